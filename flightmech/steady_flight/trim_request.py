"""A wanted steady flight by plain names, turned into what the kernel moves and what it shall reach."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from flightmech.aircraft.controls import MOVES
from flightmech.errors import SchemaError, UnknownName
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import INPUT, PARAMETER, STATE, CatalogueEntry
from flightmech.units import G0

ACCELERATIONS = ("u_dot", "v_dot", "w_dot", "p_dot", "q_dot", "r_dot")
CLIMB = "hddot"  # acceleration upward: no output, but the kernel knows it
BY_GAMMA, BY_THETA, ON_GROUND = range(3)
_SURFACES = ("delta_e", "delta_a", "delta_r")
_STRAIGHT = {"gamma": 0.0, "phi": 0.0, "psi_dot": 0.0}


@dataclass(frozen=True)
class Kind:
    """One kind of steady flight.

    Parameters
    ----------
    unknowns, residuals : tuple of str
        Unknowns, and what shall vanish.
    fixed : mapping of str to float
        Held at these values unless given otherwise. [SI]
    one_of : tuple of str
        Without a value of at least one of them the flight is not defined.
    frees : mapping of str to str
        Giving the first frees the second in its place.
    drops : mapping of str to str
        Giving the first takes the second out of the residuals.
    """

    unknowns: tuple[str, ...]
    residuals: tuple[str, ...] = ACCELERATIONS
    fixed: Mapping[str, float] = field(default_factory=dict)
    one_of: tuple[str, ...] = ()
    frees: Mapping[str, str] = field(default_factory=dict)
    drops: Mapping[str, str] = field(default_factory=dict)
    path: int = BY_GAMMA


KINDS = {
    "level": Kind(
        ("alpha", "beta", *_SURFACES, "power"), fixed=_STRAIGHT, frees={"beta": "phi", "power": "V"}
    ),
    "climb": Kind(
        ("alpha", "beta", *_SURFACES, "power"),
        fixed={"phi": 0.0, "psi_dot": 0.0},
        one_of=("gamma", "hdot", "theta", "power"),
        frees={"beta": "phi", "power": "gamma"},
    ),
    "turn": Kind(
        ("alpha", "beta", *_SURFACES, "power", "psi_dot"),
        (*ACCELERATIONS, "ay"),
        fixed={"gamma": 0.0},
        one_of=("phi", "psi_dot", "nz"),
        frees={"psi_dot": "phi", "nz": "phi", "power": "gamma"},
        drops={"beta": "ay"},
    ),
    "sideslip": Kind(
        ("alpha", "phi", *_SURFACES, "power"),
        fixed={"gamma": 0.0, "psi_dot": 0.0},
        one_of=("beta", "delta_r", "phi"),
        frees={"delta_r": "beta", "phi": "beta", "power": "gamma"},
    ),
    "pull_up": Kind(
        ("alpha", "beta", *_SURFACES, "power", "q"),
        fixed=_STRAIGHT,
        one_of=("nz", "q"),
        frees={"power": "gamma"},
    ),
    "engine_out": Kind(
        ("alpha", "phi", *_SURFACES, "power"),
        fixed={"gamma": 0.0, "psi_dot": 0.0, "beta": 0.0},
        frees={"phi": "beta", "delta_r": "beta", "power": "gamma"},
    ),
    "ground": Kind(
        ("h", "theta", "phi"),
        (CLIMB, "p_dot", "q_dot"),
        fixed={"V": 0.0, "gamma": 0.0, "psi_dot": 0.0, "gear": 1.0},
        frees={"u_dot": "power"},
        path=ON_GROUND,
    ),
}
# outputs that a start value brings about, in any kind
UNKNOWN_FOR = {"V_cas": "V", "mach": "V", "qbar": "V", "hdot": "gamma", "h_agl": "h"}


_START = ("V", "alpha", "beta", "gamma", "theta", "phi", "psi", "h", "p", "q", "r", "psi_dot")
DRIVES = {
    0.0: "throttle",
    1.0: "n1_drive",
    2.0: "thrust_drive",
}  # input that drives an engine, by mode.engine
POSITIONS, FORCES = 1.0, 2.0  # mode.controls
_TABS = {
    "column": "delta_t",
    "wheel": "delta_ta",
    "pedal": "delta_tr",
}  # what takes a force off the pilot
_ENGINE_OUTPUTS = ("thrust", "n1", "n2")
_ANGLE, _RATE = 1.5, 3.0  # limits of attitude and climb angle [rad], of rates [rad s-1]
_LIMITS = {
    "alpha": (-0.6, 0.6, 1.0),
    "beta": (-0.35, 0.35, 1.0),
    "psi": (-np.inf, np.inf, 1.0),
    "V": (1.0, 1000.0, 100.0),
    "h": (-500.0, 30000.0, 10000.0),
    **dict.fromkeys(("gamma", "theta", "phi"), (-_ANGLE, _ANGLE, 1.0)),
    **dict.fromkeys(("p", "q", "r", "psi_dot"), (-_RATE, _RATE, 1.0)),
}  # low, high, size; alpha and beta as in the kernel's own trim
_FORCE = 100.0  # size of a pilot force [N]
_TYRE = 0.2  # most deflection of a tyre along the ground [m]
RIGID = 13  # states of the rigid body in the kernel, which come first


class Request(NamedTuple):
    """What goes to the kernel; `values` are the parameters and inputs before the search, `search`
    guess, low, high and size.
    """

    kind: str
    path: int
    values: dict[str, float]
    unknowns: tuple[str, ...]
    movers: tuple[tuple[str, ...], ...]
    search: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    residuals: tuple[str, ...]
    outputs: tuple[str, ...]
    wanted: np.ndarray


def make_trim_request(
    sim: SimModel,
    parameters: Mapping[str, float],
    kind: str,
    unknowns: Sequence[str] | None,
    residuals: Sequence[str] | None,
    fixed: Mapping[str, float],
) -> Request:
    """Return the request for a kind of flight, as `flightmech.trim` describes it."""
    if kind not in KINDS:
        raise UnknownName(kind, KINDS, "kind of trim")
    modes = {name: value for name, value in fixed.items() if name.startswith("mode.")}
    others = {name: value for name, value in fixed.items() if name not in modes}
    return _RequestResolver(sim, {**parameters, **modes}, kind, others).read(unknowns, residuals)


class _RequestResolver:
    """The names of one request and what they mean for the model at hand."""

    def __init__(
        self, sim: SimModel, parameters: Mapping[str, float], kind: str, fixed: Mapping[str, float]
    ):
        self.sim, self.name, self.kind = sim, kind, KINDS[kind]
        self.states = {row.name: row for row in sim.entries(STATE)[RIGID:]}
        self.rows: dict[str, CatalogueEntry] = {
            row.name: row for row in (*sim.entries(PARAMETER), *sim.entries(INPUT))
        }
        self.values = {str(name): float(value) for name, value in parameters.items()} | {
            "mode.trim": 0.0
        }
        for name in self.values:
            if name not in self.rows:
                raise UnknownName(name, self.rows, "parameter or input")
        self.drive = DRIVES.get(
            self._value("mode.engine"), "throttle"
        )  # an invalid mode is reported by the kernel
        self.engines = [
            name.removesuffix(f".{self.drive}")
            for name in sim.inputs
            if name.endswith(f".{self.drive}")
        ]
        self.controls = self._value("mode.controls")
        self.circuits = {
            surface: item for item, surface in MOVES.items() if f"{item}.mass" in self.rows
        }
        self.given = {self._held(self._plain(name)): float(value) for name, value in fixed.items()}
        self.failed = self._failures()

    def read(self, unknowns: Sequence[str] | None, residuals: Sequence[str] | None) -> Request:
        solve_for = self._unknowns(
            None if unknowns is None else [self._plain(name) for name in unknowns]
        )
        self._defaults(solve_for)
        path = self._path(solve_for)
        if path == ON_GROUND:
            self._stand(solve_for if unknowns is None else [])
        goals = self._goals(residuals or self.kind.residuals, path) | self._forces(solve_for)
        self._refuse(solve_for, goals)
        self._guess(solve_for)
        movers = tuple(self._movers(name) for name in solve_for)
        limits = np.array(
            [
                self._limits(name, items[0], path)
                for name, items in zip(solve_for, movers, strict=True)
            ]
        )
        guess = np.array(
            [
                self._start_guess(name, items[0], path)
                for name, items in zip(solve_for, movers, strict=True)
            ]
        )
        names = tuple(self._shown(name) for name in solve_for)
        search = (guess, limits[:, 0], limits[:, 1], limits[:, 2])
        outputs = tuple(f"trim.{name}" if name in ACCELERATIONS else name for name in goals)
        return Request(
            self.name,
            path,
            self.values,
            names,
            movers,
            search,
            tuple(goals),
            outputs,
            np.array(list(goals.values())),
        )

    def _value(self, name: str) -> float:
        return self.values.get(name, self.rows[name].value)

    def _stand(self, solve_for: list[str]) -> None:
        """At rest the tyres hold what pulls along the ground, and nothing accelerates."""
        tyres = [name for name in self.states if name.endswith((".tyre_x", ".tyre_y"))]
        if not tyres:
            raise SchemaError(
                f"trim, kind {self.name}",
                ["the aircraft has no landing gear; give it [gear] in its file"],
            )
        if self._value("init.V") == 0.0:
            wheels = [
                name
                for name in tyres
                if self._value(f"{name.removeprefix('state.').rpartition('.')[0]}.friction") == 0.0
            ]
            solve_for += [name for name in wheels if name not in self.given]
            self.kind = replace(self.kind, residuals=ACCELERATIONS)

    def _plain(self, name: str) -> str:
        """Return the name of the input for what drives an engine, ``power`` for what drives all,
        start values without their prefix.
        """
        plain = name.removeprefix("init.") if name.removeprefix("init.") in _START else name
        engine, _, quantity = plain.rpartition(".")
        if quantity != self.drive.removesuffix("_drive"):
            return plain
        return f"{engine}.{self.drive}" if engine else "power"

    def _held(self, name: str) -> str:
        """Return the output for travel, force and deflection of a control circuit that something
        else drives.
        """
        item = name.removeprefix("F_")
        if item in self.circuits.values():
            driving = {POSITIONS: item, FORCES: f"F_{item}"}.get(self.controls)
            return name if name == driving else f"applied.{name}"
        return f"applied.{name}" if name in self.circuits and self.controls == POSITIONS else name

    def _forces(self, solve_for: Sequence[str]) -> dict[str, float]:
        """With forces driving, a given or unknown one holds the deflection by itself: the kernel
        has nothing to add.
        """
        named = {*solve_for, *self.given}
        forced = self.circuits.values() if self.controls == FORCES else ()
        return {f"trim.F_{item}": 0.0 for item in forced if f"F_{item}" in named}

    def _shown(self, name: str) -> str:
        return (self.drive if name == "power" else name).removesuffix("_drive")

    def _failures(self) -> set[str]:
        found = set()
        for name in [name for name in self.given if name.endswith(".failed")]:
            engine = name.removesuffix(".failed")
            if engine not in self.engines:
                raise UnknownName(name, [f"{item}.failed" for item in self.engines], "engine")
            if self.given.pop(name):
                found.add(engine)
                self.values |= self._without(engine)
        return found

    def _without(self, engine: str) -> dict[str, float]:
        """Return what stops an engine: no recorded thrust; fuel cut off, so that it windmills; else
        no thrust at all.
        """
        if self.drive == "thrust_drive":
            return {f"{engine}.thrust_drive": 0.0}
        return (
            {f"{engine}.cutoff": 1.0}
            if f"{engine}.cutoff" in self.rows
            else {f"term.{engine}.thrust": 0.0}
        )

    def _power(self, solve_for: Iterable[str] = ()) -> tuple[str, ...]:
        """Return the inputs that drive the engines that run and are not named one by one."""
        named = {*self.given, *solve_for}
        inputs = (f"{engine}.{self.drive}" for engine in self.engines if engine not in self.failed)
        return tuple(name for name in inputs if name not in named)

    def _unknowns(self, unknowns: list[str] | None) -> list[str]:
        wanted = self.kind.one_of
        named = {*self.given, *(unknowns or ())}
        self.given |= {
            name: self.values[f"init.{name}"]
            for name in wanted
            if f"init.{name}" in self.values and name not in named
        }
        stated = {
            name.removeprefix("applied.")
            for name in (*self.given, *(unknowns or ()), *self._missing())
        }
        if wanted and not stated & {*wanted}:
            raise SchemaError(
                f"trim, kind {self.name}",
                [f"no value of {_or(map(self._shown, wanted))}; give one in fixed"],
            )
        if unknowns is not None:
            return unknowns
        given = {**self.given, **dict.fromkeys(self._missing(), 0.0)}
        freed = [
            self.kind.frees.get(name.removeprefix("applied.")) or self._brought_about_by(name)
            for name in given
        ]
        solve_for = [
            self.circuits.get(name, name) if self.controls == POSITIONS else name
            for name in self.kind.unknowns
        ]
        forces = [f"F_{item}" for item in self.circuits.values()] if self.controls == FORCES else []
        return [name for name in dict.fromkeys((*solve_for, *forces, *freed)) if name not in given]

    def _brought_about_by(self, output: str) -> str:
        engine, _, quantity = output.rpartition(".")
        if engine in self.engines and quantity in _ENGINE_OUTPUTS:
            return f"{engine}.{self.drive}"
        if output.startswith(("applied.F_", "F_")):
            return _TABS.get(output.rpartition("F_")[2], output)
        return UNKNOWN_FOR.get(output, output)

    def _missing(self) -> tuple[str, ...]:
        return () if self._power() else ("power",)

    def _defaults(self, solve_for: Sequence[str]) -> None:
        """Hold what the kind holds, where nothing else is given; put what is given into parameters
        and inputs.
        """
        settled = {*solve_for, *self.given, *(name.removeprefix("init.") for name in self.values)}
        held = {name: value for name, value in self.kind.fixed.items() if name not in settled}
        if "theta" in self.given:
            held.pop("gamma", None)
        self.given = held | self.given
        for name, value in self.given.items():
            self.values |= dict.fromkeys(
                (item for item in self._settable(name) if item not in self.states), value
            )

    def _settable(self, name: str) -> tuple[str, ...]:
        """Return the parameters and inputs that are this quantity; none when it is an output or an
        acceleration.
        """
        if name == "power":
            return self._power()
        if name in ACCELERATIONS or f"init.{name}" in self.rows:
            return (f"init.{name}",)
        if name in self.rows or name in self.states:
            return (name,)
        if name not in self.sim.outputs:
            raise UnknownName(
                name,
                {*_START, *ACCELERATIONS, "throttle", "thrust", *self.rows, *self.sim.outputs},
                "quantity",
            )
        return ()

    def _path(self, solve_for: Sequence[str]) -> int:
        if self.kind.path == ON_GROUND:
            return ON_GROUND
        return BY_THETA if "theta" in (*solve_for, *self.given) else BY_GAMMA

    def _goals(self, residuals: Sequence[str], path: int) -> dict[str, float]:
        dropped = {self.kind.drops[name] for name in self.given if name in self.kind.drops}
        goals = {
            name: 0.0
            for name in residuals
            if residuals is not self.kind.residuals or name not in dropped
        }
        followers = {BY_GAMMA: ("theta",), BY_THETA: ("gamma",), ON_GROUND: ("alpha", "beta")}[path]
        for name, value in self.given.items():
            if name in ACCELERATIONS:
                goals[name] = 0.0  # less init.u_dot, which holds the value
            elif name in followers or not self._settable(name):
                goals[name] = value
        for name in goals:
            if name not in (*ACCELERATIONS, CLIMB) and name not in self.sim.outputs:
                raise UnknownName(name, {*ACCELERATIONS, CLIMB, *self.sim.outputs}, "residual")
        return goals

    def _refuse(self, solve_for: Sequence[str], goals: Mapping[str, float]) -> None:
        problems = [
            f"{self._shown(name)} is fixed and unknown at once; take one away"
            for name in solve_for
            if name in self.given
        ]
        problems += [
            f"{self._shown(name)} is named twice among the unknowns"
            for name in {*solve_for}
            if list(solve_for).count(name) > 1
        ]
        if "theta" in solve_for and "gamma" in solve_for:
            problems.append(
                "theta and gamma are both unknown, but one follows from the other; take one away"
            )
        if "power" in solve_for and not self._power(solve_for):
            problems.append(
                f"no engine is left for {self._shown('power')}; take it away from the unknowns"
            )
        if not problems and len(goals) > len(solve_for):
            surplus = len(goals) - len(solve_for)
            listed = (
                f"{len(goals)} residuals ({', '.join(goals)}) against {len(solve_for)} "
                f"unknowns ({', '.join(map(self._shown, solve_for))})"
            )
            problems.append(f"{listed}; free {surplus} more, fix fewer, or name fewer residuals")
        if problems:
            raise SchemaError(f"trim, kind {self.name}", problems)

    def _movers(self, name: str) -> tuple[str, ...]:
        items = self._settable(name)
        if not items:
            raise UnknownName(
                name,
                {*_START, "throttle", "thrust", *self.rows},
                "quantity to solve for",
                "an output cannot be moved, it can be fixed",
            )
        return items

    def _guess(self, solve_for: Sequence[str]) -> None:
        """Start where turn, bank and load factor belong together for small angles."""
        V, g = max(self._value("init.V"), 1.0), G0
        phi, turn = self._value("init.phi"), self._value("init.psi_dot")
        load = self.given.get("nz", 1.0)
        if "phi" in solve_for and "psi_dot" in self.given:
            self.values["init.phi"] = float(np.arctan(V * turn / g))
        elif "phi" in solve_for and "psi_dot" in solve_for:
            self.values["init.phi"] = phi = float(np.arccos(min(1.0, 1.0 / max(load, 1.0))))
        if "psi_dot" in solve_for:
            self.values["init.psi_dot"] = g * float(np.tan(phi)) / V
        if "q" in solve_for:
            self.values["init.q"] = (load - 1.0) * g / V

    def _start_guess(self, name: str, item: str, path: int) -> float:
        if path == ON_GROUND and name in ("h", "theta"):
            return np.nan  # standing: the kernel knows
        return 0.0 if item in self.states else self._value(item)

    def _limits(self, name: str, item: str, path: int) -> tuple[float, float, float]:
        if name == "h" and path == ON_GROUND:
            runway = self._value("env.runway_elevation")
            return runway - 20.0, runway + 50.0, 10.0
        if name in _LIMITS:
            return _LIMITS[name]
        if item in self.states:
            row = self.states[item]
            return (-_TYRE, _TYRE, 0.05 * _TYRE) if ".tyre_" in item else (row.low, row.high, 1.0)
        row, weight = self.rows[item], self._value("mass.mass") * G0
        if item.endswith(".thrust_drive"):
            return max(row.low, -weight), min(row.high, weight), weight
        size = (
            _FORCE
            if item.startswith("F_")
            else max(abs(self._value(item)), 1.0)
            if item in self.sim.parameters
            else 1.0
        )
        return row.low, row.high, size


def _or(names: Iterable[str]) -> str:
    *first, last = names
    return f"{', '.join(first)} or {last}" if first else last

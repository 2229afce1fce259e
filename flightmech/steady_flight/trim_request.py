"""A trim as the kernel solves it, from plain names of fixed and unknown quantities."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flightmech.aircraft.controls import MOVES
from flightmech.errors import SchemaError, UnknownName
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import INPUT, PARAMETER, STATE, CatalogueEntry
from flightmech.steady_flight.trim_kinds import (
    ACCELERATIONS,
    BY_GAMMA,
    BY_THETA,
    CLIMB,
    DRIVES,
    KINDS,
    ON_GROUND,
    SHAFT_DRIVES,
    UNKNOWN_FOR,
    SearchRanges,
)

# Tables of thrust or power of an engine that has no fuel to cut off.
_POWER_TABLES = ("thrust", "shaft_power", "corrected_shaft_power")
POSITIONS, FORCES = 1.0, 2.0  # mode.controls
RIGID = 13  # states of the rigid body in the kernel, which come first
_START = ("V", "alpha", "beta", "gamma", "theta", "phi", "psi", "h", "p", "q", "r", "psi_dot")
# Tab that trims out the force of a control circuit.
_TABS = {"column": "delta_t", "wheel": "delta_ta", "pedal": "delta_tr"}
_ENGINE_OUTPUTS = ("thrust", "n1", "n2", "rpm", "torque", "manifold_pressure")


def stopping_values(engine: str, sim: SimModel) -> dict[str, float]:
    """Return inputs and parameters that take the power from an engine that the lever drives.

    Parameters
    ----------
    engine : str
        ``engine1`` ...
    sim : SimModel
    """
    if f"{engine}.cutoff" in sim.inputs:
        return {f"{engine}.cutoff": 1.0}
    # An engine of a table alone has no fuel, and a motor has neither: its lever is closed.
    names = [f"term.{engine}.{table}" for table in _POWER_TABLES]
    names = [name for name in names if name in sim.parameters]
    return dict.fromkeys(names or [f"{engine}.throttle"], 0.0)


class Request(NamedTuple):
    """A trim for the kernel.

    `values` are the parameters and inputs before the search. `movers` are the states, parameters
    and inputs of each unknown. `search` is guess, low, high and size (unknown,). `targets` are the
    values of the `outputs` (residual,).
    """

    kind: str
    path: int
    values: dict[str, float]
    unknowns: tuple[str, ...]
    movers: tuple[tuple[str, ...], ...]
    search: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    residuals: tuple[str, ...]
    outputs: tuple[str, ...]
    targets: np.ndarray


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
    # A mode is a parameter also if it is given as a fixed quantity.
    modes = {name: value for name, value in fixed.items() if name.startswith("mode.")}
    quantities = {name: value for name, value in fixed.items() if name not in modes}
    resolver = _RequestResolver(sim, {**parameters, **modes}, kind, fixed=quantities)
    return resolver.resolve(unknowns, residuals)


class _RequestResolver:
    """The names of one request and their meaning in one model."""

    def __init__(
        self, sim: SimModel, parameters: Mapping[str, float], kind: str, fixed: Mapping[str, float]
    ):
        self.sim, self.name, self.kind = sim, kind, KINDS[kind]
        self.states = {row.name: row for row in sim.entries(STATE)[RIGID:]}
        self.rows: dict[str, CatalogueEntry] = {}
        for row in (*sim.entries(PARAMETER), *sim.entries(INPUT)):
            self.rows[row.name] = row
        self.values: dict[str, float] = {}
        for name, value in parameters.items():
            self.values[str(name)] = float(value)
        # The kernel must not trim again at the start.
        self.values["mode.trim"] = 0.0
        for name in self.values:
            if name not in self.rows:
                raise UnknownName(name, self.rows, "parameter or input")

        self.drive = self._find_drive()
        self.engines: list[str] = []
        for name in sim.inputs:
            if name.endswith(f".{self.drive}"):
                self.engines.append(name.removesuffix(f".{self.drive}"))
        self.controls = self._value("mode.controls")
        self.circuits: dict[str, str] = {}
        for item, surface in MOVES.items():
            if f"{item}.mass" in self.rows:
                self.circuits[surface] = item
        self.fixed: dict[str, float] = {}
        for name, value in fixed.items():
            self.fixed[self._fixed_name(self._plain_name(name))] = float(value)
        self.failed = self._stop_failed_engines()

    def resolve(self, unknowns: Sequence[str] | None, residuals: Sequence[str] | None) -> Request:
        """Return the request; unknowns and residuals are those of the kind unless given."""
        plain = None
        if unknowns is not None:
            plain = [self._plain_name(name) for name in unknowns]
        solve_for = self._choose_unknowns(plain)
        self._apply_fixed(solve_for)
        path = self._choose_path(solve_for)
        if path == ON_GROUND:
            self._set_up_ground(solve_for if unknowns is None else [])
        goals = self._choose_goals(residuals or self.kind.residuals, path)
        goals |= self._force_goals(solve_for)
        self._check(solve_for, goals)
        ranges = SearchRanges(
            self.sim, self.rows, states=self.states, values=self.values, path=path
        )
        self.values |= ranges.turn_start(solve_for, self.fixed)
        movers, limits, guesses = [], [], []
        for name in solve_for:
            items = self._find_movers(name)
            movers.append(items)
            limits.append(ranges.limits(name, items[0]))
            guesses.append(ranges.first_guess(name, items[0]))
        # low, high and size (unknown, 3)
        bounds = np.array(limits)
        outputs = []
        for name in goals:
            outputs.append(f"trim.{name}" if name in ACCELERATIONS else name)
        return Request(
            kind=self.name,
            path=path,
            values=self.values,
            unknowns=tuple(self._display_name(name) for name in solve_for),
            movers=tuple(movers),
            search=(np.array(guesses), bounds[:, 0], bounds[:, 1], bounds[:, 2]),
            residuals=tuple(goals),
            outputs=tuple(outputs),
            targets=np.array(list(goals.values())),
        )

    def _value(self, name: str) -> float:
        return self.values.get(name, self.rows[name].value)

    def _find_drive(self) -> str:
        """Return the input that brings about the power."""
        # the kernel reports an invalid mode
        drive = DRIVES.get(self._value("mode.engine"), "throttle")
        if drive != "rpm_drive":
            return drive
        # a governor holds the recorded speed at any power, which is that of the lever
        governed = [name for name in self.rows if name.endswith(".governed")]
        is_governed = any(self._value(name) != 0.0 for name in governed)
        return "throttle" if is_governed else drive

    def _set_up_ground(self, solve_for: list[str]) -> None:
        """At rest, add the deflections of the tyres to the unknowns; all accelerations vanish."""
        tyres = [name for name in self.states if name.endswith((".tyre_x", ".tyre_y"))]
        if not tyres:
            raise SchemaError(
                f"trim, kind {self.name}",
                ["the aircraft has no landing gear; give it [gear] in its file"],
            )
        if self._value("init.V") != 0.0:
            return
        for name in tyres:
            contact = name.removeprefix("state.").rpartition(".")[0]
            # a contact with a friction coefficient is a skid, without tyre deflections
            if self._value(f"{contact}.friction") == 0.0 and name not in self.fixed:
                solve_for.append(name)
        self.kind = replace(self.kind, residuals=ACCELERATIONS)

    def _plain_name(self, name: str) -> str:
        """Return the name that the resolver uses.

        ``throttle`` or ``thrust`` of an engine becomes the input that drives it, that of all
        engines becomes ``power``. Start values have no prefix.
        """
        # init.V and V are the same quantity
        plain = name
        if name.removeprefix("init.") in _START:
            plain = name.removeprefix("init.")
        engine, _, quantity = plain.rpartition(".")
        if quantity != self.drive.removesuffix("_drive"):
            return plain
        return f"{engine}.{self.drive}" if engine else "power"

    def _fixed_name(self, name: str) -> str:
        """Return the output in place of a travel, force or deflection that another input drives."""
        circuit = name.removeprefix("F_")
        if circuit in self.circuits.values():
            driving = {POSITIONS: circuit, FORCES: f"F_{circuit}"}.get(self.controls)
            return name if name == driving else f"applied.{name}"
        if name in self.circuits and self.controls == POSITIONS:
            return f"applied.{name}"
        return name

    def _force_goals(self, solve_for: Sequence[str]) -> dict[str, float]:
        """Return zero residuals of the trim force for pilot forces that are fixed or unknown.

        Such a force holds the deflection alone, so that the kernel must not add a force.
        """
        if self.controls != FORCES:
            return {}
        goals = {}
        for circuit in self.circuits.values():
            if f"F_{circuit}" in solve_for or f"F_{circuit}" in self.fixed:
                goals[f"trim.F_{circuit}"] = 0.0
        return goals

    def _display_name(self, name: str) -> str:
        """Return the name of a quantity as users write it."""
        if name == "power":
            name = self.drive
        return name.removesuffix("_drive")

    def _stop_failed_engines(self) -> set[str]:
        """Remove ``engine1.failed`` ... from the fixed quantities, and stop these engines."""
        failed: set[str] = set()
        for name in list(self.fixed):
            if not name.endswith(".failed"):
                continue
            engine = name.removesuffix(".failed")
            if engine not in self.engines:
                raise UnknownName(name, [f"{item}.failed" for item in self.engines], "engine")
            if self.fixed.pop(name):
                failed.add(engine)
                self.values |= self._stopped_engine(engine)
        return failed

    def _stopped_engine(self, engine: str) -> dict[str, float]:
        """Return the values that stop an engine.

        Raises
        ------
        SchemaError
            Torque, speed or manifold pressure drives the engines, and is not given for this one.
        """
        if self.drive == "thrust_drive":
            return {f"{engine}.thrust_drive": 0.0}
        recorded = DRIVES.get(self._value("mode.engine"), self.drive)
        if f".{recorded}" in SHAFT_DRIVES:
            # The drive decides whether the propeller windmills, turns without friction, or stops.
            name = f"{engine}.{recorded}"
            if name not in self.values and name not in self.fixed:
                raise SchemaError(
                    f"trim, kind {self.name}",
                    [
                        f"{engine}.failed: with mode.engine {self._value('mode.engine'):g} the "
                        f"drag of a failed engine is that of {name}, which is not given; give it, "
                        f"or trim with mode.engine 0, in which the propeller windmills without fuel"
                    ],
                )
            return {f"{engine}.cutoff": 1.0} if f"{engine}.cutoff" in self.rows else {}
        return stopping_values(engine, self.sim)

    def _power_inputs(self, solve_for: Sequence[str] = ()) -> tuple[str, ...]:
        """Return the inputs of all running engines that the request does not name."""
        inputs = []
        for engine in self.engines:
            name = f"{engine}.{self.drive}"
            if engine not in self.failed and name not in self.fixed and name not in solve_for:
                inputs.append(name)
        return tuple(inputs)

    def _choose_unknowns(self, unknowns: list[str] | None) -> list[str]:
        """Return the unknowns: those of the request, or those of the kind and of its freed names.

        Raises
        ------
        SchemaError
            A value is missing without which the flight is not defined.
        """
        self._fix_start_values(unknowns or [])
        missing = () if self._power_inputs() else ("power",)
        names = [*self.fixed, *(unknowns or ()), *missing]
        stated = {name.removeprefix("applied.") for name in names}
        if self.kind.one_of and not stated & {*self.kind.one_of}:
            choices = _join_choices([self._display_name(name) for name in self.kind.one_of])
            raise SchemaError(
                f"trim, kind {self.name}", [f"no value of {choices}; give one in fixed"]
            )
        if unknowns is not None:
            return unknowns
        # power that cannot be solved for counts as fixed
        fixed = dict.fromkeys([*self.fixed, *missing])
        solve_for = []
        for name in self.kind.unknowns:
            if self.controls == POSITIONS:
                name = self.circuits.get(name, name)
            solve_for.append(name)
        if self.controls == FORCES:
            solve_for += [f"F_{circuit}" for circuit in self.circuits.values()]
        for name in fixed:
            partner = self.kind.frees.get(name.removeprefix("applied."))
            solve_for.append(partner or self._unknown_for_output(name))
        # fromkeys removes duplicates and keeps the order
        return [name for name in dict.fromkeys(solve_for) if name not in fixed]

    def _fix_start_values(self, unknowns: Sequence[str]) -> None:
        """Fix the quantities of `one_of` whose start values the parameters give."""
        start_values = {}
        for name in self.kind.one_of:
            if name in self.fixed or name in unknowns:
                continue
            if f"init.{name}" in self.values:
                start_values[name] = self.values[f"init.{name}"]
        self.fixed |= start_values

    def _unknown_for_output(self, output: str) -> str:
        """Return the unknown that brings about an output, or the name itself."""
        engine, _, quantity = output.rpartition(".")
        if engine in self.engines and quantity in _ENGINE_OUTPUTS:
            return f"{engine}.{self.drive}"
        if output.startswith(("applied.F_", "F_")):
            return _TABS.get(output.rpartition("F_")[2], output)
        return UNKNOWN_FOR.get(output, output)

    def _apply_fixed(self, solve_for: Sequence[str]) -> None:
        """Add the fixed quantities of the kind, and write all of them to parameters and inputs."""
        stated = {*solve_for, *self.fixed}
        stated |= {name.removeprefix("init.") for name in self.values}
        defaults = {}
        for name, value in self.kind.fixed.items():
            if name not in stated:
                defaults[name] = value
        if "theta" in self.fixed:  # the climb angle follows from the pitch attitude
            defaults.pop("gamma", None)
        self.fixed = defaults | self.fixed
        for name, value in self.fixed.items():
            for item in self._settable_names(name):
                if item not in self.states:
                    self.values[item] = value

    def _settable_names(self, name: str) -> tuple[str, ...]:
        """Return the states, parameters and inputs that are a quantity; none for an output."""
        if name == "power":
            return self._power_inputs()
        if name in ACCELERATIONS or f"init.{name}" in self.rows:
            return (f"init.{name}",)
        if name in self.rows or name in self.states:
            return (name,)
        if name not in self.sim.outputs:
            allowed = {*_START, *ACCELERATIONS, "throttle", "thrust", *self.rows}
            raise UnknownName(name, {*allowed, *self.sim.outputs}, "quantity")
        return ()

    def _choose_path(self, solve_for: Sequence[str]) -> int:
        if self.kind.path == ON_GROUND:
            return ON_GROUND
        if "theta" in solve_for or "theta" in self.fixed:
            return BY_THETA
        return BY_GAMMA

    def _choose_goals(self, residuals: Sequence[str], path: int) -> dict[str, float]:
        """Return the values of the residuals by name."""
        dropped: set[str | None] = set()
        if residuals is self.kind.residuals:
            for name in self.fixed:
                dropped.add(self.kind.drops.get(name))
        goals = {name: 0.0 for name in residuals if name not in dropped}
        # Quantities that follow from the others on this path: they are fixed as residuals.
        followers = {BY_GAMMA: ("theta",), BY_THETA: ("gamma",), ON_GROUND: ("alpha", "beta")}
        for name, value in self.fixed.items():
            if name in ACCELERATIONS:
                goals[name] = 0.0  # the kernel subtracts init.u_dot, which holds the value
            elif name in followers[path] or not self._settable_names(name):
                goals[name] = value
        for name in goals:
            if name not in (*ACCELERATIONS, CLIMB) and name not in self.sim.outputs:
                raise UnknownName(name, {*ACCELERATIONS, CLIMB, *self.sim.outputs}, "residual")
        return goals

    def _check(self, solve_for: Sequence[str], goals: Mapping[str, float]) -> None:
        """Raise SchemaError with all contradictions of the request."""
        problems = []
        for name in solve_for:
            if name in self.fixed:
                problems.append(
                    f"{self._display_name(name)} is fixed and unknown at once; take one away"
                )
        for name in {*solve_for}:
            if list(solve_for).count(name) > 1:
                problems.append(f"{self._display_name(name)} is named twice among the unknowns")
        # theta = gamma + alpha without bank and sideslip
        if "theta" in solve_for and "gamma" in solve_for:
            problems.append(
                "theta and gamma are both unknown, but one follows from the other; take one away"
            )
        if "power" in solve_for and not self._power_inputs(solve_for):
            problems.append(
                f"no engine is left for {self._display_name('power')}; take it away from the "
                f"unknowns"
            )
        if not problems and len(goals) > len(solve_for):
            unknowns = ", ".join(map(self._display_name, solve_for))
            problems.append(
                f"{len(goals)} residuals ({', '.join(goals)}) against {len(solve_for)} unknowns "
                f"({unknowns}); free {len(goals) - len(solve_for)} more, fix fewer, or name fewer "
                f"residuals"
            )
        if problems:
            raise SchemaError(f"trim, kind {self.name}", problems)

    def _find_movers(self, name: str) -> tuple[str, ...]:
        """Return the states, parameters and inputs that an unknown moves."""
        items = self._settable_names(name)
        if not items:
            raise UnknownName(
                name,
                {*_START, "throttle", "thrust", *self.rows},
                "quantity to solve for",
                "an output cannot be moved, it can be fixed",
            )
        return items


def _join_choices(names: Iterable[str]) -> str:
    *first, last = names
    return f"{', '.join(first)} or {last}" if first else last

"""A steady flight of an aircraft with a database: coefficients and static derivatives about it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.optimize import root_scalar

from flightmech import build_up, terms
from flightmech.aircraft.aircraft import Aircraft
from flightmech.axes import lift_drag
from flightmech.errors import SimulationError
from flightmech.names import COEFFICIENTS
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.compiler import compile as compile_model
from flightmech.simulation.kernel import PARAMETER, Simulation
from flightmech.simulation.run import constant_inputs, initialise_run
from flightmech.steady_flight.flight_condition import condition_parameters, flight_condition_text
from flightmech.steady_flight.trim_search import trimmed_outputs
from flightmech.units import G0

HINGES = ("Ch_e", "Ch_a", "Ch_r")
VARIABLES = (
    "alpha",
    "beta",
    "V",
    "phat",
    "qhat",
    "rhat",
    "alphadothat",
    "betadothat",
    "dnz",
    "delta_e",
    "delta_a",
    "delta_r",
)
STEP = float(np.finfo(float).eps ** (1.0 / 3.0))  # of a variable's size, for central differences
_LEFT = 1e-6  # acceleration that still counts as trimmed [m s-2, rad s-2]
# path angle of an aircraft without engines that has no steady glide; it is reported as not trimmed
# [rad]
_NO_GLIDE = -0.05
_STEEPEST = 1.4  # path angle up to which a steady glide is looked for [rad]
_GLIDES = 29  # of the grid, every 0.05 rad


@dataclass(frozen=True)
class CompiledAircraft:
    """An aircraft and its database, compiled, with what is evaluated of them again and again.

    Parameters
    ----------
    aircraft : Aircraft
        Geometry, engines, controls.
    db : DataTree
        The database, for what the kernel does not fly.
    sim : SimModel
        The two compiled.
    """

    aircraft: Aircraft
    db: xr.DataTree = field(repr=False)
    sim: SimModel = field(repr=False)

    @cached_property
    def defaults(self) -> dict[str, float]:
        """Default of each parameter."""
        return {row.name: row.value for row in self.sim.entries(PARAMETER)}

    @cached_property
    def force_axes(self) -> str:
        """Axes of the force coefficients of the database."""
        return str(self.sim.meta["force_axes"])

    @cached_property
    def hinges(self) -> dict[str, list[xr.Dataset]]:
        """Terms of the hinge moments by coefficient."""
        found = [name for name in HINGES if name in self.db.children]
        return {
            name: [node.to_dataset() for node in self.db[name].children.values()] for name in found
        }

    @cached_property
    def lift_range(self) -> dict[str, tuple[float, float]]:
        """First and last breakpoint that all lift tables share, by axis."""
        groups = [
            self.db[name].children.values()
            for name in ("CL", "CX", "CZ")
            if name in self.db.children
        ]
        points = [
            (str(axis), node.coords[axis].values)
            for group in groups
            for node in group
            for axis in node.coords
        ]
        ends = [
            (axis, float(values[0]), float(values[-1]))
            for axis, values in points
            if values.size > 1
        ]
        return {
            axis: (max(e[1] for e in ends if e[0] == axis), min(e[2] for e in ends if e[0] == axis))
            for axis in {e[0] for e in ends}
        }


@dataclass(frozen=True)
class Point:
    """A trimmed flight over a flat Earth.

    Parameters
    ----------
    pair : Pair
        Aircraft and database.
    parameters : dict of str to float
        Parameters and inputs of the flight. [SI]
    trimmed : dict of str to float
        All outputs of the kernel there.
    """

    pair: CompiledAircraft
    parameters: dict[str, float]
    trimmed: dict[str, float] = field(repr=False)

    def __getitem__(self, name: str) -> float:
        """Return an output of the trimmed flight, ``point["alpha"]``."""
        return self.trimmed[name]

    def at(self, **changes: float) -> Point:
        """Return the flight trimmed anew with other parameters; a dot in a name is written ``__``.
        [SI]
        """
        return _trimmed(
            self.pair,
            {
                **self.parameters,
                **{name.replace("__", "."): value for name, value in changes.items()},
            },
        )

    def parameter(self, name: str) -> float:
        """Return a parameter of the flight, its default when none was given."""
        return self.parameters.get(name, self.pair.defaults[name])

    @property
    def aircraft(self) -> Aircraft:
        """The aircraft."""
        return self.pair.aircraft

    @property
    def sim(self) -> SimModel:
        """The compiled model."""
        return self.pair.sim

    @property
    def mass(self) -> float:
        """Mass. [kg]"""
        return self.parameter("mass.mass")

    @property
    def weight(self) -> float:
        """Weight. [N]"""
        return self.mass * G0

    @property
    def cg(self) -> np.ndarray:
        """Centre of gravity (3,) from the moment reference point, body axes. [m]"""
        return np.array([self.parameter(f"mass.{name}_cg_b") for name in "xyz"])

    @property
    def CW(self) -> float:
        """Weight over dynamic pressure and area. [1]"""
        return self.weight / (self["qbar"] * self.aircraft.S)

    @property
    def thrust(self) -> float:
        """Sum of the net thrusts. [N]"""
        return sum(
            self[f"engine{number}.thrust"] for number in range(1, len(self.aircraft.engines) + 1)
        )

    @property
    def fuel_flow(self) -> float:
        """Sum of the fuel flows of engines with decks. [kg s-1]"""
        return sum(
            self[f"engine{number}.fuel_flow"] for number in range(1, len(self.aircraft.engines) + 1)
        )

    @property
    def excess(self) -> float:
        """Largest acceleration that remains after the longitudinal controls. [m s-2, rad s-2]"""
        return max(abs(self[f"trim.{name}_dot"]) for name in "uwq")

    def level(self, V: float, h: float | None = None) -> Point:
        """Return level flight at another speed [m s-1] and height [m], with whatever thrust it
        takes.
        """
        return self.at(
            init__V=V, init__gamma=0.0, mode__engine=2.0, init__h=self["h"] if h is None else h
        )

    @property
    def is_trimmed(self) -> bool:
        """Whether speed, path and pitch are steady."""
        return self.excess < _LEFT

    @cached_property
    def variables(self) -> dict[str, float]:
        """Every model variable of the flight, by name."""
        craft = self.aircraft
        half = 0.5 / self["V"]
        found = {
            name: self[name]
            for name in ("alpha", "beta", "mach", "h", "h_agl", "V", "qbar", "p", "q", "r", "phi")
        }
        found |= {
            "phat": self["p"] * craft.b * half,
            "qhat": self["q"] * craft.cbar * half,
            "rhat": self["r"] * craft.b * half,
        }
        found |= {"alphadothat": 0.0, "betadothat": 0.0, "dnz": self["nz"] - 1.0}
        found |= {
            name.removeprefix("applied."): value
            for name, value in self.trimmed.items()
            if name.startswith("applied.")
        }
        inputs = dict(zip(self.sim.inputs, constant_inputs(self.sim, self.parameters), strict=True))
        found |= {"gear": inputs["gear"], "speedbrake": inputs["speedbrake"]}
        found["x_cg"] = craft.x_ref_mac - self.cg[0] / craft.cbar
        for number in range(1, len(craft.engines) + 1):
            lever = (
                inputs[f"engine{number}.throttle"]
                + self.parameter("bias.throttle")
                + self["trim.throttle"]
            )
            found |= {
                f"engine{number}.throttle": lever,
                f"engine{number}.thrust": self[f"engine{number}.thrust"],
            }
        found["CT"] = self.thrust / (self["qbar"] * craft.S)
        return found

    @property
    def power_off(self) -> dict[str, float]:
        """Model variables of power, as they are with throttles closed and without thrust."""
        return {
            **self.with_thrust([0.0] * len(self.aircraft.engines)),
            **dict.fromkeys(self._levers(), 0.0),
        }

    def with_thrust(self, thrust: Sequence[float] | np.ndarray) -> dict[str, float]:
        """Return the model variables of the thrust, ``CT`` and that of each engine, for other
        thrusts (engine,). [N]
        """
        found = {f"engine{number}.thrust": float(one) for number, one in enumerate(thrust, 1)}
        return {**found, "CT": float(sum(thrust)) / (self["qbar"] * self.aircraft.S)}

    def _levers(self) -> list[str]:
        return [f"engine{number}.throttle" for number in range(1, len(self.aircraft.engines) + 1)]

    @cached_property
    def _scaled(self) -> Simulation:
        run = Simulation(self.sim.model)
        for name, value in self.parameters.items():
            if name.startswith("term."):
                run.set_parameter(self.sim.parameters.index(name), float(value))
        return run

    def coefficients(self, **values: ArrayLike) -> np.ndarray:
        """Return CL, CD (stability axes), CY (body axis), Cl, Cm, Cn about the moment reference
        point (6, ...).

        Parameters
        ----------
        **values : array (...)
            Model variables that differ from the trimmed flight, broadcast against each other; with
            ``V`` the Mach number, the dynamic pressure and, at constant thrust, ``CT`` follow. [SI]
        """
        known: dict[str, ArrayLike] = {**self.variables, **values}
        if "V" in values:
            ratio = np.asarray(values["V"]) / self["V"]
            known |= {
                "mach": self["mach"] * ratio,
                "qbar": self["qbar"] * ratio**2,
                "CT": self.variables["CT"] / ratio**2,
            }
            known |= {
                name: value for name, value in values.items() if name in ("mach", "qbar", "CT")
            }
        shape = np.broadcast_shapes(*(np.shape(value) for value in known.values()))
        own = {
            name: 0.0 for name in self.sim.variables if "." in name or name == "fuel"
        }  # of engine decks and legs: in no coefficient
        known = own | known
        summed = [
            name
            for name in self.sim.variables
            if name in build_up.COEFFICIENTS and name not in values
        ]
        found = self._summed({**known, **dict.fromkeys(summed, 0.0)}, shape)
        for _ in summed:  # a pass completes the coefficients of one level at least
            found = self._summed({**known, **self._as_variables(found, known, summed)}, shape)
        return found

    def _summed(self, known: Mapping[str, ArrayLike], shape: tuple[int, ...]) -> np.ndarray:
        """Return what `coefficients` does, of given variables."""
        rows = [
            np.broadcast_to(np.asarray(known[name], float), shape).ravel()
            for name in self.sim.variables
        ]
        table = np.stack(rows, axis=-1) if rows else np.empty((int(np.prod(shape)), 0))
        c = self._scaled.evaluate(table)[0].T.reshape(6, *shape)
        bias = np.array([self.parameter(f"bias.{name}") for name in COEFFICIENTS]).reshape(
            6, *(1 for _ in shape)
        )
        return _to_stability(c, self.pair.force_axes, known["alpha"], known["beta"]) + bias

    def _as_variables(
        self, c: np.ndarray, known: Mapping[str, ArrayLike], wanted: Sequence[str]
    ) -> dict[str, np.ndarray]:
        """Return coefficients in the axes of the database, as its terms take them."""
        CL, CD, CY, Cl, Cm, Cn = c
        alpha, beta = np.asarray(known["alpha"]), np.asarray(known["beta"])
        found = {"CL": CL, "CD": CD, "CY": CY, "Cl": Cl, "Cm": Cm, "Cn": Cn}
        found |= {
            "CX": CL * np.sin(alpha) - CD * np.cos(alpha),
            "CZ": -CL * np.cos(alpha) - CD * np.sin(alpha),
        }
        if self.pair.force_axes == "wind":
            found |= {
                "CD": CD * np.cos(beta) - CY * np.sin(beta),
                "CY": CD * np.sin(beta) + CY * np.cos(beta),
            }
        return {name: found[name] for name in wanted}

    def body(self, x_cg_b: float | None = None, **values: ArrayLike) -> np.ndarray:
        """Return CX, CY, CZ and Cl, Cm, Cn about the centre of gravity (6, ...), body axes;
        `x_cg_b` [m] puts it somewhere else.
        """
        craft, (x, y, z) = self.aircraft, self.cg
        if x_cg_b is not None:
            x, values = x_cg_b, {"x_cg": craft.x_ref_mac - x_cg_b / craft.cbar, **values}
        alpha = values.get("alpha", self.variables["alpha"])
        CL, CD, CY, Cl, Cm, Cn = self.coefficients(**values)
        CX, CZ = CL * np.sin(alpha) - CD * np.cos(alpha), -CL * np.cos(alpha) - CD * np.sin(alpha)
        moved = (
            Cl + (CY * z - CZ * y) / craft.b,
            Cm + (CZ * x - CX * z) / craft.cbar,
            Cn + (CX * y - CY * x) / craft.b,
        )
        return np.stack([CX, CY, CZ, *moved])

    def slope(self, variable: str, x_cg_b: float | None = None) -> np.ndarray:
        """Return the slopes of `body` (6,) over a model variable. [per unit of the variable, SI]"""
        middle, step = self.variables[variable], STEP * max(abs(self.variables[variable]), 1.0)
        up, down = (self.body(x_cg_b, **{variable: middle + sign * step}) for sign in (1.0, -1.0))
        return (up - down) / (2.0 * step)

    def derivatives(self, variables: Sequence[str] = VARIABLES) -> xr.Dataset:
        """Return the derivatives of the six coefficients about the moment reference point; CL, CD
        in stability, the rest in body axes.

        Returns
        -------
        Dataset
            ``value (coefficient, variable)``, per unit of the variable [SI]; derivatives over ``V``
            hold the change with Mach number and dynamic pressure, per m/s.
        """
        columns = []
        for name in variables:
            middle, step = self.variables[name], STEP * max(abs(self.variables[name]), 1.0)
            columns.append(
                (
                    self.coefficients(**{name: middle + step})
                    - self.coefficients(**{name: middle - step})
                )
                / (2.0 * step)
            )
        coords = {"coefficient": list(COEFFICIENTS), "variable": list(variables)}
        return xr.Dataset(
            {"value": (("coefficient", "variable"), np.stack(columns, axis=1))}, coords
        )

    def hinge(self, coefficient: str, **values: float) -> float | None:
        """Return a hinge-moment coefficient, None when the database has none; beyond its tables as
        the simulation does.
        """
        if coefficient not in self.pair.hinges:
            return None
        known = {**self.variables, **values}
        return float(
            sum(
                terms.evaluate_term(leaf, known, outside="clamp")
                for leaf in self.pair.hinges[coefficient]
            )
        )

    def hinge_slope(self, coefficient: str, variable: str) -> float:
        """Return the slope of a hinge-moment coefficient over a model variable."""
        middle, step = self.variables[variable], STEP * max(abs(self.variables[variable]), 1.0)
        up, down = (
            self.hinge(coefficient, **{variable: middle + sign * step}) or 0.0
            for sign in (1.0, -1.0)
        )
        return (up - down) / (2.0 * step)


def trimmed_at(aircraft: Aircraft, db: xr.DataTree, condition: Mapping[str, float]) -> Point:
    """Return the trimmed flight at a condition.

    Parameters
    ----------
    aircraft, db
        Compiled together; hinge moments (``Ch_e Ch_a Ch_r``) of the database are kept with them.
    condition : mapping of str to float
        As in `flightmech.characteristics`; ``gamma`` of an aircraft without engines is found. [SI]

    Raises
    ------
    UnknownName
        A name that is none of these.
    SchemaError
        No speed, or two.
    SimulationError
        No steady flight is found; the text gives the remaining accelerations and the control that
        is at its limit.
    """
    sim = compile_model(aircraft, db)
    point = _trimmed(CompiledAircraft(aircraft, db, sim), condition_parameters(sim, condition))
    if not point.is_trimmed:
        kind = "flight" if aircraft.engines else "glide (the aircraft file has no engines)"
        raise SimulationError(
            f"no steady {kind} at {flight_condition_text(condition)}: {_left(point)}; change the condition or "
            f"the limits of the controls"
        )
    return point


def _trimmed(pair: CompiledAircraft, parameters: dict[str, float]) -> Point:
    if not pair.aircraft.engines:
        parameters = {**parameters, "init.gamma": _glide(pair, parameters)}
    return Point(pair, parameters, _outputs(pair, parameters))


def _outputs(pair: CompiledAircraft, parameters: Mapping[str, float]) -> dict[str, float]:
    return dict(
        zip(pair.sim.outputs, map(float, trimmed_outputs(pair.sim, parameters)), strict=True)
    )


def _glide(pair: CompiledAircraft, parameters: Mapping[str, float]) -> float:
    """Return the path angle at which an aircraft without engines neither gains nor loses speed;
    `_NO_GLIDE` if there is none. [rad]
    """

    def gain(gamma: float) -> float:
        return _outputs(pair, {**parameters, "init.gamma": gamma})["trim.u_dot"]

    try:
        found = root_scalar(
            gain, x0=_NO_GLIDE, x1=2.0 * _NO_GLIDE, method="secant", xtol=1e-12, maxiter=50
        )
    except SimulationError:  # the secant ran away from a flight that cannot be trimmed
        return _bracketed_glide(gain)
    return (
        float(found.root)
        if found.converged and abs(found.root) < _STEEPEST
        else _bracketed_glide(gain)
    )


def _bracketed_glide(gain: Callable[[float], float]) -> float:
    """Return the shallowest path angle of no gain on a grid of glides, refined; `_NO_GLIDE` if the
    gain has one sign there. [rad]
    """
    grid = np.linspace(0.0, -_STEEPEST, _GLIDES)
    gains = np.array([gain(float(gamma)) for gamma in grid])
    changes = np.flatnonzero(np.sign(gains[:-1]) * np.sign(gains[1:]) <= 0.0)
    if not changes.size:
        return _NO_GLIDE
    ends = grid[changes[0]], grid[changes[0] + 1]
    return float(root_scalar(gain, bracket=ends, method="brentq", xtol=1e-12).root)


def _left(point: Point) -> str:
    left = ", ".join(f"{name}_dot {point[f'trim.{name}_dot']:.3g}" for name in "uwq")
    ends = [
        f"{name} {np.degrees(point[f'applied.{name}']):.3g} deg"
        for name in ("delta_e",)
        if _at_end(point, name)
    ]
    place = ", ".join([f"alpha {np.degrees(point['alpha']):.3g} deg", *ends])
    return f"accelerations of {left} (m/s2, rad/s2) remain at {place}"


def _at_end(point: Point, control: str) -> bool:
    limits = point.aircraft.limits.get(control)
    return limits is not None and bool(
        np.isclose(point[f"applied.{control}"], limits, atol=1e-9).any()
    )


def _to_stability(c: np.ndarray, force_axes: str, alpha: ArrayLike, beta: ArrayLike) -> np.ndarray:
    """Turn force coefficients of the database (order of `packer.FORCES`) to stability-axis CL, CD
    and body-axis CY.
    """
    if force_axes == "stability":
        return c
    if force_axes == "body":
        CL, CD = lift_drag(c[0], c[1], alpha)
        return np.stack([CL, CD, *c[2:]])
    along, side = (
        -c[1] * np.cos(beta) - c[2] * np.sin(beta),
        -c[1] * np.sin(beta) + c[2] * np.cos(beta),
    )
    return np.stack([c[0], -along, side, *c[3:]])


NO_THRUST = "the aircraft file gives an engine neither a thrust table nor a deck"
_SPEEDS = tuple(
    f"{corrected}{n}_command" for corrected in ("", "corrected_") for n in ("n1", "n2")
)  # tables of a deck that govern


class Heights(NamedTuple):
    """What thrust does over height: where its tables end [m], infinite when none has such an axis;
    whether it goes with the pressure.
    """

    end: float
    lapses: bool


def has_thrust(aircraft: Aircraft) -> bool:
    """Return whether there are engines and each has a thrust table or a deck."""
    return bool(aircraft.engines) and all(
        engine.thrust is not None or engine.deck is not None for engine in aircraft.engines
    )


def burns_fuel(aircraft: Aircraft) -> bool:
    """Return whether there are engines and each has a deck with a fuel flow."""
    decks = [engine.deck for engine in aircraft.engines]
    return bool(decks) and all(
        deck is not None and {"fuel_flow", "corrected_fuel_flow"} & set(deck.tables)
        for deck in decks
    )


def full_thrust(flight: Point) -> np.ndarray:
    """Return the net thrust (engine,) at full throttle, spools settled, at the speed and height of
    a flight. [N]
    """
    numbers = range(1, len(flight.aircraft.engines) + 1)
    full = flight.aircraft.limits.get("throttle", (0.0, 1.0))[1] - flight.parameter("bias.throttle")
    lever = {f"engine{number}.throttle": full for number in numbers}
    attitude = {"init.alpha": flight["alpha"], "init.beta": flight["beta"]}
    values = {**flight.parameters, **attitude, **lever, "mode.engine": 0.0, "mode.trim": 0.0}
    outputs = initialise_run(flight.sim, values, constant_inputs(flight.sim, values)).outputs()
    return np.array(
        [outputs[flight.sim.outputs.index(f"engine{number}.thrust")] for number in numbers]
    )


def thrust_over_height(aircraft: Aircraft) -> Heights:
    """Return what the thrust at full throttle does over height, of the engine whose tables end
    first.
    """
    tables: list[xr.Dataset] = []
    lapses = []
    for engine in aircraft.engines:
        deck = {} if engine.deck is None else engine.deck.tables
        tables += [deck[name] for name in ("thrust", "corrected_thrust", *_SPEEDS) if name in deck]
        tables += [] if engine.thrust is None else [engine.thrust]
        lapses.append("corrected_thrust" in deck)
    ends = [float(leaf["h"][-1]) for leaf in tables if "h" in leaf.coords and leaf["h"].size > 1]
    return Heights(min(ends, default=np.inf), all(lapses))

"""A steady flight of an aircraft with its coefficients and static derivatives.

The coefficients come from the compiled model. Central differences give the derivatives.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from flightmech import build_up, terms
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import SimulationError
from flightmech.names import COEFFICIENTS, IMPLICIT, REDUCED_RATES
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.compiler import compile as compile_model
from flightmech.simulation.kernel import Simulation
from flightmech.simulation.run import Stated, constant_inputs, values_in_si
from flightmech.steady_flight.compiled_aircraft import CompiledAircraft
from flightmech.steady_flight.flight_condition import condition_parameters, flight_condition_text
from flightmech.steady_flight.glide_angle import find_glide_angle
from flightmech.steady_flight.stated_speeds.odd_speeds import describe_odd_flight
from flightmech.steady_flight.trim_findings import (
    STATED,
    TRIMMED,
    alpha_grid,
    describe_accelerations,
    describe_greatest_lift,
    describe_missing_terms,
    describe_tables_left,
    weigh_accelerations,
)
from flightmech.units import DEGREE, G0

VARIABLES = (
    "alpha",
    "beta",
    "V",
    *REDUCED_RATES,
    "dnz",
    "delta_e",
    "delta_a",
    "delta_r",
)
# Step of central differences, relative to a variable: balances truncation and rounding.
STEP = float(np.finfo(float).eps ** (1.0 / 3.0))
# Largest bank in place of a rudder: that of a flight with a failed engine. [rad]
_BANK = 5.0 * DEGREE
_SHOWN_BANK = 0.005  # smallest bank that a remark states [deg]
# outputs of the kernel that are model variables of the same name
_OUTPUT_VARIABLES = (
    "alpha",
    "beta",
    "mach",
    "h",
    "h_agl",
    "V",
    "qbar",
    "p",
    "q",
    "r",
    "phi",
)


@dataclass(frozen=True)
class Point:
    """A trimmed flight over a flat Earth.

    Parameters
    ----------
    compiled : CompiledAircraft
        Aircraft and database.
    parameters : dict of str to float
        Parameters and inputs of the flight. [SI]
    trimmed : dict of str to float
        All outputs of the kernel in the trimmed state. [SI]
    """

    compiled: CompiledAircraft
    parameters: dict[str, float]
    trimmed: dict[str, float] = field(repr=False)

    def __getitem__(self, name: str) -> float:
        """Return an output of the trimmed flight, ``point["alpha"]``."""
        return self.trimmed[name]

    def retrim(self, **changes: float) -> Point:
        """Return the flight trimmed again with other parameters. [SI]

        A dot in the name of a parameter is written ``__``.
        """
        parameters = dict(self.parameters)
        for name, value in changes.items():
            parameters[name.replace("__", ".")] = value
        return _trim_flight(self.compiled, parameters)

    def parameter(self, name: str) -> float:
        """Return a parameter of the flight, or its default."""
        return self.parameters.get(name, self.compiled.defaults[name])

    @property
    def aircraft(self) -> Aircraft:
        """The aircraft."""
        return self.compiled.aircraft

    @property
    def sim(self) -> SimModel:
        """The compiled model."""
        return self.compiled.sim

    @property
    def mass(self) -> float:
        """Mass of the flight, with the fuel that is in its tanks. [kg]"""
        return self["mass"]

    @property
    def weight(self) -> float:
        """Weight. [N]"""
        return self.mass * G0

    @property
    def cg(self) -> np.ndarray:
        """Centre of gravity (3,) from the moment reference point, body axes. [m]"""
        # a model with fuel has it as an output, since the fuel of the flight moves it
        names = [f"{axis}_cg_b" for axis in "xyz"]
        return np.array([self.trimmed.get(k, self.parameter(f"mass.{k}")) for k in names])

    @property
    def CW(self) -> float:
        """Weight over dynamic pressure and area. [1]"""
        return self.weight / (self["qbar"] * self.aircraft.S)

    @property
    def thrust(self) -> float:
        """Sum of the net thrusts. [N]"""
        return sum(self[f"{engine}.thrust"] for engine in self._engine_names)

    @property
    def fuel_flow(self) -> float:
        """Sum of the fuel flows of engines with decks. [kg s-1]"""
        return sum(self[f"{engine}.fuel_flow"] for engine in self._engine_names)

    @property
    def is_trimmed(self) -> bool:
        """Whether all six accelerations are at most `TRIMMED`."""
        return not self.remaining(TRIMMED)

    def remaining(self, least: float) -> list[str]:
        """Return the letters of the accelerations beyond `least` [m s-2], as ``["v", "r"]``."""
        weighted = weigh_accelerations(self.trimmed, self.aircraft.b)
        return [letter for letter, size in weighted.items() if not size <= least]

    @property
    def remarks(self) -> list[str]:
        """Bank that balances the flight, and accelerations that the trim leaves, in words."""
        texts = []
        bank = float(np.degrees(self["phi"] - self.parameter("init.phi")))
        if self.parameter("init.phi_range") > 0.0 and abs(bank) >= _SHOWN_BANK:
            text = f"a bank of {bank:.2f} deg balances the flight"
            # The condition may allow a bank of a flight with a rudder, too.
            if "delta_r" in self.compiled.missing_terms:
                text = f"the database has no term of the rudder, such as Cn/rudder: {text}"
            texts.append(text)
        letters = self.remaining(STATED)
        if letters:
            rates = describe_accelerations(self.trimmed, letters)
            texts.append(f"trimmed to {TRIMMED:g} m/s2; accelerations of {rates} remain")
        return texts

    @property
    def tables_left(self) -> list[str]:
        """A text for each variable of the flight that is beyond its tables."""
        return list(describe_tables_left(self.sim, self.trimmed).values())

    @property
    def _engine_names(self) -> list[str]:
        return [f"engine{number}" for number in range(1, len(self.aircraft.engines) + 1)]

    def trim_level(self, V: float, h: float | None = None) -> Point:
        """Return level flight at another speed [m s-1] and height [m], trimmed by thrust."""
        if h is None:
            h = self["h"]
        return self.retrim(init__V=V, init__gamma=0.0, mode__engine=2.0, init__h=h)

    @cached_property
    def variables(self) -> dict[str, float]:
        """Every model variable of the flight, by name. [SI]"""
        craft = self.aircraft
        values = {name: self[name] for name in _OUTPUT_VARIABLES}
        half = 0.5 / self["V"]
        for name, (rate, length) in REDUCED_RATES.items():
            if name in IMPLICIT:
                # alpha_dot and beta_dot of a steady flight
                values[name] = 0.0
            elif rate in self.trimmed:
                values[name] = self[rate] * getattr(craft, length) * half
        values["dnz"] = self["nz"] - 1.0
        # positions of the controls as they act: input, bias and trim together
        for name, value in self.trimmed.items():
            if name.startswith("applied."):
                values[name.removeprefix("applied.")] = value
        # inputs without a bias act as they are
        inputs = dict(zip(self.sim.inputs, constant_inputs(self.sim, self.parameters), strict=True))
        values |= {"gear": inputs["gear"], "speedbrake": inputs["speedbrake"]}
        values["x_cg"] = craft.x_ref_mac - self.cg[0] / craft.cbar
        for engine in self._engine_names:
            lever = inputs[f"{engine}.throttle"]
            lever = lever + self.parameter("bias.throttle") + self["trim.throttle"]
            values[f"{engine}.throttle"] = lever
            values[f"{engine}.thrust"] = self[f"{engine}.thrust"]
        values["CT"] = self.thrust / (self["qbar"] * craft.S)
        return values | self.compiled.part_variables(values, inputs, self.trimmed)

    @cached_property
    def _scaled_simulation(self) -> Simulation:
        """A simulation with the scale factors of the terms of this flight."""
        run = Simulation(self.sim.model)
        for name, value in self.parameters.items():
            if name.startswith("term."):
                run.set_parameter(self.sim.parameters.index(name), float(value))
        return run

    def coefficients(self, **values: ArrayLike) -> np.ndarray:
        """Return CL, CD (stability axes), CY (body axis), Cl, Cm, Cn (6, ...).

        The moments are about the moment reference point.

        Parameters
        ----------
        **values : array (...)
            Model variables that differ from the trimmed flight, broadcast against each other. With
            ``V`` the Mach number and the dynamic pressure follow. ``CT`` follows, too, at constant
            thrust. [SI]
        """
        variables: dict[str, ArrayLike] = {**self.variables, **values}
        if "V" in values:
            ratio = np.asarray(values["V"]) / self["V"]
            followers = {
                "mach": self["mach"] * ratio,
                "qbar": self["qbar"] * ratio**2,
                "CT": self.variables["CT"] / ratio**2,
            }
            for name, value in followers.items():
                variables[name] = values.get(name, value)
        shape = np.broadcast_shapes(*map(np.shape, variables.values()))
        # Terms may depend on other coefficients. They start at zero, and each pass completes the
        # coefficients of at least one level.
        coupled = [
            name
            for name in self.sim.variables
            if name in build_up.COEFFICIENTS and name not in values
        ]
        coefficients = self._evaluate_build_up(
            {**variables, **dict.fromkeys(coupled, 0.0)}, shape=shape
        )
        for _ in coupled:
            estimates = self.compiled.to_database_axes(coefficients, variables)
            inserted = {name: estimates[name] for name in coupled}
            coefficients = self._evaluate_build_up({**variables, **inserted}, shape=shape)
        return coefficients

    def _evaluate_build_up(
        self, variables: Mapping[str, ArrayLike], shape: tuple[int, ...]
    ) -> np.ndarray:
        """Return CL, CD, CY, Cl, Cm, Cn (6, ...) for one value of every model variable."""
        columns = [
            np.broadcast_to(np.asarray(variables[name], float), shape).ravel()
            for name in self.sim.variables
        ]
        if columns:
            table = np.stack(columns, axis=-1)
        else:
            table = np.empty((int(np.prod(shape)), 0))
        # sums of the terms (coefficient, ...)
        sums = self._scaled_simulation.evaluate(table)[0].T.reshape(6, *shape)
        biases = np.array([self.parameter(f"bias.{name}") for name in COEFFICIENTS])
        biases = biases.reshape(6, *[1] * len(shape))
        stability = self.compiled.to_stability(
            sums, alpha=variables["alpha"], beta=variables["beta"]
        )
        return stability + biases

    def body_coefficients(self, x_cg_b: float | None = None, **values: ArrayLike) -> np.ndarray:
        """Return CX, CY, CZ and Cl, Cm, Cn about the centre of gravity (6, ...), body axes.

        Parameters
        ----------
        x_cg_b : float, optional
            Another centre of gravity, forward of the moment reference point. [m]
        **values : array (...)
            Model variables, as in `coefficients`. [SI]
        """
        craft, (x, y, z) = self.aircraft, self.cg
        if x_cg_b is not None:
            x = x_cg_b
            values = {"x_cg": craft.x_ref_mac - x_cg_b / craft.cbar, **values}
        # lift and drag of the stability axes in body axes
        alpha = values.get("alpha", self.variables["alpha"])
        CL, CD, CY, Cl, Cm, Cn = self.coefficients(**values)
        CX = CL * np.sin(alpha) - CD * np.cos(alpha)
        CZ = -CL * np.cos(alpha) - CD * np.sin(alpha)
        # moments about the c.g.: M - r x F, with r from the reference point to the c.g.
        rolling = Cl + (CY * z - CZ * y) / craft.b
        pitching = Cm + (CZ * x - CX * z) / craft.cbar
        yawing = Cn + (CX * y - CY * x) / craft.b
        return np.stack([CX, CY, CZ, rolling, pitching, yawing])

    def _step_around(self, variable: str) -> tuple[float, float, float]:
        """Return the lower and upper value of a central difference, and its step."""
        middle = self.variables[variable]
        step = STEP * max(abs(middle), 1.0)
        return middle - step, middle + step, step

    def body_slopes(self, variable: str, x_cg_b: float | None = None) -> np.ndarray:
        """Return the slopes of `body_coefficients` (6,) over a model variable. [per unit, SI]"""
        low, high, step = self._step_around(variable)
        upper = self.body_coefficients(x_cg_b, **{variable: high})
        lower = self.body_coefficients(x_cg_b, **{variable: low})
        return (upper - lower) / (2.0 * step)

    def derivatives(self, variables: Sequence[str] | None = None) -> xr.Dataset:
        """Return the derivatives of the six coefficients about the moment reference point.

        CL and CD are in stability axes, the other coefficients in body axes. The default is every
        variable of `VARIABLES` that the simulation has.

        Returns
        -------
        Dataset
            ``value (coefficient, variable)``, per unit of the variable [SI]. Derivatives with
            respect to ``V`` contain the change with Mach number and dynamic pressure, per m/s.
        """
        if variables is None:
            variables = [name for name in VARIABLES if name in self.variables]
        columns = []
        for name in variables:
            low, high, step = self._step_around(name)
            upper = self.coefficients(**{name: high})
            lower = self.coefficients(**{name: low})
            columns.append((upper - lower) / (2.0 * step))
        coords = {"coefficient": list(COEFFICIENTS), "variable": list(variables)}
        values = np.stack(columns, axis=1)
        return xr.Dataset({"value": (("coefficient", "variable"), values)}, coords)

    def hinge_moment(self, coefficient: str, **values: float) -> float | None:
        """Return a hinge-moment coefficient, None if the database has none.

        Outside the tables the end values hold, as in the simulation.
        """
        if coefficient not in self.compiled.hinges:
            return None
        # a hinge moment is the sum of its terms
        variables = {**self.variables, **values}
        leaves = self.compiled.hinges[coefficient]
        return float(sum(terms.evaluate_term(leaf, variables, outside="clamp") for leaf in leaves))

    def hinge_slope(self, coefficient: str, variable: str) -> float:
        """Return the slope of a hinge-moment coefficient over a model variable, or 0."""
        low, high, step = self._step_around(variable)
        upper = self.hinge_moment(coefficient, **{variable: high}) or 0.0
        lower = self.hinge_moment(coefficient, **{variable: low}) or 0.0
        return (upper - lower) / (2.0 * step)


def trimmed_at(aircraft: Aircraft, db: xr.DataTree, condition: Mapping[str, Stated]) -> Point:
    """Return the trimmed flight at a condition.

    Parameters
    ----------
    aircraft, db
        Aircraft and database, which are compiled together. The flight keeps the hinge moments
        (``Ch_e Ch_a Ch_r``) of the database.
    condition : mapping of str to float
        As in `flightmech.characteristics`. If the aircraft has no engines, ``gamma`` is computed.
        [SI]

    Raises
    ------
    UnknownName
        A name is not a speed, a start value, an input or a parameter.
    SchemaError
        No speed, or two.
    SimulationError
        No flight is steady. The text states the remaining accelerations, the term that the
        database lacks to balance them and the control that is at its limit.
    """
    sim = compile_model(aircraft, db)
    compiled = CompiledAircraft(aircraft, db, sim)
    condition = values_in_si(sim, condition)
    point = _trim_flight(compiled, condition_parameters(sim, condition))
    if not point.is_trimmed:
        kind = "flight" if aircraft.engines else "glide (the aircraft file has no engines)"
        reasons = "; ".join([_describe_residual(point), *describe_odd_flight(sim, condition)])
        raise SimulationError(
            f"no steady {kind} at {flight_condition_text(condition)}: {reasons}; change the "
            f"condition, the limits of the controls or the terms of the database"
        )
    return point


def _trim_flight(compiled: CompiledAircraft, parameters: dict[str, float]) -> Point:
    """Trim with the kernel; without engines, at the path angle of a steady glide.

    Without a term of the rudder nothing balances side force and yawing moment with the wings level,
    and a bank within `_BANK` does. The bank stays where the parameters give it.
    """
    given = parameters.keys() & {"init.phi", "init.phi_range"}
    if "delta_r" in compiled.missing_terms and not given:
        parameters = {**parameters, "init.phi_range": _BANK}
    if not compiled.aircraft.engines:
        gamma = find_glide_angle(compiled, parameters)
        parameters = {**parameters, "init.gamma": gamma}
    return Point(compiled, parameters, compiled.trim_outputs(parameters))


def _describe_residual(point: Point) -> str:
    """Return the remaining accelerations, with the state in which the trim stopped."""
    letters = point.remaining(TRIMMED)
    rates = describe_accelerations(point.trimmed, letters)
    state = f"alpha {np.degrees(point['alpha']):.3g} deg"
    if _is_at_limit(point, "delta_e"):
        state += f", delta_e {np.degrees(point['applied.delta_e']):.3g} deg"
    text = f"accelerations of {rates} remain at {state}"
    missing = describe_missing_terms(letters, point.compiled.missing_terms)
    return ", ".join([text, *missing, *point.tables_left, *_describe_lift(point)])


def _describe_lift(point: Point) -> list[str]:
    """Return a text if the lift coefficient is at its maximum."""
    angles = alpha_grid(point.sim)
    if not angles.size:
        return []
    lift = point.coefficients(alpha=angles)[0]
    return list(filter(None, [describe_greatest_lift(point["CL"], point["alpha"], (angles, lift))]))


def _is_at_limit(point: Point, control: str) -> bool:
    limits = point.aircraft.limits.get(control)
    return limits is not None and bool(
        np.isclose(point[f"applied.{control}"], limits, atol=1e-9).any()
    )

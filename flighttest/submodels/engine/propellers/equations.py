"""Equations of motion and of the shaft at points of steady power, with their unknowns.

Unknowns correct the a-priori tables of propeller and engine, the drag polar, and the common errors
of the instruments::

    CT = (1 + s) CT0(J, blade angle) + c (a1 z + a2 P2(z) + a3 P3(z)) + w min(CT0, 0)
         + c (a0 + y (a4 + a5 z))                      where the blades turn
    CP = (1 + s) CP0 + c (a1 z + a2 P2(z) + a3 P3(z))
    P  = (1 + e + d x) gross - losses                  of the engine by its tables
    Wf = (1 + b) Wf0

    force         m f = sum T cos(alpha + i_T) - qbar S (CD0 + K CL^2)
    shaft power   CP rho n^3 D^5 = P - I w w'          fixed pitch, or blades at a stop
    engine power  torque w = P by the tables
    fuel flow     Wf

CT0 and CP0 are a priori, c their rms over the points, z = -1 ... 1 over the advance ratios of the
points, y the same over their blade angles, P2 and P3 Legendre polynomials, x = -1 ... 1 over
manifold pressure or n1.  Each unknown has an a-priori standard error, so higher orders stay at zero
unless the points determine them.  An instrument that each of several engines has, has one error for
all of them and a smaller one for each.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import IdentificationError
from flighttest.reconstruction.dynamics.shaft_condition import (
    STOPPED,
    Condition,
    EnginePower,
    air_of,
    blade_setting,
    power_of,
    power_unit,
    propeller_of,
    shaft_condition,
    table_at,
    thrust_unit,
)
from flighttest.submodels.engine.propellers.corrections import (
    FEATHERED,
    FUEL,
    ORDERS,
    PITCH,
    POWER,
    POWER_AXES,
    WINDMILLING,
    FlownRange,
    PriorValue,
    corrected,
    relative_error,
)
from flighttest.submodels.engine.propellers.engine_type import check_one_type
from flighttest.submodels.engine.propellers.instruments import (
    INSTRUMENTS,
    instrument_shares,
    remove_errors,
)
from flighttest.submodels.engine.static_thrust import Polar

# Unknowns on which blade angles and the tables at them depend.
_MOVING = ("error of", "power", "CP_prop scale")


class PropulsionEquations:
    """Residuals of the equations at points.

    Parameters
    ----------
    points : Dataset (point,)
        As `propeller_points` returns them.
    aircraft : Aircraft
        All engines are of the type of the first one.
    polar : Polar
        A-priori drag polar with standard errors.
    errors : mapping of str to float, optional
        Standard errors in place of `INSTRUMENTS`; zero trusts an instrument.

    Attributes
    ----------
    unknowns : dict of str to PriorValue
        In the order of the vector of unknowns.
    shapes : dict of str to FlownRange
        ``CT_prop``, ``CP_prop`` over J, and ``power`` over its axis.
    power_axis : str
        Axis of the slope of the power; empty without one.

    Raises
    ------
    IdentificationError
        Engines of several types, a propeller that does not turn, or no measured power of a governed
        propeller.
    """

    def __init__(
        self,
        points: xr.Dataset,
        aircraft: Aircraft,
        polar: Polar,
        errors: Mapping[str, float] | None = None,
    ):
        self._kept: tuple[tuple[float, ...], Condition, list[_ShaftState]] | None = None
        # a recorded fuel flow that is not compared
        self.metered = False
        check_one_type(aircraft)
        self.aircraft, self.count = aircraft, points.sizes["point"]
        self.left_out = str(points.attrs.get("left_out", ""))
        self.accelerometer = points.attrs.get("force") == "accelerometer"
        self.columns = {str(k): np.asarray(x.values, float) for k, x in points.items()}
        self.engine = aircraft.engines[0]
        self.propeller = propeller_of(self.engine, 1)
        self.numbers = range(1, len(aircraft.engines) + 1)
        self.torque = all(f"engine{k}.torque" in self.columns for k in self.numbers)
        self.power_axis = self._power_axis()
        # Shapes and masks belong to the a-priori tables and the recorded values.
        states = [
            self._prior_state(number, self.columns | air_of(self.columns))
            for number in self.numbers
        ]
        self.charted = all(state.power is not None for state in states)
        self.shapes = self._make_shapes(states)
        self.stops = [state.at_stop for state in states]
        self.turning = [_is_turning(state) for state in states]
        self.units = self._make_units(states)
        self.unknowns = self._make_unknowns(polar, dict(INSTRUMENTS) | dict(errors or {}), states)

    def _refuse_power(self) -> None:
        raise IdentificationError(
            "neither torque nor manifold pressure (with a piston engine) nor n1 (with a table of "
            "shaft power) is recorded for all engines: the blade angle of a governed propeller "
            "follows from the power; map one of engineN.torque, engineN.manifold_pressure, "
            "engineN.n1"
        )

    def _power_axis(self) -> str:
        tables = self.power_tables()
        for axis in POWER_AXES:
            if tables and all(axis in leaf["value"].dims for leaf in tables.values()):
                return axis
        return ""

    def power_tables(self) -> dict[str, xr.Dataset]:
        """Return the tables of the gross power of the first engine."""
        part = self.engine.piston or self.propeller
        names = ("power", "corrected_power", "fuel_work", "shaft_power", "corrected_shaft_power")
        return {name: part.tables[name] for name in names if name in part.tables}

    def _make_shapes(self, states: list[_ShaftState]) -> dict[str, FlownRange]:
        shapes = {}
        turning = [_is_turning(state) for state in states]
        J = np.concatenate([state.at["J"][on] for state, on in zip(states, turning)])
        if not J.size:
            raise IdentificationError(
                "the propeller turns at no point; check the unit of engineN.rpm"
            )
        for name, prior in (("CT_prop", "CT"), ("CP_prop", "CP")):
            values = [getattr(state, prior)[on] for state, on in zip(states, turning)]
            size = float(np.sqrt(np.mean(np.concatenate(values) ** 2)))
            shapes[name] = FlownRange(float(J.min()), float(J.max()), size)
        if self.propeller.turns_blades:
            angles = np.concatenate([s.at["blade_angle"][on] for s, on in zip(states, turning)])
            shapes["blade_angle"] = FlownRange(float(angles.min()), float(angles.max()), 1.0)
        if self.power_axis and self.charted:
            x = np.concatenate([state.at[self.power_axis] for state in states])
            shapes["power"] = FlownRange(float(x.min()), float(x.max()), 1.0)
        return shapes

    def _make_units(self, states: list[_ShaftState]) -> dict[str, float]:
        """Return the size of power [W] and fuel flow [kg/s] that residuals are divided by."""
        P = np.concatenate([state.CP * power_unit(self.propeller, state.at) for state in states])
        units = {"power": max(float(np.max(np.abs(P))), 1.0)}
        flows = [self.columns.get(f"engine{k}.fuel_flow", np.zeros(1)) for k in self.numbers]
        units["fuel flow"] = max(float(np.max(np.concatenate(flows))), 1e-9)
        return units

    def _make_unknowns(
        self, polar: Polar, errors: dict[str, float], states: list[_ShaftState]
    ) -> dict[str, PriorValue]:
        unknowns: dict[str, PriorValue] = {}
        fixed = not self.propeller.turns_blades or "engine1.blade_angle" in self.columns
        for name in ("CT_prop", "CP_prop"):
            share = relative_error(self.propeller.tables[name])
            for order, stderr in ORDERS.items():
                # Without a blade angle only points at a stop show CP.
                if name == "CT_prop" or fixed or (order == "scale" and self._count_stops() > 2):
                    unknowns[f"{name} {order}"] = PriorValue(0.0, stderr * share / ORDERS["scale"])
        if "blade_angle" in self.shapes:
            for order, stderr in PITCH.items():
                unknowns[f"CT_prop {order}"] = PriorValue(0.0, stderr)
        if not fixed and any((state.CT < 0.0).any() for state in states):
            unknowns["CT_prop windmilling"] = PriorValue(0.0, WINDMILLING)
        if any((state.at.get("feather", np.zeros(1)) > 0.5).any() for state in states):
            unknowns["CT_prop feathered"] = PriorValue(0.0, FEATHERED)
        if self.charted and self.power_tables():
            unknowns["power scale"] = PriorValue(0.0, POWER["scale"])
            if self.power_axis:
                unknowns["power slope"] = PriorValue(0.0, POWER["slope"])
        if self._has_fuel(states):
            unknowns["fuel flow scale"] = PriorValue(0.0, FUEL)
        unknowns["CD0"] = PriorValue(polar.CD0, polar.CD0_stderr)
        unknowns["K"] = PriorValue(polar.K, polar.K_stderr)
        shares = instrument_shares(self.columns, self.numbers, self.accelerometer)
        for name, share in shares.items():
            stderr = errors[name.rpartition(".")[2]] * share**0.5
            unknowns[f"error of {name}"] = PriorValue(0.0, stderr)
        return unknowns

    def _count_stops(self) -> int:
        return int(sum(np.count_nonzero(stop & on) for stop, on in zip(self.stops, self.turning)))

    def _has_fuel(self, states: list[_ShaftState]) -> bool:
        recorded = all(f"engine{k}.fuel_flow" in self.columns for k in self.numbers)
        # A flow that air and mixture meter makes the power; a factor would change both.
        for state in states:
            if state.power is None:
                return False
            if state.power.metered_flow.any():
                self.metered = recorded
                return False
            if not (state.power.tabled_flow + state.power.flow_of_power).any():
                return False
        return recorded

    def at_points(self, columns: Mapping[str, np.ndarray]) -> PropulsionEquations:
        """Return the same equations and unknowns at other points, for their slopes."""
        other = copy(self)
        other._kept = None
        other.columns = {name: np.asarray(x, float) for name, x in columns.items()}
        other.count = len(other.columns["V"])
        air = other.columns | air_of(other.columns)
        states = [self._prior_state(number, air) for number in self.numbers]
        other.stops = [state.at_stop for state in states]
        other.turning = [_is_turning(state) for state in states]
        return other

    def first(self) -> np.ndarray:
        """Return the a-priori values."""
        return np.array([unknown.value for unknown in self.unknowns.values()])

    def prior_errors(self) -> np.ndarray:
        """Return the a-priori standard errors; zero holds an unknown."""
        return np.array([unknown.stderr for unknown in self.unknowns.values()])

    def measured(self, value: Mapping[str, float]) -> Condition:
        """Return the channels without the common errors of their instruments, and the air."""
        return remove_errors(self.columns, value, self.numbers, self.accelerometer)

    def _condition(self, number: int, columns: Condition) -> Condition:
        """Return the variables of the tables of one engine."""
        aircraft = self.aircraft
        return shaft_condition(columns, aircraft.engines[number - 1], number, aircraft.cg)

    def _prior_state(self, number: int, columns: Condition) -> _ShaftState:
        """Return condition, a-priori coefficients and power of one engine at recorded values."""
        at = self._condition(number, columns)
        power = power_of(self.engine, at)
        shaft = self._shaft_power(at, power, {})
        return self._state(at, power, shaft, scale=1.0)

    def _shaft_power(
        self, at: Condition, power: EnginePower | None, value: Mapping[str, float]
    ) -> np.ndarray:
        """Return the power that the propeller takes: torque, else the tables of the engine. [W]"""
        spin_up = self.propeller.inertia * at["rpm"] * at.get("rpm_dot", 0.0 * at["rpm"])
        if self.torque:
            return at["torque"] * at["rpm"] - spin_up
        if power is None and self.propeller.turns_blades:
            self._refuse_power()
        if power is None:
            # fixed pitch without any measured power: the speed alone decides
            leaf = self.propeller.tables["CP_prop"]
            return table_at(leaf, at) * power_unit(self.propeller, at)
        return self.engine_power(power, at, value) - spin_up

    def engine_power(
        self, power: EnginePower, at: Condition, value: Mapping[str, float]
    ) -> np.ndarray:
        """Return the corrected power of the tables of an engine. [W]"""
        return self._power_factor(at, value) * power.gross - power.losses

    def _power_factor(self, at: Condition, value: Mapping[str, float]) -> np.ndarray | float:
        """Return the factor on the gross power."""
        factor = 1.0 + value.get("power scale", 0.0)
        if "power slope" not in value:
            return factor
        return factor + value["power slope"] * self.shapes["power"].place(at[self.power_axis])

    def fuel_flow(
        self, power: EnginePower, at: Condition, value: Mapping[str, float]
    ) -> np.ndarray:
        """Return the corrected fuel flow of the tables of an engine. [kg/s]"""
        tabled = power.tabled_flow + self._power_factor(at, value) * power.flow_of_power
        return (1.0 + value["fuel flow scale"]) * tabled

    def _state(
        self, at: Condition, power: EnginePower | None, shaft: np.ndarray, scale: float
    ) -> _ShaftState:
        """Return the a-priori coefficients at the blade angle of a power."""
        at_stop = np.ones(len(shaft), bool)
        if self.propeller.turns_blades:
            setting = blade_setting(self.propeller, at, shaft / scale)
            at, at_stop = at | {"blade_angle": setting.angle}, setting.at_stop
        tables = self.propeller.tables
        CT, CP = (table_at(tables[name], at) for name in ("CT_prop", "CP_prop"))
        return _ShaftState(at, power, shaft=shaft, CT=CT, CP=CP, at_stop=at_stop)

    def states(self, value: Mapping[str, float], columns: Condition) -> list[_ShaftState]:
        """Return the state of each engine with corrected coefficients."""
        return [self._corrected(prior, value) for prior in self.uncorrected_states(value, columns)]

    def _corrected(self, prior: _ShaftState, value: Mapping[str, float]) -> _ShaftState:
        CT = corrected("CT_prop", prior.CT, prior.at, self.shapes, value)
        feathered = prior.at.get("feather", np.zeros_like(CT)) > 0.5
        own = (1.0 + value.get("CT_prop feathered", 0.0)) * prior.CT
        CP = corrected("CP_prop", prior.CP, prior.at, self.shapes, value)
        return prior._replace(CT=np.where(feathered, own, CT), CP=CP)

    def uncorrected_states(
        self, value: Mapping[str, float], columns: Condition
    ) -> list[_ShaftState]:
        """Return the state of each engine with the coefficients of the tables."""
        states = []
        scale = 1.0 + value.get("CP_prop scale", 0.0)
        for number in self.numbers:
            at = self._condition(number, columns)
            power = power_of(self.engine, at) if self.charted else None
            states.append(self._state(at, power, self._shaft_power(at, power, value), scale))
        return states

    def _measured_states(self, value: Mapping[str, float]) -> tuple[Condition, list[_ShaftState]]:
        """Return channels and states, of which those that the tables make are kept.

        Most slopes belong to unknowns that change neither the channels nor the blade angles.
        """
        key = tuple(x for name, x in value.items() if name.startswith(_MOVING))
        if self._kept is None or self._kept[0] != key:
            columns = self.measured(value)
            self._kept = key, columns, self.uncorrected_states(value, columns)
        _, columns, states = self._kept
        return columns, [self._corrected(state, value) for state in states]

    def residuals(self, u: np.ndarray) -> dict[str, np.ndarray]:
        """Return measured less computed at unknowns, by equation.

        ``force`` is in m/s2, the others are relative to the largest power or fuel flow.
        """
        value = dict(zip(self.unknowns, map(float, u)))
        columns, states = self._measured_states(value)
        blocks = {"force": columns["f"] - self.path_force(value, columns, states) / columns["mass"]}
        shaft, engine, fuel = [], [], []
        for state, stop, on in zip(states, self.stops, self.turning):
            used = stop & on
            taken = state.CP * power_unit(self.propeller, state.at)
            shaft.append(((state.shaft - taken) / self._level(value))[used])
            if self.torque and state.power is not None:
                tabled = self.engine_power(state.power, state.at, value)
                measured = state.at["torque"] * state.at["rpm"]
                engine.append(((measured - tabled) / self.units["power"])[on])
            if "fuel flow scale" in value and state.power is not None:
                flow = self.fuel_flow(state.power, state.at, value)
                fuel.append(((state.at["fuel_flow"] - flow) / self.units["fuel flow"])[on])
        more = {"shaft power": shaft, "engine power": engine, "fuel flow": fuel}
        # without a measured power the equation of the shaft determines nothing
        if not (self.torque or self.charted):
            more.pop("shaft power")
        for name, parts in more.items():
            if parts and sum(map(len, parts)):
                blocks[name] = np.concatenate(parts)
        return blocks

    def _level(self, value: Mapping[str, float]) -> float:
        """Return the power that the residuals of the shaft are divided by. [W]

        Without a torque both sides of the equation are corrected tables. Residuals of a fixed size
        would then be smallest for a power of zero, and both levels would come out too low.
        """
        if self.torque:
            return self.units["power"]
        return self.units["power"] * (1.0 + value.get("power scale", 0.0))

    def runs(self) -> dict[str, np.ndarray]:
        """Return the number of the record of each residual, by equation."""
        run = self.columns["run"]
        runs = {"force": run}
        pairs = zip(self.stops, self.turning)
        runs["shaft power"] = np.concatenate([run[stop & turning] for stop, turning in pairs])
        turning_runs = np.concatenate([run[turning] for turning in self.turning])
        return runs | {"engine power": turning_runs, "fuel flow": turning_runs}

    def path_force(
        self, value: Mapping[str, float], columns: Condition, states: list[_ShaftState]
    ) -> np.ndarray:
        """Return thrust along the path less drag. [N]"""
        along, across = np.zeros(self.count), np.zeros(self.count)
        for engine, state in zip(self.aircraft.engines, states):
            T = state.CT * thrust_unit(self.propeller, state.at)
            al, (x, _, z) = columns.get("alpha", 0.0 * T), engine.direction
            along = along + T * (x * np.cos(al) + z * np.sin(al))
            across = across + T * (x * np.sin(al) - z * np.cos(al))
        q_S = 0.5 * columns["rho"] * columns["V"] ** 2 * self.aircraft.S
        CL = (columns["mass"] * columns["lift_force"] - across) / q_S
        return along - q_S * (value["CD0"] + value["K"] * CL**2)


class _ShaftState(NamedTuple):
    """Condition, power by the tables, power at the shaft [W], coefficients, blades at a stop."""

    at: Condition
    power: EnginePower | None
    shaft: np.ndarray
    CT: np.ndarray
    CP: np.ndarray
    at_stop: np.ndarray


def _is_turning(state: _ShaftState) -> np.ndarray:
    """Return where a propeller turns and is not feathered (point,)."""
    feathered = state.at.get("feather", np.zeros_like(state.CT)) > 0.5
    return (state.at["rpm"] > STOPPED) & ~feathered

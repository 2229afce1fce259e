"""Constants and axes of the propulsion part of an aircraft file that no aeroplane has.

A bare number is SI and radians.  Each rule has the range of all aircraft, from models to airliners,
and the units whose numbers are often typed in its place.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import pi
from typing import NamedTuple

import numpy as np

from flightmech.aircraft.engine import MOST, Engine, list_leaves
from flightmech.units import DEGREE, FOOT, INCH, MERCURY, POUND

_RPM = (("rpm", pi / 30.0),)
_DEGREES = (("deg", DEGREE),)
_TIMES = (("ms", 1e-3),)
_PRESSURES = (
    ("inHg", MERCURY * INCH),
    ("psi", 6894.757),
    ("kPa", 1e3),
    ("hPa", 1e2),
    ("bar", 1e5),
)
# A pressure in inHg whose numbers were given the unit kPa.
_AS_KPA = (("inHg in place of kPa", MERCURY * INCH * 1e-3), ("psi in place of kPa", 6.894757))
_INERTIAS = (
    ("kg cm2", 1e-4),
    ("g m2", 1e-3),
    ("lb ft2", POUND * FOOT**2),
    ("lb in2", POUND * INCH**2),
    ("g cm2", 1e-7),
)
_PER_CENT = (("%", 0.01),)
_ANGLES = (-0.9, 1.8)  # rad, from reverse to feathered blades
# inertia over the fifth power of the diameter, of models to turboprops [kg m-3]
_INERTIA = (0.006, 1.0)
_TORQUES = (0.25, 6.0)  # torque limit over rated power of the tables through rated speed
_NO_LOAD = (0.5, 5.0)  # speed of a motor without load over that of its propeller
_CHART_SPEED = (0.5, 3.0)  # last node of a speed over the rated speed


class _Rule(NamedTuple):
    """Usual range of a number, in its unit, and the units that are mistaken for it."""

    unit: str
    low: float
    high: float
    units: tuple[tuple[str, float], ...] = ()
    remedy: str = ""


@dataclass(frozen=True)
class UnusualSize:
    """A number of an aircraft file that no aeroplane has.

    Attributes
    ----------
    name : str
        Number of the aircraft file, such as ``bsfc``, ``propeller_diameter`` or ``rpm_high``.
    text, remedy : str
        What came and what is usual, and what the user does.
    """

    name: str
    text: str
    remedy: str


# Zero stands for a constant that is not used, and the largest double for a limit without effect.
_PARTS: dict[str, dict[str, _Rule]] = {
    "propeller": {
        "gear_ratio": _Rule(
            "", 0.7, 60.0, remedy="it is the speed of the engine over that of the propeller"
        ),
        "low_pitch": _Rule("rad", *_ANGLES, _DEGREES),
        "high_pitch": _Rule("rad", *_ANGLES, _DEGREES),
        "feather_pitch": _Rule("rad", *_ANGLES, _DEGREES),
        "rpm_low": _Rule("rad/s", 5.0, 4000.0, _RPM),
        "pitch_rate": _Rule("rad/s", 0.005, 3.0, (("deg/s", DEGREE),)),
        "feather_rate": _Rule("rad/s", 0.005, 3.0, (("deg/s", DEGREE),)),
        "governor_gain": _Rule(
            "", 5e-4, 4.0, (("deg/s over rad/s", DEGREE), ("rad/s over rpm", 30.0 / pi))
        ),
        "governor_time": _Rule("s", 0.002, 5.0, _TIMES),
        "power_time": _Rule("s", 0.002, 10.0, _TIMES),
    },
    "piston": {
        "displacement": _Rule("m3", 1e-6, 0.1, (("litres", 1e-3), ("cm3", 1e-6), ("in3", INCH**3))),
        "volumetric_efficiency": _Rule("", 0.3, 1.6, _PER_CENT),
        "compression_ratio": _Rule("", 3.0, 30.0),
        "map_time": _Rule("s", 0.005, 5.0, _TIMES),
        "boost_ratio": _Rule("", 1.0, 10.0),
        "boost_rpm": _Rule("rad/s", 50.0, 1500.0, _RPM),
        "boost_limit": _Rule("Pa", 60e3, 500e3, _PRESSURES + _AS_KPA),
        "full_rich": _Rule(
            "", 0.03, 0.3, remedy="it is the mass of fuel over that of air: 0.08, not 12.5"
        ),
        "crank_rpm": _Rule("rad/s", 2.0, 120.0, _RPM),
        "fire_rpm": _Rule("rad/s", 2.0, 120.0, _RPM),
        "flame_time": _Rule("s", 0.002, 10.0, _TIMES),
    },
    "deck": {
        "lever_delay": _Rule("s", 0.001, 5.0, _TIMES),
        "pla_full": _Rule("rad", 0.01, 2.5, _DEGREES),
        "n1_rundown": _Rule("s", 0.1, 200.0, _TIMES),
        "n2_rundown": _Rule("s", 0.1, 200.0, _TIMES),
        "starter_speed": _Rule("", 0.02, 0.8, _PER_CENT),
        "starter_time": _Rule("s", 0.1, 100.0, _TIMES),
        "light_speed": _Rule("", 0.01, 0.7, _PER_CENT),
        "sustain_speed": _Rule("", 0.01, 0.7, _PER_CENT),
        "flame_time": _Rule("s", 0.005, 20.0, _TIMES),
        "itt_time": _Rule("s", 0.01, 30.0, _TIMES),
        "n1_rated": _Rule("rad/s", 100.0, 20e3, _RPM),
        "n2_rated": _Rule("rad/s", 100.0, 20e3, _RPM),
        "n1_inertia": _Rule("kg m2", 1e-7, 1000.0, _INERTIAS),
        "n2_inertia": _Rule("kg m2", 1e-7, 300.0, _INERTIAS),
    },
    "motor": {
        "capacity": _Rule("A s", 300.0, 1e8, (("Ah", 3600.0), ("mAh", 3.6))),
        "charge_start": _Rule("", 0.01, 1.0, _PER_CENT),
    },
}
# Last node of an axis.
_AXES: dict[str, _Rule] = {
    "manifold_pressure": _Rule("Pa", 60e3, 500e3, _PRESSURES + _AS_KPA),
    "p_static": _Rule("Pa", 60e3, 120e3, _PRESSURES + _AS_KPA),
    "blade_angle": _Rule("rad", *_ANGLES, _DEGREES),
    "J": _Rule("", 0.2, 12.0),
    "throttle": _Rule("", 0.5, 1.3, _PER_CENT),
    "n1": _Rule("", 0.5, 1.6, _PER_CENT),
    "n2": _Rule("", 0.5, 1.6, _PER_CENT),
    "corrected_n1": _Rule("", 0.5, 2.0, _PER_CENT),
    "corrected_n2": _Rule("", 0.5, 2.0, _PER_CENT),
    "mach": _Rule("", 0.05, 8.0),
    "h": _Rule("m", -500.0, 31e3, (("ft", FOOT),)),
    "temperature": _Rule("K", 240.0, 400.0),
    "temperature_ratio": _Rule("", 0.85, 2.0),
    "pressure_ratio": _Rule("", 0.5, 3.0),
    "pla": _Rule("rad", 0.01, 2.5, _DEGREES),
    "charge": _Rule("", 0.5, 1.01, _PER_CENT),
}
# Largest magnitude of a table.
_VALUES: dict[str, _Rule] = {
    "n1_up_time": _Rule("s", 0.02, 60.0, _TIMES),
    "n1_down_time": _Rule("s", 0.02, 60.0, _TIMES),
    "n2_up_time": _Rule("s", 0.02, 60.0, _TIMES),
    "n2_down_time": _Rule("s", 0.02, 60.0, _TIMES),
    "n1_command": _Rule("", 0.3, 1.6, _PER_CENT),
    "n2_command": _Rule("", 0.3, 1.6, _PER_CENT),
    "corrected_n1_command": _Rule("", 0.3, 2.0, _PER_CENT),
    "corrected_n2_command": _Rule("", 0.3, 2.0, _PER_CENT),
    "itt": _Rule("K", 500.0, 2600.0),
    "corrected_itt": _Rule("K", 500.0, 2600.0),
    "low_stop": _Rule("rad", 0.0, 1.8, _DEGREES),
    "map_ratio": _Rule("", 0.3, 12.0, _PER_CENT),
    "friction_pressure": _Rule("Pa", 5e3, 2e6, _PRESSURES),
    "fuel_work": _Rule("J/kg", 1e6, 5e7, (("kJ/kg", 1e3), ("MJ/kg", 1e6))),
    "open_voltage": _Rule("V", 1.0, 2000.0, (("mV", 1e-3), ("kV", 1e3))),
}

# Tables that grow with what drives the engine.
_GROWING = (
    *("thrust", "corrected_thrust", "shaft_power", "corrected_shaft_power"),
    *("power", "corrected_power", "fuel_flow", "corrected_fuel_flow"),
)
_DRIVING = ("n1", "n2", "corrected_n1", "corrected_n2", "throttle", "pla", "manifold_pressure")


def unusual_constants(engine: Engine, number: int) -> Iterator[UnusualSize]:
    """Yield the constants, axes and values of an engine that no aeroplane has.

    Parameters
    ----------
    engine : Engine
    number : int
        Of the engine, for the texts.
    """
    for part, rules in _PARTS.items():
        section = getattr(engine, part)
        if section is None:
            continue
        for name, rule in rules.items():
            value = float(getattr(section, name))
            if value and value != MOST:
                yield from _compare(f"engine {number}: {part}.{name}", name, value, rule)
    yield from _unusual_axes(engine, number)
    yield from _unusual_values(engine, number)
    yield from _falling_tables(engine, number)
    if engine.time_constant:
        rule = _Rule("s", 0.005, 60.0, _TIMES)
        where = f"engine {number}: time_constant"
        yield from _compare(where, "time_constant", engine.time_constant, rule)


def unusual_inertia(engine: Engine, number: int) -> Iterator[UnusualSize]:
    """Yield a moment of inertia of a propeller that does not belong to its diameter.

    The inertia of similar propellers goes with the fifth power of the diameter.
    """
    propeller = engine.propeller
    if propeller is None:
        return
    low, high = (limit * propeller.diameter**5 for limit in _INERTIA)
    where = f"engine {number}: propeller.inertia, with a diameter of {propeller.diameter:.3g} m,"
    rule = _Rule("kg m2", low, high, _INERTIAS)
    yield from _compare(where, "propeller_inertia", propeller.inertia, rule)


def _unusual_axes(engine: Engine, number: int) -> Iterator[UnusualSize]:
    """Yield the axes of tables whose last node is in another unit. One text for one axis."""
    seen = set()
    for target, leaf in list_leaves(engine).items():
        for name in map(str, leaf.variables["value"].dims):
            nodes = leaf.variables[name].values if name in leaf.variables else np.zeros(0)
            if name not in _AXES or nodes.size < 2 or not np.issubdtype(nodes.dtype, np.number):
                continue
            last = float(nodes.max())
            if (name, last) not in seen:
                seen.add((name, last))
                where = f"engine {number}: the last node of {name} in the table {target}"
                yield from _compare(where, name, last, _AXES[name])


def _unusual_values(engine: Engine, number: int) -> Iterator[UnusualSize]:
    """Yield the tables whose largest value is in another unit."""
    for target, leaf in list_leaves(engine).items():
        largest = float(np.abs(leaf.variables["value"].values).max())
        # values with a regressor or a factor are not in the unit of the target
        plain = not leaf.attrs.get("regressors") and "K1" not in leaf
        if target in _VALUES and plain and not leaf.attrs.get("power") and largest:
            where = f"engine {number}: the largest value of the table {target}"
            yield from _compare(where, target, largest, _VALUES[target])


def _falling_tables(engine: Engine, number: int) -> Iterator[UnusualSize]:
    """Yield the tables of thrust and power that fall from the first node of a speed, a lever or a
    manifold pressure to the last one: mostly values in the opposite order.
    """
    for target, leaf in list_leaves(engine).items():
        if target not in _GROWING or leaf.attrs.get("regressors"):
            continue
        table = leaf.variables["value"]
        for name in map(str, table.dims):
            if name not in _DRIVING or table.sizes[name] < 2:
                continue
            # means over all other axes at the first and at the last node
            by_node = np.moveaxis(table.values, table.get_axis_num(name), 0)
            ends = [float(by_node[place].mean()) for place in (0, -1)]
            if ends[1] >= ends[0]:
                continue
            nodes = leaf.variables[name].values
            text = (
                f"engine {number}: the table {target} falls from {_rounded(ends[0])} at {name} "
                f"{_rounded(nodes[0])} to {_rounded(ends[1])} at {_rounded(nodes[-1])}, on average "
                f"over its other axes; thrust and power grow with it"
            )
            yield UnusualSize(target, text, f"give the values in the order of the nodes of {name}")


def unusual_speeds(engine: Engine, number: int) -> Iterator[UnusualSize]:
    """Yield the axes of speeds and the motor whose speed does not belong to the propeller.

    They are compared with `rpm_high` and `gear_ratio` of the propeller, which must be usual.
    """
    propeller = engine.propeller
    if propeller is None:
        return
    rated = {"rpm": propeller.rpm_high, "engine_rpm": propeller.rpm_high * propeller.gear_ratio}
    seen = set()
    for target, leaf in list_leaves(engine).items():
        for name in set(rated) & set(leaf.coords):
            last, speed = float(leaf[name].max()), rated[name]
            # a table for a part of the speeds has its last node there
            if leaf[name].size < 2 or (name, last) in seen:
                continue
            seen.add((name, last))
            low, high = (factor * speed for factor in _CHART_SPEED)
            where = (
                f"engine {number}: the last node of {name} in the table {target}, with a rated "
                f"speed of {speed:.4g} rad/s,"
            )
            yield from _compare(where, name, last, _Rule("rad/s", low, high, _RPM))
    if engine.motor is not None:
        voltage = float(engine.motor.tables["open_voltage"]["value"].max())
        low, high = (factor * rated["engine_rpm"] / voltage for factor in _NO_LOAD)
        where = f"engine {number}: motor.speed_constant, with {voltage:.4g} V,"
        rule = _Rule("rad/s/V", low, high, (("rpm/V", pi / 30.0),))
        yield from _compare(where, "speed_constant", engine.motor.speed_constant, rule)


def unusual_torque(engine: Engine, number: int, power: float) -> Iterator[UnusualSize]:
    """Yield a torque limit that does not belong to the power of an engine.

    Parameters
    ----------
    engine, number
        As for `unusual_constants`.
    power : float
        Largest power of its tables, without limits. [W]
    """
    propeller = engine.propeller
    if propeller is None or propeller.torque_limit == MOST:
        return
    torque = power / propeller.rpm_high
    low, high = (factor * torque for factor in _TORQUES)
    units = (("kN m", 1e3), ("lbf in", 0.1129848), ("lbf ft", 1.3558179))
    where = f"engine {number}: propeller.torque_limit, with {power / 1e3:.4g} kW at rated speed,"
    rule = _Rule("N m", low, high, units)
    yield from _compare(where, "torque_limit", propeller.torque_limit, rule)


def _compare(where: str, name: str, value: float, rule: _Rule) -> Iterator[UnusualSize]:
    """Yield a number outside of its usual range, with the units that bring it inside."""
    if rule.low <= value <= rule.high:
        return
    unit = f" {rule.unit}" if rule.unit else ""
    low, high = _rounded(rule.low), _rounded(rule.high)
    text = f"{where} is {_rounded(value)}{unit}; usual is {low} to {high}{unit}"
    fitting = [label for label, factor in rule.units if rule.low <= value * factor <= rule.high]
    if fitting:
        text += f", as if the number were in {' or '.join(fitting)}"
    remedy = rule.remedy or f"correct {name}, and write its unit with the number"
    yield UnusualSize(name, text, remedy)


def _rounded(value: float) -> str:
    """Return a number with four digits, without an exponent from 0.0001 to 10 million."""
    return f"{float(f'{value:.4g}'):.7g}"

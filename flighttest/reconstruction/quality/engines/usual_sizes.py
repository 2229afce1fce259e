"""Sizes of airframe, engines and propellers that no aeroplane has: mostly numbers in another unit.

A propeller at standstill and rated speed takes CP rho n^3 D^5.  The fifth power shows a diameter in
another unit: 81 cm in place of 81 in takes a hundredth of the power of its engine.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import pi

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.engine import Engine, list_leaves
from flightmech.aircraft.propulsion.propeller import Propeller
from flightmech.terms import evaluate_term, list_regressors
from flightmech.units import FOOT, G0, INCH
from flighttest.reconstruction.quality.engines.mounting import (
    impossible_body,
    unusual_mounting,
    unusual_pumps,
)
from flighttest.reconstruction.quality.engines.usual_constants import (
    UnusualSize,
    unusual_constants,
    unusual_inertia,
    unusual_speeds,
    unusual_torque,
)

_USUAL_AREA = (0.6, 1.5)  # S over cbar x b
_USUAL_LOADING, _SMALL_SPAN = (80.0, 12000.0), 8.0  # N/m2, m
_USUAL_RADIUS = (0.04, 0.35)  # of roll, over the span
_FAR = 3.0  # factor beyond usual numbers, or between two powers
_USUAL_BSFC = (4e-8, 4e-7)  # kg/J: diesel engine to idling turbine
_BSFC_UNITS = (("lb/(hp h)", 1.69e-7), ("kg/(kW h)", 1.0 / 3.6e6), ("g/(kW h)", 1.0 / 3.6e9))
_FASTEST_TIP = 400.0  # m/s at rated speed; blades of aeroplanes reach 340 m/s
_RHO_0 = 1.225  # sea level [kg/m3]
# true length over the one that was read
_LENGTHS = (
    ("in were given as cm", 100.0 * INCH),
    ("cm were given as in", 0.01 / INCH),
    ("in were given as m", INCH),
    ("cm were given as m", 0.01),
    ("ft were given as m", FOOT),
    ("m were given as ft", 1.0 / FOOT),
)
_ENGINE_POWERS = ("power", "corrected_power", "shaft_power", "corrected_shaft_power")


def unusual_sizes(aircraft: Aircraft) -> list[UnusualSize]:
    """Return the numbers of airframe, engines and propellers far outside those of aeroplanes.

    Parameters
    ----------
    aircraft : Aircraft

    Returns
    -------
    list of UnusualSize
        Specific consumption a factor of 3 beyond 4e-8 to 4e-7 kg/J, blade tips faster than 400 m/s,
        and a propeller that takes less than a third or more than the threefold of the power of its
        engine at standstill and rated speed, over all its blade angles. Constants, axes and values
        of tables outside of the ranges of `unusual_constants`. Reference quantities that do not fit
        each other, and a mass or an inertia of another size. Places that engines and the centre of
        gravity cannot have, inertias that no body has, stops of surfaces beyond 90 deg,
        and transfer pumps of more than 20 kg/s.
    """
    sizes = list(_unusual_airframe(aircraft))
    named = {size.name for size in sizes}
    # span and chord judge the places
    if "reference" not in named:
        sizes += unusual_mounting(aircraft)
    sizes += [size for size in impossible_body(aircraft) if size.name not in named]
    sizes += unusual_pumps(aircraft)
    for number, engine in enumerate(aircraft.engines, 1):
        sizes += _unusual_consumption(engine, number)
        sizes += unusual_constants(engine, number)
        if engine.propeller is not None:
            sizes += _of_propeller(engine, engine.propeller, number)
    return sizes


def _of_propeller(engine: Engine, propeller: Propeller, number: int) -> list[UnusualSize]:
    """Return the numbers of a propeller that do not belong to each other, without consequences."""
    power = _table_power(engine)
    # a torque limit in another unit limits the power of the engine
    sizes = [] if power is None else list(unusual_torque(engine, number, power))
    if not sizes:
        sizes += _unusual_propeller(engine, propeller, number)
    # a diameter in another unit shows in the inertia, a rated speed in the axes of speeds
    if not sizes:
        sizes += unusual_inertia(engine, number)
    if all(size.name != "rpm_high" for size in sizes):
        sizes += unusual_speeds(engine, number)
    return sizes


def _unusual_airframe(aircraft: Aircraft) -> Iterator[UnusualSize]:
    """Yield reference quantities, mass and inertia that do not fit each other."""
    S, cbar, b = aircraft.S, aircraft.cbar, aircraft.b
    ratio = S / (cbar * b)
    low, high = _USUAL_AREA
    if not low <= ratio <= high:
        yield UnusualSize(
            "reference",
            f"S {S:.4g} m2 is {ratio:.3g} times cbar {cbar:.4g} m x b {b:.4g} m; usual is 0.8 to 1",
            "check S, cbar, b and their units; a number without a unit is in m",
        )
        # mass and inertia are judged by these
        return
    loading = aircraft.mass * G0 / S
    # of a model aeroplane it falls with its size
    low, high = _USUAL_LOADING[0] * min(1.0, b / _SMALL_SPAN), _USUAL_LOADING[1]
    if not low <= loading <= high:
        yield UnusualSize(
            "mass",
            f"mass {aircraft.mass:.4g} kg is a wing loading of {loading:.3g} N/m2; usual is "
            f"{low:.3g} to {high:g} N/m2",
            "check mass and S and their units; a number without a unit is in kg",
        )
        return
    low, high = _USUAL_RADIUS
    radius = (aircraft.Ixx / aircraft.mass) ** 0.5 / b
    if not low <= radius <= high:
        yield UnusualSize(
            "inertia",
            f"Ixx {aircraft.Ixx:.4g} kg m2 is a radius of gyration of {radius:.3g} of the span; "
            f"usual is 0.08 to 0.2",
            "check Ixx, mass and their units; 1 slug ft2 is 1.356 kg m2",
        )


def _unusual_consumption(engine: Engine, number: int) -> Iterator[UnusualSize]:
    low, high = _USUAL_BSFC
    for name, leaf in list_leaves(engine).items():
        if not name.endswith("bsfc") or not _is_plain(leaf):
            continue
        usual = float(np.median(leaf["value"].values))
        if low / _FAR <= usual <= high * _FAR:
            continue
        text = f"engine {number}: {name} is {usual:.4g} kg/J; engines have {low:g} to {high:g}"
        fitting = [unit for unit, factor in _BSFC_UNITS if low <= usual * factor <= high]
        if fitting:
            text += f", as if it were in {' or '.join(fitting)}"
        remedy = (
            "give the specific consumption in kg/J: 1 lb/(hp h) is 1.69e-7, 1 g/(kW h) 2.78e-10"
        )
        yield UnusualSize("bsfc", text, remedy)


def _unusual_propeller(engine: Engine, propeller: Propeller, number: int) -> Iterator[UnusualSize]:
    tip = 0.5 * propeller.diameter * propeller.rpm_high
    sizes = f"diameter {propeller.diameter:.4g} m, rpm_high {propeller.rpm_high:.4g} rad/s"
    remedy = "correct diameter and rpm_high with their units, such as '75 in' and '2700 rpm'"
    if tip > _FASTEST_TIP:
        text = (
            f"engine {number}: the blade tips reach {tip:.0f} m/s ({sizes}); those of aeroplanes "
            f"reach 340 m/s"
        )
        # the power would show the same mistake once more
        yield UnusualSize("rpm_high", text, remedy)
        return
    given, taken = _engine_power(engine, propeller), _static_powers(propeller)
    if given is None or taken is None:
        return
    low, high = taken
    if low / _FAR <= given <= high * _FAR:
        return
    text = (
        f"engine {number}: its propeller takes {low / 1e3:.3g} to {high / 1e3:.3g} kW at "
        f"standstill and rated speed ({sizes}), and the engine gives {given / 1e3:.3g} kW"
    )
    # the power goes with the fifth power of the diameter
    factors = sorted((given / power) ** 0.2 for power in taken)
    causes = [cause for cause, factor in _LENGTHS if factors[0] <= factor <= factors[1]]
    fitting = [propeller.diameter * factor for factor in factors]
    text += f"; a diameter of {fitting[0]:.2g} to {fitting[1]:.2g} m takes that power"
    if causes:
        text += f", as if {' or '.join(causes)}"
    remedy = "correct the diameter, rpm_high, CP_prop or the power of the engine, with their units"
    yield UnusualSize("propeller_diameter", text, remedy)


def _engine_power(engine: Engine, propeller: Propeller) -> float | None:
    """Return the largest power of the tables of an engine at sea level [W]; None without one."""
    power = _table_power(engine)
    if power is None:
        return None
    return min(power, propeller.power_limit, propeller.torque_limit * propeller.rpm_high)


def _table_power(engine: Engine) -> float | None:
    """Return the largest power of the tables of an engine [W]; None without one."""
    leaves = list_leaves(engine)
    powers = [leaves[name] for name in _ENGINE_POWERS if name in leaves]
    if not powers or not all(map(_is_plain, powers)):
        return None
    largest = max(float(leaf["value"].max()) for leaf in powers)
    return largest if largest > 0.0 else None


def _static_powers(propeller: Propeller) -> tuple[float, float] | None:
    """Return the least and largest power at standstill and rated speed over the blade angles [W].

    None for a table over other variables, or without power at standstill.
    """
    leaf = propeller.tables["CP_prop"]
    if not _is_plain(leaf) or not set(map(str, leaf["value"].dims)) <= {"J", "blade_angle"}:
        return None
    revolutions = propeller.rpm_high / (2.0 * pi)
    angles = np.array([propeller.low_pitch, propeller.highest])
    point = {"J": np.zeros(2), "blade_angle": angles}
    used = {name: point[name] for name in map(str, leaf["value"].dims)}
    CP = np.broadcast_to(evaluate_term(leaf, used, outside="clamp"), (2,))
    powers = CP * _RHO_0 * revolutions**3 * propeller.diameter**5
    if not (powers > 0.0).all():
        return None
    return float(powers.min()), float(powers.max())


def _is_plain(leaf: xr.Dataset) -> bool:
    """Return whether the values of a leaf are those of the quantity: no regressor, no factor."""
    return not list_regressors(leaf) and "K1" not in leaf and not leaf.attrs.get("power")

"""Import of engine files of JSBSim that turn a propeller: piston engines and turboprops.

The equations are those of JSBSim 1.3 (``FGPiston``, ``FGTurboProp``), in SI units.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from aerodb.exchange.jsbsim.propulsion.elements import (
    GAS_CONSTANT,
    HORSEPOWER,
    INHG,
    PLAIN,
    POUNDS_PER_KILOGRAM,
    POWERS,
    PRESSURES,
    STANDARD_PRESSURE,
    TORQUES,
    VOLUMES,
    find_table,
    need_table,
    read_line_table,
    read_plane_table,
    read_value,
)
from aerodb.exchange.xml_reader import Element, read_xml
from flightmech import air
from flightmech.aircraft.propulsion.engine_deck import EngineDeck
from flightmech.aircraft.propulsion.piston_engine import PistonEngine
from flightmech.aircraft.propulsion.propeller import Propeller
from flightmech.terms import make_term
from flightmech.units import FOOT, INCH, KNOT, POUND

_RPM = 2.0 * np.pi / 60.0  # [rad s-1]
_FEET_PER_INCH = 1.0 / 12.0
# Gas constant of the air of the simulation. [J kg-1 K-1]
_OWN_GAS_CONSTANT = 287.05287
_STOICHIOMETRIC = 14.7  # air over fuel
_RICHEST = 1.3  # equivalence ratio with the mixture lever at 1
# Efficiency of the mixture over fuel per air, which JSBSim uses without a table MIXTURE.
_MIXTURE = (
    (0.05, 0.05137, 0.05179, 0.0543, 0.05842, 0.06312, 0.06942, 0.07786, 0.08845, 0.0927, 0.1012)
    + (0.11455, 0.12158, 0.12435, 0.125),
    (0.0, 0.00862, 0.21552, 0.48276, 0.7069, 0.83621, 0.93103, 1.0, 1.0, 0.98276, 0.93103)
    + (0.72414, 0.4569, 0.23276, 0.0),
)
# Efficiency of the combustion over N1 in per cent, without a table CombustionEfficiency_N1.
_COMBUSTION = (
    (60.0, 82.0, 96.0, 100.0, 104.0, 110.0),
    (12.0 / 52.0, 12.0 / 30.0, 12.0 / 16.0, 1.0, 1.5, 6.0),
)
_N1_STEP = 0.25  # of the table of specific fuel consumption [%]
_LIGHT_N1 = 0.15  # at which JSBSim starts a turboprop


class ShaftEngine(NamedTuple):
    """What turns a propeller: a piston engine, or a deck with tables of shaft power."""

    piston: PistonEngine | None
    deck: EngineDeck | None
    tables: dict[str, xr.Dataset]
    limits: dict[str, float]
    rated_rpm: float
    remarks: list[str]

    def on(self, propeller: Propeller) -> Propeller:
        """Return the propeller with the tables and limits of the engine."""
        tables = dict(propeller.tables) | self.tables
        limits: dict[str, Any] = dict(self.limits)
        return replace(propeller, tables=tables, **limits)


def import_jsbsim_engine(path: str | Path) -> ShaftEngine:
    """Read an engine file of JSBSim that turns a propeller.

    Parameters
    ----------
    path : path
        File with ``<piston_engine>`` or ``<turboprop_engine>``.

    Raises
    ------
    ParseError
        Another kind of engine, such as ``<turbine_engine>``, whose thrust is not shaft power even
        when the file has the name of a turboprop; or a number or table without meaning.
    """
    root = read_xml(path)
    readers = {"piston_engine": _read_piston, "turboprop_engine": _read_turboprop}
    if root.tag == "turbine_engine":
        raise root.error(
            "<turbine_engine>, which JSBSim flies by its thrust",
            "<piston_engine> or <turboprop_engine>; its thrust is not shaft power",
        )
    if root.tag not in readers:
        raise root.error(f"<{root.tag}>", f"one of <{'>, <'.join(readers)}>")
    return readers[root.tag](root)


def _read_piston(root: Element) -> ShaftEngine:
    """Return a piston engine; the names of the variables are those of JSBSim."""
    idle = read_value(root, "idlerpm", PLAIN, default=600.0)
    most_rpm = read_value(root, "maxrpm", PLAIN, default=2800.0)
    most_power = read_value(root, "maxhp", POWERS, default=200.0 * HORSEPOWER)
    displacement = read_value(root, "displacement", VOLUMES, default=360.0 * VOLUMES["IN3"])
    low_map = read_value(root, "minmp", PRESSURES, default=6.5 * INHG)
    high_map = read_value(root, "maxmp", PRESSURES, default=28.5 * INHG)
    stroke = read_value(root, "stroke", {"IN": INCH, "M": 1.0}, default=4.375 * INCH)
    efficiency = read_value(root, "volumetric-efficiency", PLAIN, default=0.85)
    friction = read_value(root, "static-friction", POWERS, default=1.5 * HORSEPOWER)
    dynamic = read_value(root, "dynamic-fmep", {"PA": 1.0}, default=18400.0)
    static = read_value(root, "static-fmep", {"PA": 1.0}, default=46500.0)
    cycles = read_value(root, "cycles", PLAIN, default=4.0)
    if cycles != 4.0:
        raise root.need("cycles").error(
            f"an engine of {cycles:g} strokes", "an engine of 4 strokes"
        )

    # mean piston speed per speed of the crankshaft [m], and the one at which the flow is choked
    piston_travel = stroke / np.pi
    peak = read_value(root, "peak-piston-speed", PLAIN, default=100.0) * FOOT
    rated_speed = most_rpm * _RPM * piston_travel
    impedance = peak / rated_speed
    airbox = read_value(root, "air-intake-impedance-factor", PLAIN, default=-1.0)
    if airbox < 0.0:
        airbox = STANDARD_PRESSURE * impedance / min(high_map, 29.9 * INHG) - impedance
    closed = peak / (idle * _RPM * piston_travel) * (STANDARD_PRESSURE / low_map - 1.0) - airbox
    if not closed >= 0.0 <= airbox:
        raise root.error(
            "maxmp above the pressure of the air, or minmp above maxmp",
            "a naturally aspirated manifold pressure; a compressor has numboostspeeds",
        )
    consumption = read_value(root, "bsfc", PLAIN, default=-1.0)
    if consumption < 0.0:
        consumption = _derived_consumption(
            [displacement, most_rpm, efficiency, high_map, most_power, friction],
            mean_pressure=dynamic * rated_speed + static,
        )
    fuel_air, effect = map(np.array, _MIXTURE)
    mixture = find_table(root, "MIXTURE")
    if mixture is not None:
        fuel_air, effect = read_line_table(mixture)
    # W per kg/s: pounds per hour over pounds per hour and horsepower
    work = POUNDS_PER_KILOGRAM * 3600.0 / consumption * HORSEPOWER
    # the friction is linear beyond this speed too
    speeds = np.array([0.0, 300.0])
    piston = PistonEngine(
        {
            "fuel_work": make_term(work * np.asarray(effect), {"fuel_air_ratio": fuel_air}),
            "friction_pressure": make_term(
                dynamic * piston_travel * speeds + static, {"engine_rpm": speeds}, outside="linear"
            ),
            "friction_power": make_term(friction),
        },
        displacement=displacement,
        volumetric_efficiency=efficiency * _OWN_GAS_CONSTANT / GAS_CONSTANT,
        compression_ratio=read_value(root, "compression-ratio", PLAIN, default=8.5),
        pumping=efficiency,
        ram_recovery=read_value(root, "ram-air-factor", PLAIN, default=1.0),
        intake_impedance=airbox * piston_travel / peak,
        throttle_impedance=closed * piston_travel / peak,
        map_time=read_value(root, "man-press-lag", PLAIN, default=1.0),
        full_rich=_RICHEST / _STOICHIOMETRIC,
        enrichment=1.0,
        crank_torque=read_value(
            root, "starter-torque", PLAIN, default=0.4 * most_power / HORSEPOWER
        )
        * TORQUES["FT*LB"],
        crank_rpm=read_value(root, "starter-rpm", PLAIN, default=2.0 * idle) * _RPM,
        fire_rpm=0.8 * idle * _RPM,
    )
    piston, remarks = _add_compressor(root, piston)
    remarks.append("magnetos, temperatures and oil are not read; starter power is not limited")
    return ShaftEngine(piston, None, {}, limits={}, rated_rpm=most_rpm * _RPM, remarks=remarks)


def _derived_consumption(sizes: list[float], mean_pressure: float) -> float:
    """Return the specific consumption that JSBSim derives from the rated power. [lb hp-1 h-1]"""
    displacement, most_rpm, efficiency, high_map, most_power, friction = sizes
    pumping = (29.92 * INHG - high_map) * efficiency
    # the constant is 30 times 745.7 W, over four strokes
    loss = (pumping + mean_pressure) * displacement * most_rpm / (4.0 * 22371.0)
    filled = displacement / VOLUMES["IN3"] * most_rpm * efficiency * high_map / (29.92 * INHG)
    return 1.1 * filled / (9411.0 * ((most_power - friction) / HORSEPOWER + loss))


def _add_compressor(root: Element, piston: PistonEngine) -> tuple[PistonEngine, list[str]]:
    """Return the piston engine with its compressor, and remarks."""
    speeds = read_value(root, "numboostspeeds", PLAIN, default=0.0)
    if speeds < 1.0:
        return piston, []
    remarks = []
    if speeds > 1.0:
        remarks.append(f"the first of {speeds:g} speeds of the compressor is read")
    for tag in ("boost-loss-factor", "takeoffboost", "boostoverride"):
        if root.first(tag) is not None:
            remarks.append(f"<{tag}> is not read")
    boost = read_value(root, "ratedboost1", {"PSI": PRESSURES["PSI"], "PA": 1.0})
    height = read_value(root, "ratedaltitude1", {"FT": FOOT, "M": 1.0}, default=0.0)
    limit = STANDARD_PRESSURE + boost
    ratio = limit / float(air.atmosphere(height).p_static)
    turns = read_value(root, "ratedrpm1", PLAIN, default=2500.0) * _RPM
    return replace(piston, boost_ratio=ratio, boost_rpm=turns, boost_limit=limit), remarks


def _read_turboprop(root: Element) -> ShaftEngine:
    """Return the gas generator as a deck, and the shaft power over the speeds."""
    idle, most = (read_value(root, tag, PLAIN) / 100.0 for tag in ("idlen1", "maxn1"))
    delay = read_value(root, "n1idle_max_delay", PLAIN, default=1.0)
    rpm, n1, power = read_plane_table(need_table(root, "EnginePowerRPM_N1"))
    K1 = _read_altitude_factor(root)
    itt = _read_itt(need_table(root, "ITT_N1"))
    deck = EngineDeck(
        {
            "thrust": make_term(0.0),
            "n1_command": make_term([idle, most], {"throttle": [0.0, 1.0]}),
            "n1_up_time": make_term(delay),
            # the constants of JSBSim
            "n1_down_time": make_term(2.4 * delay),
            "itt": itt,
        },
        itt_time=read_value(root, "itt_delay", PLAIN, default=0.05),
        starter_speed=read_value(root, "startern1", PLAIN, default=20.0) / 100.0,
        starter_time=6.0 * delay,
        n1_rundown=5.0 * delay,
        light_speed=_LIGHT_N1,
    )
    tables = {
        "shaft_power": make_term(
            power * HORSEPOWER, {"engine_rpm": rpm * _RPM, "n1": n1 / 100.0}, K1=K1
        ),
        "shaft_bsfc": _read_consumption(root),
    }
    limits = {"power_limit": read_value(root, "maxpower", {"HP": HORSEPOWER, "WATTS": 1.0})}
    if root.first("ielumaxtorque") is not None:
        limits["torque_limit"] = read_value(root, "ielumaxtorque", TORQUES)
    remarks = ["the jet thrust of the turboprop is 0, as in JSBSim"]
    for tag in ("betarangeend", "reversemaxpower"):
        if root.first(tag) is not None:
            remarks.append(f"<{tag}> is not read; add a table low_stop over throttle")
    if "torque_limit" in limits:
        remarks.append("<ielumaxtorque> limits the torque at once, in JSBSim through the lever")
    return ShaftEngine(
        None, deck, tables, limits=limits, rated_rpm=float(rpm[-1]) * _RPM, remarks=remarks
    )


def _read_altitude_factor(root: Element) -> xr.DataArray | None:
    """Return ``EnginePowerVC`` as a factor over pressure ratio and equivalent airspeed."""
    table = find_table(root, "EnginePowerVC")
    if table is None:
        return None
    names = [element.text for element in table.all("independentVar")]
    if names != ["atmosphere/P-psf", "velocities/ve-kts"]:
        raise table.error(
            f"EnginePowerVC over {', '.join(names) or 'no property'}",
            "a table over atmosphere/P-psf and velocities/ve-kts",
        )
    pressure, speed, factor = read_plane_table(table)
    from_psf = POUND * 9.80665 / FOOT**2 / 101325.0
    axes = {"pressure_ratio": pressure * from_psf, "V_eas": speed * KNOT}
    return xr.DataArray(factor, axes, ("pressure_ratio", "V_eas"))


def _read_itt(table: Element) -> xr.Dataset:
    """Return the temperature of the running engine over N1. [K]"""
    n1, running, celsius = read_plane_table(table)
    return make_term(celsius[:, int(np.argmax(running))] + 273.15, {"n1": n1 / 100.0})


def _read_consumption(root: Element) -> xr.Dataset:
    """Return the specific fuel consumption over N1, PSFC over the efficiency. [kg J-1]"""
    specific = read_value(root, "psfc", {"LBS/HR/HP": POUND / 3600.0 / HORSEPOWER})
    points, efficiency = map(np.array, _COMBUSTION)
    table = find_table(root, "CombustionEfficiency_N1")
    if table is not None:
        points, efficiency = read_line_table(table)
    # the efficiency is linear between its nodes, its reciprocal is not
    fine = np.arange(points[0], points[-1] + 0.5 * _N1_STEP, _N1_STEP)
    # nodes that differ by rounding are one
    n1 = np.unique(np.round(np.union1d(points, fine[fine < points[-1]]), 9))
    return make_term(specific / np.interp(n1, points, efficiency), {"n1": n1 / 100.0})

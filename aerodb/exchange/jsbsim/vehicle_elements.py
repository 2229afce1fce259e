"""XML elements of a JSBSim flight model for the aircraft: header, mass, engines, controls."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree as ET

import xarray as xr

from aerodb.exchange.jsbsim.properties import (
    AXIS,
    factor_elements,
    throttle_property,
    thrust_property,
)
from aerodb.exchange.jsbsim.propulsion.tanks import list_priorities, without_fuel, write_feeds
from aerodb.exchange.jsbsim.propulsion.transfers import write_transfers
from flightmech.aircraft.aircraft import Aircraft, reference_in
from flightmech.aircraft.engine import Engine
from flightmech.aircraft.fuel import Fuel
from flightmech.aircraft.propulsion.propeller import Propeller
from flightmech.terms import list_regressors
from flightmech.units import FOOT, INCH, POUND, POUND_FORCE, SLUG

_SLUGFT2 = SLUG * FOOT**2
# Part of the mass that is fuel in the tank of engines with propellers.
_FUEL_PART = 0.1

# Control: command and position. A positive aileron command rolls right, a positive delta_a, delta_d
# or delta_s rolls left.
_SURFACES = {
    "delta_e": ("fcs/elevator-cmd-norm", AXIS["delta_e"]),
    "delta_r": ("fcs/rudder-cmd-norm", AXIS["delta_r"]),
    "delta_t": ("fcs/pitch-trim-cmd-norm", AXIS["delta_t"]),
    "delta_ta": ("fcs/roll-trim-cmd-norm", AXIS["delta_ta"]),
    "delta_tr": ("fcs/yaw-trim-cmd-norm", AXIS["delta_tr"]),
    "delta_d": ("-fcs/aileron-cmd-norm", AXIS["delta_d"]),
    "delta_s": ("-fcs/aileron-cmd-norm", AXIS["delta_s"]),
    "delta_f": ("fcs/flap-cmd-norm", AXIS["delta_f"]),
    "gear": ("gear/gear-cmd-norm", AXIS["gear"]),
    "speedbrake": ("fcs/speedbrake-cmd-norm", AXIS["speedbrake"]),
}
_TABS = ("delta_t", "delta_ta", "delta_tr")
# Controls whose command is 0 ... 1. The command of all others is -1 ... 1.
_ONE_SIDED = ("delta_f", "gear", "speedbrake")
_DEFAULT = {"gear": (0.0, 1.0), "speedbrake": (0.0, 1.0)}


def write_header(root: ET.Element, attributes: Mapping[Any, Any]) -> None:
    """Write title, source and history of the database."""
    head = ET.SubElement(root, "fileheader")
    for tag, key in (
        ("author", "source"),
        ("description", "title"),
        ("note", "comment"),
        ("note", "history"),
    ):
        if attributes.get(key):
            add_text_child(head, tag, str(attributes[key]))
    if attributes.get("references"):
        title = str(attributes["references"])
        ET.SubElement(head, "reference", author="", date="", title=title, refID="1")


def write_geometry_and_mass(root: ET.Element, aircraft: Aircraft) -> None:
    """Write geometry, mass, inertia and centre of gravity, without fuel in tanks that are written.

    The tanks are written by `write_propulsion`.
    """
    if has_propellers(aircraft) and aircraft.fuel is not None and aircraft.fuel.tanks:
        aircraft = without_fuel(aircraft)
    metrics = ET.SubElement(root, "metrics")
    _write_number(metrics, "wingarea", aircraft.S / FOOT**2, unit="FT2")
    _write_number(metrics, "wingspan", aircraft.b / FOOT, unit="FT")
    _write_number(metrics, "chord", aircraft.cbar / FOOT, unit="FT")
    for name in ("AERORP", "EYEPOINT", "VRP"):
        _write_location(metrics, aircraft, (0.0, 0.0, 0.0), name=name)
    mass = ET.SubElement(root, "mass_balance", negated_crossproduct_inertia="true")
    # In structural axes x and z are reversed, which changes the sign of Ixy and Iyz. The attribute
    # negates all three products, so Ixz is written with the opposite sign.
    for name in ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"):
        sign = -1.0 if name == "Ixz" else 1.0
        value = sign * getattr(aircraft, name) / _SLUGFT2
        _write_number(mass, name.lower(), value, unit="SLUG*FT2")
    _write_number(mass, "emptywt", aircraft.mass / POUND, unit="LBS")
    _write_location(mass, aircraft, aircraft.cg, name="CG")
    ET.SubElement(root, "ground_reactions")


def write_engines(root: ET.Element, aircraft: Aircraft) -> None:
    """Write the engines as external forces that follow ``fcs/engine1-thrust-lbs``.

    Engines with propellers are written by `write_propulsion`.
    """
    if not aircraft.engines or has_propellers(aircraft):
        return
    reactions = ET.SubElement(root, "external_reactions")
    for number, engine in enumerate(aircraft.engines, 1):
        force = ET.SubElement(reactions, "force", name=f"engine{number}", frame="BODY")
        add_text_child(ET.SubElement(force, "function"), "property", thrust_property(number))
        _write_location(force, aircraft, engine.position)
        direction = ET.SubElement(force, "direction")
        for name, component in zip("xyz", engine.direction, strict=True):
            add_text_child(direction, name, repr(float(component)))


def has_propellers(aircraft: Aircraft) -> bool:
    """Return whether the engines turn propellers."""
    return any(engine.propeller is not None for engine in aircraft.engines)


def write_propulsion(
    root: ET.Element, aircraft: Aircraft, files: Sequence[tuple[str, str]]
) -> None:
    """Write the engines with propellers; `files` are the names of engine and propeller files."""
    if not files:
        return
    propulsion = ET.SubElement(root, "propulsion")
    fuel = aircraft.fuel if aircraft.fuel is not None and aircraft.fuel.tanks else None
    for engine, (engine_file, propeller_file) in zip(aircraft.engines, files, strict=True):
        element = ET.SubElement(propulsion, "engine", file=engine_file)
        if fuel is None:
            add_text_child(element, "feed", "0")
        else:
            write_feeds(element, engine, fuel)
        thruster = ET.SubElement(element, "thruster", file=propeller_file)
        _write_location(thruster, aircraft, engine.position)
        x, y, z = engine.direction
        orient = ET.SubElement(thruster, "orient", unit="RAD")
        angles = {"roll": 0.0, "pitch": math.atan2(-z, math.hypot(x, y)), "yaw": math.atan2(y, x)}
        for name, angle in angles.items():
            add_text_child(orient, name, repr(angle))
        blades = engine.propeller
        assert blades is not None, "engines with propellers alone have files"
        add_text_child(thruster, "sense", str(blades.rotation))
        add_text_child(thruster, "p_factor", repr(_p_factor(blades)))
    if fuel is not None:
        _write_tanks(propulsion, aircraft, fuel)
        return
    tank = ET.SubElement(propulsion, "tank", type="FUEL")
    _write_location(tank, aircraft, aircraft.cg)
    # JSBSim burns from a tank: a part of the mass is fuel at the centre of gravity
    part = _FUEL_PART * aircraft.mass / POUND
    _write_number(tank, "capacity", part, unit="LBS")
    _write_number(tank, "contents", part, unit="LBS")
    empty = root.find("mass_balance/emptywt")
    assert empty is not None, "write_geometry_and_mass writes it"
    empty.text = repr(aircraft.mass / POUND - part)


def _write_tanks(propulsion: ET.Element, aircraft: Aircraft, fuel: Fuel) -> None:
    """Write the tanks that feed the engines; the mass of the aircraft was written without them."""
    for tank, priority in zip(fuel.tanks, list_priorities(fuel), strict=True):
        element = ET.SubElement(propulsion, "tank", type="FUEL")
        _write_location(element, aircraft, tank.position)
        _write_number(element, "capacity", tank.capacity / POUND, unit="LBS")
        _write_number(element, "contents", tank.content / POUND, unit="LBS")
        add_text_child(element, "priority", str(priority))


def _p_factor(blades: Propeller) -> float:
    """Return the shift of the thrust per angle of the inflow. [in]"""
    if "CM_prop" not in blades.tables:
        return 0.0
    moment = blades.tables["CM_prop"]["value"].values
    thrust = blades.tables["CT_prop"]["value"].values
    return float((moment * thrust).sum() / (thrust**2).sum()) * blades.diameter / INCH


@dataclass(frozen=True)
class Propulsion:
    """Static thrust of the engines as terms; `native` as in `table_element`."""

    thrusts: Mapping[str, xr.Dataset]
    native: bool


def write_flight_control(
    root: ET.Element, aircraft: Aircraft, used: Collection[str], propulsion: Propulsion
) -> None:
    """Write the scaling of the commands in `used`, thrust of engines and transfer pumps."""
    control = ET.SubElement(root, "flight_control", name=aircraft.name)
    for number, engine in enumerate(aircraft.engines, 1):
        if engine.propeller is not None:
            continue
        _declare_property(control, throttle_property(number))
        if engine.thrust is None:
            _declare_property(control, thrust_property(number))
    # A tab without limits has no command. Its position is set directly.
    free_tabs = [name for name in _TABS if name in used and name not in aircraft.limits]
    for name in free_tabs:
        _declare_property(control, AXIS[name])
    channel = ET.SubElement(control, "channel", name="Surfaces")
    for name, (command, position) in _SURFACES.items():
        if name in used and name not in free_tabs:
            limits, one_sided = _control_limits(aircraft, name), name in _ONE_SIDED
            _write_scale(channel, command, position, limits=limits, one_sided=one_sided)
    if "delta_a" in used:
        # delta_a is the angle of the right aileron, the left one moves the other way.
        low, high = _control_limits(aircraft, "delta_a")
        command = "fcs/aileron-cmd-norm"
        _write_scale(channel, command, "fcs/left-aileron-pos-rad", limits=(-high, -low))
        _write_scale(channel, f"-{command}", "fcs/right-aileron-pos-rad", limits=(low, high))
    for number, engine in enumerate(aircraft.engines, 1):
        if engine.thrust is not None:
            name = f"engine{number}"
            engine_channel = ET.SubElement(control, "channel", name=name)
            _write_thrust(engine_channel, name, engine, propulsion=propulsion)
    if has_propellers(aircraft) and aircraft.fuel is not None and aircraft.fuel.transfers:
        write_transfers(control, aircraft.fuel)


def missing_limits(aircraft: Aircraft, used: Collection[str]) -> list[str]:
    """Return a problem for every control in `used` that needs limits and has none."""
    problems = []
    for name in (*_SURFACES, "delta_a"):
        needs_limits = name in used and name not in _DEFAULT and name not in _TABS
        if needs_limits and name not in aircraft.limits:
            problems.append(
                f"{name} has no limits in the aircraft file, which scale its command; add "
                f"[limits] {name} = [low, high]"
            )
    return problems


def engine_terms(aircraft: Aircraft) -> dict[str, xr.Dataset]:
    """Return the static thrust of the engines as terms ``engine1/thrust``.

    The lever of each engine is the variable ``engine1.throttle``.
    """
    thrusts = {}
    for number, engine in enumerate(aircraft.engines, 1):
        if engine.thrust is None:
            continue
        leaf, lever = engine.thrust.squeeze(drop=True), f"engine{number}.throttle"
        if "throttle" in leaf.dims:
            leaf = leaf.rename({"throttle": lever})
        regressors = []
        for name in list_regressors(leaf):
            regressors.append(lever if name == "throttle" else name)
        thrusts[f"engine{number}/thrust"] = leaf.assign_attrs(regressors=" ".join(regressors))
    return thrusts


def function_fields(aircraft: Aircraft) -> dict[str, object]:
    """Return the data of the aircraft for the functions of `properties.FUNCTION`."""
    thrusts = ""
    for number in range(1, len(aircraft.engines) + 1):
        thrusts += f"<property>{thrust_property(number)}</property>"
    return {
        "x_ref_mac": aircraft.x_ref_mac,
        "chords_per_inch": INCH / aircraft.cbar,
        "thrusts": thrusts,
    }


def _control_limits(aircraft: Aircraft, name: str) -> tuple[float, float]:
    return aircraft.limits.get(name) or _DEFAULT[name]


def _declare_property(control: ET.Element, name: str) -> None:
    ET.SubElement(control, "property", value="0").text = name


def _write_scale(
    channel: ET.Element,
    command: str,
    position: str,
    limits: tuple[float, float],
    one_sided: bool = False,
) -> None:
    """Write the scaling of a command of -1 ... 1, or 0 ... 1 if it is one-sided, to the limits."""
    surface = position.split("/")[1].split("-pos")[0]
    scale = ET.SubElement(channel, "aerosurface_scale", name=f"{surface}-travel")
    add_text_child(scale, "input", command)
    if one_sided:
        _write_range(scale, "domain", (0.0, 1.0))
        # Else JSBSim scales both sides of zero on their own.
        add_text_child(scale, "zero_centered", "false")
    _write_range(scale, "range", limits)
    add_text_child(scale, "output", position)


def _write_range(parent: ET.Element, tag: str, limits: tuple[float, float]) -> None:
    element = ET.SubElement(parent, tag)
    for name, value in zip(("min", "max"), limits, strict=True):
        add_text_child(element, name, repr(float(value)))


def _write_thrust(channel: ET.Element, name: str, engine: Engine, propulsion: Propulsion) -> None:
    """Write the static thrust of an engine and its lag."""
    static_thrust = f"fcs/{name}-static-thrust-lbs"
    fcs_function = ET.SubElement(channel, "fcs_function", name=static_thrust)
    product = ET.SubElement(ET.SubElement(fcs_function, "function"), "product")
    # The table is in newtons, the property in pounds.
    add_text_child(product, "value", repr(1.0 / POUND_FORCE))
    product.extend(factor_elements(propulsion.thrusts[f"{name}/thrust"], propulsion.native))
    # c1 is the reciprocal of the time constant of a first-order lag. [1/s]
    component, key, value = "pure_gain", "gain", "1"
    if engine.time_constant > 0.0:
        component, key, value = "lag_filter", "c1", repr(1.0 / engine.time_constant)
    follower = ET.SubElement(channel, component, name=f"{name}-spool")
    add_text_child(follower, "input", static_thrust)
    add_text_child(follower, key, value)
    add_text_child(follower, "output", f"fcs/{name}-thrust-lbs")


def _write_location(
    parent: ET.Element, aircraft: Aircraft, position: tuple[float, float, float], name: str = ""
) -> None:
    """Write a point in structural axes; `position` is from the moment reference, body axes. [m]"""
    attributes = {"name": name, "unit": "IN"} if name else {"unit": "IN"}
    location = ET.SubElement(parent, "location", attributes)
    # Structural axes have x aft and z up, body axes x forward and z down.
    for axis, sign, origin, offset in zip(
        "xyz", (-1.0, 1.0, -1.0), reference_in(aircraft, {}), position, strict=True
    ):
        add_text_child(location, axis, repr(sign * (origin + offset) / INCH))


def _write_number(parent: ET.Element, tag: str, value: float, unit: str) -> None:
    ET.SubElement(parent, tag, unit=unit).text = repr(value)


def add_text_child(parent: ET.Element, tag: str, text: str) -> None:
    """Append an element with a text."""
    ET.SubElement(parent, tag).text = text

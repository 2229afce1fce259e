"""The aircraft around the aerodynamics of a JSBSim file: geometry, mass, engines as external forces, commands to surfaces.

Structural axes of JSBSim: x aft, y right, z up; here from the drawing datum of the aircraft file, in inches.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from xml.etree import ElementTree as ET

import xarray as xr

from flightmech.aircraft.aircraft import Aircraft, reference_in
from flightmech.aircraft.systems.engine import Engine
from flightmech.terms import regressors
from flightmech.units import FOOT, INCH, POUND, POUND_FORCE, SLUG

from .properties import AXIS, throttle, thrust
from .tables import factors

_SLUGFT2 = SLUG * FOOT**2

# control: command and position; a positive aileron command rolls right, delta_a, delta_d and delta_s roll left
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
_ONE_SIDED = ("delta_f", "gear", "speedbrake")
_DEFAULT = {"gear": (0.0, 1.0), "speedbrake": (0.0, 1.0)}


def header(root: ET.Element, attributes: Mapping) -> None:
    """Write title, source and history of the database."""
    head = ET.SubElement(root, "fileheader")
    for tag, key in (("author", "source"), ("description", "title"), ("note", "comment"), ("note", "history")):
        if attributes.get(key):
            ET.SubElement(head, tag).text = str(attributes[key])
    if attributes.get("references"):
        ET.SubElement(head, "reference", author="", date="", title=str(attributes["references"]), refID="1")


def body(root: ET.Element, aircraft: Aircraft) -> None:
    """Write geometry and mass; products of inertia change sign with x and z, which point the other way in structural axes."""
    metrics = ET.SubElement(root, "metrics")
    _number(metrics, "wingarea", aircraft.S / FOOT**2, "FT2")
    _number(metrics, "wingspan", aircraft.b / FOOT, "FT")
    _number(metrics, "chord", aircraft.cbar / FOOT, "FT")
    for name in ("AERORP", "EYEPOINT", "VRP"):
        _location(metrics, aircraft, (0.0, 0.0, 0.0), name)
    mass = ET.SubElement(root, "mass_balance", negated_crossproduct_inertia="true")
    for name in ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"):
        sign = -1.0 if name == "Ixz" else 1.0
        _number(mass, name.lower(), sign * getattr(aircraft, name) / _SLUGFT2, "SLUG*FT2")
    _number(mass, "emptywt", aircraft.mass / POUND, "LBS")
    _location(mass, aircraft, aircraft.cg, "CG")
    ET.SubElement(root, "ground_reactions")


def propulsion(root: ET.Element, aircraft: Aircraft) -> None:
    """Write the engines as external forces that follow ``fcs/engine1-thrust-lbs``."""
    if not aircraft.engines:
        return
    reactions = ET.SubElement(root, "external_reactions")
    for number, engine in enumerate(aircraft.engines, 1):
        force = ET.SubElement(reactions, "force", name=f"engine{number}", frame="BODY")
        ET.SubElement(ET.SubElement(force, "function"), "property").text = thrust(number)
        _location(force, aircraft, engine.position)
        direction = ET.SubElement(force, "direction")
        for name, component in zip("xyz", engine.direction):
            ET.SubElement(direction, name).text = repr(float(component))


def flight_control(root: ET.Element, aircraft: Aircraft, used: Collection[str], thrusts: Mapping[str, xr.Dataset], native: bool) -> None:
    """Write how commands move the surfaces that the model uses, and the `thrusts` of the engines."""
    control = ET.SubElement(root, "flight_control", name=aircraft.name)
    for number, engine in enumerate(aircraft.engines, 1):
        ET.SubElement(control, "property", value="0").text = throttle(number)
        if engine.thrust is None:
            ET.SubElement(control, "property", value="0").text = thrust(number)
    free = [name for name in _TABS if name in used and name not in aircraft.limits]
    for name in free:  # without limits a tab has no command: whoever flies sets its position
        ET.SubElement(control, "property", value="0").text = AXIS[name]
    channel = ET.SubElement(control, "channel", name="Surfaces")
    for name, (command, position) in _SURFACES.items():
        if name in used and name not in free:
            _surface(channel, command, position, _limits(aircraft, name), name in _ONE_SIDED)
    if "delta_a" in used:
        low, high = _limits(aircraft, "delta_a")
        _surface(channel, "fcs/aileron-cmd-norm", "fcs/left-aileron-pos-rad", (-high, -low))
        _surface(channel, "-fcs/aileron-cmd-norm", "fcs/right-aileron-pos-rad", (low, high))
    for number, engine in enumerate(aircraft.engines, 1):
        name = f"engine{number}"
        if engine.thrust is not None:
            _engine(ET.SubElement(control, "channel", name=name), name, thrusts[f"{name}/thrust"], engine, native)


def missing_limits(aircraft: Aircraft, used: Collection[str]) -> list[str]:
    """Return a problem for every control that the model uses and whose travel is not known; a tab needs none."""
    controls = [name for name in (*_SURFACES, "delta_a") if name in used]
    return [
        f"{name} has no limits in the aircraft file, which scale its command; add [limits] {name} = [low, high]"
        for name in controls
        if name not in aircraft.limits and name not in _DEFAULT and name not in _TABS
    ]


def engine_terms(aircraft: Aircraft) -> dict[str, xr.Dataset]:
    """Return the static thrust of the engines as terms, ``engine1/thrust``, their lever called ``engine1.throttle``."""
    found = {}
    for number, engine in enumerate(aircraft.engines, 1):
        if engine.thrust is not None:
            leaf, own = engine.thrust.squeeze(drop=True), f"engine{number}.throttle"
            words = [own if word == "throttle" else word for word in regressors(leaf)]
            named = leaf.rename({"throttle": own}) if "throttle" in leaf.dims else leaf
            found[f"engine{number}/thrust"] = named.assign_attrs(regressors=" ".join(words))
    return found


def function_fields(aircraft: Aircraft) -> dict[str, object]:
    """Return what the functions for variables that JSBSim has not take from the aircraft."""
    thrusts = "".join(f"<property>{thrust(number)}</property>" for number in range(1, len(aircraft.engines) + 1))
    return {"x_ref_mac": aircraft.x_ref_mac, "chords_per_inch": INCH / aircraft.cbar, "thrusts": thrusts}


def _limits(aircraft: Aircraft, name: str) -> tuple[float, float]:
    return aircraft.limits.get(name) or _DEFAULT[name]


def _surface(channel: ET.Element, command: str, position: str, limits: tuple[float, float], one_sided: bool = False) -> None:
    """Write the scaling of a command: 0 ... 1 from the low to the high limit, or -1 ... 1 with zero at zero."""
    scale = ET.SubElement(channel, "aerosurface_scale", name=f"{position.split('/')[1].split('-pos')[0]}-travel")
    ET.SubElement(scale, "input").text = command
    if one_sided:
        _pair(scale, "domain", (0.0, 1.0))
        ET.SubElement(scale, "zero_centered").text = "false"
    _pair(scale, "range", limits)
    ET.SubElement(scale, "output").text = position


def _pair(parent: ET.Element, tag: str, pair: tuple[float, float]) -> None:
    element = ET.SubElement(parent, tag)
    for name, value in zip(("min", "max"), pair):
        ET.SubElement(element, name).text = repr(float(value))


def _engine(channel: ET.Element, name: str, leaf: xr.Dataset, engine: Engine, native: bool) -> None:
    """Write the static thrust of an engine and its lag."""
    function = ET.SubElement(ET.SubElement(channel, "fcs_function", name=f"fcs/{name}-static-thrust-lbs"), "function")
    product = ET.SubElement(function, "product")
    _child(product, "value", repr(1.0 / POUND_FORCE))
    product.extend(factors(leaf, native))
    lags = engine.time_constant > 0.0
    follower = ET.SubElement(channel, "lag_filter" if lags else "pure_gain", name=f"{name}-spool")
    _child(follower, "input", f"fcs/{name}-static-thrust-lbs")
    _child(follower, "c1" if lags else "gain", repr(1.0 / engine.time_constant) if lags else "1")
    _child(follower, "output", f"fcs/{name}-thrust-lbs")


def _location(parent: ET.Element, aircraft: Aircraft, position: tuple[float, float, float], name: str = "") -> None:
    """Write a point that is `position` from the moment reference point, body axes, in structural axes."""
    location = ET.SubElement(parent, "location", {**({"name": name} if name else {}), "unit": "IN"})
    for axis, sign, origin, offset in zip("xyz", (-1.0, 1.0, -1.0), reference_in(aircraft, {}), position):
        _child(location, axis, repr(sign * (origin + offset) / INCH))


def _number(parent: ET.Element, tag: str, value: float, unit: str) -> None:
    element = ET.SubElement(parent, tag, unit=unit)
    element.text = repr(value)


def _child(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = text

"""Parts of a similar aircraft: engine decks, fuel, separation, gear, circuits, by their units."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.fuel import INERTIAS, MOMENTS, Fuel
from flightmech.aircraft.landing_gear import Contact, LandingGear
from flightmech.aircraft.propulsion.engine_deck import TARGETS, EngineDeck
from flightmech.aircraft.separation import TARGETS as SEPARATION_TARGETS
from flightmech.aircraft.separation import FlowSeparation
from flightmech.names import lookup
from flightmech.terms import list_regressors

# Powers of the base units in each unit. A temperature does not change.
_BASE_UNITS: dict[str, tuple[tuple[str, int], ...]] = {
    "m": (("m", 1),),
    "kg": (("kg", 1),),
    "s": (("s", 1),),
    "N": (("kg", 1), ("m", 1), ("s", -2)),
    "Pa": (("kg", 1), ("m", -1), ("s", -2)),
    "rad": (),
    "1": (),
    "K": (),
}
_UNIT_FACTOR = re.compile(r"([A-Za-z]+|1)(-?\d*)")
# SI units of the constants of each part. Constants that are not listed do not change.
_FORCE, _TORQUE, _SPRING = "N", "N m", "N m-1"
_CONTACT = {
    **dict.fromkeys(("position", "radius", "stroke"), "m"),
    **dict.fromkeys(("stiffness", "tyre_stiffness", "side_stiffness"), _SPRING),
    **dict.fromkeys(("damping", "damping_ext"), "N s m-1"),
    **dict.fromkeys(("orifice", "orifice_ext"), "N s2 m-2"),
    **dict.fromkeys(("preload", "cornering_stiffness", "cornering_load", "brake"), _FORCE),
    "loss": "s",
}
_STEERING = {
    **dict.fromkeys(("stiffness", "arm_stiffness"), _TORQUE),
    **dict.fromkeys(("damping", "arm_damping"), "N m s"),
    **dict.fromkeys(("inertia", "arm_inertia"), "kg m2"),
    **dict.fromkeys(("trail", "scrub"), "m"),
}
# surface on its hinge, in all circuits
_SURFACE = {
    "inertia": "kg m2",
    "hinge_damping": "N m s",
    "hinge_friction": _TORQUE,
    "unbalance": "kg m",
    "arm": "m",
    "step": "s",
}
# circuits of column and pedals, whose travel is a length
_LINEAR = {
    **_SURFACE,
    **dict.fromkeys(("stops", "neutral", "neutral_trim"), "m"),
    **dict.fromkeys(("mass", "bob_weight"), "kg"),
    **dict.fromkeys(("damping", "cable_damping"), "N s m-1"),
    **dict.fromkeys(("stiffness", "cable_stiffness", "nose_spring"), _SPRING),
    **dict.fromkeys(("preload", "friction", "stiction", "trim_limit"), _FORCE),
    "gearing_slope": "m-2",
}
# circuit of the wheel, whose travel is an angle
_ROTARY = {
    **_SURFACE,
    "mass": "kg m2",
    "bob_weight": "kg m",
    **dict.fromkeys(("damping", "cable_damping"), "N m s"),
    **dict.fromkeys(
        (
            "stiffness",
            "cable_stiffness",
            "nose_spring",
            "preload",
            "friction",
            "stiction",
            "trim_limit",
        ),
        _TORQUE,
    ),
}
_TANK = {"position": "m", "capacity": "kg", "content": "kg"}
_TRANSFER = {"rate": "kg s-1", **dict.fromkeys(("fill", "band", "leave"), "kg")}
_DECK = {
    **dict.fromkeys(
        ("lever_delay", "n1_rundown", "n2_rundown", "starter_time", "flame_time", "itt_time"), "s"
    ),
    **dict.fromkeys(("n1_rated", "n2_rated"), "s-1"),
    **dict.fromkeys(("n1_inertia", "n2_inertia"), "kg m2"),
    "inlet": "m",
}


@dataclass(frozen=True)
class Scale:
    """Factors of length, mass and time, and of the thrust, which may have another factor."""

    length: float
    mass: float
    time: float
    thrust: float

    def of(self, units: str) -> float:
        """Return the factor of a quantity in SI units.

        Examples
        --------
        >>> Scale(4.0, 64.0, 2.0, 64.0).of("N m-1")
        16.0
        """
        ratios = {"m": self.length, "kg": self.mass, "s": self.time}
        factor = 1.0
        for word in units.split():
            match = _UNIT_FACTOR.fullmatch(word)
            assert match is not None
            power = int(match.group(2) or 1)
            for base, exponent in _BASE_UNITS[match.group(1)]:
                factor *= ratios[base] ** (exponent * power)
        return factor


def scaled_parts(aircraft: Aircraft, scale: Scale) -> dict[str, Any]:
    """Return fuel, stall, gear and circuits of the similar aircraft, by the field of `Aircraft`."""
    circuits = {}
    for name, circuit in aircraft.circuits.items():
        # the wheel turns, column and pedals move along a line
        units = _ROTARY if name == "wheel" else _LINEAR
        circuits[name] = _scale_constants(circuit, units, scale)
    return {
        "fuel": None if aircraft.fuel is None else _scale_fuel(aircraft.fuel, scale),
        "stall": None if aircraft.stall is None else _scale_separation(aircraft.stall, scale),
        "gear": None if aircraft.gear is None else _scale_gear(aircraft.gear, scale),
        "circuits": circuits,
    }


def scaled_deck(deck: EngineDeck, scale: Scale) -> EngineDeck:
    """Return the engine deck of the similar aircraft."""
    tables = {}
    for name, leaf in deck.tables.items():
        # a force of the engine has the factor of the thrust
        factor = scale.thrust if TARGETS[name] == "N" else scale.of(TARGETS[name])
        tables[name] = _scale_table(leaf, factor, scale)
    return replace(_scale_constants(deck, _DECK, scale), tables=tables)


def _scale_constants(item: Any, units: Mapping[str, str], scale: Scale) -> Any:
    """Return a copy of a dataclass in which the constants with units are scaled."""
    constants = {}
    for constant in fields(item):
        if constant.name in units:
            factor = scale.of(units[constant.name])
            constants[constant.name] = _scale_value(getattr(item, constant.name), factor)
    return replace(item, **constants)


def _scale_value(value: Any, factor: float) -> Any:
    if value is None:
        return None
    if isinstance(value, tuple):
        return tuple(_scale_value(component, factor) for component in value)
    # the largest double is a limit that does not act
    return value if abs(value) == sys.float_info.max else value * factor


def _scale_table(
    leaf: xr.Dataset, factor: float, scale: Scale, axes: Mapping[str, str] | None = None
) -> xr.Dataset:
    """Return a leaf with scaled value, over the factors of its regressors, and scaled axes.

    `axes` has the units of the axes to scale.
    """
    for name in list_regressors(leaf):
        factor /= scale.of(lookup(name).units)
    values = {}
    for name in ("value", "stderr"):
        if name in leaf:
            values[name] = leaf[name].copy(data=leaf[name].values * factor)
    coords = {}
    for name, units in (axes or {}).items():
        if name in leaf.coords:
            coords[name] = leaf[name] * scale.of(units)
    return leaf.assign(values).assign_coords(coords)


def _scale_fuel(fuel: Fuel, scale: Scale) -> Fuel:
    tanks = tuple(_scale_constants(tank, _TANK, scale) for tank in fuel.tanks)
    units = {**dict.fromkeys(MOMENTS, "kg m"), **dict.fromkeys(INERTIAS, "kg m2")}
    tables = {}
    for name, leaf in fuel.tables.items():
        tables[name] = _scale_table(leaf, scale.of(units[name]), scale, axes={"fuel": "kg"})
    position = _scale_value(fuel.position, scale.length)
    transfers = tuple(_scale_constants(pump, _TRANSFER, scale) for pump in fuel.transfers)
    return Fuel(fuel.mass * scale.mass, position, tables, tanks, transfers)


def _scale_separation(stall: FlowSeparation, scale: Scale) -> FlowSeparation:
    tables = {}
    axes = {"V": "m s-1", "h_agl": "m", "qbar": "Pa"}
    for name, leaf in stall.tables.items():
        tables[name] = _scale_table(leaf, scale.of(SEPARATION_TARGETS[name]), scale, axes=axes)
    return FlowSeparation(stall.station * scale.length, tables)


def _scale_gear(gear: LandingGear, scale: Scale) -> LandingGear:
    contacts = tuple(_scale_contact(contact, scale) for contact in gear.contacts)
    steering = _scale_constants(gear.steering, _STEERING, scale)
    return replace(gear, contacts=contacts, steering=steering)


def _scale_contact(contact: Contact, scale: Scale) -> Contact:
    scaled = _scale_constants(contact, _CONTACT, scale)
    if contact.strut is None:
        return scaled
    strut = _scale_table(contact.strut, scale.of(_FORCE), scale, axes={"compression": "m"})
    return replace(scaled, strut=strut)

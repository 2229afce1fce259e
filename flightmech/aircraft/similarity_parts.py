"""Engine decks, fuel, landing gear and control circuits of a similar aircraft: factors from the dimensions of each constant.

With the ratios of `similarity`, times go with the square root of the length ratio and forces with the mass ratio; so a quantity in
kg^a m^b s^c goes with m^a l^(b + c/2).  Fractions, angles, friction coefficients, temperatures and what lies over Mach number, height or
a fraction of the rated speed stay as they are; so does the friction of a wet runway, which belongs to the runway.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import xarray as xr

from ..names import lookup
from ..terms import regressors
from .aircraft import Aircraft
from .systems.engine_deck import TARGETS, Deck
from .systems.fuel import INERTIAS, MOMENTS, Fuel
from .systems.landing_gear import Contact, LandingGear

_DERIVED = {"N": "kg m s-2", "Pa": "kg m-1 s-2", "rad": "", "1": "", "K": ""}
_FORCE, _TORQUE, _SPRING, _TURNING = "N", "N m", "N m-1", "N m"
_CONTACT = {
    **dict.fromkeys(("position", "radius", "stroke"), "m"),
    **dict.fromkeys(("stiffness", "tyre_stiffness", "side_stiffness"), _SPRING),
    **dict.fromkeys(("damping", "damping_ext"), "N s m-1"),
    **dict.fromkeys(("orifice", "orifice_ext"), "N s2 m-2"),
    **dict.fromkeys(("preload", "cornering_stiffness", "cornering_load", "brake"), _FORCE),
    "loss": "s",
}
_STEERING = {
    **dict.fromkeys(("stiffness", "arm_stiffness"), _TURNING),
    **dict.fromkeys(("damping", "arm_damping"), "N m s"),
    **dict.fromkeys(("inertia", "arm_inertia"), "kg m2"),
    **dict.fromkeys(("trail", "scrub"), "m"),
}
_SURFACE = {"inertia": "kg m2", "hinge_damping": "N m s", "hinge_friction": _TORQUE, "unbalance": "kg m", "arm": "m", "step": "s"}
_LINEAR = {
    **_SURFACE,
    **dict.fromkeys(("stops", "neutral", "neutral_trim"), "m"),
    **dict.fromkeys(("mass", "bob_weight"), "kg"),
    **dict.fromkeys(("damping", "cable_damping"), "N s m-1"),
    **dict.fromkeys(("stiffness", "cable_stiffness", "nose_spring"), _SPRING),
    **dict.fromkeys(("preload", "friction", "stiction", "trim_limit"), _FORCE),
    "gearing_slope": "m-2",
}
_ROTARY = {
    **_SURFACE,
    "mass": "kg m2",
    "bob_weight": "kg m",
    **dict.fromkeys(("damping", "cable_damping"), "N m s"),
    **dict.fromkeys(("stiffness", "cable_stiffness", "nose_spring", "preload", "friction", "stiction", "trim_limit"), _TORQUE),
}
_DECK = {
    **dict.fromkeys(("lever_delay", "n1_rundown", "n2_rundown", "starter_time", "flame_time", "itt_time"), "s"),
    **dict.fromkeys(("n1_rated", "n2_rated"), "s-1"),
    **dict.fromkeys(("n1_inertia", "n2_inertia"), "kg m2"),
    "inlet": "m",
}


@dataclass(frozen=True)
class Scale:
    """Factors of length, mass and time, and of the thrust, which may be given apart."""

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
        found = 1.0
        for word in " ".join(_spelt(word) for word in units.split()).split():
            base, power = re.fullmatch(r"([a-z]+)(-?\d*)", word).groups()  # type: ignore[union-attr]
            found *= {"m": self.length, "kg": self.mass, "s": self.time}[base] ** int(power or 1)
        return found


def _spelt(word: str) -> str:
    base, power = re.fullmatch(r"([A-Za-z]+|1)(-?\d*)", word).groups()  # type: ignore[union-attr]
    if base not in _DERIVED:
        return word
    parts = (re.fullmatch(r"([a-z]+)(-?\d*)", part).groups() for part in _DERIVED[base].split())  # type: ignore[union-attr]
    return " ".join(f"{name}{int(exponent or 1) * int(power or 1)}" for name, exponent in parts)


def scaled_parts(aircraft: Aircraft, scale: Scale) -> dict[str, Any]:
    """Return fuel, gear and circuits of the similar aircraft, by the field of `Aircraft`."""
    return {
        "fuel": _fuel(aircraft.fuel, scale) if aircraft.fuel is not None else None,
        "gear": _gear(aircraft.gear, scale) if aircraft.gear is not None else None,
        "circuits": {
            name: _constants(circuit, _ROTARY if name == "wheel" else _LINEAR, scale) for name, circuit in aircraft.circuits.items()
        },
    }


def scaled_deck(deck: Deck, scale: Scale) -> Deck:
    """Return the engine deck of the similar aircraft."""
    changed = _constants(deck, _DECK, scale)
    return replace(changed, tables={name: _table(leaf, TARGETS[name], scale) for name, leaf in deck.tables.items()})


def _constants(item: Any, units: Mapping[str, str], scale: Scale) -> Any:
    """Return a dataclass with the constants that have units scaled; limits that are none stay none."""
    return replace(
        item, **{f.name: _scaled_values(getattr(item, f.name), scale.of(units[f.name])) for f in fields(item) if f.name in units}
    )


def _scaled_values(value: Any, by: float) -> Any:
    if value is None:
        return None
    if isinstance(value, tuple):
        return tuple(_scaled_values(part, by) for part in value)
    return value if abs(value) == sys.float_info.max else value * by


def _table(leaf: xr.Dataset, units: str, scale: Scale, axes: Mapping[str, str] | None = None) -> xr.Dataset:
    """Return a leaf whose value is in `units` over those of its regressors, with the axes of `axes` scaled too."""
    by = scale.thrust if units == "N" else scale.of(units)
    for word in regressors(leaf):
        by /= scale.of(lookup(word).units)
    scaled = leaf.assign({name: leaf[name].copy(data=leaf[name].values * by) for name in ("value", "stderr") if name in leaf})
    return scaled.assign_coords({name: leaf[name] * scale.of(unit) for name, unit in (axes or {}).items() if name in leaf.coords})


def _fuel(fuel: Fuel, scale: Scale) -> Fuel:
    units = {**dict.fromkeys(MOMENTS, "kg m"), **dict.fromkeys(INERTIAS, "kg m2")}
    tables = {name: _table(leaf, units[name], scale, {"fuel": "kg"}) for name, leaf in fuel.tables.items()}
    return Fuel(fuel.mass * scale.mass, _scaled_values(fuel.position, scale.length), tables)


def _gear(gear: LandingGear, scale: Scale) -> LandingGear:
    contacts = tuple(_contact(contact, scale) for contact in gear.contacts)
    return replace(gear, contacts=contacts, steering=_constants(gear.steering, _STEERING, scale))


def _contact(contact: Contact, scale: Scale) -> Contact:
    changed = _constants(contact, _CONTACT, scale)
    if contact.strut is None:
        return changed
    force = replace(scale, thrust=scale.of("N"))
    return replace(changed, strut=_table(contact.strut, "N", force, {"compression": "m"}))

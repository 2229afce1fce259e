"""Catalogue rows and tables of the landing gear."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from flightmech.simulation.catalogue_row import MOST, make_row
from flightmech.simulation.kernel import (
    FIXED,
    INPUT,
    INTEGER,
    PARAMETER,
    STATE,
    CatalogueEntry,
)

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.aircraft.aircraft import Aircraft
    from flightmech.aircraft.landing_gear import Contact, LandingGear

# Tables below: units, display units, description by name; _RUNWAY has no display units.
_INPUTS = {
    "delta_nw": ("rad", "deg", "nose-wheel steering command, positive to the right"),
    "brake_left": ("1", "1", "left brake pedal, 0 free, 1 full"),
    "brake_right": ("1", "1", "right brake pedal, 0 free, 1 full"),
}
_GEAR_OUTPUTS = {
    "gear.Fx": ("N", "N", "force of the ground on the aircraft along body x"),
    "gear.Fy": ("N", "N", "force of the ground on the aircraft along body y"),
    "gear.Fz": ("N", "N", "force of the ground on the aircraft along body z"),
    "gear.Mx": ("N m", "N m", "moment of the ground about the c.g., body x"),
    "gear.My": ("N m", "N m", "moment of the ground about the c.g., body y"),
    "gear.Mz": ("N m", "N m", "moment of the ground about the c.g., body z"),
    "gear.steering": ("rad", "deg", "steering angle of the nose wheel, positive to the right"),
    "gear.steering_moment": (
        "N m",
        "N m",
        "moment of the steering spring on the nose wheel, positive to the right",
    ),
}
_CONTACT_OUTPUTS = {
    "compression": ("m", "cm", "compression of the strut"),
    "tyre_deflection": ("m", "cm", "vertical deflection of the tyre"),
    "Fx": ("N", "N", "force of the ground along the wheel, positive forward"),
    "Fy": ("N", "N", "force of the ground across the wheel, positive to the right"),
    "Fz": ("N", "N", "load, positive when the ground pushes up"),
    "slip_angle": (
        "rad",
        "deg",
        "angle from the wheel to its motion over the ground, positive when it moves to the right",
    ),
    "brake_force": ("N", "N", "force at the ground that the brake can hold"),
}
_GEAR_STATES = {
    "steering": ("rad", "deg", "steering angle"),
    "steering_rate": ("rad s-1", "deg/s", "rate of the steering angle"),
    "steering_arm": ("rad", "deg", "angle of the steering arm"),
    "steering_arm_rate": ("rad s-1", "deg/s", "rate of the steering arm"),
    "steering_twist": ("rad", "deg", "twist of the tyre of a wheel turned at rest"),
}
_CONTACT_STATES = {
    "stroke": ("m", "cm", "compression of the strut in series with a tyre"),
    "tyre_x": ("m", "cm", "deflection of tyre or skid along the wheel"),
    "tyre_y": ("m", "cm", "deflection of tyre or skid across the wheel"),
}
_RUNWAY = {
    "mu_dry": ("1", "greatest friction of a tyre over load, dry runway"),
    "mu_wet_0": ("1", "the same on a wet runway: constant of the cubic of the ground speed"),
    "mu_wet_1": ("s m-1", "the same: factor of the speed"),
    "mu_wet_2": ("s2 m-2", "the same: factor of its square"),
    "mu_wet_3": ("s3 m-3", "the same: factor of its cube"),
    "mu_icy": ("1", "greatest friction of a tyre over load, icy runway"),
    "skid_ratio": ("1", "friction of a locked wheel over the greatest friction"),
}
# Parameters that may be negative.
_SIGNED = (
    "mu_wet_0",
    "mu_wet_1",
    "mu_wet_2",
    "mu_wet_3",
    "trail",
    "rudder",
    "steering",
    "x",
    "y",
    "z",
)
_STEERING = {
    "limit": ("rad", "deg", "greatest steering angle to either side"),
    "stiffness": (
        "N m rad-1",
        "N m/deg",
        "moment of the steering spring; 0 with order 0: a castor",
    ),
    "damping": ("N m s rad-1", "N m s rad-1", "damping of the wheel about its pivot"),
    "inertia": ("kg m2", "kg m2", "moment of inertia of the wheel about its pivot"),
    "trail": ("m", "cm", "side force behind the pivot"),
    "scrub": ("m", "cm", "moment over friction force of a wheel turned at rest"),
    "rudder": ("1", "1", "steering command per rudder deflection, both to the right"),
    "arm_stiffness": (
        "N m rad-1",
        "N m/deg",
        "moment of the spring between command and arm, order 4",
    ),
    "arm_damping": ("N m s rad-1", "N m s rad-1", "damping of the arm, order 4"),
    "arm_inertia": ("kg m2", "kg m2", "moment of inertia of the arm, order 4"),
}
_CONTACT = {
    "x": ("m", "m", "lowest point of the unloaded leg from the moment reference point, body x"),
    "y": ("m", "m", "lowest point of the unloaded leg from the moment reference point, body y"),
    "z": ("m", "m", "lowest point of the unloaded leg from the moment reference point, body z"),
    "radius": ("m", "m", "radius of the unloaded tyre"),
    "stiffness": ("N m-1", "N m-1", "strut force over compression"),
    "preload": ("N", "N", "strut force at no compression"),
    "stroke": ("m", "m", "compression at which the strut is solid"),
    "damping": ("N s m-1", "N s m-1", "strut force per rate of compression, inwards"),
    "damping_ext": ("N s m-1", "N s m-1", "the same outwards"),
    "orifice": ("N s2 m-2", "N s2 m-2", "strut force per square of the rate, inwards"),
    "orifice_ext": ("N s2 m-2", "N s2 m-2", "the same outwards"),
    "tyre_stiffness": ("N m-1", "N m-1", "vertical stiffness of the tyre in series; 0 one spring"),
    "side_stiffness": ("N m-1", "N m-1", "stiffness of tyre or skid along the ground"),
    "cornering_stiffness": ("N rad-1", "N/deg", "greatest side force per slip angle; 0 a skid"),
    "cornering_load": ("N", "N", "load at which it is reached"),
    "loss": ("s", "ms", "damping of the carcass along the ground over its stiffness"),
    "rolling": ("1", "1", "rolling resistance over load"),
    "brake": ("N", "N", "brake force at the ground with a full pedal"),
    "brake_friction": ("1", "1", "brake force over load with a full pedal, added to brake"),
    "steering": ("1", "1", "angle of the wheel per steering angle"),
    "friction": ("1", "1", "friction of a skid over load; 0 a wheel"),
    "retracts": ("1", "1", "1: carries in proportion to the input gear"),
}

# Upper limits of parameters of a contact.
_HIGHEST = {"retracts": 1.0, "loss": 0.04}


def row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> CatalogueEntry:
    """Return the catalogue row of a name of the gear or of a contact."""
    gear = aircraft.gear
    assert gear is not None
    word = name.rsplit(".", 1)[-1]
    if kind == PARAMETER:
        # a parameter belongs to a contact if the item is one, else to the gear
        for contact in gear.contacts:
            if contact.name == item:
                return _contact_parameter_row(name, word, contact)
        return _gear_parameter_row(name, word, gear)
    if kind == INPUT:
        units, display_units, text = _INPUTS[name]
        low, high = 0.0, 1.0
        if name == "delta_nw":
            low, high = -gear.steering.limit, gear.steering.limit
        return make_row(name, units, text, display_units=display_units, low=low, high=high)
    # weight on wheels
    if name == f"wow_{item}":
        return make_row(name, "1", f"{item} on the ground, 1 yes", low=0.0, high=1.0)
    if group == "gear":
        table = _GEAR_STATES[word] if kind == STATE else _GEAR_OUTPUTS[name]
        units, display_units, text = table
        return make_row(name, units, text, display_units=display_units)
    table = _CONTACT_STATES[word] if kind == STATE else _CONTACT_OUTPUTS[word]
    units, display_units, text = table
    return make_row(name, units, f"{item}: {text}", display_units=display_units)


def _gear_parameter_row(name: str, word: str, gear: LandingGear) -> CatalogueEntry:
    """Return the row of a parameter of runway, brakes or steering."""
    if name == "runway.condition":
        text, condition = "0 dry, 1 wet, 2 icy", float(gear.condition)
        return make_row(name, "1", text, value=condition, low=0.0, high=2.0, flags=INTEGER)
    if name == "gear.antiskid":
        text = "part of the friction that the anti-skid system uses; 0 none"
        return make_row(name, "1", text, value=gear.antiskid, low=0.0, high=1.0)
    if name == "steering.order":
        text, order = "0 quasi-static, 2 one mass, 4 two masses", float(gear.steering.order)
        flags = INTEGER | FIXED
        return make_row(name, "1", text, value=order, low=0.0, high=4.0, flags=flags)
    low = -MOST if word in _SIGNED else 0.0
    if name.startswith("steering."):
        units, display_units, text = _STEERING[word]
        value = getattr(gear.steering, word)
        return make_row(name, units, text, display_units=display_units, value=value, low=low)
    units, text = _RUNWAY[word]
    # mu_wet_0 ... mu_wet_3 are the coefficients of one polynomial
    if word.startswith("mu_wet"):
        value = gear.mu_wet[int(word[-1])]
    else:
        value = getattr(gear, word)
    high = 1.0 if word == "skid_ratio" else MOST
    return make_row(name, units, text, value=value, low=low, high=high)


def _contact_parameter_row(name: str, word: str, contact: Contact) -> CatalogueEntry:
    units, display_units, text = _CONTACT[word]
    if word in "xyz":
        value = contact.position["xyz".index(word)]
    else:
        value = float(getattr(contact, word))
    return make_row(
        name,
        units,
        f"{contact.name}: {text}",
        display_units=display_units,
        value=value,
        low=-MOST if word in _SIGNED else 0.0,
        high=_HIGHEST.get(word, MOST),
        flags=INTEGER if word == "retracts" else 0,
    )


def items(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return the items of the groups: one gear, and the contacts by name."""
    if aircraft.gear is None:
        return {"gear": (), "contact": ()}
    return {"gear": ("",), "contact": tuple(contact.name for contact in aircraft.gear.contacts)}


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return the strut tables."""
    if aircraft.gear is None:
        return
    for contact in aircraft.gear.contacts:
        if contact.strut is not None:
            leaf = contact.strut.rename({"compression": f"gear.{contact.name}.compression"})
            yield f"gear.{contact.name}.strut", f"gear.{contact.name}/strut", leaf

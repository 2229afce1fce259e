"""Catalogue rows of the landing gear: what its inputs, outputs, states and parameters mean."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

from flightmech.simulation.kernel import (
    FIXED,
    INPUT,
    INTEGER,
    OUTPUT,
    PARAMETER,
    STATE,
    CatalogueEntry,
)

if TYPE_CHECKING:
    import xarray as xr

    from flightmech.aircraft.aircraft import Aircraft
    from flightmech.aircraft.landing_gear import Contact, LandingGear

MOST = sys.float_info.max

# name: units, display units, description
_INPUTS = {
    "delta_nw": ("rad", "deg", "nose-wheel steering command, positive to the right"),
    "brake_left": ("1", "1", "left brake pedal, 0 free, 1 full"),
    "brake_right": ("1", "1", "right brake pedal, 0 free, 1 full"),
}
_GEAR_OUTPUTS = {
    **{
        f"gear.F{axis}": ("N", "N", f"force of the ground on the aircraft along body {axis}")
        for axis in "xyz"
    },
    **{
        f"gear.M{axis}": ("N m", "N m", f"moment of the ground about the c.g., body {axis}")
        for axis in "xyz"
    },
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
    **{
        axis: (
            "m",
            "m",
            f"lowest point of the unloaded leg from the moment reference point, body {axis}",
        )
        for axis in "xyz"
    },
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


def row(kind: int, group: str, item: str, name: str, aircraft: Aircraft) -> CatalogueEntry:
    """Return the catalogue row of a name of the gear or of a contact."""
    assert aircraft.gear is not None
    word = name.rsplit(".", 1)[-1]
    if kind == PARAMETER:
        contact = next(
            (contact for contact in aircraft.gear.contacts if contact.name == item), None
        )
        return (
            _gear_parameter(name, word, aircraft.gear)
            if contact is None
            else _contact_parameter(name, word, contact)
        )
    if kind == INPUT:
        units, display, text = _INPUTS[name]
        limit = aircraft.gear.steering.limit
        return CatalogueEntry(
            name,
            units,
            display,
            text,
            0.0,
            *((-limit, limit) if name == "delta_nw" else (0.0, 1.0)),
            0,
        )
    if name == f"wow_{item}":
        return CatalogueEntry(name, "1", "1", f"{item} on the ground, 1 yes", 0.0, 0.0, 1.0, 0)
    if kind == STATE:
        units, display, text = (_GEAR_STATES if group == "gear" else _CONTACT_STATES)[word]
    elif kind == OUTPUT and group == "gear":
        units, display, text = _GEAR_OUTPUTS[name]
    else:
        units, display, text = _CONTACT_OUTPUTS[word]
    return CatalogueEntry(
        name, units, display, text if group == "gear" else f"{item}: {text}", 0.0, -MOST, MOST, 0
    )


def _gear_parameter(name: str, word: str, gear: LandingGear) -> CatalogueEntry:
    if name == "runway.condition":
        return CatalogueEntry(
            name, "1", "1", "0 dry, 1 wet, 2 icy", float(gear.condition), 0.0, 2.0, INTEGER
        )
    if name == "gear.antiskid":
        return CatalogueEntry(
            name,
            "1",
            "1",
            "part of the friction that the anti-skid system uses; 0 none",
            gear.antiskid,
            0.0,
            1.0,
            0,
        )
    if name == "steering.order":
        return CatalogueEntry(
            name,
            "1",
            "1",
            "0 quasi-static, 2 one mass, 4 two masses",
            float(gear.steering.order),
            0.0,
            4.0,
            INTEGER | FIXED,
        )
    low = -MOST if word in _SIGNED else 0.0
    if name.startswith("steering."):
        return CatalogueEntry(name, *_STEERING[word], getattr(gear.steering, word), low, MOST, 0)
    units, text = _RUNWAY[word]
    value = gear.mu_wet[int(word[-1])] if word.startswith("mu_wet") else getattr(gear, word)
    return CatalogueEntry(
        name, units, units, text, value, low, 1.0 if word == "skid_ratio" else MOST, 0
    )


def _contact_parameter(name: str, word: str, contact: Contact) -> CatalogueEntry:
    units, display, text = _CONTACT[word]
    place = dict(zip("xyz", contact.position, strict=True))
    value = place[word] if word in place else float(getattr(contact, word))
    high = {"retracts": 1.0, "loss": 0.04}.get(word, MOST)
    return CatalogueEntry(
        name,
        units,
        display,
        f"{contact.name}: {text}",
        value,
        -MOST if word in _SIGNED else 0.0,
        high,
        INTEGER if word == "retracts" else 0,
    )


def items(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Return the items of the groups: one gear, and the contacts by name."""
    if aircraft.gear is None:
        return {"gear": (), "contact": ()}
    return {"gear": ("",), "contact": tuple(contact.name for contact in aircraft.gear.contacts)}


def terms(aircraft: Aircraft) -> Iterator[tuple[str, str, xr.Dataset]]:
    """Return the strut tables."""
    for contact in aircraft.gear.contacts if aircraft.gear else ():
        if contact.strut is not None:
            leaf = contact.strut.rename({"compression": f"gear.{contact.name}.compression"})
            yield f"gear.{contact.name}.strut", f"gear.{contact.name}/strut", leaf

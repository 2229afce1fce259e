"""An aircraft from a similar one, by the laws of similarity ([LR743] section 2.3).

With the length ratio l and the mass ratio m (l^3 at equal density) an aircraft of the same shape
flies alike at the same lift coefficient when its speed is V sqrt(l) and its times are t sqrt(l)
(equal Froude number V^2/(g L)).  Every law below follows from the dimensions of its quantity with
these three, forces going with m: what is counted in radians or in parts of a travel stays as it is.

Not similar, and kept as they are: Mach number and height axes of the thrust tables (the air is the
same air), the errors of the instruments, limits of the controls.

References
----------
.. [LR743] Report LR-743, 1993, section 2.3.
.. [Wolowicz] Wolowicz, Bowman and Gilbert, Similitude requirements and scaling relationships as applied to model testing,
   NASA TP-1435, 1979: Froude scaling.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft, Vector
from flightmech.aircraft.controls import ControlGeometry
from flightmech.aircraft.engine import Engine
from flightmech.aircraft.engine_deck import TARGETS, EngineDeck
from flightmech.aircraft.fuel import INERTIAS, MOMENTS, Fuel
from flightmech.aircraft.landing_gear import Contact, LandingGear
from flightmech.errors import SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.terms import SOURCES, list_regressors

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
_SURFACE = {
    "inertia": "kg m2",
    "hinge_damping": "N m s",
    "hinge_friction": _TORQUE,
    "unbalance": "kg m",
    "arm": "m",
    "step": "s",
}
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
            name: _constants(circuit, _ROTARY if name == "wheel" else _LINEAR, scale)
            for name, circuit in aircraft.circuits.items()
        },
    }


def scaled_deck(deck: EngineDeck, scale: Scale) -> EngineDeck:
    """Return the engine deck of the similar aircraft."""
    changed = _constants(deck, _DECK, scale)
    return replace(
        changed,
        tables={name: _table(leaf, TARGETS[name], scale) for name, leaf in deck.tables.items()},
    )


def _constants(item: Any, units: Mapping[str, str], scale: Scale) -> Any:
    """Return a dataclass with the constants that have units scaled; limits that are none stay none."""
    return replace(
        item,
        **{
            f.name: _scaled_values(getattr(item, f.name), scale.of(units[f.name]))
            for f in fields(item)
            if f.name in units
        },
    )


def _scaled_values(value: Any, by: float) -> Any:
    if value is None:
        return None
    if isinstance(value, tuple):
        return tuple(_scaled_values(part, by) for part in value)
    return value if abs(value) == sys.float_info.max else value * by


def _table(
    leaf: xr.Dataset, units: str, scale: Scale, axes: Mapping[str, str] | None = None
) -> xr.Dataset:
    """Return a leaf whose value is in `units` over those of its regressors, with the axes of `axes`
    scaled too.
    """
    by = scale.thrust if units == "N" else scale.of(units)
    for word in list_regressors(leaf):
        by /= scale.of(lookup(word).units)
    scaled = leaf.assign(
        {
            name: leaf[name].copy(data=leaf[name].values * by)
            for name in ("value", "stderr")
            if name in leaf
        }
    )
    return scaled.assign_coords(
        {
            name: leaf[name] * scale.of(unit)
            for name, unit in (axes or {}).items()
            if name in leaf.coords
        }
    )


def _fuel(fuel: Fuel, scale: Scale) -> Fuel:
    units = {**dict.fromkeys(MOMENTS, "kg m"), **dict.fromkeys(INERTIAS, "kg m2")}
    tables = {
        name: _table(leaf, units[name], scale, {"fuel": "kg"}) for name, leaf in fuel.tables.items()
    }
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


class Law(NamedTuple):
    """A power law: factor = length_ratio**length * mass_ratio**mass, and where it comes from."""

    length: float
    mass: float
    why: str


LAWS: dict[str, Law] = {
    "length": Law(1.0, 0.0, "geometry: chord, span, positions, centre of gravity, hinge chords"),
    "area": Law(2.0, 0.0, "geometry: wing and hinge areas"),
    "mass": Law(0.0, 1.0, "given, or the cube of the length ratio at equal density"),
    "inertia": Law(2.0, 1.0, "equal radii of gyration over length: m L^2"),
    "time": Law(0.5, 0.0, "Froude: L/V with V as sqrt(L)"),
    "thrust": Law(0.0, 1.0, "equal thrust over weight"),
    "angular_momentum": Law(1.5, 1.0, "m L^2 / t: equal gyroscopic over aerodynamic moments"),
    "gearing": Law(-1.0, 0.0, "equal angle per part of the travel; per rad of a wheel it stays"),
}
"""Laws of what an `Aircraft` holds; engine decks, fuel, gear and control circuits follow from these by their dimensions."""


def similarity_factor(law: Law, length_ratio: float, mass_ratio: float | None = None) -> float:
    """Return the factor of a law; without `mass_ratio` the density is equal.

    Examples
    --------
    >>> factor(LAWS["inertia"], 2.0)
    32.0
    """
    mass = length_ratio**3 if mass_ratio is None else mass_ratio
    return float(length_ratio**law.length * mass**law.mass)


def rescale(
    aircraft: Aircraft,
    length_ratio: float,
    mass_ratio: float | None = None,
    overrides: Mapping[str, float] | None = None,
    name: str = "",
) -> Aircraft:
    """Return a similar aircraft of another size.

    Parameters
    ----------
    aircraft : Aircraft
        The known one.
    length_ratio : float
        New length over known length. [1]
    mass_ratio : float, optional
        New mass over known mass; the cube of the length ratio unless given. [1]
    overrides : mapping of str to float, optional
        Factors that replace those of `LAWS`: ``{"thrust": 1.4}`` when the engine is known. [1]
    name : str, optional
        Name of the new aircraft.

    Returns
    -------
    Aircraft
        ``history`` lists the ratios, every factor and which were given.

    Raises
    ------
    SchemaError
        A ratio or factor that is not a positive number.
    UnknownName
        An override that is not in `LAWS`.
    """
    given = dict(overrides or {})
    ratios = {
        "length_ratio": length_ratio,
        **({} if mass_ratio is None else {"mass_ratio": mass_ratio}),
        **given,
    }
    bad = [
        f"{key} is {value!r}; give a positive number"
        for key, value in ratios.items()
        if not (np.isfinite(value) and value > 0.0)
    ]
    if bad:
        raise SchemaError("rescale", bad)
    for key in given:
        if key not in LAWS:
            raise UnknownName(key, LAWS, "law")
    by = {
        key: given.get(key, similarity_factor(law, length_ratio, mass_ratio))
        for key, law in LAWS.items()
    }
    inertia = {
        axis: getattr(aircraft, axis) * by["inertia"]
        for axis in ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
    }
    line = f"rescaled from {aircraft.name}: length ratio {length_ratio:g}; factors " + ", ".join(
        f"{key} {value:.6g}{' (given)' if key in given or (key == 'mass' and mass_ratio is not None) else ''}"
        for key, value in by.items()
    )
    scale = Scale(by["length"], by["mass"], by["time"], by["thrust"])
    return replace(
        aircraft,
        name=name or aircraft.name,
        S=aircraft.S * by["area"],
        cbar=aircraft.cbar * by["length"],
        b=aircraft.b * by["length"],
        mass=aircraft.mass * by["mass"],
        **inertia,
        reference=None if aircraft.reference is None else _times(aircraft.reference, by["length"]),
        cg=_times(aircraft.cg, by["length"]),
        engines=tuple(_engine(engine, by, scale, line) for engine in aircraft.engines),
        **scaled_parts(aircraft, scale),
        instruments={
            key: _instrument(table, by["length"]) for key, table in aircraft.instruments.items()
        },
        controls={key: _control(key, control, by) for key, control in aircraft.controls.items()},
        history=f"{aircraft.history}\n{line}" if aircraft.history else line,
    )


def _times(vector: Vector, by: float) -> Vector:
    x, y, z = (component * by for component in vector)
    return x, y, z


def _engine(engine: Engine, by: Mapping[str, float], scale: Scale, line: str) -> Engine:
    return replace(
        engine,
        deck=None if engine.deck is None else scaled_deck(engine.deck, scale),
        position=_times(engine.position, by["length"]),
        thrust=None if engine.thrust is None else _thrust(engine.thrust, by["thrust"], line),
        time_constant=engine.time_constant * by["time"],
        angular_momentum=engine.angular_momentum * by["angular_momentum"],
    )


def _thrust(leaf: xr.Dataset, by: float, line: str) -> xr.Dataset:
    scaled = leaf.assign({name: leaf[name] * by for name in ("value", "stderr") if name in leaf})
    for name in ("value", "stderr"):
        if name in leaf:
            scaled[name].attrs = leaf[name].attrs
    if "source" in leaf:
        scaled["source"] = leaf["source"].copy(
            data=np.full(leaf["source"].shape, SOURCES.index("judgement"), np.uint8)
        )
    history = str(leaf.attrs.get("history", ""))
    return scaled.assign_attrs(history=f"{history}\n{line}" if history else line)


def _instrument(table: Any, by: float) -> Any:
    if not isinstance(table, dict) or "position" not in table:
        return table
    return {**table, "position": [float(component) * by for component in table["position"]]}


def _control(name: str, control: ControlGeometry, by: Mapping[str, float]) -> ControlGeometry:
    gearing = control.gearing
    if gearing is not None and name != "delta_a":
        gearing *= by["gearing"]
    return ControlGeometry(control.S_hinge * by["area"], control.c_hinge * by["length"], gearing)

"""Similar aircraft of another size, by the laws of similarity ([LR743] section 2.3).

Two aircraft of the same shape have the length ratio l and the mass ratio m (l^3 at equal density).
Their motions at the same lift coefficient are similar if the speed is V sqrt(l) and the times are
t sqrt(l), which means an equal Froude number V^2/(g L). Forces are proportional to m. All laws
follow from these three factors and the dimension of the quantity. Angles, and fractions of a
travel, do not change.

Mach number and height in the thrust tables do not change, because the air is the same. The errors
of the instruments and the limits of the controls do not change either.

References
----------
.. [LR743] Report LR-743, 1993, section 2.3.
.. [Wolowicz] Wolowicz, Bowman and Gilbert, Similitude requirements and scaling relationships as
   applied to model testing, NASA TP-1435, 1979: Froude scaling.
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
from flightmech.aircraft.facts import AircraftFacts
from flightmech.aircraft.fuel import INERTIAS, MOMENTS, Fuel
from flightmech.aircraft.landing_gear import Contact, LandingGear
from flightmech.aircraft.propulsion.engine_deck import TARGETS, EngineDeck
from flightmech.aircraft.separation import TARGETS as SEPARATION_TARGETS
from flightmech.aircraft.separation import FlowSeparation
from flightmech.errors import SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.terms import SOURCES, list_regressors

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
_DECK = {
    **dict.fromkeys(
        ("lever_delay", "n1_rundown", "n2_rundown", "starter_time", "flame_time", "itt_time"), "s"
    ),
    **dict.fromkeys(("n1_rated", "n2_rated"), "s-1"),
    **dict.fromkeys(("n1_inertia", "n2_inertia"), "kg m2"),
    "inlet": "m",
}
_FACTS = {"mtow": "kg", "basic_operating_weight": "kg", "v1": "m s-1", "mean_chord": "m"}


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
    units = {**dict.fromkeys(MOMENTS, "kg m"), **dict.fromkeys(INERTIAS, "kg m2")}
    tables = {}
    for name, leaf in fuel.tables.items():
        tables[name] = _scale_table(leaf, scale.of(units[name]), scale, axes={"fuel": "kg"})
    return Fuel(fuel.mass * scale.mass, _scale_value(fuel.position, scale.length), tables)


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


class Law(NamedTuple):
    """A power law, length_ratio**length * mass_ratio**mass, and its reason."""

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
"""Laws of the quantities of an `Aircraft`.

The factors of engine decks, fuel, gear and control circuits follow from these by their dimensions.
"""


def similarity_factor(law: Law, length_ratio: float, mass_ratio: float | None = None) -> float:
    """Return the factor of a law. Without `mass_ratio` the density is equal.

    Examples
    --------
    >>> similarity_factor(LAWS["inertia"], 2.0)
    32.0
    """
    if mass_ratio is None:
        mass_ratio = length_ratio**3
    return float(length_ratio**law.length * mass_ratio**law.mass)


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
        Aircraft with known data.
    length_ratio : float
        New length over the length of `aircraft`. [1]
    mass_ratio : float, optional
        New mass over the mass of `aircraft`. The default is the cube of the length ratio. [1]
    overrides : mapping of str to float, optional
        Factors that replace those of `LAWS`, for example ``{"thrust": 1.4}`` if the engine is
        known. [1]
    name : str, optional
        Name of the new aircraft.

    Returns
    -------
    Aircraft
        ``history`` lists the ratios, all factors and the overrides.

    Raises
    ------
    SchemaError
        A ratio or factor that is not a positive number.
    UnknownName
        An override that is not in `LAWS`.
    """
    fixed = dict(overrides or {})
    ratios = {"length_ratio": length_ratio}
    if mass_ratio is not None:
        ratios["mass_ratio"] = mass_ratio
    _demand_positive(ratios | fixed)
    for key in fixed:
        if key not in LAWS:
            raise UnknownName(key, LAWS, "law")
    factors = {}
    for key, law in LAWS.items():
        factors[key] = fixed.get(key, similarity_factor(law, length_ratio, mass_ratio))
    if mass_ratio is not None:
        fixed.setdefault("mass", mass_ratio)
    line = f"rescaled from {aircraft.name}: length ratio {length_ratio:g}; factors "
    line += _describe_factors(factors, fixed)
    return _scale_aircraft(aircraft, factors, name or aircraft.name, line)


def _demand_positive(ratios: Mapping[str, float]) -> None:
    problems = []
    for key, value in ratios.items():
        if not (np.isfinite(value) and value > 0.0):
            problems.append(f"{key} is {value!r}; give a positive number")
    if problems:
        raise SchemaError("rescale", problems)


def _describe_factors(factors: Mapping[str, float], fixed: Mapping[str, float]) -> str:
    texts = []
    for key, factor in factors.items():
        mark = " (given)" if key in fixed else ""
        texts.append(f"{key} {factor:.6g}{mark}")
    return ", ".join(texts)


def _scale_aircraft(
    aircraft: Aircraft, factors: Mapping[str, float], name: str, line: str
) -> Aircraft:
    """Return the aircraft with the factors of `LAWS`. `line` is added to its history."""
    length = factors["length"]
    scale = Scale(
        length=length, mass=factors["mass"], time=factors["time"], thrust=factors["thrust"]
    )
    reference = aircraft.reference
    if reference is not None:
        reference = _scale_vector(reference, length)
    # Moments of inertia have a factor of their own, which a law may replace.
    inertia = {}
    for moment in ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"):
        inertia[moment] = getattr(aircraft, moment) * factors["inertia"]
    instruments = {}
    for key, table in aircraft.instruments.items():
        instruments[key] = _scale_instrument(table, length)
    controls = {}
    for key, control in aircraft.controls.items():
        controls[key] = _scale_control(key, control, factors)
    return replace(
        aircraft,
        name=name,
        S=aircraft.S * factors["area"],
        cbar=aircraft.cbar * length,
        b=aircraft.b * length,
        mass=aircraft.mass * factors["mass"],
        **inertia,
        reference=reference,
        cg=_scale_vector(aircraft.cg, length),
        engines=tuple(_scale_engine(engine, factors, scale, line) for engine in aircraft.engines),
        **scaled_parts(aircraft, scale),
        instruments=instruments,
        controls=controls,
        history=_append_line(aircraft.history, line),
        facts=_scale_facts(aircraft.facts, scale),
    )


def _scale_facts(facts: AircraftFacts, scale: Scale) -> AircraftFacts:
    scaled = {}
    for name, units in _FACTS.items():
        value = getattr(facts, name)
        if value is not None:
            scaled[name] = value * scale.of(units)
    return replace(facts, **scaled)


def _scale_vector(vector: Vector, factor: float) -> Vector:
    x, y, z = vector
    return x * factor, y * factor, z * factor


def _append_line(history: str, line: str) -> str:
    return f"{history}\n{line}" if history else line


def _scale_engine(engine: Engine, factors: Mapping[str, float], scale: Scale, line: str) -> Engine:
    deck, thrust = engine.deck, engine.thrust
    if engine.propeller is not None:
        raise SchemaError(
            "similar aircraft",
            [
                "an engine turns a propeller, whose tables the laws of similarity do not scale; "
                "delete the engines and add those of the new aircraft afterwards"
            ],
        )
    if deck is not None:
        deck = scaled_deck(deck, scale)
    if thrust is not None:
        thrust = _scale_thrust(thrust, factors["thrust"], line)
    return replace(
        engine,
        deck=deck,
        position=_scale_vector(engine.position, factors["length"]),
        thrust=thrust,
        time_constant=engine.time_constant * factors["time"],
        angular_momentum=engine.angular_momentum * factors["angular_momentum"],
    )


def _scale_thrust(leaf: xr.Dataset, factor: float, line: str) -> xr.Dataset:
    tables = [name for name in ("value", "stderr") if name in leaf]
    scaled = leaf.assign({name: leaf[name] * factor for name in tables})
    # the product has no attributes
    for name in tables:
        scaled[name].attrs = leaf[name].attrs
    if "source" in leaf:
        codes = np.full(leaf["source"].shape, SOURCES.index("judgement"), np.uint8)
        scaled["source"] = leaf["source"].copy(data=codes)
    history = str(leaf.attrs.get("history", ""))
    return scaled.assign_attrs(history=_append_line(history, line))


def _scale_instrument(table: Any, factor: float) -> Any:
    if not isinstance(table, dict) or "position" not in table:
        return table
    return {**table, "position": [float(component) * factor for component in table["position"]]}


def _scale_control(
    name: str, control: ControlGeometry, factors: Mapping[str, float]
) -> ControlGeometry:
    gearing = control.gearing
    # the gearing of the aileron is per radian of the wheel, which does not change
    if gearing is not None and name != "delta_a":
        gearing *= factors["gearing"]
    return ControlGeometry(
        S_hinge=control.S_hinge * factors["area"],
        c_hinge=control.c_hinge * factors["length"],
        gearing=gearing,
    )

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

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft, Vector
from flightmech.aircraft.controls import ControlGeometry
from flightmech.aircraft.engine import Engine
from flightmech.aircraft.facts import AircraftFacts
from flightmech.aircraft.similarity_parts import Scale, scaled_deck, scaled_parts
from flightmech.errors import SchemaError, UnknownName
from flightmech.terms import SOURCES

_FACTS = {"mtow": "kg", "basic_operating_weight": "kg", "v1": "m s-1", "mean_chord": "m"}


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

"""An aircraft from a similar one, by the laws of similarity ([LR743] section 2.3).

With the length ratio l and the mass ratio m (l^3 at equal density) an aircraft of the same shape flies alike at the same lift coefficient
when its speed is V sqrt(l) and its times are t sqrt(l) (equal Froude number V^2/(g L)).  Every law below follows from the dimensions of its
quantity with these three, forces going with m: what is counted in radians or in parts of a travel stays as it is.

Not similar, and kept as they are: Mach number and height axes of the thrust tables (the air is the same air), the errors of the
instruments, limits of the controls.

References
----------
.. [LR743] Report LR-743, 1993, section 2.3.
.. [Wolowicz] Wolowicz, Bowman and Gilbert, Similitude requirements and scaling relationships as applied to model testing,
   NASA TP-1435, 1979: Froude scaling.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from ..errors import SchemaError, UnknownName
from ..terms import SOURCES
from .aircraft import Aircraft, Vector
from .control_surface import Control
from .similarity_parts import Scale, scaled_deck, scaled_parts
from .systems.engine import Engine


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


def factor(law: Law, length_ratio: float, mass_ratio: float | None = None) -> float:
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
    ratios = {"length_ratio": length_ratio, **({} if mass_ratio is None else {"mass_ratio": mass_ratio}), **given}
    bad = [f"{key} is {value!r}; give a positive number" for key, value in ratios.items() if not (np.isfinite(value) and value > 0.0)]
    if bad:
        raise SchemaError("rescale", bad)
    for key in given:
        if key not in LAWS:
            raise UnknownName(key, LAWS, "law")
    by = {key: given.get(key, factor(law, length_ratio, mass_ratio)) for key, law in LAWS.items()}
    inertia = {axis: getattr(aircraft, axis) * by["inertia"] for axis in ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")}
    line = f"rescaled from {aircraft.name}: length ratio {length_ratio:g}; factors " + ", ".join(
        f"{key} {value:.6g}{' (given)' if key in given or (key == 'mass' and mass_ratio is not None) else ''}" for key, value in by.items()
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
        instruments={key: _instrument(table, by["length"]) for key, table in aircraft.instruments.items()},
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
        scaled["source"] = leaf["source"].copy(data=np.full(leaf["source"].shape, SOURCES.index("judgement"), np.uint8))
    history = str(leaf.attrs.get("history", ""))
    return scaled.assign_attrs(history=f"{history}\n{line}" if history else line)


def _instrument(table: Any, by: float) -> Any:
    if not isinstance(table, dict) or "position" not in table:
        return table
    return {**table, "position": [float(component) * by for component in table["position"]]}


def _control(name: str, control: Control, by: Mapping[str, float]) -> Control:
    gearing = control.gearing
    if gearing is not None and name != "delta_a":
        gearing *= by["gearing"]
    return Control(control.S_hinge * by["area"], control.c_hinge * by["length"], gearing)

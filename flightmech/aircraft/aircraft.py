"""Aircraft: geometry, mass, engines, limits and instruments.

All numbers are SI. Positions are in body axes from the moment reference point. Only `reference` is
relative to the drawing datum.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypedDict

import numpy as np

from flightmech.aircraft.controls import (
    Circuit,
    ControlGeometry,
)
from flightmech.aircraft.engine import Engine
from flightmech.aircraft.facts import AircraftFacts
from flightmech.aircraft.fuel import Fuel
from flightmech.aircraft.landing_gear import LandingGear
from flightmech.aircraft.propulsion.tank import Tank
from flightmech.aircraft.separation import FlowSeparation
from flightmech.errors import UnknownName
from flightmech.short_text import ShortText, describe_fields
from flightmech.support.figures import html_table

Vector = tuple[float, float, float]


class DefaultNumber(float):
    """A default value: equal to the same number in a file, of another type."""


X_REF_MAC = DefaultNumber(0.25)
# units of the fields of an aircraft that are one number, and of all fields
_SCALAR_UNITS = {"S": "m2", "cbar": "m", "b": "m", "mass": "kg"} | dict.fromkeys(
    ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"), "kg m2"
)
_UNITS = {**_SCALAR_UNITS, "reference": "m", "cg": "m"}


@dataclass(frozen=True)
class Aircraft(ShortText):
    """Geometry, mass and equipment of an aircraft, SI.

    Parameters
    ----------
    name : str
        Name of the type.
    S, cbar, b : float
        Reference area, chord and span. [m2, m, m]
    mass : float
        Gross mass. [kg]
    Ixx, Iyy, Izz, Ixy, Ixz, Iyz : float
        Moments and products of inertia about the c.g. The products are the integrals of xy dm and
        so on. [kg m2]
    reference : tuple of float (3,), optional
        Moment reference point from the drawing datum, in body directions. The default is the point
        of the database. [m]
    x_ref_mac : float
        Distance of the reference point behind the leading edge of the mean chord, in chords. [1]
    cg : tuple of float (3,)
        Centre of gravity from the moment reference point, body axes. [m]
    engines : tuple of Engine
        Engines in the order of their numbers, from 1.
    limits : dict of str to (low, high)
        Travel of the controls. [SI]
    instruments : dict of str to dict
        Tables of the instruments as in the file, for `flighttest`.
    controls : dict of str to ControlGeometry
        Hinge geometry of ``delta_e``, ``delta_a`` and ``delta_r``, ``[control.delta_e]`` in the
        file.
    circuits : dict of str to Circuit
        Circuits of ``column``, ``wheel`` and ``pedal``, ``[circuit.column]`` in the file.
    gear : LandingGear, optional
        Wheels, skids, steering and runway, ``[gear]`` in the file.
    fuel : Fuel, optional
        Fuel on board, part of `mass`. Without it the mass is constant.
    stall : FlowSeparation, optional
        Flow separation of both wing halves, ``[stall]`` in the file. Without it the tables of the
        database are the stall.
    earth_outputs : bool
        Whether the models have outputs in Earth-fixed and inertial axes, and the gravitation.
    acknowledged : dict of str to str
        Reasons for unusual values of the database by subject, such as ``static margin``.
    history : str
        Source of computed numbers, one line per step.
    facts : AircraftFacts
        Weights, speeds and kind of controls, ``[facts]`` in the file.
    """

    name: str
    S: float
    cbar: float
    b: float
    mass: float
    Ixx: float
    Iyy: float
    Izz: float
    Ixy: float = 0.0
    Ixz: float = 0.0
    Iyz: float = 0.0
    reference: Vector | None = None
    x_ref_mac: float = X_REF_MAC
    cg: Vector = (0.0, 0.0, 0.0)
    engines: tuple[Engine, ...] = ()
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)
    instruments: dict[str, Any] = field(default_factory=dict)
    controls: dict[str, ControlGeometry] = field(default_factory=dict)
    circuits: dict[str, Circuit] = field(default_factory=dict)
    gear: LandingGear | None = None
    fuel: Fuel | None = None
    stall: FlowSeparation | None = None
    earth_outputs: bool = False
    acknowledged: dict[str, str] = field(default_factory=dict)
    history: str = ""
    facts: AircraftFacts = field(default_factory=AircraftFacts)

    def __repr__(self) -> str:
        """Return geometry, mass and equipment with units as text."""
        return describe_fields(self, _UNITS)

    def _repr_html_(self) -> str:
        """Return geometry, mass and equipment as a table for a notebook."""
        rows: list[tuple[str, object, str]] = []
        for name, unit in _SCALAR_UNITS.items():
            rows.append((name, float(getattr(self, name)), unit))
        cg = " ".join(f"{component:g}" for component in self.cg)
        rows.append(("cg", cg, "m from the moment reference point"))
        rows.append(("engines", len(self.engines), ""))
        rows.append(("instruments", ", ".join(self.instruments), ""))
        parts = {"control circuits": self.circuits, "landing gear": self.gear, "fuel": self.fuel}
        notes = [f"without {name}" for name, part in parts.items() if not part]
        return html_table(f"Aircraft {self.name}", ("", "", "unit"), rows, notes=notes)


def reference_in(aircraft: Any, attrs: Mapping[Any, Any]) -> Vector:
    """Return the moment reference point of an aircraft. [m]

    The default is the point in the attributes of a database.
    """
    if aircraft.reference is not None:
        return aircraft.reference
    x, y, z = (float(attrs.get(name, 0.0)) for name in ("x_ref", "y_ref", "z_ref"))
    return x, y, z


def inertia_tensor(aircraft: Any) -> np.ndarray:
    """Return the inertia tensor (3, 3) about the c.g., body axes. [kg m2]"""
    Ixx, Iyy, Izz = aircraft.Ixx, aircraft.Iyy, aircraft.Izz
    Ixy, Ixz, Iyz = aircraft.Ixy, aircraft.Ixz, aircraft.Iyz
    # products are the integrals of xy dm and so on, so they have a minus sign here
    return np.array([[Ixx, -Ixy, -Ixz], [-Ixy, Iyy, -Iyz], [-Ixz, -Iyz, Izz]])


class InertiaFields(TypedDict):
    """Moments and products of inertia about the c.g., body axes. [kg m2]"""

    Ixx: float
    Iyy: float
    Izz: float
    Ixy: float
    Ixz: float
    Iyz: float


def inertia_fields(tensor: np.ndarray) -> InertiaFields:
    """Return the moments and products of an inertia tensor (3, 3), as fields of an aircraft.

    The inverse of `inertia_tensor`. [kg m2]
    """
    return {
        "Ixx": float(tensor[0, 0]),
        "Iyy": float(tensor[1, 1]),
        "Izz": float(tensor[2, 2]),
        "Ixy": float(-tensor[0, 1]),
        "Ixz": float(-tensor[0, 2]),
        "Iyz": float(-tensor[1, 2]),
    }


def point_inertia(mass: float, arm: np.ndarray) -> np.ndarray:
    """Return the inertia tensor (3, 3) about the origin of a mass point at `arm` [m]. [kg m2]"""
    # parallel axes: m (r^T r I - r r^T)
    return mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))


def tanks_of(aircraft: Aircraft) -> tuple[Tank, ...]:
    """Return the tanks with a state each; none of an aircraft with one state for all fuel."""
    return () if aircraft.fuel is None else aircraft.fuel.tanks


def with_contents(aircraft: Aircraft, contents: Mapping[str, float]) -> Aircraft:
    """Return the aircraft with other contents of its tanks.

    Parameters
    ----------
    aircraft : Aircraft
        Its mass, centre of gravity and inertia include the contents of the tanks of its fuel.
    contents : mapping of str to float
        Fuel by the name of the tank; tanks without an entry keep theirs. [kg]

    Returns
    -------
    Aircraft
        Mass, centre of gravity, inertia about it, and fuel have the new contents.

    Raises
    ------
    UnknownName
        A tank that the aircraft does not have.
    SchemaError
        A content that does not go into its tank.
    """
    fuel, tanks = aircraft.fuel, tanks_of(aircraft)
    for name in contents:
        if all(name != tank.name for tank in tanks):
            raise UnknownName(name, [tank.name for tank in tanks], "tank of the aircraft")
    if fuel is None or not tanks:
        return aircraft
    filled = tuple(replace(tank, content=contents.get(tank.name, tank.content)) for tank in tanks)
    # J about the moment reference point, of all that has mass
    cg = np.array(aircraft.cg)
    mass, moment = aircraft.mass, aircraft.mass * cg
    J = inertia_tensor(aircraft) + point_inertia(mass, cg)
    for old, new in zip(tanks, filled, strict=True):
        change, position = new.content - old.content, np.array(new.position)
        mass += change
        moment = moment + change * position
        J = J + point_inertia(change, position)
    x, y, z = (float(value) for value in moment / mass)
    J = J - point_inertia(mass, np.array([x, y, z]))
    held = sum(tank.content for tank in filled)
    return replace(
        aircraft,
        mass=mass,
        cg=(x, y, z),
        **inertia_fields(J),
        fuel=replace(fuel, mass=held, tanks=filled),
    )

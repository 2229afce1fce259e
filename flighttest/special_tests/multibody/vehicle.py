"""Vehicle of several rigid bodies, as a TOML file.

The file has a tree of bodies on revolute joints, the drives of the joints, and the markers.

rho = "1.2 kg/m3"

[body.fuselage]                                # no parent: the base
mass = "0.337 kg"
cg = ["0.01 m", "0 m", "0.005 m"]              # from its origin, x forward, y right, z down
# Ixx Iyy Izz about the c.g., then Ixy Ixz Iyz if not zero
inertia = ["4e-4 kg m2", "3.5e-3 kg m2", "3.5e-3 kg m2"]
[body.fuselage.markers]
nose = ["0.20 m", "0 m", "0.01 m"]

[body.wing_right]
parent = "fuselage"
# origin, on the axis of the joint, in axes of the parent
at = ["0.06 m", "0.03 m", "-0.03 m"]
# right-handed; at angle 0 the axes of the body are those of the parent
axis = [1, 0, 0]
mass = "0.0428 kg"

[gear.wing_left]                               # angle = ratio times that of another joint
follows = "wing_right"
ratio = -1

[linkage.stroke]                               # planar four-bar; the crank is independent
crank = "crank"
coupler = "coupler"
rocker = "wing_right"
pin_on_coupler = ["0 m", "0.025 m", "-0.049 m"]
pin_on_rocker = ["0 m", "0.025 m", "0 m"]

[spring.wing_right]
stiffness = "0.05 N m/rad"

[actuator.crank]                               # Ma a + Ca v + Ka p + G tau = B u
Ma = 2e-5
Ca = 4e-3
B = 0.4
command = "throttle"

[aerodynamics.tail]                            # known part of the air loads, such as balance fits
body = "tail"
point = ["-0.05 m", "0 m", "0 m"]
S = "0.032 m2"
fits = "tail_fits"

[reference]
S = "0.27 m2"

[cameras]
axes = "north west up"
flapping_frequency = "5 Hz"
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import xarray as xr
from pydantic import BeforeValidator, Field, model_validator

from flightmech.errors import SchemaError
from flightmech.quantities import parse_quantity, time_text
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_models import Strict, validate_content
from flightmech.support.toml_quantities import InUnits
from flightmech.units import to_si
from flighttest.records.readers.columns import locate_column
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.opening import open_recording
from flighttest.special_tests.motion_capture import MarkerSetup, read_markers
from flighttest.special_tests.multibody.joints import (
    GearedJoint,
    JointActuator,
    Linkage,
    Position,
    Spring,
)

# Largest difference of the unit vectors of parallel axes.
_PARALLEL = 1e-9
# Rounding of the largest moment of inertia of a thin body.
_ROUNDING = 1e-9


def _inertia(item: Any) -> tuple[float, ...]:
    if not isinstance(item, (list, tuple)) or len(item) not in (3, 6):
        raise ValueError(
            "three moments of inertia Ixx Iyy Izz, or six with Ixy Ixz Iyz, are needed"
        )
    return tuple(parse_quantity(value, "kg m2") for value in item)


class RigidBody(Strict):
    """One rigid body and the joint between it and its parent."""

    mass: Annotated[float, InUnits("kg")] = Field(ge=0.0, description="Mass.")
    cg: Position = Field(
        default=(0.0, 0.0, 0.0),
        description="Centre of gravity from the origin, x forward, y right, z down.",
    )
    inertia: Annotated[tuple[float, ...], BeforeValidator(_inertia)] = Field(
        default=(0.0, 0.0, 0.0),
        description="Ixx Iyy Izz about the c.g., or six with the integrals of xy, xz, yz dm.",
    )
    parent: str | None = Field(
        default=None, description="Body that holds it; the one body without is the base."
    )
    at: Position = Field(
        default=(0.0, 0.0, 0.0),
        description="Origin, on the axis of the joint, in axes of the parent.",
    )
    axis: tuple[float, float, float] = Field(
        default=(1.0, 0.0, 0.0), description="Axis of the joint in axes of the parent."
    )
    markers: dict[str, Position] = Field(default_factory=dict, description="Markers in body axes.")

    @property
    def matrix(self) -> np.ndarray:
        """Inertia matrix about the c.g. [kg m2]"""
        xx, yy, zz, xy, xz, yz = (*self.inertia, 0.0, 0.0, 0.0)[:6]
        return np.array([[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]])

    @model_validator(mode="after")
    def _check_body(self) -> RigidBody:
        if not np.linalg.norm(self.axis) > 0.0:
            raise ValueError("axis has no length")
        moments = np.linalg.eigvalsh(self.matrix)
        if moments[0] < 0.0 or moments[2] > (moments[0] + moments[1]) * (1.0 + _ROUNDING):
            listed = ", ".join(f"{moment:.4g}" for moment in moments)
            raise ValueError(
                f"inertia: principal moments {listed} kg m2 belong to no body; the largest may not "
                "exceed the sum of the others"
            )
        return self


class LiftingBody(Strict):
    """A body with known air loads: lift and drag along its stability axes.

    They depend on angle of attack and sideslip at a point of the body.
    """

    body: str = Field(description="Body with the surface.")
    point: Position = Field(
        default=(0.0, 0.0, 0.0),
        description="Point of the loads and of the flow, in axes of the body.",
    )
    S: Annotated[float, InUnits("m2")] = Field(gt=0.0, description="Reference area.")
    fits: str | None = Field(
        default=None, description="Folder with CL.nc and CD.nc, as flight balance writes it."
    )
    CL: dict[str, float | tuple[float, float]] = Field(
        default_factory=dict, description="Terms and values, or [value, standard error]."
    )
    CD: dict[str, float | tuple[float, float]] = Field(
        default_factory=dict, description="Terms and values, or [value, standard error]."
    )

    @model_validator(mode="after")
    def _check_source(self) -> LiftingBody:
        if bool(self.fits) == bool(self.CL or self.CD):
            raise ValueError("either fits or CL and CD are needed")
        return self


class Area(Strict):
    """Reference area of the coefficients of the vehicle."""

    S: Annotated[float, InUnits("m2")] = Field(gt=0.0, description="Reference area.")


class Cameras(Strict):
    """Motion, axes and unit of the positions of the cameras."""

    flapping_frequency: Annotated[float, InUnits("Hz")] = Field(
        gt=0.0, description="Frequency of the periodic motion."
    )
    multiples: float = Field(
        default=8.0, gt=0.0, description="Cut-off of the motion over the flapping frequency."
    )
    axes: str = Field(
        default="north east down", description="Directions of x, y and z of the cameras."
    )
    unit: str = Field(default="m", description="Unit of the positions, if the file has none.")


class Vehicle(Strict):
    """Bodies, drives of their joints, known air loads and cameras."""

    body: dict[str, RigidBody] = Field(min_length=1)
    gear: dict[str, GearedJoint] = Field(
        default_factory=dict, description="Per joint that follows another joint."
    )
    linkage: dict[str, Linkage] = Field(default_factory=dict)
    spring: dict[str, Spring] = Field(default_factory=dict, description="Per joint.")
    actuator: dict[str, JointActuator] = Field(
        default_factory=dict, description="Per independent joint."
    )
    aerodynamics: dict[str, LiftingBody] = Field(default_factory=dict)
    reference: Area
    cameras: Cameras
    rho: Annotated[float, InUnits("kg m-3")] = Field(
        default=1.225, gt=0.0, description="Density of the air."
    )

    @model_validator(mode="after")
    def _check_tree(self) -> Vehicle:
        bases = [name for name, body in self.body.items() if body.parent is None]
        if len(bases) != 1:
            raise ValueError(
                f"bodies without a parent: {', '.join(bases) or 'none'}; exactly one is needed"
            )
        self._check_names()
        for name in self.body:
            self._check_parents(name)
        if not sum(body.mass for body in self.body.values()) > 0.0:
            raise ValueError("all bodies are without mass")
        driven = self._driven
        twice = sorted({name for name in driven if driven.count(name) > 1})
        if twice:
            raise ValueError(f"{', '.join(twice)}: moved by more than one gear or linkage")
        for name, linkage in self.linkage.items():
            self._check_linkage(name, linkage, driven)
        for name in self.gear:
            self._check_gears(name)
        wrong = [name for name in self.actuator if name in driven]
        if wrong:
            raise ValueError(
                f"actuator: {', '.join(wrong)} follows another joint; allowed: "
                f"{', '.join(self.independent)}"
            )
        return self

    def _check_parents(self, name: str) -> None:
        """Raise ValueError if the parents of a body form a circle."""
        chain = [name]
        parent = self.body[name].parent
        while parent is not None:
            if parent in chain:
                raise ValueError(f"{' on '.join([*chain, parent])}: the parents make a circle")
            chain.append(parent)
            parent = self.body[parent].parent

    def _check_gears(self, name: str) -> None:
        """Raise ValueError if the gears from a joint on form a circle."""
        chain = [name]
        while chain[-1] in self.gear:
            chain.append(self.gear[chain[-1]].follows)
            if chain[-1] in chain[:-1]:
                raise ValueError(f"gear: {' follows '.join(chain)}")

    def _check_names(self) -> None:
        """Raise ValueError with all names that are not a body or a joint."""
        bodies = list(self.body)
        joints = [name for name, body in self.body.items() if body.parent is not None]
        # key of the file, the name there, allowed names
        uses: list[tuple[str, str, list[str]]] = []
        for name, body in self.body.items():
            if body.parent is not None:
                uses.append((f"body.{name}.parent", body.parent, bodies))
        uses += [("gear", name, joints) for name in self.gear]
        for name, gear in self.gear.items():
            uses.append((f"gear.{name}.follows", gear.follows, joints))
        for name, linkage in self.linkage.items():
            uses.append((f"linkage.{name}.crank", linkage.crank, joints))
            uses.append((f"linkage.{name}.coupler", linkage.coupler, joints))
            uses.append((f"linkage.{name}.rocker", linkage.rocker, joints))
        uses += [("spring", name, joints) for name in self.spring]
        uses += [("actuator", name, joints) for name in self.actuator]
        for name, surface in self.aerodynamics.items():
            uses.append((f"aerodynamics.{name}.body", surface.body, bodies))
        problems = []
        for key, name, allowed in uses:
            if name not in allowed:
                problems.append(f"{key}: {name!r} is unknown; allowed: {', '.join(allowed)}")
        if problems:
            raise ValueError("; ".join(problems))

    def _check_linkage(self, name: str, linkage: Linkage, driven: list[str]) -> None:
        """Raise ValueError if a linkage is not a planar four-bar on one body."""
        crank, rocker = self.body[linkage.crank], self.body[linkage.rocker]
        coupler = self.body[linkage.coupler]
        if linkage.crank in driven:
            raise ValueError(
                f"linkage.{name}: its crank {linkage.crank} follows another joint; it must be "
                f"independent"
            )
        if coupler.parent != linkage.crank or rocker.parent != crank.parent:
            raise ValueError(
                f"linkage.{name}: the coupler sits on the crank, crank and rocker sit on one body"
            )
        direction = np.array(crank.axis) / np.linalg.norm(crank.axis)
        for body in (coupler, rocker):
            axis = np.array(body.axis) / np.linalg.norm(body.axis)
            if np.linalg.norm(axis - direction) > _PARALLEL:
                raise ValueError(f"linkage.{name}: crank, coupler and rocker need the same axis")

    @property
    def _driven(self) -> list[str]:
        """Joints that a gear or a linkage moves."""
        driven = list(self.gear)
        for linkage in self.linkage.values():
            driven += [linkage.coupler, linkage.rocker]
        return driven

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Bodies, each after its parent."""
        names: list[str] = []
        while len(names) < len(self.body):
            # one generation of the tree
            generation = []
            for name, body in self.body.items():
                if name not in names and (body.parent is None or body.parent in names):
                    generation.append(name)
            names += generation
        return tuple(names)

    @property
    def base(self) -> str:
        """The body without a parent."""
        return self.names[0]

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints by their bodies, each after the joint of its parent."""
        return self.names[1:]

    @property
    def independent(self) -> tuple[str, ...]:
        """Joints that neither a gear nor a linkage moves."""
        return tuple(name for name in self.joints if name not in self._driven)

    @property
    def markers(self) -> MarkerSetup:
        """Markers of all bodies as the cameras see them."""
        return MarkerSetup(
            body={name: body.markers for name, body in self.body.items() if body.markers},
            **self.cameras.model_dump(),
        )


def read_vehicle(path: str | Path) -> Vehicle:
    """Return the vehicle of a TOML file; folders of fits are relative to the folder of the file.

    Raises
    ------
    ParseError
        The file is not TOML.
    SchemaError
        All faults of the keys; a name that is not a body or joint, joints in a circle, a linkage
        that is not planar.
    """
    path = Path(path)
    vehicle = validate_content(Vehicle, read_toml(path), str(path))
    if not any(body.markers for body in vehicle.body.values()):
        raise SchemaError(str(path), ["no body has markers; give those of [body.NAME.markers]"])
    surfaces = dict(vehicle.aerodynamics)
    for name, surface in vehicle.aerodynamics.items():
        if surface.fits:
            folder = str(path.parent / surface.fits)
            surfaces[name] = surface.model_copy(update={"fits": folder})
    return vehicle.model_copy(update={"aerodynamics": surfaces})


def read_flight(path: str | Path, vehicle: Vehicle) -> tuple[xr.DataArray, xr.Dataset]:
    """Return the positions of the markers, and the commands of the actuators (time,).

    Parameters
    ----------
    path : str or Path
        Recording with the columns of `read_markers`, and one column per command, in SI or with a
        unit.
    vehicle : Vehicle

    Raises
    ------
    UnknownName
        A column of a marker or of a command is missing.
    SchemaError
        The frames are not evenly spaced, or a command does not cover them.
    """
    positions = read_markers(path, vehicle.markers)
    time = positions["time"].values
    recording = open_recording(path, NameMap({}))
    commands: dict[str, np.ndarray] = {}
    for name in sorted({drive.command for drive in vehicle.actuator.values() if drive.command}):
        column = locate_column(recording, name, path)
        # a required column that is missing raises
        assert column is not None
        stamps, values, unit = column[0], column[1], column[2]
        if unit:
            values = np.asarray(to_si(values, unit))
        valid = np.isfinite(values)
        if not valid.any() or stamps[valid][0] > time[0] or stamps[valid][-1] < time[-1]:
            raise SchemaError(
                str(path),
                [
                    f"{name} does not cover the frames, {time_text(time[0])} to "
                    f"{time_text(time[-1])} s"
                ],
            )
        commands[name] = np.interp(time, stamps[valid], values[valid])
    variables = {name: ("time", values) for name, values in commands.items()}
    return positions, xr.Dataset(variables, {"time": time})

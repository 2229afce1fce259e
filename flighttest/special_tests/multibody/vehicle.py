"""A vehicle of several rigid bodies, as a TOML file: a tree of bodies on revolute joints, what
drives them, what the cameras see.

rho = "1.2 kg/m3"

[body.fuselage]                                # no parent: the body whose motion is wanted
mass = "0.337 kg"
cg = ["0.01 m", "0 m", "0.005 m"]              # from its origin, x forward, y right, z down
inertia = ["4e-4 kg m2", "3.5e-3 kg m2", "3.5e-3 kg m2"]   # Ixx Iyy Izz, Ixy Ixz Iyz where not zero; about the c.g.
[body.fuselage.markers]
nose = ["0.20 m", "0 m", "0.01 m"]

[body.wing_right]
parent = "fuselage"
at = ["0.06 m", "0.03 m", "-0.03 m"]           # its origin, on the axis of its joint, in axes of the parent
axis = [1, 0, 0]                               # positive turn right-handed; at angle 0 the axes are those of the parent
mass = "0.0428 kg"

[gear.wing_left]                               # angle = ratio times that of another joint
follows = "wing_right"
ratio = -1

[linkage.stroke]                               # a planar four-bar; the crank is the independent coordinate
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
from flightmech.support.input_files import read_toml
from flightmech.support.toml_models import Strict, validate_content
from flightmech.support.toml_quantities import InUnits
from flightmech.units import parse_quantity, to_si
from flighttest.records.readers.columns import locate_column
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.opening import open_recording
from flighttest.special_tests.motion_capture import MarkerSetup, read_markers

Metres = Annotated[float, InUnits("m")]
Position = tuple[Metres, Metres, Metres]
_PARALLEL = 1e-9


def _inertia(item: Any) -> tuple[float, ...]:
    if not isinstance(item, (list, tuple)) or len(item) not in (3, 6):
        raise ValueError(
            "three moments of inertia Ixx Iyy Izz, or six with Ixy Ixz Iyz, are needed"
        )
    return tuple(parse_quantity(value, "kg m2") for value in item)


class RigidBody(Strict):
    """One rigid body and the joint that holds it to its parent."""

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
    def _possible(self) -> RigidBody:
        if not np.linalg.norm(self.axis) > 0.0:
            raise ValueError("axis has no length")
        moments = np.linalg.eigvalsh(self.matrix)
        if moments[0] < 0.0 or moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-9):
            raise ValueError(
                f"inertia: principal moments {', '.join(f'{m:.4g}' for m in moments)} kg m2 "
                f"belong to no body; the largest may not exceed "
                "the sum of the others"
            )
        return self


class GearedJoint(Strict):
    """A joint that turns with another one."""

    follows: str = Field(description="The other joint, by its body.")
    ratio: float = Field(default=1.0, description="Angle over that of the other.")
    offset: Annotated[float, InUnits("rad")] = Field(
        default=0.0, description="Angle where that of the other is zero."
    )


class Linkage(Strict):
    """A planar four-bar: crank on the base, coupler on the crank, rocker on the base, all with
    parallel axes.
    """

    crank: str = Field(
        description="Body that turns fully; its angle is the independent coordinate."
    )
    coupler: str = Field(description="Body on the crank.")
    rocker: str = Field(description="Body that the coupler moves.")
    pin_on_coupler: Position = Field(
        description="Pin between coupler and rocker, in axes of the coupler."
    )
    pin_on_rocker: Position = Field(description="The same pin, in axes of the rocker.")
    branch: int = Field(default=1, description="Which of both ways to close the loop, 1 or -1.")
    turns: int = Field(
        default=1, description="Sense in which the crank turns about its axis, 1 or -1."
    )

    @model_validator(mode="after")
    def _sign(self) -> Linkage:
        for name in ("branch", "turns"):
            if getattr(self, name) not in (1, -1):
                raise ValueError(f"{name}: 1 and -1 are allowed")
        return self


class Spring(Strict):
    """A spring with a damper on a joint."""

    stiffness: Annotated[float, InUnits("N m rad-1")] = Field(
        default=0.0, ge=0.0, description="Moment over angle."
    )
    rest: Annotated[float, InUnits("rad")] = Field(default=0.0, description="Angle without moment.")
    damping: Annotated[float, InUnits("N m s rad-1")] = Field(
        default=0.0, ge=0.0, description="Moment over rate."
    )


class JointActuator(Strict):
    """An actuator on an independent joint, Ma a + Ca v + Ka p + G tau = B u, tau the moment on the
    joint; SI.
    """

    Ma: float = Field(default=0.0, ge=0.0, description="Inertia.")
    Ca: float = Field(default=0.0, description="Damping.")
    Ka: float = Field(default=0.0, description="Stiffness.")
    G: float = Field(default=1.0, description="Gear ratio.")
    B: float = Field(default=0.0, description="Gain of the command.")
    command: str | None = Field(
        default=None, description="Column of the command; without it the command is zero."
    )

    @model_validator(mode="after")
    def _geared(self) -> JointActuator:
        if self.G == 0.0:
            raise ValueError("the gear ratio G is zero; the moment on the joint would be unknown")
        return self


class LiftingBody(Strict):
    """A body whose air loads are known: lift and drag along its stability axes, by angle of attack
    and sideslip at a point of it.
    """

    body: str = Field(description="Body with the surface.")
    point: Position = Field(
        default=(0.0, 0.0, 0.0),
        description="Where the loads act and the flow is taken, in axes of the body.",
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
    def _one_source(self) -> LiftingBody:
        if bool(self.fits) == bool(self.CL or self.CD):
            raise ValueError("either fits or CL and CD are needed")
        return self


class Area(Strict):
    """Reference of the coefficients of the vehicle."""

    S: Annotated[float, InUnits("m2")] = Field(gt=0.0, description="Reference area.")


class Cameras(Strict):
    """How the cameras see the markers."""

    flapping_frequency: Annotated[float, InUnits("Hz")] = Field(
        gt=0.0, description="Frequency of the periodic motion."
    )
    multiples: float = Field(
        default=8.0, gt=0.0, description="Cut-off of the motion over the flapping frequency."
    )
    axes: str = Field(
        default="north east down", description="Where x, y and z of the cameras point to."
    )
    unit: str = Field(default="m", description="Unit of the positions, where the file states none.")


class Vehicle(Strict):
    """Bodies, what drives their joints, known air loads, cameras."""

    body: dict[str, RigidBody] = Field(min_length=1)
    gear: dict[str, GearedJoint] = Field(
        default_factory=dict, description="Per joint that follows another."
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
    def _a_tree(self) -> Vehicle:
        bases = [name for name, body in self.body.items() if body.parent is None]
        if len(bases) != 1:
            raise ValueError(
                f"bodies without a parent: {', '.join(bases) or 'none'}; exactly one is needed"
            )
        self._demand_known()
        for name in self.body:
            chain = [name]
            while (parent := self.body[chain[-1]].parent) is not None:
                if parent in chain:
                    raise ValueError(f"{' on '.join([*chain, parent])}: the parents make a circle")
                chain.append(parent)
        if not sum(body.mass for body in self.body.values()) > 0.0:
            raise ValueError("all bodies are without mass")
        driven = [
            *self.gear,
            *(name for one in self.linkage.values() for name in (one.coupler, one.rocker)),
        ]
        twice = sorted({name for name in driven if driven.count(name) > 1})
        if twice:
            raise ValueError(f"{', '.join(twice)}: moved by more than one gear or linkage")
        for name, one in self.linkage.items():
            self._demand_planar(name, one, driven)
        for name in self.gear:
            chain = [name]
            while chain[-1] in self.gear:
                chain.append(self.gear[chain[-1]].follows)
                if chain[-1] in chain[:-1]:
                    raise ValueError(f"gear: {' follows '.join(chain)}")
        if wrong := [name for name in self.actuator if name in driven]:
            raise ValueError(
                f"actuator: {', '.join(wrong)} follows another joint; allowed: "
                f"{', '.join(self.independent)}"
            )
        return self

    def _demand_known(self) -> None:
        joints = [name for name, body in self.body.items() if body.parent is not None]
        uses = [
            (f"body.{name}.parent", body.parent, list(self.body))
            for name, body in self.body.items()
            if body.parent is not None
        ]
        uses += [("gear", name, joints) for name in self.gear]
        uses += [(f"gear.{name}.follows", one.follows, joints) for name, one in self.gear.items()]
        uses += [
            (f"linkage.{name}.{part}", getattr(one, part), joints)
            for name, one in self.linkage.items()
            for part in ("crank", "coupler", "rocker")
        ]
        uses += [("spring", name, joints) for name in self.spring] + [
            ("actuator", name, joints) for name in self.actuator
        ]
        uses += [
            (f"aerodynamics.{name}.body", one.body, list(self.body))
            for name, one in self.aerodynamics.items()
        ]
        wrong = [
            f"{place}: {name!r} is unknown; allowed: {', '.join(allowed)}"
            for place, name, allowed in uses
            if name not in allowed
        ]
        if wrong:
            raise ValueError("; ".join(wrong))

    def _demand_planar(self, name: str, one: Linkage, driven: list[str]) -> None:
        crank, coupler, rocker = (self.body[part] for part in (one.crank, one.coupler, one.rocker))
        if one.crank in driven:
            raise ValueError(
                f"linkage.{name}: its crank {one.crank} follows another joint; it must be "
                f"independent"
            )
        if coupler.parent != one.crank or rocker.parent != crank.parent:
            raise ValueError(
                f"linkage.{name}: the coupler sits on the crank, crank and rocker sit on one body"
            )
        axes = [
            np.array(body.axis) / np.linalg.norm(body.axis) for body in (crank, coupler, rocker)
        ]
        if any(np.linalg.norm(axis - axes[0]) > _PARALLEL for axis in axes):
            raise ValueError(f"linkage.{name}: crank, coupler and rocker need the same axis")

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Bodies, each after its parent."""
        found: list[str] = []
        while len(found) < len(self.body):
            found += [
                name
                for name, body in self.body.items()
                if name not in found and (body.parent is None or body.parent in found)
            ]
        return tuple(found)

    @property
    def base(self) -> str:
        """The body without a parent."""
        return self.names[0]

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints by their bodies, each after that of its parent."""
        return self.names[1:]

    @property
    def independent(self) -> tuple[str, ...]:
        """Joints whose angles are coordinates of their own."""
        driven = {
            *self.gear,
            *(name for one in self.linkage.values() for name in (one.coupler, one.rocker)),
        }
        return tuple(name for name in self.joints if name not in driven)

    @property
    def markers(self) -> MarkerSetup:
        """Markers of all bodies as the cameras see them."""
        return MarkerSetup(
            body={name: body.markers for name, body in self.body.items() if body.markers},
            **self.cameras.model_dump(),
        )


def read_vehicle(path: str | Path) -> Vehicle:
    """Return the vehicle of a TOML file; folders of fits are relative to its own.

    Raises
    ------
    ParseError
        The text is not TOML.
    SchemaError
        With all faults of the keys; a name that is not a body or joint, joints in a circle, a linkage
        that is not planar.
    """
    path = Path(path)
    found = validate_content(Vehicle, read_toml(path), str(path))
    if not any(body.markers for body in found.body.values()):
        raise SchemaError(str(path), ["no body has markers; give those of [body.NAME.markers]"])
    moved = {
        name: one.model_copy(update={"fits": str(path.parent / one.fits)}) if one.fits else one
        for name, one in found.aerodynamics.items()
    }
    return found.model_copy(update={"aerodynamics": moved})


def read_flight(path: str | Path, vehicle: Vehicle) -> tuple[xr.DataArray, xr.Dataset]:
    """Return the positions of the markers, and the commands of the actuators (time,).

    Parameters
    ----------
    path : str or Path
        Recording with columns as `read_markers` needs them, and one per command, in SI or with its
        unit.
    vehicle : Vehicle

    Raises
    ------
    UnknownName
        A column of a marker or of a command is missing.
    SchemaError
        Frames that are not evenly spaced, or a command that begins later or ends earlier than they.
    """
    positions = read_markers(path, vehicle.markers)
    time = positions["time"].values
    recording = open_recording(path, NameMap({}))
    commands: dict[str, np.ndarray] = {}
    for name in sorted({drive.command for drive in vehicle.actuator.values() if drive.command}):
        place = locate_column(recording, name, path)
        assert place is not None  # required
        stamps, values = place[0], np.asarray(to_si(place[1], place[2])) if place[2] else place[1]
        good = np.isfinite(values)
        if not good.any() or stamps[good][0] > time[0] or stamps[good][-1] < time[-1]:
            raise SchemaError(
                str(path), [f"{name} does not cover the frames, {time[0]:g} to {time[-1]:g} s"]
            )
        commands[name] = np.interp(time, stamps[good], values[good])
    return positions, xr.Dataset(
        {name: ("time", values) for name, values in commands.items()}, {"time": time}
    )

"""Tables of the joints of a vehicle: gears, linkages, springs and actuators."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from flightmech.support.toml_models import Strict
from flightmech.support.toml_quantities import InUnits

Metres = Annotated[float, InUnits("m")]
Position = tuple[Metres, Metres, Metres]


class GearedJoint(Strict):
    """A joint that turns with another one."""

    follows: str = Field(description="The other joint, by its body.")
    ratio: float = Field(default=1.0, description="Angle over that of the other.")
    offset: Annotated[float, InUnits("rad")] = Field(
        default=0.0, description="Angle where that of the other is zero."
    )


class Linkage(Strict):
    """A planar four-bar: crank and rocker on one body, coupler on the crank, parallel axes."""

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
    def _check_signs(self) -> Linkage:
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
    """An actuator on an independent joint, Ma a + Ca v + Ka p + G tau = B u.

    tau is the moment on the joint; SI.
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
    def _check_gear(self) -> JointActuator:
        if self.G == 0.0:
            raise ValueError("the gear ratio G is zero; the moment on the joint would be unknown")
        return self

"""Controls of an aircraft: their names, their travel, their hinges."""

from __future__ import annotations

from dataclasses import dataclass

CONTROLS = (
    "delta_e",
    "delta_a",
    "delta_r",
    "delta_t",
    "delta_ta",
    "delta_tr",
    "delta_f",
    "delta_s",
    "delta_d",
    "gear",
    "speedbrake",
    "throttle",
)
DEVICE = "device."
"""Beginning of the name of a further control, ``device.body_flap.deflection``: one that only the tables of a database use."""

TRAVEL = {
    "delta_e": ("column", "m-1"),
    "delta_a": ("wheel", "1"),
    "delta_r": ("pedal", "m-1"),
}  # control: what moves it, unit of its gearing


@dataclass(frozen=True)
class Control:
    """What a hinge moment acts on: H = qbar S_hinge c_hinge Ch, positive as the deflection of the surface.

    Parameters
    ----------
    S_hinge : float
        Area behind the hinge line of all surfaces that the control moves together. [m2]
    c_hinge : float
        Mean chord behind the hinge line. [m]
    gearing : float, optional
        Deflection per travel of column, wheel or pedal, in the package's sign convention; negative in an ordinary aeroplane, where a
        column pulled aft raises the elevator.  The pilot holds the surface with F = -gearing H.
        [rad m-1 for elevator and rudder, rad per rad of the wheel for the ailerons]
    """

    S_hinge: float
    c_hinge: float
    gearing: float | None = None

"""The words of the tolerance table in house names: which channel a parameter is judged on, and in which unit."""

from __future__ import annotations

from flightmech.errors import UnitError
from flightmech.names import lookup
from flightmech.units import parse

# Airspeed is calibrated, and like is compared with like (rule R10 of the table).  Tables give magnitudes, so signs need
# no change.  Wheel force is a force in the table and a torque in the house; a lateral deviation needs a runway.
CHANNELS: dict[str, str] = {
    "airspeed": "V_cas",
    "altitude": "h",
    "height": "h_agl",
    "pitch_angle": "theta",
    "pitch_rate": "q",
    "angle_of_attack": "alpha",
    "bank_angle": "phi",
    "roll_rate": "p",
    "yaw_rate": "r",
    "sideslip": "beta",
    "heading": "psi",
    "normal_acceleration": "nz",
    "climb_rate": "hdot",
    "elevator": "delta_e",
    "aileron": "delta_a",
    "rudder": "delta_r",
    "rudder_tab": "delta_tr",
    "n1": "engine1.n1",
    "net_thrust": "engine1.thrust",
    "fuel_flow": "engine1.fuel_flow",
    "column_force": "F_column",
    "pedal_force": "F_pedal",
    "bank_to_sideslip_peak_lag": "phi",
}
MODE_CHANNELS = {"2.c.9": "V_cas", "2.c(9)": "V_cas", "2.d.7": "r", "2.d(7)": "r"}
"""Where a mode is measured unless the case says otherwise: the phugoid in airspeed, the Dutch roll in yaw rate."""

SCALAR_UNITS = {
    "period": "s",
    "t_half": "s",
    "damping_ratio": "1",
    "peak_lag": "s",
    "response_initial": "s",
    "response_total": "s",
}
"""SI unit of the measures that have one of their own; the others have that of their channel."""

WRAPPED = frozenset({"phi", "psi", "lon"})
"""Channels that jump by a full turn."""


def si_unit(measure: str, channel: str) -> str:
    """Return the SI unit in which `measure` on `channel` is computed."""
    return SCALAR_UNITS.get(measure) or lookup(channel).units


def factor(measure: str, channel: str, unit: str) -> float:
    """Return the factor that turns a limit in `unit`, as printed, into SI.

    Raises
    ------
    UnitError
        The unit is unknown or belongs to another quantity.

    Examples
    --------
    >>> factor("trace", "h", "ft")
    0.3048
    >>> factor("trace", "nz", "g")  # load factor counts in g
    1.0
    """
    expected = si_unit(measure, channel)
    if channel == "nz" and unit == "g":
        return 1.0
    dimension, size, _ = parse("1" if unit == "-" else unit)
    if dimension != parse(expected)[0]:
        raise UnitError(f"{channel}: unit {unit!r} cannot be converted to {expected!r}; give a unit of the same quantity")
    return size

"""Channels and units of the parameters of the tolerance table."""

from __future__ import annotations

from collections.abc import Container

from flightmech.errors import UnitError, UnknownName
from flightmech.names import VOCABULARY, lookup, value_text
from flightmech.units import parse_unit
from pom.tolerances.criteria import Criterion

SOURCES: dict[str, tuple[str, ...]] = {
    "time": (),
    "V_ground": ("vn", "ve"),
    "distance": ("vn", "ve"),
    "y_runway": ("vn", "ve"),
    "psi_dot": ("q", "r", "phi", "theta"),
    "F_rim": ("F_wheel",),
    "fuel_used": ("engine1.fuel_flow",),
}
"""By derived quantity: its source signals.

The quantity of a record or a model itself has priority over the derived one.
"""


def source_signals(channel: str) -> tuple[str, ...]:
    """Return the source signals of a channel; a signal is its own source."""
    return SOURCES.get(channel, (channel,))


def output_of(channel: str, offered: Container[str]) -> str:
    """Return the output of a model with the values of a channel.

    ``delta_e`` is an input of a model, and ``applied.delta_e`` is the output with its values.
    """
    applied = f"applied.{channel}"
    if channel not in offered and applied in offered:
        return applied
    return channel


# Airspeed is calibrated, and like is compared with like (rule R10 of the table).  Tables give
# magnitudes, so signs need no change.  A wheel force of the table is a force at the rim.  This
# product uses a torque and the radius of the wheel.
CHANNELS: dict[str, str] = {
    # performance
    "airspeed": "V_cas",
    "altitude": "h",
    "height": "h_agl",
    "climb_rate": "hdot",
    "descent_rate": "hdot",
    "climb_gradient": "gradient",
    "time": "time",
    "distance": "distance",
    "fuel_used": "fuel",
    "turn_radius": "turn_radius",
    "turn_rate": "psi_dot",
    "lateral_deviation": "y_runway",
    "engine_failure_speed": "V_cas",
    # motion
    "pitch_angle": "theta",
    "pitch_rate": "q",
    "angle_of_attack": "alpha",
    "bank_angle": "phi",
    "roll_rate": "p",
    "yaw_rate": "r",
    "sideslip": "beta",
    "heading": "psi",
    "normal_acceleration": "nz",
    "bank_to_sideslip_peak_lag": "phi",
    "recovery": "theta",
    # instants
    "initial_buffet_speed": "V_cas",
    "stall_warning_speed": "V_cas",
    "stall_speed": "V_cas",
    "buffet_onset_angle_of_attack": "alpha",
    "flare_height": "h_agl",
    "flare_time_tf": "time",
    "descent_rate_at_touchdown": "hdot",
    # controls
    "elevator": "delta_e",
    "elevator_change": "delta_e",
    "stabilizer": "i_h",
    "trim_surface": "delta_t",
    "trim_rate": "trim_rate",
    "aileron": "delta_a",
    "spoiler": "delta_sp",
    "rudder": "delta_r",
    "rudder_tab": "delta_tr",
    "rudder_pedal": "pedal",
    "nosewheel_angle": "gear.steering",
    "nosewheel_deadband": "gear.steering",
    "column_force": "F_column",
    "wheel_force": "F_rim",
    "pedal_force": "F_pedal",
    "tiller_force": "F_tiller",
    "brake_force": "F_brake",
    "brake_pressure": "p_brake",
    # power plant: the first engine stands for all; an asymmetric case names another one in its
    # tolerances
    "n1": "engine1.n1",
    "rpm": "engine1.rpm",
    "net_thrust": "engine1.thrust",
    "fuel_flow": "engine1.fuel_flow",
    "epr": "engine1.epr",
    "torque": "engine1.torque",
    "manifold_pressure": "engine1.manifold_pressure",
    "throttle_angle": "engine1.pla",
    "prop_lever": "engine1.prop_lever",
}
OTHERS: dict[str, tuple[str, ...]] = {
    "trim_surface": ("i_h",),
    "trim_rate": ("i_h",),
    "fuel_used": ("fuel_used",),
}
"""By parameter: channels to judge if the record lacks the first choice.

For example an adjustable stabilizer instead of a tab, or fuel flow instead of fuel on board.
"""

MODE_CHANNELS = {"2.c.9": "V_cas", "2.d.7": "r"}
"""By test: the default channel of a mode: airspeed for the phugoid, yaw rate for the Dutch roll."""

SHEAR_CHANNEL = "V_cas"
"""Channel of the trend in the demonstration of windshear (2.g); the rule names none."""

TRAVEL = {
    "2.a.1.a": "column",
    "2.a.1": "column",
    "2.a.2.a": "wheel",
    "2.a.2.b": "wheel",
    "2.a.2": "wheel",
    "2.a.3.a": "pedal",
    "2.a.3.b": "pedal",
    "2.a.4": "tiller",
    "2.a.5": "pedal",
    "2.a.6": "trim_indicator",
    "2.a.9": "brake",
    "2.b.1": "column",
    "2.b.2": "wheel",
    "2.b.3": "pedal",
}
"""By test: the control that a sweep or a release moves.

It is the abscissa of the curves, and it oscillates after the release.
"""

PROGRESS = {"1.c.3": "h", "1.d.1": "V_cas", "1.d.2": "V_cas"}
"""By test: the channel whose change bounds a segment without events."""

FORCES = {
    "column": "F_column",
    "wheel": "F_rim",
    "pedal": "F_pedal",
    "tiller": "F_tiller",
    "brake": "F_brake",
}
"""By control of the cockpit: the force of the pilot."""

SCALAR_UNITS = {
    "period": "s",
    "t_half": "s",
    "damping_ratio": "1",
    "peak_lag": "s",
    "response_initial": "s",
    "response_total": "s",
    "first_zero_crossing": "s",
    "period_n": "s",
    "time_90_to_10": "s",
    "overshoot_count": "1",
    "vibration": "Hz",
}
"""SI unit by measure; other measures have the unit of their channel."""

# Units of the table for pure numbers
_PURE = {"-": "1", "count": "1"}
# Display units without an offset
_LINEAR = {
    row.display_units for row in VOCABULARY.values() if parse_unit(row.display_units)[2] == 0.0
}


def plain_id(test_id: str) -> str:
    """Return the number of a test as the FAA writes it.

    EASA and CAAC write ``2.c(10)`` and ``2.a(1)``.

    Examples
    --------
    >>> plain_id("2.c(10)")
    '2.c.10'
    """
    return test_id.replace("(", ".").replace(")", "")


def si_unit(measure: str, channel: str) -> str:
    """Return the SI unit in which `measure` on `channel` is computed."""
    return SCALAR_UNITS.get(measure) or lookup(channel).units


def limit_to_si_factor(measure: str, channel: str, unit: str) -> float:
    """Return the factor from a printed limit in `unit` to SI.

    Raises
    ------
    UnitError
        The unit is unknown or belongs to another quantity.

    Examples
    --------
    >>> limit_to_si_factor("trace", "h", "ft")
    0.3048
    >>> limit_to_si_factor("trace", "nz", "g")  # load factor counts in g
    1.0
    """
    expected = si_unit(measure, channel)
    if channel == "nz" and unit == "g":
        return 1.0
    dimension, size, _ = parse_unit(_PURE.get(unit, unit))
    if dimension != parse_unit(expected)[0]:
        raise UnitError(
            f"{channel}: unit {unit!r} cannot be converted to {expected!r}; give a unit of "
            f"the same quantity"
        )
    return size


def display_unit(criterion: Criterion) -> str:
    """Return the unit of the printed absolute limit, else the display unit of the quantity."""
    for limit in criterion.band.limits:
        if limit.quantity == "absolute":
            return _PURE.get(limit.unit, limit.unit)
    if not criterion.channel:
        return "1"
    quantity = lookup(criterion.channel)
    unit = si_unit(criterion.measure, criterion.channel)
    # A measure such as a period has another unit than its channel.  A unit with an offset (degC)
    # does not convert differences by a factor.
    if unit == quantity.units and quantity.display_units in _LINEAR:
        return quantity.display_units
    return unit


def channel_value_text(channel: str, value: float) -> str:
    """Return a channel in words, and its value in the display unit."""
    return f"{quantity_words(channel)} {value_text(channel, value)}"


def quantity_words(name: str) -> str:
    """Return a quantity in words: those of the vocabulary, or the name without underscores.

    Examples
    --------
    >>> quantity_words("delta_e"), quantity_words("nz")
    ('elevator deflection', 'load factor at the c.g.')
    """
    try:
        # a definition may follow the words
        return lookup(name).long_name.partition(",")[0]
    except UnknownName:
        return plain_words(name)


_SYMBOLS = {
    "ti": "initial response time (Ti)",
    "tt": "total response time (Tt)",
}
"""Rows whose name in the table is a symbol."""


def plain_words(name: str) -> str:
    """Return the name of a row or a measure in words.

    Examples
    --------
    >>> plain_words("pitch_angle")
    'pitch angle'
    """
    return _SYMBOLS.get(name, name.replace("_", " "))

"""Specification of the instruments: positions, noise and expected constant errors.

The aircraft file has one table per instrument.  The name map of a recorder may replace a table.
The names of the tables are free, channels have canonical names::

    [instruments.imu]
    # from the moment reference point, body axes
    position = [0.90, 0.25, 0.32]
    # standard deviation of the white noise per recorded sample
    noise = { q = "0.03 deg/s", az_imu = 0.04 }
    # standard deviations of the constant error and of the scale error; default: no scale error
    bias_sigma = { q = "0.03 deg/s", az_imu = 0.06 }
    scale_sigma = { az_imu = 0.002 }
    [instruments.vanes]
    # upwash: mean and standard deviation
    factor = { alpha_vane = [1.08, 0.04] }
    # first-order time constant
    lag = [0.05, 0.02]
    [instruments.air_data]
    # of the pitot tube; default: the c.g.
    position = [4.1, 0.0, 0.1]
    # error of the static pressure over impact pressure
    static_error = [0.0, 0.02]
    # latency of the whole instrument
    delay = [0.10, 0.05]
    # the readings are not valid below this airspeed
    minimum_speed = 25.0
    # V, V_cas or mach of a record without impact pressure
    [instruments.airspeed]
    noise = { V = 0.3 }
    factor = { V = [1.0, 0.03] }
    # rigging of the pick-ups; enters the errors of the derivatives
    [instruments.surfaces]
    bias_sigma = { delta_e = "0.1 deg" }
    scale_sigma = { delta_e = 0.01 }
    # enters the errors of the control loading
    [instruments.cockpit]
    bias_sigma = { F_column = "0.3 lbf", column = 5e-4 }
    scale_sigma = { F_column = 0.01 }

A channel is used as a measurement if an instrument gives its noise.  `earth_rate = true` in the
table of the gyros states that they measure the rate of the Earth too, as an inertial reference
does.  The record then needs its latitude.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from pydantic import BeforeValidator, Field, ValidationInfo, WithJsonSchema, field_validator

from flightmech.errors import SchemaError, UnitError, UnknownName
from flightmech.names import lookup
from flightmech.quantities import parse_quantity
from flightmech.support.input_files import json_content
from flightmech.support.toml_models import Strict, fixed_array, validate_content
from flightmech.support.toml_quantities import InUnits, quantity_schema
from flightmech.units import DEGREE

IMU = ("p", "q", "r", "ax_imu", "ay_imu", "az_imu")
# Without a recorded impact pressure an airspeed is a measured channel itself.
SPEEDS = ("V", "V_cas", "mach")
VANES = ("alpha_vane", "beta_vane")
MEASURED = (
    *("phi", "theta", "psi", "vn", "ve", "vd", "h_gps", "q_c"),
    *SPEEDS,
    *("p_static", "temperature"),
    *VANES,
    "h_radio",
)
"""Channels that the reconstruction can use as measurements."""
SURFACES = ("delta_e", "delta_a", "delta_r")
COCKPIT = ("column", "wheel", "pedal", "F_column", "F_wheel", "F_pedal", "delta_t")
# Default accuracy of rigging and calibration of a surface pick-up. [rad], [1]
SURFACE_BIAS = 0.1 * DEGREE
SURFACE_SCALE = 0.01
LONGEST_DELAY, LONGEST_LAG = 5.0, 60.0
"""Latency of a satellite receiver on a bus, and time constant of a temperature probe. [s]"""


def _mean_and_sigma(units: str) -> Any:
    """Return the field type of [mean, sigma] of a quantity."""

    def convert(item: Any) -> tuple[float, float]:
        # Each of the two may have its unit as text.
        if not isinstance(item, list | tuple) or len(item) != 2:
            raise ValueError(f"expected [mean, sigma] in {units}")
        mean, sigma = (parse_quantity(part, units) for part in item)
        if sigma < 0.0:
            raise ValueError("sigma must not be negative")
        return mean, sigma

    return Annotated[
        tuple[float, float],
        BeforeValidator(convert),
        WithJsonSchema(fixed_array([quantity_schema(units)] * 2)),
    ]


def _parse_channels(table: Any) -> dict[str, float]:
    """Return the values of a table by channel. [SI]"""
    if not isinstance(table, dict):
        raise ValueError("expected a table channel = value")
    try:
        values = {name: parse_quantity(item, lookup(name).units) for name, item in table.items()}
    except (UnknownName, UnitError) as error:
        raise ValueError(str(error)) from error
    if any(value <= 0.0 for value in values.values()):
        raise ValueError("standard errors must be positive")
    return values


def demand_possible_time(name: str, seconds: float, most: float) -> None:
    """Raise ValueError for a delay or a lag that no instrument has: mostly milliseconds. [s]"""
    if abs(seconds) <= most:
        return
    text = f"{name} is {seconds:g} s; allowed are at most {most:g} s"
    if abs(seconds) * 1e-3 <= most:
        text += f': a number without a unit is in seconds, write "{seconds:g} ms" if that is meant'
    raise ValueError(text)


# The annotations are made by a function, which a type checker does not evaluate.
if TYPE_CHECKING:
    _Time: TypeAlias = tuple[float, float]
    _Number: TypeAlias = tuple[float, float]
else:
    _Time, _Number = _mean_and_sigma("s"), _mean_and_sigma("1")
_Length = Annotated[float, InUnits("m")]
_Channels = Annotated[
    dict[str, float],
    BeforeValidator(_parse_channels),
    WithJsonSchema({"type": "object", "additionalProperties": quantity_schema("of the channel")}),
]


class Instrument(Strict):
    """One instrument."""

    position: tuple[_Length, _Length, _Length] | None = Field(
        default=None,
        examples=[[0.9, 0.25, 0.32]],
        description="Of the sensor, body axes, from the moment reference point.",
    )
    noise: _Channels = Field(
        default_factory=dict,
        examples=[{"q": "0.03 deg/s", "az_imu": 0.04}],
        description="One sigma of white noise per sample as recorded, by channel; a channel with "
        "it is used as a measurement.",
    )
    bias_sigma: _Channels = Field(
        default_factory=dict,
        examples=[{"q": "0.03 deg/s", "az_imu": 0.06}],
        description="One sigma of the constant error, by channel.",
    )
    scale_sigma: dict[str, Annotated[float, Field(gt=0.0)]] = Field(
        default_factory=dict,
        examples=[{"az_imu": 0.002}],
        description="One sigma of the scale error, by channel; none without it.",
    )
    factor: dict[str, _Number] = Field(
        default_factory=dict,
        examples=[{"alpha_vane": [1.08, 0.04]}],
        description="[mean, sigma] of a factor: upwash of vanes, scale of an airspeed; by channel.",
    )
    lag: _Time | None = Field(
        default=None,
        examples=[[0.05, 0.02]],
        description="[mean, sigma] of the first-order time constant.",
    )
    delay: _Time | None = Field(
        default=None,
        examples=[["100 ms", "50 ms"]],
        description="[mean, sigma] of the latency of the whole instrument.",
    )
    static_error: _Number | None = Field(
        default=None,
        examples=[[0.0, 0.02]],
        description="[mean, sigma] of the static-pressure error over impact pressure.",
    )
    minimum_speed: Annotated[float, InUnits("m s-1")] = Field(
        default=0.0,
        examples=["50 kt"],
        description="Airspeed below which the readings mean nothing.",
    )
    maximum: Annotated[float, InUnits("m")] | None = Field(
        default=None,
        examples=["2500 ft"],
        description="Height above which a radio altimeter shows nothing.",
    )
    earth_rate: bool = Field(
        default=False,
        examples=[True],
        description="Whether the gyros show the rate of the Earth too, as those of an inertial "
        "reference do.",
    )

    @field_validator("scale_sigma")
    @classmethod
    def _check_scales(cls, scale_sigma: dict[str, float]) -> dict[str, float]:
        allowed = (*IMU, *SURFACES, *COCKPIT)
        wrong = sorted(set(scale_sigma) - set(allowed))
        if wrong:
            raise ValueError(
                f"scale errors are known for {', '.join(allowed)} only, not for {', '.join(wrong)}"
            )
        return scale_sigma

    @field_validator("delay", "lag")
    @classmethod
    def _check_times(
        cls, time: tuple[float, float] | None, info: ValidationInfo
    ) -> tuple[float, float] | None:
        most = LONGEST_DELAY if info.field_name == "delay" else LONGEST_LAG
        for part, seconds in zip(("mean", "sigma"), time or (), strict=False):
            demand_possible_time(f"the {part} of {info.field_name}", seconds, most)
        return time

    @field_validator("factor")
    @classmethod
    def _check_factors(cls, factor: dict[str, Any]) -> dict[str, Any]:
        wrong = sorted(set(factor) - {*VANES, *SPEEDS})
        if wrong:
            hint = "; give q_c a static_error" if "q_c" in wrong else ""
            raise ValueError(
                f"factors are estimated for {', '.join((*VANES, *SPEEDS))} only, not for "
                f"{', '.join(wrong)}{hint}"
            )
        return factor


class Instruments(Strict):
    """All instruments of an aircraft."""

    table: dict[str, Instrument]

    def name_of(self, channel: str) -> str | None:
        """Return the name of the instrument that gives the noise of `channel`, or None."""
        return next((name for name, item in self.table.items() if channel in item.noise), None)

    def of(self, channel: str) -> Instrument:
        """Return the instrument that gives the noise of `channel`, else an empty one."""
        name = self.name_of(channel)
        return self.table[name] if name else Instrument()

    def noise(self, channel: str) -> float:
        """Return the standard deviation of the noise of a channel, which an instrument must
        give.
        """
        return self.of(channel).noise[channel]

    def delay_of(self, channel: str) -> str:
        """Return the name of the constant for the latency of `channel`, or ""."""
        if self.of(channel).delay is None:
            return ""
        return f"delay.{self.name_of(channel)}"


def _first_value(tables: Sequence[Mapping[str, float]], name: str, default: float) -> float:
    """Return the value of a channel in the first table that has it."""
    return next((table[name] for table in tables if name in table), default)


def _pick_up_tables(
    content: Mapping[str, Any], what: str
) -> tuple[list[dict[str, float]], list[dict[str, float]]]:
    """Return the tables of bias and of scale of all instruments."""
    instruments = validate_content(Instruments, {"table": _to_tables(content)}, what).table.values()
    biases = [instrument.bias_sigma for instrument in instruments]
    scales = [instrument.scale_sigma for instrument in instruments]
    return biases, scales


def surface_errors(
    content: Mapping[str, Any], what: str = "instruments"
) -> dict[str, tuple[float, float]]:
    """Return standard errors of bias [rad] and scale of the surface pick-ups.

    Surfaces without an entry in the aircraft file have the defaults.

    Raises
    ------
    SchemaError
        With all problems of the tables.
    """
    biases, scales = _pick_up_tables(content, what)
    errors = {}
    for name in SURFACES:
        bias = _first_value(biases, name, SURFACE_BIAS)
        errors[name] = bias, _first_value(scales, name, SURFACE_SCALE)
    return errors


def pick_up_errors(
    content: Mapping[str, Any], what: str = "instruments"
) -> dict[str, tuple[float, float]]:
    """Return standard errors of bias and scale of surfaces, cockpit controls, forces and tab.

    `identify_control_loading` uses them.

    Parameters
    ----------
    content : mapping
        ``Aircraft.instruments``.

    Returns
    -------
    dict of str to (float, float)
        Surfaces without an entry have the defaults of `surface_errors`.  Cockpit channels without
        an entry are not in the result. [unit of the channel, 1]

    Raises
    ------
    SchemaError
        With all problems of the tables.
    """
    biases, scales = _pick_up_tables(content, what)
    errors = surface_errors(content, what)
    # Channels without an expected error are exact.
    for name in COCKPIT:
        bias, scale = _first_value(biases, name, 0.0), _first_value(scales, name, 0.0)
        if bias or scale:
            errors[name] = bias, scale
    return errors


def instruments_of(aircraft: Any, facts: Mapping[Any, Any]) -> Instruments:
    """Return the specification for a record.

    A table of the name map replaces the table of this name in the aircraft file.

    Parameters
    ----------
    aircraft : Aircraft
    facts : mapping
        Attributes of the record; ``instruments`` has the tables of the name map (JSON).

    Raises
    ------
    SchemaError
        As `parse_instruments`.
    """
    tables = stated_in(facts)
    what = f"instruments of {aircraft.name}"
    if tables:
        what += " and the name map"
    return parse_instruments({**aircraft.instruments, **tables}, what)


def stated_in(facts: Mapping[Any, Any]) -> dict[str, Any]:
    """Return the tables of instruments in the name map of a record; empty without tables."""
    return json_content(
        facts.get("instruments", "{}"),
        str(facts.get("source_file", "the record")),
        "a table of instruments",
    )


def _to_tables(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return instruments as tables; each may be an object or a table already."""
    tables = {}
    for name, item in content.items():
        tables[name] = item if isinstance(item, dict) else item.model_dump()
    return tables


def parse_instruments(content: Mapping[str, Any], what: str = "instruments") -> Instruments:
    """Return the specification from the tables of an aircraft file.

    Parameters
    ----------
    content : mapping
        Instrument name to its table, ``Aircraft.instruments``.

    Raises
    ------
    SchemaError
        With all problems.  An inertial unit (noise of p q r ax_imu ay_imu az_imu and its position)
        is required.
    """
    instruments = validate_content(Instruments, {"table": _to_tables(content)}, what)
    # The reconstruction integrates the inertial unit, and estimates its constant errors.
    problems = []
    for name in IMU:
        if not instruments.name_of(name):
            problems.append(
                f"no instrument gives the noise of {name}; the reconstruction integrates it"
            )
    for name in IMU:
        label = instruments.name_of(name)
        if label and name not in instruments.of(name).bias_sigma:
            problems.append(f"{label}: missing bias_sigma of {name}")
    for label, instrument in instruments.table.items():
        problems += [f"{label}: {text}" for text in _instrument_problems(instrument)]
    if problems:
        raise SchemaError(what, problems)
    return instruments


def instrument_of(
    content: Mapping[str, Any], channel: str, what: str = "instruments"
) -> Instrument:
    """Return the instrument of one channel; those that a reconstruction needs may be missing.

    Parameters
    ----------
    content : mapping
        ``Aircraft.instruments``.
    channel : str
        The instrument is the one that gives its noise, else an empty one.
    what : str
        For the text of an error.

    Raises
    ------
    SchemaError
        The table of the instrument has a fault.
    """
    for table in _to_tables(content).values():
        if isinstance(table, Mapping) and channel in (table.get("noise") or ()):
            return validate_content(Instrument, dict(table), what)
    return Instrument()


def _instrument_problems(instrument: Instrument) -> list[str]:
    """Return what is wrong with one instrument, apart from its values."""
    used = (*IMU, *MEASURED, *SURFACES, *COCKPIT)
    problems = []
    for name in instrument.noise:
        if name not in used:
            problems.append(
                f"noise of {name}, which nothing uses; used are {', '.join(used)}; delete it"
            )
    # Accelerometers, vanes and a radio altimeter measure the motion of their position.
    if instrument.position is None and {"ax_imu", *VANES, "h_radio"} & set(instrument.noise):
        problems.append("missing position (m, body axes, from the moment reference point)")
    for name in sorted(instrument.factor.keys() - instrument.noise.keys()):
        problems.append(
            f"factor of {name} without its noise; give noise = {{ {name} = ... }} in the same table"
        )
    if instrument.earth_rate and not {"p", "q", "r"} <= set(instrument.noise):
        problems.append(
            "earth_rate belongs to the instrument that gives the noise of p, q and r; move it there"
        )
    return problems

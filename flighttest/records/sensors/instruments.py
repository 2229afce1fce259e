"""Specification of the instruments: where they sit, how noisy they are, and how large their
constant errors may be.

It stands in the aircraft file, and where a recorder differs in its name map, one table per instrument; the names of the tables are free,
channels carry canonical names::

    [instruments.imu]
    position = [0.90, 0.25, 0.32]                       # from the moment reference point, body axes
    noise = { q = "0.03 deg/s", az_imu = 0.04 }         # one sigma of white noise, per sample as recorded
    bias_sigma = { q = "0.03 deg/s", az_imu = 0.06 }    # one sigma of the constant error
    scale_sigma = { az_imu = 0.002 }                    # one sigma of the scale error; none without it
    [instruments.vanes]
    factor = { alpha_vane = [1.08, 0.04] }              # upwash: mean and one sigma
    lag = [0.05, 0.02]                                  # first-order time constant
    [instruments.air_data]
    position = [4.1, 0.0, 0.1]                          # of the pitot tube; at the c.g. without it
    static_error = [0.0, 0.02]                          # static-pressure error over impact pressure
    delay = [0.10, 0.05]                                # latency of the whole instrument
    minimum_speed = 25.0                                # below it the readings mean nothing
    [instruments.airspeed]                              # where no impact pressure was recorded: V, V_cas or mach
    noise = { V = 0.3 }
    factor = { V = [1.0, 0.03] }                        # scale factor: mean and one sigma
    [instruments.surfaces]
    bias_sigma = { delta_e = "0.1 deg" }                # rigging of the pick-ups; goes into the errors of the derivatives
    scale_sigma = { delta_e = 0.01 }
    [instruments.cockpit]
    bias_sigma = { F_column = "0.3 lbf", column = 5e-4 }  # goes into the errors of the control loading
    scale_sigma = { F_column = 0.01 }

A channel is used as a measurement when an instrument gives its noise.  `earth_rate = true` in the
table of the gyros states that they show the rate of the Earth too, as those of an inertial
reference do; the record then needs its latitude.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from pydantic import BeforeValidator, Field, WithJsonSchema, field_validator

from flightmech.errors import SchemaError, UnitError, UnknownName
from flightmech.names import lookup
from flightmech.support.input_files import json_content
from flightmech.support.toml_models import Strict, fixed_array, validate_content
from flightmech.support.toml_quantities import InUnits, quantity_schema
from flightmech.units import DEGREE, parse_quantity

IMU = ("p", "q", "r", "ax_imu", "ay_imu", "az_imu")
SPEEDS = (
    "V",
    "V_cas",
    "mach",
)  # airspeeds that are measured channels themselves where no impact pressure was recorded
VANES = ("alpha_vane", "beta_vane")
MEASURED = (
    "phi",
    "theta",
    "psi",
    "vn",
    "ve",
    "vd",
    "h_gps",
    "q_c",
    *SPEEDS,
    "p_static",
    "temperature",
    *VANES,
    "h_radio",
)
"""Channels that the reconstruction can use as measurements."""
SURFACES = ("delta_e", "delta_a", "delta_r")
COCKPIT = ("column", "wheel", "pedal", "F_column", "F_wheel", "F_pedal", "delta_t")
SURFACE_BIAS = (
    0.1 * DEGREE
)  # what a pick-up is rigged and calibrated to, unless the instruments specify otherwise [rad]
SURFACE_SCALE = 0.01


def _pair(units: str) -> Any:
    """Return the field type of [mean, sigma] of a quantity."""

    def convert(item: Any) -> tuple[float, float]:
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


def _per_channel(table: Any) -> dict[str, float]:
    if not isinstance(table, dict):
        raise ValueError("expected a table channel = value")
    try:
        values = {name: parse_quantity(item, lookup(name).units) for name, item in table.items()}
    except (UnknownName, UnitError) as error:
        raise ValueError(str(error)) from error
    if any(value <= 0.0 for value in values.values()):
        raise ValueError("standard errors must be positive")
    return values


if TYPE_CHECKING:
    _Time: TypeAlias = tuple[float, float]
    _Number: TypeAlias = tuple[float, float]
else:
    _Time, _Number = _pair("s"), _pair("1")
_Length = Annotated[float, InUnits("m")]
_Channels = Annotated[
    dict[str, float],
    BeforeValidator(_per_channel),
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
    def _scaled_only(cls, scale_sigma: dict[str, float]) -> dict[str, float]:
        wrong = sorted(set(scale_sigma) - {*IMU, *SURFACES, *COCKPIT})
        if wrong:
            raise ValueError(
                f"scale errors are known for {', '.join((*IMU, *SURFACES, *COCKPIT))} only, "
                f"not for {', '.join(wrong)}"
            )
        return scale_sigma

    @field_validator("factor")
    @classmethod
    def _angles_and_speeds_only(cls, factor: dict[str, Any]) -> dict[str, Any]:
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
        """Return the specification behind `channel`; an empty one when no instrument gives its
        noise.
        """
        name = self.name_of(channel)
        return self.table[name] if name else Instrument()

    def noise(self, channel: str) -> float:
        """Return one sigma of the noise of a channel that an instrument knows."""
        return self.of(channel).noise[channel]

    def delay_of(self, channel: str) -> str:
        """Return the name of the constant that holds the latency of `channel`, or ""."""
        return f"delay.{self.name_of(channel)}" if self.of(channel).delay else ""


def surface_errors(
    content: Mapping[str, Any], what: str = "instruments"
) -> dict[str, tuple[float, float]]:
    """Return standard errors of bias [rad] and scale of the surface pick-ups, those of an aircraft
    file or the defaults.

    Raises
    ------
    SchemaError
        With all problems of the tables.
    """
    tables = validate_content(Instruments, {"table": _tables(content)}, what).table.values()
    found = {}
    for name in SURFACES:
        bias = next(
            (item.bias_sigma[name] for item in tables if name in item.bias_sigma), SURFACE_BIAS
        )
        found[name] = (
            bias,
            next(
                (item.scale_sigma[name] for item in tables if name in item.scale_sigma),
                SURFACE_SCALE,
            ),
        )
    return found


def pick_up_errors(
    content: Mapping[str, Any], what: str = "instruments"
) -> dict[str, tuple[float, float]]:
    """Return standard errors of bias and scale of surfaces, cockpit controls, forces and tab, for
    `identify_control_loading`.

    Parameters
    ----------
    content : mapping
        ``Aircraft.instruments``.

    Returns
    -------
    dict of str to (float, float)
        Surfaces that no instrument names have the defaults of `surface_errors`; the cockpit has
        what is given. [unit of the channel, 1]

    Raises
    ------
    SchemaError
        With all problems of the tables.
    """
    tables = validate_content(Instruments, {"table": _tables(content)}, what).table.values()
    found = surface_errors(content, what)
    for name in COCKPIT:
        bias = next((item.bias_sigma[name] for item in tables if name in item.bias_sigma), 0.0)
        scale = next((item.scale_sigma[name] for item in tables if name in item.scale_sigma), 0.0)
        if bias or scale:
            found[name] = bias, scale
    return found


def instruments_of(aircraft: Any, facts: Mapping[Any, Any]) -> Instruments:
    """Return the specification for a record: the tables of the aircraft file, and over them those
    of its name map.

    Parameters
    ----------
    aircraft : Aircraft
    facts : mapping
        Attributes of the record; ``instruments`` holds the tables of the name map (JSON).  A table
        replaces the one of that name.

    Raises
    ------
    SchemaError
        As `instruments`.
    """
    stated = stated_in(facts)
    return parse_instruments(
        {**aircraft.instruments, **stated},
        f"instruments of {aircraft.name}{' and the name map' if stated else ''}",
    )


def stated_in(facts: Mapping[Any, Any]) -> dict[str, Any]:
    """Return the tables of instruments that the name map of a record states; empty for none."""
    return json_content(
        facts.get("instruments", "{}"),
        str(facts.get("source_file", "the record")),
        "a table of instruments",
    )


def _tables(content: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: item if isinstance(item, dict) else item.model_dump()
        for name, item in content.items()
    }


def parse_instruments(content: Mapping[str, Any], what: str = "instruments") -> Instruments:
    """Return the specification from the tables of an aircraft file.

    Parameters
    ----------
    content : mapping
        Instrument name to its table, ``Aircraft.instruments``.

    Raises
    ------
    SchemaError
        With all problems; an inertial unit (noise of p q r ax_imu ay_imu az_imu and its position)
        must be there.
    """
    found = validate_content(Instruments, {"table": _tables(content)}, what)
    problems = [
        f"no instrument gives the noise of {name}; the reconstruction integrates it"
        for name in IMU
        if not found.name_of(name)
    ]
    for name in IMU:
        if found.name_of(name) and name not in found.of(name).bias_sigma:
            problems.append(f"{found.name_of(name)}: missing bias_sigma of {name}")
    used = (*IMU, *MEASURED, *SURFACES, *COCKPIT)
    for name, item in found.table.items():
        problems += [
            f"{name}: noise of {key}, which nothing uses; used are {', '.join(used)}; delete it"
            for key in item.noise
            if key not in used
        ]
        if item.position is None and {"ax_imu", *VANES, "h_radio"} & set(item.noise):
            problems.append(
                f"{name}: missing position (m, body axes, from the moment reference point)"
            )
        alone = sorted(item.factor.keys() - item.noise.keys())
        problems += [
            f"{name}: factor of {key} without its noise; give noise = {{ {key} = ... }} in "
            f"the same table"
            for key in alone
        ]
        if item.earth_rate and not {"p", "q", "r"} <= set(item.noise):
            problems.append(
                f"{name}: earth_rate belongs to the instrument that gives the noise of p, q "
                f"and r; move it there"
            )
    if problems:
        raise SchemaError(what, problems)
    return found

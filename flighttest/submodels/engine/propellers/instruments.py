"""Instruments of an aircraft with propellers: standard errors, and records without the errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from flightmech.units import G0
from flighttest.reconstruction.dynamics.shaft_condition import Condition, air_of

# Common standard errors of the instruments: relative, or in the unit given.
INSTRUMENTS = {
    "V": 0.005,
    "mass": 0.005,
    "rpm": 0.002,
    "torque": 0.01,
    "manifold_pressure": 0.01,
    "fuel_flow": 0.01,
    "temperature": 1.0,  # K
    "climb": 0.005,
    "alpha": 0.002,  # rad
}
# Instruments of an engine, and the part of the variance of their errors that several engines have
# in common: they are of one type, calibrated with one standard (our judgement). The mean of two
# engines keeps 95 % of the error of one.
ENGINE_INSTRUMENTS = ("rpm", "torque", "manifold_pressure", "fuel_flow")
COMMON_TO_ENGINES = 0.8


def instrument_shares(
    columns: Condition, numbers: Sequence[int], accelerometer: bool
) -> dict[str, float]:
    """Return the instruments with common errors, each with its part of the variance.

    A name of `ENGINE_INSTRUMENTS` without a number belongs to the instruments of all engines.

    Parameters
    ----------
    columns : dict of str to array (point,)
        Recorded channels.
    numbers : sequence of int
        Of the engines.
    accelerometer : bool
        Whether the force is that of the accelerometers.
    """
    names = ("V", "mass", "temperature", "alpha" if accelerometer else "climb")
    shares = dict.fromkeys(names, 1.0)
    for channel in ENGINE_INSTRUMENTS:
        recorded = [number for number in numbers if _source(number, channel, columns) in columns]
        if len(recorded) == len(numbers) > 1:
            shares[channel] = COMMON_TO_ENGINES
        own = 1.0 - shares.get(channel, 0.0)
        shares |= {f"engine{number}.{channel}": own for number in recorded}
    return shares


def remove_errors(
    columns: Condition, value: Mapping[str, float], numbers: Sequence[int], accelerometer: bool
) -> Condition:
    """Return channels without the errors of their instruments, and the air.

    Parameters
    ----------
    columns, numbers, accelerometer
        As for `instrument_shares`.
    value : mapping of str to float
        Errors by the names ``error of`` and an instrument: relative, ``temperature`` [K], ``alpha``
        [rad].
    """
    columns = dict(columns)
    for name, error in value.items():
        channel = name.removeprefix("error of ")
        if channel == name or error == 0.0:
            continue
        if channel == "temperature" and channel in columns:
            columns[channel] = columns[channel] + error
        elif channel not in ("temperature", "climb", "alpha"):
            for source in _sources(channel, numbers, columns):
                columns[source] = columns[source] * (1.0 + error)
    columns |= air_of(columns)
    # An error of the angle of attack turns the specific force, one of the climb stretches it.
    error = value.get("error of alpha", 0.0)
    if "alpha" in columns and accelerometer:
        columns["alpha"] = columns["alpha"] + error
    columns["f"] = columns["f"] - columns["lift_force"] * error
    if "hdot" in columns and not accelerometer:
        scale = value.get("error of climb", 0.0)
        columns["f"] = columns["f"] + G0 * columns["hdot"] / columns["V"] * scale
    return columns


def _sources(instrument: str, numbers: Sequence[int], columns: Condition) -> list[str]:
    """Return the columns of an instrument, those of all engines if it has no number."""
    if instrument in ENGINE_INSTRUMENTS:
        return [_source(number, instrument, columns) for number in numbers]
    number, dot, channel = instrument.removeprefix("engine").partition(".")
    return [_source(int(number), channel, columns)] if dot else [instrument]


def _source(number: int, channel: str, columns: Condition) -> str:
    """Return the column of a channel of one engine; its speed may be that of the crankshaft."""
    name = f"engine{number}.{channel}"
    if channel == "rpm" and name not in columns:
        return f"engine{number}.engine_rpm"
    return name

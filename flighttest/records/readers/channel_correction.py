"""Channels of a name map as text, and corrections of their unit, sign, scale and offset."""

from __future__ import annotations

import json
from typing import Any

from flightmech.names import lookup
from flightmech.quantities import parse_quantity
from flightmech.units import G0, known_unit, parse_unit, to_si
from flighttest.records.readers.name_map import Channel

# Units of recorders.  Of each quantity the SI unit of the vocabulary comes first.
UNITS = (
    *("rad", "deg", "1", "%", "rad/s", "deg/s", "rpm"),
    *("m/s2", "g", "ft/s2", "m/s", "kt", "ft/s", "km/h", "ft/min"),
    *("m", "ft", "cm", "in", "Pa", "hPa", "kPa", "psf", "psi", "inHg"),
    *("K", "degC", "degF", "N", "lbf", "kg", "lb", "kg/s", "kg/h", "lb/h", "N m", "lbf ft"),
)
# Dimension of an angle or a fraction.
_NUMBER = parse_unit("1")[0]
# Relative difference below which two factors are the same unit.
_EQUAL = 1e-9


def recorder_units(name: str) -> tuple[str, ...]:
    """Return the units of recorders for a quantity, the SI unit first."""
    dimension = parse_unit(lookup(name).units)[0]
    units = [unit for unit in UNITS if parse_unit(unit)[0] == dimension]
    # Angles and fractions both have no dimension.
    if dimension == _NUMBER:
        return ("rad", "deg") if lookup(name).units == "rad" else ("1", "%")
    # Turns per minute are of shafts, degrees per second of the aeroplane.
    other = "deg/s" if is_shaft_speed(name) else "rpm"
    return tuple(unit for unit in units if unit != other)


def is_shaft_speed(name: str) -> bool:
    """Return whether a quantity is the speed of a propeller or of its engine."""
    return name.rpartition(".")[2] in ("rpm", "engine_rpm")


def entry_of(channel: Channel) -> dict[str, Any]:
    """Return the keys of a channel that differ from their defaults, the column first."""
    return channel.stated()


def line_of(name: str, channel: Channel) -> str:
    """Return the line of a name map that states a channel."""
    entry = entry_of(channel)
    # A canonical name with a dot needs quotes, except the keys of engines, which TOML may split.
    key = name
    if not (name.startswith("engine") or name.isidentifier()):
        key = json.dumps(name)
    if set(entry) == {"column"}:
        return f"{key} = {_toml_value(entry['column'])}"
    items = ", ".join(f"{option} = {_toml_value(item)}" for option, item in entry.items())
    return f"{key} = {{ {items} }}"


def correct_channel(
    channel: Channel, name: str, file_unit: str | None, slope: float, shift: float
) -> Channel:
    """Return a channel with a correction of its converted values.

    A slope that equals the ratio of two units changes the unit, any other slope the scale.

    Parameters
    ----------
    channel : Channel
        Channel of the name map.
    name : str
        Canonical name.
    file_unit : str or None
        Unit that the file states for the column.
    slope, shift : float
        Corrected value = slope * value + shift. [1, SI]
    """
    units = lookup(name).units
    offset = slope * parse_quantity(channel.offset, units) + shift
    sign = channel.sign if slope > 0.0 else -channel.sign
    if isinstance(channel.scale, str):
        scale_with_unit = channel.scale
        if abs(slope) != 1.0:
            scale_with_unit = f"{abs(slope) * parse_quantity(channel.scale, units):.10g} {units}"
        return channel.changed(
            sign=sign, scale=scale_with_unit, offset=_round_offset(offset, units)
        )

    # Value = sign * scale * (factor * column + zero) + offset.  The correction multiplies the zero
    # point of the old unit too; the zero point of the new unit is subtracted again.
    old_unit = known_unit(channel.unit or file_unit or units)
    old_zero = float(to_si(0.0, old_unit, units))
    offset += slope * channel.sign * channel.scale * old_zero
    factor = abs(slope) * parse_unit(old_unit)[1]
    new_unit = _unit_of_factor(
        factor, [old_unit, *recorder_units(name)], channel, sign=sign, offset=offset
    )
    scale = channel.scale
    if new_unit is None:
        new_unit = old_unit
        scale = channel.scale * abs(slope)
    offset -= sign * scale * float(to_si(0.0, new_unit, units))

    stated_unit: str | None = new_unit
    if channel.unit is None and file_unit is not None and known_unit(file_unit) == new_unit:
        stated_unit = None  # the file states it
    return channel.changed(
        unit=stated_unit, sign=sign, scale=scale, offset=_round_offset(offset, units)
    )


def _unit_of_factor(
    factor: float, candidates: list[str], channel: Channel, sign: int, offset: float
) -> str | None:
    """Return the unit with a factor to SI, preferably one that explains the offset too."""
    matching = []
    for unit in candidates:
        if abs(parse_unit(unit)[1] - factor) <= _EQUAL * factor:
            matching.append(unit)
    for unit in matching:
        # The zero point of a temperature scale may be the whole offset.
        remainder = abs(offset - sign * float(channel.scale) * float(to_si(0.0, unit)))
        if remainder < _EQUAL * max(abs(offset), 1.0):
            return unit
    return matching[0] if matching else None


def _round_offset(offset: float, units: str) -> float | str:
    """Return an offset in SI with ten digits, or as a whole number of g."""
    if abs(offset) < _EQUAL:
        return 0.0
    in_g = offset / G0
    if units == "m s-2" and abs(in_g - round(in_g)) < _EQUAL:
        return f"{round(in_g)} g"
    return float(f"{offset:.10g}")


def _toml_value(item: Any) -> str:
    """Return a value as TOML text."""
    if isinstance(item, list | tuple):
        return f"[{', '.join(map(_toml_value, item))}]"
    if isinstance(item, bool):
        return "true" if item else "false"
    if isinstance(item, str):
        return json.dumps(item, ensure_ascii=False)
    if isinstance(item, float):
        return f"{item:.10g}"
    return str(item)

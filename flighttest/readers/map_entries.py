"""Entries of a name map as text, and the entry that corrects what a channel was taken for.

A channel is an affine function of its calibrated column.  A correction is another one on top, ``slope x + shift`` of the converted
channel; what comes out is written with a unit of the quantity where there is one of that size, else with a `scale`.
"""

from __future__ import annotations

import json
from typing import Any

from flightmech.names import lookup
from flightmech.units import G0, known_unit, parse, quantity, to_si

from .name_map import Channel

# units of recorders, the SI unit of the vocabulary before the others of its quantity
UNITS = ("rad", "deg", "1", "%", "rad/s", "deg/s", "m/s2", "g", "ft/s2", "m/s", "kt", "ft/s", "km/h", "ft/min", "m", "ft", "cm", "in") + (
    *("Pa", "hPa", "kPa", "psf", "psi", "K", "degC", "degF", "N", "lbf", "kg", "lb", "kg/s", "kg/h", "lb/h", "N m"),
)
_EQUAL = 1e-9


def units_of(name: str) -> tuple[str, ...]:
    """Return the units of recorders in which a quantity may stand, the SI unit first."""
    dimension = parse(lookup(name).units)[0]
    found = [unit for unit in UNITS if parse(unit)[0] == dimension]
    if dimension == (0, 0, 0, 0):  # angles and fractions
        wanted = ("rad", "deg") if lookup(name).units == "rad" else ("1", "%")
        found = [unit for unit in found if unit in wanted]
    if dimension == (0, 0, -1, 0):
        found = [unit for unit in found if unit in ("rad/s", "deg/s")]
    return tuple(found)


def entry_of(channel: Channel) -> dict[str, Any]:
    """Return the keys of a channel that differ from their defaults, the column first."""
    return channel.stated()


def line_of(name: str, channel: Channel) -> str:
    """Return the line of a name map that states a channel."""
    entry = entry_of(channel)
    key = name if name.startswith("engine") or name.isidentifier() else json.dumps(name)
    if set(entry) == {"column"}:
        return f"{key} = {_toml(entry['column'])}"
    return f"{key} = {{ {', '.join(f'{word} = {_toml(item)}' for word, item in entry.items())} }}"


def corrected(channel: Channel, name: str, file_unit: str | None, slope: float, shift: float) -> Channel:
    """Return a channel with a correction of its converted values.

    Parameters
    ----------
    channel : Channel
        As it stands in the name map.
    name : str
        Canonical name.
    file_unit : str or None
        Unit that the file states for the column.
    slope, shift : float
        Corrected value = slope * value + shift. [1, SI]
    """
    units = lookup(name).units
    offset = slope * quantity(channel.offset, units) + shift
    sign = channel.sign if slope > 0.0 else -channel.sign
    if isinstance(channel.scale, str):
        per_one = channel.scale if abs(slope) == 1.0 else f"{abs(slope) * quantity(channel.scale, units):.10g} {units}"
        return channel.changed(sign=sign, scale=per_one, offset=_offset(offset, units))
    unit = known_unit(channel.unit or file_unit or units)
    old_zero = float(to_si(0.0, unit, units))
    offset += slope * channel.sign * channel.scale * old_zero
    wanted = abs(slope) * parse(unit)[1]
    candidates = [unit, *units_of(name)]
    new = next((one for one in candidates if abs(parse(one)[1] - wanted) <= _EQUAL * wanted and _fits(one, sign, channel, offset)), None)
    new = new or next((one for one in candidates if abs(parse(one)[1] - wanted) <= _EQUAL * wanted), None)
    scale = channel.scale if new else channel.scale * abs(slope)
    new = new or unit
    offset -= sign * scale * float(to_si(0.0, new, units))
    own = None if channel.unit is None and file_unit is not None and known_unit(file_unit) == new else new
    return channel.changed(unit=own, sign=sign, scale=scale, offset=_offset(offset, units))


def _fits(unit: str, sign: int, channel: Channel, offset: float) -> bool:
    """Return whether a unit explains the offset too, as that of a temperature scale does."""
    return abs(offset - sign * float(channel.scale) * float(to_si(0.0, unit))) < _EQUAL * max(abs(offset), 1.0)


def _offset(offset: float, units: str) -> float | str:
    """Return an offset in SI, one of whole g as such."""
    if abs(offset) < _EQUAL:
        return 0.0
    in_g = offset / G0
    return f"{round(in_g)} g" if units == "m s-2" and abs(in_g - round(in_g)) < _EQUAL else float(f"{offset:.10g}")


def _toml(item: Any) -> str:
    if isinstance(item, list | tuple):
        return f"[{', '.join(map(_toml, item))}]"
    if isinstance(item, bool):
        return "true" if item else "false"
    return json.dumps(item, ensure_ascii=False) if isinstance(item, str) else f"{item:.10g}" if isinstance(item, float) else str(item)

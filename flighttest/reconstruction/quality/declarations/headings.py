"""Units, scales and columns of the name map against the headings of the file.

A contradiction is a warning, because a heading may be wrong.  It is a note if kinematics show that
the name map is right.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np
import xarray as xr

from flightmech.errors import UnitError
from flightmech.names import lookup
from flightmech.units import known_unit, parse_unit, to_si
from flighttest.reconstruction.quality.checks.mistake_search import (
    GAIN,
    Repair,
    total_disagreement,
)
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.finding import Finding, map_entry, map_entry_of
from flighttest.records.readers.channel_correction import line_of
from flighttest.records.readers.name_map import Channel

_UNSTATED = ("", "1", "-", "none", "n/a")  # entries of files without a unit
# headings use the names of masses for forces, and the other way round
_POUNDS = {"lbf": "lb", "kgf": "kg"}
# relative difference of a scale from the factor of a unit within which it is that factor
_CONVERTED = 1e-3

# words of a heading that belong to a channel, and words that belong to another one
CHANNEL_WORDS: dict[str, tuple[str, str]] = {
    "h_baro": ("baro press palt", "gps gnss sat geo wgs radio radar agl"),
    "h_gps": ("gps gnss sat geo wgs", "baro press palt"),
    "V_cas": ("cas kcas ias kias calib indic", "tas ktas true gs ground eas"),
    "V": ("tas ktas true", "cas kcas ias kias eas calib indic gs ground"),
    "alpha_vane": ("aoa alpha attack", "aos beta slip"),
    "beta_vane": ("aos beta slip", "aoa alpha attack"),
    "phi": ("roll bank phi", "pitch theta yaw heading psi"),
    "theta": ("pitch theta", "roll bank phi yaw heading psi"),
    "psi": ("heading hdg psi yaw", "track trk course cog roll bank phi pitch theta"),
    "p": ("roll p", "pitch yaw"),
    "q": ("pitch q", "roll yaw"),
    "r": ("yaw r", "roll pitch"),
    "ax_imu": ("long nx ax x", "lateral norm vert ny nz ay az"),
    "ay_imu": ("lat ny ay y", "long norm vert nx nz ax az"),
    "az_imu": ("norm vert nz az z", "long lateral nx ny ax ay"),
    "vn": ("north", "east"),
    "ve": ("east", "north"),
    "delta_e": ("elev stab", "ail rud"),
    "delta_a": ("ail", "elev rud"),
    "delta_r": ("rud", "elev ail"),
}
_SHORT, _LONG = 3, 4  # letters of a beginning of a word, and of a word: "aileron", "elevator"
_TOKEN = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


def heading_findings(
    record: xr.DataTree, signals: ResampledChannels, mistaken: Collection[str] = ()
) -> list[Finding]:
    """Return the units, scales and columns of the name map that contradict the headings.

    Parameters
    ----------
    record : DataTree
    signals : ResampledChannels
        Without mistakes.
    mistaken : collection of str
        Channels in which a mistake was corrected. Their motion shows nothing about the name map.
    """
    reliable = signals.without(mistaken)
    groups = {attrs["column"].partition("/")[0] for _, attrs in mapped_channels(record)}
    findings = []
    for name, attrs in mapped_channels(record):
        _, channel, file_unit = map_entry_of(record, name)
        if channel is None:
            continue
        findings += _unit_finding(record, reliable, name, channel=channel, unit=file_unit or "")
        findings += _scale_finding(record, reliable, name, channel=channel, unit=file_unit or "")
        # the name of a group belongs to a heading only if there are several groups
        heading = attrs["column"].rpartition("/")[2]
        if len(groups) > 1:
            heading = attrs["column"].replace("/", " ")
        findings += _name_finding(name, heading)
    return findings


def with_headings(findings: list[Finding]) -> list[Finding]:
    """Return findings with the heading added to a mistake of unit, in place of its own finding."""
    stated = {finding.channels[0]: finding for finding in findings if finding.kind == "stated_unit"}
    proven = {finding.channels[0] for finding in findings if _is_proven_unit(finding)}
    merged = []
    for finding in findings:
        name = finding.channels[0]
        if _is_proven_unit(finding) and name in stated:
            finding = replace(finding, text=f"{finding.text}; {stated[name].text}")
        if finding.kind != "stated_unit" or name not in proven:
            merged.append(finding)
    return merged


def _is_proven_unit(finding: Finding) -> bool:
    return finding.kind in ("unit", "weight") and finding.severity == "error"


def mapped_channels(record: xr.DataTree) -> Iterator[tuple[str, dict]]:
    """Yield the channels that a single column gives, with their attributes."""
    for node in record.children.values():
        for name, x in node.data_vars.items():
            if x.attrs.get("map_entry") and x.attrs.get("column"):
                yield str(name), x.attrs


def matching_words(column: str, name: str) -> str:
    """Return whose words a heading has: the channel (``own``), another one (``other``), or none."""
    own_words, other_words = CHANNEL_WORDS[name]
    tokens = [token.lower() for token in _TOKEN.findall(column)]
    if any(_has_word(tokens, word) for word in own_words.split()):
        return "own"
    if any(_has_word(tokens, word) for word in other_words.split()):
        return "other"
    return ""


def _has_word(tokens: list[str], word: str) -> bool:
    """Return whether a word, or a longer word with its beginning, is among the tokens."""
    if word in tokens:
        return True
    if len(word) < _SHORT:
        return False
    return any(token.startswith(word) and len(token) >= _LONG for token in tokens)


def _unit_finding(
    record: xr.DataTree, signals: ResampledChannels, name: str, *, channel: Channel, unit: str
) -> list[Finding]:
    """Return the finding on a unit that contradicts the unit of the file."""
    calibrated = channel.polynomial is not None or channel.table is not None
    if channel.unit is None or calibrated or isinstance(channel.scale, str):
        return []
    if unit.strip().lower() in _UNSTATED:
        return []
    map_unit, heading = _comparable_units(channel.unit, unit)
    dimension, factor = _parse_or_none(map_unit)
    heading_dimension, heading_factor = _parse_or_none(heading)
    if heading_dimension is None or dimension is None:
        return []
    text = (
        f"the name map takes {name} in {channel.unit}, and the file states {unit} for "
        f"{channel.columns[0]!r}"
    )
    if heading_dimension != dimension:
        # a symbol in brackets, such as "Height (h)"
        if len(heading) == 1 or heading == "psi":
            return []
        text = f"{text}, which is a unit of another quantity"
        remedy = "check the column, or correct the unit in the name map"
        return [Finding("warning", "stated_unit", (name,), text, remedy=remedy)]
    zero, heading_zero = float(to_si(0.0, map_unit)), float(to_si(0.0, heading))
    if np.isclose(factor, heading_factor, rtol=1e-6) and np.isclose(zero, heading_zero):
        return []
    # value in the unit of the file from the value in the unit of the name map
    slope = heading_factor / factor
    shift = (heading_zero - slope * zero) * channel.sign * float(channel.scale)
    remedy = f"if the file is right: {map_entry(record, name, slope, shift)}"
    repair = Repair("unit", (name,), text, slope=slope, shift=shift)
    return [_weigh_contradiction(signals, repair, remedy)]


def _scale_finding(
    record: xr.DataTree, signals: ResampledChannels, name: str, *, channel: Channel, unit: str
) -> list[Finding]:
    """Return the finding on a scale that repeats the factor of the unit."""
    unit = channel.unit or unit
    if isinstance(channel.scale, str) or channel.scale == 1.0 or not unit:
        return []
    dimension, factor = _parse_or_none(known_unit(unit))
    if dimension is None or abs(factor - 1.0) < _CONVERTED:
        return []
    if min(abs(channel.scale / factor - 1.0), abs(channel.scale * factor - 1.0)) > _CONVERTED:
        return []
    text = (
        f"the scale {channel.scale:g} of {name} is the factor of its unit {unit}, by which "
        f"the column is converted as well"
    )
    leaf, _, _ = map_entry_of(record, name)
    remedy = (
        f"if that is once too often: {line_of(name, channel.changed(scale=1.0))}   # in "
        f"[{leaf}] of the name map"
    )
    repair = Repair("unit", (name,), text, slope=1.0 / channel.scale)
    return [_weigh_contradiction(signals, repair, remedy)]


def _weigh_contradiction(signals: ResampledChannels, repair: Repair, remedy: str) -> Finding:
    """Return a warning, or a note if the motion shows that the name map is right."""
    severity, text = "warning", repair.mistake
    if repair.channels[0] in signals:
        growth = total_disagreement(repair.apply(signals)) - total_disagreement(signals)
        if growth > GAIN:
            severity, text = "note", f"{text}; kinematics agree with the name map"
    return Finding(severity, "stated_unit", repair.channels, text, remedy=remedy)


def _comparable_units(map_unit: str, heading: str) -> tuple[str, str]:
    """Return two units as the product spells them, a mass and a force of one name as the same."""
    units = known_unit(map_unit), known_unit(heading)
    if _parse_or_none(units[0])[0] == _parse_or_none(units[1])[0]:
        return units
    first, second = _POUNDS.get(units[0], units[0]), _POUNDS.get(units[1], units[1])
    # a force in the one and a mass in the other: the pound is the force
    if {first, second} in ({"N", "lb"}, {"N", "kg"}):
        first, second = first.replace("lb", "lbf"), second.replace("lb", "lbf")
    return first, second


def _parse_or_none(unit: str) -> tuple[tuple | None, float]:
    try:
        return parse_unit(unit)[:2]
    except UnitError:
        return None, 1.0


def _name_finding(name: str, column: str) -> list[Finding]:
    """Return the finding on a heading of another quantity, such as ``GPS Alt`` for `h_baro`."""
    if name not in CHANNEL_WORDS or matching_words(column, name) != "other":
        return []
    text = (
        f"{name} ({lookup(name).long_name}) is read from the column {column!r}, which is "
        f"called after another quantity"
    )
    remedy = f"check the column of {name} in the name map"
    return [Finding("warning", "column_name", (name,), text, remedy=remedy)]

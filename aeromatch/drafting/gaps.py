"""Remarks about gaps of recordings: absent channels, and columns without a quantity."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import tomlkit
import xarray as xr

from aeromatch.drafting.name_map.name_rows import REQUIRED
from flightmech.errors import UnitError
from flightmech.quantities import parse_quantity
from flightmech.support.toml_quantities import CONFIRM, UNFILLED

# Alternative channels, their common name, and the consequence if all of them are absent.
_NEEDED = (
    (("delta_e",), "elevator", "no pitch manoeuvre can be found"),
    (("delta_a", "delta_a_left", "delta_a_right"), "aileron", "no roll manoeuvre can be found"),
    (("delta_r",), "rudder", "no yaw manoeuvre can be found"),
    (("V", "V_cas", "mach", "q_c"), "airspeed", "no coefficient can be formed"),
    (
        ("h_baro", "p_static", "h_gps"),
        "altitude or static pressure",
        "no air density can be formed",
    ),
    (
        ("alpha_vane",),
        "angle of attack",
        "it follows from the reconstruction alone, with a larger standard error",
    ),
)
# At most two digits: a number is also the length of lists of engines.
_ENGINE = re.compile(r"engine([1-9]\d?)\.")
# Largest ratio of the stated mass and a recorded one that a flight explains.
_SAME_MASS = 1.5
# Share of the largest number of channels below which a record is of another recorder.
_FEW = 0.5
# Columns that a remark names. The file names.toml lists all columns.
_MOST = 20


@dataclass(frozen=True)
class AircraftGap:
    """A value of the aircraft file that its author has to give or to confirm.

    Attributes
    ----------
    place : tuple of str or int
        Keys and positions that lead to the value; empty for a gap that no single value fills.
    text : str
    """

    place: tuple[str | int, ...]
    text: str


def open_gaps(gaps: Sequence[AircraftGap], drafted: str, own: str) -> list[str]:
    """Return the texts of the gaps that the author's aircraft file leaves open.

    A gap is filled by another value, or by the removal of the word CONFIRM behind a correct one.

    Parameters
    ----------
    gaps : sequence of AircraftGap
    drafted, own : str
        New draft, and the file with the edits of its author.
    """
    before, present = tomlkit.parse(drafted), tomlkit.parse(own)
    texts = []
    for gap in gaps:
        item = _item_at(present, gap.place)
        if item is None:
            continue
        is_drafted = item == _item_at(before, gap.place)
        comment = "" if item is present else item.trivia.comment
        if item is present or item == UNFILLED or (is_drafted and CONFIRM in comment):
            texts.append(gap.text)
    return texts


def _item_at(table: Any, place: Sequence[str | int]) -> Any:
    """Return a value of a file; None if the file does not have it."""
    for key in place:
        try:
            table = table[key]
        except (KeyError, IndexError, TypeError):
            return None
    return table


def compare_mass(own: str, records: Mapping[str, xr.DataTree]) -> list[str]:
    """Return a remark if the mass of an aircraft file is far from the recorded ones.

    A mass in pounds without its unit is taken in kilograms, and everything else looks right.
    """
    stated = tomlkit.parse(own).unwrap().get("mass", UNFILLED)
    recorded: list[float] = []
    for record in records.values():
        for node in record.children.values():
            if "mass" in node.data_vars:
                recorded.append(float(node["mass"].median()))
    if stated == UNFILLED or not recorded:
        return []
    try:
        mass = parse_quantity(stated, "kg")
    except UnitError:
        # The check of the project names the fault.
        return []
    least, largest = min(recorded), max(recorded)
    if least / _SAME_MASS <= mass <= largest * _SAME_MASS:
        return []
    return [
        f"mass of aircraft.toml is {mass:.5g} kg, the records have {least:.5g} ... {largest:.5g} "
        "kg: check both and their units; a number without a unit is in kg"
    ]


def channel_names(records: Iterable[xr.DataTree]) -> set[str]:
    """Return the names of the channels of all records."""
    names: set[str] = set()
    for record in records:
        for node in record.children.values():
            names.update(str(name) for name in node.data_vars)
    return names


def engine_numbers(names: Iterable[str]) -> set[int]:
    """Return the numbers of the engines in the names of channels, such as ``engine1.n1``."""
    return {int(match[1]) for match in map(_ENGINE.match, names) if match}


def missing_channels(flights: Mapping[str, xr.DataTree]) -> list[str]:
    """Return a remark for each channel that no record has, with the consequence."""
    if not flights:
        return []
    channels = channel_names(flights.values())
    remarks = []
    for names, word, consequence in _NEEDED:
        if channels.isdisjoint(names):
            remarks.append(f"no {word} ({names[0]}) is recorded or recognised: {consequence}")
    return remarks


def unable_to_identify(flights: Mapping[str, xr.DataTree]) -> dict[str, list[str]]:
    """Return the channels that the reconstruction needs and a record does not have, by record."""
    absent: dict[str, list[str]] = {}
    for record, tree in flights.items():
        channels = channel_names([tree])
        missing = [name for name in REQUIRED if name not in channels]
        if missing:
            absent[record] = missing
    return absent


def describe_unable(unable: Mapping[str, Sequence[str]]) -> list[str]:
    """Return a remark for each set of absent channels, with the records that lack them."""
    records: dict[tuple[str, ...], list[str]] = {}
    for record, absent in unable.items():
        records.setdefault(tuple(absent), []).append(record)
    remarks = []
    for missing, names in records.items():
        verb = "neither identify nor prove" if len(names) > 1 else "neither identifies nor proves"
        remarks.append(
            f"{', '.join(names)}: {verb}, because the reconstruction needs {', '.join(missing)}"
        )
    return remarks


def listed_columns(record: xr.DataTree) -> list[str]:
    """Return the columns of a recording that its name map leaves out."""
    return [name for name in str(record.attrs.get("unmapped", "")).split(", ") if name]


def describe_other_recorders(records: Mapping[str, xr.DataTree]) -> list[str]:
    """Return a remark for each record that has few of the channels that another one has.

    One name map is drafted for one recorder; the columns of a second one are hardly in it.
    """
    counts = {name: len(channel_names([record])) for name, record in records.items()}
    most = max(counts.values(), default=0)
    remarks = []
    for name, count in counts.items():
        if count < _FEW * most:
            remarks.append(
                f"{name} has {count} channels and another record {most}: is it of another "
                f"recorder? Draft a project for it alone, or add its columns to names.toml; "
                f"'aeromatch flight info' lists them"
            )
    return remarks


def unknown_columns(columns: Sequence[str], has_map: bool) -> list[str]:
    """Return a remark that names the columns without a quantity, with the remedy."""
    if not columns:
        return []
    names = ", ".join(columns[:_MOST])
    if len(columns) > _MOST:
        names += f" and {len(columns) - _MOST} more"
    remedy = "add them to names.toml and run init again"
    if has_map:
        remedy = "add them to the name map and run init again"
    return [f"columns without a quantity: {names}; where one is a channel, {remedy}"]

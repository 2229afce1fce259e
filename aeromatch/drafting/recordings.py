"""Recordings of a draft with their name map, stated facts and manoeuvres."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import pandas as pd
import xarray as xr

import flighttest
from aeromatch.drafting.aircraft import StatedFacts
from aeromatch.drafting.flown import describe_unknown, without_unknown
from aeromatch.drafting.gaps import (
    channel_names,
    describe_other_recorders,
    listed_columns,
    missing_channels,
    unknown_columns,
)
from aeromatch.drafting.name_map.author_map import AuthorMap
from aeromatch.drafting.name_map.candidates import candidates_of
from aeromatch.drafting.name_map.column_table import ColumnRow, describe_columns
from aeromatch.drafting.name_map.name_repair import check_draft
from aeromatch.drafting.name_map.names import NamesDraft, draft_names, read_own_names
from aeromatch.drafting.sources import Sources
from flightmech.air import atmosphere
from flightmech.errors import SchemaError
from flightmech.quantities import number_or_text, parse_quantity
from flighttest.flight_programme.manoeuvre_finding.finding import find_manoeuvres, named_by_response

# Facts of a name map that the author may state, with their units.
FACTS = {"temperature": "K", "latitude": "rad", "runway_elevation": "m"}


@dataclass
class RecordedFlights:
    """Recordings as read with their name map, and their manoeuvres.

    Attributes
    ----------
    names : NamesDraft
    records : dict of str to DataTree
        By file name without extension.
    marks : dict of str to DataFrame
        Manoeuvres by record. [s]
    marked : set of str
        Records that mark their manoeuvres themselves.
    columns : list of ColumnRow
        What every column of the recordings is taken for.
    """

    names: NamesDraft
    records: dict[str, xr.DataTree] = field(default_factory=dict)
    marks: dict[str, pd.DataFrame] = field(default_factory=dict)
    marked: set[str] = field(default_factory=set)
    columns: list[ColumnRow] = field(default_factory=list)

    @property
    def has_table(self) -> bool:
        """Whether the manoeuvres of some record require a table."""
        return len(self.marked) < len(self.marks)

    @property
    def has_drafted_map(self) -> bool:
        """Whether the project requires a name map that is not the author's."""
        return not self.names.identity and self.names.own is None


def read_flights(
    sources: Sources,
    flap: float | None,
    known: StatedFacts,
    own_map: str | Path | None,
    remarks: list[str],
    author: AuthorMap | None = None,
) -> RecordedFlights:
    """Return the recordings with the author's or a drafted name map.

    Parameters
    ----------
    sources : Sources
    flap : float or None
        Largest flap deflection of the listings. [rad]
    known : StatedFacts
    own_map : path or None
        Name map of the author outside of the project, which is used unchanged.
    remarks : list of str
        Receives what the author has to confirm.
    author : AuthorMap, optional
        Lines of the author in the name map of the project.
    """
    if own_map is not None:
        draft = read_own_names(own_map)
    else:
        draft = draft_names(sources.records, flap, author)
    names, records, findings = check_draft(_add_facts(draft, known), sources.records)
    names, records = _add_temperature(names, records, sources.records, remarks)
    remarks += [*names.remarks, *missing_channels(records)]
    remarks += [finding.line for finding in findings]
    if names.own is None:
        left_out = [item.column for item in names.left_out]
        candidates = candidates_of(names.all_rows(), sources.records, left_out)
        remarks += [candidate.text() for candidate in candidates]
        remarks += unknown_columns(left_out, has_map=False)
        remarks += describe_other_recorders(records)
    else:
        unmapped: dict[str, None] = {}
        for record in records.values():
            unmapped |= dict.fromkeys(listed_columns(record))
        left_out = list(unmapped)
        remarks += unknown_columns(left_out, has_map=True)
    return RecordedFlights(names, records, columns=describe_columns(names, findings, left_out))


def has_engine_speed(record: xr.DataTree) -> bool:
    """Return whether a record has the speed of a spool of an engine."""
    return any(name.endswith((".n1", ".n2")) for name in channel_names([record]))


def _add_facts(names: NamesDraft, known: StatedFacts) -> NamesDraft:
    """Return a map with the facts that the author states."""
    facts: dict[str, float] = {}
    for key, unit in FACTS.items():
        if known.values.get(key):
            facts[key] = parse_quantity(number_or_text(known.values[key]), unit)
    if names.own is not None and facts:
        problems = []
        for key in facts:
            problems.append(
                f"{key} stands in [record] of the name map {names.file}; write it there"
            )
        raise SchemaError("init", problems)
    return replace(names, facts={**names.facts, **facts})


def _add_temperature(
    names: NamesDraft,
    records: dict[str, xr.DataTree],
    files: Sequence[Path],
    remarks: list[str],
) -> tuple[NamesDraft, dict[str, xr.DataTree]]:
    """Return map and records with the temperature of the standard atmosphere.

    They are unchanged if a temperature is recorded or stated, and if no height is recorded.
    """
    channels = channel_names(records.values())
    if names.identity or "temperature" in channels or "temperature" in names.facts:
        return names, records
    height = _median_height(records.values())
    if height is None:
        return names, records
    kelvin = round(float(atmosphere(height).temperature), 1)
    if names.own is not None:
        remarks.append(
            f'no temperature is recorded: add temperature = "{kelvin:g} K" to [record] of '
            f"{names.file}, as in the standard atmosphere"
        )
        return names, records
    remarks.append(
        f"no temperature is recorded: that of the standard atmosphere at {height:.0f} m, "
        f"{kelvin:g} K, stands in names.toml; "
        "confirm it, 3 K change the air density by 1 %"
    )
    names = replace(names, facts={**names.facts, "temperature": kelvin})
    return names, {file.stem: flighttest.read(file, names.mapping()) for file in files}


def _median_height(records: Iterable[xr.DataTree]) -> float | None:
    """Return the median of the recorded heights, or None without a height. [m]"""
    heights: list[float] = []
    for record in records:
        for node in record.children.values():
            for name in ("h_baro", "h_gps"):
                if name in node.data_vars:
                    heights.append(float(node[name].median()))
    if not heights:
        return None
    # The upper median, which is a recorded height.
    return sorted(heights)[len(heights) // 2]


def add_manoeuvres(
    flights: RecordedFlights, own_tables: Mapping[str, pd.DataFrame], remarks: list[str]
) -> None:
    """Add the manoeuvres of every record, as marked or as found in the movements.

    `own_tables` has the records whose manoeuvres the author has edited in the table of the project.
    """
    for name, record in flights.records.items():
        table = flighttest.records.marked_manoeuvres(record)
        # The marks of the author come before a search.
        if len(table):
            flights.marked.add(name)
            table = named_by_response(record, table)
        elif name in own_tables:
            table = own_tables[name]
        else:
            try:
                found = find_manoeuvres(record)
                table = without_unknown(found)
                remarks += describe_unknown(name, found)
            except SchemaError as error:
                remarks.append(f"{name}: no manoeuvre was looked for: {'; '.join(error.problems)}")
        flights.marks[name] = table

"""Flight records in plain arrays: channels in canonical names and SI, with flags of their faults.

`flighttest.records.record` converts them to trees of xarray.  Plain arrays need neither xarray nor
pandas, whose import takes longer than the reading of a short record.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flightmech.errors import SchemaError, UnknownName
from flightmech.names import VOCABULARY, is_quantity, quantity_attributes
from flighttest.records.channel_groups import ChannelSamples, RecordGroup, make_groups
from flighttest.records.column_places import ColumnPlace, damaged_column, locate_columns
from flighttest.records.readers.clocks import Clocks
from flighttest.records.readers.name_map import Channel, NameMap
from flighttest.records.readers.name_map_reading import read_names, shipped_maps
from flighttest.records.readers.opening import format_name, open_recording
from flighttest.records.readers.recording import Recording, clock_name, flight_mode_rows
from flighttest.records.readers.utc_time import utc_facts


class Arrays(NamedTuple):
    """A flight record: attributes of the root, and groups of channels by name.

    `flighttest.records.record` describes the attributes.
    """

    attrs: dict[str, Any]
    leaves: dict[str, RecordGroup]


def read_arrays(path: str | Path, names: str | Path | NameMap | None = None) -> Arrays:
    """Return a flight record in plain arrays.

    Parameters and errors are the same as in `flighttest.records.record.read`.
    """
    path = Path(path)
    mapping = names
    if mapping is not None and not isinstance(mapping, NameMap):
        mapping = read_names(mapping)
    # With the map a reader can load the requested columns only.
    recording = open_recording(path, mapping or NameMap({}))
    if mapping is None:
        mapping = _canonical_map(recording, path)
    clocks = Clocks(recording.tables, mapping, path.name, recording.left_out)
    tables = clocks.with_decoded_words()
    mapped = locate_columns(mapping, tables, path, recording.left_out)
    leaves = _make_leaves(mapped.places, mapping, clocks)
    if not leaves:
        requested = ", ".join(mapped.absent[:8]) or "no channel"
        raise SchemaError(
            f"name map {mapping.source}",
            [f"nothing that it names is in {path.name} ({requested}); see 'aeromatch flight info'"],
        )
    _add_constants(leaves, mapping)

    # The facts read the column of [utc], so they precede the list of columns that nothing reads.
    attrs = _record_facts(recording, mapping, clocks, path)
    attrs["unmapped"] = ", ".join(_unmapped_columns(mapped.places, clocks))
    attrs["absent"] = " ".join(mapped.absent)
    if recording.modes:
        attrs["modes"] = json.dumps(_flight_modes(recording, mapping, leaves))
    notes = [*_stored_notes(recording.facts), *recording.notes, *clocks.notes, *mapped.notes]
    attrs["notes"] = json.dumps(notes)
    if recording.left_out:
        left_out = [[omission.place, omission.reason] for omission in recording.left_out]
        attrs["left_out"] = json.dumps(left_out)
    for key, value in attrs.items():
        if isinstance(value, str):
            attrs[key] = _to_encodable(value)
    return Arrays(attrs, leaves)


def _make_leaves(
    places: Mapping[str, dict[str, ColumnPlace]], mapping: NameMap, clocks: Clocks
) -> dict[str, RecordGroup]:
    """Return the groups of channels of all leaves of the name map that have channels."""
    leaves: dict[str, RecordGroup] = {}
    for leaf, leaf_places in places.items():
        if not leaf_places:
            continue
        for name, group in make_groups(leaf, leaf_places, mapping, clocks).items():
            # The name of a slower group may be the name of another leaf.
            is_used = name in leaves or (name != leaf and name in places)
            label = f"{leaf}_{len(leaves)}" if is_used else name
            leaves[label] = group
    return leaves


def _unmapped_columns(places: Mapping[str, Mapping[str, ColumnPlace]], clocks: Clocks) -> list[str]:
    """Return the columns that neither a channel nor a clock reads, as TABLE/COLUMN."""
    used = set(clocks.columns_used)
    for leaf_places in places.values():
        used.update(leaf_places.values())
    unmapped = []
    for name, table in clocks.tables.items():
        for column in table.columns:
            if (name, column) not in used:
                unmapped.append(f"{name}/{column}")
    return unmapped


def _record_facts(
    recording: Recording, mapping: NameMap, clocks: Clocks, path: Path
) -> dict[str, Any]:
    """Return the facts of the file, of the time of the world and of the name map."""
    facts: dict[str, Any] = {}
    for key, value in recording.facts.items():
        if isinstance(value, str | int | float):
            facts[key] = value
    # The name map has priority over the file.
    facts.update(utc_facts(mapping.utc, clocks.tables, clocks))
    facts.update(mapping.facts.stated())
    if mapping.instruments:
        instruments = {}
        for name, instrument in mapping.instruments.items():
            instruments[name] = instrument.model_dump(exclude_defaults=True)
        facts["instruments"] = json.dumps(instruments)
    facts.setdefault("title", facts.get("record") or path.name.split(".")[0])
    facts.update(source_file=path.name, format=format_name(recording.kind))
    return facts


def _to_encodable(text: str) -> str:
    """Replace undecodable bytes of a file name by question marks, so that files can store it."""
    return text.encode("utf-8", "replace").decode()


def _flight_modes(
    recording: Recording, mapping: NameMap, leaves: Mapping[str, RecordGroup]
) -> list[dict[str, object]]:
    """Return the flight modes on the clock of the record."""
    first = min(
        float(table.time[0]) for table in recording.tables.values() if table.time is not None
    )
    # Drift and offset of the clock apply to the modes as to the channels.
    clock = mapping.clock_of(recording.modes_table)
    if recording.modes_table in mapping.clocks:
        # The drift of the clock of one table counts from the first stamp of this table.
        first = recording.modes[0][0]
    modes = []
    for time, name in recording.modes:
        modes.append((first + (time - first) / (1.0 + clock.drift) + clock.offset, name))
    start = min(float(group.time[0]) for group in leaves.values())
    end = max(float(group.time[-1]) for group in leaves.values())
    return flight_mode_rows(modes, start, end)


def _add_constants(leaves: Mapping[str, RecordGroup], mapping: NameMap) -> None:
    """Add the constant channels of the name map that no leaf has.

    They join the leaf of the roll rate, else the first leaf.
    """
    groups = list(leaves.values())
    target = next((group for group in groups if "p" in group.channels), groups[0])
    recorded: set[str] = set()
    for group in groups:
        recorded.update(group.channels)
    for name, value in mapping.constants.items():
        if name not in recorded:
            attrs = {**quantity_attributes(name), "calibration": "constant, stated in the name map"}
            target.channels[name] = ChannelSamples(np.full(len(target.time), value), attrs)


def _stored_notes(facts: Mapping[str, Any]) -> list[str]:
    """Return the notes of a record that this package wrote."""
    try:
        return [str(note) for note in json.loads(facts.get("notes", "[]"))]
    except (ValueError, TypeError):
        return []


def _canonical_map(recording: Recording, path: Path) -> NameMap:
    """Return the name map of a file whose columns have canonical names.

    Raises
    ------
    ParseError
        A column with a canonical name is damaged.
    UnknownName
        A column has another name.
    """
    # A damaged column is not in the tables, so that its name alone states that it was required.
    for omission in recording.left_out:
        column = omission.place.rpartition("/")[2]
        if omission.fault and is_quantity(column):
            raise damaged_column(column, omission, path)
    clocks = {"time", "t"}
    for table in recording.tables.values():
        clock = clock_name(table.columns)
        if clock is not None:
            clocks.add(clock)
    leaves: dict[str, dict[str, Channel]] = {}
    unknown: set[str] = set()
    for name, table in recording.tables.items():
        columns = [column for column in table.columns if column not in clocks]
        unknown.update(column for column in columns if not is_quantity(column))
        leaves[name] = {column: Channel(column=column) for column in columns}
    if unknown:
        raise _unknown_columns(sorted(unknown), path)
    return NameMap(leaves, source="of the file")


def _unknown_columns(columns: list[str], path: Path) -> UnknownName:
    """Return the error of columns that need a name map."""
    return UnknownName(
        columns[0],
        VOCABULARY,
        what="column",
        hint=(
            f"{path.name} has {len(columns)} columns without a canonical name "
            f"({', '.join(columns[:12])}); pass names=... (--names), a name map in TOML or a "
            f"shipped one ({', '.join(shipped_maps())})"
        ),
    )

"""Recordings as flight records in plain arrays: every channel found, converted, and what is wrong
with it flagged.

`flighttest.records.show_record` makes a tree of xarray of them, for whatever works on a record.  A look
at one needs neither xarray nor pandas, whose import takes longer than the reading.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flightmech.errors import AeromatchError, ParseError, SchemaError, UnitError, UnknownName
from flightmech.names import VOCABULARY, lookup, quantity_attributes
from flightmech.support.arrays import median
from flighttest.records.readers.channel_correction import entry_of
from flighttest.records.readers.clocks import Clocks, TableClock
from flighttest.records.readers.columns import column_called, unit_of_column
from flighttest.records.readers.name_map import Channel, NameMap
from flighttest.records.readers.name_map_reading import read_names, shipped_maps
from flighttest.records.readers.opening import FORMATS, open_recording
from flighttest.records.readers.recording import (
    LeftOut,
    RecordedTable,
    Recording,
    clock_name,
    flight_mode_rows,
    left_out_as,
)
from flighttest.records.readers.utc_time import utc_facts
from flighttest.records.signals.blank_cells import clocks_of_rows
from flighttest.records.signals.conditioning import GAP, remove_delay
from flighttest.records.signals.delays import follow_command, remove_lag
from flighttest.records.signals.sample_flags import (
    MOST,
    Flag,
    as_text,
    flag_runs,
    read_stored_flags,
    sample_faults,
)
from flighttest.records.stored_overview import add_file_name_facts, encodable_text


class ChannelSamples(NamedTuple):
    """One channel: its samples (time,) and its attributes."""

    values: np.ndarray
    attrs: dict[str, Any]


class RecordGroup(NamedTuple):
    """Channels by name over one clock (time,) [s], and the attributes of the clock."""

    time: np.ndarray
    channels: dict[str, ChannelSamples]
    attrs: dict[str, Any]


class Arrays(NamedTuple):
    """A flight record: root attributes, and leaves by name; attributes as
    `flighttest.records.show_record` describes them.
    """

    attrs: dict[str, Any]
    leaves: dict[str, RecordGroup]


def read_arrays(path: str | Path, names: str | Path | NameMap | None = None) -> Arrays:
    """Return a flight record in plain arrays; parameters and errors as in
    `flighttest.records.show_record.read`.
    """
    path = Path(path)
    mapping = names if isinstance(names, NameMap) or names is None else read_names(names)
    recording = open_recording(path, mapping or NameMap({}))
    record = unnamed_arrays(recording, mapping, path)
    return record._replace(attrs=add_file_name_facts(record.attrs, path.name))


def unnamed_arrays(recording: Recording, mapping: NameMap | None, path: Path) -> Arrays:
    """Return a flight record in plain arrays, with None for the facts that the name of its file
    gives; errors as `read_arrays`.
    """
    return _record(recording, mapping or _own_names(recording, path), path)


def _record(recording: Recording, mapping: NameMap, path: Path) -> Arrays:
    clocks = Clocks(recording.tables, mapping, path.name, recording.left_out)
    tables = clocks.with_decoded_words()
    places, absent, lost = _places(mapping, tables, path, recording.left_out)
    leaves: dict[str, RecordGroup] = {}
    for leaf, part in places.items():
        for name, channels in _leaves(leaf, part, mapping, tables, clocks).items() if part else ():
            leaves[
                name if name not in {*leaves, *(set(places) - {leaf})} else f"{leaf}_{len(leaves)}"
            ] = channels
    if not leaves:
        wanted = ", ".join(absent[:8]) if absent else "no channel"
        raise SchemaError(
            f"name map {mapping.source}",
            [f"nothing that it names is in {path.name} ({wanted}); see 'aeromatch flight info'"],
        )
    _with_constants(leaves, mapping)
    used = {place for part in places.values() for place in part.values()} | clocks.columns_used
    root: dict[str, Any] = {
        key: value for key, value in recording.facts.items() if isinstance(value, str | int | float)
    }
    root.update({key: value for key, value in utc_facts(mapping.utc, tables, clocks).items()})
    root.update({key: value for key, value in mapping.facts.stated().items()})
    if mapping.instruments:
        root["instruments"] = json.dumps(
            {
                name: item.model_dump(exclude_defaults=True)
                for name, item in mapping.instruments.items()
            }
        )
    root.setdefault("title", root.get("record") or None)
    root.update(source_file=None, format=FORMATS[recording.kind][1])
    root["unmapped"] = ", ".join(
        f"{t}/{c}" for t, table in tables.items() for c in table.columns if (t, c) not in used
    )
    root["absent"] = " ".join(absent)
    if recording.modes:
        root["modes"] = json.dumps(_modes(recording, mapping, leaves))
    root["notes"] = json.dumps([*_notes(recording.facts), *recording.notes, *clocks.notes, *lost])
    if recording.left_out:
        root["left_out"] = json.dumps([[one.place, one.reason] for one in recording.left_out])
    root = {
        key: encodable_text(value) if isinstance(value, str) else value
        for key, value in root.items()
    }
    return Arrays(root, leaves)


def _modes(
    recording: Recording, mapping: NameMap, leaves: Mapping[str, RecordGroup]
) -> list[dict[str, object]]:
    """Return the flight modes on the clock of the record."""
    clock = mapping.clock
    first = min(
        float(table.time[0]) for table in recording.tables.values() if table.time is not None
    )
    settled = [
        (first + (time - first) / (1.0 + clock.drift) + clock.offset, name)
        for time, name in recording.modes
    ]
    times = [leaf.time for leaf in leaves.values()]
    return flight_mode_rows(
        settled, min(float(time[0]) for time in times), max(float(time[-1]) for time in times)
    )


def _with_constants(leaves: Mapping[str, RecordGroup], mapping: NameMap) -> None:
    """Add the channels that the map states as constant, where no leaf shows them, to the leaf of
    the rates or the first one.
    """
    shown = {name for leaf in leaves.values() for name in leaf.channels}
    home = next(
        (leaf for leaf in leaves.values() if "p" in leaf.channels), next(iter(leaves.values()))
    )
    for name, value in mapping.constants.items():
        if name not in shown:
            about = {**quantity_attributes(name), "calibration": "constant, stated in the name map"}
            home.channels[name] = ChannelSamples(np.full(len(home.time), value), about)


def _notes(facts: Mapping[str, Any]) -> list[str]:
    """Return the notes that a record written by this package carries."""
    try:
        return [str(note) for note in json.loads(facts.get("notes", "[]"))]
    except (ValueError, TypeError):
        return []


def _own_names(recording: Recording, path: Path) -> NameMap:
    """Return the map of a file that already speaks canonical names."""
    damaged = [
        one for one in recording.left_out if one.fault and _known(one.place.rpartition("/")[2])
    ]
    if damaged:
        raise _needed(damaged[0].place.rpartition("/")[2], damaged[0], path)
    clocks = (
        "time",
        "t",
        *(clock for table in recording.tables.values() if (clock := clock_name(table.columns))),
    )
    unknown = sorted(
        {
            c
            for table in recording.tables.values()
            for c in table.columns
            if not _known(c) and c not in clocks
        }
    )
    if unknown:
        hint = (
            f"{path.name} has {len(unknown)} columns without a canonical name "
            f"({', '.join(unknown[:12])})"
        )
        maps = ", ".join(shipped_maps())
        raise UnknownName(
            unknown[0],
            VOCABULARY,
            "column",
            f"{hint}; pass names=... (--names), a name map in TOML or a shipped one ({maps})",
        )
    return NameMap(
        {
            name: {c: Channel(column=c) for c in table.columns if c not in clocks}
            for name, table in recording.tables.items()
        },
        source="of the file",
    )


def _known(name: str) -> bool:
    try:
        return bool(lookup(name))
    except UnknownName:
        return False


_Place = tuple[str, str]  # table and column


def _places(
    mapping: NameMap, tables: Mapping[str, RecordedTable], path: Path, left_out: Sequence[LeftOut]
) -> tuple[dict[str, dict[str, _Place]], list[str], list[str]]:
    """Return where every channel is, leaf by leaf, what optional channels lack, and channels left
    out; all problems in one error.
    """
    places: dict[str, dict[str, _Place]] = {}
    problems: list[AeromatchError] = []
    absent: list[str] = []
    lost: dict[str, list[str]] = {}
    for leaf, channels in mapping.leaves.items():
        places[leaf] = {}
        for name, channel in channels.items():
            try:
                places[leaf][name] = _locate(leaf, channel, tables, path)
            except UnknownName as error:
                reason = next(
                    filter(
                        None, (left_out_as(column, leaf, left_out) for column in channel.columns)
                    ),
                    None,
                )
                if reason is not None and not reason.remedy:
                    lost.setdefault(f"{reason.place} ({reason.reason})", []).append(name)
                if reason is not None and reason.fault:
                    problems.append(_needed(name, reason, path))
                elif channel.optional or (reason is not None and not reason.remedy):
                    absent.append(channel.columns[0])
                else:
                    problems.append(error if reason is None else _needed(name, reason, path))
                continue
            problems += _unit_problem(channel, name, places[leaf][name], tables)
    if len(problems) == 1:
        raise problems[0]
    if problems:
        raise SchemaError(
            f"name map {mapping.source} for {path.name}", [str(problem) for problem in problems]
        )
    return (
        places,
        absent,
        [f"{text}: left out, and with it {', '.join(names)}" for text, names in lost.items()],
    )


def _needed(name: str, left_out: LeftOut, path: Path) -> ParseError:
    """Return the error of a name map that reads a channel from what no record can hold."""
    found = left_out.reason if left_out.fault else f"{left_out.reason} in {left_out.place}"
    return ParseError(
        str(path), left_out.line, f"{found}, which the name map reads as {name}", left_out.remedy
    )


def _unit_problem(
    channel: Channel, name: str, place: _Place, tables: Mapping[str, RecordedTable]
) -> list[AeromatchError]:
    try:
        channel.convert(np.zeros(0), unit_of_column(tables[place[0]], place[1], name), name)
    except UnitError as error:
        return [error]
    return []


def _locate(leaf: str, channel: Channel, tables: Mapping[str, RecordedTable], path: Path) -> _Place:
    """Return table and column of a channel, from the first of its columns that is there."""
    missing: UnknownName | None = None
    for column in channel.columns:
        try:
            return _one_place(leaf, column, tables, path)
        except UnknownName as error:
            missing = missing or error
    assert missing is not None
    raise missing


def _one_place(leaf: str, wanted: str, tables: Mapping[str, RecordedTable], path: Path) -> _Place:
    """Return the place of ``table/column``, of a column of the leaf's own table or of the only
    table, or of a table with one column.
    """
    if wanted in tables and len(tables[wanted].columns) == 1:
        return wanted, next(iter(tables[wanted].columns))
    for table in sorted(
        tables, key=len, reverse=True
    ):  # names of tables may hold slashes, names of columns too
        if wanted.startswith(table + "/") and (
            column := column_called(wanted[len(table) + 1 :], tables[table])
        ):
            return table, column
    own = (
        leaf if leaf in tables else next(iter(tables)) if len(tables) == 1 else "data"
    )  # a unit may hold a slash
    if own in tables and (column := column_called(wanted, tables[own])):
        return own, column
    group, _, column = wanted.rpartition("/")
    group = group or (leaf if leaf in tables else next(iter(tables)) if len(tables) == 1 else "")
    if group not in tables:
        raise UnknownName(
            group or leaf,
            tables,
            "table",
            f"{path.name} holds no such group for column {wanted!r}; write group/column",
        )
    if column not in tables[group].columns:
        raise UnknownName(
            column,
            tables[group].columns,
            "column",
            f"the name map requires it in {path.name}, table {group}",
        )
    return group, column


def _stated_error(
    channel: Channel, error: float | None, raw: np.ndarray, unit: str | None, name: str
) -> dict[str, float]:
    """The standard error that the file states for a column, through the calibration at the middle
    of what was read.
    """
    if error is None:
        return {}
    known = raw[~np.isnan(raw)]
    middle = median(known) if len(known) else 0.0
    low, high = np.asarray(
        channel.convert(np.array([middle - 0.5 * error, middle + 0.5 * error]), unit, name), float
    )
    return {"stderr": float(abs(high - low))} if np.isfinite(high - low) else {}


def _leaves(
    leaf: str,
    places: dict[str, _Place],
    mapping: NameMap,
    tables: Mapping[str, RecordedTable],
    clocks: Clocks,
) -> dict[str, RecordGroup]:
    """Return the channels of a leaf of the name map; those whose samples form a slower clock than
    the rows have a leaf of their own.
    """
    what = f"{clocks.file}, leaf {leaf}"
    groups = sorted({group for group, _ in places.values()})
    if any(not clocks.have_same_stamps(groups[0], group, what) for group in groups[1:]):
        raise SchemaError(
            f"name map, leaf {leaf}",
            [
                f"its columns come from tables with different clocks ({', '.join(groups)}); "
                f"make a leaf of each"
            ],
        )
    clock = clocks.table_clock(groups[0], what)
    raw: dict[str, np.ndarray] = {}
    for name, (group, column) in places.items():
        values = np.asarray(tables[group].columns[column], float)
        raw[name] = values if len(clock.samples) == len(values) else values[clock.samples]
    parts = clocks_of_rows(clock.time, raw)
    if len(parts) == 1 and parts[0][0] is None:
        return {leaf: _leaf(leaf, places, mapping, tables, clock, raw)}
    # the name of the map remains with the channels of all rows, or with the largest group
    parts.sort(key=lambda part: (part[0] is not None, -len(part[1])))
    found: dict[str, RecordGroup] = {}
    for filled, names in parts:
        samples = np.arange(len(clock.time)) if filled is None else np.flatnonzero(filled)
        slow = clock if filled is None else _slower(clock, samples)
        rate = float(slow.attributes["rate"])
        label = leaf if not found else f"{leaf}_{rate:.3g}Hz"
        label = label if label not in found else f"{label}_{len(found)}"
        own = {name: places[name] for name in names}
        found[label] = _leaf(
            leaf, own, mapping, tables, slow, {name: raw[name][samples] for name in names}
        )
    return found


def _slower(clock: TableClock, samples: np.ndarray) -> TableClock:
    """Return the clock of some rows of a table."""
    time = clock.time[samples]
    step = np.diff(time)
    usual = median(step)
    gaps = np.flatnonzero(step > GAP * usual)[:MOST]
    flags = [flag for flag in clock.flags if flag.kind != "gap"]
    flags += [
        Flag("", "gap", float(time[i]), float(time[i + 1]), 0, f"{step[i]:.3g} s") for i in gaps
    ]
    words = ", ".join(f"{time[i]:g} s ({step[i]:.3g} s)" for i in gaps)
    return TableClock(
        time,
        clock.samples[samples],
        flags,
        {**clock.attributes, "rate": 1.0 / usual, "gaps": words},
    )


def _leaf(
    leaf: str,
    places: dict[str, _Place],
    mapping: NameMap,
    tables: Mapping[str, RecordedTable],
    clock: TableClock,
    samples: dict[str, np.ndarray],
) -> RecordGroup:
    """Return channels on one clock, converted, with their flags."""
    columns: dict[str, ChannelSamples] = {}
    found = [*read_stored_flags(tables[next(iter(places.values()))[0]].flags), *clock.flags]
    for name, (group, column) in places.items():
        channel, unit = mapping.leaves[leaf][name], unit_of_column(tables[group], column, name)
        raw = samples[name]
        found += flag_runs(clock.time, np.isinf(raw), name, "outside")
        raw = np.where(np.isinf(raw), np.nan, raw)
        x = np.asarray(channel.convert(raw, unit, name), float)
        found += (
            flag_runs(clock.time, np.isnan(x) & ~np.isnan(raw), name, "outside")
            if channel.table is not None
            else []
        )
        error = _stated_error(channel, tables[group].errors.get(column), raw, unit, name)
        x, limits = remove_delay(clock.time, x, channel.delay, name), channel.limits(name)
        x = (
            follow_command(clock.time, x, -channel.lag, *limits)
            if limits
            else remove_lag(clock.time, x, channel.lag, name)
        )
        found += sample_faults(clock.time, x, name, clock.attributes["rate"])
        about = {
            **quantity_attributes(name),
            "column": f"{group}/{column}",
            "calibration": channel.calibration(unit, column),
        }
        about["map_entry"] = json.dumps(
            {
                **entry_of(channel),
                "column": column if "/" not in channel.columns[0] else f"{group}/{column}",
            }
        )
        about["file_unit"] = unit or ""
        removed = {
            f"{key}_removed": value
            for key, value in (("delay", channel.delay), ("lag", channel.lag))
            if value
        }
        columns[name] = ChannelSamples(x, {**about, **removed, **error})
    if {"delta_a_left", "delta_a_right"} <= set(columns) and "delta_a" not in columns:
        about = {
            **quantity_attributes("delta_a"),
            "calibration": "(delta_a_right - delta_a_left) / 2",
        }
        columns["delta_a"] = ChannelSamples(
            (columns["delta_a_right"].values - columns["delta_a_left"].values) / 2.0, about
        )
    missing: dict[str, list[Flag]] = {}
    for flag in found:
        if flag.kind == "missing":
            missing.setdefault(flag.channel, []).append(flag)
    words = ", ".join(
        f"{name} {sum(m.samples for m in group)} from {group[0].start:g} s"
        for name, group in missing.items()
    )
    about = {**clock.attributes, "missing": words, "flags": as_text(dict.fromkeys(found))}
    return RecordGroup(clock.time, columns, about)

"""Channels of a record in canonical names and SI, in groups of one clock each.

The channels of a leaf of the name map are converted, corrected for delay and lag, and checked for
faults.  Channels that are slower than the rows of their table form a group of their own.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, TypeVar

import numpy as np

from flightmech.errors import SchemaError
from flightmech.names import quantity_attributes
from flightmech.quantities import time_text
from flightmech.support.arrays import median
from flighttest.records.column_places import ColumnPlace
from flighttest.records.readers.channel_correction import entry_of
from flighttest.records.readers.clocks import Clocks, TableClock
from flighttest.records.readers.columns import unit_of_column
from flighttest.records.readers.name_map import Channel, NameMap
from flighttest.records.readers.recording import RecordedTable
from flighttest.records.signals.blank_cells import clocks_of_rows
from flighttest.records.signals.delays import follow_command, remove_lag
from flighttest.records.signals.missing_codes import find_missing_codes
from flighttest.records.signals.resampling import GAP, remove_delay
from flighttest.records.signals.sample_flags import (
    MOST,
    Flag,
    as_text,
    flag_runs,
    read_stored_flags,
    sample_faults,
)

_Result = TypeVar("_Result")
# Values of a record from which on threads save time, and the largest number of threads.
_LARGE, _MOST_THREADS = 2_000_000, 4
# No sensor has larger numbers, in any unit; powers of damaged ones, such as 1e308, are infinite.
_LARGEST = 1e30


class ChannelSamples(NamedTuple):
    """Samples (time,) and attributes of one channel."""

    values: np.ndarray
    attrs: dict[str, Any]


class RecordGroup(NamedTuple):
    """Channels by name over one clock (time,) [s], and the attributes of the clock."""

    time: np.ndarray
    channels: dict[str, ChannelSamples]
    attrs: dict[str, Any]


def map_large(
    function: Callable[[str], _Result], names: Sequence[str], samples: int
) -> Iterator[_Result]:
    """Return the results of a function of each channel in order, in threads for long records.

    NumPy works outside of the lock of Python; a thread for few samples costs more than it saves.
    """
    workers = min(len(names), os.cpu_count() or 1, _MOST_THREADS)
    if workers < 2 or samples * len(names) < _LARGE:
        return map(function, names)
    with ThreadPoolExecutor(workers) as pool:
        return iter(list(pool.map(function, names)))


def make_groups(
    leaf: str, places: dict[str, ColumnPlace], mapping: NameMap, clocks: Clocks
) -> dict[str, RecordGroup]:
    """Return the channels of a leaf of the name map, in one group for each clock.

    Parameters
    ----------
    leaf : str
        Name of the leaf.
    places : dict of str to ColumnPlace
        Canonical name -> table and column.
    mapping : NameMap
    clocks : Clocks
        Clocks and tables of the file.

    Returns
    -------
    dict of str to RecordGroup
        The first group has the name of the leaf.  The names of slower groups end with their rate.

    Raises
    ------
    SchemaError
        The columns of the leaf are in tables with different clocks.
    """
    clock, raw = _raw_samples(leaf, places, clocks)
    channels = mapping.leaves[leaf]
    codes = _remove_missing_codes(raw, channels)
    parts = clocks_of_rows(clock.time, raw)
    if len(parts) == 1 and parts[0][0] is None:
        group = _convert_group(channels, places, clocks.tables, clock=clock, raw=raw)
        return _with_codes({leaf: group}, codes)

    # The channels of all rows, or else the largest part, have the name of the leaf.
    parts.sort(key=lambda part: (part[0] is not None, -len(part[1])))
    groups: dict[str, RecordGroup] = {}
    for is_filled, names in parts:
        part_clock, part_raw = clock, {name: raw[name] for name in names}
        if is_filled is not None:
            samples = np.flatnonzero(is_filled)
            part_clock = _select_rows(clock, samples)
            part_raw = {name: raw[name][samples] for name in names}
        group = _convert_group(channels, places, clocks.tables, clock=part_clock, raw=part_raw)
        groups[_group_name(leaf, groups, part_clock)] = group
    return _with_codes(groups, codes)


def _with_codes(groups: dict[str, RecordGroup], codes: Mapping[str, str]) -> dict[str, RecordGroup]:
    """Add the codes of missing values that were replaced to the attributes of their channels."""
    for group in groups.values():
        for name in codes.keys() & group.channels.keys():
            group.channels[name].attrs["missing_codes"] = codes[name]
    return groups


def _raw_samples(
    leaf: str, places: dict[str, ColumnPlace], clocks: Clocks
) -> tuple[TableClock, dict[str, np.ndarray]]:
    """Return the clock of a leaf, and the recorded samples of its channels on this clock."""
    what = f"{clocks.file}, leaf {leaf}"
    tables = sorted({table for table, _ in places.values()})
    for table in tables[1:]:
        if not clocks.have_same_stamps(tables[0], table, what):
            raise SchemaError(
                f"name map, leaf {leaf}",
                [
                    f"its columns come from tables with different clocks ({', '.join(tables)}); "
                    f"make a leaf of each"
                ],
            )
    clock = clocks.table_clock(tables[0], what)
    raw: dict[str, np.ndarray] = {}
    for name, (table, column) in places.items():
        values = np.asarray(clocks.tables[table].columns[column], float)
        # The clock may have removed stray and repeated stamps.
        if len(clock.samples) != len(values):
            values = values[clock.samples]
        raw[name] = values
    return clock, raw


def _remove_missing_codes(
    raw: dict[str, np.ndarray], channels: Mapping[str, Channel]
) -> dict[str, str]:
    """Replace the codes of missing values by NaN in place, and return what was replaced.

    They are those that the name map states, else numbers such as -999 far from all readings.
    """
    replaced: dict[str, str] = {}
    for name, values in raw.items():
        found = [(code, values == code) for code in channels[name].missing or ()]
        if channels[name].missing is None:
            found = find_missing_codes(values)
        texts = []
        for code, is_code in found:
            if not is_code.any():
                continue
            raw[name] = np.where(is_code, np.nan, raw[name])
            texts.append(f"{code:.10g} in {int(is_code.sum())} cells")
        if texts:
            replaced[name] = ", ".join(texts)
    return replaced


def _group_name(leaf: str, groups: Mapping[str, RecordGroup], clock: TableClock) -> str:
    """Return the name of the next group of a leaf: the leaf, then the leaf with a rate."""
    if not groups:
        return leaf
    name = f"{leaf}_{float(clock.attributes['rate']):.3g}Hz"
    if name in groups:
        return f"{name}_{len(groups)}"
    return name


def _select_rows(clock: TableClock, samples: np.ndarray) -> TableClock:
    """Return the clock of some rows of a table."""
    time = clock.time[samples]
    step = np.diff(time)
    usual_step = median(step)
    # The gaps of all rows do not apply to the slower clock.
    flags = [flag for flag in clock.flags if flag.kind != "gap"]
    gaps = []
    for i in np.flatnonzero(step > GAP * usual_step)[:MOST]:
        start, stop = float(time[i]), float(time[i + 1])
        flags.append(Flag("", "gap", start, stop=stop, samples=0, note=f"{step[i]:.3g} s"))
        gaps.append(f"{time_text(time[i])} s ({step[i]:.3g} s)")
    attributes = {**clock.attributes, "rate": 1.0 / usual_step, "gaps": ", ".join(gaps)}
    return TableClock(time, clock.samples[samples], flags, attributes)


def _convert_group(
    channels: Mapping[str, Channel],
    places: Mapping[str, ColumnPlace],
    tables: Mapping[str, RecordedTable],
    clock: TableClock,
    raw: Mapping[str, np.ndarray],
) -> RecordGroup:
    """Return the channels of `raw` on one clock, converted to SI, with their flags."""
    # All tables of a leaf have the same clock, and each has its stored flags.
    flags: list[Flag] = []
    for table in dict.fromkeys(places[name][0] for name in raw):
        flags += read_stored_flags(tables[table].flags)
    flags += clock.flags
    converted: dict[str, ChannelSamples] = {}

    def convert(name: str) -> tuple[ChannelSamples, list[Flag]]:
        source = places[name]
        return _convert_channel(
            channels[name], name, tables[source[0]], source=source, clock=clock, raw=raw[name]
        )

    for name, (channel, faults) in zip(raw, map_large(convert, list(raw), len(clock.time))):
        converted[name] = channel
        flags += faults
    # A stored flag may be found again.
    flags = list(dict.fromkeys(flags))
    _add_aileron(converted)
    attrs = {
        **clock.attributes,
        "missing": _describe_missing(flags),
        "flags": as_text(flags),
    }
    return RecordGroup(clock.time, converted, attrs)


def _convert_channel(
    channel: Channel,
    name: str,
    table: RecordedTable,
    source: ColumnPlace,
    clock: TableClock,
    raw: np.ndarray,
) -> tuple[ChannelSamples, list[Flag]]:
    """Return a channel in SI without delay and lag, and the flags of its samples."""
    column = source[1]
    unit = unit_of_column(table, column, name)
    is_beyond = np.abs(raw) > _LARGEST
    faults = flag_runs(clock.time, is_beyond, name, "outside")
    raw = np.where(is_beyond, np.nan, raw)
    x = np.asarray(channel.convert(raw, unit, name), float)
    if channel.table is not None:
        # The calibration table gives NaN beyond its rows.
        is_outside = np.isnan(x) & ~np.isnan(raw)
        faults += flag_runs(clock.time, is_outside, name, "outside")
    stderr = _convert_stderr(channel, table.errors.get(column), raw, unit=unit, name=name)

    x = remove_delay(clock.time, x, channel.delay, name)
    limits = channel.limits(name)
    if limits:
        # A negative lag with limits of rate and position: an actuator follows the command.
        rate_limit, stops = limits
        x = follow_command(clock.time, x, -channel.lag, rate_limit, stops)
    else:
        x = remove_lag(clock.time, x, channel.lag, name)
    faults += sample_faults(clock.time, x, name, clock.attributes["rate"])
    attrs = _channel_attributes(channel, name, source, unit=unit)
    if stderr is not None:
        attrs["stderr"] = stderr
    return ChannelSamples(x, attrs), faults


def _channel_attributes(
    channel: Channel, name: str, source: ColumnPlace, unit: str | None
) -> dict[str, Any]:
    """Return the attributes of a channel: quantity, source, conversion and corrections."""
    path = "/".join(source)
    attrs: dict[str, Any] = dict(quantity_attributes(name))
    attrs["column"] = path
    attrs["calibration"] = channel.calibration(unit, source[1])
    # The entry names the column that was read, in the style of the name map.
    entry = entry_of(channel)
    entry["column"] = path if "/" in channel.columns[0] else source[1]
    attrs["map_entry"] = json.dumps(entry)
    attrs["file_unit"] = unit or ""
    if channel.delay:
        attrs["delay_removed"] = channel.delay
    if channel.lag:
        attrs["lag_removed"] = channel.lag
    return attrs


def _convert_stderr(
    channel: Channel, error: float | None, raw: np.ndarray, unit: str | None, name: str
) -> float | None:
    """Return the standard error of a column in SI, None if the file does not state one.

    The calibration may be a curve.  It is applied at the median of the samples, half an error to
    each side.
    """
    if error is None:
        return None
    valid = raw[~np.isnan(raw)]
    middle = median(valid) if len(valid) else 0.0
    ends = np.array([middle - 0.5 * error, middle + 0.5 * error])
    low, high = np.asarray(channel.convert(ends, unit, name), float)
    if not np.isfinite(high - low):
        return None
    return float(abs(high - low))


def _add_aileron(channels: dict[str, ChannelSamples]) -> None:
    """Add the aileron deflection, half the difference of the right and the left surface."""
    if "delta_a" in channels or not {"delta_a_left", "delta_a_right"} <= set(channels):
        return
    difference = channels["delta_a_right"].values - channels["delta_a_left"].values
    attrs = {
        **quantity_attributes("delta_a"),
        "calibration": "(delta_a_right - delta_a_left) / 2",
    }
    channels["delta_a"] = ChannelSamples(difference / 2.0, attrs)


def _describe_missing(flags: Iterable[Flag]) -> str:
    """Return number and first time of the missing samples of each channel."""
    missing: dict[str, list[Flag]] = {}
    for flag in flags:
        if flag.kind == "missing":
            missing.setdefault(flag.channel, []).append(flag)
    texts = []
    for name, runs in missing.items():
        count = sum(flag.samples for flag in runs)
        texts.append(f"{name} {count} from {time_text(runs[0].start)} s")
    return ", ".join(texts)

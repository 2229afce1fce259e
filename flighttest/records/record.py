"""Flight records: recordings as a tree of leaves, one per time base, in canonical names and SI.

A `FlightRecord` is a plain ``xarray.DataTree``.  Each leaf is a Dataset over its own ``time`` [s]; its attributes state what the clock
looked like (``rate`` [Hz], ``gaps``, ``duplicates``), which channels hold NaN (``missing``), and all flags (`flighttest.signals.flags`).
Root attributes: ``title``, ``start``, ``purpose``, ``source_file``, ``format``, ``manoeuvres`` and ``modes`` (JSON), ``notes`` (JSON:
faults that the file itself reports), ``unmapped`` and ``absent`` columns, ``latitude`` [rad], ``runway_elevation`` [m] where known.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import AeromatchError, ParseError, SchemaError, UnitError, UnknownName
from flightmech.names import VOCABULARY, attrs, lookup
from flightmech.support.input_files.text import json_content

from ..readers.clocks import Clocks, utc_facts
from ..readers.flight_modes import rows
from ..readers.headings import column_called
from ..readers.map_entries import entry_of
from ..readers.name_map import Channel, NameMap, read_names, shipped_maps
from ..readers.opening import FORMATS, open_recording
from ..readers.recording import Recording, Table
from ..signals.conditioning import remove_delay
from ..signals.first_order_lag import follow_command, remove_lag
from ..signals.sample_flags import Flag, as_text, in_words, kept, sample_faults, spans


def read(path: str | Path, names: str | Path | NameMap | None = None) -> xr.DataTree:
    """Return a flight record from a file of any known format; the format is recognised by content.

    Parameters
    ----------
    path : str or Path
        CSV (plain or gzip), netCDF, HDF5, MATLAB v5 to v7.3, PX4 ULog, ArduPilot DataFlash, MDF, IRIG 106 Chapter 10.
    names : str, Path or NameMap, optional
        Name map: a TOML file, or the name of a shipped one (``"px4"``, ``"ardupilot"``).  Without it every column must carry a canonical
        name and its unit.  Columns the map does not name are left out and listed in the root attribute ``unmapped``.

    Returns
    -------
    DataTree
        The record; ``delta_a`` is formed from left and right, positive for left roll. [SI]

    Raises
    ------
    ParseError
        The file breaks its format, or is of no known one.
    UnknownName
        A column of the map is not in the file, or a column has no canonical name, with the near names.
    UnitError
        A column without a unit, or with one of another quantity.
    SchemaError
        Several of these at once; a clock that is set back; leaves that mix clocks.
    AeromatchError
        The package that reads the format is not installed; the message states how to install it.

    References
    ----------
    .. [LR743] Report LR-743, 1993, section 4.2.
    """
    path = Path(path)
    mapping = names if isinstance(names, NameMap) or names is None else read_names(names)
    recording = open_recording(path, mapping or NameMap({}))
    return _record(recording, mapping or _own_names(recording, path), path)


def _record(recording: Recording, mapping: NameMap, path: Path) -> xr.DataTree:
    clocks = Clocks(recording.tables, mapping, path.name)
    tables = clocks.with_decoded_words()
    places, absent = _places(mapping, tables, path)
    leaves = {leaf: _leaf(leaf, part, mapping, tables, clocks) for leaf, part in places.items() if part}
    if not leaves:
        wanted = ", ".join(absent[:8]) if absent else "no channel"
        raise SchemaError(
            f"name map {mapping.source}", [f"nothing that it names is in {path.name} ({wanted}); see 'aeromatch flight info'"]
        )
    _with_constants(leaves, mapping)
    used = {place for part in places.values() for place in part.values()} | clocks.columns_used
    root = {key: value for key, value in recording.facts.items() if isinstance(value, str | int | float)}
    root.update({key: value for key, value in utc_facts(mapping.utc, tables, clocks).items()})
    root.update({key: value for key, value in mapping.facts.model_dump().items() if value is not None})
    if mapping.instruments:
        root["instruments"] = json.dumps({name: item.model_dump(exclude_defaults=True) for name, item in mapping.instruments.items()})
    root.setdefault("title", root.get("record") or path.name.split(".")[0])
    root.update(source_file=path.name, format=FORMATS[recording.kind][1])
    root["unmapped"] = " ".join(f"{t}/{c}" for t, table in tables.items() for c in table.columns if (t, c) not in used)
    root["absent"] = " ".join(absent)
    if recording.modes:
        root["modes"] = json.dumps(_modes(recording, mapping, leaves))
    root["notes"] = json.dumps([*_notes(recording.facts), *recording.notes, *clocks.notes])
    root = {key: _writable(value) if isinstance(value, str) else value for key, value in root.items()}
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=root), **{f"/{leaf}": data for leaf, data in leaves.items()}})


def _modes(recording: Recording, mapping: NameMap, leaves: Mapping[str, xr.Dataset]) -> list[dict[str, object]]:
    """Return the flight modes on the clock of the record."""
    clock = mapping.clock
    first = min(float(table.time[0]) for table in recording.tables.values() if table.time is not None)
    settled = [(first + (time - first) / (1.0 + clock.drift) + clock.offset, name) for time, name in recording.modes]
    times = [data["time"].values for data in leaves.values()]
    return rows(settled, min(float(time[0]) for time in times), max(float(time[-1]) for time in times))


def _writable(text: str) -> str:
    """Return a text that files can hold: bytes of a file's name that the encoding of the system does not know become question marks."""
    return text.encode("utf-8", "replace").decode()


def _with_constants(leaves: dict[str, xr.Dataset], mapping: NameMap) -> None:
    """Add the channels that the map states as constant, where no leaf shows them, to the leaf of the rates or the first one."""
    shown = {str(name) for data in leaves.values() for name in data.data_vars}
    home = next((leaf for leaf, data in leaves.items() if "p" in data), next(iter(leaves)))
    for name, value in mapping.constants.items():
        if name not in shown:
            about = {**attrs(name), "calibration": "constant, stated in the name map"}
            leaves[home][name] = _over_time(np.full(leaves[home].sizes["time"], value), about)


def _notes(facts: Mapping[str, Any]) -> list[str]:
    """Return the notes that a record written by this package carries."""
    try:
        return [str(note) for note in json.loads(facts.get("notes", "[]"))]
    except (ValueError, TypeError):
        return []


def locate(record: xr.DataTree, name: str) -> str | None:
    """Return the leaf that holds channel `name`, or None."""
    return next((leaf for leaf, node in record.children.items() if name in node.data_vars), None)


def channels(record: xr.DataTree) -> dict[str, str]:
    """Return every channel with its leaf."""
    return {str(name): leaf for leaf, node in record.children.items() for name in node.data_vars}


def manoeuvres(record: xr.DataTree | xr.Dataset) -> pd.DataFrame:
    """Return the list of manoeuvres a record carries, or the states of a path of that record.

    Returns
    -------
    DataFrame
        One row per manoeuvre: ``manoeuvre control start end note``, times in seconds of the record; empty without a list.
    """
    return _listed(record, "manoeuvres")


def modes(record: xr.DataTree | xr.Dataset) -> pd.DataFrame:
    """Return the flight modes in the log of an autopilot (PX4, ArduPilot) as `manoeuvres` does: a row from each change to the next."""
    return _listed(record, "modes")


def _listed(record: xr.DataTree | xr.Dataset, key: str) -> pd.DataFrame:
    columns = ["manoeuvre", "control", "start", "end", "note"]
    file = str(record.attrs.get("source_file", "the record"))
    found = json_content(record.attrs.get(key, "[]"), file, f"a list of {key}")
    if not isinstance(found, list) or not all(isinstance(row, dict) for row in found):
        raise ParseError(file, 0, f"the attribute {key} {str(found)[:40]!r}", "a list of rows in JSON; write the record again")
    return pd.DataFrame([{name: row.get(name, "") for name in columns} for row in found], columns=columns)


def overview(record: xr.DataTree) -> pd.DataFrame:
    """Return one row per channel: leaf, rate, span, smallest and largest value, unit, calibration, faults."""
    rows = []
    for leaf, node in record.children.items():
        data = node.to_dataset()
        time = data["time"].values
        for name in map(str, data.data_vars):
            x = data[name].values
            rows.append(
                {
                    "leaf": leaf,
                    "channel": name,
                    "rate": data.attrs["rate"],
                    "start": time[0],
                    "stop": time[-1],
                    "min": np.nanmin(x) if np.isfinite(x).any() else np.nan,
                    "max": np.nanmax(x) if np.isfinite(x).any() else np.nan,
                    "units": data[name].attrs["units"],
                    "calibration": data[name].attrs.get("calibration", ""),
                    "missing": int(np.isnan(x).sum()),
                }
            )
    return pd.DataFrame(rows)


def faults(record: xr.DataTree) -> list[str]:
    """Return in words what is wrong with the clocks and samples of a record; `flighttest.signals.flags` gives the same as a table."""
    found = [str(note) for note in json.loads(record.attrs.get("notes", "[]"))]
    for leaf, node in record.children.items():
        found += [f"{leaf}: {text}" for text in in_words(kept(node.attrs.get("flags", "[]")))]
    return found


def _own_names(recording: Recording, path: Path) -> NameMap:
    """Return the map of a file that already speaks canonical names."""
    clocks = ("time", "t")
    unknown = sorted({c for table in recording.tables.values() for c in table.columns if not _known(c) and c not in clocks})
    if unknown:
        hint = f"{path.name} has {len(unknown)} columns without a canonical name ({', '.join(unknown[:12])})"
        maps = ", ".join(shipped_maps())
        raise UnknownName(
            unknown[0], VOCABULARY, "column", f"{hint}; pass names=... (--names), a name map in TOML or a shipped one ({maps})"
        )
    return NameMap(
        {name: {c: Channel(column=c) for c in table.columns if c not in clocks} for name, table in recording.tables.items()},
        source="of the file",
    )


def needs_names(path: str | Path) -> bool:
    """Return whether a recording can be read with a name map only: some column has no canonical name, or no unit.

    Raises
    ------
    ParseError
        The file is damaged, or of no known format.
    """
    try:
        read(path)
    except ParseError:
        raise
    except AeromatchError:
        return True
    return False


def _known(name: str) -> bool:
    try:
        return bool(lookup(name))
    except UnknownName:
        return False


_Place = tuple[str, str]  # table and column


def _places(mapping: NameMap, tables: Mapping[str, Table], path: Path) -> tuple[dict[str, dict[str, _Place]], list[str]]:
    """Return where every channel is, leaf by leaf, and what optional channels lack; all problems in one error."""
    places: dict[str, dict[str, _Place]] = {}
    problems: list[AeromatchError] = []
    absent: list[str] = []
    for leaf, channels in mapping.leaves.items():
        places[leaf] = {}
        for name, channel in channels.items():
            try:
                places[leaf][name] = _locate(leaf, channel, tables, path)
            except UnknownName as error:
                if channel.optional:
                    absent.append(channel.columns[0])
                else:
                    problems.append(error)
                continue
            problems += _unit_problem(channel, name, places[leaf][name], tables)
    if len(problems) == 1:
        raise problems[0]
    if problems:
        raise SchemaError(f"name map {mapping.source} for {path.name}", [str(problem) for problem in problems])
    return places, absent


def _unit_problem(channel: Channel, name: str, place: _Place, tables: Mapping[str, Table]) -> list[AeromatchError]:
    try:
        channel.convert(np.zeros(0), tables[place[0]].units.get(place[1]), name)
    except UnitError as error:
        return [error]
    return []


def _locate(leaf: str, channel: Channel, tables: Mapping[str, Table], path: Path) -> _Place:
    """Return table and column of a channel, from the first of its columns that is there."""
    missing: UnknownName | None = None
    for column in channel.columns:
        try:
            return _one_place(leaf, column, tables, path)
        except UnknownName as error:
            missing = missing or error
    assert missing is not None
    raise missing


def _one_place(leaf: str, wanted: str, tables: Mapping[str, Table], path: Path) -> _Place:
    """Return the place of ``table/column``, of a column of the leaf's own table or of the only table, or of a table with one column."""
    if wanted in tables and len(tables[wanted].columns) == 1:
        return wanted, next(iter(tables[wanted].columns))
    for table in sorted(tables, key=len, reverse=True):  # names of tables may hold slashes, names of columns too
        if wanted.startswith(table + "/") and (column := column_called(wanted[len(table) + 1 :], tables[table])):
            return table, column
    own = leaf if leaf in tables else next(iter(tables)) if len(tables) == 1 else "data"  # a unit may hold a slash
    if own in tables and (column := column_called(wanted, tables[own])):
        return own, column
    group, _, column = wanted.rpartition("/")
    group = group or (leaf if leaf in tables else next(iter(tables)) if len(tables) == 1 else "")
    if group not in tables:
        raise UnknownName(group or leaf, tables, "table", f"{path.name} holds no such group for column {wanted!r}; write group/column")
    if column not in tables[group].columns:
        raise UnknownName(column, tables[group].columns, "column", f"the name map requires it in {path.name}, table {group}")
    return group, column


def _stated_error(channel: Channel, error: float | None, raw: np.ndarray, unit: str | None, name: str) -> dict[str, float]:
    """The standard error that the file states for a column, through the calibration at the middle of what was read."""
    middle = float(np.nanmedian(raw)) if np.isfinite(raw).any() else 0.0
    if error is None:
        return {}
    low, high = np.asarray(channel.convert(np.array([middle - 0.5 * error, middle + 0.5 * error]), unit, name), float)
    return {"stderr": float(abs(high - low))} if np.isfinite(high - low) else {}


def _leaf(leaf: str, places: dict[str, _Place], mapping: NameMap, tables: Mapping[str, Table], clocks: Clocks) -> xr.Dataset:
    what = f"{clocks.file}, leaf {leaf}"
    groups = sorted({group for group, _ in places.values()})
    if any(not clocks.same(groups[0], group, what) for group in groups[1:]):
        raise SchemaError(
            f"name map, leaf {leaf}", [f"its columns come from tables with different clocks ({', '.join(groups)}); make a leaf of each"]
        )
    clock = clocks.settled(groups[0], what)
    columns: dict[str, Any] = {}
    found = [*kept(tables[groups[0]].flags), *clock.flags]
    for name, (group, column) in places.items():
        channel, unit = mapping.leaves[leaf][name], tables[group].units.get(column)
        raw = np.asarray(tables[group].columns[column], float)
        raw = raw if len(clock.keep) == len(raw) else raw[clock.keep]
        found += spans(clock.time, np.isinf(raw), name, "outside")
        raw = np.where(np.isinf(raw), np.nan, raw)
        x = np.asarray(channel.convert(raw, unit, name), float)
        found += spans(clock.time, np.isnan(x) & ~np.isnan(raw), name, "outside") if channel.table is not None else []
        error = _stated_error(channel, tables[group].errors.get(column), raw, unit, name)
        x, limits = remove_delay(clock.time, x, channel.delay, name), channel.limits(name)
        x = follow_command(clock.time, x, -channel.lag, *limits) if limits else remove_lag(clock.time, x, channel.lag, name)
        found += sample_faults(clock.time, x, name, clock.about["rate"])
        about = {**attrs(name), "column": f"{group}/{column}", "calibration": channel.calibration(unit, column)}
        about["map_entry"] = json.dumps({**entry_of(channel), "column": column if "/" not in channel.columns[0] else f"{group}/{column}"})
        about["file_unit"] = unit or ""
        removed = {f"{key}_removed": value for key, value in (("delay", channel.delay), ("lag", channel.lag)) if value}
        columns[name] = "time", x, {**about, **removed, **error}
    if {"delta_a_left", "delta_a_right"} <= set(columns) and "delta_a" not in columns:
        about = {**attrs("delta_a"), "calibration": "(delta_a_right - delta_a_left) / 2"}
        columns["delta_a"] = "time", (columns["delta_a_right"][1] - columns["delta_a_left"][1]) / 2.0, about
    missing: dict[str, list[Flag]] = {}
    for flag in found:
        if flag.kind == "missing":
            missing.setdefault(flag.channel, []).append(flag)
    words = ", ".join(f"{name} {sum(m.samples for m in group)} from {group[0].start:g} s" for name, group in missing.items())
    about = {**clock.about, "missing": words, "flags": as_text(dict.fromkeys(found))}
    variables = {name: _over_time(*column[1:]) for name, column in columns.items()}
    index = pd.Index(clock.time)
    time = xr.IndexVariable("time", index, attrs("time"), fastpath=True)
    return xr.Dataset(variables, xr.Coordinates({"time": time}, {"time": xr.indexes.PandasIndex(index, "time")}), about)


def _over_time(values: np.ndarray, about: dict[str, Any]) -> xr.Variable:
    """Return a variable of a plain array; without `fastpath` xarray imports dask, where that is installed, to look for its arrays."""
    return xr.Variable("time", values, about, fastpath=True)

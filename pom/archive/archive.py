"""File ``results.nc``: complete results in exact doubles, one group per case.

Any netCDF-4 or HDF5 tool reads it.  The text ``document`` of the root is JSON: title, revision,
provenance, diagnoses, logs of tunings, order of the cases.  The group of a case holds
``signals(run, channel, time)``, ``tolerance(banded, time)`` and ``inputs(input, time)``, with the
names along these dimensions, and a ``document`` (case, conditions, trim, verdicts, failure).
Models with draws have ``samples`` in that document, and their quantiles in
``fan0(channel, quantile, time)``, ``fan1`` and so on.  Units are SI and radians.  The verdicts are
in the unit of the tolerance table.  Files are named relative to the folder of the report.  A few
large variables take the place of many small ones, so that a hundred cases are read in seconds.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import AeromatchError, SchemaError
from flightmech.short_text import ShortText
from flightmech.support.array_files.netcdf_writing import encode_hdf5
from flightmech.support.console import to_json_types
from flightmech.support.hdf5_seal import demand_self_contained
from flightmech.support.input_files import file_sha256
from pom.archive.origins import case_found_from, case_seen_from
from pom.cases.case import PomCase
from pom.fmu.run_cache import FileState
from pom.result import PomResult, make_verdict_table, to_split_dict
from pom.samples import SampledReplay

# Dimension of the names, by part of a result.
_NAMES = {"signals": "channel", "tolerance": "banded", "inputs": "input"}


@dataclass(frozen=True)
class Archive(ShortText):
    """Content of ``results.nc``.

    Attributes
    ----------
    results : list of PomResult
        As judged, exact.
    title, revision : str
        Title and revision of the report.
    provenance : dict
        As given to `pom.write_report`, without paths.
    diagnoses : dict of str to DataFrame
        Case name to the table of `pom.diagnose`.
    paper : str or None
        Paper of ``report.pdf``; empty without a PDF, None if the file does not state it.
    tunings : dict of str to dict
        Name of a model to the log of its tuning (`pom.tuning_content.Tuning.document`).
    chapters : bytes
        Drawn chapters of the report in addition to its cases (`pom.report.chapters`); empty
        without chapters.
    """

    results: list[PomResult]
    title: str = ""
    revision: str = ""
    provenance: dict[str, Any] = field(default_factory=dict)
    diagnoses: dict[str, pd.DataFrame] = field(default_factory=dict)
    paper: str | None = None
    tunings: dict[str, dict[str, Any]] = field(default_factory=dict)
    chapters: bytes = field(default=b"", repr=False)


def write_archive(path: str | os.PathLike, archive: Archive, keys: Sequence[str]) -> None:
    """Write ``results.nc``.  Equal input gives equal bytes.

    Parameters
    ----------
    path : path
    archive : Archive
    keys : sequence of str
        Name of the group of every result.
    """
    head = {
        "title": archive.title,
        "revision": archive.revision,
        "provenance": to_json_types(archive.provenance),
        "diagnoses": {name: _table_to_json(table) for name, table in archive.diagnoses.items()},
        "cases": list(keys),
        "paper": archive.paper,
    }
    if archive.tunings:
        head["tunings"] = to_json_types(archive.tunings)

    def fill(file: h5py.File) -> None:
        _write_document(file, head)
        if archive.chapters:
            file.create_dataset(
                "chapters",
                data=np.frombuffer(archive.chapters, np.uint8),
                compression="gzip",
                compression_opts=6,
            )
        for key, result in zip(keys, archive.results, strict=True):
            _write_result(file.create_group(key), result, Path(path).parent)

    Path(path).write_bytes(encode_hdf5(fill))


def read_archive(path: str | os.PathLike) -> Archive:
    """Read a ``results.nc``.

    Parameters
    ----------
    path : path
        The file, or the folder of a report.

    Raises
    ------
    FileNotFoundError
        No such file.
    SchemaError
        The file is not a ``results.nc`` of `pom.write_report`, or it is damaged.
    """
    path = Path(path)
    if path.is_dir():
        path = path / "results.nc"
    if not path.is_file():
        raise FileNotFoundError(
            2, "no results here; give the folder of a report or its results.nc", str(path)
        )
    if path.suffix == ".json":
        raise SchemaError(
            str(path),
            [
                f"a report is read from its results.nc, not from {path.name}; give the folder "
                f"{path.parent}"
            ],
        )
    demand_self_contained(path)
    try:
        with h5py.File(path, "r") as file:
            head = _read_document(file)
            results = [_read_result(file[key], path.parent) for key in head["cases"]]
            # a report without further chapters has no such dataset
            chapters = b""
            if isinstance(file.get("chapters"), h5py.Dataset):
                chapters = file["chapters"][()].tobytes()
    except AeromatchError:
        raise
    except Exception as error:
        # HDF5 raises errors of many types for a damaged file, and so do its contents
        raise SchemaError(
            str(path),
            [f"not a results.nc of a report, or damaged ({error}); write the report again"],
        ) from error
    diagnoses = {name: _table_from_json(table) for name, table in head["diagnoses"].items()}
    return Archive(
        results,
        head["title"],
        revision=head["revision"],
        provenance=head["provenance"],
        diagnoses=diagnoses,
        paper=head.get("paper"),
        tunings=head.get("tunings", {}),
        chapters=chapters,
    )


def _write_result(group: h5py.Group, result: PomResult, folder: Path) -> None:
    """Write one result into its group."""
    parts: dict[str, xr.Dataset] = {part: getattr(result, part) for part in _NAMES}
    attrs, channel_attrs = {}, {}
    for part, data in parts.items():
        attrs[part] = data.attrs
        channel_attrs[part] = {str(name): data.variables[name].attrs for name in data.data_vars}
    head: dict[str, Any] = {
        "case": case_seen_from(result.case, folder).to_dict(),
        "conditions": result.conditions,
        "failure": result.failure,
        "trim": to_split_dict(result.trim),
        "verdict": result.verdict_records(),
        "attrs": attrs,
        "channels": channel_attrs,
    }
    if result.samples:
        head["samples"] = {run: replay.document() for run, replay in result.samples.items()}
    _write_document(group, head)
    run = _write_scale(group, "run", [str(name) for name in result.signals["run"].values])
    time = _write_scale(group, "time", result.signals["time"].values)
    for number, replay in enumerate(result.samples.values()):
        _write_fan(group, number, replay.fan, time)
    # The bytes of the file depend on when HDF5 objects are closed, so this loop keeps its handles.
    for part, data in parts.items():
        names = _write_scale(group, _NAMES[part], list(channel_attrs[part]))
        # Inputs may have another time base than the signals.
        clock = time
        if not np.array_equal(data["time"].values, result.signals["time"].values):
            clock = _write_scale(group, f"{_NAMES[part]}_time", data["time"].values)
        # Signals (channel, run, time) become (run, channel, time); other parts have no runs.
        axes = [run, names, clock] if part == "signals" else [names, clock]
        channels = [data.variables[name].values for name in data.data_vars]
        shape = [len(axis) for axis in axes if axis is not names]
        values = np.array(channels, float).reshape(-1, *shape)
        table = group.create_dataset(
            part, data=np.moveaxis(values, 0, axes.index(names)), **_compression(values)
        )
        for i, axis in enumerate(axes):
            table.dims[i].attach_scale(axis)


def _write_fan(group: h5py.Group, number: int, fan: xr.Dataset, time: h5py.Dataset) -> None:
    """Write the quantiles of the draws of one model, ``fan0(fan0_channel, quantile, time)``."""
    names = _write_scale(group, f"fan{number}_channel", list(map(str, fan.data_vars)))
    quantile = _write_scale(group, f"fan{number}_quantile", fan["quantile"].values)
    # the shape is stated, since an empty fan has no variables
    samples = np.array([item.values for item in fan.data_vars.values()], float)
    values = samples.reshape(-1, len(quantile), len(time))
    table = group.create_dataset(f"fan{number}", data=values, **_compression(values))
    for i, axis in enumerate((names, quantile, time)):
        table.dims[i].attach_scale(axis)


def _compression(values: np.ndarray) -> dict[str, Any]:
    # HDF5 does not compress an empty table.
    if not values.size:
        return {}
    return {"compression": "gzip", "compression_opts": 1, "shuffle": True}


def _write_scale(group: h5py.Group, name: str, values: Any) -> h5py.Dataset:
    """Write the coordinate along a dimension."""
    # A list holds names, an array numbers.
    if isinstance(values, list):
        data, dtype = np.array(values, object), h5py.string_dtype(encoding="utf-8")
    else:
        data, dtype = np.array(values, float), float
    scale = group.create_dataset(name, data=data, dtype=dtype)
    scale.make_scale(name)
    return scale


def _read_result(group: h5py.Group, folder: Path) -> PomResult:
    head = _read_document(group)
    # the keys of `to_split_dict`: data, index, columns
    trim = pd.DataFrame(**head["trim"], dtype=float)
    # JSON stores NaN as null, which becomes NaN in an array of floats.
    conditions = head["conditions"]
    values = np.array(list(conditions.values()), float)
    conditions = dict(zip(conditions, values.tolist(), strict=True))
    samples = {}
    for number, (run, item) in enumerate(head.get("samples", {}).items()):
        # fans are numbered in the order of their models
        samples[run] = SampledReplay.of_document(item, _read_fan(group, number))
    return PomResult(
        case=case_found_from(PomCase.from_dict(head["case"]), folder),
        conditions=conditions,
        trim=trim.rename_axis("quantity"),
        verdict=make_verdict_table(head["verdict"]),
        failure=head["failure"],
        signals=_read_part(group, head, "signals"),
        tolerance=_read_part(group, head, "tolerance"),
        inputs=_read_part(group, head, "inputs"),
        samples=samples,
    )


def _read_fan(group: h5py.Group, number: int) -> xr.Dataset:
    values, names = group[f"fan{number}"][()], group[f"fan{number}_channel"].asstr()[()]
    coords = {"quantile": group[f"fan{number}_quantile"][()], "time": group["time"][()]}
    variables = {name: (("quantile", "time"), values[k]) for k, name in enumerate(names)}
    return xr.Dataset(variables, coords)


def _read_part(group: h5py.Group, head: Mapping[str, Any], part: str) -> xr.Dataset:
    values, names = group[part][()], list(group[_NAMES[part]].asstr()[()])
    clock = f"{_NAMES[part]}_time"
    if clock not in group:
        clock = "time"
    coords: dict[str, Any] = {"time": group[clock][()]}
    if not np.all(np.isfinite(coords["time"])) or np.any(np.diff(coords["time"]) < 0.0):
        raise ValueError(f"{group.name}/{clock} is not a rising time")
    dims: tuple[str, ...] = ("time",)
    if part == "signals":
        coords["run"] = list(group["run"].asstr()[()])
        dims = ("run", "time")
    attrs = head["channels"][part]
    variables = {}
    for i, name in enumerate(names):
        # the axis of the channels is the last but one, behind the runs
        variables[name] = (dims, values[..., i, :], attrs[name])
    return xr.Dataset(variables, coords, head["attrs"][part])


def _write_document(group: h5py.Group, item: Mapping[str, Any]) -> None:
    text = json.dumps(to_json_types(item), ensure_ascii=False, separators=(",", ":"))
    group.create_dataset("document", data=text, dtype=h5py.string_dtype(encoding="utf-8"))


def _read_document(group: h5py.Group) -> dict[str, Any]:
    return json.loads(group["document"].asstr()[()])


def _table_to_json(table: pd.DataFrame) -> dict[str, Any]:
    return {
        "columns": [str(name) for name in table.columns],
        "rows": to_json_types(table.to_numpy(object).tolist()),
    }


def _table_from_json(item: Mapping[str, Any]) -> pd.DataFrame:
    table = pd.DataFrame(item["rows"], columns=item["columns"])
    # A column of numbers may hold nulls only, so every column without a text is one of numbers.
    numbers = []
    for name in table.columns:
        if not table[name].map(lambda value: isinstance(value, str)).any():
            numbers.append(name)
    return table.astype(dict.fromkeys(numbers, float)).rename(columns=_rename_column)


def _rename_column(column: str) -> str:
    """Return the present name of a column; earlier versions wrote ``closes`` and ``miss``."""
    name, blank, quantity = column.rpartition(" ")
    return name + blank + {"closes": "explained", "miss": "mismatch"}.get(quantity, quantity)


class Custody:
    """Hashes of input files, computed before the files are read.

    A file may be replaced or edited while a batch runs, even for a moment.  Its hash would then not
    belong to the results.  `check` finds such a file before anything is written.

    Examples
    --------
    >>> custody = Custody()
    >>> custody.take([__file__])
    >>> custody.check()
    """

    def __init__(self) -> None:
        self._taken: dict[Path, tuple[FileState, str]] = {}

    def take(self, files: Iterable[str | Path]) -> None:
        """Hash files that are about to be read.  Files hashed before keep their first hash.

        Raises
        ------
        FileNotFoundError
        """
        for file in files:
            path = Path(file).resolve()
            if path not in self._taken:
                # The state comes first, so that `check` finds a change during the hashing.
                state = FileState.of(path)
                self._taken[path] = state, file_sha256(path)

    def sha256(self, file: str | Path) -> str:
        """Return the recorded hash of a file.  If none was recorded, compute it now."""
        self.take([file])
        return self._taken[Path(file).resolve()][1]

    def check(self, files: Iterable[str | Path] | None = None) -> None:
        """Compare files with their recorded state; by default all recorded files.

        Raises
        ------
        SchemaError
            With every file that changed or was deleted.
        """
        paths = list(self._taken)
        if files is not None:
            paths = [Path(file).resolve() for file in files]
        problems = []
        for path in paths:
            state, _ = self._taken[path]
            try:
                same = FileState.of(path) == state
            except OSError:
                same = False
            if not same:
                problems.append(
                    f"{path} changed while the batch ran; nothing was written, run it again"
                )
        if problems:
            raise SchemaError("inputs", problems)

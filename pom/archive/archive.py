"""``results.nc``: whole results in exact doubles, one group per case, readable by any netCDF-4 or
HDF5 tool.

Layout: the text ``document`` of the root is JSON (title, revision, provenance, diagnoses, logs of
tunings, order of the cases); the group of a case holds ``signals(run, channel, time)``,
``tolerance(banded, time)`` and ``inputs(input, time)`` with the names along these dimensions, and
its own ``document`` (case, conditions, trim, verdicts, failure).  Models flown with draws have
``samples`` in that document and their quantiles in ``fan0(channel, quantile, time)`` and so on.  SI
and radians; the verdicts are in the unit of the tolerance table.  Files are named from the folder
of the report.  Few large variables instead of many small ones: a hundred cases are read in seconds.
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

from flightmech.errors import SchemaError
from flightmech.support.console import to_json_types
from flightmech.support.hdf5_seal import demand_self_contained
from pom.archive.origins import case_found_from, case_seen_from, file_sha256
from pom.cases.case import PomCase
from pom.fmu.run_cache import FileState
from pom.result import PomResult, make_verdict_table, to_split_dict
from pom.samples import SampledReplay

_NAMES = {
    "signals": "channel",
    "tolerance": "banded",
    "inputs": "input",
}  # part of a result -> the dimension of its names


@dataclass(frozen=True)
class Archive:
    """What ``results.nc`` holds.

    Attributes
    ----------
    results : list of PomResult
        As judged, exact.
    title, revision : str
        Of the report.
    provenance : dict
        As given to `pom.write_report`, without places on a disk.
    diagnoses : dict of str to DataFrame
        Case name to the table of `pom.diagnose`.
    paper : str or None
        Of ``report.pdf``, empty without one; None: not stated.
    tunings : dict of str to dict
        Name of a model to the log of its tuning (`pom.tuning_content.Tuning.document`).
    chapters : bytes
        What the report shows in addition to its cases, as it draws it (`pom.report.chapters`);
        empty where it shows nothing.
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
    """Write ``results.nc``; `keys` names the group of every result.  Equal input gives equal bytes."""
    head = {
        "title": archive.title,
        "revision": archive.revision,
        "provenance": to_json_types(archive.provenance),
        "diagnoses": {name: _table_to_json(table) for name, table in archive.diagnoses.items()},
        "cases": list(keys),
        "paper": archive.paper,
        **({"tunings": to_json_types(archive.tunings)} if archive.tunings else {}),
    }
    with h5py.File(path, "w") as file:
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


def read_archive(path: str | os.PathLike) -> Archive:
    """Read ``results.nc``, or that of the folder of a report.

    Raises
    ------
    FileNotFoundError
        No such file.
    SchemaError
        The file is not a ``results.nc`` of `pom.write_report`, or it is damaged.
    """
    path = Path(path)
    path = path / "results.nc" if path.is_dir() else path
    if not path.is_file():
        raise FileNotFoundError(
            2, "no results here; give the folder of a report or its results.nc", str(path)
        )
    demand_self_contained(path)
    try:
        with h5py.File(path, "r") as file:
            head = _read_document(file)
            results = [_read_result(file[key], path.parent) for key in head["cases"]]
            chapters = (
                file["chapters"][()].tobytes()
                if isinstance(file.get("chapters"), h5py.Dataset)
                else b""
            )
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise SchemaError(
            str(path),
            [f"not a results.nc of a report, or damaged ({error}); write the report again"],
        ) from error
    diagnoses = {name: _table_from_json(table) for name, table in head["diagnoses"].items()}
    about = (head["title"], head["revision"], head["provenance"])
    return Archive(results, *about, diagnoses, head.get("paper"), head.get("tunings", {}), chapters)


def _write_result(group: h5py.Group, result: PomResult, folder: Path) -> None:
    parts: dict[str, xr.Dataset] = {part: getattr(result, part) for part in _NAMES}
    head: dict[str, Any] = {
        "case": case_seen_from(result.case, folder).to_dict(),
        "conditions": result.conditions,
        "failure": result.failure,
        "trim": to_split_dict(result.trim),
        "verdict": result.verdict_records(),
        "attrs": {part: data.attrs for part, data in parts.items()},
        "channels": {
            part: {str(name): data.variables[name].attrs for name in data.data_vars}
            for part, data in parts.items()
        },
    }
    if result.samples:
        head["samples"] = {run: found.document() for run, found in result.samples.items()}
    _write_document(group, head)
    run = _scale(group, "run", [str(name) for name in result.signals["run"].values])
    time = _scale(group, "time", result.signals["time"].values)
    for number, found in enumerate(result.samples.values()):
        _write_fan(group, number, found.fan, time)
    for part, data in parts.items():
        names = _scale(group, _NAMES[part], list(head["channels"][part]))
        own = np.array_equal(data["time"].values, result.signals["time"].values)
        clock = time if own else _scale(group, f"{_NAMES[part]}_time", data["time"].values)
        axes = [run, names, clock] if part == "signals" else [names, clock]
        channels = [data.variables[name].values for name in data.data_vars]
        values = np.array(channels, float).reshape(-1, *(len(a) for a in axes if a is not names))
        table = group.create_dataset(
            part, data=np.moveaxis(values, 0, axes.index(names)), **_squeeze(values)
        )
        for i, axis in enumerate(axes):
            table.dims[i].attach_scale(axis)


def _write_fan(group: h5py.Group, number: int, fan: xr.Dataset, time: h5py.Dataset) -> None:
    """Write the quantiles of the draws of one model: ``fan0(fan0_channel, quantile, time)`` and so
    on, in the order of the models.
    """
    names = _scale(group, f"fan{number}_channel", list(map(str, fan.data_vars)))
    quantile = _scale(group, f"fan{number}_quantile", fan["quantile"].values)
    values = np.array([item.values for item in fan.data_vars.values()], float).reshape(
        -1, len(quantile), len(time)
    )
    table = group.create_dataset(f"fan{number}", data=values, **_squeeze(values))
    for i, axis in enumerate((names, quantile, time)):
        table.dims[i].attach_scale(axis)


def _squeeze(values: np.ndarray) -> dict[str, Any]:
    return {"compression": "gzip", "compression_opts": 1, "shuffle": True} if values.size else {}


def _scale(group: h5py.Group, name: str, values: Any) -> h5py.Dataset:
    """Write the coordinate along a dimension."""
    kind = h5py.string_dtype(encoding="utf-8") if isinstance(values, list) else float
    scale = group.create_dataset(
        name, data=np.array(values, object if isinstance(values, list) else float), dtype=kind
    )
    scale.make_scale(name)
    return scale


def _read_result(group: h5py.Group, folder: Path) -> PomResult:
    head = _read_document(group)
    trim = pd.DataFrame(
        head["trim"]["data"], head["trim"]["index"], head["trim"]["columns"], dtype=float
    )
    return PomResult(
        case=case_found_from(PomCase.from_dict(head["case"]), folder),
        conditions={
            name: float("nan") if value is None else float(value)
            for name, value in head["conditions"].items()
        },
        trim=trim.rename_axis("quantity"),
        verdict=make_verdict_table(head["verdict"]),
        failure=head["failure"],
        signals=_read_part(group, head, "signals"),
        tolerance=_read_part(group, head, "tolerance"),
        inputs=_read_part(group, head, "inputs"),
        samples={
            run: SampledReplay.of_document(item, _read_fan(group, k))
            for k, (run, item) in enumerate(head.get("samples", {}).items())
        },
    )


def _read_fan(group: h5py.Group, number: int) -> xr.Dataset:
    values, names = group[f"fan{number}"][()], group[f"fan{number}_channel"].asstr()[()]
    coords = {"quantile": group[f"fan{number}_quantile"][()], "time": group["time"][()]}
    return xr.Dataset(
        {name: (("quantile", "time"), values[k]) for k, name in enumerate(names)}, coords
    )


def _read_part(group: h5py.Group, head: Mapping[str, Any], part: str) -> xr.Dataset:
    values, names = group[part][()], list(group[_NAMES[part]].asstr()[()])
    clock = f"{_NAMES[part]}_time"
    coords: dict[str, Any] = {"time": group[clock if clock in group else "time"][()]}
    if part == "signals":
        coords["run"] = list(group["run"].asstr()[()])
    dims = ("run", "time") if part == "signals" else ("time",)
    attrs = head["channels"][part]
    return xr.Dataset(
        {name: (dims, values[..., i, :], attrs[name]) for i, name in enumerate(names)},
        coords,
        head["attrs"][part],
    )


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
    numbers = [
        name
        for name in table.columns
        if not table[name].map(lambda value: isinstance(value, str)).any()
    ]
    return table.astype(dict.fromkeys(numbers, float)).rename(
        columns=_renamed
    )  # a column without any number came as nulls


def _renamed(column: str) -> str:
    """Return a column of a diagnosis by its present name; files of earlier versions hold ``closes``
    and ``miss``.
    """
    name, blank, quantity = column.rpartition(" ")
    return name + blank + {"closes": "explained", "miss": "mismatch"}.get(quantity, quantity)


class Custody:
    """Files with their hashes, taken before they are read.

    A file that is replaced or edited while a batch runs, even for a moment, would lend its hash to
    results of another content; `check` finds it before anything is written.

    Examples
    --------
    >>> custody = Custody()
    >>> custody.take([__file__])
    >>> custody.check()
    """

    def __init__(self) -> None:
        self._taken: dict[Path, tuple[FileState, str]] = {}

    def take(self, files: Iterable[str | Path]) -> None:
        """Hash files that are about to be read; those taken before keep their first hash.

        Raises
        ------
        FileNotFoundError
        """
        for path in (Path(file).resolve() for file in files):
            if path not in self._taken:
                state = FileState.of(
                    path
                )  # first: what changes while it is hashed is found by `check`
                self._taken[path] = state, file_sha256(path)

    def sha256(self, file: str | Path) -> str:
        """Return the hash that a file had when it was taken; one that was not is taken now."""
        self.take([file])
        return self._taken[Path(file).resolve()][1]

    def check(self, files: Iterable[str | Path] | None = None) -> None:
        """Compare files, all that were taken unless given, with what they were.

        Raises
        ------
        SchemaError
            With every file that changed or is gone.
        """
        problems = []
        for path in self._taken if files is None else [Path(file).resolve() for file in files]:
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

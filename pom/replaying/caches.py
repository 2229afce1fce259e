"""Results kept next to the flights of a batch, so that a batch that goes on judges only what
changed.

A result is a function of its case, the flight, the models, the evidence and the program.  Their
hash names the file, so that one that is there needs neither its record nor a fit; whatever changed
has another name and is judged anew.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import xarray as xr

import flightmech
import flighttest
from flightmech.support.atomic_write import written_atomically
from flightmech.support.kept_stages.content_hashes import content_hash
from flighttest.records.stored_groups import plain_group
from pom.cases.case import PomCase
from pom.cases.reference_states import recorded_states
from pom.fmu.run_cache import FileState
from pom.fmu.simulate import FmuModel
from pom.judging.measures.modal import keep_modes, mode_table
from pom.result import PomResult, make_verdict_table, to_records, to_split_dict


@dataclass(frozen=True)
class KeptStates:
    """Reconstructed states of raw records.

    Attributes
    ----------
    folder : Path or None
        Keeps them under the hash of the record, of its name map, of the aircraft with all that its
        file names, of the biases and of the programs that reconstruct; without it nothing is kept.
    biases : Dataset or None
        Constants of the instruments (`recorded_states`).
    """

    folder: Path | None
    biases: xr.Dataset | None
    _aircraft: dict[str, flightmech.Aircraft] = field(
        default_factory=dict, repr=False
    )  # read once in a batch

    def read(self, case: PomCase) -> xr.Dataset | None:
        """Return the states of the record of a case; None when they are not kept."""
        file = self._file(case)
        if file is None or not file.is_file():
            return None
        with h5py.File(file, "r") as content:
            states = plain_group(content)
        return xr.load_dataset(file, engine="h5netcdf") if states is None else states

    def make(self, case: PomCase) -> xr.Dataset:
        """Reconstruct the record of a case and keep its states.

        Raises
        ------
        SchemaError, IdentificationError
            As `recorded_states`.
        """
        states, file = recorded_states(case, self.biases), self._file(case)
        if file is not None:
            file.parent.mkdir(parents=True, exist_ok=True)
            with written_atomically(file) as part:
                states.to_netcdf(part, engine="h5netcdf")
        return states

    def identity(self, case: PomCase) -> str:
        """Return the hash of all that the states of the record of a case come from, but for the
        windows of its cases.
        """
        if case.aircraft and case.aircraft not in self._aircraft:
            self._aircraft[case.aircraft] = flightmech.read_aircraft(case.aircraft)
        files = [
            hashlib.sha256(Path(name).read_bytes() if name else b"").hexdigest()
            for name in (case.record, case.names)
        ]
        return content_hash(
            reconstruction_digest(), files, self._aircraft.get(case.aircraft), self.biases
        )

    def _file(self, case: PomCase) -> Path | None:
        if self.folder is None or not case.aircraft:
            return None
        return self.folder / "states" / f"{self.identity(case)}.nc"


@cache
def reconstruction_digest() -> str:
    """Return the hash of the modules that read and reconstruct, with the versions of the libraries
    they count with.
    """
    digest = hashlib.sha256()
    for package in (flightmech, flighttest):
        folder = Path(str(package.__file__)).parent
        for file in sorted(folder.rglob("*.py")):
            digest.update(file.read_bytes())
    return " ".join(
        [digest.hexdigest(), *(f"{name} {version(name)}" for name in ("numpy", "scipy", "xarray"))]
    )


_PARTS = {
    "signals": ("run", "time"),
    "tolerance": ("time",),
    "inputs": ("time",),
}  # with the dimensions of their channels


@dataclass(frozen=True)
class ResultKeys:
    """Names of the results of one batch, by all that they depend on.

    Attributes
    ----------
    records : KeptStates
        Of the records that are read.
    program : str
        What decides the last bit of a result (`pom.replaying.batch.installation`).
    evidence : DataTree or None
        What flight found.
    """

    records: KeptStates
    program: str
    evidence: xr.DataTree | None = None
    _hashes: dict[Any, str] = field(
        default_factory=dict, repr=False
    )  # of what the cases of a batch share
    _states: dict[str, FileState] = field(
        default_factory=dict, repr=False
    )  # of files, before they were read

    def of(self, case: PomCase, path: Any, models: Mapping[str, FmuModel]) -> str:
        """Return the name of the result of a case; empty when one of its files cannot be read,
        which whoever reads it reports.

        Parameters
        ----------
        case : PomCase
        path : Path or Dataset or None
            As given to `pom.replay_all`; None for a record that is read.
        models : mapping of str to Model
        """
        read = path is None or case.wind == "measured"  # a path holds no measured wind
        try:
            self._states.update(
                {
                    name: FileState.of(name)
                    for name in _files(case)
                    if read and name not in self._states
                }
            )
            record = (
                self._once(
                    (case.record, case.names, case.aircraft), lambda: self.records.identity(case)
                )
                if read
                else ""
            )
        except OSError:
            return ""
        given = "" if path is None else self._once(id(path), lambda: _of_path(path))
        flown = [
            (name, _described(model), None if model.law is None else _described(model.law))
            for name, model in models.items()
        ]
        return content_hash(
            self.program,
            case,
            record,
            given,
            flown,
            self._once("evidence", lambda: _of_tree(self.evidence)),
        )

    def hold(self, case: PomCase) -> bool:
        """Whether the files of a case are those whose content the name of its result was made of;
        else it may be kept under no name.
        """
        try:
            return all(
                FileState.of(name) == self._states[name]
                for name in _files(case)
                if name in self._states
            )
        except OSError:
            return False

    def _once(self, what: Any, make: Callable[[], str]) -> str:
        if what not in self._hashes:
            self._hashes[what] = make()
        return self._hashes[what]


@dataclass(frozen=True)
class KeptResults:
    """Results by key, one file each, written atomically and checked when they are read.

    Attributes
    ----------
    folder : Path or None
        Made when it is missing; None: nothing is kept.
    """

    folder: Path | None

    def read(self, key: str) -> PomResult | None:
        """Return what is kept under a key; None when nothing is, a damaged file, or under no key."""
        file = self._file(key)
        try:
            content = b"" if file is None else file.read_bytes()
        except OSError:
            return None
        digest, body = content[:_DIGEST], content[_DIGEST:]
        if hashlib.sha256(body).digest() != digest:
            return None
        text, _, numbers = body.partition(b"\n")
        return _result(json.loads(text), np.frombuffer(numbers, "<f8").astype(float))

    def write(self, key: str, result: PomResult) -> None:
        """Keep a result under a key; none under an empty one."""
        file = self._file(key)
        if file is None:
            return
        head, blocks = _content(result)
        body = (
            json.dumps(head, default=_plain, ensure_ascii=False).encode()
            + b"\n"
            + b"".join(block.tobytes() for block in blocks)
        )
        file.parent.mkdir(parents=True, exist_ok=True)
        with written_atomically(file, durable=False) as part:
            part.write_bytes(hashlib.sha256(body).digest() + body)

    def _file(self, key: str) -> Path | None:
        return None if self.folder is None or not key else self.folder / "results" / key[:2] / key


_DIGEST = hashlib.sha256().digest_size


def _files(case: PomCase) -> list[str]:
    return [name for name in (case.record, case.names, case.aircraft) if name]


def _described(model: FmuModel) -> list[str]:
    return [model.origin(), model.links.table]


def _of_path(path: Any) -> str:
    return (
        content_hash(path)
        if isinstance(path, xr.Dataset)
        else content_hash(path.states, path.biases, path.errors)
    )


def _of_tree(tree: xr.DataTree | None) -> str:
    return (
        ""
        if tree is None
        else content_hash({node.path: node.to_dataset() for node in tree.subtree})
    )


def _content(result: PomResult) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Return what JSON holds of a result to the last bit, and the samples behind it."""
    head: dict[str, Any] = {
        "case": result.case.to_dict(),
        "conditions": result.conditions,
        "failure": result.failure,
        "trim": to_split_dict(result.trim),
        "verdict": result.verdict_records(),
        "modes": to_records(mode_table(result)),
        "runs": [str(run) for run in result.signals["run"].values],
        "parts": {},
    }
    blocks = []
    for part in _PARTS:
        data: xr.Dataset = getattr(result, part)
        channels = {str(name): data.variables[name].attrs for name in data.data_vars}
        head["parts"][part] = {
            "attrs": data.attrs,
            "channels": channels,
            "samples": data.sizes["time"],
        }
        blocks += [
            data.variables[name].values.astype("<f8", copy=False) for name in ("time", *channels)
        ]
    return head, blocks


def _plain(item: Any) -> Any:
    """Return a number of NumPy as one of Python."""
    return item.item()


def _result(head: Mapping[str, Any], numbers: np.ndarray) -> PomResult:
    """Return the result that `_content` was made of."""
    runs, at = head["runs"], 0

    def taken(*shape: int) -> np.ndarray:
        nonlocal at
        first, at = at, at + int(np.prod(shape))
        return numbers[first:at].reshape(shape)

    parts: dict[str, Any] = {}
    for part, dims in _PARTS.items():
        found = head["parts"][part]
        time = taken(found["samples"])
        shape = (len(runs), len(time)) if len(dims) == 2 else (len(time),)
        data = {name: (dims, taken(*shape), attrs) for name, attrs in found["channels"].items()}
        parts[part] = xr.Dataset(
            data, {**({"run": runs} if len(dims) == 2 else {}), "time": time}, found["attrs"]
        )
    trim = head["trim"]
    result = PomResult(
        case=PomCase.from_dict(head["case"]),
        conditions=head["conditions"],
        trim=pd.DataFrame(
            trim["data"], pd.Index(trim["index"], name="quantity"), trim["columns"], dtype=float
        ),
        verdict=make_verdict_table(head["verdict"]),
        failure=head["failure"],
        **parts,
    )
    keep_modes(result, head["modes"])
    return result

"""Stored states of records and stored results of cases, for a batch that is continued.

A result is a function of its case, the flight, the models, the evidence and the program. The hash
of all of them is the name of its file. A stored result is read without its record and without a
fit. Any change gives another name, and the case is judged again.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import xarray as xr

import flightmech
from flightmech.support.array_files.netcdf_writing import write_netcdf
from flightmech.support.atomic_write import written_atomically
from flightmech.support.hdf5_seal import decoding_errors
from flightmech.support.input_files import file_sha256
from flightmech.support.kept_stages.checked_files import read_checked, write_checked
from flightmech.support.kept_stages.content_hashes import content_hash
from flightmech.support.kept_stages.program import hash_installation
from flighttest.records.stored_groups import plain_group
from pom.cases.case import PomCase
from pom.cases.reference_states import recorded_states
from pom.fmu.models import FmuModel
from pom.fmu.run_cache import FileState
from pom.judging.measures.modal import keep_modes, mode_table
from pom.result import PomResult, make_verdict_table, to_records, to_split_dict


@dataclass(frozen=True)
class KeptStates:
    """Reconstructed states of raw records.

    Attributes
    ----------
    folder : Path or None
        Folder of the stored states; nothing is stored without it. The name of a file is the hash
        of the record, of its name map, of the aircraft with all files that it names, of the biases
        and of the program.
    biases : Dataset or None
        Constants of the instruments (`recorded_states`).
    """

    folder: Path | None
    biases: xr.Dataset | None
    # Aircraft by file: each is read once in a batch.
    _aircraft: dict[str, flightmech.Aircraft] = field(default_factory=dict, repr=False)

    def read(self, case: PomCase) -> xr.Dataset | None:
        """Return the stored states of the record of a case; None if there are none."""
        file = self._file(case)
        if file is None or not file.is_file():
            return None
        with decoding_errors(file, "states of a record that this command kept; remove the file"):
            with h5py.File(file, "r") as content:
                states = plain_group(content)
            if states is None:
                states = xr.load_dataset(file, engine="h5netcdf", phony_dims="access")
        return states

    def make(self, case: PomCase) -> xr.Dataset:
        """Reconstruct the record of a case and store its states.

        Raises
        ------
        SchemaError, IdentificationError
            As `recorded_states`.
        """
        states, file = recorded_states(case, self.biases), self._file(case)
        if file is not None:
            file.parent.mkdir(parents=True, exist_ok=True)
            with written_atomically(file) as part:
                write_netcdf(states, part)
        return states

    def identity(self, case: PomCase) -> str:
        """Return the hash of all inputs of the states of a record.

        The windows of the cases are not among them.
        """
        if case.aircraft and case.aircraft not in self._aircraft:
            self._aircraft[case.aircraft] = flightmech.read_aircraft(case.aircraft)
        files = [file_sha256(name) if name else "" for name in (case.record, case.names)]
        aircraft = self._aircraft.get(case.aircraft)
        return content_hash(hash_installation(), files, aircraft, self.biases)

    def _file(self, case: PomCase) -> Path | None:
        if self.folder is None or not case.aircraft:
            return None
        return self.folder / "states" / f"{self.identity(case)}.nc"


@dataclass(frozen=True)
class ResultKeys:
    """Names of the results of one batch: hashes of all their inputs.

    Attributes
    ----------
    records : KeptStates
        Identities of the records that are read.
    program : str
        Hash of all that determines the last bit of a result, as from `hash_installation`.
    evidence : DataTree or None
        Database identified from flight.
    """

    records: KeptStates
    program: str
    evidence: xr.DataTree | None = None
    # Hashes of the inputs that several cases share.
    _hashes: dict[Any, str] = field(default_factory=dict, repr=False)
    # States of the files before they were read.
    _states: dict[str, FileState] = field(default_factory=dict, repr=False)

    def of(self, case: PomCase, path: Any, models: Mapping[str, FmuModel]) -> str:
        """Return the name of the result of a case.

        It is empty if a file of the case cannot be read. The replay then reports the file.

        Parameters
        ----------
        case : PomCase
        path : Path or Dataset or None
            As in `pom.replay_all`; None for a record that is read.
        models : mapping of str to Model
        """
        record = ""
        # A path does not contain a measured wind, which is read from the record.
        if path is None or case.wind == "measured":
            try:
                self._note_states(case)
                record = self._hash_once(
                    (case.record, case.names, case.aircraft), lambda: self.records.identity(case)
                )
            except OSError:
                return ""
        path_hash = ""
        if path is not None:
            path_hash = self._hash_once(id(path), lambda: _hash_path(path))
        described = [_describe_with_law(name, model) for name, model in models.items()]
        evidence = self._hash_once("evidence", lambda: _hash_tree(self.evidence))
        return content_hash(self.program, case, record, path_hash, described, evidence)

    def _note_states(self, case: PomCase) -> None:
        """Store the states of the files of a case before they are read."""
        new = [name for name in _files(case) if name not in self._states]
        # All states or none: the first missing file raises.
        self._states.update({name: FileState.of(name) for name in new})

    def hold(self, case: PomCase) -> bool:
        """Return whether the files of a case are unchanged since the name of its result was made.

        The result of a changed file must not be stored under this name.
        """
        try:
            for name in _files(case):
                if name in self._states and FileState.of(name) != self._states[name]:
                    return False
        except OSError:
            return False
        return True

    def _hash_once(self, key: Any, make: Callable[[], str]) -> str:
        if key not in self._hashes:
            self._hashes[key] = make()
        return self._hashes[key]


@dataclass(frozen=True)
class KeptResults:
    """Results by key, one checked file each.

    Attributes
    ----------
    folder : Path or None
        Created if it is missing; None: nothing is stored.
    """

    folder: Path | None

    def read(self, key: str) -> PomResult | None:
        """Return the result of a key; None without a file, for a damaged file or an empty key."""
        file = self._file(key)
        if file is None:
            return None
        content = read_checked(file)
        if content is None:
            return None
        text, _, numbers = bytes(content).partition(b"\n")
        return _read_result(json.loads(text), np.frombuffer(numbers, "<f8").astype(float))

    def write(self, key: str, result: PomResult) -> None:
        """Store a result under a key; nothing under an empty key."""
        file = self._file(key)
        if file is None:
            return
        head, blocks = _result_content(result)
        text = json.dumps(head, default=_to_python_number, ensure_ascii=False)
        file.parent.mkdir(parents=True, exist_ok=True)
        write_checked(file, text.encode(), b"\n", *[block.tobytes() for block in blocks])

    def _file(self, key: str) -> Path | None:
        if self.folder is None or not key:
            return None
        # Folders by the first two digits: a batch has thousands of results.
        return self.folder / "results" / key[:2] / key


def _files(case: PomCase) -> list[str]:
    return [name for name in (case.record, case.names, case.aircraft) if name]


def _describe(model: FmuModel) -> list[str]:
    return [model.origin(), model.links.table]


def _describe_with_law(name: str, model: FmuModel) -> tuple[str, list[str], list[str] | None]:
    """Return name and provenance of a model, and the provenance of its control law."""
    law = None
    if model.law is not None:
        law = _describe(model.law)
    return name, _describe(model), law


def _hash_path(path: Any) -> str:
    if isinstance(path, xr.Dataset):
        return content_hash(path)
    return content_hash(path.states, path.biases, path.errors)


def _hash_tree(tree: xr.DataTree | None) -> str:
    if tree is None:
        return ""
    return content_hash({node.path: node.to_dataset() for node in tree.subtree})


# Datasets of a result, with the dimensions of their channels.
_PARTS = {"signals": ("run", "time"), "tolerance": ("time",), "inputs": ("time",)}


def _result_content(result: PomResult) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Return the part of a result that JSON stores without a loss, and the blocks of samples."""
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
    blocks: list[np.ndarray] = []
    for part in _PARTS:
        data: xr.Dataset = getattr(result, part)
        channels = {str(name): data.variables[name].attrs for name in data.data_vars}
        head["parts"][part] = {
            "attrs": data.attrs,
            "channels": channels,
            "samples": data.sizes["time"],
        }
        # The time comes first, then the channels in the order of the head.
        for name in ("time", *channels):
            blocks.append(data.variables[name].values.astype("<f8", copy=False))
    return head, blocks


def _to_python_number(item: Any) -> Any:
    """Return a number of NumPy as one of Python."""
    return item.item()


class _SampleReader:
    """Arrays from the samples of a stored result, one after the other."""

    def __init__(self, numbers: np.ndarray):
        self.numbers = numbers
        self.position = 0

    def next_array(self, *shape: int) -> np.ndarray:
        """Return the next array of this shape."""
        start = self.position
        self.position += int(np.prod(shape))
        return self.numbers[start : self.position].reshape(shape)


def _read_result(head: Mapping[str, Any], numbers: np.ndarray) -> PomResult:
    """Return the result from the parts that `_result_content` returned."""
    runs, samples = head["runs"], _SampleReader(numbers)
    parts: dict[str, Any] = {}
    for part, dims in _PARTS.items():
        stored = head["parts"][part]
        time = samples.next_array(stored["samples"])
        coords: dict[str, Any] = {}
        shape: tuple[int, ...] = (len(time),)
        if "run" in dims:
            coords["run"] = runs
            shape = (len(runs), len(time))
        coords["time"] = time
        data = {}
        for name, attrs in stored["channels"].items():
            data[name] = (dims, samples.next_array(*shape), attrs)
        parts[part] = xr.Dataset(data, coords, stored["attrs"])
    trim = head["trim"]
    quantities = pd.Index(trim["index"], name="quantity")
    result = PomResult(
        case=PomCase.from_dict(head["case"]),
        conditions=head["conditions"],
        trim=pd.DataFrame(trim["data"], quantities, trim["columns"], dtype=float),
        verdict=make_verdict_table(head["verdict"]),
        failure=head["failure"],
        **parts,
    )
    # The modes are not fitted again.
    keep_modes(result, head["modes"])
    return result

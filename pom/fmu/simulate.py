"""One model through one job: canonical names and SI on this side, the variables and units of the FMU on the other."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from platform import machine
from typing import Any

import numpy as np

from flightmech.errors import SchemaError

from ..cases.case import PomCase
from ..cases.job import Job
from ..tolerances.parameter_channels import WRAPPED
from .content_hashes import content_hash
from .description import read_fmu
from .file_state import FileState
from .fmu_file import Fmu
from .process import hired
from .run_cache import Store
from .variable_map import Links, links_of
from .worker.frames import moved_controls

Found = dict[str, np.ndarray]


@dataclass(frozen=True)
class Model:
    """An FMU and how its variables are reached."""

    fmu: Fmu
    links: Links

    def origin(self) -> str:
        """Return file, version and hash, as the attributes of a result keep it."""
        kind = ", model exchange" if self.fmu.exchange else ""
        return f"{self.fmu.path.name}, FMI {self.fmu.version}{kind}, sha256 {self.fmu.sha256}"


class Models:
    """The models of a batch, read once; each case may bring tables of names of its own.

    Parameters
    ----------
    runs : mapping of str to path
        Name of a model to its FMU.
    names : mapping of str to path, optional
        Name of a model to its table of names (`links_of`); it goes before that of a case.

    Raises
    ------
    ParseError, FileNotFoundError
        No FMU.
    SchemaError
        A model with the name of the recording, ``flight``; a table for a model that is not there.
    """

    def __init__(self, runs: Mapping[str, str | Path], names: Mapping[str, str | Path] | None = None):
        self.names = {name: str(table) for name, table in (names or {}).items()}
        if "flight" in runs:
            raise SchemaError("models", ["flight is the name of the recording; give the model another one"])
        unknown = [name for name in self.names if name not in runs]
        if unknown:
            raise SchemaError("names", [f"{name}: no such model; there are {', '.join(runs)}" for name in unknown])
        self._fmus = {name: read_fmu(file) for name, file in runs.items()}
        self._links: dict[tuple[str, str | None], Links] = {}

    def of(self, case: PomCase) -> dict[str, Model]:
        """Return the models as they speak in a case.

        Raises
        ------
        ParseError, FileNotFoundError
            No table of names.
        SchemaError
            A table that does not fit its FMU.
        """
        tables = {**case.models, **self.names}
        return {name: Model(fmu, self._joined(name, tables.get(name))) for name, fmu in self._fmus.items()}

    def _joined(self, name: str, table: str | None) -> Links:
        if (name, table) not in self._links:
            self._links[name, table] = links_of(self._fmus[name], table)
        return self._links[name, table]


def fly(model: Model, job: Job, wanted: Collection[str], timeout: float, store: Store | None = None) -> tuple[Found, str]:
    """Fly a job by a model in its child process.

    Parameters
    ----------
    model : Model
    job : Job
    wanted : collection of str
        Canonical names of outputs; those that the model has are returned.
    timeout : float
        Wall time allowed. [s]
    store : Store, optional
        Where flights are kept; one that is there is not flown again.

    Returns
    -------
    found : dict of str to array (time,)
        Outputs by canonical name, and the controls that the math pilot moved; NaN where the run did not come. [SI]
    failure : str
        Empty when all went well.
    """
    outputs = [name for name in model.links.outputs if name in {*wanted, *job.targets}]
    time = _points(model.fmu, job.time)
    task = _task(model, job, outputs, time)
    key = content_hash(_program(), model.fmu.sha256, task) if store else ""
    columns, failure = store.read(key, (len(time), len(outputs) + len(moved_controls(task)))) if store else None, ""
    if columns is None:
        before = _as_read(model.fmu)
        with hired(model.fmu.path) as child:
            reply = child.run(task, timeout, model.fmu.once)
        columns, failure = np.column_stack([reply.outputs, *_moved(task, reply.moved)]), reply.error
        if before is None or _state(model.fmu) != before:  # what flew may be neither the file that was read nor the one that is there
            columns, failure = np.full_like(columns, np.nan), f"{model.fmu.path.name} changed after it was read; run the batch again"
        if store and not failure:
            store.write(key, columns)
    return _found(model, job, outputs, time, task, columns), failure


def _as_read(fmu: Fmu) -> FileState | None:
    """Return the state of an FMU that is the file that was read, on another machine of a cluster by its hash; None of another one."""
    state = _state(fmu)
    if state is None or state == fmu.state:
        return state
    return state if hashlib.sha256(fmu.path.read_bytes()).hexdigest() == fmu.sha256 else None


def _state(fmu: Fmu) -> FileState | None:
    try:
        return FileState.of(fmu.path)
    except OSError:
        return None


def _points(fmu: Fmu, time: np.ndarray) -> np.ndarray:
    """Return the communication points: the samples, or even steps for an FMU that takes no others. [s]"""
    if not fmu.even:
        return time
    step = fmu.step or float(np.median(np.diff(time)))
    return time[0] + step * np.arange(int(np.ceil((time[-1] - time[0]) / step - 1e-6)) + 1)


def _task(model: Model, job: Job, outputs: list[str], time: np.ndarray) -> dict[str, Any]:
    """Return the job as the worker takes it: names, units and signs of the FMU, at its communication points."""
    links = model.links

    def at_points(values: np.ndarray) -> np.ndarray:
        return values if time is job.time else np.interp(time, job.time, values)

    inputs = {
        links.inputs[name].variable: links.inputs[name].to_fmu(at_points(u)) for name, u in job.inputs.items() if name in links.inputs
    }
    parameters = {
        links.parameters[name].variable: links.parameters[name].to_fmu(value)
        for name, value in job.parameters.items()
        if name in links.parameters
    }
    inputs |= {name: np.full(len(time), value) for name, value in links.fixed.items() if name in model.fmu.inputs}
    parameters |= {name: value for name, value in links.fixed.items() if name not in model.fmu.inputs}
    task = {"time": time, "inputs": inputs, "parameters": parameters, "outputs": [links.outputs[name].variable for name in outputs]}
    if job.pilot:
        targets = {name: at_points(values) for name, values in job.targets.items()}
        task["pilot"] = {"targets": targets, **_hand(links, job, outputs, list(inputs))}
    return task


def _hand(links: Links, job: Job, outputs: list[str], inputs: list[str]) -> dict[str, Any]:
    """Return the loops of the math pilot, what they see (column, factor, offset to SI) and what they move (column, factor to SI)."""
    seen = {name: links.outputs[name] for name in job.targets}
    moved = {loop.control: links.inputs[loop.control] for loop in job.pilot}
    return {
        "loops": [asdict(loop) for loop in job.pilot],
        "sense": {name: (outputs.index(name), link.factor, link.offset) for name, link in seen.items()},
        "move": {name: (inputs.index(link.variable), link.factor) for name, link in moved.items()},
    }


def _moved(task: Mapping[str, Any], moved: Mapping[str, np.ndarray]) -> list[np.ndarray]:
    nothing = np.full(len(task["time"]), np.nan)
    return [moved.get(name, nothing) for name in moved_controls(task)]


def _found(model: Model, job: Job, outputs: list[str], time: np.ndarray, task: Mapping[str, Any], columns: np.ndarray) -> Found:
    """Return what was flown at the samples of the job, by canonical name and in SI."""
    found = {name: model.links.outputs[name].to_canonical(columns[:, i]) for i, name in enumerate(outputs)}
    if len(time) != len(job.time) or not np.array_equal(time, job.time):
        found = {name: _at_samples(name, values, time, job.time) for name, values in found.items()}
    for i, name in enumerate(moved_controls(task)):
        place = np.clip(np.searchsorted(time, job.time + 1e-9, side="right") - 1, 0, len(time) - 1)
        found[name] = job.inputs[name] + columns[place, len(outputs) + i]
    return found


def _at_samples(name: str, values: np.ndarray, time: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Return an output between the steps of its FMU, on straight lines; angles that jump are made continuous first."""
    if name in WRAPPED:
        known = np.isfinite(values)
        values = np.where(known, np.unwrap(np.where(known, values, 0.0)), np.nan)
    return np.interp(samples, time, values)


@cache
def _program() -> str:
    """Return what flies a job: the hash of its modules, the version of FMPy, the kind of machine."""
    here = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for file in [here / "cases" / "pilot.py", *sorted((here / "fmu" / "worker").glob("*.py"))]:
        digest.update(file.read_bytes())
    return f"{digest.hexdigest()} {version('fmpy')} {sys.platform} {machine()}"

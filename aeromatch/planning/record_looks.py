"""The looks at all records of a project: those that are kept are not taken again, the others are shared out to processes."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from importlib import import_module
from multiprocessing import get_context
from typing import Any

import xarray as xr

import pom
from flightmech import Aircraft
from flightmech.errors import AeromatchError, AeromatchWarning
from flightmech.support.kept_stages.stages import Kept, Stages, recorded
from flighttest.readers.name_map import read_names

from ..project import Project
from ..workflow import record_inputs, record_of
from .collecting import texts_of
from .record_look import LookTask, RecordLook, look_at

_WORTH_A_PROCESS = 4  # records per process

STATES = "states at start values"
"""Stage of the states of a record that a case replays: a changed case needs them, and they take longer than all else of its check."""


@dataclass
class _Found:
    """A look; record and states if they were made and shall be kept, and the texts of the warnings of reading the record."""

    look: RecordLook
    record: xr.DataTree | None = None
    states: xr.Dataset | None = None
    remarks: list[str] = field(default_factory=list)


class RecordLooks:
    """Looks at records, with the records themselves as stages of the match.

    Parameters
    ----------
    project : Project
    custody : Custody
        Of the files that are read.
    stages : Stages
    jobs : int
        Processes, where the system can fork; -1 for one per core.
    keep_records : bool
        Whether a match follows, which takes the records from the stages; to keep them takes longer than to look at them.
    """

    def __init__(self, project: Project, custody: pom.archive.Custody, stages: Stages, jobs: int, keep_records: bool) -> None:
        self._project, self._custody, self._stages = project, custody, stages
        self._keeps = keep_records and stages.store is not None
        self._jobs = jobs if jobs > 0 else os.cpu_count() or 1
        self._tasks: dict[str, LookTask] = {}
        self._names: Any = None
        self._aircraft: Kept[Aircraft] | None = None
        self._records: dict[str, dict[str, Any]] = {}

    def take(self, tasks: Sequence[LookTask], meanwhile: Callable[[], Any]) -> dict[str, RecordLook]:
        """Return the looks by record.

        Parameters
        ----------
        tasks : sequence of LookTask
        meanwhile : callable
            What this process does first, while others look at records.
        """
        self._tasks = {task.name: task for task in tasks}
        self._aircraft = self._stages.given(tasks[0].aircraft) if tasks else None
        unread: dict[str, RecordLook] = {}
        inputs = {}
        for task in tasks:
            try:
                self._records[task.name] = record_inputs(self._project, task.name, self._custody)
            except OSError as error:
                unread[task.name] = RecordLook(task.name, [f"record {task.name}: {text}" for text in texts_of(error)])
                continue
            assert self._aircraft is not None
            inputs[task.name] = {"record": self._records[task.name], **task.inputs(self._aircraft)}

        def compute(missing: list[str], put: Callable[..., None]) -> None:
            for found in self._looked(missing, meanwhile):
                self._keep(found)
                put(found.look.name, found.look, keep=not found.look.problems)  # a fault may be corrected without a trace in the inputs

        kept = self._stages.batch("record look", inputs, compute)
        return {task.name: kept[task.name].value if task.name in kept else unread[task.name] for task in tasks}

    def look(self, name: str) -> _Found:
        """Look at one record, in whatever process."""
        remarks: list[str] = []
        made: xr.DataTree | None = None
        kept = self._stages.recall("record", self._records[name], None)
        if kept is None:
            try:
                made, remarks = recorded(record_of, self._project, name, self._custody, self._names)
            except (AeromatchError, OSError) as error:
                return _Found(RecordLook(name, [f"record {name}: {text}" for text in texts_of(error)]))
        record: xr.DataTree = made if kept is None else kept  # type: ignore[assignment]
        known = self._stages.recall(STATES, self._of_states(name), None) if self._tasks[name].cases else None
        with warnings.catch_warnings():  # the reconstruction gives them again
            warnings.simplefilter("ignore", AeromatchWarning)
            look, states = look_at(self._tasks[name], record, known)
        new = states if self._tasks[name].cases and known is None else None
        return _Found(look, made, new, remarks) if self._keeps else _Found(look, remarks=remarks)

    def _of_states(self, name: str) -> dict[str, Any]:
        return {"record": self._records[name], "aircraft": self._aircraft}

    def _keep(self, found: _Found) -> None:
        """Keep a record and its states as the results of their stages, and give the warnings of reading the record."""

        def make() -> xr.DataTree | None:
            for text in found.remarks:
                warnings.warn(text, AeromatchWarning, stacklevel=2)
            return found.record

        name = found.look.name
        if found.record is None:
            make()
        else:
            self._stages.one("record", self._records[name], make, name)
        if found.states is not None:
            self._stages.remember(STATES, self._of_states(name), found.states)

    def _looked(self, names: list[str], meanwhile: Callable[[], Any]) -> Iterator[_Found]:
        """Yield what looks at records give, as they come."""
        self._names = _name_map(self._project)
        count = min(self._jobs, len(names) // _WORTH_A_PROCESS)
        if count < 2 or sys.platform != "linux":
            yield from map(self.look, names)
            return
        import_module("scipy.signal")  # every look needs it: once, instead of in each process
        # a forked process has all that is imported and read here: only names go there
        with ProcessPoolExecutor(count, get_context("fork"), _share, (self,)) as pool:
            begun = [pool.submit(_look, name) for name in names]
            try:
                meanwhile()
                for one in as_completed(begun):
                    yield one.result()
            finally:
                pool.shutdown(cancel_futures=True)


_shared: list[RecordLooks] = []


def _share(looks: RecordLooks) -> None:
    """Take over the looks in a forked process."""
    _shared[:] = [looks]


def _look(name: str) -> _Found:
    return _shared[0].look(name)


def _name_map(project: Project) -> Any:
    """Return the name map, read once for all records; None where there is none, or a faulty one, which every record states."""
    if project.names is None:
        return None
    try:
        return read_names(project.names)
    except (AeromatchError, OSError):
        return None

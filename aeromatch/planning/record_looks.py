"""Looks at flight records before a match: what fits, submodels and cases use, and what is
absent.
"""

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
from aeromatch.planning.record_look import LookTask, RecordLook, look_at
from aeromatch.planning.steps import texts_of
from aeromatch.project.project import Project
from aeromatch.workflow.identified import record_inputs, record_of
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchError, AeromatchWarning
from flightmech.support.kept_stages.captured_warnings import capture_warnings
from flightmech.support.kept_stages.stages import Kept, Stages
from flighttest.records.readers.name_map_reading import read_names

# Records per process for which a further process saves time.
_RECORDS_PER_PROCESS = 4

STATES = "states at start values"
"""Stage of the states of a record that a case replays.

A changed case requires them again, and their computation is the longest part of its check.
"""


@dataclass
class _LookResult:
    """A look, and the results that the store gets.

    Attributes
    ----------
    look : RecordLook
    record : DataTree or None
        The record, if it was read and the store gets it.
    states : Dataset (time,) or None
        The states, if they were computed and the store gets them.
    remarks : list of str
        Texts of the warnings of reading the record.
    """

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
        Hashes of the files that are read.
    stages : Stages
    jobs : int
        Processes, if the system can fork; -1 for one per core.
    keep_records : bool
        Whether a match follows, which reads the records from the store. Storing a record takes
        longer than a look at it.
    """

    def __init__(
        self,
        project: Project,
        custody: pom.archive.Custody,
        stages: Stages,
        jobs: int,
        keep_records: bool,
    ) -> None:
        self._project, self._custody, self._stages = project, custody, stages
        self._keeps = keep_records and stages.store is not None
        self._jobs = jobs if jobs > 0 else os.cpu_count() or 1
        self._tasks: dict[str, LookTask] = {}
        self._names: Any = None
        self._aircraft: Kept[Aircraft] | None = None
        self._records: dict[str, dict[str, Any]] = {}

    def take(
        self, tasks: Sequence[LookTask], meanwhile: Callable[[], Any]
    ) -> dict[str, RecordLook]:
        """Return the looks by record.

        Parameters
        ----------
        tasks : sequence of LookTask
        meanwhile : callable
            Called once by this process, while other processes look at records.
        """
        self._tasks = {task.name: task for task in tasks}
        looks: dict[str, RecordLook] = {}
        inputs: dict[str, dict[str, Any]] = {}
        for task in tasks:
            if self._aircraft is None:
                self._aircraft = self._stages.given(task.aircraft)
            try:
                self._records[task.name] = record_inputs(self._project, task.name, self._custody)
            except OSError as error:
                looks[task.name] = _unreadable(task.name, error)
                continue
            inputs[task.name] = {"record": self._records[task.name], **task.inputs(self._aircraft)}

        def compute(missing: list[str], put: Callable[..., None]) -> None:
            for result in self._look_at_all(missing, meanwhile):
                self._store(result)
                # The cause of a problem may be corrected without a change of the inputs.
                put(result.look.name, result.look, keep=not result.look.problems)

        for name, stored in self._stages.batch("record look", inputs, compute).items():
            looks[name] = stored.value
        return {task.name: looks[task.name] for task in tasks}

    def look(self, name: str) -> _LookResult:
        """Look at one record, in this or another process."""
        remarks: list[str] = []
        new_record: xr.DataTree | None = None
        record: xr.DataTree | None = self._stages.recall("record", self._records[name], None)
        if record is None:
            try:
                new_record, remarks = capture_warnings(
                    record_of, self._project, name, self._custody, self._names
                )
            except (AeromatchError, OSError) as error:
                return _LookResult(_unreadable(name, error))
            record = new_record
        assert record is not None
        task = self._tasks[name]
        stored_states: xr.Dataset | None = None
        if task.cases:
            stored_states = self._stages.recall(STATES, self._state_inputs(name), None)
        # The reconstruction of the match issues these warnings again.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AeromatchWarning)
            look, states = look_at(task, record, stored_states)
        result = _LookResult(look, remarks=remarks)
        if self._keeps:
            result.record = new_record
            if task.cases and stored_states is None:
                result.states = states
        return result

    def _size_of(self, name: str) -> int:
        """Return the size of the file of a record. [byte]"""
        return self._project.flights[name].stat().st_size

    def _state_inputs(self, name: str) -> dict[str, Any]:
        return {"record": self._records[name], "aircraft": self._aircraft}

    def _store(self, result: _LookResult) -> None:
        """Store a record and its states, and issue the warnings of reading the record."""

        def make() -> xr.DataTree | None:
            for text in result.remarks:
                warnings.warn(text, AeromatchWarning, stacklevel=2)
            return result.record

        name = result.look.name
        if result.record is None:
            make()
        else:
            self._stages.one("record", self._records[name], make, item=name)
        if result.states is not None:
            self._stages.remember(STATES, self._state_inputs(name), result.states)

    def _look_at_all(self, names: list[str], meanwhile: Callable[[], Any]) -> Iterator[_LookResult]:
        """Yield the results of the looks at records as they are completed."""
        self._names = _read_name_map(self._project)
        count = min(self._jobs, len(names) // _RECORDS_PER_PROCESS)
        if count < 2 or sys.platform != "linux":
            yield from map(self.look, names)
            return
        # Each look uses this module. Imported here, it is imported once for all processes.
        import_module("scipy.signal")
        # A forked process has everything that this process has imported and read, so that only
        # names are sent to it.
        with ProcessPoolExecutor(count, get_context("fork"), _share, (self,)) as pool:
            # The longest records first, so that the processes end at the same time.
            ordered = sorted(names, key=self._size_of, reverse=True)
            tasks = [pool.submit(_look_at_shared, name) for name in ordered]
            try:
                meanwhile()
                for task in as_completed(tasks):
                    yield task.result()
            finally:
                pool.shutdown(cancel_futures=True)


_shared: list[RecordLooks] = []


def _share(looks: RecordLooks) -> None:
    """Store the looks in a forked process."""
    _shared[:] = [looks]


def _look_at_shared(name: str) -> _LookResult:
    return _shared[0].look(name)


def _unreadable(name: str, error: Exception) -> RecordLook:
    return RecordLook(name, [f"record {name}: {text}" for text in texts_of(error)])


def _read_name_map(project: Project) -> Any:
    """Return the name map, read once for all records, or None for an absent or faulty name map.

    The look at each record reports a faulty name map.
    """
    if project.names is None:
        return None
    try:
        return read_names(project.names)
    except (AeromatchError, OSError):
        return None

"""One record before the match: what fits, submodels and cases take of it, and what it lacks for
them.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import flighttest
import pom
from aeromatch.planning.sample_checks import fit_problems, submodel_problems
from aeromatch.planning.steps import run_collecting_problems, texts_of
from aeromatch.project.project import FitSection, Project
from aeromatch.project.sections import RecordSelection
from aeromatch.workflow.steps import record_inputs, record_of
from aeromatch.workflow.submodels import find_case_overlaps, spans_of
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchError, AeromatchWarning
from flightmech.support.kept_stages.stages import Kept, Stages, capture_warnings
from flighttest.reconstruction.states_at_start import start_states
from flighttest.records.readers.name_map_reading import read_names
from pom.cases.case import PomCase
from pom.checking.case_check import case_problems

START = 150
"""Samples at the start of a record, from which the names of its coefficients are found."""


@dataclass(frozen=True)
class LookTask:
    """One record and what the project does with it: all that a look at it depends on.

    Attributes
    ----------
    name : str
    aircraft : Aircraft
    cases : list of PomCase
        Those whose record it is.
    given : DataFrame or None
        Its manoeuvres in the table of the project; None if they are those that it marks.
    fits : dict of str to Fit
        Fits that use it, by ``fit 'name'``, with this record alone.
    submodels : dict of str to list of Flown
        What submodels take of it, by the place in the project file.
    sections : dict of str to Engine, Control, Gear or GroundEffect
        Sections of the project file that these belong to, by the same place.
    """

    name: str
    aircraft: Aircraft
    cases: list[PomCase]
    given: pd.DataFrame | None = None
    fits: dict[str, FitSection] = field(default_factory=dict)
    submodels: dict[str, list[RecordSelection]] = field(default_factory=dict)
    sections: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        name: str,
        project: Project,
        aircraft: Aircraft,
        cases: Sequence[PomCase],
        given: pd.DataFrame | None,
    ) -> LookTask:
        """Return what a project does with a record."""
        alone = {"records": (name,)}
        own = [case for case in cases if Path(case.record).stem == name]
        task = cls(name, aircraft, own, given)
        for fit in project.fits:
            if name in fit.records:
                task.fits[f"fit {fit.name!r}"] = fit.model_copy(update=alone)
        for place, flown in project.submodels.items():
            taken = [one.model_copy(update=alone) for one in flown if name in one.records]
            if taken:
                section, _, rest = place.partition(".")
                asked = getattr(project, section)
                task.submodels[place] = taken
                task.sections[place] = (
                    asked[rest.partition(".")[0]] if section == "controls" else asked
                )
        return task

    def inputs(self, aircraft: Kept[Aircraft]) -> dict[str, Any]:
        """Return what the look depends on besides the record, for a stage; `aircraft` is the one of
        the task.
        """
        uses = {"fits": self.fits, "submodels": self.submodels, "sections": self.sections}
        return {"aircraft": aircraft, "cases": self.cases, "manoeuvres": self.given, **uses}


@dataclass
class RecordLook:
    """What a look at a record gave.

    Attributes
    ----------
    name : str
    problems : list of str
    first, last : float
        Span of the clock of the path; NaN for a record that cannot be read. [s]
    channels : int
        Recorded channels.
    taken : dict of str to (int, float)
        By fit or place of a submodel: number of manoeuvres and windows, and their time together.
        [s]
    start : Dataset (time,) or None
        The first states of a record that identifies something. [SI]
    windows : dict of str to Dataset (time,)
        By case that has no problem with the record: its states. [SI]
    """

    name: str
    problems: list[str] = field(default_factory=list)
    first: float = float("nan")
    last: float = float("nan")
    channels: int = 0
    taken: dict[str, tuple[int, float]] = field(default_factory=dict)
    start: xr.Dataset | None = None
    windows: dict[str, xr.Dataset] = field(default_factory=dict)


def look_at(
    task: LookTask, record: xr.DataTree, states: xr.Dataset | None = None
) -> tuple[RecordLook, xr.Dataset | None]:
    """Return what a record holds for the project, with all problems, and its states; `states` are
    these, where they are at hand.
    """
    look = RecordLook(task.name)
    look.channels = sum(len(leaf.data_vars) for leaf in record.children.values())
    if states is None:
        states = run_collecting_problems(
            look.problems, f"record {task.name}", start_states, record, task.aircraft
        )
    spans = _spans(task, record, look)
    if states is None:
        return look, None
    time = states["time"].values
    look.first, look.last = float(time[0]), float(time[-1])
    if task.fits or task.submodels:
        _look_for_identification(task, states, spans, look)
    for case in task.cases:
        faults = case_problems(case, states, {})
        look.problems += faults
        if not faults:
            look.windows[case.name] = _around(states, case.window)
    return look, states


def _spans(
    task: LookTask, record: xr.DataTree, look: RecordLook
) -> dict[str, list[tuple[float, float]]]:
    """Return start and end of everything that identifies something, by fit or place of a submodel."""
    users: dict[str, Sequence[RecordSelection]] = {
        **{place: [fit] for place, fit in task.fits.items()},
        **task.submodels,
    }
    if not users:
        return {}
    marks = flighttest.manoeuvres(record) if task.given is None else task.given
    tables = [table for table in (marks, flighttest.records.flight_modes(record)) if len(table)]
    table = pd.concat(tables, ignore_index=True) if tables else marks
    found = {}
    for place, flown in users.items():
        spans = spans_of(place, flown, {task.name: table}, look.problems)
        look.problems += find_case_overlaps(place, spans, task.cases)
        found[place] = spans[task.name]
    return found


def _look_for_identification(
    task: LookTask,
    states: xr.Dataset,
    spans: Mapping[str, Sequence[tuple[float, float]]],
    look: RecordLook,
) -> None:
    """Check the parts of a record that identify something."""
    look.start = states.isel(time=slice(0, START))
    for place, own in spans.items():
        inside = [(max(start, look.first), min(end, look.last)) for start, end in own]
        look.taken[place] = len(own), float(sum(max(0.0, end - start) for start, end in inside))
        where = f"{place}, record {task.name}"
        outside = [span for span in own if span[0] > -np.inf and not _is_inside(span, states)]
        look.problems += [
            f"{where}: {start:g} ... {end:g} s is not inside the record, {look.first:g} ... "
            f"{look.last:g} s"
            for start, end in outside
        ]
        if outside:
            continue
        if place in task.fits:
            look.problems += fit_problems(where, task.fits[place], states, own)
        else:
            look.problems += submodel_problems(
                where, place, task.sections[place], task.aircraft, states, own
            )


def _is_inside(span: tuple[float, float], states: xr.Dataset) -> bool:
    """Return whether a window lies inside the states, as `flighttest.between` requires."""
    time = states["time"].values
    step = float(np.median(np.diff(time)))
    return bool(span[0] >= time[0] - step and span[1] <= time[-1] + 1.5 * step)


def _around(states: xr.Dataset, window: tuple[float, float]) -> xr.Dataset:
    """Return the states over a window with two samples more on both sides."""
    time = states["time"].values
    first, behind = np.searchsorted(time, window[0]) - 2, np.searchsorted(time, window[1]) + 3
    return states.isel(time=slice(max(0, first), behind))


_WORTH_A_PROCESS = 4  # records per process

STATES = "states at start values"
"""Stage of the states of a record that a case replays: a changed case needs them, and they take longer than all else of its check."""


@dataclass
class _Found:
    """A look; record and states if they were made and shall be kept, and the texts of the warnings
    of reading the record.
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
        Of the files that are read.
    stages : Stages
    jobs : int
        Processes, where the system can fork; -1 for one per core.
    keep_records : bool
        Whether a match follows, which takes the records from the stages; to keep them takes longer
        than to look at them.
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
                unread[task.name] = RecordLook(
                    task.name, [f"record {task.name}: {text}" for text in texts_of(error)]
                )
                continue
            assert self._aircraft is not None
            inputs[task.name] = {"record": self._records[task.name], **task.inputs(self._aircraft)}

        def compute(missing: list[str], put: Callable[..., None]) -> None:
            for found in self._looked(missing, meanwhile):
                self._keep(found)
                put(
                    found.look.name, found.look, keep=not found.look.problems
                )  # a fault may be corrected without a trace in the inputs

        kept = self._stages.batch("record look", inputs, compute)
        return {
            task.name: kept[task.name].value if task.name in kept else unread[task.name]
            for task in tasks
        }

    def look(self, name: str) -> _Found:
        """Look at one record, in whatever process."""
        remarks: list[str] = []
        made: xr.DataTree | None = None
        kept = self._stages.recall("record", self._records[name], None)
        if kept is None:
            try:
                made, remarks = capture_warnings(
                    record_of, self._project, name, self._custody, self._names
                )
            except (AeromatchError, OSError) as error:
                return _Found(
                    RecordLook(name, [f"record {name}: {text}" for text in texts_of(error)])
                )
        record: xr.DataTree = made if kept is None else kept  # type: ignore[assignment]
        known = (
            self._stages.recall(STATES, self._of_states(name), None)
            if self._tasks[name].cases
            else None
        )
        with warnings.catch_warnings():  # the reconstruction gives them again
            warnings.simplefilter("ignore", AeromatchWarning)
            look, states = look_at(self._tasks[name], record, known)
        new = states if self._tasks[name].cases and known is None else None
        return _Found(look, made, new, remarks) if self._keeps else _Found(look, remarks=remarks)

    def _of_states(self, name: str) -> dict[str, Any]:
        return {"record": self._records[name], "aircraft": self._aircraft}

    def _keep(self, found: _Found) -> None:
        """Keep a record and its states as the results of their stages, and give the warnings of
        reading the record.
        """

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
    """Return the name map, read once for all records; None where there is none, or a faulty one,
    which every record states.
    """
    if project.names is None:
        return None
    try:
        return read_names(project.names)
    except (AeromatchError, OSError):
        return None

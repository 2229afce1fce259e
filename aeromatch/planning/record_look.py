"""One flight record before a match: what fits, submodels and cases use, and what is absent."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import flighttest
from aeromatch.planning.record_faults.gap_checks import gap_departures
from aeromatch.planning.record_faults.held_checks import held_departures
from aeromatch.planning.repeated_samples import proving_samples, used_samples
from aeromatch.planning.resting_variables import movements
from aeromatch.planning.sample_checks import (
    fit_problems,
    manoeuvre_problems,
    sample_indices,
    submodel_problems,
)
from aeromatch.planning.steps import run_collecting_problems
from aeromatch.planning.term_remarks import Range, flown_ranges
from aeromatch.project.model_sections import FitSection
from aeromatch.project.project import Project
from aeromatch.project.sections import RecordSelection
from aeromatch.workflow.windows import find_case_overlaps, spans_of
from flightmech.aircraft.aircraft import Aircraft
from flightmech.quantities import time_text
from flightmech.support.kept_stages.stages import Kept
from flighttest.reconstruction.quality.declarations.rigging import past_stops
from flighttest.reconstruction.quality.engines.table_ranges import range_findings
from flighttest.reconstruction.quality.engines.usual_sizes import unusual_sizes
from flighttest.reconstruction.quality.record_notes import note_missing_codes
from flighttest.reconstruction.states_at_start import start_states
from pom.cases.case import PomCase
from pom.checking.case_check import case_problems
from pom.judging.window_checks import window_departures

START = 150
"""Samples at the start of a record that give the names of its coefficients."""


@dataclass(frozen=True)
class LookTask:
    """One record and its use in the project: all inputs of a look at it.

    Attributes
    ----------
    name : str
    aircraft : Aircraft
    cases : list of PomCase
        Cases that replay the record.
    table : DataFrame or None
        Its manoeuvres in the table of the project; None if the record itself marks them.
    fits : dict of str to FitSection
        Fits that use it, by ``fit 'name'``, with this record alone.
    submodels : dict of str to list of RecordSelection
        Parts that submodels use, by the position in the project file.
    sections : dict of str to EngineSection, ControlSection, GearSection or GroundEffectSection
        Sections of the project file, by the same position.
    faulty : frozenset of str
        Manoeuvres of the record whose rows of the table are faulty, as in `spans_of`.
    """

    name: str
    aircraft: Aircraft
    cases: list[PomCase]
    table: pd.DataFrame | None = None
    fits: dict[str, FitSection] = field(default_factory=dict)
    submodels: dict[str, list[RecordSelection]] = field(default_factory=dict)
    sections: dict[str, Any] = field(default_factory=dict)
    faulty: frozenset[str] = frozenset()

    @classmethod
    def of(
        cls,
        name: str,
        project: Project,
        aircraft: Aircraft,
        cases: Sequence[PomCase],
        table: pd.DataFrame | None,
        faulty: Iterable[str] = (),
    ) -> LookTask:
        """Return the use of a record in a project."""
        alone = {"records": (name,)}
        replayed = [case for case in cases if Path(case.record).stem == name]
        task = cls(name, aircraft, replayed, table=table, faulty=frozenset(faulty))
        for fit in project.fit:
            if name in fit.records:
                task.fits[f"fit {fit.name!r}"] = fit.model_copy(update=alone)
        for position, selections in project.submodels.items():
            for selection in selections:
                if name in selection.records:
                    parts = task.submodels.setdefault(position, [])
                    parts.append(selection.model_copy(update=alone))
                    task.sections[position] = _section(project, position)
        return task

    def inputs(self, aircraft: Kept[Aircraft]) -> dict[str, Any]:
        """Return the inputs of the stage besides the record; `aircraft` is that of the task."""
        return {
            "aircraft": aircraft,
            "cases": [case.without_texts() for case in self.cases],
            "manoeuvres": self.table,
            "fits": self.fits,
            "submodels": self.submodels,
            "sections": self.sections,
            "faulty": sorted(self.faulty),
        }


def _section(project: Project, position: str) -> Any:
    """Return the section of a position: ``engine.flown``, ``controls.column.free`` ..."""
    name, _, remainder = position.partition(".")
    if name == "controls":
        return project.controls.sections[remainder.partition(".")[0]]
    return getattr(project, name)


@dataclass
class RecordLook:
    """Result of a look at a record.

    Attributes
    ----------
    name : str
    problems : list of str
    departures : list of str
        Departures of the windows of cases from normal practice, gaps of the record, and values that
        it repeats. The match runs with them.
    first, last : float
        Span of the clock of the path; NaN for a record that cannot be read. [s]
    channels : int
        Recorded channels.
    uses : dict of str to (int, float)
        By fit or position of a submodel: number of manoeuvres and windows, and their total time.
        [s]
    start : Dataset (time,) or None
        The first states of a record that identifies something. [SI]
    windows : dict of str to Dataset (time,)
        States of each case that has no problem with the record. [SI]
    remarks : list of str
        Controls past the stops of the aircraft file, and codes of missing values.
    moved : dict of str to dict of str to float
        By fit: largest range of a variable inside one of its windows. [rad], [rad s-1]
    movers : dict of str to list of str
        By variable: the manoeuvres of the record that move it.
    samples : dict of str to array of uint64
        Hashes of the samples that identify a coefficient, or a submodel by its position.
    ranges : dict of str to dict of str to (float, float)
        Flown ranges of the axes of tables, by fit. [SI]
    proofs : dict of str to array of uint64
        Hashes of the samples in the windows of cases, by case.
    """

    name: str
    problems: list[str] = field(default_factory=list)
    departures: list[str] = field(default_factory=list)
    first: float = float("nan")
    last: float = float("nan")
    channels: int = 0
    uses: dict[str, tuple[int, float]] = field(default_factory=dict)
    start: xr.Dataset | None = None
    windows: dict[str, xr.Dataset] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)
    moved: dict[str, dict[str, float]] = field(default_factory=dict)
    movers: dict[str, list[str]] = field(default_factory=dict)
    samples: dict[str, np.ndarray] = field(default_factory=dict)
    ranges: dict[str, dict[str, Range]] = field(default_factory=dict)
    proofs: dict[str, np.ndarray] = field(default_factory=dict)


def look_at(
    task: LookTask, record: xr.DataTree, states: xr.Dataset | None = None
) -> tuple[RecordLook, xr.Dataset | None]:
    """Return the look at a record, with all problems, and the states of the record.

    Parameters
    ----------
    task : LookTask
    record : DataTree
    states : Dataset (time,), optional
        The states at start values, if they are available. [SI]
    """
    look = RecordLook(task.name)
    look.channels = sum(len(leaf.data_vars) for leaf in record.children.values())
    for note in note_missing_codes(record):
        look.remarks.append(f"record {task.name}: {note.text}; {note.remedy}")
    if states is None:
        states = run_collecting_problems(
            look.problems, f"record {task.name}", start_states, record, task.aircraft
        )
    table = _manoeuvres_of(task, record)
    spans = _find_spans(task, table, look)
    if states is None:
        return look, None
    look.departures += gap_departures(task.name, record, task.cases, spans)
    look.departures += held_departures(task.name, record, task.cases, spans)
    look.problems += manoeuvre_problems(task.name, table, states)
    look.remarks += stop_remarks(task, states) + table_remarks(task, states)
    time = states["time"].values
    look.first, look.last = float(time[0]), float(time[-1])
    if task.fits or task.submodels:
        _check_identification(task, states, spans=spans, look=look)
        look.samples = used_samples(task.fits, record, spans)
        fitted = {position: spans[position] for position in task.fits}
        look.moved, look.movers = movements(states, table, fitted)
    if task.cases:
        look.proofs = proving_samples(task.cases, record)
    for case in task.cases:
        problems = case_problems(case, states, {})
        look.problems += problems
        if not problems:
            look.windows[case.name] = _select_window(states, case.window)
            for text in window_departures(case, states):
                look.departures.append(f"case {case.name}: {text}")
    return look, states


def stop_remarks(task: LookTask, states: xr.Dataset) -> list[str]:
    """Return the recorded controls that pass the stops of the aircraft file, a line each."""
    unknown = str(states.attrs.get("unknown", "")).split()
    remarks = []
    for control, stops in task.aircraft.limits.items():
        if control not in states or control in unknown:
            continue
        values = states.variables[control].values
        values = values[np.isfinite(values)]
        text = past_stops(control, values, stops) if values.size else ""
        if text:
            remarks.append(f"record {task.name}: {text}; correct unit, zero or scale, or the stops")
    return remarks


def table_remarks(task: LookTask, states: xr.Dataset) -> list[str]:
    """Return the conditions of a record beyond the tables of the engines, a line each."""
    values = {}
    for name in states.data_vars:
        variable = states.variables[name]
        if variable.ndim == 1:
            values[str(name)] = variable.values
    # Most records have no finding, and need no list of the axes that have a remark already.
    if not range_findings(values, task.aircraft):
        return []
    sizes = {size.name for size in unusual_sizes(task.aircraft)}
    findings = range_findings(values, task.aircraft, sizes)
    return [f"record {task.name}: {found.text}; {found.remedy}" for found in findings]


def _manoeuvres_of(task: LookTask, record: xr.DataTree) -> pd.DataFrame:
    """Return the manoeuvres and the flight modes of a record that identifies something."""
    table = task.table
    if table is None:
        table = flighttest.records.marked_manoeuvres(record)
    # An empty table would change the types of the columns.
    tables = [part for part in (table, flighttest.records.flight_modes(record)) if len(part)]
    if tables:
        table = pd.concat(tables, ignore_index=True)
    return table


def _find_spans(
    task: LookTask, table: pd.DataFrame, look: RecordLook
) -> dict[str, list[tuple[float, float]]]:
    """Return the windows that identify something, by fit or position of a submodel."""
    users: dict[str, Sequence[RecordSelection]] = {}
    for position, fit in task.fits.items():
        users[position] = [fit]
    users |= task.submodels
    if not users:
        return {}
    spans: dict[str, list[tuple[float, float]]] = {}
    for position, selections in users.items():
        by_record = spans_of(
            position, selections, {task.name: table}, look.problems, faulty=task.faulty
        )
        look.problems += find_case_overlaps(position, by_record, task.cases)
        spans[position] = by_record[task.name]
    return spans


def _check_identification(
    task: LookTask,
    states: xr.Dataset,
    spans: Mapping[str, Sequence[tuple[float, float]]],
    look: RecordLook,
) -> None:
    """Check the parts of a record that identify something."""
    look.start = states.isel(time=slice(0, START))
    for position, windows in spans.items():
        where = f"{position}, record {task.name}"
        duration = 0.0
        outside = []
        for start, end in windows:
            duration += max(0.0, min(end, look.last) - max(start, look.first))
            # A window from -inf is the whole record.
            if start > -np.inf and not _is_inside((start, end), states):
                outside.append(
                    f"{where}: {time_text(start)} ... {time_text(end)} s is not inside the record, "
                    f"{time_text(look.first)} ... {time_text(look.last)} s"
                )
        look.uses[position] = len(windows), float(duration)
        look.problems += outside
        if outside:
            continue
        if position in task.fits:
            look.problems += fit_problems(where, task.fits[position], states=states, spans=windows)
            samples = sample_indices(states["time"].values, windows)
            look.ranges[position] = flown_ranges(states, samples)
        else:
            look.problems += submodel_problems(
                where,
                position,
                section=task.sections[position],
                aircraft=task.aircraft,
                states=states,
                spans=windows,
            )


def _is_inside(span: tuple[float, float], states: xr.Dataset) -> bool:
    """Return whether a window is inside the states, by the rule of `flighttest.select_time`."""
    time = states["time"].values
    step = float(np.median(np.diff(time)))
    return bool(span[0] >= time[0] - step and span[1] <= time[-1] + 1.5 * step)


def _select_window(states: xr.Dataset, window: tuple[float, float]) -> xr.Dataset:
    """Return the states in a window and two samples before and after it."""
    time = states["time"].values
    first = np.searchsorted(time, window[0]) - 2
    # `searchsorted` gives the first sample after the window, so 3 is two more samples.
    behind = np.searchsorted(time, window[1]) + 3
    return states.isel(time=slice(max(0, first), behind))

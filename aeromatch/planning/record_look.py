"""One record before the match: what fits, submodels and cases take of it, and what it lacks for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import flighttest
from flightmech import Aircraft
from flightmech.support.kept_stages.stages import Kept
from flighttest.reconstruction import start_states
from pom.cases import PomCase
from pom.checking import case_problems

from ..project import Fit, Project
from ..sections import Flown
from ..submodels import overlaps, spans_of
from .collecting import collect
from .sample_checks import fit_problems, submodel_problems

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
    fits: dict[str, Fit] = field(default_factory=dict)
    submodels: dict[str, list[Flown]] = field(default_factory=dict)
    sections: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, name: str, project: Project, aircraft: Aircraft, cases: Sequence[PomCase], given: pd.DataFrame | None) -> LookTask:
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
                task.sections[place] = asked[rest.partition(".")[0]] if section == "controls" else asked
        return task

    def inputs(self, aircraft: Kept[Aircraft]) -> dict[str, Any]:
        """Return what the look depends on besides the record, for a stage; `aircraft` is the one of the task."""
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
        By fit or place of a submodel: number of manoeuvres and windows, and their time together. [s]
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


def look_at(task: LookTask, record: xr.DataTree, states: xr.Dataset | None = None) -> tuple[RecordLook, xr.Dataset | None]:
    """Return what a record holds for the project, with all problems, and its states; `states` are these, where they are at hand."""
    look = RecordLook(task.name)
    look.channels = sum(len(leaf.data_vars) for leaf in record.children.values())
    if states is None:
        states = collect(look.problems, f"record {task.name}", start_states, record, task.aircraft)
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


def _spans(task: LookTask, record: xr.DataTree, look: RecordLook) -> dict[str, list[tuple[float, float]]]:
    """Return start and end of everything that identifies something, by fit or place of a submodel."""
    users: dict[str, Sequence[Flown]] = {**{place: [fit] for place, fit in task.fits.items()}, **task.submodels}
    if not users:
        return {}
    marks = flighttest.manoeuvres(record) if task.given is None else task.given
    tables = [table for table in (marks, flighttest.records.modes(record)) if len(table)]
    table = pd.concat(tables, ignore_index=True) if tables else marks
    found = {}
    for place, flown in users.items():
        spans = spans_of(place, flown, {task.name: table}, look.problems)
        look.problems += overlaps(place, spans, task.cases)
        found[place] = spans[task.name]
    return found


def _look_for_identification(
    task: LookTask, states: xr.Dataset, spans: Mapping[str, Sequence[tuple[float, float]]], look: RecordLook
) -> None:
    """Check the parts of a record that identify something."""
    look.start = states.isel(time=slice(0, START))
    for place, own in spans.items():
        inside = [(max(start, look.first), min(end, look.last)) for start, end in own]
        look.taken[place] = len(own), float(sum(max(0.0, end - start) for start, end in inside))
        where = f"{place}, record {task.name}"
        outside = [span for span in own if span[0] > -np.inf and not _is_inside(span, states)]
        look.problems += [
            f"{where}: {start:g} ... {end:g} s is not inside the record, {look.first:g} ... {look.last:g} s" for start, end in outside
        ]
        if outside:
            continue
        if place in task.fits:
            look.problems += fit_problems(where, task.fits[place], states, own)
        else:
            look.problems += submodel_problems(where, place, task.sections[place], task.aircraft, states, own)


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

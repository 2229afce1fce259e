"""A batch whose models are also flown with draws of their databases."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import xarray as xr

from flightmech import Aircraft, read_aircraft
from flightmech.errors import UnknownName

from ..cases.case import PomCase
from ..fmu.simulate import Models
from ..replaying.batch import flown, replay_all
from ..replaying.replay_case import Plan, plan_of
from ..replaying.state_cache import KeptStates
from ..replaying.trim_surfaces import solved
from ..result import PomResult
from ..samples import Samples
from .drawn_models import DrawnModels
from .sampled_case import sampled


def replay_sampled(
    cases: Sequence[PomCase],
    runs: Mapping[str, str | Path],
    databases: Mapping[str, str | Path | xr.DataTree],
    count: int,
    seed: int = 0,
    paths: Mapping[str, Any] | None = None,
    *,
    names: Mapping[str, str | Path] | None = None,
    errors: Mapping[str, float] | None = None,
    biases: xr.Dataset | None = None,
    jobs: int = -1,
    resume: str | Path | None = None,
    timeout: float = 60.0,
    progress: Callable[[PomResult], None] | None = None,
    **options: Any,
) -> list[PomResult]:
    """Replay every case by every model and judge it, as `replay_all`, and then by draws of the models whose databases are given.

    Parameters
    ----------
    cases, runs, paths, names, biases, jobs, resume, timeout, progress
        As in `replay_all`.
    databases : mapping of str to path or DataTree
        Name of a model to the database that its FMU was made from, with standard errors; a model without is not sampled.
    count : int
        Number of draws.
    seed : int
    errors : mapping, optional
        Relative standard errors of ``mass`` and ``thrust`` (`Instruments.of`).
    **options
        Others of `replay_all`.

    Returns
    -------
    list of PomResult
        In the order of the cases, with ``samples``; the same for any number of jobs.  A case with a control law has none.

    Raises
    ------
    UnknownName
        A database for a model that is not there.
    SchemaError, OutOfRange, SimulationError
        As `replay_all` and `DrawnModels.of`.
    """
    unknown = [name for name in databases if name not in runs]
    if unknown:
        raise UnknownName(unknown[0], runs, "model", "a database is that of a model")
    drawn = {name: DrawnModels.of(runs[name], database, count, seed) for name, database in databases.items()}
    kept = Path(resume).resolve() if resume is not None else None
    states = flown(cases, paths or {}, KeptStates(kept, biases), jobs)
    given: dict[str, Any] = {case.record: path for case, path in zip(cases, states, strict=True)}
    results = replay_all(cases, runs, given, names=names, jobs=jobs, resume=resume, timeout=timeout, **options)
    fmus, aircraft = Models(runs, names), _Aircraft()
    found = []
    for case, result in zip(cases, results, strict=True):
        samples: dict[str, Samples] = {}
        for name, models in drawn.items() if not case.law else ():
            plan = plan_of(case, given[case.record])
            job, _, failure = solved(plan.job, plan.case.drive.trim_surfaces, fmus.of(case)[name], timeout)
            if not failure:
                samples[name] = sampled(Plan(plan.case, plan.states, job), models, aircraft.of(case), errors, jobs)
        found.append(replace(result, samples=samples))
        if progress is not None:
            progress(found[-1])
    return found


class _Aircraft:
    """Aircraft of cases, each read once."""

    def __init__(self) -> None:
        self._known: dict[str, Aircraft] = {}

    def of(self, case: PomCase) -> Aircraft | None:
        if case.aircraft and case.aircraft not in self._known:
            self._known[case.aircraft] = read_aircraft(case.aircraft)
        return self._known.get(case.aircraft)

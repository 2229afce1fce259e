"""A batch whose models are also flown with draws of their databases."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import xarray as xr

from flightmech import Aircraft, read_aircraft
from flightmech.errors import UnknownName

from ..cases.case import PomCase
from ..fmu.file_state import FileState
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
    for name, database in databases.items():
        drawn_models(runs[name], database, count, seed)  # what they refuse is reported before the flights
    kept = Path(resume).resolve() if resume is not None else None
    states = flown(cases, paths or {}, KeptStates(kept, biases), jobs)
    given: dict[str, Any] = {case.record: path for case, path in zip(cases, states, strict=True)}
    results = replay_all(cases, runs, given, names=names, jobs=jobs, resume=resume, timeout=timeout, **options)
    draw = {"count": count, "seed": seed, "errors": errors, "names": names, "timeout": timeout}
    found = []
    for case, result in zip(cases, results, strict=True):
        samples = {} if case.law else samples_of_case(case, given[case.record], runs, databases, draw, jobs)
        found.append(replace(result, samples=samples))
        if progress is not None:
            progress(found[-1])
    return found


def samples_of_case(
    case: PomCase,
    path: Any,
    runs: Mapping[str, str | Path],
    databases: Mapping[str, str | Path | xr.DataTree],
    draw: Mapping[str, Any],
    jobs: int,
) -> dict[str, Samples]:
    """Return the samples of one case by model; a model whose trim surfaces cannot be solved has none.

    Parameters
    ----------
    case, path, runs, databases, jobs
        As in `replay_sampled`, of one case.
    draw : mapping
        ``count``, ``seed``, ``errors``, ``names`` and ``timeout`` of `replay_sampled`.
    """
    models, aircraft = Models(runs, draw.get("names")).of(case), _aircraft(case.aircraft) if case.aircraft else None
    samples: dict[str, Samples] = {}
    for name, database in databases.items():
        plan = plan_of(case, path)
        job, _, failure = solved(plan.job, plan.case.drive.trim_surfaces, models[name], draw.get("timeout", 60.0))
        if not failure:
            drawn = drawn_models(runs[name], database, draw["count"], draw["seed"])
            samples[name] = sampled(Plan(plan.case, plan.states, job), drawn, aircraft, draw.get("errors"), jobs)
    return samples


def drawn_models(fmu: str | Path, database: str | Path | xr.DataTree, count: int, seed: int) -> DrawnModels:
    """Return `DrawnModels.of`, made once in a process for all cases of a batch."""
    files = [Path(item) for item in (fmu, database) if not isinstance(item, xr.DataTree)]
    key = (*(FileState.of(file) for file in files), id(database) if isinstance(database, xr.DataTree) else 0, count, seed)
    if key not in _drawn:
        while len(_drawn) >= _MOST_DRAWN:
            _drawn.pop(next(iter(_drawn)))
        _drawn[key] = (DrawnModels.of(fmu, database, count, seed), database)  # the database keeps its identity as long as this
    return _drawn[key][0]


_MOST_DRAWN = 4  # models whose draws are held
_drawn: dict[Any, tuple[DrawnModels, Any]] = {}


@lru_cache(maxsize=8)
def _aircraft(file: str) -> Aircraft:
    """Return the aircraft of cases, read once."""
    return read_aircraft(file)

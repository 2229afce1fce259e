"""Probability of a match: a case is replayed with draws of the model and of the instruments.

Each draw of the posterior takes the place of the aeroplane. It is flown with the input, start and
mass of the record, corrected by drawn errors of the instruments. Its motion is recorded with the
same errors, and the model is judged against this record.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from joblib import Parallel, delayed

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import SchemaError, UnknownName
from pom.cases.case import PomCase
from pom.diagnosis.sampling.draws import DrawnModels, InstrumentErrors
from pom.diagnosis.sampling.sampled_bench import SampledBench, SampledRun, with_inertia
from pom.diagnosis.sampling.shares import contribution_changes, regressors_of_draws, variance_shares
from pom.fmu.models import Models
from pom.fmu.run_cache import FileState
from pom.replaying.batch import BatchExecution, replay_all
from pom.replaying.batch_plans import paths_of_cases
from pom.replaying.caches import KeptStates
from pom.replaying.replay_case import ReplayPlan, plan_of
from pom.replaying.replay_channels import shown_channels
from pom.replaying.trim import solve_trim_surfaces
from pom.result import PomResult
from pom.samples import SampledReplay
from pom.tolerances.channels import source_signals

_MOST_DRAWN = 4  # models whose draws stay in memory
# Draws and their database by key. The stored database keeps the `id` in the key unique.
_drawn: dict[Any, tuple[DrawnModels, Any]] = {}
_drawn_lock = Lock()


def replay_draws(
    plan: ReplayPlan,
    models: DrawnModels,
    aircraft: Aircraft | None = None,
    errors: Mapping[str, float] | None = None,
    jobs: int = 1,
) -> SampledReplay:
    """Fly a case by every draw and judge the model against each, as `pom.replay` judges a flight.

    Parameters
    ----------
    plan : Plan
        From `pom.replaying.plan_of`; its trim surfaces are not solved again.
    models : DrawnModels
    aircraft, errors
        As in `InstrumentErrors.of`.
    jobs : int
        Threads; -1 for one per core.  The samples do not depend on it.

    Raises
    ------
    SchemaError
        The case has a control law, whose FMU the kernel does not fly.
    """
    if plan.job.law is not None:
        text = f"case {plan.case.name}: its control law is an FMU, which the kernel does not fly"
        raise SchemaError("samples", [text])
    plan = replace(plan, job=with_inertia(plan.job, models.model))
    compared: set[str] = set()
    for channel in shown_channels(plan.case, plan.states):
        compared.update((channel, *source_signals(channel)))
    instruments = InstrumentErrors.of(
        plan.job, plan.states, aircraft, errors=errors, compared=compared
    )
    bench = SampledBench.of(plan, models.model, instruments)
    errors_by_draw = instruments.draws(models.count, models.seed)
    runs = _judge_draws(bench, models, errors_by_draw, jobs)
    names = []
    for criterion in plan.case.criteria:
        if any(np.isfinite(run.signed(criterion.name)) for run in runs):
            names.append(criterion.name)
    hinges = plan.case.drive.level != "recorded"
    changes = contribution_changes(models.database, models.nodes, plan.states, hinges, aircraft)
    regressors = regressors_of_draws(
        changes, dict(zip(instruments.names, errors_by_draw.T, strict=True))
    )
    ratios = {}
    for name in names:
        ratios[name] = [run.number(name) for run in runs]
    signed_ratios = {name: bench.signed(name, runs) for name in names}
    return SampledReplay(
        seed=models.seed,
        database=models.source,
        status=tuple(run.status for run in runs),
        decides=np.array([run.deciding_number for run in runs]),
        ratio=pd.DataFrame(ratios, dtype=float),
        shares=variance_shares(signed_ratios, regressors),
        fan=bench.fan(runs),
    )


def _judge_draws(
    bench: SampledBench, models: DrawnModels, errors: np.ndarray, jobs: int
) -> list[SampledRun]:
    """Return the judged run of every draw; errors (draw, error) of the instruments."""
    # Compute the cached run once, before the threads use it.
    bench.own  # noqa: B018
    # The noise depends on seed and case, so that the number of threads does not change it.
    name_hash = zlib.crc32(bench.plan.case.name.encode())
    generators = np.random.default_rng([models.seed, name_hash]).spawn(models.count)
    draws = zip(models.models, errors, generators, strict=True)
    with Parallel(n_jobs=jobs, backend="threading") as pool:
        return list(pool(delayed(bench.matched)(*draw) for draw in draws))


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
    **options: Any,
) -> list[PomResult]:
    """Replay and judge every case as `replay_all`, then judge the models against draws.

    Parameters
    ----------
    cases, runs, paths, names, biases
        As in `replay_all`.
    databases : mapping of str to path or DataTree
        Database of a model, with standard errors; its FMU was made from it. A model without a
        database is not sampled.
    count : int
        Number of draws.
    seed : int
    errors : mapping, optional
        Relative standard errors of ``mass`` and ``thrust`` (`InstrumentErrors.of`).
    **options
        ``evidence``, ``recorded`` and the attributes of `BatchExecution`, as in `replay_all`.

    Returns
    -------
    list of PomResult
        In the order of the cases, with ``samples``; the same for any number of jobs.  A case with a
        control law has none.

    Raises
    ------
    UnknownName
        `databases` names a model that is not in `runs`.
    SchemaError, OutOfRange, SimulationError
        As `replay_all` and `DrawnModels.of`.
    """
    plain = {name: options.pop(name, None) for name in ("evidence", "recorded")}
    execution = BatchExecution(**options)
    unknown = [name for name in databases if name not in runs]
    if unknown:
        raise UnknownName(unknown[0], runs, "model", "a database is that of a model")
    # Report a wrong database before the flights.
    for name, database in databases.items():
        drawn_models(runs[name], database, count, seed)
    records = KeptStates(execution.folder, biases)
    states = paths_of_cases(cases, paths or {}, records, execution.jobs)
    paths_by_record: dict[str, Any] = {}
    for case, path in zip(cases, states, strict=True):
        paths_by_record[case.record] = path
    # Progress is reported with the samples, not with the plain results.
    plain_execution = vars(replace(execution, progress=None))
    results = replay_all(cases, runs, paths_by_record, names=names, **plain, **plain_execution)
    settings = DrawSettings(count, seed, errors=errors, names=names, timeout=execution.timeout)
    sampled_results = []
    for case, result in zip(cases, results, strict=True):
        samples: dict[str, SampledReplay] = {}
        if not case.law:
            samples = samples_of_case(
                case,
                paths_by_record[case.record],
                runs,
                databases=databases,
                draw=vars(settings),
                jobs=execution.jobs,
            )
        sampled_results.append(replace(result, samples=samples))
        if execution.progress is not None:
            execution.progress(sampled_results[-1])
    return sampled_results


@dataclass(frozen=True)
class DrawSettings:
    """Settings of the draws of a case, as `samples_of_case` reads them.

    Attributes
    ----------
    count, seed, errors, names
        As in `replay_sampled`.
    timeout : float
        Wall time allowed for the trim of one model. [s]
    """

    count: int
    seed: int
    errors: Mapping[str, float] | None = None
    names: Mapping[str, str | Path] | None = None
    timeout: float = 60.0


def samples_of_case(
    case: PomCase,
    path: Any,
    runs: Mapping[str, str | Path],
    databases: Mapping[str, str | Path | xr.DataTree],
    draw: Mapping[str, Any],
    jobs: int,
) -> dict[str, SampledReplay]:
    """Return the samples of one case by model; none for a case that cannot be flown.

    It cannot be flown if its trim surfaces cannot be solved, or if the record has a gap in it.

    Parameters
    ----------
    case, path, runs, databases, jobs
        As in `replay_sampled`, of one case.
    draw : mapping
        Attributes of `DrawSettings`.
    """
    settings = DrawSettings(**draw)
    models = Models(runs, settings.names).of(case)
    aircraft = None
    if case.aircraft:
        aircraft = _read_aircraft_once(case.aircraft)
    samples: dict[str, SampledReplay] = {}
    for name, database in databases.items():
        plan = plan_of(case, path)
        if plan.refusal:
            continue
        job, _, failure = solve_trim_surfaces(
            plan.job, plan.case.drive.trim_surfaces, models[name], settings.timeout
        )
        if failure:
            continue
        draws = drawn_models(runs[name], database, settings.count, settings.seed)
        trimmed = ReplayPlan(plan.case, plan.states, job)
        samples[name] = replay_draws(trimmed, draws, aircraft, errors=settings.errors, jobs=jobs)
    return samples


def drawn_models(
    fmu: str | Path, database: str | Path | xr.DataTree, count: int, seed: int
) -> DrawnModels:
    """Return `DrawnModels.of`, computed once in a process for all cases of a batch.

    The function may be called from any thread.
    """
    files, identity = [Path(fmu)], 0
    if isinstance(database, xr.DataTree):
        identity = id(database)
    else:
        files.append(Path(database))
    key = (*(FileState.of(file) for file in files), identity, count, seed)
    # Workers of a cluster may have several threads. Without the lock one thread could drop the
    # draws that another one has just stored, or both could compute the same draws.
    with _drawn_lock:
        if key not in _drawn:
            # Drop the oldest draws first.
            while len(_drawn) >= _MOST_DRAWN:
                _drawn.pop(next(iter(_drawn)))
            _drawn[key] = (DrawnModels.of(fmu, database, count, seed), database)
        return _drawn[key][0]


@lru_cache(maxsize=8)
def _read_aircraft_once(file: str) -> Aircraft:
    """Return the aircraft of a file; many cases share it."""
    return read_aircraft(file)

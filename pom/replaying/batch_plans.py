"""Plans of a batch: every record is read or reconstructed once for all its cases."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import starmap
from pathlib import Path
from typing import Any

import xarray as xr
from joblib import delayed

from flightmech.errors import SchemaError
from flightmech.support.kept_stages.sharing import process_pool
from pom.cases.case import PomCase
from pom.cases.reference_states import read_path_states
from pom.fmu.models import Models
from pom.replaying.caches import KeptStates
from pom.replaying.replay_case import ReplayPlan, check_plan, plan_of
from pom.replaying.worker_processes import Processes

_Source = tuple[str, str, str]  # record, name map and aircraft of a case


def make_plans(
    cases: list[PomCase],
    paths: Mapping[str, Any],
    records: KeptStates,
    *,
    jobs: int,
    pool: Processes | None,
) -> list[ReplayPlan]:
    """Return the plan of every case; a record is read once for all its cases."""
    groups: dict[_Source, list[PomCase]] = {}
    for case in cases:
        if path_of_case(case, paths) is None:
            groups.setdefault(_source_of(case), []).append(case)
    calls = [(group, records) for group in groups.values()]
    if pool is None:
        read: Iterable[list[ReplayPlan] | None] = starmap(_plan_stored_record, calls)
    else:
        read = pool.map(_plan_stored_record, calls)
    plans = dict(zip(groups, read, strict=True))
    raw = []
    for source, group_plans in plans.items():
        if group_plans is None:
            raw.append(groups[source][0])
    for source, states in _read_states(raw, records, jobs).items():
        plans[source] = [plan_of(case, states) for case in groups[source]]
    # Plans of a record are in the order of its cases.
    next_plans = {source: iter(group_plans or ()) for source, group_plans in plans.items()}
    ordered = []
    for case in cases:
        path = path_of_case(case, paths)
        if path is None:
            ordered.append(next(next_plans[_source_of(case)]))
        else:
            ordered.append(plan_of(case, path))
    return ordered


def _plan_stored_record(cases: list[PomCase], records: KeptStates) -> list[ReplayPlan] | None:
    """Return the plans of cases of one record; None if it has to be reconstructed."""
    states = _read_stored_states(cases[0], records)
    if states is None:
        return None
    return [plan_of(case, states) for case in cases]


def paths_of_cases(
    cases: Sequence[PomCase], paths: Mapping[str, Any], records: KeptStates, jobs: int
) -> list[Any]:
    """Return the path of every case: from `paths`, else the states of its record.

    Parameters
    ----------
    cases, paths, jobs
        As in `replay_all`. Each record is read or reconstructed once.
    records : KeptStates
        Store of reconstructed states.
    """
    # Each record is read once, before the paths are put in the order of the cases.
    without_path = [case for case in cases if path_of_case(case, paths) is None]
    states = _read_states(without_path, records, jobs)
    case_paths = []
    for case in cases:
        path = path_of_case(case, paths)
        if path is None:
            path = states[_source_of(case)]
        case_paths.append(path)
    return case_paths


def path_of_case(case: PomCase, paths: Mapping[str, Any]) -> Any:
    """Return the path for the record of a case; None without one."""
    return paths.get(case.record, paths.get(Path(case.record).stem))


def _source_of(case: PomCase) -> _Source:
    """Return the files that determine the states of a case."""
    return case.record, case.names, case.aircraft


def _read_states(
    cases: Iterable[PomCase], records: KeptStates, jobs: int
) -> dict[_Source, xr.Dataset]:
    """Return the states of all records; raw records are reconstructed in parallel."""
    first_cases: dict[_Source, PomCase] = {}
    for case in cases:
        first_cases.setdefault(_source_of(case), case)
    stored: dict[_Source, xr.Dataset | None] = {}
    raw: list[_Source] = []
    for source, case in first_cases.items():
        stored[source] = _read_stored_states(case, records)
        if stored[source] is None:
            raw.append(source)
    # One record does not repay the start of a process.
    if len(raw) <= 1:
        jobs = 1
    work = (delayed(records.make)(first_cases[source]) for source in raw)
    reconstructed = dict(zip(raw, process_pool(jobs)(work), strict=True))
    # Keep the order of the cases: the reconstructed records are anywhere among them.
    all_states = {}
    for source, states in stored.items():
        if states is None:
            states = reconstructed[source]
        all_states[source] = states
    return all_states


def _read_stored_states(case: PomCase, records: KeptStates) -> xr.Dataset | None:
    """Return the states in the record or in the store; None if it has to be reconstructed."""
    states = read_path_states(case.record)
    if states is None:
        return records.read(case)
    return states


def check_plans(plans: Iterable[ReplayPlan], models: Models) -> None:
    """Raise if a model cannot fly a case; every problem is reported once, with its cases."""
    cases: dict[tuple[str, str, str], list[str]] = {}
    for plan in plans:
        for name, model in models.of(plan.case).items():
            try:
                check_plan(plan, model)
            except SchemaError as error:
                for text in error.problems:
                    cases.setdefault((error.what, name, text), []).append(plan.case.name)
    if cases:
        problems = []
        for (what, name, text), case_names in cases.items():
            unique = ", ".join(dict.fromkeys(case_names))
            problems.append(f"{what} ({name}): {text}; case {unique}")
        raise SchemaError("replay", problems)

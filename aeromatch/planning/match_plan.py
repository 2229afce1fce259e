"""The plan of a match: its steps, inputs and products, and all problems that prevent it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

import flightmech
import flighttest
import pom
from aeromatch.planning import model_checks
from aeromatch.planning.case_checks import CaseChecks
from aeromatch.planning.record_looks import LookTask, RecordLook, RecordLooks
from aeromatch.planning.steps import products_of, run_collecting_problems, steps_of
from aeromatch.project.project import Project
from aeromatch.workflow.steps import a_priori, add_missing_terms, before_flight, databases_before
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchError, SchemaError, UnknownName
from flightmech.support.atomic_write import resolve_folder
from flightmech.support.kept_stages.sharing import demand_scheduler
from flightmech.support.kept_stages.stages import Kept, Stages
from pom.cases.case import PomCase


@dataclass(frozen=True)
class MatchOptions:
    """Options of a match that its plan depends on.

    Attributes
    ----------
    scheduler : str or None
        Address of a dask.distributed cluster.
    resume : Path or None
        Folder that keeps flights.
    samples : int
        Draws of the final model.
    compare : bool
        Whether the tables are made in all ways.
    """

    scheduler: str | None = None
    resume: str | Path | None = None
    samples: int = 0
    compare: bool = False


@dataclass
class MatchPlan:
    """What a match will do.

    Attributes
    ----------
    project : Project
    cases : list of PomCase
        Those that can be read.
    looks : dict of str to RecordLook
        By record, in the order in which the match reads them.
    steps, products : list of str
    problems : list of str
        All that stands in the way; empty if the match can begin.
    """

    project: Project
    cases: list[PomCase] = field(default_factory=list)
    looks: dict[str, RecordLook] = field(default_factory=dict)
    steps: list[str] = field(default_factory=list)
    products: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)

    def demand(self) -> None:
        """Raise all problems, if there are any.

        Raises
        ------
        SchemaError
        """
        if self.problems:
            raise SchemaError(f"{self.project.file}: nothing was computed", self.problems)

    def record_rows(self) -> list[dict[str, Any]]:
        """Return a row for every record: its span [s], its channels, and what it is for."""
        return [self._record_row(look) for look in self.looks.values()]

    def _record_row(self, look: RecordLook) -> dict[str, Any]:
        purpose = [
            f"{place} ({count}: {seconds:.0f} s)" if count else place
            for place, (count, seconds) in look.taken.items()
        ]
        purpose += [
            f"case {case.name}" for case in self.cases if Path(case.record).stem == look.name
        ]
        return {
            "record": look.name,
            "start": look.first,
            "end": look.last,
            "channels": look.channels,
            "for": "; ".join(purpose),
        }

    def fit_rows(self) -> list[dict[str, Any]]:
        """Return a row for every fit: its records, manoeuvres and windows, time [s] and models."""
        rows = []
        for fit in self.project.fits:
            taken = [
                look.taken.get(f"fit {fit.name!r}", (0, 0.0))
                for name, look in self.looks.items()
                if name in fit.records
            ]
            count, seconds = sum(number for number, _ in taken), sum(span for _, span in taken)
            rows.append(
                {
                    "fit": fit.name,
                    "records": len(fit.records),
                    "windows": count,
                    "seconds": seconds,
                    "models": list(fit.models),
                }
            )
        return rows

    def case_rows(self) -> list[dict[str, Any]]:
        """Return a row for every case: its row of the tolerance table, record, window [s], drives
        and judged criteria.
        """
        return [
            {
                "id": case.id,
                "case": case.name,
                "title": case.title,
                "record": Path(case.record).stem,
                "start": case.window[0],
                "end": case.window[1],
                "drive": f"{case.drive.surfaces}, {case.drive.engine}",
                "criteria": sum(criterion.applies for criterion in case.criteria),
            }
            for case in self.cases
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as plain data."""
        return {
            "project": str(self.project.file),
            "title": self.project.title,
            "steps": self.steps,
            "records": self.record_rows(),
            "fits": self.fit_rows(),
            "cases": self.case_rows(),
            "products": self.products,
            "problems": self.problems,
        }


def make_plan(
    project: Project,
    folder: str | Path,
    jobs: int = 1,
    options: MatchOptions | None = None,
    stages: Stages | None = None,
    keep_records: bool = False,
) -> MatchPlan:
    """Return the plan of a match, with every problem that its inputs show.

    The a-priori database is built, every record is read, and its path is set up at start values;
    nothing is estimated, and nothing is written into the folder.

    Parameters
    ----------
    project : Project
    folder : path
        Where the match would write.
    jobs : int
        Processes that read records, where the system can fork; -1 for one per core. The plan is the
        same for any number.
    options : MatchOptions, optional
    stages : Stages, optional
        Those of the match: they keep the a-priori database and each check that found no problem.
    keep_records : bool
        Whether they keep the records, too, for a match that follows.

    Returns
    -------
    MatchPlan
    """
    chosen, plan, stages = options or MatchOptions(), MatchPlan(project), stages or Stages()
    custody = pom.archive.Custody()
    problems = plan.problems
    _check_places(Path(folder), chosen, problems)
    for file in project.cases:
        case = run_collecting_problems(problems, "", pom.read_case, file)
        plan.cases += [case] if case is not None else []
    problems += model_checks.name_problems(project)
    aircraft = run_collecting_problems(problems, "", flightmech.read_aircraft, project.aircraft)
    apriori = (
        run_collecting_problems(problems, "", before_flight, project, aircraft)
        if aircraft is not None
        else None
    )
    names = _record_names(project, plan.cases, problems)
    if aircraft is not None and apriori is not None:
        problems += model_checks.submodel_structure_problems(project, apriori, aircraft)
        build = cache(lambda: _databases(project, aircraft, custody, stages, problems))
        tasks = _tasks(project, plan.cases, aircraft, names, problems)
        plan.looks = RecordLooks(project, custody, stages, jobs, keep_records).take(tasks, build)
        problems += [text for look in plan.looks.values() for text in look.problems]
        _check_models(plan, apriori, aircraft, build(), stages, custody, problems)
    if chosen.samples:
        model_checks.aircraft_of_cases((case.aircraft for case in plan.cases), problems)
    plan.problems = list(dict.fromkeys(problems))
    plan.steps = steps_of(project, names, len(plan.cases), chosen.compare)
    plan.products = products_of(project, plan.cases, chosen.compare)
    return plan


def _check_places(folder: Path, chosen: MatchOptions, problems: list[str]) -> None:
    """Check that the folders can be written, and that the cluster answers."""
    for place, written in (("output", folder), ("--resume", chosen.resume)):
        if written is None:
            continue
        path = Path(written)
        if path.parent.is_dir():
            run_collecting_problems(problems, place, resolve_folder, path)
            continue
        above = next((parent for parent in path.absolute().parents if parent.exists()), Path("/"))
        if not above.is_dir():
            problems.append(f"{place}: {above} is a file; name another folder")
        elif not os.access(above, os.W_OK):
            problems.append(f"{place}: nothing can be written into {above}; name another folder")
    if chosen.scheduler:
        run_collecting_problems(problems, "--scheduler", demand_scheduler, chosen.scheduler)


def _record_names(
    project: Project, cases: Sequence[PomCase], problems: list[str]
) -> dict[str, bool]:
    """Return the records that the match reads, in its order, and whether each identifies something."""
    named = [case.name for case in cases]
    doubled = [name for name in dict.fromkeys(named) if named.count(name) > 1]
    problems += [
        f"{named.count(name)} cases are named {name!r}; give each a name of its own"
        for name in doubled
    ]
    found = {record: True for fit in project.fits for record in fit.records}
    found |= {
        record: True
        for flown in project.submodels.values()
        for one in flown
        for record in one.records
    }
    for case in cases:
        record = Path(case.record).stem
        if record not in project.flights:
            problems.append(f"case {case.name}: {UnknownName(record, project.flights, 'record')}")
        else:
            found.setdefault(record, False)
    return found


def _tasks(
    project: Project,
    cases: Sequence[PomCase],
    aircraft: Aircraft,
    names: Mapping[str, bool],
    problems: list[str],
) -> list[LookTask]:
    given: Mapping[str, pd.DataFrame] = {}
    if project.manoeuvres is not None:
        given = (
            run_collecting_problems(
                problems, "manoeuvres", flighttest.records.read_manoeuvres, project.manoeuvres
            )
            or {}
        )
        problems += [
            f"manoeuvres: {UnknownName(name, project.flights, 'record')}"
            for name in given
            if name not in project.flights
        ]
    return [LookTask.of(name, project, aircraft, cases, given.get(name)) for name in names]


def _databases(
    project: Project,
    aircraft: Aircraft,
    custody: pom.archive.Custody,
    stages: Stages,
    problems: list[str],
) -> dict[str, Kept[xr.DataTree]]:
    """Return the databases before the flights, by the model that they belong to; empty if they
    cannot be made.
    """
    try:
        datcom, start = databases_before(project, aircraft, custody, stages)
        return {"datcom": datcom, "final": start}
    except (AeromatchError, OSError):
        # what is wrong with the listings, and with what is opened, one after the other
        prior = run_collecting_problems(problems, "listings", a_priori, project, aircraft)
    if prior is None:
        return {}
    opening = run_collecting_problems(problems, "", add_missing_terms, project, prior)
    return {
        "datcom": stages.given(prior),
        "final": stages.given(prior if opening is None else opening),
    }


def _check_models(
    plan: MatchPlan,
    apriori: Aircraft,
    aircraft: Aircraft,
    databases: Mapping[str, Kept[xr.DataTree]],
    stages: Stages,
    custody: pom.archive.Custody,
    problems: list[str],
) -> None:
    """Check the databases with what enters them, and every case with every model that will fly it."""
    project = plan.project
    published = model_checks.published_fits(project, problems)
    starts = {
        name: look.start
        for name, look in plan.looks.items()
        if look.start is not None and _forms_coefficients(look)
    }
    names = model_checks.coefficient_names(project, aircraft, starts, stages, problems)
    problems += model_checks.regressor_problems(project, names)
    problems += model_checks.height_problems(project, names)
    if databases:
        start = databases["final"].value
        problems += model_checks.term_problems(project, start, published)
        problems += model_checks.variable_problems(project, start, names)
    windows = {number: _window(plan, case) for number, case in enumerate(plan.cases)}
    checks = CaseChecks(project, custody, stages)
    problems += checks.problems(
        plan.cases, windows, databases, {"datcom": apriori, "final": aircraft}
    )


def _window(plan: MatchPlan, case: PomCase) -> xr.Dataset | None:
    """Return the states over the window of a case; None where they cannot be had."""
    look = plan.looks.get(Path(case.record).stem)
    return look.windows.get(case.name) if look is not None else None


def _forms_coefficients(look: RecordLook) -> bool:
    """Return whether the match forms the aerodynamic coefficients along a record."""
    return any(place.startswith("fit ") or place == "ground_effect.flown" for place in look.taken)

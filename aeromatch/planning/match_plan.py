"""Plan of a match: its steps, inputs and products, and all problems that prevent it."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

import aerodb
import flightmech
import pom
from aeromatch.planning import model_checks, remarks
from aeromatch.planning.case_checks import CaseChecks
from aeromatch.planning.record_look import LookTask, RecordLook
from aeromatch.planning.record_looks import RecordLooks
from aeromatch.planning.repeated_samples import (
    leaked_sample_problems,
    repeated_sample_problems,
)
from aeromatch.planning.resting_variables import resting_remarks
from aeromatch.planning.steps import (
    join_equal_lines,
    products_of,
    run_collecting_problems,
    steps_of,
)
from aeromatch.planning.term_remarks import joined_ranges, term_remarks
from aeromatch.project.project import Project
from aeromatch.rebuilding.match_options import MatchOptions
from aeromatch.workflow.aerodynamics import a_priori, add_missing_terms, before_flight
from aeromatch.workflow.devices import read_devices
from aeromatch.workflow.identified import databases_before
from aeromatch.workflow.windows import AERODYNAMIC, EVERY_MANOEUVRE, records_of
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchError, SchemaError, UnknownName
from flightmech.support.atomic_write import resolve_folder
from flightmech.support.kept_stages.captured_warnings import capture_warnings
from flightmech.support.kept_stages.sharing import demand_scheduler
from flightmech.support.kept_stages.stages import Kept, Stages
from flightmech.terms import list_model_variables
from flighttest.records.manoeuvre_table import read_sound_manoeuvres
from pom.cases.case import PomCase
from pom.cases.fact_agreement import contradictions
from pom.replaying.idle_devices import idle_devices


@dataclass
class MatchPlan:
    """Plan of a match.

    Attributes
    ----------
    project : Project
    cases : list of PomCase
        The cases that can be read.
    looks : dict of str to RecordLook
        By record, in the order in which the match reads them.
    steps, products : list of str
    problems : list of str
        All reasons why the match cannot begin.
    departures : list of str
        Departures of cases and their windows from normal practice, and gaps in the clocks of
        records. The match runs with them, and its verdicts state them.
    remarks : list of str
        Unusual numbers and models that are mostly mistakes. The match runs with them and prints
        them as warnings.
    gaps : list of str
        That nothing identifies, that nothing proves: a match without fits or without cases.
    """

    project: Project
    cases: list[PomCase] = field(default_factory=list)
    looks: dict[str, RecordLook] = field(default_factory=dict)
    steps: list[str] = field(default_factory=list)
    products: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    departures: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    gaps: list[str] = field(default_factory=list)

    def demand(self) -> None:
        """Raise all problems, if there are any.

        Raises
        ------
        SchemaError
        """
        if self.problems:
            raise SchemaError(f"{self.project.file}: nothing was computed", self.problems)

    def record_rows(self) -> list[dict[str, Any]]:
        """Return a row for every record: its span [s], its channels, and its uses."""
        rows = []
        for look in self.looks.values():
            row = {
                "record": look.name,
                "start": look.first,
                "end": look.last,
                "channels": look.channels,
                "for": "; ".join(self._uses_of(look)),
            }
            rows.append(row)
        return rows

    def _uses_of(self, look: RecordLook) -> list[str]:
        """Return the fits, submodels and cases that use a record."""
        uses = []
        for label, (count, seconds) in look.uses.items():
            # A record that cannot be read has no windows.
            if count:
                uses.append(f"{label} ({count}: {seconds:.0f} s)")
            else:
                uses.append(label)
        for case in self.cases:
            if Path(case.record).stem == look.name:
                uses.append(f"case {case.name}")
        return uses

    def fit_rows(self) -> list[dict[str, Any]]:
        """Return a row for every fit: its records, manoeuvres and windows, time [s] and models."""
        rows = []
        for fit in self.project.fit:
            # Number of windows and their time over all records of the fit. [s]
            count, seconds = 0, 0.0
            for name, look in self.looks.items():
                if name in fit.records:
                    windows, duration = look.uses.get(f"fit {fit.name!r}", (0, 0.0))
                    count += windows
                    seconds += duration
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
        """Return a row for every case.

        A row has the row of the tolerance table, record, window [s], drives, and the number of
        criteria that are judged.
        """
        rows = []
        for case in self.cases:
            start, end = case.window
            row = {
                "id": case.id,
                "case": case.name,
                "title": case.title,
                "record": Path(case.record).stem,
                "start": start,
                "end": end,
                "drive": f"{case.drive.surfaces}, {case.drive.engine}",
                "criteria": sum(criterion.applies for criterion in case.criteria),
            }
            rows.append(row)
        return rows

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
            "departures": self.departures,
            "remarks": self.remarks,
            "gaps": self.gaps,
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

    The a-priori database is built, every record is read, and its states are computed at start
    values. No parameter is estimated, and no file is written into the folder.

    Parameters
    ----------
    project : Project
    folder : path
        Output folder of the match.
    jobs : int
        Processes that read records, if the system can fork; -1 for one per core. The plan does not
        depend on the number.
    options : MatchOptions, optional
    stages : Stages, optional
        Stages of the match. They store the a-priori database and each check without a problem.
    keep_records : bool
        Whether they also store the records, for a match that follows.

    Returns
    -------
    MatchPlan
    """
    options = options or MatchOptions()
    stages = stages or Stages()
    plan = MatchPlan(project)
    custody = pom.archive.Custody()
    problems = plan.problems
    # Every check collects its problems, so that one run shows all of them.
    _check_folders(Path(folder), options, problems)
    cases = [
        run_collecting_problems(problems, file.name, pom.read_case, file) for file in project.cases
    ]
    plan.cases += filter(None, cases)
    problems += contradictions(plan.cases)
    plan.departures += remarks.case_statements(plan.cases)
    problems += model_checks.name_problems(project)
    plan.remarks += remarks.project_remarks(project)
    # a case that cannot be read would be missed by its recording, too
    if len(plan.cases) == len(project.cases):
        run_collecting_problems(problems, "", read_devices, project, plan.cases)
    aircraft = run_collecting_problems(problems, "", flightmech.read_aircraft, project.aircraft)
    apriori: Aircraft | None = None
    if aircraft is not None:
        plan.remarks += remarks.aircraft_remarks(aircraft)
        apriori = run_collecting_problems(problems, "", before_flight, project, aircraft)
    names = _record_names(project, plan.cases, problems)
    plan.gaps = remarks.purpose_gaps(project, names)
    if aircraft is not None and apriori is not None:
        problems += model_checks.submodel_structure_problems(project, apriori, aircraft)
        looks = RecordLooks(project, custody, stages, jobs=jobs, keep_records=keep_records)
        checks = _ModelChecks(plan, apriori, aircraft, custody=custody, stages=stages)
        # The databases are built while other processes read the records.
        plan.looks = looks.take(_look_tasks(plan, aircraft, names), meanwhile=checks.databases)
        for look in plan.looks.values():
            problems += look.problems
            plan.departures += look.departures
            plan.remarks += look.remarks
        samples = {name: look.samples for name, look in plan.looks.items()}
        proofs = {name: look.proofs for name, look in plan.looks.items()}
        problems += repeated_sample_problems(samples)
        problems += leaked_sample_problems(samples, proofs)
        plan.remarks += resting_remarks(project, plan.looks)
        ranges = joined_ranges(look.ranges for look in plan.looks.values())
        plan.remarks += term_remarks(project, ranges)
        checks.run()
    if options.samples:
        model_checks.aircraft_of_cases((case.aircraft for case in plan.cases), problems)
    # Two checks may report one problem, and many records have a common one.
    plan.problems = join_equal_lines(problems)
    plan.departures = join_equal_lines(plan.departures)
    plan.remarks = join_equal_lines(plan.remarks)
    plan.steps = steps_of(project, names, len(plan.cases), options.compare_tables)
    plan.products = products_of(project, plan.cases, options.compare_tables)
    return plan


def _check_folders(folder: Path, options: MatchOptions, problems: list[str]) -> None:
    """Check that the folders can be written, and that the cluster is reachable."""
    for label, name in (("output", folder), ("--resume", options.resume)):
        if name is None:
            continue
        path = Path(name)
        if path.parent.is_dir():
            run_collecting_problems(problems, label, resolve_folder, path)
            continue
        # The nearest existing folder gets the new folders.
        parents = (parent for parent in path.absolute().parents if parent.exists())
        parent = next(parents, Path("/"))
        if not parent.is_dir():
            problems.append(f"{label}: {parent} is a file; name another folder")
        elif not os.access(parent, os.W_OK):
            problems.append(f"{label}: nothing can be written into {parent}; name another folder")
    if options.scheduler:
        run_collecting_problems(problems, "--scheduler", demand_scheduler, options.scheduler)


def _record_names(
    project: Project, cases: Sequence[PomCase], problems: list[str]
) -> dict[str, bool]:
    """Return the records of the match in order, and whether each identifies something."""
    case_names = [case.name for case in cases]
    for name in dict.fromkeys(case_names):
        count = case_names.count(name)
        if count > 1:
            problems.append(f"{count} cases are named {name!r}; give each case a different name")
    records = dict.fromkeys(records_of(project), True)
    for case in cases:
        record = Path(case.record).stem
        if record not in project.flights:
            problems.append(f"case {case.name}: {UnknownName(record, project.flights, 'record')}")
        else:
            records.setdefault(record, False)
    return records


def _look_tasks(plan: MatchPlan, aircraft: Aircraft, names: Mapping[str, bool]) -> list[LookTask]:
    """Return the tasks of the looks at the records, with the project's table of manoeuvres."""
    project = plan.project
    tables: Mapping[str, pd.DataFrame] = {}
    faulty: Mapping[str, Collection[str]] = {}
    if project.manoeuvres is not None:
        found = run_collecting_problems(
            plan.problems, "manoeuvres", read_sound_manoeuvres, project.manoeuvres
        )
        # A table without a row that can be read has no manoeuvre for any record.
        faulty = dict.fromkeys(names, (EVERY_MANOEUVRE,))
        if found is not None:
            tables, faulty, problems = found
            plan.problems += [f"manoeuvres: {text}" for text in problems]
    for name in tables:
        if name not in project.flights:
            plan.problems.append(f"manoeuvres: {UnknownName(name, project.flights, 'record')}")
    tasks = []
    for name in names:
        table, known = tables.get(name), faulty.get(name, ())
        task = LookTask.of(name, project, aircraft, cases=plan.cases, table=table, faulty=known)
        tasks.append(task)
    return tasks


class _ModelChecks:
    """Databases before the flights, and checks of all models; the problems go into the plan."""

    def __init__(
        self,
        plan: MatchPlan,
        apriori: Aircraft,
        aircraft: Aircraft,
        custody: pom.archive.Custody,
        stages: Stages,
    ) -> None:
        self._plan, self._custody, self._stages = plan, custody, stages
        self._apriori, self._aircraft = apriori, aircraft
        self._databases: dict[str, Kept[xr.DataTree]] | None = None

    def databases(self) -> dict[str, Kept[xr.DataTree]]:
        """Return the databases before the flights by model; none after an error."""
        if self._databases is not None:
            return self._databases
        if self._plan.project.prior:
            # warnings of estimates are often slips of sign or unit, and belong to the remarks
            databases, texts = capture_warnings(self._build_databases)
            self._plan.remarks += [f"prior: {text}" for text in texts]
        else:
            databases = self._build_databases()
        self._databases = databases
        return databases

    def _build_databases(self) -> dict[str, Kept[xr.DataTree]]:
        project, problems = self._plan.project, self._plan.problems
        try:
            datcom, start = databases_before(
                project, self._aircraft, self._custody, stages=self._stages
            )
            return {project.prior_model: datcom, "final": start}
        except (AeromatchError, OSError):
            # The two steps are repeated one by one, so that each error has its place.
            prior = run_collecting_problems(
                problems,
                "prior" if project.prior else "listings",
                a_priori,
                project,
                self._aircraft,
            )
        if prior is None:
            return {}
        opened = run_collecting_problems(problems, "", add_missing_terms, project, prior)
        if opened is None:
            opened = prior
        return {
            project.prior_model: self._stages.given(prior),
            "final": self._stages.given(opened),
        }

    def run(self) -> None:
        """Check the databases with their updates, and every case with every model."""
        plan, project, problems = self._plan, self._plan.project, self._plan.problems
        databases = self.databases()
        published = model_checks.published_fits(project, problems)
        starts = {}
        for name, look in plan.looks.items():
            if look.start is not None and _forms_coefficients(look):
                starts[name] = look.start
        names = model_checks.coefficient_names(
            project, self._aircraft, starts, stages=self._stages, problems=problems
        )
        problems += model_checks.regressor_problems(project, names)
        problems += model_checks.height_problems(project, names)
        problems += model_checks.station_problems(project, self._aircraft)
        if databases:
            start = databases["final"].value
            problems += model_checks.term_problems(project, start, published)
            problems += model_checks.variable_problems(project, start, names)
            plan.remarks += model_checks.unplaced_remarks(project, start)
            plan.remarks += remarks.ice_remarks(start, plan.cases, plan.looks)
        windows: dict[int, xr.Dataset | None] = {}
        for number, case in enumerate(plan.cases):
            look_of_case = plan.looks.get(Path(case.record).stem)
            # A case whose record has a problem has no states.
            known = {} if look_of_case is None else look_of_case.windows
            windows[number] = known.get(case.name)
        plan.departures += self._idle_devices(databases, windows)
        problems += CaseChecks(project, self._custody, self._stages).problems(
            plan.cases,
            windows,
            databases=databases,
            aircraft={project.prior_model: self._apriori, "final": self._aircraft},
        )

    def _idle_devices(
        self,
        databases: Mapping[str, Kept[xr.DataTree]],
        windows: Mapping[int, xr.Dataset | None],
    ) -> list[str]:
        """Return the devices that a case sets and a database has no term for, a line each."""
        models: dict[str, list[str]] = {}
        for name, database in databases.items():
            variables: set[str] = set()
            for leaf in aerodb.terms(database.value).values():
                variables.update(list_model_variables(leaf))
            for number, case in enumerate(self._plan.cases):
                for text in idle_devices(case, windows[number], variables):
                    models.setdefault(f"case {case.name}: {text}", []).append(name)
        return [f"{text} (model {', '.join(names)})" for text, names in models.items()]


def _forms_coefficients(look: RecordLook) -> bool:
    """Return whether the match forms the aerodynamic coefficients along a record."""
    return any(
        label.startswith("fit ") or label.partition(".")[0] in AERODYNAMIC for label in look.uses
    )

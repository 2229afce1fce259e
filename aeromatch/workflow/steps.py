"""The main job, step by step: each step takes what the one before gives, none prints."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd
import xarray as xr

import aerodb
import flightmech
import flighttest
import pom
from aerodb.figures.lr743_set.flown import FLOWN
from aeromatch.project.project import Project
from aeromatch.rebuilding.products import (
    MatchOutcome,
    add_model_samples,
    model_files,
    of_cases,
    replay_cases,
    write_files,
)
from aeromatch.workflow.flown import flown_tree
from aeromatch.workflow.submodels import (
    Spans,
    Submodels,
    find_case_overlaps,
    identified_controls,
    identified_engine,
    identified_gear,
    identified_ground_effect,
    raise_problems,
    spans_of,
    terms_near_ground,
    with_engine,
)
from datcom_io.reading.reader import read_place
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.parts import different_parts
from flightmech.errors import SchemaError, UnknownName
from flightmech.support.atomic_write import folder_written_atomically, resolve_folder
from flightmech.support.kept_stages.content_hashes import FileContent
from flightmech.support.kept_stages.sharing import open_cluster
from flightmech.support.kept_stages.stages import Kept, Stages, Values
from flighttest.reconstruction.flight_programme import reconstructed_paths
from flighttest.regression.combining.joined_fits import coloured_covariance, table_samples
from flighttest.regression.combining.published_table import read_published
from flighttest.submodels.control_loading.result import replace_hinge_moments
from flighttest.submodels.ground_effect.result import replace_ground_effect
from pom.checking.case_check import RecordCheck, checks_text, with_record_checks
from pom.diagnosis.corrected_model import joint_terms
from pom.diagnosis.joint_correction import diagnosed_cases
from pom.diagnosis.term_swaps import by_submodel, differing_terms

Step = Callable[[str], AbstractContextManager[None]]
REPORT = "report"
_TABLES_STEP = {
    "tabulate": "join {} local models",
    "direct": "regress samples",
    "join": "join {} local models by regression",
}
COMPARED = "tables_compared.csv"
_OURS = re.compile(
    rf"(datcom|corrected|final)(\.nc|\.toml|\.fmu|_engine\d+\.nc|_fuel\.nc)|{re.escape(FLOWN)}|{re.escape(COMPARED)}"
)


def a_priori(project: Project, aircraft: Aircraft) -> xr.DataTree:
    """Return the database of the project's DATCOM listings."""
    listings: dict[str, Any] = {
        role: [read_place(place) for place in places] for role, places in project.listings.items()
    }
    stated: dict[str, Any] = dict(project.stated)
    return aerodb.from_datcom(aircraft, altitude=project.altitude, **listings, **stated)


def add_missing_terms(project: Project, prior: xr.DataTree) -> xr.DataTree:
    """Return the a-priori database with the terms that DATCOM cannot give, as zeros with wide
    standard errors.

    Raises
    ------
    SchemaError
        A new term is faulty, or a term to be held is not in the database; all of them.
    """
    db = aerodb.replace_terms(
        prior,
        {name: term.leaf() for name, term in project.terms.items()},
        note="opened for the flights",
    )
    known = aerodb.terms(db)
    unknown = [
        f"held: {UnknownName(name, known, 'term')}" for name in project.held if name not in known
    ]
    if unknown:
        raise SchemaError(str(project.file), unknown)
    return db


def records_of(project: Project, cases: Sequence[Any] = ()) -> list[str]:
    """Return the records that the fits and submodels of a project and the given cases need, in
    order.

    Raises
    ------
    SchemaError
        Cases whose record is not among the flights of the project, and cases of one name; all of
        them.
    """
    named = [case.name for case in cases]
    flown = {case.name: Path(case.record).stem for case in cases}
    unknown = [
        f"case {name}: {UnknownName(record, project.flights, 'record')}"
        for name, record in flown.items()
        if record not in project.flights
    ]
    unknown += [
        f"{named.count(name)} cases are named {name!r}; give each a name of its own"
        for name in flown
        if named.count(name) > 1
    ]
    if unknown:
        raise SchemaError(str(project.file), unknown)
    fitted = [record for fit in project.fits for record in fit.records]
    submodels = [
        record for flown in project.submodels.values() for one in flown for record in one.records
    ]
    return list(dict.fromkeys([*fitted, *submodels, *flown.values()]))


def inputs_of(project: Project, names: Iterable[str]) -> list[Path]:
    """Return every file that the results rest on, with the flight records named."""
    flights = [project.flights[name] for name in names]
    listings = list(
        dict.fromkeys(place.file for places in project.listings.values() for place in places)
    )
    aircraft = [project.aircraft, *([project.apriori] if project.apriori else [])]
    return [
        project.file,
        *aircraft,
        *([project.names] if project.names else []),
        *listings,
        *flights,
        *project.cases,
        *project.tables.values(),
        *([project.manoeuvres] if project.manoeuvres else []),
        *project.published,
    ]


def before_flight(project: Project, aircraft: Aircraft) -> Aircraft:
    """Return the aircraft of the a-priori model: that of the project's file `apriori`, or the same."""
    return flightmech.read_aircraft(project.apriori) if project.apriori else aircraft


@dataclass(frozen=True)
class IdentificationWindows:
    """Start and end of the manoeuvres that identify something, by record. [s]

    Attributes
    ----------
    fits : list of dict
        One for every fit of the project.
    submodels : dict of str to dict
        By the place in the project file.
    """

    fits: list[Spans]
    submodels: dict[str, Spans]


def marks_of(
    project: Project, records: Mapping[str, xr.DataTree], problems: list[str]
) -> dict[str, pd.DataFrame]:
    """Return the manoeuvres of the records that a project needs: those of the project's table, else
    their own; and their flight modes.

    Parameters
    ----------
    project : Project
    records : mapping of str to DataTree
    problems : list of str
        Gets a line for every record of the table that is not among the flights.
    """
    own = {name: flighttest.manoeuvres(records[name]) for name in records_of(project)}
    given = flighttest.records.read_manoeuvres(project.manoeuvres) if project.manoeuvres else {}
    problems += [
        f"manoeuvres: {UnknownName(name, project.flights, 'record')}"
        for name in given
        if name not in project.flights
    ]
    listed = {
        name: [given.get(name, table), flighttest.records.flight_modes(records[name])]
        for name, table in own.items()
    }
    return {
        name: pd.concat([table for table in tables if len(table)] or tables, ignore_index=True)
        for name, tables in listed.items()
    }


def select_windows(
    project: Project,
    records: Mapping[str, xr.DataTree],
    cases: Sequence[Any] = (),
    marks: tuple[Mapping[str, pd.DataFrame], Sequence[str]] | None = None,
) -> IdentificationWindows:
    """Return what is taken of the records, by name, for every fit and submodel of a project.

    `marks` are the tables of `marks_of` with the problems it listed, where they are there already.

    Raises
    ------
    SchemaError
        Manoeuvres that a record does not have, faults of the table of manoeuvres, and windows that
        overlap with a case: what proves the model must not identify it; all of them.
    """
    problems: list[str] = list(marks[1]) if marks is not None else []
    tables = marks[0] if marks is not None else marks_of(project, records, problems)
    fits = [spans_of(f"fit {fit.name!r}", [fit], tables, problems) for fit in project.fits]
    submodels = {
        place: spans_of(place, flown, tables, problems)
        for place, flown in project.submodels.items()
    }
    named = [
        *((f"fit {fit.name!r}", spans) for fit, spans in zip(project.fits, fits, strict=True)),
        *submodels.items(),
    ]
    problems += [text for place, spans in named for text in find_case_overlaps(place, spans, cases)]
    raise_problems(project, problems)
    return IdentificationWindows(fits, submodels)


def reconstruct_records(
    project: Project, aircraft: Aircraft, records: Mapping[str, xr.DataTree], jobs: int
) -> dict[str, Any]:
    """Return the paths of all records by name; those that only prove the model give the others
    nothing.

    A project that identifies nothing reconstructs its records as one programme.
    """
    identifying = [name for name in records_of(project) if name in records] or list(records)
    proving = [name for name in records if name not in identifying]
    found = flighttest.reconstruct_programme(
        [records[name] for name in identifying],
        aircraft,
        jobs=jobs,
        validation=[records[name] for name in proving],
    )
    return dict(zip([*identifying, *proving], found, strict=True))


def _threads(jobs: int) -> int:
    """Return a number of threads; -1 is one per core, as it is for processes."""
    return jobs if jobs > 0 else os.cpu_count() or 1


def coefficients_of(
    project: Project,
    aircraft: Aircraft,
    paths: Mapping[str, Any],
    windows: IdentificationWindows,
    jobs: int = 1,
) -> dict[str, xr.Dataset]:
    """Return the aerodynamic coefficients along the records that a fit or the ground effect takes,
    by name; `jobs` threads.
    """
    needed = [*windows.fits, windows.submodels.get("ground_effect.flown", {})]
    names = dict.fromkeys(name for spans in needed for name in spans)

    def found(name: str) -> xr.Dataset:
        return flighttest.coefficients(paths[name], aircraft, project.errors, project.cutoff)

    with ThreadPoolExecutor(_threads(jobs)) as pool:
        return dict(zip(names, pool.map(found, names)))


def rests_on(
    project: Project, windows: IdentificationWindows, cases: Sequence[Any]
) -> dict[str, str]:
    """Return which records each part of the model and each case rests on, in words, for the report.

    A record that identifies over one stretch of time and proves over another is stated: its
    instruments come from all of it.
    """
    identifying = records_of(project)
    proved = [Path(case.record).stem for case in cases]
    found = {"constants of the instruments": ", ".join(identifying or dict.fromkeys(proved))}
    found |= {
        f"fit {fit.name}": ", ".join(spans)
        for fit, spans in zip(project.fits, windows.fits, strict=True)
    }
    found |= {place: ", ".join(spans) for place, spans in windows.submodels.items()}
    for case, record in zip(cases, proved, strict=True):
        found[f"case {case.name}"] = (
            f"{record}, which identifies too, at other times" if record in identifying else record
        )
    return found


def fit_records(
    project: Project, data: Mapping[str, xr.Dataset], windows: IdentificationWindows, jobs: int = 1
) -> list[Any]:
    """Return one `flighttest.Fit` per record and model of every fit, and those published.

    Parameters
    ----------
    project : Project
    data : mapping of str to Dataset
        From `coefficients_of`.
    windows : Windows
    jobs : int
        Threads.
    """

    taken = [
        (fit, *place)
        for fit, places in zip(project.fits, windows.fits, strict=True)
        for place in places.items()
    ]
    with ThreadPoolExecutor(_threads(jobs)) as pool:
        made = pool.map(
            lambda one: fit_local_models(
                data[one[1]], one[2], one[0].models, f"{one[1]}: {one[0].name}"
            ),
            taken,
        )
        local = [fit for fits in made for fit in fits]
    return [*local, *(fit for file in project.published for fit in read_published(file))]


def fit_local_models(
    data: xr.Dataset, spans: Sequence[tuple[float, float]], models: Sequence[str], name: str
) -> list[Any]:
    """Return the local models of one fit on one record."""
    parts = [flighttest.select_time(data, *span) for span in spans]
    return [
        flighttest.regress(flighttest.RegressionModel.parse(model), parts, name=name)
        for model in models
    ]


def samples_of(
    project: Project,
    start: xr.DataTree,
    data: Mapping[str, xr.Dataset],
    windows: IdentificationWindows,
) -> list[xr.Dataset]:
    """Return the samples behind every fit of the project, for tables estimated directly from them;
    names as those of `fit_records`.
    """
    found = []
    for fit, places in zip(project.fits, windows.fits, strict=True):
        coefficients = dict.fromkeys(
            flighttest.RegressionModel.parse(model).coefficient for model in fit.models
        )
        for record, spans in places.items():
            parts = [flighttest.select_time(data[record], *span) for span in spans]
            found += [
                table_samples(coefficient, start, parts, f"{record}: {fit.name}")
                for coefficient in coefficients
            ]
    return found


WAYS: dict[str, Callable[[Project, xr.DataTree, Sequence[Any], Sequence[xr.Dataset]], Any]] = {
    "tabulate": lambda project, start, fits, samples: aerodb.tabulate(
        fits, start, held=project.held, unplaced=project.unplaced
    ),
    "direct": lambda project, start, fits, samples: aerodb.update.regress_tables(
        samples,
        start,
        coloured_covariance,
        project.held,
        fits=_without_samples(fits, samples),
        unplaced=project.unplaced,
        local=_with_samples(fits, samples),
    ),
    "join": lambda project, start, fits, samples: aerodb.update.join_submodels(
        fits, start, held=project.held, unplaced=project.unplaced
    ),
}
"""How flights enter the tables, by the key ``tabulation`` of a project; from fits (`fit_records`) and samples (`samples_of`)."""


def _without_samples(fits: Sequence[Any], samples: Sequence[xr.Dataset]) -> list[Any]:
    """Return the fits of which there are no samples: those published."""
    return [fit for fit in fits if not _has_samples(fit, samples)]


def _with_samples(fits: Sequence[Any], samples: Sequence[xr.Dataset]) -> list[Any]:
    """Return the fits of the samples."""
    return [fit for fit in fits if _has_samples(fit, samples)]


def _has_samples(fit: Any, samples: Sequence[xr.Dataset]) -> bool:
    known = {(one.attrs["coefficient"], one.attrs["name"]) for one in samples}
    return (fit.estimates.attrs["coefficient"], fit.name) in known


def final_database(
    project: Project, start: xr.DataTree, fits: Sequence[Any], samples: Sequence[xr.Dataset] = ()
) -> tuple[xr.DataTree, Any]:
    """Return the database after the flights, and the tabulation behind it.

    Parameters
    ----------
    project : Project
        Its `tabulation` is one of `WAYS`.
    start : DataTree
        From `add_missing_terms`.
    fits : sequence of Fit
        From `fit_records`.
    samples : sequence of Dataset
        From `samples_of`; used by the way ``direct`` only.
    """
    tabulation = WAYS[project.tabulation](project, start, fits, samples)
    final = aerodb.replace_terms(start, tabulation, note="identified from flight")
    final.attrs["title"] = f"{project.title}: database after flight"
    return final, tabulation


def compare_tables(
    project: Project,
    start: xr.DataTree,
    fits: Sequence[Any],
    samples: Sequence[xr.Dataset],
    known: Mapping[str, Any] | None = None,
) -> pd.DataFrame:
    """Return the nodes of all `WAYS` side by side (`aerodb.update.compare_ways`); `known` holds
    tabulations that are there already.
    """
    found = dict(known or {})
    return aerodb.update.compare_ways(
        {way: found.get(way) or make(project, start, fits, samples) for way, make in WAYS.items()},
        start,
    )


def with_submodels(database: xr.DataTree, found: Submodels, tables: bool = False) -> xr.DataTree:
    """Return a database with the identified hinge moments and ground effect; `tables` as in
    `replace_ground_effect`.
    """
    for loading in found.controls.values():
        database = replace_hinge_moments(database, loading)
    return (
        database
        if found.ground_effect is None
        else replace_ground_effect(database, found.ground_effect, tables)
    )


def after_flight(project: Project, aircraft: Aircraft, found: Submodels) -> Aircraft:
    """Return the aircraft with its identified engines and control circuits; the landing gear
    follows the aerodynamics.
    """
    if found.engine is not None:
        aircraft = with_engine(aircraft, project, found.engine)
    for loading in found.controls.values():
        aircraft = loading.aircraft(aircraft)
    return aircraft


def perform_match(
    project: Project,
    folder: str | Path,
    jobs: int,
    step: Step,
    command: str = "",
    scheduler: str | None = None,
    resume: str | Path | None = None,
    samples: int = 0,
    seed: int = 0,
    compare: bool = False,
    stages: Stages | None = None,
) -> MatchOutcome:
    """Do the whole job of a project and write databases, FMUs and report into a folder.

    The folder is exchanged as a whole in the end, so that its databases, FMUs and report are always
    of one job.

    Parameters
    ----------
    project : Project
    folder : path
        Gets ``datcom.nc corrected.nc final.nc``, the aircraft that belong to them as ``.toml``,
        both as ``.fmu``, ``flown.nc`` (what they were identified from, for the figures of LR-743),
        and ``report/``. What else is in it stays.
    jobs : int
        Processes for reconstruction, diagnosis and replay, threads for the steps between them; -1
        for one per core.
    step : callable
        ``with step("text"):`` surrounds every step, for progress.
    command : str
        Command line, for the report.
    scheduler : str, optional
        Address of a cluster (`pom.replay_all`), whose workers reconstruct, form coefficients, fit,
        diagnose, replay, sample and draw.
    resume : path, optional
        Of `pom.replay_all`: the folder that keeps its flights.
    samples, seed : int
        Draws of the final model (`pom.replay_sampled`); none without.
    compare : bool
        Whether the tables are made in all `WAYS` and compared node by node, in
        ``tables_compared.csv``.
    stages : Stages, optional
        Where the results of stages are kept; without it nothing is.  The files have the same bytes
        either way.

    Returns
    -------
    Outcome

    Raises
    ------
    OSError
        The folder cannot be exchanged
        (`flightmech.support.atomic_write.folder_written_atomically`).
    SimulationError
        As `flightmech.support.kept_stages.sharing.open_cluster`.
    """
    folder = Path(folder)
    if folder.parent.is_dir():
        resolve_folder(folder)  # before the work
    stages = stages or Stages()
    with open_cluster(scheduler) if scheduler else nullcontext(stages.workers) as stages.workers:
        found = run_identification(project, jobs, step, stages, compare)
        folder.parent.mkdir(parents=True, exist_ok=True)
        with folder_written_atomically(folder, _is_ours) as new:
            with step("write three databases, aircraft and FMUs"):
                fmus = _models(found, new, stages)
            custody = found.custody
            custody.take(fmus.values())
            with step(f"replay {len(found.cases)} cases by {len(fmus)} FMUs"):
                inputs = of_cases(
                    found.cases,
                    found.paths,
                    fmus,
                    project.tables,
                    found.databases["final"],
                    found.content,
                )
                options = (
                    {"names": project.tables, "evidence": found.databases["final"].value}
                    if found.cases
                    else {}
                )
                results = replay_cases(
                    stages,
                    inputs,
                    found.cases,
                    fmus,
                    found.paths,
                    jobs=jobs,
                    scheduler=scheduler,
                    resume=resume,
                    **options,
                )
                if samples:
                    draw = {
                        "count": samples,
                        "seed": seed,
                        "errors": project.errors,
                        "names": project.tables,
                    }
                    results = add_model_samples(
                        stages,
                        inputs,
                        results,
                        fmus,
                        {"final": new / "final.nc"},
                        found.paths,
                        draw,
                        jobs,
                    )
            custody.check()
            checks = Values(found.checks)
            results = with_record_checks(results, checks)
            with step("write the report"):
                made_from = pom.provenance(
                    inputs_of(project, found.records), fmus, command, digest=custody.sha256
                )
                made_from["records"] = rests_on(project, found.windows, found.cases)
                if wrong := checks_text(checks.values()):
                    made_from["record_errors"] = wrong
                if project.signatures:
                    made_from["signatures"] = project.signatures
                pom.write_report(
                    results,
                    new / REPORT,
                    title=f"{project.title}: Proof of Match",
                    provenance=made_from,
                    diagnoses=found.diagnoses,
                    kept=_chapters(found, stages).value,
                    chapters=project.chapters,
                    jobs=jobs,
                    stages=stages,
                )
    stages.close()
    return _outcome(found, results, folder / REPORT / "report.html")


@dataclass
class Identified:
    """What a match identified and diagnosed, each result at hand or kept.

    Attributes
    ----------
    project : Project
    custody : Custody
        Of the files that were read.
    cases : list of PomCase
    records : list of str
    windows : Windows
    paths, data : dict of str to Kept
        Reconstructed paths and coefficients by record.
    fits : list of Kept of list of Fit
    marks : Kept
        Manoeuvres by record, and what is wrong with them.
    checks : dict of str to Kept of RecordCheck
        Checks of the records, by name.
    engine, controls, ground_effect, gear : Kept
        Submodels; None where there is none.
    tables : Kept of (DataTree, Tabulation)
    compared : Kept of DataFrame or None
    databases, aircraft : dict of str to Kept
        ``datcom corrected final``.
    diagnoses : dict of str to DataFrame
    """

    project: Project
    custody: pom.archive.Custody
    cases: list[Any]
    records: list[str]
    windows: IdentificationWindows = field(init=False)
    paths: dict[str, Kept[Any]] = field(default_factory=dict)
    data: dict[str, Kept[Any]] = field(default_factory=dict)
    fits: list[Kept[list[Any]]] = field(default_factory=list)
    marks: Kept[Any] = field(init=False)
    checks: dict[str, Kept[RecordCheck]] = field(default_factory=dict)
    engine: Kept[Any] = field(default_factory=lambda: Kept(made=(None,)))
    controls: Kept[Any] = field(default_factory=lambda: Kept(made=(({}, {}, {}),)))
    ground_effect: Kept[Any] = field(default_factory=lambda: Kept(made=(None,)))
    gear: Kept[Any] = field(default_factory=lambda: Kept(made=(None,)))
    tables: Kept[Any] = field(init=False)
    compared: Kept[Any] | None = None
    databases: dict[str, Kept[Any]] = field(default_factory=dict)
    aircraft: dict[str, Kept[Any]] = field(default_factory=dict)
    diagnoses: dict[str, pd.DataFrame] = field(default_factory=dict)

    def content(self, file: Path) -> FileContent:
        """Return a file as an input of a stage, as it was taken into custody."""
        return FileContent(Path(file), self.custody.sha256(file))

    def submodels(self) -> Submodels:
        """Return what was identified next to the aerodynamics."""
        controls, free, driven = self.controls.value
        return Submodels(
            self.engine.value, controls, free, driven, self.ground_effect.value, self.gear.value
        )

    def of_submodels(self) -> dict[str, Kept[Any]]:
        """Return the same as inputs of a stage."""
        return {
            "engine": self.engine,
            "controls": self.controls,
            "ground effect": self.ground_effect,
            "landing gear": self.gear,
        }

    def all_fits(self) -> list[Any]:
        """Return the local models, those of the records first."""
        return [fit for kept in self.fits for fit in kept.value]


def run_identification(
    project: Project, jobs: int, step: Step, stages: Stages, compare: bool = False
) -> Identified:
    """Return everything up to the diagnosis of the cases, stage by stage; parameters as `perform_match`."""
    custody = pom.archive.Custody()
    custody.take([*inputs_of(project, []), *project.models.values()])
    aircraft = flightmech.read_aircraft(project.aircraft)
    apriori: Kept[Any] = stages.given(before_flight(project, aircraft))
    cases = [pom.read_case(file) for file in project.cases]
    found = Identified(project, custody, cases, records_of(project, cases))
    with step(
        f"read {sum(map(len, project.listings.values()))} DATCOM listings, build the "
        f"a-priori database"
    ):
        datcom, start = databases_before(project, aircraft, custody, stages)
    custody.take(inputs_of(project, found.records))
    with step(f"read {len(found.records)} flight records"):
        records = {
            name: stages.one(
                "record",
                record_inputs(project, name, custody),
                partial(record_of, project, name, custody),
                name,
            )
            for name in found.records
        }
        found.marks = _marks(found, records, stages)
        found.windows = select_windows(project, Values(records), cases, found.marks.value)
    with step("check the flight records"):
        found.checks = _checks(found, records, aircraft, jobs, stages)
    with step(
        "reconstruct the states; the records that identify determine the instruments' constants"
    ):
        known = stages.given(aircraft)
        identifying = [name for name in records_of(project) if name in records] or list(records)
        first = {name: records[name] for name in identifying}
        proving = {name: one for name, one in records.items() if name not in first}
        found.paths = reconstructed_paths(
            first, known, jobs=jobs, validation=proving, stages=stages
        )
    if project.engine is not None:  # before the aerodynamics, which need the thrust
        with step("identify the engine"):
            found.engine = _engine(found, apriori, stages)
    if project.controls:
        with step(f"identify the control loading of {', '.join(project.controls)}"):
            found.controls = _controls(found, known, jobs, stages)
    flying = _after_flight(found, known, stages)
    with step(
        f"identify coefficients on "
        f"{len(dict.fromkeys(name for spans in found.windows.fits for name in spans))} "
        f"flight records"
    ):
        found.data = _coefficients(found, flying, jobs, stages)
        found.fits = _fits(found, jobs, stages)
    with step(
        f"{_TABLES_STEP[project.tabulation].format(_count(found))} and the prior into tables"
    ):
        behind = (
            _samples(found, start, stages)
            if compare or project.tabulation == "direct"
            else stages.given([])
        )
        found.tables = _tables(found, start, behind, stages)
    if compare:
        with step(f"make the tables in all {len(WAYS)} ways and compare them"):
            found.compared = _compared(found, start, behind, stages)
    final = found.tables.part("database", lambda both: both[0])
    if (
        project.ground_effect is not None
    ):  # after the aerodynamics, whose lift in free air it multiplies
        with step("identify the ground effect"):
            found.ground_effect = _ground_effect(found, final, stages)
    if project.gear is not None:  # last, for it needs lift and drag near the ground
        with step("identify the landing gear"):
            found.gear = _gear(found, flying, final, stages)
            landing = {"aircraft": flying, "landing gear": found.gear}
            flying = stages.one(
                "aircraft with gear", landing, partial(_with_gear, flying, found.gear)
            )
    final = _final(found, final, stages)
    with step(f"swap terms on {len(cases)} cases, build the corrected database"):
        _diagnose(found, (datcom, final), (apriori, flying), jobs, stages)
    return found


def databases_before(
    project: Project, aircraft: Aircraft, custody: pom.archive.Custody, stages: Stages
) -> tuple[Kept[xr.DataTree], Kept[xr.DataTree]]:
    """Return the a-priori database as the listings give it, and opened for the flights."""
    files = [place.file for places in project.listings.values() for place in places]

    def make() -> xr.DataTree:
        datcom = a_priori(project, aircraft)
        custody.check(files)  # what is kept under the hash of a file is of that file
        return datcom

    listings = {
        role: [
            (FileContent(place.file, custody.sha256(place.file)), place.case) for place in places
        ]
        for role, places in project.listings.items()
    }
    stated = {"altitude": project.altitude, "stated": project.stated}
    datcom = stages.one(
        "a-priori database", {"aircraft": aircraft, "listings": listings, **stated}, make
    )
    asked = {"database": datcom, "terms": project.terms, "held": project.held}
    return datcom, stages.one(
        "opened database", asked, lambda: add_missing_terms(project, datcom.value)
    )


def record_inputs(project: Project, name: str, custody: pom.archive.Custody) -> dict[str, Any]:
    """Return what the stage ``record`` of a flight record depends on: its file, and the name map."""
    files = [project.flights[name], *([project.names] if project.names else [])]
    file, *names = [FileContent(one, custody.sha256(one)) for one in files]
    return {"file": file, "names": names}


def record_of(
    project: Project, name: str, custody: pom.archive.Custody, names: Any = None
) -> xr.DataTree:
    """Return a flight record; `names` is the name map, where it is at hand."""
    record = flighttest.read(project.flights[name], project.names if names is None else names)
    custody.check([project.flights[name], *([project.names] if project.names else [])])
    return record


def _marks(
    found: Identified, records: Mapping[str, Kept[xr.DataTree]], stages: Stages
) -> Kept[tuple[dict[str, pd.DataFrame], list[str]]]:
    """Return the manoeuvres of the records that identify, and what is wrong with the table of them."""
    project = found.project
    table = [project.manoeuvres] if project.manoeuvres else []

    def make() -> tuple[dict[str, pd.DataFrame], list[str]]:
        problems: list[str] = []
        marks = marks_of(project, Values(records), problems)
        found.custody.check(table)
        return marks, problems

    inputs = {
        "records": {name: records[name] for name in records_of(project)},
        "flights": list(project.flights),
    }
    return stages.one(
        "manoeuvres", {**inputs, "table": [found.content(file) for file in table]}, make
    )


def _of(
    spans: Mapping[str, Spans], places: str, results: Mapping[str, Kept[Any]]
) -> dict[str, Any]:
    """Return what a submodel takes of the records as inputs of a stage: spans, and results of the
    records.
    """
    own = {place: records for place, records in spans.items() if place.startswith(places)}
    names = dict.fromkeys(name for records in own.values() for name in records)
    return {"spans": own, "records": {name: results[name] for name in names}}


def _engine(found: Identified, apriori: Kept[Aircraft], stages: Stages) -> Kept[Any]:
    project, spans = found.project, found.windows.submodels
    points = list(project.points.values())

    def make() -> Any:
        engine = identified_engine(project, apriori.value, Values(found.paths), spans)
        found.custody.check(points)
        return engine

    found.custody.take(points)
    files = {name: found.content(file) for name, file in project.points.items()}
    return stages.one(
        "engine",
        {
            "settings": project.engine,
            "files": files,
            "aircraft": apriori,
            **_of(spans, "engine.", found.paths),
        },
        make,
    )


def _controls(found: Identified, aircraft: Kept[Aircraft], jobs: int, stages: Stages) -> Kept[Any]:
    project, spans = found.project, found.windows.submodels

    def make() -> Any:
        return identified_controls(
            project, aircraft.value, Values(found.paths), spans, _threads(jobs)
        )

    return stages.one(
        "control loading",
        {
            "settings": project.controls,
            "aircraft": aircraft,
            **_of(spans, "controls.", found.paths),
        },
        make,
    )


def _after_flight(found: Identified, aircraft: Kept[Aircraft], stages: Stages) -> Kept[Aircraft]:
    """Return the aircraft with its identified engines and control circuits."""
    if found.project.engine is None and not found.project.controls:
        return aircraft
    inputs = {
        "aircraft": aircraft,
        "settings": found.project.engine,
        "engine": found.engine,
        "controls": found.controls,
    }
    return stages.one(
        "aircraft", inputs, lambda: after_flight(found.project, aircraft.value, found.submodels())
    )


def _checks(
    found: Identified,
    records: Mapping[str, Kept[xr.DataTree]],
    aircraft: Aircraft,
    jobs: int,
    stages: Stages,
) -> dict[str, Kept[RecordCheck]]:
    """Return the checks of the flight records by name."""
    inputs = {name: {"record": record, "aircraft": aircraft} for name, record in records.items()}

    def arguments(name: str) -> tuple[Any, ...]:
        return name, records[name].value, aircraft

    return stages.each("record check", inputs, RecordCheck.of, arguments, jobs)


def _coefficients(
    found: Identified, aircraft: Kept[Aircraft], jobs: int, stages: Stages
) -> dict[str, Kept[xr.Dataset]]:
    project, windows = found.project, found.windows
    needed = [*windows.fits, windows.submodels.get("ground_effect.flown", {})]
    settings = {"aircraft": aircraft, "errors": project.errors, "cutoff": project.cutoff}
    inputs = {
        name: {"path": found.paths[name], **settings}
        for name in dict.fromkeys(name for spans in needed for name in spans)
    }

    def arguments(name: str) -> tuple[Any, ...]:
        return found.paths[name].value, aircraft.value, project.errors, project.cutoff

    return stages.each(
        "coefficients",
        inputs,
        flighttest.coefficients,
        arguments,
        _threads(jobs),
        threads=stages.local,
    )


def _fits(found: Identified, jobs: int, stages: Stages) -> list[Kept[list[Any]]]:
    """Return the local models of every fit and record in their order, then those published."""
    calls: dict[str, tuple[Any, ...]] = {}
    for number, (fit, places) in enumerate(
        zip(found.project.fits, found.windows.fits, strict=True), 1
    ):
        for record, spans in places.items():
            calls[f"{number} {fit.name}, {record}"] = (
                record,
                spans,
                fit.models,
                f"{record}: {fit.name}",
            )
    inputs = {
        item: {"coefficients": found.data[record], "fit": rest}
        for item, (record, *rest) in calls.items()
    }

    def arguments(item: str) -> tuple[Any, ...]:
        return found.data[calls[item][0]].value, *calls[item][1:]

    local = stages.each(
        "fit", inputs, fit_local_models, arguments, _threads(jobs), threads=stages.local
    )
    published = [
        stages.one(
            "published fits",
            {"file": found.content(file)},
            partial(_published, file, found.custody),
            file.name,
        )
        for file in found.project.published
    ]
    return [*local.values(), *published]


def _published(file: Path, custody: pom.archive.Custody) -> list[Any]:
    fits = list(read_published(file))
    custody.check([file])
    return fits


def _with_gear(aircraft: Kept[Aircraft], gear: Kept[Any]) -> Aircraft:
    return gear.value.aircraft(aircraft.value)


def _count(found: Identified) -> int:
    """Return the number of local models."""
    places = zip(found.project.fits, found.windows.fits, strict=True)
    return sum(len(fit.models) * len(records) for fit, records in places) + sum(
        len(kept.value) for kept in found.fits[len(found.fits) - len(found.project.published) :]
    )


def _samples(found: Identified, start: Kept[xr.DataTree], stages: Stages) -> Kept[list[xr.Dataset]]:
    """Return the samples behind the fits."""
    fits, windows = found.project.fits, found.windows
    names = dict.fromkeys(name for spans in windows.fits for name in spans)
    inputs = {
        "fits": fits,
        "spans": windows.fits,
        "start": start,
        "coefficients": {name: found.data[name] for name in names},
    }
    return stages.one(
        "samples behind fits",
        inputs,
        lambda: samples_of(found.project, start.value, Values(found.data), windows),
    )


def _of_tables(
    found: Identified, start: Kept[xr.DataTree], behind: Kept[list[xr.Dataset]]
) -> dict[str, Any]:
    project = found.project
    return {
        "start": start,
        "fits": found.fits,
        "samples": behind,
        "held": project.held,
        "unplaced": project.unplaced,
        "way": project.tabulation,
        "title": project.title,
    }


def _tables(
    found: Identified, start: Kept[xr.DataTree], behind: Kept[list[xr.Dataset]], stages: Stages
) -> Kept[Any]:
    def make() -> Any:
        return final_database(found.project, start.value, found.all_fits(), behind.value)

    return stages.one("tables", _of_tables(found, start, behind), make)


def _compared(
    found: Identified, start: Kept[xr.DataTree], behind: Kept[list[xr.Dataset]], stages: Stages
) -> Kept[pd.DataFrame]:
    def make() -> pd.DataFrame:
        known = {found.project.tabulation: found.tables.value[1]}
        return compare_tables(found.project, start.value, found.all_fits(), behind.value, known)

    return stages.one("compared tables", _of_tables(found, start, behind), make)


def _ground_effect(found: Identified, final: Kept[xr.DataTree], stages: Stages) -> Kept[Any]:
    project, spans = found.project, found.windows.submodels
    taken = {"database": final, "settings": project.ground_effect}
    near = stages.one(
        "terms near the ground", taken, lambda: terms_near_ground(project, final.value)
    )
    # by what it holds, not by how it is kept: a change of other coefficients ends here
    neighbour = stages.given(near.value)

    def make() -> Any:
        return identified_ground_effect(project, Values(found.data), spans, neighbour.value)

    return stages.one(
        "ground effect",
        {
            "settings": project.ground_effect,
            "database": neighbour,
            **_of(spans, "ground_effect.", found.data),
        },
        make,
    )


def _gear(
    found: Identified, aircraft: Kept[Aircraft], final: Kept[xr.DataTree], stages: Stages
) -> Kept[Any]:
    project, spans = found.project, found.windows.submodels

    def make() -> Any:
        near = with_submodels(final.value, found.submodels())
        return identified_gear(project, aircraft.value, Values(found.paths), spans, near)

    before = {
        "controls": found.controls,
        "ground effect": found.ground_effect,
        "database": final,
        "aircraft": aircraft,
    }
    return stages.one(
        "landing gear",
        {"settings": project.gear, **before, **_of(spans, "gear.", found.paths)},
        make,
    )


def _final(found: Identified, final: Kept[xr.DataTree], stages: Stages) -> Kept[xr.DataTree]:
    """Return the final database with the submodels that are part of it."""
    asked = found.project.ground_effect
    if asked is None and not found.project.controls:
        return final
    tables = asked is not None and asked.tables
    inputs = {
        "database": final,
        "controls": found.controls,
        "ground effect": found.ground_effect,
        "tables": tables,
    }
    return stages.one(
        "final database", inputs, lambda: with_submodels(final.value, found.submodels(), tables)
    )


def _diagnose(
    found: Identified,
    databases: tuple[Kept[xr.DataTree], Kept[xr.DataTree]],
    aircraft: tuple[Kept[Any], Kept[Any]],
    jobs: int,
    stages: Stages,
) -> None:
    """Diagnose the cases, and make the corrected model; databases and aircraft are those before and
    after the flights.
    """
    (datcom, final), (apriori, flying) = databases, aircraft
    alone = [
        case for case in found.cases if not case.law
    ]  # the kernel flies no FMU of a control law
    paths = {case.name: found.paths[Path(case.record).stem] for case in alone}
    by_case = flying.part("by case", lambda one: dict.fromkeys(paths, one))
    found.diagnoses = diagnosed_cases(alone, datcom, final, by_case, apriori, paths, jobs, stages)
    why = {"before": datcom, "after": final, "diagnoses": found.diagnoses}
    corrected = stages.one(
        "corrected database",
        why,
        lambda: pom.corrected_database(datcom.value, final.value, found.diagnoses),
    )
    parts = {"before": apriori, "after": flying, "diagnoses": found.diagnoses}
    mixed = stages.one(
        "corrected aircraft",
        parts,
        lambda: pom.corrected_aircraft(apriori.value, flying.value, found.diagnoses),
    )
    found.databases = {"datcom": datcom, "corrected": corrected, "final": final}
    found.aircraft = {"datcom": apriori, "corrected": mixed, "final": flying}


def _evidence(found: Identified, stages: Stages) -> Kept[tuple[bytes, Any]]:
    """Return ``flown.nc``, and the 1 g lines of the final model over the conditions flown."""
    project, windows = found.project, found.windows
    spans = [*windows.fits, windows.submodels.get("ground_effect.flown", {})]
    final, aircraft = found.databases["final"], found.aircraft["final"]

    def make() -> tuple[bytes, Any]:
        tree = flown_tree(
            project.title,
            Values(found.data),
            spans,
            found.marks.value[0],
            found.all_fits(),
            found.submodels(),
        )
        with TemporaryDirectory() as place:
            file = Path(place) / FLOWN
            tree.to_netcdf(file, engine="h5netcdf")
            lines, _ = aerodb.figures.one_g_lines(
                final.value, aircraft.value, tree["manoeuvres"].to_dataset().to_dataframe()
            )
            return file.read_bytes(), lines

    inputs = {
        "title": project.title,
        "coefficients": found.data,
        "spans": spans,
        "manoeuvres": found.marks,
        "fits": found.fits,
    }
    return stages.one(
        "evidence",
        {**inputs, **found.of_submodels(), "database": final, "aircraft": aircraft},
        make,
    )


def _models(found: Identified, folder: Path, stages: Stages) -> dict[str, Path]:
    """Write databases, aircraft, FMUs and evidence into a folder, and return the FMUs by name, with
    those from elsewhere.
    """
    if found.compared is not None:
        found.compared.value.to_csv(folder / COMPARED)
    for name, database in found.databases.items():
        write_files(model_files(stages, name, database, found.aircraft[name]).value, folder)
    (folder / FLOWN).write_bytes(_evidence(found, stages).value[0])
    return {name: folder / f"{name}.fmu" for name in found.databases} | found.project.models


def _chapters(found: Identified, stages: Stages) -> Kept[Any]:
    """Return the chapters of the report in addition to its cases."""

    def make() -> Any:
        submodels = found.submodels()
        return pom.report.drawn_chapters(
            databases={name: kept.value for name, kept in found.databases.items()},
            diagnoses=found.diagnoses,
            fits=found.all_fits(),
            submodels=submodels.found,
            free_motion=submodels.free_motion,
            driven_motion=submodels.driven_motion,
            chapters=found.project.chapters,
            level_lines=_evidence(found, stages).value[1],
        )

    inputs = {
        "databases": found.databases,
        "fits": found.fits,
        "diagnoses": found.diagnoses,
        "chapters": found.project.chapters,
    }
    return stages.one(
        "chapters", {**inputs, **found.of_submodels(), "evidence": _evidence(found, stages)}, make
    )


def _outcome(found: Identified, results: list[Any], report: Path) -> MatchOutcome:
    """Return what was made."""
    taken = pom.corrected_terms(found.diagnoses.values())
    databases = [kept.value for kept in found.databases.values()]
    before, after = found.aircraft["datcom"].value, found.aircraft["final"].value
    different = len(differing_terms(databases[0], databases[-1])) + len(
        different_parts(before, after)
    )
    folder = report.parents[1]
    own = [item for item in folder.iterdir() if _is_ours(item.name)]
    files = [
        file.relative_to(folder).as_posix()
        for item in own
        for file in (item, *item.rglob("*"))
        if file.is_file()
    ]
    submodels, joint = by_submodel(taken, *databases), joint_terms(found.diagnoses)
    faults = [line for check in found.checks.values() for line in check.value.lines()]
    return MatchOutcome(
        results, taken, submodels, joint, different, found.tables, report, sorted(files), faults
    )


def _is_ours(name: str) -> bool:
    """Whether a file of the folder that `perform_match` writes is one that an earlier job wrote."""
    return name == REPORT or bool(_OURS.fullmatch(name))

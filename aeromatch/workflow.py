"""The main job, step by step: each step takes what the one before gives, none prints."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

import aerodb
import flightmech
import flighttest
import pom
from aerodb.figures.lr743_set.flown import FLOWN
from datcom_io.reading import read_place
from flightmech import Aircraft
from flightmech.aircraft.parts import different_parts
from flightmech.errors import SchemaError, UnknownName
from flightmech.support.atomic_write import exchangeable, folder_written_atomically
from flighttest.combining import coloured_covariance, read_published, table_samples
from flighttest.control_loading import replace_hinge_moments
from flighttest.ground_effect import replace_ground_effect
from pom.checking import check_records, with_record_checks
from pom.checking.record_check import checks_text
from pom.diagnosis import by_submodel, differing, joint_terms

from .flown import flown_tree
from .project import Project
from .submodels import (
    Spans,
    Submodels,
    demand,
    identified_controls,
    identified_engine,
    identified_gear,
    identified_ground_effect,
    overlaps,
    spans_of,
    with_engine,
)

Step = Callable[[str], AbstractContextManager[None]]
REPORT = "report"
_TABLES_STEP = {"tabulate": "join {} local models", "direct": "regress samples", "join": "join {} local models by regression"}
COMPARED = "tables_compared.csv"
_OURS = re.compile(rf"(datcom|corrected|final)(\.nc|\.toml|\.fmu|_engine\d+\.nc|_fuel\.nc)|{re.escape(FLOWN)}|{re.escape(COMPARED)}")


def a_priori(project: Project, aircraft: Aircraft) -> xr.DataTree:
    """Return the database of the project's DATCOM listings."""
    listings: dict[str, Any] = {role: [read_place(place) for place in places] for role, places in project.listings.items()}
    stated: dict[str, Any] = dict(project.stated)
    return aerodb.from_datcom(aircraft, altitude=project.altitude, **listings, **stated)


def opened(project: Project, prior: xr.DataTree) -> xr.DataTree:
    """Return the a-priori database with the terms that DATCOM cannot give, as zeros with wide standard errors.

    Raises
    ------
    SchemaError
        A new term is faulty, or a term to be held is not in the database; all of them.
    """
    db = aerodb.replace_terms(prior, {name: term.leaf() for name, term in project.terms.items()}, note="opened for the flights")
    known = aerodb.terms(db)
    unknown = [f"held: {UnknownName(name, known, 'term')}" for name in project.held if name not in known]
    if unknown:
        raise SchemaError(str(project.file), unknown)
    return db


def records_of(project: Project, cases: Sequence[Any] = ()) -> list[str]:
    """Return the records that the fits and submodels of a project and the given cases need, in order.

    Raises
    ------
    SchemaError
        Cases whose record is not among the flights of the project, and cases of one name; all of them.
    """
    named = [case.name for case in cases]
    flown = {case.name: Path(case.record).stem for case in cases}
    unknown = [
        f"case {name}: {UnknownName(record, project.flights, 'record')}" for name, record in flown.items() if record not in project.flights
    ]
    unknown += [f"{named.count(name)} cases are named {name!r}; give each a name of its own" for name in flown if named.count(name) > 1]
    if unknown:
        raise SchemaError(str(project.file), unknown)
    fitted = [record for fit in project.fits for record in fit.records]
    submodels = [record for flown in project.submodels.values() for one in flown for record in one.records]
    return list(dict.fromkeys([*fitted, *submodels, *flown.values()]))


def inputs_of(project: Project, names: Iterable[str]) -> list[Path]:
    """Return every file that the results rest on, with the flight records named."""
    flights = [project.flights[name] for name in names]
    listings = list(dict.fromkeys(place.file for places in project.listings.values() for place in places))
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
class Windows:
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


def marks_of(project: Project, records: Mapping[str, xr.DataTree], problems: list[str]) -> dict[str, pd.DataFrame]:
    """Return the manoeuvres of the records that a project needs: those of the project's table, else their own; and their flight modes.

    Parameters
    ----------
    project : Project
    records : mapping of str to DataTree
    problems : list of str
        Gets a line for every record of the table that is not among the flights.
    """
    own = {name: flighttest.manoeuvres(records[name]) for name in records_of(project)}
    given = flighttest.records.read_manoeuvres(project.manoeuvres) if project.manoeuvres else {}
    problems += [f"manoeuvres: {UnknownName(name, project.flights, 'record')}" for name in given if name not in project.flights]
    listed = {name: [given.get(name, table), flighttest.records.modes(records[name])] for name, table in own.items()}
    return {name: pd.concat([table for table in tables if len(table)] or tables, ignore_index=True) for name, tables in listed.items()}


def windows_of(project: Project, records: Mapping[str, xr.DataTree], cases: Sequence[Any] = ()) -> Windows:
    """Return what is taken of the records, by name, for every fit and submodel of a project.

    Raises
    ------
    SchemaError
        Manoeuvres that a record does not have, faults of the table of manoeuvres, and windows that overlap with a case: what proves
        the model must not identify it; all of them.
    """
    problems: list[str] = []
    tables = marks_of(project, records, problems)
    fits = [spans_of(f"fit {fit.name!r}", [fit], tables, problems) for fit in project.fits]
    submodels = {place: spans_of(place, flown, tables, problems) for place, flown in project.submodels.items()}
    named = [*((f"fit {fit.name!r}", spans) for fit, spans in zip(project.fits, fits, strict=True)), *submodels.items()]
    problems += [text for place, spans in named for text in overlaps(place, spans, cases)]
    demand(project, problems)
    return Windows(fits, submodels)


def reconstructed(project: Project, aircraft: Aircraft, records: Mapping[str, xr.DataTree], jobs: int) -> dict[str, Any]:
    """Return the paths of all records by name; those that only prove the model give the others nothing.

    A project that identifies nothing reconstructs its records as one programme.
    """
    identifying = [name for name in records_of(project) if name in records] or list(records)
    proving = [name for name in records if name not in identifying]
    found = flighttest.reconstruct_programme(
        [records[name] for name in identifying], aircraft, jobs=jobs, validation=[records[name] for name in proving]
    )
    return dict(zip([*identifying, *proving], found, strict=True))


def _threads(jobs: int) -> int:
    """Return a number of threads; -1 is one per core, as it is for processes."""
    return jobs if jobs > 0 else os.cpu_count() or 1


def coefficients_of(
    project: Project, aircraft: Aircraft, paths: Mapping[str, Any], windows: Windows, jobs: int = 1
) -> dict[str, xr.Dataset]:
    """Return the aerodynamic coefficients along the records that a fit or the ground effect takes, by name; `jobs` threads."""
    needed = [*windows.fits, windows.submodels.get("ground_effect.flown", {})]
    names = dict.fromkeys(name for spans in needed for name in spans)

    def found(name: str) -> xr.Dataset:
        return flighttest.coefficients(paths[name], aircraft, project.errors, project.cutoff)

    with ThreadPoolExecutor(_threads(jobs)) as pool:
        return dict(zip(names, pool.map(found, names)))


def rests_on(project: Project, windows: Windows, cases: Sequence[Any]) -> dict[str, str]:
    """Return which records each part of the model and each case rests on, in words, for the report.

    A record that identifies over one stretch of time and proves over another is stated: its instruments come from all of it.
    """
    identifying = records_of(project)
    proved = [Path(case.record).stem for case in cases]
    found = {"constants of the instruments": ", ".join(identifying or dict.fromkeys(proved))}
    found |= {f"fit {fit.name}": ", ".join(spans) for fit, spans in zip(project.fits, windows.fits, strict=True)}
    found |= {place: ", ".join(spans) for place, spans in windows.submodels.items()}
    for case, record in zip(cases, proved, strict=True):
        found[f"case {case.name}"] = f"{record}, which identifies too, at other times" if record in identifying else record
    return found


def identify(project: Project, data: Mapping[str, xr.Dataset], windows: Windows, jobs: int = 1) -> list[Any]:
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

    def found(fit: Any, record: str, spans: Sequence[tuple[float, float]]) -> list[Any]:
        parts = [flighttest.between(data[record], *span) for span in spans]
        return [flighttest.regress(flighttest.Model.parse(model), parts, name=f"{record}: {fit.name}") for model in fit.models]

    taken = [(fit, *place) for fit, places in zip(project.fits, windows.fits, strict=True) for place in places.items()]
    with ThreadPoolExecutor(_threads(jobs)) as pool:
        local = [fit for fits in pool.map(lambda one: found(*one), taken) for fit in fits]
    return [*local, *(fit for file in project.published for fit in read_published(file))]


def samples_of(project: Project, start: xr.DataTree, data: Mapping[str, xr.Dataset], windows: Windows) -> list[xr.Dataset]:
    """Return the samples behind every fit of the project, for tables estimated directly from them; names as those of `identify`."""
    found = []
    for fit, places in zip(project.fits, windows.fits, strict=True):
        coefficients = dict.fromkeys(flighttest.Model.parse(model).coefficient for model in fit.models)
        for record, spans in places.items():
            parts = [flighttest.between(data[record], *span) for span in spans]
            found += [table_samples(coefficient, start, parts, f"{record}: {fit.name}") for coefficient in coefficients]
    return found


WAYS: dict[str, Callable[[Project, xr.DataTree, Sequence[Any], Sequence[xr.Dataset]], Any]] = {
    "tabulate": lambda project, start, fits, samples: aerodb.tabulate(fits, start, held=project.held, unplaced=project.unplaced),
    "direct": lambda project, start, fits, samples: aerodb.update.regress_tables(
        samples,
        start,
        coloured_covariance,
        project.held,
        fits=_without_samples(fits, samples),
        unplaced=project.unplaced,
        local=_with_samples(fits, samples),
    ),
    "join": lambda project, start, fits, samples: aerodb.update.join_submodels(fits, start, held=project.held, unplaced=project.unplaced),
}
"""How flights enter the tables, by the key ``tabulation`` of a project; from fits (`identify`) and samples (`samples_of`)."""


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
        From `opened`.
    fits : sequence of Fit
        From `identify`.
    samples : sequence of Dataset
        From `samples_of`; used by the way ``direct`` only.
    """
    tabulation = WAYS[project.tabulation](project, start, fits, samples)
    final = aerodb.replace_terms(start, tabulation, note="identified from flight")
    final.attrs["title"] = f"{project.title}: database after flight"
    return final, tabulation


def compare_tables(
    project: Project, start: xr.DataTree, fits: Sequence[Any], samples: Sequence[xr.Dataset], known: Mapping[str, Any] | None = None
) -> pd.DataFrame:
    """Return the nodes of all `WAYS` side by side (`aerodb.update.compare_ways`); `known` holds tabulations that are there already."""
    found = dict(known or {})
    return aerodb.update.compare_ways({way: found.get(way) or make(project, start, fits, samples) for way, make in WAYS.items()}, start)


def with_submodels(database: xr.DataTree, found: Submodels, tables: bool = False) -> xr.DataTree:
    """Return a database with the identified hinge moments and ground effect; `tables` as in `replace_ground_effect`."""
    for loading in found.controls.values():
        database = replace_hinge_moments(database, loading)
    return database if found.ground_effect is None else replace_ground_effect(database, found.ground_effect, tables)


def after_flight(project: Project, aircraft: Aircraft, found: Submodels) -> Aircraft:
    """Return the aircraft with its identified engines and control circuits; the landing gear follows the aerodynamics."""
    if found.engine is not None:
        aircraft = with_engine(aircraft, project, found.engine)
    for loading in found.controls.values():
        aircraft = loading.aircraft(aircraft)
    return aircraft


@dataclass(frozen=True)
class Outcome:
    """What `perform` made.

    Attributes
    ----------
    results : list of PomResult
        One per case.
    corrected_terms : list of str
        Terms, and parts of the aircraft, that the corrected model takes from the final one.
    corrected_submodels : dict of str to list of str
        The same by submodel: ``aerodynamics``, ``ground effect``, ``control loading``, ``engine``, ``landing gear``.
    joint_terms : dict of str to list of str
        Those of them that no case needs alone: added since the terms of one case change another, by the case for which.
    differing : int
        Terms and parts that differ between the a-priori and the final model.
    tabulation : Tabulation
        How the terms came about.
    report : Path
        Of ``report.html``.
    record_errors : list of str
        Errors that the checks of the flight records found, a line each.
    """

    results: list[Any]
    corrected_terms: list[str]
    corrected_submodels: dict[str, list[str]]
    joint_terms: dict[str, list[str]]
    differing: int
    tabulation: Any
    report: Path
    record_errors: list[str] = field(default_factory=list)

    def to_dict(self) -> dict[str, Any]:
        """Return the verdicts as plain data."""
        return {
            "report": str(self.report),
            "corrected_terms": self.corrected_terms,
            "corrected_submodels": self.corrected_submodels,
            "joint_terms": self.joint_terms,
            "record_errors": self.record_errors,
            "differing": self.differing,
            "warnings": list(self.tabulation.notices),
            "cases": [
                {
                    "name": result.case.name,
                    "id": result.case.id,
                    "status": {run: result.status(run) for run in result.runs},
                    "verdict": result.verdict_records(),
                    "failure": result.failure,
                    "samples": {run: found.numbers() for run, found in result.samples.items()},
                }
                for result in self.results
            ],
        }


def perform(
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
) -> Outcome:
    """Do the whole job of a project and write databases, FMUs and report into a folder.

    The folder is exchanged as a whole in the end, so that its databases, FMUs and report are always of one job.

    Parameters
    ----------
    project : Project
    folder : path
        Gets ``datcom.nc corrected.nc final.nc``, the aircraft that belong to them as ``.toml``, both as ``.fmu``, ``flown.nc`` (what
        they were identified from, for the figures of LR-743), and ``report/``.
        What else is in it stays.
    jobs : int
        Processes for reconstruction, diagnosis and replay, threads for the steps between them; -1 for one per core.
    step : callable
        ``with step("text"):`` surrounds every step, for progress.
    command : str
        Command line, for the report.
    scheduler, resume : str, optional
        Of `pom.replay_all`: the address of a cluster for the replay, and the folder that keeps its flights.
    samples, seed : int
        Draws of the final model (`pom.replay_sampled`); none without.
    compare : bool
        Whether the tables are made in all `WAYS` and compared node by node, in ``tables_compared.csv``.

    Returns
    -------
    Outcome

    Raises
    ------
    OSError
        The folder cannot be exchanged (`flightmech.support.atomic_write.folder_written_atomically`).
    """
    folder = Path(folder)
    if folder.parent.is_dir():
        exchangeable(folder)  # before the work
    custody = pom.archive.Custody()
    custody.take([*inputs_of(project, []), *project.models.values()])
    aircraft = flightmech.read_aircraft(project.aircraft)
    apriori = before_flight(project, aircraft)
    cases = [pom.read_case(file) for file in project.cases]
    with step(f"read {sum(map(len, project.listings.values()))} DATCOM listings, build the a-priori database"):
        datcom = a_priori(project, aircraft)
        start = opened(project, datcom)
    names = records_of(project, cases)
    custody.take(inputs_of(project, names))
    with step(f"read {len(names)} flight records"):
        records = {name: flighttest.read(project.flights[name], project.names) for name in names}
        windows = windows_of(project, records, cases)
    with step("check the flight records"):
        checks = check_records(records, aircraft, jobs)
    with step("reconstruct the states; the records that identify determine the instruments' constants"):
        paths = reconstructed(project, aircraft, records, jobs)
    submodels = Submodels()
    if project.engine is not None:  # before the aerodynamics, which need the thrust
        with step("identify the engine"):
            submodels = replace(submodels, engine=identified_engine(project, apriori, paths, windows.submodels))
    if project.controls:
        with step(f"identify the control loading of {', '.join(project.controls)}"):
            controls, free, driven = identified_controls(project, aircraft, paths, windows.submodels, _threads(jobs))
            submodels = replace(submodels, controls=controls, free_motion=free, driven_motion=driven)
    aircraft = after_flight(project, aircraft, submodels)
    with step(f"identify coefficients on {len(dict.fromkeys(name for spans in windows.fits for name in spans))} flight records"):
        data = coefficients_of(project, aircraft, paths, windows, jobs)
        fits = identify(project, data, windows, jobs)
    with step(f"{_TABLES_STEP[project.tabulation].format(len(fits))} and the prior into tables"):
        behind = samples_of(project, start, data, windows) if compare or project.tabulation == "direct" else []
        final, tabulation = final_database(project, start, fits, behind)
    compared = None
    if compare:
        with step(f"make the tables in all {len(WAYS)} ways and compare them"):
            compared = compare_tables(project, start, fits, behind, {project.tabulation: tabulation})
    if project.ground_effect is not None:  # after the aerodynamics, whose lift in free air it multiplies
        with step("identify the ground effect"):
            submodels = replace(submodels, ground_effect=identified_ground_effect(project, data, windows.submodels, final))
    if project.gear is not None:  # last, for it needs lift and drag near the ground
        with step("identify the landing gear"):
            near = with_submodels(final, submodels)
            submodels = replace(submodels, gear=identified_gear(project, aircraft, paths, windows.submodels, near))
            aircraft = submodels.gear.aircraft(aircraft)
    final = with_submodels(final, submodels, project.ground_effect is not None and project.ground_effect.tables)
    with step(f"swap terms on {len(cases)} cases, build the corrected database"):
        alone = [case for case in cases if not case.law]  # the kernel flies no FMU of a control law
        flown = {case.name: paths[Path(case.record).stem] for case in alone}
        diagnoses = pom.diagnose_all(alone, datcom, final, dict.fromkeys(flown, aircraft), flown, apriori, jobs)
        corrected = pom.corrected_database(datcom, final, diagnoses)
    databases = {"datcom": datcom, "corrected": corrected, "final": final}
    flown = {"datcom": apriori, "corrected": pom.corrected_aircraft(apriori, aircraft, diagnoses), "final": aircraft}
    folder.parent.mkdir(parents=True, exist_ok=True)
    with folder_written_atomically(folder, _is_ours) as new:
        with step("write three databases, aircraft and FMUs"):
            fmus = {}
            if compared is not None:
                compared.to_csv(new / COMPARED)
            for name, db in databases.items():
                aerodb.save(db, new / f"{name}.nc")
                flightmech.write_aircraft(flown[name], new / f"{name}.toml")
                fmus[name] = flightmech.write_fmu(flightmech.compile(flown[name], db), new / f"{name}.fmu")
            spans = [*windows.fits, windows.submodels.get("ground_effect.flown", {})]
            evidence = flown_tree(project.title, data, spans, marks_of(project, records, []), fits, submodels)
            evidence.to_netcdf(new / FLOWN, engine="h5netcdf")
            level_lines, _ = aerodb.figures.one_g_lines(final, aircraft, evidence["manoeuvres"].to_dataset().to_dataframe())
        fmus |= project.models
        custody.take(fmus.values())
        with step(f"replay {len(cases)} cases by {len(fmus)} FMUs"):
            options: dict[str, Any] = {"names": project.tables, "evidence": final, "jobs": jobs, "scheduler": scheduler, "resume": resume}
            if samples:
                results = pom.replay_sampled(
                    cases, fmus, {"final": new / "final.nc"}, samples, seed, paths, errors=project.errors, **options
                )
            else:
                results = pom.replay_all(cases, fmus, paths, **options)
        custody.check()
        results = with_record_checks(results, checks)
        with step("write the report"):
            made_from = pom.provenance(inputs_of(project, names), fmus, command, digest=custody.sha256)
            made_from["records"] = rests_on(project, windows, cases)
            if wrong := checks_text(checks.values()):
                made_from["record_errors"] = wrong
            if project.signatures:
                made_from["signatures"] = project.signatures
            pom.write_report(
                results,
                new / REPORT,
                title=f"{project.title}: Proof of Match",
                provenance=made_from,
                databases=databases,
                diagnoses=diagnoses,
                fits=fits,
                submodels=submodels.found,
                free_motion=submodels.free_motion,
                driven_motion=submodels.driven_motion,
                chapters=project.chapters,
                level_lines=level_lines,
                jobs=jobs,
            )
    taken = pom.corrected_terms(diagnoses.values())
    different = len(differing(datcom, final)) + len(different_parts(apriori, aircraft))
    report = folder / REPORT / "report.html"
    faults = [line for check in checks.values() for line in check.lines()]
    return Outcome(results, taken, by_submodel(taken, *databases.values()), joint_terms(diagnoses), different, tabulation, report, faults)


def _is_ours(name: str) -> bool:
    """Whether a file of the folder that `perform` writes is one that an earlier job wrote."""
    return name == REPORT or bool(_OURS.fullmatch(name))

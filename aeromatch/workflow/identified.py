"""Results of an identification, and its stages from the records to the aerodynamic tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

import flighttest
import pom
from aeromatch.project.priors import PriorSection
from aeromatch.project.project import Project
from aeromatch.workflow.aerodynamics import (
    a_priori,
    add_missing_terms,
    compare_tables,
    final_database,
    fit_local_models,
    samples_of,
    thread_count,
)
from aeromatch.workflow.submodels import Submodels
from aeromatch.workflow.windows import (
    IdentificationWindows,
    SharedByRecord,
    marks_of,
    proving_records,
    records_of,
    samples_of_copies,
)
from flightmech.aircraft.aircraft import Aircraft
from flightmech.support.kept_stages.content_hashes import FileContent
from flightmech.support.kept_stages.stages import Kept, Stages, Values
from flighttest.regression.combining.published_table import read_published
from pom.checking.case_check import RecordCheck
from pom.diagnosis.culprits.project_ranking import ProjectRanking


@dataclass
class Identified:
    """Results of an identification and a diagnosis. Each result is in memory or in the store.

    Attributes
    ----------
    project : Project
    custody : Custody
        Hashes of the files that were read.
    cases : list of PomCase
    records : list of str
    windows : IdentificationWindows
    paths, data : dict of str to Kept
        Reconstructed paths and coefficients by record.
    fits : list of Kept of list of Fit
    marks : Kept
        Manoeuvres by record, and the problems of the table of manoeuvres.
    checks : dict of str to Kept of RecordCheck
        Checks of the records, by name.
    left_out : list of str
        Faulty samples in the windows, left out or not, a line each.
    unflown : dict of str to str
        Cases that no model can fly, by name, with the reason; they have no diagnosis.
    engine, controls, ground_effect, stall, gear : Kept
        Submodels; None where there is none.
    tables : Kept of (DataTree, Tabulation)
    compared : Kept of DataFrame or None
    databases, aircraft : dict of str to Kept
        ``datcom corrected final``.
    diagnoses : dict of str to DataFrame
    ranking : ProjectRanking or None
        The terms of the a-priori model ranked over all cases.
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
    left_out: list[str] = field(default_factory=list)
    unflown: dict[str, str] = field(default_factory=dict)
    engine: Kept[Any] = field(default_factory=lambda: Kept(made=(None,)))
    controls: Kept[Any] = field(default_factory=lambda: Kept(made=(({}, {}, {}),)))
    ground_effect: Kept[Any] = field(default_factory=lambda: Kept(made=(None,)))
    stall: Kept[Any] = field(default_factory=lambda: Kept(made=(None,)))
    gear: Kept[Any] = field(default_factory=lambda: Kept(made=(None,)))
    tables: Kept[Any] = field(init=False)
    compared: Kept[Any] | None = None
    databases: dict[str, Kept[Any]] = field(default_factory=dict)
    aircraft: dict[str, Kept[Any]] = field(default_factory=dict)
    diagnoses: dict[str, pd.DataFrame] = field(default_factory=dict)
    ranking: ProjectRanking | None = None

    def content(self, file: Path) -> FileContent:
        """Return a file as an input of a stage, with its hash in the custody."""
        return FileContent(Path(file), self.custody.sha256(file))

    def submodels(self) -> Submodels:
        """Return the identified submodels."""
        loadings, free_motion, driven_motion = self.controls.value
        return Submodels(
            engine=self.engine.value,
            controls=loadings,
            free_motion=free_motion,
            driven_motion=driven_motion,
            ground_effect=self.ground_effect.value,
            stall=self.stall.value,
            gear=self.gear.value,
        )

    def submodel_inputs(self) -> dict[str, Kept[Any]]:
        """Return the submodels as inputs of a stage."""
        return {
            "engine": self.engine,
            "controls": self.controls,
            "ground effect": self.ground_effect,
            "stall": self.stall,
            "landing gear": self.gear,
        }

    def all_fits(self) -> list[Any]:
        """Return the local models of the records, then the published local models."""
        fits: list[Any] = []
        for stored in self.fits:
            fits += stored.value
        return fits


def databases_before(
    project: Project, aircraft: Aircraft, custody: pom.archive.Custody, stages: Stages
) -> tuple[Kept[xr.DataTree], Kept[xr.DataTree]]:
    """Return the a-priori database of the listings, and the database with the missing terms."""
    files = [listing.file for listing in project.listings.places()]
    for section in project.prior:
        files += section.all_files
    files += [file for file in (project.ice,) if file]

    def make() -> xr.DataTree:
        datcom = a_priori(project, aircraft)
        # The store must not have a result of other bytes under the hash of a file.
        custody.check(files)
        return datcom

    listings: dict[str, list[tuple[FileContent, str]]] = {}
    for role, places in project.listings.by_role.items():
        listings[role] = []
        for listing_case in places:
            content = FileContent(listing_case.file, custody.sha256(listing_case.file))
            listings[role].append((content, listing_case.case))
    inputs: dict[str, Any] = {
        "aircraft": aircraft,
        "listings": listings,
        "altitude": project.listings.altitude,
        "stated": project.listings.statements,
    }
    if project.prior:
        inputs["prior"] = [_prior_inputs(section, custody) for section in project.prior]
        inputs["take"] = project.take
    if project.ice is not None:
        inputs["ice"] = FileContent(project.ice, custody.sha256(project.ice))
    datcom = stages.one("a-priori database", inputs, make)
    term_inputs = {"database": datcom, "terms": project.terms, "held": project.held}
    opened = stages.one(
        "opened database", term_inputs, lambda: add_missing_terms(project, datcom.value)
    )
    return datcom, opened


def _prior_inputs(section: PriorSection, custody: pom.archive.Custody) -> dict[str, Any]:
    """Return what the database of a further source depends on."""
    contents = [FileContent(file, custody.sha256(file)) for file in section.all_files]
    return {"files": contents, **section.settings()}


def _record_files(project: Project, name: str) -> list[Path]:
    """Return the file of a flight record and, if the project has one, its name map."""
    files = [project.flights[name]]
    if project.names:
        files.append(project.names)
    return files


def record_inputs(project: Project, name: str, custody: pom.archive.Custody) -> dict[str, Any]:
    """Return the inputs of the stage ``record`` of a flight record: its file, and the name map."""
    files = _record_files(project, name)
    record, *names = [FileContent(file, custody.sha256(file)) for file in files]
    return {"file": record, "names": names}


def record_of(
    project: Project, name: str, custody: pom.archive.Custody, names: Any = None
) -> xr.DataTree:
    """Return a flight record. `names` is the name map, if it is in memory."""
    if names is None:
        names = project.names
    record = flighttest.read(project.flights[name], names)
    custody.check(_record_files(project, name))
    return record


def read_records(result: Identified, stages: Stages) -> dict[str, Kept[xr.DataTree]]:
    """Return the flight records by name."""
    project, custody = result.project, result.custody
    records: dict[str, Kept[xr.DataTree]] = {}
    for name in result.records:
        inputs = record_inputs(project, name, custody)
        make = partial(record_of, project, name, custody)
        records[name] = stages.one("record", inputs, make, item=name)
    return records


def read_marks(
    result: Identified, records: Mapping[str, Kept[xr.DataTree]], stages: Stages
) -> Kept[tuple[dict[str, pd.DataFrame], list[str]]]:
    """Return the manoeuvres of the identifying records, and the problems of their table."""
    project = result.project
    table = [project.manoeuvres] if project.manoeuvres else []

    def make() -> tuple[dict[str, pd.DataFrame], list[str]]:
        problems: list[str] = []
        marks = marks_of(project, Values(records), problems)
        # The table is read from its file, which must not have changed since it was hashed.
        result.custody.check(table)
        return marks, problems

    inputs = {
        "records": {name: records[name] for name in records_of(project)},
        "flights": list(project.flights),
        "table": [result.content(file) for file in table],
    }
    return stages.one("manoeuvres", inputs, make)


def find_copies(
    result: Identified, records: Mapping[str, Kept[xr.DataTree]], stages: Stages
) -> SharedByRecord:
    """Return the samples that the records of cases share with identifying records."""
    identifying = records_of(result.project)
    others = {name: records[name] for name in identifying}
    inputs: dict[str, dict[str, Any]] = {}
    for name in proving_records(result.cases):
        inputs[name] = {"record": records[name], "identifying": others}

    def compute(missing: list[str], put: Callable[..., None]) -> None:
        for name, copies in samples_of_copies(missing, identifying, Values(records)).items():
            put(name, copies)

    copies = stages.batch("copied samples", inputs, compute)
    return {name: stored.value for name, stored in copies.items()}


def check_identified_records(
    records: Mapping[str, Kept[xr.DataTree]], aircraft: Aircraft, jobs: int, stages: Stages
) -> dict[str, Kept[RecordCheck]]:
    """Return the checks of the flight records by name."""
    inputs = {name: {"record": record, "aircraft": aircraft} for name, record in records.items()}

    def arguments(name: str) -> tuple[Any, ...]:
        return name, records[name].value, aircraft

    return stages.each("record check", inputs, RecordCheck.of, arguments=arguments, jobs=jobs)


def compute_coefficients(
    result: Identified, aircraft: Kept[Aircraft], jobs: int, stages: Stages
) -> dict[str, Kept[xr.Dataset]]:
    """Return the coefficients of the records of a fit or the ground effect, by record."""
    project = result.project
    settings = {"aircraft": aircraft, "errors": project.errors, "cutoff": project.cutoff}
    inputs: dict[str, dict[str, Any]] = {}
    for name in result.windows.aerodynamic_records():
        inputs[name] = {"path": result.paths[name], **settings}

    def arguments(name: str) -> tuple[Any, ...]:
        return result.paths[name].value, aircraft.value, project.errors, project.cutoff

    return stages.each(
        "coefficients",
        inputs,
        flighttest.coefficients,
        arguments=arguments,
        jobs=thread_count(jobs),
        threads=stages.local,
    )


def fit_coefficients(result: Identified, jobs: int, stages: Stages) -> list[Kept[list[Any]]]:
    """Return the local models of every fit and record in order, then the published models."""
    fits = zip(result.project.fit, result.windows.fits, strict=True)
    # Record, and the other arguments of `fit_local_models`, by the name of the item.
    # The number makes the items of two fits of one name different.
    calls: dict[str, tuple[str, tuple[Any, ...]]] = {}
    for number, (fit, spans_by_record) in enumerate(fits, 1):
        for record, spans in spans_by_record.items():
            item = f"{number} {fit.name}, {record}"
            calls[item] = record, (spans, fit.models, f"{record}: {fit.name}")
    inputs: dict[str, dict[str, Any]] = {}
    for item, (record, settings) in calls.items():
        inputs[item] = {"coefficients": result.data[record], "fit": list(settings)}

    def arguments(item: str) -> tuple[Any, ...]:
        record, settings = calls[item]
        return result.data[record].value, *settings

    local = stages.each(
        "fit",
        inputs,
        fit_local_models,
        arguments=arguments,
        jobs=thread_count(jobs),
        threads=stages.local,
    )
    published: list[Kept[list[Any]]] = []
    for file in result.project.published:
        content = {"file": result.content(file)}
        make = partial(_read_published_fits, file, result.custody)
        published.append(stages.one("published fits", content, make, item=file.name))
    return [*local.values(), *published]


def _read_published_fits(file: Path, custody: pom.archive.Custody) -> list[Any]:
    fits = list(read_published(file))
    custody.check([file])
    return fits


def count_local_models(result: Identified) -> int:
    """Return the number of local models, without the computation of a fit."""
    count = 0
    for fit, spans in zip(result.project.fit, result.windows.fits, strict=True):
        count += len(fit.models) * len(spans)
    # The stages of the published fits follow the stages of the records.
    first = len(result.fits) - len(result.project.published)
    for stored in result.fits[first:]:
        count += len(stored.value)
    return count


def select_samples(
    result: Identified, start: Kept[xr.DataTree], stages: Stages
) -> Kept[list[xr.Dataset]]:
    """Return the samples of the fits, for tables that are estimated directly from them."""
    inputs = {
        "fits": result.project.fit,
        "spans": result.windows.fits,
        "start": start,
        "coefficients": {name: result.data[name] for name in result.windows.fitted_records()},
    }

    def make() -> list[xr.Dataset]:
        return samples_of(result.project, start.value, Values(result.data), result.windows)

    return stages.one("samples behind fits", inputs, make)


def _table_inputs(
    result: Identified, start: Kept[xr.DataTree], samples: Kept[list[xr.Dataset]]
) -> dict[str, Any]:
    project = result.project
    return {
        "start": start,
        "fits": result.fits,
        "samples": samples,
        "held": project.held,
        "unplaced": project.unplaced,
        "way": project.tabulation,
    }


def make_tables(
    result: Identified,
    start: Kept[xr.DataTree],
    samples: Kept[list[xr.Dataset]],
    stages: Stages,
) -> Kept[Any]:
    """Return the database after the flights without submodels, and its tabulation."""

    def make() -> Any:
        return final_database(result.project, start.value, result.all_fits(), samples.value)

    return stages.one("tables", _table_inputs(result, start, samples), make)


def make_table_comparison(
    result: Identified,
    start: Kept[xr.DataTree],
    samples: Kept[list[xr.Dataset]],
    stages: Stages,
) -> Kept[pd.DataFrame]:
    """Return the nodes of the tables of all methods side by side."""

    def make() -> pd.DataFrame:
        return compare_tables(
            result.project,
            start.value,
            fits=result.all_fits(),
            samples=samples.value,
            known={result.project.tabulation: result.tables.value[1]},
        )

    return stages.one("compared tables", _table_inputs(result, start, samples), make)

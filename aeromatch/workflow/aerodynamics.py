"""Single steps from the a-priori database of a project to its database after flight."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pandas as pd
import xarray as xr

import aerodb
import flightmech
import flighttest
from aerodb.update.tabulation_report import make_empty_tabulation
from aeromatch.project.priors import PriorSection
from aeromatch.project.project import Project
from aeromatch.workflow.submodels import Submodels, attached_database, with_engine
from aeromatch.workflow.windows import IdentificationWindows, raise_problems, records_of
from datcom_io.reading.reader import read_place
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchWarning, UnknownName
from flightmech.support.console import count_text
from flighttest.regression.combining.joined_fits import coloured_covariance, table_samples
from flighttest.regression.combining.published_table import read_published
from flighttest.submodels.control_loading.hinge_terms import replace_hinge_moments
from flighttest.submodels.ground_effect.database_terms import replace_ground_effect
from flighttest.submodels.stall.database_terms import add_stall

_NO_FIT = (
    "the project has no [[fit]] and no published models: no term is identified, and the models "
    "corrected and final keep the a-priori aerodynamics"
)


def a_priori(project: Project, aircraft: Aircraft) -> xr.DataTree:
    """Return the a-priori database of a project.

    It is that of the DATCOM listings and of the sources of ``[[prior]]``, blended if there are two
    or more, with the differences by ice.
    """
    clean = _clean_prior(project, aircraft)
    if project.ice is None:
        return clean
    return aerodb.edit.add_ice(clean, aerodb.edit.read_ice(project.ice))


def _clean_prior(project: Project, aircraft: Aircraft) -> xr.DataTree:
    """Return the a-priori database without ice."""
    sources = [_open_source(section, aircraft) for section in project.prior]
    methods = [section.method for section in project.prior]
    listings: dict[str, Any] = {}
    for role, places in project.listings.by_role.items():
        listings[role] = [read_place(listing) for listing in places]
    if listings:
        statements: dict[str, Any] = project.listings.statements
        datcom = aerodb.from_datcom(
            aircraft, altitude=project.listings.altitude, **listings, **statements
        )
        sources, methods = [datcom, *sources], ["", *methods]
    if len(sources) == 1:
        return sources[0]
    blend = aerodb.edit.blend_sources(
        sources,
        aircraft,
        take=project.take,
        methods=methods,
        move_reference=any(section.move_reference for section in project.prior),
    )
    return blend.database


def _open_source(section: PriorSection, aircraft: Aircraft) -> xr.DataTree:
    """Return the database of one source."""
    if section.is_database:
        return aerodb.open(section.files[0])
    return aerodb.from_estimate(aircraft, section.files, **section.options())


def prior_step(project: Project) -> str:
    """Return the name of the step that builds the a-priori database."""
    listings = f"{len(project.listings.places())} DATCOM listings"
    if not project.prior:
        return f"read {listings}, build the a-priori database"
    if not project.listings.by_role:
        return f"read {count_text(len(project.prior), 'source')}, build the a-priori database"
    further = count_text(len(project.prior), "further source")
    return f"read {listings} and {further}, blend the a-priori database"


def add_missing_terms(project: Project, prior: xr.DataTree) -> xr.DataTree:
    """Return the a-priori database with the terms that DATCOM does not give.

    A new term is zero and has a wide standard error.

    Raises
    ------
    SchemaError
        A new term is faulty, or a fixed term is not in the database; with all problems.
    """
    db = aerodb.replace_terms(
        prior,
        {name: term.leaf() for name, term in project.terms.items()},
        note="opened for the flights",
    )
    available = aerodb.terms(db)
    problems: list[str] = []
    for name in project.held:
        if name not in available:
            problems.append(f"held: {UnknownName(name, available, 'term')}")
    raise_problems(project, problems)
    return db


def before_flight(project: Project, aircraft: Aircraft) -> Aircraft:
    """Return the aircraft of the a-priori model: the file `apriori`, or `aircraft` without it."""
    if project.apriori:
        return flightmech.read_aircraft(project.apriori)
    return aircraft


def reconstruct_records(
    project: Project, aircraft: Aircraft, records: Mapping[str, xr.DataTree], jobs: int
) -> dict[str, Any]:
    """Return the reconstructed paths of all records by name.

    Records that only prove the model do not contribute to the instrument constants of the others.
    A project without identification reconstructs its records as one programme.
    """
    # Data that prove the model must not change its constants.
    identifying = identifying_records(project, records)
    proving = [name for name in records if name not in identifying]
    paths = flighttest.reconstruct_programme(
        [records[name] for name in identifying],
        aircraft,
        jobs=jobs,
        validation=[records[name] for name in proving],
    )
    return dict(zip([*identifying, *proving], paths, strict=True))


def identifying_records(project: Project, records: Mapping[str, Any]) -> list[str]:
    """Return the names of the records that identify something, or all names if none does."""
    return [name for name in records_of(project) if name in records] or list(records)


def thread_count(jobs: int) -> int:
    """Return a number of threads. As for processes, -1 is one per core."""
    if jobs > 0:
        return jobs
    return os.cpu_count() or 1


def coefficients_of(
    project: Project,
    aircraft: Aircraft,
    paths: Mapping[str, Any],
    windows: IdentificationWindows,
    jobs: int = 1,
) -> dict[str, xr.Dataset]:
    """Return the aerodynamic coefficients along the records of a fit or the ground effect.

    Parameters
    ----------
    project : Project
    aircraft : Aircraft
    paths : mapping of str to Path
        Reconstructions by record.
    windows : IdentificationWindows
    jobs : int
        Threads.

    Returns
    -------
    dict of str to Dataset (time,)
        By record.
    """
    names = windows.aerodynamic_records()

    def compute(name: str) -> xr.Dataset:
        return flighttest.coefficients(paths[name], aircraft, project.errors, project.cutoff)

    with ThreadPoolExecutor(thread_count(jobs)) as pool:
        return dict(zip(names, pool.map(compute, names)))


def fit_records(
    project: Project, data: Mapping[str, xr.Dataset], windows: IdentificationWindows, jobs: int = 1
) -> list[Any]:
    """Return one `flighttest.Fit` per record and model of every fit, then the published fits.

    Parameters
    ----------
    project : Project
    data : mapping of str to Dataset
        From `coefficients_of`.
    windows : IdentificationWindows
    jobs : int
        Threads.
    """
    fits: list[Any] = []
    with ThreadPoolExecutor(thread_count(jobs)) as pool:
        tasks = []
        for fit, spans_by_record in zip(project.fit, windows.fits, strict=True):
            for record, spans in spans_by_record.items():
                name = f"{record}: {fit.name}"
                tasks.append(pool.submit(fit_local_models, data[record], spans, fit.models, name))
        # The results are in the order of the project, not in the order of completion.
        for task in tasks:
            fits += task.result()
    for file in project.published:
        fits += read_published(file)
    return fits


def fit_local_models(
    data: xr.Dataset, spans: Sequence[tuple[float, float]], models: Sequence[str], name: str
) -> list[Any]:
    """Return the local models of one fit on one record."""
    parts = [flighttest.select_time(data, *span) for span in spans]
    fits = []
    for text in models:
        model = flighttest.RegressionModel.parse(text)
        fits.append(flighttest.regress(model, parts, name=name))
    return fits


def samples_of(
    project: Project,
    start: xr.DataTree,
    data: Mapping[str, xr.Dataset],
    windows: IdentificationWindows,
) -> list[xr.Dataset]:
    """Return the samples of every fit of the project, for tables estimated directly from them.

    The names are the names of the fits of `fit_records`.
    """
    samples = []
    for fit, spans_by_record in zip(project.fit, windows.fits, strict=True):
        # Two models of one coefficient use the same samples, which enter the tables once.
        coefficients: dict[str, None] = {}
        for model in fit.models:
            coefficients[flighttest.RegressionModel.parse(model).coefficient] = None
        for record, spans in spans_by_record.items():
            parts = [flighttest.select_time(data[record], *span) for span in spans]
            name = f"{record}: {fit.name}"
            for coefficient in coefficients:
                samples.append(table_samples(coefficient, start, parts, name))
    return samples


def _project_on_nodes(
    project: Project, start: xr.DataTree, fits: Sequence[Any], samples: Sequence[xr.Dataset]
) -> Any:
    return aerodb.tabulate(fits, start, held=project.held, unplaced=project.unplaced)


def _regress_samples(
    project: Project, start: xr.DataTree, fits: Sequence[Any], samples: Sequence[xr.Dataset]
) -> Any:
    # Published fits have no samples, so they enter by their estimates.
    sampled: list[Any] = []
    published: list[Any] = []
    for fit in fits:
        if _has_samples(fit, samples):
            sampled.append(fit)
        else:
            published.append(fit)
    return aerodb.update.regress_tables(
        samples,
        start,
        coloured_covariance,
        project.held,
        fits=published,
        unplaced=project.unplaced,
        local=sampled,
    )


def _join_by_regression(
    project: Project, start: xr.DataTree, fits: Sequence[Any], samples: Sequence[xr.Dataset]
) -> Any:
    return aerodb.update.join_submodels(fits, start, held=project.held, unplaced=project.unplaced)


WAYS: dict[str, Callable[[Project, xr.DataTree, Sequence[Any], Sequence[xr.Dataset]], Any]] = {
    "tabulate": _project_on_nodes,
    "direct": _regress_samples,
    "join": _join_by_regression,
}
"""Methods of updating tables from flight, by the key ``tabulation`` of a project.

The arguments are project, database, fits (`fit_records`) and samples (`samples_of`).
"""


def _has_samples(fit: Any, samples: Sequence[xr.Dataset]) -> bool:
    # Fit and samples have the same name for one coefficient.
    keys = {(sample.attrs["coefficient"], sample.attrs["name"]) for sample in samples}
    return (fit.estimates.attrs["coefficient"], fit.name) in keys


def final_database(
    project: Project, start: xr.DataTree, fits: Sequence[Any], samples: Sequence[xr.Dataset] = ()
) -> tuple[xr.DataTree, Any]:
    """Return the database after the flights, and its tabulation.

    Parameters
    ----------
    project : Project
        Its `tabulation` is one of `WAYS`.
    start : DataTree
        From `add_missing_terms`.
    fits : sequence of Fit
        From `fit_records`.
    samples : sequence of Dataset
        From `samples_of`. Only the method ``direct`` uses them.
    """
    if fits:
        tabulation = WAYS[project.tabulation](project, start, fits, samples)
    else:
        warnings.warn(_NO_FIT, AeromatchWarning, stacklevel=2)
        tabulation = make_empty_tabulation(_NO_FIT)
    final = aerodb.replace_terms(start, tabulation, note="identified from flight")
    # The title of the project names its report only, so that a new one changes no model.
    final.attrs["title"] = f"{start.attrs['aircraft']}: database after flight"
    return final, tabulation


def compare_tables(
    project: Project,
    start: xr.DataTree,
    fits: Sequence[Any],
    samples: Sequence[xr.Dataset],
    known: Mapping[str, Any] | None = None,
) -> pd.DataFrame:
    """Return the nodes of all `WAYS` side by side (`aerodb.update.compare_ways`).

    `known` has the tabulations that are available already, by method.
    """
    tabulations = dict(known or {})
    by_method: dict[str, Any] = {}
    for method, make in WAYS.items():
        by_method[method] = tabulations.get(method) or make(project, start, fits, samples)
    return aerodb.update.compare_ways(by_method, start)


def with_submodels(
    project: Project, database: xr.DataTree, found: Submodels, tables: bool = False
) -> xr.DataTree:
    """Return a database with the identified hinge moments, stall and ground effect.

    `tables` is a parameter of `replace_ground_effect`.
    """
    if found.stall is not None:
        database = add_stall(attached_database(project, database, found.stall.records), found.stall)
    for loading in found.controls.values():
        database = replace_hinge_moments(database, loading)
    if found.ground_effect is None:
        return database
    return replace_ground_effect(database, found.ground_effect, tables)


def after_flight(project: Project, aircraft: Aircraft, found: Submodels) -> Aircraft:
    """Return the aircraft with its identified engines and control circuits.

    The landing gear is added later, because its identification requires the aerodynamics.
    """
    if found.engine is not None:
        aircraft = with_engine(aircraft, project, found.engine)
    for loading in found.controls.values():
        aircraft = loading.aircraft(aircraft)
    return aircraft

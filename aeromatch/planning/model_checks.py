"""Checks of databases, submodels and models from elsewhere, before they are made."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import aerodb
import flightmech
import flighttest
from aerodb.update.cautions.unplaced_terms import describe_lacking_variables
from aerodb.update.observations import known_terms
from aeromatch.planning.steps import run_collecting_problems
from aeromatch.project.project import Project
from aeromatch.project.sections import (
    EngineSection,
    GroundEffectSection,
    StallSection,
    find_faults,
)
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.controls import ICE
from flightmech.errors import AeromatchError
from flightmech.support.kept_stages.stages import Kept, Stages
from flighttest.regression.combining.published_table import read_published
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.submodels.control_loading.loading import loading_of
from flighttest.submodels.engine.records import read_points
from flighttest.submodels.engine.tables import EngineStructure, read_structure
from flighttest.submodels.landing_gear.wheel_positions import wheels_of
from flighttest.submodels.stall.model import demand_station
from pom.cases.case import PomCase
from pom.fmu.models import Models

# Quantities with a default if they are not recorded: a device at rest, or free air.
_WITH_DEFAULT = {"h_agl", "delta_t", "delta_ta", "delta_tr", "gear", "speedbrake", ICE}


def own_model(
    name: str, aircraft: Aircraft, database: Kept[xr.DataTree]
) -> tuple[flightmech.SimModel | None, list[str]]:
    """Return a compiled model of the project, or None, and the reasons why it cannot be compiled.

    The final model is compiled from the database before the flights. It has the same inputs,
    outputs and parameters.
    """
    problems: list[str] = []
    model = run_collecting_problems(
        problems, f"model {name}", flightmech.compile, aircraft, database.value
    )
    return model, problems


def ground_problems(aircraft: Aircraft, case: PomCase) -> list[str]:
    """Return a problem if a case starts on the ground and the aircraft has no landing gear."""
    if case.drive.trim != "ground" or case.law:
        return []
    if aircraft.gear and aircraft.gear.contacts:
        return []
    return [
        f"case {case.name}: drive.trim is ground, and {aircraft.name} has no landing gear; "
        f"give [[gear.contact]] in its file"
    ]


def foreign_models(project: Project, problems: list[str]) -> dict[str, Models]:
    """Return the models from elsewhere, each with its table of names."""
    foreign: dict[str, Models] = {}
    for name, file in project.fmus.items():
        position = f"models.{name}"
        tables = {}
        if name in project.tables:
            tables[name] = project.tables[name]
        models = run_collecting_problems(problems, position, Models, {name: file}, tables)
        if models is not None:
            run_collecting_problems(problems, position, models.demand_platform)
            foreign[name] = models
    return foreign


def term_problems(project: Project, start: xr.DataTree, published: Sequence[Any]) -> list[str]:
    """Return the reasons why fits cannot update the database.

    The reasons are absent coefficients, absent fixed terms, and terms without standard errors.
    """
    coefficients: dict[str, None] = {}
    for fit in project.fit:
        for text in fit.models:
            coefficients[RegressionModel.parse(text).coefficient] = None
    for published_fit in published:
        coefficients[str(published_fit.model.coefficient)] = None
    problems: list[str] = []
    for coefficient in coefficients:
        position = f"fits of {coefficient}"
        find_terms = partial(known_terms, [coefficient], start, project.held)
        run_collecting_problems(problems, position, find_terms)
    return list(dict.fromkeys(problems))


def unplaced_remarks(project: Project, start: xr.DataTree) -> Iterator[str]:
    """Yield the terms of fits on which no table of the database depends, each once.

    The match stops where the estimate of such a term is significant.
    """
    if project.unplaced != "raise":
        return
    fits: dict[str, list[str]] = {}
    for fit in project.fit:
        for text in fit.models:
            model = RegressionModel.parse(text)
            try:
                (found,) = known_terms([model.coefficient], start, project.held)
            except AeromatchError:
                # a problem of its own (`term_problems`)
                continue
            for line in describe_lacking_variables(found, model.terms):
                fits.setdefault(line, []).append(repr(fit.name))
    for line, names in fits.items():
        yield (
            f"fit {', '.join(dict.fromkeys(names))}: {line}; the match stops if its estimate is "
            f"significant"
        )


def coefficient_names(
    project: Project,
    aircraft: Aircraft,
    starts: Mapping[str, xr.Dataset],
    stages: Stages,
    problems: list[str],
) -> dict[str, set[str]]:
    """Return the variables that `flighttest.coefficients` gives along records, by record.

    Parameters
    ----------
    project : Project
    aircraft : Aircraft
    starts : mapping of str to Dataset (time,)
        First states of records that fits or the ground effect use. [SI]
    stages : Stages
    problems : list of str
        Gets a line for an absent state, such as the thrust of an engine, and for a sample rate
        that is too low for the low-pass.
    """
    # Records with the same channels have the same variables, so one of them is sufficient.
    first: dict[frozenset[str], str] = {}
    representative: dict[str, str] = {}
    for record, states in starts.items():
        channels = frozenset(map(str, states.data_vars))
        representative[record] = first.setdefault(channels, record)
    settings = {
        "aircraft": stages.given(aircraft),
        "errors": project.errors,
        "cutoff": project.cutoff,
    }

    def compute(missing: list[str], put: Callable[..., None]) -> None:
        for record in missing:
            find_names = partial(_variable_names, starts[record], aircraft, project)
            names = run_collecting_problems(problems, f"record {record}", find_names)
            put(record, names or set(), keep=names is not None)

    inputs = {record: {"states": starts[record], **settings} for record in first.values()}
    names = stages.batch("coefficient names", inputs, compute)
    return {record: names[source].value for record, source in representative.items()}


def _variable_names(states: xr.Dataset, aircraft: Aircraft, project: Project) -> set[str]:
    # A record may start at a standstill, where coefficients are 0/0.
    with np.errstate(all="ignore"):
        data = flighttest.coefficients(states, aircraft, project.errors, project.cutoff)
    return {str(name) for name in data.data_vars}


def regressor_problems(project: Project, names: Mapping[str, set[str]]) -> list[str]:
    """Return the variables that models require and that records do not have.

    `names` is the result of `coefficient_names`.
    """
    problems: list[str] = []
    for fit in project.fit:
        problems += _absent_regressors(
            f"fit {fit.name!r}", fit.models, records=fit.records, names=names
        )
    if project.ground_effect is not None:
        records = dict.fromkeys(_flown_records(project.ground_effect))
        problems += _absent_regressors(
            "ground_effect.flown", project.ground_effect.models, records=records, names=names
        )
    if project.stall is not None:
        records = dict.fromkeys(_flown_records(project.stall))
        problems += _absent_regressors(
            "stall.flown", project.stall.models, records=records, names=names
        )
    return problems


def station_problems(project: Project, aircraft: Aircraft) -> Iterator[str]:
    """Yield a problem if the stations of a stall are beyond the wing tips of the aircraft."""
    if project.stall is not None and project.stall.station:
        yield from find_faults("stall.station", demand_station, project.stall.station, aircraft.b)


def _flown_records(section: GroundEffectSection | StallSection) -> list[str]:
    records: list[str] = []
    for selection in section.flown:
        records += selection.records
    return records


def _absent_regressors(
    position: str, models: Iterable[str], records: Iterable[str], names: Mapping[str, set[str]]
) -> list[str]:
    problems: list[str] = []
    # A record without names cannot be read, which is another problem.
    readable = [record for record in records if names.get(record)]
    for model in map(RegressionModel.parse, models):
        for name in (model.coefficient, *model.variables):
            lacking = [record for record in readable if name not in names[record]]
            if lacking:
                problems.append(
                    f"{position}: {model} needs {name}, which record {', '.join(lacking)} "
                    f"does not hold; map its channel"
                )
    return problems


def height_problems(project: Project, names: Mapping[str, set[str]]) -> list[str]:
    """Return a problem if no record of the ground effect has a height above the runway."""
    if project.ground_effect is None:
        return []
    records = _flown_records(project.ground_effect)
    # A record without names cannot be read, which is another problem.
    if not all(names.get(record) for record in records):
        return []
    if any("h_agl" in names[record] for record in records):
        return []
    return [
        "ground_effect.flown: no record has a height over the runway, h_agl; give "
        "runway_elevation in [record] of the name map"
    ]


def variable_problems(
    project: Project, start: xr.DataTree, names: Mapping[str, set[str]]
) -> list[str]:
    """Return the variables that terms of the database require and that the records do not have.

    `names` is the result of `coefficient_names`.
    """
    leaves = aerodb.terms(start)
    missing: dict[tuple[str, str], list[str]] = {}
    for fit in project.fit:
        coefficients = {RegressionModel.parse(text).coefficient for text in fit.models}
        required: dict[str, set[str]] = {}
        for name, leaf in leaves.items():
            if name.split("/")[0] in coefficients:
                required[name] = flightmech.terms.list_model_variables(leaf)
        # A record without names cannot be read, which is another problem.
        for record in filter(names.get, fit.records):
            for term, variables in required.items():
                for variable in sorted(variables - names[record] - _WITH_DEFAULT):
                    missing.setdefault((variable, term), []).append(record)
    problems = []
    for (variable, term), records in missing.items():
        problems.append(
            f"term {term} depends on {variable}, which record "
            f"{', '.join(dict.fromkeys(records))} does not hold; map its channel"
        )
    return problems


def published_fits(project: Project, problems: list[str]) -> list[Any]:
    """Return the local models from elsewhere."""
    fits: list[Any] = []
    for file in project.published:
        fits += run_collecting_problems(problems, "published", read_published, file) or []
    return fits


def name_problems(project: Project) -> list[str]:
    """Return the fits with the same name, record and coefficient, which have no unique name."""
    counts: dict[tuple[str, str, str], int] = {}
    for fit in project.fit:
        for record in fit.records:
            for text in fit.models:
                key = fit.name, record, RegressionModel.parse(text).coefficient
                counts[key] = counts.get(key, 0) + 1
    problems = []
    for (name, record, coefficient), count in counts.items():
        if count > 1:
            problems.append(
                f"fit {name!r} gives {count} models of {coefficient} for record {record}; give "
                f"each fit a name of its own"
            )
    return problems


def submodel_structure_problems(
    project: Project, apriori: Aircraft, aircraft: Aircraft
) -> list[str]:
    """Return the parts that the aircraft files lack for the identification of the submodels."""
    problems: list[str] = []
    if project.engine is not None:
        problems += _engine_problems(project.engine, project.points, apriori)
    for control, section in project.controls.sections.items():
        position = f"controls.{control}"
        settings = (section.model, section.constants, section.arm)
        run_collecting_problems(problems, position, loading_of, aircraft, control, *settings)
        if control not in aircraft.circuits:
            problems.append(
                f"{position}: {aircraft.name} has no [circuit.{control}]; give stops and "
                f"mass at least"
            )
    if project.gear is not None:
        run_collecting_problems(problems, "gear", wheels_of, aircraft)
    if project.ground_effect is not None:
        problems += _ground_effect_problems(project.ground_effect)
    return problems


def _engine_problems(
    section: EngineSection, files: Mapping[str, Path], apriori: Aircraft
) -> list[str]:
    if apriori.engines and apriori.engines[0].propeller is not None:
        return _propeller_problems(section)
    problems: list[str] = []
    for name in ("points", "climbs"):
        if name in files:
            run_collecting_problems(problems, f"engine.{name}", read_points, files[name])
    structure: EngineStructure | None = EngineStructure()
    if "structure" in files:
        # The reader of the project has reported a faulty file already.
        structure = run_collecting_problems([], "", read_structure, files["structure"])
    tables: list[str] = []
    if apriori.engines and apriori.engines[0].deck is not None:
        tables = list(apriori.engines[0].deck.tables)
    if (section.points or section.climbs) and "corrected_thrust" not in tables:
        problems.append(
            f"engine: settled points correct the table corrected_thrust of the a-priori "
            f"deck; it has {' '.join(tables) or 'no tables'}"
        )
    if structure is not None and structure.tables and not section.flights:
        problems.append(
            f"engine.flights: missing; the tables {', '.join(structure.tables)} of "
            f"engine.structure come from whole flights"
        )
    return problems


def _propeller_problems(section: EngineSection) -> list[str]:
    """Return what the section lacks or has too much for an aircraft with propellers."""
    problems = []
    if not section.flights:
        problems.append(
            "engine.flights: missing; thrust and power of a propeller come from climbs, glides and "
            "level accelerations in whole records"
        )
    if section.polar is None:
        problems.append(
            "engine.polar: missing; the thrust of a propeller is identified together with the "
            "drag: give CD0 and K, and polar_stderr"
        )
    for name in ("starts", "points", "climbs", "structure"):
        if getattr(section, name):
            problems.append(f"engine.{name}: belongs to a jet; delete it for propellers")
    if section.engines != (1,):
        problems.append("engine.engines: all propellers are identified together; delete it")
    return problems


def _ground_effect_problems(section: GroundEffectSection) -> list[str]:
    coefficients = [RegressionModel.parse(text).coefficient for text in section.models]
    problems = []
    for name in dict.fromkeys(coefficients):
        if coefficients.count(name) > 1:
            problems.append(f"ground_effect.models: two models of {name}; give one")
    for text in section.ground:
        model = RegressionModel.parse(text)
        if model.coefficient not in coefficients:
            problems.append(
                f"ground_effect.ground: {model} has no model of {model.coefficient} in "
                f"ground_effect.models; add one"
            )
    return problems


def aircraft_of_cases(files: Iterable[str], problems: list[str]) -> None:
    """Read the aircraft files of the cases, which the draws of the models require."""
    for file in dict.fromkeys(files):
        if file:
            run_collecting_problems(problems, "case.aircraft", flightmech.read_aircraft, file)

"""Whether databases, submodels and foreign models of a project can be made, as far as its files
show.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

import aerodb
import flightmech
import flighttest
from aerodb.update.observations import known_terms
from aeromatch.planning.steps import run_collecting_problems
from aeromatch.project.project import Project
from flightmech.aircraft.aircraft import Aircraft
from flightmech.support.kept_stages.stages import Kept, Stages
from flighttest.regression.combining.published import read_published
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.submodels.control_loading.loading import loading_of
from flighttest.submodels.engine.records import read_points
from flighttest.submodels.engine.tables import EngineStructure, read_structure
from flighttest.submodels.landing_gear.wheel_positions import wheels_of
from pom.cases.case import PomCase
from pom.fmu.simulate import Models

_FORMED = (
    "h_agl",
    "delta_t",
    "delta_ta",
    "delta_tr",
    "gear",
    "speedbrake",
)  # at rest or far from the ground where not recorded


def own_model(
    name: str, aircraft: Aircraft, database: Kept[xr.DataTree]
) -> tuple[flightmech.SimModel | None, list[str]]:
    """Return a model of the project, compiled, and why it cannot be.

    The final model is compiled from the database before the flights; it has the same inputs,
    outputs and parameters.
    """
    faults: list[str] = []
    return run_collecting_problems(
        faults, f"model {name}", flightmech.compile, aircraft, database.value
    ), faults


def ground_problems(aircraft: Aircraft, case: PomCase) -> list[str]:
    """Return that a case starts on wheels which the aircraft does not have."""
    if case.drive.trim != "ground" or case.law or (aircraft.gear and aircraft.gear.contacts):
        return []
    return [
        f"case {case.name}: drive.trim is ground, and {aircraft.name} has no landing gear; "
        f"give [[gear.contact]] in its file"
    ]


def foreign_models(project: Project, problems: list[str]) -> dict[str, Models]:
    """Return the models from elsewhere, each with its table of names."""
    found = {}
    for name, file in project.models.items():
        table = {name: project.tables[name]} if name in project.tables else {}
        models = run_collecting_problems(problems, f"models.{name}", Models, {name: file}, table)
        if models is not None:
            run_collecting_problems(problems, f"models.{name}", models.demand_platform)
            found[name] = models
    return found


def term_problems(project: Project, start: xr.DataTree, published: Sequence[Any]) -> list[str]:
    """Return why fits cannot enter the database: coefficients and held terms that it lacks, terms
    without standard errors.
    """
    found: list[str] = []
    wanted = dict.fromkeys(
        RegressionModel.parse(text).coefficient for fit in project.fits for text in fit.models
    )
    wanted |= dict.fromkeys(str(fit.model.coefficient) for fit in published)
    for coefficient in wanted:
        run_collecting_problems(
            found, f"fits of {coefficient}", known_terms, [coefficient], start, project.held
        )
    return list(dict.fromkeys(found))


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
    starts : mapping of str to Dataset (time,)
        First states of records that fits or the ground effect use. [SI]
    stages : Stages
    problems : list of str
        Gets what it lacks: a state such as the thrust of an engine, or samples fast enough for the
        low-pass.
    """
    # one record of all that hold the same channels
    first: dict[frozenset[str], str] = {}
    alike = {
        record: first.setdefault(frozenset(map(str, states.data_vars)), record)
        for record, states in starts.items()
    }
    settings = {
        "aircraft": stages.given(aircraft),
        "errors": project.errors,
        "cutoff": project.cutoff,
    }

    def compute(missing: list[str], put: Callable[..., None]) -> None:
        for record in missing:
            names = run_collecting_problems(
                problems, f"record {record}", _names_of, starts[record], aircraft, project
            )
            put(record, names or set(), keep=names is not None)

    found = stages.batch(
        "coefficient names",
        {record: {"states": starts[record], **settings} for record in first.values()},
        compute,
    )
    return {record: found[one].value for record, one in alike.items()}


def _names_of(states: xr.Dataset, aircraft: Aircraft, project: Project) -> set[str]:
    # the start of a record may be a standstill, where coefficients have no value
    with np.errstate(all="ignore"):
        return set(
            map(
                str,
                flighttest.coefficients(states, aircraft, project.errors, project.cutoff).data_vars,
            )
        )


def regressor_problems(project: Project, names: Mapping[str, set[str]]) -> list[str]:
    """Return the variables that models need and the records do not hold; `names` from
    `coefficient_names`.
    """
    needs = {f"fit {fit.name!r}": (fit.models, list(fit.records)) for fit in project.fits}
    if project.ground_effect is not None:
        flown = [record for one in project.ground_effect.flown for record in one.records]
        needs["ground_effect.flown"] = project.ground_effect.models, list(dict.fromkeys(flown))
    found = []
    for place, (models, records) in needs.items():
        for model in map(RegressionModel.parse, models):
            for name in (model.coefficient, *model.variables):
                lacking = [
                    record for record in records if names.get(record) and name not in names[record]
                ]
                if lacking:
                    found.append(
                        f"{place}: {model} needs {name}, which record {', '.join(lacking)} "
                        f"does not hold; map its channel"
                    )
    return found


def height_problems(project: Project, names: Mapping[str, set[str]]) -> list[str]:
    """Return that no record of the ground effect has a height over the runway."""
    if project.ground_effect is None:
        return []
    records = [record for one in project.ground_effect.flown for record in one.records]
    if not all(names.get(record) for record in records) or any(
        "h_agl" in names[record] for record in records
    ):
        return []
    return [
        "ground_effect.flown: no record has a height over the runway, h_agl; give "
        "runway_elevation in [record] of the name map"
    ]


def variable_problems(
    project: Project, start: xr.DataTree, names: Mapping[str, set[str]]
) -> list[str]:
    """Return the variables that terms of the database need and the records of the fits do not hold;
    `names` by record.
    """
    leaves = aerodb.terms(start)
    missing: dict[tuple[str, str], list[str]] = {}
    for fit in project.fits:
        coefficients = {RegressionModel.parse(text).coefficient for text in fit.models}
        needed = {
            name: flightmech.terms.list_model_variables(leaf)
            for name, leaf in leaves.items()
            if name.split("/")[0] in coefficients
        }
        for record in fit.records:
            if not names.get(record):
                continue  # it cannot be read, which is reported
            for term, variables in needed.items():
                for variable in sorted(variables - names[record] - {*_FORMED}):
                    missing.setdefault((variable, term), []).append(record)
    return [
        f"term {term} depends on {variable}, which record "
        f"{', '.join(dict.fromkeys(records))} does not hold; map its channel"
        for (variable, term), records in missing.items()
    ]


def published_fits(project: Project, problems: list[str]) -> list[Any]:
    """Return the local models from elsewhere."""
    found: list[Any] = []
    for file in project.published:
        found += run_collecting_problems(problems, "published", read_published, file) or []
    return found


def name_problems(project: Project) -> list[str]:
    """Return the fits that could not be distinguished: one name, one record and one coefficient."""
    seen: dict[tuple[str, str, str], int] = {}
    for fit in project.fits:
        for record in fit.records:
            for text in fit.models:
                key = fit.name, record, RegressionModel.parse(text).coefficient
                seen[key] = seen.get(key, 0) + 1
    return [
        f"fit {name!r} gives {count} models of {coefficient} for record {record}; give each "
        f"fit a name of its own"
        for (name, record, coefficient), count in seen.items()
        if count > 1
    ]


def submodel_structure_problems(
    project: Project, apriori: Aircraft, aircraft: Aircraft
) -> list[str]:
    """Return what the aircraft files lack for the submodels that are to be identified."""
    found: list[str] = []
    if project.engine is not None:
        found += _engine_problems(project, apriori)
    for item, asked in project.controls.items():
        run_collecting_problems(
            found,
            f"controls.{item}",
            loading_of,
            aircraft,
            item,
            asked.model,
            asked.constants,
            asked.arm,
        )
        if item not in aircraft.circuits:
            found.append(
                f"controls.{item}: {aircraft.name} has no [circuit.{item}]; give stops and "
                f"mass at least"
            )
    if project.gear is not None:
        run_collecting_problems(found, "gear", wheels_of, aircraft)
    if project.ground_effect is not None:
        found += _ground_problems(project.ground_effect)
    return found


def _engine_problems(project: Project, apriori: Aircraft) -> list[str]:
    asked, found = project.engine, list[str]()
    for name in ("points", "climbs"):
        if name in project.points:
            run_collecting_problems(found, f"engine.{name}", read_points, project.points[name])
    file = project.points.get("structure")
    structure = (
        run_collecting_problems([], "", read_structure, file)
        if file is not None
        else EngineStructure()
    )
    deck = apriori.engines[0].deck if apriori.engines else None
    tables = list(deck.tables) if deck is not None else []
    settled = asked is not None and (asked.points or asked.climbs)
    if settled and "corrected_thrust" not in tables:
        found.append(
            f"engine: settled points correct the table corrected_thrust of the a-priori "
            f"deck; it has {' '.join(tables) or 'no tables'}"
        )
    if asked is not None and structure is not None and structure.tables and not asked.flights:
        found.append(
            f"engine.flights: missing; the tables {', '.join(structure.tables)} of "
            f"engine.structure come from whole flights"
        )
    return found


def _ground_problems(asked: Any) -> list[str]:
    models = [RegressionModel.parse(text) for text in asked.models]
    coefficients = [model.coefficient for model in models]
    found = [
        f"ground_effect.models: two models of {name}; give one"
        for name in dict.fromkeys(coefficients)
        if coefficients.count(name) > 1
    ]
    for text in asked.ground:
        model = RegressionModel.parse(text)
        if model.coefficient not in coefficients:
            found.append(
                f"ground_effect.ground: {model} has no model of {model.coefficient} in "
                f"ground_effect.models; add one"
            )
    return found


def aircraft_of_cases(files: Iterable[str], problems: list[str]) -> None:
    """Read the aircraft of the cases, which draws of the models need."""
    for file in dict.fromkeys(files):
        if file:
            run_collecting_problems(problems, "case.aircraft", flightmech.read_aircraft, file)

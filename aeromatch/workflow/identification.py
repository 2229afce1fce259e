"""Identification and diagnosis of a project, from its files to the three models of a match."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import xarray as xr

import flightmech
import pom
from aeromatch.project.project import Project
from aeromatch.workflow.aerodynamics import (
    WAYS,
    before_flight,
    identifying_records,
    prior_step,
)
from aeromatch.workflow.faulty_samples import list_faults, unflown_cases, without_faults
from aeromatch.workflow.identified import (
    Identified,
    check_identified_records,
    compute_coefficients,
    count_local_models,
    databases_before,
    find_copies,
    fit_coefficients,
    make_table_comparison,
    make_tables,
    read_marks,
    read_records,
    select_samples,
)
from aeromatch.workflow.submodel_stages import (
    add_gear,
    add_separation,
    make_controls,
    make_engine,
    make_final_database,
    make_flying_aircraft,
    make_gear,
    make_ground_effect,
    make_stall,
)
from aeromatch.workflow.windows import (
    inputs_of,
    records_of,
    select_windows,
)
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import IdentificationError
from flightmech.support.kept_stages.stages import Kept, Stages, Values
from flighttest.reconstruction.flight_programme import reconstructed_paths
from pom.diagnosis.corrected_model import correction_reasons
from pom.diagnosis.joint_correction import diagnose_project

Step = Callable[[str], AbstractContextManager[None]]
_RECONSTRUCT_STEP = (
    "reconstruct the states; the records that identify determine the instruments' constants"
)
_TABLES_STEP = {
    "tabulate": "join {} local models",
    "direct": "regress samples",
    "join": "join {} local models by regression",
}


def run_identification(
    project: Project, jobs: int, step: Step, stages: Stages, compare: bool = False
) -> Identified:
    """Return the results of all stages up to the diagnosis of the cases.

    The parameters are parameters of `aeromatch.workflow.steps.perform_match`.
    """
    custody = pom.archive.Custody()
    custody.take([*inputs_of(project, []), *project.fmus.values()])
    aircraft = flightmech.read_aircraft(project.aircraft)
    apriori: Kept[Any] = stages.given(before_flight(project, aircraft))
    cases = [pom.read_case(file) for file in project.cases]
    result = Identified(project, custody, cases, records_of(project, cases))
    with step(prior_step(project)):
        datcom, start = databases_before(project, aircraft, custody, stages)
    unidentified = stages.given(aircraft)
    _reconstruct(result, unidentified, jobs, step=step, stages=stages)
    # The engine precedes the aerodynamics, which require the thrust.
    if project.engine is not None:
        with step("identify the engine"):
            result.engine = make_engine(result, apriori, stages)
    if project.controls.sections:
        with step(f"identify the control loading of {', '.join(project.controls.sections)}"):
            result.controls = make_controls(result, unidentified, jobs, stages)
    flying = make_flying_aircraft(result, unidentified, stages)
    count = len(result.windows.fitted_records())
    with step(f"identify coefficients on {count} flight records"):
        result.data = compute_coefficients(result, flying, jobs, stages)
        result.fits = fit_coefficients(result, jobs, stages)
    final = _tabulate(result, start, compare, step=step, stages=stages)
    # The ground effect multiplies the lift in free air, so it follows the aerodynamics.
    if project.ground_effect is not None:
        with step("identify the ground effect"):
            result.ground_effect = make_ground_effect(result, final, stages)
    # The stall comes on top of the attached flow, which the tables have.
    if project.stall is not None:
        with step("identify the stall"):
            result.stall = make_stall(result, flying, final, stages)
            flying = add_separation(flying, result.stall, "aircraft with separation", stages)
        if aircraft.stall is None:
            # Terms over the separation can only be exchanged between models that have it.  No
            # a-priori term uses it.
            apriori = add_separation(apriori, result.stall, "a-priori separation", stages)
    # The landing gear is last, because it requires lift and drag near the ground.
    if project.gear is not None:
        with step("identify the landing gear"):
            result.gear = make_gear(result, flying, final, stages)
            flying = add_gear(flying, result.gear, stages)
    final = make_final_database(result, final, stages)
    with step(f"swap terms on {len(cases)} cases, build the corrected database"):
        _diagnose(
            result,
            databases=(datcom, final),
            aircraft=(apriori, flying),
            jobs=jobs,
            stages=stages,
        )
    return result


def _reconstruct(
    result: Identified, aircraft: Kept[Aircraft], jobs: int, step: Step, stages: Stages
) -> None:
    """Read and check the flight records, select the windows, and reconstruct the states."""
    result.custody.take(inputs_of(result.project, result.records, result.cases))
    with step(f"read {len(result.records)} flight records"):
        records = read_records(result, stages)
        result.marks = read_marks(result, records, stages)
        windows = select_windows(
            result.project,
            Values(records),
            cases=result.cases,
            marks=result.marks.value,
            copies=find_copies(result, records, stages),
        )
    with step("check the flight records"):
        result.checks = check_identified_records(records, aircraft.value, jobs, stages)
    faults = {name: check.value.faults for name, check in result.checks.items()}
    result.windows, result.left_out = without_faults(result.project, windows, faults)
    with step(_RECONSTRUCT_STEP):
        try:
            result.paths = reconstruct_records(result.project, records, aircraft, jobs, stages)
        except IdentificationError as error:
            listed = "; ".join(list_faults(faults))
            if not listed:
                raise
            # they are the likeliest cause
            raise IdentificationError(
                f"{error}. The check of the records has faulty samples: {listed}; cut the records "
                f"there (`aeromatch flight cut`), or leave the faulty ones out"
            ) from error
    result.unflown = unflown_cases(
        result.cases, faults, lambda record: result.paths[record].value.states
    )
    result.left_out += result.unflown.values()


def reconstruct_records(
    project: Project,
    records: Mapping[str, Kept[xr.DataTree]],
    aircraft: Kept[Aircraft],
    jobs: int,
    stages: Stages,
) -> dict[str, Kept[Any]]:
    """Return the reconstructed paths; only the records that identify inform the others."""
    identifying = identifying_records(project, records)
    proving = {name: record for name, record in records.items() if name not in identifying}
    return reconstructed_paths(
        {name: records[name] for name in identifying},
        aircraft,
        jobs=jobs,
        validation=proving,
        stages=stages,
    )


def find_paths(project: Project, jobs: int, step: Step, stages: Stages) -> dict[str, Kept[Any]]:
    """Return the reconstructed paths of a match, from the stages where they are stored.

    The inputs of the stages are those of `run_identification`.  After a match without a change of
    the project nothing is computed again.
    """
    custody = pom.archive.Custody()
    aircraft = flightmech.read_aircraft(project.aircraft)
    cases = [pom.read_case(file) for file in project.cases]
    result = Identified(project, custody, cases, records_of(project, cases))
    custody.take(inputs_of(project, result.records))
    with step(f"read {len(result.records)} flight records"):
        records = read_records(result, stages)
    with step(_RECONSTRUCT_STEP):
        return reconstruct_records(project, records, stages.given(aircraft), jobs, stages)


def _tabulate(
    result: Identified, start: Kept[xr.DataTree], compare: bool, step: Step, stages: Stages
) -> Kept[xr.DataTree]:
    """Return the database after the flights without submodels, and compare it if requested."""
    tabulation = result.project.tabulation
    text = _TABLES_STEP[tabulation].format(count_local_models(result))
    with step(f"{text} and the prior into tables"):
        samples: Kept[list[xr.Dataset]] = stages.given([])
        if compare or tabulation == "direct":
            samples = select_samples(result, start, stages)
        result.tables = make_tables(result, start, samples, stages)
    if compare:
        with step(f"make the tables in all {len(WAYS)} ways and compare them"):
            result.compared = make_table_comparison(result, start, samples, stages)
    return result.tables.part("database", lambda both: both[0])


def _diagnose(
    result: Identified,
    databases: tuple[Kept[xr.DataTree], Kept[xr.DataTree]],
    aircraft: tuple[Kept[Any], Kept[Any]],
    jobs: int,
    stages: Stages,
) -> None:
    """Diagnose the cases and make the corrected model.

    `databases` and `aircraft` are those before and after the flights.
    """
    datcom, final = databases
    apriori, flying = aircraft
    # The kernel does not simulate the FMU of a control law, so a case with one has no diagnosis.
    cases = [case for case in result.cases if not case.law and case.name not in result.unflown]
    paths = {case.name: result.paths[Path(case.record).stem] for case in cases}
    by_case = flying.part("by case", lambda craft: dict.fromkeys(paths, craft))
    diagnosis = diagnose_project(
        cases,
        datcom,
        final,
        aircraft=by_case,
        apriori=apriori,
        paths=paths,
        jobs=jobs,
        stages=stages,
    )
    result.diagnoses, result.ranking = diagnosis.tables, diagnosis.ranking
    # The diagnoses enter the corrected model by what it states of them, terms and reasons.
    reasons = correction_reasons(result.diagnoses)
    corrected = stages.one(
        "corrected database",
        {"before": datcom, "after": final, "reasons": reasons},
        lambda: pom.corrected_database(datcom.value, final.value, result.diagnoses),
    )
    mixed = stages.one(
        "corrected aircraft",
        {"before": apriori, "after": flying, "reasons": reasons},
        lambda: pom.corrected_aircraft(apriori.value, flying.value, result.diagnoses),
    )
    names = result.project.own_models
    result.databases = dict(zip(names, (datcom, corrected, final), strict=True))
    result.aircraft = dict(zip(names, (apriori, mixed, flying), strict=True))

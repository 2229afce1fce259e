"""Stages that identify the submodels of a project, and add them to aircraft and database."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import xarray as xr

from aeromatch.workflow.aerodynamics import after_flight, thread_count, with_submodels
from aeromatch.workflow.identified import Identified
from aeromatch.workflow.submodels import (
    identified_controls,
    identified_engine,
    identified_gear,
    identified_ground_effect,
    identified_stall,
    terms_near_ground,
    with_separation,
)
from aeromatch.workflow.windows import Spans
from flightmech.aircraft.aircraft import Aircraft
from flightmech.support.kept_stages.stages import Kept, Stages, Values


def _select_inputs(
    spans: Mapping[str, Spans], section: str, results: Mapping[str, Kept[Any]]
) -> dict[str, Any]:
    """Return the windows of a section of the project file, and the results of their records."""
    selected: dict[str, Spans] = {}
    records: dict[str, Kept[Any]] = {}
    for position, spans_by_record in spans.items():
        if position.startswith(section):
            selected[position] = spans_by_record
            for name in spans_by_record:
                records[name] = results[name]
    return {"spans": selected, "records": records}


def make_engine(result: Identified, apriori: Kept[Aircraft], stages: Stages) -> Kept[Any]:
    """Return the identified engine."""
    project, spans = result.project, result.windows.submodels
    points = list(project.points.values())

    def make() -> Any:
        engine = identified_engine(project, apriori.value, Values(result.paths), spans)
        result.custody.check(points)
        return engine

    # The hashes are taken before the files are read, and checked afterwards.
    result.custody.take(points)
    inputs = {
        "settings": project.engine,
        "files": {name: result.content(file) for name, file in project.points.items()},
        "aircraft": apriori,
        **_select_inputs(spans, "engine.", result.paths),
    }
    return stages.one("engine", inputs, make)


def make_controls(
    result: Identified, aircraft: Kept[Aircraft], jobs: int, stages: Stages
) -> Kept[Any]:
    """Return the control loadings with free and driven motion, as `identified_controls`."""
    project, spans = result.project, result.windows.submodels

    def make() -> Any:
        return identified_controls(
            project,
            aircraft.value,
            paths=Values(result.paths),
            spans=spans,
            jobs=thread_count(jobs),
        )

    inputs = {
        "settings": project.controls.sections,
        "aircraft": aircraft,
        **_select_inputs(spans, "controls.", result.paths),
    }
    return stages.one("control loading", inputs, make)


def make_flying_aircraft(
    result: Identified, aircraft: Kept[Aircraft], stages: Stages
) -> Kept[Aircraft]:
    """Return the aircraft with its identified engines and control circuits."""
    project = result.project
    # Without these submodels a stage would only copy the aircraft.
    if project.engine is None and not project.controls.sections:
        return aircraft
    inputs = {
        "aircraft": aircraft,
        "settings": project.engine,
        "engine": result.engine,
        "controls": result.controls,
    }
    return stages.one(
        "aircraft", inputs, lambda: after_flight(project, aircraft.value, result.submodels())
    )


def make_ground_effect(result: Identified, final: Kept[xr.DataTree], stages: Stages) -> Kept[Any]:
    """Return the identified ground effect; `final` gives the free-air terms."""
    project, spans = result.project, result.windows.submodels
    near = stages.one(
        "terms near the ground",
        {"database": final, "settings": project.ground_effect},
        lambda: terms_near_ground(project, final.value),
    )
    # The hash of the content is the input, and not the hash of the stored file. So a change of
    # other coefficients does not lead to a new identification.
    neighbour = stages.given(near.value)

    def make() -> Any:
        return identified_ground_effect(project, Values(result.data), spans, neighbour.value)

    inputs = {
        "settings": project.ground_effect,
        "database": neighbour,
        **_select_inputs(spans, "ground_effect.", result.data),
    }
    return stages.one("ground effect", inputs, make)


def make_stall(
    result: Identified, aircraft: Kept[Aircraft], final: Kept[xr.DataTree], stages: Stages
) -> Kept[Any]:
    """Return the identified stall; `final` is the attached flow."""
    project, spans = result.project, result.windows.submodels

    def make() -> Any:
        return identified_stall(
            project, aircraft.value, Values(result.data), spans, database=final.value
        )

    inputs = {
        "settings": project.stall,
        "database": final,
        "aircraft": aircraft,
        **_select_inputs(spans, "stall.", result.data),
    }
    return stages.one("stall", inputs, make)


def add_separation(
    aircraft: Kept[Aircraft], stall: Kept[Any], name: str, stages: Stages
) -> Kept[Aircraft]:
    """Return the aircraft with the identified separation; `name` is that of the stage."""
    inputs = {"aircraft": aircraft, "stall": stall}
    return stages.one(name, inputs, lambda: with_separation(aircraft.value, stall.value))


def make_gear(
    result: Identified, aircraft: Kept[Aircraft], final: Kept[xr.DataTree], stages: Stages
) -> Kept[Any]:
    """Return the identified landing gear."""
    project, spans = result.project, result.windows.submodels

    def make() -> Any:
        return identified_gear(
            project,
            aircraft.value,
            paths=Values(result.paths),
            spans=spans,
            database=with_submodels(project, final.value, result.submodels()),
        )

    inputs = {
        "settings": project.gear,
        "controls": result.controls,
        "ground effect": result.ground_effect,
        "stall": result.stall,
        "attached": project.stall.attached_to if project.stall is not None else "",
        "database": final,
        "aircraft": aircraft,
        **_select_inputs(spans, "gear.", result.paths),
    }
    return stages.one("landing gear", inputs, make)


def add_gear(aircraft: Kept[Aircraft], gear: Kept[Any], stages: Stages) -> Kept[Aircraft]:
    """Return the aircraft with its identified landing gear."""
    inputs = {"aircraft": aircraft, "landing gear": gear}
    return stages.one("aircraft with gear", inputs, lambda: gear.value.aircraft(aircraft.value))


def make_final_database(
    result: Identified, final: Kept[xr.DataTree], stages: Stages
) -> Kept[xr.DataTree]:
    """Return the final database with hinge moments, ground effect and stall."""
    project = result.project
    section = project.ground_effect
    if section is None and project.stall is None and not project.controls.sections:
        return final
    tables = section is not None and section.tables
    inputs = {
        "database": final,
        "controls": result.controls,
        "ground effect": result.ground_effect,
        "stall": result.stall,
        "attached": project.stall.attached_to if project.stall is not None else "",
        "tables": tables,
    }
    return stages.one(
        "final database",
        inputs,
        lambda: with_submodels(project, final.value, result.submodels(), tables),
    )

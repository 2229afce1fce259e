"""Submodels of a project identified from its records: engine, control loading, ground effect,
landing gear.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from joblib import Parallel, delayed

import aerodb
import flighttest
from aeromatch.project.project import Project
from aeromatch.project.sections import RecordSelection
from flightmech.aircraft.aircraft import Aircraft
from flightmech.build_up import required_coefficients
from flightmech.errors import SchemaError, UnknownName
from flighttest.records.sensors.instruments import pick_up_errors
from flighttest.submodels.control_loading.loading import loading_of
from flighttest.submodels.engine.records import engine_channels, read_points
from flighttest.submodels.engine.static_thrust import Polar
from flighttest.submodels.engine.tables import EngineStructure, read_structure
from flighttest.submodels.landing_gear.identification import identify_landing_gear
from flighttest.submodels.landing_gear.reconstructed_loads import GroundRecord

Spans = dict[str, list[tuple[float, float]]]
"""Start and end of what is taken of each record. [s]"""


@dataclass(frozen=True)
class Submodels:
    """Submodels identified from the records of a project; None or empty where the project has no
    section for them.

    Attributes
    ----------
    engine : EngineFit or None
    controls : dict of str to IdentifiedLoading
    free_motion : dict of str to list of Flown
        Pulses and releases of the controls, simulated with what was identified.
    driven_motion : dict of str to list of Dataset (time,)
        Slow manoeuvres of the controls.
    ground_effect : GroundEffect or None
    gear : IdentifiedGear or None
    """

    engine: Any = None
    controls: Mapping[str, Any] = field(default_factory=dict)
    free_motion: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    driven_motion: Mapping[str, Sequence[xr.Dataset]] = field(default_factory=dict)
    ground_effect: Any = None
    gear: Any = None

    @property
    def found(self) -> dict[str, Any]:
        """The results by the name of the submodel, for the report."""
        named = {
            "engine": self.engine,
            **self.controls,
            "ground effect": self.ground_effect,
            "landing gear": self.gear,
        }
        return {name: result for name, result in named.items() if result is not None}


def spans_of(
    place: str,
    flown: Iterable[RecordSelection],
    tables: Mapping[str, pd.DataFrame],
    problems: list[str],
) -> Spans:
    """Return start and end of manoeuvres and windows by record; without both the whole record.

    Parameters
    ----------
    place : str
        Where the project file has them.
    flown : iterable of Flown
    tables : mapping of str to DataFrame
        `flighttest.manoeuvres` by record.
    problems : list of str
        Gets a line for every manoeuvre that a record does not have.
    """
    found: Spans = {}
    for one in flown:
        for record in one.records:
            spans = [*_spans(place, record, one.manoeuvres, tables[record], problems), *one.window]
            whole = [] if one.manoeuvres or one.window else [(-np.inf, np.inf)]
            found.setdefault(record, []).extend(spans or whole)
    return found


def _spans(
    place: str, record: str, wanted: Iterable[str], table: pd.DataFrame, problems: list[str]
) -> list[tuple[float, float]]:
    """Return the windows of manoeuvres in one record; ``"3211 elevator"`` is kind and control,
    ``"trim"`` a kind.
    """
    labels = (table["manoeuvre"] + " " + table["control"].fillna("")).str.strip()
    found: list[tuple[float, float]] = []
    for name in wanted:
        rows = table[(labels == name) | (table["manoeuvre"] == name)]
        if rows.empty:
            problems.append(
                f"{place}, record {record}: {UnknownName(name, set(labels), 'manoeuvre')}"
            )
        found += [
            (float(start), float(end))
            for start, end in zip(rows["start"], rows["end"], strict=True)
        ]
    return found


def find_case_overlaps(place: str, spans: Spans, cases: Iterable[Any]) -> list[str]:
    """Return a line for every case whose record was to identify something over the time that is
    replayed.
    """
    found = []
    for case in cases:
        start, end = case.window
        taken = [
            span
            for span in spans.get(Path(case.record).stem, [])
            if span[0] < end and start < span[1]
        ]
        found += [
            f"{place}: record {Path(case.record).stem} proves case {case.name} from "
            f"{start:g} to {end:g} s; it cannot identify too"
        ] * bool(taken)
    return found


def select_spans(data: xr.Dataset, spans: Iterable[tuple[float, float]]) -> list[xr.Dataset]:
    """Return the parts of a record."""
    return [data.sel(time=slice(start, end)) for start, end in spans]


def identified_engine(
    project: Project, apriori: Aircraft, paths: Mapping[str, Any], spans: Mapping[str, Spans]
) -> Any:
    """Return the engine as the records give it; the a-priori deck is that of the first engine of
    `apriori`.

    Parameters
    ----------
    project : Project
        With a section ``[engine]``.
    apriori : Aircraft
    paths : mapping of str to Path
        Reconstructions by record.
    spans : mapping of str to dict
        By place in the project file.
    """
    asked = project.engine
    if asked is None:
        return None

    def channels(place: str) -> list[xr.Dataset]:
        parts = [
            (record, part)
            for record, own in spans.get(place, {}).items()
            for part in select_spans(paths[record].states, own)
        ]
        return [
            thin_samples(engine_channels(part, asked.engines, asked.pla), asked.rate).assign_attrs(
                record=record
            )
            for record, part in parts
        ]

    points = {
        name: read_points(file) for name, file in project.points.items() if name != "structure"
    }
    structure = (
        read_structure(project.points["structure"])
        if "structure" in project.points
        else EngineStructure()
    )
    deck = apriori.engines[0].deck if apriori.engines else None
    return flighttest.identify_engine(
        channels("engine.flown"),
        channels("engine.starts"),
        points.get("points"),
        points.get("climbs"),
        deck.tables if deck else None,
        Polar(*asked.polar, *asked.polar_stderr) if asked.polar else None,
        apriori.S,
        len(asked.engines),
        flights=channels("engine.flights"),
        **structure.keywords(),
    )


def thin_samples(data: xr.Dataset, rate: float) -> xr.Dataset:
    """Return every so many samples, at most `rate` a second."""
    step = float(np.median(np.diff(data["time"].values)))
    return data.isel(time=slice(None, None, max(1, round(1.0 / (rate * step)))))


def with_engine(aircraft: Aircraft, project: Project, found: Any) -> Aircraft:
    """Return an aircraft all of whose engines have the identified deck."""
    deck = found.deck(project.engine.pla or (0.0, 1.0)) if project.engine else None
    return (
        replace(
            aircraft,
            engines=tuple(replace(engine, deck=deck, thrust=None) for engine in aircraft.engines),
        )
        if deck
        else aircraft
    )


def identified_controls(
    project: Project,
    aircraft: Aircraft,
    paths: Mapping[str, Any],
    spans: Mapping[str, Spans],
    jobs: int = 1,
) -> tuple[dict[str, Any], dict[str, Any], dict[str, list[xr.Dataset]]]:
    """Return the control loading of every control that the project names, its simulated free
    motion, and its driven manoeuvres.

    Driven manoeuvres that are whole records are taken without the free ones.  Controls are shared
    out to `jobs` threads.
    """

    calls, moved = [], {}
    for item, asked in project.controls.items():
        free = spans.get(f"controls.{item}.free", {})
        driven = {
            record: _less(own, free.get(record, []))
            for record, own in spans[f"controls.{item}.driven"].items()
        }
        moved[item], fast = (
            [
                part
                for record, own in group.items()
                for part in select_spans(_on_ground(paths[record].states), own)
            ]
            for group in (driven, free)
        )
        loading = loading_of(aircraft, item, asked.model, asked.constants, asked.arm)
        known, errors = aircraft.circuits.get(item), pick_up_errors(aircraft.instruments)
        calls.append(
            delayed(_identified_control)(loading, moved[item], fast, asked.order, errors, known)
        )
    made = Parallel(n_jobs=max(1, min(jobs, len(calls))), backend="threading")(
        calls
    )  # most of it is linear algebra on large arrays
    found = dict(zip(moved, made))
    return (
        {item: one for item, (one, _) in found.items()},
        {item: flown for item, (_, flown) in found.items()},
        moved,
    )


def _identified_control(
    loading: Any,
    slow: Sequence[xr.Dataset],
    fast: Sequence[xr.Dataset],
    order: int,
    errors: Mapping[str, Any],
    known: Any,
) -> tuple[Any, Any]:
    """Return the control loading and its simulated free motion."""
    found = flighttest.identify_control_loading(
        loading, slow, fast, order, errors=errors, drawings=known
    )
    return found, found.fly(fast)


def _on_ground(states: xr.Dataset) -> xr.Dataset:
    """Return states with the switch of the nose wheel, which the spring of the pedals requires,
    under the name ``wow``.
    """
    return (
        states.assign(wow=states["wow_nose"])
        if "wow_nose" in states and "wow" not in states
        else states
    )


def _less(
    spans: Sequence[tuple[float, float]], taken: Sequence[tuple[float, float]]
) -> list[tuple[float, float]]:
    """Return the remainder of spans of time without others."""
    left = list(spans)
    for start, end in taken:
        cut = [[(a, min(b, start)), (max(a, end), b)] for a, b in left]
        left = [(a, b) for pair in cut for a, b in pair if a < b]
    return left


def identified_ground_effect(
    project: Project,
    data: Mapping[str, xr.Dataset],
    spans: Mapping[str, Spans],
    database: xr.DataTree,
) -> Any:
    """Return the ground effect next to the free-air terms of `database`; `data` from
    `flighttest.coefficients`, by record.
    """
    asked = project.ground_effect
    if asked is None:
        return None
    changed = {
        model.coefficient: model.terms
        for model in map(flighttest.RegressionModel.parse, asked.ground)
    }
    parts = [
        (record, part)
        for record, own in spans["ground_effect.flown"].items()
        for part in select_spans(data[record], own)
    ]
    models = [flighttest.RegressionModel.parse(text) for text in asked.models]
    names = [record for record, _ in parts]
    return flighttest.identify_ground_effect(
        models, [part for _, part in parts], changed, database, asked.free_air == "held", names
    )


def terms_near_ground(project: Project, database: xr.DataTree) -> xr.DataTree:
    """Return what of a database the ground effect is identified next to: the terms of its
    coefficients, and of coefficients that these depend on.
    """
    leaves, axes = aerodb.terms(database), str(database.attrs["force_axes"])
    asked = project.ground_effect.models if project.ground_effect is not None else []
    wanted = new = {flighttest.RegressionModel.parse(text).coefficient for text in asked}
    while new:
        own = [leaf for name, leaf in leaves.items() if name.split("/")[0] in new]
        new = set().union(*(required_coefficients(leaf, axes) for leaf in own)) - wanted
        wanted = wanted | new
    taken = {name: leaf for name, leaf in leaves.items() if name.split("/")[0] in wanted}
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs={"force_axes": axes}), **taken})


def identified_gear(
    project: Project,
    aircraft: Aircraft,
    paths: Mapping[str, Any],
    spans: Mapping[str, Spans],
    database: xr.DataTree,
) -> Any:
    """Return the landing gear of the ground runs; `database` gives the air forces near the ground."""
    asked = project.gear
    if asked is None:
        return None
    parts = [
        (paths[record], part)
        for record, own in spans["gear.flown"].items()
        for part in select_spans(paths[record].states, own)
    ]
    records = [GroundRecord(part, path.biases) for path, part in parts]
    return identify_landing_gear(
        records, aircraft, database, asked.errors, flown=asked.output_error
    )


def raise_problems(project: Project, problems: Sequence[str]) -> None:
    """Raise all problems of a project, if any."""
    if problems:
        raise SchemaError(str(project.file), list(problems))

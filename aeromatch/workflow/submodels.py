"""Submodels of a project identified from its records: engine, control loading, ground effect,
landing gear.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import xarray as xr
from joblib import Parallel, delayed

import aerodb
import flighttest
from aeromatch.project.project import Project
from aeromatch.project.sections import EngineSection
from aeromatch.workflow.windows import Spans, parts_in_spans, select_spans
from flightmech.aircraft.aircraft import Aircraft
from flightmech.build_up import required_coefficients
from flightmech.quantities import parse_quantity
from flighttest.records.sensors.instruments import pick_up_errors
from flighttest.submodels.control_loading.loading import loading_of
from flighttest.submodels.engine.propellers.identification import identify_propeller
from flighttest.submodels.engine.propellers.result import PropellerFit
from flighttest.submodels.engine.records import engine_channels, read_points
from flighttest.submodels.engine.static_thrust import Polar
from flighttest.submodels.engine.tables import EngineStructure, read_structure
from flighttest.submodels.landing_gear.identification import identify_landing_gear
from flighttest.submodels.landing_gear.reconstructed_loads import GroundRecord
from flighttest.submodels.stall.database_terms import continue_attached_flow, reach_of
from flighttest.submodels.stall.identification import identify_stall
from flighttest.submodels.stall.model import demand_station


@dataclass(frozen=True)
class Submodels:
    """Submodels identified from the records of a project.

    A submodel is None or empty if the project has no section for it.

    Attributes
    ----------
    engine : EngineFit, PropellerFit or None
    controls : dict of str to IdentifiedLoading
    free_motion : dict of str to list of Flown
        Pulses and releases of the controls, simulated with the identified loading.
    driven_motion : dict of str to list of Dataset (time,)
        Slow manoeuvres of the controls.
    ground_effect : GroundEffect or None
    stall : StallIdentification or None
    gear : IdentifiedGear or None
    """

    engine: Any = None
    controls: Mapping[str, Any] = field(default_factory=dict)
    free_motion: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    driven_motion: Mapping[str, Sequence[xr.Dataset]] = field(default_factory=dict)
    ground_effect: Any = None
    stall: Any = None
    gear: Any = None

    @property
    def found(self) -> dict[str, Any]:
        """The results by the name of the submodel, for the report."""
        results = {
            "engine": self.engine,
            **self.controls,
            "ground effect": self.ground_effect,
            "stall": self.stall,
            "landing gear": self.gear,
        }
        return {name: result for name, result in results.items() if result is not None}


def identified_engine(
    project: Project, apriori: Aircraft, paths: Mapping[str, Any], spans: Mapping[str, Spans]
) -> Any:
    """Return the engine identified from the records, or None without a section ``[engine]``.

    The a-priori deck is the deck of the first engine of `apriori`. An aircraft with propellers has
    its propellers and engines identified together with the polar (`identify_propeller`).

    Parameters
    ----------
    project : Project
    apriori : Aircraft
    paths : mapping of str to Path
        Reconstructions by record.
    spans : mapping of str to dict
        By position in the project file.
    """
    section = project.engine
    if section is None:
        return None
    if apriori.engines and apriori.engines[0].propeller is not None:
        return _identified_propeller(section, apriori, paths, spans)
    points = {}
    for name, file in project.points.items():
        if name != "structure":
            points[name] = read_points(file)
    structure = EngineStructure()
    if "structure" in project.points:
        structure = read_structure(project.points["structure"])
    # All engines are of one type, so the first deck is the prior of all.
    tables = None
    if apriori.engines and apriori.engines[0].deck:
        tables = apriori.engines[0].deck.tables
    polar = None
    if section.polar:
        polar = Polar(*section.polar, *section.polar_stderr)
    return flighttest.identify_engine(
        power_changes=_engine_records(section, paths, spans.get("engine.flown", {})),
        starts=_engine_records(section, paths, spans.get("engine.starts", {})),
        recorded=points.get("points"),
        equilibrium=points.get("climbs"),
        prior=tables,
        polar=polar,
        S=apriori.S,
        engines=len(section.engines),
        flights=_engine_records(section, paths, spans.get("engine.flights", {})),
        structure=structure,
    )


def _identified_propeller(
    section: EngineSection,
    apriori: Aircraft,
    paths: Mapping[str, Any],
    spans: Mapping[str, Spans],
) -> PropellerFit:
    """Return propellers and engines from the steady power and the power changes of the records.

    Whole flights give both; windows of power changes give the dynamics alone.
    """
    assert section.polar is not None
    steady, changes = [], []
    for record, record_spans in spans.get("engine.flights", {}).items():
        for part in select_spans(paths[record].states, record_spans):
            steady.append(thin_samples(part, section.rate).assign_attrs(record=record))
    for record, record_spans in spans.get("engine.flown", {}).items():
        for part in select_spans(paths[record].states, record_spans):
            changes.append(thin_samples(part, section.rate).assign_attrs(record=record))
    return identify_propeller(
        steady,
        apriori,
        Polar(*section.polar, *section.polar_stderr),
        power_changes=[*steady, *changes],
        pla=section.pla,
    )


def _engine_records(
    section: EngineSection, paths: Mapping[str, Any], spans: Spans
) -> list[xr.Dataset]:
    """Return the engine channels of the windows at the sample rate of the section."""
    parts = []
    for record, record_spans in spans.items():
        for part in select_spans(paths[record].states, record_spans):
            channels = engine_channels(part, section.engines, section.pla)
            parts.append(thin_samples(channels, section.rate).assign_attrs(record=record))
    return parts


def thin_samples(data: xr.Dataset, rate: float) -> xr.Dataset:
    """Return every n-th sample, with about `rate` samples per second. [1/s]"""
    # The median is the sample time also of a record with gaps.
    step = float(np.median(np.diff(data["time"].values)))
    return data.isel(time=slice(None, None, max(1, round(1.0 / (rate * step)))))


def with_engine(aircraft: Aircraft, project: Project, found: Any) -> Aircraft:
    """Return an aircraft whose engines all have the identified deck, or propeller and engine."""
    if project.engine is None:
        return aircraft
    if isinstance(found, PropellerFit):
        return found.aircraft(aircraft)
    # Without lever angles, the lever is a fraction from idle to full power.
    deck = found.deck(project.engine.pla or (0.0, 1.0))
    if not deck:
        return aircraft
    engines = tuple(replace(engine, deck=deck, thrust=None) for engine in aircraft.engines)
    return replace(aircraft, engines=engines)


def identified_controls(
    project: Project,
    aircraft: Aircraft,
    paths: Mapping[str, Any],
    spans: Mapping[str, Spans],
    jobs: int = 1,
) -> tuple[dict[str, Any], dict[str, Any], dict[str, list[xr.Dataset]]]:
    """Return the control loading of every control that the project names.

    Parameters
    ----------
    project : Project
    aircraft : Aircraft
    paths : mapping of str to Path
        Reconstructions by record.
    spans : mapping of str to dict
        By position in the project file.
    jobs : int
        Threads; each identifies one control at a time.

    Returns
    -------
    loadings : dict of str to IdentifiedLoading
        By control.
    free_motion : dict of str to list of Flown
        Simulated free motion.
    driven_motion : dict of str to list of Dataset (time,)
        Driven manoeuvres. A whole record is used without its free manoeuvres.
    """
    calls = []
    driven_motion: dict[str, list[xr.Dataset]] = {}
    for item, section in project.controls.sections.items():
        free = spans.get(f"controls.{item}.free", {})
        # A whole record contains the free manoeuvres too, so they are cut out.
        driven: Spans = {}
        for record, record_spans in spans[f"controls.{item}.driven"].items():
            driven[record] = _subtract_spans(record_spans, free.get(record, []))
        driven_motion[item] = _ground_parts(paths, driven)
        call = delayed(_identify_control)(
            loading_of(aircraft, item, section.model, section.constants, section.arm),
            driven_motion[item],
            _ground_parts(paths, free),
            section.order,
            method=section.method,
            errors=pick_up_errors(aircraft.instruments),
            circuit=aircraft.circuits.get(item),
        )
        calls.append(call)
    # Threads are sufficient: most of the time is linear algebra on large arrays.
    threads = max(1, min(jobs, len(calls)))
    results = Parallel(n_jobs=threads, backend="threading")(calls)
    loadings: dict[str, Any] = {}
    free_motion: dict[str, Any] = {}
    for item, (loading, motion) in zip(driven_motion, results):
        loadings[item] = loading
        free_motion[item] = motion
    return loadings, free_motion, driven_motion


def _identify_control(
    loading: Any,
    driven: Sequence[xr.Dataset],
    free: Sequence[xr.Dataset],
    order: int,
    method: str,
    errors: Mapping[str, Any],
    circuit: Any,
) -> tuple[Any, Any]:
    """Return the control loading and its simulated free motion."""
    identified = flighttest.identify_control_loading(
        loading, driven, free, order, errors=errors, drawings=circuit, method=method
    )
    return identified, identified.fly(free)


def _ground_parts(paths: Mapping[str, Any], spans: Spans) -> list[xr.Dataset]:
    """Return the windows of the states, with the nose-wheel switch under the name ``wow``.

    The spring of the pedals requires this switch.
    """
    parts = []
    for record, record_spans in spans.items():
        states = paths[record].states
        if "wow_nose" in states and "wow" not in states:
            states = states.assign(wow=states["wow_nose"])
        parts += select_spans(states, record_spans)
    return parts


def _subtract_spans(
    spans: Sequence[tuple[float, float]], excluded: Sequence[tuple[float, float]]
) -> list[tuple[float, float]]:
    """Return the parts of time spans that are outside of all excluded spans."""
    parts = list(spans)
    for start, end in excluded:
        pieces = []
        # Each part leaves a piece before and a piece after the excluded span; either may be empty.
        for first, last in parts:
            pieces += [(first, min(last, start)), (max(first, end), last)]
        parts = [piece for piece in pieces if piece[0] < piece[1]]
    return parts


def identified_ground_effect(
    project: Project,
    data: Mapping[str, xr.Dataset],
    spans: Mapping[str, Spans],
    database: xr.DataTree,
) -> Any:
    """Return the ground effect, or None without a section ``[ground_effect]``.

    Parameters
    ----------
    project : Project
    data : mapping of str to Dataset
        From `flighttest.coefficients`, by record.
    spans : mapping of str to dict
        By position in the project file.
    database : DataTree
        Gives the free-air terms.
    """
    section = project.ground_effect
    if section is None:
        return None
    changed = _terms_by_coefficient(section.ground)
    parts, names = parts_in_spans(data, spans["ground_effect.flown"])
    models = [flighttest.RegressionModel.parse(text) for text in section.models]
    return flighttest.identify_ground_effect(
        models, parts, changed, database=database, hold=section.free_air == "held", names=names
    )


def identified_stall(
    project: Project,
    aircraft: Aircraft,
    data: Mapping[str, xr.Dataset],
    spans: Mapping[str, Spans],
    database: xr.DataTree,
) -> Any:
    """Return the stall, or None without a section ``[stall]``.

    Parameters
    ----------
    project : Project
    aircraft : Aircraft
        Gives span and chord.
    data : mapping of str to Dataset
        From `flighttest.coefficients`, by record.
    spans : mapping of str to dict
        By position in the project file.
    database : DataTree
        The attached flow before `attached_database`.
    """
    section = project.stall
    if section is None:
        return None
    parts, names = parts_in_spans(data, spans["stall.flown"])
    database = attached_database(project, database, parts)
    return identify_stall(
        parts,
        demand_station(section.station, aircraft.b),
        aircraft.cbar,
        database=database,
        axis=section.over,
        coefficients=section.coefficients,
        attached=_terms_by_coefficient(section.attached),
        names=names,
    )


def _terms_by_coefficient(texts: Sequence[str]) -> dict[str, Any]:
    """Return the terms of models such as ``"CL = 1 + alpha"`` by their coefficient."""
    models = [flighttest.RegressionModel.parse(text) for text in texts]
    return {model.coefficient: model.terms for model in models}


def attached_database(
    project: Project, database: xr.DataTree, records: Sequence[xr.Dataset]
) -> xr.DataTree:
    """Return a database whose tables go on linearly where ``stall.attached_to`` states it.

    They reach 10 deg beyond the largest angle of attack of the records of the stalls.
    """
    if project.stall is None or not project.stall.attached_to:
        return database
    last = parse_quantity(project.stall.attached_to, "rad")
    return continue_attached_flow(database, last, reach_of(records))


def with_separation(aircraft: Aircraft, found: Any) -> Aircraft:
    """Return an aircraft with the identified separation; its tables of the buffet stay."""
    tables = aircraft.stall.tables if aircraft.stall else {}
    buffet = {name: leaf for name, leaf in tables.items() if name.startswith("buffet")}
    return replace(aircraft, stall=found.separation(buffet))


def terms_near_ground(project: Project, database: xr.DataTree) -> xr.DataTree:
    """Return the terms of a database that the identification of the ground effect uses.

    These are the terms of its coefficients, and of all coefficients that they depend on.
    """
    leaves = aerodb.terms(database)
    axes = str(database.attrs["force_axes"])
    models: Sequence[str] = ()
    if project.ground_effect is not None:
        models = project.ground_effect.models
    required = {flighttest.RegressionModel.parse(text).coefficient for text in models}
    # A term may depend on further coefficients, whose terms may depend on others.
    new = required
    while new:
        dependencies: set[str] = set()
        for name, leaf in leaves.items():
            if name.split("/")[0] in new:
                dependencies.update(required_coefficients(leaf, axes))
        new = dependencies - required
        required = required | new
    terms = {name: leaf for name, leaf in leaves.items() if name.split("/")[0] in required}
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs={"force_axes": axes}), **terms})


def identified_gear(
    project: Project,
    aircraft: Aircraft,
    paths: Mapping[str, Any],
    spans: Mapping[str, Spans],
    database: xr.DataTree,
) -> Any:
    """Return the landing gear of the ground runs, or None without a section ``[gear]``.

    Parameters
    ----------
    project : Project
    aircraft : Aircraft
    paths : mapping of str to Path
        Reconstructions by record.
    spans : mapping of str to dict
        By position in the project file.
    database : DataTree
        Gives the aerodynamic forces near the ground.
    """
    section = project.gear
    if section is None:
        return None
    records = []
    for record, record_spans in spans["gear.flown"].items():
        path = paths[record]
        for part in select_spans(path.states, record_spans):
            records.append(GroundRecord(part, path.biases))
    return identify_landing_gear(
        records, aircraft, database, section.errors, flown=section.output_error
    )

"""Predicted flights of a catalogue, with the processing of real flights.

Every condition becomes one predicted flight record with all its manoeuvres.  The records have the
reconstruction of a programme, so that the fits contain the errors of the instruments.  A local fit
of any choice of manoeuvres is then the observation theta = H g + D s + e of the identification.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.edit.term_edits import replace_terms
from aerodb.store.schema import terms
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import (
    AeromatchError,
    IdentificationError,
    OutOfRange,
    SchemaError,
    UnknownName,
)
from flightmech.short_text import ShortText
from flightmech.simulation.compiler import SimModel
from flighttest.flight_programme.input_design.design import surface_limits
from flighttest.flight_programme.input_design.predicted_response import (
    amplitude_within,
    each_within,
    first_exceeded_limit,
    scale_signal,
    trimmed_start,
)
from flighttest.flight_programme.planning.catalogue import (
    NEAR_GROUND,
    Catalogue,
    PlannedCondition,
    PlannedFit,
    PlannedManoeuvre,
)
from flighttest.flight_programme.planning.pilot import (
    BEFORE,
    BEHIND,
    PredictedFlight,
    fly_manoeuvres,
)
from flighttest.flight_programme.planning.predicted_record import predicted_record
from flighttest.reconstruction.dynamics.force_coefficients import coefficients, select_time
from flighttest.reconstruction.flight_programme import reconstruct_programme
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress

# Shares of the amplitude that are tried for a manoeuvre without a test input.
_PARTS = (1.0, 0.85, 0.7, 0.55, 0.4)

Item = tuple[str, str]
"""Condition and manoeuvre, by name."""


@dataclass(frozen=True)
class Candidate:
    """A manoeuvre at a condition.

    Attributes
    ----------
    item : (str, str)
        Condition and manoeuvre.
    manoeuvre : Manoeuvre
        The manoeuvre; without a test input its amplitude is scaled to the limits.
    time : float
        Time of the manoeuvre with its recovery or `setup`, whichever is longer. [s]
    fuel : float
        Fuel in this time; NaN if the model has no fuel flow. [kg]
    signal : Dataset or None
        The test input, scaled to the limits.
    extremes : dict of str to (float, float)
        Lowest and highest value of the limited outputs. [SI]
    binding : str
        Description of the limit that a larger amplitude exceeds.
    """

    item: Item
    manoeuvre: PlannedManoeuvre
    time: float
    fuel: float
    signal: xr.Dataset | None
    extremes: dict[str, tuple[float, float]]
    binding: str


@dataclass
class Prediction(ShortText):
    """The predicted flights of a catalogue.

    Attributes
    ----------
    catalogue : Catalogue
    candidates : dict of (str, str) to Candidate
        Manoeuvres inside the limits.
    refused : dict of (str, str) to str
        Reason for each manoeuvre that cannot be flown.
    data : dict of str to Dataset (time,)
        Coefficients along each condition, as `flighttest.coefficients` returns them.
    marks : dict of str to DataFrame
        Manoeuvres of each condition, as of a flight record.
    trims : dict of str to dict
        Steady flight of each condition: parameters and inputs. [SI]
    span : float
        Unit of the heights of low passes and landings. [m]
    """

    catalogue: Catalogue
    candidates: dict[Item, Candidate]
    refused: dict[Item, str]
    data: dict[str, xr.Dataset]
    marks: dict[str, pd.DataFrame]
    trims: dict[str, dict[str, float]]
    span: float = 0.0
    _fits: dict[Any, list[Any]] = field(default_factory=dict, repr=False)

    def fits(self, items: Sequence[Item]) -> list[Any]:
        """Return the fits of a choice of manoeuvres.

        A model that the manoeuvres do not determine is omitted.

        Parameters
        ----------
        items : sequence of (str, str)

        Returns
        -------
        list of Fit
            One per condition, fit of the catalogue and model.  The fits of a combination of
            manoeuvres are computed once.
        """
        fits: list[Any] = []
        for condition in self.data:
            chosen = {manoeuvre for name, manoeuvre in items if name == condition}
            for fit in self.catalogue.fit:
                used = tuple(name for name in fit.manoeuvres if name in chosen)
                if used and (not fit.conditions or condition in fit.conditions):
                    fits += self._fits_of(condition, fit, used)
        return fits

    def _fits_of(self, condition: str, fit: PlannedFit, used: tuple[str, ...]) -> list[Any]:
        key = condition, fit.name, used
        if key not in self._fits:
            marks = self.marks[condition]
            marks = marks[marks["manoeuvre"].isin(used)]
            spans = zip(marks["start"].astype(float), marks["end"].astype(float), strict=True)
            parts = [select_time(self.data[condition], *span) for span in spans]
            self._fits[key] = fit_models(fit, parts, name=f"{condition}: {fit.name}")
        return self._fits[key]


def fit_models(fit: PlannedFit, parts: list[xr.Dataset], *, name: str) -> list[Any]:
    """Return the models of a fit that manoeuvres determine."""
    fits = [fit_model(text, parts, name) for text in fit.models]
    return [result for result in fits if result is not None]


def fit_model(text: str, parts: list[xr.Dataset], name: str) -> Any:
    """Return the fit of a model to manoeuvres, or None if they do not determine it."""
    try:
        return regress(RegressionModel.parse(text), parts, name=name)
    except IdentificationError:
        return None


def with_assumed(database: xr.DataTree, catalogue: Catalogue) -> xr.DataTree:
    """Return the database with the values that a catalogue assumes for the prediction.

    An assumed term has its value at all nodes. A term that the flights identify is often zero in
    the database, but an aircraft without rudder power cannot have a sideslip.

    Raises
    ------
    SchemaError
        The database does not have an assumed term.
    """
    leaves = terms(database)
    unknown, changed = [], {}
    for name, value in catalogue.assumed.items():
        if name in leaves:
            changed[name] = leaves[name].assign(value=xr.full_like(leaves[name]["value"], value))
        else:
            unknown.append(f"assumed: {UnknownName(name, leaves, 'term')}")
    if unknown:
        raise SchemaError("catalogue", unknown)
    return replace_terms(database, changed)


def predict(
    catalogue: Catalogue,
    sim: SimModel,
    aircraft: Aircraft,
    jobs: int = 1,
    only: Sequence[Item] | None = None,
) -> Prediction:
    """Return the predicted flights of a catalogue, one record per condition.

    Parameters
    ----------
    catalogue : Catalogue
    sim : SimModel
        The a-priori model: aircraft and prior database, with the terms that the catalogue assumes
        (`with_assumed`).
    aircraft : Aircraft
        Aircraft with instruments, limits of surfaces, mass and lengths.
    jobs : int
        Processes for the reconstruction.
    only : sequence of (str, str), optional
        Condition and manoeuvre of the flights to predict; all by default.

    Returns
    -------
    Prediction

    Raises
    ------
    SchemaError
        No manoeuvre can be flown, with the reason for each; or a reconstruction is not possible
        with the instruments.
    """
    prediction = Prediction(catalogue, {}, {}, data={}, marks={}, trims={}, span=aircraft.b)
    model = _PredictionModel(sim, aircraft)
    records = {}
    for number, condition in enumerate(catalogue.condition):
        manoeuvres = []
        for allowed, manoeuvre in catalogue.flyable():
            is_requested = only is None or (condition.name, manoeuvre.name) in only
            if allowed.name == condition.name and is_requested:
                manoeuvres.append(manoeuvre)
        flight = _fly_condition(prediction, condition, manoeuvres, model=model)
        if flight is not None:
            prediction.marks[condition.name] = pd.DataFrame(flight.marks)
            records[condition.name] = predicted_record(
                flight,
                aircraft,
                title=condition.name,
                rates=catalogue.rates,
                seed=catalogue.seed + number,
            )
    if not records:
        problems = [f"{c}, {m}: {why}" for (c, m), why in prediction.refused.items()]
        raise SchemaError("flight programme", problems)
    paths = reconstruct_programme(list(records.values()), aircraft, jobs=jobs)
    for name, path in zip(records, paths, strict=True):
        prediction.data[name] = coefficients(
            path, aircraft, catalogue.errors or None, catalogue.cutoff
        )
    return prediction


@dataclass(frozen=True)
class _PredictionModel:
    """The a-priori model and its aircraft."""

    sim: SimModel
    aircraft: Aircraft


def _fly_condition(
    prediction: Prediction,
    condition: PlannedCondition,
    manoeuvres: Sequence[PlannedManoeuvre],
    *,
    model: _PredictionModel,
) -> PredictedFlight | None:
    """Return one flight with all manoeuvres of a condition inside the limits, or None.

    Candidates, refused manoeuvres and the trim are added to the prediction.
    """
    if not manoeuvres:
        return None
    try:
        start = trimmed_start(
            model.sim,
            condition.parameters,
            kind=condition.kind,
            fixed=condition.fixed,
            unknowns=condition.unknowns,
        )
    except AeromatchError as error:
        for manoeuvre in manoeuvres:
            prediction.refused[condition.name, manoeuvre.name] = str(error)
        return None
    prediction.trims[condition.name] = dict(start)
    limits = {**prediction.catalogue.limits, **condition.limits}
    margin = prediction.catalogue.margin
    ready = []
    for manoeuvre in manoeuvres:
        item = condition.name, manoeuvre.name
        try:
            signal, binding = _scale_input(model, manoeuvre, start, limits=limits, margin=margin)
            scaled, alone, excess = _scale_manoeuvre(
                model, manoeuvre, signal, start=start, limits=limits
            )
        except AeromatchError as error:
            prediction.refused[item] = str(error)
            continue
        ready.append((scaled, signal))
        prediction.candidates[item] = _make_candidate(
            item, scaled, signal, binding=binding or excess, alone=alone, limits=limits
        )
    if not ready:
        return None
    # a landing ends on the runway, so it is the last one
    ready.sort(key=lambda pair: pair[0].kind == "landing")
    return fly_manoeuvres(model.sim, start, ready, span=model.aircraft.b)


def predict_manoeuvre(
    catalogue: Catalogue, sim: SimModel, aircraft: Aircraft, item: Item
) -> tuple[PredictedFlight, dict[str, float]]:
    """Return the predicted flight of one manoeuvre alone, as large as the limits allow.

    Returns
    -------
    flight : PredictedFlight
    start : dict of str to float
        Parameters and inputs of the trim. [SI]

    Raises
    ------
    AeromatchError
        The manoeuvre leaves its limits.
    """
    pairs = {(condition.name, one.name): (condition, one) for condition, one in catalogue.flyable()}
    condition, manoeuvre = pairs[item]
    model = _PredictionModel(sim, aircraft)
    start = trimmed_start(
        sim,
        condition.parameters,
        kind=condition.kind,
        fixed=condition.fixed,
        unknowns=condition.unknowns,
    )
    limits = {**catalogue.limits, **condition.limits}
    signal, _ = _scale_input(model, manoeuvre, start, limits=limits, margin=catalogue.margin)
    _, flight, _ = _scale_manoeuvre(model, manoeuvre, signal, start=start, limits=limits)
    return flight, dict(start)


def _scale_manoeuvre(
    model: _PredictionModel,
    manoeuvre: PlannedManoeuvre,
    signal: xr.Dataset | None,
    *,
    start: Mapping[str, float],
    limits: Mapping[str, Any],
) -> tuple[PlannedManoeuvre, PredictedFlight, str]:
    """Return the largest manoeuvre inside the limits, its flight, and the limit of a larger one."""
    excess = ""
    # a test input is scaled already, and a device has one amplitude
    parts: Sequence[float] = _PARTS
    if signal is not None or manoeuvre.kind in ("device", "landing"):
        parts = (1.0,)
    for part in parts:
        scaled = manoeuvre.model_copy(update={"amplitude": part * manoeuvre.amplitude})
        flight = fly_manoeuvres(model.sim, start, [(scaled, signal)], span=model.aircraft.b)
        recorded = {name: pair for name, pair in limits.items() if name in flight.motion}
        exceeded = first_exceeded_limit(flight.motion, recorded)
        if not exceeded:
            return scaled, flight, excess
        excess = exceeded
    raise OutOfRange(excess)


def _scale_input(
    model: _PredictionModel,
    manoeuvre: PlannedManoeuvre,
    start: Mapping[str, float],
    *,
    limits: Mapping[str, Any],
    margin: float,
) -> tuple[xr.Dataset | None, str]:
    """Return the largest test input inside the limits, and the limit that a larger one exceeds."""
    if manoeuvre.design is None:
        return None, ""
    sim, signal = model.sim, manoeuvre.design.signal()
    limits = {**surface_limits(sim, model.aircraft, signal), **limits}
    # each axis alone, then all axes together by one factor
    factors = each_within(sim, signal, start, limits=limits, margin=margin)
    signal = scale_signal(signal, factors)
    amplitude = amplitude_within(sim, signal, start, limits=limits, margin=margin)
    factors = dict.fromkeys(manoeuvre.design.axis, amplitude.scale)
    return scale_signal(signal, factors), amplitude.binding


def _make_candidate(
    item: Item,
    manoeuvre: PlannedManoeuvre,
    signal: xr.Dataset | None,
    *,
    binding: str,
    alone: PredictedFlight,
    limits: Mapping[str, Any],
) -> Candidate:
    """Return a manoeuvre with time, fuel and extremes of its flight alone."""
    mark, motion = alone.marks[0], alone.motion
    part = motion.sel(time=slice(mark["start"], mark["end"]))
    time = float(mark["end"] - mark["start"]) + max(manoeuvre.setup, BEHIND)
    if manoeuvre.kind in NEAR_GROUND:
        # with the ways to and from the height
        time = float(motion["time"][-1]) - BEFORE - BEHIND + max(manoeuvre.setup, BEHIND)
    flow = [motion[name].values for name in motion.data_vars if str(name).endswith(".fuel_flow")]
    fuel = np.nan
    if flow:
        # mean flow of all engines over the whole flight
        fuel = time * float(np.sum(flow, axis=0).mean())
    extremes = {}
    for name in limits:
        if name in part:
            extremes[name] = (float(part[name].min()), float(part[name].max()))
    return Candidate(
        item,
        manoeuvre,
        time=time,
        fuel=fuel,
        signal=signal,
        extremes=extremes,
        binding=binding,
    )

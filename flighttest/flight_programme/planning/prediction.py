"""What the manoeuvres of a catalogue would determine: flown on the a-priori model, recorded,
reconstructed and fitted as real ones.

Every condition becomes one predicted flight record with all its manoeuvres.  The records go through
the reconstruction of a programme, so that the fits carry what the instruments leave open, and a
local fit of any choice of manoeuvres is the observation theta = H g + D s + e that the
identification will form.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.edit.table_edits import replace_terms
from aerodb.store.schema import terms
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import (
    AeromatchError,
    IdentificationError,
    OutOfRange,
    SchemaError,
    UnknownName,
)
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
    Catalogue,
    PlannedCondition,
    PlannedFit,
    PlannedManoeuvre,
)
from flighttest.flight_programme.planning.pilot import (
    BEHIND,
    PredictedFlight,
    fly_manoeuvres,
    predicted_record,
)
from flighttest.reconstruction.dynamics.force_coefficients import coefficients, select_time
from flighttest.reconstruction.flight_programme import reconstruct_programme
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress

_PARTS = (
    1.0,
    0.85,
    0.7,
    0.55,
    0.4,
)  # of the amplitude of a manoeuvre without test input that are tried

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
        As flown: the amplitude of one without test input is that which the limits allow.
    time : float
        Of the manoeuvre with its recovery or `setup`, whichever is longer. [s]
    fuel : float
        Burnt meanwhile; NaN where the model has no fuel flow. [kg]
    signal : Dataset or None
        The test input as flown.
    extremes : dict of str to (float, float)
        Lowest and highest value of the limited outputs. [SI]
    binding : str
        The limit that stopped the amplitude, in words.
    """

    item: Item
    manoeuvre: PlannedManoeuvre
    time: float
    fuel: float
    signal: xr.Dataset | None
    extremes: dict[str, tuple[float, float]]
    binding: str


@dataclass
class Prediction:
    """The predicted flights of a catalogue.

    Attributes
    ----------
    catalogue : Catalogue
    candidates : dict of (str, str) to Candidate
        What can be flown.
    refused : dict of (str, str) to str
        What cannot, and why.
    data : dict of str to Dataset (time,)
        Coefficients along each condition, as `flighttest.coefficients` returns them.
    marks : dict of str to DataFrame
        Manoeuvres of each condition, as of a flight record.
    trims : dict of str to dict
        Steady flight of each condition: parameters and inputs. [SI]
    """

    catalogue: Catalogue
    candidates: dict[Item, Candidate]
    refused: dict[Item, str]
    data: dict[str, xr.Dataset]
    marks: dict[str, pd.DataFrame]
    trims: dict[str, dict[str, float]]
    _fits: dict[Any, list[Any]] = field(default_factory=dict, repr=False)

    def fits(self, items: Sequence[Item]) -> list[Any]:
        """Return the fits that a choice of manoeuvres allows; a model that they do not determine is
        left out.

        Parameters
        ----------
        items : sequence of (str, str)

        Returns
        -------
        list of Fit
            One per condition, fit of the catalogue and model, worked out once for every
            combination.
        """
        found: list[Any] = []
        for condition in self.data:
            flown = {manoeuvre for name, manoeuvre in items if name == condition}
            for fit in self.catalogue.fit:
                used = tuple(name for name in fit.manoeuvres if name in flown)
                if used and (not fit.conditions or condition in fit.conditions):
                    found += self._fitted(condition, fit, used)
        return found

    def _fitted(self, condition: str, fit: PlannedFit, used: tuple[str, ...]) -> list[Any]:
        key = condition, fit.name, used
        if key not in self._fits:
            marks = self.marks[condition]
            chosen = marks[marks["manoeuvre"].isin(used)]
            spans = zip(chosen["start"].astype(float), chosen["end"].astype(float), strict=True)
            parts = [select_time(self.data[condition], *span) for span in spans]
            self._fits[key] = [
                one
                for text in fit.models
                if (one := fit_model(text, parts, f"{condition}: {fit.name}")) is not None
            ]
        return self._fits[key]


def fit_model(text: str, parts: list[xr.Dataset], name: str) -> Any:
    """Return the fit of a model to manoeuvres, None where they do not determine it."""
    try:
        return regress(RegressionModel.parse(text), parts, name=name)
    except IdentificationError:
        return None


def with_assumed(database: xr.DataTree, catalogue: Catalogue) -> xr.DataTree:
    """Return the database whose terms have the values that a catalogue assumes for the prediction,
    at all nodes.

    A term that the flights shall find starts from zero; a rudder without effect would fly no
    sideslip.

    Raises
    ------
    SchemaError
        Terms that the database does not have.
    """

    leaves = terms(database)
    if unknown := [
        f"assumed: {UnknownName(name, leaves, 'term')}"
        for name in catalogue.assumed
        if name not in leaves
    ]:
        raise SchemaError("catalogue", unknown)
    return replace_terms(
        database,
        {
            name: leaves[name].assign(value=xr.full_like(leaves[name]["value"], x))
            for name, x in catalogue.assumed.items()
        },
    )


def predict(
    catalogue: Catalogue,
    sim: SimModel,
    aircraft: Aircraft,
    jobs: int = 1,
    only: Sequence[Item] | None = None,
) -> Prediction:
    """Return the predicted flights of all manoeuvres of a catalogue, each condition one record.

    Parameters
    ----------
    catalogue : Catalogue
    sim : SimModel
        The a-priori model: aircraft and prior database, with the terms that the catalogue assumes
        (`with_assumed`).
    aircraft : Aircraft
        For instruments, limits of surfaces, mass and lengths.
    jobs : int
        Processes for the reconstruction.
    only : sequence of (str, str), optional
        Condition and manoeuvre of those that are flown; all without it.

    Returns
    -------
    Prediction

    Raises
    ------
    SchemaError
        No manoeuvre can be flown, with the reason for each; instruments that a reconstruction
        cannot work with.
    """

    candidates: dict[Item, Candidate] = {}
    refused: dict[Item, str] = {}
    records, marks = {}, {}
    trims: dict[str, dict[str, float]] = {}
    for number, condition in enumerate(catalogue.condition):
        wanted = [
            m
            for c, m in catalogue.flyable()
            if c.name == condition.name and (only is None or (c.name, m.name) in only)
        ]
        if not wanted:
            continue
        flown = _condition(catalogue, condition, wanted, sim, aircraft, candidates, refused, trims)
        if flown is not None:
            marks[condition.name] = pd.DataFrame(flown.marks)
            records[condition.name] = predicted_record(
                flown, aircraft, condition.name, catalogue.rates, catalogue.seed + number
            )
    if not records:
        raise SchemaError(
            "flight programme", [f"{c}, {m}: {why}" for (c, m), why in refused.items()]
        )
    paths = reconstruct_programme(list(records.values()), aircraft, jobs=jobs)
    data = {
        name: coefficients(path, aircraft, catalogue.errors or None, catalogue.cutoff)
        for name, path in zip(records, paths, strict=True)
    }
    return Prediction(catalogue, candidates, refused, data, marks, trims)


def _condition(
    catalogue: Catalogue,
    condition: PlannedCondition,
    wanted: Sequence[PlannedManoeuvre],
    sim: SimModel,
    aircraft: Aircraft,
    candidates: dict[Item, Candidate],
    refused: dict[Item, str],
    trims: dict[str, dict[str, float]],
) -> PredictedFlight | None:
    """Fly all manoeuvres of a condition that can be flown, one after the other; None for none."""
    try:
        start = trimmed_start(
            sim, condition.parameters, condition.kind, condition.fixed, condition.unknowns
        )
    except AeromatchError as error:
        refused.update({(condition.name, m.name): str(error) for m in wanted})
        return None
    trims[condition.name] = dict(start)
    limits = {**catalogue.limits, **condition.limits}
    ready = []
    for manoeuvre in wanted:
        item = condition.name, manoeuvre.name
        try:
            signal, binding = _fitted_signal(catalogue, manoeuvre, sim, aircraft, start, limits)
            manoeuvre, alone, stopped = _within(sim, start, manoeuvre, signal, limits)
        except AeromatchError as error:
            refused[item] = str(error)
            continue
        ready.append((manoeuvre, signal))
        candidates[item] = _candidate(item, manoeuvre, signal, binding or stopped, alone, limits)
    return fly_manoeuvres(sim, start, ready) if ready else None


def _within(
    sim: SimModel,
    start: Mapping[str, float],
    manoeuvre: PlannedManoeuvre,
    signal: xr.Dataset | None,
    limits: Mapping[str, Any],
) -> tuple[PlannedManoeuvre, PredictedFlight, str]:
    """Return a manoeuvre as large as the limits allow, its flight, and the limit that a larger one
    breaks.
    """
    stopped = ""
    for part in _PARTS if signal is None and manoeuvre.kind != "device" else (1.0,):
        smaller = manoeuvre.model_copy(update={"amplitude": part * manoeuvre.amplitude})
        flown = fly_manoeuvres(sim, start, [(smaller, signal)])
        broken = first_exceeded_limit(
            flown.motion, {name: pair for name, pair in limits.items() if name in flown.motion}
        )
        if not broken:
            return smaller, flown, stopped
        stopped = broken
    raise OutOfRange(stopped)


def _fitted_signal(
    catalogue: Catalogue,
    manoeuvre: PlannedManoeuvre,
    sim: SimModel,
    aircraft: Aircraft,
    start: Mapping[str, float],
    limits: Mapping[str, Any],
) -> tuple[xr.Dataset | None, str]:
    """Return a test input, as large as the limits allow, and the limit that stopped it."""
    if manoeuvre.design is None:
        return None, ""
    signal = manoeuvre.design.signal()
    allowed = {**surface_limits(sim, aircraft, signal), **limits}
    signal = scale_signal(signal, each_within(sim, signal, start, allowed, catalogue.margin))
    amplitude = amplitude_within(sim, signal, start, allowed, margin=catalogue.margin)
    return scale_signal(
        signal, dict.fromkeys(manoeuvre.design.axis, amplitude.scale)
    ), amplitude.binding


def _candidate(
    item: Item,
    manoeuvre: PlannedManoeuvre,
    signal: xr.Dataset | None,
    binding: str,
    alone: PredictedFlight,
    limits,
) -> Candidate:
    mark, motion = alone.marks[0], alone.motion
    part = motion.sel(time=slice(mark["start"], mark["end"]))
    length = float(mark["end"] - mark["start"])
    time = length + max(manoeuvre.setup, BEHIND)
    flow = [motion[name].values for name in motion.data_vars if str(name).endswith(".fuel_flow")]
    fuel = time * float(np.sum(flow, axis=0).mean()) if flow else np.nan
    extremes = {
        name: (float(part[name].min()), float(part[name].max())) for name in limits if name in part
    }
    return Candidate(item, manoeuvre, time, fuel, signal, extremes, binding)

"""Whether the samples of a record can determine what a fit or a submodel takes from it, as far as
recorded channels show.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from aeromatch.planning.steps import run_collecting_problems
from aeromatch.project.project import FitSection
from aeromatch.workflow.submodels import select_spans, thin_samples
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchError
from flightmech.names import lookup
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.model import RegressionModel, term_powers, variable_of
from flighttest.regression.equation_error.time_domain import LEAST_MOVEMENT, SAMPLES_PER_TERM
from flighttest.submodels.control_loading.loading import loading_of
from flighttest.submodels.control_loading.motion import loading_channels
from flighttest.submodels.engine.records import engine_channels
from flighttest.submodels.engine.schedule import remove_lever_noise
from flighttest.submodels.landing_gear.reconstructed_loads import TOUCHING
from flighttest.submodels.landing_gear.wheel_positions import wheels_of

# of the least movement: readings before the reconstruction move a little more or less than after it
_CERTAIN = 0.5
_RUNNING = (
    "phi",
    "theta",
    "psi",
    "p",
    "q",
    "r",
    "vn",
    "ve",
    "vd",
)  # states that the loads of the wheels need

Spans = Sequence[tuple[float, float]]


def fit_problems(where: str, fit: FitSection, states: xr.Dataset, spans: Spans) -> list[str]:
    """Return why a fit cannot be made of some windows of a record: too few samples, inputs that do
    not move.

    Parameters
    ----------
    where : str
        Fit and record, for the texts.
    fit : Fit
    states : Dataset (time,)
        `flighttest.reconstruction.start_states`. [SI]
    spans : sequence of (float, float)
        [s]
    """
    if not spans:
        return []
    chosen = _inside(states["time"].values, spans)
    count = int(chosen.size - _on_wheels(states)[chosen].sum())
    found = []
    for text in fit.models:
        model = RegressionModel.parse(text)
        least = SAMPLES_PER_TERM * len(model.terms)
        if count < least:
            found.append(
                f"{where}: {count} samples in flight for {len(model.terms)} terms of "
                f"{model}; at least {least} are needed"
            )
        else:
            found += [
                f"{where}: {model}: {term} does not move; leave it out, or add a manoeuvre"
                for term in _resting(model, states, chosen)
            ]
    return found


def _inside(time: np.ndarray, spans: Spans) -> np.ndarray:
    """Return the places of the samples in some windows, as `flighttest.between` takes them, one
    window after the other.
    """
    step = float(np.median(np.diff(time)))
    ends = [np.searchsorted(time, (start, stop - 0.5 * step)) for start, stop in spans]
    return np.concatenate([np.arange(first, behind) for first, behind in ends])


def _on_wheels(states: xr.Dataset) -> np.ndarray:
    """Return whether a wheel is on the ground, (time,)."""
    wheels = [name for name in map(str, states.data_vars) if name.startswith("wow_")]
    return (
        np.any([states.variables[name].values > 0.5 for name in wheels], axis=0)
        if wheels
        else np.zeros(states.sizes["time"], bool)
    )


def _resting(model: RegressionModel, states: xr.Dataset, chosen: np.ndarray) -> list[str]:
    """Return the terms of single recorded variables that do not move, next to a constant, by the
    rule of `flighttest.regress`.
    """
    if not least_squares.intercept_mask(model.terms).any():
        return []
    found = []
    for term in model.terms:
        factors = term_powers(term) if term != "1" else {}
        name = variable_of(next(iter(factors))) if list(factors.values()) == [1] else ""
        if name not in states:
            continue
        alone = RegressionModel(model.coefficient, [term])
        column = alone.design({name: states.variables[name].values[chosen]})[:, 0]
        least = _CERTAIN * LEAST_MOVEMENT.get(lookup(name).units, 0.0)
        if np.ptp(column) == 0.0 or np.std(column) < least:
            found.append(term)
    return found


def submodel_problems(
    where: str, place: str, asked: Any, aircraft: Aircraft, states: xr.Dataset, spans: Spans
) -> list[str]:
    """Return why a record cannot identify a submodel.

    Parameters
    ----------
    where : str
        Place and record, for the texts.
    place : str
        Place in the project file: ``engine.flown``, ``controls.column.free`` ...
    asked : Engine, Control, Gear or GroundEffect
        The section of the project file.
    aircraft : Aircraft
    states : Dataset (time,)
        `flighttest.reconstruction.start_states`. [SI]
    spans : sequence of (float, float)
        Windows that are taken. [s]
    """
    section = place.split(".")[0]
    if section == "ground_effect":
        return []  # its variables are those of the coefficients
    time = states["time"].values
    empty = sum(int(np.count_nonzero((time >= start) & (time <= end)) < 2) for start, end in spans)
    found = [f"{where}: {empty} windows without a sample; choose others"] if empty else []
    if section == "controls":
        return found + _control_problems(where, place.split(".")[1], asked, aircraft, states)
    parts = [part for part in select_spans(states, spans) if part.sizes["time"] > 1]
    if section == "engine":
        return found + _engine_problems(where, place, asked, parts)
    return found + _gear_problems(where, aircraft, parts)


def _engine_problems(where: str, place: str, asked: Any, parts: Sequence[xr.Dataset]) -> list[str]:
    found: list[str] = []
    for part in parts:
        record = run_collecting_problems(
            found, where, engine_channels, part, asked.engines, asked.pla
        )
        if record is None:
            continue
        if place != "engine.starts" and "throttle" not in record:
            found.append(
                f"{where}: no lever of engine {asked.engines[0]} "
                f"(engine{asked.engines[0]}.throttle or .pla); map its channel"
            )
        elif place == "engine.flown":
            try:
                remove_lever_noise(thin_samples(record, asked.rate))
            except AeromatchError as error:
                found.append(f"{where}: {error}")
    return list(dict.fromkeys(found))


def _control_problems(
    where: str, item: str, asked: Any, aircraft: Aircraft, states: xr.Dataset
) -> list[str]:
    try:
        needed = loading_channels(
            loading_of(aircraft, item, asked.model, asked.constants, asked.arm)
        )
    except AeromatchError:
        return []  # reported once, without a record
    have = {*map(str, states.data_vars)} | ({"wow"} if "wow_nose" in states else set())
    return [
        f"{where}: the {item} needs {name}, which the record does not hold; map its channel"
        for name in needed
        if name not in have
    ]


def _gear_problems(where: str, aircraft: Aircraft, parts: Sequence[xr.Dataset]) -> list[str]:
    try:
        wheels = [f"gear.{wheel.name}.compression" for wheel in wheels_of(aircraft)]
    except AeromatchError:
        return []  # reported once, without a record
    found = []
    for part in parts:
        absent = [name for name in (*wheels, *_RUNNING) if name not in part]
        found += [
            f"{where}: the landing gear needs {name}, which the record does not hold; map "
            f"its channel"
            for name in absent
        ]
        if not absent and not any((part[name].values > TOUCHING).any() for name in wheels):
            found.append(
                f"{where}: no wheel is compressed by more than {TOUCHING:g} m; give ground "
                f"runs or landings"
            )
    return list(dict.fromkeys(found))

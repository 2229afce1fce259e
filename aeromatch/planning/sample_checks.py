"""Checks of the samples of a record: whether they can determine a fit or a submodel.

Only recorded channels are used, because the states are not reconstructed yet.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aeromatch.planning.steps import run_collecting_problems
from aeromatch.project.model_sections import FitSection
from aeromatch.workflow.submodels import thin_samples
from aeromatch.workflow.windows import AERODYNAMIC, select_spans
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchError
from flightmech.names import lookup
from flightmech.quantities import time_text
from flightmech.units import DEGREE
from flighttest.flight_programme.manoeuvre_finding.finding import LEAST_SURFACE, SURFACES
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.model import RegressionModel, term_powers, variable_of
from flighttest.regression.equation_error.movement import ranges_in_spans
from flighttest.regression.equation_error.problem import LEAST_MOVEMENT, SAMPLES_PER_TERM
from flighttest.submodels.control_loading.loading import loading_of
from flighttest.submodels.control_loading.motion import loading_channels
from flighttest.submodels.engine.records import engine_channels
from flighttest.submodels.engine.schedule import remove_lever_noise
from flighttest.submodels.landing_gear.reconstructed_loads import TOUCHING
from flighttest.submodels.landing_gear.wheel_positions import wheels_of

# Fraction of the least movement of `flighttest.regress`. Readings before the reconstruction move a
# little more or less than after it, so only a clear standstill is a problem.
_CERTAIN = 0.5
# States that the loads of the wheels require.
_RUNNING = ("phi", "theta", "psi", "p", "q", "r", "vn", "ve", "vd")

Spans = Sequence[tuple[float, float]]
_INPUTS = ("3211", "doublet", "pulse", "block", "sweep", "multisine")
"""Manoeuvres in which the named control moves; in others it may hold a state, or be at rest."""


def manoeuvre_problems(record: str, table: pd.DataFrame, states: xr.Dataset) -> list[str]:
    """Return the rows of manoeuvres in which the named control does not move.

    Parameters
    ----------
    record : str
    table : DataFrame
        Manoeuvres of the record: ``manoeuvre control start end``. [s]
    states : Dataset (time,)
        With the surfaces that the record has. [SI]
    """
    time = states["time"].values
    surfaces = {}
    for name, control in SURFACES.items():
        if name in states:
            surfaces[control] = states.variables[name].values
    problems = []
    rows = [row for row in table.to_dict("records") if row["manoeuvre"] in _INPUTS]
    spans = [(row["start"], row["end"]) for row in rows]
    for row, moved in zip(rows, ranges_in_spans(time, surfaces, spans), strict=True):
        if not ((time >= row["start"]) & (time <= row["end"])).any():
            continue
        for control in str(row["control"]).split():
            if control not in moved or not moved[control] < LEAST_SURFACE:
                continue
            sizes = [f"{name} {size / DEGREE:.2g} deg" for name, size in moved.items()]
            problems.append(
                f"manoeuvres: record {record}: {row['manoeuvre']} {control} from "
                f"{time_text(row['start'])} "
                f"to {time_text(row['end'])} s, where the {control} does not move "
                f"({', '.join(sizes)}); "
                f"correct its times or its control"
            )
    return problems


def fit_problems(where: str, fit: FitSection, states: xr.Dataset, spans: Spans) -> list[str]:
    """Return the reasons why windows of a record cannot determine a fit.

    The reasons are too few samples, and inputs that do not move.

    Parameters
    ----------
    where : str
        Fit and record, for the texts.
    fit : FitSection
    states : Dataset (time,)
        `flighttest.reconstruction.start_states`. [SI]
    spans : sequence of (float, float)
        [s]
    """
    if not spans:
        return []
    samples = sample_indices(states["time"].values, spans)
    count = int(samples.size - _on_wheels(states)[samples].sum())
    problems: list[str] = []
    for text in fit.models:
        model = RegressionModel.parse(text)
        minimum = SAMPLES_PER_TERM * len(model.terms)
        if count < minimum:
            problems.append(
                f"{where}: {count} samples in flight for {len(model.terms)} terms of "
                f"{model}; at least {minimum} are needed"
            )
            continue
        for term in _resting_terms(model, states, samples):
            problems.append(
                f"{where}: {model}: {term} does not move; leave it out, or add a manoeuvre"
            )
    return problems


def sample_indices(time: np.ndarray, spans: Spans) -> np.ndarray:
    """Return the indices of the samples in windows, one window after the other.

    The bounds are the bounds of `flighttest.select_time`.
    """
    step = float(np.median(np.diff(time)))
    indices = []
    for start, stop in spans:
        # The sample at the end of a window belongs to the next window.
        first, behind = np.searchsorted(time, (start, stop - 0.5 * step))
        indices.append(np.arange(first, behind))
    # a fit whose manoeuvres are of no known record has no window
    return np.concatenate([np.zeros(0, int), *indices])


def _on_wheels(states: xr.Dataset) -> np.ndarray:
    """Return whether a wheel is on the ground, (time,)."""
    wheels = [name for name in map(str, states.data_vars) if name.startswith("wow_")]
    if not wheels:
        return np.zeros(states.sizes["time"], bool)
    return np.any([states.variables[name].values > 0.5 for name in wheels], axis=0)


def _resting_terms(model: RegressionModel, states: xr.Dataset, samples: np.ndarray) -> list[str]:
    """Return the terms of one recorded variable that do not move, by the rule of `regress`.

    A model without a constant has no such term.
    """
    if not least_squares.intercept_mask(model.terms).any():
        return []
    resting = []
    for term in model.terms:
        # Only a single variable to the power of 1 is compared with its least movement.
        factors = term_powers(term) if term != "1" else {}
        if list(factors.values()) != [1]:
            continue
        name = variable_of(next(iter(factors)))
        if name not in states:
            continue
        if name in str(states.attrs.get("unknown", "")).split():
            continue
        single = RegressionModel(model.coefficient, [term])
        column = single.design({name: states.variables[name].values[samples]})[:, 0]
        least = _CERTAIN * LEAST_MOVEMENT.get(lookup(name).units, 0.0)
        if np.ptp(column) == 0.0 or np.std(column) < least:
            resting.append(term)
    return resting


def submodel_problems(
    where: str, position: str, section: Any, aircraft: Aircraft, states: xr.Dataset, spans: Spans
) -> list[str]:
    """Return the reasons why a record cannot identify a submodel.

    Parameters
    ----------
    where : str
        Position and record, for the texts.
    position : str
        Position in the project file: ``engine.flown``, ``controls.column.free`` ...
    section : EngineSection, ControlSection, GearSection or GroundEffectSection
        The section of the project file.
    aircraft : Aircraft
    states : Dataset (time,)
        `flighttest.reconstruction.start_states`. [SI]
    spans : sequence of (float, float)
        Windows. [s]
    """
    kind = position.split(".")[0]
    # The variables of these are checked with the variables of the coefficients.
    if kind in AERODYNAMIC:
        return []
    time = states["time"].values
    empty = 0
    for start, end in spans:
        if np.count_nonzero((time >= start) & (time <= end)) < 2:
            empty += 1
    problems: list[str] = []
    if empty:
        problems.append(f"{where}: {empty} windows without a sample; choose others")
    if kind == "controls":
        control = position.split(".")[1]
        return problems + _control_problems(
            where, control, section=section, aircraft=aircraft, states=states
        )
    parts = [part for part in select_spans(states, spans) if part.sizes["time"] > 1]
    if kind == "engine":
        return problems + _engine_problems(where, position, section=section, parts=parts)
    return problems + _gear_problems(where, aircraft, parts)


def _engine_problems(
    where: str, position: str, section: Any, parts: Sequence[xr.Dataset]
) -> list[str]:
    problems: list[str] = []
    for part in parts:
        read_channels = partial(engine_channels, part, section.engines, section.pla)
        record = run_collecting_problems(problems, where, read_channels)
        if record is None:
            continue
        if position != "engine.starts" and "throttle" not in record:
            engine = f"engine{section.engines[0]}"
            problems.append(
                f"{where}: no lever of engine {section.engines[0]} "
                f"({engine}.throttle or .pla); map its channel"
            )
        elif position == "engine.flown":
            try:
                remove_lever_noise(thin_samples(record, section.rate))
            except AeromatchError as error:
                problems.append(f"{where}: {error}")
    return list(dict.fromkeys(problems))


def _control_problems(
    where: str, control: str, section: Any, aircraft: Aircraft, states: xr.Dataset
) -> list[str]:
    try:
        loading = loading_of(aircraft, control, section.model, section.constants, section.arm)
        required = loading_channels(loading)
    except AeromatchError:
        # The check of the submodels reports this error once, without a record.
        return []
    available = {str(name) for name in states.data_vars}
    if "wow_nose" in available:
        # The identification uses the switch of the nose wheel under this name.
        available.add("wow")
    problems = []
    for name in required:
        if name not in available:
            problems.append(
                f"{where}: the {control} needs {name}, which the record does not hold; map its "
                f"channel"
            )
    return problems


def _gear_problems(where: str, aircraft: Aircraft, parts: Sequence[xr.Dataset]) -> list[str]:
    try:
        wheels = [f"gear.{wheel.name}.compression" for wheel in wheels_of(aircraft)]
    except AeromatchError:
        # The check of the submodels reports this error once, without a record.
        return []
    problems: list[str] = []
    for part in parts:
        absent = [name for name in (*wheels, *_RUNNING) if name not in part]
        for name in absent:
            problems.append(
                f"{where}: the landing gear needs {name}, which the record does not hold; map "
                f"its channel"
            )
        if not absent and not any((part[name].values > TOUCHING).any() for name in wheels):
            problems.append(
                f"{where}: no wheel is compressed by more than {TOUCHING:g} m; give ground "
                f"runs or landings"
            )
    return list(dict.fromkeys(problems))

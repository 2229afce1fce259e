"""Whether the samples of a record can determine what a fit or a submodel takes from it, as far as recorded channels show."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

import flighttest
from flightmech import Aircraft
from flightmech.errors import AeromatchError
from flightmech.names import lookup
from flighttest import Model
from flighttest.control_loading.loading import loading_of
from flighttest.control_loading.motion import channels
from flighttest.engine import engine_channels
from flighttest.engine.schedule import quiet
from flighttest.equation_error import least_squares
from flighttest.equation_error.model import powers, variable_of
from flighttest.equation_error.time_domain import LEAST_MOVEMENT, SAMPLES_PER_TERM
from flighttest.landing_gear.reconstructed_loads import TOUCHING
from flighttest.landing_gear.wheels import wheels_of

from ..project import Fit, Project
from ..submodels import between, thinned
from .collecting import collect

_PART = 150  # samples from which the names of the coefficients are found
_CERTAIN = 0.5  # of the least movement: readings before the reconstruction move a little more or less than after it
_RUNNING = ("phi", "theta", "psi", "p", "q", "r", "vn", "ve", "vd")  # states that the loads of the wheels need

Spans = Sequence[tuple[float, float]]


def coefficient_names(states: xr.Dataset, aircraft: Aircraft, project: Project) -> set[str]:
    """Return the variables that `flighttest.coefficients` gives of these states.

    Raises
    ------
    UnknownName
        A state that it needs is missing, such as the thrust of an engine.
    OutOfRange
        The low-pass of the project is too fast for the samples.
    """
    part = states.isel(time=slice(0, _PART))
    # the start of a record may be a standstill, where coefficients have no value
    with np.errstate(all="ignore"):
        return set(map(str, flighttest.coefficients(part, aircraft, project.errors, project.cutoff).data_vars))


def fit_problems(where: str, fit: Fit, states: xr.Dataset, spans: Spans, names: set[str]) -> list[str]:
    """Return why a fit cannot be made of some windows of a record: missing variables, too few samples, inputs that rest.

    Parameters
    ----------
    where : str
        Fit and record, for the texts.
    fit : Fit
    states : Dataset (time,)
        `flighttest.reconstruction.start_states`. [SI]
    spans : sequence of (float, float)
        [s]
    names : set of str
        `coefficient_names`; empty if it is not known.
    """
    if not spans or not names:
        return []
    parts = [flighttest.between(states, *span) for span in spans]
    data = xr.concat(parts, "time", data_vars="all", combine_attrs="override") if len(parts) > 1 else parts[0]
    count = _airborne(data)
    found = []
    for text in fit.models:
        model = Model.parse(text)
        absent = [name for name in (model.coefficient, *model.variables) if name not in names]
        found += [f"{where}: {model} needs {name}, which the record does not hold; map the channel, or leave the term out" for name in absent]
        if count < SAMPLES_PER_TERM * len(model.terms):
            least = SAMPLES_PER_TERM * len(model.terms)
            found.append(f"{where}: {count} samples in flight for {len(model.terms)} terms of {model}; at least {least} are needed")
        elif not absent:
            found += [f"{where}: {model}: {term} does not move; leave it out, or add a manoeuvre" for term in _resting(model, data)]
    return found


def _airborne(data: xr.Dataset) -> int:
    """Return the number of samples without a wheel on the ground."""
    down = [np.asarray(data[name].values) > 0.5 for name in map(str, data.data_vars) if name.startswith("wow_")]
    return int(data.sizes["time"] - (np.any(down, axis=0).sum() if down else 0))


def _resting(model: Model, data: xr.Dataset) -> list[str]:
    """Return the terms of single recorded variables that do not move, next to a constant, by the rule of `flighttest.regress`."""
    if not least_squares.constants(model.terms).any():
        return []
    found = []
    for term in model.terms:
        factors = powers(term) if term != "1" else {}
        if list(factors.values()) != [1]:
            continue
        name = variable_of(next(iter(factors)))
        if name not in data:
            continue
        column = model.design({name: np.asarray(data[name].values, float)} | _others(model, data))[:, model.terms.index(term)]
        least = _CERTAIN * LEAST_MOVEMENT.get(lookup(name).units, 0.0)
        if np.ptp(column) == 0.0 or np.std(column) < least:
            found.append(term)
    return found


def _others(model: Model, data: xr.Dataset) -> dict[str, np.ndarray]:
    """Return the variables of a model; zeros for those that are formed later."""
    zero = np.zeros(data.sizes["time"])
    return {name: np.asarray(data[name].values, float) if name in data else zero for name in model.variables}


def submodel_problems(
    where: str, place: str, project: Project, aircraft: Aircraft, states: xr.Dataset, spans: Spans, names: set[str]
) -> list[str]:
    """Return why a record cannot identify a submodel.

    Parameters
    ----------
    where : str
        Place and record, for the texts.
    place : str
        Place in the project file: ``engine.flown``, ``controls.column.free`` ...
    project, aircraft
    states : Dataset (time,)
        `flighttest.reconstruction.start_states`. [SI]
    spans : sequence of (float, float)
        Windows that are taken. [s]
    names : set of str
        `coefficient_names`; needed for the ground effect only.
    """
    parts = between(states, spans)
    found = [
        f"{where}: no sample from {start:g} to {end:g} s" for (start, end), part in zip(spans, parts, strict=True) if part.sizes["time"] < 2
    ]
    parts = [part for part in parts if part.sizes["time"] > 1]
    section = place.split(".")[0]
    if section == "engine" and project.engine is not None:
        return found + _engine_problems(where, place, project.engine, parts)
    if section == "controls":
        return found + _control_problems(where, place.split(".")[1], project, aircraft, states)
    if section == "gear":
        return found + _gear_problems(where, aircraft, parts)
    return found + _ground_problems(where, project, names)


def _engine_problems(where: str, place: str, asked: Any, parts: Sequence[xr.Dataset]) -> list[str]:
    found: list[str] = []
    for part in parts:
        record = collect(found, where, engine_channels, part, asked.engines, asked.pla)
        if record is None:
            continue
        if place != "engine.starts" and "throttle" not in record:
            found.append(f"{where}: no lever of engine {asked.engines[0]} (engine{asked.engines[0]}.throttle or .pla); map its channel")
        elif place == "engine.flown":
            try:
                quiet(thinned(record, asked.rate))
            except AeromatchError as error:
                found.append(f"{where}: {error}")
    return list(dict.fromkeys(found))


def _control_problems(where: str, item: str, project: Project, aircraft: Aircraft, states: xr.Dataset) -> list[str]:
    asked = project.controls[item]
    try:
        needed = channels(loading_of(aircraft, item, asked.model, asked.constants, asked.arm))
    except AeromatchError:
        return []  # reported once, without a record
    have = {*map(str, states.data_vars)} | ({"wow"} if "wow_nose" in states else set())
    return [f"{where}: the {item} needs {name}, which the record does not hold; map its channel" for name in needed if name not in have]


def _gear_problems(where: str, aircraft: Aircraft, parts: Sequence[xr.Dataset]) -> list[str]:
    try:
        wheels = [f"gear.{wheel.name}.compression" for wheel in wheels_of(aircraft)]
    except AeromatchError:
        return []  # reported once, without a record
    found = []
    for part in parts:
        absent = [name for name in (*wheels, *_RUNNING) if name not in part]
        found += [f"{where}: the landing gear needs {name}, which the record does not hold; map its channel" for name in absent]
        if not absent and not any((part[name].values > TOUCHING).any() for name in wheels):
            found.append(f"{where}: no wheel is compressed by more than {TOUCHING:g} m; give ground runs or landings")
    return list(dict.fromkeys(found))


def _ground_problems(where: str, project: Project, names: set[str]) -> list[str]:
    asked = project.ground_effect
    if asked is None or not names:
        return []
    models = [Model.parse(text) for text in asked.models]
    absent = dict.fromkeys(name for model in models for name in (model.coefficient, *model.variables) if name not in names)
    return [f"{where}: the ground effect needs {name}, which the record does not hold; map its channel" for name in absent]

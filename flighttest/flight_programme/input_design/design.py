"""Design of a test input: the signal, as large as its limits allow, and its expected errors."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import SchemaError
from flightmech.short_text import ShortText
from flightmech.simulation.compiler import SimModel
from flightmech.support.atomic_write import folder_for_files
from flighttest.flight_programme.input_design.input_accuracy import (
    Expected,
    cramer_rao,
    expected_errors,
)
from flighttest.flight_programme.input_design.input_signals import axes_of, measures
from flighttest.flight_programme.input_design.predicted_response import (
    Amplitude,
    amplitude_within,
    each_within,
    scale_signal,
    trimmed_start,
)
from flighttest.flight_programme.input_design.specification import ConditionTable, Design
from flighttest.flight_programme.input_design.timetable import save_csv, save_timetable
from flighttest.regression.equation_error.model import RegressionModel

# Columns of the predicted response in its CSV.
_RESPONSE_COLUMNS = (
    *("V", "alpha", "beta", "p", "q", "r"),
    *("phi", "theta", "psi", "nz", "ay", "h"),
)
# Quantities of `Expected.estimates` in the summary.
_ESTIMATE_COLUMNS = ("estimate", "stderr", "stderr_white", "vif")


@dataclass(frozen=True)
class Designed(ShortText):
    """A test input that is ready for flight.

    Attributes
    ----------
    title : str
    signal : Dataset (time,)
        Deflections from trim, scaled to the limits. [SI]
    measures : DataFrame
        Of `input_signals.measures`; with a condition also ``factor``, the scaled amplitude of an
        axis over the requested one.
    amplitude : Amplitude or None
        Largest common factor on all axes, after each axis alone has been scaled to the limits;
        None without a condition.
    expected : tuple of Expected
        One per model, and one for output error.
    """

    title: str
    signal: xr.Dataset
    measures: Any
    amplitude: Amplitude | None
    expected: tuple[Expected, ...]

    def summary(self) -> dict[str, Any]:
        """Return all numbers as plain tables."""
        tables: dict[str, Any] = {"title": self.title, **self.signal.attrs, "axes": self.measures}
        if self.amplitude is not None:
            tables |= {
                "scale": self.amplitude.scale,
                "binding": self.amplitude.binding,
                "response": self.amplitude.extremes,
            }
        tables["expected"] = {model.name: _tabulate_estimates(model) for model in self.expected}
        return tables


def _tabulate_estimates(expected: Expected) -> dict[str, dict[str, float]]:
    """Return the expected values of each term."""
    table = {}
    for term in expected.estimates["term"].values:
        row = expected.estimates.sel(term=term)
        table[str(term)] = {key: float(row[key]) for key in _ESTIMATE_COLUMNS}
    return table


def design_input(
    design: Design, sim: SimModel | None = None, aircraft: Aircraft | None = None
) -> Designed:
    """Return the test input of a description, as large as its limits allow.

    Parameters
    ----------
    design : Design
        As from `read_design`.
    sim : SimModel, optional
        The a-priori model; required if the design has a condition.
    aircraft : Aircraft, optional
        Limits of its surfaces, which apply in addition to those of the design, and noise of its
        instruments.

    Raises
    ------
    SchemaError
        The design has a condition without a model, an accuracy without a condition, or another
        fault.
    OutOfRange, IdentificationError
        As in `amplitude_within`, `expected_errors` and `cramer_rao`.
    """
    signal = design.signal()
    condition = design.condition
    if condition is None:
        if design.accuracy is not None:
            problem = (
                "[accuracy] requires [condition]: expected standard errors need a condition in "
                "which the model predicts the motion; add [condition], or remove [accuracy]"
            )
            raise SchemaError("design", [problem])
        return Designed(design.title, signal, measures(signal), amplitude=None, expected=())
    if sim is None or aircraft is None:
        problem = (
            "[condition] needs the a-priori model and the aircraft; give both, or remove "
            "[condition]"
        )
        raise SchemaError("design", [problem])
    return _design_in_condition(design, condition, signal, sim=sim, aircraft=aircraft)


def _design_in_condition(
    design: Design,
    condition: ConditionTable,
    signal: xr.Dataset,
    *,
    sim: SimModel,
    aircraft: Aircraft,
) -> Designed:
    """Return a signal scaled to the limits of a condition, with its expected errors."""
    start = trimmed_start(
        sim, {}, kind=condition.kind, fixed=condition.fixed, unknowns=condition.unknowns
    )
    limits = {**surface_limits(sim, aircraft, signal), **condition.limits}
    # first each axis alone, so that one strong axis does not make the others small
    factors = each_within(sim, signal, start=start, limits=limits, margin=condition.margin)
    signal = scale_signal(signal, factors)
    # then all axes together by one factor
    amplitude = amplitude_within(sim, signal, start=start, limits=limits, margin=condition.margin)
    factors = {name: factor * amplitude.scale for name, factor in factors.items()}
    signal = scale_signal(signal, dict.fromkeys(factors, amplitude.scale))
    expected = _expect_errors(
        design, sim, aircraft, signal=signal, start=start, response=amplitude.response
    )
    return Designed(
        design.title,
        signal,
        measures=measures(signal).assign(factor=list(factors.values())),
        amplitude=amplitude,
        expected=expected,
    )


def surface_limits(
    sim: SimModel, aircraft: Aircraft, signal: xr.Dataset
) -> dict[str, tuple[float, float]]:
    """Return the limits of the surfaces that a test input moves. [SI]

    The keys are the outputs ``applied.<surface>`` of the model.
    """
    axes = axes_of(signal)
    limits = {}
    for name, (low, high) in aircraft.limits.items():
        output = f"applied.{name}"
        if name in axes and output in sim.outputs:
            limits[output] = (float(low), float(high))
    return limits


def save_design(designed: Designed, folder: str | os.PathLike, name: str) -> list[Path]:
    """Write the input as CSV and as a time table, and the predicted response as CSV.

    Parameters
    ----------
    designed : Designed
    folder : path
        Created if it is missing.
    name : str
        The files are called ``<name>.csv``, ``<name>.table`` and ``<name>_response.csv``.

    Returns
    -------
    list of Path
        The written files.
    """
    folder = Path(folder)
    names = [f"{name}.csv", f"{name}.table"]
    with folder_for_files(folder) as place:
        save_csv(designed.signal, place / names[0])
        save_timetable(designed.signal, place / names[1], title=designed.title)
        if designed.amplitude is not None:
            names.append(f"{name}_response.csv")
            response = designed.amplitude.response
            outputs = [output for output in _RESPONSE_COLUMNS if output in response]
            save_csv(response[outputs], place / names[2])
    return [folder / file for file in names]


def _expect_errors(
    design: Design,
    sim: SimModel,
    aircraft: Aircraft,
    *,
    signal: xr.Dataset,
    start: Mapping[str, float],
    response: xr.Dataset,
) -> tuple[Expected, ...]:
    """Return the expected errors of each regression model, and those of output error."""
    accuracy = design.accuracy
    if accuracy is None:
        return ()
    noise = dict(accuracy.noise) or None
    expected = []
    for text in accuracy.models:
        model = RegressionModel.parse(text)
        expected.append(
            expected_errors(model, response, aircraft, noise=noise, memory=accuracy.memory)
        )
    if accuracy.parameters:
        bounds = cramer_rao(
            sim,
            signal,
            start,
            parameters=accuracy.parameters,
            noise=accuracy.outputs,
            nuisance=accuracy.nuisance,
            memory=accuracy.memory,
        )
        expected.append(bounds)
    return tuple(expected)

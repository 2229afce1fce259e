"""From the description of a test input to the input that is flown: scaled, judged, written."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from flightmech.errors import SchemaError

from ..equation_error.model import Model
from .input_accuracy import Expected, cramer_rao, expected_errors
from .input_signals import axes_of, measures
from .predicted_response import Amplitude, amplitude_within, each_within, scaled, trimmed_start
from .specification import Design
from .timetable import save_csv, save_timetable

if TYPE_CHECKING:
    from flightmech import Aircraft, SimModel

_KEPT = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "nz", "ay", "h")  # of the response, for the CSV


@dataclass(frozen=True)
class Designed:
    """A test input that is ready to be flown.

    Attributes
    ----------
    title : str
    signal : Dataset (time,)
        Deflections from trim, scaled to the limits. [SI]
    measures : DataFrame
        Of `input_signals.measures`; with a condition also ``factor``, by which an axis is smaller than requested.
    amplitude : Amplitude or None
        What the limits allowed of all axes together, after each had been fitted alone; None without a condition.
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
        found: dict[str, Any] = {"title": self.title, **self.signal.attrs, "axes": self.measures}
        if self.amplitude is not None:
            found |= {"scale": self.amplitude.scale, "binding": self.amplitude.binding, "response": self.amplitude.extremes}
        columns = ("estimate", "stderr", "stderr_white", "vif")
        found["expected"] = {
            one.name: {str(t): {key: float(one.estimates[key].sel(term=t)) for key in columns} for t in one.estimates["term"].values}
            for one in self.expected
        }
        return found


def design_input(design: Design, sim: SimModel | None = None, aircraft: Aircraft | None = None) -> Designed:
    """Return the test input of a description, as large as its limits allow.

    Parameters
    ----------
    design : Design
        As from `read_design`.
    sim : SimModel, optional
        The a-priori model; needed when the design has a condition.
    aircraft : Aircraft, optional
        For the limits of its surfaces, which hold in addition to those of the design, and for the noise of its instruments.

    Raises
    ------
    SchemaError
        A condition without a model, an accuracy without a condition; every fault of the description.
    OutOfRange, IdentificationError
        As in `amplitude_within`, `expected_errors` and `cramer_rao`.
    """
    signal = design.signal()
    if design.condition is None:
        if design.accuracy is not None:
            raise SchemaError("design", ["accuracy: expected standard errors need a condition, in which a model predicts the motion"])
        return Designed(design.title, signal, measures(signal), None, ())
    if sim is None or aircraft is None:
        raise SchemaError("design", ["condition: needs the a-priori model and the aircraft; give them or leave the condition out"])
    start = trimmed_start(sim, {}, design.condition.kind, design.condition.fixed, design.condition.unknowns)
    limits = {**surface_limits(sim, aircraft, signal), **design.condition.limits}
    margin = design.condition.margin
    factors = each_within(sim, signal, start, limits, margin)
    signal = scaled(signal, factors)
    amplitude = amplitude_within(sim, signal, start, limits, margin=margin)
    factors = {name: factor * amplitude.scale for name, factor in factors.items()}
    signal = scaled(signal, dict.fromkeys(factors, amplitude.scale))
    expected = _expected(design, sim, aircraft, signal, start, amplitude)
    return Designed(design.title, signal, measures(signal).assign(factor=list(factors.values())), amplitude, expected)


def surface_limits(sim: SimModel, aircraft: Aircraft, signal: xr.Dataset) -> dict[str, tuple[float, float]]:
    """Return the limits of the surfaces that a test input moves, as limits on the outputs of the model. [SI]"""
    moved = {f"applied.{name}": limit for name, limit in aircraft.limits.items() if name in axes_of(signal)}
    return {name: (float(low), float(high)) for name, (low, high) in moved.items() if name in sim.outputs}


def save_design(made: Designed, folder: str | os.PathLike, name: str) -> list[Path]:
    """Write the input as CSV and as a time table, and the predicted response as CSV.

    Parameters
    ----------
    made : Designed
    folder : path
        Made when it is not there.
    name : str
        The files are called ``<name>.csv``, ``<name>.table`` and ``<name>_response.csv``.

    Returns
    -------
    list of Path
        What was written.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"{name}.csv", folder / f"{name}.table"]
    save_csv(made.signal, files[0])
    save_timetable(made.signal, files[1], made.title)
    if made.amplitude is not None:
        files.append(folder / f"{name}_response.csv")
        response = made.amplitude.response
        save_csv(response[[output for output in _KEPT if output in response]], files[2])
    return files


def _expected(design: Design, sim, aircraft, signal, start, amplitude: Amplitude) -> tuple[Expected, ...]:
    wanted = design.accuracy
    if wanted is None:
        return ()
    noise = dict(wanted.noise) or None
    found = [expected_errors(Model.parse(text), amplitude.response, aircraft, noise, wanted.memory) for text in wanted.models]
    if wanted.parameters:
        found.append(cramer_rao(sim, signal, start, wanted.parameters, wanted.outputs, wanted.nuisance, memory=wanted.memory))
    return tuple(found)

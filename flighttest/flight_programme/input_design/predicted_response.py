"""Predicted response to a test input, and the amplitude that keeps the response inside limits.

The nonlinear a-priori model is simulated, because the limits that matter (stall, load factor, bank)
are beyond the range of a linear model.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import flightmech
from flightmech.errors import (
    AeromatchWarning,
    IdentificationError,
    OutOfRange,
    SimulationError,
    UnknownName,
)
from flightmech.names import lookup
from flightmech.simulation.compiler import SimModel
from flightmech.units import from_si
from flighttest.flight_programme.input_design.input_signals import axes_of

# Step of the simulation [s].
STEP = 0.01
# Number of bisections; the error of the amplitude is then a thousandth of the largest amplitude.
_BISECTIONS = 10
# Input of the model that one surface of a pair moves, with its share: half the difference of the
# ailerons, the mean of the flaps.
_LEFT_RIGHT = {
    "delta_a_right": ("delta_a", 0.5),
    "delta_a_left": ("delta_a", -0.5),
    "delta_f_right": ("delta_f", 0.5),
    "delta_f_left": ("delta_f", 0.5),
}
# Columns of the extremes of a response.
_EXTREMES = ["trim", "lowest", "highest", "low", "high"]


def trimmed_start(
    sim: SimModel,
    parameters: Mapping[str, float],
    kind: str = "level",
    fixed: Mapping[str, float] | None = None,
    unknowns: Sequence[str] | None = None,
) -> dict[str, float]:
    """Return the parameters and inputs of a steady flight, for the functions of this module.

    Parameters
    ----------
    sim : SimModel
    parameters, kind, fixed, unknowns
        As in `flightmech.trim`; for a glider ``gamma`` replaces power among the unknowns.

    Raises
    ------
    IdentificationError
        There is no such flight inside the limits; the text contains the verdict of the trim.
    """
    steady = flightmech.trim(
        sim,
        {"mode.earth": 0.0, **parameters},
        kind=kind,
        fixed=dict(fixed or {}),
        unknowns=unknowns,
    )
    if not steady.attrs["converged"]:
        raise IdentificationError(
            f"no steady flight to start the test input from: {steady.attrs['verdict']}"
        )
    return flightmech.start_of(steady)


def model_inputs(
    sim: SimModel, signal: xr.Dataset, start: Mapping[str, float], scale: float = 1.0
) -> xr.Dataset:
    """Return the inputs of a model under a test input: trim plus scaled deflections.

    Parameters
    ----------
    sim : SimModel
    signal : Dataset (time,)
        Deflections from trim. [SI]
    start : mapping of str to float
        Parameters and inputs of the trim.
    scale : float
        Factor on all axes.

    Returns
    -------
    Dataset (time,)
        ``throttle`` moves the levers of all engines.  ``delta_a`` is half the difference of
        ``delta_a_right`` and ``delta_a_left``, ``delta_f`` the mean of ``delta_f_left`` and
        ``delta_f_right``.

    Raises
    ------
    UnknownName
        The model has no input for an axis.
    """
    deflections: dict[str, np.ndarray] = {}
    for axis in axes_of(signal):
        for name, share in _model_axes(sim, axis):
            deflection = share * scale * signal[axis].values
            deflections[name] = deflections.get(name, 0.0) + deflection
    inputs = {}
    for name, deflection in deflections.items():
        inputs[name] = ("time", start.get(name, 0.0) + deflection)
    return xr.Dataset(inputs, {"time": signal["time"].values})


def predict_response(
    sim: SimModel,
    signal: xr.Dataset,
    start: Mapping[str, float],
    scale: float = 1.0,
    outputs: Sequence[str] | None = None,
) -> xr.Dataset:
    """Return the simulated response to a test input.

    Parameters
    ----------
    sim, signal, start, scale
        As in `model_inputs`.
    outputs : sequence of str, optional
        Outputs of the model; all if omitted.

    Returns
    -------
    Dataset (time,)
        [SI]

    Raises
    ------
    SimulationError
        The motion diverges.
    """
    return flightmech.simulate(
        sim,
        model_inputs(sim, signal, start, scale=scale),
        {**start, "mode.trim": 0.0},
        step=STEP,
        outputs=outputs,
    )


@dataclass(frozen=True)
class Amplitude:
    """Largest test input inside the limits.

    Attributes
    ----------
    scale : float
        Factor on the test input, at most the requested one.
    binding : str
        Description of the limit that a larger input exceeds; empty if the requested input exceeds
        none.
    extremes : DataFrame
        Index ``quantity``: ``trim``, ``lowest``, ``highest`` of the response at this scale,
        ``low`` and ``high`` of the limits. [SI]
    response : Dataset (time,)
        Response at this scale.
    """

    scale: float
    binding: str
    extremes: Any
    response: xr.Dataset


def amplitude_within(
    sim: SimModel,
    signal: xr.Dataset,
    start: Mapping[str, float],
    limits: Mapping[str, tuple[float, float]],
    largest: float = 1.0,
    margin: float = 1.0,
) -> Amplitude:
    """Return the largest factor on a test input that keeps the predicted response inside limits.

    Parameters
    ----------
    sim, signal, start
        As in `model_inputs`.
    limits : mapping of str to (float, float)
        Output of the model to its lowest and highest value: ``alpha``, ``nz``, ``phi``, ``V``,
        ``applied.delta_e`` ... [SI]
    largest : float
        Largest factor.
    margin : float
        Part of the distance from trim to each limit that the prediction may use.  For an a-priori
        model whose damping may be wrong by a third, 0.7 is appropriate.

    Returns
    -------
    Amplitude

    Raises
    ------
    OutOfRange
        The trimmed flight is outside the limits, or a thousandth of the largest input exceeds them.
    UnknownName
        A limit is not on an output.

    Notes
    -----
    Bisection: a larger input is assumed to exceed the limits too.
    """
    trim = _trim_inside_limits(sim, signal, start, limits=limits)
    narrow = {}
    for name, bounds in limits.items():
        narrow[name] = tuple(trim[name] + margin * (bound - trim[name]) for bound in bounds)
    scale, binding = _bisect_scale(sim, signal, start, limits=narrow, largest=largest)
    response = predict_response(sim, signal, start, scale=scale)
    return Amplitude(
        scale, binding, extremes=_tabulate_extremes(response, trim, limits), response=response
    )


def _trim_inside_limits(
    sim: SimModel,
    signal: xr.Dataset,
    start: Mapping[str, float],
    *,
    limits: Mapping[str, tuple[float, float]],
) -> dict[str, float]:
    """Return the limited outputs in trim; raise if one of them is outside its limits."""
    for name in limits:
        if name not in sim.outputs:
            raise UnknownName(name, sim.outputs, "limit", "limits are set on outputs of the model")
    # two samples of the input at zero scale are the shortest record of the trim
    steady = predict_response(sim, signal.isel(time=slice(0, 2)), start, scale=0.0)
    trim = {name: float(steady[name][0]) for name in limits}
    outside = []
    for name, (low, high) in limits.items():
        if not low <= trim[name] <= high:
            outside.append(_describe_excess(name, trim[name], low=low, high=high))
    if outside:
        raise OutOfRange(f"the steady flight is outside its limits already: {'; '.join(outside)}")
    return trim


def _bisect_scale(
    sim: SimModel,
    signal: xr.Dataset,
    start: Mapping[str, float],
    *,
    limits: Mapping[str, tuple[float, ...]],
    largest: float,
) -> tuple[float, str]:
    """Return the largest scale inside the limits, and the limit that a larger one exceeds."""

    def excess(scale: float) -> str:
        try:
            # the search passes the stops of the controls on purpose
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", AeromatchWarning)
                response = predict_response(sim, signal, start, scale=scale, outputs=list(limits))
        except SimulationError as error:
            return f"the motion diverges ({error})"
        return first_exceeded_limit(response, limits)

    binding = excess(largest)
    if not binding:
        return largest, ""
    low, high = 0.0, largest
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        reason = excess(middle)
        if reason:
            high, binding = middle, reason
        else:
            low = middle
    if low == 0.0:
        raise OutOfRange(f"even a thousandth of the test input is too much: {binding}")
    return low, binding


def each_within(
    sim: SimModel,
    signal: xr.Dataset,
    start: Mapping[str, float],
    limits: Mapping[str, tuple[float, float]],
    margin: float = 1.0,
) -> dict[str, float]:
    """Return a factor per axis that keeps the response to that axis alone inside limits.

    A strong axis then does not make the others small. Parameters and errors are those of
    `amplitude_within`.
    """
    factors = {}
    for name in axes_of(signal):
        alone = signal[[name]].assign_attrs(signal.attrs)
        amplitude = amplitude_within(sim, alone, start, limits=limits, margin=margin)
        factors[name] = amplitude.scale
    return factors


def scale_signal(signal: xr.Dataset, factors: Mapping[str, float]) -> xr.Dataset:
    """Return a test input with its axes, and the powers of their lines, scaled."""
    scaled = signal.assign({name: signal[name] * factor for name, factor in factors.items()})
    if "power" in signal:
        axes = signal["axis"].values
        squares = [factors.get(str(name), 1.0) ** 2 for name in axes]
        scaled["power"] = signal["power"] * xr.DataArray(squares, {"axis": axes}, ("axis",))
    return scaled


def _model_axes(sim: SimModel, axis: str) -> list[tuple[str, float]]:
    """Return the inputs of the model that an axis moves, each with its share."""
    if axis in sim.inputs:
        return [(axis, 1.0)]
    if axis in _LEFT_RIGHT:
        return [_LEFT_RIGHT[axis]]
    # a lever moves the same input of every engine
    levers = []
    for name in sim.inputs:
        if name.startswith("engine") and name.endswith(f".{axis}"):
            levers.append((name, 1.0))
    if not levers:
        raise UnknownName(axis, sim.inputs, "axis", "the model has no input for it")
    return levers


def first_exceeded_limit(response: xr.Dataset, limits: Mapping[str, tuple[float, ...]]) -> str:
    """Return a description of the limit that a response exceeds first; empty for none."""
    exceeded: list[tuple[float, str]] = []
    for name, (low, high) in limits.items():
        x = response[name].values
        outside = np.flatnonzero((x < low) | (x > high))
        if len(outside):
            first = outside[0]
            time = float(response["time"].values[first])
            text = _describe_excess(name, x[first], low=low, high=high)
            exceeded.append((time, f"{text} at {time:g} s"))
    if not exceeded:
        return ""
    return min(exceeded)[1]


def _describe_excess(name: str, value: float, *, low: float, high: float) -> str:
    """Return a value and its limits in the display unit of its quantity."""
    unit = lookup(name.removeprefix("applied.")).display_units
    value, low, high = (float(from_si(x, unit)) for x in (value, low, high))
    text = f"{name} {value:.4g} outside {low:.4g} ... {high:.4g}"
    if unit == "1":
        return text
    return f"{text} {unit}"


def _tabulate_extremes(
    response: xr.Dataset, trim: Mapping[str, float], limits: Mapping[str, tuple[float, float]]
) -> pd.DataFrame:
    """Return trim, extremes and limits of the limited outputs. [SI]"""
    rows = {}
    for name, (low, high) in limits.items():
        x = response[name]
        rows[name] = [trim[name], float(x.min()), float(x.max()), low, high]
    table = pd.DataFrame.from_dict(rows, orient="index", columns=_EXTREMES)
    return table.rename_axis("quantity")

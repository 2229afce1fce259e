"""The response to a test input that an a-priori model predicts, and the amplitude that keeps it
inside limits.

The nonlinear model flies, on the compiled kernel: the limits that matter (stall, load factor, bank)
are where a linear model ends.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import flightmech
from flightmech.errors import IdentificationError, OutOfRange, SimulationError, UnknownName
from flightmech.names import lookup
from flightmech.simulation.compiler import SimModel
from flightmech.units import from_si
from flighttest.flight_programme.input_design.input_signals import axes_of

STEP = 0.01  # of the simulation [s]
_BISECTIONS = 10  # the amplitude is then known to a thousandth of the largest one
# what the model takes for a pair of surfaces: difference for ailerons, mean for flaps
_LEFT_RIGHT = {
    "delta_a": (("delta_a_right", 0.5), ("delta_a_left", -0.5)),
    "delta_f": (("delta_f_right", 0.5), ("delta_f_left", 0.5)),
}


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
        As in `flightmech.trim`; a glider has ``gamma`` among its unknowns in place of power.

    Raises
    ------
    IdentificationError
        There is no such flight inside the limits; the text is the verdict of the trim.
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
        ``throttle`` moves the levers of all engines, ``delta_a_left`` and ``delta_a_right`` make
        ``delta_a`` (half their difference), ``delta_f_left`` and ``delta_f_right`` make ``delta_f``
        (their mean).

    Raises
    ------
    UnknownName
        An axis that the model has no input for.
    """
    moved: dict[str, np.ndarray] = {}
    for axis in axes_of(signal):
        for name, share in _model_axes(sim, axis):
            moved[name] = moved.get(name, 0.0) + share * scale * signal[axis].values
    return xr.Dataset(
        {name: ("time", start.get(name, 0.0) + u) for name, u in moved.items()},
        {"time": signal["time"].values},
    )


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
        Of the model; all without it.

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
        model_inputs(sim, signal, start, scale),
        {**start, "mode.trim": 0.0},
        step=STEP,
        outputs=outputs,
    )


@dataclass(frozen=True)
class Amplitude:
    """The largest test input that the limits allow.

    Attributes
    ----------
    scale : float
        Factor on the test input, at most the one requested.
    binding : str
        The limit that a larger input would break, in words; empty when none is near.
    extremes : DataFrame
        Index ``quantity``: ``trim``, ``lowest``, ``highest`` of the response at this scale,
        ``low``, ``high`` as allowed. [SI]
    response : Dataset (time,)
        At this scale.
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
        The input is not made larger than this.
    margin : float
        Part of the way from trim to each limit that the prediction may use: an a-priori model whose
        damping may be wrong by a third deserves 0.7.

    Returns
    -------
    Amplitude

    Raises
    ------
    OutOfRange
        The trimmed flight itself is outside, or a thousandth of the largest input is too much.
    UnknownName
        A limit on something that is not an output.

    Notes
    -----
    Bisection: what a larger input does is taken to break the limits as well.
    """
    for name in limits:
        if name not in sim.outputs:
            raise UnknownName(name, sim.outputs, "limit", "limits are set on outputs of the model")
    rest = predict_response(sim, signal.isel(time=slice(0, 2)), start, 0.0)
    trim = {name: float(rest[name][0]) for name in limits}
    outside = [
        _words(name, trim[name], *limits[name])
        for name in limits
        if not limits[name][0] <= trim[name] <= limits[name][1]
    ]
    if outside:
        raise OutOfRange(f"the steady flight is outside its limits already: {'; '.join(outside)}")
    narrow = {
        name: tuple(trim[name] + margin * (bound - trim[name]) for bound in limits[name])
        for name in limits
    }

    def broken(scale: float) -> str:
        try:
            response = predict_response(sim, signal, start, scale, list(limits))
        except SimulationError as error:
            return f"the motion diverges ({error})"
        return first_exceeded_limit(response, narrow)

    low, high, binding = 0.0, largest, broken(largest)
    if not binding:
        low = largest
    for _ in range(_BISECTIONS if binding else 0):
        middle = 0.5 * (low + high)
        reason = broken(middle)
        low, high, binding = (low, middle, reason) if reason else (middle, high, binding)
    if low == 0.0:
        raise OutOfRange(f"even a thousandth of the test input is too much: {binding}")
    response = predict_response(sim, signal, start, low)
    return Amplitude(low, binding, _extremes(response, trim, limits), response)


def each_within(
    sim: SimModel,
    signal: xr.Dataset,
    start: Mapping[str, float],
    limits: Mapping[str, tuple[float, float]],
    margin: float = 1.0,
) -> dict[str, float]:
    """Return a factor per axis that keeps the response to that axis alone inside limits, so that a
    strong one does not starve the others.

    Parameters, errors
        As in `amplitude_within`.
    """
    return {
        name: amplitude_within(
            sim, signal[[name]].assign_attrs(signal.attrs), start, limits, margin=margin
        ).scale
        for name in axes_of(signal)
    }


def scale_signal(signal: xr.Dataset, factors: Mapping[str, float]) -> xr.Dataset:
    """Return a test input with its axes, and the powers of their lines, scaled."""
    found = signal.assign({name: signal[name] * factor for name, factor in factors.items()})
    if "power" in signal:
        square = xr.DataArray(
            [factors.get(str(name), 1.0) ** 2 for name in signal["axis"].values],
            {"axis": signal["axis"].values},
            ("axis",),
        )
        found["power"] = signal["power"] * square
    return found


def _model_axes(sim: SimModel, axis: str) -> list[tuple[str, float]]:
    """The inputs of the model that an axis moves, each with its share."""
    if axis in sim.inputs:
        return [(axis, 1.0)]
    shares = [
        (name, share)
        for name, parts in _LEFT_RIGHT.items()
        for part, share in parts
        if part == axis
    ]
    shares = shares or [
        (name, 1.0)
        for name in sim.inputs
        if name.startswith("engine") and name.endswith(f".{axis}")
    ]
    if not shares:
        raise UnknownName(axis, sim.inputs, "axis", "the model has no input for it")
    return shares


def first_exceeded_limit(response: xr.Dataset, limits: Mapping[str, tuple[float, ...]]) -> str:
    """Return the limit that a response breaks first, in words; empty for none."""
    found: list[tuple[float, str]] = []
    for name, (low, high) in limits.items():
        x = response[name].values
        bad = np.flatnonzero((x < low) | (x > high))
        if len(bad):
            time = float(response["time"].values[bad[0]])
            found.append((time, f"{_words(name, x[bad[0]], low, high)} at {time:g} s"))
    return min(found)[1] if found else ""


def _words(name: str, value: float, low: float, high: float) -> str:
    row = lookup(name.removeprefix("applied."))
    value, low, high = (float(from_si(x, row.display_units)) for x in (value, low, high))
    return (
        f"{name} {value:.4g} outside {low:.4g} ... "
        f"{high:.4g}{'' if row.display_units == '1' else ' ' + row.display_units}"
    )


def _extremes(
    response: xr.Dataset, trim: Mapping[str, float], limits: Mapping[str, tuple[float, float]]
):

    rows = {
        name: {
            "trim": trim[name],
            "lowest": float(response[name].min()),
            "highest": float(response[name].max()),
            "low": limits[name][0],
            "high": limits[name][1],
        }
        for name in limits
    }
    columns = ["trim", "lowest", "highest", "low", "high"]
    return pd.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("quantity")

"""Windows of free motion as pieces of a likelihood: recorded force in, both ends of the cable out.

`window_response` simulates them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.support.arrays import true_runs
from flightmech.units import G0
from flighttest.records.signals.white_noise import estimate_white_noise
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.motion import (
    REST,
    control_signals,
    free_motion_windows,
    has_force_jump,
    loading_channels,
)
from flighttest.submodels.control_loading.responses.quiet_inputs import quiet_lines

# Name of the force error of a driving hand: part of the force proportional to the rate.
HAND = "hand_damping"
# Names of the unknowns of a window.
TRAVEL, SURFACE, EDGE, ERROR = "start.travel", "start.surface", "edge", "force_error"
# Length of the pieces over which the noise of the force is an unknown, and length of a line of the
# force from which on the noise of the whole line is one unknown. [s]
_PIECE, _LONG = 0.1, 0.25
# Most pieces of a window: the kernel has room for 128 unknowns, with the constants of the circuit,
# the terms of the hinge moment and the jumps of the force.
_MOST_PIECES = 72
# Part of the way between the stops, next to a stop, that is left out.
_MARGIN = 0.02
# Shortest window. [samples]
_SHORTEST = 12


@dataclass(frozen=True)
class FreeWindow:
    """One window of free motion.

    Attributes
    ----------
    time : array (time,)
        Time. [s]
    measured : array (time, 2)
        Travel of the cockpit end and of the surface end (deflection over gearing), over the
        white noise of each.
    scale : array (2,)
        White noise of both. [m or rad]
    force : array (time,)
        Recorded force. [N or N m]
    weight : array (time,)
        Load factor less one, times standard gravity. [m s-2]
    load : array (time,)
        Hinge moment for Ch = 1. [N m]
    factors : list of (int, array (time,))
        Power of the deflection and other factors of every term of the hinge moment.
    ground : float
        1 if the nose-wheel spring acts.
    edges : tuple of int
        Samples before a jump of the force.
    errors : tuple of (slice, float)
        Samples over which the noise of the force is one unknown, and its standard deviation.
    is_driven : bool
        Whether a hand drives the control all the time: no jump of the force.
    """

    time: np.ndarray
    measured: np.ndarray
    scale: np.ndarray
    force: np.ndarray
    weight: np.ndarray
    load: np.ndarray
    factors: list[tuple[int, np.ndarray]]
    ground: float
    edges: tuple[int, ...]
    errors: tuple[tuple[slice, float], ...]
    is_driven: bool

    @property
    def span(self) -> str:
        """First and last time as a text."""
        return f"{self.time[0]:.2f}-{self.time[-1]:.2f} s"

    @property
    def step(self) -> float:
        """Sampling interval. [s]"""
        return float(np.median(np.diff(self.time)))

    def starts(self) -> dict[str, float]:
        """Return first values of the unknowns of this window."""
        rest = slice(0, max(1, round(REST / self.step)))
        s, a = (self.measured[rest] * self.scale).mean(axis=0)
        starts = {TRAVEL: float(s), SURFACE: float(a)}
        starts |= {f"{EDGE}{k + 1}": 0.5 for k in range(len(self.edges))}
        return starts | {f"{ERROR}{k + 1}": 0.0 for k in range(len(self.errors))}


def find_windows(
    loading: ControlLoading,
    free: Sequence[xr.Dataset],
    stops: tuple[float, float] | None = None,
    error: tuple[str, int, float] | None = None,
) -> list[FreeWindow]:
    """Return the windows of free motion of pulses and releases.

    A window ends before the control comes to a stop, whose spring is not part of the model.

    Parameters
    ----------
    loading : ControlLoading
    free : sequence of Dataset (time,)
        Pulses and releases, as for `identify_control_loading`.
    stops : (float, float), optional
        Travel at both stops. [m or rad]
    error : (str, int, float), optional
        Channel, kind (0 bias, 1 scale error) and size of an error that is added; the windows are
        those of the records without it.
    """
    scale = _noise_scale(loading, free)
    windows = []
    for record in free:
        # Whole records: the longer a line, the better it is determined.
        quiet, hand = {}, f"F_{loading.item}"
        for name in loading_channels(loading):
            if name in record and name not in (loading.item, loading.deflection, "wow"):
                x = record[name].values.astype(float)
                noise = estimate_white_noise(x)
                lines, sizes = quiet_lines(x, noise)
                quiet[name] = ("time", lines)
                if name == hand:
                    quiet["force_noise"] = ("time", np.full(len(x), noise))
                    quiet["force_line"] = ("time", sizes)
        for data in free_motion_windows(loading, record):
            data = _before_stop(loading, data, stops)
            if data.sizes["time"] >= _SHORTEST:
                edges = np.flatnonzero(has_force_jump(data[hand].values))
                known = quiet
                if not len(edges):
                    # A hand that drives the control gives any force, not lines.
                    known = {name: x for name, x in quiet.items() if name != hand}
                inputs = record.assign(known).sel(time=data["time"])
                if error is not None and error[0] in inputs:
                    channel, kind, size = error
                    wrong = inputs[channel] * (1.0 + size) if kind else inputs[channel] + size
                    inputs = inputs.assign({channel: wrong})
                windows.append(_prepare_window(loading, inputs, scale, tuple(edges.tolist())))
    return windows


def _noise_scale(loading: ControlLoading, free: Sequence[xr.Dataset]) -> np.ndarray:
    """Return the white noise of travel and surface end, (2,).

    Records without noise get a millionth of the motion.
    """
    noise, spans = [], []
    for record in free:
        ends = record[loading.item].values, record[loading.deflection].values / loading.gearing
        noise.append([estimate_white_noise(x) for x in ends])
        spans.append([float(np.ptp(x)) for x in ends])
    if not noise:
        return np.ones(2)
    return np.maximum(np.median(noise, axis=0), 1e-6 * np.max(spans))


def _before_stop(
    loading: ControlLoading, data: xr.Dataset, stops: tuple[float, float] | None
) -> xr.Dataset:
    """Return a window up to the sample before the control reaches a stop."""
    if stops is None:
        return data
    low, high = stops
    margin = _MARGIN * (high - low)
    s = data[loading.item].values
    outside = np.flatnonzero((s < low + margin) | (s > high - margin))
    end = int(outside[0]) if len(outside) else len(s)
    return data.isel(time=slice(0, end))


def _prepare_window(
    loading: ControlLoading, data: xr.Dataset, scale: np.ndarray, edges: tuple[int, ...]
) -> FreeWindow:
    """Return one window with its signals."""
    moved = control_signals(loading, data, None)
    travel = moved["travel"].values
    aft = moved[loading.deflection].values / loading.gearing
    weight = np.zeros(len(travel))
    if "bob_weight" in loading.constants:
        weight = G0 * (moved["nz"].values - 1.0)
    force = moved[f"F_{loading.item}"].values
    return FreeWindow(
        time=moved["time"].values,
        measured=np.column_stack([travel, aft]) / scale,
        scale=scale,
        force=force,
        weight=weight,
        load=loading.load(moved) / -loading.gearing,
        factors=loading.by_power(moved),
        ground=float(moved["on_ground"].values.mean()),
        edges=edges,
        errors=_force_errors(data, is_driven=not edges),
        is_driven=not edges,
    )


def _force_errors(data: xr.Dataset, is_driven: bool) -> tuple[tuple[slice, float], ...]:
    """Return the pieces of a window over which the noise of the force is an unknown.

    Noise of a long line of the force is one unknown, as small as the mean of so many samples. A
    ramp of a pulse, the force of a hand that drives the control, or a force of any other form has
    pieces of `_PIECE`. A window of more than `_MOST_PIECES` pieces has longer ones: the slower part
    of that noise remains an unknown.
    """
    step = float(np.median(np.diff(data["time"].values)))
    n = data.sizes["time"]
    size = max(1, round(_PIECE / step), math.ceil(n / _MOST_PIECES))
    lines = data["force_line"].values
    is_known = lines * step > _LONG
    noise = float(data["force_noise"].values[0])
    if not noise > 0.0:
        return ()
    pieces = []
    # Number of the line of each sample; 0 in a piece.
    line = 1 + np.append(0, np.cumsum(np.diff(lines) != 0))
    for start in range(0, n, size):
        part = slice(start, min(start + size, n))
        if is_driven or not is_known[part].all():
            pieces.append((part, noise / np.sqrt(part.stop - part.start)))
            line[part] = 0
    for number in np.unique(line[line > 0]):
        for start, stop in true_runs(line == number):
            pieces.append((slice(start, stop), noise / np.sqrt(lines[start])))
    return tuple(pieces)

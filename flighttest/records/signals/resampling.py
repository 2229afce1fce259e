"""Resampling and zero-phase filtering of sampled channels.

Controls move in near-rectangular steps.  They are interpolated by monotone cubics, which do not
overshoot, switches have the state of the nearest sample, and all other channels have cubic splines.
A channel that is faster than the target grid is low-passed first in both directions, without delay
and aliasing; a switch is not.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from flightmech.errors import OutOfRange
from flightmech.names import WRAPPED
from flightmech.support.arrays import median

GAP = 3.5
"""Longest step of a clock without a gap, in median steps.

Lost samples make whole multiples of a step.  Half a step more than three keeps the rounding of a
clock from deciding about two lost samples.
"""


_CONTROLS = (
    *("delta_", "throttle", "pla", "gear", "speedbrake", "brake"),
    *("column", "wheel", "pedal", "F_", "wow_"),
    *("mixture", "prop_", "tiller", "i_h", "trim_indicator"),
    *("setting", "deflection"),  # of a device
)
# Channels that are 0 or 1.
_SWITCHES = frozenset(
    ("cutoff", "starter", "ignition", "flameout", "feather", "burning")
    + ("crossfeed", "pump", "stall_warning", "buffet")
)
SMOOTHING = 6.0
"""Cut-off of `smooth`, two to three times the fastest mode of a small aeroplane. [Hz]

For a light jet 2 to 3 Hz are suitable.
"""


SAME_CLOCK = 1e-9
"""Difference of equal stamps, in sampling intervals."""


# Cut-off of a faster channel before it is resampled, in rates of the target grid.
_GRID_CUTOFF = 0.4


def is_control(name: str) -> bool:
    """Return whether a channel is a surface, lever, device or pilot force."""
    return name.rpartition(".")[2].startswith(_CONTROLS)


def is_switch(name: str) -> bool:
    """Return whether a channel is 0 or 1, such as a fuel lever."""
    return name.rpartition(".")[2] in _SWITCHES


# Least cut-off over the rate: below 1e-8 the steady state of the filter is singular by rounding.
_LEAST_CUTOFF = 1e-6


def lowpass(x, rate: float, cutoff: float = SMOOTHING) -> np.ndarray:
    """Return `x` after a zero-phase low-pass filter.

    The filter is a Butterworth filter of order 4, forward and backward, with -3 dB at `cutoff`.

    Parameters
    ----------
    x : array (time,)
        Uniformly sampled signal. [any]
    rate : float
        Samples per second. [Hz]
    cutoff : float
        Frequency where the amplitude is 0.71, below half the rate. [Hz]

    Returns
    -------
    array (time,)

    Raises
    ------
    OutOfRange
        The cut-off is not between a millionth and half of the rate.

    Notes
    -----
    Two passes give -6 dB at the design frequency, which is therefore raised by
    (sqrt(2) - 1)^(-1/8) = 1.117.  Both ends are padded by odd reflection over three time constants
    of the slowest pole (at least 0.5/cutoff).  Treat 0.5 s at each end as lost.
    """
    # reading a record filters nothing: SciPy's part takes half a second to import
    from scipy.signal import sosfilt

    design = cutoff / (math.sqrt(2.0) - 1.0) ** 0.125
    if not _LEAST_CUTOFF * rate < design < 0.5 * rate:
        raise OutOfRange(
            f"cut-off {cutoff:g} Hz at {rate:g} samples per second; it must lie between "
            f"{_LEAST_CUTOFF * rate:g} and {0.5 * rate * 0.895:g} Hz"
        )
    x = np.asarray(x, float)
    # The slowest poles of a Butterworth filter of order 4 have the damping ratio sin(pi/8).
    slowest = 1.0 / (2.0 * math.pi * design * math.sin(math.pi / 8.0))
    pad = math.ceil(rate * max(0.5 / cutoff, 3.0 * slowest))
    pad = min(pad, len(x) - 1)
    # The steps of `scipy.signal.sosfiltfilt`, with the same bytes. That function computes the
    # settled states again at each call, in more than half of its time for 1500 samples.
    sections, settled = _butterworth(design, rate)
    before, after = 2 * x[:1] - x[pad:0:-1], 2 * x[-1:] - x[-2 : -(pad + 2) : -1]
    padded = np.concatenate([before, x, after])
    forward, _ = sosfilt(sections, padded, zi=settled * padded[0])
    backward, _ = sosfilt(sections, forward[::-1], zi=settled * forward[-1])
    return backward[::-1][pad : len(padded) - pad]


# One design takes as long as the filtering of a manoeuvre.
@lru_cache(maxsize=256)
def _butterworth(cutoff: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a Butterworth filter of order 4, for reading only.

    The arrays are its second-order sections, and the states of each section (section, 2) that an
    input of 1 has brought about.
    """
    # reading a record filters nothing: SciPy's part takes half a second to import
    from scipy.signal import butter, sosfilt_zi

    sections = butter(4, cutoff, fs=rate, output="sos")
    return sections, sosfilt_zi(sections)


def resample(time, x, grid, name: str) -> np.ndarray:
    """Return channel `name` on another time grid.

    Parameters
    ----------
    time, x : array (time,)
        Samples, at rising times. [s], [any]
    grid : array (grid,)
        Times of the result.  Beyond the samples the nearest value is held. [s]
    name : str
        Canonical name.  A switch has its nearest sample, a control a monotone cubic, any other
        channel a cubic spline.

    Returns
    -------
    array (grid,)

    References
    ----------
    .. [Fritsch1980] Fritsch, Carlson, SIAM J. Numer. Anal. 17, 1980.
    """
    # reading a record filters nothing: SciPy's part takes half a second to import
    from scipy.interpolate import CubicSpline, PchipInterpolator

    time, x, grid = (np.asarray(a, float) for a in (time, x, grid))
    grid = np.clip(grid, time[0], time[-1])
    if is_switch(name):
        # Halfway between two samples: on average without a delay.
        return x[np.searchsorted(0.5 * (time[:-1] + time[1:]), grid)]
    if len(time) < 4:
        return np.interp(grid, time, x)
    if _is_same_clock(time, grid) and np.isfinite(x).all():
        return x.copy()
    interpolator = PchipInterpolator if is_control(name) else CubicSpline
    return interpolator(time, x)(grid)


def _is_same_clock(time: np.ndarray, grid: np.ndarray) -> bool:
    if len(time) != len(grid):
        return False
    tolerance = SAME_CLOCK * (time[-1] - time[0]) / len(time)
    return bool(np.abs(time - grid).max() <= tolerance)


def resample_to_grid(time, x, grid, name: str) -> np.ndarray:
    """Return a channel on a uniform grid.

    A channel faster than the grid is low-passed first below 0.4 of the rate of the grid.
    Parameters are the same as in `resample`; `grid` is uniform and has at least two points.
    """
    time, x, grid = (np.asarray(a, float) for a in (time, x, grid))
    rate = 1.0 / (grid[1] - grid[0])
    # one sample has no rate
    channel_rate = 1.0 / median(np.diff(time)) if len(time) > 1 else 0.0
    # A switch has no frequencies that could be filtered.
    has_states = is_switch(name) or name.rpartition(".")[2].startswith("wow_")
    if channel_rate > 1.01 * rate and not has_states:
        steps = math.floor((time[-1] - time[0]) * channel_rate + 1e-6)
        uniform = time[0] + np.arange(steps + 1) / channel_rate
        # A shorter channel is too short for the filter.
        if len(uniform) > 8:
            x = lowpass(resample(time, x, uniform, name), channel_rate, _GRID_CUTOFF * rate)
            time = uniform
    return resample(time, x, grid, name)


def remove_delay(time, x, delay: float, name: str) -> np.ndarray:
    """Return a channel without a known latency.

    The value of the result at t is the recorded value at t + delay.

    Parameters
    ----------
    time, x : array (time,)
        Samples, at rising times.  The result is NaN where a NaN contributes to it. [s], [any]
    delay : float
        Latency of the channel, see `time_delay`.  The last `delay` seconds have the last sample.
        [s]
    name : str
        Canonical name, see `resample`.

    Returns
    -------
    array (time,)
    """
    time, x = np.asarray(time, float), np.asarray(x, float)
    is_finite = np.isfinite(x)
    if not delay or is_finite.sum() < 2:
        return x
    samples = x[is_finite]
    if name in WRAPPED:
        samples = np.unwrap(samples)
    shifted_time = np.clip(time + delay, time[0], time[-1])
    shifted = resample(time[is_finite], samples, shifted_time, name)
    # Linear interpolation of the mask is positive where a NaN is one of the two neighbours.
    is_lost = np.interp(time + delay, time, (~is_finite).astype(float)) > 0.0
    return np.where(is_lost, np.nan, shifted)

"""Samples that identified a model, kept with it in short form, and their comparison with a flight.

A record that proves a model must not identify it.  File names do not show a copy, samples do.  A
database keeps the angular rates and the load factor of every window that entered it, as means over
0.4 s at every 0.2 s, in the text of one root attribute; a model compiled from it keeps them, too.
Copies under other names, parts of a window and re-sampled ones correlate with them at one shift of
the clocks.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy

from flightmech.flown_states import FLOWN_STATES, join_states
from flightmech.support.arrays import integrate_trapezoids

FLOWN_SAMPLES = "flown_samples"
"""Root attribute of a database with the windows that identified it."""
CHANNELS = ("p", "q", "r", "nz")
LEAST_CHANNELS = 3
STEP = 0.2  # [s] of the common clock
SMOOTHED = 0.4  # [s] mean over it, so that a clock between the samples does not matter
LEAST_OVERLAP = 5.0  # [s]
ALIKE = 0.985
"""Median correlation of the channels at one shift of the clocks, from which on samples are shared.

Our number: copies at a higher rate have 1.00.  Of the 1081 pairs of the 47 records of the T-37, the
two most alike have 0.903; two Dutch rolls of the C182 flown alike have 0.963.  A copy at a lower
rate, interpolated, may stay below.
"""
COPIED = 0.997
"""Median correlation from which on a window holds samples of a flight.

A window is shorter than a record, so more is needed than `ALIKE`: two Dutch rolls of the C182 flown
alike have 0.9945 over 5 s, the cases of the T-37 and its 105 windows (three rates) 0.972 at most,
copies 0.9983 and more.
"""
COPIED_NOISE = 0.95
"""Least correlation of all channels from which on a window with two channels of noise is a copy.

A channel that does not move, such as the roll rate of a pitch manoeuvre, holds noise, which only
copies share.  On another clock such channels of the T-37 correlate by 0.970 and more, and the
median of all channels by 0.987 only.  Different flights have 0.81 at most in the least alike
channel, and like ones of a simulated C182, whose small motion is alike too, have no two channels of
noise.
"""
_WHITE = 0.45  # correlation of means two to six steps later, which share no sample; noise has less
_LIKELY = 0.6  # at a shift that is up to half a step wrong; below it no finer shift is tried
_NEAR = 0.93  # at a shift that is up to half of `_COARSE` wrong
_COARSE, _FINE = 0.05, 0.0125  # [s] shifts of the clocks that are tried
_RESOLUTION = 0.1  # of the median change from step to step; finer is noise
_GAP = 1.5  # sampling intervals from which on a new window begins


@dataclass(frozen=True)
class FlownWindow:
    """One window of the samples that identified a model.

    Attributes
    ----------
    source : str
        Name of the fit or the record.
    start : float
        On the clock of the record. [s]
    channels : tuple of str
    means : array (channel, step)
        Means over `SMOOTHED` at every `STEP` from the start on. [SI]
    """

    source: str
    start: float
    channels: tuple[str, ...]
    means: np.ndarray


@dataclass(frozen=True)
class SharedWindow:
    """A window that identified a model and holds samples of a flight.

    Attributes
    ----------
    source : str
        Name of the fit or the record of the window.
    start, stop : float
        The shared samples, on the clock of the flight. [s]
    correlation : float
    channels : tuple of str
    """

    source: str
    start: float
    stop: float
    correlation: float
    channels: tuple[str, ...]


def cut_windows(source: str, time: np.ndarray, channels: Mapping[str, Any]) -> list[FlownWindow]:
    """Return the windows of samples, one for every stretch without a gap.

    Parameters
    ----------
    source : str
        Name of the fit or the record.
    time : array (time,)
        It may jump between windows. [s]
    channels : mapping of str to array (time,)
        Those of `CHANNELS` are kept; with fewer than `LEAST_CHANNELS` there is no window.
    """
    names = tuple(name for name in CHANNELS if name in channels)
    if len(names) < LEAST_CHANNELS or time.size < 2:
        return []
    rows = np.array([np.asarray(channels[name], float) for name in names])
    steps = np.diff(time)
    usual = float(np.median(steps))
    # A long step is a gap; a step back is the start of another window.
    cuts = np.flatnonzero((steps > _GAP * usual) | (steps <= 0.0)) + 1
    windows = []
    for indices in np.split(np.arange(time.size), cuts):
        indices = indices[np.isfinite(rows[:, indices]).all(axis=0)]
        if indices.size < 2 or np.ptp(time[indices]) < LEAST_OVERLAP + SMOOTHED:
            continue
        # Smoothed and reduced: a comparison needs the motion, not the noise.
        means = smooth_rows(time[indices], rows[:, indices])
        windows.append(FlownWindow(source, float(time[indices[0]]), names, means))
    return windows


def smooth_rows(time: np.ndarray, rows: np.ndarray, shift: float = 0.0) -> np.ndarray:
    """Return means over `SMOOTHED` at every `STEP` from `shift` after the first sample on.

    Parameters
    ----------
    time : array (time,)
        [s]
    rows : array (channel, time)
    shift : float
        [s]

    Returns
    -------
    array (channel, step)
    """
    instants = np.arange(time[0] + shift, time[-1] - SMOOTHED + 1e-9, STEP)
    return np.array([smooth_samples(time, values, instants) for values in rows])


def smooth_samples(time: np.ndarray, values: np.ndarray, instants: np.ndarray) -> np.ndarray:
    """Return means of samples over `SMOOTHED` from each of the instants on. [s]"""
    # The integral of the samples is continuous: its differences are means at any rate.
    integral = integrate_trapezoids(time, values)
    late = np.interp(instants + SMOOTHED, time, integral)
    return (late - np.interp(instants, time, integral)) / SMOOTHED


def pack_windows(windows: Iterable[FlownWindow]) -> str:
    """Return windows as the text of an attribute; equal windows are kept once."""
    heads, blocks = [], []
    seen = set()
    for window in windows:
        key = (window.channels, window.start, window.means.tobytes())
        if key in seen or not window.means.size:
            continue
        seen.add(key)
        # whole numbers of a share of the usual step; differences compress well
        usual = np.median(np.abs(np.diff(window.means, axis=1)), axis=1)
        quanta = np.where(usual > 0.0, _RESOLUTION * usual, 1.0)
        counts = np.round(window.means / quanta[:, np.newaxis]).astype(np.int64)
        changes = np.diff(counts, axis=1, prepend=0).astype("<i4")
        heads.append([window.source, window.start, window.channels, quanta.tolist(), counts.shape])
        # the bytes of one place of all numbers follow each other
        blocks.append(changes.view(np.uint8).reshape(-1, 4).T.tobytes())
    if not heads:
        return ""
    content = json.dumps(heads, separators=(",", ":")).encode() + b"\n" + b"".join(blocks)
    return base64.b85encode(zlib.compress(content, 9)).decode()


@lru_cache(maxsize=8)
def unpack_windows(text: str) -> tuple[FlownWindow, ...]:
    """Return the windows of `pack_windows`; none for a damaged or an empty text."""
    if not text:
        return ()
    try:
        content = zlib.decompress(base64.b85decode(text))
        head, _, body = content.partition(b"\n")
        windows, place = [], 0
        for source, start, names, quanta, shape in json.loads(head):
            size = 4 * shape[0] * shape[1]
            planes = np.frombuffer(body[place : place + size], np.uint8).reshape(4, -1)
            changes = np.ascontiguousarray(planes.T).view("<i4").reshape(shape)
            means = np.cumsum(changes.astype(float), axis=1) * np.array(quanta)[:, np.newaxis]
            windows.append(FlownWindow(str(source), float(start), tuple(names), means))
            place += size
    except (ValueError, TypeError, KeyError, zlib.error):
        return ()
    return tuple(windows)


def join_packed(*texts: str) -> str:
    """Return the windows of several texts as one text."""
    windows: list[FlownWindow] = []
    for text in dict.fromkeys(filter(None, texts)):
        windows += unpack_windows(text)
    if len(set(filter(None, texts))) == 1:
        # packed once: rounding again would change the numbers
        return next(filter(None, texts))
    return pack_windows(windows)


def with_flown_samples(*attributes: Mapping[Any, Any]) -> dict[str, str]:
    """Return the root attributes `FLOWN_SAMPLES` and `FLOWN_STATES` of databases joined.

    An attribute that none of them has is left out.
    """
    joined = {
        FLOWN_SAMPLES: join_packed(*(str(item.get(FLOWN_SAMPLES, "")) for item in attributes)),
        FLOWN_STATES: join_states(*(str(item.get(FLOWN_STATES, "")) for item in attributes)),
    }
    return {name: text for name, text in joined.items() if text}


def find_shared_windows(
    windows: Sequence[FlownWindow], time: np.ndarray, channels: Mapping[str, Any]
) -> list[SharedWindow]:
    """Return the windows that hold samples of a flight.

    Parameters
    ----------
    windows : sequence of FlownWindow
    time : array (time,)
        Of the flight. [s]
    channels : mapping of str to array (time,)
        Of the flight, by name.

    Notes
    -----
    Correlations are absolute: a record mirrored left to right is a copy, too.
    """
    names = tuple(name for name in CHANNELS if name in channels)
    rows = np.array([np.asarray(channels[name], float) for name in names])
    if len(names) < LEAST_CHANNELS:
        return []
    is_finite = np.isfinite(rows).all(axis=0)
    time, rows = time[is_finite], rows[:, is_finite]
    if time.size < 2 or np.ptp(time) < LEAST_OVERLAP + SMOOTHED:
        return []
    flight = _ShiftedFlight(time, rows, names)
    found = []
    for window in windows:
        common = [name for name in window.channels if name in names]
        if len(common) < LEAST_CHANNELS:
            continue
        # The clocks of window and flight may differ: the best shift counts.
        match = flight.best_match(window, common)
        is_noise_shared = match.least > COPIED_NOISE and _holds_noise(window.means)
        if match.correlation > COPIED or is_noise_shared:
            start = float(time[0]) + match.shift + max(match.lag, 0) * STEP
            size = window.means.shape[1]
            count = min(match.lag + size, flight.rows_at(match.shift).shape[1])
            stop = start + (count - max(match.lag, 0) - 1) * STEP + SMOOTHED
            shared = SharedWindow(window.source, start, stop, match.correlation, tuple(common))
            found.append(shared)
    return found


def _holds_noise(means: np.ndarray) -> bool:
    """Return whether two channels of a window (channel, step) are noise."""
    rows = means - means.mean(axis=1, keepdims=True)
    # an oscillation has a large correlation at one of these lags, a slow motion at the first
    later = [np.mean(rows[:, lag:] * rows[:, :-lag], axis=1) for lag in range(2, 7)]
    is_noise = np.max(np.abs(later), axis=0) < _WHITE * rows.var(axis=1)
    # one may be the small motion of a lateral manoeuvre in pitch
    return int(is_noise.sum()) >= 2


class _Match(NamedTuple):
    """Best shift of a window: lag in steps, and shift inside a step [s].

    `correlation` is the median over the channels, `least` the smallest of them.
    """

    correlation: float
    lag: int
    shift: float
    least: float


class _ShiftedFlight:
    """Means of a flight on clocks that begin at several instants inside one step."""

    def __init__(self, time: np.ndarray, rows: np.ndarray, names: Sequence[str]):
        self.time, self.rows, self.names = time, rows, names
        self._means: dict[float, np.ndarray] = {}

    def rows_at(self, shift: float) -> np.ndarray:
        """Return the means (channel, step) from `shift` after the first sample on."""
        key = round(shift, 6)
        if key not in self._means:
            self._means[key] = smooth_rows(self.time, self.rows, shift)
        return self._means[key]

    def match_at(self, kept: np.ndarray, picked: Sequence[int], shift: float) -> _Match:
        """Return the best lag of a window at one shift."""
        flight = self.rows_at(shift)[[*picked]]
        single = np.abs(sliding_correlation(flight, kept))
        joint = np.median(single, axis=0)
        place = int(np.argmax(joint))
        lag = place - (kept.shape[1] - 1)
        return _Match(float(joint[place]), lag, shift, float(single[:, place].min()))

    def best_match(self, window: FlownWindow, common: Sequence[str]) -> _Match:
        """Return the best lag and shift of a window, finer the more likely it is a copy."""
        kept = window.means[[window.channels.index(name) for name in common]]
        picked = [self.names.index(name) for name in common]
        best = self.match_at(kept, picked, 0.0)
        if best.correlation < _LIKELY:
            return best
        coarse = [
            self.match_at(kept, picked, s)
            for s in np.arange(_COARSE, STEP - 0.5 * _COARSE, _COARSE)
        ]
        best = max(best, *coarse)
        if best.correlation < _NEAR:
            return best
        near = best.shift + _FINE * np.arange(1 - _COARSE / _FINE, _COARSE / _FINE)
        fine = [self.match_at(kept, picked, float(s)) for s in near if s >= 0.0]
        return max(best, *fine)


def sliding_correlation(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the correlation of rows over their overlap, at every lag of b in a (name, lag).

    Lags run from 1 - size of b; an overlap shorter than `LEAST_OVERLAP` has correlation 0.
    """
    a, b = a - a.mean(axis=1, keepdims=True), b - b.mean(axis=1, keepdims=True)
    # the overlap at each lag, on the samples of a and on those of b
    lags = np.arange(1 - b.shape[1], a.shape[1])
    first, last = np.maximum(lags, 0), np.minimum(lags + b.shape[1], a.shape[1])
    count = last - first

    def overlap_mean(rows: np.ndarray, shift: np.ndarray | int) -> np.ndarray:
        total = np.pad(np.cumsum(rows, axis=1), ((0, 0), (1, 0)))
        return (total[:, last - shift] - total[:, first - shift]) / count

    mean_a, mean_b = overlap_mean(a, 0), overlap_mean(b, lags)
    variance_a = overlap_mean(a * a, 0) - mean_a**2
    variance_b = overlap_mean(b * b, lags) - mean_b**2
    # sum over the overlap of a(t + lag) b(t), by the convolution theorem
    size = scipy.fft.next_fast_len(lags.size, real=True)
    product = scipy.fft.rfft(a, size) * scipy.fft.rfft(b[:, ::-1], size)
    covariance = scipy.fft.irfft(product, size)[:, : lags.size] / count - mean_a * mean_b
    # below a share of the variance of the whole series, the difference is rounding
    least = 1e-9 * np.maximum(a.var(axis=1), b.var(axis=1))[:, np.newaxis]
    is_valid = (count * STEP >= LEAST_OVERLAP) & (variance_a > least) & (variance_b > least)
    scale = np.sqrt(np.where(is_valid, variance_a * variance_b, 1.0))
    return np.where(is_valid, covariance / scale, 0.0)

"""Samples that two flight records share: the same record under another name, trimmed or re-sampled.

A record that proves a model must not identify it.  File names do not show a copy, samples do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.flown_samples import (
    ALIKE,
    LEAST_CHANNELS,
    LEAST_OVERLAP,
    SMOOTHED,
    STEP,
    sliding_correlation,
    smooth_samples,
)

INERTIAL = ("p", "q", "r", "ax", "ay", "az", "ax_imu", "ay_imu", "az_imu")
"""Channels of gyros and accelerometers: noise and turbulence make them differ in every flight."""
LEAST_SAMPLES = 100  # equal instants that are no coincidence


@dataclass(frozen=True)
class SharedSamples:
    """Samples of one record in another.

    Attributes
    ----------
    start, stop : float
        On the clock of the first record. [s]
    shift : float
        Clock of the second record less that of the first. [s]
    how : str
        ``420 equal samples of p, q, r``, or the correlation.
    """

    start: float
    stop: float
    shift: float
    how: str


Channels = dict[str, tuple[np.ndarray, np.ndarray]]


def find_shared_samples(
    first: xr.DataTree | Channels, second: xr.DataTree | Channels
) -> SharedSamples | None:
    """Return the samples that two records share; None if they are different flights.

    Parameters
    ----------
    first, second : DataTree or mapping
        As `flighttest.read` returns them, or their `inertial_channels`, which many pairs share.

    Notes
    -----
    Trimmed and thinned copies have equal samples.  For others the inertial channels are correlated
    at every shift of the clocks, on a common clock of 0.2 s, over the overlap alone.
    """
    one = inertial_channels(first) if isinstance(first, xr.DataTree) else first
    other = inertial_channels(second) if isinstance(second, xr.DataTree) else second
    names = [name for name in one if name in other]
    if len(names) < LEAST_CHANNELS:
        return None
    return _find_equal(one, other, names) or _find_shift(one, other, names)


def inertial_channels(record: xr.DataTree) -> Channels:
    """Return time and values of the inertial channels that vary, without missing samples."""
    channels: Channels = {}
    for leaf in record.children.values():
        variables = leaf.variables
        for name in INERTIAL:
            if name not in variables or "time" not in variables:
                continue
            time = variables["time"].values.astype(float)
            values = np.asarray(variables[name].values, float)
            is_finite = np.isfinite(values)
            if values.ndim == 1 and is_finite.sum() > LEAST_SAMPLES and np.ptp(values[is_finite]):
                channels[name] = time[is_finite], values[is_finite]
    return channels


def sample_hashes(channels: Channels) -> tuple[np.ndarray, np.ndarray]:
    """Return time and a hash of each sample over the inertial channels of one clock.

    Equal hashes in two records are samples of one flight: noise makes all channels together differ
    in any two flights.

    Parameters
    ----------
    channels : mapping
        Result of `inertial_channels`.

    Returns
    -------
    time : array (time,)
        Clock of the most channels. [s] Empty with fewer than `LEAST_CHANNELS` on one clock.
    hashes : array of uint64 (time,)
    """
    counts = [channels[name][1].size for name in channels]
    usual = max(sorted(set(counts)), key=counts.count, default=0)
    names = [name for name in channels if channels[name][1].size == usual]
    if len(names) < LEAST_CHANNELS:
        return np.zeros(0), np.zeros(0, np.uint64)
    return channels[names[0]][0], _sample_rows(channels, names)


def _find_equal(one: Channels, other: Channels, names: list[str]) -> SharedSamples | None:
    """Return the instants at which all channels of one clock are equal; None for too few."""
    # One channel of a coarse converter has equal samples in any two flights, all together do not.
    names = [name for name in names if one[name][1].size == one[names[0]][1].size]
    names = [name for name in names if other[name][1].size == other[names[0]][1].size]
    if len(names) < LEAST_CHANNELS:
        return None
    first, second = _sample_rows(one, names), _sample_rows(other, names)
    common, rows, columns = np.intersect1d(first, second, return_indices=True)
    if common.size <= LEAST_SAMPLES:
        return None
    time, other_time = one[names[0]][0][rows], other[names[0]][0][columns]
    how = f"{common.size} equal samples of {', '.join(names)}"
    shift = float(np.median(other_time - time))
    return SharedSamples(float(time.min()), float(time.max()), shift, how)


def _sample_rows(channels: Channels, names: list[str]) -> np.ndarray:
    """Return one hash per instant over all channels (time,)."""
    # single precision: a copy may have been stored so; 0.0 + removes the sign of zero
    columns = [0.0 + channels[name][1].astype(np.float32) for name in names]
    bits = np.column_stack(columns).view(np.uint32).astype(np.uint64)
    # a weighted sum modulo 2^64 is a hash; sorting the rows themselves takes a hundred times longer
    weights = np.random.default_rng(0).integers(1, 2**63, bits.shape[1], dtype=np.uint64)
    return (bits * (2 * weights + 1)).sum(axis=1, dtype=np.uint64)


def _find_shift(one: Channels, other: Channels, names: list[str]) -> SharedSamples | None:
    """Return the shift of the clocks at which most channels are alike; None without one."""
    (start_a, a), (start_b, b) = _smooth(one, names), _smooth(other, names)
    if min(a.shape[1], b.shape[1]) * STEP < LEAST_OVERLAP:
        return None
    joint = np.median(sliding_correlation(a, b), axis=0)
    best = int(np.argmax(joint))
    if not joint[best] > ALIKE:
        return None
    # at index k the first sample of `one` falls on sample count - 1 - k of `other`
    count = b.shape[1]
    lag = best - (count - 1)
    start = start_a + max(lag, 0) * STEP
    stop = start_a + (min(lag + count, a.shape[1]) - 1) * STEP
    how = f"correlation {joint[best]:.4f} of {', '.join(names)}"
    return SharedSamples(float(start), float(stop), float(start_b - start_a - lag * STEP), how)


def _smooth(channels: Channels, names: list[str]) -> tuple[float, np.ndarray]:
    """Return the start of the common clock, and means over `SMOOTHED` from then on (name, time)."""
    start = max(channels[name][0][0] for name in names)
    stop = min(channels[name][0][-1] for name in names)
    instants = np.arange(start, stop - SMOOTHED, STEP)
    rows = [smooth_samples(*channels[name], instants) for name in names]
    return float(start), np.array(rows)

"""Steady schedule of a spool over the power lever: where the lever rests, and what the speed
settles at.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import xarray as xr
from scipy.ndimage import maximum_filter1d, median_filter, minimum_filter1d

from flightmech.errors import IdentificationError

STILL = 6.0  # time for which the lever must have rested [s]
MEDIAN = 0.2  # length of the running median [s]
FIRST = 0.5  # time at rest with which a record begins [s]
# range of the throttle that counts as rest, and distance of two positions that count as one
SAME = 0.02
LEAST = 0.05  # samples at a position of rest, in those at the most frequent one
GAP = 0.2  # knots of the schedule stand closer
SPACING = 0.035  # of the knots over n2
AWAY = 0.02  # gap to the schedule from which on a rate carries information on the time constant
EDGE = 0.005  # by which tables reach beyond the speeds at rest: an engine that idles stays inside
WIDE = 0.15  # half the time over which a rate is taken [s]


def remove_lever_noise(record: xr.Dataset) -> xr.Dataset:
    """Return a record with the noise of the lever taken off: a running median, which leaves ramps
    as they are.

    The simulation starts at the steady state of the first sample, so the first half second is held
    at its median.

    Raises
    ------
    IdentificationError
        The lever moves from the start.
    """

    step = float(np.median(np.diff(record["time"].values)))
    throttle = median_filter(
        record["throttle"].values.astype(float), 2 * round(0.5 * MEDIAN / step) + 1
    )
    count = max(round(FIRST / step), 1)
    if np.ptp(throttle[:count]) > SAME:
        raise IdentificationError(
            f"{record.attrs.get('record', 'a record')}: the lever moves in the first "
            f"{FIRST:g} s; let it begin at rest"
        )
    throttle[:count] = np.median(throttle[:count])
    return record.assign(throttle=("time", throttle))


def find_lever_rest(record: xr.Dataset, still: float = STILL, same: float = SAME) -> np.ndarray:
    """Return where the lever has rested for a while; records count as begun at rest.

    Parameters
    ----------
    record : Dataset (time,)
        ``throttle``, on a uniform clock.
    still : float
        Time at rest. [s]
    same : float
        Range of the throttle within it.
    """

    throttle, time = record["throttle"].values, record["time"].values
    width = max(round(still / float(np.median(np.diff(time)))), 1)
    padded = np.concatenate([np.full(width, np.median(throttle[:5])), throttle])
    high, low = (
        np.asarray(one(padded, width + 1, origin=width // 2))
        for one in (maximum_filter1d, minimum_filter1d)
    )
    return (high - low)[width:] < same


def rest_positions(records: Sequence[xr.Dataset]) -> np.ndarray:
    """Return the positions at which the lever rested, rising."""
    found = np.sort(
        np.concatenate([one["throttle"].values[find_lever_rest(one)] for one in records])
    )
    if not len(found):
        raise IdentificationError(
            f"the lever never rests for {STILL:g} s; add records at settled power"
        )
    groups = np.split(found, np.flatnonzero(np.diff(found) > SAME / 4.0) + 1)
    least = LEAST * max(map(len, groups))
    return np.array([float(np.median(group)) for group in groups if len(group) >= least])


def schedule_nodes(records: Sequence[xr.Dataset]) -> np.ndarray:
    """Return breakpoints of the schedule: the positions of rest, and evenly between those that are
    far apart.
    """
    rest = rest_positions(records)
    between = [np.linspace(a, b, int(np.ceil((b - a) / GAP)) + 1)[1:-1] for a, b in pairwise(rest)]
    return np.sort(np.concatenate([rest, *between]))


def speed_knots(records: Sequence[xr.Dataset]) -> np.ndarray:
    """Return knots of the tables over n2, evenly over what was run."""
    n2 = np.concatenate([one["n2"].values for one in records])
    low, high = np.quantile(n2, [0.002, 0.998])
    return np.linspace(low, high, max(round((high - low) / SPACING), 1) + 1)


def settled_speeds(records: Sequence[xr.Dataset], name: str) -> np.ndarray:
    """Return a speed at all samples at which the lever has rested; empty when there are none."""
    return np.concatenate(
        [
            one[name].values[find_lever_rest(one)]
            for one in records
            if name in one and "throttle" in one
        ]
        or [np.empty(0)]
    )


def cover_settled_range(points: np.ndarray, settled: np.ndarray) -> np.ndarray:
    """Return breakpoints over a speed, the outer ones moved outwards where the engine would leave
    them at rest.

    Parameters
    ----------
    points : array (breakpoint,)
    settled : array (sample,)
        Of the speed, at rest; one sample in a hundred is left to noise on either side.
    """
    found = np.array(points, float)
    settled = settled[np.isfinite(settled)]
    if settled.size:
        low, high = np.quantile(settled, [0.01, 0.99])
        found[0], found[-1] = min(found[0], low - EDGE), max(found[-1], high + EDGE)
    return found


def reading_error(records: Sequence[xr.Dataset], at: np.ndarray) -> np.ndarray:
    """Return the standard error of the mean lever position about each knot, from the noise of its
    readings. [throttle]

    Parameters
    ----------
    records : sequence of Dataset
        As they were recorded, before `remove_lever_noise`.
    at : array (knot,)
    """
    parts = [
        (one["throttle"].values[still], one["throttle"].values[1:] - one["throttle"].values[:-1])
        for one in records
        if (still := find_lever_rest(one)).any()
    ]
    noise = (
        np.sqrt(0.5) * 1.4826 * np.median(np.abs(np.concatenate([change for _, change in parts])))
    )
    rest = np.concatenate([lever for lever, _ in parts])
    return np.array(
        [noise / np.sqrt(max(int(np.count_nonzero(np.abs(rest - x) < SAME)), 1)) for x in at]
    )


def first_schedule(
    records: Sequence[xr.Dataset], name: str, at: np.ndarray, over: str = "throttle"
) -> np.ndarray:
    """Return the settled speed ``name`` over the throttle or the other spool, a start for the
    search.
    """
    rest = [find_lever_rest(one) for one in records]
    x = np.concatenate([one[over].values[still] for one, still in zip(records, rest)])
    y = np.concatenate([one[name].values[still] for one, still in zip(records, rest)])
    edges = np.append(at[0] - 1.0, np.append(0.5 * (at[1:] + at[:-1]), at[-1] + 1.0))
    inside = [(x >= a) & (x < b) for a, b in pairwise(edges)]
    place, speed = np.array(
        [(np.median(x[part]), np.median(y[part])) for part in inside if part.any()]
    ).T
    return np.interp(at, place, np.maximum.accumulate(speed))


def first_rates(
    records: Sequence[xr.Dataset],
    name: str,
    lever: np.ndarray,
    schedule: np.ndarray,
    at: np.ndarray,
) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Return time constants [s] and rates [1/s], each up and down, about values of n2: a start for
    the search.

    A time constant is the median of gap over rate, a rate the one that nine in ten samples do not
    reach.

    Parameters
    ----------
    records : sequence of Dataset (time,)
    name : {"n1", "n2"}
        The speed that moves.
    lever, schedule : array (knot,)
        What it settles at.
    at : array (speed,)
        Values of n2.

    Raises
    ------
    IdentificationError
        The speed does not move both ways.
    """
    rows = []
    for one in records:
        time, n = one["time"].values, one[name].values
        width = max(round(WIDE / float(np.median(np.diff(time)))), 1)
        rate = (n[2 * width :] - n[: -2 * width]) / (time[2 * width :] - time[: -2 * width])
        gap = (np.interp(one["throttle"].values, lever, schedule) - n)[width:-width]
        rows.append(np.column_stack([one["n2"].values[width:-width], gap, rate]))
    n2, gap, rate = np.concatenate(rows).T
    times, rates = [], []
    for way, word in ((1.0, "up"), (-1.0, "down")):
        moving = (way * gap > AWAY) & (way * rate > 0.0)
        if not moving.any():
            raise IdentificationError(
                f"{name} never moves {word} by more than {AWAY:g}; add a power change that way"
            )
        near = [np.abs(n2[moving] - v) < SPACING for v in at]
        times.append(_about(at, near, (gap / np.where(moving, rate, 1.0))[moving], 0.5))
        rates.append(_about(at, near, way * rate[moving], 0.9))
    return (times[0], times[1]), (rates[0], rates[1])


def _about(
    at: np.ndarray, near: Sequence[np.ndarray], values: np.ndarray, share: float
) -> np.ndarray:
    """Quantile of values about each place; between places where there are samples."""
    known = np.array([part.sum() > 3 for part in near])
    if not known.any():
        return np.full(len(at), float(np.quantile(values, share)))
    return np.interp(
        at,
        at[known],
        [float(np.quantile(values[part], share)) for part, ok in zip(near, known) if ok],
    )


def reading_noise(records: Sequence[xr.Dataset], name: str) -> float:
    """Return the standard deviation of the noise of a channel from sample to sample, by third
    differences.
    """
    change = np.concatenate([np.diff(one[name].values, 3) for one in records])
    return float(1.4826 * np.median(np.abs(change)) / np.sqrt(20.0))

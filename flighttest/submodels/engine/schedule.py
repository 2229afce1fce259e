"""Steady schedule of a spool over the power lever.

The functions find where the lever is at rest, and the speed of the spool there.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import scipy
import xarray as xr

from flightmech.errors import IdentificationError

# Time for which the lever must have been at rest. [s]
STILL = 6.0
# Length of the running median. [s]
MEDIAN = 0.2
# Time at rest at the begin of a record. [s]
FIRST = 0.5
# Range of the throttle at rest, and distance of two positions that count as the same.
SAME = 0.02
# Smallest number of samples at a position of rest, in those at the most frequent position.
LEAST = 0.05
# Largest distance of the knots of the schedule.
GAP = 0.2
# Distance of the knots over n2.
SPACING = 0.035
# Gap to the schedule above which a rate contains information on the time constant.
AWAY = 0.02
# Margin of tables beyond the speeds at rest. An idling engine stays inside the table.
EDGE = 0.005
# Half the time over which a rate is computed. [s]
WIDE = 0.15
# Median absolute deviation to standard deviation of a normal distribution.
_FROM_MEDIAN = 1.4826


def remove_lever_noise(record: xr.Dataset) -> xr.Dataset:
    """Return a record with the noise of the lever removed by a running median.

    The median does not change ramps.  The simulation starts at the steady state of the first
    sample.  The first half second is therefore replaced by its median.

    Raises
    ------
    IdentificationError
        The lever moves from the start.
    """
    step = float(np.median(np.diff(record["time"].values)))
    throttle = scipy.ndimage.median_filter(
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
    """Return where the lever has been at rest for a while (sample,).

    Before a record the lever is at rest.

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
    # Range of the throttle over the last `width` samples.
    high = np.asarray(scipy.ndimage.maximum_filter1d(padded, width + 1, origin=width // 2))
    low = np.asarray(scipy.ndimage.minimum_filter1d(padded, width + 1, origin=width // 2))
    return (high - low)[width:] < same


def rest_positions(records: Sequence[xr.Dataset]) -> np.ndarray:
    """Return the positions at which the lever was at rest, in rising order."""
    at_rest = [record["throttle"].values[find_lever_rest(record)] for record in records]
    positions = np.sort(np.concatenate(at_rest))
    if not len(positions):
        raise IdentificationError(
            f"the lever never rests for {STILL:g} s; add records at settled power"
        )
    # A gap between sorted samples separates two positions.
    groups = np.split(positions, np.flatnonzero(np.diff(positions) > SAME / 4.0) + 1)
    least = LEAST * max(map(len, groups))
    return np.array([float(np.median(group)) for group in groups if len(group) >= least])


def schedule_nodes(records: Sequence[xr.Dataset]) -> np.ndarray:
    """Return breakpoints of the schedule: the positions of rest, and points in large gaps."""
    positions = rest_positions(records)
    points = [positions]
    for a, b in pairwise(positions):
        points.append(np.linspace(a, b, int(np.ceil((b - a) / GAP)) + 1)[1:-1])
    return np.sort(np.concatenate(points))


def speed_knots(records: Sequence[xr.Dataset]) -> np.ndarray:
    """Return uniform knots of the tables over n2, over the recorded speeds."""
    n2 = np.concatenate([one["n2"].values for one in records])
    low, high = np.quantile(n2, [0.002, 0.998])
    return np.linspace(low, high, max(round((high - low) / SPACING), 1) + 1)


def settled_speeds(records: Sequence[xr.Dataset], name: str) -> np.ndarray:
    """Return a speed at all samples with the lever at rest; the result may be empty."""
    speeds = [np.empty(0)]
    for record in records:
        if name in record and "throttle" in record:
            speeds.append(record[name].values[find_lever_rest(record)])
    return np.concatenate(speeds)


def cover_settled_range(points: np.ndarray, settled: np.ndarray) -> np.ndarray:
    """Return breakpoints over a speed that cover the speeds at rest.

    The outer breakpoints are moved outwards if necessary.

    Parameters
    ----------
    points : array (breakpoint,)
        Breakpoints in rising order.
    settled : array (sample,)
        Speeds at rest. One sample in a hundred on either side counts as noise.
    """
    covering = np.array(points, float)
    settled = settled[np.isfinite(settled)]
    if settled.size:
        low, high = np.quantile(settled, [0.01, 0.99])
        covering[0], covering[-1] = min(covering[0], low - EDGE), max(covering[-1], high + EDGE)
    return covering


def reading_error(records: Sequence[xr.Dataset], at: np.ndarray) -> np.ndarray:
    """Return the standard error of the mean lever position about each knot. [throttle]

    It follows from the noise of the readings.

    Parameters
    ----------
    records : sequence of Dataset
        As recorded, before `remove_lever_noise`.
    at : array (knot,)
        Lever positions.
    """
    at_rest, changes = [], []
    for record in records:
        still = find_lever_rest(record)
        if still.any():
            lever = record["throttle"].values
            at_rest.append(lever[still])
            changes.append(lever[1:] - lever[:-1])
    # The difference of two readings has twice the variance of one.
    noise = np.sqrt(0.5) * _FROM_MEDIAN * np.median(np.abs(np.concatenate(changes)))
    positions = np.concatenate(at_rest)
    errors = []
    for x in at:
        count = int(np.count_nonzero(np.abs(positions - x) < SAME))
        errors.append(noise / np.sqrt(max(count, 1)))
    return np.array(errors)


def first_schedule(
    records: Sequence[xr.Dataset], name: str, at: np.ndarray, over: str = "throttle"
) -> np.ndarray:
    """Return the settled speed ``name`` over the throttle or the other spool, as a first value."""
    at_rest = [record.isel(time=find_lever_rest(record)) for record in records]
    x = np.concatenate([record[over].values for record in at_rest])
    y = np.concatenate([record[name].values for record in at_rest])
    # Medians of the samples nearest to each knot; a knot without samples is interpolated.
    edges = np.append(at[0] - 1.0, np.append(0.5 * (at[1:] + at[:-1]), at[-1] + 1.0))
    medians = []
    for a, b in pairwise(edges):
        inside = (x >= a) & (x < b)
        if inside.any():
            medians.append((np.median(x[inside]), np.median(y[inside])))
    position, speed = np.array(medians).T
    return np.interp(at, position, np.maximum.accumulate(speed))


def first_rates(
    records: Sequence[xr.Dataset],
    name: str,
    lever: np.ndarray,
    schedule: np.ndarray,
    at: np.ndarray,
) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Return first values of time constants [s] and rates [1/s], each up and down.

    A time constant is the median of gap over rate about a value of n2. A rate is the quantile of
    0.9.

    Parameters
    ----------
    records : sequence of Dataset (time,)
        Power changes.
    name : {"n1", "n2"}
        The speed that moves.
    lever, schedule : array (knot,)
        Lever positions and the steady speed at them.
    at : array (speed,)
        Values of n2.

    Raises
    ------
    IdentificationError
        The speed does not move both ways.
    """
    rows = []
    for record in records:
        time, n = record["time"].values, record[name].values
        width = max(round(WIDE / float(np.median(np.diff(time)))), 1)
        rate = (n[2 * width :] - n[: -2 * width]) / (time[2 * width :] - time[: -2 * width])
        gap = (np.interp(record["throttle"].values, lever, schedule) - n)[width:-width]
        rows.append(np.column_stack([record["n2"].values[width:-width], gap, rate]))
    n2, gap, rate = np.concatenate(rows).T
    times, rates = [], []
    for sign, word in ((1.0, "up"), (-1.0, "down")):
        # Far from the schedule and moving towards it: rate = gap / time constant.
        moving = (sign * gap > AWAY) & (sign * rate > 0.0)
        if not moving.any():
            raise IdentificationError(
                f"{name} never moves {word} by more than {AWAY:g}; add a power change that way"
            )
        near = [np.abs(n2[moving] - v) < SPACING for v in at]
        time_constant = (gap / np.where(moving, rate, 1.0))[moving]
        times.append(_local_quantiles(at, near, values=time_constant, level=0.5))
        rates.append(_local_quantiles(at, near, values=sign * rate[moving], level=0.9))
    return (times[0], times[1]), (rates[0], rates[1])


def _local_quantiles(
    at: np.ndarray, near: Sequence[np.ndarray], values: np.ndarray, level: float
) -> np.ndarray:
    """Return the quantile of the values near each point, interpolated where there are too few."""
    points, quantiles = [], []
    for point, part in zip(at, near):
        if part.sum() > 3:
            points.append(point)
            quantiles.append(float(np.quantile(values[part], level)))
    if not points:
        return np.full(len(at), float(np.quantile(values, level)))
    return np.interp(at, points, quantiles)


def reading_noise(records: Sequence[xr.Dataset], name: str) -> float:
    """Return the standard deviation of the noise of a channel, from third differences."""
    change = np.concatenate([np.diff(record[name].values, 3) for record in records])
    # A third difference has 1 + 9 + 9 + 1 = 20 times the variance of a reading.
    return float(_FROM_MEDIAN * np.median(np.abs(change)) / np.sqrt(20.0))

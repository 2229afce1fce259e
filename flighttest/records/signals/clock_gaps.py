"""Gaps of a clock that no interpolation bridges, and the stretches between them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, pairwise

import numpy as np
import xarray as xr

from flightmech.errors import OutOfRange
from flightmech.quantities import time_text
from flighttest.records.signals.resampling import GAP

BRIDGED = 0.5443
"""Longest gap that interpolation bridges; our number. [s]

Rates and attitude of an aeroplane hardly change their course in half a second. In more, an input of
the pilot can begin and end. The number is not a multiple of a usual step of a recorder, so that
the rounding of a clock does not decide.
"""
SHORTEST_STRETCH = 1.0
"""Shortest stretch next to a gap that is used; a shorter one shows no motion. [s]"""

_CONTINUOUS = frozenset(
    {
        *("p", "delta_e", "delta_a", "delta_r", "column", "wheel", "pedal"),
        *("F_column", "F_wheel", "F_pedal"),
    }
)
"""Channels that no recorder samples on change alone."""
_MOST_MISSING = 0.5
"""Largest share of gaps in the clock of a recorder that samples all the time; our number."""


def clock_gaps(time: np.ndarray) -> list[tuple[float, float]]:
    """Return the last instant before and the first one after each gap of a clock. [s]

    Parameters
    ----------
    time : array (time,)
        Rising instants. [s]

    Returns
    -------
    list of (float, float)
        Steps longer than `BRIDGED` seconds and `GAP` median steps, in order.
    """
    clock = np.asarray(time, float)
    if clock.size < 3:
        return []
    steps = np.diff(clock)
    # almost no clock has a long step, and a plan lists the gaps of every channel
    if not (steps > BRIDGED).any():
        return []
    is_gap = (steps > BRIDGED) & (steps > GAP * np.median(steps))
    return [(float(clock[i]), float(clock[i + 1])) for i in np.flatnonzero(is_gap)]


def filled_instants(data: xr.Dataset, names: Sequence[str]) -> np.ndarray:
    """Return the instants with a value of at least one of some channels. [s]

    Blank cells of a table are NaN: a recorder without samples leaves rows out, or leaves them
    blank.

    Parameters
    ----------
    data : Dataset (time,)
        Leaf of a record.
    names : sequence of str
        Its channels that count.
    """
    time = data.variables["time"].values.astype(float)
    return time[_filled_rows(data, names)]


def _filled_rows(data: xr.Dataset, names: Sequence[str]) -> np.ndarray:
    """Return whether at least one of some channels has a value at each instant (time,)."""
    filled = np.zeros(data.sizes["time"], bool)
    for name in names:
        filled |= np.isfinite(data.variables[name].values.astype(float))
    return filled


def sample_gaps(data: xr.Dataset, names: Sequence[str]) -> list[tuple[float, float]]:
    """Return the gaps between the samples of channels; arguments as `filled_instants`. [s]

    A device that is recorded on change, such as a flap, has no samples while it stands still.  Gaps
    in more than half of its time are not a loss, and are not returned.
    """
    return _gaps_of_samples(filled_instants(data, names), names)


def channel_gaps(data: xr.Dataset, name: str) -> list[tuple[float, float]]:
    """Return the gaps of one channel as `sample_gaps`, with those at both ends of its clock. [s]

    A channel that is blank up to the end, while others of its clock have values, has no samples
    there.
    """
    # the index of xarray copies its values at each request
    clock = data.variables["time"].values.astype(float)
    filled = clock[_filled_rows(data, [name])]
    gaps = _gaps_of_samples(filled, [name])
    if filled.size < 3:
        return gaps
    first, last = (clock[0], filled[0]), (filled[-1], clock[-1])
    # a shorter end is bridged whatever the steps of the clock are
    if max(first[1] - first[0], last[1] - last[0]) <= BRIDGED:
        return gaps
    longest = max(BRIDGED, GAP * float(np.median(np.diff(filled))))
    ends = [(float(start), float(stop)) for start, stop in (first, last) if stop - start > longest]
    return sorted([*gaps, *ends])


def _gaps_of_samples(clock: np.ndarray, names: Sequence[str]) -> list[tuple[float, float]]:
    """Return the gaps between the instants (time,) of channels, unless they stood still. [s]"""
    gaps = clock_gaps(clock)
    if not gaps or _CONTINUOUS.intersection(names):
        return gaps
    missing = sum(stop - start for start, stop in gaps)
    return [] if missing > _MOST_MISSING * float(clock[-1] - clock[0]) else gaps


def gap_text(gap: tuple[float, float]) -> str:
    """Return a gap in words.

    Examples
    --------
    >>> gap_text((39.95, 42.0))
    'a gap of 2.05 s in the clock from 39.95 to 42 s'
    """
    start, stop = gap
    return (
        f"a gap of {stop - start:.3g} s in the clock from {time_text(start)} to {time_text(stop)} s"
    )


def gaps_in(
    window: tuple[float, float], gaps: Sequence[tuple[float, float]]
) -> list[tuple[float, float]]:
    """Return the gaps that a window contains or touches the inside of. [s]"""
    return [gap for gap in gaps if window[0] < gap[1] and gap[0] < window[1]]


def split_at_gaps(
    windows: Sequence[tuple[float, float]], gaps: Sequence[tuple[float, float]]
) -> list[tuple[float, float]]:
    """Return the stretches of windows between the gaps of a clock. [s]

    Parameters
    ----------
    windows : sequence of (float, float)
        [s]
    gaps : sequence of (float, float)
        Result of `clock_gaps`. [s]

    Returns
    -------
    list of (float, float)
        In order. A window without a gap is unchanged. Next to a gap, stretches shorter than
        `SHORTEST_STRETCH` are left out.

    Raises
    ------
    OutOfRange
        No stretch of a window is long enough.

    Examples
    --------
    >>> split_at_gaps([(0.0, 80.0)], [(39.95, 42.0)])
    [(0.0, 39.95), (42.0, 80.0)]
    """
    stretches: list[tuple[float, float]] = []
    for window in windows:
        inside = gaps_in(window, gaps)
        if not inside:
            stretches.append(window)
            continue
        # ends of the window and of the gaps in turn: start, gap, gap, ..., stop
        edges = [window[0], *chain.from_iterable(inside), window[1]]
        pieces = list(pairwise(edges))[::2]
        kept = [piece for piece in pieces if piece[1] - piece[0] >= SHORTEST_STRETCH]
        if not kept:
            raise OutOfRange(
                f"window {time_text(window[0])} ... {time_text(window[1])} s; the record has "
                f"{gap_text(inside[0])}, and no stretch of {SHORTEST_STRETCH:g} s without a gap; "
                f"choose another window"
            )
        stretches += kept
    return stretches

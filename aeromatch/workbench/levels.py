"""Channels at the resolution of a screen: smallest and largest value by block, in levels."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import numpy as np

FACTOR = 8
"""Samples of a level that one block of the next level joins."""


class Levels:
    """One channel with its levels.

    Parameters
    ----------
    values : ndarray (samples,)
        NaN where there is no sample.
    """

    def __init__(self, values: np.ndarray) -> None:
        self.values = np.asarray(values, np.float64)
        self._levels: list[tuple[np.ndarray, np.ndarray]] = []

    def level(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Return smallest and largest values of blocks of ``FACTOR ** number`` samples; the last block may be shorter."""
        while len(self._levels) < number:
            low, high = self._levels[-1] if self._levels else (self.values, self.values)
            self._levels.append((_blocks(low, np.fmin), _blocks(high, np.fmax)))
        return self._levels[number - 1] if number else (self.values, self.values)


def _blocks(values: np.ndarray, join: np.ufunc) -> np.ndarray:
    if not len(values):
        return values
    return join.reduceat(values, np.arange(0, len(values), FACTOR))


def level_of(samples: int, points: int) -> int:
    """Return the coarsest level that still has at least `points` blocks for so many samples.

    Examples
    --------
    >>> level_of(1000, 1000), level_of(8000, 1000), level_of(63_999, 1000)
    (0, 1, 1)
    """
    number = 0
    while samples >= points * FACTOR ** (number + 1):
        number += 1
    return number


def traces(
    time: np.ndarray, channels: Mapping[str, Levels], start: float, stop: float, points: int
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return channels of one clock inside a span of time, so that a line through the points looks as through all samples.

    Parameters
    ----------
    time : ndarray (samples,)
        Ascending. [s]
    channels : mapping of str to Levels
    start, stop : float
        One sample more on either side is taken. [s]
    points : int
        Of the screen: at least so many blocks, where there are so many samples.

    Returns
    -------
    time : ndarray (n,)
    values : dict of str to ndarray (n,)
        All samples, or of each block the smallest value at its start and the largest in its middle.
    """
    first = max(int(np.searchsorted(time, start)) - 1, 0)
    last = min(int(np.searchsorted(time, stop, side="right")) + 1, len(time))
    number = level_of(max(last - first, 0), points)
    if number == 0:
        return time[first:last], {name: channel.values[first:last] for name, channel in channels.items()}
    size = FACTOR**number
    blocks = slice(first // size, -(-last // size))
    starts = np.arange(blocks.start, blocks.stop) * size
    middle = np.minimum(starts + size // 2, len(time) - 1)
    places = np.column_stack([time[starts], time[middle]]).ravel()
    found = {name: np.column_stack([part[blocks] for part in channel.level(number)]).ravel() for name, channel in channels.items()}
    return places, found


def packed(groups: Sequence[tuple[dict[str, object], np.ndarray, Mapping[str, np.ndarray]]]) -> bytes:
    """Return traces as bytes for the page.

    Parameters
    ----------
    groups : sequence of (about, time, values)
        One per clock.

    Returns
    -------
    bytes
        Little-endian: length of the head as uint32, the head (JSON, padded by spaces so that the arrays begin at a multiple of 8), then of
        every group the time as float64 and each channel as float64.
    """
    head = [{**about, "samples": len(time), "channels": list(values)} for about, time, values in groups]
    text = json.dumps(head).encode()
    text += b" " * (-(len(text) + 4) % 8)
    arrays = [np.asarray(part, "<f8").tobytes() for _, time, values in groups for part in (time, *values.values())]
    return b"".join([len(text).to_bytes(4, "little"), text, *arrays])

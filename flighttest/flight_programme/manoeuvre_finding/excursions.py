"""A control reduced to its excursions, from one extreme to the next, and the test inputs that
sequences of excursions are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.stats import spearmanr

from flightmech.support.arrays import true_runs

# s from 15 to 85 % of an excursion; a pilot moves a stick between the stops of a test input in 0.2
# to 0.5 s
FAST = 0.8
ISOLATED = 1.5  # s without another excursion before and after a test input
_PAUSE = (
    3.5  # s between excursions of one oscillation: half a period of the lowest frequency, 0.15 Hz
)
_FEWEST = 9  # excursions of an oscillation
_ALIKE = 0.4  # an excursion smaller than this share of the largest does not disturb a test input
# amplitudes of the excursions, durations of the steps between them: [Jategaonkar2015] chapter 2
TEMPLATES = {
    "3211": ((1.0, -2.0, 2.0, -2.0, 1.0), (3.0, 2.0, 1.0, 1.0)),
    "doublet": ((1.0, -2.0, 1.0), (1.0, 1.0)),
    "pulse": ((1.0, -1.0), (1.0,)),
}
_STEP = (0.25, 6.0)  # s, shortest and longest step of a test input


_TIE = 1e-6  # samples of a recorder with coarse steps are equal; rounding decides nothing
_SIZE = 0.35  # largest deviation of a size from its template, of the largest size
_LENGTH = 0.6  # largest deviation of a step, of the unit step
_RAMP = 0.8  # longest 15 to 85 % of an excursion, of the unit step


@dataclass(frozen=True)
class Excursion:
    """Movement from one extreme to the next.

    Attributes
    ----------
    size : float
        Last extreme less first. [of the control]
    start, middle, end : float
        Times at 15, 50 and 85 % of the way. [s]
    """

    size: float
    start: float
    middle: float
    end: float

    @property
    def fast(self) -> bool:
        """Whether it is a step."""
        return self.end - self.start < FAST


@dataclass(frozen=True)
class FoundManoeuvre:
    """One manoeuvre: kind, control, first and last movement [s], confidence 0 to 1."""

    kind: str
    control: str
    start: float
    end: float
    confidence: float


def find_excursions(time: np.ndarray, x: np.ndarray, least: float) -> list[Excursion]:
    """Return the excursions of a signal.

    Parameters
    ----------
    time, x : array (time,)
        [s], [of the control]
    least : float
        Smallest movement that counts; smaller reversals belong to the excursion around them.
    """
    turns = _turning_points(x, least)
    return [_excursion(time[a : b + 1], x[a : b + 1]) for a, b in pairwise(turns)]


def find_movements(time: np.ndarray, x: np.ndarray, least: float) -> list[Excursion]:
    """Return the excursions of a control without the plateaus in them: a step and a drift that
    follows it are two movements.

    Parameters as in `find_excursions`; a control moves where half of `least` is covered in 0.5 s.
    """
    half = max(round(0.25 * (len(time) - 1) / (time[-1] - time[0])), 1)
    ahead, behind = (
        np.append(x[half:], np.full(half, x[-1])),
        np.insert(x[:-half], 0, np.full(half, x[0])),
    )
    turns = _turning_points(x, least)
    found = []
    for a, b in pairwise(turns):
        moving = np.sign(x[b] - x[a]) * (ahead - behind)[a : b + 1] > (0.5 + _TIE) * least
        for first, last in true_runs(moving):
            c, d = max(a + first - half, a), min(a + last + half, b)
            if abs(x[d] - x[c]) >= (1.0 - _TIE) * least:
                found.append(_excursion(time[c : d + 1], x[c : d + 1]))
    return found


def _turning_points(x: np.ndarray, least: float) -> list[int]:
    """Return the samples of the extremes, each at least `least` from the one before."""
    turns, low, high, rising = [], 0, 0, 0
    tie = _TIE * least
    for k, value in enumerate(x):
        if value > x[high] + tie:
            high = k
        if value < x[low] - tie:
            low = k
        if rising >= 0 and x[high] - value >= least - tie:
            turns.append(high)
            rising, low, high = -1, k, k
        elif rising <= 0 and value - x[low] >= least - tie:
            turns.append(low)
            rising, low, high = 1, k, k
    return [*turns, high if rising > 0 else low] if turns else []


def _excursion(time: np.ndarray, x: np.ndarray) -> Excursion:
    way = (x - x[0]) / (x[-1] - x[0])
    first = int(
        np.argmax(way > 0.5 + _TIE)
    )  # the first crossing of the middle; noise on a long plateau is on neither side of it
    before = np.flatnonzero(way[: first + 1] < 0.15 - _TIE)
    after = np.flatnonzero(way[first:] > 0.85 + _TIE)
    start, end = before[-1] if len(before) else 0, first + after[0]
    return Excursion(float(x[-1] - x[0]), float(time[start]), float(time[first]), float(time[end]))


def step_inputs(control: str, found: Sequence[Excursion]) -> list[FoundManoeuvre]:
    """Return 3-2-1-1, doublets and pulses: fast excursions in the proportions of a template,
    nothing else close by.
    """
    inputs: list[FoundManoeuvre] = []
    taken = np.zeros(len(found), bool)
    for kind, (sizes, steps) in TEMPLATES.items():
        count = len(sizes)
        for k in range(len(found) - count + 1):
            part = found[k : k + count]
            if (
                taken[k : k + count].any()
                or not all(one.fast for one in part)
                or _disturbed(found, k, count)
            ):
                continue
            likeness = _likeness(part, sizes, steps)
            if likeness > 0.0:
                taken[k : k + count] = True
                inputs.append(FoundManoeuvre(kind, control, part[0].start, part[-1].end, likeness))
    return inputs


def _likeness(part: Sequence[Excursion], sizes: Sequence[float], steps: Sequence[float]) -> float:
    """Return 1 for excursions exactly in the proportions of a template, 0 for those that are too
    far from it.
    """
    size, step = np.array([one.size for one in part]), np.diff([one.middle for one in part])
    model, lengths = np.array(sizes), np.array(steps)
    scale = (size @ model) / (model @ model)
    unit = (step @ lengths) / (lengths @ lengths)
    if not _STEP[0] <= unit <= _STEP[1] or scale == 0.0:
        return 0.0
    ramp = max(one.end - one.start for one in part) / unit
    worst = max(
        np.abs(size / scale - model).max() / (_SIZE * np.abs(model).max()),
        np.abs(step / unit - lengths).max() / _LENGTH,
        ramp / _RAMP,
    )
    return max(0.0, 1.0 - worst**2)


def _disturbed(found: Sequence[Excursion], k: int, count: int) -> bool:
    """Return whether another excursion that is not small stands next to a test input."""
    largest = max(abs(one.size) for one in found[k : k + count])
    before = [
        found[k].start - one.end
        for one in found[max(k - 1, 0) : k]
        if abs(one.size) > _ALIKE * largest
    ]
    after = [
        one.start - found[k + count - 1].end
        for one in found[k + count : k + count + 1]
        if abs(one.size) > _ALIKE * largest
    ]
    return any(pause < ISOLATED for pause in (*before, *after))


def find_oscillations(
    control: str, found: Sequence[Excursion], most: float
) -> list[tuple[FoundManoeuvre, float]]:
    """Return long alternating movements, and the trend of their half periods, -1 for a sweep
    upwards, 1 for one downwards.

    Parameters
    ----------
    control : str
    found : sequence of Excursion
    most : float
        Half of the excursions are larger than this.
    """
    chains: list[list[Excursion]] = []
    for one in found:
        if chains and one.middle - chains[-1][-1].middle < _PAUSE:
            chains[-1].append(one)
        else:
            chains.append([one])
    waves = []
    for chain in chains:
        if len(chain) >= _FEWEST and np.median([abs(one.size) for one in chain]) > most:
            waves.append(
                (
                    FoundManoeuvre("unknown", control, chain[0].start, chain[-1].end, 0.0),
                    _trend(chain),
                )
            )
    return waves


def _trend(chain: Sequence[Excursion]) -> float:
    """Return the rank correlation of half periods with time; 0 when the frequency changes by less
    than a factor of 1.8.
    """

    half = np.diff([one.middle for one in chain])
    quarter = max(len(half) // 4, 2)
    change = half[:quarter].mean() / half[-quarter:].mean()
    return (
        float(spearmanr(np.arange(len(half)), half).statistic)
        if max(change, 1.0 / change) > 1.8
        else 0.0
    )


def named_oscillations(waves: Sequence[tuple[FoundManoeuvre, float]]) -> list[FoundManoeuvre]:
    """Return oscillations as multisine (several controls over the same time), sweep (a trend of
    frequency), or unknown.
    """
    named: list[FoundManoeuvre] = []
    left = list(waves)
    while left:
        first = left.pop(0)
        group = [first, *(other for other in left if _shared(first[0], other[0]) > 0.8)]
        left = [other for other in left if other not in group]
        control = " ".join(dict.fromkeys(one.control for one, _ in group))
        start, end = min(one.start for one, _ in group), max(one.end for one, _ in group)
        if len(group) > 1:
            kind, confidence = "multisine", min(_shared(first[0], one) for one, _ in group)
        elif abs(first[1]) > 0.8:
            kind, confidence = "sweep", abs(first[1])
        else:
            kind, confidence = "unknown", 0.0
        named.append(FoundManoeuvre(kind, control, start, end, confidence))
    return named


def _shared(one: FoundManoeuvre, other: FoundManoeuvre) -> float:
    """Return the time that two movements share, of the time that they cover together."""
    if one.control == other.control:
        return 0.0
    return max(
        0.0,
        (min(one.end, other.end) - max(one.start, other.start))
        / (max(one.end, other.end) - min(one.start, other.start)),
    )

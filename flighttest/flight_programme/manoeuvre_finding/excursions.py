"""Excursions of a control from extreme to extreme, and the test inputs that they form.

A test input is a sequence of excursions in the proportions of a template. An oscillation is a long
sequence of excursions without a pause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from flightmech.support.arrays import true_runs

# Longest duration of a step from 15 to 85 % of an excursion [s]. A pilot moves a stick between the
# stops of a test input in 0.2 to 0.5 s.
FAST = 0.8
# Time without another excursion before and after a test input [s].
ISOLATED = 1.5
# Longest time between excursions of one oscillation [s]: half a period of the lowest frequency,
# 0.15 Hz.
_PAUSE = 3.5
# Fewest excursions of an oscillation.
_FEWEST = 9
# An excursion smaller than this share of the largest does not disturb a test input.
_ALIKE = 0.4
# Amplitudes of the excursions, and durations of the steps between them: [Jategaonkar2015] chapter 2
TEMPLATES = {
    "3211": ((1.0, -2.0, 2.0, -2.0, 1.0), (3.0, 2.0, 1.0, 1.0)),
    "doublet": ((1.0, -2.0, 1.0), (1.0, 1.0)),
    "pulse": ((1.0, -1.0), (1.0,)),
}
# Shortest and longest unit step of a test input [s].
_STEP = (0.25, 6.0)
# Share of the threshold below which two samples count as equal. A recorder with coarse steps
# repeats values, and rounding must not decide between them.
_TIE = 1e-6
# Largest deviation of a size from its template, as a share of the largest size.
_SIZE = 0.35
# Largest deviation of a step, as a share of the unit step.
_LENGTH = 0.6
# Longest duration from 15 to 85 % of an excursion, as a share of the unit step.
_RAMP = 0.8
# Least rank correlation of half periods with time that makes an oscillation a sweep.
_SWEEP_TREND = 0.8
# Least share of common time of two oscillations of one multisine.
_COMMON_TIME = 0.8


@dataclass(frozen=True)
class Excursion:
    """Movement from one extreme to the next.

    Attributes
    ----------
    size : float
        Last extreme less first. [of the control]
    start, middle, end : float
        Times at 15, 50 and 85 % of the size. [s]
    """

    size: float
    start: float
    middle: float
    end: float

    @property
    def fast(self) -> bool:
        """Whether the excursion is a step."""
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
    turns = _find_turning_points(x, least)
    return [_measure_excursion(time[a : b + 1], x[a : b + 1]) for a, b in pairwise(turns)]


def find_movements(time: np.ndarray, x: np.ndarray, least: float) -> list[Excursion]:
    """Return the excursions of a control without the plateaus in them.

    A step and a drift that follows it are two movements. A control moves where it covers half of
    `least` in 0.5 s. Parameters as in `find_excursions`.
    """
    # samples of 0.25 s, half of the interval over which the rate of the control is judged
    half = max(round(0.25 * (len(time) - 1) / (time[-1] - time[0])), 1)
    ahead = np.append(x[half:], np.full(half, x[-1]))
    behind = np.insert(x[:-half], 0, np.full(half, x[0]))
    movements = []
    for a, b in pairwise(_find_turning_points(x, least)):
        # only samples that move in the direction of the excursion count
        direction = np.sign(x[b] - x[a])
        moving = direction * (ahead - behind)[a : b + 1] > (0.5 + _TIE) * least
        for first, last in true_runs(moving):
            c, d = max(a + first - half, a), min(a + last + half, b)
            if abs(x[d] - x[c]) >= (1.0 - _TIE) * least:
                movements.append(_measure_excursion(time[c : d + 1], x[c : d + 1]))
    return movements


def _find_turning_points(x: np.ndarray, least: float) -> list[int]:
    """Return the indices of the extremes, each at least `least` from the one before."""
    turns: list[int] = []
    # indices of the lowest and the highest sample since the last extreme; `rising` is 0 until the
    # first extreme
    low, high, rising = 0, 0, 0
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
    if not turns:
        return []
    # the movement after the last reversal ends at its extreme, not at the last sample
    turns.append(high if rising > 0 else low)
    return turns


def _measure_excursion(time: np.ndarray, x: np.ndarray) -> Excursion:
    """Return size and times of the samples from one extreme to the next."""
    progress = (x - x[0]) / (x[-1] - x[0])
    # first crossing of the middle; noise on a long plateau is on neither side of the middle
    middle = int(np.argmax(progress > 0.5 + _TIE))
    below = np.flatnonzero(progress[: middle + 1] < 0.15 - _TIE)
    above = np.flatnonzero(progress[middle:] > 0.85 + _TIE)
    start = 0
    if len(below):
        start = below[-1]
    return Excursion(
        size=float(x[-1] - x[0]),
        start=float(time[start]),
        middle=float(time[middle]),
        end=float(time[middle + above[0]]),
    )


def step_inputs(control: str, excursions: Sequence[Excursion]) -> list[FoundManoeuvre]:
    """Return the 3-2-1-1, doublets and pulses of one control.

    Each is a sequence of fast excursions in the proportions of a template, with no other excursion
    close to it.
    """
    inputs: list[FoundManoeuvre] = []
    # an excursion belongs to one input; the templates with more steps have priority
    assigned = np.zeros(len(excursions), bool)
    for kind, (sizes, steps) in TEMPLATES.items():
        count = len(sizes)
        for k in range(len(excursions) - count + 1):
            part = excursions[k : k + count]
            if assigned[k : k + count].any() or not all(step.fast for step in part):
                continue
            if _has_close_neighbour(excursions, k, count=count):
                continue
            likeness = _compare_with_template(part, sizes, steps=steps)
            if likeness > 0.0:
                assigned[k : k + count] = True
                inputs.append(
                    FoundManoeuvre(
                        kind=kind,
                        control=control,
                        start=part[0].start,
                        end=part[-1].end,
                        confidence=likeness,
                    )
                )
    return inputs


def _compare_with_template(
    part: Sequence[Excursion], sizes: Sequence[float], *, steps: Sequence[float]
) -> float:
    """Return 1 for excursions in the proportions of a template, 0 at the largest deviation."""
    size = np.array([step.size for step in part])
    duration = np.diff([step.middle for step in part])
    model, lengths = np.array(sizes), np.array(steps)
    # amplitude and unit step of the template by least squares
    scale = (size @ model) / (model @ model)
    unit = (duration @ lengths) / (lengths @ lengths)
    if not _STEP[0] <= unit <= _STEP[1] or scale == 0.0:
        return 0.0
    ramp = max(step.end - step.start for step in part) / unit
    # each deviation as a share of its largest accepted value
    worst = max(
        np.abs(size / scale - model).max() / (_SIZE * np.abs(model).max()),
        np.abs(duration / unit - lengths).max() / _LENGTH,
        ramp / _RAMP,
    )
    return max(0.0, 1.0 - worst**2)


def _has_close_neighbour(excursions: Sequence[Excursion], k: int, *, count: int) -> bool:
    """Return whether a similar excursion is close to the `count` excursions from number `k`."""
    part = excursions[k : k + count]
    disturbing = _ALIKE * max(abs(step.size) for step in part)
    # A neighbour of similar size in a short pause belongs to the same movement.
    pauses = []
    if k > 0 and abs(excursions[k - 1].size) > disturbing:
        pauses.append(part[0].start - excursions[k - 1].end)
    if k + count < len(excursions) and abs(excursions[k + count].size) > disturbing:
        pauses.append(excursions[k + count].start - part[-1].end)
    return min(pauses, default=np.inf) < ISOLATED


def find_oscillations(
    control: str, excursions: Sequence[Excursion], most: float
) -> list[tuple[FoundManoeuvre, float]]:
    """Return long alternating movements with the trend of their half periods.

    The trend is -1 for a sweep to higher frequencies and 1 for a sweep to lower ones.

    Parameters
    ----------
    control : str
    excursions : sequence of Excursion
    most : float
        Half of the excursions are larger than this.
    """
    chains: list[list[Excursion]] = []
    for excursion in excursions:
        if chains and excursion.middle - chains[-1][-1].middle < _PAUSE:
            chains[-1].append(excursion)
        else:
            chains.append([excursion])
    waves = []
    for chain in chains:
        if len(chain) < _FEWEST or np.median([abs(step.size) for step in chain]) <= most:
            continue
        wave = FoundManoeuvre(
            kind="unknown",
            control=control,
            start=chain[0].start,
            end=chain[-1].end,
            confidence=0.0,
        )
        waves.append((wave, _correlate_half_periods(chain)))
    return waves


def _correlate_half_periods(chain: Sequence[Excursion]) -> float:
    """Return the rank correlation of half periods with time.

    It is 0 if the frequency changes by less than a factor of 1.8.
    """
    half_periods = np.diff([step.middle for step in chain])
    # means of the first and the last quarter, because single half periods scatter
    quarter = max(len(half_periods) // 4, 2)
    change = half_periods[:quarter].mean() / half_periods[-quarter:].mean()
    if not max(change, 1.0 / change) > 1.8:
        return 0.0
    # Imported on first use: a plan finds no manoeuvres, and this part takes half a second.
    return float(scipy.stats.spearmanr(np.arange(len(half_periods)), half_periods).statistic)


def named_oscillations(waves: Sequence[tuple[FoundManoeuvre, float]]) -> list[FoundManoeuvre]:
    """Return oscillations as multisine, sweep or unknown.

    Several controls over the same time are a multisine. A trend of frequency is a sweep.
    """
    named: list[FoundManoeuvre] = []
    remaining = list(waves)
    while remaining:
        first, trend = remaining.pop(0)
        # the oscillations of other controls over the same time belong to the same input
        together = [entry for entry in remaining if _common_share(first, entry[0]) > _COMMON_TIME]
        remaining = [entry for entry in remaining if entry not in together]
        group = [first, *(wave for wave, _ in together)]
        if len(group) > 1:
            kind = "multisine"
            # The share of an oscillation with itself is zero, so the first one takes no part.
            confidence = min(_common_share(first, wave) for wave, _ in together)
        elif abs(trend) > _SWEEP_TREND:
            kind, confidence = "sweep", abs(trend)
        else:
            kind, confidence = "unknown", 0.0
        named.append(
            FoundManoeuvre(
                kind=kind,
                control=" ".join(dict.fromkeys(wave.control for wave in group)),
                start=min(wave.start for wave in group),
                end=max(wave.end for wave in group),
                confidence=confidence,
            )
        )
    return named


def _common_share(first: FoundManoeuvre, second: FoundManoeuvre) -> float:
    """Return the common time of movements of two controls, as a share of the time of both."""
    if first.control == second.control:
        return 0.0
    common = min(first.end, second.end) - max(first.start, second.start)
    covered = max(first.end, second.end) - min(first.start, second.start)
    return max(0.0, common / covered)

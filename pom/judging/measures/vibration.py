"""Frequencies of a vibration: the predominant peaks of the spectrum of flight and device.

Test 3.f.5 of Table A2A (edition 2014, page 65): the predominant frequency spikes of the airplane
data are compared, three of them at least, within 2 Hz; appearance and trend are for people.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from flightmech.support.arrays import rms
from pom.judging.measures.values import apply_tick
from pom.judging.signals import WHO, Comparison
from pom.tolerances.bands import Invalid, Judgement, RowRemark, judge_number
from pom.tolerances.criteria import Criterion

# The rule has no numbers for a peak.  The following ones are our choice.
SEGMENT = 2.0  # [s] of Welch's method: peaks closer than about 1 Hz are one
LOWEST = 1.0  # [Hz] slower motion is flight, not vibration
PROMINENCE = 4.0  # ratio of the spectral density at a peak to that about it, 6 dB
RESOLUTION = 1e-6  # of the largest value, per root of a hertz: less is rounding
PREDOMINANT = 100.0  # ratio of the largest spectral density to that of a peak, 20 dB
LEAST_PEAKS = 3  # of the row
LEAST_SEGMENTS = 8  # half overlapped: fewer leave peaks of chance


def vibration_peaks(time: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the frequencies of the spectral peaks of a signal, the strongest first (peaks,). [Hz]

    Welch's method with Hann windows of 2 s, half overlapped.  A peak stands out by a factor of four
    in spectral density, and is at most a hundred times below the largest one.

    Parameters
    ----------
    time : array (time,)
        Uniform. [s]
    y : array (time,)

    Raises
    ------
    Invalid
        The signal is shorter than eight segments.
    """
    step = float(np.median(np.diff(time)))
    length = round(SEGMENT / step)
    if 2 * time.size // max(length, 1) - 1 < LEAST_SEGMENTS:
        least = 0.5 * (LEAST_SEGMENTS + 1) * SEGMENT
        raise Invalid(f"a spectrum needs {least:.0f} s of vibration, the window has fewer")
    # `scipy.signal` is imported on first use, because few cases are vibrations.
    frequency, density = scipy.signal.welch(y, 1.0 / step, nperseg=length, detrend="linear")
    kept = frequency >= LOWEST
    # rounding of a signal at rest is no vibration
    floor = (RESOLUTION * float(np.abs(y).max())) ** 2 + 1e-300
    level = np.log(np.maximum(density[kept], floor))
    places, _ = scipy.signal.find_peaks(level, prominence=np.log(PROMINENCE))
    strongest = places[np.argsort(-level[places], kind="stable")]
    is_predominant = level[strongest] > level[strongest[:1]] - np.log(PREDOMINANT)
    return frequency[kept][strongest[is_predominant]]


def judge_vibration(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the frequencies of the predominant peaks; a right set waits for an engineer's tick.

    Peaks of flight and model are paired one to one with the least sum of differences.  The third
    smallest difference is judged, so that three peaks at least are within the tolerance.
    """
    time, *runs = match.both(criterion)
    peaks = [vibration_peaks(time, y) for y in runs]
    if peaks[0].size < LEAST_PEAKS:
        raise Invalid(f"{WHO[0]} has {peaks[0].size} frequency peaks; the row compares three")
    pairs = zip(WHO, runs, strict=True)
    sizes = ", ".join(f"{who} {rms(y - y.mean()):.3g} g rms" for who, y in pairs)
    listed = RowRemark("values", f"{_peak_text(WHO[0], peaks[0])}, {_peak_text(WHO[1], peaks[1])}")
    if peaks[1].size < LEAST_PEAKS:
        reason = RowRemark("reason", f"the model has {peaks[1].size} of the three frequency peaks")
        return Judgement("fail", remarks=(reason, listed), at=float(time[0]))
    differences = np.abs(peaks[0][:, np.newaxis] - peaks[1])
    # each peak of the model stands for one peak of the flight
    own, other = scipy.optimize.linear_sum_assignment(differences)
    third = int(np.argsort(differences[own, other], kind="stable")[LEAST_PEAKS - 1])
    outcome = judge_number(
        criterion, float(peaks[0][own[third]]), float(peaks[1][other[third]]), at=float(time[0])
    )
    verdict, text = outcome.verdict, "a tick does not overrule the frequencies"
    if verdict == "pass":
        # appearance and trend are for people
        verdict, text = apply_tick(match.case.ticks.get(criterion.name, ""), [])
    size = RowRemark("method", f"size of the vibration: {sizes}")
    return replace(outcome, verdict=verdict, remarks=(listed, size, RowRemark("tick", text)))


def _peak_text(who: str, peaks: np.ndarray) -> str:
    listed = ", ".join(f"{peak:.1f}" for peak in peaks[:6])
    return f"{who} {listed or 'none'} Hz"

"""Scatter of a model's answer against that of the record: an answer does not hold its noise.

The third differences of a channel hold its scatter from sample to sample.  That of a flight is
mostly noise of instruments, which no simulation can know.  An answer whose scatter is that of the
record, sample by sample, was made from the record.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np
import xarray as xr

from pom.judging.signals import traces_of
from pom.status import UNPROBED, unprobed_remark
from pom.tolerances.bands import RowRemark, unwrapped_difference
from pom.tolerances.channels import quantity_words

CHANNELS = ("p", "q", "r", "nz", "ny", "nx", "theta", "phi", "psi", "alpha", "beta", "V_cas", "h")
LEAST_CHANNELS = 3
LEAST_SAMPLES = 50
NOISE = 0.5
"""Largest correlation of successive third differences of a channel whose scatter is noise.

White noise has -0.75, the records of the T-37 and the C182 -0.78 to 0.3 in rates and accelerations;
a smooth motion at 50 samples per second has nearly 1.
"""
COPIED = 0.5
"""Median correlation of the scatter of answer and record from which on it is a copy.

Copies have 1.00, a controller that follows the record 0.76 and 0.85; honest models of the T-37 and
the C182 have at most 0.12.
"""
_TRACE = 0.05  # scatter of the answer, over that of the record, which noise of the inputs explains
DRIFTING = ("phi", "theta", "psi", "V_cas")
"""Channels in which a small error of a simulation grows slowly.

The altitude is not among them: the slow noise of a static port has the same form.
"""
DRIFTS = 0.4
"""Least correlation of the difference over `LAG`, in the channel where it is largest.

Honest models of the T-37 and the C182 have 0.65 to 1.00, and 0.45 in a force check of the T-37.
Records smoothed over 0.24 s have -0.59 to 0.44 in 19 of 21 windows; phugoid and power change of the
C182 have 0.64 and 0.67, since the noise of their records is slow itself.
"""
LAG = 1.0  # [s]
NOISE_PROBE = "the scatter of the answer against that of the record"
DIFFERENCE_PROBE = "whether flight and model differ by more than noise"
"""Names of the probes in the remarks that they were not made."""
SCATTER, DIFFERENCE = "scatter", "difference"  # quantities of the remarks
_CUT = 4.0  # medians of the scatter, so that steps of the inputs do not decide


class RecordScatter:
    """Scatter of a record, computed once for all models of a case.

    Parameters
    ----------
    flight : mapping of str to array (time,)
        [SI]
    """

    def __init__(self, flight: Mapping[str, np.ndarray]):
        self.flight = flight

    @cached_property
    def noise(self) -> dict[str, np.ndarray | None]:
        """Third differences of the channels without gaps, cut; None where they are not noise."""
        found: dict[str, np.ndarray | None] = {}
        for name in CHANNELS:
            if name in self.flight and np.isfinite(self.flight[name]).all():
                found[name] = noise_of(np.diff(self.flight[name], 3))
        return found

    @cached_property
    def noisy(self) -> frozenset[str]:
        """Channels of `DRIFTING` whose scatter is noise."""
        present = [name for name in DRIFTING if name in self.flight]
        return frozenset(name for name in present if is_noisy(self.flight[name]))


def noise_of(differences: np.ndarray) -> np.ndarray | None:
    """Return third differences without single steps; None unless they are noise, by `NOISE`."""
    recorded = cut_steps(differences)
    if recorded.size < LEAST_SAMPLES or not recorded.std():
        return None
    if np.corrcoef(recorded[1:], recorded[:-1])[0, 1] > NOISE:
        return None
    return recorded


def measure_scatter(
    signals: xr.Dataset, run: str, scatter: RecordScatter | None = None
) -> tuple[RowRemark, ...]:
    """Return the remarks on the scatter of a model, and on its difference from the flight.

    Parameters
    ----------
    signals : Dataset (run, time)
        Of a result.
    run : str
    scatter : RecordScatter, optional
        Of the flight of these signals.

    Returns
    -------
    tuple of RowRemark
        Of kind ``probe``, ``not_driven`` if the scatter is that of the record, ``departure`` for a
        difference of noise alone, or ``not_probed`` if the record has too little noise.
    """
    scatter = scatter or RecordScatter(traces_of(signals, "flight"))
    model = traces_of(signals, run)
    remarks = judge_scatter(scatter, model)
    if any(remark.kind == "not_driven" for remark in remarks):
        return remarks
    return (*remarks, *judge_difference(signals["time"].values.astype(float), scatter, model))


def judge_scatter(scatter: RecordScatter, model: Mapping[str, np.ndarray]) -> tuple[RowRemark, ...]:
    """Return the remark of `measure_scatter` for a record and the traces of a model (time,)."""
    flight = scatter.flight
    ratios, correlations = {}, {}
    for name in CHANNELS:
        if name not in flight or name not in model:
            continue
        answer = np.diff(model[name], 3)
        if name in scatter.noise and np.isfinite(answer).all():
            recorded = scatter.noise[name]
        else:
            differences = np.diff(flight[name], 3)
            is_finite = np.isfinite(differences) & np.isfinite(answer)
            recorded, answer = noise_of(differences[is_finite]), answer[is_finite]
        if recorded is None:
            continue
        answer = cut_steps(answer)
        if not answer.std():
            continue
        ratios[name] = float(answer.std() / recorded.std())
        correlations[name] = float(np.corrcoef(recorded, answer)[0, 1])
    if len(ratios) < LEAST_CHANNELS:
        reason = f"noise in {len(ratios)} channels of the record, {LEAST_CHANNELS} are needed"
        return (unprobed_remark(NOISE_PROBE, reason, SCATTER),)
    ratio = float(np.median([*ratios.values()]))
    correlation = float(np.median([*correlations.values()]))
    text = (
        f"scatter from sample to sample {ratio:.2g} of the record's, correlation with it "
        f"{correlation:.2f} (median of {len(ratios)} channels)"
    )
    values = {"ratio": ratio, "correlation": correlation}
    # An input with noise, such as a recorded thrust, leaves a trace of it in an honest answer.
    if correlation < COPIED or ratio < _TRACE:
        return (RowRemark("probe", text, SCATTER, values=values, unit="1"),)
    reason = f"not driven by the inputs: {text}; the answer holds the noise of the record"
    return (RowRemark("not_driven", reason, SCATTER, values=values, unit="1"),)


def noise_of_inputs(remarks: Iterable[RowRemark]) -> tuple[RowRemark, ...]:
    """Return remarks in which the scatter of a model that answers by its tables proves nothing.

    Tables over flight condition and controls cannot hold a flight, so the noise in the answer came
    with the recorded inputs.
    """
    explained = []
    for remark in remarks:
        # this probe would prove nothing here, so that its absence is not stated
        if remark.kind == UNPROBED and remark.quantity in (SCATTER, DIFFERENCE):
            continue
        if remark.kind == "not_driven" and "correlation" in remark.values:
            text = remark.text.removeprefix("not driven by the inputs: ").partition(";")[0]
            text += "; the answer is that of the tables in the FMU, so its noise is of the inputs"
            remark = replace(remark, kind="probe", text=text)
        explained.append(remark)
    return tuple(explained)


# Motion of a channel, over the difference of flight and model, that a copy would follow.
_MOTION = 5.0


def judge_difference(
    time: np.ndarray, scatter: RecordScatter, model: Mapping[str, np.ndarray]
) -> tuple[RowRemark, ...]:
    """Return the remark on a difference of flight and model that is nothing but noise.

    Errors of a simulation are integrated: they grow and decay slowly.  The difference of a record
    and a smoothed copy is the noise of the record, which is not correlated over a second.

    Parameters
    ----------
    time : array (time,)
        [s]
    scatter : RecordScatter
    model : mapping of str to array (time,)
        [SI]

    Returns
    -------
    tuple of RowRemark
        Of kind ``probe`` or ``departure``, or ``not_probed`` if fewer than `LEAST_CHANNELS`
        channels of the record hold noise and move.
    """
    count = round(LAG / float(np.median(np.diff(time)))) if time.size > LEAST_SAMPLES else 0
    if not 0 < count < time.size // 2:
        reason = f"the window has less than {2.0 * LAG:g} s or {LEAST_SAMPLES} samples"
        return (unprobed_remark(DIFFERENCE_PROBE, reason, DIFFERENCE),)
    flight = scatter.flight
    correlations = {}
    for name in DRIFTING:
        if name not in model or name not in scatter.noisy:
            continue
        difference = unwrapped_difference(name, flight[name], model[name])
        difference = difference - difference.mean()
        if not np.isfinite(difference).all() or not difference.std():
            continue
        if flight[name].std() < _MOTION * difference.std():
            # Without motion an honest model leaves the noise alone, too.
            continue
        # autocorrelation: lag covariance over the variance, both as means over their samples
        covariance = float(np.mean(difference[count:] * difference[:-count]))
        correlations[name] = covariance / float(np.var(difference))
    if len(correlations) < LEAST_CHANNELS:
        reason = (
            f"{len(correlations)} of {len(DRIFTING)} channels of attitude and speed hold noise and "
            f"move, {LEAST_CHANNELS} are needed"
        )
        return (unprobed_remark(DIFFERENCE_PROBE, reason, DIFFERENCE),)
    largest = max(correlations.values())
    listed = ", ".join(
        f"{quantity_words(name)} {value:.2f}" for name, value in correlations.items()
    )
    text = f"difference of flight and model over {LAG:g} s correlated by {listed}"
    if largest >= DRIFTS:
        return (RowRemark("probe", text, DIFFERENCE, values=correlations, unit="1"),)
    reason = (
        f"departure: {text}: nothing but the noise of the record, which no simulation leaves. "
        f"Check whether the answer was made from the record, or the record by the model"
    )
    return (RowRemark("departure", reason, DIFFERENCE, values=correlations, unit="1"),)


def is_noisy(trace: np.ndarray) -> bool:
    """Return whether the scatter of a recorded channel is noise, by `NOISE`."""
    scatter = np.diff(trace, 3)
    if scatter.size < LEAST_SAMPLES or not np.isfinite(scatter).all() or not scatter.std():
        return False
    return float(np.corrcoef(scatter[1:], scatter[:-1])[0, 1]) <= NOISE


def cut_steps(differences: np.ndarray) -> np.ndarray:
    """Return differences without the sizes of single steps."""
    if not differences.size:
        return differences
    limit = _CUT * float(np.median(np.abs(differences)))
    return np.clip(differences, -limit, limit)

"""A replay with longer steps than the samples of the record, and its outputs at these samples.

An internal step cannot be longer than the time between two samples of the inputs, so a job is thinned first.  All samples are kept where
an input jumps, such as a brake that is released: what sticks or slips does so at that time.  Elsewhere each input that is kept is the mean
of those around it, weighed by the hat function that reaches to the neighbours that are kept: joined by lines, they have the integral of
the recorded ones, and what a record scatters from sample to sample does not enter as what it happened to be at every fourth.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from ..cases.job import Job
from ..tolerances.parameter_channels import WRAPPED

JUMP = 10.0  # second differences of an input above so many of their medians, and above `LEAST_JUMP` of its range, are a jump
LEAST_JUMP = 0.02
LEAST_RANGE = 1e-6  # [SI] of an input: what is below is rounding, as a wind that blows level


def thinned(job: Job, step: float) -> Job:
    """Return a job whose samples are as far apart as they can be within `step` [s], which becomes its longest internal step.

    First and last sample stay as they are: the model is trimmed on the one and ends on the other.  A math pilot keeps all samples.
    """
    parameters = {**job.parameters, "mode.step": step}
    count = job.time.size
    every = 1 if job.pilot or count < 2 else int(step / float(np.median(np.diff(job.time))) * (1.0 + 1e-6))
    if every < 2 or count < 2 * every:
        return replace(job, parameters=parameters)
    kept = np.unique([*range(0, count, every), count - 1, *_jumps(job.inputs.values())])
    before, share = _between(kept, np.arange(count))
    weight = _hats(before, share, np.ones(count), kept.size)
    inputs = {}
    for name, values in job.inputs.items():
        mean = _hats(before, share, values, kept.size) / weight
        mean[[0, -1]] = values[[0, -1]]
        inputs[name] = mean
    return replace(job, time=job.time[kept], inputs=inputs, parameters=parameters)


def _jumps(inputs: Iterable[np.ndarray]) -> np.ndarray:
    """Return the samples next to which an input jumps, and that sample itself."""
    found = [np.empty(0, int)]
    for values in inputs:
        bend = np.abs(np.diff(values, 2))
        found.append(1 + np.flatnonzero(bend > np.fmax(JUMP * np.median(bend), LEAST_JUMP * max(np.ptp(values), LEAST_RANGE))))
    at = np.concatenate(found)
    return np.concatenate([at - 1, at, at + 1])


def _between(kept: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return behind which of the kept places each wanted one lies, and which share of the way to the next."""
    before = np.clip(np.searchsorted(kept, wanted, side="right") - 1, 0, kept.size - 2)
    return before, (wanted - kept[before]) / np.diff(kept)[before]


def _hats(before: np.ndarray, share: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Return the sums of values (sample,) weighed by the hat functions (count,) at the kept samples."""
    return np.bincount(before, (1.0 - share) * values, count) + np.bincount(before + 1, share * values, count)


def at_samples(outputs: Mapping[str, np.ndarray], kept: np.ndarray, time: np.ndarray) -> dict[str, np.ndarray]:
    """Return outputs (run, kept) by name at all samples (run, time), along lines; angles the way round that is below half a turn."""
    if kept.size == time.size:
        return dict(outputs)
    before, share = _between(kept, time)
    found = {}
    for name, values in outputs.items():
        rise = np.diff(values, axis=1)
        if name in WRAPPED:
            rise = np.angle(np.exp(1j * rise))
        found[name] = values[:, before] + share * rise[:, before]
    return found

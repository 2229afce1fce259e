"""A replay with longer steps than the samples of the record, and its outputs at these samples.

An internal step cannot be longer than the time between two samples of the inputs, so a job is thinned first.  Each input that is kept is
the mean of those around it, weighed by the hat function that reaches to the neighbours that are kept: joined by lines, they have the
integral of the recorded ones, and what a record scatters from sample to sample does not enter as what it happened to be at every fourth.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..cases.job import Job
from ..tolerances.parameter_channels import WRAPPED


def thinned(job: Job, step: float) -> Job:
    """Return a job whose samples are as far apart as they can be within `step` [s], which becomes its longest internal step.

    First and last sample stay as they are: the model is trimmed on the one and ends on the other.  A math pilot keeps all samples.
    """
    parameters = {**job.parameters, "mode.step": step}
    count, spacing = job.time.size, float(np.median(np.diff(job.time)))
    every = 1 if job.pilot else int(step / spacing * (1.0 + 1e-6))
    if every < 2 or count < 2 * every:
        return replace(job, parameters=parameters)
    kept = np.unique([*range(0, count, every), count - 1])
    hat = np.convolve(np.ones(every), np.ones(every))
    weight = np.convolve(np.ones(count), hat, "same")
    inputs = {}
    for name, values in job.inputs.items():
        mean = np.convolve(values, hat, "same") / weight
        mean[[0, -1]] = values[[0, -1]]
        inputs[name] = mean[kept]
    return replace(job, time=job.time[kept], inputs=inputs, parameters=parameters)


def at_samples(name: str, values: np.ndarray, kept: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return outputs (run, kept) at all samples (run, time), along lines; of an angle the way round that is below half a turn."""
    if kept.size == time.size:
        return values
    before = np.clip(np.searchsorted(kept, time, side="right") - 1, 0, kept.size - 2)
    share = (time - kept[before]) / np.diff(kept)[before]
    rise = np.diff(values, axis=1)
    if name in WRAPPED:
        rise = np.angle(np.exp(1j * rise))
    return values[:, before] + share * rise[:, before]

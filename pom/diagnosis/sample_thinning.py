"""Jobs with fewer samples for swap runs, and outputs interpolated to all samples."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from flightmech.names import WRAPPED
from pom.cases.job import ReplayJob

# An input jumps where its second difference exceeds both limits.
JUMP = 10.0  # medians of the second differences of the input
LEAST_JUMP = 0.02  # of the range of the input
LEAST_RANGE = 1e-6  # [SI] Smaller ranges are rounding errors, for example of a steady wind.


def thin_job(job: ReplayJob, step: float) -> ReplayJob:
    """Return a job with the largest sample spacing within `step`.

    `step` [s] also becomes the longest internal step. The first and the last sample stay: the
    model is trimmed at the first and ends at the last. Samples next to a jump of an input stay.
    A job with a math pilot keeps all samples.
    """
    parameters = {**job.parameters, "mode.step": step}
    count = job.time.size
    every = 1
    if not job.pilot and count >= 2:
        every = int(step / float(np.median(np.diff(job.time))) * (1.0 + 1e-6))
    if every < 2 or count < 2 * every:
        return replace(job, parameters=parameters)
    nodes = np.unique([*range(0, count, every), count - 1, *_find_jumps(job.inputs.values())])
    before, share = _locate_samples(nodes, np.arange(count))
    # Each node gets the mean of the input around it, weighted by the hat function of the node.
    weight = _sum_hat_weighted(before, share, np.ones(count), nodes.size)
    inputs = {}
    for name, values in job.inputs.items():
        mean = _sum_hat_weighted(before, share, values, nodes.size) / weight
        mean[[0, -1]] = values[[0, -1]]
        inputs[name] = mean
    return replace(job, time=job.time[nodes], inputs=inputs, parameters=parameters)


def _find_jumps(inputs: Iterable[np.ndarray]) -> np.ndarray:
    """Return the samples at which an input jumps, and their neighbours."""
    jumps = [np.empty(0, int)]
    for values in inputs:
        bend = np.abs(np.diff(values, 2))
        limit = np.fmax(JUMP * np.median(bend), LEAST_JUMP * max(np.ptp(values), LEAST_RANGE))
        # Second difference i is centred on sample i + 1.
        jumps.append(1 + np.flatnonzero(bend > limit))
    samples = np.concatenate(jumps)
    return np.concatenate([samples - 1, samples, samples + 1])


def _locate_samples(nodes: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the index of the node before each position, and the share of the interval behind
    it.
    """
    before = np.clip(np.searchsorted(nodes, positions, side="right") - 1, 0, nodes.size - 2)
    return before, (positions - nodes[before]) / np.diff(nodes)[before]


def _sum_hat_weighted(
    before: np.ndarray, share: np.ndarray, values: np.ndarray, count: int
) -> np.ndarray:
    """Return the sums of values (sample,), weighted by the hat functions of the nodes (count,)."""
    return np.bincount(before, (1.0 - share) * values, count) + np.bincount(
        before + 1, share * values, count
    )


def at_samples(
    outputs: Mapping[str, np.ndarray], kept: np.ndarray, time: np.ndarray
) -> dict[str, np.ndarray]:
    """Interpolate outputs linearly to all samples; angles along the shorter arc.

    Parameters
    ----------
    outputs : mapping of str to array (run, node)
    kept : array (node,)
        Times of the outputs. [s]
    time : array (time,)
        Times of all samples. [s]

    Returns
    -------
    dict of str to array (run, time)
    """
    if kept.size == time.size:
        return dict(outputs)
    before, share = _locate_samples(kept, time)
    interpolated = {}
    for name, values in outputs.items():
        rise = np.diff(values, axis=1)
        if name in WRAPPED:
            rise = np.angle(np.exp(1j * rise))
        interpolated[name] = values[:, before] + share * rise[:, before]
    return interpolated

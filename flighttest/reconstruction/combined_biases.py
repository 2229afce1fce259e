"""Constants of the instruments from several runs together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, SchemaError
from flighttest.reconstruction.problem.problem import PER_RUN, invert_covariance

# Tolerances within which two priors count as the same: relative, of means and of variances, and
# absolute, of variances.
_SAME_MEAN = 1e-9
_SAME_VARIANCE = 1e-6
_LEAST_VARIANCE = 1e-8
# A run takes part in the spread of a constant if its standard error is below this share of the
# prior one.
_INFORMED = 0.5


def combine_biases(paths: Sequence[Any]) -> xr.Dataset:
    """Return the constants of the instruments from all runs together.

    Parameters
    ----------
    paths : sequence of FlightPath, or of their ``biases``
        Reconstructions that started from the same prior, which is counted once.

    Returns
    -------
    Dataset (parameter,)
        As ``FlightPath.biases``, without the constants of a single run (wind, reference pressure),
        and with ``spread``: the rms over the runs of (run - combined)/(standard error of the
        difference). It is about 1 if the runs agree.

    Raises
    ------
    SchemaError
        There is no path, or the paths have different priors.
    IdentificationError
        The runs contradict their prior so much that no combination exists.

    Notes
    -----
    Run i adds the information P_i^-1 - P_0^-1 of its marginal posterior. Constants that a run in
    turbulence held are not counted for that run.
    """
    return combine_runs([run_information(getattr(path, "biases", path)) for path in paths])


@dataclass(frozen=True)
class RunInformation:
    """Information of one run on the instruments, as plain arrays.

    Attributes
    ----------
    names, units : list of str (n,)
        Constants, without the constants of a single run.
    estimate, stderr, prior, prior_stderr : array (n,)
    held : array of bool (n,)
        Constants that stayed at their prior.
    covariance : array (n, n)
        Prior covariance.
    free : array of int (m,)
        Indices of the constants that were estimated.
    information : array (m, m)
        Information that the run adds on the estimated constants.
    vector : array (m,)
        The same information times its estimate.
    """

    names: list[str]
    units: list[str]
    estimate: np.ndarray
    stderr: np.ndarray
    prior: np.ndarray
    prior_stderr: np.ndarray
    held: np.ndarray
    covariance: np.ndarray
    free: np.ndarray
    information: np.ndarray
    vector: np.ndarray


def run_information(biases: xr.Dataset) -> RunInformation:
    """Return the information in the ``biases`` of a run on the instruments."""
    constants = instrument_constants(biases)
    estimate, prior = constants["estimate"].values, constants["prior"].values
    stderr, prior_stderr = constants["stderr"].values, constants["prior_stderr"].values
    held = constants["held"].values
    free = np.flatnonzero(~held)
    block = np.ix_(free, free)
    prior_covariance = _covariance(prior_stderr, constants["prior_correlation"].values)
    posterior_covariance = _covariance(stderr, constants["correlation"].values)
    # marginal information of posterior and prior on the estimated constants
    after = invert_covariance(posterior_covariance[block])
    before = invert_covariance(prior_covariance[block])
    vector = after @ estimate[free] - before @ prior[free]
    information, vector = _keep_gained_information(after - before, vector, prior_stderr[free])
    return RunInformation(
        names=[str(name) for name in constants["parameter"].values],
        units=[str(unit) for unit in constants["unit"].values],
        estimate=estimate,
        stderr=stderr,
        prior=prior,
        prior_stderr=prior_stderr,
        held=held,
        covariance=prior_covariance,
        free=free,
        information=information,
        vector=vector,
    )


def _keep_gained_information(
    information: np.ndarray, vector: np.ndarray, scale: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the information that a run has gained, without directions in which it has none.

    Standard errors that were widened for coloured residuals may exceed those of the prior. A run
    never knows less than its prior; it has no information in such a direction.

    Parameters
    ----------
    information : array (n, n)
        Posterior less prior information.
    vector : array (n,)
        Product of information and estimate.
    scale : array (n,)
        Prior standard errors, which make the directions comparable.
    """
    gains, directions = np.linalg.eigh(information * np.outer(scale, scale))
    gained = gains > 0.0
    if gained.all():
        return information, vector
    kept = directions[:, gained]
    scaled = (kept * gains[gained]) @ kept.T
    return scaled / np.outer(scale, scale), kept @ (kept.T @ (vector * scale)) / scale


def combine_runs(runs: Sequence[RunInformation]) -> xr.Dataset:
    """Return the constants from these runs together, see `combine_biases`."""
    if not runs:
        raise SchemaError("combination of biases", ["no reconstruction given; give one at least"])
    index: dict[str, int] = {}
    for run in runs:
        for name in run.names:
            index.setdefault(name, len(index))
    names = list(index)
    # indices of the constants of each run among all constants
    indices = []
    for run in runs:
        indices.append(np.array([index[name] for name in run.names]))
    prior_mean, prior, units = _common_prior(runs, indices, names)
    prior_information = invert_covariance(prior)
    information, vector = prior_information.copy(), prior_information @ prior_mean
    for run, positions in zip(runs, indices, strict=True):
        free = positions[run.free]
        information[np.ix_(free, free)] += run.information
        vector[free] += run.vector
    covariance = invert_covariance(information)
    if not (np.diag(covariance) > 0.0).all():
        raise IdentificationError(
            "the runs contradict each other and their prior; look at the spread of single "
            "constants before you combine them"
        )
    mean = covariance @ vector
    stderr, prior_stderr = np.sqrt(np.diag(covariance)), np.sqrt(np.diag(prior))
    square = ("parameter", "parameter_")
    return xr.Dataset(
        {
            "estimate": ("parameter", mean),
            "stderr": ("parameter", stderr),
            "prior": ("parameter", prior_mean),
            "prior_stderr": ("parameter", prior_stderr),
            "unit": ("parameter", units),
            "held": ("parameter", np.zeros(len(names), bool)),
            "spread": ("parameter", _spread(runs, indices, mean, stderr)),
            "correlation": (square, covariance / np.outer(stderr, stderr)),
            "prior_correlation": (square, prior / np.outer(prior_stderr, prior_stderr)),
        },
        coords={"parameter": names, "parameter_": names},
        attrs={"runs": len(runs)},
    )


def instrument_constants(found: xr.Dataset) -> xr.Dataset:
    """Return the constants without the constants of a single run (wind, reference pressure)."""
    shared = [name not in PER_RUN for name in map(str, found["parameter"].values)]
    return found.isel(parameter=shared, parameter_=shared)


def _covariance(stderr: np.ndarray, correlation: np.ndarray) -> np.ndarray:
    return correlation * np.outer(stderr, stderr)


def _common_prior(
    runs: Sequence[RunInformation], indices: Sequence[np.ndarray], names: list[str]
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return mean, covariance and units of the prior that all runs have in common."""
    mean = np.full(len(names), np.nan)
    covariance = np.zeros((len(names), len(names)))
    units = [""] * len(names)
    problems = set()
    for run, positions in zip(runs, indices, strict=True):
        # compare with the prior of the runs before; NaN is a constant that they do not have
        is_set = np.isfinite(mean[positions])
        variance, run_variance = np.diag(covariance)[positions], np.diag(run.covariance)
        same_mean = np.abs(mean[positions] - run.prior) <= _SAME_MEAN * np.abs(run.prior)
        tolerance = _SAME_VARIANCE * np.abs(run_variance) + _LEAST_VARIANCE
        same_variance = np.abs(variance - run_variance) <= tolerance
        for i in positions[is_set & ~(same_mean & same_variance)]:
            problems.add(
                f"{names[i]}: two runs started from different priors; reconstruct them with the "
                f"same one"
            )
        mean[positions] = run.prior
        covariance[np.ix_(positions, positions)] = run.covariance
        for i, unit in zip(positions, run.units, strict=True):
            units[i] = unit
    if problems:
        raise SchemaError("combination of biases", sorted(problems))
    return mean, covariance, units


def _spread(
    runs: Sequence[RunInformation],
    indices: Sequence[np.ndarray],
    mean: np.ndarray,
    stderr: np.ndarray,
) -> np.ndarray:
    """Return the rms normalised deviation of the runs from their combination (n,).

    It is NaN for a constant that fewer than two runs determine.
    """
    deviations: list[list[float]] = [[] for _ in mean]
    for run, positions in zip(runs, indices, strict=True):
        # The run is part of the combination, so the variance of the difference is the difference of
        # the variances.
        variance = run.stderr**2 - stderr[positions] ** 2
        informed = ~run.held & (run.stderr < _INFORMED * run.prior_stderr) & (variance > 0.0)
        for j in np.flatnonzero(informed).tolist():
            difference = float(run.estimate[j] - mean[positions[j]])
            deviations[positions[j]].append(difference / np.sqrt(variance[j]))
    spread = np.full(len(mean), np.nan)
    for i, values in enumerate(deviations):
        if len(values) > 1:
            spread[i] = np.sqrt(np.mean(np.square(values)))
    return spread

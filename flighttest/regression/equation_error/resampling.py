"""Repetitions of an identification: bootstrap of one fit, Monte Carlo over simulated records.

joblib distributes the work. On one machine `jobs` is the number of processes. Inside ``with
joblib.parallel_config(backend="dask"):`` the same calls run on the workers of a dask.distributed
cluster.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from joblib import delayed, effective_n_jobs

from flightmech.errors import IdentificationError
from flightmech.short_text import ShortText
from flightmech.support.kept_stages.sharing import process_pool
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.samples import RegressionSamples
from flighttest.regression.uncertainty.coloured_residuals import estimate_disturbances
from flighttest.remarks import TabledEstimates

FEWEST = 20  # replicates or seeds
_BATCHES = 4  # batches per process: a task must take longer than its transfer to the process
_WITHIN = 2.0  # standard errors of the coverage
_FIGURES = ("estimate", "stderr", "stderr_white")  # of a run


@dataclass(frozen=True)
class Bootstrap(ShortText, TabledEstimates):
    """Estimates of one fit with repeatedly drawn disturbances.

    Attributes
    ----------
    fit : Fit
    estimates : Dataset (term, term_)
        ``estimate`` (of the fit), ``stderr`` (scatter of the replicates), ``stderr_white`` (of the
        fit), ``covariance``, ``correlation``, ``bias`` (mean of the replicates less the fit),
        ``low`` and ``high`` (2.5 and 97.5 %).
    replicates : DataArray (replicate, term)
    """

    fit: Fit
    estimates: xr.Dataset
    replicates: xr.DataArray

    def report(self) -> str:
        """Return scatter and limits as a text table next to the errors of the fit."""
        e = self.estimates
        lines = [
            f"{self.fit.name or self.fit.model}: {self.replicates.sizes['replicate']} replicates",
            f"{'term':<18}{'estimate':>11}{'stderr':>10}{'of fit':>10}{'ratio':>7}{'bias':>10}"
            f"{'2.5 %':>11}{'97.5 %':>11}",
        ]
        for k, term in enumerate(e["term"].values):
            fit_stderr, stderr = float(self.fit.estimates["stderr"][k]), float(e["stderr"][k])
            # ratio of the scatter of the replicates to the reported standard error
            ratio = stderr / fit_stderr if fit_stderr else np.nan
            lines.append(
                f"{term!s:<18}{float(e['estimate'][k]):>11.5g}{stderr:>10.2g}{fit_stderr:>10.2g}"
                f"{ratio:>7.2f}{float(e['bias'][k]):>10.2g}{float(e['low'][k]):>11.5g}"
                f"{float(e['high'][k]):>11.5g}"
            )
        return "\n".join(lines)


@dataclass(frozen=True)
class MonteCarlo(ShortText, TabledEstimates):
    """Estimates from many simulated records, compared with the truth.

    Attributes
    ----------
    estimates : Dataset (term)
        ``truth``, ``estimate`` (mean), ``bias``, ``bias_stderr``, ``scatter``, ``stderr`` (root
        mean square of the reported standard errors), ``coverage`` (share within two reported
        standard errors), ``coverage_white``.
    runs : Dataset (run, term)
        ``estimate``, ``stderr``, ``stderr_white``.
    """

    estimates: xr.Dataset
    runs: xr.Dataset

    @property
    def coverage(self) -> float:
        """Share of all estimates within two reported standard errors of the truth."""
        return float(self.estimates["coverage"].mean())

    def report(self) -> str:
        """Return bias and coverage as a text table."""
        e = self.estimates
        lines = [
            f"{self.runs.sizes['run']} runs, {100 * self.coverage:.1f} % of the estimates "
            f"within two standard errors",
            f"{'term':<18}{'truth':>11}{'mean':>11}{'bias/se':>9}{'scatter':>10}{'stderr':>10}"
            f"{'coverage':>10}{'white':>8}",
        ]
        for k, term in enumerate(e["term"].values):
            row = {str(name): float(item[k]) for name, item in e.data_vars.items()}
            lines.append(
                f"{term!s:<18}{row['truth']:>11.5g}{row['estimate']:>11.5g}"
                f"{row['bias'] / row['bias_stderr']:>9.1f}{row['scatter']:>10.2g}"
                f"{row['stderr']:>10.2g}{100 * row['coverage']:>8.1f} "
                f"%{100 * row['coverage_white']:>6.0f} %"
            )
        return "\n".join(lines)


def monte_carlo(
    identify: Callable[[int], Any], truth: dict[str, float], seeds: Sequence[int], jobs: int = -1
) -> MonteCarlo:
    """Identify many simulated records and compare the estimates with the truth.

    Parameters
    ----------
    identify : callable
        seed -> a result with ``estimates`` (a fit, a selection ...) from a record that is simulated
        with that seed. A cluster must be able to import it.
    truth : mapping
        True value of every term of interest.
    seeds : sequence of int
        One run each; at least twenty.
    jobs : int
        Processes; -1 for one per core.

    Returns
    -------
    MonteCarlo

    Raises
    ------
    IdentificationError
        Too few seeds, or a term of the truth that the runs do not estimate.
    """
    if len(seeds) < FEWEST:
        raise IdentificationError(
            f"{len(seeds)} seeds; {FEWEST} at least, and 200 to distinguish 95 % from 92 %"
        )
    batches = _divide_into_batches(list(seeds), jobs)
    results = process_pool(jobs)(
        delayed(_identify_records)(identify, list(truth), batch) for batch in batches
    )
    table = np.concatenate(results)  # (run, figure, term)
    columns = {name: (("run", "term"), table[:, k]) for k, name in enumerate(_FIGURES)}
    runs = xr.Dataset(columns, coords={"run": list(seeds), "term": list(truth)})
    true = np.array(list(truth.values()))
    errors = runs["estimate"].values - true
    # The scatter is about the mean of the runs, the coverage about the truth.
    scatter = errors.std(axis=0, ddof=1)
    estimates = xr.Dataset(
        {
            "truth": ("term", true),
            "estimate": runs["estimate"].mean("run"),
            "bias": ("term", errors.mean(axis=0)),
            "bias_stderr": ("term", scatter / np.sqrt(len(table))),
            "scatter": ("term", scatter),
            "stderr": np.sqrt((runs["stderr"] ** 2).mean("run")),
            "coverage": ("term", _coverage(errors, runs["stderr"].values)),
            "coverage_white": ("term", _coverage(errors, runs["stderr_white"].values)),
        }
    )
    return MonteCarlo(estimates, runs)


def _coverage(errors: np.ndarray, stderr: np.ndarray) -> np.ndarray:
    """Return the share of the runs (run, term) within two standard errors, (term,)."""
    return (np.abs(errors) < _WITHIN * stderr).mean(axis=0)


def bootstrap(fit: Fit, replicates: int = 200, seed: int = 0, jobs: int = 1) -> Bootstrap:
    """Draw disturbances with the colour of the residual, and estimate again.

    Parameters
    ----------
    fit : Fit
        In time or in frequency, weighted or not.
    replicates : int
        At least twenty.
    seed : int
        Seed of the draws. Replicate k has a generator of its own, so that the result does not
        depend on the number of processes.
    jobs : int
        Processes; -1 for one per core. More than one process is faster from a hundred thousand
        samples on.

    Returns
    -------
    Bootstrap

    Raises
    ------
    IdentificationError
        Too few replicates, or published values without samples.

    Notes
    -----
    A parametric bootstrap [Efron1993]_: each stretch without a gap gets a disturbance of the colour
    that `estimate_disturbances` returns, with the size of its own residual. A constant that differs
    between stretches is drawn too.

    References
    ----------
    .. [Efron1993] Efron, Tibshirani, An Introduction to the Bootstrap, 1993.
    """
    if replicates < FEWEST:
        raise IdentificationError(
            f"{replicates} replicates; {FEWEST} at least, and 1000 for limits of 95 %"
        )
    if "time" not in fit.data:
        raise IdentificationError(
            f"{fit.name or fit.model}: published values have no residuals to draw from; give "
            f"a fit of samples"
        )
    simulator = _ResidualSimulator(fit)
    batches = _divide_into_batches(list(range(replicates)), jobs)
    draws = process_pool(jobs)(delayed(simulator.draw)(seed, batch) for batch in batches)
    changes = np.concatenate(draws)  # (replicate, term)
    theta = fit.estimates["estimate"].values
    terms = [str(term) for term in fit.estimates["term"].values]
    # limits of the replicates, not of a normal distribution
    low, high = np.quantile(changes, [0.025, 0.975], axis=0)
    variables = {
        "bias": ("term", changes.mean(axis=0)),
        "low": ("term", theta + low),
        "high": ("term", theta + high),
    }
    estimates = least_squares.regression_estimates(
        terms,
        theta,
        covariance=np.atleast_2d(np.cov(changes.T)),
        white=fit.estimates["stderr_white"].values,
        systematic=([], np.zeros((len(terms), 0))),
        extra=variables,
    )
    repeated = xr.DataArray(theta + changes, dims=("replicate", "term"), coords={"term": terms})
    return Bootstrap(fit, estimates, repeated)


class _ResidualSimulator:
    """Disturbances like the residual of a fit, and the changes of the estimates by them."""

    def __init__(self, fit: Fit):
        time, number = fit.data["time"].values, fit.data["manoeuvre"].values
        # The data of a fit do not contain the sampling intervals: they are the median steps.
        steps = []
        for k in range(int(number.max()) + 1):
            times = time[number == k]
            step = 1.0
            if len(times) > 1:
                step = float(np.median(np.diff(times)))
            steps.append(step)
        self.pieces, steps = RegressionSamples(fit.data, steps).pieces()
        self.estimator = least_squares.estimator_matrix(fit.design.values)
        self.offset = float(fit.estimates.attrs.get("offset", 0.0))
        self.disturbances = estimate_disturbances(
            fit.regressors.values, fit.residual, pieces=self.pieces, steps=steps
        )

    def draw(self, seed: int, numbers: Sequence[int]) -> np.ndarray:
        """Return the changes of the estimates of some replicates, (numbers, terms)."""
        changes = []
        for number in numbers:
            changes.append(self._draw_change(np.random.default_rng([seed, number])))
        return np.stack(changes)

    def _draw_change(self, rng: np.random.Generator) -> np.ndarray:
        """Return the change of the estimates by one disturbance, (terms,)."""
        v = np.empty(self.estimator.shape[1])
        for piece, disturbance in zip(self.pieces, self.disturbances):
            # The offset is a constant per stretch, on top of the coloured disturbance.
            noise = disturbance.sample(piece.stop - piece.start, rng)
            v[piece] = noise + self.offset * rng.normal()
        return self.estimator @ v


def _identify_records(
    identify: Callable[[int], Any], terms: list[str], seeds: Sequence[int]
) -> np.ndarray:
    """Return estimates and standard errors of some runs, (seeds, figures, terms)."""
    rows = []
    for seed in seeds:
        e = identify(seed).estimates
        names = [str(term) for term in e["term"].values]
        missing = [term for term in terms if term not in names]
        if missing:
            raise IdentificationError(
                f"seed {seed} did not estimate {', '.join(missing)}; it has {', '.join(names)}"
            )
        columns = [names.index(term) for term in terms]
        rows.append([e[name].values[columns] for name in _FIGURES])
    return np.array(rows)


def _divide_into_batches(items: list[int], jobs: int) -> list[list[int]]:
    count = min(len(items), _BATCHES * effective_n_jobs(jobs))
    return [part.tolist() for part in np.array_split(items, count)]

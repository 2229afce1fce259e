"""Many repetitions of an identification: bootstrap of one fit, Monte Carlo over simulated records.

Work is handed out by joblib.  On one machine `jobs` states how many processes; inside ``with
joblib.parallel_config(backend="dask"):`` the same calls run on the workers of a dask.distributed
cluster.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from joblib import Parallel, delayed, effective_n_jobs

from flightmech.errors import IdentificationError
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.samples import RegressionSamples
from flighttest.regression.uncertainty.coloured_residuals import estimate_disturbances

FEWEST = 20
_BATCHES = 4  # batches of replicates per process: a task must be longer than its journey


@dataclass(frozen=True)
class Bootstrap:
    """Estimates of one fit under disturbances drawn anew.

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
            f"{'term':<18}{'estimate':>11}{'stderr':>10}{'of fit':>10}{'ratio':>7}{'bias':>10}{'2.5 %':>11}{'97.5 %':>11}",
        ]
        for k, term in enumerate(e["term"].values):
            own = float(self.fit.estimates["stderr"][k])
            s = float(e["stderr"][k])
            lines.append(
                f"{term!s:<18}{float(e['estimate'][k]):>11.5g}{s:>10.2g}{own:>10.2g}{s / own if own else np.nan:>7.2f}"
                f"{float(e['bias'][k]):>10.2g}{float(e['low'][k]):>11.5g}{float(e['high'][k]):>11.5g}"
            )
        return "\n".join(lines)


@dataclass(frozen=True)
class MonteCarlo:
    """What many simulated records gave, against the truth.

    Attributes
    ----------
    estimates : Dataset (term)
        ``truth``, ``estimate`` (mean), ``bias``, ``bias_stderr``, ``scatter``, ``stderr`` (root of
        the mean square of those reported), ``coverage`` (share within two reported standard
        errors), ``coverage_white``.
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
            f"{'term':<18}{'truth':>11}{'mean':>11}{'bias/se':>9}{'scatter':>10}{'stderr':>10}{'coverage':>10}{'white':>8}",
        ]
        for k, term in enumerate(e["term"].values):
            row = {str(name): float(item[k]) for name, item in e.data_vars.items()}
            lines.append(
                f"{term!s:<18}{row['truth']:>11.5g}{row['estimate']:>11.5g}{row['bias'] / row['bias_stderr']:>9.1f}{row['scatter']:>10.2g}"
                f"{row['stderr']:>10.2g}{100 * row['coverage']:>8.1f} "
                f"%{100 * row['coverage_white']:>6.0f} %"
            )
        return "\n".join(lines)


def monte_carlo(
    identify: Callable[[int], Any], truth: dict[str, float], seeds: Sequence[int], jobs: int = -1
) -> MonteCarlo:
    """Identify many simulated records and hold the estimates against the truth.

    Parameters
    ----------
    identify : callable
        seed -> a result with ``estimates`` (a fit, a selection ...) from a record simulated with
        that seed.  For a cluster it must be importable there.
    truth : mapping
        True value of every term to look at.
    seeds : sequence of int
        One run each; twenty at least.
    jobs : int
        Processes; -1 for one per core.

    Returns
    -------
    Study

    Raises
    ------
    IdentificationError
        Too few seeds, or a term of the truth that the runs do not estimate.
    """

    if len(seeds) < FEWEST:
        raise IdentificationError(
            f"{len(seeds)} seeds; {FEWEST} at least, and 200 to distinguish 95 % from 92 %"
        )
    batches = _batches(list(seeds), jobs)
    rows = [
        row
        for batch in Parallel(n_jobs=jobs)(
            delayed(_identify)(identify, list(truth), batch) for batch in batches
        )
        for row in batch
    ]
    runs = xr.Dataset(
        {
            name: (("run", "term"), np.array([row[k] for row in rows]))
            for k, name in enumerate(("estimate", "stderr", "stderr_white"))
        },
        coords={"run": list(seeds), "term": list(truth)},
    )
    true = np.array(list(truth.values()))
    away = runs["estimate"].values - true
    scatter = away.std(axis=0, ddof=1)
    return MonteCarlo(
        xr.Dataset(
            {
                "truth": ("term", true),
                "estimate": runs["estimate"].mean("run"),
                "bias": ("term", away.mean(axis=0)),
                "bias_stderr": ("term", scatter / np.sqrt(len(rows))),
                "scatter": ("term", scatter),
                "stderr": np.sqrt((runs["stderr"] ** 2).mean("run")),
                "coverage": ("term", (np.abs(away) < 2 * runs["stderr"].values).mean(axis=0)),
                "coverage_white": (
                    "term",
                    (np.abs(away) < 2 * runs["stderr_white"].values).mean(axis=0),
                ),
            }
        ),
        runs,
    )


def bootstrap(fit: Fit, replicates: int = 200, seed: int = 0, jobs: int = 1) -> Bootstrap:
    """Draw disturbances of the colour of the residual and estimate anew.

    Parameters
    ----------
    fit : Fit
        In time or in frequency, weighted or not.
    replicates : int
        Twenty at least.
    seed : int
        Replicate k has a generator of its own, so that the result is the same however the work is
        shared out.
    jobs : int
        Processes; -1 for one per core.  Pays from a hundred thousand samples on.

    Returns
    -------
    Bootstrap

    Raises
    ------
    IdentificationError
        Too few replicates, or published values without samples.

    Notes
    -----
    A parametric bootstrap: each stretch without a gap gets a disturbance of the colour that `estimate_disturbances` finds, with the size
    of its own residual; a constant that differs between stretches is drawn too.

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
    source = _ResidualSimulator(fit)
    batches = _batches(list(range(replicates)), jobs)
    found = np.concatenate(
        Parallel(n_jobs=jobs)(delayed(source.draw)(seed, batch) for batch in batches)
    )
    theta = fit.estimates["estimate"].values
    terms = [str(term) for term in fit.estimates["term"].values]
    low, high = np.quantile(found, [0.025, 0.975], axis=0)
    more = {
        "bias": ("term", found.mean(axis=0)),
        "low": ("term", theta + low),
        "high": ("term", theta + high),
    }
    nothing: tuple[list[str], np.ndarray] = ([], np.zeros((len(terms), 0)))
    covariance = np.atleast_2d(np.cov(found.T))
    estimates = least_squares.regression_estimates(
        terms, theta, covariance, fit.estimates["stderr_white"].values, nothing, more
    )
    return Bootstrap(
        fit,
        estimates,
        xr.DataArray(theta + found, dims=("replicate", "term"), coords={"term": terms}),
    )


class _ResidualSimulator:
    """Disturbances like the residual of a fit, and what they do to the estimates."""

    def __init__(self, fit: Fit):
        time, number = fit.data["time"].values, fit.data["manoeuvre"].values
        steps = [
            float(np.median(np.diff(time[number == k]))) if (number == k).sum() > 1 else 1.0
            for k in range(int(number.max()) + 1)
        ]
        self.pieces, steps = RegressionSamples(fit.data, steps).pieces()
        self.estimator = least_squares.estimator_matrix(fit.design.values)
        self.offset = float(fit.estimates.attrs.get("offset", 0.0))
        self.colours = estimate_disturbances(
            fit.regressors.values, fit.residual, self.pieces, steps
        )

    def draw(self, seed: int, numbers: Sequence[int]) -> np.ndarray:
        """Return changes of the estimates, (numbers, terms)."""
        return np.stack([self._one(np.random.default_rng([seed, number])) for number in numbers])

    def _one(self, rng: np.random.Generator) -> np.ndarray:
        v = np.empty(self.estimator.shape[1])
        for piece, colour in zip(self.pieces, self.colours):
            v[piece] = colour.sample(piece.stop - piece.start, rng) + self.offset * rng.normal()
        return self.estimator @ v


def _identify(
    identify: Callable[[int], Any], terms: list[str], seeds: Sequence[int]
) -> list[tuple[np.ndarray, ...]]:
    found = []
    for seed in seeds:
        e = identify(seed).estimates
        names = [str(term) for term in e["term"].values]
        if missing := [term for term in terms if term not in names]:
            raise IdentificationError(
                f"seed {seed} did not estimate {', '.join(missing)}; it has {', '.join(names)}"
            )
        at = [names.index(term) for term in terms]
        found.append(tuple(e[name].values[at] for name in ("estimate", "stderr", "stderr_white")))
    return found


def _batches(items: list[int], jobs: int) -> list[list[int]]:

    count = min(len(items), _BATCHES * effective_n_jobs(jobs))
    return [part.tolist() for part in np.array_split(items, count)]

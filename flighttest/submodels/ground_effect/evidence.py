"""Evidence for the forms of a ground effect: Schwarz's criterion, and what a form leaves.

The measure is Schwarz's criterion, BIC = n ln(rss / N) + p ln n, with the number n of *independent*
samples.  Residuals are correlated in time; with the number N of samples every detail of a
disturbance would seem significant.  n is counted in the residual of the richest form, which
contains the regressors of all forms.  The residual of a form that does not fit is slow: counted in
it, n is small, and a form that fits better is not worth its parameters.

References
----------
.. [Schwarz1978] Schwarz, Estimating the dimension of a model, Annals of Statistics 6, 1978.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import scipy

from flightmech.support.arrays import rms
from flighttest.regression.equation_error.samples import RegressionSamples
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of

# Difference of the criterion below which two forms are equal.
NEAR = 2.0
# Probability that a form that fits is reported to leave more than the noise.
_FALSE_ALARM = 1e-3
# Smallest singular value of the regressors of the richest form, over the largest.
_RANK = 1e-8


@dataclass(frozen=True)
class RichestForm:
    """Least squares with the regressors of all forms together.

    Attributes
    ----------
    residual : array (samples,)
        Measured minus fitted coefficient.
    parameters : int
        Number of independent regressors.
    n : float
        Number of independent samples of the residual.
    """

    residual: np.ndarray
    parameters: int
    n: float


def fit_richest_form(X: np.ndarray, z: np.ndarray, samples: RegressionSamples) -> RichestForm:
    """Return the fit of the regressors X (samples, terms) of all forms to a coefficient z."""
    length = np.linalg.norm(X, axis=0)
    U, s, _ = np.linalg.svd(X[:, length > 0.0] / length[length > 0.0], full_matrices=False)
    # The forms are alike: combinations that do not differ are left out.
    basis = U[:, s > _RANK * s[0]]
    v = z - basis @ (basis.T @ z)
    return RichestForm(v, basis.shape[1], independent_samples(v, samples))


def independent_samples(v: np.ndarray, samples: RegressionSamples) -> float:
    """Return the number of independent samples with the standard error of the mean residual."""
    pieces, steps = samples.pieces()
    C = coloured_covariance_of(np.ones((len(v), 1)), v, pieces, steps).covariance
    return float(min(np.var(v) / C[0, 0], len(v)))


@dataclass(frozen=True)
class Misfit:
    """What a form leaves beyond the richest form.

    Attributes
    ----------
    form : str
    rms : float
        Rms of the difference between both forms. [coefficient]
    noise : float
        Rms of the residual of the richest form. [coefficient]
    ratio : float
        Power of the difference per parameter, over that of the noise (F ratio).
    limit : float
        Ratio that a form that fits exceeds once in a thousand times.
    """

    form: str
    rms: float
    noise: float
    ratio: float
    limit: float

    @property
    def is_significant(self) -> bool:
        """Whether the form leaves more than the noise."""
        return self.ratio > self.limit

    def describe(self) -> str:
        """Return the misfit as a sentence."""
        return (
            f"the form {self.form} does not fit: it leaves {self.rms:.2g} rms more than the noise "
            f"of {self.noise:.2g} (F {self.ratio:.1f}, a form that fits stays below "
            f"{self.limit:.1f}); K(h) is wrong by more than its standard error"
        )


def misfit_of(form: str, v: np.ndarray, parameters: int, richest: RichestForm) -> Misfit | None:
    """Return what a form with residual `v` leaves, or None where nothing can be left.

    An F test, in which both residuals have n independent samples.
    """
    extra, free = richest.parameters - parameters, richest.n - richest.parameters
    if extra < 1 or free < 1.0:
        return None
    noise2 = float(np.mean(richest.residual**2))
    difference2 = max(float(np.mean(v**2)) - noise2, 0.0)
    ratio = (difference2 / extra) / (noise2 / free)
    limit = float(scipy.stats.f.isf(_FALSE_ALARM, extra, free))
    return Misfit(form, float(np.sqrt(difference2)), float(np.sqrt(noise2)), ratio, limit)


def rank_forms(residuals: dict[str, tuple[np.ndarray, int | None]], n: float) -> pd.DataFrame:
    """Return the forms with the criterion of each, the best one first.

    Parameters
    ----------
    residuals : dict of str to (array (samples,), int or None)
        Residual and number of parameters of each form.  None is a form that contains these flights
        already, such as a database with nodes from flight. It gets the number of the best other
        form, so that the residual decides.
    n : float
        Number of independent samples.

    Returns
    -------
    DataFrame
        Index form; ``parameters``, ``rms``, ``BIC`` less that of the best.
    """
    criteria = {}
    for form, (v, count) in residuals.items():
        if count is not None:
            criteria[form] = schwarz_criterion(v, count, n)
    best = min(criteria, key=lambda form: criteria[form])
    default = residuals[best][1] or 0
    rows = {}
    for form, (v, count) in residuals.items():
        parameters = default if count is None else count
        rows[form] = {
            "parameters": parameters,
            "rms": rms(v),
            "BIC": schwarz_criterion(v, parameters, n),
        }
    table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("form")
    table = table.sort_values("BIC", kind="stable")
    table["BIC"] -= table["BIC"].min()
    return table


def schwarz_criterion(v: np.ndarray, parameters: int, n: float) -> float:
    """Return Schwarz's criterion of a form with residual `v` and `n` independent samples."""
    return n * float(np.log(np.mean(v**2))) + parameters * float(np.log(n))


def select_form(table: pd.DataFrame, order: Sequence[str]) -> str:
    """Return the form with the least criterion.

    Of forms within two of it, the result is the first one in `order`.
    """
    near = [str(form) for form, value in table["BIC"].items() if value <= NEAR]
    return min(near, key=list(order).index)

"""Forms of a ground effect, and their comparison on the same samples.

The measure is Schwarz's criterion, BIC = n ln(rss / N) + p ln n, with the number n of *independent*
samples.  Residuals are correlated in time; with the number N of samples every detail of a
disturbance would seem significant.

References
----------
.. [LR743] Report LR-743, 1993, section 4.5.1, eq. (11), (13), (14).
.. [Schwarz1978] Schwarz, Estimating the dimension of a model, Annals of Statistics 6, 1978.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.support.arrays import rms
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.samples import RegressionSamples
from flighttest.regression.expressions import parse_expression
from flighttest.regression.separable_model import SeparableModel, ShapeParameter
from flighttest.regression.uncertainty import collinearity
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of

# Difference of the criterion below which two forms are equal.
_NEAR = 2.0
HEIGHT = "h_agl"
# Bounds of s: above -0.1 the ground has the same effect at all heights.
EXPONENTS = (-4.0, -0.1)
# Height of a record without a height. [m]
FREE_AIR = 1e4
# Regressor of [LR743] eq. (14).
BANK = "CL*phi"
# Coefficients of which the ground may change all terms.
_LONGITUDINAL = ("CL", "CD", "Cm", "CX", "CZ")


@dataclass(frozen=True)
class HeightTable:
    """Ground terms as tables over the height, linear between breakpoints and zero at the last one.

    Attributes
    ----------
    terms : tuple of str
        Ground terms.
    heights : array (nodes,)
        Breakpoints. [m]
    value, stderr : array (terms, nodes)
        Coefficient per unit of each ground term.
    free : array (free terms,)
        Estimated free-air coefficients.
    residual : array (samples,)
        Measured minus fitted coefficient.
    """

    terms: tuple[str, ...]
    heights: np.ndarray
    value: np.ndarray
    stderr: np.ndarray
    free: np.ndarray
    residual: np.ndarray

    @property
    def parameters(self) -> int:
        """Number of estimated free-air coefficients and nodes."""
        return len(self.free) + self.value[:, :-1].size


def height_table(
    X: np.ndarray,
    terms: tuple[str, ...],
    ground: np.ndarray,
    h: np.ndarray,
    z: np.ndarray,
    samples: RegressionSamples,
    heights: np.ndarray,
) -> HeightTable:
    """Return the ground terms as tables over the height, by least squares.

    Parameters
    ----------
    X : array (samples, terms)
        Regressors of the estimated free-air terms.
    terms : tuple of str
        Ground terms.
    ground : array (samples, ground terms)
        Regressors of the ground terms.
    h, z : array (samples,)
        Height [m] and measured coefficient.
    samples : Samples
        Samples of the coefficient, for the colour of the residuals.
    heights : array (nodes,)
        Increasing breakpoints; the last one is free air.

    Raises
    ------
    IdentificationError
        A node that no sample determines.
    """
    # Linear interpolation: hat functions of all breakpoints except the last, (samples, nodes).
    nodes = len(heights) - 1
    hats = np.array([np.interp(h, heights, hat) for hat in np.eye(len(heights))[:nodes]]).T
    tables = (ground[:, :, None] * hats[:, None, :]).reshape(len(h), -1)
    X_all = np.hstack([X, tables])
    names = [f"free {k}" for k in range(X.shape[1])]
    for term in terms:
        names += [f"{term} at {height:.3g} m" for height in heights[:-1]]
    collinearity.demand_rank(X_all, names)
    theta = np.linalg.lstsq(X_all, z, rcond=None)[0]
    v = z - X_all @ theta
    C = coloured_covariance_of(X_all, v, *samples.pieces()).covariance
    # The last node is free air, with the value and the standard error zero.
    shape = (ground.shape[1], nodes)
    value, stderr = np.zeros((shape[0], nodes + 1)), np.zeros((shape[0], nodes + 1))
    value[:, :-1] = theta[X.shape[1] :].reshape(shape)
    stderr[:, :-1] = np.sqrt(np.diag(C))[X.shape[1] :].reshape(shape)
    return HeightTable(
        terms, heights, value=value, stderr=stderr, free=theta[: X.shape[1]], residual=v
    )


def height_breakpoints(
    h: np.ndarray, ratio: float = 1.5, least: int = 25, highest: float = 60.0
) -> np.ndarray:
    """Return breakpoints from the lowest height of the samples up to free air. [m]

    Parameters
    ----------
    h : array (samples,)
        Heights. [m]
    ratio : float
        Smallest ratio of neighbouring breakpoints.
    least : int
        Smallest number of samples between breakpoints. With fewer samples a breakpoint is omitted.
    highest : float
        Largest ratio of the last breakpoint to the first one.

    Raises
    ------
    IdentificationError
        Fewer than `least` samples near the ground.
    """
    lowest = float(h.min())
    breakpoints = [lowest]
    count = int(np.log(highest) / np.log(ratio))
    for height in lowest * ratio ** np.arange(1, count + 1):
        if np.count_nonzero((h >= breakpoints[-1]) & (h < height)) >= least:
            breakpoints.append(float(height))
    if len(breakpoints) < 2:
        raise IdentificationError(
            f"fewer than {least} samples between {lowest:.3g} and {highest * lowest:.3g} m"
        )
    return np.array(breakpoints)


def independent_samples(v: np.ndarray, samples: RegressionSamples) -> float:
    """Return the number of independent samples with the standard error of the mean residual."""
    pieces, steps = samples.pieces()
    C = coloured_covariance_of(np.ones((len(v), 1)), v, pieces, steps).covariance
    return float(min(np.var(v) / C[0, 0], len(v)))


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
    near = [str(form) for form, value in table["BIC"].items() if value <= _NEAR]
    return min(near, key=list(order).index)


def ground_terms(model: RegressionModel) -> tuple[str, ...]:
    """Return the terms that the ground may change.

    These are all terms of CL, CD and Cm, [LR743] eq. (13), and the bank angle of Cl, eq. (14).

    Raises
    ------
    IdentificationError
        A coefficient for which the report has no form.
    """
    if model.coefficient in _LONGITUDINAL:
        return tuple(model.terms)
    if model.coefficient == "Cl":
        return (BANK,)
    raise IdentificationError(
        f"no form of ground effect for {model.coefficient}; name its terms in `ground`, as "
        f"{{'CY': ['beta']}}"
    )


def exponent_name(term: str) -> str:
    """Return the name of the exponent of a ground term.

    It is ``s_alpha`` for ``alpha``, and ``s_0`` for the constant.
    """
    if term == "1":
        return "s_0"
    return "s_" + re.sub(r"\W+", "_", term.replace("**", "")).strip("_")


def times_height_power(term: str, name: str | None = None) -> str:
    """Return a term times h^s, in the spelling of a separable model.

    `name` is that of the exponent; its default is the exponent of the term.
    """
    power = f"{HEIGHT}^{name or exponent_name(term)}"
    if term != "1":
        power = f"{term}*{power}"
    return str(parse_expression(power))


def separable_spelling(term: str) -> str:
    """Return a term of a `RegressionModel` in the spelling of a separable model."""
    return str(parse_expression(term))


def model_over_ground(
    model: RegressionModel,
    ground: Sequence[str],
    held: bool = False,
    common: bool = False,
    exponents: tuple[float, float] = EXPONENTS,
    starts: Mapping[str, float] | None = None,
) -> SeparableModel:
    """Return the model of a coefficient in and out of ground effect.

    Parameters
    ----------
    model : Model
        Terms in free air.
    ground : sequence of str
        Terms that the ground changes.
    held : bool
        Whether the free-air terms are already subtracted from the measured coefficient.
    common : bool
        Whether all ground terms have one exponent ``s``, [LR743] eq. (11).
    exponents : (low, high)
        Bounds of the exponents.
    starts : mapping of str to float, optional
        First values of exponents by name, from an earlier search.
    """
    common_name = "s" if common else None
    terms: list[str] = []
    if not held:
        terms += model.terms
    shape = {}
    for term in ground:
        name = common_name or exponent_name(term)
        terms.append(times_height_power(term, common_name))
        shape[name] = ShapeParameter(*exponents, (starts or {}).get(name))
    return SeparableModel(model.coefficient, terms, shape)


def with_heights(data: Sequence[xr.Dataset], names: Sequence[str]) -> list[xr.Dataset]:
    """Return manoeuvres that all have a height; one without it is in free air.

    Parameters
    ----------
    data : sequence of Dataset (time,)
        Manoeuvres, some of them with a height over the runway.
    names : sequence of str
        Names of the manoeuvres, for messages.

    Raises
    ------
    IdentificationError
        No manoeuvre with a height, or a height that is not positive.
    """
    if not any(HEIGHT in manoeuvre for manoeuvre in data):
        raise IdentificationError(
            f"no manoeuvre has {HEIGHT}; reconstruct with runway_elevation, so that heights "
            f"over the runway are known"
        )
    records = []
    for manoeuvre, name in zip(data, names):
        if HEIGHT not in manoeuvre:
            records.append(manoeuvre.assign({HEIGHT: FREE_AIR}))
            continue
        h = np.asarray(manoeuvre[HEIGHT].values, float)
        if (h <= 0.0).any():
            raise IdentificationError(
                f"{name}: {HEIGHT} falls to {np.nanmin(h):.3g} m; h^s needs heights above "
                f"zero: cut it at the touch-down"
            )
        records.append(manoeuvre)
    return records

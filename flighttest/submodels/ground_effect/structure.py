"""Forms of ground effect compared on the same samples.

The measure is Schwarz's criterion, BIC = n ln(rss / N) + p ln n, with the number n of *independent*
samples: residuals are correlated in time, and with N itself every detail of a disturbance would
seem significant.

References
----------
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


@dataclass(frozen=True)
class HeightTable:
    """Ground terms as tables over the height, straight between breakpoints, zero at the last.

    Attributes
    ----------
    terms : tuple of str
        Ground terms.
    heights : array (nodes,)
        [m]
    value, stderr : array (terms, nodes)
        Of the coefficient per unit of each ground term.
    free : array (free terms,)
        Free-air coefficients that were estimated along.
    residual : array (samples,)
    """

    terms: tuple[str, ...]
    heights: np.ndarray
    value: np.ndarray
    stderr: np.ndarray
    free: np.ndarray
    residual: np.ndarray

    @property
    def parameters(self) -> int:
        """Free-air coefficients and nodes that were estimated."""
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
        Free-air regressors that are estimated along.
    terms : tuple of str
        Ground terms.
    ground : array (samples, ground terms)
        Regressors that the ground changes.
    h, z : array (samples,)
        Height [m] and measured coefficient.
    samples : Samples
    heights : array (nodes,)
        Breakpoints, rising; the last one is free air.

    Raises
    ------
    IdentificationError
        A node that no sample determines.
    """
    hats = np.array(
        [np.interp(h, heights, np.eye(len(heights))[k]) for k in range(len(heights) - 1)]
    ).T
    tables = (ground[:, :, None] * hats[:, None, :]).reshape(len(h), -1)
    whole = np.hstack([X, tables])
    names = [f"free {k}" for k in range(X.shape[1])]
    names += [f"{term} at {height:.3g} m" for term in terms for height in heights[:-1]]
    collinearity.demand_rank(whole, names)
    theta = np.linalg.lstsq(whole, z, rcond=None)[0]
    v = z - whole @ theta
    C = coloured_covariance_of(whole, v, *samples.pieces()).covariance
    shape = (ground.shape[1], len(heights) - 1)
    value, stderr = (np.zeros((shape[0], shape[1] + 1)) for _ in range(2))
    value[:, :-1] = theta[X.shape[1] :].reshape(shape)
    stderr[:, :-1] = np.sqrt(np.diag(C))[X.shape[1] :].reshape(shape)
    return HeightTable(terms, heights, value, stderr, theta[: X.shape[1]], v)


def height_breakpoints(
    h: np.ndarray, ratio: float = 1.5, least: int = 25, highest: float = 60.0
) -> np.ndarray:
    """Return heights from the lowest that was flown up to free air. [m]

    Parameters
    ----------
    h : array (samples,)
        Heights flown. [m]
    ratio : float
        Least ratio of neighbouring heights.
    least : int
        Least samples between them; where fewer were flown the next heights are left out.
    highest : float
        The last height is at most so many times the lowest.

    Raises
    ------
    IdentificationError
        Fewer than `least` samples near the ground.
    """
    lowest = float(h.min())
    found = [lowest]
    for height in lowest * ratio ** np.arange(1, int(np.log(highest) / np.log(ratio)) + 1):
        if np.count_nonzero((h >= found[-1]) & (h < height)) >= least:
            found.append(float(height))
    if len(found) < 2:
        raise IdentificationError(
            f"fewer than {least} samples between {lowest:.3g} and {highest * lowest:.3g} m"
        )
    return np.array(found)


def independent_samples(v: np.ndarray, samples: RegressionSamples) -> float:
    """Return how many independent samples would have a mean as good as that of the residual."""
    pieces, steps = samples.pieces()
    C = coloured_covariance_of(np.ones((len(v), 1)), v, pieces, steps).covariance
    return float(min(np.var(v) / C[0, 0], len(v)))


def rank_forms(residuals: dict[str, tuple[np.ndarray, int | None]], n: float) -> pd.DataFrame:
    """Return the forms with the criterion of each, the best first.

    Parameters
    ----------
    residuals : dict of str to (array (samples,), int or None)
        Residual and number of parameters of each form.  None where the form has heard these flights
        already, as a database whose nodes are from flight: it counts as many as the best of the
        others, so that the residual decides between them.
    n : float
        Independent samples.

    Returns
    -------
    DataFrame
        Index form; ``parameters``, ``rms``, ``BIC`` less that of the best.
    """
    known = {
        form: schwarz_criterion(v, count, n)
        for form, (v, count) in residuals.items()
        if count is not None
    }
    like = residuals[min(known, key=lambda form: known[form])][1] or 0
    rows = {}
    for form, (v, count) in residuals.items():
        counted = like if count is None else count
        rows[form] = {"parameters": counted, "rms": rms(v), "BIC": schwarz_criterion(v, counted, n)}
    table = (
        pd.DataFrame.from_dict(rows, orient="index")
        .rename_axis("form")
        .sort_values("BIC", kind="stable")
    )
    table["BIC"] -= table["BIC"].min()
    return table


def schwarz_criterion(v: np.ndarray, parameters: int, n: float) -> float:
    """Return Schwarz's criterion of a form with residual `v` and `n` independent samples."""
    return n * float(np.log(np.mean(v**2))) + parameters * float(np.log(n))


def select_form(table: pd.DataFrame, order: Sequence[str]) -> str:
    """Return the form with the least criterion; of forms within two of it the one that stands first
    in `order`.
    """
    near = [str(form) for form, value in table["BIC"].items() if value <= 2.0]
    return min(near, key=list(order).index)


HEIGHT = "h_agl"
EXPONENTS = (-4.0, -0.1)  # bounds of s: above -0.1 the ground is felt at all heights alike
FREE_AIR = 1e4  # height of a record that does not give it [m]
BANK = "CL*phi"  # the regressor of [LR743] eq. (14)
_LONGITUDINAL = ("CL", "CD", "Cm", "CX", "CZ")


def ground_terms(model: RegressionModel) -> tuple[str, ...]:
    """Return the terms that the ground may change: of CL, CD and Cm all, (13); of Cl the bank
    angle, (14).

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
    """Return the name of the exponent of a ground term: ``s_alpha`` of ``alpha``, ``s_0`` of the
    constant.
    """
    return "s_" + ("0" if term == "1" else re.sub(r"\W+", "_", term.replace("**", "")).strip("_"))


def times_height_power(term: str, name: str | None = None) -> str:
    """Return a term times h^s, in the spelling of a separable model."""
    return str(
        parse_expression(
            f"{'' if term == '1' else term + '*'}{HEIGHT}^{name or exponent_name(term)}"
        )
    )


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
        Free air.
    ground : sequence of str
        Terms that the ground changes.
    held : bool
        The free-air terms are taken off the measured coefficient already.
    common : bool
        One exponent ``s`` for all ground terms, [LR743] eq. (11).
    exponents : (low, high)
        Bounds of the exponents.
    starts : mapping of str to float, optional
        First values of exponents by name, where the search need not begin anew.
    """
    name = "s" if common else None
    terms = [*(() if held else model.terms), *(times_height_power(term, name) for term in ground)]
    names = dict.fromkeys(name or exponent_name(term) for term in ground)
    return SeparableModel(
        model.coefficient,
        terms,
        {one: ShapeParameter(*exponents, (starts or {}).get(one)) for one in names},
    )


def with_heights(data: Sequence[xr.Dataset], names: Sequence[str]) -> list[xr.Dataset]:
    """Return manoeuvres that all have a height; one without counts as free air when its name is not
    informative else.

    Raises
    ------
    IdentificationError
        No manoeuvre with a height, or a height that is not positive.
    """
    if not any(HEIGHT in one for one in data):
        raise IdentificationError(
            f"no manoeuvre has {HEIGHT}; reconstruct with runway_elevation, so that heights "
            f"over the runway are known"
        )
    found = []
    for one, name in zip(data, names):
        h = np.asarray(one[HEIGHT].values, float) if HEIGHT in one else np.array(FREE_AIR)
        if (h <= 0.0).any():
            raise IdentificationError(
                f"{name}: {HEIGHT} falls to {np.nanmin(h):.3g} m; h^s needs heights above "
                f"zero: cut it at the touch-down"
            )
        found.append(one if HEIGHT in one else one.assign({HEIGHT: FREE_AIR}))
    return found

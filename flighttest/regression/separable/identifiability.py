"""Identifiability of the parameters of a separable fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flighttest.regression.separable.search import SeparableSolution
from flighttest.regression.separable_model import SeparableModel, ShapeParameter
from flighttest.regression.uncertainty import collinearity

# least coefficient over standard error of a term with shape parameters: the search takes the
# largest of many
T_SHAPED = 3.0
NARROWED = 0.5  # largest standard error of a shape parameter over that before the flights
_SINGULAR = 1e-14  # singular value of the normal matrix, over the largest, that counts as zero
_REGULAR = 1e-15  # added to the diagonal of the normal matrix, of itself: against rounding


def assess_identifiability(
    models: Sequence[SeparableModel],
    shape: Mapping[str, ShapeParameter],
    names: Sequence[str],
    theta: np.ndarray,
    covariance: np.ndarray,
    solution: SeparableSolution,
) -> dict[str, Any]:
    """Return the identifiability of every parameter, as variables of a Dataset.

    Parameters
    ----------
    models : sequence of SeparableModel
    shape : mapping of str to ShapeParameter
    names : sequence of str
        Coefficients of all models, then shape parameters.
    theta : array (names,)
    covariance : array (names, names)
    solution : SeparableSolution

    Returns
    -------
    dict
        ``t`` (of a coefficient: over its standard error for given shapes; of a shape parameter:
        NaN), ``narrowed`` (standard error of a shape parameter over that before the flights),
        ``identified`` (bool), ``why`` (text), ``condition_index`` (component), ``proportion``
        (component, term).
    """
    count = len(names) - len(shape)
    t = np.full(len(names), np.nan)
    t[:count] = _coefficient_ratios(theta[:count], solution)
    stderr = np.sqrt(np.diag(covariance))
    narrowed = np.full(len(names), np.nan)
    for m, item in enumerate(shape.values()):
        narrowed[count + m] = stderr[count + m] / item.spread
    why = _explain_parameters(models, shape, theta=theta, t=t, narrowed=narrowed, solution=solution)
    index, proportion = _variance_decomposition(solution)
    t_name = {"long_name": "coefficient over its standard error, shapes as they are"}
    return {
        "t": ("term", t, t_name),
        "narrowed": (
            "term",
            narrowed,
            {"long_name": "standard error over that before the flights"},
        ),
        "identified": ("term", np.array([not text for text in why])),
        "why": ("term", np.array(why, dtype=str)),
        "condition_index": ("component", index),
        "proportion": (("component", "term"), proportion),
    }


def _coefficient_ratios(coefficients: np.ndarray, solution: SeparableSolution) -> np.ndarray:
    """Return coefficients over their standard errors for given shapes, (coefficients,)."""
    count = len(coefficients)
    # Sandwich covariance N^-1 S N^-1 of the coefficients alone, with the normal matrix N.
    normal_matrix = solution.products[:count, :count]
    inverse = np.linalg.pinv(normal_matrix, rcond=_SINGULAR, hermitian=True)
    variance = np.diag(inverse @ solution.spread[:count, :count] @ inverse)
    with np.errstate(divide="ignore"):
        return np.abs(coefficients) / np.sqrt(np.maximum(variance, 0.0))


def _explain_parameters(
    models: Sequence[SeparableModel],
    shape: Mapping[str, ShapeParameter],
    theta: np.ndarray,
    t: np.ndarray,
    narrowed: np.ndarray,
    solution: SeparableSolution,
) -> list[str]:
    """Return for every parameter why it is not identified; empty text if it is."""
    shapes_of_terms: list[tuple[str, ...]] = []
    for model in models:
        shapes_of_terms.extend(model.shapes.values())
    why = [_explain_coefficient(t[j], shapes) for j, shapes in enumerate(shapes_of_terms)]
    for k, (name, item) in enumerate(shape.items(), start=len(why)):
        # A shape means nothing if all of its terms may be zero.
        largest_t = max(t[j] for j, shapes in enumerate(shapes_of_terms) if name in shapes)
        if largest_t < T_SHAPED:
            text = f"its term is {largest_t:.1f} standard errors from zero, {T_SHAPED:g} are needed"
        elif solution.products[k, k] == 0.0:
            text = "it has no effect on the samples"
        elif not solution.free[k]:
            text = f"at its bound {theta[k]:g}"
        else:
            text = _explain_shape(item, narrowed[k])
        why.append(text)
    return why


def _explain_coefficient(t: float, shapes: Sequence[str]) -> str:
    """Return why a coefficient is not identified. A term without shape parameter may be zero."""
    if t >= T_SHAPED or not shapes:
        return ""
    return f"{t:.1f} standard errors from zero, {T_SHAPED:g} are needed"


def _explain_shape(item: ShapeParameter, narrowed: float) -> str:
    """Return why a shape parameter inside its bounds is not identified."""
    if not narrowed > NARROWED:
        return ""
    before = f"its bounds {item.low:g} ... {item.high:g}"
    if item.sigma == item.spread:
        before = f"its a-priori standard error {item.sigma:g}"
    return f"standard error {100 * narrowed:.0f} % of that of {before}"


def _variance_decomposition(solution: SeparableSolution) -> tuple[np.ndarray, np.ndarray]:
    """Return condition indexes and variance proportions; zero for parameters at a bound."""
    free, size = solution.free, len(solution.free)
    M = solution.products[np.ix_(free, free)]
    # The triangular root R with R'R = X'X has the singular values of X.
    root = np.linalg.cholesky(M + _REGULAR * np.diag(np.diag(M))).T
    index, share = collinearity.variance_decomposition(root)
    all_index, all_share = np.full(size, np.inf), np.zeros((size, size))
    all_index[: len(index)] = index
    all_share[: len(index), free] = share
    return all_index, all_share

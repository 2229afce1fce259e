"""Which parameters of a separable fit the data can see, and why not the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..expressions.separable_model import SeparableModel, ShapeParameter
from ..uncertainty import collinearity

T_SHAPED = 3.0  # least coefficient over standard error of a term whose shape was searched: the search takes the largest of many
NARROWED = 0.5  # largest standard error of a shape parameter over that before the flights


def judged(
    models: Sequence[SeparableModel],
    shape: Mapping[str, ShapeParameter],
    names: Sequence[str],
    theta: np.ndarray,
    covariance: np.ndarray,
    found: Any,
) -> dict[str, tuple]:
    """Return what is known of every parameter, as variables of a Dataset.

    Parameters
    ----------
    models : sequence of SeparableModel
    shape : mapping of str to ShapeParameter
    names : sequence of str
        Coefficients of all models, then shape parameters.
    theta, covariance : array (names,), (names, names)
    found : object
        ``products`` and ``spread`` of the fit, ``free``.

    Returns
    -------
    dict
        ``t`` (of a coefficient: over its standard error for given shapes; of a shape parameter: NaN), ``narrowed``
        (standard error of a shape parameter over that before the flights), ``identified`` (bool), ``why`` (text),
        ``condition_index`` (component), ``proportion`` (component, term).
    """
    count = len(names) - len(shape)
    D = np.linalg.pinv(found.products[:count, :count], rcond=1e-14, hermitian=True)
    given = np.sqrt(np.maximum(np.diag(D @ found.spread[:count, :count] @ D), 0.0))
    with np.errstate(divide="ignore"):
        t = np.concatenate([np.abs(theta[:count]) / given, np.full(len(shape), np.nan)])
    stderr = np.sqrt(np.diag(covariance))
    narrowed = np.concatenate([np.full(count, np.nan), [stderr[count + m] / item.spread for m, item in enumerate(shape.values())]])
    shapes = [own for model in models for own in model.shapes.values()]
    why = [_coefficient(t[j], shapes[j]) for j in range(count)]
    for m, name in enumerate(shape):
        users = [j for j in range(count) if name in shapes[j]]
        why.append(_shape(name, shape[name], theta[count + m], narrowed[count + m], max(t[j] for j in users), found.free[count + m]))
    index, proportion = _decomposed(found)
    return {
        "t": ("term", t, {"long_name": "coefficient over its standard error, shapes as they are"}),
        "narrowed": ("term", narrowed, {"long_name": "standard error over that before the flights"}),
        "identified": ("term", np.array([not text for text in why])),
        "why": ("term", np.array(why, dtype=str)),
        "condition_index": ("component", index),
        "proportion": (("component", "term"), proportion),
    }


def _coefficient(t: float, shapes: Sequence[str]) -> str:
    """A term of known form may well be zero; one whose form was searched must be seen, or its form means nothing."""
    return "" if t >= T_SHAPED or not shapes else f"{t:.1f} standard errors from zero, {T_SHAPED:g} are needed"


def _shape(name: str, item: ShapeParameter, value: float, narrowed: float, t: float, free: bool) -> str:
    if t < T_SHAPED:
        return f"its term is {t:.1f} standard errors from zero, {T_SHAPED:g} are needed"
    if not free:
        return f"at its bound {value:g}"
    if narrowed > NARROWED:
        before = (
            f"its a-priori standard error {item.sigma:g}" if item.sigma == item.spread else f"its bounds {item.low:g} ... {item.high:g}"
        )
        return f"standard error {100 * narrowed:.0f} % of that of {before}"
    return ""


def _decomposed(found: Any) -> tuple[np.ndarray, np.ndarray]:
    """Condition indexes and variance proportions over all parameters; zero for those at a bound."""
    free, size = found.free, len(found.free)
    M = found.products[np.ix_(free, free)]
    root = np.linalg.cholesky(M + 1e-15 * np.diag(np.diag(M))).T
    index, share = collinearity.decomposition(root)
    whole_index, whole = np.full(size, np.inf), np.zeros((size, size))
    whole_index[: len(index)] = index
    whole[: len(index), free] = share
    return whole_index, whole

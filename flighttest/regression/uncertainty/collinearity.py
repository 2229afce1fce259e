"""Which regressors the data can distinguish.

References
----------
.. [Belsley1980] Belsley, Kuh, Welsch, Regression Diagnostics, 1980.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError

RANK = 1e-8  # smallest singular value of the regressors, scaled to unit length, against the largest
CONDITION = 30.0
SHARE = 0.5
VIF = 10.0  # above which a term is remarked
# VIF above which terms are refused: what is independent in one is a thousandth of its movement
INSEPARABLE = 1e6
CORRELATED = 0.9


def demand_rank(X: np.ndarray, terms: Sequence[str]) -> None:
    """Raise when the regressors do not determine all parameters.

    Raises
    ------
    IdentificationError
        Names the terms that do not move and the combinations that vanish.
    """
    length = np.linalg.norm(X, axis=0)
    idle = [term for term, size in zip(terms, length) if size == 0.0]
    if idle:
        raise IdentificationError(
            f"{', '.join(idle)} {'is' if len(idle) == 1 else 'are'} zero throughout; leave "
            f"the term out or add a manoeuvre that moves it"
        )
    constant = [
        term for term, column in zip(terms, X.T) if np.ptp(column) <= 1e-9 * np.abs(column).max()
    ]
    if len(constant) > 1:
        raise IdentificationError(
            f"{', '.join(constant)} do not move: all of them are constants here; keep one of "
            f"them or add a manoeuvre that moves the others"
        )
    # fewer rows than terms: the directions beyond the rows vanish
    _, s, Vt = np.linalg.svd(X / length, full_matrices=len(X) < len(terms))
    for value, vector in zip(np.pad(s, (0, len(Vt) - len(s))), Vt):
        if value < RANK * s[0]:
            raise IdentificationError(
                f"the data cannot distinguish: {describe_combination(vector, terms)} vanishes "
                f"throughout; leave a term out or add a manoeuvre"
            )


def demand_independence(X: np.ndarray, fixed: np.ndarray, terms: Sequence[str]) -> None:
    """Raise when terms differ by less than any instrument resolves.

    A variance inflation factor of 1e6 leaves a thousandth of the movement of a regressor to itself:
    less than the resolution, the calibration and the synchronism of recorded channels.

    Raises
    ------
    IdentificationError
        Names the terms, their factors and the limit.
    """
    if fixed.sum() >= len(fixed) - 1:
        return
    own = np.flatnonzero(~fixed)
    Z = X[:, own]
    if fixed.any():
        Z = Z - X[:, fixed] @ np.linalg.lstsq(X[:, fixed], Z, rcond=None)[0]
    R = np.linalg.qr(Z / np.linalg.norm(Z, axis=0))[1]
    factors = (np.linalg.inv(R) ** 2).sum(axis=1)
    if not (factors > INSEPARABLE).any():
        return
    worst = [
        f"{terms[own[j]]} ({factors[j]:.1e})"
        for j in np.argsort(-factors)
        if factors[j] > INSEPARABLE
    ]
    raise IdentificationError(
        f"the data cannot distinguish {', '.join(worst)}: variance inflation factors above "
        f"the limit of {INSEPARABLE:.0e}, where what is "
        "independent in a term is less than a thousandth of its movement; leave a term out, "
        "hold it at its a-priori value, or add a "
        "manoeuvre that moves the terms independently"
    )


def regressor_correlations(X: np.ndarray, constants: np.ndarray) -> np.ndarray:
    """Return the correlation of the regressors after their constants are taken out.

    Parameters
    ----------
    X : array (samples, terms)
    constants : array of bool (terms,)
        Intercept columns.

    Returns
    -------
    array (terms, terms)
        1 on the diagonal; 0 in rows and columns of the constants.
    """
    found = np.eye(X.shape[1])
    moving = ~constants
    if moving.any():
        Z = X[:, moving]
        if constants.any():
            Z = Z - X[:, constants] @ np.linalg.lstsq(X[:, constants], Z, rcond=None)[0]
        Z = Z / np.linalg.norm(Z, axis=0)
        found[np.ix_(moving, moving)] = Z.T @ Z
    return found


def variance_inflation(correlation: np.ndarray) -> np.ndarray:
    """Return the variance inflation factors: diagonal of the inverse correlation matrix."""
    return np.diag(np.linalg.inv(correlation))


def variance_decomposition(X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return condition indexes and variance proportions of regressors scaled to unit length
    [Belsley1980].

    Parameters
    ----------
    X : array (rows, terms)
        The constant among them.

    Returns
    -------
    index : array (components,)
        Largest singular value over each; rising.
    proportion : array (components, terms)
        Share of the variance of each estimate that comes from each component; the columns sum to
        one.
    """
    _, s, Vt = np.linalg.svd(X / np.linalg.norm(X, axis=0), full_matrices=False)
    share = (Vt / s[:, None]) ** 2
    return s[0] / s, share / share.sum(axis=0)


def collinear_terms(estimates: xr.Dataset) -> list[tuple[float, str]]:
    """Return condition indexes above 30 on which two or more terms depend, each with those terms in
    words.

    Parameters
    ----------
    estimates : Dataset
        With ``condition_index`` (component) and ``proportion`` (component, term); a term depends on
        a component when more than half of its variance comes from it [Belsley1980].
    """
    terms = [str(term) for term in estimates["term"].values]
    found = []
    for index, share in zip(estimates["condition_index"].values, estimates["proportion"].values):
        involved = np.flatnonzero(share > SHARE)
        if index > CONDITION and len(involved) >= 2:
            found.append(
                (
                    float(index),
                    " with ".join(f"{terms[j]} ({100 * share[j]:.0f} %)" for j in involved),
                )
            )
    return found


def describe_combination(vector: np.ndarray, terms: Sequence[str]) -> str:
    """Return a vector over scaled regressors in words, such as ``0.71 alpha - 0.70 qhat``."""
    order = [j for j in np.argsort(-np.abs(vector)) if abs(vector[j]) > 0.1 * np.abs(vector).max()]
    sign = np.sign(vector[order[0]])
    text = " ".join(
        f"{'-' if sign * vector[j] < 0 else '+'} {abs(vector[j]):.2f} {terms[j]}" for j in order
    )
    return text.removeprefix("+ ") + " (each scaled to unit length)"

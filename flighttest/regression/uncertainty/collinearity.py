"""Collinearity of regressors: rank, variance inflation factors and condition indexes.

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
CONDITION = 30.0  # condition index from which on a dependency is remarked [Belsley1980]
SHARE = 0.5  # share of a variance from which on a term takes part in a dependency [Belsley1980]
VIF = 10.0  # above which a term is remarked
# VIF above which terms are refused: the independent part is a thousandth of the movement
INSEPARABLE = 1e6
CORRELATED = 0.9  # correlation of two regressors above which they are remarked
_STILL = 1e-9  # range of a regressor, of its size, up to which it is a constant


def demand_rank(X: np.ndarray, terms: Sequence[str]) -> None:
    """Raise when the regressors do not determine all parameters.

    Parameters
    ----------
    X : array (rows, terms)
    terms : sequence of str

    Raises
    ------
    IdentificationError
        Regressors that do not move, or combinations that vanish. The message names them.
    """
    length = np.linalg.norm(X, axis=0)
    idle = [term for term, size in zip(terms, length) if size == 0.0]
    if idle:
        verb = "is" if len(idle) == 1 else "are"
        raise IdentificationError(
            f"{', '.join(idle)} {verb} zero throughout; leave the term out or add a manoeuvre "
            f"that moves it"
        )
    is_constant = np.ptp(X, axis=0) <= _STILL * np.abs(X).max(axis=0)
    constants = [term for term, flag in zip(terms, is_constant) if flag]
    if len(constants) > 1:
        raise IdentificationError(
            f"{', '.join(constants)} do not move: all of them are constants here; keep one of "
            f"them or add a manoeuvre that moves the others"
        )
    # With fewer rows than terms, the directions beyond the rows vanish.
    _, s, Vt = np.linalg.svd(X / length, full_matrices=len(X) < len(terms))
    for value, vector in zip(np.pad(s, (0, len(Vt) - len(s))), Vt):
        if value < RANK * s[0]:
            raise IdentificationError(
                f"the data cannot distinguish: {describe_combination(vector, terms)} vanishes "
                f"throughout; leave a term out or add a manoeuvre"
            )


def demand_independence(X: np.ndarray, fixed: np.ndarray, terms: Sequence[str]) -> None:
    """Raise when terms differ by less than any instrument resolves.

    A variance inflation factor of 1e6 leaves a thousandth of the movement of a regressor
    independent of the others. This is less than the resolution, the calibration and the synchronism
    of recorded channels.

    Parameters
    ----------
    X : array (rows, terms)
    fixed : array of bool (terms,)
        Intercepts.
    terms : sequence of str

    Raises
    ------
    IdentificationError
        Terms above the limit. The message names them, their factors and the limit.
    """
    if fixed.sum() >= len(fixed) - 1:
        return
    columns = np.flatnonzero(~fixed)
    Z = _remove_constants(X, fixed)
    # The VIF is the diagonal of (Z'Z)^-1 = R^-1 R^-T of regressors of unit length.
    R = np.linalg.qr(Z / np.linalg.norm(Z, axis=0))[1]
    factors = (np.linalg.inv(R) ** 2).sum(axis=1)
    if not (factors > INSEPARABLE).any():
        return
    worst = []
    for j in np.argsort(-factors):
        if factors[j] > INSEPARABLE:
            worst.append(f"{terms[columns[j]]} ({factors[j]:.1e})")
    raise IdentificationError(
        f"the data cannot distinguish {', '.join(worst)}: variance inflation factors above "
        f"the limit of {INSEPARABLE:.0e}, where what is independent in a term is less than a "
        f"thousandth of its movement; leave a term out, hold it at its a-priori value, or add a "
        f"manoeuvre that moves the terms independently"
    )


def _remove_constants(X: np.ndarray, constants: np.ndarray) -> np.ndarray:
    """Return the other regressors less their projection on the constants."""
    Z = X[:, ~constants]
    if not constants.any():
        return Z
    return Z - X[:, constants] @ np.linalg.lstsq(X[:, constants], Z, rcond=None)[0]


def regressor_correlations(X: np.ndarray, constants: np.ndarray) -> np.ndarray:
    """Return the correlation of the regressors without their constants.

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
    correlation = np.eye(X.shape[1])
    moving = ~constants
    if moving.any():
        Z = _remove_constants(X, constants)
        Z = Z / np.linalg.norm(Z, axis=0)
        correlation[np.ix_(moving, moving)] = Z.T @ Z
    return correlation


def variance_inflation(correlation: np.ndarray) -> np.ndarray:
    """Return the variance inflation factors: diagonal of the inverse correlation matrix."""
    return np.diag(np.linalg.inv(correlation))


def variance_decomposition(X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return condition indexes and variance proportions of the regressors [Belsley1980]_.

    The regressors are scaled to unit length.

    Parameters
    ----------
    X : array (rows, terms)
        Regressors, including the constant.

    Returns
    -------
    index : array (components,)
        Largest singular value over each, in rising order.
    proportion : array (components, terms)
        Share of the variance of each estimate that comes from each component; the columns sum to
        one.
    """
    _, s, Vt = np.linalg.svd(X / np.linalg.norm(X, axis=0), full_matrices=False)
    # Var(theta_k) is proportional to sum_j (v_kj/s_j)^2 over the components j.
    share = (Vt / s[:, None]) ** 2
    return s[0] / s, share / share.sum(axis=0)


def collinear_terms(estimates: xr.Dataset) -> list[tuple[float, str]]:
    """Return condition indexes above 30 on which two or more terms depend, with these terms.

    Parameters
    ----------
    estimates : Dataset
        With ``condition_index`` (component) and ``proportion`` (component, term). A term depends on
        a component if more than half of its variance comes from it [Belsley1980]_.

    Returns
    -------
    list of (condition index, text)
    """
    terms = [str(term) for term in estimates["term"].values]
    dependencies = []
    for index, share in zip(estimates["condition_index"].values, estimates["proportion"].values):
        involved = np.flatnonzero(share > SHARE)
        if index > CONDITION and len(involved) >= 2:
            texts = [f"{terms[j]} ({100 * share[j]:.0f} %)" for j in involved]
            dependencies.append((float(index), " with ".join(texts)))
    return dependencies


def describe_combination(vector: np.ndarray, terms: Sequence[str]) -> str:
    """Return a vector over scaled regressors as text, such as ``0.71 alpha - 0.70 qhat``.

    Parameters
    ----------
    vector : array (terms,)
        Coefficients; those below a tenth of the largest are left out.
    terms : sequence of str
    """
    size = np.abs(vector)
    order = [j for j in np.argsort(-size) if size[j] > 0.1 * size.max()]
    sign = np.sign(vector[order[0]])
    parts = []
    for j in order:
        operator = "-" if sign * vector[j] < 0 else "+"
        parts.append(f"{operator} {abs(vector[j]):.2f} {terms[j]}")
    return " ".join(parts).removeprefix("+ ") + " (each scaled to unit length)"

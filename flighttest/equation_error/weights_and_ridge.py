"""Weights of samples and the penalty of a ridge."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError

WEIGHTS = ("equal", "manoeuvre", "robust")
HUBER = 1.345  # scaled deviations from which on a residual loses weight: 95 % efficiency on Gaussian noise
_ROUNDS = 20
_STILL = 1e-4


def roots(kind: str, X: np.ndarray, z: np.ndarray, data: xr.Dataset) -> np.ndarray:
    """Return the square roots of the weights, (samples,); their squares have the mean one.

    Parameters
    ----------
    kind : str
        One of `WEIGHTS`, or a variable of `data` with standard errors.
    X, z : array (samples, terms), (samples,)
    data : Dataset (sample,)
        With ``manoeuvre``.

    Raises
    ------
    IdentificationError
        Standard errors that are not positive.
    """
    if kind == "equal":
        return np.ones(len(z))
    if kind not in WEIGHTS:
        sigma = data[kind].values
        if not (sigma > 0).all():
            raise IdentificationError(f"{kind} is not positive in {int((~(sigma > 0)).sum())} samples; a standard error is needed in each")
        return _scaled(1.0 / sigma)
    root, rule = np.ones(len(z)), _by_manoeuvre if kind == "manoeuvre" else _huber
    for _ in range(_ROUNDS):
        theta = np.linalg.lstsq(X * root[:, None], z * root, rcond=None)[0]
        last, root = root, _scaled(rule(z - X @ theta, data["manoeuvre"].values))
        if np.abs(root - last).max() < _STILL:
            break
    return root


def ridge_penalty(ridge: float | str, X: np.ndarray, z: np.ndarray, fixed: np.ndarray) -> tuple[np.ndarray, float]:
    """Return what a ridge adds to the diagonal of X'X, (terms,), and the ridge parameter.

    Parameters
    ----------
    ridge : float or "auto"
        The parameter on standardised regressors; ``auto``: n s^2/(theta' theta) of the standardised regression.
    X, z : array (rows, terms), (rows,)
    fixed : array of bool (terms,)
        Intercepts, which are not penalised.

    Raises
    ------
    IdentificationError
        A negative parameter.
    """
    length2 = np.where(fixed, 0.0, ((X - (X.mean(axis=0) if fixed.any() else 0.0)) ** 2).sum(axis=0))
    if ridge == "auto":
        theta = np.linalg.lstsq(X, z, rcond=None)[0]
        v = z - X @ theta
        s2 = float(v @ v) / (len(z) - len(theta))
        ridge = float((~fixed).sum() * s2 / (length2 * theta**2).sum())
    if isinstance(ridge, str) or not ridge >= 0.0:
        raise IdentificationError(f"ridge is {ridge!r}; expected a number that is not negative, or 'auto'")
    return ridge * length2, float(ridge)


def _by_manoeuvre(v: np.ndarray, manoeuvre: np.ndarray) -> np.ndarray:
    rms = np.sqrt(np.bincount(manoeuvre, v**2) / np.maximum(np.bincount(manoeuvre), 1))
    least = 1e-6 * rms.max() or 1.0
    return 1.0 / np.maximum(rms, least)[manoeuvre]


def _huber(v: np.ndarray, manoeuvre: np.ndarray) -> np.ndarray:
    scale = 1.4826 * float(np.median(np.abs(v - np.median(v))))
    return np.sqrt(np.minimum(1.0, HUBER * scale / np.maximum(np.abs(v), 1e-300))) if scale else np.ones(len(v))


def _scaled(root: np.ndarray) -> np.ndarray:
    return root / np.sqrt(np.mean(root**2))

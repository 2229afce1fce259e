"""Least distance under linear inequalities."""

from __future__ import annotations

import numpy as np


def least_distance(G: np.ndarray, h: np.ndarray) -> np.ndarray | None:
    """Return the shortest z (n,) with G z >= h; None when no z satisfies all of them.

    Parameters
    ----------
    G : array (m, n)
    h : array (m,)

    References
    ----------
    .. [Lawson1974] Lawson, Hanson, Solving Least Squares Problems, Prentice-Hall 1974, chapter 23, algorithm LDP.
    """
    from scipy.optimize import nnls

    if not len(G) or (h <= 0.0).all():
        return np.zeros(G.shape[1])
    scale = np.maximum(np.linalg.norm(G, axis=1), 1e-12)
    G, h = G / scale[:, None], h / scale
    E = np.vstack([G.T, h])
    f = np.append(np.zeros(G.shape[1]), 1.0)
    u, _ = nnls(E, f, maxiter=30 * E.shape[1])
    r = E @ u - f
    z = -r[:-1] / r[-1] if abs(r[-1]) > 1e-12 else None
    return z if z is not None and (G @ z >= h - 1e-6 * (1.0 + np.abs(h))).all() else None

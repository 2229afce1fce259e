"""Quadratic model of a cost at an iterate: its steps with constraints, and its curvature.

References
----------
.. [Dennis1981] Dennis, Gay, Welsch, An adaptive nonlinear least-squares algorithm, ACM Trans.
   Mathematical Software 7, 1981 (sized secant part of the curvature).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

# Smallest eigenvalue of the information scaled to unit diagonal that counts.
_LEAST_EIGENVALUE = 1e-14
# Least curvature of the cost in any direction over the information.
_LEAST_CURVATURE = 0.2


class QuadraticModel(NamedTuple):
    """Quadratic model of the cost at an iterate, and what holds there.

    Attributes
    ----------
    slopes : any
        Slopes of the sides on which the step goes.
    M, g : array (unknown, unknown), (unknown,)
        Information and downhill gradient.
    scale : array (unknown,)
        Unit of each unknown in which M has a unit diagonal.
    values, vectors : array
        Eigenvalues and eigenvectors of M in these units.
    bounds : dict of int to float
        Unknowns held at a bound.
    kinks : dict of int to float
        Ratios held at a kink.
    inside : array of bool (kink,)
        Whether the step goes inside.
    """

    slopes: Any
    M: np.ndarray
    g: np.ndarray
    scale: np.ndarray
    values: np.ndarray
    vectors: np.ndarray
    bounds: dict[int, float]
    kinks: dict[int, float]
    inside: np.ndarray

    def solve(
        self, A: np.ndarray, b: np.ndarray, damping: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the step with A d = b, its multipliers, and the size of one per row."""
        root = self.scale[:, None] * self.vectors
        root = root / np.sqrt(np.maximum(self.values, _LEAST_EIGENVALUE) + damping)
        free = root @ (root.T @ self.g)
        if not len(A):
            return free, np.zeros(0), np.zeros(0)
        # rows of A in standard errors, so that their products have a unit diagonal
        B = A @ root
        size = np.sqrt((B**2).sum(axis=1))
        B = B / size[:, None]
        multipliers = np.linalg.lstsq(B @ B.T, b / size - A @ free / size, rcond=1e-12)[0]
        return free + root @ (B.T @ multipliers), multipliers / size, size


def updated_bend(M: np.ndarray, C: np.ndarray, step: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Return what the curvature of the cost has beyond the information, after a step [Dennis1981]_.

    Parameters
    ----------
    M, C : array (unknown, unknown)
        Information at the end of the step, and the last result.
    step, change : array (unknown,)
        Step, and by how much the downhill gradient fell along it.
    """
    along = float(step @ C @ step)
    if along != 0.0:
        C = C * min(1.0, abs(float(step @ (change - M @ step)) / along))
    B = M + C
    pushed = B @ step
    curved, by_change = float(step @ pushed), float(step @ change)
    if curved > 0.0:
        # Powell's damping keeps the curvature positive.
        part = 1.0 if by_change >= 0.2 * curved else 0.8 * curved / (curved - by_change)
        change = part * change + (1.0 - part) * pushed
        B = B - np.outer(pushed, pushed) / curved
        B = B + np.outer(change, change) / float(step @ change)
    return _limit_bend(M, B - M)


def _limit_bend(M: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Return C with no direction in which M + C is less than `_LEAST_CURVATURE` of M."""
    scale = 1.0 / np.sqrt(np.diag(M))
    values, vectors = np.linalg.eigh(M * np.outer(scale, scale))
    roots = np.sqrt(np.maximum(values, _LEAST_EIGENVALUE))
    inverse = scale[:, None] * vectors / roots
    relative, turned = np.linalg.eigh(inverse.T @ C @ inverse)
    root = vectors * roots / scale[:, None] @ turned
    return (root * np.maximum(relative, _LEAST_CURVATURE - 1.0)) @ root.T

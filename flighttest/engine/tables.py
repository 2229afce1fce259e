"""A table over one axis with the joint covariance of its nodes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.terms import make

FINE = 0.01  # distance of the nodes, in throttle and in speed
_STEP = 1e-6  # of a difference


@dataclass(frozen=True)
class Curve:
    """An identified table over one axis.

    Attributes
    ----------
    leaf : Dataset
        ``value`` and ``stderr``.
    covariance : array (node, node)
    """

    leaf: xr.Dataset
    covariance: np.ndarray

    @classmethod
    def of(cls, axis: str, at: np.ndarray, nodes: Callable[[np.ndarray], np.ndarray], theta: np.ndarray, C: np.ndarray) -> Curve:
        """Return the table from unknowns with their covariance.

        Parameters
        ----------
        axis : str
        at : array (node,)
        nodes : callable
            Nodes from the unknowns (unknown,).
        theta, C : array (unknown,), (unknown, unknown)
        """
        slopes = np.column_stack([(nodes(theta + _STEP * e) - nodes(theta - _STEP * e)) / (2.0 * _STEP) for e in np.eye(len(theta))])
        covariance = slopes @ C @ slopes.T
        stderr = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        outside = "linear" if axis == "throttle" else "hold"
        return cls(make(nodes(theta), {axis: at}, stderr=stderr, source="flight", outside=outside), covariance)

    def lines(self, name: str, rows: int = 12) -> list[str]:
        """Return some of the nodes as lines of text."""
        axis = str(self.leaf["value"].dims[0])
        some = np.unique(np.linspace(0, self.leaf.sizes[axis] - 1, rows).round().astype(int))
        head = f"{name}: {axis:>12}{'value':>12}{'stderr':>10}"
        nodes = zip(self.leaf[axis].values[some], self.leaf["value"].values[some], self.leaf["stderr"].values[some])
        return [head, *(f"{x:>{len(name) + 14}.4f}{v:>12.5g}{s:>10.2g}" for x, v, s in nodes)]

    def at(self, place: float) -> tuple[float, float]:
        """Return value and standard error at a place inside the table.

        Raises
        ------
        IdentificationError
            Outside of it.
        """
        axis = str(self.leaf["value"].dims[0])
        points = self.leaf[axis].values
        if not points[0] - 0.01 <= place <= points[-1] + 0.01:
            raise IdentificationError(f"identified for {axis} from {points[0]:.4g} to {points[-1]:.4g}; {place:.4g} is outside")
        w = np.array([np.interp(place, points, row) for row in np.eye(len(points))])
        return float(w @ self.leaf["value"].values), float(np.sqrt(w @ self.covariance @ w))


def fine(knots: np.ndarray) -> np.ndarray:
    """Return nodes at and evenly between the knots."""
    if len(knots) < 2:
        raise IdentificationError("one position of the lever, or one speed; add records at other powers")
    parts = [np.linspace(a, b, max(int(np.ceil((b - a) / FINE)), 1), endpoint=False) for a, b in pairwise(knots)]
    return np.append(np.concatenate(parts), knots[-1])

"""Tables over the height: one factor for all terms, or one for each term.

A factor is linear between breakpoints, and zero from its last one on.  Landings pass the heights
above the low passes in seconds and with one angle of attack.  There a factor of the constant and
one of the slope are determined by their sum only, and noise of the angle of attack lowers the
slope: the T-37's were +0.7 and -0.8 from 16 to 36 m, where its ground effect is zero.  So a table
ends at the highest node that is determined.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from flighttest.regression.equation_error.samples import RegressionSamples
from flighttest.regression.uncertainty.collinearity import RANK
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of
from flighttest.submodels.ground_effect.evidence import NEAR, schwarz_criterion

# Names of the two forms.
ONE_FACTOR, SEPARATE = "table, one K", "table"
# Standard errors from zero of the highest node of a table: it is the largest of several.
_SIGNIFICANT = 3.0
# Largest ratio of a node to those below it. A ground effect does not grow with the height;
# the ratio leaves room for a plateau with noise.
_GROWTH = 2.0
# Change of a factor at which the iteration of the free-air coefficients ends, and its most steps.
_CHANGE, _STEPS = 1e-9, 200


@dataclass(frozen=True)
class HeightTable:
    """Ground terms as tables over the height.

    Attributes
    ----------
    form : str
        `ONE_FACTOR` or `SEPARATE`.
    terms : tuple of str
        Ground terms.
    heights : array (nodes,)
        Breakpoints. [m]
    value, stderr : array (terms, nodes)
        Coefficient per unit of each ground term. From the end of a table on it is zero, with what
        the node was as its error.
    free : array (free terms,)
        Estimated free-air coefficients.
    residual : array (samples,)
        Measured minus fitted coefficient.
    parameters : int
        Number of estimated free-air coefficients and nodes.
    """

    form: str
    terms: tuple[str, ...]
    heights: np.ndarray
    value: np.ndarray
    stderr: np.ndarray
    free: np.ndarray
    residual: np.ndarray
    parameters: int

    def end(self, term: str) -> float:
        """Return the height from which on the table of a term is zero. [m]"""
        last = np.flatnonzero(self.value[self.terms.index(term)])[-1]
        return float(self.heights[last + 1])

    def is_undetermined(self, row: int, end: int) -> bool:
        """Return whether the last node before `end` is near zero, or one grows with the height."""
        sizes = np.abs(self.value[row, :end])
        if sizes[-1] < _SIGNIFICANT * self.stderr[row, end - 1]:
            return True
        largest_below = np.maximum.accumulate(sizes)[:-1]
        return bool((sizes[1:] > _GROWTH * largest_below).any())


class TableSearch:
    """Search for the tables over the height of one coefficient.

    Parameters
    ----------
    X : array (samples, free terms)
        Regressors of the estimated free-air terms.
    free : sequence of str
        Their names.
    ground : sequence of str
        Terms that the ground may change.
    regressors : array (samples, ground terms)
        Regressors of these terms.
    samples : RegressionSamples
        Samples of the coefficient, for the colour of the residuals.
    h, z : array (samples,)
        Height [m] and measured coefficient.
    heights : array (nodes,)
        Increasing breakpoints; the last one is free air.
    n : float
        Number of independent samples.
    held : dict of str to float
        Free-air coefficients of the ground terms whose free-air part is already subtracted.
    """

    def __init__(
        self,
        X: np.ndarray,
        free: Sequence[str],
        ground: Sequence[str],
        regressors: np.ndarray,
        samples: RegressionSamples,
        h: np.ndarray,
        z: np.ndarray,
        heights: np.ndarray,
        n: float,
        held: dict[str, float],
    ):
        self.X, self.z, self.samples, self.n = X, z, samples, n
        self.heights, self.held = heights, held
        self.free, self.ground = list(free), tuple(ground)
        self.nodes = len(heights) - 1
        self.products = table_regressors(regressors, h, heights)
        # The triangular factor has the same sums of squares as the samples, with few rows.
        self.R: Any = np.linalg.qr(np.column_stack([X, self.products, z]), mode="r")

    # Tables of each term -----------------------------------------------------------------------

    def separate(self, nothing: float) -> HeightTable | None:
        """Return the tables of the terms with the least criterion.

        It is None where no table lowers the criterion `nothing` without ground effect.
        """
        best: tuple[int, ...] = ()
        least = nothing
        for chosen in list_subsets(range(len(self.ground))):
            columns = self.columns_of({k: self.nodes for k in chosen})
            v = least_squares_residual(self.R[:, columns], self.R[:, -1])
            criterion = self._criterion(v, len(columns))
            if criterion < least and not is_short_of_rank(self.R[:, columns]):
                best, least = chosen, criterion
        return self.determined(best)

    def determined(self, chosen: Sequence[int]) -> HeightTable | None:
        """Return the tables of chosen terms, each up to its highest node that is determined."""
        ends = {k: self.nodes for k in chosen}
        dropped = np.zeros((len(self.ground), self.nodes + 1))
        while ends:
            table = self._fit_separate(ends)
            worst, least = None, np.inf
            for row, (k, end) in enumerate(ends.items()):
                t = abs(table.value[row, end - 1]) / table.stderr[row, end - 1]
                if table.is_undetermined(row, end) and t < least:
                    worst, least = k, t
            if worst is None:
                rows = list(ends)
                return replace(table, stderr=table.stderr + dropped[rows])
            ends[worst] -= 1
            # A node that is set to zero is known to what it was, and to its error.
            row, node = table.terms.index(self.ground[worst]), ends[worst]
            dropped[worst, node] = np.hypot(table.value[row, node], table.stderr[row, node])
            if not ends[worst]:
                del ends[worst]
        return None

    def columns_of(self, ends: dict[int, int]) -> list[int]:
        """Return the columns of the free-air terms and of the first nodes of ground terms."""
        p = self.X.shape[1]
        columns = list(range(p))
        for k, end in ends.items():
            columns += range(p + k * self.nodes, p + k * self.nodes + end)
        return columns

    def _fit_separate(self, ends: dict[int, int]) -> HeightTable:
        """Return the least squares of the first nodes of ground terms."""
        columns = self.columns_of(ends)
        J = np.column_stack([self.X, self.products])[:, columns]
        theta = np.linalg.lstsq(J, self.z, rcond=None)[0]
        v = self.z - J @ theta
        errors = np.sqrt(np.diag(coloured_covariance_of(J, v, *self.samples.pieces()).covariance))
        value = np.zeros((len(ends), self.nodes + 1))
        stderr = np.zeros_like(value)
        # The nodes of the ground terms follow the free-air terms; free air itself is zero.
        first = self.X.shape[1]
        for row, end in enumerate(ends.values()):
            value[row, :end] = theta[first : first + end]
            stderr[row, :end] = errors[first : first + end]
            first += end
        return HeightTable(
            SEPARATE,
            tuple(self.ground[k] for k in ends),
            self.heights,
            value=value,
            stderr=stderr,
            free=theta[: self.X.shape[1]],
            residual=v,
            parameters=len(columns),
        )

    # One factor for all terms --------------------------------------------------------------------

    def one_factor(self) -> HeightTable | None:
        """Return one table of the factor K(h) for several terms, y = y_inf (1 + K).

        Of nearly equal sets of terms it is the smallest one.  It is None where fewer than two terms
        have a free-air coefficient, or where the samples do not determine the factor.
        """
        known = [k for k, term in enumerate(self.ground) if self._has_free_air(term)]
        criteria = {}
        for chosen in list_subsets(known):
            columns = self.columns_of({k: self.nodes for k in chosen})
            if len(chosen) < 2 or is_short_of_rank(self.R[:, columns]):
                continue
            v = self._solve_one(chosen, self.nodes)[2]
            criteria[chosen] = self._criterion(v, self.X.shape[1] + self.nodes)
        if not criteria:
            return None
        least = min(criteria.values())
        near = [chosen for chosen, value in criteria.items() if value <= least + NEAR]
        best = min(near, key=lambda chosen: (len(chosen), criteria[chosen]))
        dropped = np.zeros((len(best), self.nodes + 1))
        for end in range(self.nodes, 0, -1):
            table = self._fit_one(best, end)
            # All rows have the same ratio to their standard errors.
            if not table.is_undetermined(0, end):
                table = replace(table, stderr=table.stderr + dropped)
                return self._with_assumption(table, best)
            dropped[:, end - 1] = np.hypot(table.value[:, end - 1], table.stderr[:, end - 1])
        return None

    def _has_free_air(self, term: str) -> bool:
        """Return whether a ground term has a free-air coefficient."""
        return term in self.held or (term in self.free and bool(self.X.shape[1]))

    def _solve_one(
        self, chosen: Sequence[int], end: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return free-air coefficients, factors (end,) and the residual in rows of R."""
        p = self.X.shape[1]
        X, z = self.R[:, :p], self.R[:, -1]
        products = self.R[:, p:-1].reshape(len(self.R), len(self.ground), self.nodes)
        products = products[:, list(chosen), :end]
        theta, K = np.linalg.lstsq(X, z, rcond=None)[0] if p else np.zeros(0), np.zeros(end)
        for _ in range(_STEPS):
            # The form is linear in the factors for given coefficients, and in these for factors.
            A = np.tensordot(products, self._sizes(chosen, theta), axes=(1, 0))
            new = np.linalg.lstsq(A, z - X @ theta, rcond=None)[0]
            theta = np.linalg.lstsq(self._scaled(X, products, chosen, new), z, rcond=None)[0]
            change, K = np.abs(new - K).max(), new
            if change < _CHANGE or not p:
                break
        if not p:
            return theta, K, z - np.tensordot(products, self._sizes(chosen, theta), (1, 0)) @ K
        return theta, K, z - self._scaled(X, products, chosen, K) @ theta

    def _sizes(self, chosen: Sequence[int], theta: np.ndarray) -> np.ndarray:
        """Return the free-air coefficients of chosen ground terms."""
        names = [self.ground[k] for k in chosen]
        if not self.X.shape[1]:
            return np.array([self.held[name] for name in names])
        return np.array([theta[self.free.index(name)] for name in names])

    def _scaled(
        self, X: np.ndarray, products: np.ndarray, chosen: Sequence[int], K: np.ndarray
    ) -> np.ndarray:
        """Return the regressors of the free-air coefficients for given factors."""
        scaled = X.copy()
        if X.shape[1]:
            for row, k in enumerate(chosen):
                scaled[:, self.free.index(self.ground[k])] += products[:, row] @ K
        return scaled

    def _fit_one(self, chosen: Sequence[int], end: int) -> HeightTable:
        """Return the least squares of one factor with its first nodes."""
        theta, K, _ = self._solve_one(chosen, end)
        products = self.products.reshape(len(self.z), len(self.ground), self.nodes)
        products = products[:, list(chosen), :end]
        sizes = self._sizes(chosen, theta)
        A = np.tensordot(products, sizes, axes=(1, 0))
        scaled = self._scaled(self.X, products, chosen, K)
        v = self.z - self.X @ theta - A @ K
        # Derivatives with respect to the free-air coefficients and to the factors.
        J = np.column_stack([scaled, A])
        C = coloured_covariance_of(J, v, *self.samples.pieces()).covariance
        stderr = np.sqrt(np.diag(C))[len(theta) :]
        empty = np.zeros(self.nodes + 1 - end)
        return HeightTable(
            ONE_FACTOR,
            tuple(self.ground[k] for k in chosen),
            self.heights,
            value=np.outer(sizes, np.concatenate([K, empty])),
            stderr=np.outer(np.abs(sizes), np.concatenate([stderr, empty])),
            free=theta,
            residual=v,
            parameters=J.shape[1],
        )

    def _with_assumption(self, table: HeightTable, chosen: Sequence[int]) -> HeightTable:
        """Return one factor with the error of its assumption, the difference from separate ones."""
        apart = np.zeros_like(table.value)
        separate = self.determined(chosen)
        if separate is not None:
            for row, term in enumerate(separate.terms):
                apart[table.terms.index(term)] = separate.value[row]
        return replace(table, stderr=np.hypot(table.stderr, table.value - apart))

    def _criterion(self, v: np.ndarray, parameters: int) -> float:
        """Return the criterion of a residual in rows of R."""
        mean_square = float(v @ v) / len(self.z)
        return schwarz_criterion(np.sqrt([mean_square]), parameters, self.n)


def table_regressors(ground: np.ndarray, h: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """Return the regressors of tables over the height, (samples, ground terms times nodes).

    Parameters
    ----------
    ground : array (samples, ground terms)
    h : array (samples,)
    heights : array (nodes + 1,)
        Breakpoints. The last one, free air, has no regressor.
    """
    # Linear interpolation: hat functions of all breakpoints except the last, (samples, nodes).
    hats = np.array([np.interp(h, heights, hat) for hat in np.eye(len(heights))[:-1]]).T
    return (ground[:, :, None] * hats[:, None, :]).reshape(len(h), -1)


def list_subsets(items: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """Yield all subsets except the empty one, the small ones first."""
    for count in range(1, len(items) + 1):
        yield from combinations(items, count)


def is_short_of_rank(X: np.ndarray) -> bool:
    """Return whether a combination of the regressors vanishes."""
    length = np.linalg.norm(X, axis=0)
    if not length.all():
        return True
    sizes = np.linalg.svd(X / length, compute_uv=False)
    return bool(sizes[-1] < RANK * sizes[0])


def least_squares_residual(X: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return the residual of least squares."""
    if not X.shape[1]:
        return z
    return z - X @ np.linalg.lstsq(X, z, rcond=None)[0]

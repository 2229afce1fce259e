"""Expected standard errors of a database after fits whose estimates are not known yet.

The posterior covariance of `aerodb.tabulate` depends on the estimates only through the weights that
it learns.  The expectation uses the a-priori weights of the parts of the prior covariance and the
declared errors of the fits, and every fit has full weight.  It holds if the declared errors are
right.  After a first tabulation, the weights and the factor on the errors that `tabulate` learnt
replace the a-priori ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
import xarray as xr

from aerodb.store.schema import terms
from aerodb.update.correlation import LENGTHS, PARTS, SHARES, prior_parts
from aerodb.update.observations import (
    CoefficientTerms,
    Observation,
    coefficient_of,
    common_errors_of_fits,
    known_terms,
    observe_fit,
    observed_nodes,
    sampled_weights,
)
from aerodb.update.tabulation import FLOWN, slices_of
from aerodb.update.tabulation_report import Tabulation
from aerodb.update.weights.weight_likelihood import invert_covariance, updated_variance

# A-priori weights of the `PARTS`.
_WEIGHTS = np.array(list(SHARES.values()))


class Expectation:
    """Expected standard errors of the nodes of a database after any of several fits.

    The observation of each fit is computed once.

    Parameters
    ----------
    prior : DataTree
        The database; its leaves need ``stderr``.
    held : sequence of str
        Terms that keep their values, as in `aerodb.tabulate`.
    lengths : mapping, optional
        As in `aerodb.tabulate`. [SI]
    learnt : Tabulation, optional
        Result of earlier flights with the same prior.  It has the weights of the parts of the prior
        covariance by term, and the factor on the standard errors of fits by coefficient.  Terms and
        coefficients that it does not have keep the a-priori ones.

    References
    ----------
    .. [Pukelsheim2006] Pukelsheim, Optimal Design of Experiments, SIAM 2006, chapter 11 (Bayesian
       designs).
    """

    def __init__(
        self,
        prior: xr.DataTree,
        held: Sequence[str] = (),
        lengths: Mapping[str, float] | None = None,
        learnt: Tabulation | None = None,
    ):
        self.prior, self.held, self.lengths = prior, held, {**LENGTHS, **(lengths or {})}
        self._weights: dict[str, np.ndarray] = {}
        self._inflation: dict[str, float] = {}
        if learnt is not None:
            for name, row in learnt.report[list(PARTS)].iterrows():
                self._weights[str(name)] = row.to_numpy(float)
            for name, factor in learnt.compatibility["inflation"].items():
                self._inflation[str(name)] = float(factor)
        self._leaves = terms(prior)
        self._terms_by_coefficient: dict[str, CoefficientTerms] = {}
        # By identity of the fit.  The fit itself is stored, so that its identity is not reused.
        self._observed: dict[int, tuple[Any, Observation]] = {}

    def stderr(
        self, fits: Sequence[Any], wanted: Mapping[str, np.ndarray] | None = None
    ) -> dict[str, np.ndarray]:
        """Return the standard errors of nodes after some fits.

        Parameters
        ----------
        fits : sequence of Fit
            Fits of flights, or predicted fits.  Their estimates are not used; otherwise as in
            `aerodb.tabulate`.
        wanted : mapping of str to bool array, optional
            Requested nodes by term, in the shape of its table.  The default is all nodes of the
            terms of the fitted coefficients.

        Returns
        -------
        dict of str to array
            In the shape of the table; NaN at nodes that are not requested.  A term that does not
            enter any fit keeps its standard errors.

        Raises
        ------
        SchemaError, UnknownName
            As `aerodb.tabulate`.
        """
        requested = wanted
        if requested is None:
            requested = self._all_nodes({coefficient_of(fit) for fit in fits})
        errors: dict[str, np.ndarray] = {}
        coefficients: dict[str, dict[str, np.ndarray]] = {}
        for name, nodes in requested.items():
            errors[name] = np.where(nodes, self._leaves[name]["stderr"].values, np.nan)
            coefficients.setdefault(name.split("/")[0], {})[name] = nodes
        for coefficient, nodes_by_term in coefficients.items():
            local = [fit for fit in fits if coefficient_of(fit) == coefficient]
            if local:
                errors |= self._coefficient_stderr(coefficient, local, nodes_by_term)
        return errors

    def stderr_of(self, fits: Sequence[Any], gradients: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the standard errors of quantities that are linear in nodes of several terms.

        Nodes of different coefficients are independent, but for the errors of mass, thrust and
        instruments, which all fits share.

        Parameters
        ----------
        fits : sequence of Fit
            As in `stderr`.
        gradients : mapping of str to array (quantity, *axes)
            Change of the quantities by the nodes of a term, in the shape of its table.

        Returns
        -------
        array (quantity,)
        """
        spreads = []
        for coefficient in dict.fromkeys(name.split("/")[0] for name in gradients):
            local = [fit for fit in fits if coefficient_of(fit) == coefficient]
            spreads.append(self.spread_of(coefficient, local, gradients))
        return sum_spreads(spreads)

    def spread_of(
        self, coefficient: str, fits: Sequence[Any], gradients: Mapping[str, np.ndarray]
    ) -> LinearSpread:
        """Return the part of `stderr_of` by the terms of one coefficient.

        Parameters
        ----------
        coefficient : str
        fits : sequence of Fit
            Fits of this coefficient.
        gradients : mapping of str to array (quantity, *axes)
            Terms of other coefficients are ignored.
        """
        own = {}
        for name, gradient in gradients.items():
            if name.split("/")[0] == coefficient:
                own[name] = gradient.reshape(len(gradient), -1)
        count = len(next(iter(own.values())))
        observed = [self.observation(fit) for fit in fits]
        blocks: dict[str, _PriorBlock] = {}
        expected: np.ndarray | float = 0.0
        if observed:
            H, (D, names) = np.vstack([one.H for one in observed]), align_errors(observed)
            requested = {name: np.any(G != 0.0, axis=0) for name, G in own.items()}
            found, expected = self._prior_blocks(coefficient, observed, H, requested=requested)
            blocks = {block.name: block for block in found}
        variance = np.zeros(count)
        for name, G in own.items():
            if name in blocks:
                P, nodes = blocks[name].covariance, blocks[name].nodes
            else:
                # No fit informs the term, or it is held: it keeps its declared standard errors.
                nodes = np.flatnonzero(np.any(G != 0.0, axis=0))
                P = self._prior_of(name, np.zeros(G.shape[1]), nodes=nodes)
                P = P / self._weights.get(name, _WEIGHTS).sum()
            variance += np.einsum("qi,ij,qj->q", G[:, nodes], P, G[:, nodes])
        if not observed:
            return LinearSpread(variance, {})
        crossed = np.zeros((count, len(H)))
        for name, block in blocks.items():
            if name in own:
                crossed += own[name][:, block.nodes] @ block.crossed
        S, shared = self._estimate_covariances(coefficient, observed, expected)
        gain = crossed @ invert_covariance(S)
        effects = gain @ D
        # As in `_coefficient_stderr`. The errors with a name are added over the coefficients.
        variance = updated_variance(variance, crossed, gain, shared)
        variance += (effects[:, len(names) :] ** 2).sum(axis=1)
        return LinearSpread(variance, dict(zip(names, effects.T[: len(names)], strict=True)))

    def flown(self, fits: Sequence[Any]) -> dict[str, np.ndarray]:
        """Return which nodes lie in the flown region of some fits, by term.

        The region is that of `aerodb.tabulate`.
        """
        is_flown: dict[str, np.ndarray] = {}
        for coefficient in dict.fromkeys(map(coefficient_of, fits)):
            local = [fit for fit in fits if coefficient_of(fit) == coefficient]
            observed = [self.observation(fit) for fit in local]
            touched, sampled = observed_nodes(observed), sampled_weights(observed)
            for name, nodes in self.node_slices(coefficient).items():
                flown_nodes = ((sampled >= FLOWN) & touched)[nodes]
                is_flown[name] = flown_nodes.reshape(self._leaves[name]["value"].shape)
        return is_flown

    def _all_nodes(self, coefficients: set[str]) -> dict[str, np.ndarray]:
        """Return all nodes of the terms of some coefficients that may change."""
        nodes = {}
        for name, leaf in self._leaves.items():
            if name.split("/")[0] in coefficients and name not in self.held:
                nodes[name] = np.ones(leaf["value"].shape, bool)
        return nodes

    def leaf(self, name: str) -> xr.Dataset:
        """Return the table of a term of the prior."""
        return self._leaves[name]

    def _coefficient_terms(self, coefficient: str) -> CoefficientTerms:
        if coefficient not in self._terms_by_coefficient:
            (group,) = known_terms([coefficient], self.prior, self.held)
            self._terms_by_coefficient[coefficient] = group
        return self._terms_by_coefficient[coefficient]

    def node_slices(self, coefficient: str) -> dict[str, slice]:
        """Return the range of each free term among the free nodes of a coefficient."""
        free = self._coefficient_terms(coefficient).free
        return dict(zip(free, slices_of(free.values()), strict=True))

    def observation(self, fit: Any) -> Observation:
        """Return the observation by a fit, with its common errors first in D."""
        if id(fit) not in self._observed:
            sources = common_errors_of_fits([fit])
            group = self._coefficient_terms(coefficient_of(fit))
            observation = observe_fit(fit, group, sources)
            # The bases are as large as the samples and are not needed again.
            self._observed[id(fit)] = fit, replace(observation, bases={})
        return self._observed[id(fit)][1]

    def _coefficient_stderr(
        self, coefficient: str, fits: Sequence[Any], requested: Mapping[str, np.ndarray]
    ) -> dict[str, np.ndarray]:
        """Return the standard errors of the requested nodes of one coefficient, by term."""
        observed = [self.observation(fit) for fit in fits]
        H, (D, _) = np.vstack([observation.H for observation in observed]), align_errors(observed)
        blocks, expected = self._prior_blocks(coefficient, observed, H, requested=requested)
        S, shared = self._estimate_covariances(coefficient, observed, expected)
        inverse = invert_covariance(S)
        errors = {}
        for block in blocks:
            if block.name not in requested:
                continue
            crossed = block.crossed[block.requested]
            gain = crossed @ inverse
            before = np.diag(block.covariance)[block.requested]
            variance = updated_variance(before, crossed, gain, shared)
            variance += ((gain @ D) ** 2).sum(axis=1)
            stderr = np.full(requested[block.name].size, np.nan)
            stderr[block.nodes[block.requested]] = np.sqrt(np.maximum(variance, 0.0))
            errors[block.name] = stderr.reshape(requested[block.name].shape)
        return errors

    def _estimate_covariances(
        self, coefficient: str, observed: Sequence[Observation], expected: np.ndarray | float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the covariance of all estimates, and that without common errors of the fits."""
        # As in `aerodb.update.tabulation`: each fit has the common errors for itself in the gain.
        # Their covariance is replaced by that of errors that all fits share.
        own_errors = scipy.linalg.block_diag(
            *[observation.D @ observation.D.T for observation in observed]
        )
        measured = scipy.linalg.block_diag(*[observation.C for observation in observed])
        shared = expected + self._inflation.get(coefficient, 1.0) ** 2 * measured
        return shared + own_errors, shared

    def _prior_of(self, name: str, sampled: np.ndarray, *, nodes: np.ndarray) -> np.ndarray:
        """Return the prior covariance of some nodes of a term."""
        parts = prior_parts(self._leaves[name], sampled, self.lengths, nodes=nodes)
        return np.einsum("k,kij->ij", self._weights.get(name, _WEIGHTS), parts)

    def _prior_blocks(
        self,
        coefficient: str,
        observed: Sequence[Observation],
        H: np.ndarray,
        *,
        requested: Mapping[str, np.ndarray],
    ) -> tuple[list[_PriorBlock], np.ndarray | float]:
        """Return the prior of the nodes of each observed term, and H P H'."""
        touched, sampled = np.abs(H).max(axis=0) > 0, sampled_weights(observed)
        blocks: list[_PriorBlock] = []
        expected: np.ndarray | float = 0.0
        for name, rows in self.node_slices(coefficient).items():
            if not touched[rows].any():
                continue
            leaf = self._leaves[name]
            is_requested = np.zeros(leaf["value"].size, bool)
            if name in requested:
                is_requested = requested[name].ravel()
            # Nodes that are neither requested nor observed do not change the result.
            nodes = np.flatnonzero(is_requested | touched[rows] | (sampled[rows] > 0))
            P = self._prior_of(name, (sampled * touched)[rows], nodes=nodes)
            h = H[:, rows][:, nodes]
            PH = P @ h.T
            expected = expected + h @ PH
            block = _PriorBlock(
                name=name,
                nodes=nodes,
                requested=is_requested[nodes],
                covariance=P,
                crossed=PH,
            )
            blocks.append(block)
        return blocks, expected


@dataclass(frozen=True)
class LinearSpread:
    """Spread of quantities by the terms of one coefficient.

    Attributes
    ----------
    variance : array (quantity,)
        Without the errors that coefficients share.
    shared : dict of str to array (quantity,)
        Change of the quantities by one standard error of each shared error.
    """

    variance: np.ndarray
    shared: dict[str, np.ndarray]


def sum_spreads(spreads: Sequence[LinearSpread]) -> np.ndarray:
    """Return the standard errors (quantity,) of quantities with terms of several coefficients."""
    variance: np.ndarray | float = 0.0
    shared: dict[str, np.ndarray] = {}
    for spread in spreads:
        variance = variance + spread.variance
        for name, effect in spread.shared.items():
            shared[name] = shared.get(name, 0.0) + effect
    for effect in shared.values():
        variance = variance + effect**2
    return np.sqrt(np.maximum(variance, 0.0))


@dataclass(frozen=True)
class _PriorBlock:
    """A-priori distribution of the nodes of one term that matter to the result."""

    name: str
    nodes: np.ndarray  # (n,): positions in ``value.ravel()``
    requested: np.ndarray  # (n,), bool
    covariance: np.ndarray  # (n, n): P
    crossed: np.ndarray  # (n, estimates): P H'


def align_errors(observed: Sequence[Observation]) -> tuple[np.ndarray, list[str]]:
    """Return the common errors of all fits, (estimates, errors), and the names of the first ones.

    Errors of the same name share a column.  Columns of fixed terms follow.
    """
    columns: dict[str, int] = {}
    for observation in observed:
        for name in observation.errors:
            columns.setdefault(name, len(columns))
    rows = []
    for observation in observed:
        named = len(observation.errors)
        common = np.zeros((len(observation.D), len(columns)))
        common[:, [columns[name] for name in observation.errors]] = observation.D[:, :named]
        rows.append(np.hstack([common, observation.D[:, named:]]))
    return np.vstack(rows), list(columns)

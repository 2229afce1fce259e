"""Standard errors that a database will have after fits, before their estimates are known.

The posterior covariance of `aerodb.tabulate` does not depend on the estimates but through the
weights that it learns.  Here the parts of the prior covariance have their a-priori weights, the
errors of the fits are taken as declared, and no fit is an outlier: what flights will give when the
declared errors are right.  Once some flights have been tabulated, what `tabulate` learnt from them
takes the place of both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from scipy.linalg import block_diag

from aerodb.store.schema import terms
from aerodb.update.correlation import LENGTHS, PARTS, SHARES, prior_parts
from aerodb.update.observations import (
    CoefficientTerms,
    Observation,
    coefficient_of,
    common_errors_of_fits,
    known_terms,
    observe_fit,
)
from aerodb.update.tabulation import FLOWN, Tabulation, slices_of

_WEIGHTS = np.array(list(SHARES.values()))


class Expectation:
    """Standard errors of the nodes of a database after any of some fits; what a fit observes is
    worked out once.

    Parameters
    ----------
    prior : DataTree
        The database; its leaves need ``stderr``.
    held : sequence of str
        Terms that keep their values, as in `aerodb.tabulate`.
    lengths : mapping, optional
        As in `aerodb.tabulate`. [SI]
    learnt : Tabulation, optional
        Of flights done already, with the same prior: weights of the parts of the prior covariance
        by term, and the factor on the standard errors of fits by coefficient.  What it does not
        have keeps the a-priori ones.

    References
    ----------
    .. [Pukelsheim2006] Pukelsheim, Optimal Design of Experiments, SIAM 2006, chapter 11 (Bayesian designs).
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
            self._weights = {
                str(name): row.to_numpy(float)
                for name, row in learnt.report[list(PARTS)].iterrows()
            }
            self._inflation = {
                str(name): float(factor)
                for name, factor in learnt.compatibility["inflation"].items()
            }
        self._leaves = terms(prior)
        self._known: dict[str, CoefficientTerms] = {}
        self._observed: dict[int, tuple[Any, Observation, list[str]]] = {}

    def stderr(
        self, fits: Sequence[Any], wanted: Mapping[str, np.ndarray] | None = None
    ) -> dict[str, np.ndarray]:
        """Return the standard errors of nodes after some fits.

        Parameters
        ----------
        fits : sequence of Fit
            Fits of flights, or predicted ones; used is what `aerodb.tabulate` uses, but for the
            estimates.
        wanted : mapping of str to bool array, optional
            Nodes by term, in the shape of its table; without it all nodes of the terms of the
            coefficients that are fitted.

        Returns
        -------
        dict of str to array
            In the shape of the table; NaN at nodes that are not wanted.  A term that no fit touches
            keeps its standard errors.

        Raises
        ------
        SchemaError, UnknownName
            As `aerodb.tabulate`.
        """
        if wanted is None:
            mine = {coefficient_of(fit) for fit in fits}
            wanted = {
                n: np.ones(self._leaves[n]["value"].shape, bool)
                for n in self._leaves
                if n.split("/")[0] in mine and n not in self.held
            }
        found = {
            name: np.where(nodes, self._leaves[name]["stderr"].values, np.nan)
            for name, nodes in wanted.items()
        }
        for coefficient in dict.fromkeys(name.split("/")[0] for name in wanted):
            local = [fit for fit in fits if coefficient_of(fit) == coefficient]
            if local:
                found |= self._of_coefficient(
                    coefficient,
                    local,
                    {n: x for n, x in wanted.items() if n.split("/")[0] == coefficient},
                )
        return found

    def flown(self, fits: Sequence[Any]) -> dict[str, np.ndarray]:
        """Return which nodes lie in the region that some fits flew, by term, as `aerodb.tabulate`
        has it.
        """
        found: dict[str, np.ndarray] = {}
        for coefficient in dict.fromkeys(map(coefficient_of, fits)):
            observed = [
                self._observation(fit)[0] for fit in fits if coefficient_of(fit) == coefficient
            ]
            sampled = np.max([o.sampled for o in observed], axis=0)
            touched = np.any([np.abs(o.H).max(axis=0) > 0 for o in observed], axis=0)
            for name, nodes in self._slices(coefficient).items():
                found[name] = ((sampled >= FLOWN) & touched)[nodes].reshape(
                    self._leaves[name]["value"].shape
                )
        return found

    def _terms_of(self, coefficient: str) -> CoefficientTerms:
        if coefficient not in self._known:
            (self._known[coefficient],) = known_terms([coefficient], self.prior, self.held)
        return self._known[coefficient]

    def _slices(self, coefficient: str) -> dict[str, slice]:
        free = self._terms_of(coefficient).free
        return dict(zip(free, slices_of(free.values()), strict=True))

    def _observation(self, fit: Any) -> tuple[Observation, list[str]]:
        """What a fit observes, with the common errors under their own names first in D."""
        if id(fit) not in self._observed:
            sources = common_errors_of_fits([fit])
            seen = observe_fit(fit, self._terms_of(coefficient_of(fit)), sources)
            self._observed[id(fit)] = (
                fit,
                replace(seen, bases={}),
                sources,
            )  # these are as large as the samples
        _, observation, sources = self._observed[id(fit)]
        return observation, sources

    def _of_coefficient(
        self, coefficient: str, fits: Sequence[Any], wanted: Mapping[str, np.ndarray]
    ) -> dict[str, np.ndarray]:
        pairs = [self._observation(fit) for fit in fits]
        observed = [one for one, _ in pairs]
        H, D = np.vstack([o.H for o in observed]), _aligned(pairs)
        touched, sampled = np.abs(H).max(axis=0) > 0, np.max([o.sampled for o in observed], axis=0)
        blocks, variances, prior = [], {}, 0.0
        for name, nodes in self._slices(coefficient).items():
            leaf, asked = self._leaves[name], wanted.get(name)
            if not touched[nodes].any():
                continue
            asked = np.zeros(leaf["value"].size, bool) if asked is None else asked.ravel()
            chosen = np.flatnonzero(asked | touched[nodes] | (sampled[nodes] > 0))
            parts = prior_parts(leaf, (sampled * touched)[nodes], self.lengths, chosen)
            P, h = (
                np.einsum("k,kij->ij", self._weights.get(name, _WEIGHTS), parts),
                H[:, nodes][:, chosen],
            )
            PH = P @ h.T
            prior = prior + h @ PH
            blocks.append((name, chosen, asked[chosen], np.diag(P), PH))
        own = _blocks([o.D @ o.D.T for o in observed])
        noise = self._inflation.get(coefficient, 1.0) ** 2 * _blocks([o.C for o in observed]) + own
        scale = np.sqrt(np.diag(prior + noise))
        inverse = np.linalg.inv((prior + noise) / np.outer(scale, scale)) / np.outer(scale, scale)
        for name, chosen, asked, before, PH in blocks:
            if name not in wanted:
                continue
            gain = PH[asked] @ inverse
            variance = (
                before[asked]
                - np.einsum("ij,ij->i", gain, PH[asked])
                + ((gain @ D) ** 2).sum(axis=1)
                - np.einsum("ij,ij->i", gain @ own, gain)
            )
            stderr = np.full(wanted[name].size, np.nan)
            stderr[chosen[asked]] = np.sqrt(np.maximum(variance, 0.0))
            variances[name] = stderr.reshape(wanted[name].shape)
        return variances


def _aligned(pairs: Sequence[tuple[Any, list[str]]]) -> np.ndarray:
    """Return the errors that fits share, (estimates, errors): those of one name in one column,
    those of held terms behind them.
    """
    names = list(dict.fromkeys(name for _, sources in pairs for name in sources))
    rows = []
    for o, sources in pairs:
        common = np.zeros((len(o.D), len(names)))
        common[:, [names.index(name) for name in sources]] = o.D[:, : len(sources)]
        rows.append(np.hstack([common, o.D[:, len(sources) :]]))
    return np.vstack(rows)


def _blocks(blocks: Sequence[np.ndarray]) -> np.ndarray:

    return block_diag(*blocks)

"""Blending of a-priori sources of one aeroplane by the covariance of their errors.

The true nodes g of a term over the union of the breakpoints are estimated from the sources of
independent methods, y_k = H_k g + e_k with cov(e_k) = P_k, by generalised least squares:

    g = (sum H_k' P_k^-1 H_k)^-1 sum H_k' P_k^-1 y_k

H_k picks the nodes at which a source speaks (`aerodb.edit.joined_sources.source_nodes`).  P_k is
the covariance of `aerodb.update.correlation`: most of the error of a method is common to all nodes
of a table, so that many nodes do not reduce it, and a correction that is found where two sources
speak reaches the nodes where one of them is silent.  A share `NODE_ERROR` belongs to each node by
itself (rounding, fairing).

Sources of one method are first joined to one, with weights 1/s^2 and the error that their
correlation leaves.  The best weights of strongly correlated sources can be negative, and the result
outside both of them (Peelle's puzzle); these cannot.

Methods share an error of their own, because all describe one drawing.  The weights are those of
independent methods; the standard error has the correlation `COMMON_ERROR`, and the chi-square of a
difference has not, so that neither is taken for smaller than it may be.

The standard error of a node is at least that of its sources node by node, (sum 1/s_k^2)^(-1/2): the
neighbours of a node would add knowledge only if the shape of the common error were known exactly.

Sources that disagree are not averaged in silence.  With chi-square of the difference d of two
sources, d' cov(d)^-1 d for all common nodes, and mean d^2/s_d^2 for their common level, the smaller
probability counts.  Below `UNLIKELY` the term is named, and its standard error reaches to the
farthest source.  Below `INCOMPATIBLE`, with opposite signs, the blend is refused: one of the two
has another sign convention, and the mean would be neither.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import scipy
import xarray as xr

from aerodb.edit.blending import UNLIKELY
from aerodb.edit.joined_sources.prior_sources import COMMON_ERROR, SourceTable
from aerodb.edit.joined_sources.source_nodes import (
    SourceNodes,
    mean_of_sources,
    speaking,
    spread_on_grid,
    weights_of,
    with_common_scale,
)
from aerodb.store.grids import JUDGEMENT, node_text, with_table
from aerodb.update.cautions.notices import INCOMPATIBLE
from aerodb.update.correlation import prior_covariance
from flightmech import terms as _terms
from flightmech.errors import SchemaError
from flightmech.short_text import ShortText

# Share of the variance of a method that belongs to each node by itself.
NODE_ERROR = 0.1
# Most nodes of a table that are blended together; the covariance has their square.
MOST_NODES = 4000
# A node has the code of the source with this share of the weight, else that of an estimate.
_DECIDES = 0.8
_AGREE = 1e-6  # relative and absolute difference of equal quantities
_ESTIMATE = _terms.SOURCES.index("estimate")


@dataclass(frozen=True)
class Disagreement(ShortText):
    """How much two sources of a term differ, in terms of their standard errors.

    Attributes
    ----------
    labels : tuple of str
    nodes : int
        Common nodes, without those that are exact.
    chi2 : float
        Of all common nodes.
    probability : float
        Smaller probability of `chi2` and of the mean square difference.
    worst : float
        Largest difference, second less first. [standard errors of the difference]
    opposite : bool
        Whether the two have opposite signs over the nodes as a whole.
    """

    labels: tuple[str, str]
    nodes: int
    chi2: float
    probability: float
    worst: float
    opposite: bool


@dataclass(frozen=True)
class BlendedTerm(ShortText):
    """A term after the blend, and what each of its sources states.

    Attributes
    ----------
    leaf : Dataset
    labels : tuple of str
        Sources of the term.
    stated : dict of str to (float, float)
        Value and standard error of each source at `location`.
    taken : (float, float)
        Value and standard error after the blend there.
    location : str
        Node of the largest disagreement.
    worst : Disagreement or None
        Of the two sources that disagree most; None with one source.
    """

    leaf: xr.Dataset
    labels: tuple[str, ...]
    stated: Mapping[str, tuple[float, float]]
    taken: tuple[float, float]
    location: str
    worst: Disagreement | None

    @property
    def is_widened(self) -> bool:
        """Whether the standard error reaches to the farthest source."""
        return self.worst is not None and self.worst.probability < UNLIKELY


def blend_term(
    name: str,
    tables: Sequence[SourceTable],
    cover: Mapping[str, tuple[float, float]] = MappingProxyType({}),
) -> BlendedTerm:
    """Return the blend of the tables of one term.

    Parameters
    ----------
    name : str
    tables : sequence of SourceTable
        From `aerodb.edit.joined_sources.prior_sources.collect_tables`, one or more.
    cover : mapping of str to (float, float)
        Range that an axis of the blended table has at least. [SI]

    Raises
    ------
    SchemaError
        Exact nodes differ, the sources contradict each other with opposite signs, or the common
        grid has too many axes or nodes.
    """
    labels = tuple(table.source.label for table in tables)
    if len(tables) == 1:
        leaf = tables[0].leaf
        return BlendedTerm(leaf, labels, {}, taken=(np.nan, np.nan), location="", worst=None)
    points, spread = spread_on_grid(tables, cover)
    if spread[0].value.size > MOST_NODES:
        raise SchemaError(
            "blend",
            [
                f"{name}: {spread[0].value.size} nodes of all sources together, at most "
                f"{MOST_NODES}; regrid a source (`db edit regrid`)"
            ],
        )
    speaks = speaking(spread)
    _demand_exact_agreement(name, points, spread, speaks)
    template = tables[0].leaf
    mean = _Nodes(mean_of_sources(spread), points, template)
    given, spread = spread, with_common_scale(spread, mean.value)
    pairs = _compare_sources(spread, speaks, mean)
    worst = min(pairs, key=lambda pair: pair.probability) if pairs else None
    if worst is not None and worst.opposite and worst.probability < INCOMPATIBLE:
        first, second = worst.labels
        raise SchemaError(
            "blend",
            [
                f"{name}: {first} and {second} have opposite signs and disagree by "
                f"{abs(worst.worst):.3g} standard errors; check signs, units and reference of "
                f"both, or take one of them (--take '{name}={first}')"
            ],
        )
    # Errors in proportion to the value refer to the result: the solution is repeated with it.
    value, _ = _solve_nodes(_join_methods(spread, speaks), mean)
    spread = with_common_scale(given, value)
    mean = _Nodes(value, points, template)
    value, stderr = _solve_nodes(_join_methods(spread, speaks), mean)
    if worst is not None and worst.probability < UNLIKELY:
        stderr = _reach_sources(value, stderr, spread, speaks)
    code = _node_sources(spread, speaks, stderr)
    leaf = with_table(template, points, value=value, stderr=stderr, source=code)
    node = _worst_node(spread, speaks)
    stated = {n.table.source.label: _at(n.value, np.sqrt(n.variance), node) for n in spread}
    return BlendedTerm(
        leaf,
        labels,
        stated,
        taken=_at(value, stderr, node),
        location=node_text(points, node),
        worst=worst,
    )


def _at(value: np.ndarray, stderr: np.ndarray, node: Sequence[int]) -> tuple[float, float]:
    place = tuple(node)
    return float(value[place]), float(stderr[place])


def _values(spread: Sequence[SourceNodes]) -> np.ndarray:
    return np.stack([nodes.value for nodes in spread])


def _variances(spread: Sequence[SourceNodes]) -> np.ndarray:
    return np.stack([nodes.variance for nodes in spread])


@dataclass(frozen=True)
class _Nodes:
    """Mean values on the common grid, for the correlation of errors."""

    value: np.ndarray
    points: Mapping[str, np.ndarray]
    template: xr.Dataset

    def covariance(self, stderr: np.ndarray) -> np.ndarray:
        """Return the covariance of errors of one method, (nodes, nodes)."""
        bare = self.template.drop_vars(["K1", "K2"], errors="ignore")
        leaf = with_table(bare, self.points, value=self.value, stderr=stderr)
        P = prior_covariance(leaf)
        return (1.0 - NODE_ERROR) * P + NODE_ERROR * np.diag(stderr.ravel() ** 2)


@dataclass(frozen=True)
class _Method:
    """Sources of one method as one: value, common error, error of each node, where it speaks."""

    value: np.ndarray
    stderr: np.ndarray
    own_error: np.ndarray
    speaks: np.ndarray


def _join_methods(spread: Sequence[SourceNodes], speaks: np.ndarray) -> list[_Method]:
    """Return the sources of each method as one."""
    members: dict[str, list[int]] = {}
    for position, nodes in enumerate(spread):
        members.setdefault(nodes.table.source.method, []).append(position)
    methods = []
    for positions in members.values():
        sources = [spread[k] for k in positions]
        methods.append(_join_method(sources, speaks[positions]))
    return methods


def _join_method(spread: Sequence[SourceNodes], speaks: np.ndarray) -> _Method:
    """Return sources of one method as one: sum w_k e_k, with the correlation of their errors."""
    any_speaks = speaks.any(axis=0)
    # Where none speaks, the numbers are not used.
    w = weights_of(_variances(spread), np.where(any_speaks, speaks, True))
    variance = np.zeros_like(spread[0].value)
    for first, w_first in zip(spread, w):
        for second, w_second in zip(spread, w):
            same = first is second
            rho = 1.0 if same else first.table.source.error_correlation(second.table.source)
            variance = variance + rho * w_first * w_second * first.stderr * second.stderr
    own_variance = sum(w_k**2 * n.own_error**2 for w_k, n in zip(w, spread))
    value = (w * _values(spread)).sum(axis=0)
    return _Method(value, np.sqrt(variance), np.sqrt(own_variance), np.asarray(any_speaks))


def _demand_exact_agreement(
    name: str,
    points: Mapping[str, np.ndarray],
    spread: Sequence[SourceNodes],
    speaks: np.ndarray,
) -> None:
    """Raise if two sources are exact at a node and differ there."""
    exact = (_variances(spread) == 0.0) & speaks
    low = np.where(exact, _values(spread), np.inf).min(axis=0)
    high = np.where(exact, _values(spread), -np.inf).max(axis=0)
    both = exact.sum(axis=0) > 1
    differs = both & ~np.isclose(low, np.where(both, high, low), rtol=_AGREE, atol=1e-12)
    if differs.any():
        node = list(map(int, np.argwhere(differs)[0]))
        raise SchemaError(
            "blend",
            [f"{name}: exact values (standard error 0) differ at {node_text(points, node)}"],
        )


def _compare_sources(
    spread: Sequence[SourceNodes], speaks: np.ndarray, mean: _Nodes
) -> list[Disagreement]:
    """Return the disagreement of every pair of sources with common nodes."""
    pairs = []
    for k, first in enumerate(spread):
        for m in range(k + 1, len(spread)):
            pair = _compare_pair(first, spread[m], speaks[k] & speaks[m], mean)
            if pair is not None:
                pairs.append(pair)
    return pairs


def _compare_pair(
    first: SourceNodes, second: SourceNodes, common: np.ndarray, mean: _Nodes
) -> Disagreement | None:
    """Return the disagreement of two sources, None without common nodes that are uncertain."""
    rho = first.table.source.error_correlation(second.table.source)
    cross = 2.0 * rho * first.stderr * second.stderr
    method_variance = first.stderr**2 + second.stderr**2 - cross
    own_variance = first.own_error**2 + second.own_error**2
    s = np.sqrt(method_variance + own_variance)
    chosen = common & (s > 0.0)
    if not chosen.any():
        return None
    index = np.flatnonzero(chosen)
    d = (second.value - first.value)[chosen]
    P = mean.covariance(np.sqrt(method_variance))[np.ix_(index, index)]
    A = P + np.diag(own_variance[chosen])
    chi2 = float(d @ scipy.linalg.cho_solve(scipy.linalg.cho_factor(A), d))
    z = d / s[chosen]
    # All nodes with their correlation, and their common level by itself.
    probability = min(
        float(scipy.stats.chi2.sf(chi2, len(d))), float(scipy.stats.chi2.sf(np.mean(z**2), 1))
    )
    return Disagreement(
        labels=(first.table.source.label, second.table.source.label),
        nodes=len(d),
        chi2=chi2,
        probability=probability,
        worst=float(z[np.argmax(np.abs(z))]),
        opposite=bool(first.value[chosen] @ second.value[chosen] < 0.0),
    )


def _solve_nodes(methods: Sequence[_Method], mean: _Nodes) -> tuple[np.ndarray, np.ndarray]:
    """Return value and standard error of all nodes by generalised least squares."""
    values = np.stack([method.value for method in methods])
    variance = np.stack([method.stderr**2 + method.own_error**2 for method in methods])
    speaks = np.stack([method.speaks for method in methods])
    weights = weights_of(variance, speaks)
    # Nodes that are zero by definition, or exact otherwise, keep their value.
    exact = ((variance == 0.0) & speaks).any(axis=0)
    value = (weights * values).sum(axis=0)
    stderr = np.zeros_like(value)
    free = np.flatnonzero(~exact)
    place = np.full(value.size, -1)
    place[free] = np.arange(free.size)
    N, b = np.zeros((free.size, free.size)), np.zeros(free.size)
    for method in methods:
        index = np.flatnonzero(method.speaks & ~exact)
        if not index.size:
            continue
        P = mean.covariance(method.stderr)[np.ix_(index, index)]
        P = P + np.diag(method.own_error.ravel()[index] ** 2)
        inverse = scipy.linalg.cho_solve(scipy.linalg.cho_factor(P), np.eye(index.size))
        rows = place[index]
        N[np.ix_(rows, rows)] += inverse
        b[rows] += inverse @ method.value.ravel()[index]
    if free.size:
        factor = scipy.linalg.cho_factor(N)
        covariance = scipy.linalg.cho_solve(factor, np.eye(free.size))
        value.flat[free] = covariance @ b
        stderr.flat[free] = np.sqrt(np.diag(covariance))
        stderr = stderr * _common_growth(variance, speaks)
    return value, np.where(exact, 0.0, np.maximum(stderr, _least_error(variance, speaks)))


def _least_error(variance: np.ndarray, speaks: np.ndarray) -> np.ndarray:
    """Return the standard error of each node by itself.

    Where one method speaks alone, its error is reduced at most as much as where others speak, too.
    """
    inverse = np.divide(1.0, variance, out=np.zeros_like(variance), where=variance > 0.0) * speaks
    total = inverse.sum(axis=0)
    least = np.sqrt(np.divide(1.0, total, out=np.zeros_like(total), where=total > 0.0))
    least = least * _common_growth(variance, speaks)
    alone = speaks.sum(axis=0) == 1
    for own_variance, speaks_here in zip(variance, speaks):
        own = np.sqrt(own_variance)
        shared = speaks_here & ~alone & (own > 0.0)
        if shared.any():
            reduction = float((least[shared] / own[shared]).min())
            least = np.where(speaks_here & alone, reduction * own, least)
    return least


def _common_growth(variance: np.ndarray, speaks: np.ndarray) -> np.ndarray:
    """Return the factor on the standard error of each node by the common error of all methods.

    sqrt(sum w_g w_h r_gh s_g s_h / sum w_g^2 s_g^2), with the weights of independent methods.
    """
    parts = weights_of(variance, speaks) * np.sqrt(variance)
    own = (parts**2).sum(axis=0)
    cross = parts.sum(axis=0) ** 2 - own
    share = np.divide(cross, own, out=np.zeros_like(own), where=own > 0.0)
    return np.sqrt(1.0 + COMMON_ERROR["aeroplane"] * np.maximum(share, 0.0))


def _reach_sources(
    value: np.ndarray, stderr: np.ndarray, spread: Sequence[SourceNodes], speaks: np.ndarray
) -> np.ndarray:
    """Return standard errors that reach to the farthest source.

    Where one source speaks alone, they grow by the median factor of the other nodes.
    """
    distance = np.where(speaks, np.abs(_values(spread) - value), 0.0).max(axis=0)
    reached = np.where(stderr > 0.0, np.maximum(stderr, distance), 0.0)
    shared = (speaks.sum(axis=0) > 1) & (stderr > 0.0)
    if not shared.any():
        return reached
    growth = float(np.median(reached[shared] / stderr[shared]))
    return np.where(shared, reached, growth * stderr)


def _node_sources(
    spread: Sequence[SourceNodes], speaks: np.ndarray, stderr: np.ndarray
) -> np.ndarray:
    """Return the code of every node: that of its source, or `estimate` for several of them."""
    weights = weights_of(_variances(spread), speaks)
    codes = np.stack([nodes.source for nodes in spread])
    share = np.stack([(weights * (codes == code)).sum(axis=0) for code in range(4)])
    strongest = share.argmax(axis=0)
    mixed = np.where(strongest == JUDGEMENT, JUDGEMENT, _ESTIMATE)
    code = np.where(share.max(axis=0) >= _DECIDES, strongest, mixed)
    # A correction from other nodes changed the number of a source that speaks alone.
    alone = speaks.sum(axis=0) == 1
    before = np.sqrt(np.where(speaks, _variances(spread), np.inf).min(axis=0))
    is_corrected = alone & (code != JUDGEMENT) & (stderr < 0.9 * before)
    return np.where(is_corrected, _ESTIMATE, code).astype(np.uint8)


def _worst_node(spread: Sequence[SourceNodes], speaks: np.ndarray) -> list[int]:
    """Return the node at which most sources speak and two differ most, in standard errors."""
    values, variance = _values(spread), _variances(spread)
    spoken = np.where(speaks, values, np.nan)
    difference = np.nanmax(spoken, axis=0) - np.nanmin(spoken, axis=0)
    s = np.sqrt((variance * speaks).sum(axis=0))
    z = np.divide(difference, s, out=np.zeros_like(s), where=s > 0.0)
    score = np.where(speaks.sum(axis=0) > 1, z, -1.0)
    return list(map(int, np.unravel_index(int(np.argmax(score)), score.shape)))

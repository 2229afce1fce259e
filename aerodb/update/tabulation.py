"""Local estimates from flight and a prior database joined into tables.

A local estimate theta = (X'X)^-1 X' z of samples that follow the tables, z = B g, has the
expectation H g with H = (X'X)^-1 X' B, whatever the local model leaves out.  Every fit is therefore
an observation

    theta = H g + D s + e,    s ~ N(0, 1),    e ~ N(0, C)

of the nodes g of all terms of its coefficient at once.  C is its coloured-residual covariance; D
holds the changes by one standard error of every error that fits share: mass, inertia, thrust, the
pick-ups of the surfaces, and what the instruments leave open in the reconstructed states.  With the
prior g ~ N(g0, P) everything is Gaussian, and the nodes have a posterior in closed form.  The
common errors s are *considered*, not estimated across fits: the nodes are weighed as if every fit
had errors s of its own, and their covariance is that of these weights when all fits share s.  Terms
that are held are considered likewise, with their a-priori errors.  An estimate that a common error
dominates (a damping, by the lag of the vanes) then distorts no table, and what all fits agree in is
taken as measured.  Estimating s across fits lets the shape of a handbook table decide about an
instrument: the bias of an elevator pick-up, which nothing but that shape distinguishes from a
constant pitching moment, then came out with a third of its true uncertainty, at values that were no
better.

The prior covariance of the nodes is a sum of four parts (`aerodb.update.correlation.prior_parts`):
common to the whole table; common to its flown region, and fading with the distance from it; a
smooth curve there that fades alike; and a rough one.  The weights of the parts, and one factor on
C, are learnt for each term: those with the largest marginal likelihood, given lognormal hyperpriors
about the a-priori shares, found by Newton's method with exact derivatives.  The weights used are
their lognormal means, which for a term that no fit informs are the a-priori shares.  What the
flights determine about the reach of a correction holds where they were flown: the second part
hardly follows the fits and never counts less than a priori, so that outside the flown region the
standard errors go back to those of the handbook.  What the whole handbook method is wrong by is the
first part, which may grow by much, and carries a correction to nodes that were not flown. Nodes of
different terms are independent a priori; after the flight they are not.  The term tables keep their
joint covariance (`aerodb.update.posterior`); ``stderr`` is that of single nodes.

What no fit separates stays divided by the priors: a fit with one term for pitch rate and rate of
incidence informs ``qhat`` and ``alphadothat`` together.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy.linalg import block_diag
from scipy.stats import chi2 as chi2_distribution

from aerodb.store.schema import terms
from aerodb.update.cautions.notices import incompatible_fits
from aerodb.update.cautions.unplaced_terms import demand_places, unplaced_terms
from aerodb.update.correlation import LENGTHS, PARTS, SHARES, SPREADS, flown_distance, prior_parts
from aerodb.update.observations import CoefficientTerms, Observation, observe_fits, samples_outside
from aerodb.update.posterior import mark_joint, with_posterior
from aerodb.update.shapes import Shape, apply_shapes, demand_shapes
from aerodb.update.term_decisions import CORRECTED, REPLACED, add_decisions
from flightmech import terms as _terms
from flightmech.errors import AeromatchWarning, IdentificationError

SUSPECT = 0.3  # weight below which a fit is listed as suspect
# least weight that some sample gives to a node from flight: half a cell away on each of two axes
FLOWN = 0.25
_HUBER = 2.5
_ROUNDS, _STEPS = 4, 100  # of weighting, and of Newton's method within each
_SPREAD_OF_FITS = 0.7  # standard error of the logarithm of the factor on C a priori
_SETTLED = 1e-6  # step in these logarithms


@dataclass(frozen=True)
class Tabulation(Mapping):
    """The new terms, ``{"CL/basic": leaf, ...}``, ready for `replace_terms`, and what was found on
    the way.

    Attributes
    ----------
    terms : dict of str to Dataset
        Every term that the fits inform.  ``source`` is flight at nodes of the flown region (some
        sample gives them a quarter of its weight, none but samples inside the table counting) whose
        standard error fell below 0.9 of the a-priori one, and stays as it was elsewhere.
    report : DataFrame
        Index term; ``nodes``, ``flight`` (nodes from flight), ``corrected`` and ``identified``
        (nodes with a ratio of posterior to prior standard error below 0.9 and 0.5),
        ``ratio_least``, ``ratio_median``, ``change_rms``, ``change_largest``, ``change_in_sd``
        (largest change, in a-priori standard errors), ``prior_inflation`` (factor on the a-priori
        standard errors; above 1 they were too small), ``level reach long short`` (weights of the
        parts of the prior covariance), ``decision`` and ``reason`` (`aerodb.update.term_decisions`;
        also attributes of the term).
    points : DataFrame
        Index (coefficient, fit): ``rms_prior``, ``rms`` of measured minus tables with the prior and
        the new ones, ``range`` of the coefficient, ``distance`` of the fit from the tables in its
        own standard errors, ``weight``, ``suspect``, ``clamped`` (share of samples outside a
        table).
    compatibility : DataFrame
        Index coefficient; ``chi2`` of the fits against prior and measurement errors, ``count`` of
        estimates, ``probability``, ``inflation`` (factor on the standard errors of all fits, 1 or
        more, from their disagreement).
    unplaced : DataFrame
        Terms of the fits that no table of the database carries, insignificant ones too: index
        (coefficient, fit); ``term``, ``estimate``, ``stderr``, ``t``, ``carried``, ``significant``,
        ``reason``.
    notices : tuple of str
        Warnings, one line each; `aerodb.replace_terms` writes them into the history of the
        database.
    """

    terms: dict[str, xr.Dataset]
    report: pd.DataFrame
    points: pd.DataFrame
    compatibility: pd.DataFrame
    unplaced: pd.DataFrame = field(default_factory=pd.DataFrame)
    notices: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> xr.Dataset:
        return self.terms[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.terms)

    def __len__(self) -> int:
        return len(self.terms)


def tabulate(
    fits: Sequence[Any],
    prior: xr.DataTree,
    held: Sequence[str] = (),
    lengths: Mapping[str, float] | None = None,
    shapes: Mapping[str, Sequence[Shape]] | None = None,
    unplaced: str = "raise",
) -> Tabulation:
    """Return the terms of a database after the fits have been heard.

    Parameters
    ----------
    fits : sequence of Fit
        Of any coefficients; used are ``estimates`` (``estimate``, ``covariance``, ``systematic``;
        attributes ``coefficient``, ``name``), ``data`` and ``design``.
    prior : DataTree
        The database; its leaves need ``stderr``, a node with ``stderr`` 0 stays.  A term that the
        flight shall bring in must be there, as zeros with a wide standard error.
    held : sequence of str
        Terms such as ``"CL/altitude"`` that keep their values; their standard errors, where they
        have them, count among those of the others.
    lengths : mapping, optional
        Correlation lengths by axis that differ from `LENGTHS`; ``inf`` for fully correlated. [SI]
    shapes : mapping of str to sequence of Shape, optional
        What the table of a term must be, by ``"CL/basic"``: `aerodb.update.Shape`.  Values meet it,
        standard errors stay; ``report`` has the inequalities at their bound (``shape_bounds``) and
        what they would make of the standard errors (``shape_ratio``).
    unplaced : {"raise", "warn"}
        What to do if no table of the database carries a significant term of a fit, as the elevator
        of a fit where the database comes from a clean listing alone.  ``warn`` goes on without the
        estimate: the control has no effect in the model then, and estimates of regressors that move
        with it are biased.

    Returns
    -------
    Tabulation

    Raises
    ------
    SchemaError
        Terms without standard errors, or force axes other than those of the fits; significant terms
        that no table carries; all faults.
    UnknownName
        A held term or a coefficient that the database does not have, or a variable that a table
        needs and the data of a fit do not hold.

    Warns
    -----
    AeromatchWarning
        Fits that are incompatible with each other and the a-priori tables (probability of
        chi-squared below 1e-6), and with ``unplaced="warn"`` the significant terms that no table
        carries.

    Notes
    -----
    A term is significant if its t value is 4.47 or more, the root of the partial F of 20 with which a term enters a stepwise regression.
    The t value is |estimate| / hypot(stderr, stderr_systematic): the errors of the instruments count, so that a constant that comes from
    the bias of a vane is not significant.  A table counts as a place if it carries half of the regressor along the flight: it depends on
    the variables of the term, and the flown values lie inside its breakpoints.

    References
    ----------
    .. [Klein2006] Klein, Morelli, Aircraft System Identification, AIAA 2006, section 5.4: partial F of 20.
    .. [Rasmussen2006] Rasmussen, Williams, Gaussian Processes for Machine Learning, MIT Press 2006, chapter 2.
    .. [Searle1992] Searle, Casella, McCulloch, Variance Components, Wiley 1992, chapter 8.
    .. [Schmidt1966] Schmidt, Application of state-space methods to navigation problems, Advances in Control Systems 3, 1966.
    """
    if not fits:
        raise IdentificationError("no fit; tabulate needs at least one")
    lengths = {**LENGTHS, **(lengths or {})}
    demand_shapes(
        shapes or {}, {name: leaf for name, leaf in terms(prior).items() if name not in held}
    )
    lost = unplaced_terms(fits, prior, held)
    notices = demand_places(lost, unplaced)
    found = merge_tabulations(
        [
            join_observations(known, observed, lengths, shapes)
            for known, observed in observe_fits(fits, prior, held)
        ]
    )
    return add_cautions(found, lost, notices)


@dataclass(frozen=True)
class _Posterior:
    """Nodes and what was found on the way; arrays by node, then by fit."""

    value: np.ndarray
    stderr: np.ndarray
    weight: np.ndarray
    distance: np.ndarray
    parts: dict[str, np.ndarray]  # weights of the parts of the prior covariance, by term
    inflation: float
    chi2: float
    taken: np.ndarray  # (nodes, estimates): W of `aerodb.update.posterior`
    common: np.ndarray  # (nodes, common errors): Z
    errors: list[str]  # their names


def join_observations(
    known: CoefficientTerms,
    observed: Sequence[Observation],
    lengths: Mapping[str, float],
    shapes: Mapping[str, Sequence[Shape]] | None = None,
    history: str = "tabulate: joined with {} fits",
) -> Tabulation:
    """Return the terms of one coefficient given all observations of it."""
    leaves, free = known.leaves, known.free
    sampled = np.max([o.sampled for o in observed], axis=0)
    touched = np.any([np.abs(o.H).max(axis=0) > 0 for o in observed], axis=0)
    found = _posterior(observed, free, sampled * touched, lengths)
    new, places = {}, {}
    for (name, leaf), nodes in zip(free.items(), slices_of(free.values())):
        if touched[nodes].any():
            flown = ((sampled >= FLOWN) & touched)[nodes]
            made = new_leaf(
                leaf,
                found.value[nodes],
                found.stderr[nodes],
                flown,
                contributing_fits(observed, nodes),
                history,
            )
            away = flown_distance(leaf, (sampled * touched)[nodes], lengths)
            new[name] = with_posterior(
                leaf,
                made,
                found.parts[name],
                away,
                lengths,
                found.taken[nodes],
                found.common[nodes],
                found.errors,
            )
            places[name] = flown.reshape(leaf["value"].shape)
    new, effect = apply_shapes(add_decisions(leaves, mark_joint(new), places), shapes or {})
    rows = [term_row(name, leaves[name], leaf, found.parts[name]) for name, leaf in new.items()]
    rows = [row.assign(**effect.get(name, {})) for name, row in zip(new, rows)]
    points = point_rows(
        known.coefficient, observed, leaves, {**leaves, **new}, found.distance, found.weight
    )
    count = sum(len(o.theta) for o in observed)
    return Tabulation(
        new,
        pd.concat(rows),
        points,
        compatibility_row(known.coefficient, count, found.chi2, found.inflation),
    )


def merge_tabulations(findings: Sequence[Tabulation]) -> Tabulation:
    """Return what was found of several coefficients as one."""
    new = {name: leaf for one in findings for name, leaf in one.items()}
    return Tabulation(
        new,
        *(
            pd.concat([getattr(one, name) for one in findings])
            for name in ("report", "points", "compatibility")
        ),
    )


def add_cautions(found: Tabulation, unplaced: pd.DataFrame, notices: Sequence[str]) -> Tabulation:
    """Return a tabulation with the terms that have no place and all notices; each notice is also a
    warning, for the caller's caller.
    """
    lost = [f"no place in the database, the estimate is left out: {line}" for line in notices]
    texts = (*lost, *incompatible_fits(found.compatibility))
    for text in texts:
        warnings.warn(text, AeromatchWarning, stacklevel=3)
    return replace(found, unplaced=unplaced, notices=texts)


def _posterior(
    observed: Sequence[Observation], free: Mapping[str, xr.Dataset], sampled: np.ndarray, lengths
) -> _Posterior:
    """Nodes given the fits; fits far from the tables that the others support lose weight, the prior
    covariance is learnt.
    """
    H, D = np.vstack([o.H for o in observed]), np.vstack([o.D for o in observed])
    g0 = np.concatenate([leaf["value"].values.ravel() for leaf in free.values()])
    y = np.concatenate([o.theta for o in observed]) - H @ g0
    columns = slices_of(free.values())
    slices = _slices([len(o.theta) for o in observed])
    priors = [prior_parts(leaf, sampled[at], lengths) for leaf, at in zip(free.values(), columns)]
    PH = [P @ H[:, at].T for P, at in zip(priors, columns)]  # (parts, nodes, estimates)
    expected = np.concatenate([H[:, at] @ one for one, at in zip(PH, columns)])
    weight, start = np.ones(len(observed)), None
    for _ in range(_ROUNDS):
        noise = _block_diagonal([o.C / w for o, w in zip(observed, weight)])
        factors, start = _learnt(y, np.concatenate([expected, noise[None]]), D @ D.T, start)
        # in the weights, each fit has the common errors for itself
        own_errors = _block_diagonal([o.D @ o.D.T / w for o, w in zip(observed, weight)])
        noise = factors[-1] * noise + own_errors
        inverse = _inverse(np.einsum("k,kij->ij", factors[:-1], expected) + noise)
        residual = noise @ inverse @ y
        distance = np.array(
            [_distance(residual[part], o.C + o.D @ o.D.T) for part, o in zip(slices, observed)]
        )
        weight = np.minimum(1.0, (_HUBER * np.sqrt(factors[-1]) / np.maximum(distance, 1e-12)) ** 2)
    weights = factors[:-1].reshape(len(free), -1)
    reach = np.vstack([np.einsum("k,kij->ij", w, one) for w, one in zip(weights, PH)])
    own = np.concatenate([w @ np.diagonal(P, axis1=1, axis2=2) for w, P in zip(weights, priors)])
    gain = reach @ inverse
    variance = (
        own
        - np.einsum("ij,ij->i", gain, reach)
        + ((gain @ D) ** 2).sum(axis=1)
        - np.einsum("ij,ij->i", gain @ own_errors, gain)
    )
    declared = np.einsum("k,kij->ij", np.tile(list(SHARES.values()), len(free)), expected)
    chi2 = float(y @ _inverse(declared + D @ D.T + _block_diagonal([o.C for o in observed])) @ y)
    stderr = np.sqrt(np.maximum(variance, 0.0))
    acting = np.flatnonzero(D.any(axis=0))
    taken, common = (
        gain @ _root(np.einsum("k,kij->ij", factors[:-1], expected) + noise + own_errors),
        gain @ D[:, acting],
    )
    names = [*observed[0].errors, *[""] * (D.shape[1] - len(observed[0].errors))]
    parts, inflation = dict(zip(free, weights)), float(np.sqrt(factors[-1]))
    return _Posterior(
        g0 + gain @ y,
        stderr,
        weight,
        distance,
        parts,
        inflation,
        chi2,
        taken,
        common,
        [names[k] for k in acting],
    )


def _learnt(
    y: np.ndarray, parts: np.ndarray, fixed: np.ndarray, start: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the weights of the parts of the covariance that the fits support, and their logarithms
    at the mode.

    The covariance of `y` is ``sum(exp(u_k) parts_k) + fixed``: `PARTS` for each table, and last the
    errors of the fits.  All are learnt together, so that an overconfident prior is not mistaken for
    fits that disagree.  The u are normal a priori, with the shares as the means of exp(u); at the
    mode of their posterior the inverse of the information matrix is taken for their covariance, and
    the weights are the means of exp(u) again.  The part that fades outside the flown region, and
    the errors of the fits, are never made smaller.
    """
    tables = (len(parts) - 1) // len(SHARES)
    spread = np.append(np.tile(list(SPREADS.values()), tables), _SPREAD_OF_FITS)
    share = np.append(np.tile(list(SHARES.values()), tables), 1.0)
    mean = np.log(share) - spread**2 / 2.0
    used = np.einsum("kii->k", parts) > 0
    u, covariance = mean.copy(), np.diag(spread**2)
    u[used], covariance[np.ix_(used, used)] = _mode(
        y, parts[used], fixed, mean[used], spread[used], (mean if start is None else start)[used]
    )
    least = np.append(
        np.tile([share if name == "reach" else 0.0 for name, share in SHARES.items()], tables), 1.0
    )
    return np.maximum(np.exp(u + np.diag(covariance) / 2.0), least), u


def _mode(y, parts, fixed, mean, spread, u) -> tuple[np.ndarray, np.ndarray]:
    """Return the mode of the logarithms and the inverse of the information there: Newton's method
    with Marquardt's damping.
    """
    cost, S = _cost(y, parts, fixed, mean, spread, u)
    damping = 1e-3
    for _ in range(_STEPS):
        inverse = _inverse(S)
        r = inverse @ y
        size = np.exp(u)
        share = size[:, None, None] * (inverse @ parts)
        pull = size[:, None] * (parts @ r)
        likelihood = (np.einsum("kii->k", share) - pull @ r) / 2.0
        gradient = likelihood + (u - mean) / spread**2
        flat = share.reshape(len(u), -1)
        expected = flat @ share.transpose(0, 2, 1).reshape(len(u), -1).T / 2.0
        information = expected + np.diag(spread**-2.0)
        curvature = pull @ inverse @ pull.T - expected + np.diag(likelihood + spread**-2.0)
        while damping < 1e10:
            trial, S_trial = np.inf, S
            try:
                L = np.linalg.cholesky(curvature + damping * np.diag(np.diag(information)))
                step = -np.linalg.solve(L.T, np.linalg.solve(L, gradient))
                step *= min(1.0, 2.0 / np.abs(step).max())
                trial, S_trial = _cost(y, parts, fixed, mean, spread, u + step)
            except np.linalg.LinAlgError:
                pass  # no minimum of the quadratic: damp more
            if trial <= cost + 1e-12 * abs(cost):
                break
            damping *= 10.0
        else:
            break
        u, cost, S, damping = u + step, trial, S_trial, max(damping / 10.0, 1e-10)
        if np.abs(step).max() < _SETTLED:
            break
    return u, np.linalg.inv(information)


def _cost(y, parts, fixed, mean, spread, u) -> tuple[float, np.ndarray]:
    """Return the negative logarithm of the density of `y` and the logarithms, and the covariance of
    `y`.
    """
    S = np.einsum("k,kij->ij", np.exp(u), parts) + fixed
    scale = np.sqrt(np.diag(S))
    L = np.linalg.cholesky(S / np.outer(scale, scale))
    z = np.linalg.solve(L, y / scale)
    return float(
        np.log(scale * np.diag(L)).sum() + z @ z / 2.0 + (((u - mean) / spread) ** 2).sum() / 2.0
    ), S


def slices_of(leaves: Iterable[xr.Dataset]) -> list[slice]:
    """Return where the nodes of each of several terms are among those of all."""
    return _slices([leaf["value"].size for leaf in leaves])


def _slices(sizes: Sequence[int]) -> list[slice]:
    ends = np.cumsum(sizes)
    return [slice(end - size, end) for end, size in zip(ends, sizes)]


def _inverse(S: np.ndarray) -> np.ndarray:
    """Inverse of a covariance, scaled to unit diagonal first: terms differ by orders of magnitude."""
    scale = np.sqrt(np.diag(S))
    return np.linalg.inv(S / np.outer(scale, scale)) / np.outer(scale, scale)


def _root(S: np.ndarray) -> np.ndarray:
    """Lower Cholesky factor of a covariance, scaled to unit diagonal first."""
    scale = np.sqrt(np.diag(S))
    return scale[:, None] * np.linalg.cholesky(S / np.outer(scale, scale))


def _distance(residual: np.ndarray, C: np.ndarray) -> float:
    """Rms of a residual in its own standard errors, correlations taken into account."""
    sd = np.sqrt(np.diag(C))
    correlation = C / np.outer(sd, sd) + 1e-9 * np.eye(len(sd))
    return float(np.sqrt((residual / sd) @ np.linalg.solve(correlation, residual / sd) / len(sd)))


def new_leaf(
    leaf: xr.Dataset,
    value: np.ndarray,
    sd: np.ndarray,
    flown: np.ndarray,
    contributors: Sequence[str],
    history: str,
) -> xr.Dataset:
    """Return a term with its new nodes, their sources, and what made them."""
    shape = leaf["value"].shape
    flown = flown.reshape(shape) & (sd.reshape(shape) < CORRECTED * leaf["stderr"].values)
    known = (
        leaf["source"].values
        if "source" in leaf
        else np.full(shape, _terms.SOURCES.index("judgement"), np.uint8)
    )
    new = leaf.copy(deep=True)
    new["value"] = leaf["value"].dims, value.reshape(shape), leaf["value"].attrs
    new["stderr"] = leaf["value"].dims, sd.reshape(shape), leaf["stderr"].attrs
    source = np.where(flown, _terms.SOURCES.index("flight"), known).astype(np.uint8)
    new["source"] = (
        leaf["value"].dims,
        source,
        {"flag_values": "0 1 2", "flag_meanings": " ".join(_terms.SOURCES)},
    )
    words = [
        str(leaf.attrs.get("comment", "")),
        f"{int(flown.sum())} of {flown.size} nodes from flight: {', '.join(contributors)}.",
    ]
    if set(_terms.list_regressors(leaf)) & {"qhat", "alphadothat"}:
        words.append(
            "Pitch rate and rate of incidence move alike in flight; between their terms the "
            "a-priori errors decide."
        )
    new.attrs["comment"] = " ".join(word for word in words if word)
    line = history.format(len(contributors))
    new.attrs["history"] = f"{leaf.attrs['history']}\n{line}" if leaf.attrs.get("history") else line
    return new


def contributing_fits(observed: Sequence[Observation], nodes: slice) -> list[str]:
    """Return the names of the fits that some of the nodes enter."""
    return [o.name or f"fit {k}" for k, o in enumerate(observed) if np.abs(o.H[:, nodes]).max() > 0]


def term_row(name: str, before: xr.Dataset, after: xr.Dataset, weights: np.ndarray) -> pd.DataFrame:
    """Return the row of `Tabulation.report` of a term."""
    sd0, change = before["stderr"].values.ravel(), (after["value"] - before["value"]).values.ravel()
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(sd0 > 0, after["stderr"].values.ravel() / sd0, 1.0)
        in_sd = np.where(sd0 > 0, np.abs(change) / sd0, 0.0)
    row = {
        "nodes": len(ratio),
        "flight": int((after["source"].values == _terms.SOURCES.index("flight")).sum()),
        "corrected": int((ratio < CORRECTED).sum()),
        "identified": int((ratio < REPLACED).sum()),
        "ratio_least": ratio.min(),
        "ratio_median": np.median(ratio),
        "change_rms": np.sqrt((change**2).mean()),
        "change_largest": change[np.abs(change).argmax()],
        "change_in_sd": in_sd.max(),
        "prior_inflation": np.sqrt(weights.sum()),
        **dict(zip(PARTS, weights)),
        "decision": after.attrs["decision"],
        "reason": after.attrs["reason"],
    }
    return pd.DataFrame(row, index=pd.Index([name], name="term"))


def point_rows(
    coefficient: str,
    observed: Sequence[Observation],
    before,
    after,
    distance: np.ndarray,
    weight: np.ndarray,
) -> pd.DataFrame:
    """Return the rows of `Tabulation.points` of a coefficient."""
    rows = []
    for k, o in enumerate(observed):
        z = o.data[coefficient].values
        prior, new = (
            z - sum(B @ leaves[name]["value"].values.ravel() for name, B in o.bases.items())
            for leaves in (before, after)
        )
        rows.append(
            {
                "coefficient": coefficient,
                "fit": o.name,
                "rms_prior": np.sqrt((prior**2).mean()),
                "rms": np.sqrt((new**2).mean()),
                "range": np.ptp(z),
                "distance": distance[k],
                "weight": weight[k],
                "suspect": bool(weight[k] < SUSPECT),
                "clamped": max(_clamped(leaf, o.data) for leaf in before.values()),
            }
        )
    return pd.DataFrame(rows).set_index(["coefficient", "fit"])


def compatibility_row(coefficient: str, count: int, chi2: float, inflation: float) -> pd.DataFrame:
    """Return the row of `Tabulation.compatibility` of a coefficient."""

    row = {
        "chi2": chi2,
        "count": count,
        "probability": float(chi2_distribution.sf(chi2, count)),
        "inflation": inflation,
    }
    return pd.DataFrame(row, index=pd.Index([coefficient], name="coefficient"))


def _clamped(leaf: xr.Dataset, data: xr.Dataset) -> float:
    """Share of the samples that lie outside the table on some axis."""
    return float(samples_outside(leaf, data).mean())


def _block_diagonal(blocks: Sequence[np.ndarray]) -> np.ndarray:

    return block_diag(*blocks)

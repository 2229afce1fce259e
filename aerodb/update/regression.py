"""Nodes of tables estimated directly from the samples of all manoeuvres.

A piecewise-linear table is linear in its nodes, so samples are

    z = B g + E s + v,    s ~ N(0, 1)

with the nodes g of all terms of one coefficient, changes E by one standard error of the errors that
all samples share, and a disturbance v that is correlated in time.  Nodes are many and what one
manoeuvre knows of them is little.  With the a-priori covariance P = F F' of the nodes it moves, the
singular value decomposition B F = U S W' gives the combinations theta = U'z whose a-priori standard
errors are S; those are kept that are some times above the standard error of U'v, with the coloured
covariance of what the combinations kept leave over.  What is smaller holds no more about the tables
than about everything that neither tables nor disturbance describe: the bend of the true curves
between two nodes, noise of the states in step with that of the coefficient.  Kept down to one
standard error, the rate of incidence of the T-37 came out 3.5 of its standard errors wrong.

An observation of directions is then one like that of a local fit: the same learnt prior covariance,
the same weights, the same common errors, considered and not estimated (`aerodb.update.tabulation`).
No local model stands between samples and tables, hence what it leaves out does not scatter its
estimates, and no term needs to be in all manoeuvres.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from scipy.linalg import block_diag
from scipy.sparse import hstack

from aerodb.store.schema import terms
from aerodb.update.cautions.unplaced_terms import demand_places, unplaced_controls, unplaced_terms
from aerodb.update.correlation import LENGTHS, SHARES, prior_parts
from aerodb.update.observations import (
    CoefficientTerms,
    Observation,
    basis_at,
    coefficient_of,
    common_errors_of_fits,
    known_terms,
    observe_fit,
)
from aerodb.update.shapes import Shape, demand_shapes
from aerodb.update.tabulation import (
    Tabulation,
    add_cautions,
    join_observations,
    merge_tabulations,
    slices_of,
)
from flightmech import terms as _terms
from flightmech.errors import IdentificationError

# a-priori standard error of a direction over that of its measurement from which on it is kept
KEEP = 4.0
_HISTORY = "regress_tables: from the samples of {} groups of manoeuvres"
_ROUNDING = 1e-6  # singular value over the largest
_PORTION = 4_000_000  # numbers of samples times directions held at a time

Covariance = Callable[[xr.Dataset, np.ndarray, np.ndarray], np.ndarray]


def regress_tables(
    samples: Sequence[xr.Dataset],
    prior: xr.DataTree,
    covariance: Covariance,
    held: Sequence[str] = (),
    lengths: Mapping[str, float] | None = None,
    fits: Sequence[Any] = (),
    shapes: Mapping[str, Sequence[Shape]] | None = None,
    unplaced: str = "raise",
    local: Sequence[Any] = (),
) -> Tabulation:
    """Return the terms of a database estimated from samples, without local models.

    Parameters
    ----------
    samples : sequence of Dataset (sample,)
        One for every manoeuvre or group of manoeuvres of one disturbance: a coefficient, named by
        the attribute ``coefficient``, and the variables of its terms [SI].  Where they have common
        errors, the changes by one standard error of each: ``<coefficient>_error`` (error, sample)
        and the same of variables.  The attribute ``name`` is for reports.
    prior : DataTree
        The database; its leaves need ``stderr``, a node with ``stderr`` 0 stays.
    covariance : callable
        ``covariance(samples, X, v)``: the covariance of the least-squares estimate with the
        regressors X (sample, term), of which v are the residuals; such as
        `flighttest.combining.coloured_covariance`.
    held, lengths, shapes
        As in `tabulate`.
    fits : sequence of Fit
        Estimates whose samples are not at hand, such as published values; they count as in
        `tabulate`.
    unplaced : {"raise", "warn"}
        As in `tabulate`, for the terms of `fits` and `local`, and where no local model describes
        samples for their primary controls (elevator of CL and Cm, aileron of Cl, rudder of CY and
        Cn, flaps, gear): one that moved and on which no term of the coefficient depends is
        significant if its t value in the residual of the tables is 4.47 or more.
    local : sequence of Fit
        Local models of the same samples.  They are not counted; only their terms must have a place.

    Returns
    -------
    Tabulation
        As that of `tabulate`; a row of ``points`` for each of `samples`, then of `fits`.

    Raises
    ------
    IdentificationError
        No samples, or fewer in one Dataset than directions in which they move the tables.
    SchemaError, UnknownName
        As in `tabulate`.

    Warns
    -----
    AeromatchWarning
        As in `tabulate`.

    References
    ----------
    .. [Hansen1998] Hansen, Rank-Deficient and Discrete Ill-Posed Problems, SIAM 1998, chapter 3.
    .. [Morelli1997] Morelli, Klein, J. Guidance 20, 1997.
    """
    if not samples:
        raise IdentificationError(
            "no samples; regress_tables needs those of at least one manoeuvre"
        )
    lengths = {**LENGTHS, **(lengths or {})}
    demand_shapes(
        shapes or {}, {name: leaf for name, leaf in terms(prior).items() if name not in held}
    )
    findings, lost = [], [unplaced_terms([*fits, *local], prior, held)]
    modelled = {(coefficient_of(fit), str(fit.estimates.attrs.get("name", ""))) for fit in local}
    for known in known_terms(
        [*(str(one.attrs["coefficient"]) for one in samples), *map(coefficient_of, fits)],
        prior,
        held,
    ):
        mine = [one for one in samples if one.attrs["coefficient"] == known.coefficient]
        given = [fit for fit in fits if coefficient_of(fit) == known.coefficient]
        of_samples = [
            str(name) for one in mine if "error" in one.coords for name in one["error"].values
        ]
        sources = list(dict.fromkeys([*of_samples, *common_errors_of_fits(given)]))
        sampled = np.max(
            [known.sampled(data) for data in (*mine, *(fit.data for fit in given))], axis=0
        )
        priors = [
            _declared(leaf, sampled[at], lengths)
            for leaf, at in zip(known.free.values(), slices_of(known.free.values()))
        ]
        seen = [_observe(one, known, priors, sources, covariance) for one in mine]
        unmodelled = [
            k for k, one in enumerate(seen) if (known.coefficient, one.name) not in modelled
        ]
        lost += [
            unplaced_controls(seen[k].name, mine[k], known, seen[k].directions, covariance)
            for k in unmodelled
        ]
        observed = [one.observation for one in seen] + [
            observe_fit(fit, known, sources) for fit in given
        ]
        findings.append(join_observations(known, observed, lengths, shapes, _HISTORY))
    table = pd.concat([one for one in lost if len(one)] or lost[:1])
    notices = demand_places(table, unplaced)
    return add_cautions(merge_tabulations(findings), table, notices)


class _Seen(NamedTuple):
    """The observation of one set of samples, and what returns the orthonormal directions in which
    its samples move the tables.
    """

    observation: Observation
    directions: Callable[[], np.ndarray]

    @property
    def name(self) -> str:
        """Name of the samples."""
        return self.observation.name


def _declared(leaf: xr.Dataset, sampled: np.ndarray, lengths: Mapping[str, float]) -> np.ndarray:
    """Return the covariance of the nodes of a term before anything is learnt."""
    return np.einsum("k,kij->ij", list(SHARES.values()), prior_parts(leaf, sampled, lengths))


def _observe(
    samples: xr.Dataset,
    known: CoefficientTerms,
    priors: Sequence[np.ndarray],
    sources: Sequence[str],
    covariance: Covariance,
) -> _Seen:

    bases = known.bases_at(samples)
    z = samples[known.coefficient].values.astype(float)
    for name, (leaf, _) in known.fixed.items():
        z = z - bases[name] @ leaf["value"].values.ravel()
    g0 = np.concatenate([leaf["value"].values.ravel() for leaf in known.free.values()])
    B = hstack([bases[name] for name in known.free], format="csr")
    touched, F = _moved([bases[name] for name in known.free], priors)
    BF = _Product(B[:, touched], F)
    r = z - B @ g0
    s, W, U = _kept(
        BF, r, lambda X, v: covariance(samples, X, v), str(samples.attrs.get("name", ""))
    )
    C = covariance(samples, U, r - U @ (U.T @ r))
    nodes = g0.copy()
    nodes[touched] += F @ (W @ (s / (s**2 + np.diag(C)) * (U.T @ r)))
    common = np.zeros((len(s), len(sources)))
    names, change = _changes(samples, known, bases, nodes)
    common[:, [sources.index(name) for name in names]] = U.T @ change.T
    H = np.zeros((len(s), len(g0)))
    H[:, touched] = (B[:, touched].T @ U).T
    D = [common, *(U.T @ (bases[name] @ factor) for name, (_, factor) in known.fixed.items())]
    name = str(samples.attrs.get("name", ""))
    return _Seen(
        Observation(
            name, samples, U.T @ z, H, np.hstack(D), C, known.sampled(samples), bases, sources
        ),
        BF.all_directions,
    )


def _moved(bases: Sequence, priors: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return which nodes the samples move, among all, and a factor F of their a-priori covariance F
    F'.
    """

    places, factors, before = [], [], 0
    for B, P in zip(bases, priors):
        here = np.flatnonzero(np.diff(B.tocsc().indptr))
        if len(here):
            size, shape = np.linalg.eigh(P[np.ix_(here, here)])
            known = size > _ROUNDING**2 * max(size[-1], 0.0)
            factors.append(shape[:, known] * np.sqrt(size[known]))
            places.append(before + here)
        before += B.shape[1]
    return np.concatenate(places), block_diag(*factors)


class _Product:
    """Sparse B times dense F, never held as a whole."""

    def __init__(self, B, F: np.ndarray) -> None:
        self.B, self.F = B, F

    def decomposed(self) -> tuple[np.ndarray, np.ndarray]:
        """Return singular values and right singular vectors (columns), by the triangular factor of
        portions of the rows.
        """
        rows = max(self.F.shape[1], _PORTION // max(self.F.shape[1], 1))
        R = np.zeros((0, self.F.shape[1]))
        for start in range(0, self.B.shape[0], rows):
            R = np.asarray(
                np.linalg.qr(np.vstack([R, self.B[start : start + rows] @ self.F]), mode="r")
            )
        _, s, Wt = np.linalg.svd(R, full_matrices=False)
        known = s > _ROUNDING * s[0]
        return s[known], Wt[known].T

    def all_directions(self) -> np.ndarray:
        """Return all left singular vectors, (samples, directions)."""
        return self.directions(*self.decomposed())

    def directions(self, s: np.ndarray, W: np.ndarray) -> np.ndarray:
        """Return left singular vectors, (samples, directions)."""
        return np.asarray(self.B @ (self.F @ (W / s)))


def _kept(
    BF: _Product,
    r: np.ndarray,
    covariance: Callable[[np.ndarray, np.ndarray], np.ndarray],
    name: str,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return singular values, right and left singular vectors of the directions that distinguish
    the tables; one at least.
    """
    s, W = BF.decomposed()
    if len(s) >= len(r):
        raise IdentificationError(
            f"{name}: {len(r)} samples in {len(s)} directions of the tables; record more, or "
            f"join manoeuvres of one disturbance"
        )
    U = BF.directions(s, W)
    power = float(r @ r - (U.T @ r) @ (U.T @ r))
    noise = np.full(len(s), np.sqrt(max(power, 0.0) / (len(r) - len(s))))  # white to begin with
    for _ in range(2):
        keep = s > KEEP * noise
        keep[0] = True
        s, W, U = s[keep], W[:, keep], U[:, keep]
        noise = np.sqrt(np.diag(covariance(U, r - U @ (U.T @ r))))
    keep = s > KEEP * noise
    keep[0] = True
    return s[keep], W[:, keep], U[:, keep]


def _changes(
    samples: xr.Dataset, known: CoefficientTerms, bases: Mapping, nodes: np.ndarray
) -> tuple[list[str], np.ndarray]:
    """Return names of the common errors and what they change of measured minus tables, (error,
    sample).
    """
    name = f"{known.coefficient}_error"
    if name not in samples:
        return [], np.zeros((0, samples.sizes["sample"]))
    change = samples[name].values.astype(float)
    values = {term: nodes[at] for term, at in zip(known.free, slices_of(known.free.values()))}
    values |= {term: leaf["value"].values.ravel() for term, (leaf, _) in known.fixed.items()}
    for term, leaf in known.leaves.items():
        moving = {
            x: samples[f"{x}_error"].values
            for x in _terms.list_model_variables(leaf)
            if f"{x}_error" in samples
        }
        for k in range(len(change)):
            by = {x: steps[k] for x, steps in moving.items() if steps[k].any()}
            if by:
                moved = samples.assign(
                    {x: ("sample", samples[x].values + step) for x, step in by.items()}
                )
                change[k] -= (basis_at(leaf, moved) - bases[term]) @ values[term]
    return [str(source) for source in samples["error"].values], change

"""Directions of node changes that matter along flights, each one standard error long.

Along a flight a coefficient changes by B dg, with B the interpolation weights of its nodes and dg
the change of the nodes, which have the covariance V. The smallest change, in the metric of V, with
given changes of the coefficient lies in the span of V B'. With the eigenvectors u_k and eigenvalues
l_k of B V B', the directions V B' u_k / sqrt(l_k) are orthonormal in that metric: sum z_k d_k has
the Mahalanobis distance |z|.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
import xarray as xr

import aerodb
from aerodb.store.schema import HINGE
from flightmech import terms as _terms
from flightmech.errors import SchemaError, UnknownName
from pom.cases.case import PomCase
from pom.diagnosis.sampling.shares import flown_conditions
from pom.probing.aircraft_identity import other_quantities, refuse_other_aircraft
from pom.replaying.trim import rationale_problem


def demand_cases(cases: Sequence[PomCase], wanted: Sequence[str] | None) -> None:
    """Check that cases can be tuned.

    Raises
    ------
    UnknownName
        A requested case that does not exist.
    SchemaError
        With all cases that have a control law, trim surfaces to solve for, or a name twice.
    """
    names = [case.name for case in cases]
    for name in wanted or ():
        if name not in names:
            raise UnknownName(name, names, "case")
    problems: list[str] = []
    for case in cases:
        if case.law:
            problems.append(
                f"{case.name}: the kernel flies no FMU of a control law; leave the case out"
            )
    for case in cases:
        if case.drive.trim_surfaces:
            problems.append(
                f"{case.name}: its trim surfaces are solved for on an FMU, which tuning does not "
                f"fly; leave the case out"
            )
    for name, count in Counter(names).items():
        if count > 1:
            problems.append(f"{count} cases are named {name!r}; give each a name of its own")
    if problems:
        raise SchemaError("cases to tune", problems)


def demand_evidence(
    database: xr.DataTree, evidence: xr.DataTree, rationale: Mapping[str, str]
) -> None:
    """Check that the evidence bounds moves of the model.

    Raises
    ------
    UnknownName
        A term with a rationale that has no standard errors.
    SchemaError
        The evidence is of another aeroplane, or has no standard errors. Or, with all problems: a
        table that the model does not have, a rationale without name, date and reason.
    """
    # the tables of another aeroplane have other breakpoints, too
    words = ("the evidence", "the model")
    refuse_other_aircraft(other_quantities(evidence.attrs, database.attrs, words))
    model = aerodb.terms(database)
    bounding: dict[str, xr.Dataset] = {}
    for name, leaf in aerodb.terms(evidence).items():
        if "stderr" in leaf and (leaf["stderr"] > 0.0).any():
            bounding[name] = leaf
    if not bounding:
        text = (
            "no term has standard errors, nothing bounds a move; give an identified "
            "database (--evidence)"
        )
        raise SchemaError("evidence", [text])
    for name in rationale:
        if name not in bounding:
            raise UnknownName(name, bounding, "term with standard errors")
    problems: list[str] = []
    for name, reason in rationale.items():
        # the same rule as for a trim bias of a case: who allows it, when and why
        lacking = rationale_problem(reason)
        if lacking:
            problems.append(f"{name}: the rationale is {reason!r}; {lacking}")
    missing = [name for name in bounding if name not in model]
    if missing:
        problems.append(
            f"the evidence has {len(missing)} terms that the model lacks ({', '.join(missing)}); "
            f"tune a model with these terms, such as final.nc of the same match (--database), or "
            f"give evidence that has only the terms of the model"
        )
    for name, leaf in bounding.items():
        if name in model and not _have_same_axes(leaf["value"], model[name]["value"]):
            problems.append(
                f"{name}: the evidence has other breakpoints than the model; give the evidence on "
                f"the breakpoints of the model"
            )
    if problems:
        raise SchemaError("evidence", problems)


def _have_same_axes(first: xr.DataArray, second: xr.DataArray) -> bool:
    if first.dims != second.dims:
        return False
    return all(np.array_equal(first[axis], second[axis]) for axis in first.dims)


LEAST = 1e-4  # smallest eigenvalue of a direction, of the largest one
MOST = 12  # directions of a coefficient
_LEAST_EIGENVALUE = 1e-300  # in place of a largest eigenvalue of zero


@dataclass(frozen=True)
class Directions:
    """Directions of node changes.

    Attributes
    ----------
    of : tuple of str
        The coefficient of each direction (direction,).
    nodes : dict of str to array (direction, nodes)
        By term, in the order of ``value.ravel()``: change of the nodes for one standard error.
    """

    of: tuple[str, ...]
    nodes: Mapping[str, np.ndarray]

    @classmethod
    def along(cls, db: xr.DataTree, flights: Sequence[xr.Dataset], hinges: bool) -> Directions:
        """Return the directions that flights determine.

        Parameters
        ----------
        db : DataTree
            With standard errors.
        flights : sequence of Dataset (time,)
            States of the cases. [SI]
        hinges : bool
            Whether hinge moments are among them.
        """
        leaves = {name: leaf for name, leaf in aerodb.terms(db).items() if "stderr" in leaf}
        coefficients: list[str] = []
        for coefficient in dict.fromkeys(name.split("/")[0] for name in leaves):
            if hinges or coefficient not in HINGE:
                coefficients.append(coefficient)
        parts = [_directions_of(db, name, leaves, flights=flights) for name in coefficients]
        of: list[str] = []
        for coefficient, (D, _) in zip(coefficients, parts, strict=True):
            of += [coefficient] * len(D)
        # Directions of one coefficient do not change the nodes of another one.
        nodes: dict[str, np.ndarray] = {}
        first = 0
        for D, slices in parts:
            for name, columns in slices.items():
                nodes[name] = np.zeros((len(of), columns.stop - columns.start))
                nodes[name][first : first + len(D)] = D[:, columns]
            first += len(D)
        return cls(tuple(of), nodes)

    def change(self, z: np.ndarray) -> dict[str, np.ndarray]:
        """Return the changes of the nodes (nodes,) by term.

        `z` (direction,) are the amounts of the directions in standard errors.
        """
        return {name: z @ D for name, D in self.nodes.items()}


def _directions_of(
    db: xr.DataTree,
    coefficient: str,
    leaves: Mapping[str, xr.Dataset],
    *,
    flights: Sequence[xr.Dataset],
) -> tuple[np.ndarray, dict[str, slice]]:
    """Return the directions (direction, nodes) of one coefficient, and the nodes of its terms."""
    slices, V = aerodb.update.covariance(db, coefficient)
    B = _interpolation_weights(db, {name: leaves[name] for name in slices}, flights)
    used = np.flatnonzero(B.any(axis=0))
    # With B = Q R, the eigenvalues of R V R' are those of B V B', and with u = Q w it follows that
    # V B' u = V R' w. R is smaller than B.
    _, R = np.linalg.qr(B[:, used])
    VR = V[:, used] @ R.T
    values, vectors = np.linalg.eigh(R @ VR[used])
    # `eigh` returns the largest eigenvalue last.
    least = LEAST * max(values[-1], _LEAST_EIGENVALUE)
    order = [k for k in reversed(range(len(values))) if values[k] > least][:MOST]
    D = np.zeros((len(order), len(V)))
    for row, k in enumerate(order):
        D[row] = (VR @ vectors[:, k]) / np.sqrt(values[k])
    # The sign of an eigenvector is arbitrary: the largest element of a direction is positive.
    largest = np.abs(D).argmax(axis=1)
    signs = np.sign(D[np.arange(len(D)), largest])
    return D * signs[:, None], slices


def _interpolation_weights(
    db: xr.DataTree, leaves: Mapping[str, xr.Dataset], flights: Sequence[xr.Dataset]
) -> np.ndarray:
    """Return the weights of the nodes of some terms at the samples of all flights (sample,
    node).
    """
    rows = []
    for states in flights:
        samples = flown_conditions(db, leaves, states)
        count = len(next(iter(samples.values()), (0,)))
        weights = []
        for leaf in leaves.values():
            weight = _terms.basis(leaf, samples, "clamp").toarray()
            # A constant has one row for all samples.
            weights.append(np.broadcast_to(weight, (count, weight.shape[1])))
        rows.append(np.hstack(weights))
    return np.vstack(rows)


_LEAST_NORM = 1e-12  # of a row of G, and of the residual of an unsolvable problem
_TOLERANCE = 1e-6  # by which a solution may violate a limit


def least_distance(G: np.ndarray, h: np.ndarray) -> np.ndarray | None:
    """Return the shortest z (n,) with G z >= h; None if no z satisfies all limits.

    Parameters
    ----------
    G : array (m, n)
    h : array (m,)

    References
    ----------
    .. [Lawson1974] Lawson, Hanson, Solving Least Squares Problems, Prentice-Hall 1974, chapter 23,
       algorithm LDP.
    """
    if not len(G) or (h <= 0.0).all():
        return np.zeros(G.shape[1])
    scale = np.maximum(np.linalg.norm(G, axis=1), _LEAST_NORM)
    G, h = G / scale[:, None], h / scale
    # LDP: u >= 0 minimises |E u - f| with E = [G'; h'], f = (0 ... 0, 1), and z = -r / r_(n+1)
    # with the residual r = E u - f. A residual of zero means that the limits contradict.
    E = np.vstack([G.T, h])
    f = np.append(np.zeros(G.shape[1]), 1.0)
    u, _ = scipy.optimize.nnls(E, f, maxiter=30 * E.shape[1])
    r = E @ u - f
    if not abs(r[-1]) > _LEAST_NORM:
        return None
    z = -r[:-1] / r[-1]
    if not (G @ z >= h - _TOLERANCE * (1.0 + np.abs(h))).all():
        return None
    return z

"""Directions of the nodes of a database that matter along flights, each one standard error long.

Along a flight a coefficient changes by B dg, with B the interpolation weights of its nodes, and V
is the covariance of these.  The smallest change, in the metric of V, that makes given changes of
the coefficient lies in the span of V B'.  With the eigenvectors u_k and eigenvalues l_k of B V B',
the directions V B' u_k/sqrt(l_k) are orthonormal in that metric: sum z_k d_k has the Mahalanobis
distance |z|.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.optimize import nnls

import aerodb
from aerodb.store.schema import HINGE
from flightmech import terms as _terms
from flightmech.errors import SchemaError, UnknownName
from pom.cases.case import PomCase
from pom.diagnosis.sampling.shares import flown_conditions


def demand_cases(cases: Sequence[PomCase], wanted: Sequence[str] | None) -> None:
    """Check that cases can be tuned.

    Raises
    ------
    UnknownName
        A wanted case that is not there.
    SchemaError
        Cases with a control law, with trim surfaces to solve for, or of one name; all of them.
    """
    names = [case.name for case in cases]
    for name in wanted or ():
        if name not in names:
            raise UnknownName(name, names, "case")
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    problems = [
        f"{case.name}: the kernel flies no FMU of a control law; leave the case out"
        for case in cases
        if case.law
    ]
    solved = [case.name for case in cases if case.drive.trim_surfaces]
    problems += [
        f"{name}: its trim surfaces are solved for on an FMU, which tuning does not fly; "
        f"leave the case out"
        for name in solved
    ]
    problems += [
        f"{names.count(name)} cases are named {name!r}; give each a name of its own"
        for name in twice
    ]
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
        An evidence without standard errors, or with a table that the model does not have; a
        rationale without words; all of them.
    """
    model = aerodb.terms(database)
    found = {
        name: leaf
        for name, leaf in aerodb.terms(evidence).items()
        if "stderr" in leaf and (leaf["stderr"] > 0.0).any()
    }
    if not found:
        raise SchemaError(
            "evidence",
            [
                "no term has standard errors, nothing bounds a move; give an identified "
                "database (--evidence)"
            ],
        )
    for name in rationale:
        if name not in found:
            raise UnknownName(name, found, "term with standard errors")
    problems = [
        f"{name}: a rationale without words; write why the term may leave the bound"
        for name, why in rationale.items()
        if not why.strip()
    ]
    other = [
        name
        for name, leaf in found.items()
        if name not in model or not _same_axes(leaf["value"], model[name]["value"])
    ]
    problems += [
        f"{name}: {'the evidence has other breakpoints than the model' if name in model else 'the model has no such term'}; "
        "give the evidence on the breakpoints of the model"
        for name in other
    ]
    if problems:
        raise SchemaError("evidence", problems)


def _same_axes(one: xr.DataArray, other: xr.DataArray) -> bool:
    return one.dims == other.dims and all(
        np.array_equal(one[axis], other[axis]) for axis in one.dims
    )


LEAST = 1e-4  # of the largest eigenvalue
MOST = 12  # of a coefficient


@dataclass(frozen=True)
class Directions:
    """Directions of node changes.

    Attributes
    ----------
    of : tuple of str
        The coefficient that each changes (direction,).
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
        heads = [
            head
            for head in dict.fromkeys(name.split("/")[0] for name in leaves)
            if hinges or head not in HINGE
        ]
        found = {head: _of(db, head, leaves, flights) for head in heads}
        of = tuple(head for head in heads for _ in range(len(found[head][0])))
        nodes: dict[str, np.ndarray] = {}
        first = 0
        for head in heads:
            D, slices = found[head]
            for name, rows in slices.items():
                nodes[name] = np.zeros((len(of), rows.stop - rows.start))
                nodes[name][first : first + len(D)] = D[:, rows]
            first += len(D)
        return cls(of, nodes)

    def change(self, z: np.ndarray) -> dict[str, np.ndarray]:
        """Return the change of the nodes (nodes,) by term for the amounts z (direction,), in
        standard errors.
        """
        return {name: z @ D for name, D in self.nodes.items()}


def _of(
    db: xr.DataTree, head: str, leaves: Mapping[str, xr.Dataset], flights: Sequence[xr.Dataset]
) -> tuple[np.ndarray, dict[str, slice]]:
    """Return the directions (direction, nodes) of one coefficient, and the nodes of its terms."""
    slices, V = aerodb.update.covariance(db, head)
    own = {name: leaves[name] for name in slices}
    rows = []
    for states in flights:
        samples = flown_conditions(db, own, states)
        count = len(next(iter(samples.values()), (0,)))
        weights = [_terms.basis(leaf, samples, "clamp").toarray() for leaf in own.values()]
        rows.append(
            np.hstack([np.broadcast_to(part, (count, part.shape[1])) for part in weights])
        )  # a constant has one row
    B = np.vstack(rows)
    used = np.flatnonzero(B.any(axis=0))
    _, R = np.linalg.qr(
        B[:, used]
    )  # B = Q R: R V R' has the eigenvalues of B V B', and V B' u = V R' w with u = Q w
    VR = V[:, used] @ R.T
    values, vectors = np.linalg.eigh(R @ VR[used])
    kept = [k for k in range(len(values))[::-1] if values[k] > LEAST * max(values[-1], 1e-300)][
        :MOST
    ]
    D = np.array([(VR @ vectors[:, k]) / np.sqrt(values[k]) for k in kept]).reshape(
        len(kept), len(V)
    )
    signs = np.sign(
        D[np.arange(len(D)), np.abs(D).argmax(axis=1)]
    )  # an eigenvector has no sign of its own
    return D * signs[:, None], slices


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

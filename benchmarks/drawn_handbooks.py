"""Tables from flights of aeroplanes whose handbook has drawn errors: are the standard errors true?

    python benchmarks/drawn_handbooks.py [PROJECT.toml] [--draws 24] [--seed 1]
        [--coefficients CL,Cm]

One aeroplane has one handbook, so that its errors are a single draw of what the a-priori tables
declare, for every seed of the flights.  Here the fits of a project give which nodes were flown and
with what errors, and each draw is another aeroplane: weights of the parts of the prior, node
values, errors that fits share and errors of each fit come from the distributions that
`aerodb.tabulate` assumes.  Per coefficient: flown nodes, the share within two standard errors, rms
and largest error over standard error.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import scipy
from planned_programme import before, local_fits

from aerodb.update.correlation import LENGTHS, PARTS, SHARES, prior_parts
from aerodb.update.observations import (
    CoefficientTerms,
    Observation,
    observe_fits,
    observed_nodes,
    sampled_weights,
)
from aerodb.update.tabulation import FLOWN, slices_of
from aerodb.update.weights.weight_learning import weigh_fits
from aerodb.update.weights.weight_likelihood import SHAPE, a_priori_logarithms, plain_shares
from aeromatch.project.project import read_project

DATA = Path(__file__).parents[1] / "data"


def covariance_root(V: np.ndarray) -> np.ndarray:
    """Return L with L L' = V, also for a singular V."""
    sd = np.sqrt(np.diag(V))
    free = sd > 0.0
    root = np.zeros_like(V)
    if free.any():
        eigenvalues, vectors = np.linalg.eigh(V[np.ix_(free, free)] / np.outer(sd[free], sd[free]))
        root[np.ix_(free, free)] = sd[free, None] * vectors * np.sqrt(np.maximum(eigenvalues, 0.0))
    return root


class DrawnAeroplanes:
    """Aeroplanes and flights of one coefficient, drawn with the a-priori distributions."""

    def __init__(self, coefficient_terms: CoefficientTerms, observed: list[Observation]):
        self.observed = observed
        free = coefficient_terms.free.values()
        self.rows, self.plain_shares = slices_of(free), plain_shares(free)
        self.H = np.vstack([one.H for one in observed])
        self.D = np.vstack([one.D for one in observed])
        self.C_root = covariance_root(scipy.linalg.block_diag(*[one.C for one in observed]))
        touched, sampled = observed_nodes(observed), sampled_weights(observed)
        self.parts = []
        for leaf, rows in zip(free, self.rows, strict=True):
            self.parts.append(prior_parts(leaf, (sampled * touched)[rows], LENGTHS))
        declared = np.concatenate([leaf["stderr"].values.ravel() for leaf in free])
        self.flown = (sampled >= FLOWN) & touched & (declared > 0.0)

    def scores(self, count: int, rng: np.random.Generator) -> Iterator[np.ndarray]:
        """Yield the errors of the flown nodes over their standard errors, draw by draw."""
        crossed = [P @ self.H[:, rows].T for P, rows in zip(self.parts, self.rows, strict=True)]
        pairs = zip(crossed, self.rows, strict=True)
        estimates = np.concatenate([self.H[:, rows] @ PH for PH, rows in pairs])
        for _ in range(count):
            nodes, y = self._draw(rng)
            learnt = weigh_fits(y, self.observed, self.D, estimates, shares=self.plain_shares)
            weights = learnt.factors[:-1].reshape(len(self.rows), -1)
            variances, PH = [], []
            for w, P, part in zip(weights, self.parts, crossed, strict=True):
                variances.append(w @ np.diagonal(P, axis1=1, axis2=2))
                PH.append(np.einsum("k,kij->ij", w, part))
            # as in `aerodb.update.tabulation`
            gain = np.vstack(PH) @ learnt.inverse
            variance = (
                np.concatenate(variances)
                - np.einsum("ij,ij->i", gain, np.vstack(PH))
                + ((gain @ self.D) ** 2).sum(axis=1)
                - np.einsum("ij,ij->i", gain @ learnt.own_errors, gain)
            )
            yield ((gain @ y - nodes) / np.sqrt(np.maximum(variance, 1e-300)))[self.flown]

    def _draw(self, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Return the true nodes less the handbook, and the estimates less their expectation."""
        tables = len(self.rows)
        mean, spread = a_priori_logarithms(tables)
        weights = np.exp(mean + spread * rng.standard_normal(len(mean)))
        of_tables = weights[:-1].reshape(tables, -1)
        is_plain = rng.random(tables) < self.plain_shares
        of_tables[np.ix_(is_plain, np.isin(PARTS, SHAPE))] = 0.0
        reach = of_tables[:, PARTS.index("reach")]
        np.maximum(reach, SHARES["reach"], out=reach)
        nodes = np.zeros(self.H.shape[1])
        for w, P, rows in zip(of_tables, self.parts, self.rows, strict=True):
            root = covariance_root(np.einsum("k,kij->ij", w, P))
            nodes[rows] = root @ rng.standard_normal(len(root))
        common = self.D @ rng.standard_normal(self.D.shape[1])
        own = self.C_root @ rng.standard_normal(len(self.C_root))
        return nodes, self.H @ nodes + common + np.sqrt(max(weights[-1], 1.0)) * own


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("project", nargs="?", type=Path, default=DATA / "t37" / "aeromatch.toml")
    parser.add_argument("--draws", type=int, default=24)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--coefficients", default="", help="such as CL,Cm; default all")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    project = read_project(given.project)
    fits = local_fits(project, 1)
    found = []
    for group, observed in observe_fits(fits, before(project)[1], project.held):
        name = group.coefficient
        if given.coefficients and name not in given.coefficients.split(","):
            continue
        rng = np.random.default_rng([given.seed, *name.encode()])
        found.append(np.array(list(DrawnAeroplanes(group, observed).scores(given.draws, rng))))
        print(describe(name, found[-1]), flush=True)
    print(describe("all", np.hstack(found)))


def describe(name: str, z: np.ndarray) -> str:
    """Return a line about errors over standard errors (draw, node)."""
    return (
        f"{name}: {z.shape[1]} flown nodes, {len(z)} draws; within two "
        f"{100 * np.mean(abs(z) < 2):.1f} %, rms {np.sqrt(np.mean(z**2)):.2f}, largest {np.abs(z).max():.1f}"
    )


if __name__ == "__main__":
    main()

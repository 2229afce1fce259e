"""Terms moved as little as the flight evidence allows, so that rows pass.

The evidence is a database with its covariance V.  The tuned model is the one nearest to it, (g - e)' V^-1 (g - e) least, whose replays
are within tolerance: the ratios are linearised in the directions that the flights determine (`Directions`), the shortest step inside all
linear limits is taken (`least_distance`), flown, and linearised again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr

import aerodb
import flightmech
from flightmech import Aircraft
from flightmech.errors import SchemaError, UnknownName
from flightmech.simulation import with_table_values

from ..replaying.replay_case import Plan
from ..sampling.instruments import Instruments
from ..sampling.sampled_case import Bench, Run
from .directions import Directions
from .least_distance import least_distance

BOUND = 2.0  # standard errors of a node, without a rationale for its term
MARGIN = 0.98  # of the tolerance
PROBE = 0.5  # standard errors
ITERATIONS = 8
SAMPLES = 60  # of a time history at which it is limited
_STILL = 1e-6  # standard errors


@dataclass(frozen=True)
class Tuning:
    """Outcome of `tune`.

    Attributes
    ----------
    database : DataTree or None
        The tuned one, with its moves in history and undo history; None when it was refused.
    moves : DataFrame
        Index term: ``from_evidence`` and ``moved``, the largest change of a node against evidence and model, ``share`` of the squared
        distance from the model that the term takes, ``rationale``.  [standard errors, 1]
    rows : DataFrame
        Index case: ``wanted``, ``before`` and ``after`` (status), ``ratio_before`` and ``ratio_after``. [1]
    distance : float
        Mahalanobis distance of the tuned model from the evidence.
    refusal : str
        Why the rows cannot pass inside the bounds, with what it would take; empty when they pass.
    """

    database: xr.DataTree | None
    moves: pd.DataFrame
    rows: pd.DataFrame
    distance: float
    refusal: str = ""

    def log(self) -> list[str]:
        """Return what moved and what it did, line by line."""
        lines = [self.refusal] if self.refusal else []
        for name, row in self.moves.iterrows():
            why = f"; {row['rationale']}" if row["rationale"] else ""
            lines.append(
                f"{name}: moved by {row['moved']:.2f} standard errors, {row['from_evidence']:.2f} from the evidence, "
                f"{100.0 * row['share']:.0f} % of the distance{why}"
            )
        for name, row in self.rows.iterrows():
            ratios = f"{row['ratio_before']:.2f} -> {row['ratio_after']:.2f} x tolerance"
            lines.append(f"{name}: {row['before']} -> {row['after']}, {ratios}{', wanted' if row['wanted'] else ''}")
        return lines


def tune(
    plans: Sequence[Plan],
    database: xr.DataTree,
    aircraft: Aircraft,
    wanted: Sequence[str] | None = None,
    evidence: xr.DataTree | None = None,
    rationale: Mapping[str, str] | None = None,
    bound: float = BOUND,
) -> Tuning:
    """Move terms so that rows pass, inside the standard errors of the evidence.

    Parameters
    ----------
    plans : sequence of Plan
        Cases, of `pom.replaying.plan_of`; all with one aircraft.
    database : DataTree
        The model.
    aircraft : Aircraft
    wanted : sequence of str, optional
        Names of the cases that must pass; all without it.  What becomes of the others is reported.
    evidence : DataTree, optional
        What flight found, with standard errors and the axes of the model; the model itself without it.
    rationale : mapping of str to str, optional
        By term: why it may leave the bound.
    bound : float
        Of every node of a term without a rationale. [standard errors]

    Returns
    -------
    Tuning
        With a refusal, and no database, when the rows cannot pass inside the bounds; ``moves`` then are what it would take.

    Raises
    ------
    UnknownName
        A wanted case or a term with a rationale that is not there.
    SchemaError
        A case with a control law, an evidence without standard errors or with a table that the model does not have.
    """
    bench = _Tuner.of(plans, database, aircraft, wanted, evidence, dict(rationale or {}))
    z, passed = bench.search(bound)
    refusal = ""
    if not passed:
        z, passed = bench.search(np.inf)
        refusal = bench.refusal(z, passed, bound)
    moves = bench.moves(z)
    rows = bench.rows(z)
    tuned = None if refusal else bench.tuned(z, moves)
    return Tuning(tuned, moves, rows, float(np.linalg.norm(z)), refusal)


def _pass(runs: Mapping[str, Run]) -> bool:
    return all(run.status == "pass" for run in runs.values())


class _Tuner:
    """Cases, model and evidence."""

    def __init__(self, benches, wanted, database, evidence, directions, sim, rationale):
        self.benches: dict[str, Bench] = benches
        self.wanted: list[str] = wanted
        self.database: xr.DataTree = database
        self.evidence: dict[str, xr.Dataset] = {n: leaf for n, leaf in aerodb.terms(evidence).items() if n in directions.nodes}
        self.found: xr.DataTree = evidence
        self.directions: Directions = directions
        self.sim = sim
        self.rationale: dict[str, str] = rationale

    @classmethod
    def of(cls, plans, database, aircraft, wanted, evidence, rationale) -> _Tuner:
        laws = [plan.case.name for plan in plans if plan.job.law is not None]
        if laws:
            raise SchemaError("cases to tune", [f"{name}: the kernel flies no FMU of a control law; leave the case out" for name in laws])
        names = [plan.case.name for plan in plans]
        for name in wanted or ():
            if name not in names:
                raise UnknownName(name, names, "case")
        found = database if evidence is None else evidence
        sim = flightmech.compile(aircraft, database)
        none = Instruments((), {}, {}, {})
        benches = {plan.case.name: Bench.of(plan, sim, none) for plan in plans}
        hinges = any(plan.case.drive.level != "recorded" for plan in plans)
        directions = Directions.along(found, [plan.states for plan in plans], hinges)
        if not directions.of:
            raise SchemaError("evidence", ["no term has standard errors; give an identified database"])
        for name in rationale:
            if name not in directions.nodes:
                raise UnknownName(name, directions.nodes, "term with standard errors")
        return cls(benches, list(wanted or names), database, found, directions, sim, rationale)

    def nodes(self, z: np.ndarray) -> dict[str, np.ndarray]:
        """Return the values of the terms for amounts z of the directions, from the evidence."""
        change = self.directions.change(z)
        return {name: leaf["value"].values + change[name].reshape(leaf["value"].shape) for name, leaf in self.evidence.items()}

    def fly(self, z: np.ndarray | None, names: Sequence[str]) -> dict[str, Run]:
        """Return the runs of cases; of the model itself without z."""
        sim = self.sim if z is None else with_table_values(self.sim, self.nodes(z))
        return {name: self.benches[name].run(sim, np.zeros(0)) for name in names}

    def search(self, bound: float) -> tuple[np.ndarray, bool]:
        """Return the amounts, and whether the wanted cases pass with them."""
        z = np.zeros(len(self.directions.of))
        for _ in range(ITERATIONS):
            runs = self.fly(z, self.wanted)
            if _pass(runs):
                return z, True
            step = self.step(z, runs, bound)
            if step is None or np.abs(step - z).max() < _STILL:
                return z, False
            z = step
        return z, _pass(self.fly(z, self.wanted))

    def step(self, z: np.ndarray, runs: Mapping[str, Run], bound: float) -> np.ndarray | None:
        """Return the shortest amounts inside all limits linearised about z; None when there are none."""
        now = self.limited(runs)
        slopes = np.zeros((len(now), len(z)))
        for k in range(len(z)):
            there = z.copy()
            there[k] += PROBE
            slopes[:, k] = (self.limited(self.fly(there, self.wanted), runs) - now) / PROBE
        slopes[~np.isfinite(slopes)] = 0.0
        level = now - slopes @ z
        G, h = np.vstack([-slopes, slopes]), np.concatenate([level - MARGIN, -level - MARGIN])
        for _ in range(20):  # limits of nodes are added as they are met
            found = least_distance(G, h)
            if found is None or not np.isfinite(bound):
                return found
            rows = self.beyond(found, bound)
            if not len(rows):
                return found
            G, h = np.vstack([G, -rows]), np.concatenate([h, np.full(len(rows), -bound)])
        return None

    def limited(self, runs: Mapping[str, Run], chosen: Mapping[str, Run] | None = None) -> np.ndarray:
        """Return the signed ratios that must be inside tolerances and limits of the trim.

        Of each group of criteria the alternative that is best in `chosen`; of a time history some samples and the worst of `chosen`.
        """
        found = []
        for name, run in runs.items():
            bench = self.benches[name]
            for criterion in bench.deciding((chosen or runs)[name]):
                channel = bench.traced.get(criterion, "")
                if channel not in run.difference:
                    found.append(np.atleast_1d(run.signed(criterion)))
                    continue
                half = bench.tolerance[channel].values
                inside = np.flatnonzero(np.isfinite(half))
                at = inside[np.unique(np.linspace(0, len(inside) - 1, SAMPLES).astype(int))]
                worst = inside[np.argmax(np.abs((chosen or runs)[name].difference[channel][inside]) / half[inside])]
                at = np.append(at, worst)
                found.append(run.difference[channel][at] / half[at])
            found.append(np.array([run.trim[quantity] for quantity in (chosen or runs)[name].trim]))
        return np.concatenate(found)

    def beyond(self, z: np.ndarray, bound: float) -> np.ndarray:
        """Return the limits, one row (direction,) each, that the nodes farthest beyond the bound call for."""
        rows = []
        for name, D in self.directions.nodes.items():
            sd = self.evidence[name]["stderr"].values.ravel()
            if name in self.rationale or not (sd > 0.0).any():
                continue
            size = np.divide(z @ D, sd, out=np.zeros(len(sd)), where=sd > 0.0)
            worst = int(np.abs(size).argmax())
            if abs(size[worst]) > bound * (1.0 + 1e-6):
                rows.append(np.sign(size[worst]) * D[:, worst] / sd[worst])
        return np.array(rows).reshape(len(rows), len(z))

    def refusal(self, z: np.ndarray, passed: bool, bound: float) -> str:
        """Return why the rows cannot pass inside the bound, and the price."""
        wanted = ", ".join(self.wanted)
        if not passed:
            return f"{wanted}: no change of the terms with standard errors makes them pass; the cause lies in what has none"
        sizes = self.sizes(self.nodes(z), {name: leaf["value"].values for name, leaf in self.evidence.items()})
        far = {name: size for name, size in sorted(sizes.items(), key=lambda item: -item[1]) if size > bound}
        price = ", ".join(f"{name} {size:.1f}" for name, size in far.items() if name not in self.rationale)
        what = f"it would take {price} standard errors: write a rationale for these terms"
        return f"{wanted}: cannot pass within {bound:g} standard errors; {what}"

    def sizes(self, new: Mapping[str, np.ndarray], old: Mapping[str, np.ndarray]) -> dict[str, float]:
        """Return the largest change of a node by term. [standard errors of the evidence]"""
        found = {}
        for name, leaf in self.evidence.items():
            sd = leaf["stderr"].values
            ratio = np.divide(np.abs(new[name] - old[name]), sd, out=np.zeros(sd.shape), where=sd > 0.0)
            found[name] = float(ratio.max(initial=0.0))
        return found

    def moves(self, z: np.ndarray) -> pd.DataFrame:
        """Return what moved, the largest share first."""
        new, leaves = self.nodes(z), aerodb.terms(self.database)
        model = {name: leaves[name]["value"].values for name in self.evidence}
        away = self.sizes(new, {name: leaf["value"].values for name, leaf in self.evidence.items()})
        moved, shares = self.sizes(new, model), self.shares({name: new[name] - model[name] for name in new})
        rows = {
            name: {"moved": moved[name], "from_evidence": away[name], "share": shares[name], "rationale": self.rationale.get(name, "")}
            for name in sorted(new, key=lambda name: -shares[name])
            if moved[name] > 1e-3
        }
        return pd.DataFrame.from_dict(rows, orient="index", columns=["moved", "from_evidence", "share", "rationale"])

    def shares(self, change: Mapping[str, np.ndarray]) -> dict[str, float]:
        """Return the share of every term in the squared Mahalanobis distance of a change of the nodes."""
        parts: dict[str, float] = {}
        for head in dict.fromkeys(name.split("/")[0] for name in change):
            slices, V = aerodb.update.covariance(self.found, head)
            dg = np.zeros(len(V))
            for name, rows in slices.items():
                dg[rows] = change[name].ravel()
            sd = np.sqrt(np.maximum(np.diag(V), 0.0))
            free = sd > 0.0
            x = dg[free] / sd[free]
            weight = np.zeros(len(V))
            weight[free] = x * np.linalg.solve(V[np.ix_(free, free)] / np.outer(sd[free], sd[free]) + 1e-6 * np.eye(free.sum()), x)
            parts |= {name: float(weight[rows].sum()) for name, rows in slices.items()}
        total = sum(parts.values())
        return {name: part / total if total > 0.0 else 0.0 for name, part in parts.items()}

    def rows(self, z: np.ndarray) -> pd.DataFrame:
        """Return what became of every case."""
        names = list(self.benches)
        before, after = self.fly(None, names), self.fly(z, names)
        found = {
            name: {
                "wanted": name in self.wanted,
                "before": before[name].status,
                "after": after[name].status,
                "ratio_before": before[name].decides,
                "ratio_after": after[name].decides,
            }
            for name in names
        }
        return pd.DataFrame.from_dict(found, orient="index")

    def tuned(self, z: np.ndarray, moves: pd.DataFrame) -> xr.DataTree:
        """Return the tuned database; every moved term states why and by how much."""
        leaves, nodes = aerodb.terms(self.database), self.nodes(z)
        new = {name: leaves[name].assign(value=leaves[name]["value"].copy(data=nodes[name])) for name in moves.index}
        if not new:
            return self.database
        note = "; ".join(f"{name} {row['moved']:.2f} standard errors" for name, row in moves.iterrows())
        return aerodb.replace_terms(self.database, new, f"pom tune for {', '.join(self.wanted)}: {note}")

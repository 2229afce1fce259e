"""Cases, model and evidence of a tuning, and the moves of its terms."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from joblib import Parallel, delayed

import aerodb
import flightmech
from flightmech import terms as _terms
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import SchemaError
from flightmech.names import lookup
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.node_values import with_table_values
from flightmech.units import from_si
from flighttest.reconstruction.dynamics.propeller_loads import with_engine_channels
from pom.diagnosis.sampling.draws import InstrumentErrors
from pom.diagnosis.sampling.sampled_bench import SampledBench, SampledRun
from pom.diagnosis.tuning.demands import Directions, demand_cases, demand_evidence, least_distance
from pom.replaying.replay_case import ReplayPlan

# A linearised limit is missed by a little: the ratios keep this distance from the tolerance.
MARGIN = 0.98
PROBE = 0.5  # standard errors
ITERATIONS = 8
# Samples of a time history with a limit; neighbours are nearly equal.
SAMPLES = 60
STATED = 0.01  # standard errors: a node that moved less keeps its source
ROUNDING = 1e-9  # standard errors
_STILL = 1e-6  # standard errors
_LIMIT_ROUNDS = 20  # in which limits of nodes are added to a step
_BEYOND = 1.0 + 1e-6  # of the bound: a node beyond it gets a limit
_RIDGE = 1e-6  # on the diagonal of a correlation matrix, so that it can be inverted
_JUDGEMENT = _terms.SOURCES.index("judgement")


def all_pass(runs: Mapping[str, SampledRun]) -> bool:
    """Return whether all runs pass."""
    return all(run.status == "pass" for run in runs.values())


class Tuner:
    """Cases, model and evidence of a tuning.

    Attributes
    ----------
    benches : dict of str to SampledBench
        By case.
    demanded : list of str
        Cases that must pass.
    database, evidence_database : DataTree
        The model, and the flight evidence.
    evidence : dict of str to Dataset
        Terms of the evidence that can be moved.
    directions : Directions
    sim : SimModel
        The compiled model.
    rationale : dict of str to str
    jobs : int
        Threads.
    """

    def __init__(
        self,
        benches: dict[str, SampledBench],
        database: xr.DataTree,
        evidence: xr.DataTree,
        *,
        directions: Directions,
        sim: SimModel,
        rationale: dict[str, str],
        jobs: int,
    ):
        self.benches = benches
        self.demanded: list[str] = []
        self.database = database
        self.evidence_database = evidence
        self.evidence: dict[str, xr.Dataset] = {}
        for name, leaf in aerodb.terms(evidence).items():
            if name in directions.nodes:
                self.evidence[name] = leaf
        self.directions = directions
        self.sim = sim
        self.rationale = rationale
        self.jobs = jobs

    @classmethod
    def of(
        cls,
        plans: Sequence[ReplayPlan],
        database: xr.DataTree,
        *,
        aircraft: Aircraft,
        requested: Sequence[str] | None,
        evidence: xr.DataTree | None,
        rationale: dict[str, str],
        jobs: int,
    ) -> Tuner:
        """Return the tuner of some cases, after checks of all inputs."""
        if evidence is None:
            evidence = database
        demand_cases([plan.case for plan in plans], requested)
        demand_evidence(database, evidence, rationale)
        sim = flightmech.compile(aircraft, database)
        # The input of the record counts as exact.
        exact = InstrumentErrors((), {}, {}, {})
        benches = {plan.case.name: SampledBench.of(plan, sim, exact) for plan in plans}
        # terms of the slipstream need the thrust of the propellers
        flights = [with_engine_channels(plan.states, aircraft) for plan in plans]
        hinges = any(plan.case.drive.level != "recorded" for plan in plans)
        directions = Directions.along(evidence, flights, hinges)
        if not directions.of:
            text = "no term that the cases use has standard errors, nothing can be moved"
            raise SchemaError("evidence", [text])
        return cls(
            benches,
            database,
            evidence,
            directions=directions,
            sim=sim,
            rationale=rationale,
            jobs=jobs,
        )

    def nodes(self, z: np.ndarray) -> dict[str, np.ndarray]:
        """Return the values of the terms for amounts z (direction,) from the evidence."""
        change = self.directions.change(z)
        values = {}
        for name, leaf in self.evidence.items():
            values[name] = leaf["value"].values + change[name].reshape(leaf["value"].shape)
        return values

    def fly(self, z: np.ndarray | None, names: Iterable[str]) -> dict[str, SampledRun]:
        """Return the runs of cases; with the model itself without z."""
        sim = self.sim
        if z is not None:
            sim = with_table_values(self.sim, self.nodes(z))
        return {name: self.benches[name].run(sim, np.zeros(0)) for name in names}

    def search_all(
        self, before: Mapping[str, SampledRun], bound: float
    ) -> tuple[np.ndarray, dict[str, SampledRun], bool]:
        """Return the amounts, the runs of all cases with them, and whether the demanded cases pass.

        Cases that pass with the model itself, and fail with the amounts, become demanded cases.
        """
        while True:
            z, passed = self.search(bound)
            # The search flies the demanded cases only.
            after = self.fly(z, self.benches)
            lost = []
            for name, run in after.items():
                has_passed = before[name].status == "pass"
                if has_passed and run.status != "pass" and name not in self.demanded:
                    lost.append(name)
            if not passed or not lost:
                return z, after, passed
            self.demanded = [*self.demanded, *lost]

    def search(self, bound: float) -> tuple[np.ndarray, bool]:
        """Return the amounts, and whether the demanded cases pass with them."""
        z = np.zeros(len(self.directions.of))
        for _ in range(ITERATIONS):
            runs = self.fly(z, self.demanded)
            if all_pass(runs):
                return z, True
            new = self.next_amounts(z, runs, bound)
            if new is None or np.abs(new - z).max() < _STILL:
                return z, False
            z = new
        return z, all_pass(self.fly(z, self.demanded))

    def next_amounts(
        self, z: np.ndarray, runs: Mapping[str, SampledRun], bound: float
    ) -> np.ndarray | None:
        """Return the shortest amounts inside all limits linearised about z; None without any."""
        now = self.limited_ratios(runs)

        def slope_along(direction: np.ndarray) -> np.ndarray:
            probe = self.fly(z + PROBE * direction, self.demanded)
            return (self.limited_ratios(probe, runs) - now) / PROBE

        with Parallel(n_jobs=self.jobs, backend="threading") as pool:
            columns = pool(delayed(slope_along)(direction) for direction in np.eye(len(z)))
        slopes = np.stack(list(columns), axis=1)
        # A probe without a judgement gives no slope.
        slopes[~np.isfinite(slopes)] = 0.0
        # -MARGIN <= level + slopes z <= MARGIN, as G z >= h.
        level = now - slopes @ z
        G = np.vstack([-slopes, slopes])
        h = np.concatenate([level - MARGIN, -level - MARGIN])
        # Only nodes that a step moves beyond the bound get a limit, because most nodes stay inside.
        for _ in range(_LIMIT_ROUNDS):
            amounts = least_distance(G, h)
            if amounts is None or not np.isfinite(bound):
                return amounts
            rows = self.node_limits(amounts, bound)
            if not len(rows):
                return amounts
            G = np.vstack([G, -rows])
            h = np.concatenate([h, np.full(len(rows), -bound)])
        return None

    def limited_ratios(
        self, runs: Mapping[str, SampledRun], reference: Mapping[str, SampledRun] | None = None
    ) -> np.ndarray:
        """Return the signed ratios that must be inside tolerances and limits of the trim.

        The runs of `reference` select the best alternative of each group of criteria, and the worst
        sample of each time history.
        """
        reference = reference or runs
        ratios: list[np.ndarray] = []
        for name, run in runs.items():
            bench = self.benches[name]
            for criterion in bench.deciding(reference[name]):
                channel = bench.traced.get(criterion, "")
                if channel not in run.difference:
                    ratios.append(np.atleast_1d(run.signed(criterion)))
                    continue
                half_width = bench.tolerance[channel].values
                # A time history counts at evenly spaced samples and at its worst one.
                samples = _limited_samples(half_width, reference[name].difference[channel])
                ratios.append(run.difference[channel][samples] / half_width[samples])
            ratios.append(np.array([run.trim[quantity] for quantity in reference[name].trim]))
        return np.concatenate(ratios)

    def node_limits(self, z: np.ndarray, bound: float) -> np.ndarray:
        """Return the limits (limit, direction) of the nodes that z moves farthest beyond the bound.

        There is at most one limit per term.
        """
        rows = []
        for name, D in self.directions.nodes.items():
            sigma = self.evidence[name]["stderr"].values.ravel()
            # A rationale allows any size, and a term without standard errors does not move.
            if name in self.rationale or not (sigma > 0.0).any():
                continue
            size = np.divide(z @ D, sigma, out=np.zeros(len(sigma)), where=sigma > 0.0)
            worst = int(np.abs(size).argmax())
            if abs(size[worst]) > bound * _BEYOND:
                rows.append(np.sign(size[worst]) * D[:, worst] / sigma[worst])
        return np.array(rows).reshape(len(rows), len(z))

    def refusal_text(
        self, z: np.ndarray, passed: bool, requested: Sequence[str], *, bound: float
    ) -> str:
        """Return why the rows cannot pass inside the bound, and the necessary moves."""
        rows = ", ".join(requested)
        still_passing = [name for name in self.demanded if name not in requested]
        if still_passing:
            rows += f" (with {', '.join(still_passing)} still passing)"
        if not passed:
            return (
                f"{rows}: no change of the terms with standard errors was found that makes "
                f"all pass; look for the cause in what has none"
            )
        sizes = self.largest_moves(self.nodes(z), self.evidence_values())
        price = []
        for name, size in sorted(sizes.items(), key=lambda item: -item[1]):
            if size > bound and name not in self.rationale:
                price.append(f"{name} {size:.1f}")
        unit = "standard error" if bound == 1.0 else "standard errors"
        return (
            f"{rows}: cannot pass within {bound:g} {unit}; it would take {', '.join(price)} "
            f"standard errors, distance {np.linalg.norm(z):.1f}: write a rationale for these terms"
        )

    def evidence_values(self) -> dict[str, np.ndarray]:
        """Return the values of the evidence by term."""
        return {name: leaf["value"].values for name, leaf in self.evidence.items()}

    def largest_moves(
        self, new: Mapping[str, np.ndarray], old: Mapping[str, np.ndarray]
    ) -> dict[str, float]:
        """Return the largest change of a node by term. [standard errors of the evidence]"""
        sizes = {}
        for name in self.evidence:
            sizes[name] = float(self.move_size(name, new[name], old[name]).max(initial=0.0))
        return sizes

    def move_size(self, name: str, new: np.ndarray, old: np.ndarray) -> np.ndarray:
        """Return the change of the nodes of a term. [standard errors of the evidence]"""
        sigma = self.evidence[name]["stderr"].values
        return np.divide(np.abs(new - old), sigma, out=np.zeros(sigma.shape), where=sigma > 0.0)

    def move_rows(self, z: np.ndarray | None) -> pd.DataFrame:
        """Return the moved terms, the largest share first; none without z."""
        leaves = aerodb.terms(self.database)
        model = {name: leaves[name]["value"].values for name in self.evidence}
        new = model
        if z is not None:
            new = self.nodes(z)
        from_evidence = self.largest_moves(new, self.evidence_values())
        shares = self.distance_shares({name: new[name] - model[name] for name in new})
        rows = {}
        for name in sorted(new, key=lambda name: -shares[name]):
            size = self.move_size(name, new[name], model[name])
            # Terms that moved by rounding only are left out.
            if size.max(initial=0.0) > ROUNDING:
                rows[name] = {
                    "moved": float(size.max()),
                    "from_evidence": from_evidence[name],
                    "share": shares[name],
                    "nodes": int((size > STATED).sum()),
                    "at": _position_of_largest(leaves[name]["value"], size),
                    "rationale": self.rationale.get(name, ""),
                }
        columns = ["moved", "from_evidence", "share", "nodes", "at", "rationale"]
        return pd.DataFrame.from_dict(rows, orient="index", columns=columns)

    def distance_shares(self, change: Mapping[str, np.ndarray]) -> dict[str, float]:
        """Return the share of every term in the squared Mahalanobis distance of a node change."""
        parts: dict[str, float] = {}
        for coefficient in dict.fromkeys(name.split("/")[0] for name in change):
            slices, V = aerodb.update.covariance(self.evidence_database, coefficient)
            dg = np.zeros(len(V))
            for name, rows in slices.items():
                dg[rows] = change[name].ravel()
            contributions = _distance_contributions(dg, V)
            for name, rows in slices.items():
                parts[name] = float(contributions[rows].sum())
        total = sum(parts.values())
        if not total > 0.0:
            return dict.fromkeys(parts, 0.0)
        return {name: part / total for name, part in parts.items()}

    def case_rows(
        self,
        requested: Sequence[str],
        before: Mapping[str, SampledRun],
        after: Mapping[str, SampledRun],
    ) -> pd.DataFrame:
        """Return the outcome of every case."""
        rows = {}
        for name, bench in self.benches.items():
            rows[name] = {
                "id": bench.plan.case.id,
                "title": bench.plan.case.title,
                "wanted": name in requested,
                "before": before[name].status,
                "after": after[name].status,
                "ratio_before": before[name].decides,
                "ratio_after": after[name].decides,
                "criterion_before": bench.decides(before[name]),
                "criterion_after": bench.decides(after[name]),
            }
        return pd.DataFrame.from_dict(rows, orient="index")

    def tuned_database(
        self, z: np.ndarray, moves: pd.DataFrame, requested: Sequence[str]
    ) -> xr.DataTree:
        """Return the tuned database.

        The history of every moved term states size and reason of the move. Its moved nodes have the
        source ``judgement``.
        """
        leaves, nodes = aerodb.terms(self.database), self.nodes(z)
        rows = ", ".join(requested)
        new = {}
        for name, move in zip(map(str, moves.index), moves.to_dict("records"), strict=True):
            leaf = leaves[name].assign(value=leaves[name]["value"].copy(data=nodes[name]))
            # A node that hardly moved keeps its source.
            if "source" in leaf:
                size = self.move_size(name, nodes[name], leaves[name]["value"].values)
                source = np.where(size > STATED, _JUDGEMENT, leaf["source"]).astype(np.uint8)
                leaf["source"] = leaf["source"].copy(data=source)
            line = _history_line(move, leaf["value"].size, rows)
            history = filter(None, (leaf.attrs.get("history", ""), line))
            new[name] = leaf.assign_attrs(history="\n".join(history))
        note = (
            f"pom tune for {rows}: {len(new)} terms moved, distance {np.linalg.norm(z):.2f} "
            f"from the evidence"
        )
        return aerodb.replace_terms(self.database, new, note)


def _limited_samples(half_width: np.ndarray, difference: np.ndarray) -> np.ndarray:
    """Return the samples at which a time history is limited: evenly spaced ones, and the worst."""
    banded = np.flatnonzero(np.isfinite(half_width))
    even = np.unique(np.linspace(0, len(banded) - 1, SAMPLES).astype(int))
    worst = np.argmax(np.abs(difference[banded]) / half_width[banded])
    return np.append(banded[even], banded[worst])


def _distance_contributions(dg: np.ndarray, V: np.ndarray) -> np.ndarray:
    """Return the contributions of the nodes (nodes,) to dg' V^-1 dg."""
    sigma = np.sqrt(np.maximum(np.diag(V), 0.0))
    free = sigma > 0.0
    # With the correlation matrix C and x = dg / sigma, the distance is x' C^-1 x.
    x = dg[free] / sigma[free]
    C = V[np.ix_(free, free)] / np.outer(sigma[free], sigma[free])
    contributions = np.zeros(len(V))
    contributions[free] = x * np.linalg.solve(C + _RIDGE * np.eye(free.sum()), x)
    return contributions


def _history_line(move: Mapping[Hashable, Any], count: int, rows: str) -> str:
    """Return the line for the history of a moved term with `count` nodes."""
    text = (
        f"pom tune for {rows}: {move['nodes']} of {count} nodes moved, by {move['moved']:.2f} "
        f"standard errors at most, {move['from_evidence']:.2f} from the evidence"
    )
    if move["rationale"]:
        text += f"; rationale: {move['rationale']}"
    return text


def _position_of_largest(value: xr.DataArray, size: np.ndarray) -> str:
    """Return the breakpoints of the node that moved most: ``mach 0.2, alpha 4 deg``."""
    indices = np.unravel_index(int(size.argmax()), size.shape)
    points = []
    for axis, k in zip(value.dims, indices, strict=True):
        unit = lookup(str(axis)).display_units
        text = f"{axis} {from_si(float(value[axis][k]), unit):.4g}"
        if unit != "1":
            text += f" {unit}"
        points.append(text)
    return ", ".join(points)

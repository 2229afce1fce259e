"""Terms moved as little as the flight evidence allows, so that rows pass.

The evidence is a database with its covariance V.  The tuned model is the one nearest to it, (g -
e)' V^-1 (g - e) least, whose replays are within tolerance: the ratios are linearised in the
directions that the flights determine (`Directions`), the shortest step inside all linear limits is
taken (`least_distance`), flown, and linearised again.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

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
from flightmech.simulation.node_values import with_table_values
from flightmech.units import from_si
from pom.diagnosis.sampling.draws import InstrumentErrors
from pom.diagnosis.sampling.sampled_bench import SampledBench, SampledRun
from pom.diagnosis.tuning.demands import Directions, demand_cases, demand_evidence, least_distance
from pom.diagnosis.tuning.tuning_log import Tuning
from pom.replaying.replay_case import ReplayPlan

BOUND = 2.0  # standard errors of a node, without a rationale for its term
MARGIN = 0.98  # of the tolerance
PROBE = 0.5  # standard errors
ITERATIONS = 8
SAMPLES = 60  # of a time history at which it is limited
STATED = 0.01  # standard errors: a node that moved less keeps its source
ROUNDING = 1e-9  # standard errors
_STILL = 1e-6  # standard errors
_JUDGEMENT = _terms.SOURCES.index("judgement")


def tune(
    plans: Sequence[ReplayPlan],
    database: xr.DataTree,
    aircraft: Aircraft,
    wanted: Sequence[str] | None = None,
    evidence: xr.DataTree | None = None,
    rationale: Mapping[str, str] | None = None,
    bound: float = BOUND,
    jobs: int = 1,
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
        Names of the cases that must pass; without it those that fail.  Cases that pass must go on
        doing so; what becomes of every case is reported.
    evidence : DataTree, optional
        What flight found, with standard errors and the axes of the model; the model itself without
        it.
    rationale : mapping of str to str, optional
        By term: why it may leave the bound.
    bound : float
        Of every node of a term without a rationale. [standard errors]
    jobs : int
        Threads; -1 for one per core.  The tuning does not depend on it.

    Returns
    -------
    Tuning
        With a refusal, and no database, when the rows cannot pass inside the bounds; ``moves`` and
        ``rows`` then are what it would take.  Nothing moves where the wanted cases pass.

    Raises
    ------
    UnknownName
        A wanted case or a term with a rationale that is not there.
    SchemaError
        A case with a control law or with trim surfaces to solve for, a wanted case that cannot be
        flown or judged, an evidence without standard errors or with a table that the model does not
        have, a rationale without words; a bound that is not positive.
    """
    if not bound > 0.0:
        raise SchemaError(
            "tuning", [f"the bound is {bound:g} standard errors; give a number above 0"]
        )
    tuner = _Tuner.of(plans, database, aircraft, wanted, evidence, dict(rationale or {}), jobs)
    before = tuner.fly(None, tuner.benches)
    tuner.demanded = wanted = _wanted(before, wanted)
    if _pass({name: before[name] for name in wanted}):
        return Tuning(database, tuner.moves(None), tuner.rows(wanted, before, before), 0.0, bound)
    z, after, passed = tuner.reached(before, bound)
    refusal = ""
    if not passed:
        z, after, passed = tuner.reached(before, np.inf)
        refusal = tuner.refusal(z, passed, wanted, bound)
    moves, rows = tuner.moves(z), tuner.rows(wanted, before, after)
    tuned = None if refusal else tuner.tuned(z, moves, wanted)
    return Tuning(tuned, moves, rows, float(np.linalg.norm(z)), bound, refusal)


def _pass(runs: Mapping[str, SampledRun]) -> bool:
    return all(run.status == "pass" for run in runs.values())


def _wanted(before: Mapping[str, SampledRun], wanted: Sequence[str] | None) -> list[str]:
    """Return the cases that must pass: those named, else those that fail."""
    if wanted is None:
        return [name for name, run in before.items() if run.status in ("fail", "limits_exceeded")]
    problems = []
    for name in wanted:
        if before[name].status == "invalid":
            problems.append(
                f"{name}: the model cannot be flown or judged: "
                f"{before[name].failure or 'the record lacks what is judged'}"
            )
        elif before[name].status == "not_tested":
            problems.append(
                f"{name}: nothing of it is judged, no change of the model can make it pass"
            )
    if problems:
        raise SchemaError("rows to tune", problems)
    return list(dict.fromkeys(wanted))


class _Tuner:
    """Cases, model and evidence; `demanded` are the cases that must pass."""

    def __init__(self, benches, database, evidence, directions, sim, rationale, jobs):
        self.benches: dict[str, SampledBench] = benches
        self.demanded: list[str] = []
        self.database: xr.DataTree = database
        self.evidence: dict[str, xr.Dataset] = {
            n: leaf for n, leaf in aerodb.terms(evidence).items() if n in directions.nodes
        }
        self.found: xr.DataTree = evidence
        self.directions: Directions = directions
        self.sim = sim
        self.rationale: dict[str, str] = rationale
        self.jobs: int = jobs

    @classmethod
    def of(cls, plans, database, aircraft, wanted, evidence, rationale, jobs) -> _Tuner:
        found = database if evidence is None else evidence
        demand_cases([plan.case for plan in plans], wanted)
        demand_evidence(database, found, rationale)
        sim = flightmech.compile(aircraft, database)
        none = InstrumentErrors((), {}, {}, {})
        benches = {plan.case.name: SampledBench.of(plan, sim, none) for plan in plans}
        hinges = any(plan.case.drive.level != "recorded" for plan in plans)
        directions = Directions.along(found, [plan.states for plan in plans], hinges)
        if not directions.of:
            raise SchemaError(
                "evidence", ["no term that the cases use has standard errors, nothing can be moved"]
            )
        return cls(benches, database, found, directions, sim, rationale, jobs)

    def nodes(self, z: np.ndarray) -> dict[str, np.ndarray]:
        """Return the values of the terms for amounts z of the directions, from the evidence."""
        change = self.directions.change(z)
        return {
            name: leaf["value"].values + change[name].reshape(leaf["value"].shape)
            for name, leaf in self.evidence.items()
        }

    def fly(self, z: np.ndarray | None, names: Iterable[str]) -> dict[str, SampledRun]:
        """Return the runs of cases; of the model itself without z."""
        sim = self.sim if z is None else with_table_values(self.sim, self.nodes(z))
        return {name: self.benches[name].run(sim, np.zeros(0)) for name in names}

    def reached(
        self, before: Mapping[str, SampledRun], bound: float
    ) -> tuple[np.ndarray, dict[str, SampledRun], bool]:
        """Return the amounts, the runs of all cases with them, and whether the demanded cases pass.

        Cases that pass with the model as it is, and no longer with the amounts, are demanded too.
        """
        while True:
            z, passed = self.search(bound)
            after = self.fly(z, self.benches)
            lost = [
                name
                for name, run in after.items()
                if before[name].status == "pass" != run.status and name not in self.demanded
            ]
            if not passed or not lost:
                return z, after, passed
            self.demanded = [*self.demanded, *lost]

    def search(self, bound: float) -> tuple[np.ndarray, bool]:
        """Return the amounts, and whether the demanded cases pass with them."""
        z = np.zeros(len(self.directions.of))
        for _ in range(ITERATIONS):
            runs = self.fly(z, self.demanded)
            if _pass(runs):
                return z, True
            step = self.step(z, runs, bound)
            if step is None or np.abs(step - z).max() < _STILL:
                return z, False
            z = step
        return z, _pass(self.fly(z, self.demanded))

    def step(
        self, z: np.ndarray, runs: Mapping[str, SampledRun], bound: float
    ) -> np.ndarray | None:
        """Return the shortest amounts inside all limits linearised about z; None when there are
        none.
        """

        now = self.limited(runs)

        def slope(along: np.ndarray) -> np.ndarray:
            return (self.limited(self.fly(z + PROBE * along, self.demanded), runs) - now) / PROBE

        with Parallel(n_jobs=self.jobs, backend="threading") as pool:
            slopes = np.stack(list(pool(delayed(slope)(along) for along in np.eye(len(z)))), axis=1)
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

    def limited(
        self, runs: Mapping[str, SampledRun], chosen: Mapping[str, SampledRun] | None = None
    ) -> np.ndarray:
        """Return the signed ratios that must be inside tolerances and limits of the trim.

        Of each group of criteria the alternative that is best in `chosen`; of a time history some
        samples and the worst of `chosen`.
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
                worst = inside[
                    np.argmax(
                        np.abs((chosen or runs)[name].difference[channel][inside]) / half[inside]
                    )
                ]
                at = np.append(at, worst)
                found.append(run.difference[channel][at] / half[at])
            found.append(np.array([run.trim[quantity] for quantity in (chosen or runs)[name].trim]))
        return np.concatenate(found)

    def beyond(self, z: np.ndarray, bound: float) -> np.ndarray:
        """Return the limits, one row (direction,) each, that the nodes farthest beyond the bound
        call for.
        """
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

    def refusal(self, z: np.ndarray, passed: bool, wanted: Sequence[str], bound: float) -> str:
        """Return why the rows cannot pass inside the bound, and the price."""
        kept = [name for name in self.demanded if name not in wanted]
        rows = ", ".join(wanted) + (f" (with {', '.join(kept)} still passing)" if kept else "")
        if not passed:
            return (
                f"{rows}: no change of the terms with standard errors was found that makes "
                f"all pass; look for the cause in what has none"
            )
        sizes = self.sizes(
            self.nodes(z), {name: leaf["value"].values for name, leaf in self.evidence.items()}
        )
        far = {
            name: size
            for name, size in sorted(sizes.items(), key=lambda item: -item[1])
            if size > bound
        }
        price = ", ".join(
            f"{name} {size:.1f}" for name, size in far.items() if name not in self.rationale
        )
        what = (
            f"it would take {price} standard errors, distance {np.linalg.norm(z):.1f}: write "
            f"a rationale for these terms"
        )
        return (
            f"{rows}: cannot pass within {bound:g} standard "
            f"error{'' if bound == 1.0 else 's'}; {what}"
        )

    def sizes(
        self, new: Mapping[str, np.ndarray], old: Mapping[str, np.ndarray]
    ) -> dict[str, float]:
        """Return the largest change of a node by term. [standard errors of the evidence]"""
        return {
            name: float(self.size(name, new[name], old[name]).max(initial=0.0))
            for name in self.evidence
        }

    def size(self, name: str, new: np.ndarray, old: np.ndarray) -> np.ndarray:
        """Return the change of the nodes of a term. [standard errors of the evidence]"""
        sd = self.evidence[name]["stderr"].values
        return np.divide(np.abs(new - old), sd, out=np.zeros(sd.shape), where=sd > 0.0)

    def moves(self, z: np.ndarray | None) -> pd.DataFrame:
        """Return what moved, the largest share first; nothing without z."""
        leaves = aerodb.terms(self.database)
        model = {name: leaves[name]["value"].values for name in self.evidence}
        new = model if z is None else self.nodes(z)
        away = self.sizes(new, {name: leaf["value"].values for name, leaf in self.evidence.items()})
        shares = self.shares({name: new[name] - model[name] for name in new})
        rows = {}
        for name in sorted(new, key=lambda name: -shares[name]):
            size = self.size(name, new[name], model[name])
            if size.max(initial=0.0) > ROUNDING:
                rows[name] = {
                    "moved": float(size.max()),
                    "from_evidence": away[name],
                    "share": shares[name],
                    "nodes": int((size > STATED).sum()),
                    "at": _place(leaves[name]["value"], size),
                    "rationale": self.rationale.get(name, ""),
                }
        return pd.DataFrame.from_dict(
            rows,
            orient="index",
            columns=["moved", "from_evidence", "share", "nodes", "at", "rationale"],
        )

    def shares(self, change: Mapping[str, np.ndarray]) -> dict[str, float]:
        """Return the share of every term in the squared Mahalanobis distance of a change of the
        nodes.
        """
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
            weight[free] = x * np.linalg.solve(
                V[np.ix_(free, free)] / np.outer(sd[free], sd[free]) + 1e-6 * np.eye(free.sum()), x
            )
            parts |= {name: float(weight[rows].sum()) for name, rows in slices.items()}
        total = sum(parts.values())
        return {name: part / total if total > 0.0 else 0.0 for name, part in parts.items()}

    def rows(
        self,
        wanted: Sequence[str],
        before: Mapping[str, SampledRun],
        after: Mapping[str, SampledRun],
    ) -> pd.DataFrame:
        """Return what became of every case."""
        found = {
            name: {
                "id": bench.plan.case.id,
                "title": bench.plan.case.title,
                "wanted": name in wanted,
                "before": before[name].status,
                "after": after[name].status,
                "ratio_before": before[name].decides,
                "ratio_after": after[name].decides,
                "criterion_before": bench.decides(before[name]),
                "criterion_after": bench.decides(after[name]),
            }
            for name, bench in self.benches.items()
        }
        return pd.DataFrame.from_dict(found, orient="index")

    def tuned(self, z: np.ndarray, moves: pd.DataFrame, wanted: Sequence[str]) -> xr.DataTree:
        """Return the tuned database; every moved term states by how much and why, and its moved
        nodes have the source judgement.
        """
        leaves, nodes = aerodb.terms(self.database), self.nodes(z)
        rows, new = ", ".join(wanted), {}
        for name, move in zip(map(str, moves.index), moves.to_dict("records"), strict=True):
            leaf = leaves[name].assign(value=leaves[name]["value"].copy(data=nodes[name]))
            if "source" in leaf:
                far = self.size(name, nodes[name], leaves[name]["value"].values) > STATED
                leaf["source"] = leaf["source"].copy(
                    data=np.where(far, _JUDGEMENT, leaf["source"]).astype(np.uint8)
                )
            why = f"; rationale: {move['rationale']}" if move["rationale"] else ""
            text = (
                f"{move['nodes']} of {leaf['value'].size} nodes moved, by {move['moved']:.2f} "
                f"standard errors at most"
            )
            line = (
                f"pom tune for {rows}: {text}, {move['from_evidence']:.2f} from the evidence{why}"
            )
            new[name] = leaf.assign_attrs(
                history="\n".join(filter(None, (leaf.attrs.get("history", ""), line)))
            )
        note = (
            f"pom tune for {rows}: {len(new)} terms moved, distance {np.linalg.norm(z):.2f} "
            f"from the evidence"
        )
        return aerodb.replace_terms(self.database, new, note)


def _place(value: xr.DataArray, size: np.ndarray) -> str:
    """Return the breakpoints of the node that moved most: ``mach 0.2, alpha 4 deg``."""
    at = np.unravel_index(int(size.argmax()), size.shape)
    units = {axis: lookup(str(axis)).display_units for axis in value.dims}
    points = {
        axis: from_si(float(value[axis][k]), units[axis])
        for axis, k in zip(value.dims, at, strict=True)
    }
    return ", ".join(
        f"{axis} {x:.4g}{'' if units[axis] == '1' else f' {units[axis]}'}"
        for axis, x in points.items()
    )

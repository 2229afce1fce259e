"""Gradients of the results of a row by the nodes of a database, by replays of its case.

Each node that the replay can touch is moved up and down by a part of its standard error, with the
trim and the recorded inputs of the case, as in a proof of match.  The central difference of a
comparison over its tolerance is the gradient.  A comparison with a tolerance band is taken at some
instants, a number as its signed ratio, and a bias of the trim over its limit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from joblib import Parallel, delayed

from aerodb.store.schema import terms
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import SchemaError
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.node_values import table_values, with_table_values
from flightmech.terms import basis
from flighttest.flight_programme.planning.catalogue import Catalogue, WantedRow
from flighttest.flight_programme.planning.prediction import predict_manoeuvre
from flighttest.flight_programme.planning.wanted_rows import RowGradients
from pom.diagnosis.sampling.draws import InstrumentErrors
from pom.diagnosis.sampling.sampled_bench import SampledBench, SampledRun, with_inertia
from pom.diagnosis.sampling.shares import flown_conditions
from pom.programme.row_cases import plan_row

# Step of a difference, in standard errors of the node. The nodes of a table move together by more,
# so that a smaller step would not describe the spread better.
_STEP = 0.25
# Instants of a time history.
_INSTANTS = 25
# Criterion and group of a bias of the trim.
_TRIM = "trim."
# Axis of the terms of ground effect, and height from which a flight is not near the runway [spans].
HEIGHT, _NEAR = "h_agl", 1.0
_COLUMNS = ["criterion", "group", "time", "sample", "ground"]
_NO_DRAW = np.zeros(0)


def differentiate_row(
    wanted: WantedRow,
    catalogue: Catalogue,
    sim: SimModel,
    aircraft: Aircraft,
    database: xr.DataTree,
    jobs: int = 1,
) -> RowGradients:
    """Return the gradients of a wanted row.

    Parameters
    ----------
    wanted : WantedRow
    catalogue : Catalogue
        With the condition and the manoeuvre of the row.
    sim : SimModel
        The a-priori model with the terms that the catalogue assumes (`with_assumed`).
    aircraft : Aircraft
    database : DataTree
        The prior with standard errors.
    jobs : int
        Threads; the gradients do not depend on it.

    Raises
    ------
    SchemaError
        The case of the row has a fault, no criterion is judged, or a replay with a moved node
        fails.
    AeromatchError
        The manoeuvre cannot be flown inside the limits.
    """
    flight, _ = predict_manoeuvre(catalogue, sim, aircraft, (wanted.condition, wanted.manoeuvre))
    # The replay without a change of the model gives the functions and their values.
    plan, notes = plan_row(wanted, flight)
    plan = replace(plan, job=with_inertia(plan.job, sim))
    bench = SampledBench.of(plan, sim, InstrumentErrors([], {}, {}, {}))
    base = bench.run(sim, _NO_DRAW)
    if base.failure:
        raise SchemaError(f"wanted_row {wanted.name}", [f"the replay fails: {base.failure}"])
    functions, left_out = _functions_of(bench, base)
    notes += left_out
    if functions.empty:
        raise _no_criterion_error(wanted, notes)
    leaves = uncertain_terms(database, hinges=plan.case.drive.level != "recorded")
    values = table_values(sim, {name: leaf["value"].shape for name, leaf in leaves.items()})
    samples = flown_conditions(database, leaves, plan.states, aircraft)
    moves = _nodes_of_flight(leaves, samples)

    def differ(name: str, node: tuple[int, ...]) -> np.ndarray:
        # Central difference over a share of the standard error of the node.
        step = _STEP * float(leaves[name]["stderr"].values[node])
        ends = []
        for sign in (1.0, -1.0):
            table = values[name].copy()
            table[node] += sign * step
            run = bench.run(with_table_values(sim, {name: table}), _NO_DRAW)
            if run.failure:
                raise SchemaError(
                    f"wanted_row {wanted.name}",
                    [f"the replay fails with {name}{list(node)} moved: {run.failure}"],
                )
            ends.append(_values_of(bench, functions, run))
        return (ends[0] - ends[1]) / (2.0 * step)

    with Parallel(n_jobs=jobs, backend="threading") as pool:
        columns = pool(delayed(differ)(*move) for move in moves)
    gradients: dict[str, np.ndarray] = {}
    for (name, moved), column in zip(moves, columns, strict=True):
        shape = (len(functions), *leaves[name]["value"].shape)
        place: tuple[Any, ...] = (slice(None), *moved)
        gradients.setdefault(name, np.zeros(shape))[place] = column
    # Close to the ground its effect enters through functions of their own.
    if float(np.min(plan.states[HEIGHT])) < _NEAR * aircraft.b:
        functions, gradients = _with_ground(functions, gradients, leaves, samples)
    gradients = {name: gradient for name, gradient in gradients.items() if gradient.any()}
    # A function that is not judged on one side of a difference has no gradient.
    finite = np.ones(len(functions), bool)
    for gradient in gradients.values():
        finite &= np.isfinite(gradient.reshape(len(functions), -1)).all(axis=1)
    if not finite.all():
        lost = sorted(set(functions["criterion"][~finite]))
        notes.append(f"not judged with a moved node, left out: {', '.join(lost)}")
    if not (finite & ~functions["ground"].to_numpy(bool)).any():
        raise _no_criterion_error(wanted, notes)
    return RowGradients(
        wanted,
        functions[finite].reset_index(drop=True),
        {name: gradient[finite] for name, gradient in gradients.items()},
        tuple(notes),
    )


def _no_criterion_error(wanted: WantedRow, notes: list[str]) -> SchemaError:
    """Return the error of a row without a judged criterion."""
    return SchemaError(
        f"wanted_row {wanted.name}",
        [f"no criterion is judged: {'; '.join(notes)}; choose another manoeuvre or row"],
    )


def _nodes_of_flight(
    leaves: Mapping[str, xr.Dataset], samples: Mapping[str, np.ndarray]
) -> list[tuple[str, tuple[int, ...]]]:
    """Return term and index of the nodes that the flight touches and that are uncertain."""
    nodes = []
    for name, leaf in leaves.items():
        is_touched = np.abs(basis(leaf, samples, "clamp")).max(axis=0).toarray().ravel() > 0.0
        is_uncertain = leaf["stderr"].values.ravel() > 0.0
        for k in np.flatnonzero(is_touched & is_uncertain):
            index = np.unravel_index(int(k), leaf["value"].shape)
            nodes.append((name, tuple(int(i) for i in index)))
    return nodes


def _with_ground(
    functions: pd.DataFrame,
    gradients: Mapping[str, np.ndarray],
    leaves: Mapping[str, xr.Dataset],
    samples: Mapping[str, np.ndarray],
) -> tuple[pd.DataFrame, dict[str, np.ndarray]]:
    """Return functions and gradients with those of the ground effect behind them."""
    ground, ground_gradients = _ground_functions(leaves, samples)
    complete = {}
    for name, leaf in leaves.items():
        shape = leaf["value"].shape
        first = gradients.get(name, np.zeros((len(functions), *shape)))
        last = ground_gradients.get(name, np.zeros((len(ground), *shape)))
        complete[name] = np.concatenate([first, last])
    return pd.concat([functions, ground], ignore_index=True), complete


def uncertain_terms(database: xr.DataTree, *, hinges: bool) -> dict[str, xr.Dataset]:
    """Return the terms with standard errors; recorded surfaces do not feel hinge moments."""
    leaves = {}
    for name, leaf in terms(database).items():
        if "stderr" in leaf and (hinges or not name.startswith("Ch_")):
            leaves[name] = leaf
    return leaves


def _ground_functions(
    leaves: Mapping[str, xr.Dataset], samples: Mapping[str, np.ndarray]
) -> tuple[pd.DataFrame, dict[str, np.ndarray]]:
    """Return the ground effect along a flight as functions by coefficient, with their gradients."""
    rows: list[dict[str, Any]] = []
    parts: dict[str, tuple[int, np.ndarray]] = {}
    near: dict[str, list[str]] = {}
    for name, leaf in leaves.items():
        if HEIGHT in leaf["value"].dims:
            near.setdefault(name.split("/")[0], []).append(name)
    for coefficient, names in near.items():
        count = len(samples[HEIGHT])
        # A few instants represent the flight: the gradients between them change slowly.
        chosen = np.unique(np.linspace(0, count - 1, _INSTANTS).astype(int))
        for name in names:
            weights = basis(leaves[name], samples, "clamp").toarray()[chosen]
            parts[name] = len(rows), weights.reshape(len(chosen), *leaves[name]["value"].shape)
        for _ in chosen:
            rows.append(_function(coefficient, coefficient, np.nan, sample=-1, ground=True))
    gradients = {}
    for name, (first, weights) in parts.items():
        # A node has a gradient only in the rows of its own coefficient.
        gradients[name] = np.zeros((len(rows), *weights.shape[1:]))
        gradients[name][first : first + len(weights)] = weights
    return pd.DataFrame(rows, columns=_COLUMNS), gradients


def _functions_of(bench: SampledBench, base: SampledRun) -> tuple[pd.DataFrame, list[str]]:
    """Return the functions of a case, and notes on the criteria that it does not judge."""
    rows: list[dict[str, Any]] = []
    lost = []
    time = bench.plan.job.time
    for name, group in bench.groups.items():
        if name in bench.traced and bench.traced[name] in base.difference:
            channel = bench.traced[name]
            inside = np.flatnonzero(np.isfinite(bench.tolerance[channel].values))
            if not len(inside):
                lost.append(name)
                continue
            chosen = np.unique(np.linspace(0, len(inside) - 1, _INSTANTS).astype(int))
            for k in inside[chosen]:
                rows.append(_function(name, group, time[k], sample=int(k)))
        elif np.isfinite(base.signed(name)):
            rows.append(_function(name, group, np.nan, sample=-1))
        else:
            lost.append(name)
    for name in base.trim:
        rows.append(_function(_TRIM + name, _TRIM + name, np.nan, sample=-1))
    judged = [row for row in rows if not row["criterion"].startswith(_TRIM)]
    notes = [f"not judged on the predicted flight: {', '.join(lost)}"] if lost else []
    if not judged:
        rows = []
    return pd.DataFrame(rows, columns=_COLUMNS), notes


def _function(
    criterion: str, group: str, time: float, *, sample: int, ground: bool = False
) -> dict[str, Any]:
    return dict(zip(_COLUMNS, (criterion, group, time, sample, ground), strict=True))


def _values_of(bench: SampledBench, functions: pd.DataFrame, run: SampledRun) -> np.ndarray:
    """Return the functions of a run: differences over their tolerance."""
    ratios: dict[str, np.ndarray] = {}
    for channel, difference in run.difference.items():
        with np.errstate(invalid="ignore", divide="ignore"):
            ratios[channel] = difference / bench.tolerance[channel].values
    found = []
    for name, sample in zip(functions["criterion"], functions["sample"], strict=True):
        if sample >= 0:
            found.append(ratios[bench.traced[name]][sample])
        elif name.startswith(_TRIM):
            found.append(run.trim[name.removeprefix(_TRIM)])
        else:
            found.append(run.signed(name))
    return np.array(found, float)


def summarise_terms(shares: Mapping[str, float], count: int = 4) -> str:
    """Return the terms with the largest shares in the variance of a row as text."""
    parts = [f"{name} {100.0 * share:.0f} %" for name, share in list(shares.items())[:count]]
    return ", ".join(parts)

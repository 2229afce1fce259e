"""Choice of the manoeuvres that bring the wanted nodes below their bounds in the least time.

The measure F of a choice is the mean, over the wanted nodes, of the logarithm of standard error
over bound, with negative logarithms counted as zero, plus the same mean over the wanted rows with
their widths. F is zero when every node and every row is below its bound.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from aerodb.store.schema import terms
from aerodb.update.expectation import Expectation, LinearSpread, sum_spreads
from aerodb.update.observations import coefficient_of
from aerodb.update.tabulation_report import Tabulation
from flightmech.errors import SchemaError, UnknownName
from flighttest.flight_programme.planning.catalogue import Catalogue, WantedAccuracy
from flighttest.flight_programme.planning.prediction import Item, Prediction
from flighttest.flight_programme.planning.wanted_rows import RowGradients, demand_rows

# Least gain of F that counts.
_LEAST = 1e-5
# Rounding of the ranges of the catalogue [SI].
_ROUNDING = 1e-9
# A row that stays above its bound is brought this near to what all manoeuvres together reach.
_NEAR_BEST = 1.05
# Wanted ratio of the standard error of the ground effect along a row near the runway.
GROUND_RATIO = 0.5


class Goal:
    """Bounds of the wanted nodes, and the distance of a choice of manoeuvres from them.

    Parameters
    ----------
    prediction : Prediction
    database : DataTree
        The prior with its standard errors.
    flown : sequence of Fit
        Fits of earlier flights; they count with every choice.
    learnt : Tabulation, optional
        Tabulation of these flights, as in `aerodb.update.Expectation`.
    rows : sequence of RowGradients
        Gradients of the wanted rows of the catalogue.  The ground effect along a row near the
        runway is wanted too, with the ratio `GROUND_RATIO` of its standard error.

    Attributes
    ----------
    bounds : dict of str to array
        In the shape of the table, NaN at nodes that are not wanted.
    unreachable : dict of str to array
        Standard error of the wanted nodes that stay above their bound with all manoeuvres, NaN
        elsewhere.  These nodes do not count.
    beyond : dict of str to float
        Width over bound of wanted rows, and of the ground effect along them, that stay above their
        bound with all manoeuvres, by name.  Their bound in F is 1.05 of this width.

    Raises
    ------
    SchemaError
        The database does not have a wanted term or axis, or bounds have no node, or the gradients
        of a wanted row are missing.
    """

    def __init__(
        self,
        prediction: Prediction,
        database: xr.DataTree,
        flown: Sequence[Any] = (),
        learnt: Tabulation | None = None,
        rows: Sequence[RowGradients] = (),
    ):
        self.prediction, self.flown, self.rows = prediction, list(flown), list(rows)
        demand_rows(prediction.catalogue, rows)
        self.expectation = Expectation(database, prediction.catalogue.held, learnt=learnt)
        self.bounds = bounds_of(prediction.catalogue, database)
        self._spreads: dict[Any, LinearSpread] = {}
        self._stderr_of_fits: dict[Any, dict[str, np.ndarray]] = {}
        self.unreachable: dict[str, np.ndarray] = {}
        self._counted: dict[str, np.ndarray] = {}
        # Standard errors after all candidates: what they do not reach, no selection reaches.
        best = self.stderr(list(prediction.candidates))
        for name, bound in self.bounds.items():
            beyond = best[name] > bound
            if beyond.any():
                self.unreachable[name] = np.where(beyond, best[name], np.nan)
            self._counted[name] = np.where(beyond, np.nan, bound)
        self._ground_before = {
            row.wanted.name: row.ground_errors(self._row_stderr(row, [])) for row in self.rows
        }
        self.beyond: dict[str, float] = {}
        for name, ratio in self.row_ratios(list(prediction.candidates)).items():
            if ratio > 1.0:
                self.beyond[name] = ratio

    def _row_stderr(self, row: RowGradients, fits: Sequence[Any]) -> np.ndarray:
        """Return the standard errors of the functions of a row."""
        spreads = []
        for coefficient in row.coefficients:
            local = [fit for fit in fits if coefficient_of(fit) == coefficient]
            key = row.wanted.name, coefficient, tuple(sorted(map(id, local)))
            if key not in self._spreads:
                self._spreads[key] = self.expectation.spread_of(coefficient, local, row.gradients)
            spreads.append(self._spreads[key])
        return sum_spreads(spreads)

    def widths(self, items: Sequence[Item]) -> dict[str, tuple[str, float]]:
        """Return the deciding criterion and the width of every wanted row after a choice."""
        fits = [*self.flown, *self.prediction.fits(items)]
        widths = {}
        for row in self.rows:
            widths[row.wanted.name] = row.decides(self._row_stderr(row, fits))
        return widths

    def ground_ratios(self, row: RowGradients, items: Sequence[Item]) -> dict[str, float]:
        """Return the standard errors of the ground effect along a row over those before.

        The key is the coefficient.
        """
        fits = [*self.flown, *self.prediction.fits(items)]
        after = row.ground_errors(self._row_stderr(row, fits))
        before = self._ground_before[row.wanted.name]
        return {name: after[name] / before[name] for name in after if before[name] > 0.0}

    def row_ratios(self, items: Sequence[Item]) -> dict[str, float]:
        """Return the widths of rows, and the errors of the ground effect, over their bounds."""
        ratios = {}
        widths = self.widths(items)
        for row in self.rows:
            name = row.wanted.name
            ratios[name] = widths[name][1] / row.wanted.ratio
            for coefficient, ratio in self.ground_ratios(row, items).items():
                ratios[f"{name}: {coefficient}"] = ratio / GROUND_RATIO
        return ratios

    def stderr(self, items: Sequence[Item]) -> dict[str, np.ndarray]:
        """Return the standard errors of the wanted nodes after a choice, NaN elsewhere."""
        fits = [*self.flown, *self.prediction.fits(items)]
        stderr = {}
        # coefficients do not share terms, so each depends on its own fits alone
        for coefficient in dict.fromkeys(name.split("/")[0] for name in self.bounds):
            local = [fit for fit in fits if coefficient_of(fit) == coefficient]
            key = coefficient, tuple(sorted(map(id, local)))
            if key not in self._stderr_of_fits:
                nodes = {}
                for name, bound in self.bounds.items():
                    if name.startswith(f"{coefficient}/"):
                        nodes[name] = np.isfinite(bound)
                self._stderr_of_fits[key] = self.expectation.stderr(local, nodes)
            stderr.update(self._stderr_of_fits[key])
        return stderr

    def missing(self, items: Sequence[Item]) -> float:
        """Return the measure F of a choice."""
        stderr = self.stderr(items)
        logarithms = [np.zeros(0)]
        for name, bound in self._counted.items():
            logarithms.append(np.log(stderr[name] / bound)[np.isfinite(bound)])
        values = np.concatenate(logarithms)
        missing = 0.0
        if len(values):
            missing = float(np.maximum(values, 0.0).mean())
        shortfalls = []
        for name, ratio in self.row_ratios(items).items():
            row_bound = max(1.0, _NEAR_BEST * self.beyond.get(name, 0.0))
            shortfalls.append(float(np.log(max(ratio / row_bound, 1.0))))
        if shortfalls:
            missing += float(np.mean(shortfalls))
        return missing


def bounds_of(catalogue: Catalogue, database: xr.DataTree) -> dict[str, np.ndarray]:
    """Return the bound of every wanted node by term, NaN at the other nodes.

    If several bounds apply to a node, the smallest counts.
    """
    leaves, problems = terms(database), []
    bounds: dict[str, np.ndarray] = {}
    for number, request in enumerate(catalogue.wanted):
        where = f"wanted.{number}"
        if request.term not in leaves or "stderr" not in leaves[request.term]:
            usable = [name for name in leaves if "stderr" in leaves[name]]
            unknown = UnknownName(request.term, usable, "term with standard errors")
            problems.append(f"{where}: {unknown}")
            continue
        leaf = leaves[request.term]
        nodes, faults = _select_nodes(leaf, request)
        problems += [f"{where}: {fault}" for fault in faults]
        if not nodes.any():
            problems.append(
                f"{where}: no node of {request.term} with a standard error lies within; widen the "
                "ranges"
            )
        limit = request.stderr or float(request.ratio or 0.0) * leaf["stderr"].values
        bound = np.where(nodes, limit, np.nan)
        earlier = bounds.get(request.term, np.full(bound.shape, np.nan))
        bounds[request.term] = np.fmin(earlier, bound)
    if problems:
        raise SchemaError("catalogue", problems)
    return bounds


def _select_nodes(leaf: xr.Dataset, request: WantedAccuracy) -> tuple[np.ndarray, list[str]]:
    """Return which nodes with a standard error are inside the ranges, and the unknown axes."""
    faults = []
    dims = leaf["value"].dims
    inside = leaf["stderr"] > 0
    for axis, (low, high) in request.within.items():
        if axis not in dims:
            faults.append(str(UnknownName(axis, map(str, dims), f"axis of {request.term}")))
            continue
        inside = inside & (leaf[axis] >= low - _ROUNDING) & (leaf[axis] <= high + _ROUNDING)
    return inside.transpose(*dims).values, faults


def select_manoeuvres(goal: Goal, done: Callable[[int, float], None] | None = None) -> list[Item]:
    """Return the manoeuvres of a programme, those with the largest gain per time first.

    Parameters
    ----------
    goal : Goal
    done : callable, optional
        ``done(count, F)`` after every choice, for progress.
    """
    chosen = _choose_greedily(goal, done)
    return _exchange_items(goal, _prune_items(goal, chosen))


def time_of(prediction: Prediction, items: Sequence[Item]) -> float:
    """Return the time of a programme with recoveries, and each setup of a condition once. [s]"""
    setups: Mapping[str, float] = {c.name: float(c.setup) for c in prediction.catalogue.condition}
    conditions = dict.fromkeys(condition for condition, _ in items)
    flights = sum(prediction.candidates[item].time for item in items)
    return flights + sum(setups[name] for name in conditions)


def _choose_greedily(goal: Goal, done: Callable[[int, float], None] | None) -> list[Item]:
    """Return manoeuvres, each with the largest gain of F per time at its choice.

    Gains decrease with the number of chosen manoeuvres. So the gain of an earlier round is an upper
    bound, and only the manoeuvre that leads by its bound is computed again.
    """
    prediction = goal.prediction
    chosen: list[Item] = []
    missing = goal.missing(chosen)
    bound = dict.fromkeys(prediction.candidates, np.inf)
    while missing > _LEAST and bound:
        best = _find_best(goal, chosen, bound, missing=missing)
        if bound[best] < _LEAST:
            break
        chosen.append(best)
        del bound[best]
        # The first fit of a term shows that the level of the whole table may be wrong. So all gains
        # may rise after the first choice, and those at the same condition after each choice.
        is_first = len(chosen) == 1
        for item in bound:
            if is_first or item[0] == best[0]:
                bound[item] = np.inf
        missing = goal.missing(chosen)
        if done:
            done(len(chosen), missing)
    return chosen


def _find_best(goal: Goal, chosen: list[Item], bound: dict[Item, float], *, missing: float) -> Item:
    """Return the manoeuvre with the largest gain per time; computed gains are put into `bound`."""
    total, computed = time_of(goal.prediction, chosen), set()
    while True:
        worth = {}
        for item, gain in bound.items():
            worth[item] = gain / (time_of(goal.prediction, [*chosen, item]) - total)
        best = max(worth, key=lambda item: worth[item])
        if best in computed:
            return best
        bound[best] = missing - goal.missing([*chosen, best])
        computed.add(best)


def _prune_items(goal: Goal, chosen: list[Item]) -> list[Item]:
    """Remove the manoeuvres without which F does not increase, the longest first."""
    reached = max(goal.missing(chosen), _LEAST)
    for item in sorted(chosen, key=lambda item: -goal.prediction.candidates[item].time):
        remaining = [candidate for candidate in chosen if candidate != item]
        if goal.missing(remaining) <= reached:
            chosen = remaining
    return chosen


def _exchange_items(goal: Goal, chosen: list[Item]) -> list[Item]:
    """Replace manoeuvres by shorter ones until no exchange saves time, and prune after each."""
    prediction = goal.prediction
    reached = max(goal.missing(chosen), _LEAST)
    empty = goal.missing([])
    alone: dict[Item, float] = {}
    for item in list(chosen):
        remaining = [candidate for candidate in chosen if candidate != item]
        needed = goal.missing(remaining) - reached
        now = time_of(prediction, chosen)
        shorter = {}
        for candidate in prediction.candidates:
            if candidate not in chosen:
                time = time_of(prediction, [*remaining, candidate])
                if time < now:
                    shorter[candidate] = time
        for candidate in sorted(shorter, key=lambda candidate: shorter[candidate]):
            if candidate not in alone:
                alone[candidate] = empty - goal.missing([candidate])
            # the gain after other manoeuvres is not expected above the gain without them
            if alone[candidate] < needed:
                continue
            if goal.missing([*remaining, candidate]) <= reached:
                return _exchange_items(goal, _prune_items(goal, [*remaining, candidate]))
    return chosen

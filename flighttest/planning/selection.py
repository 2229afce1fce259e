"""The smallest choice of manoeuvres that brings every wanted node below its bound: greedy by gain over time, then exchanges.

What is missing of a choice is

    F = mean over the wanted nodes of max(0, ln(standard error/bound)).

Each step takes the candidate with the largest decrease of F per second, the setup of a condition included.  Gains are evaluated
lazily: a gain found earlier is taken as an upper bound of the present one, so that only candidates at the top of the list are
evaluated again [Minoux1978].  That is exact for gains that only decrease while the choice grows.  Manoeuvres of one condition are
fitted together and can make up for each other, so those of the condition just chosen are always evaluated again.  Exchanges then
remove what later choices made superfluous, and replace a manoeuvre by one that takes less time.  The result is a local optimum, not
proven to be the global one.

References
----------
.. [Minoux1978] Minoux, Accelerated greedy algorithms for maximizing submodular set functions, Optimization Techniques, 1978.
.. [Fedorov1972] Fedorov, Theory of Optimal Experiments, Academic Press 1972 (exchange).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from aerodb.update.expectation import Expectation
from aerodb.update.observations import coefficient_of
from aerodb.update.tabulation import Tabulation
from flightmech.errors import SchemaError, UnknownName

from .catalogue import Catalogue
from .prediction import Item, Prediction

_LEAST = 1e-5  # of F: a gain below it is none


class Goal:
    """Bounds of the wanted nodes, and how far a choice of manoeuvres is from them.

    Parameters
    ----------
    prediction : Prediction
    database : DataTree
        The prior with its standard errors.
    flown : sequence of Fit
        Fits of flights that are done already; they count with every choice.
    learnt : Tabulation, optional
        Of these flights, as in `aerodb.update.Expectation`.

    Attributes
    ----------
    bounds : dict of str to array
        In the shape of the table, NaN at nodes that are not wanted.
    unreachable : dict of str to array
        Wanted nodes that all manoeuvres together leave above their bound: standard error then, NaN elsewhere.  They are not counted.

    Raises
    ------
    SchemaError
        A wanted term or axis that the database does not have, or bounds without a node.
    """

    def __init__(self, prediction: Prediction, database: xr.DataTree, flown: Sequence[Any] = (), learnt: Tabulation | None = None):
        self.prediction, self.flown = prediction, list(flown)
        self.expectation = Expectation(database, prediction.catalogue.held, learnt=learnt)
        self.bounds = bounds_of(prediction.catalogue, database)
        self._known: dict[Any, dict[str, np.ndarray]] = {}
        self.unreachable: dict[str, np.ndarray] = {}
        best = self.stderr(list(prediction.candidates))
        for name, bound in self.bounds.items():
            beyond = best[name] > bound
            if beyond.any():
                self.unreachable[name] = np.where(beyond, best[name], np.nan)
        self._counted = {
            name: np.where(np.isnan(self.unreachable.get(name, np.full(b.shape, np.nan))), b, np.nan) for name, b in self.bounds.items()
        }

    def stderr(self, items: Sequence[Item]) -> dict[str, np.ndarray]:
        """Return the standard errors of the wanted nodes after a choice of manoeuvres, NaN elsewhere."""
        fits = [*self.flown, *self.prediction.fits(items)]
        found = {}
        for coefficient in dict.fromkeys(name.split("/")[0] for name in self.bounds):
            local = [fit for fit in fits if coefficient_of(fit) == coefficient]
            key = coefficient, tuple(sorted(map(id, local)))
            if key not in self._known:
                wanted = {name: np.isfinite(b) for name, b in self.bounds.items() if name.startswith(f"{coefficient}/")}
                self._known[key] = self.expectation.stderr(local, wanted)
            found.update(self._known[key])
        return found

    def missing(self, items: Sequence[Item]) -> float:
        """Return F of a choice."""
        stderr = self.stderr(items)
        parts = [np.log(stderr[name] / bound)[np.isfinite(bound)] for name, bound in self._counted.items()]
        values = np.concatenate(parts) if parts else np.zeros(0)
        return float(np.maximum(values, 0.0).mean()) if len(values) else 0.0


def bounds_of(catalogue: Catalogue, database: xr.DataTree) -> dict[str, np.ndarray]:
    """Return the bound of every node that a catalogue wants, by term, NaN at the others; the least where several hold."""
    from aerodb.store.schema import terms

    leaves, problems = terms(database), []
    found: dict[str, np.ndarray] = {}
    for number, wanted in enumerate(catalogue.wanted):
        if wanted.term not in leaves or "stderr" not in leaves[wanted.term]:
            problems.append(
                f"wanted.{number}: {UnknownName(wanted.term, [n for n in leaves if 'stderr' in leaves[n]], 'term with standard errors')}"
            )
            continue
        leaf = leaves[wanted.term]
        inside = leaf["stderr"] > 0
        for axis, (low, high) in wanted.within.items():
            if axis not in leaf["value"].dims:
                problems.append(f"wanted.{number}: {UnknownName(axis, map(str, leaf['value'].dims), f'axis of {wanted.term}')}")
                continue
            inside = inside & (leaf[axis] >= low - 1e-9) & (leaf[axis] <= high + 1e-9)
        nodes = inside.transpose(*leaf["value"].dims).values
        if not nodes.any():
            problems.append(f"wanted.{number}: no node of {wanted.term} with a standard error lies within; widen the ranges")
        bound = np.where(nodes, wanted.stderr or float(wanted.ratio or 0.0) * leaf["stderr"].values, np.nan)
        found[wanted.term] = np.fmin(found.get(wanted.term, np.full(bound.shape, np.nan)), bound)
    if problems:
        raise SchemaError("catalogue", problems)
    return found


def choose(goal: Goal, done: Callable[[int, float], None] | None = None) -> list[Item]:
    """Return the manoeuvres of a programme, in the order in which they were found worth their time.

    Parameters
    ----------
    goal : Goal
    done : callable, optional
        ``done(count, F)`` after every choice, for progress.
    """
    chosen = _greedy(goal, done)
    return _exchanged(goal, _pruned(goal, chosen))


def time_of(prediction: Prediction, items: Sequence[Item]) -> float:
    """Return the time of a programme: manoeuvres with recovery, and the setup of every condition once. [s]"""
    setups: Mapping[str, float] = {c.name: float(c.setup) for c in prediction.catalogue.condition}
    return sum(prediction.candidates[item].time for item in items) + sum(setups[name] for name in dict.fromkeys(c for c, _ in items))


def _greedy(goal: Goal, done: Callable[[int, float], None] | None) -> list[Item]:
    prediction = goal.prediction
    chosen: list[Item] = []
    missing = goal.missing(chosen)
    bound = dict.fromkeys(prediction.candidates, np.inf)
    while missing > _LEAST and bound:
        total, fresh = time_of(prediction, chosen), set()
        while True:
            worth = {item: gain / (time_of(prediction, [*chosen, item]) - total) for item, gain in bound.items()}
            best = max(worth, key=lambda item: worth[item])
            if best in fresh:
                break
            bound[best] = missing - goal.missing([*chosen, best])
            fresh.add(best)
        if bound[best] < _LEAST:
            break
        chosen.append(best)
        del bound[best]
        first = len(chosen) == 1  # of the first fit of a term the whole table learns that its level may be wrong
        bound |= {item: np.inf for item in bound if first or item[0] == best[0]}
        missing = goal.missing(chosen)
        if done:
            done(len(chosen), missing)
    return chosen


def _pruned(goal: Goal, chosen: list[Item]) -> list[Item]:
    """Remove what is not needed, the longest first."""
    reached = max(goal.missing(chosen), _LEAST)
    for item in sorted(chosen, key=lambda one: -goal.prediction.candidates[one].time):
        rest = [other for other in chosen if other != item]
        if goal.missing(rest) <= reached:
            chosen = rest
    return chosen


def _exchanged(goal: Goal, chosen: list[Item]) -> list[Item]:
    """Replace manoeuvres by others that take less time as long as that can be done, and prune again."""
    prediction = goal.prediction
    reached = max(goal.missing(chosen), _LEAST)
    empty = goal.missing([])
    alone: dict[Item, float] = {}
    for item in list(chosen):
        rest = [other for other in chosen if other != item]
        needed = goal.missing(rest) - reached
        now = time_of(prediction, chosen)
        shorter = {other: t for other in prediction.candidates if other not in chosen and (t := time_of(prediction, [*rest, other])) < now}
        for other in sorted(shorter, key=lambda one: shorter[one]):
            if other not in alone:
                alone[other] = empty - goal.missing([other])
            if alone[other] < needed:  # it would have to add more in company than alone
                continue
            if goal.missing([*rest, other]) <= reached:
                return _exchanged(goal, _pruned(goal, [*rest, other]))
    return chosen

"""The plan of a flight-test programme: which manoeuvres in which order, and what they will
determine.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.store.schema import terms
from aerodb.update.expectation import Expectation
from aerodb.update.observations import coefficient_of
from aerodb.update.tabulation_report import Tabulation
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.simulation.compiler import SimModel
from flightmech.units import from_si
from flighttest.flight_programme.planning.catalogue import Catalogue
from flighttest.flight_programme.planning.prediction import Item, Prediction, predict

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
        Wanted nodes that all manoeuvres together leave above their bound: standard error then, NaN
        elsewhere.  They are not counted.

    Raises
    ------
    SchemaError
        A wanted term or axis that the database does not have, or bounds without a node.
    """

    def __init__(
        self,
        prediction: Prediction,
        database: xr.DataTree,
        flown: Sequence[Any] = (),
        learnt: Tabulation | None = None,
    ):
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
            name: np.where(
                np.isnan(self.unreachable.get(name, np.full(b.shape, np.nan))), b, np.nan
            )
            for name, b in self.bounds.items()
        }

    def stderr(self, items: Sequence[Item]) -> dict[str, np.ndarray]:
        """Return the standard errors of the wanted nodes after a choice of manoeuvres, NaN
        elsewhere.
        """
        fits = [*self.flown, *self.prediction.fits(items)]
        found = {}
        for coefficient in dict.fromkeys(name.split("/")[0] for name in self.bounds):
            local = [fit for fit in fits if coefficient_of(fit) == coefficient]
            key = coefficient, tuple(sorted(map(id, local)))
            if key not in self._known:
                wanted = {
                    name: np.isfinite(b)
                    for name, b in self.bounds.items()
                    if name.startswith(f"{coefficient}/")
                }
                self._known[key] = self.expectation.stderr(local, wanted)
            found.update(self._known[key])
        return found

    def missing(self, items: Sequence[Item]) -> float:
        """Return F of a choice."""
        stderr = self.stderr(items)
        parts = [
            np.log(stderr[name] / bound)[np.isfinite(bound)]
            for name, bound in self._counted.items()
        ]
        values = np.concatenate(parts) if parts else np.zeros(0)
        return float(np.maximum(values, 0.0).mean()) if len(values) else 0.0


def bounds_of(catalogue: Catalogue, database: xr.DataTree) -> dict[str, np.ndarray]:
    """Return the bound of every node that a catalogue wants, by term, NaN at the others; the least
    where several hold.
    """

    leaves, problems = terms(database), []
    found: dict[str, np.ndarray] = {}
    for number, wanted in enumerate(catalogue.wanted):
        if wanted.term not in leaves or "stderr" not in leaves[wanted.term]:
            problems.append(
                f"wanted.{number}: "
                f"{UnknownName(wanted.term, [n for n in leaves if 'stderr' in leaves[n]], 'term with standard errors')}"
            )
            continue
        leaf = leaves[wanted.term]
        inside = leaf["stderr"] > 0
        for axis, (low, high) in wanted.within.items():
            if axis not in leaf["value"].dims:
                problems.append(
                    f"wanted.{number}: "
                    f"{UnknownName(axis, map(str, leaf['value'].dims), f'axis of {wanted.term}')}"
                )
                continue
            inside = inside & (leaf[axis] >= low - 1e-9) & (leaf[axis] <= high + 1e-9)
        nodes = inside.transpose(*leaf["value"].dims).values
        if not nodes.any():
            problems.append(
                f"wanted.{number}: no node of {wanted.term} with a standard error lies "
                f"within; widen the ranges"
            )
        bound = np.where(
            nodes, wanted.stderr or float(wanted.ratio or 0.0) * leaf["stderr"].values, np.nan
        )
        found[wanted.term] = np.fmin(found.get(wanted.term, np.full(bound.shape, np.nan)), bound)
    if problems:
        raise SchemaError("catalogue", problems)
    return found


def select_manoeuvres(goal: Goal, done: Callable[[int, float], None] | None = None) -> list[Item]:
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
    """Return the time of a programme: manoeuvres with recovery, and the setup of every condition
    once. [s]
    """
    setups: Mapping[str, float] = {c.name: float(c.setup) for c in prediction.catalogue.condition}
    return sum(prediction.candidates[item].time for item in items) + sum(
        setups[name] for name in dict.fromkeys(c for c, _ in items)
    )


def _greedy(goal: Goal, done: Callable[[int, float], None] | None) -> list[Item]:
    prediction = goal.prediction
    chosen: list[Item] = []
    missing = goal.missing(chosen)
    bound = dict.fromkeys(prediction.candidates, np.inf)
    while missing > _LEAST and bound:
        total, fresh = time_of(prediction, chosen), set()
        while True:
            worth = {
                item: gain / (time_of(prediction, [*chosen, item]) - total)
                for item, gain in bound.items()
            }
            best = max(worth, key=lambda item: worth[item])
            if best in fresh:
                break
            bound[best] = missing - goal.missing([*chosen, best])
            fresh.add(best)
        if bound[best] < _LEAST:
            break
        chosen.append(best)
        del bound[best]
        first = (
            len(chosen) == 1
        )  # of the first fit of a term the whole table learns that its level may be wrong
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
    """Replace manoeuvres by others that take less time as long as that can be done, and prune
    again.
    """
    prediction = goal.prediction
    reached = max(goal.missing(chosen), _LEAST)
    empty = goal.missing([])
    alone: dict[Item, float] = {}
    for item in list(chosen):
        rest = [other for other in chosen if other != item]
        needed = goal.missing(rest) - reached
        now = time_of(prediction, chosen)
        shorter = {
            other: t
            for other in prediction.candidates
            if other not in chosen and (t := time_of(prediction, [*rest, other])) < now
        }
        for other in sorted(shorter, key=lambda one: shorter[one]):
            if other not in alone:
                alone[other] = empty - goal.missing([other])
            if alone[other] < needed:  # it would have to add more in company than alone
                continue
            if goal.missing([*rest, other]) <= reached:
                return _exchanged(goal, _pruned(goal, [*rest, other]))
    return chosen


@dataclass(frozen=True)
class ProgrammePlan:
    """A flight-test programme.

    Attributes
    ----------
    prediction : Prediction
    items : list of (str, str)
        Condition and manoeuvre, in the order of the flight: conditions as the catalogue lists them.
    order : DataFrame
        Index ``card`` from 1: ``condition manoeuvre setup time fuel clock fuel_total`` [s, kg];
        `setup` of the condition at its first card, `clock` and `fuel_total` at the end of the card.
    nodes : DataFrame
        Wanted nodes: ``term``, one column per axis [SI], ``before`` and ``expected`` standard
        errors, ``bound``, ``state``: reached, missed, or unreachable when all manoeuvres of the
        catalogue together leave it above its bound.
    expected : dict of str to array
        Expected standard errors of all nodes of the terms that the programme informs, in the shape
        of the table.
    undetermined : list of str
        Fits of the catalogue that the chosen manoeuvres do not determine.
    """

    prediction: Prediction
    items: list[Item]
    order: pd.DataFrame
    nodes: pd.DataFrame
    expected: dict[str, np.ndarray]
    undetermined: list[str]

    @property
    def time(self) -> float:
        """Return the time of the programme with all setups. [s]"""
        return time_of(self.prediction, self.items)

    def summary(self) -> dict[str, Any]:
        """Return the plan as plain tables."""
        return {
            "title": self.prediction.catalogue.title,
            "time": self.time,
            "time_of_catalogue": time_of(self.prediction, list(self.prediction.candidates)),
            "order": self.order.reset_index(),
            "nodes": self.nodes,
            "undetermined": self.undetermined,
            "refused": {f"{c}, {m}": why for (c, m), why in self.prediction.refused.items()},
        }

    def report(self) -> str:
        """Return order, states of the wanted nodes and what stays open as text."""
        return _report(self)


def plan_programme(
    catalogue: Catalogue,
    sim: SimModel,
    aircraft: Aircraft,
    database: xr.DataTree,
    flown: Sequence[Any] = (),
    jobs: int = 1,
    done: Callable[[int, float], None] | None = None,
) -> ProgrammePlan:
    """Return the smallest programme of a catalogue that brings every wanted node below its bound,
    as far as it can.

    Parameters
    ----------
    catalogue : Catalogue
    sim : SimModel
        The a-priori model with the terms that the catalogue assumes (`with_assumed`).
    aircraft : Aircraft
        For its instruments, limits, mass and lengths.
    database : DataTree
        The prior with standard errors.
    flown : sequence of Fit
        Fits of flights done already.
    jobs : int
        Processes for the reconstruction.
    done : callable, optional
        ``done(count, F)`` after every choice.

    Raises
    ------
    SchemaError
        As `predict` and `Goal`.
    """
    return plan_predicted_flights(predict(catalogue, sim, aircraft, jobs), database, flown, done)


def plan_predicted_flights(
    prediction: Prediction,
    database: xr.DataTree,
    flown: Sequence[Any] = (),
    done: Callable[[int, float], None] | None = None,
) -> ProgrammePlan:
    """Return the smallest programme of predicted flights; parameters as in `plan_programme`."""
    goal = Goal(prediction, database, flown)
    chosen = set(select_manoeuvres(goal, done))
    items = [item for item in prediction.candidates if item in chosen]
    fits = [*flown, *prediction.fits(items)]
    undetermined = [f"{c}: {fit.name}" for c, fit in _undetermined(prediction, items)]
    return ProgrammePlan(
        prediction,
        items,
        order_of(prediction, items),
        nodes_of(goal, items, database),
        goal.expectation.stderr(fits),
        undetermined,
    )


def nodes_of(goal: Goal, items: Sequence[Item], database: xr.DataTree) -> pd.DataFrame:
    """Return the wanted nodes with standard errors before and after a choice of manoeuvres, as in
    `ProgrammePlan.nodes`.
    """
    leaves, after, rows = terms(database), goal.stderr(items), []
    for name, bound in goal.bounds.items():
        leaf = leaves[name]
        beyond = goal.unreachable.get(name)
        for place in map(tuple, np.argwhere(np.isfinite(bound))):
            axes = {
                str(axis): float(leaf[axis].values[k])
                for axis, k in zip(leaf["value"].dims, place, strict=True)
            }
            expected = float(after[name][place])
            state = "reached" if expected <= bound[place] * (1.0 + 1e-9) else "missed"
            if beyond is not None and np.isfinite(beyond[place]):
                state = "unreachable"
            row = {
                "before": float(leaf["stderr"].values[place]),
                "expected": expected,
                "bound": float(bound[place]),
                "state": state,
            }
            rows.append({"term": name, **axes, **row})
    first = ["term"]
    columns = [
        *first,
        *dict.fromkeys(
            key
            for row in rows
            for key in row
            if key not in (*first, "before", "expected", "bound", "state")
        ),
    ]
    return pd.DataFrame(rows)[[*columns, "before", "expected", "bound", "state"]]


def order_of(prediction: Prediction, items: Sequence[Item]) -> pd.DataFrame:
    """Return the cards of a choice of manoeuvres, as in `ProgrammePlan.order`."""
    setups = {c.name: float(c.setup) for c in prediction.catalogue.condition}
    rows, clock, fuel, seen = [], 0.0, 0.0, set()
    for condition, manoeuvre in items:
        one = prediction.candidates[condition, manoeuvre]
        setup = 0.0 if condition in seen else setups[condition]
        seen.add(condition)
        burnt = one.fuel * (1.0 + setup / one.time)
        clock, fuel = clock + setup + one.time, fuel + burnt
        row = {
            "condition": condition,
            "manoeuvre": manoeuvre,
            "setup": setup,
            "time": one.time,
            "fuel": burnt,
        }
        rows.append({**row, "clock": clock, "fuel_total": fuel})
    columns = ["condition", "manoeuvre", "setup", "time", "fuel", "clock", "fuel_total"]
    return pd.DataFrame(rows, columns=columns, index=pd.RangeIndex(1, len(rows) + 1, name="card"))


def _undetermined(prediction: Prediction, items: Sequence[Item]) -> list[tuple[str, Any]]:
    """Fits of the catalogue that use chosen manoeuvres and that these do not determine, by
    condition.
    """
    made = {(str(fit.name), fit.model.coefficient) for fit in prediction.fits(items)}
    found = []
    for condition in dict.fromkeys(c for c, _ in items):
        for fit in prediction.catalogue.fit:
            used = any((condition, name) in items for name in fit.manoeuvres) and (
                not fit.conditions or condition in fit.conditions
            )
            lacking = [
                text
                for text in fit.models
                if (f"{condition}: {fit.name}", text.split("=")[0].strip()) not in made
            ]
            if used and lacking:
                found.append((condition, fit))
    return found


def format_quantity(name: str, value: float) -> str:
    """Return a quantity by name in the units of display, with its unit."""
    units = lookup(name.removeprefix("applied.")).display_units
    text = f"{float(from_si(value, units)):.4g}"
    return text if units == "1" else f"{text} {units}"


def clock_text(seconds: float) -> str:
    """Return a time as ``h:mm:ss`` or ``m:ss``."""
    whole = round(seconds)
    hours, minutes, rest = whole // 3600, whole // 60 % 60, whole % 60
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def _report(plan: ProgrammePlan) -> str:
    prediction = plan.prediction
    lines = [
        f"{prediction.catalogue.title or 'flight-test programme'}: {len(plan.items)} of "
        f"{len(prediction.candidates)} manoeuvres"
    ]
    lines.append(
        f"{'card':>4}  "
        f"{'condition':<32}{'manoeuvre':<32}{'setup':>7}{'time':>7}{'fuel kg':>9}{'clock':>9}"
    )
    for card, row in plan.order.iterrows():
        setup = clock_text(row["setup"]) if row["setup"] else ""
        fuel = f"{row['fuel_total']:.1f}" if np.isfinite(row["fuel_total"]) else "-"
        times = f"{setup:>7}{clock_text(row['time']):>7}{fuel:>9}{clock_text(row['clock']):>9}"
        lines.append(f"{card:>4}  {row['condition']:<32}{row['manoeuvre']:<32}{times}")
    whole = time_of(prediction, list(prediction.candidates))
    lines.append(
        f"time {clock_text(plan.time)} with setups; the whole catalogue takes {clock_text(whole)}"
    )
    lines.append("")
    lines.append(
        f"{'term':<18}{'wanted':>8}{'reached':>9}{'missed':>8}{'unreachable':>13}{'largest expected/bound':>24}"
    )
    for name, part in plan.nodes.groupby("term", sort=False):
        counts = part["state"].value_counts()
        numbers = [int(counts.get(state, 0)) for state in ("reached", "missed", "unreachable")]
        worst = float((part["expected"] / part["bound"]).max())
        lines.append(
            f"{name!s:<18}{len(part):>8}{numbers[0]:>9}{numbers[1]:>8}{numbers[2]:>13}{worst:>24.2f}"
        )
    lines += [f"! not determined: {text}" for text in plan.undetermined]
    lines += [
        f"! cannot be flown: {condition}, {manoeuvre}: {why}"
        for (condition, manoeuvre), why in prediction.refused.items()
    ]
    return "\n".join(lines)

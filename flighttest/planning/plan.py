"""The plan of a flight-test programme: which manoeuvres in which order, and what they will determine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.store.schema import terms
from flightmech.names import lookup
from flightmech.units import from_si

from .catalogue import Catalogue
from .prediction import Item, Prediction, predict
from .selection import Goal, choose, time_of

if TYPE_CHECKING:
    from flightmech import Aircraft, SimModel


@dataclass(frozen=True)
class Plan:
    """A flight-test programme.

    Attributes
    ----------
    prediction : Prediction
    items : list of (str, str)
        Condition and manoeuvre, in the order of the flight: conditions as the catalogue lists them.
    order : DataFrame
        Index ``card`` from 1: ``condition manoeuvre setup time fuel clock fuel_total`` [s, kg]; `setup` of the condition at its first card,
        `clock` and `fuel_total` at the end of the card.
    nodes : DataFrame
        Wanted nodes: ``term``, one column per axis [SI], ``before`` and ``expected`` standard errors, ``bound``, ``state``: reached,
        missed, or unreachable when all manoeuvres of the catalogue together leave it above its bound.
    expected : dict of str to array
        Expected standard errors of all nodes of the terms that the programme informs, in the shape of the table.
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
) -> Plan:
    """Return the smallest programme of a catalogue that brings every wanted node below its bound, as far as it can.

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
    return plan_of(predict(catalogue, sim, aircraft, jobs), database, flown, done)


def plan_of(
    prediction: Prediction, database: xr.DataTree, flown: Sequence[Any] = (), done: Callable[[int, float], None] | None = None
) -> Plan:
    """Return the smallest programme of predicted flights; parameters as in `plan_programme`."""
    goal = Goal(prediction, database, flown)
    chosen = set(choose(goal, done))
    items = [item for item in prediction.candidates if item in chosen]
    fits = [*flown, *prediction.fits(items)]
    undetermined = [f"{c}: {fit.name}" for c, fit in _undetermined(prediction, items)]
    return Plan(
        prediction, items, order_of(prediction, items), nodes_of(goal, items, database), goal.expectation.stderr(fits), undetermined
    )


def nodes_of(goal: Goal, items: Sequence[Item], database: xr.DataTree) -> pd.DataFrame:
    """Return the wanted nodes with standard errors before and after a choice of manoeuvres, as in `Plan.nodes`."""
    leaves, after, rows = terms(database), goal.stderr(items), []
    for name, bound in goal.bounds.items():
        leaf = leaves[name]
        beyond = goal.unreachable.get(name)
        for place in map(tuple, np.argwhere(np.isfinite(bound))):
            axes = {str(axis): float(leaf[axis].values[k]) for axis, k in zip(leaf["value"].dims, place, strict=True)}
            expected = float(after[name][place])
            state = "reached" if expected <= bound[place] * (1.0 + 1e-9) else "missed"
            if beyond is not None and np.isfinite(beyond[place]):
                state = "unreachable"
            row = {"before": float(leaf["stderr"].values[place]), "expected": expected, "bound": float(bound[place]), "state": state}
            rows.append({"term": name, **axes, **row})
    first = ["term"]
    columns = [*first, *dict.fromkeys(key for row in rows for key in row if key not in (*first, "before", "expected", "bound", "state"))]
    return pd.DataFrame(rows)[[*columns, "before", "expected", "bound", "state"]]


def order_of(prediction: Prediction, items: Sequence[Item]) -> pd.DataFrame:
    """Return the cards of a choice of manoeuvres, as in `Plan.order`."""
    setups = {c.name: float(c.setup) for c in prediction.catalogue.condition}
    rows, clock, fuel, seen = [], 0.0, 0.0, set()
    for condition, manoeuvre in items:
        one = prediction.candidates[condition, manoeuvre]
        setup = 0.0 if condition in seen else setups[condition]
        seen.add(condition)
        burnt = one.fuel * (1.0 + setup / one.time)
        clock, fuel = clock + setup + one.time, fuel + burnt
        row = {"condition": condition, "manoeuvre": manoeuvre, "setup": setup, "time": one.time, "fuel": burnt}
        rows.append({**row, "clock": clock, "fuel_total": fuel})
    columns = ["condition", "manoeuvre", "setup", "time", "fuel", "clock", "fuel_total"]
    return pd.DataFrame(rows, columns=columns, index=pd.RangeIndex(1, len(rows) + 1, name="card"))


def _undetermined(prediction: Prediction, items: Sequence[Item]) -> list[tuple[str, Any]]:
    """Fits of the catalogue that use chosen manoeuvres and that these do not determine, by condition."""
    made = {(str(fit.name), fit.model.coefficient) for fit in prediction.fits(items)}
    found = []
    for condition in dict.fromkeys(c for c, _ in items):
        for fit in prediction.catalogue.fit:
            used = any((condition, name) in items for name in fit.manoeuvres) and (not fit.conditions or condition in fit.conditions)
            lacking = [text for text in fit.models if (f"{condition}: {fit.name}", text.split("=")[0].strip()) not in made]
            if used and lacking:
                found.append((condition, fit))
    return found


def shown(name: str, value: float) -> str:
    """Return a quantity by name in the units of display, with its unit."""
    units = lookup(name.removeprefix("applied.")).display_units
    text = f"{float(from_si(value, units)):.4g}"
    return text if units == "1" else f"{text} {units}"


def clock_text(seconds: float) -> str:
    """Return a time as ``h:mm:ss`` or ``m:ss``."""
    whole = round(seconds)
    hours, minutes, rest = whole // 3600, whole // 60 % 60, whole % 60
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def _report(plan: Plan) -> str:
    prediction = plan.prediction
    lines = [f"{prediction.catalogue.title or 'flight-test programme'}: {len(plan.items)} of {len(prediction.candidates)} manoeuvres"]
    lines.append(f"{'card':>4}  {'condition':<32}{'manoeuvre':<32}{'setup':>7}{'time':>7}{'fuel kg':>9}{'clock':>9}")
    for card, row in plan.order.iterrows():
        setup = clock_text(row["setup"]) if row["setup"] else ""
        fuel = f"{row['fuel_total']:.1f}" if np.isfinite(row["fuel_total"]) else "-"
        times = f"{setup:>7}{clock_text(row['time']):>7}{fuel:>9}{clock_text(row['clock']):>9}"
        lines.append(f"{card:>4}  {row['condition']:<32}{row['manoeuvre']:<32}{times}")
    whole = time_of(prediction, list(prediction.candidates))
    lines.append(f"time {clock_text(plan.time)} with setups; the whole catalogue takes {clock_text(whole)}")
    lines.append("")
    lines.append(f"{'term':<18}{'wanted':>8}{'reached':>9}{'missed':>8}{'unreachable':>13}{'largest expected/bound':>24}")
    for name, part in plan.nodes.groupby("term", sort=False):
        counts = part["state"].value_counts()
        numbers = [int(counts.get(state, 0)) for state in ("reached", "missed", "unreachable")]
        worst = float((part["expected"] / part["bound"]).max())
        lines.append(f"{name!s:<18}{len(part):>8}{numbers[0]:>9}{numbers[1]:>8}{numbers[2]:>13}{worst:>24.2f}")
    lines += [f"! not determined: {text}" for text in plan.undetermined]
    lines += [f"! cannot be flown: {condition}, {manoeuvre}: {why}" for (condition, manoeuvre), why in prediction.refused.items()]
    return "\n".join(lines)

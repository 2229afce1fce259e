"""Plan of a flight-test programme: manoeuvres, their order, and the expected standard errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.store.schema import terms
from flightmech.aircraft.aircraft import Aircraft
from flightmech.names import value_text
from flightmech.short_text import ShortText
from flightmech.simulation.compiler import SimModel
from flighttest.flight_programme.planning.catalogue import Catalogue, PlannedFit
from flighttest.flight_programme.planning.expected_range import RANGE_COLUMNS, draw_ranges
from flighttest.flight_programme.planning.prediction import Item, Prediction, predict
from flighttest.flight_programme.planning.selection import Goal, select_manoeuvres, time_of
from flighttest.flight_programme.planning.wanted_rows import RowGradients, shares_of_row

# Last columns of the table of nodes, after the axes of the terms.
_NODE_COLUMNS = ["before", "expected", "bound", "state"]
_ORDER_COLUMNS = ["condition", "manoeuvre", "setup", "time", "fuel", "clock", "fuel_total"]
_ROW_COLUMNS = ["row", "condition", "manoeuvre", "before", "expected", "bound"]
_ROW_COLUMNS += ["criterion", "state", "rests_on", "ground"]
# Ratio of standard errors above which the ground effect counts as not flown.
_NOT_LOWERED = 0.9
_STATES = ("reached", "missed", "unreachable")


@dataclass(frozen=True)
class ProgrammePlan(ShortText):
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
        errors, ``bound``, ``state``: reached, missed, or unreachable.  An unreachable node stays
        above its bound with all manoeuvres of the catalogue.
    expected : dict of str to array
        Expected standard errors of all nodes of the terms that the programme informs, in the shape
        of the table.
    undetermined : list of str
        Fits of the catalogue that the chosen manoeuvres do not determine.
    rows : DataFrame
        Wanted rows: ``row condition manoeuvre``, widths ``before`` and ``expected``, ``bound``,
        ``criterion`` that decides, ``state`` as of nodes, ``rests_on``: the terms with the largest
        shares of the expected variance, and ``ground``: standard errors of the ground effect along
        the row over those before the flights, by coefficient.
    notes : list of str
        What the prediction of the rows assumes or lacks, and draws of the ranges that failed.
    ranges : dict of str to Dataset
        Range of the standard errors of the terms that the programme informs, over draws of what the
        identification will learn (`flighttest.planning.draw_stderr`): ``low``, ``median``, ``high``
        in the shape of the table, as of `range_of_draws`.  Empty without draws; NaN, and a note,
        for a term with less than 20 draws that converge.
    """

    prediction: Prediction
    items: list[Item]
    order: pd.DataFrame
    nodes: pd.DataFrame
    expected: dict[str, np.ndarray]
    undetermined: list[str]
    rows: pd.DataFrame = field(default_factory=pd.DataFrame)
    notes: list[str] = field(default_factory=list)
    ranges: dict[str, xr.Dataset] = field(default_factory=dict)

    @property
    def time(self) -> float:
        """Time of the programme with all setups. [s]"""
        return time_of(self.prediction, self.items)

    def summary(self) -> dict[str, Any]:
        """Return the plan as plain tables."""
        return {
            "title": self.prediction.catalogue.title,
            "time": self.time,
            "time_of_catalogue": time_of(self.prediction, list(self.prediction.candidates)),
            "order": self.order.reset_index(),
            "nodes": self.nodes,
            "rows": self.rows,
            "notes": self.notes,
            "undetermined": self.undetermined,
            "refused": {", ".join(item): why for item, why in self.prediction.refused.items()},
        }

    def report(self) -> str:
        """Return order, states of the wanted nodes and open points as text."""
        return _format_plan(self)


def plan_programme(
    catalogue: Catalogue,
    sim: SimModel,
    aircraft: Aircraft,
    database: xr.DataTree,
    flown: Sequence[Any] = (),
    jobs: int = 1,
    done: Callable[[int, float], None] | None = None,
    rows: Sequence[RowGradients] = (),
) -> ProgrammePlan:
    """Return the shortest programme that brings every wanted node below its bound.

    Nodes that no choice of manoeuvres brings below their bound are reported as unreachable.

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
        Fits of earlier flights.
    jobs : int
        Processes for the reconstruction.
    done : callable, optional
        ``done(count, F)`` after every choice.
    rows : sequence of RowGradients
        Gradients of the wanted rows of the catalogue.

    Raises
    ------
    SchemaError
        As `predict` and `Goal`.
    """
    prediction = predict(catalogue, sim, aircraft, jobs=jobs)
    return plan_predicted_flights(prediction, database, flown=flown, done=done, rows=rows)


def plan_predicted_flights(
    prediction: Prediction,
    database: xr.DataTree,
    flown: Sequence[Any] = (),
    done: Callable[[int, float], None] | None = None,
    rows: Sequence[RowGradients] = (),
    draws: int = 0,
) -> ProgrammePlan:
    """Return the shortest programme of predicted flights; parameters as in `plan_programme`.

    `draws` is the number of draws for the ranges.
    """
    goal = Goal(prediction, database, flown, rows=rows)
    chosen = set(select_manoeuvres(goal, done))
    items = [item for item in prediction.candidates if item in chosen]
    fits = [*flown, *prediction.fits(items)]
    undetermined = [f"{name}: {fit.name}" for name, fit in _find_undetermined(prediction, items)]
    ranges, range_notes = draw_ranges(goal, fits, draws)
    return ProgrammePlan(
        prediction,
        items,
        order=order_of(prediction, items),
        nodes=_with_ranges(nodes_of(goal, items, database), ranges, database),
        expected=goal.expectation.stderr(fits),
        undetermined=undetermined,
        rows=rows_of(goal, items),
        notes=[*_note_rows(goal), *range_notes],
        ranges=ranges,
    )


def _with_ranges(
    nodes: pd.DataFrame, ranges: Mapping[str, xr.Dataset], database: xr.DataTree
) -> pd.DataFrame:
    """Return wanted nodes with the range of their standard errors."""
    if not ranges:
        return nodes
    leaves = terms(database)
    rows = []
    for _, node in nodes.iterrows():
        found = dict.fromkeys(RANGE_COLUMNS, np.nan)
        if node["term"] in ranges:
            leaf = leaves[node["term"]]
            nearest = {}
            for axis in map(str, leaf["value"].dims):
                nearest[axis] = int(np.argmin(np.abs(leaf[axis].values - node[axis])))
            table = ranges[node["term"]].isel(nearest)
            found = {key: float(table[key]) for key in RANGE_COLUMNS}
        rows.append(found)
    # The ranges stand behind the expected standard error.
    place = list(nodes.columns).index("expected") + 1
    return pd.concat(
        [nodes.iloc[:, :place], pd.DataFrame(rows, index=nodes.index), nodes.iloc[:, place:]],
        axis=1,
    )


def rows_of(goal: Goal, items: Sequence[Item]) -> pd.DataFrame:
    """Return the wanted rows with widths before and after a choice of manoeuvres.

    The columns are those of `ProgrammePlan.rows`.
    """
    fits = [*goal.flown, *goal.prediction.fits(items)]
    before, after = goal.widths([]), goal.widths(items)
    rows = []
    for row in goal.rows:
        wanted = row.wanted
        criterion, width = after[wanted.name]
        state = "missed"
        if width <= wanted.ratio * (1.0 + 1e-9):
            state = "reached"
        elif wanted.name in goal.beyond:
            state = "unreachable"
        shares = shares_of_row(row, goal.expectation, fits)
        rests_on = [f"{name} {100.0 * share:.0f} %" for name, share in list(shares.items())[:4]]
        rows.append(
            {
                "row": wanted.row,
                "condition": wanted.condition,
                "manoeuvre": wanted.manoeuvre,
                "before": before[wanted.name][1],
                "expected": width,
                "bound": wanted.ratio,
                "criterion": criterion,
                "state": state,
                "rests_on": ", ".join(rests_on),
                "ground": ", ".join(
                    f"{name} {ratio:.2f}" for name, ratio in goal.ground_ratios(row, items).items()
                ),
            }
        )
    return pd.DataFrame(rows, columns=_ROW_COLUMNS)


def _note_rows(goal: Goal) -> list[str]:
    """Return the notes on the rows, and the ground effect that no manoeuvre informs."""
    notes, everything = [], list(goal.prediction.candidates)
    for row in goal.rows:
        notes += [f"{row.wanted.name}: {note}" for note in row.notes]
        for coefficient, ratio in goal.ground_ratios(row, everything).items():
            if ratio > _NOT_LOWERED:
                notes.append(
                    f"{row.wanted.name} rests on the ground effect on {coefficient}, and no "
                    "manoeuvre of the catalogue lowers its standard error; add a condition over "
                    'the runway with a [[manoeuvre]] of kind = "low_pass"'
                )
    return notes


def nodes_of(goal: Goal, items: Sequence[Item], database: xr.DataTree) -> pd.DataFrame:
    """Return the wanted nodes with standard errors before and after a choice of manoeuvres.

    The columns are those of `ProgrammePlan.nodes`.
    """
    leaves, after = terms(database), goal.stderr(items)
    rows: list[dict[str, Any]] = []
    for name, bound in goal.bounds.items():
        leaf = leaves[name]
        unreachable = goal.unreachable.get(name, np.full(bound.shape, np.nan))
        for node in map(tuple, np.argwhere(np.isfinite(bound))):
            row: dict[str, Any] = {"term": name}
            for axis, k in zip(leaf["value"].dims, node, strict=True):
                row[str(axis)] = float(leaf[axis].values[k])
            row["before"] = float(leaf["stderr"].values[node])
            row["expected"] = float(after[name][node])
            row["bound"] = float(bound[node])
            if np.isfinite(unreachable[node]):
                row["state"] = "unreachable"
            elif row["expected"] <= bound[node] * (1.0 + 1e-9):
                row["state"] = "reached"
            else:
                row["state"] = "missed"
            rows.append(row)
    # axes in the order in which the terms have them; terms without an axis have NaN there
    table = pd.DataFrame(rows)
    if not rows:
        return pd.DataFrame(columns=["term", *_NODE_COLUMNS])
    axes = [column for column in table.columns if column not in ("term", *_NODE_COLUMNS)]
    return table[["term", *axes, *_NODE_COLUMNS]]


def order_of(prediction: Prediction, items: Sequence[Item]) -> pd.DataFrame:
    """Return the cards of a choice of manoeuvres, as in `ProgrammePlan.order`."""
    setups = {c.name: float(c.setup) for c in prediction.catalogue.condition}
    rows, clock, fuel_total = [], 0.0, 0.0
    for condition, manoeuvre in items:
        candidate = prediction.candidates[condition, manoeuvre]
        # the first card of a condition has its setup
        setup = setups.pop(condition, 0.0)
        # the setup burns fuel at the rate of the manoeuvre
        fuel = candidate.fuel * (1.0 + setup / candidate.time)
        clock, fuel_total = clock + setup + candidate.time, fuel_total + fuel
        rows.append((condition, manoeuvre, setup, candidate.time, fuel, clock, fuel_total))
    cards = pd.RangeIndex(1, len(rows) + 1, name="card")
    return pd.DataFrame(rows, columns=_ORDER_COLUMNS, index=cards)


def _find_undetermined(
    prediction: Prediction, items: Sequence[Item]
) -> list[tuple[str, PlannedFit]]:
    """Return condition and fit where chosen manoeuvres do not determine a model of the fit."""
    determined = {(str(fit.name), fit.model.coefficient) for fit in prediction.fits(items)}
    undetermined = []
    for condition in dict.fromkeys(condition for condition, _ in items):
        for fit in prediction.catalogue.fit:
            if fit.conditions and condition not in fit.conditions:
                continue
            if not any((condition, name) in items for name in fit.manoeuvres):
                continue
            # a model is named by the coefficient on its left side
            coefficients = [text.split("=")[0].strip() for text in fit.models]
            name = f"{condition}: {fit.name}"
            if any((name, coefficient) not in determined for coefficient in coefficients):
                undetermined.append((condition, fit))
    return undetermined


def format_quantity(name: str, value: float) -> str:
    """Return a quantity by name in the units of display, with its unit."""
    return value_text(name.removeprefix("applied."), value)


def clock_text(seconds: float) -> str:
    """Return a time as ``h:mm:ss`` or ``m:ss``."""
    minutes, second = divmod(round(seconds), 60)
    hours, minute = divmod(minutes, 60)
    if hours:
        return f"{hours}:{minute:02d}:{second:02d}"
    return f"{minute}:{second:02d}"


def _format_plan(plan: ProgrammePlan) -> str:
    prediction = plan.prediction
    title = prediction.catalogue.title or "flight-test programme"
    lines = [f"{title}: {len(plan.items)} of {len(prediction.candidates)} manoeuvres"]
    lines += _format_order(plan.order)
    catalogue_time = clock_text(time_of(prediction, list(prediction.candidates)))
    lines.append(
        f"time {clock_text(plan.time)} with setups; the whole catalogue takes {catalogue_time}"
    )
    lines += ["", *_format_nodes(plan.nodes)]
    if len(plan.rows):
        lines += ["", *format_rows(plan.rows)]
    lines += [f"! {text}" for text in plan.notes]
    lines += [f"! not determined: {text}" for text in plan.undetermined]
    for (condition, manoeuvre), why in prediction.refused.items():
        lines.append(f"! cannot be flown: {condition}, {manoeuvre}: {why}")
    return "\n".join(lines)


def _format_order(order: pd.DataFrame) -> list[str]:
    """Return one line per card."""
    lines = [
        f"{'card':>4}  "
        f"{'condition':<32}{'manoeuvre':<32}{'setup':>7}{'time':>7}{'fuel kg':>9}{'clock':>9}"
    ]
    for card, row in order.iterrows():
        setup, fuel = "", "-"
        if row["setup"]:
            setup = clock_text(row["setup"])
        if np.isfinite(row["fuel_total"]):
            fuel = f"{row['fuel_total']:.1f}"
        times = f"{setup:>7}{clock_text(row['time']):>7}{fuel:>9}{clock_text(row['clock']):>9}"
        lines.append(f"{card:>4}  {row['condition']:<32}{row['manoeuvre']:<32}{times}")
    return lines


def format_rows(rows: pd.DataFrame) -> list[str]:
    """Return one line per wanted row: widths over the tolerance, and the terms it rests on."""
    lines = [
        f"{'row':<8}{'condition':<24}{'manoeuvre':<24}{'before':>8}{'then':>7}{'bound':>7}"
        f"  {'state':<12}{'decides':<22}rests on"
    ]
    for _, row in rows.iterrows():
        widths = f"{row['before']:>8.2f}{row['expected']:>7.2f}{row['bound']:>7.2f}"
        lines.append(
            f"{row['row']:<8}{row['condition']:<24}{row['manoeuvre']:<24}{widths}"
            f"  {row['state']:<12}{row['criterion']:<22}{row['rests_on']}"
        )
        if row["ground"]:
            lines.append(f"{'':8}ground effect, of its standard error before: {row['ground']}")
    return lines


def _format_nodes(nodes: pd.DataFrame) -> list[str]:
    """Return one line per term, with the number of nodes in each state."""
    lines = [
        f"{'term':<18}{'wanted':>8}{'reached':>9}{'missed':>8}{'unreachable':>13}"
        f"{'largest expected/bound':>24}"
    ]
    if "low" in nodes:
        lines[0] += "  range of 80 %"
    for name, part in nodes.groupby("term", sort=False):
        counts = part["state"].value_counts()
        reached, missed, unreachable = (int(counts.get(state, 0)) for state in _STATES)
        worst = float((part["expected"] / part["bound"]).max())
        line = f"{name!s:<18}{len(part):>8}{reached:>9}{missed:>8}{unreachable:>13}{worst:>24.2f}"
        if "low" in part:
            low, high = ((part[key] / part["bound"]).max() for key in ("low", "high"))
            line += f"{low:>8.2f} ... {high:.2f}" if np.isfinite(low) else f"{'none':>8}"
        lines.append(line)
    return lines

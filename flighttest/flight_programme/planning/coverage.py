"""Coverage of a flight-test programme by its records, and the cards that are still needed.

The records have the same reconstruction and fits as the prediction.  A record belongs to the
condition of the catalogue that is nearest to its median flight.  Its manoeuvres are found by the
marks of the record.

The remaining cards are predicted with the database that these flights have identified, and with the
weights of its prior covariance that `aerodb.tabulate` has estimated from them.  The reduction of a
standard error by a further flight depends on both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import flightmech
from aerodb.edit.term_edits import replace_terms
from aerodb.update.tabulation import tabulate
from aerodb.update.tabulation_report import Tabulation
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import SchemaError
from flightmech.short_text import ShortText
from flightmech.units import DEGREE
from flighttest.flight_programme.planning.catalogue import Catalogue, PlannedCondition, PlannedFit
from flighttest.flight_programme.planning.plan import (
    clock_text,
    format_rows,
    nodes_of,
    order_of,
    rows_of,
)
from flighttest.flight_programme.planning.prediction import (
    Item,
    Prediction,
    fit_models,
    predict,
    with_assumed,
)
from flighttest.flight_programme.planning.selection import Goal, select_manoeuvres, time_of
from flighttest.flight_programme.planning.wanted_rows import RowGradients
from flighttest.reconstruction.dynamics.force_coefficients import coefficients, select_time
from flighttest.records.record import marked_manoeuvres

# Largest distance of a record from a condition: a share of the value, and an absolute distance
# [SI].
_NEAR = {
    "V": (0.08, 0.0),
    "h": (0.0, 400.0),
    "delta_f": (0.0, 5 * DEGREE),
    "gear": (0.0, 0.4),
    "speedbrake": (0.0, 0.4),
    "mach": (0.08, 0.0),
}
_STATES = ("achieved", "open", "unreachable")


@dataclass(frozen=True)
class Flights:
    """Fits and manoeuvres of a catalogue in flight records.

    Attributes
    ----------
    fits : list of Fit
        One per record, fit of the catalogue and determined model.
    conditions : dict of str to str
        Record to condition; empty text if no condition is near.
    done : list of (str, str)
        Condition and manoeuvre.
    undetermined : list of (str, str)
        Condition and manoeuvre that were flown, but that no fit could use; they are not done.
    """

    fits: list[Any]
    conditions: dict[str, str]
    done: list[Item]
    undetermined: list[Item] = field(default_factory=list)


@dataclass(frozen=True)
class Coverage(ShortText):
    """Achieved standard errors and the cards that are still needed.

    Attributes
    ----------
    flights : Flights
    nodes : DataFrame
        Wanted nodes: ``term``, axes, ``before`` the flights, ``achieved`` by the records,
        ``expected`` with the needed cards, ``bound``, ``state``: achieved, open, or unreachable
        with all manoeuvres of the plan.
    needed : DataFrame
        Cards of the plan that are still needed, as `Plan.order`.
    superfluous : list of (str, str)
        Cards of the plan that are not needed after the flights.
    time : float
        Time of the needed cards with setups. [s]
    rows : DataFrame
        Wanted rows, as `ProgrammePlan.rows`; ``before`` is the width after the flights so far.
    """

    flights: Flights
    nodes: pd.DataFrame
    needed: pd.DataFrame
    superfluous: list[Item]
    time: float
    rows: pd.DataFrame = field(default_factory=pd.DataFrame)

    def summary(self) -> dict[str, Any]:
        """Return the coverage as plain tables."""
        return {
            "records": self.flights.conditions,
            "done": [", ".join(item) for item in self.flights.done],
            "undetermined": [", ".join(item) for item in self.flights.undetermined],
            "nodes": self.nodes,
            "rows": self.rows,
            "needed": self.needed.reset_index(),
            "superfluous": [", ".join(item) for item in self.superfluous],
            "time": self.time,
        }

    def report(self) -> str:
        """Return achieved and open nodes, and the remaining cards, as text."""
        return _format_coverage(self)


def flights_of(
    catalogue: Catalogue,
    records: Mapping[str, xr.DataTree],
    paths: Mapping[str, Any],
    aircraft: Aircraft,
) -> Flights:
    """Return the fits of the catalogue that flight records determine.

    Parameters
    ----------
    catalogue : Catalogue
    records : mapping of str to DataTree
        Records with their marks.
    paths : mapping of str to Path
        Reconstructions of the records.
    aircraft : Aircraft

    Raises
    ------
    SchemaError
        No record has a manoeuvre of the catalogue.
    """
    fits: list[Any] = []
    done: list[Item] = []
    flown: list[Item] = []
    conditions = {}
    for name, record in records.items():
        data = coefficients(paths[name], aircraft, catalogue.errors or None, catalogue.cutoff)
        condition = nearest_condition(catalogue.condition, data)
        conditions[name] = condition
        marks = _find_marks(catalogue, marked_manoeuvres(record))
        # A manoeuvre that no fit can use is to be flown again; one without a fit is only flown.
        wanted: set[str] = set()
        used: set[str] = set()
        for fit in catalogue.fit:
            if not fit.conditions or condition in fit.conditions:
                found = _fit_record(fit, data, marks, name=name)
                fits += found
                wanted.update(fit.manoeuvres)
                used.update(fit.manoeuvres if found else ())
        if condition:
            flown += [(condition, manoeuvre) for manoeuvre in marks]
            useful = [item for item in marks if item in used or item not in wanted]
            done += [(condition, manoeuvre) for manoeuvre in useful]
    if not fits:
        names = ", ".join(manoeuvre.name for manoeuvre in catalogue.manoeuvre)
        problem = (
            f"no record has a manoeuvre that a fit of the catalogue uses: {names}; give `marks` "
            "if the records use other names"
        )
        raise SchemaError("flight coverage", [problem])
    done = list(dict.fromkeys(done))
    undetermined = [item for item in dict.fromkeys(flown) if item not in done]
    return Flights(fits, conditions, done, undetermined)


def _find_marks(catalogue: Catalogue, table: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return the marks of a record by manoeuvre of the catalogue."""
    marks: dict[str, pd.DataFrame] = {}
    if not len(table):
        return marks
    for manoeuvre in catalogue.manoeuvre:
        rows = manoeuvre.marked(table)
        if len(rows):
            marks[manoeuvre.name] = rows
    return marks


def _fit_record(
    fit: PlannedFit, data: xr.Dataset, marks: Mapping[str, pd.DataFrame], *, name: str
) -> list[Any]:
    """Return the models of a fit that the manoeuvres of one record determine."""
    rows = [marks[manoeuvre] for manoeuvre in fit.manoeuvres if manoeuvre in marks]
    if not rows:
        return []
    spans = pd.concat(rows).sort_values("start")
    starts, ends = spans["start"].astype(float), spans["end"].astype(float)
    parts = [select_time(data, *span) for span in zip(starts, ends, strict=True)]
    return fit_models(fit, parts, name=f"{name}: {fit.name}")


def nearest_condition(conditions: Sequence[PlannedCondition], data: xr.Dataset) -> str:
    """Return the name of the condition nearest to the median of a flight.

    The name is empty if no condition is near in speed, height and configuration.
    """
    best, distance = "", 1.0
    for condition in conditions:
        # distances in units of the largest allowed distance
        distances = []
        for name, value in condition.fixed.items():
            if name in _NEAR and name in data:
                relative, absolute = _NEAR[name]
                allowed = relative * abs(value) + absolute
                distances.append(abs(float(data[name].median()) - value) / allowed)
        if distances and max(distances) <= distance:
            best, distance = condition.name, max(distances)
    return best


def coverage_of(
    catalogue: Catalogue,
    planned: Sequence[Item],
    flights: Flights,
    aircraft: Aircraft,
    database: xr.DataTree,
    jobs: int = 1,
    rows: Sequence[RowGradients] = (),
) -> Coverage:
    """Return the nodes that flights have achieved, and the cards that are still needed.

    Parameters
    ----------
    catalogue : Catalogue
    planned : sequence of (str, str)
        Condition and manoeuvre of the cards of the plan.
    flights : Flights
        As from `flights_of`.
    aircraft, database, jobs, rows
        As in `plan_programme`.

    Raises
    ------
    SchemaError
        The catalogue does not have a card of the plan, or no manoeuvre can be flown.
    """
    flyable = [(condition.name, manoeuvre.name) for condition, manoeuvre in catalogue.flyable()]
    unknown = [item for item in planned if item not in flyable]
    if unknown:
        raise SchemaError(
            "plan", [f"{c}, {m}: not a manoeuvre of the catalogue" for c, m in unknown]
        )
    remaining = [item for item in planned if item not in flights.done]
    learnt = tabulate(flights.fits, database, catalogue.held)
    identified = identify_database(learnt, database, catalogue)
    prediction = _predict_remaining(catalogue, remaining, aircraft, database=identified, jobs=jobs)
    goal = Goal(prediction, database, flown=flights.fits, learnt=learnt, rows=rows)
    needed = select_manoeuvres(goal) if remaining else []
    items = [item for item in prediction.candidates if item in needed]
    superfluous = []
    for item in remaining:
        if item not in items and item in prediction.candidates:
            superfluous.append(item)
    return Coverage(
        flights,
        _compare_nodes(nodes_of(goal, [], database), nodes_of(goal, items, database)),
        needed=order_of(prediction, items),
        superfluous=superfluous,
        time=time_of(prediction, items),
        rows=_compare_rows(rows_of(goal, []), rows_of(goal, items)),
    )


def _compare_rows(now: pd.DataFrame, then: pd.DataFrame) -> pd.DataFrame:
    """Return the wanted rows after the flights, and after the needed cards."""
    rows = then.copy()
    # before: with the flights so far
    rows["before"] = now["expected"]
    return rows


def _compare_nodes(now: pd.DataFrame, then: pd.DataFrame) -> pd.DataFrame:
    """Return the wanted nodes after the flights, and after the needed cards."""
    nodes = now.rename(columns={"expected": "achieved"}).drop(columns=["bound", "state"])
    nodes["expected"], nodes["bound"] = then["expected"], now["bound"]
    still_open = np.where(then["state"] == "unreachable", "unreachable", "open")
    nodes["state"] = np.where(now["expected"] <= now["bound"], "achieved", still_open)
    return nodes


def identify_database(
    learnt: Tabulation, database: xr.DataTree, catalogue: Catalogue
) -> xr.DataTree:
    """Return the database that flights have identified.

    A term without information from the flights has the value that the catalogue assumes.

    Parameters
    ----------
    learnt : Tabulation
        Tabulation of the flights.
    database : DataTree
        The prior.
    catalogue : Catalogue
    """
    informed = learnt.report.index[learnt.report["corrected"] > 0]
    identified = {}
    for name, leaf in learnt.items():
        if name not in catalogue.assumed or name in informed:
            identified[name] = leaf
    return replace_terms(with_assumed(database, catalogue), identified)


def _predict_remaining(
    catalogue: Catalogue,
    remaining: Sequence[Item],
    aircraft: Aircraft,
    *,
    database: xr.DataTree,
    jobs: int,
) -> Prediction:
    """Return the predicted flights of the cards that are still to be flown."""
    if not remaining:
        return Prediction(catalogue, {}, {}, data={}, marks={}, trims={})
    sim = flightmech.compile(aircraft, database)
    return predict(catalogue, sim, aircraft, jobs=jobs, only=remaining)


def _format_coverage(coverage: Coverage) -> str:
    flights = coverage.flights
    lines = []
    for name, condition in flights.conditions.items():
        lines.append(f"{name}: {condition or 'no condition of the catalogue near it'}")
    lines.append(
        f"{len(flights.done)} manoeuvres done, {len(coverage.needed)} still needed, "
        f"{len(coverage.superfluous)} superfluous"
    )
    for item in flights.undetermined:
        lines.append(f"flown, but no fit can use it: {', '.join(item)}")
    lines += ["", *_format_nodes(coverage.nodes), ""]
    if len(coverage.rows):
        lines += [*format_rows(coverage.rows), ""]
    for _, row in coverage.needed.iterrows():
        time = clock_text(row["time"])
        lines.append(f"to fly: {row['condition']}, {row['manoeuvre']} ({time})")
    lines += [f"superfluous: {', '.join(item)}" for item in coverage.superfluous]
    lines.append(f"time {clock_text(coverage.time)} with setups")
    return "\n".join(lines)


def _format_nodes(nodes: pd.DataFrame) -> list[str]:
    """Return one line per term, with the number of nodes in each state."""
    lines = [
        f"{'term':<18}{'wanted':>8}{'achieved':>10}{'open':>7}{'unreachable':>13}"
        f"{'largest achieved/bound':>24}{'then':>7}"
    ]
    for name, part in nodes.groupby("term", sort=False):
        counts = part["state"].value_counts()
        achieved, still_open, unreachable = (int(counts.get(state, 0)) for state in _STATES)
        now = float((part["achieved"] / part["bound"]).max())
        then = float((part["expected"] / part["bound"]).max())
        lines.append(
            f"{name!s:<18}{len(part):>8}{achieved:>10}{still_open:>7}{unreachable:>13}"
            f"{now:>24.2f}{then:>7.2f}"
        )
    return lines

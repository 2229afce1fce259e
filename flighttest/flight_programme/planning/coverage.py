"""A flight-test programme while it is flown: what the records so far determine, and what of the
plan is still needed.

The records go through the same reconstruction and fits as the prediction.  A record belongs to the
condition of the catalogue that is nearest to its median flight; manoeuvres are found by the marks
of the record.  What is still to be flown is predicted with the database as these flights have
identified it, and with the weights of its prior covariance that they have taught `aerodb.tabulate`:
how much of a standard error a flight removes depends on both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import flightmech
from aerodb.edit.table_edits import replace_terms
from aerodb.update.tabulation import tabulate
from aerodb.update.tabulation_report import Tabulation
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import SchemaError
from flightmech.units import DEGREE
from flighttest.flight_programme.planning.catalogue import Catalogue, PlannedCondition
from flighttest.flight_programme.planning.plan import (
    Goal,
    clock_text,
    nodes_of,
    order_of,
    select_manoeuvres,
    time_of,
)
from flighttest.flight_programme.planning.prediction import (
    Item,
    Prediction,
    fit_model,
    predict,
    with_assumed,
)
from flighttest.reconstruction.dynamics.force_coefficients import coefficients, select_time
from flighttest.records.record import manoeuvres

# how far the mean of a record may be from a condition: a part of the value, and an absolute
# distance [SI]
_NEAR = {
    "V": (0.08, 0.0),
    "h": (0.0, 400.0),
    "delta_f": (0.0, 5 * DEGREE),
    "gear": (0.0, 0.4),
    "speedbrake": (0.0, 0.4),
    "mach": (0.08, 0.0),
}


@dataclass(frozen=True)
class Flights:
    """What has been flown of a catalogue.

    Attributes
    ----------
    fits : list of Fit
        One per record, fit of the catalogue and model that its manoeuvres determine.
    conditions : dict of str to str
        Record to condition; empty text for none near it.
    done : list of (str, str)
        Condition and manoeuvre.
    """

    fits: list[Any]
    conditions: dict[str, str]
    done: list[Item]


@dataclass(frozen=True)
class Coverage:
    """What is achieved and what is still needed.

    Attributes
    ----------
    flights : Flights
    nodes : DataFrame
        Wanted nodes: ``term``, axes, ``before`` the flights, ``achieved`` by the records,
        ``expected`` with what is still needed, ``bound``, ``state``: achieved, open, or unreachable
        with all manoeuvres of the plan.
    needed : DataFrame
        Cards of the plan that are still needed, as `Plan.order`.
    superfluous : list of (str, str)
        Cards of the plan that the flights have made so.
    time : float
        Of what is needed, setups included. [s]
    """

    flights: Flights
    nodes: pd.DataFrame
    needed: pd.DataFrame
    superfluous: list[Item]
    time: float

    def summary(self) -> dict[str, Any]:
        """Return the coverage as plain tables."""
        return {
            "records": self.flights.conditions,
            "done": [", ".join(item) for item in self.flights.done],
            "nodes": self.nodes,
            "needed": self.needed.reset_index(),
            "superfluous": [", ".join(item) for item in self.superfluous],
            "time": self.time,
        }

    def report(self) -> str:
        """Return what is achieved, open and still to be flown as text."""
        return _report(self)


def flights_of(
    catalogue: Catalogue,
    records: Mapping[str, xr.DataTree],
    paths: Mapping[str, Any],
    aircraft: Aircraft,
) -> Flights:
    """Return the fits of the catalogue that some flight records allow.

    Parameters
    ----------
    catalogue : Catalogue
    records : mapping of str to DataTree
        For their marks.
    paths : mapping of str to Path
        Their reconstructions.
    aircraft : Aircraft

    Raises
    ------
    SchemaError
        No record holds a manoeuvre of the catalogue.
    """

    fits: list[Any] = []
    done: list[Item] = []
    conditions = {}
    for name, record in records.items():
        data = coefficients(paths[name], aircraft, catalogue.errors or None, catalogue.cutoff)
        conditions[name] = nearest_condition(catalogue.condition, data)
        table = manoeuvres(record)
        flown = {m.name: m.marked(table) for m in catalogue.manoeuvre} if len(table) else {}
        flown = {manoeuvre: rows for manoeuvre, rows in flown.items() if len(rows)}
        done += [(conditions[name], manoeuvre) for manoeuvre in flown if conditions[name]]
        for fit in catalogue.fit:
            rows = [flown[manoeuvre] for manoeuvre in fit.manoeuvres if manoeuvre in flown]
            if not rows or (fit.conditions and conditions[name] not in fit.conditions):
                continue
            spans = pd.concat(rows).sort_values("start")
            parts = [
                select_time(data, *span)
                for span in zip(
                    spans["start"].astype(float), spans["end"].astype(float), strict=True
                )
            ]
            fits += [
                one
                for text in fit.models
                if (one := fit_model(text, parts, f"{name}: {fit.name}")) is not None
            ]
    if not fits:
        names = ", ".join(m.name for m in catalogue.manoeuvre)
        raise SchemaError(
            "flight coverage",
            [
                f"no record holds a manoeuvre that a fit of the catalogue uses: {names}; "
                f"give `marks` where records call them otherwise"
            ],
        )
    return Flights(fits, conditions, list(dict.fromkeys(done)))


def nearest_condition(conditions: Sequence[PlannedCondition], data: xr.Dataset) -> str:
    """Return the name of the condition next to the median of a flight; empty when none is near in
    speed, height and configuration.
    """
    best, distance = "", 1.0
    for condition in conditions:
        apart = []
        for name, wanted in condition.fixed.items():
            if name in _NEAR and name in data:
                relative, absolute = _NEAR[name]
                apart.append(
                    abs(float(data[name].median()) - wanted) / (relative * abs(wanted) + absolute)
                )
        if apart and max(apart) <= distance:
            best, distance = condition.name, max(apart)
    return best


def coverage_of(
    catalogue: Catalogue,
    planned: Sequence[Item],
    flights: Flights,
    aircraft: Aircraft,
    database: xr.DataTree,
    jobs: int = 1,
) -> Coverage:
    """Return what the flights have achieved, and what of a plan is still needed.

    Parameters
    ----------
    catalogue : Catalogue
    planned : sequence of (str, str)
        Condition and manoeuvre of the cards of the plan.
    flights : Flights
        From `flights_of`.
    aircraft, database, jobs
        As in `plan_programme`.

    Raises
    ------
    SchemaError
        A card that the catalogue does not have, or no manoeuvre that can be flown.
    """
    flyable = [(c.name, m.name) for c, m in catalogue.flyable()]
    if unknown := [item for item in planned if item not in flyable]:
        raise SchemaError("plan", [f"{c}, {m}: no manoeuvre of the catalogue" for c, m in unknown])
    rest = [item for item in planned if item not in flights.done]
    learnt = tabulate(flights.fits, database, catalogue.held)
    prediction = _rest(
        catalogue, rest, aircraft, identify_database(learnt, database, catalogue), jobs
    )
    goal = Goal(prediction, database, flights.fits, learnt)
    needed = select_manoeuvres(goal) if rest else []
    items = [item for item in prediction.candidates if item in needed]
    now, then = nodes_of(goal, [], database), nodes_of(goal, items, database)
    nodes = now.rename(columns={"expected": "achieved"}).drop(columns=["bound", "state"])
    nodes["expected"], nodes["bound"] = then["expected"], now["bound"]
    nodes["state"] = np.where(
        now["expected"] <= now["bound"],
        "achieved",
        np.where(then["state"] == "unreachable", "unreachable", "open"),
    )
    superfluous = [item for item in rest if item not in items and item in prediction.candidates]
    return Coverage(
        flights, nodes, order_of(prediction, items), superfluous, time_of(prediction, items)
    )


def identify_database(
    learnt: Tabulation, database: xr.DataTree, catalogue: Catalogue
) -> xr.DataTree:
    """Return the database as some flights have identified it; a term that they do not inform keeps
    the value that the catalogue assumes.

    Parameters
    ----------
    learnt : Tabulation
        Of the flights.
    database : DataTree
        The prior.
    catalogue : Catalogue
    """

    informed = learnt.report.index[learnt.report["corrected"] > 0]
    found = {
        name: leaf
        for name, leaf in learnt.items()
        if name not in catalogue.assumed or name in informed
    }
    return replace_terms(with_assumed(database, catalogue), found)


def _rest(
    catalogue: Catalogue, rest: Sequence[Item], aircraft: Aircraft, database: xr.DataTree, jobs: int
) -> Prediction:
    """Return the predicted flights of the cards that are still to be flown, of no other."""

    if not rest:
        return Prediction(catalogue, {}, {}, {}, {}, {})
    return predict(catalogue, flightmech.compile(aircraft, database), aircraft, jobs, rest)


def _report(found: Coverage) -> str:
    flights = found.flights
    lines = [
        f"{name}: {condition or 'no condition of the catalogue near it'}"
        for name, condition in flights.conditions.items()
    ]
    lines.append(
        f"{len(flights.done)} manoeuvres done, {len(found.needed)} still needed, "
        f"{len(found.superfluous)} superfluous"
    )
    lines.append("")
    lines.append(
        f"{'term':<18}{'wanted':>8}{'achieved':>10}{'open':>7}{'unreachable':>13}{'largest achieved/bound':>24}{'then':>7}"
    )
    for name, part in found.nodes.groupby("term", sort=False):
        counts = part["state"].value_counts()
        numbers = [int(counts.get(state, 0)) for state in ("achieved", "open", "unreachable")]
        ratio = [float((part[key] / part["bound"]).max()) for key in ("achieved", "expected")]
        lines.append(
            f"{name!s:<18}{len(part):>8}{numbers[0]:>10}{numbers[1]:>7}{numbers[2]:>13}{ratio[0]:>24.2f}{ratio[1]:>7.2f}"
        )
    lines.append("")
    lines += [
        f"to fly: {row['condition']}, {row['manoeuvre']} ({clock_text(row['time'])})"
        for _, row in found.needed.iterrows()
    ]
    lines += [
        f"superfluous: {condition}, {manoeuvre}" for condition, manoeuvre in found.superfluous
    ]
    lines.append(f"time {clock_text(found.time)} with setups")
    return "\n".join(lines)

"""Warnings that a database stores in its root attribute `NOTICES`, one a line."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import pandas as pd
import xarray as xr

from aerodb.store.plausibility import check_plausibility
from aerodb.store.plausibility_findings import PlausibilityFinding

NOTICES = "notices"
INCOMPATIBLE = 1e-6
"""Probability of chi-squared below which fits count as incompatible."""


def notices_of(attributes: Mapping[Any, Any]) -> list[str]:
    """Return the warnings that root attributes of a database hold."""
    return str(attributes.get(NOTICES, "")).splitlines()


def with_notices(attributes: Mapping[Any, Any], more: Iterable[str]) -> dict[str, str]:
    """Return the root attribute `NOTICES` with further warnings.

    It is empty without warnings.  A repeated warning is stored once.
    """
    lines = notices_of(attributes)
    # A warning is one line of the attribute, whatever its line breaks.
    lines += [" ".join(text.split()) for text in more]
    if not lines:
        return {}
    return {NOTICES: "\n".join(dict.fromkeys(lines))}


def note_plausibility(
    db: xr.DataTree, aircraft: Any
) -> tuple[xr.DataTree, list[PlausibilityFinding]]:
    """Return a database whose notices hold its implausible values, and all findings.

    Parameters
    ----------
    db : DataTree
    aircraft : Aircraft
        Its ``mass`` and the reasons in ``acknowledged`` are used where it has them.
    """
    loading = None
    if hasattr(aircraft, "mass") and hasattr(aircraft, "cg"):
        loading = aircraft
    findings = check_plausibility(db, loading, getattr(aircraft, "acknowledged", {}))
    notices = [str(item) for item in findings if item.kind == "implausible"]
    if notices:
        db = db.copy()
        db.attrs = {**db.attrs, **with_notices(db.attrs, notices)}
    return db, findings


def incompatible_fits(compatibility: pd.DataFrame, report: pd.DataFrame) -> list[str]:
    """Return the warning on coefficients with incompatible fits: one line, or none.

    It names the table of each that moves furthest, and the growth of the errors of the fits: the
    two sides that chi-squared does not distinguish.

    Parameters
    ----------
    compatibility : DataFrame
        Of a `Tabulation`: index coefficient; ``chi2 count probability inflation``.
    report : DataFrame
        Of a `Tabulation`: index term; ``change_in_sd``.
    """
    rows = compatibility[compatibility["probability"] < INCOMPATIBLE]
    if rows.empty:
        return []
    coefficients = []
    for coefficient, row in rows.iterrows():
        facts = [
            f"chi-squared {row['chi2']:.4g} of {int(row['count'])} estimates",
            f"probability {row['probability']:.1g}",
        ]
        own_terms = report.index.str.startswith(f"{coefficient}/")
        moved = report.loc[own_terms, "change_in_sd"].dropna()
        if not moved.empty:
            facts.append(
                f"{moved.idxmax()} moves by {moved.max():.2g} of its a-priori standard errors"
            )
        # 1 where they need not grow, and with the methods that do not estimate it.
        if row["inflation"] > 1.05:
            facts.append(f"standard errors of the fits grow {row['inflation']:.2g} times")
        coefficients.append(f"{coefficient} ({', '.join(facts)})")
    causes = "an effect that no table holds"
    # the moment of roll acceleration about the yaw axis looks like aerodynamics
    if {"Cl", "Cn"} & set(rows.index):
        causes += ", a wrong sign of Ixz"
    return [
        f"incompatible fits: {', '.join(coefficients)}: the fits contradict each other or the "
        "a-priori tables by more than their standard errors; a table that moves far was wrong by "
        f"more than it states; where the errors of the fits grow, look for {causes} or a faulty "
        "record"
    ]


def suspect_fits(points: pd.DataFrame) -> list[str]:
    """Return the warning on fits that contradict the others: one line with their names, or none.

    Parameters
    ----------
    points : DataFrame
        Of a `Tabulation`: index (coefficient, fit); ``distance weight suspect``.
    """
    rows = points[points["suspect"]].reset_index()
    if rows.empty:
        return []
    fits = []
    for row in rows.itertuples():
        fits.append(
            f"{row.fit} ({row.coefficient}, {row.distance:.1f} standard errors from the tables, "
            f"weight {row.weight:.2g})"
        )
    return [
        f"suspect fits: {', '.join(fits)}: the other fits and the a-priori tables contradict them, "
        "and they have lost weight; look for a wrong mass, configuration or record"
    ]

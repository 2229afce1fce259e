"""Tables of ``match --plan``."""

from __future__ import annotations

from typing import Any

import click

from flightmech.quantities import time_text
from flightmech.support.console import count_text, print_table


def print_plan(plan: Any) -> None:
    """Print steps, records, fits, cases, products and number of problems."""
    print_table(
        ("", "step"),
        list(enumerate(plan.steps, 1)),
        title=f"{plan.project.title}: {plan.project.file}",
        right=("",),
    )
    rows = [
        (
            row["record"],
            f"{time_text(row['start'])} ... {time_text(row['end'])}",
            row["channels"],
            row["for"],
        )
        for row in plan.record_rows()
    ]
    print_table(
        ("record", "time [s]", "channels", "for"),
        rows,
        title="\nFlight records",
        right=("channels",),
    )
    fits = [
        (
            row["fit"],
            row["records"],
            row["windows"],
            f"{row['seconds']:.0f}",
            "; ".join(row["models"]),
        )
        for row in plan.fit_rows()
    ]
    print_table(
        ("fit", "records", "windows", "time [s]", "models"),
        fits,
        title="\nFits",
        right=("records", "windows", "time [s]"),
    )
    cases = [
        (
            row["id"],
            row["case"],
            row["record"],
            f"{time_text(row['start'])} ... {time_text(row['end'])}",
            row["drive"],
            row["criteria"],
        )
        for row in plan.case_rows()
    ]
    print_table(
        ("row", "case", "record", "window [s]", "drive", "criteria"),
        cases,
        title="\nCases",
        right=("criteria",),
    )
    click.echo("\nProducts\n" + "\n".join(plan.products))
    if plan.departures:
        click.echo("\nDepartures, which the verdicts state\n" + "\n".join(plan.departures))
    if plan.remarks:
        click.echo("\nRemarks: unusual, correct what is a mistake\n" + "\n".join(plan.remarks))
    if plan.gaps:
        click.echo("\nNothing to do yet in a part of the match\n" + "\n".join(plan.gaps))
    ending = "" if plan.problems else "; nothing was computed or written"
    click.echo(f"\n{count_text(len(plan.problems), 'problem')}{ending}")
    click.echo(
        "not checked here: signs, units and delays of the records, and the aircraft file "
        "against them; the match checks them, and aeromatch flight check does so now"
    )

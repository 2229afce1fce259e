"""Function that performs the command of `pom.cli.spread`."""

from __future__ import annotations

from typing import Any

import click

import aerodb
import flightmech
from aerodb.update.expectation import Expectation, sum_spreads
from flightmech.errors import SchemaError
from flightmech.support.console import print_json, print_table, show_progress
from flighttest.flight_programme.planning.catalogue import read_catalogue
from flighttest.flight_programme.planning.prediction import with_assumed
from flighttest.flight_programme.planning.wanted_rows import (
    RowGradients,
    save_rows,
    shares_of_row,
    spreads_of_row,
)
from pom.programme.row_cases import row_title
from pom.programme.row_gradients import differentiate_row, summarise_terms

# Width below which a criterion is not printed: rounding of the replays.
_LEAST = 5e-3


def run_spread(
    catalogue_file: str,
    aircraft_file: str,
    database_file: str,
    output: str | None,
    jobs: int,
    as_json: bool,
) -> None:
    """Perform the command ``spread``."""
    catalogue = read_catalogue(catalogue_file)
    if not catalogue.wanted_row:
        raise SchemaError(catalogue_file, ["no [[wanted_row]]; add the rows that are wanted"])
    aircraft, database = flightmech.read_aircraft(aircraft_file), aerodb.open(database_file)
    sim = flightmech.compile(aircraft, with_assumed(database, catalogue))
    rows = []
    for wanted in catalogue.wanted_row:
        with show_progress(f"{wanted.row} {row_title(wanted)}: {wanted.manoeuvre}"):
            rows.append(
                differentiate_row(
                    wanted, catalogue, sim, aircraft=aircraft, database=database, jobs=jobs
                )
            )
    if output:
        save_rows(rows, database, output)
    # terms that keep their values in the identification keep their errors too
    expectation = Expectation(database, catalogue.held)
    found = [_describe(row, expectation) for row in rows]
    if as_json:
        print_json({"title": catalogue.title, "rows": found, "file": output})
        return
    lines: list[tuple[Any, ...]] = []
    for item in found:
        for name, width in item["widths"].items():
            lines.append((item["row"], item["manoeuvre"], name, f"{width:.2f}"))
    title = "width before the flights: two standard errors of the miss over the tolerance"
    print_table(["row", "manoeuvre", "criterion", "width"], lines, title, right=["width"])
    for item in found:
        click.echo(
            f"{item['row']} {item['title']}: {item['criterion']} decides, width "
            f"{item['width']:.2f}; it rests on {summarise_terms(item['rests_on'])}"
        )
        for note in item["notes"]:
            click.echo(f"! {item['row']}: {note}")
    if output:
        click.echo(f"written: {output}")


def _describe(row: RowGradients, expectation: Expectation) -> dict[str, Any]:
    """Return the widths of a row before the flights as plain data."""
    stderr = sum_spreads(spreads_of_row(row, expectation, []))
    criterion, width = row.decides(stderr)
    widths = {
        str(name): float(value) for name, value in row.widths(stderr).items() if value > _LEAST
    }
    return {
        "row": row.wanted.row,
        "title": row_title(row.wanted),
        "condition": row.wanted.condition,
        "manoeuvre": row.wanted.manoeuvre,
        "bound": row.wanted.ratio,
        "criterion": criterion,
        "width": width,
        "widths": widths,
        "rests_on": shares_of_row(row, expectation, []),
        "notes": list(row.notes),
    }

"""Functions that perform the commands of `aerodb.cli.characteristics`."""

from __future__ import annotations

from typing import Any

import click

import flightmech
from aerodb.edit.rescaling import rescale as rescaled
from aerodb.store.files import open as open_database
from aerodb.store.files import save
from aerodb.store.overview import summary
from aerodb.store.templates import scheme_texts
from aerodb.update.standard_errors import with_standard_errors
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import UnknownName
from flightmech.flying_qualities.evaluation import characteristics as compute
from flightmech.names import VOCABULARY
from flightmech.support.console import (
    print_json,
    print_table,
    show_progress,
)
from flightmech.units import number_or_text, parse_quantity


def run_characteristics(
    database: str,
    aircraft: str,
    speed: str | None,
    cas: str | None,
    mach: float | None,
    altitude: str,
    further: tuple[Any, ...],
    samples: int,
    seed: int,
    as_json: bool,
) -> None:
    """Perform the command ``characteristics``."""
    condition: dict[str, float] = {"h": parse_quantity(number_or_text(altitude), "m")}
    condition |= {
        name: parse_quantity(number_or_text(text), "m s-1")
        for name, text in (("V", speed), ("V_cas", cas))
        if text is not None
    }
    condition |= {} if mach is None else {"mach": mach}
    condition |= {name: _si(name, text) for name, text in further}
    with show_progress("compute the characteristics"):
        craft, db = read_aircraft(aircraft), open_database(database)
        found = compute(craft, db, condition)
    if samples:
        with show_progress(f"compute those of {samples} databases drawn from the standard errors"):
            found = with_standard_errors(found, craft, db, condition, samples, seed)
    if not as_json:
        click.echo(found.report())
        return
    curves = {"trim": found.trim, "polar": found.polar, "performance": found.performance}
    print_json(
        {
            "title": found.title,
            "condition": found.condition,
            "tables_left": found.tables_left,
            "characteristics": found.table,
            "modes": found.modes,
            "derivatives": found.derivatives["value"].to_pandas().to_dict(),
            **{
                name: {str(key): curve[key].values for key in curve.variables}
                for name, curve in curves.items()
            },
        }
    )


def run_rescale(
    database: str,
    aircraft: str,
    length_ratio: float,
    mass_ratio: float | None,
    laws: tuple[Any, ...],
    factors: tuple[Any, ...],
    name: str,
    output: str,
    aircraft_output: str,
    as_json: bool,
) -> None:
    """Perform the command ``rescale``."""
    craft = flightmech.aircraft.rescale(
        flightmech.read_aircraft(aircraft), length_ratio, mass_ratio, _numbers(laws), name
    )
    tree = rescaled(open_database(database), craft, _numbers(factors))
    save(tree, output)
    flightmech.write_aircraft(craft, aircraft_output)
    if as_json:
        print_json(
            {
                "file": output,
                "aircraft": aircraft_output,
                "history": craft.history.splitlines()[-1],
                "attributes": tree.attrs,
            }
        )
        return
    click.echo(craft.history.splitlines()[-1])
    click.echo(summary(tree))
    click.echo(f"\nwritten: {output}, {aircraft_output}")


def _numbers(pairs: tuple[Any, ...]) -> dict[str, float]:

    return {name: parse_quantity(number_or_text(text), "1") for name, text in pairs}


def _si(name: str, text: str) -> float:
    """Return the value of a condition; names of the vocabulary have a unit, parameters of the
    simulation are bare SI numbers.
    """

    units = VOCABULARY[name].units if name in VOCABULARY else "1"
    return parse_quantity(number_or_text(text), units)


def run_scheme(coefficient: str | None, as_json: bool) -> None:
    """Perform the command ``scheme``."""
    rows = scheme_texts()
    if coefficient is not None:
        known = dict.fromkeys(name.split("/")[0] for name in rows)
        if coefficient not in known:
            raise UnknownName(coefficient, known, "coefficient")
        rows = {name: row for name, row in rows.items() if name.split("/")[0] == coefficient}
    if as_json:
        print_json([{"term": name, **row} for name, row in rows.items()])
        return
    head = ["term", "K1", "axes", "times", "LR-743", "meaning", "from DATCOM", "identified (4.5)"]
    print_table(
        head, [[name, *(text or "-" for text in row.values())] for name, row in rows.items()]
    )

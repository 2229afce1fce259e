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
from flightmech.quantities import number_or_text, option_quantity
from flightmech.simulation.stated_values.odd_values import describe_bare_numbers
from flightmech.support.console import print_json, print_table, show_progress


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
    condition: dict[str, float] = {"h": option_quantity("--altitude", altitude, "m")}
    for name, text in (("V", speed), ("V_cas", cas)):
        if text is not None:
            condition[name] = option_quantity(name, text, "m s-1")
    if mach is not None:
        condition["mach"] = mach
    for name, text in further:
        condition[name] = _to_si(name, text)
    with show_progress("compute the characteristics"):
        craft, db = read_aircraft(aircraft), open_database(database)
        result = compute(craft, db, condition)
    if samples:
        with show_progress(f"compute those of {samples} databases drawn from the standard errors"):
            result = with_standard_errors(
                result, craft, db, condition=condition, count=samples, seed=seed
            )
    if not as_json:
        click.echo(result.report())
        if line := describe_bare_numbers(_bare_numbers(speed, cas, altitude, further)):
            click.echo(line)
        return
    document = {
        "title": result.title,
        "condition": result.condition,
        "tables_left": result.tables_left,
        "remarks": result.remarks,
        "characteristics": result.table,
        "modes": result.modes,
        "derivatives": result.derivatives["value"].to_pandas().to_dict(),
    }
    curves = {"trim": result.trim, "polar": result.polar, "performance": result.performance}
    for name, curve in curves.items():
        document[name] = {str(key): curve[key].values for key in curve.variables}
    print_json(document)


def _bare_numbers(
    speed: str | None, cas: str | None, altitude: str, further: tuple[Any, ...]
) -> dict[str, float]:
    """Return the values of the condition that have no unit. [SI]"""
    texts = {"V": speed, "V_cas": cas, "h": altitude, **dict(further)}
    numbers = {name: number_or_text(text) for name, text in texts.items() if text is not None}
    # height zero needs no unit
    return {
        name: number for name, number in numbers.items() if isinstance(number, float) and number
    }


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
    return {name: option_quantity(name, text, "1") for name, text in pairs}


def _to_si(name: str, text: str) -> float:
    """Return the value of a condition. [SI]

    Names of the vocabulary have a unit, parameters of the simulation are bare SI numbers.
    """
    units = VOCABULARY[name].units if name in VOCABULARY else "1"
    return option_quantity(name, text, units)


def run_scheme(coefficient: str | None, as_json: bool) -> None:
    """Perform the command ``scheme``."""
    rows = scheme_texts()
    if coefficient is not None:
        coefficients = dict.fromkeys(name.split("/")[0] for name in rows)
        if coefficient not in coefficients:
            raise UnknownName(coefficient, coefficients, "coefficient")
        rows = {name: row for name, row in rows.items() if name.split("/")[0] == coefficient}
    if as_json:
        print_json([{"term": name, **row} for name, row in rows.items()])
        return
    head = ["term", "K1", "axes", "times", "LR-743", "meaning", "from DATCOM", "identified (4.5)"]
    cells = []
    for name, row in rows.items():
        cells.append([name, *(text or "-" for text in row.values())])
    print_table(head, cells)

"""The verbs ``characteristics`` and ``rescale`` of ``aeromatch db``."""

from __future__ import annotations

from typing import Any

import click

from flightmech.support.console import (
    InputFile,
    NewFile,
    json_option,
    print_json,
    print_table,
    show_progress,
)

_FILE = InputFile()


class Pairs(click.ParamType):
    """NAME=VALUE."""

    name = "NAME=VALUE"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, str]:
        """Return name and text of the value."""
        name, sign, text = str(value).partition("=")
        if not (name.strip() and sign and text.strip()):
            self.fail(f"{value!r} is not NAME=VALUE, such as delta_f='20 deg'", param, ctx)
        return name.strip(), text.strip()


@click.command("characteristics")
@click.argument("database", metavar="DB", type=_FILE)
@click.argument("aircraft", type=_FILE)
@click.option("--speed", help="True airspeed, such as '175 kt' or 90 [m/s].")
@click.option("--cas", help="Calibrated airspeed instead.")
@click.option("--mach", type=float, help="Mach number instead.")
@click.option("--altitude", default="0", show_default=True, help="Height, such as '5000 ft'.")
@click.option(
    "--set",
    "further",
    multiple=True,
    type=Pairs(),
    help="More of the condition: delta_f='20 deg', gear=1, mass=2400, x_cg_b=-0.05 ...",
)
@click.option(
    "--samples",
    type=int,
    default=0,
    help="Draw so many databases from the standard errors of DB, 10 or more; adds standard errors.",
)
@click.option("--seed", type=int, default=1, show_default=True, help="Seed of the random draws.")
@json_option
def characteristics_command(
    database: str,
    aircraft: str,
    speed: str | None,
    cas: str | None,
    mach: float | None,
    altitude: str,
    further: tuple,
    samples: int,
    seed: int,
    as_json: bool,
) -> None:
    """Compute the flying qualities and performance of AIRCRAFT (TOML) with DB (netCDF) at one
    condition.
    """
    from aerodb.store.files import open
    from aerodb.update.standard_errors import with_standard_errors
    from flightmech.aircraft.aircraft import read_aircraft
    from flightmech.flying_qualities.evaluation import characteristics as compute
    from flightmech.units import parse_quantity

    condition: dict[str, float] = {"h": parse_quantity(_number(altitude), "m")}
    condition |= {
        name: parse_quantity(_number(text), "m s-1")
        for name, text in (("V", speed), ("V_cas", cas))
        if text is not None
    }
    condition |= {} if mach is None else {"mach": mach}
    condition |= {name: _si(name, text) for name, text in further}
    with show_progress("compute the characteristics"):
        craft, db = read_aircraft(aircraft), open(database)
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
            "characteristics": found.table,
            "modes": found.modes,
            "derivatives": found.derivatives["value"].to_pandas().to_dict(),
            **{
                name: {str(key): curve[key].values for key in curve.variables}
                for name, curve in curves.items()
            },
        }
    )


@click.command("rescale")
@click.argument("database", metavar="DB", type=_FILE)
@click.argument("aircraft", type=_FILE)
@click.option("--length-ratio", required=True, type=float, help="New length over known length.")
@click.option(
    "--mass-ratio",
    type=float,
    help="New mass over known mass; the cube of the length ratio unless given.",
)
@click.option(
    "--law",
    "laws",
    multiple=True,
    type=Pairs(),
    help="Factor in place of a law: thrust=1.4, inertia=2.1 ...",
)
@click.option(
    "--factor",
    "factors",
    multiple=True,
    type=Pairs(),
    help="Factor on terms: horizontal_tail=1.1, Cm/elevator=0.9 ...",
)
@click.option("--name", default="", help="Name of the new aircraft.")
@click.option("-o", "--output", required=True, type=NewFile(), help="The new database, netCDF-4.")
@click.option(
    "--aircraft-output", required=True, type=NewFile(), help="The new aircraft file, TOML."
)
@json_option
def rescale_command(
    database: str,
    aircraft: str,
    length_ratio: float,
    mass_ratio: float | None,
    laws: tuple,
    factors: tuple,
    name: str,
    output: str,
    aircraft_output: str,
    as_json: bool,
) -> None:
    """Make a similar aircraft and its database from AIRCRAFT (TOML) and DB (netCDF) by the laws of
    similarity.
    """
    import flightmech
    from aerodb.edit.rescaling import rescale as rescaled
    from aerodb.store.files import open, save
    from aerodb.store.overview import summary

    craft = flightmech.aircraft.rescale(
        flightmech.read_aircraft(aircraft), length_ratio, mass_ratio, _numbers(laws), name
    )
    tree = rescaled(open(database), craft, _numbers(factors))
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


def _number(text: str) -> str | float:
    """Return a bare number as one, which is SI; a text with a unit stays."""
    try:
        return float(text)
    except ValueError:
        return text


def _numbers(pairs: tuple) -> dict[str, float]:
    from flightmech.units import parse_quantity

    return {name: parse_quantity(_number(text), "1") for name, text in pairs}


def _si(name: str, text: str) -> float:
    """Return the value of a condition; names of the vocabulary have a unit, parameters of the
    simulation are bare SI numbers.
    """
    from flightmech.names import VOCABULARY
    from flightmech.units import parse_quantity

    units = VOCABULARY[name].units if name in VOCABULARY else "1"
    return parse_quantity(_number(text), units)


@click.command("scheme")
@click.argument("coefficient", required=False)
@json_option
def scheme_command(coefficient: str | None, as_json: bool) -> None:
    """Print the build-up of LR-743, equations (1) to (11): what each term is and where it can come
    from.
    """
    from aerodb.store.templates import scheme_texts
    from flightmech.errors import UnknownName

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

"""The verb ``aeromatch flight ground-effect``: ground effect from landings, low passes and free-air records."""

from __future__ import annotations

from pathlib import Path

import click

from flightmech.support.console import InputFile, NewFile, document, json_option, progress

_MODELS = ("CL = 1 + alpha + qhat + delta_e", "CD = 1 + alpha + alpha**2", "Cm = 1 + alpha + qhat + delta_e")


@click.command("ground-effect")
@click.argument("paths", nargs=-1, required=True, type=InputFile())
@click.option("--aircraft", "aircraft_file", required=True, type=InputFile(), help="Aircraft, TOML.")
@click.option(
    "--model", "models", multiple=True, help="Free-air terms of a coefficient. Default: " + "; ".join(f"'{m}'" for m in _MODELS) + "."
)
@click.option("--ground", multiple=True, help="Terms that the ground may change, as 'CL = 1 + alpha'. Default: all; CL*phi of Cl.")
@click.option("--database", "database_file", type=InputFile(), help="Database whose ground effect takes part in the comparison.")
@click.option("--hold", is_flag=True, help="Hold the free-air terms at the database. Default: they are estimated along.")
@click.option("--cutoff", type=click.FloatRange(0.0, min_open=True), help="Low-pass all states alike first [Hz].")
@click.option("--height", "heights", type=float, multiple=True, help="Height at which K(h) is printed [m].")
@click.option("-o", "--output", type=NewFile(), help="Write the database with the ground effect in it.")
@click.option("--tables", is_flag=True, help="Write K(h) as tables in place of k h^s.")
@json_option
def ground_effect(paths, aircraft_file, models, ground, database_file, hold, cutoff, heights, output, tables, as_json) -> None:
    """Identify k and s of C = C_free (1 + k h^s) from reconstructed PATHS: landings, low passes, and free air at the same flap."""
    import aerodb
    from flightmech import read_aircraft
    from flightmech.errors import SchemaError

    from ...dynamics.force_coefficients import coefficients
    from ...dynamics.saved_paths import open_path
    from ...equation_error.model import Model
    from ...ground_effect.database import replace_ground_effect
    from ...ground_effect.identification import identify_ground_effect

    if (hold or output) and not database_file:
        raise SchemaError("flight ground-effect", ["--hold and -o need a database; give --database"])
    aircraft = read_aircraft(aircraft_file)
    database = aerodb.open(database_file) if database_file else None
    with progress(f"coefficients along {len(paths)} paths"):
        data = [coefficients(open_path(path), aircraft, cutoff=cutoff) for path in paths]
    changed = {model.coefficient: model.terms for model in map(Model.parse, ground)}
    names = [Path(path).name for path in paths]
    with progress("identify the ground effect"):
        found = identify_ground_effect([Model.parse(text) for text in models or _MODELS], data, changed, database, hold, names)
    if output and database is not None:
        aerodb.save(replace_ground_effect(database, found, tables), output)
    if as_json:
        document({**_as_dict(found), "file": output})
        return
    click.echo(found.report(heights))
    if output:
        click.echo(f"written: {output}")


def _as_dict(found) -> dict:
    """The result as a document."""
    return {
        "held": found.held,
        "not_identified": found.not_identified,
        "coefficients": {
            name: {
                "form": one.form,
                "heights": one.heights,
                "terms": [row._asdict() for row in one.rows()],
                "evidence": one.evidence.to_dict("index"),
            }
            for name, one in found.coefficients.items()
        },
    }

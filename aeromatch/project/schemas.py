"""JSON schemas of the files of a project, for editors that complete and check the keys."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from aeromatch.project.project import project_schema
from flightmech.aircraft.aircraft_file import aircraft_schema as without_instruments
from flightmech.support.atomic_write import write_text
from flightmech.support.console import json_option, print_json
from flightmech.support.toml_models import part_schema, schema_text
from flighttest.records.readers.name_map_file import name_map_schema
from flighttest.records.sensors.instruments import Instrument
from flighttest.submodels.engine.tables import structure_schema
from pom.cases.case_file import case_schema


def schema_with_instruments() -> dict[str, Any]:
    """Return the JSON schema of aircraft files, with the schema of their instruments."""
    schema = without_instruments()
    schema["$defs"]["Instrument"] = part_schema(Instrument)
    schema["properties"]["instruments"]["additionalProperties"] = {"$ref": "#/$defs/Instrument"}
    return schema


SCHEMAS: dict[str, Callable[[], dict[str, Any]]] = {
    "project": project_schema,
    "aircraft": schema_with_instruments,
    "names": name_map_schema,
    "case": case_schema,
    "engine": structure_schema,
}
"""Schema by kind of file: aeromatch.toml, aircraft.toml, names.toml, cases, and the file of the key
``structure`` of ``[engine]``.
"""


def schema_lines(kind: str) -> list[str]:
    """Return the first lines of a file, by which editors find its schema."""
    file = f"{kind}.schema.json"
    return [
        f"#:schema {file}",
        f"# `aeromatch schema {kind}` writes {file}; an editor that knows it completes and "
        f"checks the keys.",
        "",
    ]


@click.command("schema")
@click.argument("kind", required=False, type=click.Choice(list(SCHEMAS)))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="File, or without KIND a folder.  [default: KIND.schema.json]",
)
@json_option
def schema(kind: str | None, output: Path | None, as_json: bool) -> None:
    """Write the JSON schema of the files of a KIND, or of all kinds, for an editor that completes
    and checks the keys.

    The first line of a file names its schema: #:schema aircraft.schema.json
    """

    if kind:
        files = {output or Path(f"{kind}.schema.json"): kind}
    else:
        folder = output or Path()
        folder.mkdir(parents=True, exist_ok=True)
        files = {folder / f"{name}.schema.json": name for name in SCHEMAS}
    for file, name in files.items():
        write_text(file, schema_text(SCHEMAS[name]()))
        if not as_json:
            click.echo(f"written: {file}")
    if as_json:
        print_json({"files": [str(file) for file in files]})

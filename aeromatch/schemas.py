"""``aeromatch schema``: the JSON schemas of the files of a project, for editors."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from flightmech.support.console import document, json_option


def aircraft_schema() -> dict[str, Any]:
    """Return the JSON schema of aircraft files, with that of their instruments."""
    from flightmech.aircraft import aircraft_schema as without_instruments
    from flightmech.support.configuration import part_schema
    from flighttest.sensors.instruments import Instrument

    schema = without_instruments()
    schema["$defs"]["Instrument"] = part_schema(Instrument)
    schema["properties"]["instruments"]["additionalProperties"] = {"$ref": "#/$defs/Instrument"}
    return schema


def _names() -> dict[str, Any]:
    from flighttest.readers import name_map_schema

    return name_map_schema()


def _project() -> dict[str, Any]:
    from .project import project_schema

    return project_schema()


def _engine() -> dict[str, Any]:
    from flighttest.engine import structure_schema

    return structure_schema()


def _case() -> dict[str, Any]:
    from pom.cases import case_schema

    return case_schema()


SCHEMAS: dict[str, Callable[[], dict[str, Any]]] = {
    "project": _project,
    "aircraft": aircraft_schema,
    "names": _names,
    "case": _case,
    "engine": _engine,
}
"""By kind of file: aeromatch.toml, aircraft.toml, names.toml, cases, and the key ``structure`` of ``[engine]``."""


def schema_lines(kind: str) -> list[str]:
    """Return the first lines of a file of a kind, by which editors find its schema."""
    file = f"{kind}.schema.json"
    return [f"#:schema {file}", f"# `aeromatch schema {kind}` writes {file}; an editor that knows it completes and checks the keys.", ""]


@click.command()
@click.argument("kind", required=False, type=click.Choice(list(SCHEMAS)))
@click.option("-o", "--output", type=click.Path(path_type=Path), help="File, or without KIND a folder.  [default: KIND.schema.json]")
@json_option
def schema(kind: str | None, output: Path | None, as_json: bool) -> None:
    """Write the JSON schema of the files of a KIND, or of all kinds, for an editor that completes and checks the keys.

    The first line of a file names its schema: #:schema aircraft.schema.json
    """
    from flightmech.support.atomic_write import write_text
    from flightmech.support.configuration import schema_text

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
        document({"files": [str(file) for file in files]})

"""Function that performs the command ``db envelope``."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import click

from aerodb.store.files import open as open_database
from flightmech.envelope.envelope import make_envelope
from flightmech.envelope.maps import (
    MARKS,
    RegionMap,
    configuration_text,
    everywhere_text,
    map_rows,
    region_maps,
    standalone_svg,
)
from flightmech.envelope.regions import REGIONS
from flightmech.errors import SchemaError
from flightmech.support.atomic_write import write_text
from flightmech.support.console import print_json, show_progress


def run_envelope(database: str, output: str | None, as_json: bool) -> None:
    """Perform the command ``envelope``."""
    kind = Path(output).suffix.lower() if output else ""
    if output and kind not in (".svg", ".csv"):
        raise SchemaError("envelope", [f"{output}: ending {kind!r}; give .svg or .csv"])
    with show_progress("find the regions of the nodes and of the flown states"):
        maps = region_maps(make_envelope(open_database(database)))
    if output:
        text = standalone_svg(maps) if kind == ".svg" else _csv_text(map_rows(maps))
        write_text(output, text)
    if as_json:
        print_json({"file": output, "maps": [_describe(region_map) for region_map in maps]})
        return
    for region_map in maps:
        click.echo(f"{region_map.report()}\n")
    listed = ", ".join(f"{mark} {word}" for mark, word in zip(MARKS, REGIONS, strict=True))
    click.echo(listed)
    everywhere = everywhere_text(maps[0].everywhere if maps else ())
    if everywhere:
        click.echo(everywhere)
    if output:
        click.echo(f"written: {output}")


def _describe(region_map: RegionMap) -> dict[str, Any]:
    """Return configuration, plane and shares of the regions of a map."""
    shares = {}
    for code, word in enumerate(REGIONS):
        shares[word] = float((region_map.regions == code).mean())
    return {
        "configuration": region_map.configuration,
        "words": configuration_text(region_map.configuration),
        "plane": list(region_map.plane),
        "held": region_map.held,
        "shares": shares,
        "everywhere": list(region_map.everywhere),
    }


def _csv_text(rows: list[dict[str, Any]]) -> str:
    """Return rows as CSV with a head; angles in rad."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()

"""Functions that perform the commands of `aeromatch.cli.store`."""

from __future__ import annotations

import click

from flightmech.errors import SchemaError
from flightmech.support.console import print_json, print_remark, print_table
from flightmech.support.kept_stages.store import (
    PLACE,
    StageStore,
    bytes_of,
    size_limit,
    store_folder,
)

_MEGABYTE = 1e6


def store_info(as_json: bool) -> None:
    """Perform the command ``info``."""
    place, limit = _place(), size_limit()
    usage = place.usage()
    total = sum(size for _, size in usage.values())
    if as_json:
        stages = {name: {"count": count, "bytes": size} for name, (count, size) in usage.items()}
        print_json(
            {"folder": str(place.folder), "bytes": total, "limit": int(limit), "stages": stages}
        )
        return
    rows = [
        (name.replace("_", " "), count, f"{size / _MEGABYTE:.1f}")
        for name, (count, size) in usage.items()
    ]
    print_table(("stage", "results", "MB"), rows, title=f"Store in {place.folder}")
    click.echo(f"{total / _MEGABYTE:.1f} MB of at most {limit / _MEGABYTE:.0f} MB")


def run_clear(size: str | None) -> None:
    """Perform the command ``clear``."""
    place = _place()
    if size is not None:
        place.shorten(bytes_of(size))
    else:
        place.clear()
    left = sum(one for _, one in place.usage().values())
    print_remark(f"{left / _MEGABYTE:.1f} MB left in {place.folder}")


def _place() -> StageStore:
    folder = store_folder()
    if folder is None:
        raise SchemaError(
            PLACE, ["the store is switched off; name a folder, or remove the variable"]
        )
    return StageStore(folder)

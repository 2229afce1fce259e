"""``aeromatch store``: what ``match`` keeps of its stages."""

from __future__ import annotations

import click

from flightmech.errors import SchemaError
from flightmech.support.console import json_option, print_json, print_remark, print_table
from flightmech.support.kept_stages.store import (
    PLACE,
    StageStore,
    bytes_of,
    size_limit,
    store_folder,
)

_MEGABYTE = 1e6


@click.group("store")
def store() -> None:
    """Show or clear the store, which keeps the results of the stages of `match`.

    It lies in the user's cache, or where AEROMATCH_STORE states; AEROMATCH_STORE=off switches it
    off, AEROMATCH_STORE_LIMIT is its size.
    """


@store.command("info")
@json_option
def store_info_command(as_json: bool) -> None:
    """Show where the store lies and what it holds, by stage."""
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


@store.command("clear")
@click.option(
    "--to",
    "size",
    metavar="SIZE",
    help="Keep what was used last, up to this size, such as 500MB; without it nothing.",
)
def clear_command(size: str | None) -> None:
    """Clear the store; the next match computes what is gone."""
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

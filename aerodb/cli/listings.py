"""Listings on the command line: a file, or one case of it as FILE:CASE."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from datcom_io.reading import Place

    from ..prior.roles import Assignment


class ListingPath(click.ParamType):
    """FILE, or FILE:CASE for one case of a listing that holds several."""

    name = "FILE[:CASE]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Place:
        """Return file and case, empty for all cases."""
        from datcom_io.reading import place_of

        try:
            return place_of(str(value))
        except FileNotFoundError as error:
            self.fail(f"{value!r}: {error.strerror}", param, ctx)


def aircraft_and_places(aircraft: str, places: tuple[str, ...]) -> tuple[Path, tuple[str, ...]]:
    """Return the aircraft file and the places of the listings; a folder stands for its ``aircraft.toml`` and its listings."""
    if not Path(aircraft).is_dir():
        return Path(aircraft), places
    file = Path(aircraft) / "aircraft.toml"
    if not file.is_file():
        raise click.UsageError(f"no aircraft.toml in the folder {aircraft}; write it, or give the aircraft file first and then the folder")
    return file, (aircraft, *places)


def read_all(places: Iterable[str]) -> list[Any]:
    """Return the listings and cases of places, of folders every listing in them."""
    from datcom_io import read
    from datcom_io.reading import listings_in, read_place

    return [item for place in places for item in (map(read, listings_in(place)) if Path(place).is_dir() else [read_place(place)])]


def role_rows(assigned: Iterable[Assignment], given: Collection[str]) -> list[tuple[str, str, str, str, str]]:
    """Return file, number and name of each case, its roles less those that are given by options, and why."""
    rows = []
    for item in assigned:
        roles = [f"{role} (given otherwise)" if role in given else role for role in item.roles]
        rows.append((item.case.file, str(item.case.ordinal), item.case.name, ", ".join(roles) or "-", item.reason))
    return rows

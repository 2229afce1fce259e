"""Listings on the command line: a file, or one case of it as FILE:CASE."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from datcom_io.reading import Place


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

"""Listings on the command line: a file, or one case of it as FILE:CASE."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click


class ListingPath(click.ParamType):
    """FILE, or FILE:CASE for one case of a listing that holds several."""

    name = "FILE[:CASE]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, str]:
        """Return file and case, empty for all cases."""
        text = str(value)
        if Path(text).is_file():
            return text, ""
        file, colon, case = text.rpartition(":")
        if not (colon and Path(file).is_file()):
            self.fail(f"there is no file {text!r}; write FILE, or FILE:CASE for one case of it", param, ctx)
        return file, case


def read(place: tuple[str, str]) -> Any:
    """Return a listing, or one case of it."""
    import datcom_io

    file, case = place
    listing = datcom_io.read(file)
    return listing[case] if case else listing

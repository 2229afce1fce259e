"""Options that verbs of ``aeromatch flight`` share."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import click

_MAPS = Path(__file__).parents[1] / "readers" / "maps"


class MapFile(click.Path):
    """A name map: a TOML file that is there, or the name of a shipped one."""

    def __init__(self) -> None:
        super().__init__(exists=True, dir_okay=False)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the name of a shipped map as it is."""
        shipped = sorted(file.stem for file in _MAPS.glob("*.toml"))
        if value in shipped and not os.path.exists(value):
            return value
        if not os.path.exists(value) and not str(value).endswith(".toml"):
            self.fail(f"no file {value!r} and no shipped map of that name; shipped are {', '.join(shipped)}", param, ctx)
        return super().convert(value, param, ctx)


names_option = click.option(
    "--names", type=MapFile(), help="Name map: a TOML file, or a shipped one (px4, ardupilot); not needed for canonical names."
)

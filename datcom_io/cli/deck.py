"""``aeromatch datcom deck | check | draw | split | run``: work with input decks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from flightmech.support import console
from flightmech.support.console import performed_by

_DECK = click.argument("deck", type=console.InputFile())
_FOLDER = click.Path(file_okay=False)


class _DeckOrFolder(console.InputFile):
    """An input deck, or a folder of them."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the name when the file or folder is there."""
        return str(value) if Path(value).is_dir() else super().convert(value, param, ctx)


@click.command("deck")
@_DECK
@click.option(
    "-o",
    "--output",
    type=console.NewFile(),
    help="Deck to write as the program reads it: upper case, 80 columns.",
)
@click.option("--resolved", is_flag=True, help="Every case complete, without SAVE.")
@console.json_option
@performed_by("datcom_io.cli.actions.deck:show_deck")
def show_deck_command() -> None:
    """Show the cases of an input deck (unit 5, plain or DATCOM+); with -o write it again."""


@click.command("check")
@_DECK
@console.json_option
@click.pass_context
@performed_by("datcom_io.cli.actions.deck:run_check_deck")
def check_deck_command() -> None:
    """Report what the program would reject in an input deck; exit code 1 when there are errors."""


@click.command("draw")
@_DECK
@click.option(
    "-o", "--output", required=True, type=console.NewFile(), help="SVG file of the drawing."
)
@click.option(
    "--case", "number", type=click.IntRange(min=1), help="Case, from 1; default: the first drawn."
)
@console.json_option
@performed_by("datcom_io.cli.actions.drawing:run_draw_deck")
def draw_deck_command() -> None:
    """Draw the aeroplane of an input deck in three views (SVG).

    Body, surfaces, controls, engines and centre of gravity are drawn from the cards. What the deck
    does not define, and dimensions that are probably errors, are named below the views.
    """


@click.command("split")
@click.argument("study", type=console.InputFile())
@click.option(
    "-o",
    "--output",
    "folder",
    required=True,
    type=_FOLDER,
    help="Folder for the run decks; made when missing.",
)
@console.json_option
@performed_by("datcom_io.cli.actions.deck:run_split")
def split_command() -> None:
    """Split a study into run decks: clean, flaps, elevator, aileron, ground.

    STUDY is a deck of one case with all devices of the aircraft, or a TOML file that names one and
    plans the runs.
    """


@click.command("run")
@click.argument("deck", type=_DeckOrFolder())
@click.option("--program", required=True, type=click.Path(), help="Your Digital DATCOM executable.")
@click.option(
    "-o",
    "--output",
    "folder",
    type=_FOLDER,
    help="Folder for the results; default: the folder of the deck.",
)
@click.option(
    "--timeout",
    type=click.FloatRange(min=0, min_open=True),
    default=600.0,
    show_default=True,
    help="Longest time of a run. [s]",
)
@console.json_option
@click.pass_context
@performed_by("datcom_io.cli.actions.deck:run_run_deck")
def run_deck_command() -> None:
    """Run a deck, or all decks of a folder, with your Digital DATCOM program and collect the files.

    Exit code 1 when the program left out a case or a run failed.
    """


VERBS = (
    show_deck_command,
    check_deck_command,
    draw_deck_command,
    split_command,
    run_deck_command,
)

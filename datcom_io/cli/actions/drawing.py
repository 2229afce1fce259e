"""Function that performs the command ``draw`` of `datcom_io.cli.deck`."""

from __future__ import annotations

import click

from datcom_io.decks.deck_file import DeckFile, read_deck
from datcom_io.drawings.deck_shape import shape_of_deck
from datcom_io.drawings.doubts import doubts_of_deck
from datcom_io.drawings.three_view import draw_deck
from flightmech.errors import SchemaError
from flightmech.support import console
from flightmech.support.atomic_write import write_text


def run_draw_deck(deck: str, output: str, number: int | None, as_json: bool) -> None:
    """Perform the command ``draw``."""
    cases = read_deck(deck)
    chosen = _choose(cases, number)
    case = cases[chosen - 1]
    svg = draw_deck(case, case.caseid)
    shape = shape_of_deck(case)
    doubts = doubts_of_deck(case, shape)
    write_text(output, svg)
    if as_json:
        console.print_json(
            {
                "file": output,
                "case": chosen,
                "cases": len(cases),
                "unit": case.dim,
                "parts": list(shape.parts),
                "doubts": doubts,
                "omissions": list(shape.omissions),
            }
        )
        return
    click.echo(f"case {chosen} of {len(cases)}: {case.caseid or 'without CASEID'}, DIM {case.dim}")
    for text in shape.parts:
        click.echo(f"  {text}")
    for text in doubts:
        console.print_remark(f"check: {text}")
    for text in shape.omissions:
        console.print_remark(f"not in the deck: {text}")
    click.echo(f"written: {output}")


def _choose(cases: DeckFile, number: int | None) -> int:
    """Return the number of the case to draw, by default the first with outlines."""
    if number is not None:
        if number > len(cases):
            raise click.UsageError(f"--case {number}: {cases.file} has {len(cases)} cases")
        return number
    if not len(cases):
        raise SchemaError("deck", [f"{cases.file} has no case"])
    for position, case in enumerate(cases, 1):
        if shape_of_deck(case).outlines:
            return position
    return 1

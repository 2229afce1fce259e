"""Control tabs (CONTAB with SYMFLP): tables printed as one stream of values.

The heading shows alpha and delta, but the values follow each other in one stream: alpha in the
outer loop, delta in the inner loop, eleven values on a line.  The first value of a line has the
columns of alpha and one decimal only.  The program does not print alpha.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from datcom_io.printout.layouts.devices import heading_values
from datcom_io.printout.rows import HeadingAxis, Line, PrintedColumn
from datcom_io.printout.tables import (
    Printed,
    PrintedBlock,
    TableLayout,
    next_text_line,
    read_printed_table,
)

if TYPE_CHECKING:
    from datcom_io.decks.deck import Deck
    from datcom_io.printout.tables import PrintedTable

PER_LINE = 11
"""Values on one line of a stream; the first of them has one decimal."""

_DELTA = HeadingAxis("DELTA", "delta", first=16, last=22, cell=PrintedColumn("", 15, 24), step=10)
_FREE_MEANING = "hinge-moment coefficient of the flap, tab free"
_LOCKED_MEANING = "hinge-moment coefficient of the flap, tab locked"
_GEARING_MEANING = "hinge-moment coefficient of the flap due to the gearing of the tab"
_FORCE_MEANING = (
    "stick force as printed; the program divides by qbar S cbar where it ought to multiply"
)


def stream_axes(deck: Deck, table: PrintedTable) -> Mapping[str, np.ndarray]:
    """Return alpha and delta (row, column) of a stream by the input cards. [deg]

    The axes are NaN behind the end of the stream.  Without cards the mapping is empty.
    """
    alphas = deck.schedule("FLTCON", "ALSCHD", "NALPHA")
    deltas = deck.schedule("SYMFLP", "DELTA", "NDELTA")
    # Alpha is the outer loop of the stream, delta the inner one.
    count = len(alphas) * len(deltas)
    shape = (len(table.rows), len(table.columns))
    if not 0 < count <= shape[0] * shape[1]:
        return {}
    axes = {"alpha": np.full(shape, np.nan), "delta": np.full(shape, np.nan)}
    axes["alpha"].flat[:count] = np.repeat(alphas, len(deltas))
    axes["delta"].flat[:count] = np.tile(deltas, len(alphas))
    return axes


def _stream_layout(
    name: str, heading: str, quantity: str, *, units: str = "1", meaning: str
) -> TableLayout:
    """Return the layout of a stream: one field of F5.1, then ten fields of E9.2 on each line."""
    first = PrintedColumn(heading, 2, 9, quantity, units, meaning=meaning)
    columns = [first]
    for k in range(PER_LINE - 1):
        columns.append(first._replace(first=15 + 10 * k, last=24 + 10 * k))
    return TableLayout(
        name,
        "",
        tuple(columns),
        keys=0,
        axes=stream_axes,
        stream=(("FLTCON", "NALPHA"), ("SYMFLP", "NDELTA")),
    )


# Tables of the two or three control-tab pages.  The program prints the stick force or its
# coefficient, and no trim-tab table for TTYPE 1.
LAYOUTS = (
    _stream_layout(
        "tab_force", "STICK FORCE, F(C), LB", "F_stick", units="lbf", meaning=_FORCE_MEANING
    ),
    _stream_layout(
        "tab_force_coefficient",
        "STICK FORCE COEFFICIENT, CF(C)",
        "CF_stick",
        meaning="stick-force coefficient",
    ),
    _stream_layout(
        "tab_free", "FLAP HINGE MOMENT COEFFICIENT - TAB FREE", "Ch_tab_free", meaning=_FREE_MEANING
    ),
    _stream_layout(
        "tab_locked",
        "FLAP HINGE MOMENT COEFFICIENT - TAB LOCKED",
        "Ch_tab_locked",
        meaning=_LOCKED_MEANING,
    ),
    _stream_layout(
        "tab_gearing",
        "FLAP HINGE MOMENT COEFFICIENT - DUE TO GEARING",
        "Ch_tab_gearing",
        meaning=_GEARING_MEANING,
    ),
    _stream_layout(
        "tab_trim",
        "TRIM TAB DEFLECTION FOR ZERO STICK FORCE, DEG.",
        "delta_tab_trim",
        units="deg",
        meaning="deflection of the trim tab for zero stick force",
    ),
)


def _read_stream(
    layout: TableLayout, lines: list[Line], opening: int
) -> tuple[list[Printed], int] | None:
    """Read the deflections of the heading and the stream below them."""
    heading = next_text_line(lines, opening + 1)
    if heading == len(lines):
        return None
    deltas = heading_values(layout.name, _DELTA, lines[heading])
    if deltas is None:
        return None
    table, after = read_printed_table(layout, lines, heading + 1)
    if table is None:
        return None
    return [deltas, table], after


def _stream_block(layout: TableLayout) -> PrintedBlock:
    opens = re.compile("^" + re.escape(layout.columns[0].name))
    return PrintedBlock((layout.name,), ("high-lift",), opens, partial(_read_stream, layout))


BLOCKS = tuple(map(_stream_block, LAYOUTS))

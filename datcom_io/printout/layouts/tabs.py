"""Control tabs: five tables whose heading promises alpha x delta, while the values run on as one
stream.

The stream has alpha outside and delta inside, eleven values to a line.  The first value of a line
stands in the place of alpha and has one decimal only; no alpha is printed anywhere.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from datcom_io.printout.layouts.devices import heading_values
from datcom_io.printout.rows import Across, Line, PrintedColumn
from datcom_io.printout.tables import Printed, PrintedBlock, TableLayout, read_printed_table

if TYPE_CHECKING:
    from datcom_io.decks.deck import Deck
    from datcom_io.printout.tables import PrintedTable

PER_LINE = 11
"""Values on one line of a stream; the first of them has one decimal."""

_DELTA = Across("DELTA", "delta", 16, 22, PrintedColumn("", 15, 24), 10)
_TABLES = (
    ("tab_force", "STICK FORCE, F(C), LB", "F_stick", "lbf"),
    ("tab_force_coefficient", "STICK FORCE COEFFICIENT, CF(C)", "CF_stick", "1"),
    ("tab_free", "FLAP HINGE MOMENT COEFFICIENT - TAB FREE", "Ch_tab_free", "1"),
    ("tab_locked", "FLAP HINGE MOMENT COEFFICIENT - TAB LOCKED", "Ch_tab_locked", "1"),
    ("tab_gearing", "FLAP HINGE MOMENT COEFFICIENT - DUE TO GEARING", "Ch_tab_gearing", "1"),
    ("tab_trim", "TRIM TAB DEFLECTION FOR ZERO STICK FORCE, DEG.", "delta_tab_trim", "deg"),
)


def stream_axes(deck: Deck, table: PrintedTable) -> Mapping[str, np.ndarray]:
    """Return alpha and delta (row, column) of a stream by the input cards, NaN behind its end;
    nothing without cards. [deg]
    """
    alphas = deck.schedule("FLTCON", "ALSCHD", "NALPHA")
    deltas = deck.schedule("SYMFLP", "DELTA", "NDELTA")
    count, shape = len(alphas) * len(deltas), (len(table.rows), len(table.columns))
    if not 0 < count <= shape[0] * shape[1]:
        return {}
    axes = {}
    for name, values in (
        ("alpha", np.repeat(alphas, len(deltas))),
        ("delta", np.tile(deltas, len(alphas))),
    ):
        axes[name] = np.full(shape, np.nan)
        axes[name].flat[:count] = values
    return axes


def _layout(name: str, words: str, quantity: str, units: str) -> TableLayout:
    windows = [(2, 9), *((15 + 10 * k, 24 + 10 * k) for k in range(PER_LINE - 1))]
    return TableLayout(
        name,
        "",
        tuple(PrintedColumn(words, first, last, quantity, units) for first, last in windows),
        keys=0,
        axes=stream_axes,
        stream=(("FLTCON", "NALPHA"), ("SYMFLP", "NDELTA")),
    )


LAYOUTS = tuple(_layout(*table) for table in _TABLES)


def _read_stream(
    layout: TableLayout, lines: list[Line], at: int
) -> tuple[list[Printed], int] | None:
    """Read the deflections of the heading and the stream below them."""
    heading = next((i for i in range(at + 1, len(lines)) if lines[i][1][1:].strip()), at)
    deltas = heading_values(layout.name, _DELTA, lines[heading])
    if deltas is None:
        return None
    table, after = read_printed_table(layout, lines, heading + 1)
    return None if table is None else ([deltas, table], after)


BLOCKS = tuple(
    PrintedBlock(
        (layout.name,),
        ("high-lift",),
        re.compile("^" + re.escape(layout.columns[0].name)),
        partial(_read_stream, layout),
    )
    for layout in LAYOUTS
)

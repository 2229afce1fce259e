"""The forms in which the program prints numbers: columns, two-way tables, and blocks with a reader of their own.

Columns are 1-based and count the carriage-control column.  The windows are wider than the printed numbers, because
a word (``NDM``, ``NA``) starts up to four columns after the left edge of its field.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import numpy as np

    from ..decks.deck import Deck
    from ..tables import Printed, Table


class Column(NamedTuple):
    """One printed column.

    ``units`` is that of the print: ``deg``, ``1``, ``1/deg``, or ``1/angle`` where card DERIV decides between degree and
    radian.  ``house`` is the name in the DataTree.  ``constant`` marks a column whose first row may hold for all rows.
    ``words`` marks a column of words: every cell is ``ok`` with a text and no number.
    """

    name: str
    first: int
    last: int
    house: str = ""
    units: str = "1"
    constant: bool = False
    words: bool = False


class Across(NamedTuple):
    """The second axis of a two-way table: its values stand in a heading line, one value column under each.

    ``first`` and ``last`` bound the first heading value, ``cell`` the first value column; both repeat every ``step`` columns.
    """

    name: str
    house: str
    first: int
    last: int
    cell: Column
    step: int


class Layout(NamedTuple):
    """One kind of table with one row per line.

    ``heading`` holds the words of the line that opens it, with single blanks and without dashes; it is empty for a table that a
    `Block` finds.  The first ``keys`` columns are the row's axes.  ``rows`` names the namelist variable that tells how many rows there
    must be, None where the print decides; ``stops`` are the words of a note that lets the table end earlier.  ``stream`` names the
    variables whose product is the number of values of a table printed as one stream of numbers, and ``axes`` returns axis values
    (row, column) by house name where they are not printed.
    """

    name: str
    heading: str
    columns: tuple[Column, ...]
    keys: int
    rows: tuple[str, str] | None = None
    across: Across | None = None
    axes: Callable[[Deck, Table], Mapping[str, np.ndarray]] | None = None
    stops: str = ""
    stream: tuple[tuple[str, str], ...] = ()


Line = tuple[int, str]


class Block(NamedTuple):
    """Lines of a page that no heading with one row per line below it describes.

    ``opens`` is searched in the line that opens the block, as `heading_words` gives it, on pages of the kinds ``pages``.
    ``read(lines, at)`` gets the lines of the page and the index of the opening line; it returns what it found and the index
    of the line after it, or None when the lines are not what they seemed.  ``names`` are the kinds of table it may return.
    """

    names: tuple[str, ...]
    pages: tuple[str, ...]
    opens: re.Pattern[str]
    read: Callable[[list[Line], int], tuple[list[Printed], int] | None]


_DASHES = re.compile("-{2,}")
_LONGEST_LINE = 160  # of the program; longer ones are not worth remembering


def heading_words(line: str) -> str:
    """Return a heading line as `Layout.heading` holds it."""
    return _known_words(line) if len(line) <= _LONGEST_LINE else _words(line)


def _words(line: str) -> str:
    return " ".join(_DASHES.sub(" ", line[1:]).split())


_known_words = lru_cache(4096)(_words)

"""The forms in which the program prints numbers: columns, two-way tables, and blocks with a reader of their own.

Columns are 1-based and count the carriage-control column.  The windows are wider than the printed numbers, because
a word (``NDM``, ``NA``) starts up to four columns after the left edge of its field.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

from .columns import Line

if TYPE_CHECKING:
    from .tables import Printed


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

"""Lines of a print file: reading in blocks, carriage control, and the lines that open a part."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import islice
from typing import TextIO

from flightmech.support.input_files import demand_regular, marked_encoding

ANCHORS = {
    "CONERR - INPUT ERROR CHECKING": "run",
    "THE FOLLOWING IS A LIST OF ALL INPUT CARDS FOR THIS CASE": "case",
    "AUTOMATED STABILITY AND CONTROL METHODS": "page",
    "THE FOLLOWING IS A LIST OF FINAL INPUTS": "page",
    "EXTRAPOLATION MESSAGE SUMMARY": "page",
    "**** FOLLOWING ARE THE": "dump",
    "**** THE FOLLOWING ARE": "dump",
    "END OF JOB.": "end",
}
"""First words of the lines that open a part of the print, and the part."""
_STARTS = tuple(ANCHORS)
# Lines of some builds between the tables: " At 1000", " Return to main program from M02O02".
_PROGRESS = re.compile(
    r" ?(?:Return to main program from|Preparing to start the big loop|At \d+\s*$)"
)
ARRAY_DUMP = re.compile(r" +[A-Z][A-Z0-9]* *\( *\d+\)=")
# One pattern for all lines that need a closer look: a new page, an anchor, a dump, progress.
_BOUNDARY = re.compile(
    r"1|[^1] *+(?=[A-Z*])(?:[A-Z][A-Z0-9]* *\( *\d+\)=|Return to|Preparing|At |"
    + "|".join(map(re.escape, _STARTS))
    + ")|Return to|Preparing|At "
)
_BLOCK_CHARACTERS = 1 << 18
_BLOCK_LINES = 4096
_LONGEST_LINE = 160  # of the program; longer ones are not worth remembering
_TRAILING = "\r\n\x1a "


def line_blocks(source: str | os.PathLike[str] | Iterable[str]) -> Iterator[list[str]]:
    """Yield the lines of a file or of an iterable in blocks, without their ends.

    Only a line feed ends a line; in a file without one, a carriage return does.  Bytes are read as
    ISO 8859-1, so that any byte in a CASEID survives.  A byte-order mark is dropped, and that of
    UTF-16, as PowerShell writes it, or UTF-32 is obeyed.  Tabs are expanded to every eighth column.
    """
    if isinstance(source, str | os.PathLike):
        yield from _file_blocks(source)
        return
    # Lines of an iterable may come without their ends.
    lines = iter(source)
    is_first = True
    while True:
        block = list(map(str, islice(lines, _BLOCK_LINES)))
        if not block:
            return
        if is_first:
            block[0] = block[0].removeprefix("\ufeff")
            is_first = False
        yield _strip_ends(block, "".join(block))


def _file_blocks(path: str | os.PathLike[str]) -> Iterator[list[str]]:
    demand_regular(path, "a print file (unit 6, for006.dat)")
    with open(path, "rb") as stream:
        head = stream.read(_BLOCK_CHARACTERS)
    encoding, skip = marked_encoding(head)
    if encoding in ("", "utf-8"):
        encoding = "latin-1"
    else:
        # The decoder turns the mark of UTF-16 or UTF-32 into one character.
        skip = 1
    # newline=None makes a lone carriage return end a line.
    newline = None
    if b"\n" in head or b"\r" not in head:
        newline = "\n"
    with open(path, encoding=encoding, errors="replace", newline=newline) as text:
        text.read(skip)
        yield from _text_blocks(text)


def _text_blocks(stream: TextIO) -> Iterator[list[str]]:
    """Yield the lines of a text in blocks; a line may reach over several reads."""
    pieces: list[str] = []  # of a line whose end has not come yet
    while True:
        block = stream.read(_BLOCK_CHARACTERS)
        if not block:
            break
        pieces.append(block)
        if "\n" in block:
            text = "".join(pieces)
            *lines, remainder = text.split("\n")
            pieces = [remainder]
            yield _strip_ends(lines, text)
    last_line = "".join(pieces)
    if last_line:
        yield _strip_ends([last_line], last_line)


def _strip_ends(lines: list[str], text: str) -> list[str]:
    """Return lines without their ends; `text` is all of them."""
    if "\x1a" in text:
        lines = [line.lstrip("\x1a") for line in lines]
    if "\t" in text:
        lines = [line.expandtabs() for line in lines]
    return [line.rstrip(_TRAILING) for line in lines]


def anchor_kind(line: str) -> str:
    """Return which part of the print a line opens: ``run case page dump end``, or an empty text."""
    if len(line) <= _LONGEST_LINE:
        return _cached_anchor(line)
    return _find_anchor(line)


def _find_anchor(line: str) -> str:
    # Anchors are printed at several indents.
    text = line[1:].lstrip()
    if not text.startswith(_STARTS):
        return ""
    return next(kind for start, kind in ANCHORS.items() if text.startswith(start))


_cached_anchor = lru_cache(1024)(_find_anchor)


def boundary_lines(lines: list[str]) -> list[int]:
    """Return the indices of lines that may open or close a part of the print, or belong to none."""
    match = _BOUNDARY.match
    return [i for i, line in enumerate(lines) if match(line)]


def is_progress(line: str) -> bool:
    """Return whether a line is one of the progress lines that some builds print between tables."""
    return _PROGRESS.match(line) is not None


class ControlColumn:
    """Puts column 1 back where a printer filter took it away.

    The first line of the print proper decides: with control column it starts with ``1``.  The first
    line of every further program run in the file decides again.  A banner before the first run is
    passed on as it is.
    """

    def __init__(self) -> None:
        self.missing: bool | None = None

    def restore(self, lines: list[str]) -> list[str]:
        """Return the lines of a block with column 1; none of them is empty."""
        restored: list[str] = []
        indices: Iterable[int] = range(len(lines))
        if self.missing is not None:
            indices = [i for i, line in enumerate(lines) if "CONERR" in line]
        for i in indices:
            if self.missing is not None and "CONERR" not in lines[i]:
                continue
            missing = self._is_missing(lines[i].lstrip("\f"))
            if missing is not None:
                # The lines before this one still belong to the run before.
                restored += self._with_column(lines[len(restored) : i])
                self.missing = missing
        return restored + self._with_column(lines[len(restored) :])

    @staticmethod
    def _is_missing(line: str) -> bool | None:
        """Return whether an anchor line lacks column 1, None for any other line."""
        if line.startswith("1") and anchor_kind(line):
            return False
        if anchor_kind(" " + line):
            return True
        return None

    def _with_column(self, lines: list[str]) -> list[str]:
        if self.missing:
            return [_add_control(line) for line in lines]
        return [line.lstrip("\f") or " " for line in lines]


def _add_control(line: str) -> str:
    """Return a line with a control column: 1 behind a form feed and for an anchor, else blank."""
    text = line.lstrip("\f")
    if text != line or anchor_kind(" " + text):
        return "1" + text
    return " " + text

"""Lines of a listing in blocks, with the carriage-control column in place.

Column 1 of the print is the Fortran carriage control: blank, ``0`` (an empty line first), ``1`` (new page), ``+``.  A
file that went through a printer filter has lost it: all columns lie one to the left, form feeds stand for new pages.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import islice
from typing import TextIO

from flightmech.support.input_files.text import demand_regular, marked_encoding

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
_STARTS = tuple(ANCHORS)
_PROGRESS = re.compile(r" ?(?:Return to main program from|Preparing to start the big loop|At \d+\s*$)")
ARRAY_DUMP = re.compile(r" +[A-Z][A-Z0-9]* *\( *\d+\)=")
_MAY_TURN = re.compile(
    r"1|[^1] *+(?=[A-Z*])(?:[A-Z][A-Z0-9]* *\( *\d+\)=|Return to|Preparing|At |"
    + "|".join(map(re.escape, _STARTS))
    + ")|Return to|Preparing|At "
)
_BLOCK_CHARACTERS = 1 << 18
_BLOCK_LINES = 4096
_LONGEST_LINE = 160  # of the program; longer ones are not worth remembering
_TRAILING = "\r\n\x1a "


def line_blocks(source: str | os.PathLike[str] | Iterable[str]) -> Iterator[list[str]]:
    """Yield the lines of a file or of an iterable in blocks, without their ends; only a line feed ends a line, in a file without one a CR.

    Bytes are read as ISO 8859-1, so that any byte in a CASEID survives; a byte-order mark is dropped, and that of UTF-16, as
    PowerShell writes it, or UTF-32 is obeyed.  Tabs are expanded to every eighth column.
    """
    if not isinstance(source, str | os.PathLike):
        rest = iter(source)
        first = True
        while lines := [str(line) for line in islice(rest, _BLOCK_LINES)]:
            if first:
                lines[0], first = lines[0].removeprefix("\ufeff"), False
            yield _clean(lines, "".join(lines))
        return
    demand_regular(source, "a print file (unit 6, for006.dat)")
    with open(source, "rb") as stream:
        head = stream.read(_BLOCK_CHARACTERS)
    encoding, skip = marked_encoding(head)
    if encoding in ("", "utf-8"):
        encoding = "latin-1"
    else:
        skip = 1
    line_end = "\n" if b"\n" in head or b"\r" not in head else None  # None: a lone CR ends a line
    with open(source, encoding=encoding, errors="replace", newline=line_end) as text:
        text.read(skip)
        yield from _blocks(text)


def _blocks(stream: TextIO) -> Iterator[list[str]]:
    begun: list[str] = []  # pieces of a line whose end has not come yet
    while block := stream.read(_BLOCK_CHARACTERS):
        begun.append(block)
        if "\n" in block:
            text = "".join(begun)
            *lines, rest = text.split("\n")
            begun = [rest]
            yield _clean(lines, text)
    if rest := "".join(begun):
        yield _clean([rest], rest)


def _clean(lines: list[str], text: str) -> list[str]:
    """Return lines without their ends; `text` is all of them."""
    if "\x1a" in text:
        lines = [line.lstrip("\x1a") for line in lines]
    if "\t" in text:
        lines = [line.expandtabs() for line in lines]
    return [line.rstrip(_TRAILING) for line in lines]


def anchor(line: str) -> str:
    """Return which part of the print a line opens: ``run case page dump end``, or an empty text."""
    return _known_anchor(line) if len(line) <= _LONGEST_LINE else _anchor(line)


def _anchor(line: str) -> str:
    text = line[1:].lstrip()
    if not text.startswith(_STARTS):
        return ""
    return next(kind for words, kind in ANCHORS.items() if text.startswith(words))


_known_anchor = lru_cache(1024)(_anchor)


def turns(lines: list[str]) -> list[int]:
    """Return the indices of lines that may open or close a part of the print, or are no part of it."""
    match = _MAY_TURN.match
    return [i for i, line in enumerate(lines) if match(line)]


class ControlColumn:
    """Puts column 1 back where a printer filter took it away.

    The first line of the print proper decides, and the first line of every further program run in the file decides again:
    with control column it starts with ``1``.  A banner before it is passed on as it is.
    """

    def __init__(self) -> None:
        self.missing: bool | None = None

    def restore(self, lines: list[str]) -> list[str]:
        """Return the lines of a block with column 1; none of them is empty."""
        done: list[str] = []
        for i in range(len(lines)) if self.missing is None else [i for i, line in enumerate(lines) if "CONERR" in line]:
            missing = self._missing(lines[i].lstrip("\f")) if self.missing is None or "CONERR" in lines[i] else None
            if missing is not None:
                done += self._restored(lines[len(done) : i])
                self.missing = missing
        return done + self._restored(lines[len(done) :])

    @staticmethod
    def _missing(line: str) -> bool | None:
        if line.startswith("1") and anchor(line):
            return False
        return True if anchor(" " + line) else None

    def _restored(self, lines: list[str]) -> list[str]:
        if self.missing:
            return [_with_control(line) for line in lines]
        return [line.lstrip("\f") or " " for line in lines]


def _with_control(line: str) -> str:
    text = line.lstrip("\f")
    return ("1" if text != line or anchor(" " + text) else " ") + text


def is_progress(line: str) -> bool:
    """Return whether a line is one of the progress lines that some builds print between the tables."""
    return _PROGRESS.match(line) is not None

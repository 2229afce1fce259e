"""Lines of a listing as a stream, with the carriage-control column in place.

Column 1 of the print is the Fortran carriage control: blank, ``0`` (an empty line first), ``1`` (new page), ``+``.  A
file that went through a printer filter has lost it: all columns lie one to the left, form feeds stand for new pages.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator

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


def open_lines(source: str | os.PathLike[str] | Iterable[str]) -> Iterator[str]:
    """Yield the lines of a file or of an iterable without their ends; only a line feed ends a line.

    Bytes are read as ISO 8859-1, so that any byte in a CASEID survives.
    """
    if isinstance(source, str | os.PathLike):
        with open(source, encoding="latin-1", newline="\n") as stream:
            yield from (line.rstrip("\r\n\x1a ") for line in stream)
    else:
        yield from (str(line).rstrip("\r\n\x1a ") for line in source)


def anchor(line: str) -> str:
    """Return which part of the print a line opens: ``run case page dump end``, or an empty text."""
    text = line[1:].lstrip()
    if not text.startswith(_STARTS):
        return ""
    return next(kind for words, kind in ANCHORS.items() if text.startswith(words))


def with_control_column(lines: Iterable[str]) -> Iterator[tuple[int, str]]:
    """Yield line number and line, with column 1 put back where a printer filter took it away.

    The first line of the print proper decides: with control column it starts with ``1``.  The banner before it is passed on as it is.
    """
    missing: bool | None = None
    for number, line in enumerate(lines, 1):
        if missing is None:
            if line.startswith("1") and anchor(line):
                missing = False
            elif anchor(" " + line.lstrip("\f")):
                missing = True
        if missing:
            text = line.lstrip("\f")
            line = ("1" if text != line or anchor(" " + text) else " ") + text
        yield number, line or " "


def is_progress(line: str) -> bool:
    """Tell whether a line is one of the progress lines that some builds print between the tables."""
    return _PROGRESS.match(line) is not None

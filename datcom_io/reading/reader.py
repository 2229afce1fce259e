"""Reading a listing: one pass over its lines, one case in memory at a time."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator

from ..listing import Case, DamagedListing, Listing
from ..printout.gc_pause import uncollected
from .faults import Observer
from .lines import ControlColumn, line_blocks
from .regions import Scanner

Source = str | os.PathLike[str] | Iterable[str]


def read(source: Source, *, partial: bool = False) -> Listing:
    """Read the print file (unit 6) of Digital DATCOM.

    Parameters
    ----------
    source : path, or iterable of str
        File, or its lines.  Line ends LF or CRLF; several program runs may follow each other; column 1 may be missing.
    partial : bool
        Take what is complete in a file that is cut, and report it in a message, instead of raising.

    Returns
    -------
    Listing

    Raises
    ------
    ParseError
        The file is no listing, is cut (no END OF JOB), or a table has another number of rows than the deck specifies.  The error is a
        `DamagedListing`: its ``listing`` holds everything that is complete before the fault.

    Notes
    -----
    The program's own faults are reported as messages, never repaired: see `datcom_io.reading.faults`.
    """
    cases = iterate(source, partial=partial)
    try:
        with uncollected():
            for case in cases:
                cases.listing.cases.append(case)
    except DamagedListing as error:
        cases.listing.cases += error.listing.cases
        error.listing = cases.listing
        raise
    return cases.listing


def iterate(source: Source, *, partial: bool = False) -> Cases:
    """Read a print file case by case; each is given out when it is complete, and only one is held in memory.

    Parameters
    ----------
    source : path, or iterable of str
        As `read` takes it.
    partial : bool
        As `read` takes it.

    Returns
    -------
    Cases
        An iterator of `Case`, with the reader's messages; ``cases.listing`` has what belongs to no case.

    Raises
    ------
    ParseError
        While iterating, when the fault is reached: a `DamagedListing`, whose ``listing`` holds what is complete of the case
        that has not been given out.

    Examples
    --------
    >>> for case in datcom_io.iterate("for006.dat"):              # doctest: +SKIP
    ...     print(case.name, len(case.cells()))
    """
    return Cases(source, partial)


class Cases(Iterator[Case]):
    """The cases of a file, one after the other.

    Attributes
    ----------
    listing : Listing
        File, runs, lines, messages and lines not understood as far as the file has been read; it holds no case.
    """

    def __init__(self, source: Source, partial: bool):
        file = os.path.basename(os.fspath(source)) if isinstance(source, str | os.PathLike) else "<text>"
        self.listing = Listing(file)
        self._cases = self._scan(source, Scanner(self.listing, partial))

    def __next__(self) -> Case:
        return next(self._cases)

    def _scan(self, source: Source, scanner: Scanner) -> Iterator[Case]:
        finish = _Finish()
        column = ControlColumn()
        try:
            for lines in line_blocks(source):
                scanner.take(column.restore(lines))
                yield from finish.all(scanner.complete)
            scanner.end()
        except DamagedListing as error:
            yield from finish.all(scanner.complete)
            error.listing.cases = list(finish.all(error.listing.cases))
            raise
        yield from finish.all(scanner.complete)


class _Finish:
    """Gives a case its name and the reader's messages, when all of it has been read."""

    def __init__(self) -> None:
        self.observer = Observer()
        self.used: set[str] = set()
        self.seen: Counter[str] = Counter()

    def all(self, cases: list[Case]) -> Iterator[Case]:
        """Yield cases and take them off the list."""
        while cases:
            case = cases.pop(0)
            self._name(case)
            self.observer.report(case)
            yield case

    def _name(self, case: Case) -> None:
        """Name a case by its CASEID; a second one of the same name gets `` (2)``."""
        base = case.deck.caseid or f"case {case.ordinal}"
        case.name = base
        while case.name in self.used or self.seen[base] == 0:
            self.seen[base] += 1
            case.name = base if self.seen[base] == 1 else f"{base} ({self.seen[base]})"
        self.used.add(case.name)

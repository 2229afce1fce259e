"""Reading a listing: one pass over its lines, one case in memory at a time."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from datcom_io.listing import Case, DamagedListing, Listing
from datcom_io.printout.content import paused_collection
from datcom_io.reading.faults import Observer
from datcom_io.reading.scanner import ControlColumn, Scanner, line_blocks

Source = str | os.PathLike[str] | Iterable[str]


def read(source: Source, *, partial: bool = False) -> Listing:
    """Read the print file (unit 6) of Digital DATCOM.

    Parameters
    ----------
    source : path, or iterable of str
        File, or its lines.  Line ends LF or CRLF; several program runs may follow each other;
        column 1 may be missing.
    partial : bool
        Take what is complete in a file that is cut, and report it in a message, instead of raising.

    Returns
    -------
    Listing

    Raises
    ------
    ParseError
        The file is no listing, is cut (no END OF JOB), or a table has another number of rows than
        the deck specifies.  The error is a `DamagedListing`: its ``listing`` holds everything that
        is complete before the fault.

    Notes
    -----
    The program's own faults are reported as messages, never repaired: see `datcom_io.reading.faults`.
    """
    cases = iterate(source, partial=partial)
    try:
        with paused_collection():
            for case in cases:
                cases.listing.cases.append(case)
    except DamagedListing as error:
        cases.listing.cases += error.listing.cases
        error.listing = cases.listing
        raise
    return cases.listing


def iterate(source: Source, *, partial: bool = False) -> Cases:
    """Read a print file case by case; each is given out when it is complete, and only one is held
    in memory.

    Parameters
    ----------
    source : path, or iterable of str
        As `read` takes it.
    partial : bool
        As `read` takes it.

    Returns
    -------
    Cases
        An iterator of `Case`, with the reader's messages; ``cases.listing`` has what belongs to no
        case.

    Raises
    ------
    ParseError
        While iterating, when the fault is reached: a `DamagedListing`, whose ``listing`` holds what
        is complete of the case that has not been given out.

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
        File, runs, lines, messages and lines not understood as far as the file has been read; it
        holds no case.
    """

    def __init__(self, source: Source, partial: bool):
        file = (
            os.path.basename(os.fspath(source))
            if isinstance(source, str | os.PathLike)
            else "<text>"
        )
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


_SIGN = b"CONERR - INPUT ERROR CHECKING"  # the program begins every run with it


class ListingCase(NamedTuple):
    """A listing and one of its cases; without case the whole listing."""

    file: Path
    case: str = ""


def place_of(text: str, folder: str | os.PathLike[str] = ".") -> ListingCase:
    """Return the file and the case that ``FILE`` or ``FILE:CASE`` names.

    Parameters
    ----------
    text : str
        Names of files and of cases may hold colons: the file is the longest part before a colon
        that is one.
    folder : path
        Where a relative path begins.

    Raises
    ------
    FileNotFoundError
        Neither the text nor a part of it before a colon is a file.
    """
    file = Path(folder, text)
    if file.is_file():
        return ListingCase(file)
    for end in reversed([k for k, letter in enumerate(text) if letter == ":"]):
        file = Path(folder, text[:end])
        if file.is_file():
            return ListingCase(file, text[end + 1 :].strip())
    raise FileNotFoundError(
        2, "there is no such file; write FILE, or FILE:CASE for one case of it", text
    )


def listings_in(folder: str | os.PathLike[str]) -> list[Path]:
    """Return the print files of the program in a folder, by name; they are recognised by their
    content.

    Raises
    ------
    FileNotFoundError
        There is none.
    """
    files = [
        path
        for path in sorted(Path(folder).iterdir())
        if path.is_file() and _SIGN in path.read_bytes().replace(b"\0", b"")
    ]
    if not files:
        raise FileNotFoundError(
            2,
            "no listing of Digital DATCOM in this folder; run the decks first (aeromatch "
            "datcom run)",
            str(folder),
        )
    return files


def read_place(place: str | ListingCase) -> Listing | Case:
    """Return the listing of a place, or the one case of it that the place names.

    Raises
    ------
    FileNotFoundError
        No such file.
    UnknownName
        No case, or several cases, of that name.
    ParseError
        The listing is damaged, or it is none.
    """
    place = place_of(place) if isinstance(place, str) else place
    listing = read(place.file)
    return listing[place.case] if place.case else listing

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
from datcom_io.reading.lines import ControlColumn, line_blocks
from datcom_io.reading.scanner import Scanner
from flightmech.errors import ParseError
from flightmech.support.file_kinds import MISSILE_FILE, file_kind
from flightmech.support.input_files import regular_files

Source = str | os.PathLike[str] | Iterable[str]


def read(source: Source, *, partial: bool = False) -> Listing:
    """Read the print file (unit 6) of Digital DATCOM.

    Parameters
    ----------
    source : path, or iterable of str
        File, or its lines.  Line ends LF or CRLF; several program runs may follow each other;
        column 1 may be missing.
    partial : bool
        Read the complete part of a truncated file and report the fault in a message; otherwise a
        truncated file raises.

    Returns
    -------
    Listing

    Raises
    ------
    ParseError
        The file is not a listing, is truncated (no END OF JOB), or a table has another number of
        rows than the deck specifies.  The error is a `DamagedListing`: its ``listing`` holds
        everything that is complete before the fault.

    Notes
    -----
    Faults of the program are reported as messages, never repaired: see `datcom_io.reading.faults`.
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
    """Read a print file case by case.

    Each case is yielded when it is complete, and only one is held in memory.

    Parameters
    ----------
    source : path, or iterable of str
        As `read` takes it.
    partial : bool
        As `read` takes it.

    Returns
    -------
    Cases
        An iterator of `Case`, with the messages of the reader; ``cases.listing`` has the messages
        and lines that belong to no case.

    Raises
    ------
    ParseError
        While iterating, when the fault is reached: a `DamagedListing`, whose ``listing`` holds the
        complete part of the case that has not been yielded.

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
        file = "<text>"
        if isinstance(source, str | os.PathLike):
            file = os.path.basename(os.fspath(source))
            kind = file_kind(source)
            if kind.startswith(MISSILE_FILE):
                raise ParseError(file, 1, kind, "a print file of Digital DATCOM")
        self.listing = Listing(file)
        self._cases = self._scan(source, Scanner(self.listing, partial))

    def __next__(self) -> Case:
        return next(self._cases)

    def _scan(self, source: Source, scanner: Scanner) -> Iterator[Case]:
        finisher = _CaseFinisher()
        column = ControlColumn()
        try:
            for lines in line_blocks(source):
                scanner.read_lines(column.restore(lines))
                yield from finisher.finish_cases(scanner.complete)
            scanner.end()
        except DamagedListing as error:
            # Cases before the damaged one are complete.
            yield from finisher.finish_cases(scanner.complete)
            error.listing.cases = list(finisher.finish_cases(error.listing.cases))
            raise
        yield from finisher.finish_cases(scanner.complete)


class _CaseFinisher:
    """Gives a case its name and the messages of the reader, when all of it has been read."""

    def __init__(self) -> None:
        self.observer = Observer()
        self.used: set[str] = set()
        self.counts: Counter[str] = Counter()

    def finish_cases(self, cases: list[Case]) -> Iterator[Case]:
        """Yield cases and take them off the list."""
        while cases:
            case = cases.pop(0)
            self._set_name(case)
            self.observer.report(case)
            yield case

    def _set_name(self, case: Case) -> None:
        """Name a case by its CASEID; a second one of the same name gets `` (2)``."""
        base = case.deck.caseid or f"case {case.ordinal}"
        case.name = base
        # A CASEID may itself end in (2), so the name is counted up until it is unused.
        while case.name in self.used or self.counts[base] == 0:
            self.counts[base] += 1
            case.name = base
            if self.counts[base] > 1:
                case.name = f"{base} ({self.counts[base]})"
        self.used.add(case.name)


# The program begins every run with this line.
_SIGN = b"CONERR - INPUT ERROR CHECKING"


class ListingCase(NamedTuple):
    """A listing and one of its cases; an empty case denotes the whole listing."""

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
    # Names may hold colons, so the longest part that is a file counts.
    colons = [k for k, letter in enumerate(text) if letter == ":"]
    for end in reversed(colons):
        file = Path(folder, text[:end])
        if file.is_file():
            return ListingCase(file, text[end + 1 :].strip())
    raise FileNotFoundError(
        2, "there is no such file; write FILE, or FILE:CASE for one case of it", text
    )


def listings_in(folder: str | os.PathLike[str]) -> list[Path]:
    """Return the print files of the program in a folder, by name.

    They are recognised by their content.

    Raises
    ------
    FileNotFoundError
        There is none.
    ParseError
        The folder holds a named pipe or a device.
    """
    files = []
    for path in regular_files(sorted(Path(folder).iterdir()), "a listing of Digital DATCOM"):
        # Without zero bytes the sign is found in UTF-16 too.
        if _SIGN in path.read_bytes().replace(b"\0", b""):
            files.append(path)
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
        The listing is damaged, or the file is not a listing.
    """
    source = place
    if isinstance(source, str):
        source = place_of(source)
    listing = read(source.file)
    if not source.case:
        return listing
    return listing[source.case]

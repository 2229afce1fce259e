"""A listing and its cases, with their conversions to data frames and arrays.

The print of a case is `PrintedCase`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from datcom_io.printout.content import ListingMessage, Page, PrintedCase
from flightmech.errors import ParseError, SchemaError, UnknownName
from flightmech.support.figures import html_table

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

# In the text that represents a listing: number of names, and of letters of each name.
_MOST_NAMES, _MOST_LETTERS = 25, 60


def shorten_name(name: str) -> str:
    """Return a name of at most `_MOST_LETTERS` letters."""
    if len(name) <= _MOST_LETTERS:
        return name
    return f"{name[: _MOST_LETTERS - 3]}..."


class Case(PrintedCase):
    """One case with its conversions to data frames and arrays.

    The attributes are those of `PrintedCase`.
    """

    def __repr__(self) -> str:
        """Return number, name and the kinds of tables of the case as text."""
        # Kinds of tables in the order of the print, each once.
        kinds: dict[str, None] = {}
        for page in self.pages:
            kinds |= dict.fromkeys(table.name for table in page.tables)
        names = ", ".join(list(kinds)[:_MOST_NAMES]) or "none"
        if len(kinds) > _MOST_NAMES:
            names += ", ..."
        return (
            f"<Case {self.ordinal} {shorten_name(self.name)!r}: pages {len(self.pages)}, "
            f"messages {len(self.messages)}; tables: {names}>"
        )

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row per printed cell, as `cells`."""
        return self.cells()

    def block(self, name: str) -> pd.DataFrame:
        """Return all tables of a kind as one table of printed numbers.

        Parameters
        ----------
        name : str
            ``conditions static downwash dynamic symflp`` and the others of
            ``docs/explanation/datcom/listings.md``.

        Returns
        -------
        DataFrame (row, ...)
            Column ``line``, then ``configuration mach altitude ground_height flap`` of the page,
            then the printed columns by their printed names, or ``label text value unit`` of numbers
            that are printed with labels; NaN where no number is printed. ``attrs["units"]`` gives
            the printed units.
        """
        from datcom_io.arrays.frames import make_block_frame

        return make_block_frame(self, name)

    def cells(self) -> pd.DataFrame:
        """Return one row per printed cell.

        Returns
        -------
        DataFrame (cell, ...)
            ``line case page table mach altitude alpha delta delta_left delta_right
            delta_difference``, other axes that the tables have, ``column text value flag``; numbers
            as printed, axis values NaN where the table has no such axis, ``flag`` a word of
            `datcom_io.FLAGS`.  ``page table column text flag`` are categorical.
        """
        from datcom_io.arrays.frames import make_cell_frame

        return make_cell_frame([self])

    def to_datatree(self, *, fill_transonic: bool = False) -> xr.DataTree:
        """Return the case in SI and radians, under the names of the vocabulary.

        Parameters
        ----------
        fill_transonic : bool
            Also fill columns that are constant in alpha on transonic pages, where the first row is
            the value at zero lift.

        Returns
        -------
        DataTree
            One leaf per family of tables, ``static downwash dynamic symflp`` ..., those that the
            case has; see ``docs/explanation/datcom/listings.md``.

        Raises
        ------
        ParseError
            The printed axes do not agree with the input deck.
        """
        from datcom_io.arrays.trees import case_tree

        return case_tree(self, fill_transonic=fill_transonic)

    def plot(
        self, coefficients: Sequence[str] = ("CL", "CD", "Cm"), configuration: str | None = None
    ) -> Figure:
        """Return a figure of static coefficients over alpha.

        It has a curve for each Mach number, altitude and height above ground.

        Parameters
        ----------
        coefficients : sequence of str
            Printed over alpha: ``CL CD Cm CN CA CL_alpha Cm_alpha CY_beta Cn_beta Cl_beta xcp``.
        configuration : str, optional
            One of the configurations of a build-up, such as ``WING-BODY``.  Default: the most
            complete one.

        Raises
        ------
        SchemaError
            The case prints no static coefficients.
        UnknownName
            A coefficient or configuration that it does not print.
        AeromatchError
            matplotlib is not installed.
        """
        from datcom_io.arrays.figure import coefficient_figure

        return coefficient_figure(
            self.name, {self.name: self.to_datatree()}, coefficients, configuration
        )


@dataclass(eq=False)
class Listing:
    """A whole print file.

    Attributes
    ----------
    file : str
        Name of the file.
    runs : int
        Program runs in the file.
    line_count : int
    unread : list of int
        Numbers of all lines that were not understood.
    own_messages : list of Message
        Messages that belong to no case.
    cases : list of Case
        The cases; the listing itself iterates over them.
    """

    file: str
    runs: int = 0
    line_count: int = 0
    unread: list[int] = field(default_factory=list)
    own_messages: list[ListingMessage] = field(default_factory=list)
    cases: list[Case] = field(default_factory=list)

    @property
    def case_names(self) -> list[str]:
        """Names of the cases, in order."""
        return [case.name for case in self.cases]

    @property
    def pages(self) -> list[Page]:
        """All pages, in order."""
        pages: list[Page] = []
        for case in self.cases:
            pages += case.pages
        return pages

    @property
    def unparsed(self) -> list[Page]:
        """Pages on which nothing was understood.

        The program, or another build of it, prints a kind of page that the reader does not have.
        """
        return [page for page in self.pages if not page.parsed]

    @property
    def messages(self) -> list[ListingMessage]:
        """All messages, of the file and of its cases, by line."""
        messages = list(self.own_messages)
        for case in self.cases:
            messages += case.messages
        return sorted(messages)

    def __len__(self) -> int:
        return len(self.cases)

    def __iter__(self) -> Iterator[Case]:
        return iter(self.cases)

    def __getitem__(self, key: str | int) -> Case:
        """Return a case by its index from 0 (int), or by its name or number (str).

        The number counts from 1.  In place of the name, a part that no other name has is enough;
        capital and small letters count as equal in it.
        """
        if isinstance(key, int):
            if not -len(self) <= key < len(self):
                indices = map(str, range(len(self)))
                raise UnknownName(str(key), indices, f"case number of {self.file}")
            return self.cases[key]
        matches = self._match_cases(key)
        if len(matches) == 1:
            return matches[0]
        if not matches:
            hint = "give its number from 1, its name or a part of the name"
            raise UnknownName(key, self.case_names, f"case of {self.file}", hint)
        names = ", ".join(f"{case.ordinal} {case.name!r}" for case in matches)
        problem = (
            f"several cases have {key!r} in their name: {names}; give the number, or "
            f"more of the name"
        )
        raise SchemaError(self.file, [problem])

    def _match_cases(self, key: str) -> list[Case]:
        """Return the cases with a name, or else with a number, or else with a part of a name."""
        # An exact name counts before a number, a number before a part of a name.
        matches = [case for case in self.cases if case.name == key]
        if not matches:
            matches = [case for case in self.cases if str(case.ordinal) == key]
        if not matches and key.strip():
            matches = [case for case in self.cases if key.lower() in case.name.lower()]
        return matches

    def __repr__(self) -> str:
        """Return file, size and the names of the cases as text.

        Names beyond the first `_MOST_NAMES` are counted.
        """
        names = [shorten_name(case.name) for case in self.cases[:_MOST_NAMES]]
        text = ", ".join(map(repr, names))
        if len(self.cases) > len(names):
            text += f", and {len(self.cases) - len(names)} more"
        counts = (
            f"runs {self.runs}, lines {self.line_count}, not understood {len(self.unread)}, "
            f"messages {len(self.messages)}"
        )
        return f"<Listing {shorten_name(self.file)!r}: {counts}; cases {len(self.cases)}: {text}>"

    def _repr_html_(self) -> str:
        """Return the cases as a table for a notebook."""
        rows = []
        for case in self.cases:
            # Only some kinds of page have a configuration.
            configurations = dict.fromkeys(page.configuration for page in case.pages)
            configurations.pop("", None)
            row = (
                case.ordinal,
                case.name,
                ", ".join(configurations),
                _mach_span(case),
                len(case.pages),
                len(case.messages),
            )
            rows.append(row)
        columns = ("", "case", "configuration", "Mach number", "pages", "messages")
        notes = []
        if self.unread:
            notes.append(f"{len(self.unread)} lines were not understood")
        return html_table(f"Digital DATCOM listing {self.file}", columns, rows, notes)

    def plot(
        self, coefficients: Sequence[str] = ("CL", "CD", "Cm"), configuration: str | None = None
    ) -> Figure:
        """Return a figure of static coefficients over alpha, a row for each case that prints them.

        Arguments and errors are those of `Case.plot`.
        """
        from datcom_io.arrays.figure import coefficient_figure

        cases = {f"{case.ordinal} {case.name}": case.to_datatree() for case in self.cases}
        return coefficient_figure(self.file, cases, coefficients, configuration)

    def cells(self) -> pd.DataFrame:
        """Return one row per printed cell.

        Returns
        -------
        DataFrame (cell, ...)
            As `Case.cells` of all cases.
        """
        from datcom_io.arrays.frames import make_cell_frame

        return make_cell_frame(self)

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row per printed cell, as `cells`."""
        return self.cells()

    def to_datatree(self, *, fill_transonic: bool = False) -> xr.DataTree:
        """Return all cases that have tables, one child per case (see `Case.to_datatree`).

        ``/`` in a name becomes ``|``.
        """
        from datcom_io.arrays.trees import listing_tree

        return listing_tree(self, self.file, self.runs, fill_transonic=fill_transonic)


def _mach_span(case: Case) -> str:
    """Return the smallest and the largest printed Mach number of a case, empty without any."""
    machs = {page.condition("mach") for page in case.pages}
    numbers = sorted(mach for mach in machs if not math.isnan(mach))
    if not numbers:
        return ""
    ends = dict.fromkeys((numbers[0], numbers[-1]))
    return " ... ".join(f"{mach:g}" for mach in ends)


class DamagedListing(ParseError):
    """A damaged or truncated listing; ``listing`` holds everything complete before the fault.

    Its pages are those that ``partial=True`` gives up to the same line.  The page with the fault
    lacks the damaged table.
    """

    def __init__(self, file: str, line: int, problem: str, expected: str, listing: Listing):
        super().__init__(file, line, problem, expected)
        self.listing = listing

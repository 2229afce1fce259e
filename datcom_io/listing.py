"""A listing and its cases, with their conversions to data frames and arrays; what is printed of a
case is `PrintedCase`.
"""

from __future__ import annotations

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

_MOST_NAMED, _MOST_LETTERS = (
    25,
    60,
)  # in the text that represents a listing: names, and letters of each


def shorten_name(name: str) -> str:
    """Return a name of at most `_MOST_LETTERS` letters."""
    return name if len(name) <= _MOST_LETTERS else f"{name[: _MOST_LETTERS - 3]}..."


class Case(PrintedCase):
    """One case, which can be had as data frames and as arrays; attributes are those of
    `PrintedCase`.
    """

    def __repr__(self) -> str:
        """Return number, name and the kinds of tables of the case as text."""
        tables = dict.fromkeys(table.name for page in self.pages for table in page.tables)
        names = f"{', '.join(list(tables)[:_MOST_NAMED]) or 'none'}{', ...' if len(tables) > _MOST_NAMED else ''}"
        return (
            f"<Case {self.ordinal} {shorten_name(self.name)!r}: pages {len(self.pages)}, "
            f"messages {len(self.messages)}; tables: {names}>"
        )

    def block(self, name: str) -> pd.DataFrame:
        """Return all tables of a kind as one table of printed numbers.

        Parameters
        ----------
        name : str
            ``conditions static downwash dynamic symflp`` and the others of ``docs/explanation/datcom/listings.md``.

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
        """Return a figure of static coefficients over alpha, a curve for each Mach number, altitude
        and height above ground.

        Parameters
        ----------
        coefficients : sequence of str
            Printed over alpha: ``CL CD Cm CN CA CL_alpha Cm_alpha CY_beta Cn_beta Cl_beta xcp``.
        configuration : str, optional
            Of the configurations of a build-up, such as ``WING-BODY``; the most complete one
            without it.

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
        return [page for case in self.cases for page in case.pages]

    @property
    def unparsed(self) -> list[Page]:
        """Pages on which nothing was understood: the program, or another build of it, prints a kind
        that is not known here.
        """
        return [page for page in self.pages if not page.parsed]

    @property
    def messages(self) -> list[ListingMessage]:
        """All messages, of the file and of its cases, by line."""
        return sorted(
            [*self.own_messages, *(message for case in self.cases for message in case.messages)]
        )

    def __len__(self) -> int:
        return len(self.cases)

    def __iter__(self) -> Iterator[Case]:
        return iter(self.cases)

    def __getitem__(self, key: str | int) -> Case:
        """Return a case by its place from 0 (int); or by its name, its number from 1 or a part of
        the name that no other has (str).

        Capital and small letters count as equal in a part of a name.
        """
        if isinstance(key, int):
            if not -len(self) <= key < len(self):
                raise UnknownName(
                    str(key), map(str, range(len(self))), f"case number of {self.file}"
                )
            return self.cases[key]
        found = [case for case in self.cases if case.name == key]
        found = found or [case for case in self.cases if str(case.ordinal) == key]
        found = found or [
            case for case in self.cases if key.strip() and key.lower() in case.name.lower()
        ]
        if len(found) == 1:
            return found[0]
        if found:
            cases = ", ".join(f"{case.ordinal} {case.name!r}" for case in found)
            raise SchemaError(
                self.file,
                [
                    f"several cases have {key!r} in their name: {cases}; give the number, or "
                    f"more of the name"
                ],
            )
        raise UnknownName(
            key,
            self.case_names,
            f"case of {self.file}",
            "give its number from 1, its name or a part of the name",
        )

    def __repr__(self) -> str:
        """Return file, size and the names of the cases as text; those beyond the first
        `_MOST_NAMED` are counted.
        """
        names = [shorten_name(case.name) for case in self.cases[:_MOST_NAMED]]
        more = f", and {len(self.cases) - len(names)} more" if len(self.cases) > len(names) else ""
        counts = (
            f"runs {self.runs}, lines {self.line_count}, not understood {len(self.unread)}, "
            f"messages {len(self.messages)}"
        )
        return (
            f"<Listing {shorten_name(self.file)!r}: {counts}; cases {len(self.cases)}: "
            f"{', '.join(map(repr, names))}{more}>"
        )

    def _repr_html_(self) -> str:
        """Return the cases as a table for a notebook."""

        rows = []
        for case in self.cases:
            machs = sorted(
                {mach for page in case.pages if (mach := page.condition("mach")) == mach}
            )  # those that are numbers
            span = (
                " ... ".join(f"{mach:g}" for mach in dict.fromkeys((machs[0], machs[-1])))
                if machs
                else ""
            )
            configurations = dict.fromkeys(
                page.configuration for page in case.pages if page.configuration
            )
            rows.append(
                (
                    case.ordinal,
                    case.name,
                    ", ".join(configurations),
                    span,
                    len(case.pages),
                    len(case.messages),
                )
            )
        columns = ("", "case", "configuration", "Mach number", "pages", "messages")
        notes = [f"{len(self.unread)} lines were not understood"] if self.unread else []
        return html_table(f"Digital DATCOM listing {self.file}", columns, rows, notes)

    def plot(
        self, coefficients: Sequence[str] = ("CL", "CD", "Cm"), configuration: str | None = None
    ) -> Figure:
        """Return a figure of static coefficients over alpha, a row for each case that prints them;
        arguments and errors as `Case.plot`.
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

    def to_datatree(self, *, fill_transonic: bool = False) -> xr.DataTree:
        """Return all cases that have tables, one child per case (see `Case.to_datatree`); ``/`` in
        a name becomes ``|``.
        """
        from datcom_io.arrays.trees import listing_tree

        return listing_tree(self, self.file, self.runs, fill_transonic=fill_transonic)


class DamagedListing(ParseError):
    """A listing that is damaged or cut; ``listing`` holds everything complete before the fault.

    Its pages are those that ``partial=True`` gives up to the same line, the page with the fault
    without the table that is damaged.
    """

    def __init__(self, file: str, line: int, found: str, expected: str, listing: Listing):
        super().__init__(file, line, found, expected)
        self.listing = listing

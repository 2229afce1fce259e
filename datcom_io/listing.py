"""What a listing holds, exactly as printed: cases, pages, tables, cells and messages, each with its line number."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from flightmech.errors import ParseError, UnknownName

from .decks.deck import Deck
from .layouts import CONDITIONS, NAMES
from .tables import Printed, Table, Values

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

_CONDITION_COLUMNS = {column.house: k for k, column in enumerate(CONDITIONS.columns)}


class Message(NamedTuple):
    """A message: line number from 1 (0: the whole file), text, and who says it, the ``program`` or this ``reader``."""

    line: int
    text: str
    origin: str = "program"


@dataclass(frozen=True, eq=False)
class Page:
    """One printed page.

    ``kind`` is ``static``, ``dynamic``, ``high-lift``, ``auxiliary``, ``section``, ``special``, ``hypersonic``, ``final inputs``,
    ``dump``, ``extrapolation`` or ``other``.  ``ground_height`` is the printed height [ft], infinite for FREE AIR and without
    ground effect; ``flap`` the printed deflection [deg] or NaN; ``power`` is ``off``, ``jet`` or ``propeller``; ``per`` is ``deg``,
    ``rad`` or empty.  ``heading`` are the heading lines below the program's name; ``notes`` the footnotes; ``unread``
    the numbers of the lines that were not understood.
    """

    kind: str
    case: int
    first: int
    last: int
    heading: tuple[str, ...] = ()
    configuration: str = ""
    ground_height: float = float("inf")
    flap: float = float("nan")
    power: str = "off"
    dim: str = ""
    per: str = ""
    conditions: Table | None = None
    printed: tuple[Printed, ...] = ()
    notes: tuple[Message, ...] = ()
    unread: tuple[int, ...] = ()

    @property
    def parsed(self) -> bool:
        """Whether anything on the page was understood, or nothing was left to understand."""
        return bool(self.printed) or not self.unread

    @property
    def tables(self) -> tuple[Table, ...]:
        """The page's tables, without its groups of ``label = value``."""
        return tuple(item for item in self.printed if isinstance(item, Table))

    def table(self, name: str) -> Table | None:
        """Return the page's table of a kind, or None."""
        return next((table for table in self.tables if table.name == name), None)

    def condition(self, name: str) -> float:
        """Return a number of the flight-condition line by its house name, NaN when it is missing. [as printed]

        A hypersonic page has no such line, only a Mach number in its heading.
        """
        if self.conditions is None:
            heading = next((item for item in self.printed if item.name == "hypersonic" and isinstance(item, Values)), None)
            return heading.value("MACH NUMBER") if heading is not None and name == "mach" else float("nan")
        return self.conditions.number(0, _CONDITION_COLUMNS[name])


@dataclass(eq=False)
class Case:
    """One case: its input deck, pages and messages.

    Attributes
    ----------
    name : str
        CASEID, made unique within the listing; ``case 3`` where there is none.
    ordinal : int
        Number of the card block in the file, from 1.
    run : int
        Number of the program run in the file, from 1.
    line : int
        Line of the card block.
    deck : Deck
        Namelists and control cards, those replayed by SAVE included.
    pages : list of Page
    messages : list of Message
    """

    ordinal: int
    run: int
    line: int
    file: str = ""
    name: str = ""
    deck: Deck = field(default_factory=Deck)
    pages: list[Page] = field(default_factory=list)
    messages: list[Message] = field(default_factory=list)

    def tables(self, name: str) -> Iterator[tuple[Page, Table]]:
        """Yield page and table of every table of a kind, in order."""
        self._demand_kind(name)
        for page in self.pages:
            if name == "conditions" and page.conditions is not None:
                yield page, page.conditions
            for table in page.printed:
                if table.name == name and isinstance(table, Table):
                    yield page, table

    def values(self, name: str) -> Iterator[tuple[Page, Values]]:
        """Yield page and group of every group of ``label = value`` of a kind, in order."""
        self._demand_kind(name)
        for page in self.pages:
            for group in page.printed:
                if group.name == name and isinstance(group, Values):
                    yield page, group

    @staticmethod
    def _demand_kind(name: str) -> None:
        if name not in NAMES:
            raise UnknownName(name, NAMES, "table kind")

    def block(self, name: str) -> pd.DataFrame:
        """Return all tables of a kind as one table of printed numbers.

        Parameters
        ----------
        name : str
            ``conditions static downwash dynamic symflp`` and the others of ``docs/datcom.md``.

        Returns
        -------
        DataFrame (row, ...)
            Column ``line``, then ``configuration mach altitude ground_height flap`` of the page, then the printed columns by their
            printed names, or ``label text value unit`` of numbers that are printed with labels; NaN where no number is printed.
            ``attrs["units"]`` gives the printed units.
        """
        from .frames import block

        return block(self, name)

    def cells(self) -> pd.DataFrame:
        """Return one row per printed cell.

        Returns
        -------
        DataFrame (cell, ...)
            ``line case page table mach altitude alpha delta delta_left delta_right delta_difference``, other axes that the tables have,
            ``column text value flag``; numbers as printed, axis values NaN where the table has no such axis, ``flag`` a word of
            `datcom_io.FLAGS`.  ``page table column text flag`` are categorical.
        """
        from .cell_frame import cells

        return cells([self])

    def to_datatree(self, *, fill_transonic: bool = False) -> xr.DataTree:
        """Return the case in SI and radians, under house names.

        Parameters
        ----------
        fill_transonic : bool
            Also fill columns that are constant in alpha on transonic pages, where the first row is the value at zero lift.

        Returns
        -------
        DataTree
            One leaf per family of tables, ``static downwash dynamic symflp`` ..., those that the case has; see ``docs/datcom.md``.

        Raises
        ------
        ParseError
            The printed axes do not agree with the input deck.
        """
        from .dataset import case_tree

        return case_tree(self, fill_transonic=fill_transonic)


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
    in_order : list of Case
        The cases; the listing itself iterates over them.
    """

    file: str
    runs: int = 0
    line_count: int = 0
    unread: list[int] = field(default_factory=list)
    own_messages: list[Message] = field(default_factory=list)
    in_order: list[Case] = field(default_factory=list)

    @property
    def cases(self) -> list[str]:
        """Names of the cases, in order."""
        return [case.name for case in self.in_order]

    @property
    def pages(self) -> list[Page]:
        """All pages, in order."""
        return [page for case in self.in_order for page in case.pages]

    @property
    def unparsed(self) -> list[Page]:
        """Pages on which nothing was understood: the program, or another build of it, prints a kind that is not known here."""
        return [page for page in self.pages if not page.parsed]

    @property
    def messages(self) -> list[Message]:
        """All messages, of the file and of its cases, by line."""
        return sorted([*self.own_messages, *(message for case in self.in_order for message in case.messages)])

    def __len__(self) -> int:
        return len(self.in_order)

    def __iter__(self) -> Iterator[Case]:
        return iter(self.in_order)

    def __getitem__(self, key: str | int) -> Case:
        if isinstance(key, int):
            if not -len(self) <= key < len(self):
                raise UnknownName(str(key), map(str, range(len(self))), f"case number of {self.file}")
            return self.in_order[key]
        for case in self.in_order:
            if case.name == key:
                return case
        raise UnknownName(key, self.cases, f"case of {self.file}")

    def cells(self) -> pd.DataFrame:
        """Return one row per printed cell.

        Returns
        -------
        DataFrame (cell, ...)
            As `Case.cells` of all cases.
        """
        from .cell_frame import cells

        return cells(self)

    def to_datatree(self, *, fill_transonic: bool = False) -> xr.DataTree:
        """Return all cases that have tables, one child per case (see `Case.to_datatree`); ``/`` in a name becomes ``|``."""
        from .dataset import listing_tree

        return listing_tree(self, fill_transonic=fill_transonic)


class DamagedListing(ParseError):
    """A listing that is damaged or cut; ``listing`` holds everything complete before the fault.

    Its pages are those that ``partial=True`` gives up to the same line, the page with the fault without the table that is damaged.
    """

    def __init__(self, file: str, line: int, found: str, expected: str, listing: Listing):
        super().__init__(file, line, found, expected)
        self.listing = listing

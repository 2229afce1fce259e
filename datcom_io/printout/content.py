"""Content of a page and of a case, exactly as printed, each item with its line number."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NamedTuple

from datcom_io.decks.deck import Deck
from datcom_io.printout.layouts import CONDITIONS, NAMES
from datcom_io.printout.tables import Printed, PrintedTable, PrintedValues
from flightmech.errors import UnknownName

_CONDITION_COLUMNS = {column.quantity: k for k, column in enumerate(CONDITIONS.columns)}


class ListingMessage(NamedTuple):
    """A message about a listing: line number, text and origin.

    Lines count from 1; 0 denotes the whole file.  The origin is the ``program`` or this ``reader``.
    """

    line: int
    text: str
    origin: str = "program"


@dataclass(frozen=True, eq=False)
class Page:
    """One printed page.

    ``kind`` is ``static``, ``dynamic``, ``high-lift``, ``auxiliary``, ``section``, ``special``,
    ``hypersonic``, ``final inputs``, ``dump``, ``extrapolation`` or ``other``.  ``ground_height``
    is the printed height [ft], infinite for FREE AIR and without ground effect; ``flap`` is the
    printed deflection [deg] or NaN; ``power`` is ``off``, ``jet`` or ``propeller``; ``per`` is
    ``deg``, ``rad`` or empty.  ``heading`` holds the heading lines below the name of the program;
    ``notes`` the footnotes; ``unread`` the numbers of the lines that were not understood.
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
    conditions: PrintedTable | None = None
    printed: tuple[Printed, ...] = ()
    notes: tuple[ListingMessage, ...] = ()
    unread: tuple[int, ...] = ()

    @property
    def parsed(self) -> bool:
        """Whether the reader understood something on the page, or all of it."""
        return bool(self.printed) or not self.unread

    @property
    def tables(self) -> tuple[PrintedTable, ...]:
        """The tables of the page, without its groups of ``label = value``."""
        return tuple(item for item in self.printed if isinstance(item, PrintedTable))

    def table(self, name: str) -> PrintedTable | None:
        """Return the table of a kind, or None."""
        for table in self.tables:
            if table.name == name:
                return table
        return None

    def groups(self, name: str) -> list[PrintedValues]:
        """Return the groups of ``label = value`` of a kind."""
        groups = []
        for item in self.printed:
            if item.name == name and isinstance(item, PrintedValues):
                groups.append(item)
        return groups

    def condition(self, name: str) -> float:
        """Return a number of the flight-condition line by its quantity, NaN when it is missing. [as
        printed]

        A hypersonic page does not have such a line, only a Mach number in its heading.
        """
        if self.conditions is not None:
            return self.conditions.number(0, _CONDITION_COLUMNS[name])
        headings = self.groups("hypersonic")
        if headings and name == "mach":
            return headings[0].value("MACH NUMBER")
        return float("nan")


@dataclass(eq=False)
class PrintedCase:
    """One case as printed: its input deck, pages and messages.

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
    messages : list of ListingMessage
    """

    ordinal: int
    run: int
    line: int
    file: str = ""
    name: str = ""
    deck: Deck = field(default_factory=Deck)
    pages: list[Page] = field(default_factory=list)
    messages: list[ListingMessage] = field(default_factory=list)

    def tables(self, name: str) -> Iterator[tuple[Page, PrintedTable]]:
        """Yield page and table of every table of a kind, in order."""
        self._require_kind(name)
        # The flight-condition line is a table of its own.
        for page in self.pages:
            if name == "conditions" and page.conditions is not None:
                yield page, page.conditions
            for table in page.printed:
                if table.name == name and isinstance(table, PrintedTable):
                    yield page, table

    def values(self, name: str) -> Iterator[tuple[Page, PrintedValues]]:
        """Yield page and group of every group of ``label = value`` of a kind, in order."""
        self._require_kind(name)
        for page in self.pages:
            for group in page.groups(name):
                yield page, group

    @staticmethod
    def _require_kind(name: str) -> None:
        if name not in NAMES:
            raise UnknownName(name, NAMES, "table kind")


@contextmanager
def paused_collection() -> Iterator[None]:
    """Disable the cyclic garbage collector inside a block that makes many objects.

    The objects do not refer back to themselves, so the collector would search all of them without
    a result.
    """
    # A caller may have disabled the collector before.
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()

"""What a page and a case hold, exactly as printed, each item with its line number."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NamedTuple

from datcom_io.decks.deck import Deck
from datcom_io.printout.layouts import CONDITIONS, NAMES
from datcom_io.printout.tables import Printed, PrintedTable, Values
from flightmech.errors import UnknownName

_CONDITION_COLUMNS = {column.quantity: k for k, column in enumerate(CONDITIONS.columns)}


class ListingMessage(NamedTuple):
    """A message: line number from 1 (0: the whole file), text, and its origin, the ``program`` or
    this ``reader``.
    """

    line: int
    text: str
    origin: str = "program"


@dataclass(frozen=True, eq=False)
class Page:
    """One printed page.

    ``kind`` is ``static``, ``dynamic``, ``high-lift``, ``auxiliary``, ``section``, ``special``,
    ``hypersonic``, ``final inputs``, ``dump``, ``extrapolation`` or ``other``.  ``ground_height``
    is the printed height [ft], infinite for FREE AIR and without ground effect; ``flap`` the
    printed deflection [deg] or NaN; ``power`` is ``off``, ``jet`` or ``propeller``; ``per`` is
    ``deg``, ``rad`` or empty.  ``heading`` are the heading lines below the program's name;
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
        """Whether anything on the page was understood, or nothing was left to understand."""
        return bool(self.printed) or not self.unread

    @property
    def tables(self) -> tuple[PrintedTable, ...]:
        """The page's tables, without its groups of ``label = value``."""
        return tuple(item for item in self.printed if isinstance(item, PrintedTable))

    def table(self, name: str) -> PrintedTable | None:
        """Return the page's table of a kind, or None."""
        return next((table for table in self.tables if table.name == name), None)

    def condition(self, name: str) -> float:
        """Return a number of the flight-condition line by its quantity, NaN when it is missing. [as
        printed]

        A hypersonic page has no such line, only a Mach number in its heading.
        """
        if self.conditions is None:
            heading = next(
                (
                    item
                    for item in self.printed
                    if item.name == "hypersonic" and isinstance(item, Values)
                ),
                None,
            )
            return (
                heading.value("MACH NUMBER")
                if heading is not None and name == "mach"
                else float("nan")
            )
        return self.conditions.number(0, _CONDITION_COLUMNS[name])


@dataclass(eq=False)
class PrintedCase:
    """What is printed of one case: its input deck, pages and messages.

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
    messages: list[ListingMessage] = field(default_factory=list)

    def tables(self, name: str) -> Iterator[tuple[Page, PrintedTable]]:
        """Yield page and table of every table of a kind, in order."""
        self._demand_kind(name)
        for page in self.pages:
            if name == "conditions" and page.conditions is not None:
                yield page, page.conditions
            for table in page.printed:
                if table.name == name and isinstance(table, PrintedTable):
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


@contextmanager
def paused_collection() -> Iterator[None]:
    """Hold the garbage collector still within a block that makes many objects, none of which refers
    back to itself.

    The collector runs after so many new objects, walks all that are alive and finds nothing: a
    fifth of the time of reading.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()

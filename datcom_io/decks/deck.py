"""One case of an input deck: the cards as written, and what the program sees when SAVE has replayed
those before.

Values unset in the program are absent here.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from datcom_io.decks.cards import (
    ERROR,
    Card,
    DeckFinding,
    Item,
    Namelist,
    NamelistAssignment,
    read_items,
)
from datcom_io.decks.namelists import DIMENSIONS, Value, format_namelist_value

Variables = dict[str, list[Value | None]]
_LARGEST_ARRAY = 300  # no array of the program is longer than 60
# a new device of a case replaces the other one; the two power namelists only hide each other
_REPLACES = {"SYMFLP": "ASYFLP", "ASYFLP": "SYMFLP"}
_HIDES = {"PROPWR": "JETPWR", "JETPWR": "PROPWR"}


@dataclass(frozen=True)
class Deck:
    """The input of one case.

    Attributes
    ----------
    namelists : dict
        Namelist name to variable name to list of values (float, bool, or None where an index was
        not set); index 1 is item 0. As the program sees them: replayed namelists included.
    cards : tuple of Card
        Control cards in order; NACA cards of a saved case come first.
    items : tuple of Namelist and Card
        The cards of this case as written, in order.
    replayed : tuple of Namelist and Card
        Namelists and NACA cards that SAVE brings from the cases before, as written there.
    findings : tuple of DeckFinding
        What could not be read, and what the program would not read.
    dim, deriv : str
        Unit of length, ``FT IN M CM``; unit of derivatives, ``DEG RAD``.  They last until changed.
    """

    namelists: dict[str, Variables] = field(default_factory=dict)
    cards: tuple[Card, ...] = ()
    items: tuple[Item, ...] = ()
    replayed: tuple[Item, ...] = ()
    findings: tuple[DeckFinding, ...] = ()
    dim: str = "FT"
    deriv: str = "DEG"

    @property
    def problems(self) -> tuple[tuple[int, str], ...]:
        """Line number and text of every finding that is an error."""
        return tuple(
            (finding.line, finding.text) for finding in self.findings if finding.severity == ERROR
        )

    @property
    def line(self) -> int:
        """First line of the case, 0 when it has no cards."""
        return self.items[0].line if self.items else 0

    def line_of(self, namelist: str, variable: str = "") -> int:
        """Return the line where a variable, or a namelist, was given last; that of the case when it
        is nowhere.
        """
        for item in reversed((*self.replayed, *self.items)):
            if isinstance(item, Namelist) and item.name == namelist:
                lines = [a.line for a in item.assignments if a.variable == variable]
                if lines or not variable:
                    return lines[-1] if lines else item.line
        return self.line_of(namelist) if variable else self.line

    def values(self, namelist: str, variable: str) -> list[float]:
        """Return an array of numbers; empty when it is not given. [as in the deck]"""
        found = self.namelists.get(namelist, {}).get(variable, [])
        return [float(x) if x is not None else float("nan") for x in found]

    def value(self, namelist: str, variable: str) -> float | None:
        """Return a scalar, or the first item of an array; None when it is not given. [as in the
        deck]
        """
        found = self.namelists.get(namelist, {}).get(variable, [None])
        return None if found[0] is None else float(found[0])

    def count(self, namelist: str, variable: str) -> int | None:
        """Return a count such as NALPHA; None when it is not given or is no count."""
        number = self.value(namelist, variable)
        return int(number) if number is not None and 0 < number <= _LARGEST_ARRAY else None

    def schedule(self, namelist: str, variable: str, count: str) -> list[float]:
        """Return the items of an array in use, for example ``schedule("FLTCON", "ALSCHD",
        "NALPHA")``.
        """
        return self.values(namelist, variable)[: self.count(namelist, count)]

    @property
    def caseid(self) -> str:
        """Text of the CASEID card, or an empty text."""
        return next(
            (card.text.strip() for card in reversed(self.cards) if card.name == "CASEID"), ""
        )

    @property
    def loop(self) -> int:
        """How Mach number and altitude step: 1 together, 2 altitude outside, 3 Mach number outside."""
        number = self.value("FLTCON", "LOOP")
        return int(number) if number in (2.0, 3.0) else 1

    def has(self, card: str) -> bool:
        """Return whether a control card is given."""
        return any(card == other.name for other in self.cards)

    def conditions(self) -> list[tuple[float, float]]:
        """Return Mach number and altitude in the order of the run; NaN without altitude, empty
        without Mach number. [1, deck unit]
        """
        machs = self.schedule("FLTCON", "MACH", "NMACH")
        heights = self.schedule("FLTCON", "ALT", "NALT") or [float("nan")] * (
            len(machs) if self.loop == 1 else 1
        )
        if self.loop == 2:
            return [(mach, height) for height in heights for mach in machs]
        if self.loop == 3:
            return [(mach, height) for mach in machs for height in heights]
        return list(zip(machs, heights))

    def regime(self, mach: float) -> str:
        """Return ``subsonic``, ``transonic`` or ``supersonic``, the methods the program uses at a
        Mach number.
        """
        subsonic, supersonic = self.value("FLTCON", "STMACH"), self.value("FLTCON", "TSMACH")
        if mach <= (0.6 if subsonic is None else subsonic):
            return "subsonic"
        return "supersonic" if mach >= (1.4 if supersonic is None else supersonic) else "transonic"

    @property
    def sections(self) -> dict[str, str]:
        """Surface, ``W H V F``, to its NACA type and designation, such as ``4 2415``; the last card
        of a surface counts.
        """
        cards = [card.text for card in self.cards if card.name == "NACA"]
        return {text[:1]: f"{text[2:3]} {text[4:].strip()}" for text in cards}

    def meaning(self) -> dict[str, object]:
        """Return all that reaches the program, comparable: equal decks in meaning give equal
        results.

        Numbers are taken to nine digits, more than the program's single precision can distinguish.
        SAVE itself and the order of cards are left out.
        """
        switches = {
            card.name
            for card in self.cards
            if card.name not in ("NACA", "CASEID", "DIM", "DERIV", "SAVE", "NEXT", "DUMP")
        }
        return {
            "namelists": {
                name: {
                    variable: [None if x is None else format_namelist_value(x) for x in values]
                    for variable, values in group.items()
                }
                for name, group in self.namelists.items()
            },
            "sections": self.sections,
            "switches": switches,
            "dumps": [
                " ".join(card.text.replace(",", " ").split())
                for card in self.cards
                if card.name == "DUMP"
            ],
            "caseid": self.caseid,
            "dim": self.dim,
            "deriv": self.deriv,
        }


def parse_cards(lines: Iterable[tuple[int, str]], before: Deck | None = None) -> Deck:
    """Return the deck of one case.

    Parameters
    ----------
    lines : iterable of (int, str)
        Line number and card text, column 1 of the card first.
    before : Deck, optional
        Deck of the case before in the same run: units are kept, namelists and NACA cards too when
        it has a SAVE card.
    """
    items, findings = read_items(lines)
    return make_deck(items, before, findings)


def make_deck(
    items: Sequence[Item], before: Deck | None = None, findings: Sequence[DeckFinding] = ()
) -> Deck:
    """Return the deck of one case from its cards, see `parse_cards`."""
    dim, deriv = (before.dim, before.deriv) if before else ("FT", "DEG")
    saved: tuple[Item, ...] = ()
    if before and before.has("SAVE"):
        saved = tuple(
            item
            for item in (*before.replayed, *before.items)
            if isinstance(item, Namelist) or item.name == "NACA"
        )
    cards = tuple(item for item in (*saved, *items) if isinstance(item, Card))
    dim = _last_word(cards, "DIM", DIMENSIONS) or dim
    deriv = _last_word(cards, "DERIV", ("DEG", "RAD")) or deriv
    return Deck(_resolve((*saved, *items)), cards, tuple(items), saved, tuple(findings), dim, deriv)


def assignments_of(group: Variables) -> Iterator[NamelistAssignment]:
    """Yield the assignments that make the variables of a namelist; a place that was not set begins
    a new one.
    """
    for variable, values in group.items():
        start = 0
        while start < len(values):
            stop = next((i for i in range(start, len(values)) if values[i] is None), len(values))
            if stop > start:
                yield NamelistAssignment(
                    0, variable, start + 1, tuple(x for x in values[start:stop] if x is not None)
                )
            start = stop + 1


def _last_word(cards: Sequence[Card], name: str, allowed: tuple[str, ...]) -> str:
    words = [card.text.split()[0] for card in cards if card.name == name and card.text]
    return next((word for word in reversed(words) if word in allowed), "")


def _resolve(items: Sequence[Item]) -> dict[str, Variables]:
    """Replay the namelists in order: later values overwrite only what they name."""
    seen: dict[str, Variables] = {}
    hidden: dict[str, Variables] = {}
    for item in items:
        if isinstance(item, Card):
            continue
        name = item.name
        seen.pop(_REPLACES.get(name, ""), None)
        if (other := _HIDES.get(name, "")) in seen:
            hidden[other] = seen.pop(other)
        group = seen.setdefault(name, hidden.pop(name, {}))
        for assignment in item.assignments:
            held = group.setdefault(assignment.variable, [])
            start, stop = assignment.start - 1, assignment.start - 1 + len(assignment.values)
            held += [None] * (stop - len(held))
            held[start:stop] = assignment.values
    return seen

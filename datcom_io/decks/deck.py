"""One case of an input deck: the cards as written, and what the program sees of them.

The program also sees the cards of earlier cases that SAVE replays.  Values that the program leaves
unset are absent here.
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
from flightmech.short_text import ShortText

Variables = dict[str, list[Value | None]]
"""Values of a namelist by variable; None where an index was not set."""
_LARGEST_ARRAY = 300  # no array of the program is longer than 60
# A new device of a case replaces the other one.
_REPLACES = {"SYMFLP": "ASYFLP", "ASYFLP": "SYMFLP"}
# Of the two power namelists one only hides the other.
_HIDES = {"PROPWR": "JETPWR", "JETPWR": "PROPWR"}
# Mach numbers that end the subsonic and start the supersonic methods, unless FLTCON gives them.
_SUBSONIC_END, _SUPERSONIC_START = 0.6, 1.4
# Cards whose presence alone does not change the results.
_NO_SWITCHES = ("NACA", "CASEID", "DIM", "DERIV", "SAVE", "NEXT", "DUMP")


@dataclass(frozen=True)
class Deck(ShortText):
    """The input of one case.

    Attributes
    ----------
    namelists : dict
        Namelist name to variable name to list of values (float, bool, or None where an index was
        not set); index 1 is item 0.  As the program sees them: replayed namelists included.
    cards : tuple of Card
        Control cards in order; NACA cards of a saved case come first.
    items : tuple of Namelist and Card
        The cards of this case as written, in order.
    replayed : tuple of Namelist and Card
        Namelists and NACA cards that SAVE brings from the cases before, as written there.
    findings : tuple of DeckFinding
        Cards that could not be read, and cards that the program would not read.
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
        errors = [finding for finding in self.findings if finding.severity == ERROR]
        return tuple((finding.line, finding.text) for finding in errors)

    @property
    def line(self) -> int:
        """First line of the case, 0 when it has no cards."""
        if not self.items:
            return 0
        return self.items[0].line

    def line_of(self, namelist: str, variable: str = "") -> int:
        """Return the line where a variable, or a namelist, was given last.

        Without the variable it is the line of the namelist, without the namelist that of the case.
        """
        for item in reversed((*self.replayed, *self.items)):
            if not isinstance(item, Namelist) or item.name != namelist:
                continue
            if not variable:
                return item.line
            lines = [entry.line for entry in item.assignments if entry.variable == variable]
            if lines:
                return lines[-1]
        if variable:
            return self.line_of(namelist)
        return self.line

    def values(self, namelist: str, variable: str) -> list[float]:
        """Return an array of numbers, NaN where an index was not set. [as in the deck]

        It is empty when the variable is not given.
        """
        numbers = []
        for item in self.namelists.get(namelist, {}).get(variable, []):
            if item is None:
                numbers.append(float("nan"))
            else:
                numbers.append(float(item))
        return numbers

    def value(self, namelist: str, variable: str) -> float | None:
        """Return a scalar, or the first item of an array; None when it is not given. [as in the
        deck]
        """
        first = self.namelists.get(namelist, {}).get(variable, [None])[0]
        if first is None:
            return None
        return float(first)

    def count(self, namelist: str, variable: str) -> int | None:
        """Return a count such as NALPHA; None when it is not given or not a count."""
        number = self.value(namelist, variable)
        if number is None or not 0 < number <= _LARGEST_ARRAY:
            return None
        return int(number)

    def schedule(self, namelist: str, variable: str, count: str) -> list[float]:
        """Return the items of an array in use, for example ``schedule("FLTCON", "ALSCHD",
        "NALPHA")``.
        """
        return self.values(namelist, variable)[: self.count(namelist, count)]

    @property
    def caseid(self) -> str:
        """Text of the last CASEID card, or an empty text."""
        for card in reversed(self.cards):
            if card.name == "CASEID":
                return card.text.strip()
        return ""

    @property
    def loop(self) -> int:
        """How Mach number and altitude step: 1 together, 2 altitude outside, 3 Mach outside."""
        number = self.value("FLTCON", "LOOP")
        if number in (2.0, 3.0):
            return int(number)
        return 1

    def has(self, card: str) -> bool:
        """Return whether a control card is given."""
        return any(card == item.name for item in self.cards)

    def conditions(self) -> list[tuple[float, float]]:
        """Return Mach number and altitude in the order of the run. [1, deck unit]

        The altitude is NaN where none is given.  Without Mach number the list is empty.
        """
        machs = self.schedule("FLTCON", "MACH", "NMACH")
        heights = self.schedule("FLTCON", "ALT", "NALT")
        if not heights:
            # With LOOP=1 both lists step together, so they have the same length.
            count = len(machs) if self.loop == 1 else 1
            heights = [float("nan")] * count
        if self.loop == 1:
            return list(zip(machs, heights))
        pairs = []
        if self.loop == 2:
            for height in heights:
                pairs += [(mach, height) for mach in machs]
        else:
            for mach in machs:
                pairs += [(mach, height) for height in heights]
        return pairs

    def regime(self, mach: float) -> str:
        """Return the methods of the program at a Mach number.

        They are ``subsonic``, ``transonic`` or ``supersonic``.
        """
        subsonic_end = self.value("FLTCON", "STMACH")
        if subsonic_end is None:
            subsonic_end = _SUBSONIC_END
        supersonic_start = self.value("FLTCON", "TSMACH")
        if supersonic_start is None:
            supersonic_start = _SUPERSONIC_START
        if mach <= subsonic_end:
            return "subsonic"
        if mach >= supersonic_start:
            return "supersonic"
        return "transonic"

    @property
    def sections(self) -> dict[str, str]:
        """Surface, ``W H V F``, to its NACA type and designation, such as ``4 2415``.

        The last card of a surface counts.
        """
        # Text of a NACA card: surface, separator, type, separator, designation.
        texts = [card.text for card in self.cards if card.name == "NACA"]
        return {text[:1]: f"{text[2:3]} {text[4:].strip()}" for text in texts}

    def meaning(self) -> dict[str, object]:
        """Return all input that reaches the program: decks of equal meaning give equal results.

        Numbers are rounded to nine digits, more than the single precision of the program can
        distinguish.  SAVE itself and the order of cards are left out.
        """
        namelists = {}
        for name, group in self.namelists.items():
            namelists[name] = {key: _format_values(values) for key, values in group.items()}
        switches = {card.name for card in self.cards if card.name not in _NO_SWITCHES}
        dumps = [card.text.replace(",", " ") for card in self.cards if card.name == "DUMP"]
        return {
            "namelists": namelists,
            "sections": self.sections,
            "switches": switches,
            "dumps": [" ".join(text.split()) for text in dumps],
            "caseid": self.caseid,
            "dim": self.dim,
            "deriv": self.deriv,
        }


def _format_values(values: Sequence[Value | None]) -> list[str | None]:
    """Return values as the program reads them, None where an index was not set."""
    texts: list[str | None] = []
    for value in values:
        texts.append(None if value is None else format_namelist_value(value))
    return texts


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
    dim, deriv = "FT", "DEG"
    saved: list[Item] = []
    if before:
        dim, deriv = before.dim, before.deriv
        if before.has("SAVE"):
            # SAVE replays namelists and NACA cards, not the other control cards.
            for item in (*before.replayed, *before.items):
                if isinstance(item, Namelist) or item.name == "NACA":
                    saved.append(item)
    cards = tuple(item for item in (*saved, *items) if isinstance(item, Card))
    return Deck(
        namelists=_resolve_namelists((*saved, *items)),
        cards=cards,
        items=tuple(items),
        replayed=tuple(saved),
        findings=tuple(findings),
        dim=_last_word(cards, "DIM", DIMENSIONS) or dim,
        deriv=_last_word(cards, "DERIV", ("DEG", "RAD")) or deriv,
    )


def assignments_of(group: Variables) -> Iterator[NamelistAssignment]:
    """Yield the assignments that make the variables of a namelist.

    An index that was not set ends an assignment, and the next index begins a new one.
    """
    for variable, values in group.items():
        run: list[Value] = []
        # The last None ends the last assignment.
        for index, value in enumerate([*values, None]):
            if value is not None:
                run.append(value)
            elif run:
                start = index - len(run) + 1
                yield NamelistAssignment(0, variable, start, tuple(run))
                run = []


def _last_word(cards: Sequence[Card], name: str, allowed: tuple[str, ...]) -> str:
    """Return the first word of the last card of a name that has an allowed one."""
    for card in reversed(cards):
        if card.name == name and card.text:
            word = card.text.split()[0]
            if word in allowed:
                return word
    return ""


def _resolve_namelists(items: Sequence[Item]) -> dict[str, Variables]:
    """Replay the namelists in order: later values overwrite only what they name."""
    resolved: dict[str, Variables] = {}
    hidden: dict[str, Variables] = {}
    for item in items:
        if isinstance(item, Card):
            continue
        resolved.pop(_REPLACES.get(item.name, ""), None)
        hidden_name = _HIDES.get(item.name, "")
        if hidden_name in resolved:
            hidden[hidden_name] = resolved.pop(hidden_name)
        group = resolved.setdefault(item.name, hidden.pop(item.name, {}))
        for assignment in item.assignments:
            values = group.setdefault(assignment.variable, [])
            start = assignment.start - 1
            stop = start + len(assignment.values)
            values += [None] * (stop - len(values))
            values[start:stop] = assignment.values
    return resolved

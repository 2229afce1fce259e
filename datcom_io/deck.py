"""Input cards as a listing echoes them: namelists and control cards of one case.

Card text starts in column 1 here.  A namelist opens with ``$NAME`` in column 2 and closes with a second ``$``; every
other card is a control card.  Values unset in the program are absent here.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from .cells import OK, read_cell

Value = float | bool
# bounded pieces and single blanks: a line of garbage must not take quadratic time
_ASSIGNMENT = re.compile(r"([A-Z][A-Z0-9]{0,7}) ?(?:\( ?(\d{1,4}) ?\))? ?=")
_REPEAT = re.compile(r"(\d{1,4}) ?\* ?(.+)")
_LOGICAL = re.compile(r"\.([TF])[A-Z]*\.?|([TF])")
_CONTROL_WORDS = frozenset(
    ("DIM", "DERIV", "CASEID", "DAMP", "PART", "BUILD", "TRIM", "PLOT", "NAMELIST", "DUMP", "PRINT", "NACA", "SAVE", "NEXT")
)
_LARGEST_ARRAY = 300  # no array of the program is longer than 60
# a new device of a saved case replaces the other one
_REPLACES = {"SYMFLP": "ASYFLP", "ASYFLP": "SYMFLP", "PROPWR": "JETPWR", "JETPWR": "PROPWR"}
_SPELLINGS = {("FLTCON", "ALPHA"): "ALSCHD"}  # TRNJET has an ALPHA of its own
DIMENSIONS = ("FT", "IN", "M", "CM")


class Card(NamedTuple):
    """A control card: line number in the file, first word, rest of the card."""

    line: int
    name: str
    text: str


@dataclass(frozen=True)
class Deck:
    """The input of one case.

    Attributes
    ----------
    namelists : dict
        Namelist name to variable name to list of values (float, bool, or None where an index was not set); index 1 is item 0.
    cards : tuple of Card
        Control cards in order; NACA cards of a saved case come first.
    problems : tuple of (int, str)
        Line number and text of what could not be read.
    dim, deriv : str
        Unit of length, ``FT IN M CM``; unit of derivatives, ``DEG RAD``.  They last until changed.
    """

    namelists: dict[str, dict[str, list[Value | None]]] = field(default_factory=dict)
    cards: tuple[Card, ...] = ()
    problems: tuple[tuple[int, str], ...] = ()
    dim: str = "FT"
    deriv: str = "DEG"

    def values(self, namelist: str, variable: str) -> list[float]:
        """Return an array of numbers; empty when it is not given. [as in the deck]"""
        found = self.namelists.get(namelist, {}).get(variable, [])
        return [float(x) if x is not None else float("nan") for x in found]

    def value(self, namelist: str, variable: str) -> float | None:
        """Return a scalar, or the first item of an array; None when it is not given. [as in the deck]"""
        found = self.namelists.get(namelist, {}).get(variable, [None])
        return None if found[0] is None else float(found[0])

    def count(self, namelist: str, variable: str) -> int | None:
        """Return a count such as NALPHA; None when it is not given or is no count."""
        number = self.value(namelist, variable)
        return int(number) if number is not None and 0 < number <= _LARGEST_ARRAY else None

    def schedule(self, namelist: str, variable: str, count: str) -> list[float]:
        """Return the items of an array in use, for example ``schedule("FLTCON", "ALSCHD", "NALPHA")``."""
        return self.values(namelist, variable)[: self.count(namelist, count)]

    @property
    def caseid(self) -> str:
        """Text of the CASEID card, or an empty text."""
        return next((card.text.strip() for card in reversed(self.cards) if card.name == "CASEID"), "")

    @property
    def loop(self) -> int:
        """How Mach number and altitude step: 1 together, 2 altitude outside, 3 Mach number outside."""
        number = self.value("FLTCON", "LOOP")
        return int(number) if number in (2.0, 3.0) else 1

    def has(self, card: str) -> bool:
        """Tell whether a control card is given."""
        return any(card == other.name for other in self.cards)

    def conditions(self) -> list[tuple[float, float]]:
        """Return Mach number and altitude in the order of the run; NaN without altitude, empty without Mach number. [1, deck unit]"""
        machs = self.schedule("FLTCON", "MACH", "NMACH")
        heights = self.schedule("FLTCON", "ALT", "NALT") or [float("nan")] * (len(machs) if self.loop == 1 else 1)
        if self.loop == 2:
            return [(mach, height) for height in heights for mach in machs]
        if self.loop == 3:
            return [(mach, height) for mach in machs for height in heights]
        return list(zip(machs, heights))

    def regime(self, mach: float) -> str:
        """Return ``subsonic``, ``transonic`` or ``supersonic``, the methods the program uses at a Mach number."""
        subsonic, supersonic = self.value("FLTCON", "STMACH"), self.value("FLTCON", "TSMACH")
        if mach <= (0.6 if subsonic is None else subsonic):
            return "subsonic"
        return "supersonic" if mach >= (1.4 if supersonic is None else supersonic) else "transonic"


def parse_cards(lines: Iterable[tuple[int, str]], before: Deck | None = None) -> Deck:
    """Return the deck of one case.

    Parameters
    ----------
    lines : iterable of (int, str)
        Line number and card text, column 1 of the card first.
    before : Deck, optional
        Deck of the case before in the same run: units are kept, namelists and NACA cards too when it has a SAVE card.
    """
    namelists: dict[str, dict[str, list[Value | None]]] = {}
    cards: list[Card] = []
    problems: list[tuple[int, str]] = []
    dim, deriv = (before.dim, before.deriv) if before else ("FT", "DEG")
    if before and before.has("SAVE"):
        namelists = {name: {key: list(items) for key, items in group.items()} for name, group in before.namelists.items()}
        cards = [card for card in before.cards if card.name == "NACA"]
    opened: list[str] = []  # cards of the namelist whose closing $ has not come yet
    start = 0
    for number, text in lines:
        if not opened:
            if not text.lstrip().startswith("$"):
                card = _control(number, text)
                if card.name in _CONTROL_WORDS:
                    cards.append(card)
                else:
                    problems.append((number, f"not a control card: {text.strip()}"))
                continue
            start, text = number, text.lstrip()[1:]
        body, closed, _ = text.partition("$")
        opened.append(body)
        if closed:
            _namelist(start, " ".join(opened), namelists, problems)
            opened = []
    if opened:
        problems.append((start, f"namelist without closing $: {opened[0][:40].strip()}"))
    dim = _last_word(cards, "DIM", DIMENSIONS) or dim
    deriv = _last_word(cards, "DERIV", ("DEG", "RAD")) or deriv
    return Deck(namelists, tuple(cards), tuple(problems), dim, deriv)


def _control(number: int, text: str) -> Card:
    words = text.split(None, 1)
    return Card(number, words[0] if words else "", words[1].rstrip() if len(words) > 1 else "")


def _last_word(cards: list[Card], name: str, allowed: tuple[str, ...]) -> str:
    words = [card.text.split()[0] for card in cards if card.name == name and card.text]
    return next((word for word in reversed(words) if word in allowed), "")


def _namelist(number: int, text: str, namelists: dict, problems: list[tuple[int, str]]) -> None:
    name, _, body = " ".join(text.split()).partition(" ")
    group = namelists.setdefault(name, {})
    namelists.pop(_REPLACES.get(name, ""), None)
    pieces = _ASSIGNMENT.split(body)
    if pieces[0].strip(" ,"):
        problems.append((number, f"${name}: {pieces[0].strip()} stands before any variable"))
    for variable, index, values in zip(pieces[1::3], pieces[2::3], pieces[3::3]):
        _assign(number, group, f"${name}", _SPELLINGS.get((name, variable), variable), int(index or 1), values, problems)


def _assign(number: int, group: dict, where: str, variable: str, index: int, text: str, problems: list[tuple[int, str]]) -> None:
    values: list[Value] = []
    for item in text.split(","):
        if not item.strip():
            continue
        repeat = _REPEAT.fullmatch(item.strip())
        value = _value(repeat[2] if repeat else item)
        if value is None:
            problems.append((number, f"{where}: {variable} has the value {item.strip()!r}, which is no number"))
            continue
        values += [value] * (min(int(repeat[1]), _LARGEST_ARRAY) if repeat else 1)
    if not values:
        return
    if not 0 < index <= _LARGEST_ARRAY or index - 1 + len(values) > _LARGEST_ARRAY:
        problems.append((number, f"{where}: {variable}({index}) holds {len(values)} values; an array has at most {_LARGEST_ARRAY}"))
        return
    held = group.setdefault(variable, [])
    held += [None] * (index - 1 + len(values) - len(held))
    held[index - 1 : index - 1 + len(values)] = values


def _value(text: str) -> Value | None:
    word = text.strip()
    if logical := _LOGICAL.fullmatch(word):
        return (logical[1] or logical[2]) == "T"
    cell = read_cell(word)
    return cell[0] if cell and cell[1] == OK else None

"""Cards as written: the namelists and control cards of one case, with their lines.

The program looks at columns: a namelist opens with ``$`` in column 2, a control card starts in
column 1, anything else continues the namelist that is open.  This reader is more patient; what the
program would stumble over is a `DeckFinding`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from datcom_io.decks.namelists import CASEID_COLUMNS, CONTROL_WORDS, SPELLINGS, Value, read_values

ERROR, WARNING, NOTE = "error", "warning", "note"


class DeckFinding(NamedTuple):
    """What a check found: line number from 1 (0: the whole deck), severity ``error``, ``warning``
    or ``note``, and text.

    An error stops the program, makes it leave out the case, or makes it print ERROR and drop what
    was requested; with a warning it runs, if need be with a value that it corrects itself, and the
    result needs care.
    """

    line: int
    severity: str
    text: str


class Card(NamedTuple):
    """A control card: line number in the file, first word, rest of the card."""

    line: int
    name: str
    text: str


class NamelistAssignment(NamedTuple):
    """``VARIABLE(start)=values`` of a namelist, with the line it stands on."""

    line: int
    variable: str
    start: int
    values: tuple[Value, ...]


class Namelist(NamedTuple):
    """One namelist as it stands in the deck."""

    line: int
    name: str
    assignments: tuple[NamelistAssignment, ...]


Item = Namelist | Card
_ASSIGN = re.compile(r"([A-Z][A-Z0-9]{0,9}) *+(?:\( *(\d{1,4}) *\) *+)?=")
_LARGEST_ARRAY = 300  # no array of the program is longer than 60
_CONTINUES = re.compile(r"[-+.\d]|[A-Z][A-Z0-9]* *+(?:\( *\d+ *\) *+)?=")


def control_card(line: int, text: str) -> Card | None:
    """Return the control card of a line, or None; column 1 comes first in `text`.

    Examples
    --------
    >>> control_card(1, "NACA-W-4-2412"), control_card(2, "* A COMMENT")
    (Card(line=1, name='NACA', text='W-4-2412'), None)
    """
    word = next((word for word in CONTROL_WORDS if text.startswith(word)), None)
    if word is None:
        return None
    name = word.split()[0]
    rest = text[len(name) :]
    return Card(line, name, rest[1:].strip() if name == "NACA" else rest.strip())


def read_items(lines: Iterable[tuple[int, str]]) -> tuple[list[Item], list[DeckFinding]]:
    """Read the cards of one case.

    Parameters
    ----------
    lines : iterable of (int, str)
        Line number and card text, column 1 of the card first.

    Returns
    -------
    items : list of Namelist and Card
        In order.
    findings : list of DeckFinding
        What could not be read, and what the program would not read.
    """
    reader = _CardReader()
    for number, text in lines:
        if text.strip():
            reader.take(number, text)
    reader.close_unended()
    return reader.items, reader.findings


class _CardReader:
    """The pass over the cards of a case: the namelist that is open, and what was found."""

    def __init__(self) -> None:
        self.items: list[Item] = []
        self.findings: list[DeckFinding] = []
        self.open: list[tuple[int, str]] | None = (
            None  # line and text of the namelist whose closing $ has not come
        )
        self.start = 0
        self.name = ""  # empty: a group the program does not know as a namelist
        self.place = 0  # among the items; control cards may stand inside a namelist

    def report(self, line: int, severity: str, text: str) -> None:
        self.findings.append(DeckFinding(line, severity, text))

    def take(self, line: int, text: str) -> None:
        plain = text.upper() if text[:6].upper() != "CASEID" else "CASEID" + text[6:]
        if plain != text:
            self.report(
                line,
                ERROR,
                "lower case: the program knows upper case only; write the deck with write_deck",
            )
            text = plain
        body = text.lstrip()
        if body.startswith("$"):
            self._dollar(line, text, body)
        elif text[0] != " ":
            self._column_one(line, text)
        elif self.open is not None:
            self._continue(line, text)
        elif body.startswith("&"):
            self.report(
                line,
                ERROR,
                f"{body.split()[0]}: & opens no namelist in this program, which ignores it; write $",
            )
            self._begin(line, "", "")
        elif card := control_card(line, body):
            self.report(
                line,
                ERROR,
                f"{card.name} does not start in column 1: the program overlooks it; move it there",
            )
            self.items.append(card)
        else:
            self.report(
                line, ERROR, f"belongs to no namelist: {body[:40].strip()}; open one with $NAME"
            )

    def _column_one(self, line: int, text: str) -> None:
        card = control_card(line, text)
        if card is not None:
            self._control(card, text)
        elif self.open is not None and _CONTINUES.match(text):
            self.report(
                line,
                ERROR,
                "a namelist goes on in column 1: the program takes it for a control card; "
                "leave column 1 blank",
            )
            self._continue(line, text)
        else:
            self.report(line, ERROR, f"not a control card: {text.strip()[:80]}")

    def _control(self, card: Card, text: str) -> None:
        if self.open is not None and card.name == "NACA":
            self.report(
                card.line,
                ERROR,
                f"NACA card inside namelist ${self.name}: it stops the program; close the "
                f"namelist with $ first",
            )
        if card.name == "DIM" and card.text[:2].ljust(2) != text[4:6].ljust(2):
            self.report(
                card.line,
                ERROR,
                "the unit of a DIM card stands in columns 5-6; write DIM and one blank",
            )
        if len(card.text) > CASEID_COLUMNS and card.name == "CASEID":
            self.report(
                card.line,
                WARNING,
                f"CASEID of {len(card.text)} characters: the program keeps {CASEID_COLUMNS}",
            )
            card = card._replace(text=card.text[:CASEID_COLUMNS])
        if card.name == "DERIV" and text[:9] not in ("DERIV DEG", "DERIV RAD"):
            self.report(
                card.line,
                ERROR,
                f"DERIV {card.text}: allowed are DERIV DEG and DERIV RAD, with one blank",
            )
        self.items.append(card)

    def _dollar(self, line: int, text: str, body: str) -> None:
        column = len(text) - len(body) + 1
        if body[1:4] == "END" and not body[4:5].isalnum():
            if self.open is not None:
                self._end(line)
            return
        if not body[1:].strip() and self.open is not None:
            if column <= 2:
                self.report(
                    line,
                    ERROR,
                    f"a $ alone in column {column}: the program takes it for a new namelist; "
                    f"write it behind the last value",
                )
            self._end(line)
            return
        if column != 2:
            self.report(
                line,
                ERROR,
                f"$ stands in column {column}: the program looks for it in column 2 only",
            )
        self.close_unended()
        name, _, rest = body[1:].partition(" ")
        name, dollar, more = name.partition("$")
        if not name:
            self.report(line, ERROR, "no name follows $; write $NAME without a blank between")
            name, _, rest = rest.lstrip().partition(" ")
        self._begin(line, name, f"{dollar}{more} {rest}")

    def _begin(self, line: int, name: str, rest: str) -> None:
        self.open, self.start, self.name, self.place = [], line, name, len(self.items)
        self._continue(line, rest)

    def _continue(self, line: int, text: str) -> None:
        assert self.open is not None
        body, closed, after = text.partition("$")
        self.open.append((line, body))
        if closed:
            self._end(line)
            self._after(line, after.strip())

    def _after(self, line: int, text: str) -> None:
        """Judge what follows a closing $ on its card."""
        if text.lstrip("$").partition(" ")[0] in ("", "END"):
            return
        lost = "=" in text
        self.report(
            line,
            ERROR if lost else WARNING,
            f"after the closing $: {text[:40]}; the program does not read it: put it on a "
            f"card of its own",
        )

    def _end(self, line: int) -> None:
        """Make an item of the namelist that is open."""
        opened, self.open = self.open or [], None
        if self.name:
            self.items.insert(
                self.place, Namelist(self.start, self.name, tuple(self._assignments(opened)))
            )

    def close_unended(self) -> None:
        """Close a namelist that another one, or the end of the case, follows without ``$``."""
        if self.open is None:
            return
        if self.name:
            problem = f"namelist without closing $: {self.name}"
            self.report(
                self.start, WARNING, f"{problem}; the program adds it in some places only: write it"
            )
        self._end(self.start)

    def _assignments(self, lines: list[tuple[int, str]]) -> Iterator[NamelistAssignment]:
        known = SPELLINGS.get(self.name, {})
        variable, start, at = "", 1, 0
        values: list[Value] = []
        for line, text in lines:
            *pieces, last = text.split(",")
            for piece in [*pieces, last] if last.strip() else pieces:
                place = 0
                while "=" in piece and (found := _ASSIGN.search(piece, place)):
                    if piece[place : found.start()].strip():
                        self._value(line, piece[place : found.start()], variable, values)
                        self.report(
                            line,
                            ERROR,
                            f"${self.name}: no comma before {found[1]}; it stops the program",
                        )
                    yield from self._complete(at, variable, start, values)
                    variable, start, at, values = (
                        known.get(found[1], found[1]),
                        int(found[2] or 1),
                        line,
                        [],
                    )
                    place = found.end()
                if piece[place:].strip():
                    self._value(line, piece[place:], variable, values)
                elif place:
                    self.report(
                        line,
                        ERROR,
                        f"${self.name}: {variable} has no value on its card; write it behind the =",
                    )
                else:
                    self.report(
                        line,
                        ERROR,
                        f"${self.name}: an empty place between commas; every value must be written",
                    )
        yield from self._complete(at, variable, start, values)

    def _value(self, line: int, text: str, variable: str, values: list[Value]) -> None:
        """Read one value and add it to `values`."""
        if not variable:
            self.report(
                line, ERROR, f"${self.name}: {text.strip()[:40]} stands before any variable"
            )
            return
        read, complaints = read_values(text.strip())
        values += read
        for severity, complaint in complaints:
            self.report(line, severity, f"${self.name}: {variable} {complaint}")

    def _complete(
        self, line: int, variable: str, start: int, values: list[Value]
    ) -> Iterator[NamelistAssignment]:
        if values and (not 0 < start <= _LARGEST_ARRAY or start - 1 + len(values) > _LARGEST_ARRAY):
            text = (
                f"${self.name}: {variable}({start}) holds {len(values)} values; an array has "
                f"at most {_LARGEST_ARRAY}"
            )
            self.report(line, ERROR, text)
        elif values:
            yield NamelistAssignment(line, variable, start, tuple(values))

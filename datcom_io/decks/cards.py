"""Cards as written: the namelists and control cards of one case, with their lines.

The program looks at columns: a namelist opens with ``$`` in column 2, a control card starts in
column 1, anything else continues the namelist that is open.  This reader accepts more; a card that
the program would not read as meant becomes a `DeckFinding`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from datcom_io.decks.namelists import CASEID_COLUMNS, CONTROL_WORDS, SPELLINGS, Value, read_values

ERROR, WARNING, NOTE = "error", "warning", "note"


class DeckFinding(NamedTuple):
    """Finding of a check: line number, severity ``error``, ``warning`` or ``note``, and text.

    Lines count from 1; 0 denotes the whole deck.  An error stops the program, makes it leave out
    the case, or makes it print ERROR and drop a requested result.  With a warning it runs, if need
    be with a value that it corrects itself, and the result needs care.
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
    for control_words in CONTROL_WORDS:
        if text.startswith(control_words):
            name = control_words.split()[0]
            content = text[len(name) :]
            # The separator behind NACA may be a hyphen.
            if name == "NACA":
                content = content[1:]
            return Card(line, name, content.strip())
    return None


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
        Cards that could not be read, and cards that the program would not read.
    """
    reader = _CardReader()
    for number, text in lines:
        if text.strip():
            reader.read_card(number, text)
    reader.close_unended()
    return reader.items, reader.findings


class _CardReader:
    """The pass over the cards of a case: the open namelist, the items and the findings."""

    def __init__(self) -> None:
        self.items: list[Item] = []
        self.findings: list[DeckFinding] = []
        # Line and text of each card of the namelist whose closing $ has not come.
        self.open: list[tuple[int, str]] | None = None
        self.start = 0
        self.name = ""  # empty: a group that is not a namelist of the program
        # Index of the namelist among the items; control cards may stand inside it.
        self.item_index = 0

    def report(self, line: int, severity: str, text: str) -> None:
        self.findings.append(DeckFinding(line, severity, text))

    def read_card(self, line: int, text: str) -> None:
        """Read one card: the start or the continuation of a namelist, or a control card."""
        # CASEID keeps its capitals, all other cards are upper case.
        plain = text.upper()
        if text[:6].upper() == "CASEID":
            plain = "CASEID" + text[6:]
        if plain != text:
            self.report(
                line,
                ERROR,
                "lower case: the program knows upper case only; write the deck with write_deck",
            )
            text = plain
        body = text.lstrip()
        if body.startswith("$"):
            self._read_dollar(line, text, body)
        elif text[0] != " ":
            self._read_column_one(line, text)
        elif self.open is not None:
            self._continue_namelist(line, text)
        elif body.startswith("&"):
            self.report(
                line,
                ERROR,
                f"{body.split()[0]}: & opens no namelist in this program, which ignores it; "
                f"write $",
            )
            self._begin_namelist(line, "", "")
        else:
            self._read_stray_card(line, body)

    def _read_stray_card(self, line: int, body: str) -> None:
        """Read a card outside a namelist that does not start in column 1."""
        card = control_card(line, body)
        if card is None:
            self.report(
                line, ERROR, f"belongs to no namelist: {body[:40].strip()}; open one with $NAME"
            )
            return
        self.report(
            line,
            ERROR,
            f"{card.name} does not start in column 1: the program overlooks it; move it there",
        )
        self.items.append(card)

    def _read_column_one(self, line: int, text: str) -> None:
        """Read a card with text in column 1: a control card, or a wrong continuation."""
        card = control_card(line, text)
        if card is not None:
            self._add_control_card(card, text)
        elif self.open is not None and _CONTINUES.match(text):
            self.report(
                line,
                ERROR,
                "a namelist goes on in column 1: the program takes it for a control card; "
                "leave column 1 blank",
            )
            self._continue_namelist(line, text)
        else:
            self.report(line, ERROR, f"not a control card: {text.strip()[:80]}")

    def _add_control_card(self, card: Card, text: str) -> None:
        """Add a control card, and report columns in which the program does not read it."""
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

    def _read_dollar(self, line: int, text: str, body: str) -> None:
        """Read a card that starts with $: a new namelist, or the end of the open one."""
        # The program looks for $ in column 2.
        column = len(text) - len(body) + 1
        if body[1:4] == "END" and not body[4:5].isalnum():
            if self.open is not None:
                self._end_namelist(line)
            return
        if not body[1:].strip() and self.open is not None:
            if column <= 2:
                self.report(
                    line,
                    ERROR,
                    f"a $ alone in column {column}: the program takes it for a new namelist; "
                    f"write it behind the last value",
                )
            self._end_namelist(line)
            return
        if column != 2:
            self.report(
                line,
                ERROR,
                f"$ stands in column {column}: the program looks for it in column 2 only",
            )
        # A new namelist ends one without $.
        self.close_unended()
        name, _, content = body[1:].partition(" ")
        # The namelist may end directly behind its name: $NAME$.
        name, dollar, behind = name.partition("$")
        if not name:
            self.report(line, ERROR, "no name follows $; write $NAME without a blank between")
            name, _, content = content.lstrip().partition(" ")
        self._begin_namelist(line, name, f"{dollar}{behind} {content}")

    def _begin_namelist(self, line: int, name: str, content: str) -> None:
        self.open, self.start, self.name = [], line, name
        self.item_index = len(self.items)
        self._continue_namelist(line, content)

    def _continue_namelist(self, line: int, text: str) -> None:
        assert self.open is not None
        # A $ behind a value ends the namelist.
        body, closed, after = text.partition("$")
        self.open.append((line, body))
        if closed:
            self._end_namelist(line)
            self._check_text_after_end(line, after.strip())

    def _check_text_after_end(self, line: int, text: str) -> None:
        """Report text behind a closing $ on its card."""
        if text.lstrip("$").partition(" ")[0] in ("", "END"):
            return
        # Values that are lost change the results; other text does not.
        severity = WARNING
        if "=" in text:
            severity = ERROR
        self.report(
            line,
            severity,
            f"after the closing $: {text[:40]}; the program does not read it: put it on a "
            f"card of its own",
        )

    def _end_namelist(self, line: int) -> None:
        """Make an item of the namelist that is open."""
        # The item stands where the namelist began, before control cards inside it.
        opened, self.open = self.open or [], None
        if self.name:
            self.items.insert(
                self.item_index, Namelist(self.start, self.name, tuple(self._assignments(opened)))
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
        self._end_namelist(self.start)

    def _assignments(self, lines: list[tuple[int, str]]) -> Iterator[NamelistAssignment]:
        """Yield the assignments of a namelist from the text of its cards."""
        spellings = SPELLINGS.get(self.name, {})
        current = NamelistAssignment(0, "", 1, ())
        values: list[Value] = []
        for line, text in lines:
            pieces = text.split(",")
            # A comma at the end of a card has no piece behind it.
            if not pieces[-1].strip():
                pieces.pop()
            for piece in pieces:
                position = 0
                # Without the comma between them one piece holds several assignments.
                for match in _assignment_matches(piece):
                    stray = piece[position : match.start()]
                    if stray.strip():
                        self._add_value(line, stray, current.variable, values)
                        self.report(
                            line,
                            ERROR,
                            f"${self.name}: no comma before {match[1]}; it stops the program",
                        )
                    yield from self._complete_assignment(current, values)
                    variable = spellings.get(match[1], match[1])
                    current = NamelistAssignment(line, variable, int(match[2] or 1), ())
                    values = []
                    position = match.end()
                if piece[position:].strip():
                    self._add_value(line, piece[position:], current.variable, values)
                elif position:
                    self.report(
                        line,
                        ERROR,
                        f"${self.name}: {current.variable} has no value on its card; write it "
                        f"behind the =",
                    )
                else:
                    self.report(
                        line,
                        ERROR,
                        f"${self.name}: an empty place between commas; every value must be written",
                    )
        yield from self._complete_assignment(current, values)

    def _add_value(self, line: int, text: str, variable: str, values: list[Value]) -> None:
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

    def _complete_assignment(
        self, assignment: NamelistAssignment, values: list[Value]
    ) -> Iterator[NamelistAssignment]:
        """Yield an assignment with its values, nothing when it has none or too many."""
        start, last = assignment.start, assignment.start - 1 + len(values)
        if not values:
            return
        if 0 < start <= _LARGEST_ARRAY and last <= _LARGEST_ARRAY:
            yield assignment._replace(values=tuple(values))
            return
        text = (
            f"${self.name}: {assignment.variable}({start}) holds {len(values)} values; an array "
            f"has at most {_LARGEST_ARRAY}"
        )
        self.report(assignment.line, ERROR, text)


def _assignment_matches(piece: str) -> Iterator[re.Match[str]]:
    """Yield the matches of ``VARIABLE(start)=`` in a piece of text."""
    # Most pieces are values; the pattern is slow.
    if "=" in piece:
        yield from _ASSIGN.finditer(piece)

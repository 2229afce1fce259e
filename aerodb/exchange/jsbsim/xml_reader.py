"""XML of strangers: elements with line numbers, nothing outside the file is ever opened.

Document type declarations, and with them all entities, are refused; size and depth are bounded.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np

from flightmech.errors import ParseError

LARGEST = 64 * 2**20  # bytes; 180 tables of 10 000 nodes take a third of it
DEEPEST = 100


@dataclass
class Element:
    """One element: `lines` holds its own text by line number."""

    tag: str
    attributes: dict[str, str]
    file: str
    line: int
    children: list[Element] = field(default_factory=list)
    lines: dict[int, str] = field(default_factory=dict)

    def all(self, tag: str) -> list[Element]:
        """Return the children of one tag."""
        return [child for child in self.children if child.tag == tag]

    def first(self, tag: str) -> Element | None:
        """Return the first child of one tag."""
        return next(iter(self.all(tag)), None)

    def walk(self) -> Iterator[Element]:
        """Yield the element and all below it, in the order of the file."""
        stack = [self]
        while stack:
            element = stack.pop()
            yield element
            stack += reversed(element.children)

    @property
    def text(self) -> str:
        """The text without blanks around it."""
        return "\n".join(self.lines.values()).strip()

    @property
    def number(self) -> float:
        """The text as one finite number."""
        found = [value for _, row in self.numbers() for value in row]
        if len(found) != 1:
            raise self.fault(f"<{self.tag}> with {len(found)} numbers", "one number")
        return float(found[0])

    def numbers(self) -> list[tuple[int, np.ndarray]]:
        """Return the numbers of each line of the text that has any, with its line number."""
        return [(at, np.array([self._finite(word, at) for word in words])) for at, text in self.lines.items() if (words := text.split())]

    def fault(self, found: str, expected: str, line: int = 0) -> ParseError:
        """Return the error of this element."""
        return ParseError(self.file, line or self.line, found, expected)

    def _finite(self, word: str, line: int) -> float:
        try:
            value = float(word) if "_" not in word else math.nan
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.fault(f"{word[:40]!r} in <{self.tag}>", "finite numbers separated by blanks", line)
        return value


def parse(path: str | Path) -> Element:
    """Return the root element of an XML file.

    Raises
    ------
    FileNotFoundError
        No such file.
    ParseError
        With the line: not XML, a document type declaration, too large or too deep.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file; give an XML file")
    if not path.is_file() or path.stat().st_size > LARGEST:
        raise ParseError(str(path), 0, "no plain file or more than 64 MB", "an XML file of moderate size; split the tables off")
    return _Builder(str(path)).read(path.read_bytes())


class _Builder:
    def __init__(self, file: str):
        self.file = file
        self.root: Element | None = None
        self.open: list[Element] = []
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = False
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = lambda tag: self.open.pop()
        self.parser.CharacterDataHandler = self._text
        self.parser.StartDoctypeDeclHandler = self._doctype

    def read(self, content: bytes) -> Element:
        try:
            self.parser.Parse(content, True)
        except expat.ExpatError as error:
            raise ParseError(self.file, error.lineno, expat.ErrorString(error.code), "well-formed XML; mend the file") from error
        except (LookupError, ValueError) as error:  # an encoding Python has not
            raise ParseError(self.file, 1, str(error), "XML in UTF-8; save it again") from error
        assert self.root is not None
        return self.root

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        line = self.parser.CurrentLineNumber
        if len(self.open) >= DEEPEST:
            raise ParseError(
                self.file, line, f"elements nested more than {DEEPEST} deep", "a flight model; nothing in one is nested so deep"
            )
        element = Element(tag, attributes, self.file, line)
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.root = element
        self.open.append(element)

    def _text(self, text: str) -> None:
        own = self.open[-1].lines
        for offset, part in enumerate(text.split("\n")):
            at = self.parser.CurrentLineNumber + offset
            own[at] = own.get(at, "") + part

    def _doctype(self, *_: object) -> None:
        raise ParseError(
            self.file,
            self.parser.CurrentLineNumber,
            "a document type declaration",
            "plain XML; entities and files outside are not read: write their content into the file and take the declaration out",
        )

"""Untrusted XML files as plain elements with line numbers: nothing outside the file is opened,
nothing is expanded.

The parser is the expat of the standard library.  It loads no external document type and no entity,
a declaration of an entity is refused, and size, depth and number of elements are limited, so that a
hostile file costs little.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np

from flightmech.errors import ParseError

MAX_BYTES = 2**27  # 180 tables of 10 000 nodes take a sixth of it
MAX_DEPTH = 200
MAX_ELEMENTS = 200_000  # a DAVE-ML model of 70 terms with 20 check cases has 8000
_REQUIRED = "it there; the format requires it"


@dataclass(slots=True)
class Element:
    """One element: name and attributes without namespace prefix, line of its start, children, and
    its own text by line number.

    A child leaves a blank in the text of its parent.
    """

    file: str
    tag: str
    line: int
    attributes: dict[str, str]
    children: list[Element] = field(default_factory=list)
    lines: dict[int, str] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """The text directly inside the element, without comments and without blanks around it."""
        return "\n".join(self.lines.values()).strip()

    @property
    def number(self) -> float:
        """The text as one finite number."""
        found = [value for _, row in self.numbers() for value in row]
        if len(found) != 1:
            raise self.error(f"<{self.tag}> with {len(found)} numbers", "one number")
        return float(found[0])

    def numbers(self) -> list[tuple[int, np.ndarray]]:
        """Return the numbers of each line of the text that has any, with its line number."""
        return [
            (at, np.array([self._finite(item, at) for item in items]))
            for at, text in self.lines.items()
            if (items := text.split())
        ]

    def all(self, *tags: str) -> list[Element]:
        """Return the children with one of these names, in order."""
        return [child for child in self.children if child.tag in tags]

    def first(self, *tags: str) -> Element | None:
        """Return the first child with one of these names."""
        return next((child for child in self.children if child.tag in tags), None)

    def need(self, *tags: str) -> Element:
        """Return the first child with one of these names; a missing one raises `ParseError`."""
        found = self.first(*tags)
        if found is None:
            raise self.error(f"<{self.tag}> without <{'> or <'.join(tags)}>", _REQUIRED)
        return found

    def attribute(self, name: str) -> str:
        """Return an attribute without blanks around it; a missing one raises `ParseError`."""
        if name not in self.attributes:
            raise self.error(f"<{self.tag}> without the attribute {name}", _REQUIRED)
        return self.attributes[name].strip()

    def walk(self) -> Iterator[Element]:
        """Yield the element and all below it, in the order of the file."""
        stack = [self]
        while stack:
            element = stack.pop()
            yield element
            stack += reversed(element.children)

    def error(self, found: str, expected: str, line: int = 0) -> ParseError:
        """Return a `ParseError` at a line of the file, that of the element unless given."""
        return ParseError(self.file, line or self.line, found, expected)

    def _finite(self, text: str, line: int) -> float:
        try:
            value = float(text) if "_" not in text else math.nan
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.error(
                f"{text[:40]!r} in <{self.tag}>", "finite numbers separated by blanks", line
            )
        return value


def read_xml(path: str | os.PathLike, doctype: bool = False) -> Element:
    """Return the root element of an XML file.

    Parameters
    ----------
    path : path
        The file.
    doctype : bool
        Accept a document type declaration.  It is not loaded, and entities are refused in any case.

    Raises
    ------
    FileNotFoundError, PermissionError
        The file cannot be read.
    ParseError
        With the line: not a regular file, not well-formed, a document type declaration, an entity,
        or beyond `MAX_BYTES`, `MAX_DEPTH` or `MAX_ELEMENTS`.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file; give an XML file")
    if not path.is_file():
        raise ParseError(str(path), 0, "not a regular file", "an XML file")
    if (size := path.stat().st_size) > MAX_BYTES:
        raise ParseError(
            str(path), 0, f"a file of {size} bytes", f"at most {MAX_BYTES}; split the tables off"
        )
    return _Builder(str(path), doctype).build(path.read_bytes())


class _Builder:
    """Handlers of one parse."""

    def __init__(self, file: str, doctype: bool):
        self.file = file
        self.root: Element | None = None
        self.open: list[Element] = []
        self.count = 0
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = False  # a buffered text has lost its line number
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        self.parser.EntityDeclHandler = self._entity
        self.parser.SkippedEntityHandler = self._unknown_entity
        self.parser.ExternalEntityRefHandler = self._unknown_entity
        if not doctype:
            self.parser.StartDoctypeDeclHandler = self._doctype

    def build(self, content: bytes) -> Element:
        try:
            self.parser.Parse(content, True)
        except expat.ExpatError as error:
            text = expat.ErrorString(error.code)
            raise ParseError(
                self.file,
                error.lineno,
                f"broken XML ({text})",
                "well-formed XML; copy or correct the file",
            ) from None
        except (
            LookupError,
            ValueError,
        ) as error:  # an encoding that Python does not have, or one of several bytes a character
            raise ParseError(
                self.file,
                1,
                f"an encoding that cannot be read ({error})",
                "UTF-8, UTF-16 or ISO-8859-1",
            ) from None
        assert self.root is not None
        return self.root

    def _error(self, found: str, expected: str) -> ParseError:
        return ParseError(self.file, self.parser.CurrentLineNumber, found, expected)

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        if len(self.open) >= MAX_DEPTH:
            raise self._error(
                f"elements nested more than {MAX_DEPTH} deep",
                "a flatter file; this one is damaged or hostile",
            )
        self.count += 1
        if self.count > MAX_ELEMENTS:
            raise self._error(
                f"more than {MAX_ELEMENTS} elements",
                "a smaller file; this one is damaged or hostile",
            )
        kept = {
            _local(key): text for key, text in attributes.items() if not key.startswith("xmlns")
        }
        element = Element(self.file, _local(name), self.parser.CurrentLineNumber, kept)
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.root = element
        self.open.append(element)

    def _end(self, name: str) -> None:
        self.open.pop()
        if self.open:
            self._text(" ")

    def _text(self, text: str) -> None:
        own = self.open[-1].lines
        for line, part in enumerate(text.split("\n"), self.parser.CurrentLineNumber):
            own[line] = own.get(line, "") + part

    def _doctype(self, *_: object) -> None:
        raise self._error(
            "a document type declaration",
            "plain XML; entities and files outside are not read: write their content into "
            "the file and delete the declaration",
        )

    def _entity(self, name: str, *declaration: object) -> None:
        raise self._error(
            f"a declaration of the entity {name!r}",
            "plain text; entities are refused, expand them first",
        )

    def _unknown_entity(self, name: str, *reference: object) -> int:
        raise self._error(
            f"the entity {name!r}",
            "plain text; no document type is loaded, write the character itself",
        )


def _local(name: str) -> str:
    return name.rsplit(":", 1)[-1]

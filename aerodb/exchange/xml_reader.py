"""Reader of untrusted XML files as plain elements with line numbers.

The parser is the expat of the standard library.  The reader opens no file except the XML file and
expands no entity: it loads no external document type, and refuses the declaration of an entity.
Size, depth and number of elements are limited, so that a hostile file takes little time and memory.
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
_MOST_CHARACTERS = 40  # of a faulty text in a message


@dataclass(slots=True)
class Element:
    """One element of an XML file.

    Parameters
    ----------
    file : str
        Path of the file.
    tag : str
        Name without namespace prefix.
    line : int
        Line of its start.
    attributes : dict of str to str
        Attributes, names without namespace prefix.
    children : list of Element
        Child elements.
    lines : dict of int to str
        Text of the element by line number.  A child leaves a blank in it.
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
        numbers: list[float] = []
        for _, row in self.numbers():
            numbers += row.tolist()
        if len(numbers) != 1:
            raise self.error(f"<{self.tag}> with {len(numbers)} numbers", "one number")
        return numbers[0]

    def numbers(self) -> list[tuple[int, np.ndarray]]:
        """Return line number and numbers of each line of the text that is not blank."""
        rows = []
        for line, text in self.lines.items():
            parts = text.split()
            if parts:
                rows.append((line, np.array([self._parse_finite(part, line) for part in parts])))
        return rows

    def all(self, *tags: str) -> list[Element]:
        """Return the children with one of these names, in order."""
        return [child for child in self.children if child.tag in tags]

    def first(self, *tags: str) -> Element | None:
        """Return the first child with one of these names."""
        return next((child for child in self.children if child.tag in tags), None)

    def need(self, *tags: str) -> Element:
        """Return the first child with one of these names; a missing one raises `ParseError`."""
        child = self.first(*tags)
        if child is None:
            raise self.error(f"<{self.tag}> without <{'> or <'.join(tags)}>", _REQUIRED)
        return child

    def attribute(self, name: str) -> str:
        """Return an attribute without blanks around it; a missing one raises `ParseError`."""
        if name not in self.attributes:
            raise self.error(f"<{self.tag}> without the attribute {name}", _REQUIRED)
        return self.attributes[name].strip()

    def walk(self) -> Iterator[Element]:
        """Yield the element and all below it, in the order of the file."""
        # A stack in place of a recursion, so that the depth does not matter.
        stack = [self]
        while stack:
            element = stack.pop()
            yield element
            stack += reversed(element.children)

    def error(self, found: str, expected: str, line: int = 0) -> ParseError:
        """Return a `ParseError` at a line of the file; 0 is the line of the element."""
        return ParseError(self.file, line or self.line, found, expected)

    def _parse_finite(self, text: str, line: int) -> float:
        # Python reads 1_000 as a number, XML does not.
        try:
            value = float(text) if "_" not in text else math.nan
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.error(
                f"{text[:_MOST_CHARACTERS]!r} in <{self.tag}>",
                "finite numbers separated by blanks",
                line,
            )
        return value


def read_xml(path: str | os.PathLike[str], doctype: bool = False) -> Element:
    """Return the root element of an XML file.

    Parameters
    ----------
    path : path
        The file.
    doctype : bool
        Whether a document type declaration is allowed.  It is not loaded, and entities are refused
        in any case.

    Raises
    ------
    FileNotFoundError, PermissionError
        The file cannot be read.
    ParseError
        The file is not a regular file or not well-formed, it has a document type declaration or an
        entity, or it exceeds `MAX_BYTES`, `MAX_DEPTH` or `MAX_ELEMENTS`; with the line.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file; give an XML file")
    if not path.is_file():
        raise ParseError(str(path), 0, "not a regular file", "an XML file")
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise ParseError(
            str(path), 0, f"a file of {size} bytes", f"at most {MAX_BYTES}; split the tables off"
        )
    return _Builder(str(path), doctype).build(path.read_bytes())


class _Builder:
    """Handlers of one parse: the root, the open elements and the number of elements."""

    def __init__(self, file: str, doctype: bool):
        self.file = file
        self.root: Element | None = None
        self.open: list[Element] = []
        self.count = 0
        self.parser = expat.ParserCreate()
        # A buffered text has no line numbers.
        self.parser.buffer_text = False
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
        except (LookupError, ValueError) as error:
            # Python does not have the encoding, or expat does not allow one of several bytes.
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
        # Declarations of namespaces are not attributes of the format.
        local_attributes = {}
        for key, text in attributes.items():
            if not key.startswith("xmlns"):
                local_attributes[_local_name(key)] = text
        line = self.parser.CurrentLineNumber
        element = Element(self.file, _local_name(name), line, attributes=local_attributes)
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.root = element
        self.open.append(element)

    def _end(self, name: str) -> None:
        self.open.pop()
        # The blank separates the texts before and after the child.
        if self.open:
            self._text(" ")

    def _text(self, text: str) -> None:
        lines = self.open[-1].lines
        for line, part in enumerate(text.split("\n"), self.parser.CurrentLineNumber):
            lines[line] = lines.get(line, "") + part

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


def _local_name(name: str) -> str:
    """Return a name without its namespace prefix."""
    return name.rsplit(":", 1)[-1]

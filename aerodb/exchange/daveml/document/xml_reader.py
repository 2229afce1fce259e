"""XML files of unknown origin as plain elements with line numbers: nothing is fetched, nothing is expanded.

The parser is the expat of the standard library.  It loads no external DTD and no entity, a document that declares an entity of its
own is refused at the declaration, and depth, size and number of elements are limited, so that a hostile file costs little.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from flightmech.errors import ParseError

MAX_DEPTH = 200
MAX_BYTES = 2**27
MAX_ELEMENTS = 200_000  # a database of 70 terms with 20 check cases has 8000


@dataclass(slots=True)
class Element:
    """One element: its name without namespace, attributes, children, the text directly inside it, and the line it starts at."""

    file: str
    tag: str
    line: int
    attributes: dict[str, str]
    children: list[Element] = field(default_factory=list)
    pieces: list[str] = field(default_factory=list)

    @property
    def text(self) -> str:
        """The text directly inside the element, comments and ends taken off."""
        return "".join(self.pieces).strip()

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
            raise self.error(f"<{self.tag}> without <{'> or <'.join(tags)}>", "it there, as the DAVE-ML 2.0.2 DTD demands")
        return found

    def attribute(self, name: str) -> str:
        """Return an attribute, ends taken off; a missing one raises `ParseError`."""
        if name not in self.attributes:
            raise self.error(f"<{self.tag}> without the attribute {name}", "it there, as the DAVE-ML 2.0.2 DTD demands")
        return self.attributes[name].strip()

    def error(self, found: str, expected: str) -> ParseError:
        """Return a `ParseError` at the place of this element."""
        return ParseError(self.file, self.line, found, expected)


def parse(path: str | os.PathLike) -> Element:
    """Return the root element of an XML file.

    Raises
    ------
    FileNotFoundError, IsADirectoryError, PermissionError
        The file cannot be read.
    ParseError
        It is no well-formed XML, declares or uses entities of its own, is deeper than `MAX_DEPTH`, larger than `MAX_BYTES` or has
        more than `MAX_ELEMENTS`.
    """
    path = Path(path)
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise ParseError(str(path), 0, f"a file of {size} bytes", f"at most {MAX_BYTES}")
    return _Builder(str(path)).build(path.read_bytes())


class _Builder:
    """Handlers of one parse."""

    def __init__(self, file: str):
        self.file = file
        self.root: Element | None = None
        self.open: list[Element] = []
        self.count = 0
        self.parser = expat.ParserCreate(namespace_separator=" ")
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._characters
        self.parser.EntityDeclHandler = self._entity
        self.parser.SkippedEntityHandler = self._unknown_entity
        self.parser.ExternalEntityRefHandler = self._unknown_entity

    def build(self, content: bytes) -> Element:
        try:
            self.parser.Parse(content, True)
        except expat.ExpatError as error:
            text = expat.ErrorString(error.code)
            raise ParseError(self.file, error.lineno, f"broken XML ({text})", "a well-formed DAVE-ML file; copy it again") from None
        except (LookupError, ValueError) as error:  # an encoding that Python does not know, or one of several bytes a character
            raise ParseError(self.file, 1, f"an encoding that cannot be read ({error})", "UTF-8, UTF-16 or ISO-8859-1") from None
        if self.root is None:
            raise ParseError(self.file, 0, "no element", "a DAVE-ML file")
        return self.root

    def _error(self, found: str, expected: str) -> ParseError:
        return ParseError(self.file, self.parser.CurrentLineNumber, found, expected)

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        if len(self.open) >= MAX_DEPTH:
            raise self._error(f"elements nested {MAX_DEPTH} deep", "a flatter file; this one looks damaged or hostile")
        self.count += 1
        if self.count > MAX_ELEMENTS:
            raise self._error(f"more than {MAX_ELEMENTS} elements", "a smaller file; this one looks damaged or hostile")
        element = Element(self.file, _local(name), self.parser.CurrentLineNumber, {_local(key): text for key, text in attributes.items()})
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.root = element
        self.open.append(element)

    def _end(self, name: str) -> None:
        self.open.pop()

    def _characters(self, text: str) -> None:
        self.open[-1].pieces.append(text)

    def _entity(self, name: str, *declaration: object) -> None:
        raise self._error(f"a declaration of the entity {name!r}", "plain text; entities are refused, expand them first")

    def _unknown_entity(self, name: str, *reference: object) -> int:
        raise self._error(f"the entity {name!r}", "plain text; no DTD is loaded, write the character itself")


def _local(name: str) -> str:
    return name.rsplit(" ", 1)[-1]

"""Reader of TOML files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from flightmech.errors import ParseError
from flightmech.support.file_kinds import TOML, file_kind
from flightmech.support.input_files import decode_text, read_bytes, with_line_feeds
from flightmech.support.toml_text import toml_content

_TOML = "a TOML text (key = value, texts in quotes)"


def read_toml(path: str | Path) -> dict[str, Any]:
    """Return the content of a TOML file.

    Raises
    ------
    ParseError
        The text is not TOML, has another encoding or exceeds the limits of `toml_content`, or the
        file is not a regular file.
    """
    path = Path(path)
    raw = read_bytes(path, _TOML)
    try:
        text = with_line_feeds(decode_text(raw, path, _TOML))
    except ParseError as error:
        # a file of another kind gets the name of its kind instead of a byte
        kind = file_kind(path)
        if kind.startswith(("a text", "bytes", "a TOML", *TOML)):
            raise
        raise ParseError(str(path), 0, kind, _TOML) from error
    try:
        return toml_content(text)
    except ValueError as error:
        kind = file_kind(path)
        if not kind.startswith("a text"):
            raise ParseError(str(path), 0, kind, _TOML) from error
        message = str(error)
        # tomllib writes the line into its message: "(at line 3, column 4)"
        match = _LINE.search(message)
        number = int(match.group(1)) if match else 0
        lines = text.splitlines()
        if not 0 < number <= len(lines):
            raise ParseError(str(path), 0, message, _TOML) from error
        raise ParseError(
            file=str(path),
            line=number,
            found=f"{lines[number - 1].strip()[:60]!r} ({message})",
            expected=f"{_TOML}; a number with a unit is a text too, 'S = \"16.9 m2\"'",
        ) from error


_LINE = re.compile(r"\(at line (\d+)[,)]")

"""The content of a TOML file of a user, and what kind of file it is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ...errors import ParseError
from ..file_kinds import TOML, file_kind
from ..input_files.text import decoded, read_bytes, with_line_feeds
from ..input_files.toml_text import toml_content

_TOML = "a TOML text (key = value, texts in quotes)"


def load(path: str | Path) -> dict[str, Any]:
    """Return the content of a TOML file.

    Raises
    ------
    ParseError
        With the line, when the text is not TOML; no regular file, another encoding, or a text beyond the limits of `toml_content`.
    """
    path = Path(path)
    raw = read_bytes(path, _TOML)
    try:
        text = with_line_feeds(decoded(raw, path, _TOML))
    except ParseError as error:
        kind = file_kind(path)
        if kind.startswith(("a text", "bytes", "a TOML", *TOML)):
            raise
        raise ParseError(str(path), 0, kind, _TOML) from error
    try:
        return toml_content(text)
    except ValueError as error:
        place = str(error)
        line = int(place.rsplit("line ", 1)[1].split(",")[0].rstrip(")")) if "(at line " in place else 0
        kind = file_kind(path)
        if not kind.startswith("a text"):
            raise ParseError(str(path), 0, kind, _TOML) from error
        written = text.splitlines()
        if not 0 < line <= len(written):
            raise ParseError(str(path), 0, place, _TOML) from error
        expected = f"{_TOML}; a number with a unit is a text too, 'S = \"16.9 m2\"'"
        raise ParseError(str(path), line, f"{written[line - 1].strip()[:60]!r} ({place})", expected) from error


def foreign_kind(content: Mapping[str, Any], own: Iterable[str] = ()) -> str:
    """Return what the content of a TOML file is when it is plainly one of another kind than that with the keys `own`, else nothing."""
    for kind, (keys, use) in TOML.items():
        if keys <= set(content) and not keys & set(own):
            return f"this is {kind} (it has {', '.join(sorted(keys))}), which {use}"
    return ""

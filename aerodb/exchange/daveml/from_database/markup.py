"""XML written line by line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from ..descriptions import legal

_STEP = "  "
_ROW = 8  # numbers in a line


def element(tag: str, attributes: Mapping[str, str] | None = None, inside: Sequence[str] | str | None = None) -> list[str]:
    """Return an element as lines; `inside` is its text, or the lines of its children."""
    head = tag + "".join(f" {key}={quoteattr(legal(text))}" for key, text in (attributes or {}).items() if text != "")
    if inside is None or len(inside) == 0:
        return [f"<{head}/>"]
    if isinstance(inside, str):
        return [f"<{head}>{escape(legal(inside))}</{tag}>"]
    return [f"<{head}>", *(_STEP + line for line in inside), f"</{tag}>"]


def text(tag: str, content: str) -> list[str]:
    """Return an element of several lines of text, each at the margin; nothing for no text."""
    return [f"<{tag}>", *escape(legal(content)).split("\n"), f"</{tag}>"] if content.strip() else []


def numbers(values: np.ndarray) -> list[str]:
    """Return an array as lines of comma-separated numbers in C order, a new line for each row; every number is exact."""
    rows = values.reshape(-1, values.shape[-1] if values.ndim else 1).tolist()
    lines = [row[i : i + _ROW] for row in rows for i in range(0, len(row), _ROW)]
    return [", ".join(map(repr, line)) + ("," if i + 1 < len(lines) else "") for i, line in enumerate(lines)]

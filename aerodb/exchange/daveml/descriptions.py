"""What DAVE-ML has no element for, as ``key: text`` lines in a ``description``; read back from files written by this package."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import groupby

import numpy as np

from flightmech.terms import SOURCES

WRITER = "aeromatch"  # how the fileVersion of our files begins
_MORE = "| "  # a line that goes on
_KEY = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)(:=|:) ?(.*)", re.DOTALL)


def packed(attributes: Mapping[str, str | float]) -> str:
    """Return attributes as lines; numbers stand behind ``:=``.  Characters that XML does not allow become question marks."""
    lines = []
    for key, item in attributes.items():
        if isinstance(item, str):
            lines += f"{key}: {item}".replace("\r", "").replace("\n", f"\n{_MORE}").split("\n")
        else:
            lines.append(f"{key}:= {item}" if isinstance(item, int | np.integer) else f"{key}:= {float(item)!r}")
    return legal("\n".join(lines))


def unpacked(text: str) -> dict[str, str | float]:
    """Return the attributes that `packed` wrote."""
    found: dict[str, str | float] = {}
    for line in text.replace(f"\n{_MORE}", "\0").replace("\n|", "\0").split("\n"):
        match = _KEY.fullmatch(line)
        if match:
            found[match[1]] = _number(match[3]) if match[2] == ":=" else match[3].replace("\0", "\n")
    return found


def _number(text: str) -> int | float:
    return int(text) if re.fullmatch(r"-?\d{1,18}", text) else float(text)


def legal(text: str) -> str:
    """Return a text in which the characters that XML does not allow are question marks."""
    return re.sub("[^\t\n\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "?", text)


def runs(source: np.ndarray) -> str:
    """Return the source codes of nodes as runs in C order: ``12 datcom, 3 judgement``."""
    return ", ".join(f"{len(list(group))} {SOURCES[code]}" for code, group in groupby(source.ravel().tolist()))


def codes(text: str, shape: tuple[int, ...]) -> np.ndarray | None:
    """Return the source codes that `runs` wrote, or None when they do not fit the shape."""
    pairs = [part.split() for part in text.split(", ")]
    if not all(len(pair) == 2 and pair[0].isdigit() and pair[1] in SOURCES for pair in pairs):
        return None
    counts = [int(pair[0]) for pair in pairs]
    if sum(counts) != int(np.prod(shape)):
        return None
    return np.repeat([SOURCES.index(pair[1]) for pair in pairs], counts).astype(np.uint8).reshape(shape)

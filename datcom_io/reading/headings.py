"""The heading of a page: its kind, the configuration, ground effect, flap and power."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import NamedTuple

from ..cells import read_cell

TITLES = (
    ("CHARACTERISTICS AT ANGLE OF ATTACK", "static"),
    ("DYNAMIC DERIVATIVES", "dynamic"),
    ("CHARACTERISTICS OF HIGH LIFT", "high-lift"),
    ("CONFIGURATION AUXILIARY", "auxiliary"),
    ("SECTION DEFINITION", "section"),
    ("USER DEFINED", "section"),
    ("AERODYNAMIC CONTROL EFFECTIVENESS", "hypersonic"),
    ("SPECIAL CONTROL METHODS", "special"),
    ("TRANSVERSE-JET CONTROL", "special"),
    ("LIST OF FINAL INPUTS", "final inputs"),
    ("EXTRAPOLATION MESSAGE SUMMARY", "extrapolation"),
    ("FOLLOWING ARE", "dump"),
)
_KINDS = (*TITLES, (")=", "dump"))
_WITH_CONFIGURATION = ("static", "dynamic", "high-lift", "auxiliary")
_GROUND = re.compile(r"GROUND HEIGHT= *(FREE AIR|[\d.]+)")
_FLAP = re.compile(r"FLAP DEFLECTION= *(-?[\d.]+)")
_POWER = re.compile(r"(JET|PROPELLER) POWER EFFECTS INCLUDED")
_LONGEST = 1000  # characters of a heading of the program; longer ones are not worth remembering


class Heading(NamedTuple):
    """The content of a heading; the height over ground in feet, the deflection in degrees, as in `Page`."""

    kind: str
    configuration: str
    ground_height: float
    flap: float
    power: str


def read_heading(first: str, words: tuple[str, ...]) -> Heading:
    """Return what the first line of a page and the words of the heading lines below it state; the same headings come again and again."""
    known = len(first) + sum(map(len, words)) <= _LONGEST
    return _known(first, words) if known else _read(first, words)


def _read(first: str, words: tuple[str, ...]) -> Heading:
    kind = _kind(first, words)
    lines = "\n".join(words[1:])
    power = _POWER.search(lines)
    configuration = words[1].removesuffix(" CONFIGURATION") if kind in _WITH_CONFIGURATION and words[1:] else ""
    return Heading(kind, configuration, _ground_height(lines), _number(_FLAP, lines), power[1].lower() if power else "off")


_known = lru_cache(1024)(_read)


def _kind(first: str, heading: tuple[str, ...]) -> str:
    """Return the kind of a page by its first line or the line below the program's name."""
    for words, kind in _KINDS:
        if words in first or (heading and words in heading[0]):
            return kind
    return "other"


def _ground_height(words: str) -> float:
    found = _GROUND.search(words)
    return float("inf") if found is None or found[1] == "FREE AIR" else _number(_GROUND, words)


def _number(pattern: re.Pattern[str], words: str) -> float:
    found = pattern.search(words)
    cell = read_cell(found[1]) if found else None
    return cell[0] if cell else float("nan")

"""The study: one deck that describes an aircraft with all its devices, and the plan of the runs to
make of it.

A study is a deck of one case, alone or with a TOML file next to it::

    deck = "t37_study.inp"                       # the aircraft, next to this file
    title = "T-37"                               # opens every CASEID; default: the CASEID of the deck
    devices = ["flaps", "elevator", "aileron"]   # what the SYMFLP and ASYFLP of the deck are, in their order

    [runs.clean]                                 # the runs to make; default: all that the deck gives
    cards = "DAMP"                               # cards added to the run, later values overwrite
    [runs.flaps]
    caseid = "T-37 FLAPS"                        # the whole CASEID
    separate = false                             # one deck for all flight conditions; default for SYMFLP: one deck each
    cards = '''
     $FLTCON NMACH=1.0,MACH(1)=0.15$
    '''
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from datcom_io.decks.cards import Namelist
from datcom_io.decks.deck import Deck
from datcom_io.decks.deck_file import DeckFile, read_deck
from flightmech.errors import SchemaError
from flightmech.support.input_files import read_toml

# word: namelist, and whether the device is on the tail
DEVICES = {
    "flaps": ("SYMFLP", False),
    "slats": ("SYMFLP", False),
    "elevator": ("SYMFLP", True),
    "aileron": ("ASYFLP", False),
    "spoiler": ("ASYFLP", False),
    "differential_tail": ("ASYFLP", True),
}
_KEYWORDS = {"FLAP": "flaps", "SLAT": "slats", "ELEVATOR": "elevator"}
_ROUNDING, _CORRECTED = (
    1e-3,
    0.1,
)  # of the half span: a flap may begin so far inside the body; the program moves it to the side
_ANY_DEVICE = (
    "SYMFLP",
    "SYMMETRIC",
)  # of headings such as SYMMETRICAL FLAP DEFLECTION PARAMETERS, which stand above elevators too
_SPOILERS, _AILERON, _DIFFERENTIAL_TAIL = (1, 2, 3), 4, 5
_KEYS: dict[str, type] = {"deck": str, "title": str, "devices": list, "runs": dict}
_RUN_KEYS: dict[str, type] = {"caseid": str, "cards": str, "separate": bool}


@dataclass(frozen=True)
class RunPlan:
    """What the study file states about one run."""

    caseid: str = ""
    cards: str = ""
    separate: bool | None = None


@dataclass(frozen=True)
class DeckStudy:
    """A study: the deck, the devices by name (each the SYMFLP or ASYFLP cards that make it), and
    the plan.
    """

    file: str
    base: Deck
    title: str
    devices: dict[str, tuple[Namelist, ...]]
    plans: dict[str, RunPlan] = field(default_factory=dict)


def word_of(name: str) -> str:
    """Return the word of `DEVICES` that a device's name begins with: ``flaps`` of ``flaps_2``;
    empty when there is none.
    """
    return next((word for word in DEVICES if name == word or name.startswith(f"{word}_")), "")


def is_on_tail(name: str) -> bool:
    """Return whether a device of that name is on the tail."""
    return DEVICES[word_of(name)][1]


def read_study(source: str | os.PathLike[str] | DeckFile) -> DeckStudy:
    """Read a study: a deck, or a TOML file that names one.

    Raises
    ------
    SchemaError
        Unknown keys, more than one case, devices that cannot be distinguished; all problems at
        once.
    ParseError
        The TOML file cannot be read.
    """
    if isinstance(source, DeckFile):
        return _study(source, {})
    path = Path(source)
    if path.suffix.lower() != ".toml":
        return _study(read_deck(path), {})
    content = read_toml(path)
    problems = _wrong_keys(content)
    if problems:
        raise SchemaError(path.name, problems)
    return _study(read_deck(path.parent / content["deck"]), content)


def _wrong_keys(content: dict) -> list[str]:
    problems = [] if "deck" in content else ["no deck; write deck = 'file.inp'"]
    problems += _wrong(content, _KEYS, "")
    for name, run in content["runs"].items() if isinstance(content.get("runs"), dict) else ():
        problems += (
            _wrong(run, _RUN_KEYS, f"runs.{name}.")
            if isinstance(run, dict)
            else [f"runs.{name} is no table"]
        )
    return problems


def _wrong(table: dict, keys: dict[str, type], where: str) -> list[str]:
    unknown = [
        f"unknown key {where}{key}; allowed: {', '.join(keys)}" for key in table if key not in keys
    ]
    kinds = [
        f"{where}{key} is {table[key]!r}; it must be a {kind.__name__}"
        for key, kind in keys.items()
        if not isinstance(table.get(key, kind()), kind)
    ]
    return unknown + kinds


def _study(deck: DeckFile, content: dict) -> DeckStudy:
    if len(deck) != 1:
        raise SchemaError(
            deck.file,
            [f"{len(deck)} cases; a study is one case that holds the aircraft and all its devices"],
        )
    base = deck[0]
    groups = _groups(base)
    names, problems = _names(deck, groups, content.get("devices", []))
    plans = {name: RunPlan(**run) for name, run in content.get("runs", {}).items()}
    if problems:
        raise SchemaError(deck.file, problems)
    return DeckStudy(
        deck.file,
        base,
        content.get("title", base.caseid),
        dict(zip(names, groups, strict=True)),
        plans,
    )


def _groups(base: Deck) -> list[tuple[Namelist, ...]]:
    """Return the devices of the deck: a SYMFLP or ASYFLP without NDELTA goes on with the one
    before.
    """
    groups: list[tuple[Namelist, ...]] = []
    for item in base.items:
        if isinstance(item, Namelist) and item.name in ("SYMFLP", "ASYFLP"):
            begins = any(assignment.variable == "NDELTA" for assignment in item.assignments)
            if not begins and groups and groups[-1][0].name == item.name:
                groups[-1] = (*groups[-1], item)
            else:
                groups.append((item,))
    return groups


def _names(
    deck: DeckFile, groups: Sequence[tuple[Namelist, ...]], given: list
) -> tuple[list[str], list[str]]:
    """Return the names of the devices and the problems in finding them."""
    problems = []
    if given and len(given) != len(groups):
        problems.append(
            f"devices names {len(given)}, the deck has {len(groups)} (SYMFLP and ASYFLP in "
            f"their order)"
        )
        return [], problems
    names: list[str] = []
    for i, group in enumerate(groups):
        name = str(given[i]) if given else _name(deck, group)
        word = word_of(name)
        if not word or DEVICES[word][0] != group[0].name:
            allowed = ", ".join(
                word for word, (namelist, _) in DEVICES.items() if namelist == group[0].name
            )
            which = f"device {name!r}" if name else "it may be on the wing or on the tail"
            problems.append(
                f"line {group[0].line}, ${group[0].name}: {which}; name it in a study file, "
                f"devices = [...], allowed: {allowed}, "
                "or by a comment above it"
            )
        count = 2
        unique = name
        while unique in names:
            unique, count = f"{name}_{count}", count + 1
        names.append(unique)
    return names, problems


def _name(deck: DeckFile, group: tuple[Namelist, ...]) -> str:
    """Name a device by its type, by a comment above it, or by the only surface it fits on."""
    values = {
        assignment.variable: assignment.values[0]
        for item in group
        for assignment in item.assignments
        if assignment.values
    }
    if group[0].name == "ASYFLP":
        kind = round(float(values.get("STYPE", 0.0)))
        return (
            "aileron"
            if kind == _AILERON
            else "spoiler"
            if kind in _SPOILERS
            else "differential_tail"
            if kind == _DIFFERENTIAL_TAIL
            else ""
        )
    there = {
        name: surface
        for name, surface in (("flaps", "WGPLNF"), ("elevator", "HTPLNF"))
        if surface in deck[0].namelists
    }
    named = _named_above(deck, group[0].line)
    for inside in (_ROUNDING, _CORRECTED):
        fits = [
            name
            for name, surface in there.items()
            if len(there) == 1 or _fits(deck[0], surface, values, inside)
        ]
        if len(fits) == 1:
            return named if named and is_on_tail(named) == is_on_tail(fits[0]) else fits[0]
        if fits:
            break
    return named


def _named_above(deck: DeckFile, line: int) -> str:
    """Return the device that the comment next above a line names; a heading that holds for any
    symmetrical flap names none.
    """
    above = max((item.line for item in deck[0].items if item.line < line), default=0)
    for at, text in reversed(deck.comments):
        words = text.upper()
        if above < at < line and not any(generic in words for generic in _ANY_DEVICE):
            found = [name for keyword, name in _KEYWORDS.items() if keyword in words]
            if len(found) == 1:
                return found[0]
    return ""


def _fits(base: Deck, surface: str, values: dict, inside: float) -> bool:
    """Return whether a flap ends within the tip of a surface and begins no farther inside the body
    than a share of the half span.
    """
    tip, exposed = base.value(surface, "SSPN"), base.value(surface, "SSPNE")
    if tip is None or exposed is None:
        return False
    inner, outer = float(values.get("SPANFI", 0.0)), float(values.get("SPANFO", 0.0))
    return inner >= tip - exposed - inside * tip and outer <= tip + _ROUNDING * tip

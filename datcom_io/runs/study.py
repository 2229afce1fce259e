"""The study: one deck of an aircraft with all its devices, and the plan of the runs.

A study is a deck of one case, alone or with a TOML file next to it::

    deck = "t37_study.inp"      # the aircraft, next to this file
    title = "T-37"              # opens every CASEID; default: the CASEID of the deck
    # names of the SYMFLP and ASYFLP of the deck, in their order
    devices = ["flaps", "elevator", "aileron"]

    [runs.clean]                # the runs to make; default: all runs of the deck
    cards = "DAMP"              # cards added to the run, later values overwrite
    [runs.flaps]
    caseid = "T-37 FLAPS"       # the whole CASEID
    separate = false            # one deck for all flight conditions; default for SYMFLP: one each
    cards = '''
     $FLTCON NMACH=1.0,MACH(1)=0.15$
    '''
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from datcom_io.decks.cards import Namelist
from datcom_io.decks.deck import Deck
from datcom_io.decks.deck_file import DeckFile, read_deck
from flightmech.errors import SchemaError
from flightmech.support.toml_files import read_toml

# Word of a device: its namelist, and whether the device is on the tail.
DEVICES = {
    "flaps": ("SYMFLP", False),
    "slats": ("SYMFLP", False),
    "elevator": ("SYMFLP", True),
    "aileron": ("ASYFLP", False),
    "spoiler": ("ASYFLP", False),
    "differential_tail": ("ASYFLP", True),
}
_KEYWORDS = {"FLAP": "flaps", "SLAT": "slats", "ELEVATOR": "elevator"}
# Shares of the half span by which a flap may begin inside the body; the program moves it to the
# side of the body.
_ROUNDING, _CORRECTED = 1e-3, 0.1
# Words of headings such as SYMMETRICAL FLAP DEFLECTION PARAMETERS, which are used above elevators
# too.
_ANY_DEVICE = ("SYMFLP", "SYMMETRIC")
_DEVICE_OF_STYPE = {
    1: "spoiler",
    2: "spoiler",
    3: "spoiler",
    4: "aileron",
    5: "differential_tail",
}
_KEYS: dict[str, type] = {"deck": str, "title": str, "devices": list, "runs": dict}
_RUN_KEYS: dict[str, type] = {"caseid": str, "cards": str, "separate": bool}


@dataclass(frozen=True)
class RunPlan:
    """Plan of one run in the study file."""

    caseid: str = ""
    cards: str = ""
    separate: bool | None = None


@dataclass(frozen=True)
class DeckStudy:
    """A study: the deck, the devices by name, and the plan.

    Each device is the SYMFLP or ASYFLP cards that make it.
    """

    file: str
    base: Deck
    title: str
    devices: dict[str, tuple[Namelist, ...]]
    plans: dict[str, RunPlan] = field(default_factory=dict)


def word_of(name: str) -> str:
    """Return the word of `DEVICES` that the name of a device begins with.

    It is ``flaps`` of ``flaps_2``, and empty when there is none.
    """
    for word in DEVICES:
        if name == word or name.startswith(f"{word}_"):
            return word
    return ""


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
        return _make_study(source, {})
    path = Path(source)
    if path.suffix.lower() != ".toml":
        return _make_study(read_deck(path), {})
    content = read_toml(path)
    # All problems of the file are reported at once.
    problems = _wrong_keys(content)
    if problems:
        raise SchemaError(path.name, problems)
    return _make_study(read_deck(path.parent / content["deck"]), content)


def _wrong_keys(content: dict[str, Any]) -> list[str]:
    """Return the problems with the keys of a study file."""
    problems = []
    if "deck" not in content:
        problems.append("no deck; write deck = 'file.inp'")
    problems += _check_table(content, _KEYS, "")
    runs = content.get("runs")
    if isinstance(runs, dict):
        for name, run in runs.items():
            if isinstance(run, dict):
                problems += _check_table(run, _RUN_KEYS, f"runs.{name}.")
            else:
                problems.append(f"runs.{name} is not a table")
    return problems


def _check_table(table: dict[str, Any], kinds: dict[str, type], prefix: str) -> list[str]:
    """Return unknown keys of a table and values of another type.

    `prefix` is the path of its keys.
    """
    problems = []
    for key in table:
        if key not in kinds:
            problems.append(f"unknown key {prefix}{key}; allowed: {', '.join(kinds)}")
    for key, kind in kinds.items():
        if key in table and not isinstance(table[key], kind):
            problems.append(f"{prefix}{key} is {table[key]!r}; it must be a {kind.__name__}")
    return problems


def _make_study(deck: DeckFile, content: dict[str, Any]) -> DeckStudy:
    if len(deck) != 1:
        raise SchemaError(
            deck.file,
            [f"{len(deck)} cases; a study is one case that holds the aircraft and all its devices"],
        )
    base = deck[0]
    groups = _group_devices(base)
    names, problems = _name_devices(deck, groups, content.get("devices", []))
    plans = {name: RunPlan(**run) for name, run in content.get("runs", {}).items()}
    if problems:
        raise SchemaError(deck.file, problems)
    return DeckStudy(
        file=deck.file,
        base=base,
        title=content.get("title", base.caseid),
        devices=dict(zip(names, groups, strict=True)),
        plans=plans,
    )


def _group_devices(base: Deck) -> list[tuple[Namelist, ...]]:
    """Return the devices of the deck.

    A SYMFLP or ASYFLP without NDELTA continues the one before.
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


def _name_devices(
    deck: DeckFile, groups: Sequence[tuple[Namelist, ...]], requested: list[Any]
) -> tuple[list[str], list[str]]:
    """Return the names of the devices, and the problems in finding them.

    `requested` are the names in the study file, none without one.
    """
    if requested and len(requested) != len(groups):
        problem = (
            f"devices names {len(requested)}, the deck has {len(groups)} (SYMFLP and ASYFLP in "
            f"their order)"
        )
        return [], [problem]
    problems = []
    names: list[str] = []
    for i, group in enumerate(groups):
        if requested:
            name = str(requested[i])
        else:
            name = _name_device(deck, group)
        word = word_of(name)
        if not word or DEVICES[word][0] != group[0].name:
            problems.append(_unnamed_device(group[0], name))
        # A second device of the same name gets the number 2.
        count = 2
        unique = name
        while unique in names:
            unique, count = f"{name}_{count}", count + 1
        names.append(unique)
    return names, problems


def _unnamed_device(namelist: Namelist, name: str) -> str:
    """Return the problem of a device without a name, or with one of another namelist."""
    allowed = [word for word, (owner, _) in DEVICES.items() if owner == namelist.name]
    which = "it may be on the wing or on the tail"
    if name:
        which = f"device {name!r}"
    return (
        f"line {namelist.line}, ${namelist.name}: {which}; name it in a study file, "
        f"devices = [...], allowed: {', '.join(allowed)}, "
        "or by a comment above it"
    )


def _name_device(deck: DeckFile, group: tuple[Namelist, ...]) -> str:
    """Name a device by its type, by a comment above it, or by the only surface it fits on."""
    values = {}
    for item in group:
        for assignment in item.assignments:
            if assignment.values:
                values[assignment.variable] = assignment.values[0]
    if group[0].name == "ASYFLP":
        return _DEVICE_OF_STYPE.get(round(float(values.get("STYPE", 0.0))), "")
    surfaces = {}
    for name, surface in (("flaps", "WGPLNF"), ("elevator", "HTPLNF")):
        if surface in deck[0].namelists:
            surfaces[name] = surface
    commented = _named_above(deck, group[0].line)
    for tolerance in (_ROUNDING, _CORRECTED):
        fits = []
        for name, surface in surfaces.items():
            if len(surfaces) == 1 or _fits_surface(deck[0], surface, values, tolerance):
                fits.append(name)
        if len(fits) == 1:
            # A comment distinguishes flaps and slats; the surface must be the one that fits.
            if commented and is_on_tail(commented) == is_on_tail(fits[0]):
                return commented
            return fits[0]
        if fits:
            break
    return commented


def _named_above(deck: DeckFile, line: int) -> str:
    """Return the device that the nearest comment above a line names, empty without one.

    A heading for any symmetrical flap does not name a device.
    """
    lines_before = [item.line for item in deck[0].items if item.line < line]
    item_before = max(lines_before, default=0)
    for comment_line, comment in reversed(deck.comments):
        text = comment.upper()
        if not item_before < comment_line < line:
            continue
        if any(generic in text for generic in _ANY_DEVICE):
            continue
        names = [name for keyword, name in _KEYWORDS.items() if keyword in text]
        if len(names) == 1:
            return names[0]
    return ""


def _fits_surface(base: Deck, surface: str, values: dict[str, Any], tolerance: float) -> bool:
    """Return whether a flap fits on a surface.

    It ends within the tip, and begins no farther inside the body than a share of the half span.
    """
    tip, exposed = base.value(surface, "SSPN"), base.value(surface, "SSPNE")
    if tip is None or exposed is None:
        return False
    inner, outer = float(values.get("SPANFI", 0.0)), float(values.get("SPANFO", 0.0))
    return inner >= tip - exposed - tolerance * tip and outer <= tip + _ROUNDING * tip

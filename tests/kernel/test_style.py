"""The style of the C sources, docs/design/kernel-style.md: short lines and functions, one statement
a line, no circle among units.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import pytest

KERNEL = Path(__file__).parents[2] / "kernel"
SOURCES = sorted(path for path in KERNEL.rglob("*.[ch]"))
# a folder uses itself and those before it
FOLDERS = (
    "include",
    "base",
    "model",
    "tables",
    "access",
    "environment",
    "propulsion",
    "gear",
    "controls",
    "flight",
    "trim",
    "lanes",
    "runs",
    "estimation",
    "shell",
)
UNITS = [path for path in SOURCES if path.parent.name in FOLDERS]
COLUMNS, LINES = 100, 60


def code(path: Path) -> str:
    """Return the text with comments and strings blanked out, line by line as it was."""

    def blank(found: re.Match) -> str:
        return re.sub(r"[^\n]", " ", found.group())

    return re.sub(
        r'/\*.*?\*/|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\])+\'', blank, path.read_text(), flags=re.S
    )


def program(path: Path) -> str:
    """Return the code without preprocessor lines, and without what stands in parentheses, brackets
    and initialisers.
    """
    text = re.sub(
        r"^#(?:.*\\\n)*.*$",
        lambda found: re.sub(r"[^\n]", " ", found.group()),
        code(path),
        flags=re.M,
    )
    out: list[str] = []
    open_pieces: list[str] = []
    for i, character in enumerate(text):
        starts = character in "([" or (
            character == "{"
            and bool(open_pieces or re.search(r"(=\s|\))$", text[max(i - 2, 0) : i]))
        )
        if open_pieces and character in ")]}":
            open_pieces.pop()
        out.append(character if not open_pieces or character == "\n" else " ")
        if starts:
            open_pieces.append(character)
    return "".join(out)


def functions(path: Path) -> list[tuple[str, int]]:
    """Return name and number of lines of every function; a definition begins in the first column
    and ends with a brace there.
    """
    found, first, name = [], 0, None
    for number, line in enumerate(code(path).splitlines(), 1):
        if line[:1].isalpha() or line.startswith("__"):
            first, opened = number, re.search(r"(\w+)\(", line)
            name = opened.group(1) if opened and "typedef" not in line else None
        if name and (line.startswith("}") or (line.rstrip().endswith("}") and number == first)):
            found.append((name, number - first + 1))
            name = None
        if line.rstrip().endswith(";") and not line.startswith((" ", "}")):
            name = None
    return found


def exported(path: Path) -> set[str]:
    """Return the functions of a source that others can call."""
    return set(
        re.findall(
            r"^(?!static|typedef|return|else)[a-z_A-Z][\w ]*?[ *](\w+)\((?:[^;{}]*)\)\s*\{",
            code(path),
            flags=re.M,
        )
    )


def used_units(paths: list[Path]) -> dict[str, set[str]]:
    """Return the units that a unit uses: those whose header it includes, and those whose functions
    it calls.
    """
    home = {name: path.stem for path in paths if path.suffix == ".c" for name in exported(path)}
    found: dict[str, set[str]] = {path.stem: set() for path in paths}
    for path in paths:
        called = {
            home[name]
            for name in set(re.findall(r"(?<![\w.>])\w+", code(path)))
            if name in home and path.suffix == ".c"
        }
        included = {
            Path(name).stem
            for name in re.findall(r'^#include "(\S+)"', path.read_text(), flags=re.M)
        }
        found[path.stem] |= (called | included) - {path.stem}
    return found


def test_the_sources_are_found():
    assert len(UNITS) > 80
    assert ("derivative", "sixdof") in [
        (name, path.stem) for path in UNITS for name, _ in functions(path)
    ]
    assert "am_load" in exported(KERNEL / "src" / "access" / "pack.c")
    # one source and one header at most bear a name
    assert max(Counter(path.name for path in UNITS).values()) == 1


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.name)
def test_lines_are_short(path):
    long = [
        f"{path.name}:{number}"
        for number, line in enumerate(path.read_text().splitlines(), 1)
        if len(line) > COLUMNS
    ]
    assert not long, f"more than {COLUMNS} columns: {long}"


@pytest.mark.slow
@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.name)
def test_functions_are_short(path):
    long = [(name, lines) for name, lines in functions(path) if lines > LINES]
    assert not long, f"more than {LINES} lines: {long}"


@pytest.mark.nightly
@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.name)
def test_one_statement_a_line(path):
    text = program(path)
    crowded = [number for number, line in enumerate(text.splitlines(), 1) if line.count(";") > 1]
    assert not crowded, f"more than one statement in the lines {crowded}"
    statements = re.split(r"[;{}]", text)
    chained = [
        " ".join(s.split())[:80]
        for s in statements
        if re.search(r"[^=!<>]=[^=].*,.*[^=!<>]=[^=]", s, flags=re.S)
    ]
    # constants of an enumeration are a list
    chained = [s for s in chained if not re.fullmatch(r"(?:[A-Z]\w*(?: = [^,]*)?,? ?)+", s)]
    assert not chained, f"assignments joined by commas: {chained}"


def test_a_function_has_a_name_of_its_own():
    """Two units with a function of one name look like a circle, and a reader takes one for the
    other.  Twice in two units stand only the functions that flight.h renames for the lanes.
    """
    twice = set(
        re.findall(r"^#define (\w+) LANED", (KERNEL / "src/model/flight.h").read_text(), re.M)
    )
    units: dict[str, set[str]] = {}
    for path in UNITS:
        if path.name == "kernel.h":
            continue
        for name, _ in functions(path):
            units.setdefault(name, set()).add(path.stem)
    assert len(units) > 700
    namesakes = {name: found for name, found in units.items() if len(found) > 1}
    namesakes.pop("__attribute__", None)
    assert not namesakes.keys() - twice, namesakes


@pytest.fixture(scope="module")
def uses() -> dict[str, set[str]]:
    return used_units(UNITS)


def test_no_circle_among_drivers_of_the_fuzzers():
    drivers = used_units(sorted((KERNEL / "fuzz").glob("drive*.[ch]")))
    assert "drive_path" in drivers["drive"]
    test_no_circle_among_units(drivers)


def test_no_circle_among_units(uses):
    left = dict(uses)
    while leaves := [unit for unit, used in left.items() if not used & left.keys()]:
        for unit in leaves:
            del left[unit]
    assert not left, f"a circle goes through {sorted(left)}"


def test_folders_use_those_before_them(uses):
    rank = {path.stem: FOLDERS.index(path.parent.name) for path in UNITS}
    wrong = [
        f"{unit} uses {other}"
        for unit, used in uses.items()
        for other in used
        if other in rank and rank[other] > rank[unit]
    ]
    assert not wrong


def test_every_public_function_is_explained():
    """A comment above each, or above the declarations it stands with."""
    blocks = re.split(r"\n\n", (KERNEL / "include" / "kernel.h").read_text())
    bare = [block for block in blocks if block.startswith("AM_API")]
    assert not bare

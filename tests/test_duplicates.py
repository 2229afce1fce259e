"""No fourteen lines of code stand twice in the packages."""

import re
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("flightmech", "datcom_io", "aerodb", "flighttest", "pom", "aeromatch")
LINES = 14  # of at most 100 columns
IMPORT = re.compile(r"\s*(import|from [\w.]+ import)\b")


def code(text: str) -> list[tuple[int, str]]:
    """Return number and text of the lines that count: no blanks, comments, imports and lone
    brackets.
    """
    imports = import_lines(text)
    numbered = ((number, line.strip()) for number, line in enumerate(text.splitlines(), 1))
    return [
        (n, line)
        for n, line in numbered
        if n not in imports and line.strip("()[]{},") and not line.startswith("#")
    ]


def import_lines(text: str) -> set[int]:
    """Return the numbers of the lines of import statements, which may stand in brackets."""
    found, is_open = set(), False
    for number, line in enumerate(text.splitlines(), 1):
        begins = IMPORT.match(line)
        if begins or is_open:
            found.add(number)
        is_open = ")" not in line and (is_open or bool(begins and "(" in line))
    return found


def repeats(files: dict[str, str]) -> list[str]:
    """Return every pair of places that share `LINES` lines, each stretch once."""
    seen: dict[tuple[str, ...], list[tuple[str, int]]] = defaultdict(list)
    for name, text in files.items():
        lines = code(text)
        for k in range(len(lines) - LINES + 1):
            window = tuple(line for _, line in lines[k : k + LINES])
            seen[window].append((name, lines[k][0]))
    found, last = [], None
    for places in (places for places in seen.values() if len(places) > 1):
        (a, i), (b, j) = places[:2]
        if last != (a, b, j - i):
            found.append(f"{a}:{i} and {b}:{j}")
        last = a, b, j - i
    return found


@pytest.mark.slow
def test_no_lines_stand_twice():
    files = [file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))]
    assert (
        repeats({str(file.relative_to(ROOT)): file.read_text(encoding="utf-8") for file in files})
        == []
    )


def test_a_repeat_is_found():
    text = "\n".join(f"line({k})" for k in range(LINES))
    assert repeats({"a.py": text, "b.py": f"first()\n\n{text}\n"}) == ["a.py:1 and b.py:3"]
    assert repeats({"a.py": text, "b.py": text.replace("line(13)", "other()")}) == []

"""No fourteen lines of code stand twice in the packages."""

import ast
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("flightmech", "datcom_io", "aerodb", "flighttest", "pom", "aeromatch")
LINES = 14  # of at most 100 columns


def code(text: str) -> list[tuple[int, str]]:
    """Return number and text of the lines that count: no blanks, comments, imports and lone
    brackets.
    """
    imports = {
        n
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for n in lines_of(node)
    }
    numbered = ((number, line.strip()) for number, line in enumerate(text.splitlines(), 1))
    return [
        (n, line)
        for n, line in numbered
        if n not in imports and line.strip("()[]{},") and not line.startswith("#")
    ]


def lines_of(node: ast.stmt) -> range:
    """Return the numbers of the lines of a statement."""
    return range(node.lineno, (node.end_lineno or node.lineno) + 1)


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

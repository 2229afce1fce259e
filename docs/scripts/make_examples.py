"""Page ``examples.md``, the scripts of the folder ``examples``, one for each job. The site has the
page (`make_site`); ``python docs/scripts/make_examples.py`` prints it.

Titles are the first sentences of the scripts.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
HEAD = """# Examples

One script for each job. They run in a checkout of the repository; figures need
`pip install 'aeromatch[figures]'`. The [notebook of the
tutorial](../tutorials/light-aircraft.ipynb) and that of [a log of a
UAV](../tutorials/uav-log.ipynb) go whole roads. All figures: [gallery](gallery.md).

| script | what it does |
| --- | --- |
"""


def first_sentence(file: Path) -> str:
    """Return the first sentence of the docstring of a script, in one line."""
    text = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    paragraph = " ".join(text.split("\n\n")[0].split()).replace("``", "`")
    return re.split(r"(?<=\.) (?=[A-Z])", paragraph)[0]


def page() -> str:
    """Return the page."""
    rows = []
    for file in sorted((ROOT / "examples").rglob("*.py")):
        name = file.relative_to(ROOT).as_posix()
        sentence = first_sentence(file)
        if not sentence:
            raise SystemExit(f"{name} has no docstring; write what it does")
        rows.append(f"| `{name}` | {sentence} |")
    return HEAD + "\n".join(rows) + "\n"


if __name__ == "__main__":
    print(page(), end="")

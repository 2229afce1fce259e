"""Page ``gallery.md``, all figures of the documentation. The site has the page (`make_site`);
``python docs/scripts/make_gallery.py`` prints it.

Captions are the alternative texts on the pages that show the figures. A figure that no page shows
is an error.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import NamedTuple

DOCS = Path(__file__).parents[1]
PAGE = DOCS / "reference" / "gallery.md"
IMAGE = re.compile(r"!\[(?P<caption>[^\]]*)\]\((?P<file>[^)\s]+)\)")
HEAD = """# Gallery

Every figure of these pages, with the page that explains it. The scripts that draw the
figures are in `docs/scripts/figures`.
"""


class Shown(NamedTuple):
    """A figure as one page shows it."""

    caption: str
    page: Path


def shown_figures() -> dict[Path, Shown]:
    """Return the first page, in the order of their names, that shows each figure."""
    figures: dict[Path, Shown] = {}
    for page in sorted(DOCS.rglob("*.md")):
        if page == PAGE:
            continue
        for match in IMAGE.finditer(page.read_text(encoding="utf-8")):
            file = (page.parent / match["file"]).resolve()
            figures.setdefault(file, Shown(match["caption"], page))
    return figures


def title_of(page: Path) -> str:
    """Return the heading of a page."""
    return page.read_text(encoding="utf-8").splitlines()[0].removeprefix("# ")


def page() -> str:
    """Return the page."""
    figures = shown_figures()
    files = {file.resolve() for file in (DOCS / "images").rglob("*.png")}
    lacking = sorted(str(file.relative_to(DOCS)) for file in files - set(figures))
    if lacking:
        raise SystemExit(f"no page shows {', '.join(lacking)}; show it or delete it")
    sections: dict[Path, list[str]] = {}
    for file, shown in figures.items():
        image = f"![{shown.caption}]({os.path.relpath(file, PAGE.parent)})"
        sections.setdefault(shown.page, []).append(f"{image}\n*{shown.caption}*\n")
    text = HEAD
    for source, images in sections.items():
        link = os.path.relpath(source, PAGE.parent)
        text += f"\n## [{title_of(source)}]({link})\n\n" + "\n".join(images)
    return text


if __name__ == "__main__":
    print(page(), end="")

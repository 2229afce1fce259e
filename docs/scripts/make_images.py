"""Take the pictures of the documentation from a report: ``python docs/scripts/make_images.py
out/t37/report/report.html``.

Needs Debian's ``chromium`` and the package ``playwright``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from chromium import open_page  # next to this file

IMAGES = Path(__file__).parents[1] / "images"


def pictures(report: Path, case: str, folder: Path, width: int = 1400) -> list[Path]:
    """Write the upper part of a case and of the page of the models as PNG.

    Parameters
    ----------
    report : Path
        ``report.html``.
    case : str
        Name of a case; empty for its first case.
    folder : Path
        Gets ``report-case.png`` and ``report-models.png``.
    width : int
        Width of the pictures. [px]

    Returns
    -------
    list of Path
        The pictures; the second only when the report compares databases.

    Raises
    ------
    SystemExit
        No chromium, or no such case in the report.
    """
    folder.mkdir(parents=True, exist_ok=True)
    made = []
    with open_page(width, 1000) as page:
        page.goto(report.resolve().as_uri())
        names = page.locator("article.case").evaluate_all("cases => cases.map(c => c.dataset.key)")
        if case and case not in names:
            raise SystemExit(f"the report has no case {case!r}; it has {', '.join(names)}")
        places = {"report-case.png": (f"#case-{case or names[0]}", ".panel canvas")}
        if page.locator("#models").count():
            page.goto(
                f"{report.resolve().as_uri()}#models"
            )  # the page is unpacked when it is shown
            page.locator("#models .term .figure").first.wait_for()
            first = page.locator("#models .term .figure").first.evaluate(
                "figure => figure.closest('.term').id"
            )
            places["report-models.png"] = f"#{first}", "#models .figure"
        for name, (place, awaited) in places.items():
            page.goto(report.resolve().as_uri() + place)
            page.locator(awaited).first.wait_for()
            page.wait_for_timeout(300)
            page.screenshot(path=folder / name)
            made.append(folder / name)
    return made


def main() -> None:
    """Read the command line and take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    parser.add_argument("report", type=Path, help="report.html")
    parser.add_argument("--case", default="", help="name of the case to show; without it the first")
    parser.add_argument("-o", "--output", type=Path, default=IMAGES, help="folder of the pictures")
    options = parser.parse_args()
    for path in pictures(options.report, options.case, options.output):
        print(path)


if __name__ == "__main__":
    main()

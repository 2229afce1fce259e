"""Take the waterfalls of docs/explanation/proof-of-match/diagnosis.md from a report: ``python
docs/scripts/make_diagnosis_images.py out/t37/report/report.html``.

Needs Debian's ``chromium`` and the package ``playwright``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from chromium import open_page  # next to this file

IMAGES = Path(__file__).parents[1] / "images"
CASES = {"normal_takeoff": "diagnosis-takeoff.png", "short_period": "diagnosis-short-period.png"}


def waterfalls(report: Path, folder: Path) -> list[Path]:
    """Write the waterfall of every case of `CASES` as PNG.

    Parameters
    ----------
    report : Path
        ``report.html`` with diagnoses of the T-37.
    folder : Path
        Gets the pictures.

    Raises
    ------
    SystemExit
        No chromium, or no such case in the report.
    """
    with open_page(1400, 4000, 1.5) as page:
        written = []
        for case, name in CASES.items():
            page.goto("about:blank")  # a new fragment alone would not load the page again
            page.goto(f"{report.resolve().as_uri()}#case-{case}")
            figure = page.locator(f"#case-{case} section:has(> h2:text-is('Cause')) figure svg")
            page.wait_for_timeout(1000)
            if not figure.count():
                raise SystemExit(
                    f"{report}: no waterfall for the case {case}; make the report by "
                    f"`aeromatch demo`"
                )
            figure.screenshot(path=folder / name)
            written.append(folder / name)
    return written


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("report", type=Path, help="report.html of the T-37")
    parser.add_argument("--folder", type=Path, default=IMAGES, help="where the pictures go")
    arguments = parser.parse_args()
    print("\n".join(map(str, waterfalls(arguments.report, arguments.folder))))

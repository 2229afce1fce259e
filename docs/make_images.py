"""Take the pictures of the documentation from a report: ``python docs/make_images.py out/t37/report/report.html``.

Needs Debian's ``chromium`` and the package ``playwright``.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

IMAGES = Path(__file__).parent / "images"


def picture(report: Path, case: str, target: Path, width: int = 1400, height: int = 1000) -> Path:
    """Write the first screen of a page of a report as PNG.

    Parameters
    ----------
    report : Path
        ``report.html``.
    case : str
        Name of a case; empty for its first case.
    target : Path
        The PNG.
    width, height : int
        Size of the screen, in pixels of the layout; the picture has twice as many.

    Returns
    -------
    Path
        `target`.

    Raises
    ------
    SystemExit
        No chromium, or no such case in the report.
    """
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium")
    if chromium is None:
        raise SystemExit("needs chromium: apt-get install chromium")
    target.parent.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": width, "height": height}, device_scale_factor=2, color_scheme="light")
        page.goto(report.resolve().as_uri())
        names = page.locator("article.case").evaluate_all("cases => cases.map(c => c.dataset.key)")
        if case and case not in names:
            raise SystemExit(f"the report has no case {case!r}; it has {', '.join(names)}")
        name = case or names[0]
        page.goto(f"{report.resolve().as_uri()}#case-{name}")
        page.wait_for_selector(f'[data-key="{name}"] .panel canvas')
        page.wait_for_timeout(300)
        page.screenshot(path=target)
        browser.close()
    return target


def main() -> None:
    """Read the command line and take the picture."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("report", type=Path, help="report.html")
    parser.add_argument("--case", default="", help="name of the case to show; without it the first")
    parser.add_argument("-o", "--output", type=Path, default=IMAGES / "report-case.png", help="the picture")
    options = parser.parse_args()
    print(picture(options.report, options.case, options.output))


if __name__ == "__main__":
    main()

"""Take the pictures of pages in the documentation: ``python docs/scripts/figures/make_pictures.py
out/t37/report/report.html``.

From the report of the T-37 come the upper part of a case, the page of the models and the waterfalls
of two cases; from a recording that is read with two mistakes in its name map (the rudder's sign,
and the load factor taken for the specific force) the page of the data quality.  Needs Debian's
``chromium`` and the package ``playwright``.
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import flightmech
import flighttest
from flighttest.reconstruction.quality.page import write_page

ROOT = Path(__file__).parents[3]
IMAGES = ROOT / "docs" / "images"
T37 = ROOT / "data" / "t37"
WIDTH = 1400  # of the pictures of a report [px]
WATERFALLS = {
    "normal_takeoff": "diagnosis-takeoff.png",
    "short_period": "diagnosis-short-period.png",
}
MISTAKES = {
    'delta_r = "delta_r"': 'delta_r = { column = "delta_r", sign = -1 }',
    'az_imu = "az_imu"': 'az_imu = { column = "az_imu", sign = -1, offset = "-1 g" }',
}


@contextmanager
def open_page(width: int, height: int, scale: float = 1.0) -> Iterator[Any]:
    """Open a light page of `width` times `height` pixels of CSS, `scale` pixels of the picture for
    each.

    Raises
    ------
    SystemExit
        No chromium.
    """
    from playwright.sync_api import sync_playwright

    program = shutil.which("chromium")
    if program is None:
        raise SystemExit("needs chromium: apt-get install chromium")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield browser.new_page(
            viewport={"width": width, "height": height},
            color_scheme="light",
            device_scale_factor=scale,
        )
        browser.close()


def take_report(report: Path, case: str, folder: Path) -> list[Path]:
    """Write ``report-case.png``, the upper part of a case (empty: the first), and
    ``report-models.png``, if the report compares databases.

    Raises
    ------
    SystemExit
        No chromium, or no such case in the report.
    """
    made = []
    with open_page(WIDTH, 1000) as page:
        page.goto(report.resolve().as_uri())
        names = page.locator("article.case").evaluate_all("cases => cases.map(c => c.dataset.key)")
        if case and case not in names:
            raise SystemExit(f"the report has no case {case!r}; it has {', '.join(names)}")
        places = {"report-case.png": (f"#case-{case or names[0]}", ".panel canvas")}
        coefficients = page.locator("[id^=models-1-]")  # a part of the page each
        if coefficients.count():
            first = coefficients.first.get_attribute("id")
            places["report-models.png"] = f"#{first}", f"#{first} .body figure"
        for name, (place, awaited) in places.items():
            page.goto(report.resolve().as_uri() + place)
            page.locator(awaited).first.wait_for()
            page.wait_for_timeout(300)
            page.screenshot(path=folder / name)
            made.append(folder / name)
    return made


def take_waterfalls(report: Path, folder: Path) -> list[Path]:
    """Write the waterfall of every case of `WATERFALLS`.

    Raises
    ------
    SystemExit
        No chromium, or no such case in the report.
    """
    made = []
    with open_page(WIDTH, 4000, 1.5) as page:
        for case, name in WATERFALLS.items():
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
            made.append(folder / name)
    return made


def take_quality(folder: Path) -> list[Path]:
    """Write ``data-quality.png``, the page of the record with mistakes."""
    text = (T37 / "names.toml").read_text(encoding="utf-8")
    for right, wrong in MISTAKES.items():
        text = text.replace(right, wrong)
    with TemporaryDirectory() as scratch, open_page(1200, 1500) as page:
        names, written = Path(scratch) / "names.toml", Path(scratch) / "page.html"
        names.write_text(text, encoding="utf-8")
        record = flighttest.read(T37 / "flight" / "t37_01_clean_low_speed_5kft.nc", names)
        aircraft = flightmech.read_aircraft(T37 / "aircraft.toml")
        write_page(flighttest.assess(record, aircraft), written)
        page.goto(written.resolve().as_uri())
        page.screenshot(path=str(folder / "data-quality.png"))
    return [folder / "data-quality.png"]


def main() -> None:
    """Read the command line and take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    parser.add_argument("report", type=Path, help="report.html of the T-37")
    parser.add_argument("--case", default="", help="name of the case to show; without it the first")
    parser.add_argument("-o", "--output", type=Path, default=IMAGES, help="folder of the pictures")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    made = take_report(options.report, options.case, options.output)
    made += take_waterfalls(options.report, options.output) + take_quality(options.output)
    print("\n".join(map(str, made)))


if __name__ == "__main__":
    main()

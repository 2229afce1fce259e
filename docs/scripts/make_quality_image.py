"""Take the picture of the data-quality page: ``python docs/scripts/make_quality_image.py``.

A recording of the T-37 is read with two mistakes in its name map: the rudder's sign, and the load
factor taken for the specific force. Needs Debian's ``chromium`` and the package ``playwright``.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from chromium import open_page  # next to this file

import flightmech
import flighttest
from flighttest.reconstruction.quality.page import write_page

ROOT = Path(__file__).parents[2]
T37 = ROOT / "data" / "t37"
MISTAKES = {
    'delta_r = "delta_r"': 'delta_r = { column = "delta_r", sign = -1 }',
    'az_imu = "az_imu"': 'az_imu = { column = "az_imu", sign = -1, offset = "-1 g" }',
}


def page(folder: Path) -> Path:
    """Write the page of the mistaken record into `folder` and return its place."""
    text = (T37 / "names.toml").read_text(encoding="utf-8")
    for right, wrong in MISTAKES.items():
        text = text.replace(right, wrong)
    names = folder / "names.toml"
    names.write_text(text, encoding="utf-8")
    record = flighttest.read(T37 / "flight" / "t37_01_clean_low_speed_5kft.nc", names)
    write_page(
        flighttest.assess(record, flightmech.read_aircraft(T37 / "aircraft.toml")),
        folder / "page.html",
    )
    return folder / "page.html"


def main() -> None:
    """Write ``docs/images/data-quality.png``."""
    with TemporaryDirectory() as folder, open_page(1200, 1500) as view:
        view.goto(page(Path(folder)).resolve().as_uri())
        view.screenshot(path=str(ROOT / "docs" / "images" / "data-quality.png"))


if __name__ == "__main__":
    main()

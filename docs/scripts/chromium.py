"""A page in Debian's ``chromium``, for the scripts next to this file that take pictures; needs the
package ``playwright``.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


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

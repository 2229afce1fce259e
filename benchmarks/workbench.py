"""Open and pan a recording of 90 minutes and 60 channels in the workbench, in a real browser.

    python benchmarks/workbench.py [--rate HZ]

Prints the time from the address to the first record, from a click on the long one to its drawn
channels, and the time of a frame while the page pans through it. Needs Debian's ``chromium`` and
the packages ``playwright``, ``starlette`` and ``uvicorn``.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import uvicorn
import xarray as xr
from playwright.sync_api import sync_playwright

from aeromatch.workbench.opened import OpenProject
from aeromatch.workbench.server import Workbench
from flightmech.names import VOCABULARY, quantity_attributes
from flighttest.records.files import save_record

T37 = Path(__file__).parents[1] / "data" / "t37"
CHANNELS, MINUTES = 60, 90
PROJECT = """
title = "Long flight"
aircraft = "aircraft.toml"
flights = "flight/*.nc"
cases = ["cases/21*.toml"]
listings.clean = "datcom/t37_clean.out"
[[fit]]
name = "lift"
records = ["a_short_flight"]
manoeuvres = ["doublet"]
models = ["CL = 1 + alpha"]
"""
PAN = """async (steps) => {
  const key = (name) => document.dispatchEvent(
    new KeyboardEvent("keydown", { key: name, bubbles: true }));
  for (let i = 0; i < 5; i++) key("+");
  await new Promise((done) => setTimeout(done, 1500));
  const times = [];
  for (let i = 0; i < steps; i++) {
    key(i % 40 < 20 ? "ArrowRight" : "ArrowLeft");
    await new Promise(requestAnimationFrame);
    times.push(performance.now());
  }
  const frames = times.slice(1).map((time, i) => time - times[i]).sort((a, b) => a - b);
  return { median: frames[Math.floor(frames.length / 2)],
    slowest: frames[Math.floor(frames.length * 0.95)] };
}"""


def recording(file: Path, rate: float, minutes: float) -> None:
    """Write a record of noise and slow motion under names of the vocabulary."""
    rng = np.random.default_rng(7)
    time_ = np.arange(int(minutes * 60 * rate)) / rate
    names = [
        name
        for name, one in VOCABULARY.items()
        if "." not in name and name not in ("time", "lat", "lon")
    ][:CHANNELS]
    slow = np.sin(np.outer(np.linspace(0.002, 0.5, len(names)), time_))
    data = {
        name: (
            "time",
            (slow[i] + 0.05 * rng.standard_normal(len(time_))).astype(float),
            quantity_attributes(name),
        )
        for i, name in enumerate(names)
    }
    leaf = xr.Dataset(
        data, {"time": ("time", time_, {"units": "s"})}, {"rate": rate, "flags": "[]"}
    )
    tree = xr.DataTree.from_dict({"imu": leaf})
    tree.attrs = {
        "title": f"{minutes:g} min, {len(names)} channels",
        "manoeuvres": "[]",
        "start": "",
        "unmapped": "",
        "absent": "",
    }
    save_record(tree, file)


def main() -> None:
    """Write the record, serve it, look at it."""
    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("--rate", type=float, default=50.0)
    rate = given.parse_args().rate
    with tempfile.TemporaryDirectory() as folder:
        project = Path(folder) / "t37"
        shutil.copytree(T37, project, ignore=shutil.ignore_patterns("flight"))
        (project / "flight").mkdir()
        recording(project / "flight" / "a_short_flight.nc", rate, 1.0)
        recording(project / "flight" / "z_long_flight.nc", rate, MINUTES)
        (project / "aeromatch.toml").write_text(PROJECT, encoding="utf-8")
        size = (project / "flight" / "z_long_flight.nc").stat().st_size / 1e6
        print(f"{MINUTES} min, {CHANNELS} channels at {rate:g} Hz, {size:.0f} MB")
        bench = Workbench(OpenProject(project / "aeromatch.toml", Path(folder) / "work"))
        bench.socket.listen(64)
        server = uvicorn.Server(uvicorn.Config(bench.app(), log_level="warning"))
        thread = threading.Thread(
            target=server.run, kwargs={"sockets": [bench.socket]}, daemon=True
        )
        thread.start()
        with sync_playwright() as driver:
            browser = driver.chromium.launch(
                executable_path=shutil.which("chromium"), args=["--no-sandbox"]
            )
            page = browser.new_page(viewport={"width": 1400, "height": 900})
            start = time.perf_counter()
            page.goto(bench.address)
            page.wait_for_selector(".u-over")
            print(f"workbench opened, a short record drawn: {time.perf_counter() - start:.2f} s")
            start = time.perf_counter()
            page.get_by_role("button", name="z_long_flight").click()
            page.get_by_role("heading", name=f"{MINUTES} min").wait_for()
            page.wait_for_selector(".u-over")
            print(
                f"recording opened, drawn: {time.perf_counter() - start:.2f} s "
                f"({page.locator('.u-over').count()} panels)"
            )
            print(
                "pan, 7 panels: {median:.1f} ms a frame, 95 % below {slowest:.1f} ms".format(
                    **page.evaluate(PAN, 120)
                )
            )
            start = time.perf_counter()
            page.evaluate(
                "for (const box of document.querySelectorAll('details input')) if "
                "(!box.checked) box.click()"
            )
            page.locator(".u-over").nth(CHANNELS - 1).wait_for(state="attached")
            print(
                f"all {page.locator('.u-over').count()} channels: "
                f"{time.perf_counter() - start:.2f} s"
            )
            print(
                "pan, all panels: {median:.1f} ms a frame, 95 % below {slowest:.1f} ms".format(
                    **page.evaluate(PAN, 60)
                )
            )
            browser.close()
        server.should_exit = True
        thread.join(20)


if __name__ == "__main__":
    main()

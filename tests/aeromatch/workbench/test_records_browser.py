"""The page of the records in a real browser: a mark dragged and renamed, found ones accepted, and a server that is started again."""

import shutil
import sys
from pathlib import Path

import pytest

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
sys.path.insert(0, str(Path(__file__).parent))
from bench import RECORD, served, small_project

from flighttest.records import read_manoeuvres

CHROMIUM = shutil.which("chromium")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.browser,
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: apt-get install chromium"),
]
WAIT = 60_000


@pytest.fixture
def page():
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser.new_page(viewport={"width": 1280, "height": 900})
        browser.close()


def opened(page, client):
    page.goto(client.bench.address)
    page.get_by_role("button", name=RECORD, exact=True).click(timeout=WAIT)
    page.get_by_role("heading", name="T-37 run 27 val_dutch_roll").wait_for(timeout=WAIT)
    page.wait_for_load_state("networkidle")


def done(page, verb):
    page.get_by_text(f"Done: aeromatch {verb}").wait_for(timeout=WAIT)


def test_a_mark_is_dragged_and_renamed(page, tmp_path):
    """By its middle; the table of the project has what the screen shows."""
    project = small_project(tmp_path / "t37")
    with served(project, tmp_path / "work") as client:
        opened(page, client)
        rows = client.data("/api/record", {"name": RECORD})
        before, span = rows["manoeuvres"]["rows"], rows["stop"] - rows["start"]
        place = max(range(len(before)), key=lambda k: before[k]["end"] - before[k]["start"])
        strip = page.get_by_role("group", name="Manoeuvres over time")
        per_pixel = span / strip.evaluate("node => node.clientWidth")
        area, begin = strip.bounding_box(), rows["start"]
        middle = 0.5 * (before[place]["start"] + before[place]["end"])
        x, y = area["x"] + 1 + (middle - begin) / per_pixel, area["y"] + area["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 12, y, steps=4)
        page.mouse.up()
        done(page, "set")
        page.wait_for_load_state("networkidle")
        table = read_manoeuvres(project.parent / "manoeuvres.csv")[RECORD]
        assert len(table) == len(before)
        moved = table.iloc[place]
        assert moved["start"] == pytest.approx(before[place]["start"] + 12 * per_pixel, abs=0.02)
        assert moved["end"] == pytest.approx(before[place]["end"] + 12 * per_pixel, abs=0.02)
        page.get_by_role("table", name="Manoeuvres").locator("tbody tr").nth(place).click()
        page.get_by_label("kind", exact=True).fill("free oscillation")
        page.get_by_role("button", name="Change", exact=True).click()
        page.get_by_role("table", name="Manoeuvres").get_by_role("row", name="free oscillation").wait_for(timeout=WAIT)
        assert read_manoeuvres(project.parent / "manoeuvres.csv")[RECORD].iloc[place]["manoeuvre"] == "free oscillation"
        assert len(client.data("/api/actions")["actions"]) == 3  # mark, set, mark


def test_the_page_goes_on_when_the_server_is_started_again(page, tmp_path):
    project, work = small_project(tmp_path / "t37"), tmp_path / "work"
    with served(project, work) as client:
        port = client.bench.port
        opened(page, client)
    page.get_by_role("button", name="t37_26_val_phugoid", exact=True).click()
    banner = page.get_by_text("The server does not answer. Start aeromatch view again with the same --port")
    banner.wait_for(timeout=WAIT)
    with served(project, work, port):
        page.get_by_role("button", name="t37_26_val_phugoid", exact=True).click()
        page.get_by_role("heading", name="T-37 run 26 val_phugoid").wait_for(timeout=WAIT)
        banner.wait_for(state="hidden", timeout=WAIT)

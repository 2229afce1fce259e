"""The page of the records in a real browser: marks dragged by middle and edge, found ones accepted, a fault remedied, a new server."""

import re
import shutil
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
sys.path.insert(0, str(Path(__file__).parent))
from bench import RECORD, served, small_project

from aeromatch.project import read_project
from aeromatch.workbench.actions import read_log
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


def opened(page, client, record=RECORD, title="T-37 run 27 val_dutch_roll"):
    page.goto(client.bench.address)
    page.get_by_role("button", name=record, exact=True).click(timeout=WAIT)
    page.get_by_role("heading", name=title).wait_for(timeout=WAIT)
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
        page.get_by_text("from the project's table").wait_for(timeout=WAIT)  # the form is drawn anew with it
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


def test_edges_of_adjoining_and_of_narrow_marks_are_dragged(page, tmp_path):
    """Pressed on the very line of the edge, and next to it; the neighbour stays, and the middle of a narrow mark still moves it."""
    record = "t37_24_val_power_slam"  # its marks adjoin
    project = small_project(tmp_path / "t37")
    (project.parent / "manoeuvres.csv").write_text(
        f"record,kind,control,start,end,note\n{record},trim,,0,5,\n{record},power_lever,throttle,5,17.5,\n"
        f"{record},pulse,elevator,17.5,18.0,\n{record},power_lever,throttle,18.0,31,\n"
    )
    project.write_text('manoeuvres = "manoeuvres.csv"\n' + project.read_text(encoding="utf-8"), encoding="utf-8")
    spans = [[0.0, 5.0], [5.0, 17.5], [17.5, 18.0], [18.0, 31.0]]
    with served(project, tmp_path / "work") as client:
        opened(page, client, record, "T-37 run 24 val_power_slam")
        about = client.data("/api/record", {"name": record})
        strip = page.get_by_role("group", name="Manoeuvres over time")
        area, per_pixel = strip.bounding_box(), (about["stop"] - about["start"]) / strip.evaluate("node => node.clientWidth")

        def drag(moment, off, by):
            x, y = area["x"] + 1 + (moment - about["start"]) / per_pixel + off, area["y"] + area["height"] / 2
            page.mouse.move(x, y)
            cursor = strip.evaluate("node => getComputedStyle(node).cursor")
            page.mouse.down()
            page.mouse.move(x + by, y, steps=4)
            with page.expect_response(lambda answer: "/api/record?" in answer.url, timeout=WAIT):  # the page reads what was written
                page.mouse.up()
            page.wait_for_load_state("networkidle")
            rows = read_manoeuvres(project.parent / "manoeuvres.csv")[record]
            assert rows[["start", "end"]].to_numpy() == pytest.approx(np.array(spans), abs=0.006), (
                moment,
                off,
            )  # hundredths are written
            for start, end in rows[["start", "end"]].to_numpy():
                strip.get_by_role("button", name=re.compile(f" {start:g} to {end:g} s$")).wait_for(timeout=WAIT)
            assert strip.get_by_role("button").count() == len(spans)
            return cursor

        spans[0][1] = 5.0 - 30 * per_pixel
        assert drag(5.0, -1, -30) == "ew-resize"  # on the line at the end of the first
        spans[1][0] = 5.0 + 25 * per_pixel
        assert drag(5.0, 1, 25) == "ew-resize"  # on the line at the start of the second
        spans[1][0] -= 20 * per_pixel
        assert drag(5.0, 25 - 5, -20) == "ew-resize"  # 5 pixels before it, where no mark is
        spans[3][1] -= 15 * per_pixel
        assert drag(31.0, -4, -15) == "ew-resize"  # inside the last
        spans[1][1] = 17.5 - 20 * per_pixel
        assert drag(17.5, -2, -20) == "ew-resize"  # the end of the second, where the narrow one adjoins
        spans[3][0] = 18.0 + 20 * per_pixel
        assert drag(18.0, 2, 20) == "ew-resize"
        spans[2] = [17.5 + 10 * per_pixel, 18.0 + 10 * per_pixel]
        assert drag(17.75, 0, 10) == "auto"  # the middle of the narrow one
        spans[2][1] += 7 * per_pixel
        assert drag(18.0, 10, 7) == "ew-resize"
        log = read_log(client.bench.opened.log)
        assert [entry.words[:2] for entry in log] == [("flight", "mark")] * 8
        assert [entry.words[entry.words.index("--row") + 1] for entry in log] == ["1", "2", "2", "4", "2", "4", "3", "3"]


def without_marks(project, record):
    """Give a project its own copy of a record that carries no marks."""
    import h5py

    folder = project.parent / "flight"
    files = folder.resolve()
    folder.unlink()
    folder.mkdir()
    for file in files.iterdir():
        if file.stem != record:
            (folder / file.name).symlink_to(file)
    shutil.copy(files / f"{record}.nc", folder)
    with h5py.File(folder / f"{record}.nc", "r+") as content:
        del content.attrs["manoeuvres"]


def test_found_manoeuvres_are_accepted_one_by_one_and_together(page, tmp_path):
    """One that is corrected, one as it was found, then the rest; the table of the project has what is accepted, the rest stays offered."""
    record = "t37_24_val_power_slam"
    project = small_project(tmp_path / "t37")
    without_marks(project, record)
    with served(project, tmp_path / "work") as client:
        found = client.data("/api/record", {"name": record, "find": 1})["manoeuvres"]["rows"]
        assert [row["found"] for row in found] == [True] * len(found)
        assert len(found) > 2
        opened(page, client, record, "T-37 run 24 val_power_slam")
        page.get_by_text("0, as the record carries them.").wait_for(timeout=WAIT)
        page.get_by_role("button", name="Search the movements of the controls").click()
        page.get_by_text(f"{len(found)} found in the movements of the controls: accept or correct them.").wait_for(timeout=WAIT)
        rows = page.get_by_role("table", name="Manoeuvres").locator("tbody tr")
        accept = page.get_by_role("button", name="Accept", exact=True)

        rows.nth(0).click()
        page.get_by_label("end", exact=True).fill("17")
        accept.click()
        page.get_by_text(f"{len(found) - 2} found in").or_(page.get_by_text(f"{len(found) - 1} found in")).wait_for(timeout=WAIT)
        done(page, "set")
        page.wait_for_load_state("networkidle")
        table = read_manoeuvres(project.parent / "manoeuvres.csv")[record]
        assert table[["manoeuvre", "control", "start", "end"]].to_numpy().tolist() == [
            ["power_change", "throttle", found[0]["start"], 17.0]
        ]
        assert read_project(project).manoeuvres == project.parent / "manoeuvres.csv"

        left = [row for row in client.data("/api/record", {"name": record, "find": 1})["manoeuvres"]["rows"] if row["found"]]
        assert rows.count() == 1 + len(left)
        assert rows.get_by_text("(found)").count() == len(left) >= 2
        rows.nth(1).click()
        accept.click()
        page.get_by_text(f"{len(left) - 1} found in").or_(page.get_by_text(f"{len(left) - 2} found in")).wait_for(timeout=WAIT)
        page.wait_for_load_state("networkidle")
        if page.get_by_role("button", name="Accept all").count():
            page.get_by_role("button", name="Accept all").click()
        page.get_by_text("0 found in the movements of the controls and not marked.").wait_for(timeout=WAIT)
        table = read_manoeuvres(project.parent / "manoeuvres.csv")[record]
        assert len(table) == rows.count()
        assert [left[0]["start"], left[0]["end"]] in table[["start", "end"]].to_numpy().tolist()
        log = read_log(client.bench.opened.log)
        assert [entry.words[0] for entry in log].count("set") == 1
        assert len(log) == 1 + len(table)


def test_the_remedy_of_a_fault_is_written_by_its_button(page, tmp_path):
    """The name map turns the rudder over; the check finds it, the button writes the line, and the record is checked again."""
    project = small_project(tmp_path / "t37")
    names = project.parent / "names.toml"
    text = names.read_text(encoding="utf-8")
    turned = text.replace('delta_r = "delta_r"', 'delta_r = { column = "delta_r", sign = -1 }')
    assert turned != text
    names.write_text(turned, encoding="utf-8")
    with served(project, tmp_path / "work") as client:
        opened(page, client)
        page.get_by_role("button", name="Check the record").click()
        page.get_by_text("delta_r has the wrong sign").wait_for(timeout=WAIT)
        page.get_by_role("button", name="Write controls.delta_r into the name map").click()
        page.get_by_text("delta_r has the wrong sign").wait_for(state="detached", timeout=WAIT)
        done(page, "set")
        page.get_by_text(client.data("/api/check", {"name": RECORD})["verdict"], exact=True).wait_for(timeout=WAIT)
        assert page.get_by_role("button", name="into the name map").count() == 0
        assert page.get_by_text("delta_r has the wrong sign").count() == 0
        assert tomllib.loads(names.read_text(encoding="utf-8")) == tomllib.loads(text)
        (entry,) = read_log(client.bench.opened.log)
        assert entry.words == ("set", "{project}/names.toml", "controls.delta_r", '"delta_r"')
        assert list(entry.files) == ["{project}/names.toml"]


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

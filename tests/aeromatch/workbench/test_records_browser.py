"""The page of the records in a real browser: marks dragged by middle and edge, found ones accepted,
a fault remedied, a new server.
"""

import re
import shutil
import socket
import sys
import tomllib
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
sys.path.insert(0, str(Path(__file__).parent))
from bench import RECORD, drawn_anew, served, small_project

from aeromatch.project.project import read_project
from aeromatch.workbench.actions import read_action_log
from flighttest.records.manoeuvre_table import read_manoeuvres

expect = pytest.importorskip("playwright.sync_api").expect
pytestmark = [pytest.mark.slow, pytest.mark.browser]


@contextmanager
def opened(page, project, work, record=RECORD, title="T-37 run 27 val_dutch_roll"):
    """Yield the client of a server, with a record on the page; the page is left before the server
    ends.
    """
    with served(project, work) as client:
        page.goto(client.bench.address)
        page.get_by_role("button", name=record, exact=True).click()
        page.get_by_role("heading", name=title).wait_for()
        yield client
        page.goto("about:blank")


def done(page, verb):
    """Wait for the end of an action; the page then reads what it has changed, and a test waits for
    that.
    """
    expect(page.locator("#job")).to_have_text(re.compile(f"^Done: aeromatch {verb}"))


def strip_of(page, marks):
    """Return the strip of the manoeuvres once it has as many marks: they are drawn last."""
    strip = page.get_by_role("group", name="Manoeuvres over time")
    expect(strip.get_by_role("button")).to_have_count(marks)
    return strip


@pytest.mark.nightly
def test_a_mark_is_dragged_and_renamed(page, tmp_path):
    """By its middle; the table of the project has what the screen shows."""
    project = small_project(tmp_path / "t37")
    with opened(page, project, tmp_path / "work") as client:
        rows = client.data("/api/record", {"name": RECORD})
        before, span = rows["manoeuvres"]["rows"], rows["stop"] - rows["start"]
        place = max(range(len(before)), key=lambda k: before[k]["end"] - before[k]["start"])
        strip = strip_of(page, len(before))
        per_pixel = span / strip.evaluate("node => node.clientWidth")
        area, begin = strip.bounding_box(), rows["start"]
        middle = 0.5 * (before[place]["start"] + before[place]["end"])
        x, y = area["x"] + 1 + (middle - begin) / per_pixel, area["y"] + area["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 12, y, steps=4)
        page.mouse.up()
        page.get_by_text("from the project's table").wait_for()
        table = read_manoeuvres(project.parent / "manoeuvres.csv")[RECORD]
        assert len(table) == len(before)
        moved = table.iloc[place]
        assert moved["start"] == pytest.approx(before[place]["start"] + 12 * per_pixel, abs=0.02)
        assert moved["end"] == pytest.approx(before[place]["end"] + 12 * per_pixel, abs=0.02)
        page.get_by_role("table", name="Manoeuvres").locator("tbody tr").nth(place).click()
        page.get_by_label("kind", exact=True).fill("free oscillation")
        page.get_by_role("button", name="Change", exact=True).click()
        page.get_by_role("table", name="Manoeuvres").get_by_role(
            "row", name="free oscillation"
        ).wait_for()
        assert (
            read_manoeuvres(project.parent / "manoeuvres.csv")[RECORD].iloc[place]["manoeuvre"]
            == "free oscillation"
        )
        assert len(client.data("/api/actions")["actions"]) == 3  # mark, set, mark


@pytest.mark.nightly
def test_edges_of_adjoining_and_of_narrow_marks_are_dragged(page, tmp_path):
    """Pressed on the very line of the edge, and next to it; the neighbour stays, and the middle of
    a narrow mark still moves it.
    """
    record = "t37_24_val_power_slam"  # its marks adjoin
    project = small_project(tmp_path / "t37")
    (project.parent / "manoeuvres.csv").write_text(
        f"record,kind,control,start,end,note\n{record},trim,,0,5,\n{record},power_lever,throttle,"
        f"5,17.5,\n"
        f"{record},pulse,elevator,17.5,18.0,\n{record},power_lever,throttle,18.0,31,\n"
    )
    project.write_text(
        'manoeuvres = "manoeuvres.csv"\n' + project.read_text(encoding="utf-8"), encoding="utf-8"
    )
    spans = [[0.0, 5.0], [5.0, 17.5], [17.5, 18.0], [18.0, 31.0]]
    with opened(page, project, tmp_path / "work", record, "T-37 run 24 val_power_slam") as client:
        about = client.data("/api/record", {"name": record})
        strip = strip_of(page, len(spans))
        area, per_pixel = (
            strip.bounding_box(),
            (about["stop"] - about["start"]) / strip.evaluate("node => node.clientWidth"),
        )

        def drag(moment, off, by, cursor):
            x, y = (
                area["x"] + 1 + (moment - about["start"]) / per_pixel + off,
                area["y"] + area["height"] / 2,
            )
            page.mouse.move(x, y)
            expect(strip).to_have_css("cursor", cursor)
            page.mouse.down()
            page.mouse.move(x + by, y, steps=4)
            with page.expect_response(
                lambda answer: "/api/record?" in answer.url
            ):  # the page reads what was written
                page.mouse.up()
            rows = read_manoeuvres(project.parent / "manoeuvres.csv")[record]
            assert rows[["start", "end"]].to_numpy() == pytest.approx(np.array(spans), abs=0.006), (
                moment,
                off,
            )  # hundredths are written
            for start, end in rows[["start", "end"]].to_numpy():
                strip.get_by_role("button", name=re.compile(f" {start:g} to {end:g} s$")).wait_for()
            strip_of(page, len(spans))

        spans[0][1] = 5.0 - 30 * per_pixel
        drag(5.0, -1, -30, "ew-resize")  # on the line at the end of the first
        spans[1][0] = 5.0 + 25 * per_pixel
        drag(5.0, 1, 25, "ew-resize")  # on the line at the start of the second
        spans[1][0] -= 20 * per_pixel
        drag(5.0, 25 - 5, -20, "ew-resize")  # 5 pixels before it, where no mark is
        spans[3][1] -= 15 * per_pixel
        drag(31.0, -4, -15, "ew-resize")  # inside the last
        spans[1][1] = 17.5 - 20 * per_pixel
        drag(17.5, -2, -20, "ew-resize")  # the end of the second, where the narrow one adjoins
        spans[3][0] = 18.0 + 20 * per_pixel
        drag(18.0, 2, 20, "ew-resize")
        spans[2] = [17.5 + 10 * per_pixel, 18.0 + 10 * per_pixel]
        drag(17.75, 0, 10, "auto")  # the middle of the narrow one
        spans[2][1] += 7 * per_pixel
        drag(18.0, 10, 7, "ew-resize")
        log = read_action_log(client.bench.opened.log)
        assert [entry.words[:2] for entry in log] == [("flight", "mark")] * 8
        assert [entry.words[entry.words.index("--row") + 1] for entry in log] == [
            "1",
            "2",
            "2",
            "4",
            "2",
            "4",
            "3",
            "3",
        ]


@pytest.mark.nightly
def test_what_is_typed_stays_when_the_page_is_drawn_anew(page, tmp_path):
    """A new manoeuvre, and one that is changed; what is written is no longer kept, and a change
    that is refused is still one.
    """
    project = small_project(tmp_path / "t37")
    with opened(page, project, tmp_path / "work") as client:
        kind, note, end = (page.get_by_label(name, exact=True) for name in ("kind", "note", "end"))
        kind.fill("doublet")
        note.fill("by hand")
        note.evaluate("node => node.setSelectionRange(3, 3)")
        drawn_anew(page, "[data-field=note]")
        expect(kind).to_have_value("doublet")
        expect(note).to_be_focused()
        page.keyboard.type("the ")
        expect(note).to_have_value("by the hand")

        rows = page.get_by_role("table", name="Manoeuvres").locator("tbody tr")
        marks = client.data("/api/record", {"name": RECORD})["manoeuvres"]["rows"]
        rows.first.click()
        expect(note).to_have_value(marks[0]["note"])
        end.fill(str(marks[0]["start"] - 1.0))
        page.get_by_role("button", name="Change", exact=True).click()
        page.get_by_role("alert").wait_for()
        drawn_anew(page, "[data-field=note]")
        expect(end).to_have_value(str(marks[0]["start"] - 1.0))
        end.fill(str(marks[0]["end"] + 0.5))
        page.get_by_role("button", name="Change", exact=True).click()
        page.get_by_text("from the project's table").wait_for()
        expect(rows).to_have_count(len(marks))
        table = read_manoeuvres(project.parent / "manoeuvres.csv")[RECORD]
        assert table["end"].iloc[0] == pytest.approx(marks[0]["end"] + 0.5, abs=0.006)
        page.get_by_role("heading", name="New manoeuvre").wait_for()
        expect(kind).to_have_value("")


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


@pytest.mark.nightly
def test_found_manoeuvres_are_accepted_one_by_one_and_together(page, tmp_path):
    """One that is corrected, one as it was found, then the rest; the table of the project has what
    is accepted, the rest stays offered.
    """
    record = "t37_24_val_power_slam"
    project = small_project(tmp_path / "t37")
    without_marks(project, record)
    with opened(page, project, tmp_path / "work", record, "T-37 run 24 val_power_slam") as client:
        found = client.data("/api/record", {"name": record, "find": 1})["manoeuvres"]["rows"]
        assert [row["found"] for row in found] == [True] * len(found)
        assert len(found) > 2
        page.get_by_text("0, as the record carries them.").wait_for()
        page.get_by_role("button", name="Search the movements of the controls").click()
        page.get_by_text(
            f"{len(found)} found in the movements of the controls: accept or correct them."
        ).wait_for()
        rows = page.get_by_role("table", name="Manoeuvres").locator("tbody tr")
        accept = page.get_by_role("button", name="Accept", exact=True)

        rows.nth(0).click()
        page.get_by_label("end", exact=True).fill("17")
        accept.click()
        page.get_by_text(
            "1, from the project's table."
        ).wait_for()  # marked, then the table is set in the project
        table = read_manoeuvres(project.parent / "manoeuvres.csv")[record]
        assert table[["manoeuvre", "control", "start", "end"]].to_numpy().tolist() == [
            ["power_change", "throttle", found[0]["start"], 17.0]
        ]
        assert read_project(project).manoeuvres == project.parent / "manoeuvres.csv"

        def offered():
            return [
                row
                for row in client.data("/api/record", {"name": record, "find": 1})["manoeuvres"][
                    "rows"
                ]
                if row["found"]
            ]

        left = offered()
        expect(rows).to_have_count(1 + len(left))
        expect(rows.get_by_text("(found)")).to_have_count(len(left))
        assert len(left) >= 2
        rows.nth(1).click()
        accept.click()
        page.get_by_text("2, from the project's table.").wait_for()
        if rest := len(offered()):
            page.get_by_text(f"{rest} found in").wait_for()
            page.get_by_role("button", name="Accept all").click()
        page.get_by_text("0 found in the movements of the controls and not marked.").wait_for()
        table = read_manoeuvres(project.parent / "manoeuvres.csv")[record]
        expect(rows).to_have_count(len(table))
        assert [left[0]["start"], left[0]["end"]] in table[["start", "end"]].to_numpy().tolist()
        log = read_action_log(client.bench.opened.log)
        assert [entry.words[0] for entry in log].count("set") == 1
        assert len(log) == 1 + len(table)


def test_the_remedy_of_a_fault_is_written_by_its_button(page, tmp_path):
    """The name map turns the rudder over; the check finds it, the button writes the line, and the
    record is checked again.
    """
    project = small_project(tmp_path / "t37")
    names = project.parent / "names.toml"
    text = names.read_text(encoding="utf-8")
    turned = text.replace('delta_r = "delta_r"', 'delta_r = { column = "delta_r", sign = -1 }')
    assert turned != text
    names.write_text(turned, encoding="utf-8")
    with opened(page, project, tmp_path / "work") as client:
        page.get_by_role("button", name="Check the record").click()
        page.get_by_text("delta_r has the wrong sign").wait_for()
        page.get_by_role("button", name="Write controls.delta_r into the name map").click()
        done(page, "set")
        page.get_by_text(
            client.data("/api/check", {"name": RECORD})["verdict"], exact=True
        ).wait_for()
        expect(page.get_by_role("button", name="into the name map")).to_have_count(0)
        expect(page.get_by_text("delta_r has the wrong sign")).to_have_count(0)
        assert tomllib.loads(names.read_text(encoding="utf-8")) == tomllib.loads(text)
        (entry,) = read_action_log(client.bench.opened.log)
        assert entry.words == ("set", "{project}/names.toml", "controls.delta_r", '"delta_r"')
        assert list(entry.files) == ["{project}/names.toml"]


@pytest.mark.nightly
def test_the_page_goes_on_when_the_server_is_started_again(new_page, tmp_path):
    project, page = small_project(tmp_path / "t37"), new_page()
    with socket.socket() as holder:  # keeps the port while no server has it
        holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        holder.bind(("127.0.0.1", 0))
        port = holder.getsockname()[1]
        with served(project, tmp_path / "work", port) as client:
            page.goto(client.bench.address)
            page.get_by_role("button", name=RECORD, exact=True).click()
            page.get_by_role("heading", name="T-37 run 27 val_dutch_roll").wait_for()
        page.get_by_role("button", name="t37_26_val_phugoid", exact=True).click()
        banner = page.get_by_text(
            "The server does not answer. Start aeromatch view again with the same --port"
        )
        banner.wait_for()
        with served(project, tmp_path / "work", port):
            page.get_by_role("button", name="t37_26_val_phugoid", exact=True).click()
            page.get_by_role("heading", name="T-37 run 26 val_phugoid").wait_for()
            expect(banner).to_be_hidden()
            page.goto("about:blank")

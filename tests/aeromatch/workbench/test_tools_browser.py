"""Tools of the pages of records and identification in a real browser: several channels in a panel,
an expression, a second record, cursors, XY plot and spectrum; selection, validation and the board.
"""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
sys.path.insert(0, str(Path(__file__).parent))
from bench import RECORD, reconstructed_project, served, small_project

expect = pytest.importorskip("playwright.sync_api").expect
pytestmark = [pytest.mark.slow, pytest.mark.browser]
OTHER = "t37_28_val_spiral"
FIRST, SECOND = "t37_01_clean_low_speed_5kft", "t37_10_multisine_clean_5kft"


def cells_of(page, table, row):
    """Return the cells of the row of a table that begins with a text."""
    found = page.get_by_role("table", name=table).get_by_role("row", name=re.compile(f"^{row}"))
    return found.get_by_role("cell").all_inner_texts()


@pytest.mark.nightly
def test_tools_of_the_records(page, tmp_path, complaints):
    """What the screen states at the cursors are samples of the record."""
    project = small_project(tmp_path / "t37")
    with served(project, tmp_path / "work") as client:
        page.goto(client.bench.address)
        page.get_by_role("button", name=RECORD, exact=True).click()
        page.get_by_role("heading", name="T-37 run 27 val_dutch_roll").wait_for()
        page.locator(".u-over").first.wait_for()
        panels = page.locator(".plot").count()
        page.get_by_label("Expression of channels").fill("alpha_vane - 2")
        page.get_by_role("button", name="Add the expression").click()
        expect(page.get_by_role("alert")).to_contain_text("write the unit, as '2 deg'")
        complaints.clear()  # of the refused expression
        page.get_by_label("Expression of channels").fill("alpha_vane - 2 deg")
        page.get_by_role("button", name="Add the expression").click()
        expect(page.locator(".plot")).to_have_count(panels + 1)
        page.get_by_label("Add a channel to the panel q", exact=True).select_option(
            label="alpha_vane (vanes), deg"
        )
        page.get_by_label("q, deg/s and deg, over time").wait_for()
        expect(page.locator(".plot")).to_have_count(panels)
        page.get_by_role("button", name="Cursors").click()
        page.get_by_label("Cursor A [s]").fill("4")
        page.get_by_label("Cursor A [s]").press("Enter")
        table = "Values at the cursors"
        tree = client.bench.opened.record(RECORD)
        time, q = (tree["imu"][name].values for name in ("time", "q"))
        row = page.get_by_role("table", name=table).get_by_role("row", name=re.compile(r"^imu\.q "))
        expected = f"{np.degrees(np.interp(4.0, time, q)):.5g}".replace("-", "\N{MINUS SIGN}")
        expect(row.get_by_role("cell").nth(2)).to_have_text(expected)
        page.get_by_label("Second record over the first").select_option(OTHER)
        page.get_by_text(f"Dashed: {OTHER}").wait_for()
        page.get_by_role("table", name=table).get_by_role(
            "row", name=re.compile(rf"^imu\.q, {OTHER} ")
        ).wait_for()
        page.get_by_role("button", name="XY plot").click()
        page.get_by_role("img", name="imu.q over vanes.alpha_vane").wait_for()
        page.get_by_role("button", name="Spectrum").click()
        expect(page.get_by_role("table", name="Spectra").locator("tbody tr")).to_have_count(2)
        assert cells_of(page, "Spectra", "imu.q")[1] == "(deg/s)\N{SUPERSCRIPT TWO}/Hz"
        page.goto("about:blank")


@pytest.mark.nightly
@pytest.mark.parametrize("width", [800, 1440])
def test_models_are_compared(page, tmp_path, complaints, width):
    """A fit and a selection are saved, the board ranks them on a window that neither has used; all
    is in the log.
    """
    page.set_viewport_size({"width": width, "height": 900})
    project = reconstructed_project(tmp_path / "t37", tmp_path / "work", [FIRST, SECOND])
    with served(project, tmp_path / "work") as client:
        page.goto(client.bench.address)
        page.get_by_role("tab", name="Identification").click()
        page.get_by_label("Fit of the project to start from").select_option(label="multisine: Cm")
        page.get_by_role("img", name="Partial regression of Cm").wait_for()
        complaints.clear()  # windows of another fit begin after the end of the path
        model = page.get_by_label("Model", exact=True)
        model.fill("Cm = 1 + alpha + qhat")
        model.press("Enter")
        estimates = page.get_by_label("Estimates; a row shows its partial regression")
        expect(estimates.locator("tbody tr")).to_have_count(3)
        page.locator("summary", has_text=FIRST).click()
        page.get_by_role("button", name=f"Validate on 3211 elevator of {FIRST}").click()
        page.get_by_text("on other windows").wait_for()
        page.get_by_label("Name", exact=True).fill("poor")
        page.get_by_role("button", name="Save the fit").click()
        page.get_by_text("Saved: poor").wait_for()
        page.locator("summary", has_text="Selection of terms").click()
        page.get_by_label("Variables of the candidates").fill("alpha qhat delta_e")
        page.get_by_label("Variables of the candidates").press("Enter")
        page.get_by_role("button", name="Select the terms of Cm").click()
        page.get_by_role("button", name="Save the selection").click()
        page.get_by_text("Saved: Cm_stepwise").wait_for()
        page.locator("summary", has_text="Board of models").click()
        page.get_by_role("button", name="Compare the models").click()
        table = page.get_by_role("table", name="Models on the windows that they have not used")
        names = table.locator("tbody tr td:first-child")
        expect(names).to_have_text(["Cm_stepwise", "poor"])
        table.get_by_role("button", name=re.compile("^R")).click()
        expect(names).to_have_text(["poor", "Cm_stepwise"])
        page.get_by_role("button", name="Save the board").click()
        expect(page.locator("#job")).to_have_text(re.compile("^Done: aeromatch flight validate"))
        log = [one["command"].split()[1:3] for one in client.data("/api/actions")["actions"]]
        assert log == [["flight", "identify"], ["flight", "select"], ["flight", "validate"]]
        page.goto("about:blank")

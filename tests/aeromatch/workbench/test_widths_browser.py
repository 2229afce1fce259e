"""Every page of the workbench at 800 and 1440 px: nothing is cut, and the sides fold away."""

import sys
from pathlib import Path

import pytest

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
sys.path.insert(0, str(Path(__file__).parent))
from bench import MULTISINE, reconstructed_project, served
from test_new_project_browser import CUT

expect = pytest.importorskip("playwright.sync_api").expect
pytestmark = [pytest.mark.nightly, pytest.mark.browser]
# What a page has drawn when it is complete.
DRAWN = {
    "Records": "#page .uplot",
    "Identification": "#page .estimates table",
    "Database": "#page table[aria-label^='Nodes of']",
    "Match": "#match-column p",
    "New project": "#page table[aria-label='Files of the folder']",
}


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    folder = tmp_path_factory.mktemp("widths")
    with served(
        reconstructed_project(folder / "t37", folder / "w", [MULTISINE]), folder / "w"
    ) as c:
        yield c


@pytest.mark.parametrize("name", DRAWN)
def test_a_page_is_not_cut(client, page, name):
    page.goto(client.bench.address)
    page.get_by_role("tab", name=name).click()
    if name == "Identification":
        page.get_by_label("Fit of the project to start from").select_option(label="multisine: CY")
    page.locator(DRAWN[name]).first.wait_for(state="attached")
    for width, closed in ((1440, 0), (800, 2 if name == "New project" else 1)):
        page.set_viewport_size({"width": width, "height": 900})
        expect(page.locator(".column.closed")).to_have_count(closed)
        # plots follow the width of their column with the next frame
        page.wait_for_function(f"({CUT})().length === 0")
        assert page.evaluate("document.documentElement.scrollWidth") <= width
    expect(page.locator("iframe")).to_have_count(0)


def test_a_narrow_screen_has_one_side_open(client, page):
    page.set_viewport_size({"width": 800, "height": 900})
    page.goto(client.bench.address)
    page.locator("#page .uplot").first.wait_for()
    table = page.get_by_role("table", name="Manoeuvres")
    expect(table).to_be_hidden()
    page.get_by_role("button", name="Show the side: Manoeuvres").click()
    expect(table).to_be_visible()
    expect(page.locator("nav.column")).to_have_class("column closed")
    # the choice stays with the page
    page.get_by_role("tab", name="Match").click()
    page.get_by_role("tab", name="Records").click()
    expect(table).to_be_visible()
    page.get_by_role("button", name="Hide the side: Manoeuvres").click()
    expect(table).to_be_hidden()

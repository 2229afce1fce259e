"""The page of the databases in a real browser: what it draws, what an edit, its undoing and a
comparison show.
"""

import json
import sys
from pathlib import Path

import pytest

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
sys.path.insert(0, str(Path(__file__).parent))
from bench import drawn_anew, served
from databases_bench import project_with_databases

import aerodb

expect = pytest.importorskip("playwright.sync_api").expect
pytestmark = [pytest.mark.slow, pytest.mark.browser]


INSIDE = """() => {
    const node = document.querySelector("aside [role=group][aria-label='how well they agree']");
    const right = (one) => one.getBoundingClientRect().right;
    return node && [node, ...node.querySelectorAll("dd")].every((one) => right(one) <= right(node.closest("aside")));
}"""


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    with served(*project_with_databases(tmp_path_factory.mktemp("databases"))) as client:
        yield client


@pytest.fixture
def page(page, client):
    """The page of the databases."""
    page.goto(client.bench.address)
    page.get_by_role("tab", name="Database").click()
    page.get_by_role("group", name="CL/basic over alpha").wait_for()
    return page


def test_families_maps_and_estimates(page):
    curves = page.get_by_role("group", name="CL/basic over alpha")
    expect(curves.locator("path[stroke-dasharray='6 4']")).to_have_count(
        6
    )  # the prior of each of the six curves
    expect(curves.locator("path[fill-opacity]")).to_have_count(1)  # the band of one of them
    page.get_by_label("Band of").select_option("")
    expect(curves.locator("path[fill-opacity]")).to_have_count(6)
    slider = page.get_by_role("slider", name="mach")
    expect(slider).to_have_attribute("aria-valuetext", "0.1 to 0.6")
    slider.press("ArrowRight")
    expect(slider).to_have_attribute("aria-valuetext", "0.2 to 0.7")
    page.get_by_role("button", name="Map").click()
    cell = page.get_by_role("img", name="alpha 8 deg, mach 0.7: 1.387, standard error 0.02")
    expect(cell).to_contain_text("1.39")
    page.get_by_role("table", name="Terms of Cm").get_by_role("row", name="qhat").press("Enter")
    page.get_by_role("group", name="Cm/qhat over alpha").wait_for()
    expect(
        page.get_by_role("img", name="a: pitch: \u221252 \u00b1 1.5, alpha 4 deg, clean")
    ).to_have_count(1)
    expect(
        page.get_by_role("img", name="b: pitch: \u221255 \u00b1 2.5, alpha 6 deg, flaps 40 deg")
    ).to_have_count(1)


def test_a_node_is_set_undone_and_compared(page, client):
    page.get_by_role("table", name="Terms of Cm").get_by_role("row", name="qhat").click()
    page.get_by_role("button", name="4 deg: \u221250 \u00b1 0.5, flight; edit").click()
    page.get_by_label("New value of the node").fill("-51")
    page.get_by_label("Note for the history").fill("run 7")
    page.get_by_role("button", name="Set the node").click()
    page.get_by_role("button", name="Undo the last edit").wait_for()
    file = client.bench.opened.work / "databases" / "final_edited.nc"
    assert aerodb.terms(aerodb.open(file))["Cm/qhat"]["value"].values.tolist() == [
        -49.0,
        -51.0,
        -48.0,
    ]
    history = page.get_by_role("table", name="Edits, the last first").locator("tbody tr").first
    expect(history).to_contain_text("set_nodes: Cm/qhat at alpha 4 deg to -51, was -50 (run 7)")
    page.get_by_label("Against").select_option("{work}/match/final.nc")
    page.get_by_role("button", name="Comparison with final").click()
    row = page.get_by_role("table", name="Differences by term").get_by_role("row", name="Cm/qhat")
    expect(row.locator("td").nth(1)).to_have_text("\u22121")
    page.get_by_role("table", name="Differences by term").get_by_role(
        "row", name="CL/basic"
    ).click()
    page.get_by_role("group", name="CL/basic over alpha").wait_for()
    page.get_by_role("button", name="Undo the last edit").click()
    page.get_by_role("button", name="Undo the last edit").wait_for(state="detached")
    assert aerodb.terms(aerodb.open(file))["Cm/qhat"]["value"].values.tolist() == [
        -49.0,
        -50.0,
        -48.0,
    ]


@pytest.mark.nightly
def test_a_table_is_regridded_extended_blended_and_its_term_deleted(page, client):
    """Every one of them is a line of the history and of the log; what cannot be done is stated
    where it was asked.
    """
    file = client.bench.opened.work / "databases" / "shaped.nc"
    history = page.get_by_role("table", name="Edits, the last first").locator("tbody tr").first
    page.get_by_role("table", name="Terms of Cm").get_by_role("row", name="qhat").click()
    page.get_by_role("group", name="Cm/qhat over alpha").wait_for()
    page.get_by_label("Name of the new database").fill("shaped")
    page.get_by_text("Breakpoints: regrid, extend").click()
    points = page.get_by_label("all breakpoints")
    expect(points).to_have_value("0 4 8")
    points.fill("0 x 8")
    page.get_by_role("button", name="Regrid").click()
    page.get_by_role("alert").filter(
        has_text="breakpoints: give numbers with blanks between them"
    ).wait_for()
    points.fill("0 8")
    page.get_by_label("Largest difference that is allowed").fill("1")
    page.get_by_role("button", name="Regrid").click()
    page.get_by_role("alert").filter(
        has_text="differs from the old one by up to 1.5 at alpha 4 deg, allowed 1"
    ).wait_for()
    points.fill("0 2 4 8")
    page.get_by_role("button", name="Regrid").click()
    history.filter(has_text="regrid: Cm/qhat on alpha 4 for 3 breakpoints").wait_for()
    assert aerodb.terms(aerodb.open(file))["Cm/qhat"]["value"].values == pytest.approx(
        [-49.0, -49.5, -50.0, -48.0]
    )

    page.get_by_label("beyond the table", exact=True).fill("12 16")
    page.get_by_label("Which values beyond the table").select_option("values")
    page.get_by_label("Values beyond the table", exact=True).fill("-44 \u221240")
    page.get_by_label("Standard errors beyond the table").fill("3 3")
    page.get_by_role("button", name="Extend").click()
    history.filter(has_text="extend: Cm/qhat").wait_for()
    leaf = aerodb.terms(aerodb.open(file))["Cm/qhat"]
    assert leaf["value"].values[-2:].tolist() == [-44.0, -40.0]
    assert leaf["stderr"].values[-2:].tolist() == [3.0, 3.0]

    page.get_by_label("Against").select_option("{work}/match/datcom.nc")
    page.get_by_role("button", name="Blend with that of datcom").click()
    history.filter(has_text="blend: Cm/qhat").wait_for()
    agreement = page.get_by_role("group", name="how well they agree")
    expect(agreement.locator("dt").first).to_have_text("term")
    figures = dict(
        zip(*(agreement.locator(kind).all_inner_texts() for kind in ("dt", "dd")), strict=True)
    )
    assert figures["term"] == "Cm/qhat"
    assert float(figures["probability"]) < 1e-6  # seven and more standard errors apart
    page.wait_for_function(INSIDE)  # drawn anew when the page reads all again
    weights = [1 / 1.0**2, 1 / 4.0**2]
    mean = (weights[0] * -49.0 + weights[1] * -18.0) / sum(weights)
    assert float(aerodb.terms(aerodb.open(file))["Cm/qhat"]["value"][0]) == pytest.approx(
        mean, rel=1e-12
    )

    page.get_by_label("beyond the table", exact=True).fill("20")
    page.get_by_label("Which values beyond the table").select_option("linear")
    page.get_by_text("Delete the term").click()
    drawn_anew(page, "[aria-label='Note for the history']")
    expect(page.get_by_label("beyond the table", exact=True)).to_have_value("20")
    expect(page.get_by_label("Which values beyond the table")).to_have_value("linear")
    page.get_by_role("button", name="Delete Cm/qhat").click()
    history.filter(has_text="delete").wait_for()
    assert "Cm/qhat" not in aerodb.terms(aerodb.open(file))
    log = client.bench.opened.log.read_text(encoding="utf-8").splitlines()
    assert [json.loads(line)["words"][3] for line in log[-4:]] == [
        "regrid",
        "extend",
        "blend",
        "delete",
    ]

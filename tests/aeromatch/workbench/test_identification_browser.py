"""The page of the identification in a real browser: what it draws, what a term that is switched off
changes, what it saves.
"""

import re
import sys
from pathlib import Path

import pytest

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
sys.path.insert(0, str(Path(__file__).parent))
from bench import drawn_anew, reconstructed_project, served

from aeromatch.project.project import read_project
from aeromatch.workbench import coefficients
from flighttest.regression.equation_error.fit_file import open_fit

expect = pytest.importorskip("playwright.sync_api").expect
pytestmark = [pytest.mark.slow, pytest.mark.browser]
RECORD = "t37_10_multisine_clean_5kft"
FIT = "multisine"


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    folder = tmp_path_factory.mktemp("identification")
    with served(
        reconstructed_project(folder / "t37", folder / "work", [RECORD]), folder / "work"
    ) as client:
        yield client


@pytest.fixture
def page(page, client):
    """The page of the identification."""
    page.goto(client.bench.address)
    page.get_by_role("tab", name="Identification").click()
    return page


def rows_of(page):
    return page.get_by_label("Estimates; a row shows its partial regression").locator("tbody tr")


def estimates(page, *terms):
    """Estimates by term as the page shows them, once it shows those of these terms."""
    expect(rows_of(page).locator("td:first-child")).to_have_text(terms)
    cells = rows_of(page).evaluate_all(
        "rows => rows.map(row => [row.cells[0].innerText, row.cells[1].innerText])"
    )
    return {term: float(text.replace("\u2212", "-")) for term, text in cells}


def uncheck_all(page):
    boxes = page.locator("details[open] input:checked")
    while boxes.count():
        boxes.first.uncheck()
    page.get_by_text("Choose windows on the left.").wait_for()  # no earlier fit is on its way


def window(page, name):
    """Choose a window by its start and end."""
    start, stop = (
        page.get_by_label(f"{word} of a window of {RECORD} [s]") for word in ("start", "end")
    )
    start.fill(name[0])
    stop.fill(name[1])
    page.get_by_role("button", name=f"Add a window of {RECORD}").click()


@pytest.mark.nightly
def test_a_term_that_is_switched_off_and_what_is_saved(page, client):
    page.get_by_label("Fit of the project to start from").select_option(label=f"{FIT}: Cm")
    page.get_by_role("img", name="Partial regression of Cm").wait_for()
    uncheck_all(page)
    window(page, ("25", "5"))
    page.get_by_role("alert").filter(has_text="the end later").wait_for()
    window(page, ("5", "25"))
    page.get_by_text("1 window;").wait_for()
    window(page, ("25", "45"))
    page.get_by_text("2 windows;").wait_for()
    page.get_by_role("button", name="Take this fit as the reference").click()
    first = estimates(page, "1", "alpha", "qhat", "delta_e")
    expect(page.locator(".uplot canvas")).to_have_count(2)
    expect(page.get_by_label("Correlation of the estimates").locator("tbody tr")).to_have_count(4)
    expect(page.get_by_role("img", name="Partial regression of Cm")).to_have_count(1)
    expect(page.get_by_role("img", name="Power spectral density")).to_have_count(1)

    page.get_by_role("button", name="qhat", exact=True).click()
    page.get_by_text("Not in this fit: qhat").wait_for()
    changed = estimates(page, "1", "alpha", "delta_e")
    assert abs(changed["delta_e"] - first["delta_e"]) > 0.01
    page.get_by_role("button", name="All terms").click()
    page.get_by_text("Not in this fit: qhat").wait_for(state="detached")
    assert estimates(page, "1", "alpha", "qhat", "delta_e") == first

    page.get_by_role("button", name="Leave out each window").click()
    rows = page.get_by_label("Fits with one window or one term left out").locator("tbody tr")
    expect(rows).to_have_count(5)

    page.get_by_label("Name", exact=True).fill("by hand")
    page.get_by_role("button", name="Save the fit").click()
    page.get_by_text("Saved: by hand.nc").wait_for()
    saved = open_fit(client.bench.opened.work / "fits" / "by hand.nc")
    for term, value in first.items():
        assert float(saved.estimates["estimate"].sel(term=term)) == pytest.approx(value, rel=1e-3)
    page.get_by_role("button", name="Add to the project as a new fit").click()
    page.get_by_label("Fit of the project to start from").locator(
        "option", has_text="by hand: Cm"
    ).wait_for(state="attached")
    added = read_project(client.bench.opened.file).fit[-1]
    assert (added.name, added.records, added.window) == (
        "by hand",
        (RECORD,),
        ((5.0, 25.0), (25.0, 45.0)),
    )
    assert added.models == ("Cm = 1 + alpha + qhat + delta_e",)


@pytest.mark.nightly
def test_a_fit_in_frequency_and_with_a_ridge(page, client):
    """Both are shown as what they are, and saved as they are shown."""
    page.get_by_label("Fit of the project to start from").select_option(label=f"{FIT}: Cm")
    page.get_by_role("img", name="Partial regression of Cm").wait_for()
    in_time = estimates(page, "1", "alpha", "qhat", "delta_e")
    page.get_by_label("domain of the fit").select_option("frequency")
    page.get_by_text("frequencies in 0.1 ... 2 Hz").wait_for()
    page.get_by_label("upper edge of the band [Hz]").fill("1.8")
    page.get_by_label("upper edge of the band [Hz]").press("Tab")
    page.get_by_text("frequencies in 0.1 ... 1.8 Hz").wait_for()
    in_band = estimates(page, "1", "alpha", "qhat", "delta_e")
    assert 0.0 < abs(in_band["delta_e"] - in_time["delta_e"]) < 0.1 * abs(in_time["delta_e"])
    ridge = page.get_by_label("Ridge", exact=True)
    ridge.fill("much")
    ridge.press("Tab")
    page.get_by_role("alert").filter(has_text="Ridge: give a number, or auto.").wait_for()
    ridge.fill("0.5")
    ridge.press("Tab")
    page.get_by_role("columnheader", name="bias of the ridge").wait_for()
    shrunk = estimates(page, "1", "alpha", "qhat", "delta_e")
    assert abs(shrunk["delta_e"]) < abs(in_band["delta_e"])
    page.get_by_text("the estimate without the ridge").wait_for()
    page.get_by_label("Name", exact=True).fill("in band")
    page.get_by_role("button", name="Save the fit").click()
    page.get_by_text(re.compile(r"^Saved: .*in band\.nc")).wait_for()
    saved = open_fit(client.bench.opened.work / "fits" / "in band.nc").estimates
    assert (saved.attrs["domain"], saved.attrs["ridge"]) == ("frequency", 0.5)
    assert float(saved["estimate"].sel(term="delta_e")) == pytest.approx(
        shrunk["delta_e"], rel=1e-3
    )


@pytest.mark.nightly
def test_by_keyboard(page):
    """A chip is switched, and a row of the estimates chosen, without a mouse."""
    page.get_by_role("img", name="Partial regression").wait_for()
    uncheck_all(page)
    window(page, ("5", "45"))
    page.get_by_text("1 window;").wait_for()
    row = rows_of(page).filter(has_text="delta_e")
    row.focus()
    page.keyboard.press("Enter")
    page.get_by_role("img", name="on delta_e, slope").wait_for()
    chip = page.get_by_role("button", name="delta_e", exact=True)
    chip.focus()
    page.keyboard.press("Space")
    row.wait_for(state="detached")
    expect(chip).to_be_focused()


HALF_WRITTEN = """
import sys, time
from aeromatch.workbench import coefficients

def half(data, file, **_):
    file.write_bytes(b"half of it")
    print("half written", file=sys.stderr, flush=True)
    time.sleep(3600)

coefficients.write_netcdf = half
sys.exit(coefficients._main(sys.argv[1]))
"""


@pytest.mark.nightly
def test_coefficients_are_cancelled_while_they_are_written(page, complaints, client, monkeypatch):
    """The page states it where the fit would stand; nothing is left of the file; the same fit is
    made when it is requested again.
    """
    opened, run = client.bench.opened, client.bench.opened.run
    folder, names = opened.work / coefficients.FOLDER, ("1", "alpha", "qhat", "delta_e")
    page.get_by_label("Fit of the project to start from").select_option(label=f"{FIT}: Cm")
    page.get_by_role("img", name="Partial regression of Cm").wait_for()
    before, first = sorted(file.name for file in folder.iterdir()), estimates(page, *names)

    (opened.places.project / "half_written.py").write_text(
        HALF_WRITTEN, encoding="utf-8"
    )  # where the process starts
    monkeypatch.setattr(coefficients, "MOST_HERE", 0)
    monkeypatch.setattr(opened, "run", lambda title, _, words: run(title, "half_written", words))
    cutoff = page.get_by_label("Cut-off, Hz")
    cutoff.fill("2.6")
    cutoff.press("Tab")
    page.get_by_text(
        "Coefficients of 1 record are formed; they are kept, so that the next fit is quick."
    ).wait_for()
    expect(page.locator("#job")).to_have_text(f"Running: coefficients along {RECORD}. half written")
    (part,) = (file for file in folder.iterdir() if file.name not in before)
    assert part.read_bytes() == b"half of it"
    page.get_by_role("button", name="Cancel", exact=True).click()
    page.get_by_role("alert").filter(
        has_text=f"coefficients along {RECORD}: cancelled; fit again to form them"
    ).wait_for()
    expect(page.locator("#job")).to_have_text(
        re.compile(f"^Cancelled: coefficients along {RECORD}")
    )
    expect(page.get_by_role("button", name="Cancel", exact=True)).to_be_hidden()
    expect(rows_of(page)).to_have_count(0)
    assert sorted(file.name for file in folder.iterdir()) == before
    page.get_by_role("button", name="Actions").click()
    page.get_by_role("heading", name="Actions of this project").wait_for()
    expect(page.locator("#log")).not_to_contain_text("coefficients")  # no action, nothing to replay

    monkeypatch.undo()
    page.get_by_role("button", name="qhat", exact=True).click()
    estimates(page, "1", "alpha", "delta_e")
    page.get_by_role("button", name="All terms").click()
    again = estimates(page, *names)
    assert (
        0.0 < abs(again["delta_e"] - first["delta_e"]) < 0.1 * abs(first["delta_e"])
    )  # another low-pass
    assert len(list(folder.iterdir())) == len(before) + 1
    complaints.remove(
        "Failed to load resource: the server responded with a status of 400 (Bad Request)"
    )  # there is no fit to answer with


@pytest.mark.nightly
def test_what_is_typed_stays_when_the_page_is_drawn_anew(page, client):
    """An action of another page ends meanwhile; the model, ends of a window and a name are kept,
    with the cursor in its place.
    """
    page.get_by_role("img", name="Partial regression").wait_for()
    start, end = (
        page.get_by_label(f"{word} of a window of {RECORD} [s]") for word in ("start", "end")
    )
    start.fill("11")
    end.fill("12.5")
    name = page.get_by_label("Name", exact=True)
    name.fill("my fit")
    model = page.get_by_label("Model", exact=True)
    model.fill("Cm = 1 + alpha")  # not left yet: it is not fitted
    model.evaluate("node => node.setSelectionRange(3, 3)")
    drawn_anew(page, "input.model")
    expect(model).to_have_value("Cm = 1 + alpha")
    expect(model).to_be_focused()
    page.keyboard.type("q")
    expect(model).to_have_value("Cm q= 1 + alpha")
    page.keyboard.press("Backspace")
    expect(start).to_have_value("11")
    expect(end).to_have_value("12.5")
    expect(name).to_have_value("my fit")
    page.keyboard.press("Tab")
    estimates(page, "1", "alpha")  # the model counts when the field is left

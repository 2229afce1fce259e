"""Page of a new project in the browser: from dropped files to a plan, and to a signed report."""

import re
import sys
from pathlib import Path

import pytest

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
sys.path.insert(0, str(Path(__file__).parent))
from bench import served

import pom
from aeromatch.project.project import read_project
from aeromatch.workbench.actions import read_action_log

expect = pytest.importorskip("playwright.sync_api").expect
pytestmark = [pytest.mark.slow, pytest.mark.browser]

C182 = Path(__file__).parents[3] / "data" / "c182"
LISTINGS = ("clean.out", "elevator_m0.15_h5000.out")
MASSES = {
    "Gross mass": "2280 lb",
    "Moment of inertia in roll, Ixx": "2827 kg m2",
    "Moment of inertia in pitch, Iyy": "1913",
    "Moment of inertia in yaw, Izz": "4169",
    "Engine 1: where the thrust acts, from the moment reference point": "80.9 in, 0, 12.9 in",
    "Inertial unit, from the moment reference point": "0.40, 0.15, 0.25",
    "Vanes, from the moment reference point": "1.10, -3.60, -0.55",
}
# Elements of a page that are wider than the column around them, or that the window cuts.
CUT = """() => [...document.querySelectorAll("#page .column:not(.closed)")].filter((column) =>
    column.scrollWidth > column.clientWidth + 1
      || column.getBoundingClientRect().right > innerWidth + 1)
    .map((column) => column.getAttribute("aria-label") || column.id)"""


@pytest.fixture
def client(tmp_path):
    (tmp_path / "new").mkdir()
    with served(tmp_path / "new" / "aeromatch.toml", tmp_path / "work") as client:
        yield client


@pytest.fixture
def page(page, client):
    page.goto(client.bench.address)
    page.get_by_text("Drop recordings, listings, decks").wait_for()
    return page


def recording(name, folder):
    """Return a copy of a recording whose elevator has a heading that nobody knows."""
    text = (C182 / "flight" / f"{name}.csv").read_text()
    file = folder / f"{name}.csv"
    file.write_text(text.replace("Elevator (deg)", "CH7", 1))
    return file


def drop(page, files):
    """Drop files on the page, as the browser gives them."""
    page.get_by_label("Files of the project").set_input_files(files)
    page.get_by_text(f"{len(files)} of {len(files)} files copied.").wait_for()


def draft(page):
    """Draft the project, and take the column CH7 as the elevator."""
    page.get_by_role("button", name="Draft the project").click()
    row = page.get_by_role("row", name="CH7")
    row.wait_for()
    expect(row).to_contain_text("its heading is not known")
    page.get_by_role("listitem").filter(has_text="no elevator (delta_e)").first.wait_for()
    choice = page.get_by_label("CH7 is taken as")
    choice.dispatch_event("pointerdown")
    choice.select_option("delta_e")
    expect(row.get_by_role("alert")).to_contain_text("states a unit")
    page.get_by_label("unit of CH7").select_option("deg")
    expect(row).to_contain_text("as you wrote it")
    page.get_by_role("listitem").filter(has_text="no elevator (delta_e)").wait_for(state="detached")


def give_masses(page):
    """Give mass, inertias and places, and confirm the centre of gravity."""
    for label, text in MASSES.items():
        page.get_by_label(label, exact=True).fill(text)
    page.get_by_role("button", name="Write: Values of the aircraft").click()
    values = page.get_by_role("table", name="Values of the aircraft")
    expect(values.get_by_text("to be given")).to_have_count(0)
    expect(values.get_by_text("to be confirmed")).to_have_count(1)
    page.get_by_role("button", name="Confirm: Centre of gravity").click()
    expect(values.get_by_text("to be confirmed")).to_have_count(0)


def give_propeller(page, project, folder):
    """Read that the engine lacks its propeller, and drop the aircraft file with it."""
    power = page.get_by_role("status", name="Thrust of the engines")
    expect(power).to_contain_text("no thrust and no propeller")
    page.get_by_role("button", name="Plan the match").click()
    page.get_by_text("no record proves: the project has no case").wait_for()
    expect(page.get_by_text("The match accepts the project.")).to_have_count(0)
    own = (C182 / "aircraft.toml").read_text()
    charts = own[own.index("[engine.propeller]") : own.index("[limits]")]
    before, mark, after = project.with_name("aircraft.toml").read_text().partition("# [limits]")
    file = folder / "aircraft.toml"
    file.write_text(f"{before}{charts}{mark}{after}")
    drop(page, [file])
    page.get_by_text("aircraft.toml: the older file is kept as aircraft.toml.").wait_for()
    page.get_by_role("button", name="Check all again").click()
    expect(power).to_be_empty()


def sign(page, work, project):
    """Look at the case in its report, sign the case and the report, and match again."""
    cases = page.get_by_role("table", name=re.compile("^Cases: verdict"))
    expect(cases).to_contain_text("Short period")
    (result,) = pom.read_archive(work / "match" / "report").results
    signals = page.get_by_role("img", name=re.compile("^q of Short period"))
    signals.wait_for()
    link = page.get_by_role("link", name="The case in the report")
    with page.expect_popup() as opened:
        link.click()
    opened.value.get_by_role("heading", name=re.compile("Short period")).first.wait_for()
    opened.value.close()
    page.get_by_label("name of who signs the case", exact=True).fill("A. Engineer")
    page.get_by_role("button", name="Sign the case").click()
    page.get_by_role("table", name="Signatures of the case").get_by_text("A. Engineer").wait_for()
    page.get_by_text("Signatures of the report").click()
    page.get_by_label("name of who signs the report", exact=True).fill("B. Chief")
    page.get_by_role("button", name="Sign the report").click()
    page.get_by_role("table", name="Signatures of the report").get_by_text("B. Chief").wait_for()
    page.get_by_role("button", name="Match again").click()
    expect(page.locator("#job")).to_have_text(re.compile("^Done: aeromatch match"))
    report = (work / "match" / "report" / "report.html").read_text(encoding="utf-8")
    assert "B. Chief" in report
    assert read_project(project).signatures["prepared"].name == "B. Chief"
    (case,) = read_project(project).cases
    assert pom.read_case(case).signatures["prepared"]["name"] == "A. Engineer"
    assert result.case.name == pom.read_case(case).name


@pytest.mark.nightly
def test_from_dropped_files_to_a_checked_project(page, client, tmp_path):
    project = client.bench.opened.file
    files = [recording("check_short_period", tmp_path)]
    drop(page, [*[C182 / "datcom" / name for name in LISTINGS], *files])
    draft(page)
    assert read_project(project).names.read_text().count("CH7") == 1
    for width in (1440, 800):
        page.set_viewport_size({"width": width, "height": 900})
        expect(page.get_by_role("button", name="Show the side")).to_have_count(
            0 if width == 1440 else 2
        )
        assert page.evaluate(CUT) == [], width
    page.get_by_role("button", name="Show the side: Trace of the column").click()
    # the elevator and the rate that shows its sign
    expect(page.locator("aside .uplot")).to_have_count(2)
    expect(page.locator("aside")).to_contain_text("Positive: trailing edge down.")
    verbs = [entry.words[0] for entry in read_action_log(client.bench.opened.log)]
    assert verbs == ["init", "set", "init"]


@pytest.mark.nightly
def test_from_dropped_files_to_a_signed_report(page, client, tmp_path):
    work, project = client.bench.opened.work, client.bench.opened.file
    page.set_viewport_size({"width": 1440, "height": 900})
    flights = [recording(name, tmp_path) for name in ("cruise", "check_short_period")]
    drop(page, [*sorted((C182 / "datcom").glob("*.out")), *flights])
    draft(page)
    give_masses(page)
    give_propeller(page, project, tmp_path)
    page.get_by_label("check_short_period proves the model").check()
    expect(
        page.get_by_role("row", name="check_short_period").get_by_role("checkbox")
    ).to_be_checked()
    expect(page.locator("#job")).to_have_text(re.compile("^Done: aeromatch init . --prove"))
    page.get_by_role("button", name="Plan the match").click()
    page.get_by_text("The match accepts the project.").wait_for()
    expect(page.get_by_role("table", name="Cases of the plan")).to_contain_text("Short period")
    page.get_by_role("button", name="Match the project").click()
    sign(page, work, project)
    verbs = [entry.words[0] for entry in read_action_log(client.bench.opened.log)]
    assert verbs[0] == "init"
    assert verbs[-3:] == ["set", "set", "match"]
    for name in ("cruise.csv", "check_short_period.csv"):
        assert (project.parent / name).read_bytes() == (tmp_path / name).read_bytes()

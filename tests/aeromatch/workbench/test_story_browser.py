"""The whole job in the page: mark, fit, match, replace a term, fly again, tune, read the report; and all of it once more from the log."""

import json
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
sys.path.insert(0, str(Path(__file__).parent))
from bench import served, small_project

import aerodb
import pom
from aeromatch.project import read_project
from flighttest.equation_error.fit import open_fit
from flighttest.records import read_manoeuvres

CHROMIUM = shutil.which("chromium")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.browser,
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: apt-get install chromium"),
]
WAIT = 300_000  # [ms] a match on a busy machine
RECORD, FLOWN = "t37_08_flaps_full_gear_down_3kft", "t37_21_val_short_period_full_flaps_gear_down"
PROJECT = f"""
title = "T-37"
aircraft = "aircraft.toml"
names = "names.toml"
flights = ["flight/{RECORD}.nc", "flight/{FLOWN}.nc"]
cases = ["cases/21_short_period.toml"]
cutoff = "4 Hz"
errors = {{ mass = 0.005, thrust = 0.015, inertia = 0.0 }}

[listings]
clean = "datcom/t37_clean.out"
flaps = "datcom/t37_flaps.out"
elevator = "datcom/t37_elevator_one_by_one.pdas.out"

[terms."CD/gear"]
regressors = ["gear"]
stderr = 0.03
comment = "undercarriage, LR-743 (10)"

[[fit]]
name = "lift and drag"
records = ["{RECORD}"]
manoeuvres = ["3211 elevator", "doublet elevator"]
models = ["CL = 1 + alpha + qhat + delta_e", "CD = 1 + alpha + alpha**2 + delta_e"]
"""


def project(folder):
    file = small_project(folder)
    file.write_text(PROJECT)
    return file


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    folder = tmp_path_factory.mktemp("story")
    with served(project(folder / "t37"), folder / "work") as client:
        yield client


@pytest.fixture
def page(client):
    """A page that must neither complain nor load anything from elsewhere."""
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.set_default_timeout(60_000)
        asked, complaints = [], []
        page.on("request", lambda request: asked.append(request.url))
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("response", lambda answer: complaints.append(f"{answer.url}: {answer.text()}") if answer.status >= 400 else None)
        page.goto(client.bench.address)
        yield page
        assert [url for url in asked if not url.startswith((client.base, "data:", "blob:"))] == []
        assert not complaints, "\n".join(complaints)
        browser.close()


def actions(client, count=0):
    """Return what the log holds, when it has so many entries."""
    file = client.bench.opened.log
    for _ in range(WAIT // 200):
        rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
        if len(rows) >= count:
            assert {row["code"] for row in rows} <= {0, 1}, rows[-1]  # 1: a case that does not pass
            return rows
        time.sleep(0.2)
    raise AssertionError(f"{len(rows)} of {count} actions")


def test_from_a_mark_to_a_report(page, client, tmp_path):
    shutil.copytree(client.bench.opened.file.parent, tmp_path / "t37", symlinks=True)  # as it was, for the log
    work, named = client.bench.opened.work, lambda name: page.get_by_role("button", name=name, exact=True)

    # mark: the second doublet of the elevator gets a name of its own
    named(RECORD).click()
    form = page.get_by_role("complementary", name="Manoeuvres, faults, coverage")
    form.get_by_role("table", name="Manoeuvres").get_by_role("row", name="3211 elevator").click()
    start, end = (float(form.get_by_label(name, exact=True).input_value()) for name in ("start", "end"))
    named("New").click()
    for name, text in {"kind": "pitch_input", "control": "elevator", "start": f"{start - 1.0}", "end": f"{end + 1.0}"}.items():
        form.get_by_label(name, exact=True).fill(text)
    named("Add").click()
    actions(client, 2)
    marked = read_manoeuvres(read_project(client.bench.opened.file).manoeuvres)[RECORD]
    assert marked[marked["manoeuvre"] == "pitch_input"]["start"].tolist() == [start - 1.0]
    named("Reconstruct").click()
    actions(client, 3)

    # fit: the pitching moment over the new manoeuvre, into the project
    page.get_by_role("tab", name="Identification").click()
    page.get_by_label("Model", exact=True).fill("Cm = 1 + alpha + qhat + delta_e")
    page.get_by_label("Model", exact=True).press("Enter")
    windows = page.locator("details", has_text=RECORD)
    if windows.get_attribute("open") is None:
        windows.locator("summary").click()
    windows.locator("label", has_text="pitch_input elevator").wait_for()
    while windows.locator("input:checked").count():
        windows.locator("input:checked").first.uncheck()
    windows.locator("label", has_text="pitch_input elevator").locator("input").check()
    page.get_by_text("1 window;").wait_for(timeout=WAIT)
    page.get_by_label("Name", exact=True).fill("pitch")
    named("Save the fit").click()
    page.get_by_text("Saved: pitch.nc").wait_for(timeout=WAIT)
    named("Add to the project as a new fit").click()
    actions(client, 5)
    saved = open_fit(work / "fits" / "pitch.nc")
    assert float(saved.estimates["estimate"].sel(term="qhat")) == pytest.approx(-55.6, abs=2.0)  # seen: -55.60
    assert read_project(client.bench.opened.file).fits[-1].name == "pitch"

    # match: DATCOM misses the short period, and the damping explains it
    page.get_by_role("tab", name="Match").click()
    named("Match the project").click()
    table = page.get_by_role("table", name="Cases: verdict and worst difference over tolerance")
    table.wait_for(timeout=WAIT)
    results = pom.read_archive(work / "match" / "report").results[0]
    assert results.status("datcom") == "fail"
    assert f"{results.worst('final')['worst_ratio']:.3g}" in table.inner_text()
    page.get_by_role("table", name="Term swaps").get_by_role("row", name="Cm/qhat").first.wait_for()
    assert "Cm/qhat" in page.get_by_role("complementary", name="Case").inner_text()

    # replace: the damping of the final database in that of DATCOM, and an FMU of it
    page.get_by_role("tab", name="Database").click()
    for choice, label in (("Show", "datcom (match)"), ("Against", "final (match)")):
        page.locator("label", has=page.get_by_text(choice, exact=True)).locator("select").select_option(label=label)
    page.get_by_role("table", name="Terms of Cm").get_by_role("row", name="qhat").click()
    page.get_by_label("Note for the history").fill("damping from flight")
    named("Take Cm/qhat of final").click()
    actions(client, 7)
    named("Write the FMU").click()
    actions(client, 8)
    edited = {file.stem: file for file in (work / "databases").iterdir() if file.suffix == ".nc"}
    (name, file), final = edited.popitem(), aerodb.open(work / "match" / "final.nc")
    np.testing.assert_array_equal(aerodb.terms(aerodb.open(file))["Cm/qhat"]["value"], aerodb.terms(final)["Cm/qhat"]["value"])

    # fly again: better than DATCOM, and marked as a trial
    page.get_by_role("tab", name="Match").click()
    page.get_by_label("name of the trial").fill("damping")
    named("This case").click()
    actions(client, 9)
    page.get_by_label("Report", exact=True).select_option(label="trial: damping")
    page.get_by_text("Trial damping: no part of the proof").wait_for(timeout=WAIT)
    trial = pom.read_archive(work / "runs" / "damping").results[0]
    assert trial.worst(name)["worst_ratio"] < results.worst("datcom")["worst_ratio"]

    # tune, and read the report of the match
    named("Tune until all cases pass").click()
    actions(client, 10)
    page.get_by_text("Nothing had to move.").or_(page.get_by_role("table", name="Moves in standard errors")).first.wait_for(timeout=WAIT)
    page.get_by_label("Report", exact=True).select_option(label="proof of match")
    report = page.frame_locator("iframe.report")
    report.get_by_role("heading", name="Short period, full flaps, gear down").first.wait_for(timeout=WAIT)

    # the log does the same again, on the project as it was
    again = tmp_path / "again"
    words = ["match", tmp_path / "t37" / "aeromatch.toml", "-o", again, "--actions", client.bench.opened.log]
    run = subprocess.run([sys.executable, "-m", "aeromatch", *map(str, words)], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "t37" / "aeromatch.toml").read_bytes() == client.bench.opened.file.read_bytes()
    for one in ("match/final.nc", f"databases/{name}.nc"):
        was, now = (aerodb.terms(aerodb.open(folder / one)) for folder in (work, again))
        for term, leaf in was.items():
            np.testing.assert_array_equal(leaf["value"], now[term]["value"], term)
    assert pom.read_archive(again / "match" / "report").results[0].worst("final")["worst_ratio"] == results.worst("final")["worst_ratio"]

"""The whole job in the browser: a manoeuvre marked, a fit, the match, a term replaced, flown,
tuned; and its log replayed.
"""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
sys.path.insert(0, str(Path(__file__).parent))
from bench import CASE, MULTISINE, one_case_project, served

import aerodb
import pom
from aeromatch.project.editing import TRIAL
from aeromatch.project.project import read_project
from aeromatch.workbench.actions import read_action_log
from flighttest.records.manoeuvre_table import read_manoeuvres
from flighttest.regression.equation_error.fit_file import open_fit
from pom.result import results_name

expect = pytest.importorskip("playwright.sync_api").expect
# each page has browser tests of its own in every run
pytestmark = [pytest.mark.nightly, pytest.mark.browser]


@pytest.fixture
def client(tmp_path, monkeypatch):
    """A server; the replay of its log takes from the store what the session has computed from the
    same inputs.
    """
    monkeypatch.setenv("AEROMATCH_STORE", str(tmp_path / "store"))
    folder = tmp_path / "story"
    with served(one_case_project(folder / "t37"), folder / "work") as client:
        yield client


@pytest.fixture
def page(page, client):
    """The page of the records."""
    page.goto(client.bench.address)
    return page


def done(page, verb):
    """Wait for the end of an action."""
    expect(page.locator("#job")).to_have_text(re.compile(f"^Done: aeromatch {verb}"))


def test_from_a_mark_to_a_tuned_model_and_its_replay(page, client, tmp_path):
    work, project = client.bench.opened.work, client.bench.opened.file
    marks(page, project)
    fits(page, work, project)
    match(page, work)
    envelope(page)
    edits(page, work)
    flies_and_tunes(page, work, project)
    signs(page, work, project)
    replays(page, client, tmp_path)


def marks(page, project):
    """The multisine ends earlier and its free response is marked; the project gets the table, the
    marks of the record in it.
    """
    table = page.get_by_role("table", name="Manoeuvres")
    table.get_by_role("row", name="multisine").click()
    page.get_by_label("end", exact=True).fill("36.5")
    page.get_by_role("button", name="Change", exact=True).click()
    table.get_by_role("row", name="36.5").wait_for()
    done(page, "set")
    for name, text in (("kind", "free response"), ("start", "37.5"), ("end", "44")):
        page.get_by_label(name, exact=True).fill(text)
    page.get_by_role("button", name="Add", exact=True).click()
    table.get_by_role("row", name="free response").wait_for()
    rows = read_manoeuvres(project.parent / "manoeuvres.csv")[MULTISINE]
    spans = dict(zip(rows["manoeuvre"], zip(rows["start"], rows["end"], strict=True), strict=True))
    assert spans["multisine"] == (7.0, 36.5)
    assert spans["free response"] == (37.5, 44.0)
    assert set(spans) == {"trim", "multisine", "recover", "free response"}
    assert read_project(project).manoeuvres == project.parent / "manoeuvres.csv"
    page.get_by_role("button", name="Reconstruct", exact=True).click()
    page.get_by_text("Reconstructed: its channels stand").wait_for()


def fits(page, work, project):
    """The side force over the window as it was marked; a term is left out, the fit is saved, and
    its model goes into the project.
    """
    page.get_by_role("tab", name="Identification").click()
    page.get_by_label("Fit of the project to start from").select_option(label="multisine: CY")
    page.get_by_role("img", name="Partial regression of CY").wait_for()
    page.get_by_text("1 window of 1 record, 29.5 s;").wait_for()
    page.get_by_role("button", name="phat", exact=True).click()
    page.get_by_text("Not in this fit: phat").wait_for()
    page.get_by_label("Name", exact=True).fill("side force")
    page.get_by_role("button", name="Save the fit").click()
    page.get_by_text("Saved: side force.nc").wait_for()
    assert open_fit(work / "fits" / "side force.nc").estimates["term"].values.tolist() == [
        "1",
        "beta",
        "rhat",
        "delta_r",
    ]
    page.get_by_role("button", name="Write the model into").click()
    done(page, "set")
    assert "CY = 1 + beta + rhat + delta_r" in read_project(project).fit[0].models


def cases(page, *verdicts):
    """Return the texts of the only case, once it has these verdicts."""
    cells = page.get_by_role("table", name="Cases").locator("tbody td")
    expect(cells).to_have_text(
        [
            re.compile("^2"),
            re.compile("."),
            *(re.compile(rf"^\S+ {verdict}\b") for verdict in verdicts),
        ]
    )
    return cells.all_inner_texts()


def match(page, work):
    """The whole job; the screen has the verdicts of the report, the signals of the case, and a link
    to the report itself.
    """
    page.get_by_role("tab", name="Match").click()
    page.get_by_text("Nothing has been matched yet.").wait_for()
    page.get_by_role("button", name="Match the project").click()
    done(page, "match")
    (result,) = pom.read_archive(work / "match" / "report").results
    cells = cases(page, "FAIL", "pass", "pass")
    assert cells[:2] == ["2.d.2", "Roll response, clean"]
    for cell, run in zip(cells[2:], ("datcom", "corrected", "final"), strict=True):
        assert float(cell.split()[2]) == pytest.approx(
            result.worst(run)["worst_ratio"], rel=5e-3
        )  # three digits are shown
    page.get_by_role("img", name="p of Roll response, clean").wait_for()
    with page.expect_popup() as opened:
        page.get_by_role("link", name="The case in the report").click()
    report = opened.value
    report.get_by_role("heading", name="Roll response, clean").wait_for()
    expect(report.get_by_role("row", name="datcom").first).to_contain_text("FAIL")
    report.close()


def envelope(page):
    """The test points of both records stand about the 1 g line of the identified model; a click on
    one opens its manoeuvre.
    """
    page.get_by_role("tab", name="Records").click()
    page.get_by_role("button", name="Test points of all records").click()
    figure = page.get_by_role("group", name="alpha over mach, one point for each manoeuvre")
    figure.get_by_role("img", name=re.compile(r"^1 g line 1: \d+ ft, 2\d\d0 kg, clean")).wait_for()
    point = figure.get_by_role("button", name="t37_22_val_roll_response_clean, roll_to_bank").first
    point.click()
    page.get_by_role("heading", name="T-37 run 22 val_roll_response_clean").wait_for()


def signs(page, work, project):
    """Rationale and signatures of a case go into its file, those of the report into the project,
    with the results; one is taken back.
    """
    archive = pom.read_archive(work / "match" / "report")
    signed = {"results": results_name(archive.results)}
    page.get_by_label("Report", exact=True).select_option("match")
    rationale = page.get_by_label("rationale", exact=True)
    rationale.fill("light turbulence")
    page.get_by_role("button", name="Write the rationale").click()
    page.get_by_text("light turbulence", exact=True).wait_for()
    page.get_by_role("button", name="Sign the case").click()
    page.get_by_role("alert").filter(has_text="Give the name of who signs.").wait_for()
    expect(rationale).to_have_value("")
    rationale.fill("not written yet")
    for name in ("A. Engineer", "B. Reviewer"):
        page.get_by_label("name of who signs the case", exact=True).fill(name)
        page.get_by_label("day of the signature of the case").fill("2026-11-21")
        page.get_by_role("button", name="Sign the case").click()
        page.get_by_role("table", name="Signatures of the case").get_by_text(name).wait_for()
    expect(page.get_by_label("name of who signs the case", exact=True)).to_have_value("")
    expect(rationale).to_have_value("not written yet")
    page.get_by_role("button", name="take back: checked, the case").click()
    page.get_by_role("table", name="Signatures of the case").get_by_text("B. Reviewer").wait_for(
        state="detached"
    )
    page.get_by_text("Signatures of the report").click()
    page.get_by_label("role of who signs the report").select_option("approved")
    page.get_by_label("name of who signs the report", exact=True).fill('C. "Chief"')
    page.get_by_label("organisation of who signs the report").fill("flight test")
    page.get_by_label("day of the signature of the report").fill("2026-11-22")
    page.get_by_role("button", name="Sign the report").click()
    page.get_by_role("table", name="Signatures of the report").get_by_text(
        'C. "Chief", flight test'
    ).wait_for()
    case = pom.read_case(project.parent / "cases" / f"{CASE}.toml")
    assert list(case.rationale.values()) == ["light turbulence"]
    assert case.signatures == {
        "prepared": {"name": "A. Engineer", "date": "2026-11-21", "organisation": "", **signed}
    }
    chief = {"name": 'C. "Chief"', "date": "2026-11-22", "organisation": "flight test", **signed}
    assert read_project(project).signatures == {"approved": chief}
    expect(page.get_by_text(f"Signs the results {signed['results']}")).to_have_count(2)


def edits(page, work):
    """The weathercock stability of the a-priori model is put in place of the identified one, with
    its reason.
    """
    page.get_by_role("tab", name="Database").click()
    page.get_by_role("table", name="Terms of Cn").get_by_role(
        "row", name=re.compile("^beta ")
    ).click()
    page.get_by_role("group", name="Cn/beta over alpha").wait_for()
    page.get_by_label("Note for the history").fill("estimate before the flights")
    page.get_by_role("button", name="Take Cn/beta of datcom").click()
    page.get_by_role("button", name="Undo the last edit").wait_for()
    expect(
        page.get_by_role("table", name="Edits, the last first").locator("tbody tr").first
    ).to_contain_text("estimate before the flights")
    names = {
        "edited": "databases/final_edited.nc",
        "datcom": "match/datcom.nc",
        "final": "match/final.nc",
    }
    terms = {name: aerodb.terms(aerodb.open(work / file)) for name, file in names.items()}
    assert terms["edited"]["Cn/beta"]["value"].identical(terms["datcom"]["Cn/beta"]["value"])
    assert terms["edited"]["Cl/beta"]["value"].identical(terms["final"]["Cl/beta"]["value"])
    page.get_by_role("button", name="Write the FMU").click()
    done(page, "fmu write")


def expect_trial(page, trial, *verdicts):
    """Wait for the report of a trial with these verdicts of its case."""
    page.get_by_role("heading", name=f"Trial \u201c{trial}\u201d: no part of the proof").wait_for()
    link = page.get_by_role("link", name="The case in the report")
    expect(link).to_have_attribute("href", re.compile(rf"/runs/{trial}/report\.html#case-"))
    cases(page, *verdicts)


def flies_and_tunes(page, work, project):
    """With that term the case fails; on a copy with a wider band too; a small move of it passes,
    and tuning finds the way back.
    """
    page.get_by_role("tab", name="Match").click()
    page.get_by_role("button", name="This case").click()
    done(page, "pom run")
    expect_trial(page, "trial", "pass", "FAIL")

    case = project.parent / "cases" / f"{CASE}.toml"
    before = case.read_bytes()
    page.get_by_text("Another trim, other tolerances").click()
    page.get_by_label("trim of the trial").select_option("not trimmed")
    page.get_by_label("tolerance of roll rate in the trial").fill("4 deg/s")
    page.get_by_label("name of the trial").fill("wide")
    page.get_by_role("button", name="This case").click()
    expect_trial(page, "wide", "pass", "FAIL")
    page.get_by_text(f"a copy of {CASE}.toml with drive.trim = false").wait_for()
    assert case.read_bytes() == before
    own, copy = pom.read_case(case), pom.read_case(work / "trials" / "wide.toml")
    assert (own.drive.trim, copy.drive.trim) == (True, False)
    assert copy.title == f"{TRIAL}: {own.title}"
    ratios = {}
    for folder in ("match/report", "runs/wide"):
        (result,) = pom.read_archive(work / folder).results
        ratios[folder] = result.worst("final")["worst_ratio"]
    assert ratios["runs/wide"] < ratios["match/report"]

    page.get_by_label("term to move").select_option("Cn/beta")
    slider = page.get_by_role("slider", name="Cn/beta")
    for _ in range(12):
        slider.press("ArrowLeft")
    expect(slider).to_have_attribute(
        "aria-valuetext", re.compile(r"^\u00d7 0\.\d+, spends 1\.2 of 2 standard errors$")
    )
    page.get_by_role("button", name="Write, and fly all cases").click()
    expect_trial(page, "by_hand", "pass", "pass")
    moved, final = (
        aerodb.terms(aerodb.open(work / file))["Cn/beta"]
        for file in ("databases/by_hand.nc", "match/final.nc")
    )
    spent = abs(moved["value"] - final["value"]) / final["stderr"]
    assert float(spent.max()) == pytest.approx(1.2, rel=1e-6)

    page.get_by_label("database", exact=True).select_option(label="final_edited")
    page.get_by_role("button", name="Tune until all cases pass").click()
    done(page, "pom tune")
    page.get_by_role("table", name="Moves in standard errors").get_by_role(
        "row", name="Cn/beta"
    ).wait_for()
    log = json.loads((work / "tuning.json").read_text(encoding="utf-8"))
    assert (log["refusal"], [move["term"] for move in log["moves"]]) == ("", ["Cn/beta"])
    tuned = aerodb.terms(aerodb.open(work / "tuned" / "tuned.nc"))["Cn/beta"]
    assert tuned["value"].values == pytest.approx(final["value"].values, rel=1e-6)
    page.get_by_label("model", exact=True).select_option(label="tuned")
    page.get_by_label("tolerance of roll rate in the trial").fill("")
    page.get_by_label("trim of the trial").select_option("as the case has it")
    page.get_by_label("name of the trial").fill("tuned")
    page.get_by_role("button", name="This case").click()
    expect_trial(page, "tuned", "pass", "pass")


VERBS = [
    "flight mark",
    "set",
    "flight mark",
    "flight reconstruct",
    "flight identify",
    "set",
    "match",
    "db edit",
    "fmu write",
    "pom run",
    "set",
    "pom run",
    "db edit",
    "fmu write",
    "pom run",
    "pom tune",
    "pom run",
    *["set"] * 5,
]


def replays(page, client, tmp_path):
    """The log has what was done; carried out on the project as it was, it gives the same project,
    databases and verdicts.
    """
    work, project = client.bench.opened.work, client.bench.opened.file
    entries = read_action_log(client.bench.opened.log)
    assert [
        " ".join(entry.words[: 1 if entry.words[0] in ("set", "match") else 2]) for entry in entries
    ] == VERBS
    page.get_by_role("button", name="Actions").click()
    page.get_by_text("aeromatch flight mark manoeuvres.csv").first.wait_for()
    expect(page.locator("#log ol li")).to_have_count(len(entries))

    fresh, again = one_case_project(tmp_path / "t37"), tmp_path / "again"
    log = shutil.copy(client.bench.opened.log, tmp_path / "actions.jsonl")
    words = [
        sys.executable,
        "-m",
        "aeromatch",
        "match",
        str(fresh),
        "-o",
        str(again),
        "--actions",
        str(log),
    ]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for name in ("aeromatch.toml", "manoeuvres.csv"):
        assert (fresh.parent / name).read_bytes() == (project.parent / name).read_bytes()
    for name in (
        "match/datcom",
        "match/corrected",
        "match/final",
        "databases/final_edited",
        "databases/by_hand",
        "tuned/tuned",
    ):
        one, other = (aerodb.terms(aerodb.open(folder / f"{name}.nc")) for folder in (work, again))
        assert list(one) == list(other)
        assert all(one[term]["value"].identical(other[term]["value"]) for term in one), name
    for name in ("match/report", "runs/trial", "runs/wide", "runs/by_hand", "runs/tuned"):
        both = [pom.read_archive(folder / name).results[0].verdict for folder in (work, again)]
        assert both[0].equals(both[1])

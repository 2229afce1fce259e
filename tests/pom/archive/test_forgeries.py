"""Edits of a report with all of its files written anew: what shows them."""

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import report_fixture
import xarray as xr

import pom
from flightmech.support.console import to_json_types
from pom.archive.archive import read_archive
from pom.archive.case_files import compare_case_files
from pom.archive.flown_again import compare_flown_again
from pom.archive.origins import case_found_from, case_seen_from
from pom.archive.report_signature import read_signature
from pom.cases.case import PomCase, read_case
from pom.judging.applicability import settle_case
from pom.replaying.replay_case import replay
from pom.result import make_verdict_table
from pom.tolerances.bands import RowRemark

TIME = np.arange(0.0, 10.01, 0.1)
FAILURE = "trim = false\n[events]\nengine_failure = 2.0"


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Return the folder that the honest report is kept in."""
    return tmp_path_factory.mktemp("honest")


@pytest.fixture
def honest(kept, write_case, lag_states, toy, tmp_path):
    """Return the folder of a report with one departure; its case file lies next to it."""
    if not (kept / "report").exists():
        case = read_case(write_case(more="trim = false"))
        result = replay(case, {"toy": toy()}, lag_states)
        remark = RowRemark("departure", "departure: flown with flaps at 0 deg", "flaps")
        rows = [{**row, "remarks": (*row["remarks"], remark)} for row in result.rows]
        result = replace(result, verdict=make_verdict_table(rows))
        pom.write_report([result], tmp_path / "report", title="Toy", paper=None)
        shutil.copytree(tmp_path, kept, dirs_exist_ok=True)
    return kept / "report"


def forge(honest, folder, change):
    """Write the report again with a changed result, as somebody who hides an edit."""
    (result,) = read_archive(honest).results
    pom.write_report([change(result)], folder, title="Toy", paper=None)
    return folder


def without_departure(result):
    rows = []
    for row in result.rows:
        kept = tuple(item for item in row["remarks"] if item.quantity != "flaps")
        rows.append({**row, "remarks": kept})
    return replace(result, verdict=make_verdict_table(rows))


def with_nearer_trace(result):
    """The largest difference, which decides, is not touched."""
    theta = result.signals["theta"].copy(deep=True)
    theta[1, 150] = theta[0, 150] + 1e-3
    return replace(result, signals=result.signals.assign(theta=theta))


def with_other_mass(result):
    return replace(result, conditions={**result.conditions, "mass": 1.0})


def with_other_flight(result):
    """Flight and model are shifted together: every difference stays."""
    theta = result.signals["theta"] + 0.01
    return replace(result, signals=result.signals.assign(theta=theta))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (without_departure, "not stated: departure: departure: flown with flaps at # deg"),
        (with_nearer_trace, "theta of toy differs"),
        (with_other_mass, "condition mass 1"),
        (with_other_flight, "theta of flight differs"),
    ],
)
def test_a_second_flight_shows_an_edit_that_hides_itself(honest, tmp_path, change, words):
    assert {item.state for item in compare_flown_again(honest, honest)} == {"same"}
    forged = forge(honest, tmp_path / "forged", change)
    texts = [item.detail for item in compare_flown_again(forged, honest) if item.state != "same"]
    assert words in " ".join(texts)


@pytest.mark.slow
def test_files_in_another_place_are_no_difference(honest, tmp_path):
    def moved(result):
        places = {"tolerances": "here/rows.csv", "models": {"toy": "here/names.toml"}}
        return replace(result, case=replace(result.case, **places))

    other = forge(honest, tmp_path / "other", moved)
    assert {item.state for item in compare_flown_again(honest, other)} == {"same"}


@pytest.mark.slow
def test_a_window_that_the_case_file_does_not_have_is_found(honest, tmp_path):
    def narrowed(result):
        start, stop = result.case.window
        return replace(result, case=replace(result.case, window=(start, stop - 2.0)))

    forged = forge(honest, tmp_path / "forged", narrowed)
    details = {item.kind: item.detail for item in pom.verify(forged) if item.state == "changed"}
    assert "window" in details["case file"]
    assert "the window of the case has" in details["verdict"]


@pytest.mark.slow
def test_a_case_that_was_taken_out_leaves_its_file(honest):
    archive = read_archive(honest)
    (result,) = archive.results
    file = honest.parent / "other.toml"
    shutil.copy(result.case.path, file)
    states = {name: state for name, state, _ in compare_case_files(archive, [file])}
    assert states["other.toml"] == "missing"
    assert states[result.case.name] == "same"


def stored(case, time=TIME, **flight):
    """Return an archive with a case as a report in the folder ``report`` next to it holds it."""
    text = json.dumps(to_json_types(case_seen_from(case, Path(case.path).parent / "r").to_dict()))
    found = case_found_from(PomCase.from_dict(json.loads(text)), Path(case.path).parent / "r")
    traces = {name: (("run", "time"), values[None]) for name, values in flight.items()}
    signals = xr.Dataset(traces, {"run": ["flight"], "time": time})
    return SimpleNamespace(results=[SimpleNamespace(case=found, signals=signals)])


def test_an_honest_case_is_the_same_in_another_folder(write_case, tmp_path, monkeypatch):
    (tmp_path / "names.toml").touch()
    parts = '[facts]\nwithout = ["spoiler", "stabilizer"]\n[models]\ntoy = "names.toml"'
    file = write_case(more=f"trim = false\n{parts}")
    monkeypatch.chdir(tmp_path)
    text = json.dumps(to_json_types(case_seen_from(read_case(file.name), "report").to_dict()))
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path / "other")
    found = case_found_from(PomCase.from_dict(json.loads(text)), "../report")
    archive = stored(found)
    assert [state for _, state, _ in compare_case_files(archive)] == ["same"]
    # what both of them have, each under its own name
    file.write_text(file.read_text().replace('"spoiler", ', ""))
    ((_, state, detail),) = compare_case_files(archive)
    assert state == "changed"
    assert detail.endswith('results.nc has ["spoiler", "stabilizer"], the case file ["stabilizer"]')


def test_criteria_that_were_fitted_to_the_flight_are_those_of_the_case(write_case):
    case = read_case(write_case(id="1.b.8", case='shortened = "start of the record"', more=FAILURE))
    bank = {criterion.channel: 0.0 * TIME for criterion in case.criteria}
    bank["phi"] = np.radians(20.0 * TIME)
    fitted = settle_case(case, TIME, bank)
    assert fitted.criteria != case.criteria
    ((_, state, _),) = compare_case_files(stored(fitted, **bank))
    assert state == "same"
    # without the bank nothing shows whether the window ends with it
    ((_, state, detail),) = compare_case_files(stored(fitted))
    assert state == "unknown"
    assert "whether the flight meets the conditions of" in detail
    ((_, state, _),) = compare_case_files(stored(case, **bank))
    assert state == "changed"


def test_a_match_stores_the_criteria_that_were_judged(write_case):
    case = read_case(write_case(id="1.b.8", case='shortened = "start of the record"', more=FAILURE))
    fitted = settle_case(case, TIME, {"phi": np.radians(20.0 * TIME)})
    result = report_fixture.roll_result()
    kept = replace(result, case=fitted.without_texts()).with_case(replace(case, title="Another"))
    assert kept.case.criteria == fitted.criteria
    assert kept.case.title == "Another"


@pytest.mark.slow
def test_a_drawn_band_that_is_not_that_of_the_criteria_is_found(honest, tmp_path):
    def widened(result):
        return replace(result, tolerance=3.0 * result.tolerance)

    forged = forge(honest, tmp_path / "forged", widened)
    details = " ".join(item.detail for item in pom.verify(forged))
    assert "drawn band of theta: not that of the criteria" in details


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ssh-keygen") is None, reason="ssh-keygen is not installed")
def test_the_first_line_states_who_signed(tmp_path):
    manifest = tmp_path / "manifest.json"
    manifest.write_text("{}")
    assert read_signature(tmp_path).text.startswith("not signed")
    keys = [tmp_path / name for name in ("office", "other")]
    for key in keys:
        words = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(key)]
        subprocess.run(words, check=True)
    words = ["ssh-keygen", "-q", "-Y", "sign", "-f", str(keys[0]), "-n", "aeromatch"]
    subprocess.run([*words, str(manifest)], check=True, capture_output=True)
    assert read_signature(tmp_path).text.startswith("signed (manifest.json.sig), the key was not")
    signers = []
    for key in keys:
        signers.append(tmp_path / f"{key.name}_signers")
        signers[-1].write_text(f"{key.name} {key.with_suffix('.pub').read_text()}")
    assert read_signature(tmp_path, signers[0]).is_known
    assert "signed by office" in read_signature(tmp_path, signers[0]).text
    assert read_signature(tmp_path, signers[1]).is_refused
    # the same key stands there for another purpose as well
    key = keys[0].with_suffix(".pub").read_text()
    signers[0].write_text(f'git namespaces="git" {key}\noffice {key}')
    assert read_signature(tmp_path, signers[0]).is_known
    signers[0].write_text(f'git namespaces="git" {key}')
    assert read_signature(tmp_path, signers[0]).is_refused
    manifest.write_text("{ }")
    assert "not that of this manifest.json" in read_signature(tmp_path, signers[0]).text


@pytest.mark.slow
def test_a_report_without_signature_is_refused_by_who_wants_one(tmp_path):
    found = read_signature(tmp_path, tmp_path / "signers")
    assert found.is_refused
    assert not found.is_known
    assert "not signed" in found.text

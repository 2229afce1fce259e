"""``aeromatch pom`` as a user runs it: words in, text and exit code out."""

import hashlib
import json
import sys
from types import SimpleNamespace

import pytest

import pom
from aeromatch.cli.command import main


@pytest.fixture
def aeromatch(tmp_path, monkeypatch, capsys):
    def call(*words):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["aeromatch", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        output = capsys.readouterr()
        return SimpleNamespace(returncode=ended.value.code, stdout=output.out, stderr=output.err)

    return call


@pytest.fixture
def case(write_case, lag_states, tmp_path):
    """A case whose record is a reconstructed path in a file."""
    path = write_case(more="trim = false")
    lag_states.assign(alpha=lag_states["alpha"]).to_netcdf(
        tmp_path / "record.nc", engine="h5netcdf"
    )
    return path


@pytest.mark.slow
def test_run_passes_with_code_0_and_writes_the_report(aeromatch, case, toy, tmp_path):
    done = aeromatch("pom", "run", case, "--model", f"toy={toy()}", "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "2.c.10  A case" in done.stdout
    assert "toy          pass with departures  0.00 x tolerance" in done.stdout
    assert "1 model x 1 case: 1 pass" in done.stdout
    assert "no evidence given: a pass without evidence" in done.stdout
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "no evidence given: a pass without evidence" in page
    assert (tmp_path / "out" / "report.html").is_file()
    found = json.loads((tmp_path / "out" / "results.json").read_text())
    assert found["results"][0]["status"] == {"toy": "pass_with_departures"}
    assert found["provenance"]["command"].startswith("aeromatch pom run ")
    assert set(found["provenance"]["inputs"]) == {"case.toml", "record.nc"}
    assert set(found["provenance"]["models"]) == {"toy"}


@pytest.mark.nightly
def test_a_control_law_is_hashed_with_the_inputs_and_a_changed_one_is_found(
    aeromatch, write_case, law, toy, lag_states, tmp_path
):
    law()
    case = write_case(more='trim = false\n[control_law]\nfmu = "law.fmu"\nmoves = ["delta_e"]\n')
    flown = lag_states.assign(column=-lag_states["delta_e"] / 1.2)
    flown.to_netcdf(tmp_path / "record.nc", engine="h5netcdf")
    done = aeromatch("pom", "run", case, "--model", f"toy={toy()}", "-o", tmp_path / "out")
    assert done.returncode in (0, 1), done.stderr
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    inputs = {
        item["name"]: item
        for item in manifest["predicate"]["buildDefinition"]["resolvedDependencies"]
    }
    assert (
        inputs["law.fmu"]["digest"]["sha256"]
        == hashlib.sha256((tmp_path / "law.fmu").read_bytes()).hexdigest()
    )
    assert inputs["law.fmu"]["uri"] == "../law.fmu"
    assert {item.state for item in pom.verify(tmp_path / "out")} == {"same"}
    law("degrees")
    assert [
        (item.kind, item.name)
        for item in pom.verify(tmp_path / "out")
        if item.state not in ("same", "unknown")
    ] == [("input", "law.fmu")]


def test_a_failed_match_is_code_1(aeromatch, case, toy):
    case.write_text(
        case.read_text()
        + '[conditions]\ntheta = "4 deg"\n[tolerance]\nq = { abs = "0.1 deg/s", group = "q" }\n'
    )
    done = aeromatch("pom", "run", case, "--model", f"toy={toy()}")
    assert done.returncode == 1
    assert "FAIL" in done.stdout
    assert "pitch_rate" in done.stdout


def test_json_is_one_document(aeromatch, case, toy):
    done = aeromatch("pom", "run", case, "--model", f"toy={toy()}", "--json")
    (result,) = json.loads(done.stdout)
    assert result["status"] == {"toy": "pass_with_departures"}  # the toy is not trimmed
    assert {row["criterion"] for row in result["verdict"]} == {
        "pitch_angle",
        "pitch_rate",
        "normal_acceleration",
    }


def test_when_every_fmu_crashes_the_code_is_2_and_nothing_is_written(
    aeromatch, case, toy, tmp_path
):
    done = aeromatch("pom", "run", case, "--model", f"bad={toy('crash')}", "-o", tmp_path / "out")
    assert done.returncode == 2
    assert done.stderr.strip() == "error: no model could be replayed: bad: crashed: signal SIGSEGV"
    assert not (tmp_path / "out").exists()


def test_one_crash_among_two_models_is_a_result(aeromatch, case, toy):
    done = aeromatch(
        "pom", "run", case, "--model", f"bad={toy('crash')}", "--model", f"good={toy()}"
    )
    assert done.returncode == 1
    assert "INVALID  crashed: signal SIGSEGV" in done.stdout
    assert "1 INVALID, 1 pass" in done.stdout


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("pom", "run", "none.toml", "--model", "a=b.fmu"), "none.toml"),
        (("pom", "check", "none.toml"), "none.toml"),
        (("pom", "run", ".", "--model", "a=b.fmu"), "no case file"),
    ],
)
def test_bad_words_are_code_2(aeromatch, words, text):
    done = aeromatch(*words)
    assert done.returncode == 2
    assert text in done.stderr
    assert "Traceback" not in done.stderr


def test_a_misspelt_key_is_one_clear_error(aeromatch, case):
    case.write_text(case.read_text().replace("title", "titel"))
    done = aeromatch("pom", "check", case)
    assert done.returncode == 2
    assert "case.titel: unknown key; near it: title" in done.stderr


def test_check_prints_the_criteria(aeromatch, case):
    done = aeromatch("pom", "check", case)
    assert done.returncode == 0
    for word in ("pitch_angle", "theta", "1.5 deg", "0.1 g", "verified", "1 ... 9"):
        assert word in done.stdout


@pytest.mark.slow
def test_check_reports_all_that_is_wrong_with_all_cases(aeromatch, case, lag_states, tmp_path):
    lag_states.to_netcdf(tmp_path / "record.nc", engine="h5netcdf")
    text = case.read_text()
    (tmp_path / "late.toml").write_text(text.replace("window = [1.0, 9.0]", "window = [1.0, 90.0]"))
    wrong = text.replace('name = "a_case"', 'name = "a/case"').replace(
        "trim = false", 'trim = "yes"'
    )
    (tmp_path / "wrong.toml").write_text(wrong)
    done = aeromatch("pom", "check", tmp_path)
    assert done.returncode == 2
    assert "case.window 1 ... 90 s lies outside the record 0 ... 10 s" in done.stderr
    assert "case.name: 'a/case' names files and links" in done.stderr
    assert "drive.trim" in done.stderr
    assert "pitch_angle" in done.stdout  # what can be read is shown


@pytest.mark.nightly
def test_the_record_may_be_the_file_of_a_reconstruction(aeromatch, case, toy, lag_states, tmp_path):
    """`flight reconstruct` writes the states as a group next to constants and residuals."""
    lag_states.to_netcdf(tmp_path / "record.nc", group="states", engine="h5netcdf")
    lag_states[["q"]].to_netcdf(
        tmp_path / "record.nc", group="residuals", mode="a", engine="h5netcdf"
    )
    done = aeromatch("pom", "run", case, "--model", f"toy={toy()}")
    assert (done.returncode, done.stderr) == (0, "")

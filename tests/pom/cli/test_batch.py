"""``aeromatch pom run`` with tables of names, kept flights and several jobs."""

import json

import joblib
import pytest
from click.testing import CliRunner

from flightmech.errors import SchemaError
from pom.cli.group import pom

NAMES = '[inputs]\ndelta_e = "Elev"\n'


@pytest.fixture
def run(write_case, lag_states, tmp_path):
    """Run three cases of the toy, whose record is a file of reconstructed states."""
    text = write_case(more="trim = false").read_text()
    lag_states.to_netcdf(tmp_path / "record.nc", engine="h5netcdf")
    folder = tmp_path / "cases"
    folder.mkdir()
    for k in range(3):
        (folder / f"{k}.toml").write_text(
            text.replace("a_case", f"case_{k}").replace("record.nc", "../record.nc")
        )

    def call(*words):
        return CliRunner().invoke(pom, ["run", str(folder), *map(str, words)])

    return call


@pytest.mark.slow
def test_a_foreign_fmu_is_replayed_by_its_table_and_its_flights_are_kept(run, toy, tmp_path):
    (tmp_path / "names.toml").write_text(NAMES)
    words = (
        "--model",
        f"strange={toy(rename={'delta_e': 'Elev'})}",
        "--names",
        f"strange={tmp_path / 'names.toml'}",
    )
    words += ("--resume", tmp_path / "kept", "-j", 2, "--json")
    done = run(*words)
    assert done.exit_code == 0, done.output
    assert [row["case"] for row in json.loads(done.stdout)] == ["case_0", "case_1", "case_2"]
    # three cases that give the model the same are one flight, and three of the probes of its
    # inputs: scaled far from and near to those of the record, and late
    kept = sorted((tmp_path / "kept").rglob("*.flight"))
    assert len(kept) == 4
    assert run(*words).stdout == done.stdout
    assert sorted((tmp_path / "kept").rglob("*.flight")) == kept


def test_without_the_table_the_foreign_fmu_is_refused(run, toy):
    done = run("--model", f"strange={toy(rename={'delta_e': 'Elev'})}")
    assert isinstance(done.exception, SchemaError)
    assert "(strange): unknown input 'delta_e'" in str(done.exception)


def test_faulty_words_for_a_table_are_reported(run, toy):
    done = run("--model", f"a={toy()}", "--names", "names.toml")
    assert isinstance(done.exception, SchemaError)
    assert "'names.toml': write name=file.toml, such as simulator=names.toml" in str(done.exception)


@pytest.mark.nightly
def test_jobs_share_out_the_report_too_and_change_no_byte(run, toy, tmp_path, monkeypatch):
    monkeypatch.setattr("pom.report.case_parts.LEAST_SHARE", 1)
    effective, asked = joblib.effective_n_jobs, []
    monkeypatch.setattr(
        "pom.report.case_parts.effective_n_jobs",
        lambda jobs: asked.append(jobs) or effective(jobs),
    )
    reports = []
    for jobs in (1, 2):
        folder = tmp_path / f"report{jobs}"
        done = run(
            "--model",
            f"toy={toy()}",
            "-j",
            jobs,
            "-o",
            folder,
            "--date",
            "2026-11-21",
            "--title",
            "Toy",
            "--json",
        )
        assert done.exit_code == 0, done.output
        reports.append(
            {
                file.relative_to(folder).as_posix(): file.read_bytes()
                for file in folder.rglob("*")
                if file.is_file()
            }
        )
    assert {1, 2} <= set(asked)
    assert {"report.html", "report.pdf", "results.nc", "csv/case_2.csv"} <= reports[0].keys()
    assert reports[0] == reports[1]

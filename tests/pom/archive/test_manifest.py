"""The manifest of a report, and what its verification finds."""

import json
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

import pom
from flightmech.errors import SchemaError
from pom.archive import origins as manifest
from pom.cases.case import read_case
from pom.replaying.replay_case import replay


@pytest.fixture
def made(write_case, lag_states, toy, tmp_path):
    """A report of one real replay with its inputs next to it."""
    case = write_case(more="trim = false")
    lag_states.to_netcdf(tmp_path / "record.nc", engine="h5netcdf")
    own = shutil.copy(toy(), tmp_path / "toy.fmu")  # the FMU of the fixture serves other tests too
    read = read_case(case)
    result = replay(read, {"toy": toy()}, lag_states)
    made_from = pom.provenance(read.files(), {"toy": own}, "aeromatch pom run", "2026-11-21")
    pom.write_report([result], tmp_path / "report", title="Toy", provenance=made_from, paper=None)
    return tmp_path


def changed(folder):
    return {
        (item.kind, item.name): item
        for item in pom.verify(folder / "report")
        if item.state not in ("same", "unknown")
    }


@pytest.mark.slow
def test_an_untouched_report_holds(made):
    found = pom.verify(made / "report")
    assert {item.state for item in found} == {"same"}
    assert {item.name for item in found if item.kind == "output"} == {
        "report.html",
        "results.json",
        "results.nc",
        "results.xml",
        "csv/a_case.csv",
    }
    assert {item.name for item in found if item.kind == "input"} == {"case.toml", "record.nc"}
    assert [(item.kind, item.name) for item in found if item.kind in ("model", "verdict")] == [
        ("model", "toy: toy.fmu"),
        ("verdict", "a_case, toy"),
    ]


@pytest.mark.nightly
def test_a_report_moved_nearer_to_the_root_than_its_inputs_lay_holds(
    write_case, lag_states, toy, tmp_path
):
    lag_states.to_netcdf(tmp_path / "record.nc", engine="h5netcdf")
    read = read_case(write_case(more="trim = false"))
    deep = tmp_path / "one/two/three/four/five/six/seven/eight"
    made_from = pom.provenance(read.files(), {"toy": toy()}, "aeromatch pom run", "2026-11-21")
    pom.write_report(
        [replay(read, {"toy": toy()}, lag_states)],
        deep,
        title="Toy",
        provenance=made_from,
        paper=None,
    )
    with tempfile.TemporaryDirectory() as near:
        assert len(Path(near).parts) < len(
            deep.relative_to(tmp_path).parts
        )  # its inputs would lie beyond the root
        shutil.copytree(deep, Path(near) / "report")
        found = pom.verify(Path(near) / "report")
    assert {item.state for item in found if item.kind == "statement"} == {"same"}


def test_the_manifest_is_an_in_toto_statement_without_places_or_clock(made):
    text = (made / "report" / "manifest.json").read_text(encoding="utf-8")
    statement = json.loads(text)
    assert statement["_type"] == "https://in-toto.io/Statement/v1"
    assert statement["predicateType"] == "https://slsa.dev/provenance/v1"
    assert all(set(item["digest"]) == {"sha256"} for item in statement["subject"])
    definition = statement["predicate"]["buildDefinition"]
    assert definition["externalParameters"]["command"] == "aeromatch pom run"
    assert definition["internalParameters"]["cases"][0]["name"] == "a_case"
    assert [item["uri"] for item in definition["resolvedDependencies"]] == [
        "../case.toml",
        "../record.nc",
        "../toy.fmu",
    ]
    assert str(made) not in text
    for file in ("results.json", "results.nc", "report.html"):
        assert str(made).encode() not in (made / "report" / file).read_bytes()


def test_every_changed_file_is_named(made):
    (made / "record.nc").write_bytes(b"other")
    (made / "toy.fmu").unlink()
    page = made / "report" / "report.html"
    page.write_text(page.read_text(encoding="utf-8").replace("Toy", "Tow"), encoding="utf-8")
    found = changed(made)
    assert {key: item.state for key, item in found.items()} == {
        ("output", "report.html"): "changed",
        ("input", "record.nc"): "changed",
        ("model", "toy: toy.fmu"): "missing",
    }
    assert found["input", "record.nc"].detail.startswith("SHA-256 was ")


def rehash(folder, name):
    """Write the new hash of a file into the manifest, as somebody would who wants to hide a
    change.
    """
    path = folder / "report" / manifest.NAME
    statement = json.loads(path.read_text(encoding="utf-8"))
    for item in statement["subject"]:
        if item["name"] == name:
            item["digest"]["sha256"] = pom.archive.origins.file_sha256(folder / "report" / name)
    path.write_text(manifest.statement_text(statement), encoding="utf-8")


def test_changed_samples_are_judged_again(made):
    with h5py.File(made / "report" / "results.nc", "r+") as file:
        group = file["a_case"]
        run, channel = (
            list(group[name].asstr()[()]).index(word)
            for name, word in (("run", "toy"), ("channel", "q"))
        )
        group["signals"][run, channel, 200] += np.radians(5.0)
    rehash(made, "results.nc")
    found = changed(made)
    assert list(found) == [("verdict", "a_case, toy")]
    assert "pitch_rate: verdict pass, judged again fail" in found["verdict", "a_case, toy"].detail


def test_another_verdict_in_json_is_found(made):
    path = made / "report" / "results.json"
    document = json.loads(path.read_text(encoding="utf-8"))
    row = next(row for row in document["results"][0]["verdict"] if row["criterion"] == "pitch_rate")
    row["verdict"] = "fail"
    row["worst_ratio"] = 2.0
    path.write_text(json.dumps(document), encoding="utf-8")
    rehash(made, "results.json")
    detail = changed(made)["verdict", "a_case, toy"].detail
    assert "pitch_rate: verdict pass, results.json fail" in detail
    assert "results.json 2" in detail


def test_a_status_in_json_without_its_verdicts_is_found(made):
    path = made / "report" / "results.json"
    document = json.loads(path.read_text(encoding="utf-8"))
    document["results"][0]["status"]["toy"] = "fail"
    path.write_text(json.dumps(document), encoding="utf-8")
    rehash(made, "results.json")
    assert (
        changed(made)["verdict", "a_case, toy"].detail
        == "status pass_with_departures, results.json fail"
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "name", "detail"),
    [
        (
            ("externalParameters", "title"),
            "manifest: title, revision, command, date, cases",
            'title: results.nc has "Toy", manifest "Other"',
        ),
        (
            ("externalParameters", "command"),
            "manifest: title, revision, command, date, cases",
            'manifest "Other"',
        ),
        (
            ("internalParameters", "cases", 0, "title"),
            "manifest: resolved cases",
            "0: results.nc has",
        ),
        (
            ("internalParameters", "cases", 0, "criteria", 0, "band", "limits", 0, "value"),
            "manifest: resolved cases",
            "0: results.nc has",
        ),
    ],
)
def test_what_the_manifest_states_is_compared_with_the_results(made, place, name, detail):
    path = made / "report" / manifest.NAME
    statement = json.loads(path.read_text(encoding="utf-8"))
    item = statement["predicate"]["buildDefinition"]
    for key in place[:-1]:
        item = item[key]
    item[place[-1]] = "Other" if isinstance(item[place[-1]], str) else 7.5
    path.write_text(manifest.statement_text(statement), encoding="utf-8")
    assert detail in changed(made)["statement", name].detail


def test_versions_and_hashes_of_the_manifest_are_compared(made):
    path = made / "report" / manifest.NAME
    statement = json.loads(path.read_text(encoding="utf-8"))
    statement["predicate"]["runDetails"]["builder"]["version"]["numpy"] = "0.1"
    path.write_text(manifest.statement_text(statement), encoding="utf-8")
    assert 'manifest "0.1"' in changed(made)["statement", "manifest: versions"].detail


def test_wider_bands_under_the_name_of_the_regulation_are_found(
    write_case, lag_states, toy, tmp_path
):
    case = read_case(write_case(more="trim = false"))
    wide = [
        replace(
            c,
            band=replace(
                c.band, limits=tuple(replace(x, value=2.5 * x.value) for x in c.band.limits)
            ),
        )
        for c in case.criteria
    ]
    result = replay(replace(case, criteria=tuple(wide)), {"toy": toy()}, lag_states)
    pom.write_report([result], tmp_path / "report", title="Toy", paper=None)
    detail = changed(tmp_path)["tolerance", "a_case"].detail
    assert (
        "pitch_angle: band '3.75 deg', the table of FAA 14 CFR Part 60 App A Table A2A, "
        "2014-01-01 has '1.5 deg'" in detail
    )


def test_a_band_of_the_case_file_is_no_deviation(write_case, lag_states, toy, tmp_path):
    case = read_case(write_case(more='trim = false\n[tolerance]\npitch_angle = "3 deg"'))
    pom.write_report(
        [replay(case, {"toy": toy()}, lag_states)], tmp_path / "report", title="Toy", paper=None
    )
    assert changed(tmp_path) == {}


def test_a_trim_beyond_its_limits_that_no_row_states_is_found(
    write_case, lag_states, toy, tmp_path
):
    result = replay(read_case(write_case(more="trim = false")), {"toy": toy()}, lag_states)
    result.trim.loc["trim.delta_e", "toy"] = np.radians(2.0)
    pom.write_report([result], tmp_path / "report", title="Toy", paper=None)
    assert (
        changed(tmp_path)["verdict", "a_case, toy"].detail
        == "trim: elevator deflection +2 deg is beyond 1 deg ('trim.delta_e'): not stated"
    )


def test_a_watched_channel_that_no_row_states_is_found(write_case, lag_states, toy, tmp_path):
    result = replay(read_case(write_case(more="trim = false")), {"toy": toy()}, lag_states)
    banked = np.zeros((2, result.signals.sizes["time"]))
    banked[1, 200:] = np.radians(5.0)
    result = replace(
        result, signals=result.signals.assign(phi=(("run", "time"), banked, {"units": "rad"}))
    )
    pom.write_report([result], tmp_path / "report", title="Toy", paper=None)
    text = "bank angle off by 5 deg at 5.0 s, without a tolerance, watched within 4 deg: not stated"
    assert changed(tmp_path)["verdict", "a_case, toy"].detail == text


@pytest.mark.slow
def test_a_crashed_model_stays_invalid(write_case, lag_states, toy, tmp_path):
    result = replay(
        read_case(write_case(more="trim = false")), {"good": toy(), "bad": toy("error")}, lag_states
    )
    assert result.failure.startswith("bad: ")
    pom.write_report([result], tmp_path / "report", title="Toy", paper=None)
    assert changed(tmp_path) == {}


def test_what_is_no_report_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no manifest\.json here"):
        pom.verify(tmp_path)
    (tmp_path / "manifest.json").write_text('{"_type": "x"}')
    with pytest.raises(SchemaError, match="not a manifest"):
        pom.verify(tmp_path)


@pytest.mark.slow
def test_verify_on_the_command_line(aeromatch, made):
    done = aeromatch("pom", "verify", made / "report")
    signed, first, sign, not_flown, not_covered = done.stdout.strip().splitlines()
    assert done.returncode == 0
    assert signed.startswith("not signed (no manifest.json.sig)")
    assert "--against REPORT" in not_flown
    assert (
        first == "all as it was: 5 outputs, 2 inputs, 1 model, 7 program files, 6 statements, "
        "1 tolerance, 1 verdict, 1 case file checked"
    )
    assert (
        sign == f"SHA-256 of manifest.json, to be signed: "
        f"{pom.archive.origins.file_sha256(made / 'report' / manifest.NAME)}"
    )
    assert not_covered == "not covered: page and PDF but for their hashes"
    (made / "case.toml").write_text("else")
    done = aeromatch("pom", "verify", made / "report")
    assert done.returncode == 1
    assert "case.toml" in done.stdout
    # the file, and the case that it no longer holds
    assert "2 of 24 differ" in done.stdout
    done = aeromatch("pom", "verify", made / "report", "--json")
    found = [item for item in json.loads(done.stdout) if item["state"] != "same"]
    assert [(item["kind"], item["name"]) for item in found] == [
        ("signature", "manifest.json"),
        ("input", "case.toml"),
        ("case file", "a_case"),
    ]


@pytest.mark.slow
def test_options_of_a_report_on_the_command_line(aeromatch, made, tmp_path):
    words = [
        "--junit",
        tmp_path / "j.xml",
        "-o",
        tmp_path / "run",
        "--revision",
        "C",
        "--date",
        "2026-11-22",
        "--no-pdf",
    ]
    done = aeromatch("pom", "run", made / "case.toml", "--model", f"toy={made / 'toy.fmu'}", *words)
    assert done.returncode == 0, done.stderr
    assert 'failures="0"' in (tmp_path / "j.xml").read_text(encoding="utf-8")
    found = pom.read_archive(tmp_path / "run")
    assert (found.revision, found.provenance["date"]) == ("C", "2026-11-22")
    assert not (tmp_path / "run" / "report.pdf").exists()
    assert {item.state for item in pom.verify(tmp_path / "run")} == {"same"}


@pytest.mark.slow
def test_a_report_is_written_again_from_results(aeromatch, made, tmp_path):
    done = aeromatch(
        "pom",
        "report",
        made / "report",
        "-o",
        tmp_path / "again",
        "--no-pdf",
        "--revision",
        "B",
        "--title",
        "Toy again",
    )
    assert done.returncode == 0, done.stderr
    assert "Toy again" in (tmp_path / "again" / "report.html").read_text(encoding="utf-8")
    assert pom.read_archive(tmp_path / "again").revision == "B"
    assert {item.state for item in pom.verify(tmp_path / "again")} == {
        "same"
    }  # its inputs are found from the new place


@pytest.mark.slow
def test_reports_are_joined(aeromatch, made, tmp_path):
    done = aeromatch(
        "pom",
        "report",
        made / "report",
        made / "report" / "results.nc",
        "-o",
        tmp_path / "both",
        "--no-pdf",
    )
    assert done.returncode == 0, done.stderr
    assert len(pom.read_archive(tmp_path / "both").results) == 2
    assert sorted(path.name for path in Path(tmp_path / "both" / "csv").iterdir()) == [
        "a_case-2.csv",
        "a_case.csv",
    ]
    # both show one flight, which counts once
    first, second = pom.read_archive(tmp_path / "both").results
    assert first.status("toy") == "pass_with_departures"  # it is not trimmed
    assert second.status("toy") == "pass_with_departures"

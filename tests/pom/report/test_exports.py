"""What a report hands to programs: results.nc and results.json, JUnit XML, CSV."""

import csv
import json
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import h5py
import numpy as np
import pandas as pd
import pytest
import xarray as xr

import pom
from flightmech.errors import SchemaError
from pom.archive import archive
from pom.archive.results_document import case_results_text
from pom.report import exports
from pom.report.case.page import case_keys
from pom.report.overview import departure_table
from pom.tolerances.bands import RowRemark
from pom.tolerances.editions import test_order as order_of_test

sys.path.insert(0, str(Path(__file__).parents[1]))
import report_fixture as fixture


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("report")
    table = fixture.diagnosis().assign(
        **{"spiral stderr": np.nan}
    )  # a column without any number stays one of numbers
    diagnoses = {"short_period_full_flaps": table}
    pom.write_report(
        fixture.results(),
        place,
        title="T-37",
        provenance=fixture.PROVENANCE,
        diagnoses=diagnoses,
        revision="A",
        paper=None,
    )
    return place


@pytest.mark.slow
def test_results_come_back_from_netcdf_bit_for_bit(folder):
    found = pom.read_archive(folder)
    assert (found.title, found.revision) == ("T-37", "A")
    # a report has its cases in the order of the tests
    made = {result.case.name: result for result in fixture.results()}
    assert sorted(result.case.name for result in found.results) == sorted(made)
    for after in found.results:
        before = made[after.case.name]
        assert replace(after.case, path="", record="") == replace(before.case, path="", record="")
        assert Path(after.case.record) == Path(before.case.record).resolve()
        assert after.signals.identical(before.signals)
        assert after.tolerance.identical(before.tolerance)
        assert after.inputs.identical(before.inputs)
        assert after.verdict.equals(before.verdict)
        assert after.trim.equals(before.trim)
        assert (after.conditions, after.failure) == (before.conditions, before.failure)
    table = found.diagnoses["short_period_full_flaps"]
    pd.testing.assert_frame_equal(table, fixture.diagnosis().assign(**{"spiral stderr": np.nan}))


def test_columns_of_an_earlier_diagnosis_get_their_present_names(tmp_path):
    """Files that were written before the columns were renamed hold ``closes`` and ``miss``."""
    now = fixture.diagnosis()
    before = now.rename(
        columns=lambda name: name.replace("explained", "closes").replace("mismatch", "miss")
    )
    assert {"closes", "miss", "pitch_rate closes", "pitch_rate miss"} <= set(before.columns)
    archive.write_archive(tmp_path / "results.nc", archive.Archive([], diagnoses={"a": before}), [])
    pd.testing.assert_frame_equal(archive.read_archive(tmp_path / "results.nc").diagnoses["a"], now)


def test_inputs_on_another_clock_keep_it(tmp_path):
    result = fixture.short_period_result()
    coarse = replace(result, inputs=result.inputs.isel(time=slice(None, None, 5)))
    archive.write_archive(tmp_path / "results.nc", archive.Archive([coarse]), ["a"])
    (after,) = archive.read_archive(tmp_path / "results.nc").results
    assert after.inputs.identical(coarse.inputs)
    assert after.signals.identical(result.signals)


@pytest.mark.slow
def test_general_tools_read_the_archive(folder):
    tree = xr.open_datatree(folder / "results.nc", engine="h5netcdf")
    case = tree["short_period_full_flaps"].to_dataset()
    theta = case["signals"].sel(run="final", channel="theta")
    np.testing.assert_array_equal(
        theta, fixture.short_period_result().signals["theta"].sel(run="final")
    )
    tree.close()


@pytest.mark.parametrize("content", [b"not HDF5", None])
def test_what_is_no_archive_is_refused(tmp_path, content):
    path = tmp_path / "results.nc"
    if content is None:
        with h5py.File(path, "w") as file:
            file["else"] = 1.0
    else:
        path.write_bytes(content)
    with pytest.raises(SchemaError, match=r"not a results\.nc of a report"):
        pom.read_archive(tmp_path)


def test_json_holds_every_number_and_no_samples(folder):
    document = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    assert document["samples"] == "results.nc"
    ordered = sorted(fixture.results(), key=lambda result: order_of_test(result.case.id))
    for item, result in zip(document["results"], ordered, strict=True):
        assert not {"signals", "tolerance"} & set(item)
        assert item["status"] == {run: result.status(run) for run in result.runs}
        assert [row["verdict"] for row in item["verdict"]] == list(result.verdict["verdict"])
        np.testing.assert_array_equal(
            [row["worst_ratio"] or np.nan for row in item["verdict"]], result.verdict["worst_ratio"]
        )
    assert len(document["diagnoses"]["short_period_full_flaps"]) == len(fixture.diagnosis())


def test_junit_counts_what_the_report_states(folder):
    root = ElementTree.parse(folder / "results.xml").getroot()
    groups = [
        verdict for r in fixture.results() for run in r.runs for verdict in r.groups(run).values()
    ]
    assert root.get("tests") == str(len(groups))
    assert root.get("failures") == str(groups.count("fail")) != "0"
    assert root.get("errors") == str(groups.count("invalid")) != "0"
    test = root.find("testsuite/testcase[@classname='short_period_full_flaps.datcom']")
    assert test.get("name") == "pitch_angle or pitch_rate"
    assert "x tolerance" in test.find("failure").get("message")


def test_a_failed_alternative_is_no_failure(folder):
    """Pitch angle outside, pitch rate inside: one of the two is enough, so the test passes."""
    result = fixture.short_period_result()
    result.verdict.loc[
        (result.verdict["run"] == "final") & (result.verdict["criterion"] == "pitch_angle"),
        "verdict",
    ] = "fail"
    suite = ElementTree.fromstring(exports.junit_xml([result], "x").split("\n", 1)[1])
    tests = suite.findall("testsuite/testcase[@classname='short_period_full_flaps.final']")
    assert all(test.find("failure") is None for test in tests)


def test_a_trim_beyond_its_limits_is_a_failed_test_of_its_own():
    result = fixture.short_period_result()
    remark = RowRemark(
        "trim",
        "trim.delta_e +2.2 deg is beyond 1 deg",
        "delta_e",
        {"found": 2.2, "limit": 1.0},
        "deg",
    )
    for index in result.verdict.index[result.verdict["run"] == "final"]:
        result.verdict.at[index, "remarks"] = (remark,)
    assert result.status("final") == "limits_exceeded"
    suite = ElementTree.fromstring(exports.junit_xml([result], "x").split("\n", 1)[1])
    (test,) = suite.findall("testsuite/testcase[@name='trim within its limits']")
    assert test.get("classname") == "short_period_full_flaps.final"
    assert test.find("failure").get("message") == remark.text


def test_the_json_of_a_report_is_refused_with_its_folder(folder):
    with pytest.raises(SchemaError, match=r"not from results.json; give the folder "):
        pom.read_archive(folder / "results.json")


def test_departures_are_a_skipped_test_of_their_own():
    result = fixture.short_period_result()
    remark = RowRemark("departure", "departure: tolerance of pitch_angle 9 deg, printed 1.5 deg")
    for index in result.verdict.index[result.verdict["run"] == "final"]:
        result.verdict.at[index, "remarks"] = (remark,)
    assert result.status("final") == "pass_with_departures"
    suite = ElementTree.fromstring(exports.junit_xml([result], "x").split("\n", 1)[1])
    (test,) = suite.findall("testsuite/testcase[@name='no departure from the printed row']")
    assert test.find("failure") is None
    assert test.find("skipped").get("message") == remark.text
    # and one line of the page of the departures and of the document for programs
    (entry,) = departure_table(["k"], [result])
    assert entry["key"] == "k"
    assert entry["rows"] == [("final", remark.text.removeprefix("departure: "))]
    text = case_results_text(result, pd.DataFrame(), ".")
    numbers = json.loads(text.numbers)
    assert numbers["departures"]["final"] == [remark.text]


def test_control_characters_do_not_break_the_xml():
    result = fixture.short_period_result(title="a\x00b \ud800 <&> \ufffe\U0001f6e9")
    root = ElementTree.fromstring(exports.junit_xml([result], "\x1b").split("\n", 1)[1].encode())
    assert root.find("testsuite").get("name") == "2.c.10 a?b ? <&> ?\U0001f6e9"


def test_csv_has_all_samples_in_si(folder):
    result = fixture.crashed_result()
    with (folder / "csv" / "approach_elevator_step.csv").open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    assert len(rows) == result.signals.sizes["time"]
    column = head.index("theta final")
    np.testing.assert_allclose(
        [float(row[column]) for row in rows],
        result.signals["theta"].sel(run="final"),
        rtol=5.001e-9,
    )
    assert all(row[head.index("theta corrected")] == "" for row in rows)  # the model that crashed
    assert "theta tolerance" in head
    assert "delta_e input" in head


def test_names_with_commas_stay_one_column():
    result = fixture.roll_result()
    named = replace(result, signals=result.signals.assign_coords(run=["flight", "a,b", "nan", "c"]))
    head, first, *_ = csv.reader("".join(exports.case_csv(named)).splitlines())
    assert "p a,b" in head
    assert "p nan" in head
    assert len(first) == len(head)


def test_groups_of_the_archive_are_named_as_the_pages(folder):
    with h5py.File(folder / "results.nc") as file:
        assert set(file) - {"document"} == set(case_keys(fixture.results()))


def test_samples_in_parts_are_those_in_one(monkeypatch):
    result = fixture.roll_result()
    whole = "".join(exports.case_csv(result))
    assert whole.count("\n") == result.signals.sizes["time"] + 1
    monkeypatch.setattr(exports, "_BLOCK", 7)
    parts = list(exports.case_csv(result))
    assert len(parts) > 10
    assert "".join(parts) == whole

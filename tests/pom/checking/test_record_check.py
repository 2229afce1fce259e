"""A pass against a flight record with an error is not a plain pass; page, index and JUnit state the
error.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import xarray as xr

import flighttest
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import SchemaError
from pom.archive.archive import read_archive
from pom.cases.case import read_case
from pom.checking.batch_check import KeptChecks, check_batch
from pom.checking.case_check import (
    RecordCheck,
    RecordError,
    check_key,
    check_records,
    checks_text,
    codes_text,
    with_record_checks,
)
from pom.report import exports
from pom.report.writer import write_report
from pom.result_notices import run_notices
from pom.status import status_text

sys.path.insert(0, str(Path(__file__).parents[1]))
import report_fixture as fixture

T37 = Path(__file__).parents[3] / "data" / "t37"
C182 = Path(__file__).parents[3] / "data" / "c182"
SIGN = RecordError(
    "sign:delta_a+p", "delta_a has the wrong sign; delta_a = { column = 'Aileron', sign = -1 }"
)
SIGN_TITLE = "sign of delta_a (aileron deflection), p (body roll rate)"


@pytest.fixture(scope="module")
def passed():
    """A result that the final model passes."""
    result = fixture.short_period_result()
    assert result.status("final") == "pass"
    return result


def on_record(result, *errors):
    (made,) = with_record_checks(
        [result], {result.case.record: RecordCheck("r", "not fit", errors)}
    )
    return made


def test_a_pass_on_a_faulty_record_has_a_status_of_its_own(passed):
    made = on_record(passed, SIGN)
    assert made.status("final") == "record_error"
    assert not made.passed("final")
    assert status_text("record_error") == "RECORD"
    assert run_notices(made, "final")[0] == f"error of the flight record: {SIGN_TITLE}: {SIGN.text}"
    assert made.status("datcom") == passed.status("datcom") == "fail"  # a failure stays one


def test_an_error_outside_of_the_window_changes_nothing(passed):
    start, stop = passed.case.window
    assert (
        on_record(passed, replace(SIGN, start=stop + 1.0, stop=stop + 2.0)).status("final")
        == "pass"
    )
    assert (
        on_record(passed, replace(SIGN, start=start - 2.0, stop=start + 0.1)).status("final")
        == "record_error"
    )
    assert on_record(passed) is passed


@pytest.mark.nightly
def test_report_states_the_error_on_page_and_index(passed, tmp_path):
    made_from = {
        "record_errors": checks_text(
            [RecordCheck("r", "not fit", (SIGN,)), RecordCheck("sound", "sound")]
        )
    }
    assert made_from == {"record_errors": {"r": f"{SIGN_TITLE}: {SIGN.text}"}}
    write_report(
        [on_record(passed, SIGN)], tmp_path / "rep", title="T", provenance=made_from, jobs=1
    )
    assert (tmp_path / "rep" / "report.pdf").stat().st_size > 1000
    page = (tmp_path / "rep" / "report.html").read_text()
    assert "pass on a record with errors" in page
    overview, case = page.split('id="cases-head"', 1)
    assert "Flight records with errors" in overview
    assert "delta_a has the wrong sign" in overview
    assert "delta_a has the wrong sign" in case
    numbers = json.loads((tmp_path / "rep" / "results.json").read_text())
    assert numbers["results"][0]["status"]["final"] == "record_error"
    again = read_archive(tmp_path / "rep")
    assert again.results[0].status("final") == "record_error"
    assert again.provenance["record_errors"] == made_from["record_errors"]


def test_a_report_of_sound_records_has_no_column_for_it(passed, tmp_path):
    write_report([passed], tmp_path / "rep", title="T", paper=None, jobs=1)
    page = (tmp_path / "rep" / "report.html").read_text()
    assert "Flight records with errors" not in page.split('id="cases-head"')[0]
    assert "pass on a record with errors" not in page.split('id="cases-head"')[0].split("<body")[1]


def test_junit_has_a_failed_test(passed):
    suite = ElementTree.fromstring(
        exports.junit_xml([on_record(passed, SIGN)], "x").split("\n", 1)[1]
    )
    tests = suite.findall("testsuite/testcase[@name='flight record without errors']")
    assert {test.get("classname").rpartition(".")[2] for test in tests} == set(passed.runs)
    assert all("wrong sign" in test.find("failure").get("message") for test in tests)


@pytest.fixture(scope="module")
def spoilt(tmp_path_factory):
    """The C182's roll with the ailerons of the wrong sign, and its case."""
    folder = tmp_path_factory.mktemp("c182")
    for name in ("names.toml", "aircraft.toml"):
        (folder / name).write_text((C182 / name).read_text())
    lines = (C182 / "flight" / "check_roll.csv").read_text().splitlines()
    column = next(i for i, head in enumerate(lines[0].split(",")) if head.startswith("Aileron"))
    rows = [line.split(",") for line in lines[1:]]
    for row in rows:
        row[column] = str(-float(row[column]))
    (folder / "check_roll.csv").write_text(
        "\n".join([lines[0], *(",".join(row) for row in rows), ""])
    )
    text = (C182 / "cases" / "roll_response.toml").read_text()
    (folder / "case.toml").write_text(text.replace("../flight/", "").replace("../", ""))
    return folder


@pytest.mark.nightly
def test_checks_of_records_are_those_of_the_assessment(spoilt):
    aircraft = read_aircraft(spoilt / "aircraft.toml")
    files = {"bad": spoilt / "check_roll.csv", "good": C182 / "flight" / "check_roll.csv"}
    records = {name: flighttest.read(file, spoilt / "names.toml") for name, file in files.items()}
    checks = check_records(records, aircraft, 1)
    assert [error.name for error in checks["bad"].errors] == ["sign:delta_a+p"]
    assert checks["good"].errors == ()
    assert checks["good"].verdict.startswith("sound: 0 errors")
    assert (
        checks["bad"].lines()[0].startswith(f"record bad: {SIGN_TITLE}: delta_a has the wrong sign")
    )


@pytest.mark.slow
def test_lost_samples_are_faults_of_the_record():
    """The line through lost samples was not flown, and must not inform a fit."""
    record = flighttest.read(T37 / "flight" / "t37_10_multisine_clean_5kft.nc", T37 / "names.toml")
    leaves = {"/": xr.Dataset(attrs=record.attrs)}
    for leaf, node in record.children.items():
        data = node.to_dataset()
        time = data["time"].values
        kept = np.flatnonzero((time < 20.0) | (time >= 21.0))
        leaves[f"/{leaf}"] = data.isel(time=kept).assign_coords(time=time[: len(kept)])
    check = RecordCheck.of("short", xr.DataTree.from_dict(leaves), None)
    assert any(error.title.startswith("samples lost in phi") for error in check.errors)
    lost = [fault for fault in check.faults if fault.kind == "lost"]
    assert {"p", "q", "alpha_vane"} <= {name for fault in lost for name in fault.channels}
    assert all(fault.start == pytest.approx(20.0, abs=0.2) for fault in lost)


@pytest.mark.nightly
def test_batch_checks_cases_and_keeps_the_checks_of_records(spoilt, tmp_path, monkeypatch):
    case = read_case(spoilt / "case.toml")
    checks = check_batch([case], None, 1, tmp_path)
    assert [error.name for error in checks[case.record].errors] == ["sign:delta_a+p"]
    assert KeptChecks(tmp_path).read(case) == checks[case.record]
    monkeypatch.setattr(flighttest, "read", None)  # the kept check needs no record
    assert check_batch([case], None, 1, tmp_path) == checks


@pytest.mark.nightly
def test_cases_of_one_record_are_checked_with_their_own_name_map(spoilt, tmp_path):
    """The second case has a name map that turns the ailerons back; only the first has an error."""
    names = (spoilt / "names.toml").read_text()
    turned = spoilt / "turned.toml"
    turned.write_text(names.replace('"Aileron", sign = -1', '"Aileron", sign = 1'))
    first = read_case(spoilt / "case.toml")
    second = replace(first, name="turned", names=str(turned))
    for _ in range(2):
        # The second time the checks are read from the folder.
        checks = check_batch([first, second], None, 1, tmp_path)
        errors = {check.record: len(check.errors) for check in checks.values()}
        assert errors == {
            "check_roll (names.toml, aircraft.toml)": 1,
            "check_roll (turned.toml, aircraft.toml)": 0,
        }
        assert list(checks) == [check_key(first), check_key(second)]
    assert list(checks_text(checks.values())) == ["check_roll (names.toml, aircraft.toml)"]


@pytest.mark.nightly
def test_batch_states_all_problems_of_raw_records_before_the_first_flight(spoilt):
    case = read_case(spoilt / "case.toml")
    beyond = replace(case, name="beyond", window=(case.window[0], 500.0))
    undriven = replace(
        case, name="undriven", drive=replace(case.drive, surfaces="cockpit", engine="n1")
    )
    with pytest.raises(SchemaError) as error:
        check_batch([case, beyond, undriven])
    texts = "\n".join(error.value.problems)
    for part in (
        "case beyond: the window",
        "case undriven: unknown recorded control 'column'",
        "'wheel'",
        "'pedal'",
        "engine1.n1",
    ):
        assert part in texts
    assert "case roll_response" not in texts


def test_a_warning_on_the_record_is_stated_and_a_late_control_is_a_departure(passed):
    late = RecordError("lag:delta_e+q", "delta_e is recorded 211 ms after it acts on q_dot")
    noise = RecordError("noise:q", "q has more noise than its instrument")
    check = RecordCheck("r", "fit, with care", (), (late, noise))
    (made,) = with_record_checks([passed], {passed.case.record: check})
    assert made.status("final") == "pass_with_departures"
    found = [text for text in run_notices(made, "final") if "flight record" in text]
    assert found[0].startswith(
        "departure: warning on the flight record: delay of delta_e (elevator"
    )
    assert found[1] == f"warning on the flight record: noise of q (body pitch rate): {noise.text}"
    # what does not drive the model is a notice
    (made,) = with_record_checks([passed], {passed.case.record: RecordCheck("r", "", (), (noise,))})
    assert made.status("final") == "pass"


def test_a_driving_control_of_another_size_is_a_departure(passed):
    size = RecordError("scale:delta_e+column", "delta_e over column has 0.50 of the gearing")
    check = RecordCheck("r", "fit, with care", (), (size,))
    (made,) = with_record_checks([passed], {passed.case.record: check})
    assert made.status("final") == "pass_with_departures"


@pytest.mark.parametrize(
    ("kind", "expected"), [("scale", "departure"), ("small_scale", "record_warning")]
)
def test_a_scale_of_the_airspeed_is_a_departure_unless_it_is_small(passed, kind, expected):
    scale = RecordError(f"{kind}:V", "V shows 0.948 of the airspeed that accelerations give")
    check = RecordCheck("roll", "fit for use, with care", (), (scale,))
    (result,) = with_record_checks([passed], {passed.case.record: check})
    kinds = {item.kind for item in result.rows[0]["remarks"] if item.quantity == scale.name}
    assert kinds == {expected}


@pytest.mark.slow
def test_a_code_of_missing_values_reaches_the_rows_of_every_case(passed):
    time = np.arange(0.0, 8.0, 0.04)
    h_gps = xr.DataArray(500.0 + 0.0 * time, {"time": time}, attrs={"units": "m"})
    h_gps.attrs |= {"missing_codes": "-999 in 3 cells", "column": "data/GPS Alt"}
    motion = xr.Dataset({name: ("time", 0.01 * np.sin(time)) for name in "pqr"}, {"time": time})
    for name in "pqr":
        motion[name].attrs["units"] = "rad/s"
    record = xr.DataTree.from_dict({"/imu": motion, "/gps": h_gps.to_dataset(name="h_gps")})
    for group in record.children.values():
        group.attrs = {"rate": 25.0, "gaps": "", "duplicates": 0, "missing": "", "flags": "[]"}
    check = RecordCheck.of("flight", record, None)
    (code,) = [item for item in check.warnings if item.name == "missing_code:h_gps"]
    assert code.text.startswith("h_gps: -999 in 3 cells of column data/GPS Alt stands for a")
    assert codes_text([check]) == f"flight: {code.text}"
    assert codes_text([RecordCheck("other", "fit")]) == ""
    sound = replace(check, errors=())
    (made,) = with_record_checks([passed], {passed.case.record: sound})
    texts = [text for text in run_notices(made, "final") if "-999 in 3 cells" in text]
    assert texts[0].startswith("warning on the flight record: code of a missing value in h_gps")
    assert made.status("final") == "pass"

"""Replay through real FMUs: a first-order lag written in C, and its bad brothers."""

import json
from dataclasses import replace

import numpy as np
import pytest

import pom
from flightmech.errors import OutOfRange, ParseError, SchemaError, UnknownName
from pom.cases.case import read_case
from pom.fmu.description import read_fmu_interface
from pom.fmu.process import Child
from pom.replaying.idle_devices import idle_devices, idle_remarks
from pom.replaying.replay_case import files_by_name, plan_of, replay
from pom.report.exports import junit_xml
from pom.tolerances.bands import remarks_text

NO_TRIM = "trim = false"
FLAPS = """
[conditions]
delta_f = "10 deg"
"""


@pytest.fixture
def case(write_case):
    return read_case(write_case(case='show = ["q", "theta"]', more=NO_TRIM))


def test_the_model_that_made_the_record_matches_to_rounding(case, toy, lag_states):
    result = replay(case, {"toy": toy()}, lag_states)
    assert result.failure == ""
    assert result.status("toy") == "pass_with_departures"
    (departure,) = [item for item in result.rows[0]["remarks"] if item.kind == "departure"]
    assert "without trim (drive.trim = false)" in departure.text
    # the record is linear between samples except at the corner of the ramp, which is a sample:
    # exact
    assert np.abs(result.signals["theta"][1] - result.signals["theta"][0]).max() < 1e-14
    assert (
        np.abs(result.signals["nz"][1] - result.signals["nz"][0]).max() < 1e-14
    )  # direct feed-through is not late
    assert result.signals["time"].values[0] == pytest.approx(1.0)
    assert result.runs == ["toy"]
    assert result.conditions["mass"] == 2900.0
    assert result.inputs["delta_e"].values[-1] == pytest.approx(0.14)
    assert result.signals.attrs["model.toy"].startswith("lag.fmu, FMI 2.0, sha256 ")


def test_without_input_derivatives_the_middle_of_the_step_is_held(case, toy, lag_states):
    result = replay(case, {"held": toy(interpolates=False)}, lag_states)
    error = np.abs(result.signals["theta"][1] - result.signals["theta"][0]).max()
    # the mean of a ramp is its middle: a steady slope is followed with an error of slope h^2/(12
    # tau) at most
    assert 0.0 < error < 2.0 * 0.02 * 0.02**2 / (12.0 * 0.5) * 1.01
    assert np.abs(result.signals["nz"][1] - result.signals["nz"][0]).max() < 1e-14


OF_UPSETS = """standard = "FAA 14 CFR Part 60 App A Att 7"
edition = "2016-05-31 (Amdt 60-4)"
show = ["q", "theta"]"""


def test_a_demonstration_is_shown_and_is_no_pass(write_case, toy, lag_states, tmp_path):
    """The same curves as of a match: the row of Attachment 7 has no tolerance for them."""
    shown = read_case(write_case("7.B", case=OF_UPSETS, more=NO_TRIM))
    assert shown.is_demonstration
    result = replay(shown, {"toy": toy()}, lag_states)
    assert result.failure == ""
    assert result.status("toy") == "demonstration"
    assert not result.passed("toy")
    assert not result.tolerance.data_vars
    (row,) = result.rows
    assert row["verdict"] == "demonstration"
    assert remarks_text(row["remarks"]).startswith("a demonstration: the curves are shown")
    # the flight of the toy is no upset
    (departure,) = [item for item in row["remarks"] if item.kind == "departure"]
    assert "no upset by attitude" in departure.text
    pom.write_report([result], tmp_path / "report", title="upset", paper=None)
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert "shown, no tolerance" in page
    assert "no tolerance applies" in junit_xml([result], "upset")
    assert "skipped" in junit_xml([result], "upset")


def test_every_criterion_has_a_row_for_every_model(case, toy, lag_states):
    result = replay(case, {"a": toy(), "b": toy(interpolates=False)}, lag_states)
    assert list(zip(result.verdict["run"], result.verdict["criterion"], strict=True)) == [
        (run, name)
        for run in ("a", "b")
        for name in ("pitch_angle", "pitch_rate", "normal_acceleration")
    ]
    assert set(result.verdict["verdict"]) == {"pass"}
    np.testing.assert_allclose(result.tolerance["theta"], np.radians(1.5), rtol=1e-15)


def test_a_worse_model_fails_with_place_and_size(case, toy, lag_states):
    result = replay(case, {"toy": toy()}, lag_states.assign(nz=lag_states["nz"] + 0.3))
    row = result.verdict.set_index("criterion").loc["normal_acceleration"]
    assert (row["verdict"], row["unit"]) == ("fail", "g")
    assert row["worst"] == pytest.approx(-0.3)
    assert row["worst_ratio"] == pytest.approx(3.0)
    assert result.status("toy") == "fail"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "stated"),
    [
        ("crash", "crashed: signal SIGSEGV"),
        ("hang", "no answer within 2 s"),
        ("error", "the step to t = 2.02 s failed"),
    ],
)
def test_a_bad_fmu_is_a_result_and_the_good_one_still_runs(
    case, toy, lag_states, kind, stated, monkeypatch
):
    run = Child.run

    def run_with_limit(child, job, timeout, once=False):
        """Give 2 s to the FMU that hangs, and to the others what a busy machine may take."""
        return run(child, job, 2.0 if "hang" in child._fmu.name else timeout, once)

    monkeypatch.setattr(Child, "run", run_with_limit)
    result = replay(case, {"bad": toy(kind), "good": toy()}, lag_states, timeout=600.0)
    assert stated in result.failure
    assert result.status("bad") == "invalid"
    assert stated in remarks_text(result.verdict.iloc[0]["remarks"])
    assert result.status("good") == "pass_with_departures"  # it is not trimmed


def test_messages_of_the_fmu_are_reported(case, toy, lag_states):
    result = replay(case, {"bad": toy("error")}, lag_states)
    assert "the engine has left the wing" in result.failure
    assert np.isfinite(result.signals["theta"][1, :50]).all()  # what was computed before is kept
    assert np.isnan(result.signals["theta"][1, 60:]).all()


@pytest.mark.slow
def test_after_a_crash_the_next_replay_starts_afresh(case, toy, lag_states):
    bad = toy("crash")
    for _ in range(2):
        assert "SIGSEGV" in replay(case, {"bad": bad}, lag_states).failure


def test_nan_outputs_are_invalid(case, toy, lag_states):
    result = replay(case, {"bad": toy("nan")}, lag_states)
    rows = result.verdict.set_index("criterion")
    assert rows.loc["pitch_angle", "verdict"] == "invalid"
    assert "the model has no value in" in remarks_text(rows.loc["pitch_angle", "remarks"])


def test_a_nan_in_an_input_is_refused_before_the_run(case, toy, lag_states):
    states = lag_states.copy(deep=True)
    states["delta_e"][300:303] = np.nan
    with pytest.raises(
        OutOfRange, match=r"input delta_e has no value in 3 of 401 samples, first at t = 6 s"
    ):
        replay(case, {"toy": toy()}, states)


def test_a_window_outside_the_record_is_refused(case, toy, lag_states):
    with pytest.raises(OutOfRange, match=r"1 ... 9 s lies outside the record 0 ... 4 s"):
        replay(case, {"toy": toy()}, lag_states.sel(time=slice(0.0, 4.0)))


def test_misspelt_names_of_an_fmu_are_reported_with_the_near_ones(case, toy, lag_states):
    with pytest.raises(SchemaError) as caught:
        replay(
            case,
            {"toy": toy(rename={"theta": "thetta", "delta_e": "delta_el", "init.V": "init.VV"})},
            lag_states,
        )
    text = str(caught.value)
    assert "unknown output 'theta'; near it: thetta" in text
    assert "unknown input 'delta_e'; near it: delta_el" in text
    assert "unknown parameter 'init.V'; near it: init.VV" in text


def test_an_fmu_in_degrees_is_refused(case, toy, lag_states):
    with pytest.raises(SchemaError, match=r"output theta is in 'deg'; needed is 'rad'"):
        replay(case, {"toy": toy(units={"theta": "deg"})}, lag_states)


def test_an_input_that_stays_zero_may_be_missing(case, toy, lag_states):
    assert "delta_a" not in read_fmu_interface(toy()).inputs
    with pytest.raises(SchemaError, match="unknown input 'delta_a'"):
        replay(case, {"toy": toy()}, lag_states.assign(delta_a=lag_states["delta_a"] + 0.01))


def test_a_missing_control_of_the_record_is_named(case, toy, lag_states):
    with pytest.raises(UnknownName, match="unknown recorded control 'delta_r'"):
        replay(case, {"toy": toy()}, lag_states.drop_vars("delta_r"))
    with pytest.raises(UnknownName, match="unknown state 'h'"):
        replay(case, {"toy": toy()}, lag_states.drop_vars("h"))
    with pytest.raises(UnknownName, match=r"unknown recorded quantity 'engine1.thrust'"):
        replay(case, {"toy": toy()}, lag_states.drop_vars("engine1.thrust"))


def test_no_fmu(case, lag_states, tmp_path):
    text = tmp_path / "text.fmu"
    text.write_text("no zip")
    with pytest.raises(ParseError, match="an FMU"):
        replay(case, {"a": text}, lag_states)
    with pytest.raises(FileNotFoundError, match=r"no file .*give the FMU of a model"):
        replay(case, {"a": tmp_path / "none.fmu"}, lag_states)


def test_conditions_of_the_case_replace_the_record(write_case, toy, lag_states):
    case = read_case(
        write_case(more='trim = false\n[conditions]\ntheta = "2 deg"\nmass = "6000 lb"')
    )
    result = replay(case, {"toy": toy()}, lag_states)
    assert result.trim.loc["theta", "toy"] == pytest.approx(np.radians(2.0), rel=1e-12)
    assert result.conditions["mass"] == pytest.approx(2721.55422)


def test_a_result_survives_json(case, toy, lag_states):
    result = replay(case, {"bad": toy("error"), "good": toy()}, lag_states)
    again = pom.PomResult.from_json(result.to_json())
    assert again.case == result.case
    np.testing.assert_allclose(
        again.signals["theta"].values, result.signals["theta"].values, rtol=5e-9
    )  # nine significant digits
    assert again.status("bad") == "invalid"
    assert again.failure == result.failure


def test_models_on_the_command_line():
    assert list(files_by_name("--model", ("a=x.fmu", "b=y.fmu"), "final=out/final.fmu")) == [
        "a",
        "b",
    ]
    with pytest.raises(SchemaError) as caught:
        files_by_name(
            "--model", ("x.fmu", "flight=x.fmu", "a=x.fmu", "a=y.fmu"), "final=out/final.fmu"
        )
    assert caught.value.problems == [
        "'x.fmu': write name=file.fmu, such as final=out/final.fmu",
        "'flight=x.fmu': the name 'flight' is taken; give every model its own",
        "'a=y.fmu': the name 'a' is taken; give every model its own",
    ]


def test_a_gap_of_the_record_in_the_window_makes_the_rows_of_this_case_invalid(
    case, toy, lag_states, write_case
):
    """The inputs in the gap are not known, so that no model can fly the case."""
    time = lag_states["time"].values
    holed = lag_states.isel(time=(time < 5.0) | (time > 6.5))
    result = replay(case, {"toy": toy()}, holed)
    assert result.status("toy") == "invalid"
    assert "a gap of 1.54 s in the clock from 4.98 to 6.52 s" in result.failure
    assert "choose a window before or after the gap" in result.failure
    assert all(row["remarks"] for row in result.rows)
    with pytest.raises(OutOfRange, match=r"a gap of 1\.54 s in the clock"):
        plan_of(case, holed).demand()
    # the line across a short gap is flown
    bridged = lag_states.isel(time=(time < 5.0) | (time > 5.2))
    assert plan_of(case, bridged).demand().refusal == ""


def test_a_gap_of_a_driving_channel_alone_refuses_the_case(case, lag_states):
    """A line across a gap of the elevator would lose an input that began and ended in it."""
    gaps = {"delta_e": [[5.3, 9.5]], "delta_r": [[5.3, 9.5]], "itt": [[2.0, 4.0]]}
    holed = lag_states.assign_attrs(channel_gaps=json.dumps(gaps))
    text = plan_of(case, holed).refusal
    assert "a gap of 4.2 s in the clock from 5.3 to 9.5 s of delta_e, delta_r" in text
    # channels that drive nothing, and controls that the case holds
    del gaps["delta_r"]
    holed = lag_states.assign_attrs(channel_gaps=json.dumps(gaps))
    assert plan_of(replace(case, conditions={"delta_e": 0.0}), holed).refusal == ""


def test_a_flap_setting_without_a_term_is_named(write_case):
    """A model without a term over the flaps flies a case at 10 deg as it flies a clean one."""
    from_file = read_case(write_case(case='show = ["q", "theta"]', more=NO_TRIM + FLAPS))
    (text,) = idle_devices(from_file, None, ["alpha", "gear"])
    assert text == "flaps at 10 deg without effect: no term of the model is over delta_f"
    assert idle_devices(from_file, None, ["alpha", "delta_f"]) == []


def test_a_recorded_device_without_a_term_is_named(case, lag_states):
    out = lag_states.assign(gear=0.0 * lag_states["q"] + 1.0)
    (remark,) = idle_remarks(case, out, ["alpha", "delta_f"])
    assert remark.kind == "without_effect"
    assert remark.text.startswith("landing gear at 1 without effect")
    # retracted, and the zero of a sensor
    nearly = lag_states.assign(delta_f=0.0 * lag_states["q"] + 0.005)
    assert idle_remarks(case, nearly, ["alpha"]) == ()
    # a lost sample hides no setting, and a channel without any sample states none
    lost = lag_states.assign(delta_f=0.0 * lag_states["q"] + 0.2)
    lost["delta_f"][3] = np.nan
    (remark,) = idle_remarks(case, lost, ["alpha"])
    assert remark.text.startswith("flaps at 11.5 deg without effect")
    assert idle_remarks(case, lost.assign(delta_f=np.nan * lost["q"]), ["alpha"]) == ()

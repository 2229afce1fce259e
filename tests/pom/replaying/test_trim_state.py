"""Limits of the trim: the default for a remark, the case file's for a verdict; drift and
corrections of a result.
"""

import json

import numpy as np
import pytest
import xarray as xr

from pom.cases.case import read_case
from pom.cases.job import job_of
from pom.cases.reference_states import calibration_text
from pom.replaying.result_assembly import assemble_result
from pom.replaying.run_remarks import calibration, drift
from pom.replaying.trim import beyond_limits, trim_limits, trim_table
from pom.report.case.remarks import run_notes
from pom.result_notices import run_notices, trim_remarks
from pom.tolerances.bands import remarks_text

DEGREE = np.radians(1.0)


@pytest.fixture
def flown(write_case, lag_states):
    """Return a function: outputs of a model that follows the toy flight, changed by words, as a
    result of one case.
    """

    def fly(more="", **changed):
        path = write_case()
        path.write_text(path.read_text().replace('engine = "thrust"', f'engine = "thrust"\n{more}'))
        case = read_case(path)
        outputs = {name: lag_states[name].values for name in ("theta", "q", "nz", "V", "h")}
        constant = {
            name: np.full(lag_states.sizes["time"], value)
            for name, value in changed.items()
            if np.ndim(value) == 0
        }
        outputs |= {name.replace("trim_", "trim."): values for name, values in constant.items()}
        outputs |= {name: np.asarray(value) for name, value in changed.items() if np.ndim(value)}
        states = lag_states.isel(time=(lag_states["time"] >= 1.0) & (lag_states["time"] <= 9.0))
        cut = {name: values[50:451] for name, values in outputs.items()}
        return assemble_result(case, states, job_of(case, states), {"model": cut}, {"model": ""})

    return fly


def test_a_bias_within_its_limit_gives_no_remark(flown):
    result = flown(trim_delta_e=0.9 * DEGREE)
    assert not result.verdict["remarks"].map(remarks_text).str.contains("trim").any()
    assert result.passed("model")


def test_a_bias_beyond_the_default_limit_is_judged_and_no_plain_pass(flown):
    result = flown(trim_delta_e=-1.5 * DEGREE)
    assert result.status("model") == "limits_exceeded"
    assert not result.passed("model")
    assert trim_remarks(result, "model") == [
        "trim: elevator deflection -1.5 deg is beyond 1 deg ('trim.delta_e')"
    ]
    assert (
        flown(trim_delta_e=np.nan).status("model") == "limits_exceeded"
    )  # no number is not within a limit
    assert (result.verdict["verdict"] == "pass").all()
    assert (
        result.verdict["remarks"]
        .map(remarks_text)
        .str.contains(
            "trim: elevator deflection -1.5 deg is beyond 1 deg ('trim.delta_e')", regex=False
        )
        .all()
    )


def test_a_bias_beyond_the_limit_of_the_case_file_makes_the_run_invalid(flown):
    result = flown('limits = { delta_e = "0.5 deg" }', trim_delta_e=0.9 * DEGREE)
    assert result.status("model") == "invalid"
    assert (
        result.verdict["remarks"]
        .map(remarks_text)
        .str.startswith("trim: elevator deflection +0.9 deg is beyond 0.5 deg ('trim.delta_e')")
        .all()
    )
    wide = 'limits = { delta_e = "3 deg" }'
    assert (
        flown(wide, trim_delta_e=2.0 * DEGREE).status("model") == "limits_exceeded"
    )  # wider than usual, without a reason
    reason = '\n[rationale]\n"trim.delta_e" = "J. Smith, 2026-11-28, calibrated to 2 deg"'
    stated = flown(wide + reason, trim_delta_e=2.0 * DEGREE)
    assert stated.status("model") == "pass_with_departures"
    text = (
        "trim: elevator deflection +2 deg is beyond 1 deg ('trim.delta_e'); allowed: J. Smith,"
        " 2026-11-28, calibrated to 2 deg"
    )
    assert run_notices(stated, "model") == [text]
    assert stated.verdict["remarks"].map(remarks_text).str.contains(text, regex=False).all()
    assert flown(wide + reason, trim_delta_e=4.0 * DEGREE).status("model") == "invalid"


@pytest.mark.parametrize(
    ("reason", "bias", "text"),
    [
        ("ok", 2.0, "write who allows it, when and why"),
        ("calibrated to 2 deg", 2.0, "write who allows it, when and why"),
        ("J. Smith, 2026-11-28, ok", 2.0, "write who allows it, when and why"),
        ("J. Smith, 2026-13-28, calibrated to 2 deg", 2.0, "write who allows it, when and why"),
        ("J. Smith, 2026-11-28, calibrated to 2 deg", 3.1, "at most 3 times the limit"),
    ],
)
def test_a_rationale_needs_text_name_and_date_and_does_not_lift_every_bias(
    flown, reason, bias, text
):
    result = flown(f'[rationale]\n"trim.delta_e" = "{reason}"', trim_delta_e=bias * DEGREE)
    assert result.status("model") == "limits_exceeded"
    assert text in trim_remarks(result, "model")[0]


def test_thrust_is_limited_by_a_share_of_what_was_recorded(flown):
    """5 % of 3000 N, as the longitudinal trim of 2.c.5 allows."""
    assert (
        "trim: net thrust +33.9 lbf is beyond 33.7 lbf ('trim.thrust')"
        in flown(trim_thrust=151.0).verdict["remarks"].map(remarks_text)[0]
    )
    assert "trim" not in flown(trim_thrust=149.0).verdict["remarks"].map(remarks_text)[0]


def test_what_the_trim_leaves_is_limited_and_a_roll_on_the_wheels_only_where_it_is_steady(
    flown, write_case
):
    assert (
        "trim: body pitch acceleration -0.172 deg/s2 is beyond 0.115 deg/s2 ('trim.q_dot')"
        in flown(trim_q_dot=-3e-3).verdict["remarks"].map(remarks_text)[0]
    )
    path = write_case()
    path.write_text(
        path.read_text().replace('engine = "thrust"', 'engine = "thrust"\ntrim = "ground"')
    )
    limits = trim_limits(read_case(path), {})
    assert set(limits) == {"w_dot", "p_dot", "q_dot"}
    assert beyond_limits(limits, {"trim.u_dot": np.array([3.0])}, demanded=False) == ()


def test_cockpit_quantities_stand_in_the_table_when_they_count():
    one = np.array([0.1])
    outputs = {
        "applied.delta_e": one,
        "applied.column": one,
        "trim.F_column": 0.0 * one,
        "trim.delta_e": 0.0 * one,
    }
    assert list(trim_table({"delta_e": one}, {"model": outputs}).index) == [
        "delta_e",
        "trim.delta_e",
    ]
    forced = trim_table(
        {"delta_e": one, "column": one}, {"model": {**outputs, "trim.F_column": one}}
    )
    assert list(forced.index) == ["delta_e", "column", "trim.delta_e", "trim.F_column"]


def test_drift_is_the_slope_of_model_minus_flight(flown, lag_states):
    time = lag_states["time"].values
    result = flown(h=lag_states["h"].values + 2.0 + 0.3 * (time - 1.0), V=lag_states["V"].values)
    row = drift(result).set_index("channel").loc["h"]
    assert (row["run"], row["unit"]) == ("model", "m")
    assert (row["start"], row["rate"]) == (pytest.approx(2.0), pytest.approx(0.3))
    assert row["spread"] < 1e-9
    assert "drift  h +59.1 ft/min" in run_notes(result, "model")  # 0.3 m/s


def test_corrections_of_the_instruments_travel_with_the_result(flown, lag_states):
    biases = xr.Dataset(
        {
            "estimate": ("parameter", [0.01, 0.5]),
            "stderr": ("parameter", [0.002, 0.1]),
            "unit": ("parameter", ["rad", "m s-2"]),
            "held": ("parameter", [False, True]),
        },
        {"parameter": ["bias.theta", "bias.ax_imu"]},
    )
    lag_states.attrs["calibration"] = calibration_text(biases)
    result = flown()
    again = type(result).from_json(result.to_json())
    assert calibration(again).to_dict("records") == [
        {"parameter": "bias.theta", "estimate": 0.01, "stderr": 0.002, "unit": "rad"}
    ]
    del lag_states.attrs["calibration"]
    assert calibration(flown()).empty
    assert json.loads(calibration_text(biases))[0]["parameter"] == "bias.theta"


def test_notes_mark_what_is_beyond_its_limit(flown):
    lines = run_notes(flown(trim_delta_e=-1.5 * DEGREE, trim_thrust=20.0), "model")
    assert lines[0] == "trim   delta_e -1.5 deg (limit 1), thrust +4.5 lbf"

"""Modes by fit, against damped sines whose numbers are chosen."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from pom.cases.case import PomCase
from pom.judging.measures.damped_sine import _project_trace, fit_mode
from pom.judging.measures.modal import judge_mode
from pom.judging.measures.modal import peak_lag as judge_lag
from pom.judging.signals import Comparison
from pom.judging.verdict import judge_criterion
from pom.replaying.recorded_runs import MasterRun, RecordedRun, recurrent_remarks
from pom.tolerances import rows
from pom.tolerances.bands import Invalid, remarks_text
from pom.tolerances.criteria import Band, Criterion, Limit

TIME = np.arange(0.0, 120.001, 0.1)
TEN = Band((Limit("percent", 10.0, "%"),), "single", "ref_scalar")
ZETA = Band((Limit("absolute", 0.02, "-"),))


def sine(period, zeta, time=TIME, amplitude=5.0, phase=0.4, offset=90.0, slope=0.02):
    wd = 2.0 * math.pi / period
    sigma = zeta * wd / math.sqrt(1.0 - zeta**2)
    return offset + slope * time + amplitude * np.exp(-sigma * time) * np.cos(wd * time + phase)


def matched(time, flight, model, id):
    return Comparison.of(
        PomCase("c", "C", id, rows.STANDARD, rows.EDITION, "c.toml", "r.nc", (0.0, 120.0)),
        time,
        flight,
        model,
    )


def modal(criterion, time, flight, model, id="1.a.1"):
    return judge_mode(criterion, matched(time, flight, model, id))


def peak_lag(criterion, time, flight, model):
    return judge_lag(criterion, matched(time, flight, model, "2.d.7"))


def criterion(measure, band=TEN, channel="V_cas", window=(0.0, 120.0)):
    return Criterion(measure, "", channel, measure, "g", band, window)


@pytest.mark.parametrize(
    ("period", "zeta"), [(38.0, 0.05), (35.0, -0.01), (30.0, 0.0), (60.0, 0.2)]
)
def test_fit_returns_the_mode_exactly(period, zeta):
    mode = fit_mode(TIME + 7.0, sine(period, zeta))
    assert mode.period == pytest.approx(period, rel=1e-6)
    assert mode.damping_ratio == pytest.approx(zeta, abs=1e-7)
    assert mode.amplitude == pytest.approx(5.0, rel=1e-5)
    assert mode.slope == pytest.approx(0.02, abs=1e-5)
    if zeta:
        wn = 2.0 * math.pi / period / math.sqrt(1.0 - zeta**2)
        assert mode.t_half == pytest.approx(math.log(2.0) / (zeta * wn), rel=1e-5)


@pytest.mark.parametrize("sigma", [-0.02, 0.01, 0.2])
def test_the_derivative_of_the_residual_is_that_of_differences(sigma):
    noise = np.random.default_rng(4).normal(0.0, 1.0, TIME.size)  # a residual that is far from zero
    trace, wd, step = sine(38.0, 0.05) + noise, 0.14, 1e-6
    exact = _project_trace(TIME, trace, sigma, wd=wd).jacobian
    for k, (ds, dw) in enumerate([(step, 0.0), (0.0, step)]):
        ahead, behind = (
            _project_trace(TIME, trace, sigma + sign * ds, wd=wd + sign * dw).residual
            for sign in (1.0, -1.0)
        )
        np.testing.assert_allclose(
            exact[:, k],
            (ahead - behind) / (2.0 * step),
            rtol=0.0,
            atol=1e-6 * np.abs(exact[:, k]).max(),
        )


def test_the_fit_is_where_the_derivative_of_the_misfit_is_zero():
    trace = sine(38.0, 0.05) + np.random.default_rng(5).normal(0.0, 0.5, TIME.size)
    mode = fit_mode(TIME, trace)
    found = _project_trace(TIME, trace, mode.sigma, wd=mode.wd)
    slope = found.jacobian.T @ found.residual
    size = np.linalg.norm(found.jacobian, axis=0) * np.linalg.norm(found.residual)
    assert np.abs(slope / size).max() < 1e-8


def test_fit_in_noise_errs_in_the_period_by_far_less_than_the_tolerance():
    # the case of the tolerance README: 10 kt phugoid, 0.3 kt noise, 3 cycles; a raw peak picker
    # errs by 71 %
    noise = np.random.default_rng(3).normal(0.0, 0.3, TIME.size)
    mode = fit_mode(TIME, sine(38.0, 0.05, amplitude=10.0) + noise)
    assert mode.period == pytest.approx(38.0, rel=5e-3)
    assert mode.damping_ratio == pytest.approx(0.05, abs=2e-3)


@pytest.mark.parametrize(("longer", "verdict"), [(1.05, "pass"), (1.0999, "pass"), (1.101, "fail")])
def test_phugoid_passes_up_to_ten_percent_of_period(longer, verdict):
    flight, model = {"V_cas": sine(38.0, 0.05)}, {"V_cas": sine(38.0 * longer, 0.05)}
    got = modal(criterion("period"), TIME, flight, model, "2.c.9")
    assert got.verdict == verdict
    assert got.worst == pytest.approx(38.0 * (longer - 1.0), rel=1e-4)


def test_damping_alternative_is_the_wider_below_0p2():
    flight, model = {"V_cas": sine(38.0, 0.05)}, {"V_cas": sine(38.0, 0.065)}
    assert modal(criterion("t_half"), TIME, flight, model).verdict == "fail"  # 23 % shorter
    assert (
        modal(criterion("damping_ratio", ZETA), TIME, flight, model).verdict == "pass"
    )  # 0.015 of 0.02


def test_an_unstable_model_of_a_stable_flight_fails_inside_the_width():
    flight, model = {"V_cas": sine(38.0, 0.008)}, {"V_cas": sine(38.0, -0.008)}
    got = modal(criterion("damping_ratio", ZETA), TIME, flight, model)
    assert got.worst_ratio < 1.0
    assert (got.verdict, remarks_text(got.remarks).startswith("stability differs")) == (
        "fail",
        True,
    )


@pytest.mark.parametrize(("bank", "reported"), [(9.9, False), (10.1, True), (-39.0, True)])
def test_a_phugoid_in_a_turn_is_reported(bank, reported):
    """The damping of a model that rolls off is that of a spiral dive as well."""
    flight = {"V_cas": sine(38.0, 0.05), "phi": np.full(TIME.size, math.radians(2.0))}
    model = {
        "V_cas": sine(38.0, 0.05),
        "phi": math.radians(2.0) + math.radians(bank) * TIME / TIME[-1],
    }
    note = remarks_text(
        modal(criterion("damping_ratio", ZETA), TIME, flight, model, "2.c.9").remarks
    )
    assert (f"bank of the model up to {abs(bank):.0f} deg off the flight's" in note) == reported
    assert "bank" not in remarks_text(
        modal(criterion("damping_ratio", ZETA), TIME, flight, model, "2.d.7").remarks
    )


def test_too_few_cycles_are_invalid_unless_the_time_to_half_is_seen():
    short = TIME <= 80.0
    window = (0.0, 80.0)
    slow = {"V_cas": sine(38.0, 0.03)[short]}  # 2.1 cycles, time to half 140 s
    with pytest.raises(
        Invalid, match=r"2.1 cycles and less than the time to half \(140 s\) in 80 s"
    ):
        modal(criterion("period", window=window), TIME[short], slow, slow, "2.c.9")
    fast = {"V_cas": sine(38.0, 0.08)[short]}  # time to half 52 s
    assert (
        modal(criterion("period", window=window), TIME[short], fast, fast, "2.c.9").verdict
        == "pass"
    )


def test_a_dutch_roll_of_fewer_than_six_cycles_departs_from_its_row():
    """Its row has no time to half in place of the cycles, as that of the phugoid has."""
    short = TIME <= 80.0
    fast = {"V_cas": sine(38.0, 0.08)[short]}
    period = criterion("period", window=(0.0, 80.0))
    got = modal(period, TIME[short], fast, fast, "2.d.7")
    assert got.verdict == "pass"
    (departure,) = [item.text for item in got.remarks if item.kind == "departure"]
    assert departure == (
        "departure: the free response has 2.1 cycles, the row requires 6 complete cycles"
    )
    phugoid = modal(period, TIME[short], fast, fast, "2.c.9")
    assert all(item.kind != "departure" for item in phugoid.remarks)
    whole = {"V_cas": sine(15.0, 0.02)}
    steady = modal(criterion("period"), TIME, whole, whole, "2.d.7")
    assert all(item.kind != "departure" for item in steady.remarks)


def test_a_model_that_does_not_oscillate_fails_and_a_flight_that_does_not_is_invalid():
    still = {"V_cas": 90.0 + np.random.default_rng(1).normal(size=TIME.size)}
    flight = {"V_cas": sine(38.0, 0.05)}
    got = modal(criterion("period"), TIME, flight, still)
    assert (
        got.verdict,
        remarks_text(got.remarks).startswith("flight 38.00 s; the model: no oscillation"),
    ) == ("fail", True)
    with pytest.raises(Invalid, match="flight: no oscillation"):
        modal(criterion("period"), TIME, still, flight)


def test_the_right_mode_without_excitation_is_no_match():
    flight, model = {"V_cas": sine(38.0, 0.05)}, {"V_cas": sine(38.0, 0.05, amplitude=0.4)}
    got = modal(criterion("period"), TIME, flight, model)
    assert (got.verdict, remarks_text(got.remarks)) == (
        "fail",
        "flight 38.00 s; the model hardly oscillates: 0.08 of the amplitude of the flight",
    )


def test_noise_alone_is_no_mode():
    noise = np.random.default_rng(1).normal(size=TIME.size)
    with pytest.raises(Invalid, match="no oscillation"):
        fit_mode(TIME, noise)


@pytest.mark.parametrize("gap", [math.nan, math.inf])
def test_a_sample_that_is_no_number_has_no_mode(gap):
    trace = sine(38.0, 0.05)
    trace[50] = gap
    with pytest.raises(Invalid, match=r"no value in 1 of 1201 samples, first at 12\.00 s"):
        fit_mode(TIME + 7.0, trace)


@pytest.mark.parametrize("samples", [2, 3, 6])
def test_few_samples_have_no_mode(samples):
    time = TIME[:samples]
    with pytest.raises(Invalid, match=f"{samples} samples; a mode needs 7 at least"):
        modal(
            criterion("period", window=(0.0, float(time[-1]))),
            time,
            {"V_cas": sine(0.5, 0.05, time)},
            {"V_cas": sine(0.5, 0.05, time)},
        )


def test_peak_lag_from_fitted_phases():
    time = np.arange(0.0, 20.0, 0.02)
    band = Band(
        (Limit("percent", 20.0, "%"), Limit("absolute", 0.1, "s")), "greater_of", "ref_scalar"
    )

    def run(lag):  # bank peaks `lag` before sideslip, period 2.5 s
        wd = 2.0 * math.pi / 2.5
        beta = sine(2.5, 0.1, time, 0.05, 0.0, 0.0, 0.0)
        return {"beta": beta, "phi": sine(2.5, 0.1, time, 0.03, wd * lag, 0.1, 0.002)}

    got = peak_lag(criterion("peak_lag", band, "phi", (0.0, 19.9)), time, run(0.6), run(0.65))
    assert remarks_text(got.remarks) == "flight 0.60 s, model 0.65 s"
    assert got.worst == pytest.approx(0.05, abs=1e-4)
    assert got.width == pytest.approx(0.12, rel=1e-3)  # 20 % of 0.6 s
    late = peak_lag(criterion("peak_lag", band, "phi", (0.0, 19.9)), time, run(1.2), run(-1.2))
    assert late.worst == pytest.approx(
        0.1, abs=1e-4
    )  # -1.2 s is the peak of the next cycle, at 1.3 s


def test_the_lag_of_a_model_in_another_cycle_is_moved_by_its_own_period():
    """Bank peaks 1.2 s before sideslip in a flight of period 2.5 s, 1.35 s in a model of 2.75 s:
    the fit of the model gives -1.4 s.  Moved by the period of the flight it would be 1.1 s.
    """
    time = np.arange(0.0, 20.0, 0.02)

    def run(period, lag):
        phase = 2.0 * math.pi / period * lag
        beta = sine(period, 0.1, time, 0.05, 0.0, 0.0, 0.0)
        return {"beta": beta, "phi": sine(period, 0.1, time, 0.03, phase, 0.1, 0.002)}

    band = Band((Limit("absolute", 0.1, "s"),), "single", "ref_scalar")
    row = criterion("peak_lag", band, "phi", (0.0, 19.9))
    got = peak_lag(row, time, run(2.5, 1.2), run(2.75, 1.4))
    assert got.worst == pytest.approx(0.2, abs=1e-4)
    assert got.verdict == "fail"


def test_a_model_that_rolls_over_is_judged_without_the_jump_of_its_bank():
    """Bank through 180 deg, given within half a turn: the lag is that of the smooth trace, which
    the report stores and judges again.
    """
    time = np.arange(0.0, 20.0, 0.02)
    wd = 2.0 * math.pi / 2.5
    band = Band((Limit("absolute", 0.1, "s"),), "single", "ref_scalar")
    beta = sine(2.5, 0.1, time, 0.05, 0.0, 0.0, 0.0)
    flight = {"beta": beta, "phi": sine(2.5, 0.1, time, 0.03, wd * 0.6, 0.1, 0.002)}
    smooth = {"beta": beta, "phi": sine(2.5, 0.1, time, 0.03, wd * 0.65, 0.3, 0.2)}
    jumping = {**smooth, "phi": np.angle(np.exp(1j * smooth["phi"]))}
    assert np.abs(np.diff(jumping["phi"])).max() > 6.0
    for model in (smooth, jumping):
        assert peak_lag(
            criterion("peak_lag", band, "phi", (0.0, 19.9)), time, flight, model
        ).worst == pytest.approx(0.05, abs=1e-3)


@pytest.mark.parametrize(
    ("id", "edition"),
    [("2.c(9)", "EASA CS-FSTD(A) Issue 2 AMC1 FSTD(A).300"), ("2.c.9", rows.STANDARD)],
)
def test_three_cycles_are_required_by_whatever_name_the_standard_has_for_the_test(id, edition):
    short = TIME <= 80.0
    slow = {"V_cas": sine(38.0, 0.03)[short]}
    with pytest.raises(Invalid, match="the table requires 3 cycles"):
        modal(criterion("period", window=(0.0, 80.0)), TIME[short], slow, slow, id)
    assert rows.rows_of_test(id, edition, {"2.c(9)": "2018-05-03"}.get(id, rows.EDITION))


def test_a_legal_period_is_far_off_as_a_trace():
    """Trap 4: 10 % more period differs by 62 % of the amplitude within three cycles at a damping
    ratio of 0.05.
    """
    flat = {"amplitude": 10.0, "phase": -0.5 * math.pi, "offset": 0.0, "slope": 0.0}
    time = np.arange(0.0, 3.0 * 38.0, 0.05)
    for longer, expected in ((1.10, 0.62), (1.05, 0.34), (1.02, 0.14)):
        apart = (
            np.abs(sine(38.0 * longer, 0.05, time, **flat) - sine(38.0, 0.05, time, **flat)).max()
            / 10.0
        )
        assert apart == pytest.approx(expected, abs=0.006)
    flight, model = ({"V_cas": sine(period, 0.05, **flat)} for period in (38.0, 38.0 * 1.0999))
    assert modal(criterion("period"), TIME, flight, model, "2.c.9").verdict == "pass"


def test_half_a_second_is_17_percent_of_a_dutch_roll():
    """Trap 5: the greater of 10 % and 0.5 s on 3 s."""
    band = Band(
        (Limit("percent", 10.0, "%"), Limit("absolute", 0.5, "s")), "greater_of", "ref_scalar"
    )
    time = np.arange(0.0, 20.0, 0.02)
    flight, model = (
        {"r": sine(period, 0.1, time, 0.1, offset=0.0, slope=0.0)} for period in (3.0, 3.49)
    )
    got = modal(criterion("period", band, "r", (0.0, 19.9)), time, flight, model)
    assert (got.verdict, round(got.worst_ratio, 3)) == ("pass", 0.98)
    assert got.applied == "10 % of the flight value or 0.5 s, the greater (3 s): 0.5 s"


def test_a_figure_of_the_flight_that_depends_on_the_window_is_remarked_and_the_verdict_stays():
    """A second mode in the first third of the window: the damping fitted is that of both."""
    window, short = (0.0, 76.0), TIME <= 76.0
    clean = sine(38.0, 0.05)[short]
    both = clean + (6.0 * np.exp(-0.15 * TIME) * np.cos(0.55 * TIME))[short]

    def judged(flight, band):
        return modal(
            criterion("damping_ratio", band, window=window),
            TIME[short],
            {"V_cas": flight},
            {"V_cas": both},
        )

    got = judged(both, ZETA)
    (remark,) = (one for one in got.remarks if one.kind == "window")
    assert got.verdict == "pass"
    assert (remark.quantity, remark.unit) == ("damping_ratio", "1")
    assert remark.values == pytest.approx(
        {"flight": 0.0745, "moved": 0.1204, "limit": 0.02}, abs=1e-4
    )
    assert (
        "damping ratio 0.07454 in the window of the case, 0.1204 in 0.0 ... 63.2 s" in remark.text
    )  # a third of the period less
    wide = Band((Limit("absolute", 0.05, "-"),))
    assert "depends on the window" not in remarks_text(
        judged(both, wide).remarks
    )  # 0.046 is inside this tolerance
    assert "depends on the window" not in remarks_text(
        judged(clean, ZETA).remarks
    )  # the mode is alone


def recurrent(master, run):
    """Return the first remark on a run compared with its master, two traces of the airspeed."""
    row = criterion("period")
    case = PomCase("c", "C", "1.a.1", rows.STANDARD, rows.EDITION, "c.toml", "r.nc", (0.0, 120.0))
    case = replace(case, criteria=(row,))
    traces = ("run", "time"), np.stack([master, master, run])
    coords = {"run": ["flight", "device-master", "device"], "time": TIME}
    result = SimpleNamespace(case=case, signals=xr.Dataset({"V_cas": traces}, coords))
    stored = MasterRun("device-master", RecordedRun({}, "", ""), share=0.5)
    return recurrent_remarks(result, "device", stored)[0]


def test_a_run_that_has_lost_the_mode_of_its_master_is_beyond_the_recurrent_criterion():
    same = recurrent(sine(38.0, 0.05), sine(38.1, 0.05))
    assert (same.kind, same.text.endswith("largest 0.05 of it in period")) == ("recurrent", True)
    lost = recurrent(sine(38.0, 0.05), sine(38.0, 0.05, amplitude=0.1))
    assert lost.kind == "recurrent_beyond"
    assert lost.text.endswith("unlike the master without a ratio: period")


def test_a_failure_that_no_ratio_shows_is_known():
    """A damping ratio of 0.005 against -0.005 is at half of its tolerance of 0.02."""
    row, case = criterion("damping_ratio", ZETA), matched(TIME, {}, {}, "1.a.1").case

    def judged(zeta):
        return judge_criterion(
            case, row, TIME, {"V_cas": sine(38.0, 0.005)}, {"V_cas": sine(38.0, zeta)}
        )

    growing, far, near = judged(-0.005), judged(0.05), judged(0.004)
    assert (growing.verdict, growing.worst_ratio) == ("fail", pytest.approx(0.5, abs=1e-3))
    assert [item.fails_without_ratio for item in (growing, far, near)] == [True, False, False]

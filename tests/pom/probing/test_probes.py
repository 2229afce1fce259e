"""Probes: models that simulate follow changed inputs; stored and steered answers do not.

Wrong gain and time of inputs, and a wrong mass, are named by their form; noise is not.
"""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from scipy.ndimage import gaussian_filter1d

from flightmech.support.arrays import rms
from pom.cases.job import ReplayJob
from pom.probing import (
    changed_job,
    compare_inputs,
    compare_lift,
    flight_consistency,
    judge_input_change,
)
from pom.probing.flight_consistency import judge_lift, largest_input_effect
from pom.probing.input_probe import NEAR, SCALE, SIZES, judge_jump
from pom.probing.late_probe import LATE, judge_late, late_job
from pom.probing.model_probes import _measure_hidden, _probe_inputs, _probe_tables
from pom.probing.scatter_probe import (
    RecordScatter,
    judge_difference,
    judge_scatter,
    noise_of_inputs,
)
from pom.replaying.table_agreement import shows_own_tables
from pom.status import unprobed_remark
from pom.tolerances.bands import RowRemark

STEP = 0.02  # [s]
TIME = np.arange(0.0, 12.0, STEP)


def elevator():
    """Return a doublet of 3 deg (time,)."""
    return np.radians(3.0) * (((TIME > 2) & (TIME < 3)) * 1.0 - ((TIME > 3) & (TIME < 4)) * 1.0)


def job_of(**inputs):
    return ReplayJob(TIME, inputs, {}, (), ())


def short_period(delta_e, flight=None, gain=0.0):
    """Return the answer of a short period; a controller of this gain holds it at a flight."""
    alpha, q, theta = np.zeros((3, TIME.size))
    for k in range(TIME.size - 1):
        q_dot = -8.0 * alpha[k] - 2.0 * q[k] - 9.0 * delta_e[k]
        rates = np.array([q[k] - 1.2 * alpha[k], q_dot, q[k]])
        now = np.array([alpha[k], q[k], theta[k]])
        if flight is not None:
            pulled = [flight[name][k] for name in ("alpha", "q", "theta")]
            rates += gain * (np.array(pulled) - now)
        alpha[k + 1], q[k + 1], theta[k + 1] = now + STEP * rates
    return {"alpha": alpha, "q": q, "theta": theta}


def probe(fly, **inputs):
    """Return the remarks on a model, a function of the elevator."""
    changed = changed_job(job_of(**inputs), {})
    before, after = fly(inputs["delta_e"]), fly(changed.job.inputs["delta_e"])
    return judge_input_change(TIME, before, after, {"q", "theta"}, moved_at=changed.moved_at)


def test_a_linear_aeroplane_changes_by_its_whole_response():
    (remark,) = probe(short_period, delta_e=elevator())
    assert remark.kind == "probe"
    # linear: the change is exactly the share of the inputs
    assert remark.values["q"] == pytest.approx(1.0, abs=1e-9)


def test_a_stored_answer_is_named():
    stored = short_period(elevator())
    (remark,) = probe(lambda delta_e: stored, delta_e=elevator())
    assert remark.kind == "not_driven"
    assert "body pitch rate" in remark.text
    assert "stored" in remark.text


def test_a_stored_answer_in_one_channel_is_named():
    stored = short_period(elevator())
    (remark,) = probe(lambda d: {**short_period(d), "q": stored["q"]}, delta_e=elevator())
    assert remark.kind == "not_driven"
    assert [*remark.values] == ["q"]


def test_an_answer_that_is_stored_in_a_part_of_the_window_is_named():
    """The model answers until 4 s, then the stored flight."""
    stored = short_period(elevator())

    def switching(delta_e):
        return {
            name: np.where(TIME < 4.0, values, stored[name])
            for name, values in short_period(delta_e).items()
        }

    (remark,) = probe(switching, delta_e=elevator())
    assert remark.kind == "not_driven"
    assert "from 4.1 to 5.1 s" in remark.text
    # a fifth of 3 deg, as a mean over 0.3 s
    assert changed_job(job_of(delta_e=elevator()), {}).moved_at == pytest.approx(2.0, abs=0.1)


def test_a_model_that_knows_the_inputs_of_the_record_is_named():
    """Its answer to other inputs is that of a larger effectiveness."""
    flight = short_period(elevator())
    near, after = (short_period(1.3 * scale * elevator()) for scale in (NEAR, SCALE))
    (remark,) = judge_jump(flight, near, after)
    assert remark.kind == "not_driven"
    assert min(remark.values.values()) > 0.5
    (remark,) = judge_jump(short_period(1.3 * elevator()), near, after)
    assert remark.kind == "probe"
    assert "up to 0.01 of" in remark.text
    (remark,) = judge_jump(flight, flight, flight)
    assert remark.kind == "not_probed"


def late_remarks(fly):
    """Return the remarks on the answer of a function of the elevator to late inputs."""
    late = late_job(job_of(delta_e=elevator()))
    return judge_late(TIME, fly(elevator()), fly(late.inputs["delta_e"]), 2.0)


def test_a_correction_that_is_stored_over_time_is_named():
    """The model is wrong, follows its inputs, and adds what it misses in the record."""
    miss = short_period(0.4 * elevator())

    def corrected(delta_e):
        return {name: v + miss[name] for name, v in short_period(0.6 * delta_e).items()}

    # with other inputs it looks like an aeroplane
    assert all(remark.kind == "probe" for remark in probe(corrected, delta_e=elevator()))
    (remark,) = late_remarks(corrected)
    assert remark.kind == "departure"
    assert f"inputs {LATE:g} s late" in remark.text
    assert "body pitch rate" in remark.text
    (remark,) = late_remarks(short_period)
    assert remark.kind == "probe"
    assert "the same 2 s later" in remark.text


def test_why_an_answer_is_not_compared_with_late_inputs_is_stated():
    drift = np.radians(1.0) * TIME

    def unsteady(delta_e):
        return {**short_period(delta_e), "theta": short_period(delta_e)["theta"] + drift**2}

    (remark,) = late_remarks(lambda d: {**unsteady(d), "phi": drift})
    assert remark.kind == "not_probed"
    # 1 deg/s in 1.7 s of rest, for 2 s
    assert "not steady: bank angle changes by 2 deg in 2 s" in remark.text
    # a turn goes on
    (remark,) = late_remarks(lambda d: {**short_period(d), "psi": drift % (2.0 * np.pi)})
    assert remark.kind == "probe"
    (remark,) = late_remarks(lambda d: {"q": np.full(TIME.size, np.nan)})
    assert "no motion without gaps" in remark.text
    (remark,) = judge_late(TIME[:90], {"q": TIME[:90]}, {"q": TIME[:90]}, 1.0)
    assert "not longer than 2 s" in remark.text


def test_shares_of_a_stall_are_those_before_its_warning():
    """After 6 s the answer does not follow the inputs linearly, as in a stall."""
    before, after = short_period(elevator()), short_period(SCALE * elevator())
    stalled = {
        name: np.where(TIME < 6.0, values, before[name] + 1e-3) for name, values in after.items()
    }
    # a ramp: most of the response is after the warning
    ramp = {name: values + 0.02 * TIME for name, values in before.items()}
    changed = {name: stalled[name] + 0.018 * TIME for name in stalled}
    weak = {}
    for name in ramp:
        after = ramp[name] + 0.3 * (changed[name] - ramp[name])
        weak[name] = np.where(TIME < 6.0, changed[name], after)
    (remark,) = judge_input_change(TIME, ramp, weak, {"theta"}, moved_at=2.0)
    assert remark.kind == "not_driven"
    (remark,) = judge_input_change(TIME, ramp, weak, {"theta"}, moved_at=2.0, linear_end=5.9)
    assert remark.kind == "probe"
    assert remark.values["theta"] == pytest.approx(1.0, abs=1e-9)
    # an answer that is stored after the warning
    flat = {name: np.where(TIME < 6.0, changed[name], ramp[name] + 1e-3) for name in ramp}
    (remark,) = judge_input_change(TIME, ramp, flat, {"theta"}, moved_at=2.0, linear_end=5.9)
    assert remark.kind == "not_driven"
    assert "below 0.1" in remark.text


@pytest.mark.parametrize("gain", [10.0, 40.0])
def test_a_controller_that_follows_the_flight_is_named(gain):
    flight = short_period(0.8 * elevator())
    (remark,) = probe(lambda d: short_period(d, flight, gain), delta_e=elevator())
    assert remark.kind == "not_driven"


def test_a_pulse_displaces_an_aeroplane_whose_controls_rest():
    rest = np.zeros(TIME.size)
    assert not changed_job(job_of(delta_e=rest), {}).moved
    (remark,) = probe(short_period, delta_e=rest)
    assert remark.kind == "probe"
    assert remark.values["theta"] > 0.5
    flight = short_period(rest)
    (remark,) = probe(lambda d: short_period(d, flight, 10.0), delta_e=rest)
    assert remark.kind == "not_driven"
    (remark,) = probe(lambda d: flight, delta_e=rest)
    assert remark.kind == "not_driven"


def test_on_its_wheels_only_an_answer_that_stays_is_named():
    """Brakes and friction stop an aeroplane whatever the inputs are."""
    before = {"V": 40.0 - 3.0 * TIME}
    slower = {"V": 40.0 - 2.99 * TIME}
    (remark,) = judge_input_change(TIME, before, slower, {"V"}, moved_at=0.0)
    assert remark.kind == "not_driven"
    (remark,) = judge_input_change(TIME, before, slower, {"V"}, moved_at=0.0, on_wheels=True)
    assert remark.kind == "not_probed"
    (remark,) = judge_input_change(TIME, before, before, {"V"}, moved_at=0.0, on_wheels=True)
    assert remark.kind == "not_driven"


def test_wind_is_not_scaled_and_the_start_stays():
    gust = np.sin(TIME)
    inputs = changed_job(job_of(delta_e=0.1 + elevator(), wind_d=gust), {}).job.inputs
    assert np.array_equal(inputs["wind_d"], gust)
    assert inputs["delta_e"][0] == 0.1
    assert np.ptp(inputs["delta_e"]) == pytest.approx(0.9 * np.ptp(elevator()))


def test_the_noise_of_the_record_in_an_answer_is_named():
    generator = np.random.default_rng(5)
    truth = short_period(elevator())
    flight, own = {}, {}
    for name, values in truth.items():
        flight[name] = values + 1e-3 * generator.standard_normal(TIME.size)
        own[name] = values + 1e-3 * generator.standard_normal(TIME.size)
    (remark,) = judge_scatter(RecordScatter(flight), own)
    assert remark.kind == "probe"
    assert abs(remark.values["correlation"]) < 0.2
    (remark,) = judge_scatter(RecordScatter(flight), {name: 1.01 * flight[name] for name in flight})
    assert remark.kind == "not_driven"
    assert remark.values["correlation"] > 0.99
    # the noise of an input, such as a recorded thrust, leaves a trace in an honest answer
    traced = {name: truth[name] + 0.01 * (flight[name] - truth[name]) for name in truth}
    (remark,) = judge_scatter(RecordScatter(flight), traced)
    assert remark.values["correlation"] > 0.9
    assert remark.kind == "probe"
    # a record without noise, such as that of a simulator, shows nothing
    (remark,) = judge_scatter(RecordScatter(truth), truth)
    assert remark.kind == "not_probed"
    assert "noise in 0 channels" in remark.text


def test_a_difference_that_is_only_noise_is_a_departure():
    generator = np.random.default_rng(8)
    truth = short_period(elevator())
    names = ("phi", "theta", "psi")
    flight = {name: truth["theta"] + 5e-4 * generator.standard_normal(TIME.size) for name in names}
    copy = {name: smoothed(values) for name, values in flight.items()}
    (remark,) = judge_difference(TIME, RecordScatter(flight), copy)
    assert remark.kind == "departure"
    assert "nothing but the noise of the record" in remark.text
    # a model with 3 % less response and a drift of 0.02 deg/s in heading
    honest = {**dict.fromkeys(names, 0.97 * truth["theta"])}
    honest["psi"] = truth["theta"] + np.radians(0.02) * TIME
    (remark,) = judge_difference(TIME, RecordScatter(flight), honest)
    assert remark.kind == "probe"
    # a record without noise shows nothing
    sine = RecordScatter(dict.fromkeys(names, np.sin(TIME)))
    assert [item.kind for item in judge_difference(TIME, sine, honest)] == ["not_probed"]
    # nor does a flight without motion, of which an honest model leaves the noise alone
    rest = {name: flight[name] - truth["theta"] for name in names}
    still = dict.fromkeys(names, np.zeros(TIME.size))
    (remark,) = judge_difference(TIME, RecordScatter(rest), still)
    assert "0 of 4 channels of attitude and speed hold noise and move" in remark.text
    # nor does a window below twice the lag
    short = {name: values[:60] for name, values in flight.items()}
    (remark,) = judge_difference(TIME[:60], RecordScatter(short), short)
    assert "the window has less than 2 s" in remark.text


def smoothed(values):
    """Return values under a Gaussian of 0.24 s, (time,)."""
    return gaussian_filter1d(values, 0.24 / STEP)


def compare(flown, **kind):
    """Return the remark on a flight, with an honest model of the elevator of `elevator`."""
    generator = np.random.default_rng(2)
    flight = {}
    for name, values in short_period(flown).items():
        flight[name] = values + 2e-4 * generator.standard_normal(TIME.size)
    before, after = short_period(elevator()), short_period(SCALE * elevator())
    (remark,) = compare_inputs(TIME, before, after, flight, **{"surfaces": True, **kind})
    return remark


def test_a_true_record_is_no_departure():
    assert compare(elevator()).kind == "probe"
    # three percent are within what models from flight have
    assert compare(1.03 * elevator()).kind == "probe"


def test_a_wrong_gain_is_measured():
    # the record shows 15 % more than the elevator moved
    remark = compare(elevator() / 1.15)
    assert remark.kind == "departure"
    assert remark.values["gain"] == pytest.approx(1 / 1.15, abs=0.005)
    # friction of the circuits changes forces by as much
    assert compare(elevator() / 1.15, surfaces=False).kind == "probe"
    assert compare(elevator() / 1.25, surfaces=False).kind == "departure"


def test_a_reversed_sign_is_named_and_a_size_of_no_pick_up_is_not():
    remark = compare(-1.0 * elevator())
    assert remark.kind == "departure"
    assert remark.values["gain"] == pytest.approx(-1.0, abs=0.01)
    remark = compare(-19.0 * elevator())
    assert remark.kind == "not_probed"


def test_a_delay_is_measured():
    remark = compare(np.interp(TIME + 0.2, TIME, elevator()))
    assert remark.kind == "departure"
    assert "earlier" in remark.text


def test_another_error_of_the_model_is_not_taken_for_the_inputs():
    generator = np.random.default_rng(3)
    gust = np.convolve(generator.standard_normal(TIME.size), np.ones(20) / 20, mode="same")
    assert compare(elevator() + 0.02 * gust).kind == "probe"


def flight_at(mass):
    """Return a steady flight whose lift coefficient is 0.5 at a mass of 1000 kg."""
    count = 200
    zero = np.zeros(count)
    lift = 0.5 * 2000.0 * 10.0
    values = {"V": zero + 60.0, "qbar": zero + 2000.0, "alpha": zero, "mass": zero + mass}
    values |= {"ax": zero, "az": zero - lift / 1000.0, "wow_left": zero}
    data = {name: ("time", item) for name, item in values.items()}
    return xr.Dataset(data, coords={"time": 0.02 * np.arange(count)})


def test_a_mass_ten_percent_off_needs_more_lift(monkeypatch):
    """The tables of this model have a lift coefficient of 0.5 everywhere."""
    parts = {"evaluate": lambda columns: (None, np.full((len(columns), 1), 0.5))}
    monkeypatch.setattr(flight_consistency, "Simulation", lambda model: SimpleNamespace(**parts))
    sim = SimpleNamespace(
        terms=("CL/basic",), variables=("alpha",), meta={"database": {"S": 10.0}}, model=None
    )
    (remark,) = compare_lift(sim, flight_at(1000.0))
    assert remark.kind == "probe"
    # without a standard error of the angle of attack the limit is 6.5 %
    assert "between -6.5 % and +6.5 % cannot be seen here" in remark.text
    assert compare_lift(sim, flight_at(1055.0))[0].kind == "probe"
    calibrated = [{"parameter": "bias.alpha_vane", "stderr": 0.0}]
    sharp = flight_at(1055.0).assign_attrs(calibration=json.dumps(calibrated))
    assert compare_lift(sim, sharp)[0].kind == "departure"
    (remark,) = compare_lift(sim, flight_at(1100.0))
    assert remark.kind == "departure"
    assert remark.values["ratio"] == pytest.approx(1.1)
    on_wheels = flight_at(1100.0).assign(wow_left=("time", np.ones(200)))
    (remark,) = compare_lift(sim, on_wheels)
    assert "not checked: the mass" in remark.text


def test_the_slope_of_the_lift_shows_a_mass_that_an_offset_of_the_vane_hides():
    expected = 0.6 + 0.1 * np.sin(TIME)
    noise = 2e-3 * np.random.default_rng(4).standard_normal(TIME.size)
    # an offset of the angle of attack adds a constant lift
    (remark,) = judge_lift(expected + 0.02 + noise, expected, 0.07)
    assert remark.kind == "probe"
    (remark,) = judge_lift(1.055 * expected - 0.02 + noise, expected, 0.07)
    assert remark.kind == "departure"
    assert abs(remark.values["ratio"] - 1.0) < 0.03
    assert remark.values["slope"] == pytest.approx(1.055, abs=0.005)


def test_a_small_effect_of_size_and_time_of_the_inputs_is_no_departure():
    # half of the doublet: its error is within what instruments show
    small = elevator() / 2.0
    generator = np.random.default_rng(2)
    flight = {}
    for name, values in short_period(small / 1.15).items():
        flight[name] = values + 2e-5 * generator.standard_normal(TIME.size)
    before, after = short_period(small), short_period(SCALE * small)
    (remark,) = compare_inputs(TIME, before, after, flight, surfaces=True)
    assert remark.kind == "probe"
    assert remark.values["gain"] == pytest.approx(1 / 1.15, abs=0.01)


def test_channels_that_a_case_does_not_show_are_probed_once():
    generator = np.random.default_rng(8)
    truth = short_period(elevator())["theta"]
    names = ("phi", "theta", "psi")
    flight = {name: truth + 5e-4 * generator.standard_normal(TIME.size) for name in names}
    copy = {name: smoothed(values) for name, values in flight.items()}
    (remark,) = _measure_hidden(RecordScatter(flight), copy, TIME, ())
    assert remark.kind == "departure"
    # what the shown channels have shown is not stated again
    assert _measure_hidden(RecordScatter(flight), copy, TIME, (remark,)) == (remark,)
    # what they have not shown, for want of channels, was looked at here
    unmade = unprobed_remark("noise", "no channel", "difference")
    assert _measure_hidden(RecordScatter(flight), copy, TIME, (unmade,)) == (remark,)
    honest = dict.fromkeys(names, 0.97 * truth)
    honest["psi"] = truth + np.radians(0.02) * TIME
    assert _measure_hidden(RecordScatter(flight), honest, TIME, ()) == ()


def test_noise_in_an_answer_by_tables_is_of_the_inputs():
    """Tables over the flight condition cannot hold a flight; a program of others can."""
    text = "not driven by the inputs: scatter 0.4; the answer holds the noise of the record"
    scatter = RowRemark("not_driven", text, values={"ratio": 0.4, "correlation": 0.5}, unit="1")
    other = RowRemark("not_driven", "not driven by the inputs: no change", values={"p": 0.0})
    first, second = noise_of_inputs([scatter, other])
    assert first.kind == "probe"
    assert first.text.startswith("scatter 0.4; the answer is that of the tables")
    assert second == other
    differs = "the answer differs from that of the tables in the FMU by 0.1 deg rms (pitch)"
    assert shows_own_tables([RowRemark("probe", differs)])
    assert not shows_own_tables([RowRemark("not_driven", f"not driven by its tables: {differs}")])
    assert not shows_own_tables([RowRemark("probe", "answer not compared with the tables")])


def test_the_bound_of_the_effect_of_inputs_is_never_exceeded():
    """A fit is not larger than what it fits, so a probe below the bound would have found
    nothing.
    """
    generator = np.random.default_rng(6)
    before, after = short_period(elevator()), short_period(SCALE * elevator())
    for size in (0.002, 0.004):
        flight = {}
        for name, values in short_period(elevator() / (1.0 + 20.0 * size)).items():
            flight[name] = values + size * generator.standard_normal(TIME.size)
        bound = largest_input_effect(TIME, before, flight)
        # the effect of the fit, channel by channel as in the comparison
        (remark,) = compare_inputs(TIME, before, after, flight, surfaces=True)
        position = (TIME - TIME.mean()) / np.ptp(TIME)
        forms = np.linalg.qr(np.column_stack([np.ones_like(TIME), position]))[0]
        effects = []
        for name in before:
            S = (before[name] - after[name]) / (1.0 - SCALE) * (remark.values["gain"] - 1.0)
            effects.append(rms((S - forms @ (forms.T @ S)) / SIZES[name]))
        assert 0.0 < max(effects) <= bound


def test_a_model_that_answers_by_its_tables_flies_once():
    flown = []

    def fly(job, channels):
        flown.append(job)
        return short_period(job.inputs["delta_e"]), ""

    case = SimpleNamespace(drive=SimpleNamespace(level="recorded"))
    job, outputs = job_of(delta_e=elevator()), short_period(elevator())
    remark, unmade = _probe_tables(case, job, outputs, {}, fly, uncompared="a wheel")
    assert (remark.kind, unmade.kind) == ("probe", "not_probed")
    assert unmade.text == "not checked: size and time of the inputs (a wheel)"
    near = short_period(1.001 * elevator())
    (remark,) = _probe_tables(case, job, outputs, near, fly)
    assert "less than the 0.25 that are named" in remark.text
    # a wrong gain of the pick-up is named as by the probe of any other model
    _, remark = _probe_tables(case, job, outputs, short_period(elevator() / 1.15), fly)
    assert remark.kind == "departure"
    assert len(flown) == 3


def test_tables_without_an_effect_of_the_controls_are_not_driven():
    case = SimpleNamespace(drive=SimpleNamespace(level="recorded"))
    job, outputs = job_of(delta_e=elevator()), short_period(elevator())
    for flight in ({}, short_period(1.001 * elevator()), short_period(elevator() / 1.15)):
        (remark,) = _probe_tables(case, job, outputs, flight, lambda *_: (outputs, ""))
        assert remark.kind == "not_driven"


def test_a_probe_whose_flight_failed_has_its_name_and_the_reason():
    criteria = (SimpleNamespace(channel="theta", applies=True),)
    case = SimpleNamespace(drive=SimpleNamespace(level="recorded"), criteria=criteria)
    job, outputs = job_of(delta_e=elevator()), short_period(elevator())
    words = {"uncompared": "", "on_wheels": False}
    (remark,) = _probe_inputs(case, job, outputs, {}, lambda *_: ({}, "it stopped"), **words)
    reason = "not checked: the answer to scaled inputs (the flight with changed inputs failed: it "
    assert (remark.kind, remark.text) == ("departure", f"{reason}stopped)")
    law = SimpleNamespace(moves=())
    job = replace(job, law=law)
    (remark,) = _probe_inputs(case, job, outputs, {}, lambda *_: ({}, "it stopped"), **words)
    # the list of probes that were not made parts a text at its bracket
    assert (remark.kind, remark.text) == ("not_probed", f"{reason}stopped)")


def test_a_small_jump_is_not_stated_beyond_its_limit():
    """A trim that is found to a tolerance changes a small answer by more than 0.3 of it."""
    before = {"theta": 0.0 * TIME}
    near, after = ({"theta": share * SIZES["theta"] + 0.0 * TIME} for share in (0.08, 0.15))
    (remark,) = judge_jump(before, near, after)
    assert remark.kind == "probe"
    assert "by up to 0.53 of" in remark.text
    assert "limit 0.3, for changes beyond 0.1 of the sizes of the probe" in remark.text


def test_power_of_a_lever_is_not_linear():
    """Near idle a lever hardly changes the power: only an answer that stays is named."""
    lever = np.where(TIME < 1.0, 0.75, 0.25)
    changed = changed_job(job_of(**{"delta_e": 0.0 * TIME, "engine1.throttle": lever}), {})
    assert changed.only_levers
    before, after = {"V": 50.0 - 2.0 * TIME}, {"V": 50.0 - 1.99 * TIME}
    (remark,) = judge_input_change(TIME, before, after, {"V"}, moved_at=1.0, uncompared="levers")
    assert remark.kind == "not_probed"
    assert "(levers)" in remark.text
    (remark,) = judge_input_change(TIME, before, before, {"V"}, moved_at=1.0, uncompared="levers")
    assert remark.kind == "not_driven"
    both = {"delta_e": elevator(), "engine1.throttle": lever}
    assert not changed_job(job_of(**both), {}).only_levers

"""Probes: models that simulate follow changed inputs; stored and steered answers do not."""

import numpy as np
import pytest

from pom.cases.job import ReplayJob
from pom.probing import changed_job, judge_change
from pom.probing.scatter_probe import judge_scatter

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
    return judge_change(TIME, before, after, {"q", "theta"}, moved=changed.moved)


def test_a_linear_aeroplane_changes_by_its_whole_response():
    (remark,) = probe(short_period, delta_e=elevator())
    assert remark.kind == "probe"
    # linear: the change is exactly the share of the inputs
    assert remark.values["q"] == pytest.approx(1.0, abs=1e-9)


def test_a_stored_answer_is_named():
    stored = short_period(elevator())
    (remark,) = probe(lambda delta_e: stored, delta_e=elevator())
    assert remark.kind == "not_driven"
    assert "q" in remark.text
    assert "stored" in remark.text


def test_a_stored_answer_in_one_channel_is_named():
    stored = short_period(elevator())
    (remark,) = probe(lambda d: {**short_period(d), "q": stored["q"]}, delta_e=elevator())
    assert remark.kind == "not_driven"
    assert [*remark.values] == ["q"]


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
    (remark,) = judge_scatter(flight, own)
    assert remark.kind == "probe"
    assert abs(remark.values["correlation"]) < 0.2
    (remark,) = judge_scatter(flight, {name: 1.01 * flight[name] for name in flight})
    assert remark.kind == "not_driven"
    assert remark.values["correlation"] > 0.99
    # a record without noise, such as that of a simulator, shows nothing
    assert judge_scatter(truth, truth) == ()

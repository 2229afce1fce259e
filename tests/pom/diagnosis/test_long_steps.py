"""A thinned job drives a model as the whole one does, and outputs return to the samples of the
record.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from pom.cases.job import ReplayJob
from pom.cases.pilot import PilotLoop
from pom.diagnosis.sample_thinning import at_samples, thin_job

TIME = 100.0 + 0.02 * np.arange(42)
SCATTER = np.random.default_rng(0).standard_normal(42)


def job(**inputs):
    return ReplayJob(TIME, inputs, {"init.V": 100.0}, (), ())


@pytest.mark.parametrize(("step", "every"), [(0.08, 4), (0.07, 3), (0.04, 2)])
def test_inputs_keep_their_integral_and_both_ends(step, every):
    short = thin_job(job(delta_e=SCATTER, delta_f=np.full(42, 0.3), delta_a=TIME - 100.0), step)
    assert_array_equal(short.time, np.unique([*TIME[::every], TIME[-1]]))
    assert short.parameters == {"init.V": 100.0, "mode.step": step}
    assert short.inputs["delta_e"][[0, -1]].tolist() == SCATTER[[0, -1]].tolist()
    assert_allclose(short.inputs["delta_f"], 0.3, rtol=1e-15)
    assert_allclose(
        short.inputs["delta_a"][:-2], short.time[:-2] - 100.0, atol=1e-12
    )  # a line stays one
    inside = np.where(
        (TIME[2 * every] < TIME) & (TIME[-3 * every] > TIME), SCATTER, 0.0
    )  # away from both ends
    coarse = thin_job(job(delta_e=inside), step)
    assert np.trapezoid(coarse.inputs["delta_e"], coarse.time) == pytest.approx(
        np.trapezoid(inside, TIME), rel=1e-12
    )
    assert (
        abs(np.trapezoid(inside[::every], TIME[::every]) / np.trapezoid(inside, TIME) - 1.0) > 0.1
    )  # single samples do not


@pytest.mark.parametrize(
    ("one", "step"),
    [
        (job(delta_e=SCATTER), 0.03),
        (replace(job(), pilot=(PilotLoop("delta_e", "theta", 1.0, 0.0, 1.0),)), 0.08),
        (replace(job(delta_e=SCATTER[:1]), time=TIME[:1]), 0.08),
    ],
)
def test_all_samples_stay_within_the_step_with_a_math_pilot_and_of_one(one, step):
    short = thin_job(one, step)
    assert short.time is one.time
    assert short.inputs is one.inputs
    assert short.parameters["mode.step"] == step


def test_outputs_follow_lines_between_the_samples_flown():
    kept = np.unique([*range(0, 42, 4), 41])
    line = np.stack([2.0 * TIME, -TIME])
    assert_allclose(at_samples({"h": line[:, kept]}, TIME[kept], TIME)["h"], line, rtol=1e-12)
    assert at_samples({"h": line}, TIME, TIME)["h"] is line
    turning = np.angle(np.exp(1j * 3.0 * TIME))[None]  # passes half a turn
    found = at_samples({"psi": turning[:, kept]}, TIME[kept], TIME)["psi"]
    assert np.abs(np.angle(np.exp(1j * (found - turning)))).max() < 1e-12


def test_a_failed_run_stays_without_numbers():
    kept = np.array([0, 20, 41])
    found = at_samples({"h": np.array([[np.nan] * 3, [1.0, 1.0, 1.0]])}, TIME[kept], TIME)["h"]
    assert np.isnan(found[0]).all()
    assert (found[1] == 1.0).all()


def test_samples_next_to_a_jump_stay_as_they_are():
    released = np.where(np.arange(42) < 18, 0.5, 0.0)
    short = thin_job(job(brake_left=released, delta_e=1e-3 * SCATTER), 0.08)
    kept = np.flatnonzero(np.isin(TIME, short.time))
    assert kept.tolist() == [0, 4, 8, 12, 16, 17, 18, 19, 20, 24, 28, 32, 36, 40, 41]
    assert short.inputs["brake_left"].tolist() == released[kept].tolist()
    inner = [5, 6, 7]  # no sample next to them is left out
    assert short.inputs["delta_e"][inner].tolist() == (1e-3 * SCATTER[kept[inner]]).tolist()
    assert short.inputs["delta_e"][1] != 1e-3 * SCATTER[4]

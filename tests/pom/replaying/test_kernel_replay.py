"""Many replays by the kernel are each the one replay; loops of the math pilot are closed in it."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import flightmech
from pom.cases.case import read_case
from pom.cases.job import job_of
from pom.cases.pilot import PilotLoop
from pom.cases.reference_states import flight_states
from pom.replaying.kernel_replay import fly_once, replay_choices


@pytest.fixture(scope="module")
def sim(trainer):
    return flightmech.compile(trainer.AIRCRAFT, trainer.database())


@pytest.fixture
def job(write_case, trainer):
    truth = trainer.flight(
        trainer.database(),
        delta_e=[(0.0, 0.0), (2.0, 0.0), (2.06, -0.06), (4.0, -0.06), (4.06, 0.0)],
    )
    case = read_case(write_case())
    return job_of(case, flight_states(case, truth))


def test_each_run_is_the_simulation_with_its_parameters(sim, job):
    scales = [1.0, 0.5, 0.0] * 25  # more runs than are kept in memory at once
    outputs, failures = replay_choices(
        sim,
        job,
        [{"term.Cm.qhat": scale, "term.CY.no_such": 1.0} for scale in scales],
        ["q", "theta"],
    )
    assert failures == [""] * 75
    assert list(outputs) == ["q", "theta"]
    inputs = xr.Dataset(
        {name: ("time", values) for name, values in job.inputs.items() if name in sim.inputs},
        {"time": job.time},
    )
    start = {name: value for name, value in job.parameters.items() if name in sim.parameters}
    for run in (0, 1, 2, 74):
        alone = flightmech.simulate(sim, inputs, {**start, "term.Cm.qhat": scales[run]})
        assert np.array_equal(outputs["q"][run], alone["q"].values)


def test_a_run_that_fails_has_no_values(sim, job):
    outputs, failures = replay_choices(
        sim, job, [{"term.CL.basic": 1.0}, {"term.CL.basic": np.inf}], ["q"]
    )
    assert failures[0] == ""
    assert failures[1]
    assert np.isfinite(outputs["q"][0]).all()
    assert np.isnan(outputs["q"][1]).all()


def test_one_run_is_the_same_to_the_last_bit(sim, job):
    bank = {"phi": 0.05 * np.sin(job.time)}
    piloted = replace(job, pilot=(PilotLoop("delta_a", "phi", gain=-2.0, limit=0.2),), targets=bank)
    failing = replace(
        job,
        inputs={**job.inputs, "delta_e": np.where(job.time > 3.0, np.inf, job.inputs["delta_e"])},
    )
    for one in (job, piloted, failing):
        many, (why,) = replay_choices(sim, one, channels=["q", "phi", "no_such"])
        found, failure = fly_once(sim, one, ["q", "phi", "no_such"])
        assert list(found) == ["q", "phi"]
        assert bool(failure) == bool(why) == (one is failing)
        for name in found:
            assert np.array_equal(found[name], many[name][0], equal_nan=True)


def test_the_math_pilot_flies_in_the_kernel(sim, job):
    bank = 0.05 * np.sin(job.time)
    loops = (
        PilotLoop("delta_a", "phi", gain=-2.0, limit=0.2),
        PilotLoop("delta_a", "p", gain=-0.5, limit=0.2),
    )
    targets = {"phi": bank, "p": 0.05 * np.cos(job.time)}
    free, _ = replay_choices(sim, job, channels=["phi", "q"])
    idle, failures = replay_choices(
        sim,
        replace(job, pilot=(replace(loops[0], gain=0.0),), targets=targets),
        channels=["phi", "q"],
    )
    assert failures == [""]
    assert np.abs(idle["q"] - free["q"]).max() < 1e-12
    flown, failures = replay_choices(
        sim,
        replace(job, pilot=loops, targets=targets),
        [{"term.CL.basic": 1.0}, {"term.CL.basic": np.inf}],
        ["phi"],
    )
    assert failures[0] == ""
    assert failures[1]
    late = job.time > 4.0
    assert (
        np.abs(flown["phi"][0] - bank)[late].max() < 0.5 * np.abs(free["phi"][0] - bank)[late].max()
    )


def test_piloted_runs_side_by_side_are_those_one_by_one(sim, job):
    """Loops that reach their limit and come back, two on one control, an angle that is turns away,
    a run that fails.
    """
    targets = {
        "phi": 0.3 * np.sin(2.0 * job.time),
        "p": np.zeros(job.time.size),
        "psi": np.full(job.time.size, 3.1 + 6.0 * np.pi),
    }
    loops = (
        PilotLoop("delta_a", "phi", gain=-2.0, limit=0.05, integral=-1.0),
        PilotLoop("delta_r", "psi", gain=-0.5, limit=0.1),
        PilotLoop("delta_a", "p", gain=-0.3, limit=0.02),
    )
    piloted = replace(job, pilot=loops, targets=targets)
    scales = [1.0, 0.8, np.inf, 0.5, 1.2, 0.0, 2.0, 1.1, 0.9, 0.7, 0.6]
    outputs, failures = replay_choices(
        sim,
        piloted,
        [{"term.Cl.phat": scale} for scale in scales],
        ["phi", "psi", "applied.delta_a"],
    )
    for run, scale in enumerate(scales):
        one = replace(piloted, parameters={**piloted.parameters, "term.Cl.phat": scale})
        found, failure = fly_once(sim, one, ["phi", "psi", "applied.delta_a"])
        assert bool(failure) == bool(failures[run]) == (scale == np.inf)
        for name, values in found.items():
            assert values.tobytes() == outputs[name][run].tobytes()
    pushed = np.abs(outputs["applied.delta_a"][0] - job.inputs["delta_a"])
    assert pushed.max() > 0.06  # both loops together beyond the limit of one
    assert (3.1 - outputs["psi"][0] > np.pi).any()  # turned

"""Replay of a flight of which the model is the truth: by FMI 2.0, by FMI 3.0, and by the kernel
itself.
"""

import tempfile
from dataclasses import replace as changed

import numpy as np
import pytest

import aerodb
import flightmech
from flightmech.errors import SchemaError
from pom.cases.case import read_case
from pom.cases.case_inputs import CaseInputs
from pom.cases.job import job_of
from pom.cases.pilot import PilotLoop
from pom.cases.reference_states import flight_states
from pom.fmu import worker
from pom.fmu.models import Models
from pom.replaying.kernel_replay import replay_choices
from pom.replaying.replay_case import replay
from pom.tolerances.bands import remarks_text


@pytest.fixture(scope="module")
def truth(trainer):
    return trainer.flight(
        trainer.database(),
        delta_e=[(0.0, 0.0), (2.0, 0.0), (2.06, -0.05), (4.0, -0.05), (4.06, 0.0)],
        delta_a=[(0.0, 0.0), (6.0, 0.0), (6.06, -0.03), (7.0, -0.03), (7.06, 0.0)],
    )


@pytest.fixture(scope="module")
def models(trainer, tmp_path_factory):
    folder = tmp_path_factory.mktemp("models")
    sim = flightmech.compile(trainer.AIRCRAFT, trainer.database())
    for version in ("2.0", "3.0"):
        flightmech.write_fmu(sim, folder / f"{version}.fmu", version=version)
    return sim, {version: folder / f"{version}.fmu" for version in ("2.0", "3.0")}


@pytest.mark.slow
def test_the_truth_is_matched_by_every_way_of_replay(write_case, truth, models, trainer):
    sim, runs = models
    case = read_case(write_case())
    result = replay(case, runs, truth)
    assert result.failure == ""
    job = job_of(case, flight_states(case, truth))
    runs_direct, failures = replay_choices(sim, job)
    assert failures == [""]
    direct = {name: values[0] for name, values in runs_direct.items()}
    scale = {"theta": np.radians(1.5), "q": np.radians(2.0), "nz": 0.1}
    for name, width in scale.items():
        signal = result.signals[name]
        # FMI 2.0 takes input derivatives, FMI 3.0 the whole record: the same linear inputs as the
        # direct call, whose time
        # does not start at zero
        assert np.abs(signal.sel(run="2.0").values - direct[name]).max() < 1e-9 * width
        assert np.abs(signal.sel(run="3.0").values - direct[name]).max() < 1e-9 * width
        # the direct replay starts from lines through the first half second: the truth within their
        # rounding
        assert np.abs(signal.sel(run="flight").values - direct[name]).max() < 1e-2 * width
    assert result.passed("2.0")
    assert result.passed("3.0")


def test_the_levels_of_replay_agree_within_their_holds(write_case, truth, models, trainer):
    """The whole record in one step, input derivatives, and the middle of each step held, on one
    job.
    """
    _, runs = models
    job = job_of(read_case(write_case()), flight_states(read_case(write_case()), truth))
    with tempfile.TemporaryDirectory() as folder:
        whole = worker.UnpackedFmu(str(runs["3.0"]), f"{folder}/3")
        inputs = {name: values for name, values in job.inputs.items() if name in whole.variables}
        parameters = {
            name: value for name, value in job.parameters.items() if name in whole.variables
        }
        task = {
            "time": job.time,
            "inputs": inputs,
            "parameters": parameters,
            "outputs": ["theta", "q"],
        }
        assert whole.takes_records
        record = worker.replay_job(whole, task)
        whole.takes_records = False
        middle = worker.replay_job(whole, task)
        sloped = worker.replay_job(worker.UnpackedFmu(str(runs["2.0"]), f"{folder}/2"), task)
    assert (record["error"], middle["error"], sloped["error"]) == ("", "", "")
    assert np.ptp(record["outputs"][:, 0]) > 0.02
    np.testing.assert_allclose(sloped["outputs"], record["outputs"], rtol=0.0, atol=1e-11)
    difference = np.abs(middle["outputs"] - record["outputs"]).max()
    assert (
        1e-8 < difference < 3e-4
    )  # held middles of 20 ms: second order, seen at the kinks of the doublets


def test_a_record_that_diverges_keeps_what_was_flown(models):
    _, runs = models
    time = 0.02 * np.arange(101)
    with tempfile.TemporaryDirectory() as folder:
        model = worker.UnpackedFmu(str(runs["3.0"]), folder)
        task = {
            "time": time,
            "inputs": {},
            "parameters": {"mass.Iyy": 1.0, "init.V": 80.0, "init.alpha": 0.1},
            "outputs": ["theta"],
        }
        found = worker.replay_job(model, task)
    assert found["error"].startswith("the replay failed: ")
    assert "replay failed after" in found["error"]
    count = np.isfinite(found["outputs"][:, 0]).sum()
    assert 0 < count < 101
    assert np.isnan(found["outputs"][count:]).all()


def test_trim_is_reported_and_leaves_nothing(write_case, truth, models, trainer):
    _, runs = models
    result = replay(read_case(write_case()), {"m": runs["2.0"]}, truth)
    trim = result.trim["m"]
    assert abs(trim["trim.delta_e"]) < 1e-4  # the recorded elevator already trims the true model
    assert trim[["trim.u_dot", "trim.w_dot", "trim.q_dot"]].abs().max() < 1e-6
    assert trim["delta_e"] == pytest.approx(result.trim.loc["delta_e", "flight"], abs=1e-4)
    assert result.trim.loc["V", "flight"] == pytest.approx(85.0, abs=1e-3)


def test_heading_through_north_is_compared_without_a_jump(write_case, truth, models, trainer):
    _, runs = models
    turned = truth.assign(psi=("time", np.mod(truth["psi"].values - 6.2 + 0.002, 2.0 * np.pi)))
    case = read_case(write_case(more='[tolerance]\npsi = "1 deg"'))
    result = replay(case, {"m": runs["2.0"]}, turned)
    row = result.verdict.set_index("criterion").loc["psi"]
    assert row["verdict"] == "pass"
    assert np.abs(np.diff(result.signals["psi"].values, axis=1)).max() < 0.1


def test_a_trim_beyond_its_limit_is_remarked(write_case, truth, tmp_path, trainer):
    db = trainer.database()
    wrong = aerodb.replace_terms(db, {"Cm/basic": aerodb.terms(db)["Cm/basic"] + 0.05})
    flightmech.write_fmu(flightmech.compile(trainer.AIRCRAFT, wrong), tmp_path / "wrong.fmu")
    result = replay(read_case(write_case()), {"m": tmp_path / "wrong.fmu"}, truth)
    assert all(
        "trim.delta_e" in note and "is beyond 1 deg" in note
        for note in result.verdict["remarks"].map(remarks_text)
    )
    elevator = 0.05 / (1.1 - 0.4 * 0.7 / 5.0)  # its own lift is carried back by the angle of attack
    assert result.trim.loc["trim.delta_e", "m"] == pytest.approx(elevator, rel=0.01)


@pytest.mark.slow
def test_the_math_pilot_of_the_child_is_that_of_the_kernel(write_case, truth, models, trainer):
    """A loop on the pitch attitude of a model with two thirds of the elevator: two ways of closing
    it, one flight.
    """
    weak = trainer.scaled(trainer.database(), Cm_elevator=0.67)
    case = changed(
        read_case(write_case(case='show = ["theta"]')),
        drive=CaseInputs("pilot", pilot=(PilotLoop("delta_e", "theta", -0.8, 0.1, -0.3),)),
    )
    job = job_of(case, flight_states(case, truth))
    sim = flightmech.compile(trainer.AIRCRAFT, weak)
    direct, failures = replay_choices(sim, job)
    assert failures == [""]
    with tempfile.TemporaryDirectory() as folder:
        runs = {
            v: flightmech.write_fmu(sim, f"{folder}/{v}.fmu", version=v) for v in ("2.0", "3.0")
        }
        result = replay(case, runs, truth)
    assert result.failure == ""
    moved = result.signals["delta_e"] - result.signals["delta_e"].sel(run="flight")
    assert np.abs(moved.sel(run="2.0")).max() > np.radians(1.0)
    theta = result.signals["theta"]
    assert np.abs(theta.sel(run="2.0").values - direct["theta"][0]).max() < 1e-10
    assert (
        np.abs(theta.sel(run="3.0").values - direct["theta"][0]).max() < 3e-4
    )  # middles of 20 ms held


def test_no_model_has_the_name_of_the_recording():
    with pytest.raises(SchemaError, match="flight is the name of the recording"):
        Models({"flight": "any.fmu"})

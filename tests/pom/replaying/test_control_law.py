"""The FMU of a control law between the recorded pilot and the model, coupled sample by sample;
feedback one step late.
"""

import json

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.errors import OutOfRange, SchemaError
from pom.archive.origins import case_found_from, case_seen_from
from pom.cases.case import PomCase, driven_quantities, read_case
from pom.cases.job import job_of
from pom.replaying.kernel_replay import replay_choices
from pom.replaying.replay_case import plan_of, replay
from pom.report.case.driving import describe_driving

STEP, TAU = 0.02, 0.5
LAW = '[control_law]\nfmu = "law.fmu"\nmoves = ["delta_e"]\n'


@pytest.fixture
def flight(lag_states):
    """A flight with a recorded column that the record of the elevator does not follow."""
    time = lag_states["time"].values
    return lag_states.drop_vars("delta_e").assign(column=("time", -0.02 * np.sin(2.0 * time)))


def expected(result, flight, gain=0.1, step=STEP):
    """Return pitch attitude and elevator, sample by sample: the lag under held inputs, the law one
    step behind.
    """
    time = result.signals["time"].values
    points = np.arange(round((time[-1] - time[0]) / step) + 1) * step + time[0]
    column = np.interp(points, flight["time"].values, flight["column"].values)
    at_start = flight.sel(time=time[0], method="nearest")
    held = np.exp(-step / TAU)
    theta, u = [float(at_start["theta"])], [-1.2 * column[0] + gain * float(at_start["q"])]
    for k in range(points.size - 1):
        theta.append(held * theta[k] + 2.0 * (1.0 - held) * u[k])
        q = (
            2.0 * u[max(k - 1, 0)] - theta[k]
        ) / TAU  # of the sample, under the input that acted until then
        u.append(-1.2 * column[k] + gain * q)
    every = round(STEP / step)
    return np.array(theta)[::every], np.array(u)[::every]


def test_model_and_law_are_coupled_with_one_step_of_delay(law, write_case, toy, flight, tmp_path):
    law()
    case = read_case(write_case(case='show = ["theta"]', more="trim = false\n" + LAW))
    result = replay(case, {"toy": toy()}, flight)
    assert result.failure == ""
    theta, u = expected(result, flight)
    assert np.abs(result.signals["theta"].values[1] - theta).max() < 1e-14
    assert np.abs(result.signals["delta_e"].values[1] - u).max() < 1e-14
    assert np.ptp(u) > 0.02  # it moves
    assert result.signals.attrs["control_law"].startswith("law.fmu, FMI 2.0, sha256 ")
    assert "delta_e" not in driven_quantities(case)


def test_units_names_and_parameters_of_the_law_are_those_of_its_table(
    law, write_case, toy, flight, tmp_path
):
    law("degrees", names=("stick", "rate", "elevator"), units=("m", "deg/s", "deg"))
    (tmp_path / "law.toml").write_text(
        '[inputs]\ncolumn = "stick"\nq = { variable = "rate", unit = "deg/s" }\n'
        '[outputs]\ndelta_e = { variable = "elevator", unit = "deg" }\n[fixed]\ngain = 0.05\n'
    )
    case = read_case(
        write_case(case='show = ["theta"]', more="trim = false\n" + LAW + 'names = "law.toml"\n')
    )
    result = replay(case, {"toy": toy()}, flight)
    theta, u = expected(result, flight, gain=0.05)
    assert np.abs(result.signals["theta"].values[1] - theta).max() < 1e-13
    assert np.abs(result.signals["delta_e"].values[1] - u).max() < 1e-13
    assert {str(tmp_path / name) for name in ("law.fmu", "law.toml")} <= set(
        case.files()
    )  # hashed with the inputs of a report


def test_a_law_of_fixed_steps_gives_the_pace(law, write_case, toy, flight):
    law(any_step=False)  # steps of 10 ms only, the record has 20 ms
    case = read_case(write_case(case='show = ["theta"]', more="trim = false\n" + LAW))
    result = replay(case, {"toy": toy()}, flight)
    theta, _ = expected(result, flight, step=0.01)
    assert np.abs(result.signals["theta"].values[1] - theta).max() < 1e-13


def test_a_law_that_fails_is_a_failure_of_the_run(law, write_case, toy, flight):
    law("broken")
    case = read_case(write_case(case='show = ["theta"]', more="trim = false\n" + LAW))
    assert "toy: the step to t = 1.04 s failed" in replay(case, {"toy": toy()}, flight).failure


def test_what_does_not_fit_is_refused(law, write_case, toy, flight, tmp_path):
    law(names=("wheel", "p", "delta_e"), units=("rad", "rad/s", "rad"))
    case = read_case(write_case(more="trim = false\n" + LAW))
    with pytest.raises(
        SchemaError,
        match=r"(?s)input wheel: the record has no such channel.*input p: the model lag\.fmu has "
        r"no such output",
    ):
        replay(case, {"toy": toy()}, flight)
    law(units=("m", "deg/s", "rad"))
    with pytest.raises(SchemaError, match="input q is in 'deg/s'; needed is 'rad s-1'"):
        replay(case, {"toy": toy()}, flight)
    law()
    with pytest.raises(OutOfRange, match="input column has no value in 1 samples"):
        replay(
            case,
            {"toy": toy()},
            flight.assign(column=flight["column"].where(flight["time"] != 3.0)),
        )
    with pytest.raises(SchemaError, match="its FMU is not flown by the kernel alone"):
        replay_choices(None, job_of(case, plan_of(case, flight).states))
    with pytest.raises(
        SchemaError,
        match=r'it drives surfaces, and drive\.surfaces is "cockpit"; make it "recorded"',
    ):
        read_case(write_case(more='trim = false\nsurfaces = "cockpit"\n' + LAW))
    with pytest.raises(SchemaError, match=r"control_law\.fmu: no file"):
        read_case(write_case(more="trim = false\n" + LAW.replace("law.fmu", "nolaw.fmu")))
    with pytest.raises(SchemaError, match="moves"):
        read_case(write_case(more="trim = false\n" + LAW.replace("delta_e", "delta_x")))


def test_a_case_with_a_law_survives_its_archive(law, write_case, tmp_path):
    law()
    case = read_case(write_case(more="trim = false\n" + LAW))
    again = PomCase.from_dict(json.loads(json.dumps(case.to_dict())))
    assert again == case
    seen = case_seen_from(case, tmp_path / "report")
    assert seen.law == "../law.fmu"
    assert case_found_from(seen, tmp_path / "report").law == case.law
    old = {key: value for key, value in case.to_dict().items() if not key.startswith("law")}
    assert PomCase.from_dict(old).law == ""  # a case of an earlier report


@pytest.mark.slow
def test_our_model_with_the_law_flies_as_with_the_same_law_in_python(
    law, write_case, trainer, tmp_path
):
    """The coupled FMUs and `flightmech.simulate_closed_loop` with a delay of one period are the
    same sampled system.
    """
    law()
    db = trainer.database()
    states = trainer.flight(
        db, delta_e=[(0.0, 0.0), (2.0, 0.0), (2.5, -0.02), (20.0, -0.02)]
    ).drop_vars("delta_e")
    time = states["time"].values
    states = states.assign(
        column=("time", np.interp(time, [0.0, 2.0, 2.3, 3.0, 3.4], [0.0, 0.0, 0.01, 0.01, 0.0]))
    )
    sim = flightmech.compile(trainer.AIRCRAFT, db)
    flightmech.write_fmu(sim, tmp_path / "model.fmu")
    case = read_case(write_case(case='show = ["theta", "q"]', more=LAW))
    result = replay(case, {"model": tmp_path / "model.fmu"}, states)
    assert result.failure == ""
    job = job_of(case, plan_of(case, states).states)
    first = -1.2 * job.law.recorded["column"][0] + 0.1 * job.law.start["q"]
    given = {name: ("time", values) for name, values in job.inputs.items()} | {
        "delta_e": ("time", np.full(job.time.size, first))
    }
    parameters = {name: value for name, value in job.parameters.items() if name in sim.parameters}
    run = flightmech.simulate_closed_loop(
        sim,
        xr.Dataset(given, {"time": job.time - job.time[0]}),
        lambda t, y, u: {
            "delta_e": -1.2 * np.interp(t, job.time - job.time[0], job.law.recorded["column"])
            + 0.1 * y["q"]
        },
        0.02,
        parameters,
        delay=1,
    )
    assert np.ptp(run.theta.values) > 0.02  # 1.3 deg
    assert np.abs(result.signals["theta"].values[1] - run.theta.values).max() < 1e-12
    words = dict(describe_driving(result)["how"])
    assert words["controls"].startswith("the control law moves")
    assert "law.fmu, FMI 2.0" in words["feedback"]
    assert words["feedback"].startswith("closed loop")

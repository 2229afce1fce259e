"""Order of the integration, equality of step and run, rollback, failures, counters."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import flightmech
from flightmech.errors import SimulationError
from flightmech.simulation.kernel import Simulation
from flightmech.terms import make_term

FLIGHT = {"init__V": 100.0, "init__h": 2000.0, "mode__trim": 2.0}


def inputs_over(sim: flightmech.SimModel, time: np.ndarray, u0: np.ndarray) -> np.ndarray:
    u = np.tile(u0, (len(time), 1))
    u[:, sim.inputs.index("delta_e")] += 0.03 * np.sin(2.0 * time)
    u[:, sim.inputs.index("delta_a")] += 0.02 * np.sin(1.3 * time)
    return u


def test_fourth_order_on_a_smooth_model(make_aircraft, make_tree, start):
    content = {
        "CL/basic": make_term(0.3),
        "CL/alpha": make_term(5.0, regressors=["alpha"]),
        "CD/basic": make_term(0.03),
        "CD/square": make_term(0.7, regressors=["alpha", "alpha"]),
        "Cm/alpha": make_term(-0.9, regressors=["alpha"]),
        "Cm/qhat": make_term(-12.0, regressors=["qhat"]),
        "Cm/elevator": make_term(-1.1, regressors=["delta_e"]),
    }
    sim = flightmech.compile(make_aircraft(engines=()), make_tree(content))
    u = np.zeros(len(sim.inputs))
    kick = u.copy()
    kick[sim.inputs.index("delta_e")] = 0.02

    def end(step: float) -> np.ndarray:
        run = start(sim, init__V=100.0, init__h=2000.0, mode__step=step)
        run.step(0.0, 2.0, u, kick)
        return run.state[3:13]

    best = end(0.001)
    errors = [np.abs(end(step) - best).max() for step in (0.08, 0.04, 0.02)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (np.abs(orders - 4.0) < 0.3).all(), (errors, orders)


def test_a_run_is_its_steps(sim, start):
    time = np.arange(0.0, 3.0, 0.02)
    run, steps = start(sim, **FLIGHT), start(sim, **FLIGHT)
    u = inputs_over(sim, time, np.zeros(len(sim.inputs)))
    y = run.run(time, u, hold=False)
    steps.set_inputs(u[0])
    rows = [steps.outputs()]
    for k in range(len(time) - 1):
        steps.step(time[k], time[k + 1] - time[k], u[k], u[k + 1])
        rows.append(steps.outputs())
    assert (np.array(rows) == y).all()


def test_held_inputs_show_in_the_outputs(sim, start):
    time = np.array([0.0, 0.1, 0.2])
    u = np.zeros((3, len(sim.inputs)))
    u[:, sim.inputs.index("delta_e")] = [0.0, 0.1, 0.2]
    column = sim.outputs.index("applied.delta_e")
    assert start(sim, **FLIGHT | {"mode__trim": 0.0}).run(time, u, hold=True)[
        :, column
    ].tolist() == [0.0, 0.0, 0.1]
    assert start(sim, **FLIGHT | {"mode__trim": 0.0}).run(time, u, hold=False)[
        :, column
    ].tolist() == [0.0, 0.1, 0.2]


def test_step_is_cut_into_equal_parts(sim, start):
    u = np.zeros(len(sim.inputs))
    whole, parts = start(sim, **FLIGHT, mode__step=0.01), start(sim, **FLIGHT, mode__step=0.01)
    whole.step(0.0, 0.05, u, u)
    for i in range(5):
        parts.step(0.01 * i, 0.01, u, u)
    np.testing.assert_allclose(whole.state, parts.state, rtol=1e-13)


def test_a_copy_is_a_rollback_point(sim, start):
    u = np.zeros(len(sim.inputs))
    run = start(sim, **FLIGHT)
    run.step(0.0, 1.0, u, u)
    saved = run.copy()
    run.step(1.0, 1.0, u, u)
    first = run.outputs()
    run.set_parameter(sim.parameters.index("mass.mass"), 3000.0)
    saved.step(1.0, 1.0, u, u)
    assert (saved.outputs() == first).all()
    assert saved.parameter(sim.parameters.index("mass.mass")) == 2300.0


def test_outputs_do_not_disturb_the_run(sim, start):
    u = np.zeros(len(sim.inputs))
    quiet, watched = start(sim, **FLIGHT), start(sim, **FLIGHT)
    for i in range(20):
        watched.outputs()
        watched.derivative(watched.state + 0.1, u)
        quiet.step(0.1 * i, 0.1, u, u)
        watched.step(0.1 * i, 0.1, u, u)
    assert (quiet.state == watched.state).all()


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_bad_input_stops_the_run_and_reports_the_time(value, sim, start):
    time = np.arange(0.0, 2.0, 0.05)
    u = np.zeros((len(time), len(sim.inputs)))
    u[17, sim.inputs.index("delta_r")] = value
    with pytest.raises(
        SimulationError, match=r"input delta_r is (-?nan|inf) at t = 0\.85 s"
    ) as caught:
        start(sim, **FLIGHT).run(time, u, hold=False)
    assert caught.value.time == pytest.approx(0.85)


def test_divergence_stops_the_run_and_keeps_the_last_good_state(make_aircraft, make_tree, start):
    content = {
        "Cm/unstable": make_term(400.0, regressors=["alpha"]),
        "Cm/worse": make_term(5e4, regressors=["qhat"]),
    }
    sim = flightmech.compile(make_aircraft(engines=()), make_tree(content))
    u = np.zeros(len(sim.inputs))
    run = start(sim, init__V=200.0, init__alpha=0.1)
    with pytest.raises(
        SimulationError, match=r"^state\.\w+ is not finite at t = .* the model has diverged"
    ) as caught:
        run.step(0.0, 60.0, u, u)
    assert 0.0 < caught.value.time < 60.0
    assert np.isfinite(run.state).all()


def test_step_before_initialisation_is_refused(sim):
    u = np.zeros(len(sim.inputs))
    with pytest.raises(SimulationError, match=r"has not been initialised"):
        Simulation(sim.model).step(0.0, 0.1, u, u)


@pytest.mark.parametrize("dt", [-0.1, np.nan, np.inf])
def test_senseless_steps_are_refused(dt, sim, start):
    u = np.zeros(len(sim.inputs))
    with pytest.raises(SimulationError, match=r"step must be finite and not negative"):
        start(sim, **FLIGHT).step(0.0, dt, u, u)


def test_steps_outside_the_tables_are_counted_per_axis_and_side(make_aircraft, make_tree, start):
    content = {
        "CL/a": make_term([0.0, 1.0], {"alpha": [0.2, 0.4]}),
        "CD/b": make_term([0.1, 0.1], {"mach": [0.0, 0.05]}),
    }
    sim = flightmech.compile(make_aircraft(engines=()), make_tree(content))
    u = np.zeros(len(sim.inputs))
    run = start(sim, init__V=100.0, init__h=1000.0, mode__step=0.01)
    run.step(0.0, 0.1, u, u)
    below, above = run.out_of_range()
    counts = dict(zip(sim.axes, zip(below.tolist(), above.tolist()), strict=True))
    assert counts == {"alpha": (10.0, 0.0), "mach": (0.0, 10.0)}
    assert run.outputs()[sim.outputs.index("out_of_range")] == 20.0


def test_a_table_that_no_step_looks_up_is_not_left(make_aircraft, make_tree, start):
    """Hinge moments are looked up for the outputs alone when the surfaces are driven."""
    content = {
        "CL/a": make_term([0.0, 1.0], {"alpha": [-0.2, 0.4]}),
        "Ch_e/b": make_term([0.1, 0.2], {"alpha": [-0.3, 0.3]}),
    }
    sim = flightmech.compile(make_aircraft(engines=()), make_tree(content))
    u = np.zeros(len(sim.inputs))
    run = start(sim, init__V=100.0, init__h=1000.0, mode__step=0.01)
    run.step(0.0, 0.1, u, u)
    np.testing.assert_array_equal(run.out_of_range(), 0.0)


def test_two_simulations_of_one_model_are_independent(sim, start):
    u = np.zeros(len(sim.inputs))
    a, b = start(sim, **FLIGHT), start(sim, **FLIGHT | {"init__V": 120.0})
    alone = start(sim, **FLIGHT)
    for i in range(10):
        a.step(0.1 * i, 0.1, u, u)
        b.step(0.1 * i, 0.1, u, u)
        alone.step(0.1 * i, 0.1, u, u)
    assert (a.state == alone.state).all()
    assert not (a.state == b.state).all()


@pytest.mark.parametrize("threads", [2, 7])
def test_the_number_of_threads_does_not_change_a_bit(threads, sim, start):
    """One model, a simulation of its own for every run; ctypes lets the runs go on at the same
    time.
    """
    time = np.arange(0.0, 2.0, 0.02)

    def fly(speed: float) -> np.ndarray:
        return start(sim, **FLIGHT | {"init__V": speed}).run(
            time, inputs_over(sim, time, np.zeros(len(sim.inputs))), hold=False
        )

    speeds = np.linspace(80.0, 130.0, 24)
    with ThreadPoolExecutor(threads) as pool:
        found = list(pool.map(fly, speeds))
    assert all((y == fly(speed)).all() for y, speed in zip(found, speeds, strict=True))


def test_a_thousand_simulations_of_one_model(sim, start):
    u = np.zeros(len(sim.inputs))
    runs = [start(sim, init__V=60.0 + 0.1 * i) for i in range(1000)]
    for run in runs:
        run.step(0.0, 0.02, u, u)
    for i in (0, 499, 999):
        alone = start(sim, init__V=60.0 + 0.1 * i)
        alone.step(0.0, 0.02, u, u)
        assert (alone.state == runs[i].state).all()


def test_a_step_of_no_length_hides_no_failed_trim(sim):
    """A trim in a wind that no flight survives leaves a state without numbers; no step makes a good
    one of it.
    """
    run = Simulation(sim.model)
    run.initialize()
    u = np.zeros(len(sim.inputs))
    u[[sim.inputs.index("wind_e"), sim.inputs.index("wind_d")]] = 1e300, -1e300
    run.set_inputs(u)
    with pytest.raises(SimulationError, match="not finite"):
        run.trim(1)
    assert not np.isfinite(run.state).all()
    with pytest.raises(SimulationError, match="is not finite"):
        run.step(0.0, 0.0, np.zeros_like(u), np.zeros_like(u))
    run.set_inputs(np.zeros_like(u))
    run.initialize()
    run.step(0.0, 0.0, np.zeros_like(u), np.zeros_like(u))
    assert np.isfinite(run.state).all()

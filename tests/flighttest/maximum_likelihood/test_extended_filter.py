"""The extended Kalman filter along a flight: on a linear system it is the steady filter."""

from __future__ import annotations

import numpy as np
import pytest
import scipy
import xarray as xr

import flightmech
from flightmech.simulation.run import constant_inputs
from flightmech.terms import make_term
from flighttest.maximum_likelihood import DrydenGust, linear_model
from flighttest.maximum_likelihood.linear.gust_states import add_gusts
from flighttest.maximum_likelihood.linear.riccati import solve_each
from flighttest.maximum_likelihood.linear.state_space import (
    filter_innovations,
    make_predictor,
    pick_values,
    steady_filter,
)
from flighttest.maximum_likelihood.nonlinear.extended_filter import FilterSettings, filter_flights
from flighttest.maximum_likelihood.nonlinear.kernel_flights import (
    COORDINATES,
    KernelFlights,
    StepSlopes,
)
from flighttest.maximum_likelihood.nonlinear.linearised_flights import LinearisedFlights

A = np.array([[-1.2, 0.98], [-6.0, -1.8]])
B = np.array([[-0.1], [-9.0]])
C = np.array([[1.0, 0.0], [0.0, 1.0], [7.3, 0.0]])
OUTPUTS, NOISE, STEP, SPEED = ("alpha", "q", "nz"), np.array([2e-3, 2e-3, 0.02]), 0.04, 100.0
PROCESS = {"process.alpha": 0.02, "process.q": 0.03}


def readings(seed=1, count=400):
    """Return an elevator input and readings that have nothing in common with the model."""
    rng = np.random.default_rng(seed)
    t = STEP * np.arange(count)
    u = 0.03 * np.sign(np.sin(1.7 * t)) + 0.01 * np.sin(5.0 * t)
    z = np.cumsum(rng.standard_normal((count, 3)), axis=0) * NOISE
    return t, u[:, None], z


def short_period():
    names = {
        "state": ["alpha", "q"],
        "state_": ["alpha", "q"],
        "input": ["delta_e"],
        "output": list(OUTPUTS),
    }
    blocks = {
        "A": (("state", "state_"), A),
        "B": (("state", "input"), B),
        "C": (("output", "state_"), C),
        "D": (("output", "input"), np.zeros((3, 1))),
    }
    return linear_model(xr.Dataset(blocks, names))


def linear_filter(model, values, u, z):
    """Return innovations and variance of the linear filter error."""
    steady = steady_filter(
        model.at(values),
        drift=np.zeros(len(model.states)),
        intensity=pick_values(values, "process", model.states),
        noise=NOISE,
        step=STEP,
    )
    start = pick_values(values, "init", model.states)
    run = make_predictor(steady, start, offset=np.zeros(3))
    return filter_innovations(run, u, z), steady.S


def open_loop(u):
    """Return outputs of the linear system without noise, exact for linear inputs."""
    system = scipy.signal.StateSpace(A, B, C, np.zeros((3, 1)))
    _, y, _ = scipy.signal.lsim(system, u, STEP * np.arange(len(u)))
    return y


def settings(process, gust=None, values=None):
    gusts = 0 if gust is None else 1
    intensity = np.zeros((1, 2 + 2 * gusts))
    intensity[0, :2] = [process.get(f"process.{name}", 0.0) for name in ("alpha", "q")]
    lags, time = np.zeros((1, gusts, 2)), np.ones((1, gusts))
    if gust is not None:
        lead, lag = gust.states
        intensity[0, 2] = values[f"process.{lead}"]
        lags[0, 0] = values[f"init.{lead}"], values[f"init.{lag}"]
        time[0, 0] = gust.scale / gust.speed
    return FilterSettings(
        intensity=intensity,
        noise=NOISE[None],
        factor=np.ones((1, 3)),
        offset=np.zeros((1, 3)),
        lags=lags,
        time=time,
        speed=np.full(gusts, SPEED),
    )


def linear_slopes(seen):
    """Return the linear model; a gust [m/s] is an angle, which the outputs of `seen` show."""
    paired = np.zeros((4, 4))
    paired[:2, :2], paired[:2, 2], paired[2, 3] = A, A[:, 0] / SPEED, 1.0 / STEP
    step = scipy.linalg.expm(paired * STEP)
    felt = np.array(seen) * C[:, 0] / SPEED
    return StepSlopes(
        F=step[None, :2, :2],
        F_gust=step[None, :2, 2:3],
        F_rise=step[None, :2, 3:4],
        H=C[None],
        H_gust=felt[None, :, None],
    )


def test_it_is_the_linear_filter_with_white_noise():
    _, u, z = readings()
    calm = {"F_gust": np.zeros((1, 2, 0)), "F_rise": np.zeros((1, 2, 0))}
    model = linear_slopes((1, 1, 1))._replace(H_gust=np.zeros((1, 3, 0)), **calm)
    flights = LinearisedFlights([model], 12, open_loop(u)[None])
    e, S = filter_flights(flights, z, settings(PROCESS), STEP)
    expected, variance = linear_filter(short_period(), PROCESS, u, z)
    np.testing.assert_allclose(e[0], expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(S[0], np.broadcast_to(variance, S[0].shape), rtol=1e-9)


@pytest.mark.parametrize("inertial", [(), ("alpha",)])
def test_it_is_the_linear_filter_in_gusts(inertial):
    _, u, z = readings(2)
    seen = tuple(name for name in ("alpha", "nz") if name not in inertial)
    gust = DrydenGust("alpha", SPEED, 150.0, 1.0, air_relative=seen, inertial=inertial)
    values = {**PROCESS, "init.gust_w": 0.7}
    values |= gust.filter_values(values)
    expected, variance = linear_filter(add_gusts(short_period(), [gust]), values, u, z)
    model = linear_slopes([float(name in seen) for name in OUTPUTS])
    flights = LinearisedFlights([model], 12, open_loop(u)[None])
    e, S = filter_flights(flights, z, settings(PROCESS, gust, values), STEP)
    # The line nearest to a gust along a step leaves 5e-10 and 2e-8 of the innovations; a line
    # between its ends leaves (step/T)^2 / 12 = 6e-5.
    np.testing.assert_allclose(e[0], expected, rtol=0.0, atol=1e-7 * np.abs(expected).max())
    np.testing.assert_allclose(S[0], np.broadcast_to(variance, S[0].shape), rtol=1e-7)


def test_a_missing_reading_is_no_reading():
    _, u, z = readings(3, count=60)
    calm = {"F_gust": np.zeros((1, 2, 0)), "F_rise": np.zeros((1, 2, 0))}
    model = linear_slopes((1, 1, 1))._replace(H_gust=np.zeros((1, 3, 0)), **calm)
    gaps = z.copy()
    gaps[20:30, 2] = np.nan
    y = open_loop(u)[None]
    e, S = filter_flights(LinearisedFlights([model], 12, y), gaps, settings(PROCESS), STEP)
    assert (e[0, 20:30, 2] == 0.0).all()
    np.testing.assert_array_equal(S[0, 20:30, 2], np.tile([0.0, 0.0, 1.0], (10, 1)))
    # Until the gap the filter is the same, and in it without the accelerometer it is another one.
    full, _ = filter_flights(LinearisedFlights([model], 12, y), z, settings(PROCESS), STEP)
    np.testing.assert_allclose(e[0, :21, :2], full[0, :21, :2], rtol=1e-12)
    assert np.abs(e[0, 21:30, :2] - full[0, 21:30, :2]).max() > 1e-4


def test_one_singular_filter_does_not_end_the_others():
    A = np.stack([np.eye(2), np.zeros((2, 2)), 2.0 * np.eye(2)])
    found = solve_each(A, np.ones((3, 2, 1)))
    np.testing.assert_array_equal(found[:, 0, 0], [1.0, np.nan, 0.5])


ALPHA = np.linspace(-0.2, 0.4, 4)
FIXED = {
    "mode.earth": 0.0,
    "mode.step": STEP,
    "init.V": 60.0,
    "init.h": 1000.0,
    "init.alpha": 0.03,
    "init.beta": 0.02,
    "init.phi": 0.3,
    "init.theta": 0.1,
    "init.psi": 1.2,
    "init.q": 0.05,
}


@pytest.fixture(scope="module")
def glider():
    leaves = {
        "/CL/basic": make_term(0.3 + 5.0 * ALPHA, {"alpha": ALPHA}),
        "/CD/basic": make_term(0.02 + 0.9 * ALPHA**2, {"alpha": ALPHA}),
        "/CY/beta": make_term(-0.6, regressors=["beta"]),
        "/Cl/beta": make_term(-0.08, regressors=["beta"]),
        "/Cl/phat": make_term(-0.45, regressors=["phat"]),
        "/Cm/basic": make_term(0.03 - 0.9 * ALPHA, {"alpha": ALPHA}),
        "/Cm/qhat": make_term(-14.0, regressors=["qhat"]),
        "/Cm/delta_e": make_term(-1.2, regressors=["delta_e"]),
        "/Cn/beta": make_term(0.09, regressors=["beta"]),
        "/Cn/rhat": make_term(-0.14, regressors=["rhat"]),
    }
    craft = flightmech.Aircraft("glider", 16.0, 1.5, 10.0, 900.0, 2000.0, 2500.0, 4000.0)
    return flightmech.compile(craft, xr.DataTree.from_dict(leaves))


def start_flight(sim, fixed, coordinates=COORDINATES, axes=(), count=5, wind=()):
    u = np.tile(constant_inputs(sim, dict(wind)), (count, 1))
    flights = KernelFlights(
        sim,
        STEP * np.arange(count),
        u,
        ["V", "alpha", "q", "az"],
        inertial=["alpha"] if axes else [],
        coordinates=coordinates,
        axes=axes,
    )
    flights.start([], np.zeros((1, 0)), fixed)
    return flights


@pytest.mark.parametrize("earth", [0.0, 1.0])
def test_a_correction_moves_the_coordinates_and_nothing_else(glider, earth):
    flights = start_flight(
        glider, FIXED | {"mode.earth": earth}, wind={"wind_n": 5.0, "wind_e": -7.0}
    )
    before, _ = flights.look(0, np.zeros((1, 0)))
    changes = 1e-5 * np.array([[3e4, 1, -2, 3, -1, 2, 4, -3, 2, 1e5]])
    flights.correct(changes, before)
    after, _ = flights.look(0, np.zeros((1, 0)))
    # The order of turns matters in the second order of the angles, 1e-9.
    np.testing.assert_allclose(after - before, changes, rtol=1e-6, atol=3e-9)


def test_a_gust_reaches_vanes_and_forces_but_not_the_motion(glider):
    flights = start_flight(glider, FIXED | {"init.beta": 0.0}, axes=(2,))
    calm, y = flights.look(0, np.zeros((1, 1)))
    moved, with_gust = flights.look(0, np.array([[1.0]]))
    np.testing.assert_array_equal(moved, calm)
    assert with_gust[0, 1] == y[0, 1]  # the angle is inertial
    # The force changes by the lift slope of 5 + 0.02 of the table and the drag.
    qbar_S_over_m = 0.5 * 1.1116 * 60.0**2 * 16.0 / 900.0
    change = -qbar_S_over_m * 5.0 / 60.0
    assert with_gust[0, 3] - y[0, 3] == pytest.approx(change, rel=0.06)


def test_a_gust_from_the_right_reaches_the_vane_of_the_sideslip(glider):
    """Positive along the y axis of the aircraft relative to the air, as the angle of sideslip."""
    level = FIXED | {"init.beta": 0.0, "init.phi": 0.0, "init.q": 0.0}
    u = np.tile(constant_inputs(glider, {}), (3, 1))
    flights = KernelFlights(
        glider,
        STEP * np.arange(3),
        u,
        ["beta", "ay", "p"],
        inertial=[],
        coordinates=("beta", "phi", "p", "r"),
        axes=(1,),
    )
    flights.start([], np.zeros((1, 0)), level)
    coordinates, y = flights.look(0, np.array([[1.0]]))
    assert y[0, 0] == pytest.approx(np.arctan(1.0 / 60.0), rel=1e-3)
    # CY of beta -0.6
    force = 0.5 * 1.1116 * 60.0**2 * 16.0 / 900.0 * -0.6 * y[0, 0]
    assert y[0, 1] == pytest.approx(force, rel=0.01)
    slopes = flights.linearise(0, np.zeros((1, 1)), coordinates)
    # Cl of beta -0.08: roll acceleration over one step
    push = 0.5 * 1.1116 * 60.0**2 * 16.0 * 10.0 / 2000.0 * -0.08 / 60.0 * STEP
    assert slopes.F_gust[0, 2, 0] == pytest.approx(push, rel=0.15)


def test_slopes_are_those_of_the_linear_model(glider):
    level = FIXED | {"init.beta": 0.0, "init.phi": 0.0, "init.q": 0.0}
    chosen = ("V", "alpha", "theta", "q")
    flights = start_flight(glider, level, chosen, axes=(2,))
    calm = np.zeros((1, 1))
    coordinates, _ = flights.look(0, calm)
    slopes = flights.linearise(0, calm, coordinates)
    # A deviation of the start is a deviation of the simulation.
    for column, (name, width) in enumerate(zip(chosen, (0.1, 1e-3, 1e-3, 1e-3))):
        ends = []
        for sign in (1.0, -1.0):
            moved = level | {f"init.{name}": coordinates[0, COORDINATES.index(name)] + sign * width}
            one = xr.Dataset(coords={"time": [0.0, STEP]})
            y = flightmech.simulate(glider, one, moved, outputs=list(chosen), step=STEP)
            ends.append(np.array([float(y[item][1]) for item in chosen]))
        expected = (ends[0] - ends[1]) / (2.0 * width)
        np.testing.assert_allclose(slopes.F[0, :, column], expected, rtol=1e-4, atol=1e-5)


def test_small_deviations_of_the_simulation_are_those_of_a_linear_system(glider):
    count, chosen = 40, ("V", "alpha", "theta", "q")
    level = FIXED | {"init.beta": 0.0, "init.phi": 0.0, "init.q": 0.0}
    free = start_flight(glider, level, chosen, count=count)
    models, y, none = [], [], np.zeros((1, 0))
    for sample in range(count):
        coordinates, found = free.look(sample, none)
        y.append(found[0])
        if sample + 1 < count:
            models.append(free.linearise(sample, none, coordinates))
            free.advance(sample, none, none, coordinates)
    noise = np.array([0.1, 2e-3, 1e-3, 0.1])
    small = 1e-4 * noise * np.random.default_rng(4).standard_normal((count, 4))
    given = FilterSettings(
        intensity=np.array([[0.0, 0.01, 0.0, 0.02]]),
        noise=noise[None],
        factor=np.ones((1, 4)),
        offset=np.zeros((1, 4)),
        lags=np.zeros((1, 0, 2)),
        time=np.ones((1, 0)),
        speed=np.zeros(0),
    )
    z = np.array(y) + small
    again = start_flight(glider, level, chosen, count=count)
    e, S = filter_flights(again, z, given, STEP)
    linear = LinearisedFlights(models, 1, np.array(y)[None])
    expected, variance = filter_flights(linear, z, given, STEP)
    # Differences as wide as the uncertainty of a state average the curvature of the tables.
    difference = np.abs(e - expected).max(axis=(0, 1)) / np.abs(expected).max(axis=(0, 1))
    assert (difference < 3e-3).all()
    np.testing.assert_allclose(S, variance, rtol=1e-5)

"""The derivative against its NumPy counterpart; conservation laws; coordinates."""

from __future__ import annotations

import numpy as np
import pytest

import flightmech
from flightmech import axes
from flightmech.terms import make_term


def random_states(run, rng, n: int):
    """States around the one at the start: any attitude, rates, speed and thrust."""
    x0 = run.state
    for _ in range(n):
        x = x0.copy()
        x[:3] += rng.normal(0.0, 300.0, 3)
        x[3:6] += rng.normal(0.0, 15.0, 3)
        x[6:10] = rng.normal(size=4)
        x[6:10] *= rng.uniform(0.999, 1.001) / np.linalg.norm(x[6:10])
        x[10:13] = rng.normal(0.0, 0.5, 3)
        x[13:] = rng.uniform(300.0, 4500.0, len(x) - 13)
        yield x


@pytest.mark.nightly
@pytest.mark.parametrize("earth", [0, 1])
def test_derivative_agrees_with_the_counterpart(
    earth, sim, content, counterpart, start, make_aircraft
):
    rng = np.random.default_rng(earth)
    numpy_counterpart = counterpart(make_aircraft(), content, earth)
    place = {
        "init__lat": 0.9,
        "init__lon": -1.3,
        "init__h": 2500.0,
        "init__V": 120.0,
        "mode__earth": float(earth),
    }
    run = start(sim, **place)
    for x in random_states(run, rng, 12):
        u = {name: rng.uniform(-0.2, 0.3) for name in sim.inputs}
        u |= {
            "wind_n": 8.0,
            "wind_e": -5.0,
            "wind_d": 1.5,
            "gear": 0.7,
            "engine1.throttle": 0.8,
            "engine2.throttle": 0.3,
        }
        found = run.derivative(x, np.array([u[name] for name in sim.inputs]))
        expected = numpy_counterpart.derivative(x, u)
        # 1e-9: heights of 6.4e6 m are known to 1e-9 relative to their own rounding, Bowring's
        # closed form to 3e-9 m
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-10 * np.abs(expected).max())


def test_air_of_the_kernel_is_that_of_the_air_module(sim, start):
    from flightmech import air

    for h, delta_T, qnh in (
        (-300.0, 0.0, 101325.0),
        (5000.0, 20.0, 99000.0),
        (14000.0, -15.0, 101325.0),
        (25000.0, 0.0, 103000.0),
    ):
        for V in (50.0, 200.0, 700.0):
            run = start(sim, init__h=h, init__V=V, env__delta_T=delta_T, env__qnh=qnh)
            y = dict(zip(sim.outputs, run.outputs(), strict=True))
            here = air.atmosphere(y["h"], delta_T, qnh)
            np.testing.assert_allclose(
                [y["temperature"], y["p_static"], y["rho"]], here[:3], rtol=1e-13
            )
            assert y["mach"] == pytest.approx(V / float(here.a_sound), rel=1e-13)
            assert y["V_cas"] == pytest.approx(
                float(air.calibrated_airspeed(air.impact_pressure(y["mach"], y["p_static"]))),
                rel=1e-12,
            )


@pytest.mark.parametrize("earth", [0.0, 1.0])
def test_outputs_give_back_the_initial_condition(earth, sim, flown):
    given = {
        "V": 130.0,
        "alpha": 0.07,
        "beta": -0.05,
        "phi": 0.4,
        "theta": -0.2,
        "psi": 2.5,
        "p": 0.1,
        "q": -0.2,
        "r": 0.05,
    }
    given |= {"h": 4000.0, "lat": -0.6, "lon": 2.9}
    y = flown(
        sim,
        mode__earth=earth,
        wind_n=12.0,
        wind_e=3.0,
        wind_d=-1.0,
        **{f"init__{name}": value for name, value in given.items()},
    )
    found = {name: y[name] for name in given}
    assert found == pytest.approx(given, rel=1e-12, abs=1e-9)  # height: rounding of 6.4e6 m
    air_relative = axes.matrix_from_euler(0.4, -0.2, 2.5).T @ np.array([y["u"], y["v"], y["w"]])
    np.testing.assert_allclose(
        [y["vn"], y["ve"], y["vd"]], air_relative + [12.0, 3.0, -1.0], rtol=1e-10, atol=1e-9
    )
    assert y["hdot"] == -y["vd"]


def empty(make_aircraft, make_tree, **changes) -> flightmech.SimModel:
    """A body without aerodynamics."""
    return flightmech.compile(
        make_aircraft(engines=(), **changes), make_tree({"CD/basic": make_term(0.0)})
    )


def test_rotational_energy_and_momentum_of_a_tumbling_body(make_aircraft, make_tree, start):
    from flightmech.aircraft.aircraft import inertia_tensor

    sim = empty(make_aircraft, make_tree)
    run = start(
        sim, init__p=0.3, init__q=-0.8, init__r=0.5, init__V=10.0, init__h=9000.0, mode__step=0.005
    )
    J, u = inertia_tensor(make_aircraft()), np.zeros(len(sim.inputs))
    x = np.array([run.state] + [(run.step(0.1 * i, 0.1, u, u), run.state)[1] for i in range(300)])
    w = x[:, 10:13]
    energy = np.einsum("ti,ij,tj->t", w, J, w)
    momentum = np.linalg.norm(w @ J, axis=1)
    assert np.ptp(energy) < 1e-10 * energy[0]  # RK4 at 5 ms, half a radian per second, 30 s
    assert np.ptp(momentum) < 1e-10 * momentum[0]
    assert (
        np.abs(np.linalg.norm(x[:, 6:10], axis=1) - 1.0).max() < 2e-11
    )  # where truncation and the pull towards 1 balance


def test_energy_in_the_rotating_frame_is_conserved(make_aircraft, make_tree, start):
    """Without air, v^2/2 + U - (omega s)^2/2 is constant over the ellipsoid; U from the J2
    field.
    """
    sim = empty(make_aircraft, make_tree)
    run = start(
        sim,
        init__V=300.0,
        init__theta=0.9,
        init__alpha=0.0,
        init__psi=0.8,
        init__lat=0.7,
        init__h=30000.0,
    )
    u = np.zeros(len(sim.inputs))

    def energy(x: np.ndarray) -> float:
        r, v = x[:3], x[3:6]
        n = np.linalg.norm(r)
        mu, J2, a, W = 3.986004418e14, 0.00108262982, 6378137.0, 7.292115e-5
        U = -mu / n * (1.0 - J2 * (a / n) ** 2 * (1.5 * (r[2] / n) ** 2 - 0.5))
        return 0.5 * v @ v + U - 0.5 * W**2 * (r[0] ** 2 + r[1] ** 2)

    start_energy = energy(run.state)
    run.step(0.0, 60.0, u, u)
    assert (
        abs(energy(run.state) - start_energy) < 1e-6
    )  # of 6e7 J/kg: rounding of 1e-15 times 6000 steps
    assert abs(run.outputs()[sim.outputs.index("h")] - 30000.0) > 1000.0


def test_flat_earth_parabola(make_aircraft, make_tree, start):
    sim = empty(make_aircraft, make_tree)
    run = start(sim, mode__earth=0.0, init__V=50.0, init__theta=0.6, init__h=100.0)
    u = np.zeros(len(sim.inputs))
    run.step(0.0, 2.0, u, u)
    y = dict(zip(sim.outputs, run.outputs(), strict=True))
    assert y["h"] == pytest.approx(
        100.0 + 50.0 * np.sin(0.6) * 2.0 - 0.5 * 9.80665 * 4.0, abs=1e-10
    )
    assert y["vn"] == pytest.approx(50.0 * np.cos(0.6), abs=1e-12)


def test_euler_angles_pass_the_vertical(make_aircraft, make_tree, start):
    """A looping body: theta stays inside 90 degrees, phi and psi jump by 180, nothing else
    happens.
    """
    sim = empty(make_aircraft, make_tree, Ixy=0.0, Ixz=0.0, Iyz=0.0)
    run = start(sim, mode__earth=0.0, init__q=1.0, init__V=0.0)
    u = np.zeros(len(sim.inputs))
    for i in range(50):
        run.step(0.1 * i, 0.1, u, u)
        y = dict(zip(sim.outputs, run.outputs(), strict=True))
        turned = 0.1 * (i + 1)
        assert np.sin(y["theta"]) == pytest.approx(np.sin(turned), abs=1e-9)
        assert np.cos(y["theta"]) * np.cos(y["psi"]) == pytest.approx(np.cos(turned), abs=1e-9)


def test_over_the_pole_and_the_date_line(make_aircraft, make_tree, start):
    """Straight flight across the pole: no jump in position or speed, latitude turns, longitude
    changes by 180 degrees.
    """
    sim = empty(make_aircraft, make_tree)
    run = start(
        sim, init__lat=np.pi / 2 - 1e-4, init__lon=np.pi - 1e-9, init__V=400.0, init__h=20000.0
    )
    u = np.zeros(len(sim.inputs))
    rows = [run.outputs()]
    for i in range(40):
        run.step(0.1 * i, 0.1, u, u)
        rows.append(run.outputs())
    y = dict(zip(sim.outputs, np.array(rows).T, strict=True))
    assert np.isfinite(np.array(rows)).all()
    assert np.abs(np.diff(y["h"])).max() < 5.0
    assert np.argmax(y["lat"]) not in (0, 40)
    assert abs(y["lon"][0]) == pytest.approx(np.pi, abs=1e-6)
    assert abs(y["lon"][-1]) < 0.1  # not 0: the Earth turns below the path


def test_at_the_pole_itself(make_aircraft, make_tree, flown):
    y = flown(empty(make_aircraft, make_tree), init__lat=np.pi / 2, init__V=100.0, init__h=1000.0)
    assert np.isfinite(list(y.values())).all()
    assert (y["lat"], y["h"]) == (
        pytest.approx(np.pi / 2, abs=1e-12),
        pytest.approx(1000.0, abs=1e-8),
    )


def test_products_of_inertia_couple_the_axes(make_aircraft, make_tree, flown):
    craft = {"engines": (), "cg": (0.0, 0.0, 0.0), "Ixy": 0.0, "Iyz": 0.0, "Ixz": 900.0}
    sim = flightmech.compile(make_aircraft(**craft), make_tree({"Cl/basic": make_term(0.01)}))
    y = flown(sim, init__V=100.0)
    roll = 0.01 * y["qbar"] * 17.0 * 10.3
    det = 10800.0 * 15100.0 - 900.0**2
    assert (y["p_dot"], y["r_dot"]) == pytest.approx(
        (15100.0 * roll / det, 900.0 * roll / det), rel=1e-12
    )


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"mass__mass": -1.0}, "mass.mass is -1; it must be positive"),
        ({"mass__Ixz": 1e6}, "positive definite inertia"),
        ({"mode__earth": 4.0}, "mode.earth is 4; it must be 0 .flat., 1 .WGS-84."),
        ({"env__qnh": float("nan")}, "env.qnh is -?nan; it must be finite"),
        ({"mode__step": 0.0}, "mode.step is 0; it must be at least 1e-6 s"),
        ({"delta_e": float("inf")}, "delta_e is inf; it must be finite"),
    ],
)
def test_senseless_parameters_are_refused(values, text, sim, start):
    with pytest.raises(flightmech.errors.SimulationError, match=text):
        start(sim, **values)

"""Terms, force axes, the implicit triple and the moment transfer."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech import axes, terms
from flightmech.simulation.kernel import Simulation
from flightmech.terms import make_term


def random_variables(
    sim: flightmech.SimModel, n: int = 400
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Model variables that leave the tables now and then."""
    rng = np.random.default_rng(11)
    spread = {
        "engine1.thrust": 4000.0,
        "h": 9000.0,
        "h_agl": 20.0,
        "mach": 0.9,
        "gear": 1.2,
        "engine1.throttle": 1.1,
        "engine2.throttle": 1.1,
    }
    columns = {
        name: rng.uniform(-0.1 if name in spread else -1.0, 1.0, n) * spread.get(name, 0.5)
        for name in sim.variables
    }
    return np.stack([columns[name] for name in sim.variables], axis=1), columns


def test_every_term_agrees_with_numpy(sim, content):
    v, columns = random_variables(sim)
    _, found = Simulation(sim.model).evaluate(v)
    for name, leaf in content.items():
        expected = terms.evaluate_term(leaf, columns, outside="clamp")
        scale = np.abs(expected).max()
        np.testing.assert_allclose(
            found[:, sim.terms.index(name)], expected, rtol=0.0, atol=1e-13 * scale, err_msg=name
        )


def test_coefficients_are_the_sums_of_their_terms(sim):
    v, _ = random_variables(sim)
    coefficients, contributions = Simulation(sim.model).evaluate(v)
    for i, coefficient in enumerate(("CL", "CD", "CY", "Cl", "Cm", "Cn")):
        own = [k for k, name in enumerate(sim.terms) if name.startswith(coefficient + "/")]
        np.testing.assert_allclose(
            coefficients[:, i], contributions[:, own].sum(axis=1), rtol=1e-13, atol=1e-15
        )


def test_scale_of_a_term(sim):
    v, _ = random_variables(sim, 5)
    run = Simulation(sim.model)
    before = run.evaluate(v)[1][:, sim.terms.index("Cm/qhat")]
    run.set_parameter(sim.parameters.index("term.Cm.qhat"), -2.0)
    assert (run.evaluate(v)[1][:, sim.terms.index("Cm/qhat")] == -2.0 * before).all()


@pytest.mark.parametrize("force_axes", ["stability", "wind", "body"])
def test_the_same_force_in_three_axes(force_axes, make_aircraft, make_tree, flown):
    CL, CD, CY, alpha, beta = 0.7, 0.06, -0.11, 0.2, 0.15
    # body components of the force of CL, CD (stability) and CY (body)
    CX, _, CZ = axes.stability_to_body([-CD, 0.0, -CL], alpha)
    to_wind = np.array([[np.cos(beta), np.sin(beta)], [-np.sin(beta), np.cos(beta)]])
    x_wind, y_wind = to_wind @ [-CD, CY]
    values = {
        "stability": {"CL": CL, "CD": CD, "CY": CY},
        "wind": {"CL": CL, "CD": -x_wind, "CY": y_wind},
        "body": {"CX": float(CX), "CZ": float(CZ), "CY": CY},
    }[force_axes]
    db = make_tree(
        {f"{name}/basic": make_term(value) for name, value in values.items()}, force_axes=force_axes
    )
    sim = flightmech.compile(make_aircraft(engines=(), cg=(0.0, 0.0, 0.0)), db)
    y = flown(sim, init__alpha=alpha, init__beta=beta, init__V=90.0)
    np.testing.assert_allclose([y["CL"], y["CD"], y["CY"]], [CL, CD, CY], rtol=1e-13)
    force = np.array([y["ax"], y["ay"], y["az"]]) * 2300.0
    np.testing.assert_allclose(force, y["qbar"] * 17.0 * np.array([CX, CY, CZ]), rtol=1e-12)


def test_moment_is_taken_to_the_centre_of_gravity(make_aircraft, make_tree, flown):
    """Lift at the reference point with the c.g. 0.1 m behind it pitches the nose up: q' = L x /
    Iyy.
    """
    sim = flightmech.compile(
        make_aircraft(engines=(), cg=(-0.1, 0.0, 0.0), Ixy=0.0, Ixz=0.0, Iyz=0.0),
        make_tree({"CL/basic": make_term(0.5)}),
    )
    y = flown(sim, init__V=80.0, mode__earth=0.0)
    assert y["q_dot"] == pytest.approx(0.5 * y["qbar"] * 17.0 * 0.1 / 8100.0, rel=1e-13)
    assert y["Cm"] == 0.0


def test_implicit_variables_fulfil_their_own_equations(sim, flown):
    y = flown(
        sim,
        init__V=110.0,
        init__alpha=0.05,
        init__beta=0.08,
        init__q=0.2,
        delta_e=-0.1,
        init__h=2000.0,
    )
    known = {
        "alphadothat": y["alpha_dot"] * 1.67 / (2 * y["V"]),
        "betadothat": y["beta_dot"] * 10.3 / (2 * y["V"]),
        "dnz": y["nz"] - 1.0,
        "alpha": y["alpha"],
        "beta": y["beta"],
        "mach": y["mach"],
        "qhat": y["q"] * 1.67 / (2 * y["V"]),
        "delta_e": -0.1,
        "h_agl": y["h_agl"],
        "h": y["h"],
        "x_cg": 0.25 - 0.06 / 1.67,
        "engine1.thrust": y["engine1.thrust"],
    }
    coefficients, _ = Simulation(sim.model).evaluate(
        np.array([[known.get(name, 0.0) for name in sim.variables]])
    )
    np.testing.assert_allclose(
        coefficients[0], [y[name] for name in ("CL", "CD", "CY", "Cl", "Cm", "Cn")], rtol=1e-12
    )


def test_biases_add_to_coefficients_and_controls(sim, flown):
    plain = flown(sim, init__V=100.0)
    moved = flown(sim, init__V=100.0, bias__Cn=0.01, bias__delta_e=0.02)
    assert moved["Cn"] - plain["Cn"] == pytest.approx(0.01, abs=1e-15)
    assert moved["applied.delta_e"] == 0.02
    assert moved["Cm"] - plain["Cm"] == pytest.approx(
        -1.05 * 0.02, rel=0.05
    )  # elevator term; alpha-dot moves it a little


@pytest.mark.parametrize("alpha", [np.pi / 2, -np.pi / 2, np.pi, 0.0])
def test_no_attitude_to_the_air_is_singular(alpha, sim, flown):
    for beta in (0.0, np.pi / 2, -np.pi / 2):
        y = flown(sim, init__V=30.0, init__alpha=alpha, init__beta=beta)
        assert np.isfinite(list(y.values())).all()


def test_at_rest_in_still_air_there_is_no_aerodynamic_force(sim, flown):
    y = flown(sim, init__V=0.0, mode__engine=2.0)
    assert np.isfinite(list(y.values())).all()
    assert (y["ax"], y["ay"], y["az"], y["alpha"], y["beta"]) == (0.0, 0.0, 0.0, 0.0, 0.0)


def test_drag_of_a_sphere_acts_against_the_wind_at_90_degrees(make_aircraft, make_tree, flown):
    sim = flightmech.compile(
        make_aircraft(engines=(), cg=(0.0, 0.0, 0.0)),
        make_tree({"CD/basic": make_term(0.1)}, force_axes="wind"),
    )
    for alpha, beta in ((np.pi / 2, 0.0), (0.0, np.pi / 2), (0.7, -1.1)):
        y = flown(sim, init__V=50.0, init__alpha=alpha, init__beta=beta)
        force = np.array([y["ax"], y["ay"], y["az"]]) * 2300.0
        against = -np.array([y["u"], y["v"], y["w"]]) / 50.0
        np.testing.assert_allclose(
            force, 0.1 * y["qbar"] * 17.0 * against, rtol=1e-12, atol=1e-12 * y["qbar"]
        )


def test_variables_of_the_block_are_those_the_terms_use(sim, content):
    used = set().union(*(terms.list_model_variables(leaf) for leaf in content.values()))
    assert set(sim.variables) == used | {"engine1.throttle", "engine2.throttle", "h", "mach"}
    assert isinstance(content["CL/basic"], xr.Dataset)

"""The linear model against derivatives worked out by hand, against small steps of the simulation,
and about kinks.
"""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy.linalg import expm

import flightmech
from flightmech.air import atmosphere
from flightmech.errors import SchemaError, UnknownName
from flightmech.steady_flight import linear_model as linear
from flightmech.terms import make_term
from flightmech.units import G0

V, H = 90.0, 1500.0
LEVEL = {"init.V": V, "init.h": H}
PITCH = ("V", "alpha", "q", "theta")


def by_hand(sim, craft, CLq: float = 0.0, Cm_alphadot: float = 0.0) -> np.ndarray:
    """A of V, alpha, q, theta for constant derivatives, thrust held along body x, straight level
    flight (Etkin 1972, chapter 5).
    """
    y = {
        name: float(value)
        for name, value in flightmech.trim(sim, {**LEVEL, "mode.earth": 0.0}).items()
    }
    rho, a, T = y["rho"], y["alpha"], y["engine1.thrust"]
    m, S, c, qS = craft.mass, craft.S, craft.cbar, y["qbar"] * craft.S
    CL, CD, CD_alpha = 0.25 + 5.2 * a, 0.025 + 1.4 * a**2, 2.8 * a
    A = np.zeros((4, 4))
    A[0] = [-rho * V * S * CD / m, (-T * np.sin(a) - qS * CD_alpha) / m + G0, 0.0, -G0]
    A[1, 0] = -rho * S * CL / (2 * m) + T * np.sin(a) / (m * V**2) - G0 / V**2
    A[1, 1] = -(qS * 5.2 + T * np.cos(a)) / (m * V)
    A[1, 2] = 1.0 - qS * CLq * c / (2 * V) / (m * V)
    M = qS * c / craft.Iyy
    A[2] = [0.0, -0.8 * M, -14.0 * M * c / (2 * V), 0.0]
    A[2] += M * Cm_alphadot * c / (2 * V) * A[1]
    A[3, 2] = 1.0
    return A


@pytest.mark.parametrize(("CLq", "Cm_alphadot"), [(0.0, 0.0), (6.0, 0.0), (0.0, -5.0)])
def test_longitudinal_entries_by_hand(plain, plain_aircraft, CLq, Cm_alphadot):
    changes = {"CL": {"qhat": CLq}, "Cm": {"alphadothat": Cm_alphadot}}
    sim = plain(
        **{
            name: {key: value for key, value in part.items() if value}
            for name, part in changes.items()
        }
    )
    found = linear.subset(flightmech.linearize(sim, LEVEL), "longitudinal")
    expected = by_hand(sim, plain_aircraft(), CLq, Cm_alphadot)
    assert list(found["state"].values) == list(PITCH)
    # rounding and truncation of central differences, docstring of linear.py; g over 1 rad sets the
    # scale of the first row
    np.testing.assert_allclose(found["A"], expected, rtol=1e-8, atol=1e-9)


def test_lateral_entries_by_hand(plain, plain_aircraft):
    found = linear.subset(flightmech.linearize(plain(), LEVEL), "lateral")
    craft, y = plain_aircraft(), flightmech.trim(plain(), {**LEVEL, "mode.earth": 0.0})
    qS, b = float(y["qbar"]) * craft.S, craft.b
    roll = qS * b / craft.Ixx * np.array([-0.09, -0.45 * b / (2 * V), 0.11 * b / (2 * V), 0.0])
    yaw = qS * b / craft.Izz * np.array([0.1, -0.04 * b / (2 * V), -0.13 * b / (2 * V), 0.0])
    np.testing.assert_allclose(found["A"][1], roll, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found["A"][2], yaw, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(
        found["A"].sel(state="phi"), [0.0, 1.0, np.tan(float(y["theta"])), 0.0], atol=1e-9
    )
    assert float(found["A"].sel(state="beta", state_="phi")) == pytest.approx(
        G0 * np.cos(float(y["theta"])) / V, rel=1e-8
    )
    np.testing.assert_allclose(
        found["B"].sel(state="p"), qS * b / craft.Ixx * np.array([-0.14, 0.01]), rtol=1e-8
    )
    assert found.attrs["coupling"] < 1e-9


def test_the_step_does_not_matter(plain):
    """Three decades about the derived step agree, and the error that is reported bounds the
    change.
    """
    sim = plain(CD={"alpha alpha": 1.4})
    best = flightmech.linearize(sim, LEVEL)
    for step in (1e-6, 1e-5, 1e-4):
        other = flightmech.linearize(sim, LEVEL, steps={"alpha": step, "q": step, "beta": step})
        np.testing.assert_allclose(
            other["A"], best["A"], rtol=1e-6, atol=1e-7
        )  # h^2/6 of the widest, eps/h of the narrowest
    assert float(best["A_error"].max()) < 1e-8
    assert float(np.abs(best["x_dot"]).max()) < 1e-12


def test_small_steps_of_the_simulation_follow(trainer):
    """Elevator and aileron steps of 1e-4 rad for 3 s: x = integral of expm(A t) B du; y = C x + D
    u.
    """
    earth = {"mode.earth": 0.0, "init.V": 90.0, "init.h": 3000.0}
    found = flightmech.linearize(trainer, earth, outputs=("nz", "q_dot", "ay"))
    time = np.arange(0.0, 3.0, 0.05)
    base = flightmech.simulate(
        trainer,
        xr.Dataset(coords={"time": time}),
        {**earth, "mode.trim": 2.0, "engine1.time_constant": 0.0},
    )
    for control in ("delta_e", "delta_a"):
        inputs = xr.Dataset({control: ("time", np.full(time.shape, 1e-4))}, {"time": time})
        inputs[control][0] = 0.0  # the trim is for the first sample
        moved = flightmech.simulate(
            trainer, inputs, {**earth, "mode.trim": 2.0, "engine1.time_constant": 0.0}, hold="zero"
        )
        B, n = found["B"].sel(input=control).values, found.sizes["state"]
        block = np.block([[found["A"].values, B[:, None]], [np.zeros((1, n + 1))]])
        x = np.stack([expm(block * max(t - time[1], 0.0))[:n, n] * 1e-4 for t in time])
        y = (
            x @ found["C"].values.T
            + np.where(time[:, None] > time[1], 1e-4, 0.0) * found["D"].sel(input=control).values
        )
        for k, name in enumerate(found["state"].values):
            change = (moved[str(name)] - base[str(name)]).values
            np.testing.assert_allclose(
                x[:, k], change, atol=2e-3 * np.abs(x).max(), err_msg=f"{control} {name}"
            )  # height left out, second order
        for k, name in enumerate(found["output"].values):
            change = (moved[str(name)] - base[str(name)]).values
            np.testing.assert_allclose(
                y[2:, k], change[2:], atol=5e-3 * np.abs(y).max(), err_msg=f"{control} {name}"
            )


def test_engine_states_and_inputs(trainer):
    start = {"init.V": 90.0, "init.h": 3000.0}
    found = flightmech.linearize(
        trainer, start, states=("V", "alpha", "q", "theta", "h", "engine1.thrust")
    )
    lag = found["A"].sel(state="engine1.thrust", state_="engine1.thrust")
    assert float(lag) == pytest.approx(-1.0 / 0.8, rel=1e-8)  # time constant of the trainer
    assert float(found["A"].sel(state="V", state_="engine1.thrust")) == pytest.approx(
        1.0 / 2500.0, rel=1e-2
    )  # cos alpha
    assert float(found["B"].sel(state="engine1.thrust", input="engine1.throttle")) > 0.0
    assert found["state_units"].values.tolist() == ["m s-1", "rad", "rad s-1", "rad", "m", "N"]
    held = flightmech.linearize(trainer, start)
    assert float(held["B"].sel(state="V", input="engine1.throttle")) > 1.0  # thrust follows at once
    assert float(held["u"].sel(input="engine1.throttle")) == pytest.approx(
        float(flightmech.trim(trainer, {**start, "mode.earth": 0.0})["trim.throttle"])
    )


def test_slope_on_a_breakpoint_is_the_mean_and_reported(plain):
    vee = make_term([0.02, 0.0, 0.01], {"beta": [-0.1, 0.0, 0.1]})
    found = flightmech.linearize(plain(Cn={"beta": 0.1, "vee": vee}), LEVEL)
    smooth = flightmech.linearize(plain(), LEVEL)
    assert found.attrs["kinks"] == "beta"
    assert smooth.attrs["kinks"] == ""
    change = found["A"].sel(state="r", state_="beta") / smooth["A"].sel(state="r", state_="beta")
    assert float(change) == pytest.approx((0.1 + 0.5 * (-0.2 + 0.1)) / 0.1, rel=1e-9)


def test_a_wide_step_averages_cells(plain):
    kinked = make_term([-0.05, 0.0, 0.0], {"alpha": [-0.5, 0.0, 0.5]})
    sim = plain(Cm={"kinked": kinked})
    alpha = float(flightmech.linearize(sim, LEVEL)["x"].sel(state="alpha"))
    narrow = flightmech.linearize(sim, LEVEL)["A"].sel(state="q", state_="alpha")
    wide = flightmech.linearize(sim, LEVEL, steps={"alpha": 0.2})["A"].sel(
        state="q", state_="alpha"
    )
    plainly = flightmech.linearize(plain(), LEVEL)["A"].sel(state="q", state_="alpha")
    assert alpha > 0.01
    assert float(narrow / plainly) == pytest.approx(1.0, rel=1e-3)  # the trim moves a little
    added = (
        0.05 * (0.2 - alpha) / 0.5 / 0.4 / -0.8
    )  # from alpha - 0.2 to the breakpoint the table rises by this
    assert float(wide / plainly) == pytest.approx(1.0 + added, rel=1e-3)


def test_a_flight_that_is_not_trimmed_states_its_residuals(plain):
    found = flightmech.linearize(
        plain(), {**LEVEL, "mode.trim": 0.0, "init.alpha": 0.1, "init.theta": 0.1}
    )
    assert float(abs(found["x_dot"].sel(state="V"))) > 0.1


def test_names_and_conditions_are_checked(plain):
    with pytest.raises(UnknownName, match="unknown state 'gamma'"):
        flightmech.linearize(plain(), LEVEL, states=("V", "gamma"))
    with pytest.raises(UnknownName, match="unknown input 'elevator'"):
        flightmech.linearize(plain(), LEVEL, inputs=("elevator",))
    with pytest.raises(UnknownName, match="unknown output 'nx'"):
        flightmech.linearize(plain(), LEVEL, outputs=("nx",))
    with pytest.raises(
        SchemaError,
        match=r"mode\.earth is 1; a linear model is about a steady flight over a flat Earth",
    ):
        flightmech.linearize(plain(), {**LEVEL, "mode.earth": 1.0})
    with pytest.raises(SchemaError, match=r"alpha is -0\.1; give a positive step"):
        flightmech.linearize(plain(), LEVEL, steps={"alpha": -0.1})
    with pytest.raises(ValueError, match="allowed: longitudinal, lateral"):
        linear.subset(flightmech.linearize(plain(), LEVEL), "pitch")


def test_height_follows_the_air(plain):
    """Thrust held: lift falls with density, so height feeds back on alpha."""
    found = flightmech.linearize(plain(), LEVEL, states=("V", "alpha", "q", "theta", "h"))
    rho = atmosphere(np.array([H - 50.0, H, H + 50.0])).rho
    gradient = float((rho[2] - rho[0]) / 100.0 / rho[1])
    lift = G0 / V - float(
        flightmech.trim(plain(), {**LEVEL, "mode.earth": 0.0})["engine1.thrust"]
    ) * np.sin(float(found["x"][1])) / (2400.0 * V)
    assert float(found["A"].sel(state="alpha", state_="h")) == pytest.approx(
        -gradient * lift, rel=1e-4
    )
    assert float(found["A"].sel(state="h", state_="theta")) == pytest.approx(V, rel=1e-8)

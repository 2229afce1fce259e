"""Gusts of Dryden form as states: their spectrum, who sees them, and their estimate."""

from __future__ import annotations

import numpy as np
import pytest
import scipy
import xarray as xr

from flightmech.errors import SchemaError, UnknownName
from flighttest.maximum_likelihood import DrydenGust, filter_error, linear_model
from flighttest.maximum_likelihood.linear.gust_states import add_gusts

A = np.array([[-1.2, 0.98], [-6.0, -1.8]])
B = np.array([[-0.1], [-9.0]])
C = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0], [7.3, 0.0]])
OUTPUTS = ("alpha_vane", "alpha", "q", "nz")
NOISE = np.array([2e-3, 2e-3, 2e-3, 0.02])
SPEED, SCALE, SIGMA = 100.0, 150.0, 1.5
STEP = 0.04


@pytest.fixture(scope="module")
def model():
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
        "D": (("output", "input"), np.zeros((4, 1))),
    }
    return linear_model(xr.Dataset(blocks, names))


def gust(**changes):
    given = {"state": "alpha", "speed": SPEED, "scale": SCALE, "intensity": SIGMA}
    seen = {"air_relative": ("alpha_vane", "nz"), "inertial": ("alpha",)}
    return DrydenGust(**{**given, **seen, **changes})


def test_the_spectrum_is_that_of_the_specification(model):
    """MIL-F-8785C: sigma^2 (L / pi) (1 + 3 x^2) / (1 + x^2)^2 with x = L Omega."""
    made = gust()
    whole = add_gusts(model, [made]).at({})
    intensity = made.filter_values({})["process.gust_w_lead"]
    for Omega in (1e-4, 3e-3, 1e-2, 0.05):
        jw = 1j * Omega * SPEED
        # w of unit white noise; one-sided over Omega, the density is V / pi of that over omega.
        lags = np.linalg.solve(jw * np.eye(2) - whole.A[2:, 2:], [intensity, 0.0])
        w = SPEED * (whole.C[0, 2:] / C[0, 0]) @ lags
        x = SCALE * Omega
        expected = SIGMA**2 * SCALE / np.pi * (1.0 + 3.0 * x**2) / (1.0 + x**2) ** 2
        assert abs(w) ** 2 * SPEED / np.pi == pytest.approx(expected, rel=1e-9)


def test_states_of_a_known_gust_are_expected_from_their_covariance(model):
    made = gust()
    whole = add_gusts(model, [made]).at({})
    values = made.filter_values({"init.gust_w": 2.0 / SIGMA})
    Q = np.diag([values["process.gust_w_lead"] ** 2, 0.0])
    P = scipy.linalg.solve_continuous_lyapunov(whole.A[2:, 2:], -Q)
    read = whole.C[0, 2:]
    assert read @ P @ read == pytest.approx((SIGMA / SPEED) ** 2)
    expected = P @ read / (read @ P @ read) * 2.0 / SPEED
    found = values["init.gust_w_lead"], values["init.gust_w_lag"]
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_air_moves_rates_vane_and_accelerometer_but_no_platform(model):
    whole = add_gusts(model, [gust()]).at({"A[alpha,alpha]": -1.5})
    read = whole.C[0, 2:]
    np.testing.assert_allclose(whole.A[:2, 2:], np.outer([-1.5, -6.0], read))
    np.testing.assert_allclose(whole.C[:, 2:], np.outer([1.0, 0.0, 0.0, 7.3], read))


def test_an_output_that_may_be_either_is_refused(model):
    with pytest.raises(SchemaError, match="nz responds to alpha; name it in air_relative"):
        add_gusts(model, [gust(air_relative=("alpha_vane",))])
    with pytest.raises(SchemaError, match="alpha is both air-relative and inertial"):
        add_gusts(model, [gust(air_relative=("alpha_vane", "nz", "alpha"))])
    with pytest.raises(SchemaError, match="scale of gust w is 0; give a positive value"):
        add_gusts(model, [gust(scale=0.0)])
    with pytest.raises(SchemaError, match="gusts are named w, w"):
        add_gusts(model, [gust(), gust()])
    with pytest.raises(UnknownName, match="unknown state 'beta'"):
        add_gusts(model, [gust(state="beta")])
    with pytest.raises(UnknownName, match="unknown output 'vane'"):
        add_gusts(model, [gust(air_relative=("vane", "alpha_vane", "nz"))])


def gusty_flight(seed):
    """A record by exact transitions of the whole system over a tenth of the sampling interval."""
    rng, fine = np.random.default_rng(seed), 10
    h, t = STEP / fine, np.arange(0.0, 20.0 + STEP / 2, STEP)
    u = 0.03 * np.interp(t, [1, 1.2, 2.5, 2.7, 4.2, 4.4, 6, 6.2], [0, 1, 1, -1, -1, 1, 1, 0])
    T = SCALE / SPEED
    b, a = scipy.signal.bilinear([np.sqrt(3.0 * T) * T, np.sqrt(T)], [T * T, 2.0 * T, 1.0], 1.0 / h)
    count = (len(t) - 1) * fine + 1
    n = rng.standard_normal(count + 4000) / np.sqrt(h)
    g = SIGMA / SPEED * scipy.signal.lfilter(b, a, n)[4000:]
    drive = np.interp(np.arange(count) * h, t, u)
    F = scipy.linalg.expm(A * h)
    G = np.linalg.solve(A, F - np.eye(2))
    x, states = np.zeros(2), np.empty((count, 2))
    for k in range(count):
        states[k] = x
        x = F @ x + G @ (B[:, 0] * drive[k] + A[:, 0] * g[k])
    y = states[::fine] @ C.T + np.outer(g[::fine], C[:, 0] * [1.0, 0.0, 1.0, 1.0])
    y += NOISE * rng.standard_normal(y.shape)
    columns = {name: ("time", y[:, k]) for k, name in enumerate(OUTPUTS)}
    return xr.Dataset({"delta_e": ("time", u), **columns}, {"time": t})


TRUTH = {"A[alpha,alpha]": -1.2, "A[q,alpha]": -6.0, "A[q,q]": -1.8, "B[q,delta_e]": -9.0}


@pytest.mark.nightly
def test_vane_platform_and_accelerometer_together_in_gusts(model):
    """The gust of given form is estimated with the motion; innovations are white."""
    wanted = {name: 0.85 * value for name, value in TRUTH.items()}
    wanted |= {"gust.w": 0.5, "scale.w": 400.0}
    fit = filter_error(model, gusty_flight(1), wanted, gusts=[gust()])
    assert fit.estimates.attrs["stop"] == "converged"
    e = fit.estimates.sel(parameter=[*TRUTH, "gust.w"])
    off = e["estimate"].values - [*TRUTH.values(), SIGMA]
    assert (np.abs(off) < 3.0 * e["stderr"].values).all()
    length = fit.estimates.sel(parameter="scale.w")
    assert abs(np.log(length["estimate"] / SCALE)) < 3.0 * length["stderr"] / length["estimate"]
    assert not [remark for remark in fit.remarks if remark.kind == "coloured"]


@pytest.mark.nightly
def test_white_process_noise_in_gusts_with_a_platform_is_forbidden(model):
    """Its estimates are several standard errors off, and the innovations show it."""
    record = gusty_flight(1).drop_vars("alpha_vane")
    linear = xr.Dataset(
        {
            "A": (("state", "state_"), A),
            "B": (("state", "input"), B),
            "C": (("output", "state_"), C[1:]),
            "D": (("output", "input"), np.zeros((3, 1))),
        },
        {
            "state": ["alpha", "q"],
            "state_": ["alpha", "q"],
            "input": ["delta_e"],
            "output": list(OUTPUTS[1:]),
        },
    )
    stirred = {"process.alpha": 0.01, "process.q": 0.01}
    wrong = filter_error(linear_model(linear), record, {**TRUTH, **stirred})
    severities = {r.severity for r in wrong.remarks if r.kind == "coloured"}
    assert "error" in severities
    made = gust(air_relative=("nz",))
    right = filter_error(linear_model(linear), record, {**TRUTH, "gust.w": 1.0}, gusts=[made])
    assert not [r for r in right.remarks if r.kind == "coloured"]


def test_a_positive_start_is_demanded_of_gust_and_scale(model):
    record = gusty_flight(2).isel(time=slice(0, 60))
    for name in ("gust.w", "scale.w"):
        with pytest.raises(SchemaError, match=f"{name} starts at zero or below"):
            filter_error(model, record, {**TRUTH, name: 0.0}, gusts=[gust()])
    with pytest.raises(UnknownName, match=r"unknown parameter 'gust\.v'"):
        filter_error(model, record, {**TRUTH, "gust.v": 1.0}, gusts=[gust()])


@pytest.mark.nightly
def test_a_search_that_does_not_converge_names_the_disturbance_that_suffices(model):
    record = gusty_flight(5).isel(time=slice(0, 150))
    start = {"A[q,alpha]": -6.0, "B[q,delta_e]": -9.0, "gust.w": 1.5}
    white = {"process.alpha": 0.003, "process.q": 0.003}
    fit = filter_error(model, record, start | white, gusts=[gust()], iterations=5)
    assert not fit.estimates.attrs["converged"]
    texts = [remark.text for remark in fit.remarks if remark.kind == "convergence"]
    assert len(texts) == 1
    assert texts[0].startswith("not identifiable: the records determine no disturbance besides")
    assert texts[0].endswith("choose gusts")
    # The platform does not see the gust: white noise alone is much less likely.
    assert "white process noise (process.*) alone +" in texts[0]


@pytest.mark.parametrize(
    ("states", "sign", "factor", "acted"),
    [(("alpha", "q"), -1.0, 4.0, (1,)), (("beta", "p", "r"), 1.0, 3.0, (1, 2))],
)
def test_the_rotation_of_the_air_is_that_of_the_specification(states, sign, factor, acted):
    """MIL-F-8785C 3.7.1.2: q and r gusts are (s / V) / (1 + tau s) of w and v, tau 4 b / (pi V)
    and 3 b / (pi V); they act where moments of damping do.
    """
    n, span = len(states), 12.0
    A = np.arange(1.0, n * n + 1.0).reshape(n, n) - 11.0
    names = {"state": list(states), "state_": list(states), "input": ["d"], "output": ["V"]}
    blocks = {"A": (("state", "state_"), A), "B": (("state", "input"), np.zeros((n, 1)))}
    blocks |= {"C": (("output", "state_"), np.eye(1, n)), "D": (("output", "input"), [[0.0]])}
    made = gust(state=states[0], air_relative=("V",), inertial=(), span=span)
    model = linear_model(xr.Dataset(blocks, names))
    whole = add_gusts(model, [made]).at({})
    still = add_gusts(model, [gust(state=states[0], air_relative=("V",), inertial=())]).at({})
    less = add_gusts(model, [made]).at({"turn.w": 0.4})
    assert whole.A.shape == (n + 3, n + 3)
    turned = whole.A[:n, n:] - np.pad(still.A[:n, n:], ((0, 0), (0, 1)))
    tau = factor * span / (np.pi * SPEED)
    for omega in (0.3, 3.0, 30.0):
        jw = 1j * omega
        lags = np.linalg.solve(jw * np.eye(3) - whole.A[n:, n:], [1.0, 0.0, 0.0])
        angle = whole.C[0, n:] @ lags
        expected = np.zeros(n, complex)
        expected[list(acted)] = sign * A[list(acted), -1] * jw / (1.0 + tau * jw) * angle
        np.testing.assert_allclose(turned @ lags, expected, rtol=1e-9, atol=1e-12)
        # (M_q - M_alphadot) / (M_q + M_alphadot) of the damping acts, here with a share of 0.3.
        changed = (less.A - whole.A)[:n, n:] @ lags
        np.testing.assert_allclose(changed, -0.6 * expected, rtol=1e-9, atol=1e-12)


def test_the_lag_of_the_rotation_starts_at_its_expected_value(model):
    made = gust(span=12.0)
    whole = add_gusts(model, [made]).at({"scale.w": 40.0})
    values = made.filter_values({"init.gust_w": 2.0 / SIGMA, "scale.w": 40.0})
    Q = np.diag([values["process.gust_w_lead"] ** 2, 0.0, 0.0])
    P = scipy.linalg.solve_continuous_lyapunov(whole.A[2:, 2:], -Q)
    read = whole.C[0, 2:]
    expected = P @ read / (read @ P @ read) * 2.0 / SPEED
    found = [values[f"init.{name}"] for name in (*made.states, made.turn)]
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    # A gust without rotation has no third lag, and no factor on it.
    assert "init.gust_w_turn" not in gust().filter_values({})
    with pytest.raises(UnknownName, match=r"unknown parameter 'turn\.w'"):
        filter_error(model, gusty_flight(2), {**TRUTH, "turn.w": 1.0}, gusts=[gust()])


def test_a_rotation_needs_the_rate_of_its_angle(model):
    with pytest.raises(SchemaError, match="the air rotates with alpha and q, or beta and r"):
        add_gusts(model, [gust(state="q", inertial=("alpha", "q"), span=9.0)])
    with pytest.raises(SchemaError, match="span of gust w is -1"):
        add_gusts(model, [gust(span=-1.0)])

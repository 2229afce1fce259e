"""A control law between the steps of the kernel: `flightmech.simulate_closed_loop`."""

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech import terms
from flightmech.errors import OutOfRange, UnknownName

S, CBAR, B, IXX, V = 16.0, 1.5, 10.0, 1500.0, 60.0
CLP, CLDA = -0.45, -0.15
RHO = 1.11166  # at 1000 m, kg/m3; US Standard Atmosphere 1976


@pytest.fixture(scope="module")
def sim():
    """An aircraft that rolls: damping and ailerons, no lift and no drag."""
    leaves = {"CL/basic": 0.0, "CD/basic": 0.0, "Cl/phat": CLP, "Cl/aileron": CLDA}
    words = {"Cl/phat": ["phat"], "Cl/aileron": ["delta_a"]}
    tree = {"/": xr.Dataset(attrs={"S": S, "cbar": CBAR, "b": B, "force_axes": "stability"})}
    tree |= {
        f"/{name}": terms.make_term(value, regressors=words.get(name, []))
        for name, value in leaves.items()
    }
    craft = flightmech.Aircraft("roll", S, CBAR, B, 1000.0, IXX, 2000.0, 3000.0)
    return flightmech.compile(craft, xr.DataTree.from_dict(tree))


START = {"init.V": V, "init.h": 1000.0, "mode.earth": 0.0, "init.p": 0.4}


def record(end=0.4, step=0.02, **values):
    return xr.Dataset(
        {
            name: ("time", np.broadcast_to(value, round(end / step) + 1))
            for name, value in values.items()
        }
    ).assign_coords(time=step * np.arange(round(end / step) + 1))


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_a_damper_gives_the_motion_of_the_sampled_system(sim, delay):
    """p_{k+1} = e^{aT} p_k + (e^{aT} - 1) / a b u_{k-delay} of a first-order lag under held inputs
    (Franklin, Powell, Workman).
    """
    T, K = 0.02, 0.3
    run = flightmech.simulate_closed_loop(
        sim, record(), lambda t, y, u: {"delta_a": K * y["p"]}, T, START, delay=delay
    )
    qSb = 0.5 * RHO * V**2 * S * B / IXX
    a, b = qSb * CLP * B / (2.0 * V), qSb * CLDA
    p, waiting = [0.4], [0.0] * delay
    for _ in range(run.sizes["time"] - 1):
        waiting.append(K * p[-1])
        p.append(np.exp(a * T) * p[-1] + (np.exp(a * T) - 1.0) / a * b * waiting.pop(0))
    assert run.p.values == pytest.approx(
        np.array(p), abs=1e-3 * 0.4
    )  # gravity adds 0.3 % to V in the end
    acting = run.delta_a.values
    assert acting[delay:] == pytest.approx(K * run.p.values[: len(p) - delay], rel=1e-12)
    assert not acting[:delay].any()
    assert (run.attrs["period"], run.attrs["delay"]) == (T, delay)


def test_a_law_that_passes_the_record_on_is_no_law(sim):
    random = np.random.default_rng(2)
    given = record(delta_a=random.normal(0.0, 0.02, 21), wind_e=3.0)
    plain = flightmech.simulate(sim, given, START, hold="zero")
    passed = flightmech.simulate_closed_loop(
        sim, given, lambda t, y, u: {"delta_a": u["delta_a"]}, 0.02, START, hold="zero"
    )
    for name in (
        "V",
        "alpha",
        "beta",
        "p",
        "q",
        "r",
        "phi",
        "theta",
        "psi",
        "h",
        "lat",
        "lon",
    ):  # what inputs do not change at once
        assert passed[name].values == pytest.approx(plain[name].values, rel=1e-11, abs=1e-13)
    linear = flightmech.simulate(sim, given, START)
    nothing = flightmech.simulate_closed_loop(
        sim, given, lambda t, y, u: {}, 0.007, START
    )  # a clock of its own, that moves nothing
    assert nothing.p.values == pytest.approx(
        linear.p.values, abs=3e-7
    )  # Runge-Kutta steps of 7 and of 10 ms
    assert "delta_a" not in nothing


def test_the_law_is_called_at_its_own_rate_and_held_between(sim):
    calls = []

    def law(t, y, u):
        calls.append((t, u["delta_a"]))
        return {"delta_a": 0.001 * len(calls)}

    run = flightmech.simulate_closed_loop(
        sim, record(delta_a=np.linspace(0.0, 0.4, 21)), law, 0.05, START
    )
    assert [t for t, _ in calls] == pytest.approx(0.05 * np.arange(9))
    assert [base for _, base in calls] == pytest.approx(
        0.05 * np.arange(9)
    )  # the record at the instant of the call
    assert run.delta_a.values == pytest.approx(
        0.001 * (np.floor(run.time.values / 0.05 + 1e-9) + 1.0)
    )
    assert run["applied.delta_a"].values == pytest.approx(run.delta_a.values)


def test_a_law_that_errs_is_named_with_its_time(sim):
    with pytest.raises(
        UnknownName, match=r"unknown input 'aileron'.*the control law returned it at t = 0 s"
    ):
        flightmech.simulate_closed_loop(
            sim, record(), lambda t, y, u: {"aileron": 0.0}, 0.02, START
        )
    with pytest.raises(OutOfRange, match=r"the control law returned nan for delta_a at t = 0\.1 s"):
        flightmech.simulate_closed_loop(
            sim, record(), lambda t, y, u: {"delta_a": np.nan if t > 0.09 else 0.0}, 0.02, START
        )
    for period, delay in ((0.0, 0), (0.02, -1)):
        with pytest.raises(ValueError, match="give a period in s above zero"):
            flightmech.simulate_closed_loop(
                sim, record(), lambda t, y, u: {}, period, START, delay=delay
            )

import numpy as np
import pytest
import xarray as xr
from scipy.optimize import nnls
from scipy.signal import lfilter

import flighttest
from flightmech.errors import AeromatchWarning, IdentificationError, UnknownName
from flightmech.terms import evaluate_term, make_term
from flighttest.submodels.aircraft_properties import thrust_table

AXES = {"throttle": [0.0, 0.5, 1.0], "mach": [0.0, 0.4]}
TABLE = make_term([[300.0, 150.0], [1500.0, 1000.0], [4500.0, 3800.0]], AXES)
TAU = 1.4


def run(seed, noise=10.0):
    rng = np.random.default_rng(seed)
    t = np.arange(0, 120, 0.1)
    throttle = np.repeat(rng.choice([0.0, 0.3, 0.6, 1.0], 8), 150)
    mach = 0.2 + 0.15 * np.sin(0.05 * t + seed)
    static = evaluate_term(TABLE, {"throttle": throttle, "mach": mach})
    keep = np.exp(-0.1 / TAU)
    thrust = lfilter([1 - keep], [1, -keep], static, zi=[static[0] * keep])[0] + rng.normal(
        0, noise, len(t)
    )
    data = {"mach": mach, "engine1.throttle": throttle, "engine1.thrust": thrust}
    return xr.Dataset({n: ("time", x) for n, x in data.items()}, coords={"time": t})


def test_table_and_lag_are_recovered():
    fit = flighttest.aircraft_properties.fit_thrust([run(s) for s in range(3)], AXES)
    inside = {"throttle": np.array([0.0, 0.3, 0.6, 1.0]), "mach": np.full(4, 0.25)}
    # 10 N of noise over some hundred settled samples per node, and what the lag leaves after six
    # seconds (e^-4 of a step)
    np.testing.assert_allclose(
        evaluate_term(fit.leaf, inside), evaluate_term(TABLE, inside), atol=60.0
    )
    assert fit.time_constant == pytest.approx(TAU, rel=0.1)
    assert fit.rms_settled < 60.0
    assert set(np.unique(fit.leaf["source"])) == {1}


def test_nodes_without_samples_are_not_from_flight_and_ends_that_hold_are_named():
    wide = {"throttle": [0.0, 0.5, 1.0], "mach": [0.0, 0.4, 0.8]}
    leaf = flighttest.aircraft_properties.fit_thrust([run(0)], wide).leaf
    # 1 is flight, 2 judgement: the records end at a Mach number of 0.35
    assert leaf["source"].values.tolist() == [[1, 1, 2]] * 3
    narrow = {"throttle": [0.0, 0.5, 1.0], "mach": [0.0, 0.2]}
    with pytest.warns(
        AeromatchWarning, match="mach of the records is .* breakpoints are 0 ... 0.2"
    ):
        flighttest.aircraft_properties.fit_thrust([run(0)], narrow)


def test_engines_that_share_a_table_are_averaged():
    data = run(0)
    data["engine2.throttle"], data["engine2.thrust"] = (
        data["engine1.throttle"],
        1.1 * data["engine1.thrust"],
    )
    one, both = (
        flighttest.aircraft_properties.fit_thrust([data], AXES),
        flighttest.aircraft_properties.fit_thrust([data], AXES, engines=(1, 2)),
    )
    np.testing.assert_allclose(both.leaf["value"], 1.05 * one.leaf["value"], rtol=1e-6, atol=1e-6)


def test_throttle_that_does_not_move():
    data = run(0)
    data["engine1.throttle"] = 0.5 + 0.0 * data["engine1.throttle"]
    with pytest.raises(IdentificationError, match=r"moves by less than 0\.1"):
        flighttest.aircraft_properties.fit_thrust([data], AXES)


def test_missing_channel():
    with pytest.raises(UnknownName, match=r"unknown channel 'mach'"):
        flighttest.aircraft_properties.fit_thrust([run(0).drop_vars("mach")], AXES)


def test_a_search_that_stops_at_its_limit_warns(monkeypatch):
    records = [run(s) for s in range(3)]
    assert flighttest.aircraft_properties.fit_thrust(records, AXES).converged
    monkeypatch.setattr(thrust_table, "_EVALUATIONS", 2)
    with pytest.warns(AeromatchWarning, match="time constant of the thrust: not converged after"):
        assert not flighttest.aircraft_properties.fit_thrust(records, AXES).converged


def test_a_table_that_does_not_converge_is_refused(monkeypatch):
    def stopped(A, b):
        return nnls(A, b, maxiter=1)

    monkeypatch.setattr(thrust_table, "nnls", stopped)
    with pytest.raises(IdentificationError, match="do not converge for 6 nodes"):
        flighttest.aircraft_properties.fit_thrust([run(s) for s in range(3)], AXES)

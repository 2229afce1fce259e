"""Iterations of the engine parts that stop at their limit: remarks, JSON, report, warning."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.air import atmosphere
from flightmech.errors import AeromatchWarning
from flightmech.terms import make_term
from flighttest.remarks import is_forbidden
from flighttest.submodels.engine import node_smoothing, records, static_thrust
from flighttest.submodels.engine.records import engine_channels
from flighttest.submodels.engine.result import identify_engine
from flighttest.submodels.engine.tables import EngineStructure

SPEEDS = np.linspace(0.6, 1.1, 4)
PRIOR = {
    "corrected_thrust": make_term(4000.0 * SPEEDS**3, {"corrected_n2": SPEEDS}),
    "n2_command": make_term([0.6, 1.0], {"throttle": [0.0, 1.0]}),
    "n2_up_time": make_term(1.0),
}
TABLES = {"corrected_thrust": {"corrected_n2": np.linspace(0.6, 1.1, 8), "mach": [0.05, 0.45]}}


def flight(seed: int, count: int = 3000) -> xr.Dataset:
    """Wandering speed and Mach number at sea level, thrust with noise of 15 N."""
    t = 0.1 * np.arange(count)
    mach, n2 = 0.25 + 0.2 * np.sin(t / 40.0), 0.8 + 0.2 * np.sin(t / 9.0)
    noise = 15.0 * np.random.default_rng(seed).normal(size=count)
    thrust = 4600.0 * n2**3 - 900.0 * mach * (1.1 - n2) + noise
    columns = {"n2": n2, "mach": mach, "h": np.zeros(count), "thrust": thrust}
    return xr.Dataset({name: ("time", x) for name, x in columns.items()}, {"time": t})


def points(count: int = 60) -> xr.Dataset:
    """Recorded thrust, 10 % above the a-priori deck, with noise of 0.3 %."""
    n2 = np.tile([0.7, 0.8, 0.9, 1.0], count)[:count]
    noise = 0.003 * np.random.default_rng(2).normal(size=count)
    thrust = 1.1 * np.interp(n2, SPEEDS, 4000.0 * SPEEDS**3) * (1.0 + noise)
    columns = {"n2": n2, "mach": np.full(count, 0.2), "h": np.zeros(count), "thrust": thrust}
    return xr.Dataset({name: ("point", x) for name, x in columns.items()})


def from_flight(seed: int):
    # A lever at rest: no power change is cut out of the record.
    record = flight(seed).assign(throttle=("time", np.zeros(3000)))
    return identify_engine(prior=PRIOR, flights=[record], structure=EngineStructure(tables=TABLES))


@pytest.mark.parametrize(
    ("module", "part"), [(node_smoothing, "lengths and noise"), (static_thrust, "static thrust")]
)
def test_a_search_that_stops_at_its_limit_is_an_error(module, part, monkeypatch):
    def identify():
        if module is static_thrust:
            return identify_engine(recorded=points(), prior=PRIOR)
        return from_flight(seed=2)

    complete = identify()
    assert complete.remarks == []
    assert complete.as_dict()["remarks"] == []
    complete.deck()
    monkeypatch.setattr(module, "PASSES", 1)
    stopped = identify()
    assert is_forbidden(stopped.remarks)
    (remark,) = stopped.as_dict()["remarks"]
    assert remark["kind"] == "convergence"
    assert remark["value"] > remark["threshold"] == 1.0
    assert f"{part}" in remark["text"]
    assert "!! " in stopped.report()
    assert "not converged after 1 iterations" in stopped.report()
    with pytest.warns(AeromatchWarning, match="engine deck: .*not converged"):
        stopped.deck()


def test_lengths_that_alternate_are_a_warning():
    """The lengths move between neighbours of their grid for ever; the noise changes by 1.1 %."""
    found = from_flight(seed=1)
    (remark,) = found.remarks
    assert remark.kind == "convergence"
    assert remark.severity == "warning"
    assert remark.value == pytest.approx(11.05, abs=0.01)
    assert found.steady["corrected_thrust"].convergence.converged is False
    assert "! lengths and noise of corrected_thrust: not converged after 8" in found.report()
    found.deck()


def test_a_pressure_altitude_that_does_not_converge_warns(monkeypatch):
    t = np.arange(50.0)
    warm = atmosphere(11000.0, delta_T=30.0)
    altitude = float(flightmech.air.pressure_altitude(float(warm.p_static)))
    columns = {"engine1.n2": 0.6, "mach": 0.5, "h_baro": altitude}
    columns["temperature"] = float(warm.temperature)
    states = xr.Dataset({name: ("time", x + 0.0 * t) for name, x in columns.items()}, {"time": t})
    converged = engine_channels(states, height="h_baro")
    # The fifth pass still moves the height by 2.0 m, so a sixth one follows.
    assert converged.attrs["height_change"] == pytest.approx(0.4585, abs=0.0005)
    assert "height_change" not in engine_channels(states.rename(h_baro="h"), height="h").attrs
    monkeypatch.setattr(records, "MOST_PASSES", 5)
    with pytest.warns(AeromatchWarning, match="height: not converged after 5 iterations"):
        stopped = engine_channels(states, height="h_baro")
    assert stopped.attrs["height_change"] == pytest.approx(2.04, abs=0.01)

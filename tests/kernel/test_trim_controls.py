"""Trim with control circuits: forces of the pilot, travel in the cockpit, tabs that take the force
away.

Hinge moment of the elevator: qS_e c_e Ch, Ch = -0.1 alpha - 0.3 delta_e - 0.2 delta_t; force on the
column -gearing times that.
"""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.aircraft.controls import Circuit, ControlGeometry
from flightmech.steady_flight.trim_search import start_of
from flightmech.terms import make_term

CRUISE = {"init.V": 110.0, "init.h": 3000.0, "mode.earth": 0.0}
AREA, CHORD, GEARING = 1.5, 0.35, -1.2
HINGES = {
    "Ch_e/alpha": make_term(-0.1, regressors=["alpha"]),
    "Ch_e/elevator": make_term(-0.3, regressors=["delta_e"]),
    "Ch_e/tab": make_term(-0.2, regressors=["delta_t"]),
    "Ch_r/beta": make_term(0.05, regressors=["beta"]),
    "Ch_r/rudder": make_term(-0.25, regressors=["delta_r"]),
    "Ch_r/tab": make_term(-0.15, regressors=["delta_tr"]),
}


@pytest.fixture(scope="module")
def piloted(make_aircraft, make_tree, content) -> flightmech.SimModel:
    """The jet of the tests of the kernel with column and pedals."""
    craft = make_aircraft(
        controls={
            "delta_e": ControlGeometry(AREA, CHORD, GEARING),
            "delta_r": ControlGeometry(0.9, 0.4, -1.5),
        },
        circuits={
            "column": Circuit((-0.3, 0.3), 6.0, friction=15.0),
            "pedal": Circuit((-0.3, 0.3), 8.0, friction=20.0),
        },
    )
    return flightmech.compile(craft, make_tree({**content, **HINGES}))


def column_force(y: xr.Dataset) -> float:
    ch = -0.1 * float(y["alpha"]) - 0.3 * float(y["applied.delta_e"])
    return -GEARING * float(y["qbar"]) * AREA * CHORD * ch


def solution(found) -> dict[str, float]:
    return dict(
        zip(map(str, found["unknown"].values), map(float, found["found"].values), strict=True)
    )


def test_surfaces_drive_and_forces_follow(piloted):
    y = flightmech.trim(piloted, CRUISE, kind="level")
    assert y.attrs["verdict"] == "trimmed"
    assert float(y["applied.F_column"]) == pytest.approx(column_force(y), rel=1e-9)
    assert float(y["applied.column"]) == pytest.approx(
        float(y["applied.delta_e"]) / GEARING, rel=1e-9
    )


def test_tabs_take_the_forces_away(piloted):
    """Hands and feet off: tabs unknown in place of the forces."""
    y = flightmech.trim(piloted, CRUISE, kind="level", fixed={"F_column": 0.0, "F_pedal": 0.0})
    assert y.attrs["verdict"] == "trimmed"
    tabs = solution(y)
    assert tabs["delta_t"] == pytest.approx(
        -(0.1 * float(y["alpha"]) + 0.3 * float(y["applied.delta_e"])) / 0.2, rel=1e-9
    )
    assert tabs["delta_tr"] == pytest.approx(
        (0.05 * float(y["beta"]) - 0.25 * float(y["applied.delta_r"])) / 0.15, rel=1e-9
    )


def test_positions_drive(piloted):
    plain = flightmech.trim(piloted, CRUISE, kind="level")
    y = flightmech.trim(piloted, {**CRUISE, "mode.controls": 1.0}, kind="level")
    assert y.attrs["verdict"] == "trimmed"
    assert list(y["unknown"].values) == ["alpha", "beta", "column", "delta_a", "pedal", "throttle"]
    assert solution(y)["column"] == pytest.approx(
        float(plain["applied.delta_e"]) / GEARING, rel=1e-9
    )
    given = flightmech.trim(
        piloted, {**CRUISE, "mode.controls": 1.0}, kind="sideslip", fixed={"delta_r": 0.1}
    )
    assert given.attrs["verdict"] == "trimmed"
    assert float(given["applied.delta_r"]) == pytest.approx(0.1, abs=1e-12)


def test_forces_drive(piloted):
    """The force that is found holds the column: the kernel adds none, and the flight goes on hands
    on.
    """
    plain = flightmech.trim(piloted, CRUISE, kind="turn", fixed={"phi": 0.6})
    y = flightmech.trim(piloted, {**CRUISE, "mode.controls": 2.0}, kind="turn", fixed={"phi": 0.6})
    assert y.attrs["verdict"] == "trimmed"
    for name in ("F_column", "F_pedal"):
        assert solution(y)[name] == pytest.approx(float(plain[f"applied.{name}"]), rel=1e-8)
        assert float(y[f"trim.{name}"]) == pytest.approx(0.0, abs=1e-8)
    lag = {"engine1.time_constant": 0.0, "engine2.time_constant": 0.0}
    flown = flightmech.simulate(
        piloted, xr.Dataset(coords={"time": np.arange(0.0, 5.0, 0.5)}), {**start_of(y), **lag}
    )
    assert float(np.abs(flown["phi"] - 0.6).max()) < 1e-6
    assert float(np.abs(flown["applied.delta_e"] - float(y["applied.delta_e"])).max()) < 1e-9


def test_a_given_force_requires_a_tab(piloted):
    y = flightmech.trim(
        piloted, {**CRUISE, "mode.controls": 2.0}, kind="level", fixed={"F_column": 30.0}
    )
    assert y.attrs["verdict"] == "trimmed"
    assert "delta_t" in solution(y)
    free = flightmech.trim(piloted, {**CRUISE, "delta_t": solution(y)["delta_t"]}, kind="level")
    assert float(free["applied.F_column"]) == pytest.approx(30.0, rel=1e-8)


def test_a_linear_model_holds_the_surfaces(piloted):
    y = flightmech.trim(piloted, {**CRUISE, "mode.controls": 2.0}, kind="level")
    held = flightmech.linearize(piloted, start_of(y))
    assert (
        held.attrs["held"]
        == "control circuits of column, pedal: surfaces held where the trim left them"
    )
    plain = flightmech.linearize(piloted, start_of(flightmech.trim(piloted, CRUISE, kind="level")))
    np.testing.assert_allclose(held["A"], plain["A"], rtol=1e-6, atol=1e-8)
    assert float(np.abs(held["x_dot"]).max()) < 1e-9

"""Derivatives of a window that starts where friction just holds the control."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from flighttest.maximum_likelihood.unknowns import Unknown, lay_out
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.responses.circuit_likelihood import CircuitLikelihood
from flighttest.submodels.control_loading.responses.free_response import find_windows
from flighttest.submodels.control_loading.responses.window_response import BRISTLE_TRAVEL

START = {
    "mass": 6.0,
    "damping": 40.0,
    "friction": 9.0,
    "cable_stiffness": 31000.0,
    "cable_damping": 50.0,
    "inertia": 0.5,
    "hinge_damping": 1.2,
    "hinge_friction": 3.0,
    "rigging": 0.0,
    "offset": 0.0,
    "Ch_e: delta_e": -0.29,
}


@pytest.fixture(scope="module")
def release() -> CircuitLikelihood:
    """A hand lets go of a column on a cable."""
    time = np.arange(0.0, 1.2, 0.02)
    away = np.where(time < 0.5, 1.0, np.exp(-3.0 * (time - 0.5)) * np.cos(14.0 * (time - 0.5)))
    noise = 5e-5 * np.random.default_rng(2).standard_normal((2, len(time)))
    channels = {
        "F_column": np.where(time < 0.5, 60.0, 0.0),
        "column": 0.0215 * away + noise[0],
        "delta_e": -1.8 * (0.02 * away + noise[1]),
        "qbar": np.full(len(time), 4000.0),
    }
    record = xr.Dataset({name: ("time", x) for name, x in channels.items()}, {"time": time})
    loading = ControlLoading(
        "column",
        -1.8,
        2.2,
        0.33,
        "Ch_e = delta_e",
        ("offset", "friction", "damping", "mass"),
    )
    windows = find_windows(loading, [record])
    unknowns = {name: Unknown(value) for name, value in START.items()}
    unknowns[BRISTLE_TRAVEL] = Unknown(float(np.log(5e-5)))
    unknowns["hand_damping"] = Unknown(0.0)
    layout = lay_out(unknowns | {n: Unknown(v) for n, v in windows[0].starts().items()}, [{}])
    return CircuitLikelihood(loading, windows, [], layout, START)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("end", [0, 1])
def test_slopes_at_a_kink_are_those_of_a_start_that_slides(release, end, side):
    """What slides from there is less than rounding, which must not choose the slopes."""

    def slopes(ratio: float) -> tuple[np.ndarray, np.ndarray]:
        theta = release.place(release.layout.start, {0: 0.3, 1: 0.2} | {end: ratio})
        sides = release.sides(theta)
        inside = np.array([True, True])
        held = release.join_sides(sides, inside)[0]
        inside[end] = False
        return release.join_sides(sides, inside)[0], held

    out, held = slopes(side * (1.0 + 1e-4))
    size = np.abs(out - held).max(axis=(0, 1))
    for beyond in (0.0, 1e-9):
        near, inside = slopes(side * (1.0 + beyond))
        assert np.all(np.abs(near - out) <= 0.05 * size + 1e-3 * np.abs(out).max(axis=(0, 1)))
        assert inside == pytest.approx(held, rel=1e-2, abs=1e-2 * np.abs(held).max())

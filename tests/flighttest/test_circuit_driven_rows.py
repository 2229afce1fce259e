"""Driven stretches as pieces of a likelihood: samples in which the control slides, and stretch."""

import numpy as np
import xarray as xr

from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.responses.driven_rows import DrivenPiece, driven_rows
from flighttest.submodels.control_loading.windows import driven_stretches

CUTOFF, STEP = 2.0, 0.01
GEARING, S_HINGE, C_HINGE = -1.8, 2.2, 0.33
CONSTANTS = ("offset", "friction", "damping", "mass")
LOADING = ControlLoading("column", GEARING, S_HINGE, C_HINGE, "Ch_e = 1 + delta_e", CONSTANTS)


def record_of(travel, surface, force) -> xr.Dataset:
    """Return a record without noise; `surface` is the surface end, reduced to the travel."""
    time = np.arange(len(travel)) * STEP
    channels = {"column": travel, "delta_e": GEARING * surface, "F_column": force}
    channels["qbar"] = np.full(len(time), 6000.0)
    return xr.Dataset({name: ("time", x) for name, x in channels.items()}, {"time": time})


def test_the_damper_of_the_cable_takes_its_part_of_a_rising_load():
    """The surface moves at a constant rate: e = (P - D e') / K with the load P holds exactly."""
    rate, K, D = 0.03, 31000.0, 60.0
    time = np.arange(0.0, 5.0, STEP)
    surface = rate * (time - 2.5)
    slope = 6000.0 * S_HINGE * C_HINGE * GEARING**2 * 0.29
    hinge_friction, hinge_damping = 3.0, 1.2
    pull = slope * surface + hinge_friction * abs(GEARING) + hinge_damping * GEARING**2 * rate
    stretching = slope * rate / K
    stretch = (pull - D * stretching) / K
    force = pull + 7.0 + 24.0 * (rate + stretching)
    driven = driven_stretches(LOADING, [record_of(surface + stretch, surface, force)], CUTOFF)
    (rows,) = driven_rows(LOADING, driven, CUTOFF, has_cable=True)
    values = {
        "offset": 0.0, "friction": 7.0, "damping": 24.0, "mass": 5.0, "Ch_e: 1": 0.0,
        "Ch_e: delta_e": -0.29, "cable_stiffness": K, "cable_damping": D, "inertia": 0.5,
        "hinge_friction": hinge_friction, "hinge_damping": hinge_damping, "rigging": 0.0,
        "hand_damping": 0.0, "friction_rate": np.log(1e-4),
    }  # fmt: skip
    piece = DrivenPiece(rows, tuple(values))
    theta = np.array(list(values.values()))
    difference = (piece.measured - piece.predict(theta)) * rows.scale
    # The rate of the surface is taken as the mean of both ends, which leaves 3 % of the effect.
    assert np.abs(difference[:, 1]).max() < 0.05 * D * stretching / K
    # The derivative by the damping is that of the prediction.
    k = list(values).index("cable_damping")
    more = theta.copy()
    more[k] += 1.0
    by_damping = piece.slopes(theta, theta, False)[:, :, k]
    np.testing.assert_allclose(by_damping, piece.predict(more) - piece.predict(theta), atol=1e-9)


def test_samples_in_which_a_low_pass_smears_the_first_and_last_motion_are_left_out():
    """The control breaks away at once at 2 s and stops at once at 6 s."""
    time = np.arange(0.0, 8.0, STEP)
    travel = 0.03 * np.clip(time - 2.0, 0.0, 4.0)
    force = np.where((time > 2.0) & (time < 6.0), 20.0, 0.0)
    # No jump between two samples, which would exclude its neighbourhood too.
    force = np.convolve(np.pad(force, 30, mode="edge"), np.ones(61) / 61.0, mode="valid")
    (record,) = driven_stretches(LOADING, [record_of(travel, travel, force)], CUTOFF)
    used = record.moved["time"].values[np.asarray(record.used)]
    # Three standard deviations of the low-pass, 0.1325 periods each.
    clear = 3.0 * 0.1325 / CUTOFF
    assert 2.0 + clear < used[0] < 2.0 + 2.0 * clear
    assert 6.0 - 2.0 * clear < used[-1] < 6.0 - clear


def test_friction_builds_up_from_the_other_side_over_a_travel():
    """Exact bristles after a reversal, and derivatives of the prediction."""
    b, time = 4e-4, np.arange(0.0, 10.0, STEP)
    # Back and forth at a constant rate, with one reversal.
    travel = 0.03 * (np.abs(time - 5.0) - 2.5)
    driven = driven_stretches(LOADING, [record_of(travel, travel, np.zeros(len(time)))], CUTOFF)
    stretches = driven_rows(LOADING, driven, CUTOFF, has_cable=False)
    assert len(stretches) == 2
    later = stretches[1]
    # The low-pass turns the travel a little later than the control turns.
    assert 0.0 < later.slid[0] < later.slid[-1] < 0.15
    values = {"offset": 0.0, "friction": 7.0, "damping": 24.0, "mass": 5.0, "Ch_e: 1": 0.0}
    values |= {"Ch_e: delta_e": 0.0, "rigging": 0.0, "hand_damping": 0.0}
    values |= {"bristle_travel": np.log(b)}
    piece, theta = DrivenPiece(later, tuple(values)), np.array(list(values.values()))
    friction = piece.predict(theta)[:, 0] * later.scale[0] - 24.0 * later.rate
    np.testing.assert_allclose(friction, 7.0 * (1.0 - 2.0 * np.exp(-later.slid / b)), atol=0.05)
    slopes = piece.slopes(theta, theta, False)
    for name in ("friction", "bristle_travel"):
        k = list(values).index(name)
        up, down = theta.copy(), theta.copy()
        up[k], down[k] = theta[k] + 1e-5, theta[k] - 1e-5
        difference = (piece.predict(up) - piece.predict(down)) / 2e-5
        np.testing.assert_allclose(slopes[:, :, k], difference, rtol=1e-5, atol=1e-6)

"""A centre of gravity that moves along a path, and what the sensors do not follow."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from flighttest.reconstruction.flight_path import moving_cg_remarks


def path(moved: float) -> xr.Dataset:
    """Return states in which the c.g. goes aft, with a pitch acceleration of 2 rad/s2 at the end.

    From its mean the c.g. is moved/2 away then.
    """
    time = np.linspace(0.0, 100.0, 101)
    columns = {name: 0.0 * time for name in ("y_cg_b", "z_cg_b", "p", "q", "r", "p_dot", "r_dot")}
    columns |= {"x_cg_b": -moved * time / time[-1], "q_dot": 2.0 * (time == time[-1])}
    return xr.Dataset({name: ("time", x) for name, x in columns.items()}, {"time": time})


def test_the_specific_force_that_the_mean_leaves_is_stated():
    (remark,) = moving_cg_remarks(path(0.3))
    assert remark.severity == "note"
    assert remark.value == pytest.approx(0.3)
    # 2 rad/s2 times 0.15 m
    assert "x_cg_b moves by 0.3 m" in remark.text
    assert "at most 0.3 m/s2" in remark.text


def test_a_small_motion_and_states_without_rates_are_not_remarked():
    assert moving_cg_remarks(path(0.015)) == []
    assert moving_cg_remarks(path(0.3).drop_vars("q_dot")) == []

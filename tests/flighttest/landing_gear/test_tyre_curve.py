"""The error of a cornering stiffness by the form of the tyre curve grows with the slip flown."""

import numpy as np
import pytest
import xarray as xr

from flighttest.submodels.landing_gear.explicit import FRICTION
from flighttest.submodels.landing_gear.tyre_curve import curve_error, magic_side_force
from flighttest.submodels.landing_gear.wheel_positions import WheelGroup


@pytest.mark.parametrize(("degrees", "expected"), [(1.0, 0.0377), (3.0, 0.0921), (6.0, 0.1405)])
def test_the_curve_error_grows_with_the_slip(degrees, expected):
    group, speed = WheelGroup(("left",)), np.full(202, 20.0)
    slip = np.tan(np.radians(np.append(np.linspace(-degrees, degrees, 201), 80.0)))
    # The last sample stands, with a slip of its own: it does not count.
    speed[-1] = 0.1
    record = xr.Dataset(
        {
            "speed": ("time", speed),
            "along": (("time", "wheel"), speed[:, None]),
            "across": (("time", "wheel"), (speed * slip)[:, None]),
            "force": (("time", "output"), np.full((202, 1), 9e3)),
        },
        {"wheel": ["left"], "output": ["load.left"]},
    )
    constants = {FRICTION: 0.8, "gear.left.cornering": 7.7}
    assert curve_error(constants, group, [record]) == pytest.approx(expected, abs=5e-4)


def test_the_magic_formula_has_its_stiffness_and_its_peak():
    slip = np.array([1e-6, 0.5, 100.0])
    force = magic_side_force(9e3, slip, 7e4, 0.8)
    assert force[0] == pytest.approx(0.07, rel=1e-6)
    assert force.max() <= 0.8 * 9e3

"""The error of a cornering stiffness by the form of the tyre curve grows with the slip flown."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from flightmech.aircraft.aircraft_file import read_aircraft
from flighttest.submodels.landing_gear.explicit import FRICTION
from flighttest.submodels.landing_gear.identification import _with_curve_error
from flighttest.submodels.landing_gear.result import GearConstant
from flighttest.submodels.landing_gear.tyre_curve import curve_error, magic_side_force
from flighttest.submodels.landing_gear.wheel_positions import WheelGroup, wheel_groups

T37 = Path(__file__).parents[3] / "data" / "t37" / "aircraft.toml"


GROUP, CONSTANTS = WheelGroup(("left",)), {FRICTION: 0.8, "gear.left.cornering": 7.7}


def rolling(slip, speed):
    """Loads of one wheel at tangents of slip angles and speeds."""
    return xr.Dataset(
        {
            "speed": ("time", speed),
            "along": (("time", "wheel"), speed[:, None]),
            "across": (("time", "wheel"), (speed * slip)[:, None]),
            "force": (("time", "output"), np.full((len(slip), 1), 9e3)),
        },
        {"wheel": ["left"], "output": ["load.left"]},
    )


@pytest.mark.parametrize(("degrees", "expected"), [(1.0, 0.0377), (3.0, 0.0921), (6.0, 0.1405)])
def test_the_curve_error_grows_with_the_slip(degrees, expected):
    speed = np.full(202, 20.0)
    slip = np.tan(np.radians(np.append(np.linspace(-degrees, degrees, 201), 80.0)))
    # The last sample stands, with a slip of its own: it does not count.
    speed[-1] = 0.1
    found = curve_error(CONSTANTS, GROUP, [rolling(slip, speed)])
    assert found.relative == pytest.approx(expected, abs=5e-4)
    assert not found.is_least


def test_without_slip_there_is_no_curve_error():
    """A search over a constant would end at its limit, and give a standard error of 200 %."""
    assert curve_error(CONSTANTS, GROUP, [rolling(np.zeros(9), np.full(9, 20.0))]) is None
    assert curve_error(CONSTANTS, GROUP, [rolling(np.full(9, 0.1), np.full(9, 0.01))]) is None


def test_a_stiffness_without_slip_is_undetermined_and_one_at_the_limit_is_remarked():
    craft = read_aircraft(T37)
    groups = wheel_groups(craft)
    nose, main = (group.parameter("cornering") for group in groups)
    held = {FRICTION: 0.8, nose: 7.7, main: 7.7}
    wheels = [name for group in groups for name in group.names]
    # The nose wheel rolls straight; the main wheels slide at 60 deg.
    parts = []
    for name in wheels:
        slip = np.full(9, 0.0 if name in groups[0].names else np.tan(np.radians(60.0)))
        part = rolling(slip, np.full(9, 20.0))
        parts.append(part.assign_coords(wheel=[name], output=[f"load.{name}"]))
    rolled = xr.concat([part[["along", "across"]] for part in parts], "wheel")
    force = xr.concat([part["force"] for part in parts], "output")
    loads = rolled.assign(speed=parts[0]["speed"], force=force)
    fit = SimpleNamespace(held=held, fit=SimpleNamespace(parameters={}), loads=[loads])
    given = {name: GearConstant(7.7, 0.1, "wheel loads") for name in (nose, main)}
    found = _with_curve_error(given, craft, fit)
    assert list(found.constants) == [main]
    assert found.constants[main].stderr == pytest.approx(2.0 * 7.7, rel=1e-3)
    assert found.reasons == {nose: "no wheel of the group rolls with a slip angle"}
    (note,) = found.notes
    assert note.term == main
    assert "differs by 200% or more, the limit of the search" in note.text


def test_the_magic_formula_has_its_stiffness_and_its_peak():
    slip = np.array([1e-6, 0.5, 100.0])
    force = magic_side_force(9e3, slip, 7e4, 0.8)
    assert force[0] == pytest.approx(0.07, rel=1e-6)
    assert force.max() <= 0.8 * 9e3

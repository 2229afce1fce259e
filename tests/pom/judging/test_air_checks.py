"""Air of a record: unusual temperature and pressure, and airspeeds that contradict them."""

import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from flightmech.air import atmosphere, true_airspeed
from pom.judging.air_checks import air_remarks

sys.path.insert(0, str(Path(__file__).parents[1]))
import report_fixture as fixture

CASE = fixture.roll_result().case


def states(warmth=5.0, error=0.0, h=3000.0, climb=100.0):
    """Return a flight in air of this warmth [K], with an error of the recorded temperature [K]."""
    height = h + np.linspace(0.0, climb, 50)
    air = atmosphere(height, warmth)
    V_cas = np.full(50, 80.0)
    data = {
        "h": height,
        "p_static": air.p_static,
        "temperature": air.temperature + error,
        "V_cas": V_cas,
        "V": true_airspeed(V_cas, air.p_static, air.temperature),
    }
    return xr.Dataset({name: ("time", item) for name, item in data.items()}).assign_coords(
        time=0.1 * np.arange(50)
    )


def texts(flight):
    return [(item.kind, item.text) for item in air_remarks(CASE, flight)]


@pytest.mark.parametrize("warmth", [5.0, -12.0])
def test_usual_air_has_no_warning_and_is_stated_as_not_checked(warmth):
    ((kind, text),) = texts(states(warmth=warmth))
    assert kind == "probe"
    assert "error of the temperature within 15 K" in text


def test_a_temperature_that_contradicts_the_airspeeds_is_named():
    (remark,) = air_remarks(CASE, states(error=-14.0))
    assert remark.kind == "record_warning"
    assert "tolerance 2 %" in remark.text
    # the airspeeds give the error back
    assert remark.values["error"] == pytest.approx(-14.0, abs=0.6)


def test_unusual_air_is_named():
    flight = states(warmth=5.0, error=25.0).drop_vars("V")
    found = texts(flight)
    assert {kind for kind, _ in found} == {"record_warning"}
    assert "+30 K off the standard atmosphere" in found[0][1]
    # higher up the column of air no longer fits the pressure of the flight
    found = texts(states(error=25.0, h=6000.0).drop_vars("V"))
    assert "hPa at sea level" in found[1][1]

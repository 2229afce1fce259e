"""Mistakes of clocks, heading and air data that no sign, unit or axis shows."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import flightmech
import flighttest
from flightmech.units import DEGREE, KNOT

C182 = Path(__file__).parents[4] / "data" / "c182"
T37 = Path(__file__).parents[4] / "data" / "t37"
CARD = "t37_01_clean_low_speed_5kft.nc"


@pytest.fixture(scope="module")
def light():
    """Return a record with calibrated airspeed only, and its aircraft."""
    record = flighttest.read(C182 / "flight" / "cruise.csv", C182 / "names.toml")
    return record, flightmech.read_aircraft(C182 / "aircraft.toml")


@pytest.fixture(scope="module")
def jet():
    record = flighttest.read(T37 / "flight" / CARD, T37 / "names.toml")
    return record, flightmech.read_aircraft(T37 / "aircraft.toml")


def judged(flight, without=(), start=0.0, **changes):
    """Return the quality of a flight with channels changed by functions of clock and values.

    The record begins at `start`: a late channel has no values before.
    """
    record, aircraft = flight
    leaves = {"/": xr.Dataset(attrs=record.attrs)}
    for leaf, node in record.children.items():
        data = node.to_dataset().drop_vars(without, errors="ignore").copy(deep=True)
        for name in changes.keys() & set(data.data_vars):
            data[name].values[:] = changes[name](data["time"].values, data[name].values)
        leaves[f"/{leaf}"] = data.sel(time=slice(start, None))
    return flighttest.assess(xr.DataTree.from_dict(leaves), aircraft)


def faults(quality):
    return {finding.name: finding for finding in quality.findings if finding.severity != "note"}


def late(delay):
    return lambda t, x: np.interp(t - delay, t, x)


def plus(offset):
    return lambda t, x: x + offset


@pytest.mark.nightly
@pytest.mark.parametrize(("channel", "delay"), [("vn", 1.0), ("V_cas", 2.0), ("alpha_vane", 0.25)])
def test_late_channel(light, channel, delay):
    # the aircraft file allows a vane 0.2 s; 0.24 (0.017) s is not significantly more
    (fault,) = faults(judged(light, start=delay, **{channel: late(delay)})).values()
    assert fault.name == f"lag:{channel}"
    # the instruments of the record are 0.04 to 0.16 s late themselves
    assert delay < fault.evidence["delay"] < delay + 0.25


@pytest.mark.nightly
def test_magnetic_heading(jet):
    found = faults(judged(jet, psi=plus(-5.0 * DEGREE)))
    assert list(found) == ["definition:psi+vn+ve"]
    error = found["definition:psi+vn+ve"].evidence["error"]
    assert error == pytest.approx(-5.0 * DEGREE, abs=0.5 * DEGREE)


@pytest.mark.nightly
def test_compass_that_wanders_by_three_degrees(light):
    found = faults(judged(light, psi=lambda t, x: x + 3.0 * DEGREE * np.sin(t / 20.0)))
    (fault,) = found.values()
    assert fault.name == "inconsistent:psi+q+r"
    assert "wanders" in fault.text


@pytest.mark.slow
def test_temperature_ten_kelvin_too_high(light):
    (fault,) = faults(judged(light, temperature=plus(10.0))).values()
    assert fault.name == "definition:temperature+h_gps"
    assert fault.evidence["slope"] == pytest.approx(1.0 - 10.0 / 290.0, abs=0.006)


@pytest.mark.nightly
def test_temperature_against_the_airspeeds_of_the_computer(jet):
    (fault,) = faults(judged(jet, ("h_gps",), temperature=plus(10.0))).values()
    assert "temperature is +10 K wrong" in fault.text


@pytest.mark.nightly
def test_wrong_altimeter_setting_without_static_pressure(jet, light):
    (fault,) = faults(judged(jet, ("p_static",), h_baro=plus(120.0))).values()
    assert "h_baro is +122 m wrong" in fault.text
    # calibrated airspeed alone shows nothing: it is listed
    assert "h_baro_level" in set(judged(light).not_checked["relation"])


@pytest.mark.nightly
def test_impact_pressure_ten_per_cent_too_large(jet):
    found = faults(judged(jet, ("V", "V_cas"), q_c=lambda t, x: 1.1 * x))
    assert list(found) == ["scale:q_c"]
    # 4.9 % of the airspeed, on a static port that is 1 % off
    assert found["scale:q_c"].evidence["slope"] == pytest.approx(1.037, abs=0.01)


@pytest.mark.nightly
def test_miles_per_hour_taken_as_knots(jet):
    mph = 1609.344 / 3600.0
    factor = KNOT / mph
    alone = ("V", "q_c", "p_static")
    assert list(faults(judged(jet, alone, V_cas=lambda t, x: factor * x))) == ["unit:V_cas"]
    found = faults(judged(jet, V_cas=lambda t, x: factor * x))
    assert list(found) == ["unit:V_cas+q_c"]
    assert "is in mph and was taken as kt" in found["unit:V_cas+q_c"].text

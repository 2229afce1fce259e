"""A record of the proof under another name, trimmed, thinned or re-sampled, is found by samples."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import flighttest
from flighttest.records import find_shared_samples

DATA = Path(__file__).parents[3] / "data" / "t37"


def read(name):
    return flighttest.read(DATA / "flight" / f"{name}.nc", DATA / "names.toml")


@pytest.fixture(scope="module")
def record():
    return read("t37_21_val_short_period_full_flaps_gear_down")


def changed(record, make):
    """Return the record with its inertial group changed, and no other group."""
    return xr.DataTree(children={"imu": xr.DataTree(make(record["imu"].to_dataset()))})


def test_a_copy_is_found(record):
    shared = find_shared_samples(record, changed(record, lambda data: data))
    assert "equal samples of p, q, r" in shared.how
    time = record["imu"]["time"].values
    assert (shared.start, shared.stop, shared.shift) == (time[0], time[-1], 0.0)


def test_a_trimmed_thinned_copy_on_another_clock_is_found(record):
    def make(data):
        part = data.sel(time=slice(4.0, 15.0)).isel(time=slice(None, None, 3))
        return part.assign_coords(time=part["time"] + 100.0)

    shared = find_shared_samples(record, changed(record, make))
    assert "equal samples of p, q, r" in shared.how
    assert shared.shift == pytest.approx(100.0)
    assert (shared.start, shared.stop) == pytest.approx((4.0, 15.0), abs=0.1)


def test_a_resampled_copy_on_another_clock_is_found(record):
    def make(data):
        time = np.arange(4.003, 18.0, 1.0 / 110.0)
        return data.interp(time=time).assign_coords(time=time + 50.0)

    shared = find_shared_samples(record, changed(record, make))
    assert shared.how.startswith("correlation 0.9") or shared.how.startswith("correlation 1.0")
    assert shared.shift == pytest.approx(50.0, abs=0.2)


@pytest.mark.nightly
def test_other_flights_of_the_same_manoeuvre_are_not_taken_for_copies(record):
    assert find_shared_samples(record, read("t37_16_descent_through_ground_effect")) is None
    # the two most alike of all records of the aeroplane
    low_speed, wheel = "t37_42_forces_clean_low_speed_5kft", "t37_54_val_wheel_force_clean"
    assert find_shared_samples(read(low_speed), read(wheel)) is None

import numpy as np
import pytest
import xarray as xr

import flighttest
from flightmech.errors import UnknownName
from flighttest.records.signals.sample_flags import Flag, sample_faults

RATE = 50.0


def noisy(seed=0, count=6000):
    rng = np.random.default_rng(seed)
    time = np.arange(count) / RATE
    return time, np.sin(0.7 * time) + rng.normal(0.0, 0.01, count)


def found(time, x):
    return [(m.kind, round(m.start * RATE), m.samples) for m in sample_faults(time, x, "q", RATE)]


def test_nothing_in_a_sound_channel():
    assert all(found(*noisy(seed)) == [] for seed in range(5))


def test_nothing_in_steps_of_a_control():
    time, x = noisy()
    step = np.where((time > 20) & (time < 21), 0.2, 0.0) - np.where(
        (time >= 21) & (time < 22), 0.2, 0.0
    )
    assert found(time, step) == []
    assert found(time, step + 0.001 * x) == []


@pytest.mark.parametrize("width", [1, 2, 3])
def test_spikes_of_up_to_three_samples(width):
    time, x = noisy()
    x[1000 : 1000 + width] += 1.0
    x[3000 : 3000 + width] -= 0.7
    assert found(time, x) == [("spike", 1000, width), ("spike", 3000, width)]


def test_a_burst_of_vibration_is_no_spike():
    time, x = noisy()
    x[2000:2100] += np.random.default_rng(1).normal(0.0, 1.0, 100)
    assert found(time, x) == []


def test_dropout_that_holds_the_last_value():
    time, x = noisy()
    x[2000:2060] = x[1999]
    assert found(time, x) == [("held", 1999, 61)]


def test_a_parked_aeroplane_is_no_dropout():
    time, x = noisy()
    x[:500] = x[500]
    assert found(time, x) == []


def test_sensor_that_dies_and_stays():
    time, x = noisy()
    x[4000:] = x[4000]
    assert found(time, x) == [("held", 4000, 2000)]


def test_missing_samples_are_runs():
    time, x = noisy()
    x[100:110] = x[500] = np.nan
    assert found(time, x) == [("missing", 100, 10), ("missing", 500, 1)]


def test_many_spans_end_in_one_for_the_rest():
    time, x = noisy()
    x[::100] = np.nan
    flags = sample_faults(time, x, "q", RATE)
    assert len(flags) == 20
    assert sum(flag.samples for flag in flags) == 60
    assert flags[-1].note == "41 spans"


def record(tmp_path):
    time, x = noisy()
    x[1000] += 1.0
    data = xr.Dataset({"q": ("time", x, {"units": "rad/s"})}, {"time": time})
    xr.DataTree.from_dict({"/imu": data}).to_netcdf(tmp_path / "f.nc", engine="h5netcdf")
    return flighttest.read(tmp_path / "f.nc")


def test_marks_and_faults_of_a_record(tmp_path):
    rows = flighttest.signals.flags(record(tmp_path))
    assert list(rows.columns) == ["leaf", "channel", "kind", "start", "stop", "samples", "note"]
    assert rows.iloc[0].tolist()[:6] == ["imu", "q", "spike", 20.0, 20.0, 1]
    assert flighttest.records.faults(record(tmp_path)) == ["imu: spikes: q 1 at 20 s"]


def test_marks_of_others_are_added_once_and_stay_in_the_file(tmp_path):
    flown = record(tmp_path)
    more = [Flag("q", "held", 30.0, 31.0, 50, "by hand")]
    flown = flighttest.signals.add_flags(
        flighttest.signals.add_flags(flown, "imu", more), "imu", more
    )
    flighttest.save_record(flown, tmp_path / "g.nc")
    again = flighttest.read(tmp_path / "g.nc")
    assert flighttest.signals.flags(again)["kind"].tolist() == ["spike", "held"]
    assert "held: q at 30 s (by hand)" in flighttest.records.faults(again)[1]
    with pytest.raises(UnknownName, match="kind of flag 'heldd'; near it: held"):
        flighttest.signals.add_flags(flown, "imu", [Flag("q", "heldd", 0, 0, 1)])
    with pytest.raises(UnknownName, match="unknown channel 'qq'"):
        flighttest.signals.add_flags(flown, "imu", [Flag("qq", "held", 0, 0, 1)])


@pytest.mark.parametrize("name", ["psi", "phi", "lon"])
def test_noise_of_an_angle_across_its_full_turn_is_no_spike(name):
    time, _ = noisy()
    around = (0.012 + np.random.default_rng(3).normal(0.0, 0.005, len(time))) % (
        2.0 * np.pi
    )  # single samples west of north
    assert {m.kind for m in sample_faults(time, around, "q", RATE)} == {"spike"}
    assert sample_faults(time, around, name, RATE) == []
    around[1000] = 1.5
    assert [(m.kind, m.samples) for m in sample_faults(time, around, name, RATE)] == [("spike", 1)]

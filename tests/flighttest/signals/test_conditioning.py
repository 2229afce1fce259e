import numpy as np
import pytest
import scipy
import xarray as xr

import flighttest
from flightmech.errors import OutOfRange, SchemaError, UnknownName
from flighttest.records.signals.resampling import is_control, lowpass, resample, resample_to_grid


def record(rate=50.0, stop=10.0, gap=None):
    t = np.arange(0, stop + 1e-9, 1 / rate)
    if gap:
        t = t[(t <= gap[0]) | (t >= gap[1])]
    fast = xr.Dataset(
        {
            "q": ("time", np.sin(t)),
            "delta_e": ("time", np.where(t % 2 < 1, 0.1, -0.1)),
            "psi": ("time", (3.1 + 0.1 * t) % (2 * np.pi)),
        },
        coords={"time": t},
        attrs={"rate": rate},
    )
    s = np.arange(0, stop, 1.0)
    slow = xr.Dataset({"mass": ("time", 2000.0 - s)}, coords={"time": s}, attrs={"rate": 1.0})
    return xr.DataTree.from_dict(
        {"/": xr.Dataset(attrs={"title": "test"}), "/imu": fast, "/fuel": slow}
    )


def test_lowpass_has_no_phase_and_minus_three_decibel_at_the_cutoff():
    rate, t = 100.0, np.arange(0, 40, 0.01)
    middle = slice(1000, 3000)
    for f, gain in ((0.5, 1.0), (3.0, 1 / np.sqrt(2)), (9.0, 0.0)):
        y = lowpass(np.sin(2 * np.pi * f * t), rate, 3.0)
        # 0.2 % at the cut-off: bilinear transform; at three times the cut-off 8 poles leave 3e-4
        assert np.abs(y - gain * np.sin(2 * np.pi * f * t))[middle].max() < 2e-3


@pytest.mark.parametrize("cutoff", [1e-300, 1e-7, 0.0, -1.0, 25.0, np.nan, np.inf])
def test_lowpass_refuses_cutoffs_without_a_filter(cutoff):
    """At 1e-300 Hz the steady state of the filter was a singular matrix."""
    with pytest.raises(OutOfRange, match="it must lie between 5e-05 and"):
        lowpass(np.arange(100.0), 50.0, cutoff)


def test_lowpass_keeps_a_straight_line():
    x = 3.0 + 0.2 * np.arange(500)
    y = lowpass(x, 50.0, 4.0)
    np.testing.assert_allclose(y[50:-50], x[50:-50], atol=1e-4)
    np.testing.assert_allclose(
        y, x, atol=0.03
    )  # within a seventh of a sample's step at the ends, which count as lost


@pytest.mark.parametrize("samples", [1, 2, 9, 600])
def test_lowpass_has_the_bytes_of_the_filter_of_scipy(samples):
    x = np.random.default_rng(samples).normal(size=samples).cumsum()
    design = 4.0 / (np.sqrt(2.0) - 1.0) ** 0.125
    # three time constants of the slowest pole, 0.28 s, in samples of 50 Hz; at least 0.5/cutoff
    pad = int(np.ceil(50.0 * max(0.125, 3.0 / (2.0 * np.pi * design * np.sin(np.pi / 8.0)))))
    sections = scipy.signal.butter(4, design, fs=50.0, output="sos")
    expected = scipy.signal.sosfiltfilt(sections, x, padlen=min(pad, samples - 1))
    np.testing.assert_array_equal(lowpass(x, 50.0, 4.0), expected)


def test_cutoff_above_half_the_rate():
    with pytest.raises(OutOfRange, match="cut-off 30 Hz at 50 samples per second"):
        lowpass(np.zeros(100), 50.0, 30.0)


def test_controls_do_not_overshoot_and_others_are_smooth():
    t = np.arange(0, 10, 0.1)
    step = np.where(t < 5.05, 0.0, 1.0)
    fine = np.arange(0, 9.9, 0.01)
    assert resample(t, step, fine, "delta_e").max() == 1.0
    assert resample(t, step, fine, "theta").max() > 1.05
    np.testing.assert_allclose(resample(t, np.sin(t), fine, "theta"), np.sin(fine), atol=1e-5)


def test_a_switch_keeps_its_states_on_any_grid():
    t = np.arange(0, 10, 0.1)
    cut_off = np.where(t < 5.05, 0.0, 1.0)
    for name in ("engine1.cutoff", "engine2.starter", "stall_warning", "tank.left.cutoff"):
        for step in (0.01, 0.37, 1.0):
            grid = np.arange(0.003, 9.9, step)  # no point halfway between two samples
            got = resample_to_grid(t, cut_off, grid, name)
            np.testing.assert_array_equal(got, np.where(grid < 5.05, 0.0, 1.0), name)
    # levers are controls, which do not overshoot
    fine = np.arange(0, 9.9, 0.01)
    for name in ("engine1.mixture", "engine1.prop_command", "tiller", "i_h"):
        assert resample(t, cut_off, fine, name).max() == 1.0


def test_what_counts_as_a_control():
    assert [
        is_control(n)
        for n in ("delta_e", "engine2.throttle", "gear", "F_column", "engine1.thrust", "theta")
    ] == [True] * 4 + [False] * 2


def test_rate_reduction_does_not_fold_down():
    t = np.arange(0, 40, 0.01)
    x = np.sin(2 * np.pi * 0.3 * t) + np.sin(
        2 * np.pi * 9.0 * t
    )  # 9 Hz would show as 1 Hz at 10 samples per second
    grid = np.arange(0, 40, 0.1)
    y = resample_to_grid(t, x, grid, "q")
    assert np.abs(y - np.sin(2 * np.pi * 0.3 * grid))[20:-20].max() < 0.01


def test_cut_has_one_clock_and_scalars_for_slow_channels():
    data = flighttest.cut(record(), 2.0, 6.0, rate=25.0)
    np.testing.assert_allclose(data["time"], 2.0 + np.arange(101) / 25)
    np.testing.assert_allclose(data["q"], np.sin(data["time"]), atol=1e-3)
    assert data["mass"].dims == ()
    assert float(data["mass"]) == 1996.0
    assert (data.attrs["start"], data.attrs["stop"], data.attrs["rate"], data.attrs["record"]) == (
        2.0,
        6.0,
        25.0,
        "test",
    )


@pytest.mark.parametrize("angle", ["psi", "phi", "lon"])
def test_cut_unwraps_an_angle_that_passes_its_full_turn(angle):
    turning = record(stop=40.0)
    values = (turning["imu/psi"].values + np.pi) % (2 * np.pi) - np.pi
    turning["imu"] = turning["imu"].to_dataset().drop_vars("psi").assign({angle: ("time", values)})
    data = flighttest.cut(turning, 25.0, 35.0, rate=40.0)
    np.testing.assert_allclose(np.diff(data[angle]), 0.1 / 40, atol=1e-6)


def test_window_outside_the_record():
    with pytest.raises(OutOfRange, match=r"window 8 \.\.\. 20 s; leaf imu holds 0 \.\.\. 10 s"):
        flighttest.cut(record(), 8.0, 20.0)


def test_window_that_ends_before_it_starts():
    with pytest.raises(OutOfRange, match="stop must lie at least one sample after start"):
        flighttest.cut(record(), 5.0, 4.0)


def test_gap_in_the_window():
    broken = record(gap=(4.0, 4.5))
    with pytest.raises(OutOfRange, match=r"leaf imu has a gap of 0\.5 s after 4 s"):
        flighttest.cut(broken, 3.0, 6.0)
    assert flighttest.cut(broken, 5.0, 8.0).sizes["time"] == 151


def test_nan_in_the_window_names_channel_and_time():
    broken = record()
    broken["imu/q"].values[200] = np.nan
    with pytest.raises(SchemaError, match=r"imu/q: 1 NaN samples, first at 4 s"):
        flighttest.cut(broken, 3.0, 6.0)
    assert np.isfinite(flighttest.cut(broken, 6.0, 8.0)["q"]).all()


def test_channel_by_name():
    assert flighttest.signals.channel(record(), "q").sizes["time"] == 501
    with pytest.raises(UnknownName, match=r"unknown channel 'qq'"):
        flighttest.signals.channel(record(), "qq")


def test_the_same_clock_gives_the_samples_themselves():
    time = 3.0 + np.arange(50) / 50.0
    x = np.random.default_rng(3).normal(size=50)
    grid = 3.0 + np.arange(50) * 0.02 + 1e-13  # rounded otherwise
    for name in ("p", "delta_e"):
        found = resample(time, x, grid, name)
        np.testing.assert_array_equal(found, x)
        assert found is not x
    moved = resample(time, x, grid + 1e-6, "p")
    assert 0.0 < np.abs(moved - x).max() < 1e-3

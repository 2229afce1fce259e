"""Gaps of a clock that split a reconstruction."""

import numpy as np
import pytest
import xarray as xr

from flightmech.errors import OutOfRange, SchemaError
from flighttest.records.sensors.instruments import IMU
from flighttest.records.sensors.measurements import MeasuredChannels, order_windows
from flighttest.records.signals.clock_gaps import (
    channel_gaps,
    clock_gaps,
    gaps_in,
    split_at_gaps,
)

CLOCK = np.arange(0.0, 20.0, 0.05)


def without(*gaps):
    kept = np.ones(CLOCK.size, bool)
    for start, stop in gaps:
        inside = (start - 1e-6 < CLOCK) & (stop - 1e-6 > CLOCK)
        kept &= ~inside
    return CLOCK[kept]


def record_at(time):
    channels = dict.fromkeys((*IMU, "phi", "theta"), ("time", np.zeros(time.size)))
    data = xr.Dataset(channels, {"time": time}, {"rate": 20.0})
    return xr.DataTree.from_dict({"/imu": data})


def test_a_short_gap_is_bridged_and_a_long_one_is_not():
    assert clock_gaps(without((5.0, 5.3))) == []
    ((start, stop),) = clock_gaps(without((5.0, 7.0)))
    assert (start, stop) == pytest.approx((4.95, 7.0))
    # a slow clock has long steps
    assert clock_gaps(np.arange(0.0, 60.0, 1.0)) == []
    assert clock_gaps(np.array([0.0, 9.0])) == []


def test_the_windows_of_a_reconstruction_end_at_gaps():
    record = record_at(without((5.0, 7.0), (7.5, 9.0)))
    # the half second between both gaps is left out
    assert np.allclose(order_windows(record, None), [(0.0, 4.95), (9.0, 19.95)])
    windows = [(0.0, 3.0), (4.0, 12.0)]
    assert np.allclose(order_windows(record, windows), [(0.0, 3.0), (9.0, 12.0)])
    assert order_windows(record_at(CLOCK), None) == [(0.0, CLOCK[-1])]


def test_blank_cells_of_the_inertial_unit_are_a_gap():
    """A recorder without samples leaves rows out, or leaves their cells blank."""
    data = record_at(CLOCK)["imu"].to_dataset()
    lost = (CLOCK > 6.01) & (CLOCK < 7.99)
    blank = data.where(xr.DataArray(~lost, dims="time"))
    record = xr.DataTree.from_dict({"/imu": blank})
    windows = order_windows(record, None)
    assert np.allclose(windows, [(0.0, 6.0), (8.0, 19.95)])
    channels = MeasuredChannels(record, windows)
    assert all(np.isfinite(channels.get(name)[1]).all() for name in (*IMU, "phi", "theta"))
    # one blank channel is a fault of this channel
    record = xr.DataTree.from_dict({"/imu": data.assign(q=blank["q"])})
    channels = MeasuredChannels(record, order_windows(record, None))
    with pytest.raises(SchemaError, match="imu/q: 39 NaN samples"):
        channels.get("q")


def test_a_window_of_gaps_alone_names_the_first_one():
    gaps = [(4.95, 7.0), (7.5, 9.0)]
    with pytest.raises(OutOfRange, match=r"a gap of 2\.05 s in the clock from 4\.95 to 7 s"):
        split_at_gaps([(4.5, 9.2)], gaps)
    # a window that ends where a gap begins does not contain it
    assert gaps_in((0.0, 4.95), gaps) == []


@pytest.mark.parametrize(("rate", "lost"), [(5.0, 2), (50.0, 24), (100.0, 49), (20.0, 10)])
def test_rounding_does_not_decide_about_a_gap(rate, lost):
    """Lost samples make whole multiples of a step: the limits lie between them."""
    grid = np.arange(0.0, 20.0, 1.0 / rate)
    found = set()
    for shift in (0.0, 0.1, 1e3 / 3.0, 86400.0):
        for first in range(10, 40):
            time = shift + np.delete(grid, np.arange(first, first + lost))
            found.add(len(clock_gaps(time)))
    assert len(found) == 1


def test_a_clock_without_a_long_step_needs_no_median(monkeypatch):
    # a plan lists the gaps of every channel of every record
    data = xr.Dataset({"delta_f": ("time", np.zeros(CLOCK.size))}, {"time": CLOCK})
    blank = data.copy(deep=True)
    blank["delta_f"][:40] = np.nan
    assert channel_gaps(blank, "delta_f") == [(0.0, 2.0)]
    monkeypatch.setattr(np, "median", None)
    assert clock_gaps(CLOCK) == []
    assert channel_gaps(data, "delta_f") == []

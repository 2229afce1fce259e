"""Blank cells of a control alone: a gap of this channel, bridged in the states and stated."""

import numpy as np
import pytest
import xarray as xr

from flightmech.errors import SchemaError
from flighttest.reconstruction.path_quantities import _channel_gaps, _recorded_channels

CLOCK = np.arange(0.0, 20.0, 0.05)
GRIDS = [np.arange(1.0, 9.0, 0.05), np.arange(12.0, 19.0, 0.05)]


def record(blank, value=np.nan):
    """A record whose ailerons are blank at some times; the elevator next to them is not."""
    aileron = np.where(blank, value, 0.1 * CLOCK)
    variables = {"delta_a": ("time", aileron), "delta_e": ("time", np.sin(CLOCK))}
    return xr.DataTree.from_dict({"/controls": xr.Dataset(variables, {"time": CLOCK})})


def test_a_line_bridges_the_blank_cells_and_the_gap_is_stated():
    tree = record((CLOCK > 4.01) & (CLOCK < 5.99))
    with pytest.warns(UserWarning, match=r"blank cells of delta_a from 4 to 6 s; leave"):
        columns = _recorded_channels(tree, GRIDS, set())
    assert np.allclose(columns["delta_a"], 0.1 * np.concatenate(GRIDS), atol=1e-3)
    assert _channel_gaps(tree) == {"delta_a": [(4.0, 6.0)]}


@pytest.mark.parametrize("times", [(10.01, 11.49), (4.01, 4.29)])
def test_blanks_between_windows_and_single_cells_are_no_gap(times, recwarn):
    columns = _recorded_channels(record((times[0] < CLOCK) & (times[1] > CLOCK)), GRIDS, set())
    assert np.isfinite(columns["delta_a"]).all()
    assert not recwarn


def test_a_channel_without_values_is_an_error():
    with pytest.raises(SchemaError, match="controls/delta_a: 300 NaN samples"):
        _recorded_channels(record((CLOCK > 0.5) & (CLOCK < 19.5)), GRIDS, set())
    with pytest.raises(SchemaError, match="controls/delta_a"):
        _recorded_channels(record(CLOCK[100] == CLOCK, np.inf), GRIDS, set())


def test_a_channel_blank_at_an_end_of_its_clock_has_a_gap_there():
    """A constant value would stand for the missing ailerons."""
    tree = record((CLOCK < 2.99) | (CLOCK > 17.01))
    with pytest.warns(
        UserWarning, match=r"delta_a from 0 to 3 s, delta_a from 17 to 19.95 s; leave"
    ):
        _recorded_channels(tree, GRIDS, set())
    assert _channel_gaps(tree) == {"delta_a": [(0.0, 3.0), (17.0, CLOCK[-1])]}
    assert _channel_gaps(record(CLOCK < 0.49)) == {}

"""Labelled data of arrays are those that the constructors of xarray make."""

import numpy as np
import pytest
import xarray as xr

from flightmech.support.array_files.labelled_arrays import make_dataset, make_variable


def test_a_dataset_is_that_of_xarray():
    time, x, map_ = np.linspace(0.0, 1.0, 5), np.arange(5.0), np.ones((5, 2))
    axes = {
        "time": make_variable("time", time, {"units": "s"}),
        "side": make_variable("side", np.array([-1.0, 1.0])),
    }
    variables = {
        "x": make_variable("time", x, {"units": "m"}),
        "map": make_variable(("time", "side"), map_),
    }
    made = make_dataset(variables, axes, {"title": "a record"})
    expected = xr.Dataset(
        {"x": ("time", x, {"units": "m"}), "map": (("time", "side"), map_)},
        {"time": ("time", time, {"units": "s"}), "side": [-1.0, 1.0]},
        {"title": "a record"},
    )
    xr.testing.assert_identical(made, expected)
    assert list(made.indexes) == ["time", "side"]
    assert made.sel(time=0.25)["x"] == 1.0


def test_lengths_that_contradict_each_other_are_an_error():
    time = make_variable("time", np.arange(4.0))
    with pytest.raises(ValueError, match="conflicting sizes for dimension 'time'"):
        make_dataset({"x": make_variable("time", np.arange(5.0))}, {"time": time})

"""Damaged files of paths, and tables of engines: refused with an error that names the file."""

import numpy as np
import pytest
import xarray as xr

from flightmech.aircraft.engine_deck import open_tables
from flightmech.errors import ParseError
from flightmech.support.input_files import file_kind
from flighttest.reconstruction.dynamics.saved_paths import open_path

TIME = np.arange(20) / 50


def write_path(path, time=TIME, error_dims=("error", "time"), names=("a", "b")):
    states = xr.Dataset({"V": ("time", 80.0 + TIME)}, {"time": time})
    sizes = {"error": 2, "time": TIME.size}
    change = np.zeros([sizes[axis] for axis in error_dims])
    errors = xr.Dataset({"V": (error_dims, change)}, {"error": list(names), "time": time})
    tree = xr.DataTree.from_dict({"states": states, "errors": errors})
    tree.to_netcdf(path, engine="h5netcdf")


def test_sound_path_is_read(tmp_path):
    write_path(tmp_path / "path.nc")
    assert open_path(tmp_path / "path.nc").states.sizes == {"time": 20}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"time": TIME[::-1]}, "a time that does not increase"),
        ({"time": np.where(TIME > 0.2, np.nan, TIME)}, "a time that is not a number"),
        ({"error_dims": ("time",)}, "a number for each error and time"),
        ({"names": ("a", "a")}, "errors without a name of their own"),
    ],
)
def test_content_that_later_computations_cannot_use_is_refused(tmp_path, change, words):
    write_path(tmp_path / "path.nc", **change)
    with pytest.raises(ParseError, match=words):
        open_path(tmp_path / "path.nc")


def test_damaged_bytes_are_refused_by_every_reader_of_hdf5(tmp_path):
    file = tmp_path / "path.nc"
    write_path(file)
    whole, refused = file.read_bytes(), 0
    for at in range(600, len(whole) - 64, 301):
        file.write_bytes(whole[:at] + b"\xff" * 64 + whole[at + 64 :])
        assert file_kind(file)  # does not raise
        for read in (open_path, open_tables):
            try:
                read(file)
            except (ParseError, OSError) as error:
                refused += "path.nc" in str(error)
            except Exception as error:
                assert type(error).__module__.startswith("flightmech"), (at, error)
    assert refused > 10

"""Damaged files of paths, and tables of engines: refused with an error that names the file."""

import numpy as np
import pytest
import xarray as xr

from flightmech.aircraft.propulsion.engine_deck import open_tables
from flightmech.errors import ParseError
from flightmech.support.file_kinds import file_kind
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


@pytest.mark.slow
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


@pytest.mark.parametrize("fault", [KeyError, RuntimeError, ValueError])
def test_any_error_of_hdf5_becomes_one_that_names_the_file(tmp_path, monkeypatch, fault):
    write_path(tmp_path / "path.nc")

    def fail(*arguments, **options):
        raise fault("bad object header")

    monkeypatch.setattr("h5py.File", fail)
    monkeypatch.setattr("xarray.open_datatree", fail)
    assert file_kind(tmp_path / "path.nc") == "a damaged netCDF-4 (HDF5) file"
    for read in (open_path, open_tables):
        with pytest.raises(ParseError, match=r"path\.nc.*bad object header"):
            read(tmp_path / "path.nc")

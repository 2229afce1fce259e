import errno
import resource
import signal

import h5py
import numpy as np
import pytest
import xarray as xr

from flightmech.support.array_files import netcdf_writing
from flightmech.support.array_files.netcdf_writing import ErrorKeepingFile, write_netcdf
from flightmech.support.atomic_write import written_atomically

# the two ways of writing: formed in memory, and through a temporary file
BOTH_WAYS = pytest.mark.parametrize("largest", [2**28, 0], ids=["memory", "file"])


@pytest.fixture
def tree():
    time = np.arange(500.0)
    imu = xr.Dataset({"q": ("time", np.sin(time))}, {"time": time}, {"rate": 1.0})
    imu["q"].values[3] = np.nan
    words = xr.Dataset({"word": ("row", np.array(["a", "bär"], object)), "n": ("row", [1, 2])})
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs={"title": "T"}), "/imu": imu, "/w": words})


@pytest.mark.slow
@BOTH_WAYS
def test_a_file_is_that_of_xarray(tree, tmp_path, monkeypatch, largest):
    monkeypatch.setattr(netcdf_writing, "LARGEST_IN_MEMORY", largest)
    write_netcdf(tree, tmp_path / "a.nc")
    tree.to_netcdf(tmp_path / "b.nc", engine="h5netcdf")
    found, expected = (xr.open_datatree(tmp_path / name, engine="h5netcdf") for name in TWO)
    with found, expected:
        assert found.identical(expected)


TWO = ("a.nc", "b.nc")


@BOTH_WAYS
@pytest.mark.skipif(not hasattr(signal, "SIGXFSZ"), reason="limits of POSIX")
def test_a_file_that_the_disk_does_not_take_is_an_error(tree, tmp_path, monkeypatch, largest):
    monkeypatch.setattr(netcdf_writing, "LARGEST_IN_MEMORY", largest)
    target = tmp_path / "r.nc"
    target.write_text("old")
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    # the file has more than 4000 bytes
    resource.setrlimit(resource.RLIMIT_FSIZE, (4000, hard))
    try:
        with (
            pytest.raises(OSError, match=r"not written.*make room") as caught,
            written_atomically(target) as part,
        ):
            write_netcdf(tree, part)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
        signal.signal(signal.SIGXFSZ, handler)
    assert caught.value.errno == errno.EFBIG
    assert caught.value.filename == str(target)
    assert [(item.name, item.read_text()) for item in tmp_path.iterdir()] == [("r.nc", "old")]


def test_a_file_that_keeps_an_error_writes_nothing_more(tmp_path):
    with ErrorKeepingFile(tmp_path / "a", "w+") as file:
        assert file.write(b"abc") == 3
        file.error = OSError(errno.EIO, "")
        assert file.write(b"def") == 3
        assert file.truncate(9) == 9
    assert (tmp_path / "a").read_bytes() == b"abc"


def test_a_large_file_is_compared_with_the_data(tree, tmp_path, monkeypatch):
    monkeypatch.setattr(netcdf_writing, "LARGEST_IN_MEMORY", 0)
    write = netcdf_writing._write_groups

    def write_and_spoil(groups, target, encoding):
        write(groups, target, encoding)
        target.flush()
        with h5py.File(target.name, "r+") as file:
            file["imu/q"][7] += 1e-9

    monkeypatch.setattr(netcdf_writing, "_write_groups", write_and_spoil)
    with pytest.raises(OSError, match=r"imu/q.*check the disk"):
        write_netcdf(tree, tmp_path / "a.nc")

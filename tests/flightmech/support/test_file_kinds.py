"""What a file is, in words; the kind of a damaged one is stated too."""

import h5py
import pytest

from flightmech.support.file_kinds import file_kind


@pytest.mark.parametrize(
    "fault", [OSError("truncated file"), RuntimeError("Unable to get group info")]
)
def test_a_damaged_file_raises_nothing(tmp_path, monkeypatch, fault):
    """What h5py raises on damaged bytes depends on the place of the damage."""

    def broken(self):
        raise fault

    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["q"] = [1.0, 2.0]
    assert file_kind(tmp_path / "a.h5") == "a netCDF-4 (HDF5) file"
    monkeypatch.setattr(h5py.File, "__iter__", broken)
    assert file_kind(tmp_path / "a.h5") == "a damaged netCDF-4 (HDF5) file"

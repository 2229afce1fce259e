"""The flight side of a case whose record is raw: reconstruction, and what is said when it does not settle."""

import pytest
import xarray as xr

import flighttest
from flightmech.errors import IdentificationError, SchemaError
from pom.case import read_case
from pom.flight import recorded_states


@pytest.fixture
def raw(write_case, trainer, tmp_path, monkeypatch):
    """A case with a raw record; the reconstruction is played by a function that remembers its prior."""
    case = write_case(case='aircraft = "trainer.toml"')
    (tmp_path / "trainer.toml").write_text(trainer.TOML)
    xr.Dataset({"q": ("time", [0.0, 0.0], {"units": "rad s-1"})}, {"time": [0.0, 0.1]}).to_netcdf(
        tmp_path / "record.nc", group="imu", engine="h5netcdf"
    )
    asked = {}

    def reconstruct(record, aircraft, prior=None):
        asked.update(channels=flighttest.overview(record)["channel"].tolist(), aircraft=aircraft.name, prior=prior)
        raise IdentificationError("the reconstruction did not settle in 40 iterations")

    monkeypatch.setattr(flighttest, "reconstruct", reconstruct)
    return read_case(case), asked


def test_what_helps_a_reconstruction_is_said(raw):
    case, asked = raw
    prior = xr.Dataset()
    with pytest.raises(IdentificationError, match=r"case a_case: .*did not settle.*--biases") as caught:
        recorded_states(case, prior)
    assert "reconstructed path as the record" in str(caught.value)
    assert asked["channels"] == ["q"]
    assert asked["prior"] is prior


def test_a_raw_record_needs_the_aircraft(write_case, tmp_path):
    path = write_case()
    xr.Dataset({"q": ("time", [0.0, 0.0], {"units": "rad s-1"})}, {"time": [0.0, 0.1]}).to_netcdf(
        tmp_path / "record.nc", group="imu", engine="h5netcdf"
    )
    with pytest.raises(SchemaError, match=r"case.aircraft: missing"):
        recorded_states(read_case(path))

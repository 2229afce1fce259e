"""The flight side of a case whose record is raw: reconstruction, and what is stated when it does
not settle.
"""

import pytest
import xarray as xr

import flighttest
from flightmech.errors import IdentificationError, SchemaError
from pom.cases.case import read_case
from pom.cases.reference_states import flight_states, recorded_states, window_problem


@pytest.fixture
def raw(write_case, trainer, tmp_path, monkeypatch):
    """A case with a raw record; the reconstruction is played by a function that remembers its
    prior.
    """
    case = write_case(case='aircraft = "trainer.toml"')
    (tmp_path / "trainer.toml").write_text(trainer.TOML)
    xr.Dataset({"q": ("time", [0.0, 0.0], {"units": "rad s-1"})}, {"time": [0.0, 0.1]}).to_netcdf(
        tmp_path / "record.nc", group="imu", engine="h5netcdf"
    )
    asked = {}

    def reconstruct(record, aircraft, prior=None):
        asked.update(
            channels=flighttest.records.overview(record)["channel"].tolist(),
            aircraft=aircraft.name,
            prior=prior,
        )
        raise IdentificationError("the reconstruction did not settle in 40 iterations")

    monkeypatch.setattr(flighttest, "reconstruct", reconstruct)
    return read_case(case), asked


def test_what_helps_a_reconstruction_is_stated(raw):
    case, asked = raw
    prior = xr.Dataset()
    with pytest.raises(
        IdentificationError, match=r"case a_case: .*did not settle.*--biases"
    ) as caught:
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


def test_a_path_of_one_sample_is_a_problem_of_the_window(write_case, lag_states, tmp_path):
    path = write_case()
    lag_states.isel(time=[0]).to_netcdf(tmp_path / "record.nc", engine="h5netcdf")
    problem = window_problem(read_case(path))
    assert problem.startswith(f"case {path}: the record {tmp_path / 'record.nc'} has fewer than")


def with_wind(path, word):
    path.write_text(path.read_text().replace("[drive]", f'[drive]\nwind = "{word}"'))
    return read_case(path)


def test_measured_wind_is_that_of_the_raw_record(write_case, lag_states, tmp_path):
    path = write_case()
    clock = [0.0, 5.0, 10.0]
    wind = xr.Dataset(
        {
            "wind_n": ("time", [2.0, 4.0, 4.0], {"units": "m s-1"}),
            "wind_e": ("time", [0.0, 0.0, 1.0], {"units": "m s-1"}),
        },
        {"time": clock},
    )
    wind.to_netcdf(tmp_path / "record.nc", group="air", engine="h5netcdf")
    states = lag_states.assign(wind_n=lag_states["V"] * 0.0 + 9.0)
    assert float(flight_states(read_case(path), states)["wind_n"][0]) == 9.0
    measured = flight_states(with_wind(path, "measured"), states)
    assert measured["wind_n"].sel(time=[1.0, 7.5], method="nearest").values == pytest.approx(
        [2.4, 4.0]
    )
    assert measured["wind_e"].sel(time=7.5, method="nearest") == pytest.approx(0.5)
    assert not measured["wind_d"].any()  # none is recorded


def test_a_record_without_wind_states_so(write_case, lag_states, tmp_path):
    path = write_case()
    xr.Dataset({"q": ("time", [0.0, 0.0], {"units": "rad s-1"})}, {"time": [0.0, 0.1]}).to_netcdf(
        tmp_path / "record.nc", group="imu", engine="h5netcdf"
    )
    with pytest.raises(SchemaError, match="holds no wind_n and wind_e; map them"):
        flight_states(with_wind(path, "measured"), lag_states)

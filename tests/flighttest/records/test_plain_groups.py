"""Groups of plain numbers are read as xarray reads them; all others are left to it."""

import h5py
import numpy as np
import pytest
import xarray as xr

from flightmech.errors import ParseError
from flighttest.reconstruction.dynamics.saved_paths import open_path
from flighttest.reconstruction.flight_programme import open_biases
from flighttest.records.stored_groups import plain_group

TIME = np.arange(5) / 50.0


def states():
    data = {
        "V": (
            "time",
            np.array([80.0, 81.0, np.nan, -0.0, 84.0]),
            {"units": "m s-1", "long_name": "true airspeed"},
        ),
        "alpha": ("time", np.linspace(0.0, 0.1, 5), {"units": "rad"}),
        "theta": (
            "time",
            np.linspace(0.1, 0.2, 5),
            {"units": "rad", "limits": np.array([-1.0, 1.0]), "column": 3},
        ),
        "error.alpha": (("error", "time"), np.ones((2, 5), np.float32)),
        "mass": ((), 2200.0),
        "held": ("error", np.array([0, 1], np.int8)),
        "unit": ("error", ["rad", "Pa"]),
        "bare": ("axis", np.arange(3.0)),  # a dimension without a coordinate
    }
    return xr.Dataset(
        data,
        {"time": ("time", TIME, {"units": "s"}), "error": ["bias.q", "vane"]},
        {"title": "a flight", "step": 0.02},
    )


def read(path, group="/"):
    with h5py.File(path) as file:
        return plain_group(file[group])


@pytest.mark.slow
def test_a_group_is_what_xarray_reads(tmp_path):
    packed = {"V": {"zlib": True}}
    states().to_netcdf(tmp_path / "path.nc", group="states", engine="h5netcdf", encoding=packed)
    found, due = (
        read(tmp_path / "path.nc", "states"),
        xr.load_dataset(tmp_path / "path.nc", group="states", engine="h5netcdf"),
    )
    assert found.identical(due)
    assert list(found.variables) == list(due.variables)
    assert found["V"].values.tobytes() == due["V"].values.tobytes()
    assert {name: item.dtype for name, item in found.variables.items()} == {
        name: item.dtype for name, item in due.variables.items()
    }
    assert [type(x) for x in found["theta"].attrs.values()] == [
        type(x) for x in due["theta"].attrs.values()
    ]
    kept = open_path(tmp_path / "path.nc")
    assert kept.states.identical(due)
    assert kept.errors is None
    assert kept.biases is None
    bare = open_path(tmp_path / "path.nc", described=False).states
    assert bare.equals(due)
    assert bare.attrs == due.attrs
    assert not any(item.attrs for item in bare.variables.values())


OTHERS = {
    "scaled": (("time", TIME), {"scale_factor": 0.1, "dtype": "int16", "_FillValue": -1}),
    "with a missing value": (("time", TIME), {"_FillValue": -9999.0}),
    "dates": (("time", np.array(["2026-01-01"] * 5, "datetime64[ns]")), {}),
    "durations": (("time", TIME, {"units": "seconds"}), {}),
    "flags": (("time", TIME > 0.05), {}),
}


@pytest.mark.nightly
@pytest.mark.parametrize("kind", OTHERS)
def test_what_needs_decoding_is_left_to_xarray(kind, tmp_path):
    item, encoding = OTHERS[kind]
    xr.Dataset({"V": ("time", TIME), "more": item}, {"time": TIME}).to_netcdf(
        tmp_path / "path.nc", engine="h5netcdf", encoding={"more": encoding}
    )
    assert read(tmp_path / "path.nc") is None
    with h5py.File(tmp_path / "path.nc") as file:
        assert plain_group(file, described=False) is None
    due = xr.load_dataset(tmp_path / "path.nc", engine="h5netcdf", decode_timedelta=False)
    assert open_path(tmp_path / "path.nc").states.identical(due)


def test_texts_are_read_however_they_are_kept(tmp_path):
    with h5py.File(tmp_path / "path.nc", "w") as file:
        file.create_dataset("time", data=TIME).make_scale("time")
        file["time"].attrs["units"] = "s"
        file["time"].attrs["empty"] = ""
        file["time"].attrs["one"] = np.array(["a"], object)
        file["time"].attrs["two numbers"] = np.array([1.0, 2.0])  # of the size of a text
        file["time"].attrs.create("ascii", "clock", dtype=h5py.string_dtype("ascii"))
    found, due = (
        read(tmp_path / "path.nc"),
        xr.load_dataset(tmp_path / "path.nc", engine="h5netcdf"),
    )
    assert found.identical(due)
    assert found["time"].attrs["ascii"] == "clock"


def test_a_scale_of_another_group_is_left_to_xarray(tmp_path):
    xr.Dataset(coords={"time": TIME}).to_netcdf(tmp_path / "path.nc", engine="h5netcdf")
    with h5py.File(tmp_path / "path.nc", "a") as file:
        values = file.create_group("states").create_dataset("V", data=TIME)
        values.dims[0].attach_scale(file["time"])
    assert read(tmp_path / "path.nc", "states") is None


def constants():
    names = ["bias.q", "vane"]
    square = ("parameter", "parameter_")
    return xr.Dataset(
        {
            "estimate": ("parameter", [0.001, 1.02]),
            "stderr": ("parameter", [1e-4, 0.01]),
            "prior": ("parameter", [0.0, 1.0]),
            "prior_stderr": ("parameter", [0.01, 0.1]),
            "unit": ("parameter", ["rad s-1", "1"]),
            "held": ("parameter", np.array([0, 1], np.int8)),
            "correlation": (square, [[1.0, 0.3], [0.3, 1.0]]),
            "prior_correlation": (square, np.eye(2)),
        },
        {"parameter": names, "parameter_": names},
        {"note": "constants"},
    )


@pytest.mark.slow
def test_constants_of_the_instruments_are_what_xarray_reads(tmp_path):
    biases = constants()
    states().to_netcdf(tmp_path / "path.nc", group="states", engine="h5netcdf")
    with pytest.raises(ParseError, match="no constants of a reconstruction"):
        open_biases(tmp_path / "path.nc")
    biases.to_netcdf(tmp_path / "path.nc", group="biases", mode="a", engine="h5netcdf")
    due = xr.load_dataset(tmp_path / "path.nc", group="biases", engine="h5netcdf")
    assert open_path(tmp_path / "path.nc").biases.identical(due)
    assert open_biases(tmp_path / "path.nc").identical(due.assign(held=due["held"].astype(bool)))
    with pytest.raises(FileNotFoundError):
        open_biases(tmp_path / "none.nc")


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("harmed", "fault"),
    [
        (lambda data: data.drop_vars("correlation"), r"without correlation \(parameter"),
        (lambda data: data.drop_vars("held"), "without held"),
        (lambda data: data.drop_vars("parameter_"), "without names"),
        (lambda data: data.assign(stderr=data["stderr"].mean()), "without stderr"),
        (lambda data: data.assign_coords(parameter=["vane", "vane"]), "each once"),
        (lambda data: data.assign_coords(parameter=["vane", "bias.q"]), "each once"),
        (lambda data: data.assign(estimate=np.nan * data["estimate"]), "estimate .* not a number"),
        (lambda data: data.assign(estimate=data["unit"]), "estimate .* not a number"),
        (lambda data: data.assign(stderr=-data["stderr"]), "stderr .* not positive"),
        (lambda data: data.assign(correlation=3.0 * data["correlation"]), "not a correlation"),
        (
            lambda data: data.assign(correlation=data["correlation"].cumsum("parameter")),
            "not a correlation",
        ),
    ],
)
def test_harmed_constants_are_refused(harmed, fault, tmp_path):
    """A prior of them would be a traceback, or a wrong number in silence."""
    states().to_netcdf(tmp_path / "path.nc", group="states", engine="h5netcdf")
    data = harmed(constants())
    data.to_netcdf(tmp_path / "path.nc", group="biases", mode="a", engine="h5netcdf")
    with pytest.raises(ParseError, match=fault):
        open_biases(tmp_path / "path.nc")

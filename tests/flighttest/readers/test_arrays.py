"""MATLAB v5 to v7.3, HDF5 and netCDF classic: written by scipy, h5py and by hand; and the real
MATLAB files of ../shared.
"""

from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

import flighttest
from flightmech.errors import ParseError, UnknownName
from flighttest.records.readers.opening import recognise_recording

pytestmark = pytest.mark.usefixtures("mat_files_in_this_process")

SHARED = Path(__file__).parents[3] / ".." / "shared" / "data" / "flight"
T = np.arange(50) / 100.0
NAMES = '[imu]\nq = { column = "q", unit = "rad/s" }\n'


def named(tmp_path, text):
    (tmp_path / "names.toml").write_text(text)
    return tmp_path / "names.toml"


def shared(name):
    file = SHARED / name
    if not file.exists():
        pytest.skip(f"needs the third-party recording {name} of ../shared")
    return file


def v73(path, fill):
    """A MATLAB v7.3 file: HDF5 behind a block of 512 bytes with MATLAB's header."""
    with h5py.File(path, "w", userblock_size=512) as file:
        fill(file)
    head = (
        b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Mar 12 10:00:00 2018 HDF5 "
        b"schema 1.00 ."
    )
    with path.open("r+b") as file:
        file.write(head.ljust(116) + bytes(8) + b"\x00\x02IM")
    return path


def matrix(group, name, values):
    """A MATLAB array of doubles: HDF5 keeps its columns as rows."""
    item = group.create_dataset(name, data=np.atleast_2d(values))
    item.attrs["MATLAB_class"] = np.bytes_("double")


def text(group, name, words):
    item = group.create_dataset(name, data=np.array([[ord(c)] for c in words], np.uint16))
    item.attrs["MATLAB_class"] = np.bytes_("char")


def test_v5_plain_arrays(tmp_path):
    scipy.io.savemat(
        tmp_path / "f.mat",
        {
            "t": T[:, None],
            "q": np.sin(T)[None, :],
            "note": "a doublet",
            "S": 30.0,
            "map": np.eye(7),
        },
    )
    assert recognise_recording(tmp_path / "f.mat") == "matlab5"
    record = flighttest.read(tmp_path / "f.mat", named(tmp_path, NAMES))
    np.testing.assert_array_equal(record["imu/q"].values, np.sin(T))
    np.testing.assert_array_equal(record["imu/time"].values, T)
    assert record.attrs["note"] == "a doublet"
    assert record.attrs["unmapped"] == "data/S"


def test_v5_structures_with_clocks_of_their_own(tmp_path):
    runs = {
        f"run_{i}": {"time": T + i, "gyro": np.stack([T, 2 * T, 3 * T], 1), "cal": {"gain": 2.0}}
        for i in (1, 2)
    }
    scipy.io.savemat(tmp_path / "f.mat", runs)
    record = flighttest.read(
        tmp_path / "f.mat",
        named(tmp_path, '[imu]\nq = { column = "run_2/gyro[1]", unit = "deg/s" }\n'),
    )
    np.testing.assert_allclose(record["imu/q"].values, np.radians(2 * T))
    np.testing.assert_allclose(record["imu/time"].values, T + 2)
    assert "run_1/cal.gain" in record.attrs["unmapped"]


def test_v5_channels_as_structures_with_units(tmp_path):
    data = {
        "time": {"data": T, "units": "sec", "description": "clock"},
        "Pitch": {"data": 3 * T, "units": "deg", "description": "attitude"},
    }
    scipy.io.savemat(tmp_path / "f.mat", {"flightdata": data})
    record = flighttest.read(
        tmp_path / "f.mat", named(tmp_path, '[ahrs]\ntheta = "flightdata/Pitch"\n')
    )
    np.testing.assert_allclose(record["ahrs/theta"].values, np.radians(3 * T))


def test_v5_structure_with_time_of_simulink(tmp_path):
    signals = np.array(
        [{"values": T[:, None] * k, "label": name} for k, name in ((1, "q"), (2, "theta"))],
        dtype=object,
    )
    scipy.io.savemat(tmp_path / "f.mat", {"out": {"time": T, "signals": signals}})
    record = flighttest.read(
        tmp_path / "f.mat", named(tmp_path, '[a]\ntheta = { column = "out/theta", unit = "rad" }\n')
    )
    np.testing.assert_allclose(record["a/theta"].values, 2 * T)


def test_rate_instead_of_a_clock(tmp_path):
    scipy.io.savemat(tmp_path / "f.mat", {"q": np.sin(T)})
    with pytest.raises(
        UnknownName,
        match=r"unknown time column 'time'; allowed: q; table data; name the clock.*or give its "
        r"rate",
    ):
        flighttest.read(tmp_path / "f.mat", named(tmp_path, NAMES))
    record = flighttest.read(
        tmp_path / "f.mat", named(tmp_path, '[time]\nrate = "100 Hz"\n' + NAMES)
    )
    np.testing.assert_allclose(record["imu/time"].values, T)


def test_v73_arrays_structures_texts_and_cells(tmp_path):
    def fill(file):
        matrix(file, "t", T)
        matrix(file, "q", np.sin(T)[:, None])
        text(file, "string", "three two one one")
        matrix(file.create_group("#refs#"), "a", np.arange(3.0))
        cell = file.create_dataset(
            "c", data=np.array([[file["#refs#/a"].ref]], dtype=h5py.ref_dtype)
        )
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
        data = file.create_group("flightdata")
        for name, values, unit in (("time", T + 1, "sec"), ("Pitch", 3 * T, "deg")):
            part = data.create_group(name)
            part.attrs["MATLAB_class"] = np.bytes_("struct")
            matrix(part, "data", values)
            text(part, "units", unit)

    file = v73(tmp_path / "f.mat", fill)
    assert recognise_recording(file) == "matlab73"
    record = flighttest.read(file, named(tmp_path, NAMES + '[ahrs]\ntheta = "flightdata/Pitch"\n'))
    np.testing.assert_array_equal(record["imu/q"].values, np.sin(T))
    np.testing.assert_allclose(record["ahrs/theta"].values, np.radians(3 * T))
    np.testing.assert_allclose(record["ahrs/time"].values, T + 1)
    assert record.attrs["format"] == "MATLAB v7.3"


def test_plain_hdf5_with_units_and_packing(tmp_path):
    with h5py.File(tmp_path / "f.bin", "w") as file:
        group = file.create_group("run/imu")
        group["t"] = np.arange(50) * 10
        group["t"].attrs["units"] = "ms"
        packed = group.create_dataset("q", data=np.append(np.arange(49), -999).astype("i2"))
        packed.attrs.update(
            units="deg/s", scale_factor=0.5, add_offset=10.0, _FillValue=np.int16(-999)
        )
        file.attrs["pilot"] = "seat 1"
    record = flighttest.read(tmp_path / "f.bin", named(tmp_path, '[imu]\nq = "run/imu/q"\n'))
    np.testing.assert_allclose(np.degrees(record["imu/q"].values[:49]), 10 + 0.5 * np.arange(49))
    assert np.isnan(record["imu/q"].values[49])
    np.testing.assert_allclose(record["imu/time"].values, np.arange(50) / 100)
    assert record.attrs["pilot"] == "seat 1"


def test_clock_since_a_date(tmp_path):
    with h5py.File(tmp_path / "f.h5", "w") as file:
        file["time"], file["q"] = np.arange(3.0), np.arange(3.0)
        file["time"].attrs["units"] = "minutes since 2018-03-12 10:00:00"
    record = flighttest.read(tmp_path / "f.h5", named(tmp_path, NAMES))
    np.testing.assert_allclose(record["imu/time"].values, [0, 60, 120])
    assert record.attrs["start"] == "2018-03-12T10:00:00"


def test_netcdf_classic(tmp_path):
    with scipy.io.netcdf_file(tmp_path / "f.nc", "w") as file:
        file.createDimension("time", 50)
        for name, values, unit in (("time", T, "s"), ("q", T, "deg/s")):
            variable = file.createVariable(name, "d", ("time",))
            variable[:] = values
            variable.units = unit
    assert recognise_recording(tmp_path / "f.nc") == "netcdf3"
    record = flighttest.read(tmp_path / "f.nc")
    np.testing.assert_allclose(record["data/q"].values, np.radians(T))


def test_objects_of_matlab_classes_are_reported(tmp_path):
    scipy.io.savemat(tmp_path / "f.mat", {"note": "text only"})
    with pytest.raises(
        ParseError,
        match=r"no array of numbers; expected plain arrays or structures; convert objects",
    ):
        flighttest.read(tmp_path / "f.mat", named(tmp_path, NAMES))


CITATION500 = """
[imu]
p = { column = "p", unit = "rad/s" }
q = { column = "q", unit = "rad/s" }
r = { column = "r", unit = "rad/s" }
phi = { column = "phi", unit = "rad" }
theta = { column = "theta", unit = "rad" }
az = { column = "Az", unit = "m/s2" }
vd = { column = "w_n", unit = "m/s" }
gear = { column = "gear", unit = "1" }
"""


@pytest.mark.parametrize(
    "name",
    [
        "da3211_2",
        "da3211_2021",
        "dadoublet_1",
        "de3211_1",
        "de3211_2021",
        "dr3211_1",
        "drdoublet_2021",
    ],
)
def test_citation_500_simulation(tmp_path, name):
    record = flighttest.read(shared(f"citation500_sim/{name}.mat"), named(tmp_path, CITATION500))
    data = record["imu"].to_dataset()
    assert data.attrs["rate"] == pytest.approx(100.0)
    theta_dot = np.gradient(data["theta"].values, data["time"].values)
    expected = data["q"].values * np.cos(data["phi"].values) - data["r"].values * np.sin(
        data["phi"].values
    )
    # README of the data set: attitude kinematics to 1e-4 rad/s; the central difference of 100 Hz
    # samples adds 1e-4 in the steps
    assert np.sqrt(np.mean((theta_dot - expected)[1:-1] ** 2)) < 1e-4
    assert "Manoeuvre" in record.attrs["string"]
    assert flighttest.records.faults(record) == []


def test_uav_log_extract(tmp_path):
    file = shared("uav_art_3kg/ProcessedData_2022_05_07_11_13_57.mat")
    text = (
        '[imu]\nq = { column = "el_1/q", unit = "rad/s" }\ntheta = { column = "el_1/pitch", '
        'unit = "deg" }\n'
    )
    text += '[other]\np = { column = "ail_3/p", unit = "rad/s" }\n'
    record = flighttest.read(file, named(tmp_path, text))
    data = record["imu"].to_dataset()
    assert data.attrs["rate"] == pytest.approx(50.0, rel=0.02)
    theta_dot = np.gradient(data["theta"].values, data["time"].values)
    # 0.86 seen: the attitude is repeated between its updates, which makes its plain differences
    # noisy; wrong columns give next to nothing
    assert np.corrcoef(theta_dot, data["q"].values)[0, 1] > 0.8
    assert len(record["other"]["p"]) > 200


def test_packed_numbers_of_both_byte_orders_in_one_file(tmp_path):
    packed = np.arange(50) - 20
    for kind, scale in (("<i2", 0.5), (">i2", np.float32(0.25)), ("<i4", np.array([2.0]))):
        with h5py.File(tmp_path / "packed.h5", "w") as file:
            file["imu/time"] = T
            # the scale has its own type, and may be a number or an array of one
            for name, order in (("q", kind), ("r", "<i2")):
                data = file.create_dataset(f"imu/{name}", data=packed, dtype=order, chunks=(7,))
                data.attrs["scale_factor"], data.attrs["_FillValue"] = scale, np.int64(-20)
        text = NAMES + 'r = { column = "r", unit = "rad/s" }\n'
        record = flighttest.read(tmp_path / "packed.h5", named(tmp_path, text))
        for name in ("q", "r"):
            values = record["imu"][name].values
            assert np.isnan(values[0])
            assert np.array_equal(values[1:], packed[1:] * float(np.ravel(scale)[0]))

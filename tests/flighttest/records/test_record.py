import gzip
import json
import os
import sys

import numpy as np
import pytest
import xarray as xr

import flighttest
from flightmech.errors import ParseError, SchemaError, UnknownName
from flighttest.records.record import (
    channel_leaves,
    faults,
    find_channel_leaf,
    marked_manoeuvres,
    overview,
)

CSV = "time,alpha,flap\ns,deg,-\n0.0,1.0,0\n0.1,2.0,0.5\n0.2,3.0,1\n0.3,4.0,1\n"
NAMES = '[air]\nalpha = "alpha"\n[controls]\ndelta_f = { column = "flap", scale = "40 deg" }\n'


@pytest.fixture
def names(tmp_path):
    file = tmp_path / "names.toml"
    file.write_text(NAMES)
    return file


def csv(tmp_path, text, name="flight.csv"):
    file = tmp_path / name
    file.write_bytes(gzip.compress(text.encode()) if name.endswith(".gz") else text.encode())
    return file


def netcdf(path, leaves, **attrs):
    xr.DataTree.from_dict({"/": xr.Dataset(attrs=attrs), **leaves}).to_netcdf(
        path, engine="h5netcdf"
    )
    return path


def leaf(time, **columns):
    return xr.Dataset(
        {n: ("time", np.asarray(x, float), {"units": u}) for n, (x, u) in columns.items()},
        coords={"time": np.asarray(time, float)},
    )


@pytest.mark.parametrize("name", ["flight.csv", "flight.csv.gz"])
def test_csv_with_units_in_the_second_line(tmp_path, names, name):
    record = flighttest.read(csv(tmp_path, CSV, name), names)
    assert channel_leaves(record) == {"alpha": "air", "delta_f": "controls"}
    np.testing.assert_allclose(np.degrees(record["air/alpha"].values), [1, 2, 3, 4])
    np.testing.assert_allclose(np.degrees(record["controls/delta_f"].values), [0, 20, 40, 40])
    assert record["controls/delta_f"].attrs["calibration"] == "40 deg * flap"
    assert record.attrs["source_file"] == name


def test_csv_with_units_in_the_heading(tmp_path, names):
    text = "# a comment\ntime [s], alpha [rad], flap [-], other\n0,0.1,0,7\n0.1,0.2,0,7\n"
    record = flighttest.read(csv(tmp_path, text), names)
    np.testing.assert_allclose(record["air/alpha"].values, [0.1, 0.2])
    assert record.attrs["unmapped"] == "data/other"


def test_csv_cell_that_is_no_number(tmp_path, names):
    with pytest.raises(ParseError, match=r"line 4: found '2.x' in column 'alpha'"):
        flighttest.read(csv(tmp_path, CSV.replace("0.1,2.0", "0.1,2.x")), names)


def test_empty_csv(tmp_path, names):
    with pytest.raises(ParseError, match="an empty file"):
        flighttest.read(csv(tmp_path, ""), names)
    with pytest.raises(ParseError, match="comma-separated columns"):
        flighttest.read(csv(tmp_path, "# nothing but this\n"), names)


def test_csv_without_the_clock(tmp_path, names):
    with pytest.raises(UnknownName, match=r"unknown time column 'time'; near it: tme"):
        flighttest.read(csv(tmp_path, CSV.replace("time,", "tme,")), names)


def test_column_of_the_map_is_not_there(tmp_path, names):
    with pytest.raises(UnknownName, match=r"unknown column 'alpha'; near it: alfa"):
        flighttest.read(csv(tmp_path, CSV.replace("alpha", "alfa")), names)


def test_column_without_a_canonical_name_needs_a_map(tmp_path):
    with pytest.raises(
        UnknownName, match="1 columns without a canonical name \\(flap\\); pass names="
    ):
        flighttest.read(csv(tmp_path, CSV))


def test_netcdf_leaves_keep_their_clocks(tmp_path):
    file = netcdf(
        tmp_path / "r.nc",
        {"/a": leaf([0, 1, 2], q=([1, 2, 3], "deg/s")), "/b": leaf([0, 0.5], V=([10, 20], "kt"))},
        title="two clocks",
    )
    record = flighttest.read(file)
    assert find_channel_leaf(record, "V") == "b"
    assert find_channel_leaf(record, "theta") is None
    np.testing.assert_allclose(record["b/V"].values, np.array([10, 20]) * 1852 / 3600)
    assert record["a"].attrs["rate"] == 1.0
    assert record.attrs["title"] == "two clocks"


def test_aileron_is_formed_from_both_sides(tmp_path):
    file = netcdf(
        tmp_path / "r.nc",
        {"/c": leaf([0, 1], delta_a_left=([-0.1, 0.0], "rad"), delta_a_right=([0.1, 0.2], "rad"))},
    )
    np.testing.assert_allclose(flighttest.read(file)["c/delta_a"].values, [0.1, 0.1])


def test_column_of_another_group(tmp_path):
    names = tmp_path / "n.toml"
    names.write_text('[x]\nq = "a/q"\nV = "b/V"\n')
    file = netcdf(
        tmp_path / "r.nc",
        {"/a": leaf([0, 1], q=([1, 2], "deg/s")), "/b": leaf([0, 0.5], V=([10, 20], "kt"))},
    )
    with pytest.raises(SchemaError, match=r"different clocks \(a, b\); make a leaf of each"):
        flighttest.read(file, names)


def test_not_a_netcdf_file(tmp_path):
    file = tmp_path / "r.nc"
    file.write_text("no")
    file.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    with pytest.raises(ParseError, match="a whole HDF5, netCDF-4"):
        flighttest.read(file)


def test_unknown_kind_of_file(tmp_path):
    file = tmp_path / "r.xls"
    file.write_bytes(b"\xd0\xcf\x11\xe0 a spreadsheet" + bytes(200))
    with pytest.raises(ParseError, match="one of the formats CSV, netCDF"):
        flighttest.read(file)


def test_clock_that_runs_backwards(tmp_path, names):
    with pytest.raises(SchemaError, match=r"time does not rise: 0\.2 s is followed by 0\.05 s"):
        flighttest.read(csv(tmp_path, CSV.replace("0.3,4.0", "0.05,4.0")), names)


def test_gaps_duplicates_and_nan_are_listed(tmp_path):
    time = [0.0, 0.1, 0.1, 0.2, 0.3, 1.3, 1.4]
    file = netcdf(tmp_path / "r.nc", {"/a": leaf(time, q=([1, 2, 2, 3, 4, np.nan, 6], "rad/s"))})
    record = flighttest.read(file)
    assert record["a"].sizes["time"] == 6
    found = " | ".join(faults(record))
    assert "gaps in the clock at 0.3 s (1 s)" in found
    assert "repeated time stamps dropped: 1" in found
    assert "NaN samples: q 1 from 1.3 s" in found


def test_known_latency_is_removed(tmp_path):
    t = np.arange(0, 5, 0.05)
    names = tmp_path / "n.toml"
    names.write_text('[a]\nq = { column = "q", delay = "100 ms" }\n')
    file = netcdf(tmp_path / "r.nc", {"/a": leaf(t, q=(np.sin(t - 0.1), "rad/s"))})
    record = flighttest.read(file, names)
    inside = slice(0, 95)
    np.testing.assert_allclose(
        record["a/q"].values[inside], np.sin(t)[inside], atol=1e-6
    )  # cubic spline, 20 Hz on 0.16 Hz


def test_manoeuvres_and_overview(tmp_path):
    flown = json.dumps([{"manoeuvre": "doublet", "control": "elevator", "start": 1.0, "end": 2.0}])
    record = flighttest.read(
        netcdf(tmp_path / "r.nc", {"/a": leaf([0, 1], q=([1, 2], "rad/s"))}, manoeuvres=flown)
    )
    assert marked_manoeuvres(record).iloc[0].to_dict() == {
        "manoeuvre": "doublet",
        "control": "elevator",
        "start": 1.0,
        "end": 2.0,
        "note": "",
    }
    row = overview(record).iloc[0]
    assert (row["leaf"], row["channel"], row["min"], row["max"], row["missing"]) == (
        "a",
        "q",
        1.0,
        2.0,
        0,
    )


@pytest.mark.parametrize(
    "text",
    ["{", "[" * 100_000, "9" * 5000, "[1]", "5"],
    ids=["cut", "deep", "digits", "no_rows", "no_list"],
)
def test_a_list_of_manoeuvres_that_is_none(text):
    record = xr.DataTree(xr.Dataset(attrs={"manoeuvres": text, "source_file": "run.nc"}))
    with pytest.raises(ParseError, match=r"run.nc: found"):
        marked_manoeuvres(record)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems refuse such a name")
def test_a_file_whose_name_is_no_text(tmp_path):
    file = tmp_path / os.fsdecode(b"fl\xfcgel.csv")
    file.write_text("time [s],q [rad/s]\n0,1\n0.1,2\n0.2,3\n")
    record = flighttest.read(file)
    assert record.attrs["source_file"] == "fl?gel.csv"
    flighttest.save_record(record, tmp_path / "record.nc")


def test_a_leaf_of_several_tables_keeps_the_flags_of_each(tmp_path):
    """The second table has a stored spike; a missing sample is stored and found again."""
    time = np.arange(0.0, 2.0, 0.1)
    p = np.sin(time)
    p[7] = np.nan
    tables = {"/a": leaf(time, p=(p, "rad/s")), "/b": leaf(time, q=(np.cos(time), "rad/s"))}
    tables["/a"].attrs["flags"] = json.dumps([["p", "missing", time[7], time[7], 1, ""]])
    tables["/b"].attrs["flags"] = json.dumps([["q", "spike", 1.0, 1.0, 1, ""]])
    file = netcdf(tmp_path / "two.nc", tables)
    (tmp_path / "two.toml").write_text('[imu]\np = "a/p"\nq = "b/q"\n')
    record = flighttest.read(file, tmp_path / "two.toml")
    assert json.loads(record["imu"].attrs["flags"]) == [
        ["p", "missing", time[7], time[7], 1, ""],
        ["q", "spike", 1.0, 1.0, 1, ""],
    ]
    assert record["imu"].attrs["missing"] == "p 1 from 0.7 s"

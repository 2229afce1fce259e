"""Columns of a CSV file under one heading, and columns without a heading."""

import json

import numpy as np
import pytest

import flighttest
from flightmech.errors import ParseError, UnknownName
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.opening import open_recording

MAP = '[air]\nh_baro = "Alt"\nalpha = { column = "AOA", unit = "deg" }\n'


def read(tmp_path, lines, names=MAP):
    (tmp_path / "a.csv").write_text("\n".join(lines))
    (tmp_path / "n.toml").write_text(names)
    return flighttest.read(tmp_path / "a.csv", tmp_path / "n.toml")


def test_a_column_that_stands_there_twice_is_read_once(tmp_path):
    lines = ["t,Alt (ft),AOA,Alt (ft)", "0,1000,1,1000", "1,,1,", "2,1200,2,1200"]
    record = read(tmp_path, lines)
    np.testing.assert_allclose(record["air/h_baro"].values, [304.8, np.nan, 365.76])
    assert json.loads(record.attrs["notes"]) == [
        "2 columns 'Alt' hold the same; the first one is read"
    ]
    assert record.attrs["unmapped"] == ""


@pytest.mark.parametrize("optional", ["", ", optional = true"])
def test_two_quantities_under_one_heading_are_not_taken_for_each_other(tmp_path, optional):
    lines = ["t,Alt (ft),AOA,Alt (ft)", "0,1000,1,1400", "1,1100,1,1500", "2,1200,2,1600"]
    with pytest.raises(ParseError, match=r"called Alt\.1, Alt\.2 from left to right.*h_baro"):
        read(tmp_path, lines, MAP.replace('"Alt"', '{ column = "Alt"' + optional + " }"))
    record = read(tmp_path, lines, MAP.replace('"Alt"', '"Alt.2"'))
    np.testing.assert_allclose(record["air/h_baro"].values, [426.72, 457.2, 487.68])
    assert record.attrs["unmapped"] == "data/Alt.1"
    without = read(tmp_path, lines, '[air]\nalpha = { column = "AOA", unit = "deg" }\n')
    assert json.loads(without.attrs["left_out"])[0][0] == "data/Alt"


def test_units_of_one_heading_may_differ(tmp_path):
    lines = ["t,Alt,AOA,Alt", "s,ft,deg,m", "0,1000,1,1000", "1,1000,1,1000"]
    record = read(tmp_path, lines, MAP.replace('"Alt"', '"Alt.2"'))
    np.testing.assert_allclose(record["air/h_baro"].values, [1000.0, 1000.0])


def test_two_clocks_of_one_name_are_no_clock(tmp_path):
    lines = ["time,AOA,time", "0,1,0.5", "1,1,1.5", "2,2,2.5"]
    own = '[air]\nalpha = { column = "AOA", unit = "deg" }\n'
    with pytest.raises(UnknownName, match=r"time\.1"):
        read(tmp_path, lines, own)
    record = read(tmp_path, lines, '[time]\ncolumn = "time.2"\n' + own)
    np.testing.assert_allclose(record["air/time"].values, [0.5, 1.5, 2.5])


def test_stamps_that_stand_there_twice(tmp_path):
    lines = ["UTC,AOA,UTC", *(f"10:22:3{i},1,10:22:3{i}" for i in range(4))]
    record = read(tmp_path, lines, '[air]\nalpha = { column = "AOA", unit = "deg" }\n')
    np.testing.assert_allclose(record["air/time"].values, 37350.0 + np.arange(4))


def test_columns_without_a_heading(tmp_path):
    (tmp_path / "a.csv").write_text("t,,AOA,\n0,7,1,\n1,8,1,\n")
    recording = open_recording(tmp_path / "a.csv", NameMap({}))
    assert list(recording.tables["data"].columns) == ["t", "column 2", "AOA"]

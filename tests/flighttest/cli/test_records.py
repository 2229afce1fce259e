"""`flight info` and `flight convert` on recordings that nobody has mapped yet."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parents[1]))
from recorders import chapter10, ulog

import flighttest
from flightmech.errors import UnknownName
from flighttest.cli.actions import contents
from flighttest.cli.group import flight


def call(*arguments):
    return CliRunner().invoke(flight, list(map(str, arguments)), catch_exceptions=False)


@pytest.fixture
def log(tmp_path):
    rows = [(1_000_000 + 20_000 * i, 0.01 * i, 0.0, 0.0) for i in range(100)]
    rows[40] = (rows[40][0], 50.0, 0.0, 0.0)
    fields = [("uint64_t", "timestamp"), ("float[3]", "xyz")]
    (tmp_path / "flight.ulg").write_bytes(
        ulog.written({("vehicle_angular_velocity", 0): (fields, rows)})
    )
    return tmp_path / "flight.ulg"


def test_info_lists_tables_and_columns(log):
    done = call("info", log)
    assert done.exit_code == 0
    assert "flight.ulg: PX4 ULog" in done.output
    assert "vehicle_angular_velocity: 100 samples, 50 Hz, 1 ... 2.98 s" in done.output
    found = json.loads(call("info", log, "--json").output)
    assert [column["column"] for column in found["tables"][0]["columns"]] == [
        "xyz[0]",
        "xyz[1]",
        "xyz[2]",
    ]


def test_info_of_many_columns_and_of_a_long_name_is_short(tmp_path, monkeypatch):
    monkeypatch.setattr(contents, "_MOST_ROWS", 3)
    names = ["time", "x" * 100_000, "a", "b", "c"]
    lines = [",".join(names), "0,1,1,1,1", "1,1,1,1,1", "2,1,1,1,1"]
    (tmp_path / "f.csv").write_text("\n".join(lines))
    output = call("info", tmp_path / "f.csv").output
    assert len(output) < 2000
    assert "(99900 characters left out)" in output
    assert "... 2 more columns; --json shows all" in output
    found = json.loads(call("info", tmp_path / "f.csv", "--json").output)
    assert [column["column"] for column in found["tables"][0]["columns"]] == names


def test_info_reports_a_clock_that_cannot_be_used(tmp_path):
    (tmp_path / "f.csv").write_text("time,q\n0,1\n1,2\n-5,3\n-4,4\n")
    assert "time does not rise: 1 s is followed by -5 s" in call("info", tmp_path / "f.csv").output


def test_info_of_chapter_10_lists_channels(tmp_path):
    chapter10.fresh()
    words = [(0, 0, chapter10.bnr(0o210, 15, 2048.0, 250.0))]
    (tmp_path / "f.ch10").write_bytes(
        b"".join(chapter10.arinc(12, 1000 * k, words) for k in range(3))
    )
    lines = call("info", tmp_path / "f.ch10").output.splitlines()
    assert lines[0] == "f.ch10: IRIG 106 Chapter 10"
    assert lines[-1].split() == ["12", "ARINC", "429", "3", "210"]


def test_convert_makes_a_record_in_canonical_names(log, tmp_path):
    done = call("convert", log, "--names", "px4", "-o", tmp_path / "flight.nc")
    assert done.exit_code == 0
    assert "! rates: spikes: p 1 at 1.8 s" in done.output
    assert "written: " in done.output
    assert "3 channels in 1 leaves" in done.output
    record = flighttest.read(tmp_path / "flight.nc")
    np.testing.assert_allclose(record["rates/p"].values[:40], 0.01 * np.arange(40), rtol=1e-6)
    assert flighttest.records.faults(record) == ["rates: spikes: p 1 at 1.8 s"]


def test_convert_without_a_map_names_the_shipped_ones(log, tmp_path):
    with pytest.raises(
        UnknownName, match=r"a name map in TOML or a shipped one \(ardupilot, px4\)"
    ):
        call("convert", log, "-o", tmp_path / "flight.nc")
    assert not (tmp_path / "flight.nc").exists()


def test_map_that_is_nowhere(log, tmp_path):
    done = call("convert", log, "--names", "px5", "-o", tmp_path / "flight.nc")
    assert done.exit_code == 2
    assert (
        "no file 'px5' and no shipped map of that name; shipped are ardupilot, px4" in done.output
    )

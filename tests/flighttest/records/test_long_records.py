"""Long records are converted in threads, with the channels, attributes and flags of one thread."""

import numpy as np
import pytest

import flighttest
from flightmech.errors import AeromatchError
from flighttest.records import channel_groups

HEAD = "time [s],P [deg/s],Q [deg/s],R [deg/s],ALPHA [deg]\n"
NAMES = """[imu]
p = "P"
q = "Q"
r = "R"
alpha_vane = "ALPHA"
"""


def test_threads_change_nothing(tmp_path, monkeypatch):
    rng = np.random.default_rng(4)
    rows = rng.standard_normal((400, 4)).cumsum(axis=0)
    rows[50:60, 1] = np.nan
    rows[200, 2] += 300.0
    lines = [f"{k / 50:.2f}," + ",".join(f"{x:.5f}" for x in row) for k, row in enumerate(rows)]
    file = tmp_path / "r.csv"
    file.write_text(HEAD + "\n".join(lines).replace("nan", "") + "\n", encoding="utf-8")
    names = tmp_path / "names.toml"
    names.write_text(NAMES, encoding="utf-8")
    one = flighttest.read(file, names)
    monkeypatch.setattr(channel_groups, "_LARGE", 1)
    monkeypatch.setattr(channel_groups.os, "cpu_count", lambda: 3)
    assert flighttest.read(file, names).identical(one)
    assert one["imu"].attrs["flags"] != "[]"


def test_the_error_is_that_of_the_first_channel(monkeypatch):
    monkeypatch.setattr(channel_groups, "_LARGE", 1)
    monkeypatch.setattr(channel_groups.os, "cpu_count", lambda: 3)

    def fail(name):
        if name != "a":
            raise AeromatchError(name)
        return name

    assert list(channel_groups.map_large(str.upper, ["a", "b"], 10)) == ["A", "B"]
    with pytest.raises(AeromatchError, match=r"^b$"):
        list(channel_groups.map_large(fail, ["a", "b", "c"], 10))

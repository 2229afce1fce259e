"""Slower channels in the rows of faster ones against dropouts."""

import numpy as np
import pytest

import flighttest
from flighttest.records.signals.blank_cells import clocks_of_rows, is_slower

N = 1500
TIME = 0.02 * np.arange(N)
CHANCE = np.random.default_rng(3).random(N)


def rows(steps):
    filled = np.zeros(N, bool)
    filled[np.asarray(steps, int)] = True
    return filled


SLOWER = {
    "every fifth": rows(np.arange(0, N, 5)),
    "every second": rows(np.arange(1, N, 2)),
    "20 Hz": rows(np.round(np.arange(0, N - 3, 2.5))),
    "40 Hz": np.arange(N) % 5 != 4,
    "with an outage": rows(np.arange(0, N, 5)) & ~((TIME > 12.0) & (TIME < 18.0)),
    "with jitter": rows(
        np.arange(5, N - 5, 10) + np.round(4.0 * CHANCE[: len(range(5, N - 5, 10))] - 2.0)
    ),
    "three samples": rows([100, 600, 1100]),
}
DROPOUTS = {
    "one": ~rows([50]),
    "some": ~rows([100, 700, 1300]),
    "a tenth": CHANCE > 0.1,
    "half": CHANCE > 0.5,
    "most": CHANCE > 0.8,
    "half of the record": TIME < 15.0,
    "bursts": TIME % 3.0 > 0.5,
    "two samples": rows([0, 1000]),
    "none left": rows([]),
}


@pytest.mark.parametrize("pattern", SLOWER)
def test_a_regular_pattern_is_a_slower_clock(pattern):
    assert is_slower(TIME, SLOWER[pattern])


@pytest.mark.parametrize("pattern", DROPOUTS)
def test_dropouts_are_none(pattern):
    assert not is_slower(TIME, DROPOUTS[pattern])


def test_clocks_of_a_joined_table():
    fast, slow = np.arange(0.0, 20.0, 0.02), np.arange(0.003, 20.0, 0.1003)
    time = np.union1d(fast, slow)
    parts = clocks_of_rows(
        time,
        {
            name: np.where(np.isin(time, own), 1.0, np.nan)
            for name, own in (("q", fast), ("vn", slow), ("p", fast))
        },
    )
    assert [names for _, names in parts] == [["q", "p"], ["vn"]]
    assert [int(filled.sum()) for filled, _ in parts] == [len(fast), len(slow)]


def test_a_slower_channel_with_dropouts_remains_with_its_clock(tmp_path):
    cells = {
        "q": [f"{k}" for k in range(100)],
        "vn": ["" if k % 5 else "1" for k in range(100)],
        "ve": ["" if k % 5 or k == 20 else "2" for k in range(100)],
    }
    lines = [
        "time,q [deg/s],vn [m/s],ve [m/s]",
        *(f"{0.02 * k:.2f},{cells['q'][k]},{cells['vn'][k]},{cells['ve'][k]}" for k in range(100)),
    ]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    record = flighttest.read(tmp_path / "a.csv")
    assert {leaf: sorted(map(str, node.data_vars)) for leaf, node in record.children.items()} == {
        "data": ["q"],
        "data_10Hz": ["ve", "vn"],
    }
    assert record["data_10Hz"].attrs["rate"] == pytest.approx(10.0)
    assert flighttest.records.faults(record) == ["data_10Hz: NaN samples: ve 1 from 0.4 s"]
    assert flighttest.records.contents(tmp_path / "a.csv")["tables"][0]["slower"][0]["columns"] == [
        "vn",
        "ve",
    ]

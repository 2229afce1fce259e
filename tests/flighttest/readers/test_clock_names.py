"""Clocks by other names, and stamps as recorders write them."""

import numpy as np
import pytest

import flighttest

NAMES = '[air]\nalpha = { column = "alpha", unit = "deg" }\n'
STAMPS = {
    "milliseconds behind a colon": ("time", ["10:22:33:050", "10:22:33:070", "10:22:33:090"]),
    "hundredths behind a colon": ("time", ["10:22:33:65", "10:22:33:67", "10:22:33:69"]),
    "comma": ("TimeStamp", ["10:22:33,050", "10:22:33,070", "10:22:33,090"]),
    "day of the year": ("IRIG Time", ["154:10:22:33.050", "154:10:22:33.070", "154:10:22:33.090"]),
    "date": (
        "UTC",
        ["2025-06-03T10:22:33.050Z", "2025-06-03T10:22:33.070Z", "2025-06-03T10:22:33.090Z"],
    ),
    "date with a colon": (
        "GMT",
        ["2025-06-03 10:22:33:050", "2025-06-03 10:22:33:070", "2025-06-03 10:22:33:090"],
    ),
    "name of its own": ("Stamps of the box", ["10:22:33.05", "10:22:33.07", "10:22:33.09"]),
    "seconds": ("Elapsed Time (s)", ["0", "0.02", "0.04"]),
    "milliseconds": ("timestamp_ms", ["1000", "1020", "1040"]),
}


@pytest.mark.parametrize("kind", STAMPS)
def test_stamps_and_names_of_clocks(tmp_path, kind):
    name, cells = STAMPS[kind]
    separator = ";" if kind == "comma" else ","
    lines = [
        f"{name}{separator}alpha",
        *(f"{cell}{separator}{number}" for number, cell in enumerate(cells)),
    ]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    (tmp_path / "n.toml").write_text(NAMES)
    record = flighttest.read(tmp_path / "a.csv", tmp_path / "n.toml")
    np.testing.assert_allclose(np.diff(record["air/time"].values), 0.02, atol=1e-6)


def test_a_time_of_day_that_repeats_is_no_clock_where_another_column_rises(tmp_path):
    lines = [
        "UTC,Elapsed,alpha",
        *(f"10:00:0{number // 4},{0.25 * number},1" for number in range(12)),
    ]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    (tmp_path / "n.toml").write_text(NAMES)
    assert flighttest.read(tmp_path / "a.csv", tmp_path / "n.toml")["air"].attrs[
        "rate"
    ] == pytest.approx(4.0)

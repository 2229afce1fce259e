"""Clocks by other names, and stamps as recorders write them."""

import numpy as np
import pytest

import flighttest
from flightmech.errors import ParseError, UnknownName

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


@pytest.mark.slow
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


@pytest.mark.parametrize("clock", ["", '[time]\ncolumn = "Time"\n'])
def test_a_clock_of_cells_that_are_no_numbers_is_named(tmp_path, clock):
    lines = ["Time,alpha", *(f"0x1p{number},1" for number in range(6))]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    (tmp_path / "n.toml").write_text(clock + NAMES)
    with pytest.raises(UnknownName, match=r"Time is left out: text in 6 of 6 cells \('0x1p0' 1"):
        flighttest.read(tmp_path / "a.csv", tmp_path / "n.toml")


def test_a_leap_second_is_named_with_its_row(tmp_path):
    dates = ["2016-12-31T23:59:59Z", "", "2016-12-31T23:59:60Z"]
    lines = ["Time,alpha", *(f"{date},1" for date in dates)]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    (tmp_path / "n.toml").write_text(NAMES)
    fault = r"found '2016-12-31T23:59:60Z' in column 'Time', row 3 of the numbers; expected ISO"
    with pytest.raises(ParseError, match=fault):
        flighttest.read(tmp_path / "a.csv", tmp_path / "n.toml")


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


def packed(seconds):
    """Return the digits of hours, minutes and seconds of a time of day."""
    whole, day = np.floor(seconds), np.mod(np.floor(seconds), 86400.0)
    digits = day // 3600.0 * 10000.0 + day % 3600.0 // 60.0 * 100.0 + day % 60.0
    return digits + np.round(seconds - whole, 6)


@pytest.mark.parametrize("heading", ["UTC", "GPS Time (hhmmss.ss)", "time"])
@pytest.mark.parametrize("start", [37353.0, 86390.0], ids=["morning", "midnight"])
def test_time_of_day_in_one_number(tmp_path, heading, start):
    truth = start + 0.05 * np.arange(2000)
    lines = [f"{heading},alpha", *(f"{stamp:09.2f},1" for stamp in packed(truth))]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    (tmp_path / "n.toml").write_text(NAMES)
    record = flighttest.read(tmp_path / "a.csv", tmp_path / "n.toml")
    np.testing.assert_allclose(record["air/time"].values, truth, atol=1e-6)
    assert "hhmmss" in record.attrs["notes"]
    assert not record["air"].attrs["gaps"]


@pytest.mark.parametrize(
    "stamps",
    [0.05 * np.arange(2000), np.r_[np.arange(60.0), 100.0 + np.arange(80.0)]],
    ids=["seconds", "seconds with a gap"],
)
def test_seconds_are_no_time_of_day_in_one_number(tmp_path, stamps):
    (tmp_path / "a.csv").write_text("\n".join(["time,alpha", *(f"{t},1" for t in stamps)]))
    (tmp_path / "n.toml").write_text(NAMES)
    record = flighttest.read(tmp_path / "a.csv", tmp_path / "n.toml")
    np.testing.assert_allclose(record["air/time"].values, stamps)


def test_stamps_that_begin_with_blank_cells(tmp_path):
    lines = ["UTC,alpha", ",1", ",1", *(f"10:22:3{i},1" for i in range(5))]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    (tmp_path / "n.toml").write_text(NAMES)
    record = flighttest.read(tmp_path / "a.csv", tmp_path / "n.toml")
    np.testing.assert_allclose(record["air/time"].values, 37350.0 + np.arange(5))


FORMS = {
    "day, month, year": ["17/05/2024 {h:02d}:{m:02d}:{s:06.3f}", 0.0],
    "month, day, year with PM": ["5/17/2024 {t:d}:{m:02d}:{s:06.3f} {half}", 0.0],
    "points": ["17.05.2024 {h:02d}:{m:02d}:{s:06.3f}", 0.0],
    "year first": ["2024/05/17 {h:02d}:{m:02d}:{s:06.3f}", 0.0],
    "without leading zeros": ["{h:d}:{m:d}:{s:.3f}", 0.0],
    "minutes and seconds": ["{m:02d}:{s:06.3f}", 12 * 3600.0],
}


@pytest.mark.parametrize("form", FORMS)
def test_dates_of_any_order_and_times_of_12_hours(tmp_path, form):
    text, hours_lost = FORMS[form]
    truth = 12 * 3600.0 + 3590.0 + 0.05 * np.arange(400)  # past 13:00
    lines = ["UTC,alpha"]
    for t in truth:
        h, m, s = int(t // 3600), int(t % 3600 // 60), t % 60
        half = "PM" if h >= 12 else "AM"
        lines.append(f"{text.format(h=h, m=m, s=s, t=(h - 1) % 12 + 1, half=half)},1")
    (tmp_path / "a.csv").write_text("\n".join(lines))
    (tmp_path / "n.toml").write_text(NAMES)
    record = flighttest.read(tmp_path / "a.csv", tmp_path / "n.toml")
    np.testing.assert_allclose(record["air/time"].values, truth - hours_lost, atol=1e-6)


def test_a_new_date_is_a_new_day(tmp_path):
    stamps = ["31.12.2024 23:59:59.5", "01.01.2025 00:00:00.0", "01.01.2025 00:00:00.5"]
    (tmp_path / "a.csv").write_text("\n".join(["UTC,alpha", *(f"{t},1" for t in stamps)]))
    (tmp_path / "n.toml").write_text(NAMES)
    record = flighttest.read(tmp_path / "a.csv", tmp_path / "n.toml")
    np.testing.assert_allclose(np.diff(record["air/time"].values), 0.5)


def test_date_and_time_in_two_columns(tmp_path):
    lines = ["Date,UTC,alpha", *(f"2024-05-17,10:22:3{i},1" for i in range(5))]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    (tmp_path / "n.toml").write_text(NAMES)
    record = flighttest.read(tmp_path / "a.csv", tmp_path / "n.toml")
    np.testing.assert_allclose(record["air/time"].values, 37350.0 + np.arange(5))

"""Numbers that recorders write for a missing value are missing samples, and are stated."""

import numpy as np
import pytest

import flighttest
from flighttest.reconstruction.quality.record_notes import note_missing_codes
from flighttest.records.signals.missing_codes import find_missing_codes

T = np.arange(0.0, 4.0, 0.02)
READINGS = np.round(5000.0 + 40.0 * np.sin(T) + 0.5 * np.cos(40.0 * T), 1)
NAMES = '[air]\nh_baro = { column = "h", unit = "ft"MORE }\n[time]\ncolumn = "t"\n'


def with_code(code, where=slice(50, 60)):
    values = READINGS.copy()
    values[where] = code
    return values


@pytest.mark.parametrize("code", [-999.0, 9999.0, -9999.0, 99999.0, -999.9, 9999.99])
def test_a_code_far_from_the_readings_is_found(code):
    ((found, is_code),) = find_missing_codes(with_code(code))
    assert found == code
    assert np.flatnonzero(is_code).tolist() == list(range(50, 60))


def test_both_codes_of_a_column_are_found():
    values = with_code(-999.0)
    values[[3, 120]] = 99999.0
    assert sorted(code for code, _ in find_missing_codes(values)) == [-999.0, 99999.0]


@pytest.mark.parametrize(
    "values",
    [
        READINGS,
        # a reading among others: the channel passes through it
        np.linspace(9000.0, 9999.0, 200),
        np.where(T > 2.0, 999.0, np.round(990.0 + 4.5 * T, 1)),
        # nothing else is recorded, or nothing at all
        np.full(200, -999.0),
        np.full(200, np.nan),
        # a number that is not a code
        with_code(-998.0),
    ],
)
def test_readings_are_no_codes(values):
    assert find_missing_codes(values) == []


def read(tmp_path, values, more=""):
    lines = [f"{t:.2f},{x:.10g}" for t, x in zip(T, values, strict=True)]
    (tmp_path / "flight.csv").write_text("\n".join(["t,h", *lines]))
    (tmp_path / "names.toml").write_text(NAMES.replace("MORE", more))
    return flighttest.read(tmp_path / "flight.csv", tmp_path / "names.toml")


def test_a_code_is_a_missing_sample_with_a_note(tmp_path):
    record = read(tmp_path, with_code(-999.0, [50, 51, 90, 140]))
    height = record["air/h_baro"]
    assert np.flatnonzero(np.isnan(height.values)).tolist() == [50, 51, 90, 140]
    assert set(flighttest.signals.flags(record)["kind"]) == {"missing"}
    (note,) = note_missing_codes(record)
    assert note.text.startswith("h_baro: -999 in 4 cells of column data/h stands for a missing")


def test_the_name_map_states_other_codes_or_none(tmp_path):
    values = with_code(-1.0, [50, 90])
    record = read(tmp_path, values, ", missing = [-1]")
    assert np.isnan(record["air/h_baro"].values).sum() == 2
    values[[120, 121]] = -999.0
    record = read(tmp_path, values, ", missing = []")
    assert not np.isnan(record["air/h_baro"].values).any()

"""Files of a test input: what is played is what was designed; damaged tables are refused."""

import numpy as np
import pytest

import flighttest
from flightmech.errors import ParseError, SchemaError
from flighttest.flight_programme.input_design.input_shapes import multistep
from flighttest.flight_programme.input_design.multisines import InputAxis, multisine
from flighttest.flight_programme.input_design.timetable import (
    FULL,
    open_timetable,
    save_csv,
    save_timetable,
)


@pytest.fixture(scope="module")
def signal():
    return multisine(
        {"delta_e": InputAxis(0.07, (0.2, 1.0)), "throttle": InputAxis(0.2, (0.2, 1.0))}, 10.0
    )


@pytest.fixture
def file(signal, tmp_path):
    save_timetable(signal, tmp_path / "input.table", "two axes")
    return tmp_path / "input.table"


def test_what_is_read_back_is_what_was_designed(signal, file):
    found = open_timetable(file)
    assert found.attrs == {"title": "two axes", "rate": 50.0}
    assert found["time"].values == pytest.approx(signal["time"].values, abs=1e-12)
    for name, peak in (("delta_e", 0.07), ("throttle", 0.2)):
        assert found[name].values == pytest.approx(signal[name].values, abs=0.5001 * peak / FULL)
        assert np.abs(found[name].values).max() == pytest.approx(
            np.abs(signal[name].values).max(), rel=1e-12
        )


def test_a_reader_of_five_lines(file, signal):
    """As the documentation shows it for a companion computer."""
    lines = file.read_text().splitlines()
    head = dict(line[2:].split(": ", 1) for line in lines if line.startswith("#"))
    rows = [[int(word) for word in line.split()] for line in lines if not line.startswith("#")]
    scale = [float(word) for word in head["scale"].split()]
    assert len(rows) == int(head["rows"])
    row = int(1000.0 * 3.02 / int(head["step_ms"]))
    assert scale[0] * rows[row][0] == pytest.approx(
        float(signal["delta_e"].sel(time=3.02, method="nearest")), abs=1e-5
    )


@pytest.mark.parametrize(
    ("damage", "text"),
    [
        (lambda lines: lines[:-20], "580|rows with checksum"),
        (lambda lines: [*lines[:300], lines[300] + "1", *lines[301:]], "checksum|whole numbers"),
        (
            lambda lines: [*lines[:300], "12", *lines[301:]],
            "line 301: found '12'; expected 2 whole numbers",
        ),
        (lambda lines: [*lines[:300], "0 99999", *lines[301:]], "within"),
        (lambda lines: ["# aeromatch playback: 9", *lines[1:]], "line 1"),
        (lambda lines: [line for line in lines if not line.startswith("# scale")], "without scale"),
        (
            lambda lines: [line.replace("step_ms: 20", "step_ms: soon") for line in lines],
            "positive numbers",
        ),
        (lambda lines: [], "line 1"),
    ],
)
def test_damaged_tables_are_refused(file, damage, text):
    file.write_text("".join(line + "\n" for line in damage(file.read_text().splitlines())))
    with pytest.raises(ParseError, match=text):
        open_timetable(file)


def test_what_cannot_be_a_table(tmp_path, signal):
    with pytest.raises(SchemaError, match="steps of 33"):
        save_timetable(multistep("delta_e", 0.1, 0.5, rate=30.0), tmp_path / "a.table")
    with pytest.raises(SchemaError, match="throttle does not move"):
        save_timetable(signal.assign(throttle=signal["throttle"] * 0.0), tmp_path / "a.table")
    with pytest.raises(SchemaError, match="several lines"):
        save_timetable(signal, tmp_path / "a.table", "one\ntwo")
    assert not list(tmp_path.iterdir())


def test_csv_is_a_flight_record(signal, tmp_path):
    save_csv(signal, tmp_path / "input.csv")
    record = flighttest.read(tmp_path / "input.csv")
    found = flighttest.signals.channel(record, "delta_e")
    assert found.values == pytest.approx(signal["delta_e"].values, abs=1e-9)
    assert found["time"].values == pytest.approx(signal["time"].values, abs=1e-9)

"""Tests of a reader of recordings that another package adds."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import flighttest
from flightmech.errors import AeromatchError, AeromatchWarning, ParseError
from flightmech.plugins import RECORD_READERS
from flighttest.cli.group import flight

# A text format with a head of its own, which would be read as CSV.
READER = """
import io
import pandas as pd

class Reader:
    def recognise(self, path, head):
        return head.startswith(b"#HOST RECORDER")

    def read(self, path):
        text = path.read_text().split("\\n", 1)[1]
        frame = pd.read_csv(io.StringIO(text), sep=";")
        frame.attrs["units"] = {"V_cas": "kt", "theta": "deg"}
        return {"host": frame}

reader = Reader()
"""
GROUPS = {RECORD_READERS: {"host": "host_reader:reader"}}
TEXT = "#HOST RECORDER 2\ntime;V_cas;theta\n0.0;100.0;2.0\n0.1;101.0;2.5\n0.2;102.0;3.0\n"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    (tmp_path / "flight.host").write_text(TEXT)
    return tmp_path / "flight.host"


def test_a_foreign_recording_is_read_in_si(file, add_distribution) -> None:
    add_distribution("host-reader", GROUPS, host_reader=READER)
    record = flighttest.read(file)
    assert record.attrs["format"] == "host"
    host = record["host"]
    assert host["time"].values.tolist() == [0.0, 0.1, 0.2]
    assert np.allclose(host["V_cas"], np.array([100.0, 101.0, 102.0]) * 1852.0 / 3600.0)
    assert np.allclose(host["theta"], np.radians([2.0, 2.5, 3.0]))
    shown = CliRunner().invoke(flight, ["info", str(file)], catch_exceptions=False)
    assert "host" in shown.stdout


def test_formats_of_the_product_come_first(tmp_path, add_distribution) -> None:
    greedy = READER.replace('head.startswith(b"#HOST RECORDER")', "True")
    add_distribution("host-reader", GROUPS, host_reader=greedy)
    (tmp_path / "x.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(200))
    assert flighttest.records.readers.opening.recognise_recording(tmp_path / "x.mat") == "matlab5"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('return {"host": frame}', "return frame.values", "ndarray from the reader 'host'"),
        ('return {"host": frame}', "return {}", "dict from the reader 'host'"),
        ("time;V_cas", "clock;V_cas", "the table 'host' of the reader 'host' with columns clock"),
        ("pd.read_csv(", "pd.read_nothing(", "AttributeError: .*; repair or uninstall"),
    ],
)
def test_a_faulty_reader_is_named(file, add_distribution, old, new, words) -> None:
    file.write_text(TEXT.replace(old, new))
    add_distribution("host-reader", GROUPS, host_reader=READER.replace(old, new))
    with pytest.raises((AeromatchError, ParseError), match=words):
        flighttest.read(file)


@pytest.mark.parametrize(
    ("old", "new"), [("head.startswith(", "head.begins("), ("import io", "import no_such_module")]
)
def test_a_broken_package_does_not_stop_other_recordings(tmp_path, add_distribution, old, new):
    add_distribution("host-reader", GROUPS, host_reader=READER.replace(old, new))
    (tmp_path / "plain.csv").write_text("time,theta\n0.0,0.1\n0.1,0.2\n0.2,0.3\n")
    with pytest.warns(AeromatchWarning, match="left out: .*host"):
        kind = flighttest.records.readers.opening.recognise_recording(tmp_path / "plain.csv")
    assert kind == "csv"

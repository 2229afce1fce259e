"""What readers leave out is counted and named with the reason; a name map that needs it gets an
error that states what to do.
"""

import json
import zipfile

import h5py
import numpy as np
import pytest
import scipy.io
from click.testing import CliRunner

import flighttest
from flightmech.errors import ParseError
from flighttest.cli.group import flight
from flighttest.records.files import contents
from flighttest.records.readers.formats.csv_words import numbers_of
from flighttest.records.readers.opening import recognise_recording
from flighttest.records.readers.recording import (
    WIDEST,
    RecordedTable,
    Recording,
    without_short_tables,
)

T = np.arange(0.0, 4.0, 0.02)
NAMES = '[air]\nalpha = { column = "alpha", unit = "deg" }\n'


def written(tmp_path, text, names=NAMES):
    (tmp_path / "names.toml").write_text(names)
    (tmp_path / "flight.csv").write_text(text)
    return tmp_path / "flight.csv", tmp_path / "names.toml"


def left_out(path):
    return {one["name"]: one["reason"] for one in contents(path)["left_out"]}


def test_a_column_of_text_is_left_out_and_named(tmp_path):
    file, names = written(
        tmp_path, "Mode,time,alpha,Gear\nMAN,0,1,UP\nMAN,0.1,2,UP\nAUTO,0.2,3,DOWN\n"
    )
    record = flighttest.read(file, names)
    np.testing.assert_allclose(np.degrees(record["air/alpha"].values), [1, 2, 3])
    assert left_out(file) == {
        "data/Mode": "text in 3 of 3 cells ('MAN' 2, 'AUTO' 1)",
        "data/Gear": "text in 3 of 3 cells ('UP' 2, 'DOWN' 1)",
    }
    assert [place for place, _ in json.loads(record.attrs["left_out"])] == [
        "data/Mode",
        "data/Gear",
    ]


def test_a_column_of_text_that_the_map_needs_is_an_error_with_the_remedy(tmp_path):
    file, names = written(
        tmp_path, "time,alpha,Gear\n0,1,UP\n0.1,2,DOWN\n", NAMES + '[gear]\ngear = "Gear"\n'
    )
    with pytest.raises(
        ParseError, match=r"'UP' 1.*data/Gear.*reads as gear.*replace the words by numbers"
    ):
        flighttest.read(file, names)
    file, names = written(
        tmp_path,
        "time,alpha,Gear\n0,1,UP\n0.1,2,DOWN\n",
        NAMES + 'gear = { column = "Gear", optional = true }\n',
    )
    assert flighttest.read(file, names).attrs["absent"] == "Gear"


def test_words_among_numbers_are_missing_samples_and_counted(tmp_path):
    file, names = written(
        tmp_path, "time,alpha\n0,1\n0.1,INVALID\n0.2,3\n0.3,----\n0.4,N/A\n0.5,4\n0.6,4\n"
    )
    record = flighttest.read(file, names)
    assert np.flatnonzero(np.isnan(record["air/alpha"].values)).tolist() == [1, 3, 4]
    assert (
        "column alpha: 2 of 6 cells are not numbers ('INVALID' 1, '----' 1)"
        in record.attrs["notes"]
    )
    assert contents(file)["notes"] == json.loads(record.attrs["notes"])


def test_true_and_false_are_numbers_and_a_damaged_number_is_neither():
    assert numbers_of(["TRUE", "FALSE", ""], "w", "data/w")[0][:2].tolist() == [1.0, 0.0]
    values, _, lost = numbers_of(["1", "2,5", "3"], "w", "data/w")
    assert values is None
    assert lost.fault == "2,5"


def test_a_damaged_cell_is_an_error_without_a_map_too(tmp_path):
    file, _ = written(tmp_path, "time,q [deg/s]\n0,1\n0.1,1.2.3\n0.2,3\n")
    with pytest.raises(ParseError, match=r"line 3: found '1.2.3' in column 'q'"):
        flighttest.read(file)


@pytest.mark.slow
@pytest.mark.parametrize("columns", [60, 90])
def test_a_wide_matrix_is_read(tmp_path, columns):
    data = np.outer(T, np.ones(columns)) + np.arange(columns)
    scipy.io.savemat(
        tmp_path / "a.mat",
        {
            "t": T[:, None],
            "fdata": data,
            "pilot": "N. N.",
            "info": {"tail": "D-X"},
            "image": np.ones((3, 7)),
        },
    )
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"], file["fdata"], file["pilot"], file["image"] = T, data, "N. N.", np.ones((3, 7))
    (tmp_path / "n.toml").write_text(
        f'[imu]\nq = {{ column = "fdata[{columns - 1}]", unit = "rad/s" }}\n'
    )
    for name in ("a.mat", "a.h5"):
        np.testing.assert_allclose(
            flighttest.read(tmp_path / name, tmp_path / "n.toml")["imu/q"].values, T + columns - 1
        )
        assert (
            left_out(tmp_path / name)["data/image"]
            == "an array of 3 x 7; the clock of its table has 200 samples"
        )
    assert left_out(tmp_path / "a.h5")["pilot"] == "text"
    assert left_out(tmp_path / "a.mat") == {
        "info/tail": "text",
        "data/image": left_out(tmp_path / "a.h5")["data/image"],
    }


def test_the_limit_that_remains_is_stated(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"], file["q"], file["wide"] = T[:5], T[:5], np.zeros((5, WIDEST + 1))
    assert left_out(tmp_path / "a.h5") == {
        "data/wide": f"a matrix of 5 x {WIDEST + 1}; at most {WIDEST} columns of one matrix are "
        f"read"
    }
    done = CliRunner().invoke(flight, ["info", str(tmp_path / "a.h5")])
    assert "left out: 1\n  data/wide: a matrix of 5 x" in done.output


def test_a_table_of_one_sample_is_left_out():
    one, two = RecordedTable({"x": T[:1]}, time=T[:1]), RecordedTable({"x": T[:2]}, time=T[:2])
    recording = without_short_tables(Recording("ulog", {"once": one, "twice": two}))
    assert list(recording.tables) == ["twice"]
    assert [tuple(part)[:2] for part in recording.left_out] == [
        ("once", "1 sample; a clock needs two samples")
    ]
    assert list(without_short_tables(Recording("ulog", {"once": one})).tables) == ["once"]


ARCHIVES = {
    "a.csv": r"a zip archive \(x.csv\).*unpack it",
    "xl/workbook.xml": "an Excel workbook.*as CSV",
    "x.npy": "NumPy arrays",
}


@pytest.mark.parametrize("member", ARCHIVES)
def test_an_archive_is_named_with_what_to_do(tmp_path, member):
    with zipfile.ZipFile(tmp_path / "flight.csv", "w") as archive:
        archive.writestr(member.replace("a.csv", "x.csv"), "time,q\n0,1\n")
    with pytest.raises(ParseError, match=ARCHIVES[member]):
        recognise_recording(tmp_path / "flight.csv")


def test_the_other_spelling_of_a_verb():
    done = CliRunner().invoke(flight, ["maneuvers", "--help"])
    assert done.exit_code == 0
    assert "maneuvers" not in CliRunner().invoke(flight, ["--help"]).output


def test_a_listing_names_what_a_self_describing_record_leaves_out(tmp_path):
    """Text and complex numbers are not channels, and a look at the record states it."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"], file["q"] = T, np.sin(T)
        file["q"].attrs["units"] = "rad/s"
        file["theta"] = np.exp(1j * T)
        file["mode"] = np.array([b"climb"] * len(T))
    shown = CliRunner().invoke(flight, ["show", str(tmp_path / "a.h5")])
    assert shown.exit_code == 0, shown.output
    assert "left out: theta: complex numbers; write the real and the imaginary part" in shown.output
    assert "left out: mode: text" in shown.output
    shown = CliRunner().invoke(flight, ["show", str(tmp_path / "a.h5"), "--json"])
    assert [row["name"] for row in json.loads(shown.output)["left_out"]] == ["mode", "theta"]

"""Manoeuvres from a CSV or TOML table."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from click.testing import CliRunner

import flighttest
from flightmech.errors import ParseError, SchemaError
from flighttest.cli.records import mark_command
from flighttest.records.manoeuvre_table import (
    edit_manoeuvres,
    read_manoeuvres,
    with_manoeuvres,
    write_manoeuvres,
)

HEAD = "record,kind,control,start,end\n"


def table(tmp_path, text, name="manoeuvres.csv"):
    (tmp_path / name).write_text(text)
    return read_manoeuvres(tmp_path / name)


def test_csv_by_record_in_order_of_time(tmp_path):
    text = (
        HEAD.replace(",", ";")
        + "run_2;doublet;rudder;3;9\nrun_1;3211;elevator;1 min;75.5\n\nrun_1;trim;;0;8\n"
    )
    found = table(tmp_path, text)
    assert list(found["run_1"].itertuples(index=False, name=None)) == [
        ("trim", "", 0.0, 8.0, ""),
        ("3211", "elevator", 60.0, 75.5, ""),
    ]
    assert found["run_2"].columns.tolist() == ["manoeuvre", "control", "start", "end", "note"]


def test_toml_is_the_same(tmp_path):
    text = (
        '[[manoeuvre]]\nrecord = "run_1"\nkind = 3211\ncontrol = "elevator"\nstart = 60\nend '
        '= "75.5 s"\n'
    )
    pd.testing.assert_frame_equal(
        table(tmp_path, text, "manoeuvres.toml")["run_1"],
        table(tmp_path, HEAD + "run_1,3211,elevator,60,75.5\n")["run_1"],
    )


def test_all_faults_of_rows_are_reported_at_once(tmp_path):
    with pytest.raises(SchemaError) as caught:
        table(tmp_path, HEAD + "run_1,doublet,rudder,9,3\nrun_1,,rudder,1,2\nrun_1,trim,,x,3 kg\n")
    found = "\n".join(caught.value.problems)
    assert "manoeuvre.0: start 9 s and end 3 s; the end lies after the start" in found
    assert "manoeuvre.1.kind" in found
    assert "manoeuvre.2.start: found 'x'; expected a number and a unit such as '1.5 s'" in found
    assert "manoeuvre.2.end" in found


def test_columns_that_are_missing_or_unknown(tmp_path):
    with pytest.raises(SchemaError) as caught:
        table(tmp_path, "file,kind,control,start,end\nrun_1,trim,,0,8\n")
    assert caught.value.problems == [
        f"{fault}; its line of names is record, kind, control, start, end, and where wanted "
        f"confidence, note"
        for fault in ("no column 'record'", "unknown column 'file'")
    ]
    with pytest.raises(SchemaError, match="no column 'record'"):
        table(tmp_path, "")


def test_a_row_of_another_length(tmp_path):
    with pytest.raises(ParseError, match="line 3: found 4 cells"):
        table(tmp_path, HEAD + "run_1,trim,,0,8\nrun_1,trim,0,8\n")


def test_what_is_written_is_read_and_marks_a_record(tmp_path):
    rows = pd.DataFrame(
        [
            {
                "manoeuvre": "doublet",
                "control": "rudder",
                "start": 3.02,
                "end": 9.5,
                "confidence": 0.871,
                "note": "a, b",
            }
        ]
    )
    write_manoeuvres({"run_1": rows}, tmp_path / "found.csv")
    assert (tmp_path / "found.csv").read_text().splitlines()[
        1
    ] == 'run_1,doublet,rudder,3.02,9.5,0.87,"a, b"'
    again = read_manoeuvres(tmp_path / "found.csv")["run_1"]
    record = xr.DataTree.from_dict(
        {"/imu": xr.Dataset({"q": ("time", np.zeros(3))}, {"time": np.arange(3.0)})}
    )
    pd.testing.assert_frame_equal(
        flighttest.records.marked_manoeuvres(with_manoeuvres(record, again)), again
    )
    assert len(flighttest.records.marked_manoeuvres(record)) == 0


def marks(tmp_path, *words):
    done = CliRunner().invoke(
        mark_command, [str(tmp_path / "marks.csv"), "run_1", *words, "--json"]
    )
    return done, read_manoeuvres(tmp_path / "marks.csv").get("run_1") if (
        tmp_path / "marks.csv"
    ).exists() else None


def test_a_row_is_added_changed_and_removed(tmp_path):
    (tmp_path / "marks.csv").write_text(
        HEAD.strip() + ",confidence,note\nrun_2,sweep,rudder,1,2,0.71,kept\n"
    )
    assert (
        marks(tmp_path, "--kind", "doublet", "--control", "elevator", "--span", "5", "8")[
            0
        ].exit_code
        == 0
    )
    assert (
        marks(
            tmp_path,
            "--kind",
            "3211",
            "--control",
            "aileron",
            "--span",
            "1",
            "4",
            "--note",
            "first, by time",
        )[0].exit_code
        == 0
    )
    found = marks(tmp_path, "--row", "2", "--span", "5.5", "9")[1]
    expected = [
        ("3211", "aileron", 1.0, 4.0, "first, by time"),
        ("doublet", "elevator", 5.5, 9.0, ""),
    ]
    assert list(found.itertuples(index=False, name=None)) == expected
    assert "run_2,sweep,rudder,1,2,0.71,kept" in (tmp_path / "marks.csv").read_text()
    found = marks(tmp_path, "--row", "1", "--remove")[1]
    assert found["manoeuvre"].tolist() == ["doublet"]
    assert marks(tmp_path, "--row", "1", "--remove")[1] is None


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--row", "2", "--remove"], "row 2 of record run_1; it has 1"),
        (["--remove"], "nothing to remove; give the row"),
        (["--control", "rudder", "--span", "1", "2"], "kind"),
        (["--row", "1", "--span", "9", "2"], "the end lies after the start"),
    ],
)
def test_a_faulty_row_leaves_the_table_alone(tmp_path, words, text):
    (tmp_path / "marks.csv").write_text(HEAD + "run_1,doublet,elevator,5,8\n")
    before = (tmp_path / "marks.csv").read_bytes()
    done, _ = marks(tmp_path, *words)
    assert text in str(done.exception)
    assert (tmp_path / "marks.csv").read_bytes() == before


def test_the_marks_of_a_record_are_the_start(tmp_path, monkeypatch):
    record = xr.DataTree(
        xr.Dataset(attrs={"manoeuvres": '[{"manoeuvre": "trim", "start": 0, "end": 3}]'})
    )
    monkeypatch.setattr("flighttest.cli.actions.records.read", lambda *_: record)
    (tmp_path / "run_1.nc").write_text("")
    found = marks(
        tmp_path,
        "--start-from",
        str(tmp_path / "run_1.nc"),
        "--kind",
        "doublet",
        "--control",
        "rudder",
        "--span",
        "4",
        "5",
    )[1]
    assert found["manoeuvre"].tolist() == ["trim", "doublet"]
    found = marks(tmp_path, "--start-from", str(tmp_path / "run_1.nc"), "--row", "2", "--remove")[1]
    assert found["manoeuvre"].tolist() == ["trim"]
    with pytest.raises(SchemaError, match="edited by hand"):
        edit_manoeuvres(tmp_path / "marks.toml", "run_1", None, {"kind": "x", "start": 0, "end": 1})

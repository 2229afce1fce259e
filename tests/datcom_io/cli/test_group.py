import json
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
import xarray as xr

from aeromatch.cli.command import main

DATA = Path(__file__).parents[3] / "data" / "t37" / "datcom"


class Done(NamedTuple):
    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def run(monkeypatch, capsys):
    """Return a call of the command line in this process, as the shell would see it."""

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["aeromatch", "datcom", *map(str, words)])
        with pytest.raises(SystemExit) as caught:
            main()
        return Done(caught.value.code, *capsys.readouterr())

    return call


def test_show(run):
    done = run("show", DATA / "t37_elevator.out")
    assert done.returncode == 0
    assert "t37_elevator.out: 1 run, 1 case, 860 lines" in done.stdout
    assert "0.15 ... 0.5 (5)" in done.stdout
    assert "static 5 downwash 5 dynamic 5 symflp 5 dcdi 5" in done.stdout
    assert "(reader): D(CM) of 5 conditions from one program run" in done.stdout


def test_show_json_with_pages(run):
    found = json.loads(run("show", DATA / "t37_elevator.out", "--case", "1", "--json").stdout)
    case = found["cases"][0]
    assert case["mach"] == [0.15, 0.2, 0.3, 0.4, 0.5]
    assert case["alpha"] == [-8.0, 20.0]
    assert case["missing"]["NDM"] == 45
    assert found["unread"] == []
    assert [page["kind"] for page in found["pages"][2:6]] == [
        "section",
        "static",
        "dynamic",
        "high-lift",
    ]


@pytest.mark.nightly
def test_a_listing_is_shown_without_xarray_and_pandas():
    code = """
import sys
from datcom_io.cli.group import datcom
datcom(sys.argv[1:], standalone_mode=False)
sys.exit(len({"xarray", "pandas"} & set(sys.modules)))
"""
    assert (
        subprocess.run(
            [sys.executable, "-c", code, "show", str(DATA / "t37_elevator.out")]
        ).returncode
        == 0
    )


@pytest.mark.slow
def test_table(run):
    done = run(
        "table", DATA / "t37_elevator.out", "--case", "T-37 OWN DECK ELEVATOR", "--page", "6"
    )
    assert "symflp, lines 275-283" in done.stdout
    assert (
        "-25.0  -0.202   0.4444      0.120    0.01167      NDM  -4.446E-03  -1.155E-02"
        in done.stdout
    )
    found = json.loads(run("table", DATA / "t37_elevator.out", "--page", "6", "--json").stdout)
    assert found["tables"][0]["rows"][0] == [
        "-25.0",
        "-0.202",
        "0.4444",
        "0.120",
        "0.01167",
        "NDM",
        "-4.446E-03",
        "-1.155E-02",
    ]


def test_table_of_numbers_with_labels(run):
    done = run("table", DATA / "t37_elevator.out", "--page", "1")
    assert "section, lines 103-117" in done.stdout
    assert "ZERO LIFT ANGLE OF ATTACK" in done.stdout
    found = json.loads(run("table", DATA / "t37_elevator.out", "--page", "1", "--json").stdout)
    assert found["tables"][0]["rows"][1] == ["ZERO LIFT ANGLE OF ATTACK", "-1.83645", "DEG."]


def test_table_of_a_page_that_is_located_only(run, tmp_path):
    lines = (DATA / "t37_elevator.out").read_text().split("\n")
    lines[102:124] = ["                      SOMETHING ELSE"]
    (tmp_path / "x.out").write_text("\n".join(lines))
    assert (
        "tables of this kind of page are not read"
        in run("table", tmp_path / "x.out", "--page", "1").stdout
    )


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (
            ("show", DATA / "t37_elevator.inp"),
            "error: t37_elevator.inp: found no page of Digital DATCOM; expected a print file",
        ),
        (
            ("show", DATA / "t37_elevator.out", "--case", "2"),
            "error: unknown case of t37_elevator.out '2'; allowed: T-37 OWN DECK ELEVATOR",
        ),
        (
            ("table", DATA / "t37_elevator.out", "--page", "99"),
            "error: unknown page of case 'T-37 OWN DECK ELEVATOR' '99'; allowed: 1 ... 18",
        ),
        (("show", "nothing.out"), "no file 'nothing.out'"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(run, words, text):
    done = run(*words)
    assert done.returncode == 2
    assert text in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.nightly
def test_convert(run, tmp_path):
    done = run(
        "convert", DATA / "t37_elevator_one_by_one.pdas.out", "--join", "-o", tmp_path / "x.nc"
    )
    assert (done.returncode, done.stdout) == (0, f"written: {tmp_path / 'x.nc'}\n")
    with xr.open_datatree(tmp_path / "x.nc", engine="h5netcdf") as tree:
        assert tree["symflp"].sizes["condition"] == 6


@pytest.mark.nightly
def test_a_cut_listing_leaves_no_file(run, tmp_path):
    lines = (DATA / "t37_elevator.out").read_text().split("\n")[:300]
    (tmp_path / "cut.out").write_text("\n".join(lines))
    done = run("convert", tmp_path / "cut.out", "-o", tmp_path / "x.nc")
    assert done.returncode == 2
    assert "found 11 rows in the dcdi table; expected 19 rows" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["cut.out"]
    assert (
        run("convert", tmp_path / "cut.out", "--partial", "-o", tmp_path / "x.nc").returncode == 0
    )

import json
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

import datcom_io
from datcom_io.cli.group import datcom

T37 = Path(__file__).parents[3] / "data" / "t37" / "datcom"


def call(*words, code=0):
    result = CliRunner().invoke(datcom, list(map(str, words)))
    assert result.exit_code == code, result.output
    return result.output


@pytest.fixture
def bad(tmp_path):
    path = tmp_path / "bad.inp"
    path.write_text(
        "* ONE\n* TWO\n $FLTCON NMACH=1.0,MACH(1)=0.3,NALPHA=1,ALSCHD(1)=0.0,ALT(1)=0.0$\n "
        "$TRNJET NT=1.0,TIME(1)=0.0$\n"
    )
    return path


def test_check_reports_findings_and_states_so_by_its_code(bad):
    comment = (
        "comment: only the pre-processor of DATCOM+ removes it, the program does not "
        "run the case; use write_deck"
    )
    count = (
        "$FLTCON: NALPHA has the value 1 without a point; the program uses it and flags a "
        "syntax error"
    )
    assert call("check", bad, code=1).split("\n") == [
        f"line 1 and 1 more: error: {comment}",
        f"line 3: warning: {count}",
        "bad.inp: 1 case, 2 errors, 1 warning",
        "",
    ]
    document = json.loads(call("check", bad, "--json", code=1))
    assert (document["error"], document["warning"], document["cases"]) == (2, 1, 1)
    assert document["findings"][2] == {"line": 3, "severity": "warning", "text": count}


def test_check_of_a_good_deck():
    assert call("check", T37 / "t37_clean.inp") == (
        "t37_clean.inp: 1 case, nothing found; span 10.31 m (33.83 with DIM FT)\n"
    )


def test_deck_shows_and_writes(bad, tmp_path):
    output = call("deck", bad, "-o", tmp_path / "good.inp")
    assert "FLTCON TRNJET" in output
    assert call("check", tmp_path / "good.inp") == "good.inp: 1 case, nothing found\n"
    row = json.loads(call("deck", T37 / "t37_flaps.inp", "--json"))["cases"][0]
    assert (row["conditions"], row["mach"], row["cards"]) == (3, "0.15 0.2 0.3", "DAMP")


def test_split_writes_one_deck_per_run(tmp_path):
    output = call("split", T37 / "t37_study.toml", "-o", tmp_path / "runs")
    assert output.endswith(f"10 run decks in {tmp_path / 'runs'}\n")
    assert len(list((tmp_path / "runs").iterdir())) == 10
    assert (
        datcom_io.read_deck(tmp_path / "runs" / "aileron.inp")[0].caseid
        == "T-37 OWN DECK WING-BODY AILERONS"
    )
    document = json.loads(call("split", T37 / "t37_study.toml", "-o", tmp_path / "runs", "--json"))
    assert [row["conditions"] for row in document["runs"]] == [18, 4, 3, 5, 6, 1, 1, 1, 1, 1]


def test_run_collects_and_reports(tmp_path):
    program = tmp_path / "datcom"
    program.write_text(
        f"#!{sys.executable}\nimport shutil\nshutil.copy({str(T37 / 't37_aileron.out')!r}, "
        f"'for006.dat')\n"
    )
    program.chmod(0o755)
    output = call("run", T37 / "t37_aileron.inp", "--program", program, "-o", tmp_path / "results")
    assert output.startswith("1 case, ")
    assert (tmp_path / "results" / "t37_aileron.out").exists()
    document = json.loads(
        call(
            "run",
            T37 / "t37_aileron.inp",
            "--program",
            program,
            "-o",
            tmp_path / "results",
            "--json",
        )
    )
    assert document["cases"] == ["T-37 OWN DECK WING-BODY AILERONS"]
    assert document["without_pages"] == []


@pytest.mark.nightly
def test_run_of_a_folder(tmp_path):
    program = tmp_path / "datcom"
    copy = f"shutil.copy({str(T37 / 't37_aileron.out')!r}, 'for006.dat')"
    program.write_text(
        f"#!{sys.executable}\nimport shutil\nif 'BROKEN' not in open('for005.dat').read():\n "
        f"   {copy}\n"
    )
    program.chmod(0o755)
    (tmp_path / "decks").mkdir()
    for name in ("one", "two"):
        (tmp_path / "decks" / f"{name}.inp").write_text((T37 / "t37_aileron.inp").read_text())
    output = call("run", tmp_path / "decks", "--program", program, "-o", tmp_path / "results")
    assert output.endswith("2 decks run\n")
    assert sorted(path.name for path in (tmp_path / "results").iterdir()) == ["one.out", "two.out"]
    (tmp_path / "decks" / "two.inp").write_text(
        (T37 / "t37_aileron.inp").read_text().replace("CASEID", "CASEID BROKEN")
    )
    document = json.loads(
        call(
            "run",
            tmp_path / "decks",
            "--program",
            program,
            "-o",
            tmp_path / "results",
            "--json",
            code=1,
        )
    )
    assert (document["failed"], [row["deck"] for row in document["runs"]]) == (
        1,
        ["one.inp", "two.inp"],
    )
    assert "ended without a print of unit 6" in document["runs"][1]["error"]

"""Mistakes of a user in the files and options of a project: the answer states what came, what is
allowed or near, and what to do.

With `test_mistakes` more than ninety mistakes. Each row: the edit of a file of the C182 example
(old and new text), a command, and what its text must hold.
"""

from __future__ import annotations

import shlex
import shutil
import sys
import warnings
from pathlib import Path

import pytest

from aeromatch.cli.command import main

pytestmark = pytest.mark.nightly
C182 = Path(__file__).parents[2] / "data" / "c182"
INIT = "init new --datcom datcom --records flight/cruise.csv"
SHOW = "flight show flight/cruise.csv --names names.toml"
PLAN = "match aeromatch.toml -o out --plan"
SHORT = "cases/short_period.toml"
P = 'p = "Roll Rate"'
ROWS = [
    ("", "init new --datcom datcomm", ["no file or folder 'datcomm'", "near it: datcom"]),
    ("", "init new --records flight/cruse.csv",
     ["'flight/cruse.csv'", "near it: flight/cruise.csv"]),
    ("", f"{INIT} --mass '2280 lbm2'", ["'2280 lbm2'", "'kg'", "give a unit of the same quantity"]),
    ("", f"{INIT} --mass '-5 kg'", ["found '-5 kg'", "give a positive number", "2400 kg"]),
    ("", f"{INIT} --Ixz '5 kg'", ["Ixz = '5 kg'", "'kg m2'", "give a unit"]),
    ("", f"{INIT} --imu '1 m' '0 m' '25 deg'", ["--imu = '25 deg'", "'m'", "give a unit"]),
    ("", f"{INIT} --latitude 45", ["latitude 45 rad", "-90 to 90 deg", "write '45 deg'"]),
    ("", f"{INIT} --latitude '145 deg'", ["is 145 deg", "-90 to 90 deg", "correct it"]),
    ("", f"{INIT} --prove cruse", ["unknown record 'cruse'", "near it: cruise"]),
    ("", f"{INIT} --imu '1 m' '0 m'", ["'--imu'", "requires 3 arguments"]),
    ("", f"{INIT} --names aircraft.toml", ["an aircraft file", "--aircraft", "a name map has"]),
    ("", "init new --recods flight", ["'--recods'", "Did you mean '--records'"]),
    ("names.toml", f"{SHOW}", P, 'p = "Rol Rate"', ["'Rol Rate'", "near it: Roll Rate"]),
    ("names.toml", SHOW, "sign = -1", 'sign = "minus"', ["az_imu.sign", "1 or -1", "'minus'"]),
    ("names.toml", SHOW, "sign = -1", "sign = 2", ["az_imu.sign", "1 or -1", "found 2"]),
    (
        "names.toml", SHOW, P, 'p = { column = "Roll Rate", unit = "kt" }',
        ["imu.p.unit", "'kt'", "'rad s-1'", "give a unit"],
    ),
    ("names.toml", SHOW, "43.2 in", "43.2 deg", ["x_cg_b.offset", "'deg'", "'m'", "give a unit"]),
    ("names.toml", SHOW, P, 'p = Roll Rate"', ["line 5", "Roll Rate", "texts in quotes"]),
    ("names.toml", SHOW, 'q = "Pitch', 'p = "Pitch', ["line 6", "overwrite", "key = value"]),
    ("names.toml", SHOW, "phi =", "bank =", ["unknown quantity 'bank'", "near it: phi"]),
    ("names.toml", SHOW, '"45 deg"', "45", ["45 rad", "-90 to 90 deg", "write '45 deg'"]),
    ("", "match . -o out", ["'.' is a folder", "give a file", "aeromatch.toml"]),
    ("", "match aeromatch.toml", ["'--output'", "Give it with its value", "Folder to write"]),
    ("", "match aeromach.toml -o out", ["no file 'aeromach.toml'", "near it: aeromatch.toml"]),
    (
        "aeromatch.toml", PLAN, "manoeuvres = \"man", "manoeuvre = \"man",
        ["manoeuvre: unknown key", "near it: manoeuvres"],
    ),
    ("aeromatch.toml", PLAN, "flight/*", "flights/*",
     ["'flights/*.csv'", "give a file or a pattern"]),
    ("aeromatch.toml", PLAN, '"cruise"', '"cruse"', ["unknown record 'cruse'", "near it: cruise"]),
    ("aeromatch.toml", PLAN, "CL = 1 + alpha", "CL = 1 + alfa", ["'alfa'", "near it: alpha"]),
    ("aeromatch.toml", PLAN, '"CL = 1', '"Cz = 1', ["unknown coefficient 'Cz'", "near it: Cn"]),
    ("aeromatch.toml", PLAN, '"CL = 1 +', '"CL 1 +', ["found 'CL 1", "expected 'CL = 1"]),
    ("aeromatch.toml", PLAN, "cases/*", "case/*", ["no file matches", "give a file or a pattern"]),
    (
        "aeromatch.toml", PLAN, '"aircraft.toml"', '"data/aircraft.toml"',
        ["no file 'data/aircraft.toml'", "near it: aircraft.toml"],
    ),
    ("aeromatch.toml", PLAN, '"delta_r"]', '"rudder"]', ["'rudder'", "near it: delta_r"]),
    ("aircraft.toml", PLAN, '"2280 lb"', '"?"', ["mass", "not given yet", "write a number in kg"]),
    ("aircraft.toml", PLAN, '"2280 lb"', "2280 lb", ["line 7", "2280 lb", "is a text too"]),
    ("aircraft.toml", PLAN, '"-28 deg", "23 deg"', '"23 deg", "-28 deg"',
     ["delta_e", "is not below"]),
    (SHORT, PLAN, "15.1]", "150.0]", ["4 ... 150 s", "0 ... 17 s", "choose one inside"]),
    (SHORT, PLAN, "[4.0, 15.1]", "[15.1, 4.0]", ["short_period.toml", "must start before it ends"]),
    (SHORT, PLAN, '"2.c.10"', '"2.c.100"', ["'2.c.100'", "near it: 2.c.10"]),
    (SHORT, PLAN, '"2014-01-01"', '"2014"', ["unknown edition", "'2014'", "near it: 2014-01-01"]),
    (SHORT, PLAN, '"recorded"', '"record"',
     ["drive.surfaces", "'recorded', 'cockpit'", "'record'"]),
    ("manoeuvres.csv", PLAN, "check_dutch_roll,", "check_dutchroll,",
     ["'check_dutchroll'", "near it"]),
    ("", "reconstruct flight/cruise.csv",
     ["no command 'reconstruct'", "'aeromatch flight reconstruct'"]),
    ("", "flight cut flight/cruise.csv 200 220 --names names.toml -o x.nc",
     ["200 ... 220 s", "0 ... 150 s"]),
    ("", "flight info flight", ["'flight' is a folder", "give a file, such as"]),
]  # fmt: skip


def rows():
    """Return file, old and new text, command, and parts of the answer of every row."""
    for row in ROWS:
        file, line, *edit, parts = row
        old, new = edit or ("", "")
        yield pytest.param(file, old, new, line, parts, id=f"{line}: {new}")


@pytest.mark.parametrize(("file", "old", "new", "line", "parts"), list(rows()))
def test_a_mistake_in_a_project_is_answered(
    file, old, new, line, parts, tmp_path, monkeypatch, capfd
):
    for name in ("aeromatch.toml", "aircraft.toml", "names.toml", "manoeuvres.csv"):
        shutil.copy(C182 / name, tmp_path)
    shutil.copytree(C182 / "cases", tmp_path / "cases")
    for name in ("flight", "datcom"):
        (tmp_path / name).symlink_to(C182 / name)
    if file:
        text = (tmp_path / file).read_text()
        assert old in text
        (tmp_path / file).write_text(text.replace(old, new, 1))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["aeromatch", *shlex.split(line)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(SystemExit) as ended:
            main()
    printed = capfd.readouterr()
    assert ended.value.code == 2, printed.err
    assert [part for part in parts if part not in printed.err] == [], printed.err
    assert "Traceback" not in printed.err
    assert not (tmp_path / "new").exists()
    assert not (tmp_path / "out").exists()

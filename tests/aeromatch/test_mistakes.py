"""Typical mistakes of every verb: the error states what came, what is allowed or near, and what to
do; as JSON too, and nothing is written.

Each row: a command, and what its text must hold. Files are those of `folder`, next to the T-37
example as ``t37``.
"""

from __future__ import annotations

import json
import shlex
import sys
import warnings
from pathlib import Path

import pytest

import aerodb
import datcom_io
import flightmech
from aeromatch.cli.command import main

DATA = Path(__file__).parents[2] / "data" / "t37"
RECORD, NAMES, CRAFT = (
    "t37/flight/t37_02_clean_cruise_5kft.nc",
    "t37/names.toml",
    "t37/aircraft.toml",
)
LISTING, DECK, CASE = (
    "t37/datcom/t37_clean.out",
    "t37/datcom/t37_clean.inp",
    "t37/cases/21_short_period.toml",
)

SOUND = """
name = "x"
S = 16.9
cbar = 1.67
b = 10.3
reference = [-3.0, 0, 0]
x_ref_mac = 0.27
mass = 2150.0
Ixx = 1e4
Iyy = 8e3
Izz = 1.5e4
cg = [0, 0, 0]
"""
IMU = """
[instruments.imu]
position = [0, 0, 0]
noise = { p = 0.001, q = 0.001, r = 0.001, ax_imu = 0.1, ay_imu = 0.1, az_imu = 0.1, NAME = 0.1 }
bias_sigma = { p = 0.001, q = 0.001, r = 0.001, ax_imu = 0.1, ay_imu = 0.1, az_imu = 0.1 }
"""
CLOCK = '\n[time]\ncolumn = "time"\n'
FILES = {
    "chord.toml": SOUND.replace("cbar", "chord").replace("\nb =", "\nspan ="),
    "units.toml": SOUND.replace("16.9", '"182 sqft"').replace("2150.0", '"4740 kilos"'),
    "engine.toml": SOUND
    + '[[engine]]\nposition = [0, 0, 0]\ndirection = [1, 0, 0]\ndeck = { file = "none.nc" }\n',
    "syntax.toml": SOUND.replace("16.9", "16.9 m2"),
    "negative.toml": SOUND.replace("2150.0", "-2150.0"),
    "heading_noise.toml": SOUND + IMU.replace("NAME", "heading"),
    "unused_noise.toml": SOUND + IMU.replace("NAME", "mass"),
    "empty.toml": "",
    "notes.txt": "Flight 12, 14 May\nwind calm, pilot Smith\nsee sheet 3\n",
    "title.txt": "Just a title\n",
    "empty.csv": "",
    "record.csv": "time,ias,theta\n0.0,90,0.1\n0.1,91,0.1\n0.2,92,0.1\n",
    "column.toml": '[air]\nV_cas = { column = "iass", unit = "kt" }' + CLOCK,
    "unit.toml": '[air]\nV_cas = { column = "ias", unit = "knott" }' + CLOCK,
    "dimension.toml": '[air]\nV_cas = { column = "ias", unit = "deg" }' + CLOCK,
    "heading.toml": '[air]\nheading = { column = "ias", unit = "deg" }' + CLOCK,
    "key.toml": '[air]\nV_cas = { colum = "ias", unit = "kt" }' + CLOCK,
    "clock.toml": '[air]\nV_cas = { column = "ias", unit = "kt" }\n[time]\ncolumn = "t"\n',
    "few.toml": '[air]\nV_cas = { column = "ias", unit = "kt" }' + CLOCK,
    "inputs.csv": "time,delta_e [deg]\n0,0\n1,1\n",
    "inputs_name.csv": "time,elevator [deg]\n0,0\n1,1\n",
    "inputs_clock.csv": "t,delta_e [deg]\n0,0\n1,1\n",
    "marks.csv": "record,kind,control,start,end\nt37_02_clean_cruise_5kft,3211,elevator,9,x\n",
    "holds/a.txt": "one\n",
}
BUILD = f"--clean {LISTING} -o x.nc"
MISTAKES = {
    # wrong kinds of files, swapped arguments
    f"db build {LISTING} --clean {CRAFT} -o x.nc": [
        "t37_clean.out",
        "a Digital DATCOM listing",
        "expected a TOML text",
    ],
    f"db build {NAMES} {BUILD}": ["names.toml", "a name map", "--names", "expected name, S"],
    f"db build t37/aeromatch.toml {BUILD}": [
        "this is a project file",
        "aeromatch match",
        "expected the keys name, S",
    ],
    f"db build {CASE} {BUILD}": [
        "this is a case file",
        "aeromatch pom",
        "expected the keys name, S",
    ],
    f"db build {CRAFT} --clean {DECK} -o x.nc": [
        "t37_clean.inp",
        "no page of Digital DATCOM",
        "run the program first",
    ],
    f"db show {RECORD}": [
        "a flight record",
        "`aeromatch flight show` reads it",
        "no aero database",
    ],
    f"db show {LISTING}": [
        "a Digital DATCOM listing",
        "`aeromatch datcom show` reads it",
        "as `aeromatch db build` writes it",
    ],
    f"db compare prior.nc {CRAFT}": [
        "aircraft.toml",
        "an aircraft file",
        "as `aeromatch db build` writes it",
    ],
    f'db characteristics {CRAFT} prior.nc --speed "90 m/s" --altitude "1 km"': [
        "prior.nc",
        "an aero database",
        "expected a TOML text",
    ],
    "db import notes.txt -o x.nc": [
        "notes.txt",
        "Flight 12",
        "expected a database (netCDF-4), a MAT file",
    ],
    "flight show prior.nc": [
        "an aero database",
        "`aeromatch db show` reads it",
        "expected a recording",
    ],
    f"flight show {LISTING}": [
        "a Digital DATCOM listing",
        "`aeromatch datcom show` reads it",
        "expected a recording",
    ],
    f"flight show {RECORD} --names {CRAFT}": [
        "this is an aircraft file",
        "--aircraft",
        "a table of channels for each clock",
    ],
    f"flight check {RECORD} --names {NAMES} --aircraft {NAMES}": [
        "a name map",
        "--names",
        "expected name, S",
    ],
    f"flight reconstruct {RECORD} --names {NAMES} --aircraft prior.nc -o x.nc": [
        "an aero database",
        "expected a TOML text",
    ],
    f'flight identify {RECORD} --aircraft {CRAFT} --model "CL = 1" -o x.nc': [
        "no states over time",
        "`aeromatch flight reconstruct -o`",
    ],
    f"flight fit {CASE} -o x.nc": [
        "this is a case file",
        "aeromatch pom",
        "expected the keys title",
    ],
    f"fmu write prior.nc {CRAFT} -o x.fmu": [
        "prior.nc",
        "an aero database",
        "expected a TOML text",
    ],
    f"fmu write {CRAFT} {LISTING} -o x.fmu": [
        "a Digital DATCOM listing",
        "`aeromatch db build` writes it",
    ],
    "fmu show prior.nc": ["an aero database", "`aeromatch db show` reads it", "expected an FMU"],
    f"pom run {CASE} --model m=prior.nc": [
        "an aero database",
        "`aeromatch db show` reads it",
        "expected an FMU",
    ],
    f"pom run {CRAFT} --model m=prior.nc": [
        "this is an aircraft file",
        "--aircraft",
        "expected the keys case",
    ],
    f"pom init {LISTING} --test 2.d.7 -o c.toml": [
        "a Digital DATCOM listing",
        "expected a recording",
    ],
    f"match {CRAFT} -o out": ["this is an aircraft file", "--aircraft", "expected the keys title"],
    f"datcom show {RECORD}": ["no page of Digital DATCOM", "expected a print file"],
    "datcom show notes.txt": ["no page of Digital DATCOM", "expected a print file"],
    f"datcom check {LISTING}": ["a Digital DATCOM listing", "expected an input deck"],
    # files that are missing, folders, empty files
    "db show prior.ncc": ["no file 'prior.ncc'", "near it: prior.nc"],
    "db show nowhere/prior.nc": ["no file", "no folder 'nowhere'", "give its path from here"],
    "db show holds": ["'holds' is a folder", "give a file", "holds/a.txt"],
    f"db build {CRAFT} --clean {LISTING} -o none/x.nc": ["no folder 'none'", "make it first"],
    f"db build engine.toml {BUILD}": [
        "engine.1.deck",
        "no file 'none.nc'",
        "give its path from the aircraft file",
    ],
    f"db build {CRAFT} -o x.nc": ["no case of the whole aeroplane", "--clean FILE:CASE"],
    f"pom run {CASE} --model m=none.fmu": [
        "no file 'none.fmu'",
        "holds no name like it",
        "give its path from here",
    ],
    "pom run holds --model m=prior.nc": ["no case file (*.toml) in holds"],
    "pom check empty.toml": ["the file is empty", "expected the keys case"],
    "pom verify holds": ["no manifest.json", "`aeromatch pom run -o`"],
    "flight show empty.csv": ["an empty file", "expected a recording"],
    "flight info title.txt": [
        "no line of numbers below the names Just, a, title",
        "a recording: names, then numbers",
    ],
    "flight show notes.txt": [
        "line 3",
        "1 cells",
        "2 cells, as the line of names has ('Flight 12', '14 May')",
    ],
    # names and keys
    f"db build chord.toml {BUILD}": ["chord: unknown key", "near it: cbar", "near it: b"],
    "db show prior.nc --term CL/baisc": ["unknown term 'CL/baisc'", "near it: CL/basic"],
    "db edit prior.nc scale CL/baisc --by 0.9 -o x.nc": [
        "unknown term 'CL/baisc'",
        "near it: CL/basic",
    ],
    f"db build {CRAFT} --clean {LISTING}:TAKEOFF -o x.nc": [
        "unknown case",
        "allowed: T-37",
        "give its number",
    ],
    "db export prior.nc --to davemll -o x.dml": ["'davemll'", "'daveml'"],
    f"datcom table {LISTING} --page 900": ["unknown page", "'900'", "allowed: 1 ... 39"],
    "flight show record.csv": ["unknown column 'ias'", "near it: V_cas", "--names"],
    "flight show record.csv --names column.toml": ["unknown column 'iass'", "near it: ias"],
    "flight show record.csv --names heading.toml": [
        "air.heading",
        "unknown quantity 'heading'",
        "near it: psi",
    ],
    "flight show record.csv --names key.toml": ["colum: unknown key", "near it: column"],
    "flight show record.csv --names clock.toml": [
        "unknown time column 't'",
        "allowed: ias, theta, time",
        "[time] column",
    ],
    f"flight show {RECORD} --names px5": ["no file 'px5'", "shipped are ardupilot, px4"],
    "flight reconstruct record.csv --names few.toml --aircraft t37/aircraft.toml -o x.nc": [
        "no channel p",
        "name its column in the name map",
    ],
    f"flight reconstruct {RECORD} --names {NAMES} --aircraft heading_noise.toml -o x.nc": [
        "unknown quantity 'heading'",
        "near it: psi",
    ],
    f"flight reconstruct {RECORD} --names {NAMES} --aircraft unused_noise.toml -o x.nc": [
        "noise of mass",
        "nothing uses",
        "delete it",
    ],
    f"fmu trim {CRAFT} prior.nc --fix speed='90 m/s'": ["unknown name 'speed'", "near it: V"],
    f"fmu simulate {CRAFT} prior.nc --inputs inputs_name.csv -o x.nc": [
        "'elevator [deg]'",
        "near it: delta_e",
        "reference/nomenclature",
    ],
    f"fmu simulate {CRAFT} prior.nc --inputs inputs_clock.csv -o x.nc": [
        "found t, delta_e [deg]",
        "a column 'time' in s",
    ],
    f"fmu simulate {CRAFT} prior.nc --inputs inputs.csv --set init.speed=90 -o x.nc": [
        "'init.speed'",
        "near it: init.V",
    ],
    "pom init t37/flight/t37_27_val_dutch_roll.nc --test 2.d.77 -o c.toml": [
        "unknown test",
        "'2.d.77'",
        "near it: 2.d.7",
    ],
    f"pom run {CASE} --model prior.nc": ["'prior.nc'", "write name=file.fmu"],
    "db bild": ["'bild'", "'build'"],
    f"db build {CRAFT} --claen {LISTING} -o x.nc": ["'--claen'", "'--clean'"],
    # numbers and units
    f"db build units.toml {BUILD}": ["'sqft'; near it: ft2", "'kilos'; near it: kg"],
    f"db build syntax.toml {BUILD}": [
        "syntax.toml, line 3",
        "'S = 16.9 m2'",
        "a text too, 'S = \"16.9 m2\"'",
    ],
    f"db build negative.toml {BUILD}": ["mass: expected a positive number", "found -2150.0"],
    f"db build {CRAFT} --clean {LISTING} --altitude 5000feets -o x.nc": [
        "unknown unit 'feets'",
        "near it: ft",
    ],
    f"fmu trim {CRAFT} prior.nc --fix V_cas='90 deg'": [
        "V_cas=90 deg",
        "cannot be converted to 'm s-1'",
        "give a unit of the same quantity",
    ],
    "flight show record.csv --names unit.toml": [
        "air.V_cas.unit",
        "unknown unit 'knott'",
        "near it: kt",
    ],
    "flight show record.csv --names dimension.toml": [
        "'deg' cannot be converted to 'm s-1'",
        "give a unit of the same quantity",
    ],
    f"flight cut {RECORD} 20 10 --names {NAMES} -o x.nc": [
        "window 20 ... 10 s",
        "stop must lie at least one sample after start",
    ],
    f"flight cut {RECORD} 20000 20010 --names {NAMES} -o x.nc": [
        "window 20000",
        "holds 0 ... 310.26 s",
        "choose a window inside",
    ],
    f"flight manoeuvres {RECORD} --names {NAMES} --table marks.csv": [
        "marks.csv",
        "end: found 'x'; expected a number",
    ],
    # aerodynamics
    f"db build {CRAFT} --clean t37/datcom/t37_flaps.out -o x.nc": [
        "WING-BODY",
        "not of the whole aeroplane",
        "--tailless",
    ],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mistakes")
    (folder / "t37").symlink_to(DATA)
    for name, text in FILES.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    aerodb.save(
        aerodb.from_datcom(
            flightmech.read_aircraft(DATA / "aircraft.toml"),
            clean=datcom_io.read(DATA / "datcom" / "t37_clean.out"),
        ),
        folder / "prior.nc",
    )
    return folder


COMPILED = [
    line for line in MISTAKES if line.startswith("fmu trim") or "--set" in line
]  # a model is compiled before the mistake shows


@pytest.mark.parametrize(
    "line",
    [pytest.param(line, marks=[pytest.mark.slow] if line in COMPILED else []) for line in MISTAKES],
)
def test_a_mistake_is_answered(line, folder, monkeypatch, capfd):
    as_json = (
        [] if line.startswith("db edit") else ["--json"]
    )  # its verbs print one line, and have no other form
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "argv", ["aeromatch", *shlex.split(line), *as_json])
    before = sorted(folder.iterdir())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(SystemExit) as ended:
            main()
    printed = capfd.readouterr()
    assert ended.value.code == 2, printed.err
    missing = [part for part in MISTAKES[line] if part not in printed.err]
    assert missing == [], printed.err
    assert "Traceback" not in printed.err
    assert len(printed.err.splitlines()) < 25, (
        "more problems than anybody reads: name the kind of the file"
    )
    if as_json:
        error = json.loads(printed.out)["error"]
        assert error["kind"]
        assert all(part in error["text"] for part in MISTAKES[line])
    assert sorted(folder.iterdir()) == before

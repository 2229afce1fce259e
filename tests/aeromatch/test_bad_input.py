"""Bad input through the command: exit code 2, one clear error, an empty stdout, and no file that
was not there before.
"""

import subprocess
import sys
import zipfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import aerodb
import datcom_io
import flightmech

DATA = Path(__file__).parents[2] / "data" / "t37"
RECORD = DATA / "flight" / "t37_21_val_short_period_full_flaps_gear_down.nc"
CASE = """
[case]
id = "2.c.10"
name = "short_period"
title = "Short period"
record = "{record}"
window = [{start}, {stop}]
"""
CRASH = (
    "#include <signal.h>\n__attribute__((constructor)) static void fall(void) { raise(SIGSEGV); }\n"
)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A database and an FMU of the T-37, and five seconds of level flight as a reconstructed
    path.
    """
    folder = tmp_path_factory.mktemp("made")
    aircraft = flightmech.read_aircraft(DATA / "aircraft.toml")
    db = aerodb.from_datcom(aircraft, clean=datcom_io.read(DATA / "datcom" / "t37_clean.out"))
    aerodb.save(db, folder / "t37.nc")
    fmu = flightmech.write_fmu(flightmech.compile(aircraft, db), folder / "t37.fmu")
    time = np.arange(251) / 50.0
    held = dict.fromkeys(
        ("alpha", "beta", "phi", "psi", "theta", "p", "q", "r", "delta_e", "delta_a", "delta_r"),
        0.0,
    )
    held |= {
        "V": 100.0,
        "h": 1500.0,
        "nz": 1.0,
        "mass": 2100.0,
        "engine1.thrust": 1000.0,
        "engine2.thrust": 1000.0,
    }
    states = xr.Dataset(
        {name: ("time", np.full(time.size, value)) for name, value in held.items()}, {"time": time}
    )
    return SimpleNamespace(database=folder / "t37.nc", fmu=fmu, states=states)


@pytest.fixture
def write_case(made, tmp_path):
    def write(start=0.0, stop=5.0, states=None):
        (made.states if states is None else states).to_netcdf(
            tmp_path / "level.nc", engine="h5netcdf"
        )
        (tmp_path / "case.toml").write_text(CASE.format(record="level.nc", start=start, stop=stop))
        return tmp_path / "case.toml"

    return write


@pytest.fixture
def refused(aeromatch, tmp_path):
    """Call the command, check what every refusal has in common, and return its text."""

    def call(*words, run=aeromatch):
        before = listing(tmp_path)
        done = run(*words)
        assert (done.returncode, done.stdout) == (2, ""), done.stderr
        assert done.stderr.startswith("error: ")
        assert done.stderr.count("error:") == 1
        assert "Traceback" not in done.stderr
        assert listing(tmp_path) == before
        return done.stderr

    return call


def listing(folder):
    return {path: path.read_bytes() if path.is_file() else b"" for path in folder.rglob("*")}


def in_a_shell(*words):
    command = [sys.executable, "-m", "aeromatch", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=1200)


@pytest.mark.nightly
def test_a_truncated_listing(refused, tmp_path):
    whole = (DATA / "datcom" / "t37_clean.out").read_text()
    (tmp_path / "cut.out").write_text(whole[: len(whole) // 2])
    message = refused(
        "db",
        "build",
        DATA / "aircraft.toml",
        "--clean",
        tmp_path / "cut.out",
        "-o",
        tmp_path / "prior.nc",
        run=in_a_shell,
    )
    assert "cut.out, line " in message
    assert "expected 19 rows" in message
    assert "run the program again" in message


def test_an_unknown_column_in_a_name_map(refused, tmp_path):
    names = (DATA / "names.toml").read_text().replace('q_c = "q_c"', 'q_c = "qc"')
    (tmp_path / "names.toml").write_text(names)
    message = refused(
        "flight", "cut", RECORD, 5, 9, "--names", tmp_path / "names.toml", "-o", tmp_path / "cut.nc"
    )
    assert "unknown column 'qc'; near it: q_c; the name map requires it" in message


def test_an_unknown_column_in_a_table(refused, tmp_path):
    (tmp_path / "run.csv").write_text(
        "time [s],q [deg/s],pitch_atitude [deg]\n0,1,2\n0.1,1,2\n0.2,1,2\n"
    )
    message = refused("flight", "cut", tmp_path / "run.csv", 0, 0.2, "-o", tmp_path / "cut.nc")
    assert "unknown column 'pitch_atitude'" in message
    assert "--names" in message


@pytest.mark.slow
def test_a_nan_in_an_input(refused, made, write_case, tmp_path):
    bad = made.states.copy(deep=True)
    bad["delta_e"][100] = np.nan
    message = refused(
        "pom",
        "run",
        write_case(states=bad),
        "--model",
        f"datcom={made.fmu}",
        "-o",
        tmp_path / "report",
    )
    assert (
        "input delta_e has no value in 1 of 251 samples, first at t = 2 s; repair the record "
        "or move the window" in message
    )


def test_a_manoeuvre_outside_the_record(refused, tmp_path):
    message = refused(
        "flight", "cut", RECORD, 5, 500, "--names", DATA / "names.toml", "-o", tmp_path / "cut.nc"
    )
    assert "5 ... 500 s" in message
    assert "choose" in message


@pytest.mark.nightly
def test_a_case_outside_its_record(refused, made, write_case, tmp_path):
    message = refused(
        "pom",
        "run",
        write_case(stop=9.0),
        "--model",
        f"datcom={made.fmu}",
        "-o",
        tmp_path / "report",
    )
    assert "the window 0 ... 9 s lies outside the record 0 ... 5 s" in message


@pytest.mark.nightly
@pytest.mark.skipif(sys.platform != "linux", reason="the crash is a signal of Linux")
def test_an_fmu_that_crashes(refused, made, write_case, tmp_path):
    (tmp_path / "crash.c").write_text(CRASH)
    library = tmp_path / "crash.so"
    compiler = [
        sys.executable,
        "-m",
        "ziglang",
        "cc",
        "-shared",
        "-fPIC",
        "-O1",
        "-fno-sanitize=undefined",
    ]
    subprocess.run([*compiler, "-o", library, tmp_path / "crash.c"], check=True)
    with zipfile.ZipFile(made.fmu) as good, zipfile.ZipFile(tmp_path / "crash.fmu", "w") as bad:
        for name in good.namelist():
            bad.writestr(
                name, library.read_bytes() if name.startswith("binaries/") else good.read(name)
            )
    words = (
        "pom",
        "run",
        write_case(),
        "--model",
        f"bad={tmp_path / 'crash.fmu'}",
        "-o",
        tmp_path / "report",
    )
    assert (
        refused(*words, run=in_a_shell)
        == "error: no model could be replayed: bad: crashed: signal SIGSEGV\n"
    )


def test_a_misspelt_key_in_a_case(refused, made, write_case, tmp_path):
    case = write_case()
    case.write_text(case.read_text().replace("title", "titel") + '[tolerance]\nthetta = "1 deg"\n')
    message = refused(
        "pom", "run", case, "--model", f"datcom={made.fmu}", "-o", tmp_path / "report"
    )
    assert "case.titel: unknown key; near it: title" in message
    assert "case.title: missing; give it" in message


def test_a_misspelt_key_in_a_project(refused, tmp_path):
    text = (
        (DATA / "aeromatch.toml")
        .read_text()
        .replace('title = "T-37"', 'titel = "T-37"')
        .replace("cutoff", "cutof")
    )
    (tmp_path / "aeromatch.toml").write_text(text)
    message = refused("match", tmp_path / "aeromatch.toml", "-o", tmp_path / "out")
    assert "3 problems" in message
    assert "titel: unknown key; near it: title" in message
    assert "cutof: unknown key; near it: cutoff" in message


@pytest.mark.parametrize(
    "verb", [("db", "check"), ("db", "show"), ("fmu", "write", DATA / "aircraft.toml")]
)
def test_a_corrupt_database(refused, made, tmp_path, verb):
    data = bytearray(made.database.read_bytes())
    (tmp_path / "corrupt.nc").write_bytes(data[: len(data) // 2])
    output = ("-o", tmp_path / "t37.fmu") if verb[0] == "fmu" else ()
    message = refused(*verb, tmp_path / "corrupt.nc", *output)
    assert "corrupt.nc: found" in message
    assert "expected" in message


def test_a_missing_folder_for_the_result(aeromatch, tmp_path):
    done = aeromatch(
        "db",
        "build",
        DATA / "aircraft.toml",
        "--clean",
        DATA / "datcom" / "t37_clean.out",
        "-o",
        tmp_path / "no" / "x.nc",
    )
    assert done.returncode == 2
    assert "make it first" in done.stderr
    assert list(tmp_path.iterdir()) == []

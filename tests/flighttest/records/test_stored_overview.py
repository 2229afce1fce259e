"""Records as this package writes them: an overview and a seal stand behind their content."""

import hashlib
import json
import subprocess
import sys
from pathlib import Path

import h5netcdf
import h5py
import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

import flighttest
from aerodb.cli.group import db
from flightmech.errors import ParseError, SchemaError
from flighttest.cli.group import flight
from flighttest.records.files import save_dataset, save_record
from flighttest.records.record import as_tree
from flighttest.records.stored_overview import OVERVIEW, stored_overview

ROOT = Path(__file__).parents[3]
CITATION = ROOT / ".." / "shared" / "data" / "flight" / "citation_phlab"
REAL = {
    "cruise": ("data/c182/flight/cruise.csv", "data/c182/names.toml"),
    "multisine": ("data/t37/flight/t37_10_multisine_clean_5kft.nc", "data/t37/names.toml"),
    "takeoff": ("data/t37/flight/t37_17_takeoff_1.nc", "data/t37/names.toml"),
    "pedals": ("data/t37/flight/t37_55_val_pedal_release_clean.nc", "data/t37/names.toml"),
}
VERBS = [("show",), ("show", "--json"), ("info",), ("info", "--json")]


def run(*arguments):
    return CliRunner().invoke(flight, list(map(str, arguments)), catch_exceptions=False).stdout


def resealed(content):
    return (
        content
        + b"\nsha256 of the bytes above: %s\n" % hashlib.sha256(content).hexdigest().encode()
    )


def unsealed(path):
    """Cut off what stands behind the HDF5 content, as another program does that changes the file."""
    content = path.read_bytes()
    path.write_bytes(content[: content.rindex(b"\noverview record")])


def faulty():
    """Return a record with gaps, repeated stamps, NaN, a held value, a spike and a list of
    manoeuvres.
    """
    time = np.concatenate([np.arange(200) * 0.02, 6.0 + np.arange(200) * 0.02])
    rng = np.random.default_rng(3)
    q = np.cumsum(rng.standard_normal(400)) * 1e-3
    q[50], q[100:103], q[250:300] = 5.0, np.nan, q[249]
    q[300:] += 1.0
    flown = [
        {
            "manoeuvre": "doublet",
            "control": "elevator",
            "start": 1,
            "end": None,
            "note": "by hand\u00a0",
        }
    ]
    leaves = {
        "/imu": xr.Dataset(
            {"q": ("time", q, {"units": "rad/s"}), "r": ("time", q * np.nan, {"units": "rad/s"})},
            {"time": time},
        ),
        "/air": xr.Dataset(
            {"V_cas": ("time", q + 50.0, {"units": "kt"})},
            {"time": np.sort(np.append(time[1:], time[7]))},
        ),
    }
    facts = {
        "title": "a record",
        "manoeuvres": json.dumps(flown),
        "latitude": 0.7,
        "number": 3,
        "notes": json.dumps(["a note"]),
    }
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=facts), **leaves})


@pytest.fixture
def file(tmp_path):
    save_record(faulty(), tmp_path / "faulty.nc")
    return tmp_path / "faulty.nc"


@pytest.mark.parametrize("verb", VERBS)
def test_an_overview_is_what_the_whole_reading_prints(file, verb):
    shown = run(*verb, file)
    unsealed(file)
    assert stored_overview(file, "listing") is None
    assert run(*verb, file) == shown


@pytest.mark.slow
@pytest.mark.parametrize("name", REAL)
def test_real_records_print_the_same_with_and_without_an_overview(tmp_path, name):
    recording, names = (ROOT / part for part in REAL[name])
    save_record(flighttest.read(recording, names), tmp_path / "run.nc")
    assert stored_overview(tmp_path / "run.nc", "listing")["facts"]["source_file"] == "run.nc"
    shown = [run(*verb, tmp_path / "run.nc") for verb in VERBS]
    whole = flighttest.read(tmp_path / "run.nc")
    unsealed(tmp_path / "run.nc")
    assert [run(*verb, tmp_path / "run.nc") for verb in VERBS] == shown
    xr.testing.assert_identical(flighttest.read(tmp_path / "run.nc"), whole)


@pytest.mark.slow
def test_a_real_flight_prints_the_same_too(tmp_path):
    recording = CITATION / "flight_20190305_2_partial.csv.gz"
    if not recording.is_file():
        pytest.skip("needs ../shared/data/flight/citation_phlab")
    save_record(
        flighttest.read(recording, ROOT / "tests" / "real" / "maps" / "citation_2019.toml"),
        tmp_path / "run.nc",
    )
    shown = [run(*verb, tmp_path / "run.nc") for verb in VERBS]
    assert stored_overview(tmp_path / "run.nc", "listing")
    unsealed(tmp_path / "run.nc")
    assert [run(*verb, tmp_path / "run.nc") for verb in VERBS] == shown


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(
    values=st.lists(st.floats(-1e3, 1e3) | st.just(np.nan), min_size=2, max_size=12),
    facts=st.dictionaries(
        st.sampled_from(["title", "record", "start", "purpose", "unmapped", "notes", "number"]),
        st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=8)
        | st.integers(-(2**31), 2**31)
        | st.floats(-9.0, 9.0),
    ),
)
def test_whatever_a_record_holds_its_overview_is_what_is_read(tmp_path_factory, values, facts):
    path = tmp_path_factory.mktemp("any") / "any.nc"
    leaf = xr.Dataset(
        {"q": ("time", values, {"units": "rad/s"})}, {"time": np.arange(len(values)) * 0.1}
    )
    save_record(xr.DataTree.from_dict({"/": xr.Dataset(attrs=facts), "/imu": leaf}), path)
    shown = [run(*verb, path) for verb in VERBS]
    unsealed(path)
    assert [run(*verb, path) for verb in VERBS] == shown


def test_what_the_overview_record_2_holds(tmp_path):
    """A change of what `show` and `info` print of a file requires a new number: files carry what
    older rules gave.
    """
    rates = xr.Dataset(
        {"q": ("time", [0.0, 0.5, np.nan, -1.0], {"units": "deg/s"})},
        {"time": [0.0, 0.1, 0.2, 0.9]},
    )
    save_record(
        xr.DataTree.from_dict({"/": xr.Dataset(attrs={"purpose": "test"}), "/imu": rates}),
        tmp_path / "a.nc",
    )
    channel = {
        "leaf": "imu",
        "channel": "q",
        "rate": 10.0,
        "start": 0.0,
        "stop": 0.9,
        "min": np.radians(-1.0),
        "max": np.radians(0.5),
    }
    facts = {
        "purpose": "test",
        "title": "a",
        "source_file": "a.nc",
        "format": "netCDF-4 or HDF5",
        "absent": "",
    }
    assert OVERVIEW == "record 2"
    assert stored_overview(tmp_path / "a.nc", "listing") == {
        "facts": facts,
        "channels": [channel | {"units": "rad s-1", "calibration": "q [deg/s]", "missing": 1}],
        "manoeuvres": [],
        "faults": ["imu: gaps in the clock at 0.2 s (0.7 s)", "imu: NaN samples: q 1 from 0.2 s"],
        "unmapped": [],
    }
    columns = [
        {"column": "q", "unit": "deg/s", "min": -1.0, "max": 0.5},
        {"column": "time", "unit": "", "min": 0.0, "max": 0.9},
    ]
    table = {
        "table": "imu",
        "samples": 4,
        "rate": 10.0,
        "start": 0.0,
        "stop": 0.9,
        "clock_fault": "",
        "slower": [],
        "columns": columns,
    }
    about = {
        "file": "a.nc",
        "format": "netCDF-4 or HDF5",
        "facts": {"purpose": "test"},
        "notes": [],
        "tables": [table],
        "left_out": [],
    }
    assert stored_overview(tmp_path / "a.nc", "contents") == about


def test_neither_numpy_nor_hdf5_is_imported_to_show_it(file):
    code = """
import sys
from aeromatch.cli import main
sys.argv = ["aeromatch", "flight", *sys.argv[1:]]
try:
    main()
finally:
    print(*sorted({"numpy", "h5py", "xarray", "pandas"} & set(sys.modules)), file=sys.stderr)
"""
    for verb in (verb for verb in VERBS if verb[0] == "show"):
        done = subprocess.run(
            [sys.executable, "-c", code, verb[0], str(file), *verb[1:]],
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stderr == "\n"
        assert done.stdout == run(*verb, file)


@pytest.mark.parametrize(("stated", "title"), [("a record", "a record"), (None, "other")])
def test_a_file_under_another_name(file, stated, title):
    """Its name is the source of the record, and its title where the record states none."""
    record = faulty()
    record.attrs = (
        {**record.attrs, "title": stated}
        if stated
        else {key: item for key, item in record.attrs.items() if key != "title"}
    )
    save_record(record, file)
    other = file.rename(file.with_name("other.by hand.nc"))
    facts = stored_overview(other, "listing")["facts"]
    assert (facts["source_file"], facts["title"]) == ("other.by hand.nc", title)
    assert stored_overview(other, "contents")["file"] == "other.by hand.nc"
    shown = [run(*verb, other) for verb in VERBS]
    unsealed(other)
    assert [run(*verb, other) for verb in VERBS] == shown


def test_a_name_map_goes_before_the_overview(file, tmp_path):
    (tmp_path / "names.toml").write_text('[imu]\np = "imu/q"\n')
    assert "imu/p" in run("show", file, "--names", tmp_path / "names.toml")


@pytest.mark.parametrize(
    "kept",
    [
        b"",
        b"\noverview record 0: {}",
        b"\noverview record 2: {}",
        b"\noverview record 2: no JSON",
        b"\noverview 1: [{}, []]",
    ],
)
def test_without_an_overview_that_it_knows_show_reads_the_record(file, kept):
    """Files of older versions have none, those of later ones may have one of other rules; that of a
    database is another one.
    """
    shown = [run(*verb, file) for verb in VERBS]
    content = file.read_bytes()
    file.write_bytes(resealed(content[: content.rindex(b"\noverview record")] + kept))
    assert [run(*verb, file) for verb in VERBS] == shown


def test_the_overview_is_what_is_shown(file):
    """Sealed by hand, with a name that no channel of the content has."""
    content = file.read_bytes()
    content = content[: content.rindex(b"\nsha256 of the bytes above")]
    file.write_bytes(resealed(content.replace(b'"channel":"q"', b'"channel":"k"')))
    assert "imu/k" in run("show", file)


def places(path):
    """Yield places of the content, the overview and the seal, all over the file."""
    size = path.stat().st_size
    tail = path.read_bytes().rindex(b"\noverview record")
    yield from (
        8,
        40,
        41,
        tail // 7,
        tail // 2,
        tail - 1,
        tail,
        tail + 3,
        tail + 40,
        (tail + size) // 2,
        size - 90,
        size - 70,
        size - 1,
    )


def test_a_damaged_byte_anywhere_is_an_error(file):
    content = file.read_bytes()
    for place in places(file):
        damaged = bytearray(content)
        damaged[place] ^= 0x11
        file.write_bytes(damaged)
        for act in (
            lambda: run("show", file),
            lambda: run("info", file),
            lambda: flighttest.read(file),
        ):
            with pytest.raises(ParseError, match=r"damaged file.*write or copy it again"):
                act()


@pytest.mark.parametrize(
    "harm",
    [
        lambda c: c[:-1],
        lambda c: c[:-200],
        lambda c: c[:5000],
        lambda c: c + b"\0" * 512,
        lambda c: c[:-300] + b"\0" * 300,
    ],
)
def test_a_file_that_ends_early_or_late_is_an_error(file, harm):
    file.write_bytes(harm(file.read_bytes()))
    for act in (
        lambda: run("show", file),
        lambda: run("info", file),
        lambda: flighttest.read(file),
    ):
        with pytest.raises(ParseError):
            act()


def in_h5py(file):
    with h5py.File(file, "a") as content:
        content["imu/q"][0] = 77.0


def in_h5netcdf(file):
    with h5netcdf.File(file, "a") as content:
        content["imu/q"][0] = 77.0


@pytest.mark.parametrize("change", [in_h5py, in_h5netcdf])
def test_a_program_that_changes_the_file_in_place_cuts_the_overview_off(file, change):
    change(file)
    assert b"overview record" not in file.read_bytes()
    assert "77 " in next(
        line for line in run("show", file).splitlines() if line.startswith("imu/q ")
    )
    assert flighttest.read(file)["imu/q"].values[0] == 77.0


def test_a_further_group_of_xarray_goes_into_the_file(file):
    air = xr.Dataset({"h": ("time", [1.0, 2.0], {"units": "m"})}, {"time": [0.0, 1.0]})
    air.to_netcdf(file, mode="a", group="more", engine="h5netcdf")
    assert "more/h" in run("show", file)


def test_other_programs_read_the_file(file):
    with h5py.File(file) as content:
        assert content["imu/q"].shape == (400,)
    with h5netcdf.File(file) as content:
        assert content["imu"].dimensions["time"].size == 400
    with xr.open_datatree(file, engine="h5netcdf") as tree:
        assert list(tree.children) == ["imu", "air"]


def test_a_file_with_bytes_of_another_program_behind_its_content_is_read(file):
    unsealed(file)
    shown = run("show", file)
    with file.open("ab") as more:
        more.write(b"\nwritten by a logger\n")
    assert run("show", file) == shown


@pytest.mark.slow
def test_a_manoeuvre_that_was_cut_carries_one(tmp_path):
    record = flighttest.read(*(ROOT / part for part in REAL["multisine"]))
    save_dataset(flighttest.cut(record, 10.0, 12.0, 50.0), tmp_path / "cut.nc")
    channels = [
        row["channel"] for row in stored_overview(tmp_path / "cut.nc", "listing")["channels"]
    ]
    assert len(channels) == 50
    shown = [run(*verb, tmp_path / "cut.nc") for verb in VERBS]
    unsealed(tmp_path / "cut.nc")
    assert [run(*verb, tmp_path / "cut.nc") for verb in VERBS] == shown


def test_a_record_that_show_refuses_is_sealed_with_its_contents(tmp_path):
    """Without canonical names it requires a name map."""
    leaf = xr.Dataset({"my rate": ("time", [1.0, 2.0], {"units": "deg/s"})}, {"time": [0.0, 1.0]})
    save_record(xr.DataTree.from_dict({"/": xr.Dataset(), "/imu": leaf}), tmp_path / "a.nc")
    assert stored_overview(tmp_path / "a.nc", "listing") is None
    assert "my rate" in run("info", tmp_path / "a.nc")
    with pytest.raises(Exception, match="without a canonical name"):
        run("show", tmp_path / "a.nc")


def test_a_clock_that_is_set_back_is_reported_under_the_name_of_the_file(tmp_path):
    leaf = xr.Dataset(
        {"q": ("time", np.ones(40), {"units": "deg/s"})},
        {"time": np.append(np.arange(20.0), np.arange(20.0))},
    )
    save_record(xr.DataTree.from_dict({"/": xr.Dataset(), "/imu": leaf}), tmp_path / "a.nc")
    assert "a.nc, table imu" in run("info", tmp_path / "a.nc")
    with pytest.raises(SchemaError, match=r"a\.nc, leaf imu"):
        run("show", tmp_path / "a.nc")


def test_a_record_is_no_database(file):
    done = CliRunner().invoke(db, ["show", str(file)])
    assert isinstance(done.exception, SchemaError)
    assert "a flight record" in str(done.exception)


def test_an_unfinished_record_never_takes_the_name(file, monkeypatch):
    before = file.read_bytes()

    def broken(*_):
        raise OSError("no space left on device")

    monkeypatch.setattr("flighttest.records.files.write_seal", broken)
    with pytest.raises(OSError, match="no space left"):
        save_record(as_tree(flighttest.records.reading.read_arrays(file)), file)
    assert file.read_bytes() == before
    assert [item.name for item in file.parent.iterdir()] == [file.name]

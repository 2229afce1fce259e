"""Records as this package writes them: a seal follows their content."""

import hashlib
import json
from pathlib import Path

import h5netcdf
import h5py
import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

import flighttest
from aerodb.cli.group import db
from flightmech.errors import ParseError, SchemaError
from flighttest.cli.group import flight
from flighttest.records.files import contents, save_dataset, save_record
from flighttest.records.listing import record_listing
from flighttest.records.reading import read_arrays
from flighttest.records.record import as_tree

ROOT = Path(__file__).parents[3]
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
    """Remove the seal, as another program does that changes the file."""
    content = path.read_bytes()
    path.write_bytes(content[: content.rindex(b"\nsha256 of the bytes above")])


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
def test_a_file_without_a_seal_prints_the_same(file, verb):
    shown = run(*verb, file)
    unsealed(file)
    assert run(*verb, file) == shown


@pytest.mark.nightly
@pytest.mark.parametrize("name", REAL)
def test_real_records_are_read_again_as_they_were_written(tmp_path, name):
    recording, names = (ROOT / part for part in REAL[name])
    record = flighttest.read(recording, names)
    save_record(record, tmp_path / "run.nc")
    again = flighttest.read(tmp_path / "run.nc")
    for leaf, node in record.children.items():
        for channel in node.data_vars:
            assert (again[leaf][channel].values.tobytes()) == node[channel].values.tobytes()
    unsealed(tmp_path / "run.nc")
    xr.testing.assert_identical(flighttest.read(tmp_path / "run.nc"), again)


def test_what_is_listed_of_a_record(tmp_path):
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
    assert record_listing(read_arrays(tmp_path / "a.nc")) == {
        "facts": facts,
        "channels": [channel | {"units": "rad s-1", "calibration": "q [deg/s]", "missing": 1}],
        "manoeuvres": [],
        "faults": ["imu: gaps in the clock at 0.2 s (0.7 s)", "imu: NaN samples: q 1 from 0.2 s"],
        "unmapped": [],
        "left_out": [],
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
    assert contents(tmp_path / "a.nc") == about


@pytest.mark.slow
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
    facts = record_listing(read_arrays(other))["facts"]
    assert (facts["source_file"], facts["title"]) == ("other.by hand.nc", title)
    assert contents(other)["file"] == "other.by hand.nc"


def test_a_sealed_record_is_read_with_a_name_map(file, tmp_path):
    (tmp_path / "names.toml").write_text('[imu]\np = "imu/q"\n')
    assert "imu/p" in run("show", file, "--names", tmp_path / "names.toml")


def test_a_record_of_an_older_version_with_an_overview_is_read(file):
    """Its overview, which is sealed too, is ignored."""
    shown = [run(*verb, file) for verb in VERBS]
    unsealed(file)
    overview = b'\noverview record 2: {"listing":{"facts":{}}}'
    file.write_bytes(resealed(file.read_bytes() + overview))
    assert [run(*verb, file) for verb in VERBS] == shown
    damaged = file.read_bytes().replace(b'"listing"', b'"lasting"')
    file.write_bytes(damaged)
    with pytest.raises(ParseError, match="damaged file"):
        run("show", file)


def places(path):
    """Yield places of the content and the seal, all over the file."""
    size = path.stat().st_size
    tail = path.read_bytes().rindex(b"\nsha256 of the bytes above")
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
def test_a_program_that_changes_the_file_in_place_cuts_the_seal_off(file, change):
    change(file)
    assert b"sha256 of the bytes above" not in file.read_bytes()
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


@pytest.mark.nightly
def test_a_manoeuvre_that_was_cut_is_shown(tmp_path):
    record = flighttest.read(*(ROOT / part for part in REAL["multisine"]))
    save_dataset(flighttest.cut(record, 10.0, 12.0, 50.0), tmp_path / "cut.nc")
    shown = json.loads(run("show", "--json", tmp_path / "cut.nc"))
    assert len(shown["channels"]) == 50


def test_a_record_that_show_refuses_has_contents(tmp_path):
    """Without canonical names it requires a name map."""
    leaf = xr.Dataset({"my rate": ("time", [1.0, 2.0], {"units": "deg/s"})}, {"time": [0.0, 1.0]})
    save_record(xr.DataTree.from_dict({"/": xr.Dataset(), "/imu": leaf}), tmp_path / "a.nc")
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
        save_record(as_tree(read_arrays(file)), file)
    assert file.read_bytes() == before
    assert [item.name for item in file.parent.iterdir()] == [file.name]

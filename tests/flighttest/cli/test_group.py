import json

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import OutOfRange, ParseError, SchemaError
from flightmech.names import quantity_attributes
from flighttest.cli.group import flight
from flighttest.reconstruction.dynamics.force_coefficients import coefficients
from flighttest.reconstruction.dynamics.saved_paths import open_path
from flighttest.reconstruction.flight_programme import open_biases
from flighttest.reconstruction.smoother import reconstruct
from flighttest.records.files import save_dataset
from flighttest.records.record import read

AIRCRAFT = """
name = "test"
S = 17.0
cbar = 1.7
b = 10.3
mass = 2100.0
Ixx = 10000.0
Iyy = 8000.0
Izz = 15000.0
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory, flown, aircraft):
    folder = tmp_path_factory.mktemp("flight")
    for seed in (0, 1):
        record, _, _ = flown(seed, duration=15.0)
        for node in record.children.values():
            for name in node.data_vars:
                node[name].attrs.update(quantity_attributes(str(name)))
        record.to_netcdf(folder / f"run_{seed}.nc", engine="h5netcdf")
    tables = "".join(
        f"[instruments.{name}]\n"
        + "".join(f"{key} = {_toml(item)}\n" for key, item in table.items())
        for name, table in aircraft.instruments.items()
    )
    (folder / "aircraft.toml").write_text(AIRCRAFT + tables)
    return folder


def _toml(item):
    if isinstance(item, dict):
        return "{ " + ", ".join(f"{key} = {_toml(part)}" for key, part in item.items()) + " }"
    return f"[{', '.join(map(str, item))}]" if isinstance(item, list) else str(item)


def call(*arguments):
    return CliRunner().invoke(flight, list(map(str, arguments)), catch_exceptions=False)


@pytest.mark.slow
def test_show_lists_channels(files):
    done = call("show", files / "run_0.nc")
    assert done.exit_code == 0
    assert "imu/az_imu" in done.output
    found = json.loads(call("show", files / "run_0.nc", "--json").output)
    assert {c["channel"] for c in found["channels"]} >= {"p", "alpha_vane", "vn"}
    assert found["faults"] == []


@pytest.mark.nightly
def test_cut_writes_a_manoeuvre(files, tmp_path):
    target = tmp_path / "m.nc"
    done = call("cut", files / "run_0.nc", 2, 8, "--rate", 25, "-o", target, "--json")
    assert json.loads(done.output)["samples"] == 151
    assert xr.open_dataset(target, engine="h5netcdf").sizes["time"] == 151


@pytest.mark.nightly
def test_a_cut_file_is_a_record_again(files, tmp_path):
    """Slow quantities are scalars in a cut file: they must not get lost on the way back, nor the
    place of the record.
    """
    import flighttest

    record = flighttest.read(files / "run_0.nc")
    cut = (
        flighttest.cut(record, 2.0, 8.0)
        .assign(mass=((), 2900.0, {"units": "kg"}))
        .assign_attrs(runway_elevation=120.0)
    )
    save_dataset(cut, tmp_path / "m.nc")
    again = flighttest.read(tmp_path / "m.nc")
    assert again.attrs["title"] == record.attrs["title"]
    assert again.attrs["runway_elevation"] == 120.0
    np.testing.assert_array_equal(again["data/mass"], 2900.0)
    assert flighttest.cut(again, 3.0, 7.0).attrs["runway_elevation"] == 120.0


@pytest.mark.nightly
def test_constants_of_another_record_are_the_prior(files, tmp_path):
    words = ["--aircraft", files / "aircraft.toml", "--window", 2, 10, "--json"]
    call("reconstruct", files / "run_0.nc", *words, "-o", tmp_path / "a.nc")
    done = call(
        "reconstruct",
        files / "run_1.nc",
        *words,
        "--biases",
        tmp_path / "a.nc",
        "-o",
        tmp_path / "b.nc",
    )
    (found,) = json.loads(done.output)
    before = open_biases(tmp_path / "a.nc").sel(parameter="bias.p")
    assert found["constants"]["bias.p"]["prior"] == pytest.approx(float(before["estimate"]))
    assert found["constants"]["bias.p"]["prior_stderr"] == pytest.approx(float(before["stderr"]))
    with pytest.raises(ParseError, match="no constants of a reconstruction"):
        call(
            "reconstruct",
            files / "run_1.nc",
            *words,
            "--biases",
            files / "run_0.nc",
            "-o",
            tmp_path / "c.nc",
        )
    with pytest.raises(SchemaError, match="go with one record"):
        call(
            "reconstruct",
            files / "run_0.nc",
            files / "run_1.nc",
            *words,
            "--biases",
            tmp_path / "a.nc",
            "-o",
            tmp_path / "d",
        )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.nc", "b.nc"]


def test_window_outside_leaves_no_file(files, tmp_path):
    with pytest.raises(OutOfRange):
        call("cut", files / "run_0.nc", 2, 80, "-o", tmp_path / "m.nc")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.nightly
def test_reconstruct_one_record(files, tmp_path):
    target = tmp_path / "path.nc"
    done = call(
        "reconstruct",
        files / "run_0.nc",
        "--aircraft",
        files / "aircraft.toml",
        "--window",
        2,
        12,
        "-o",
        target,
    )
    assert "State reconstruction: simulated 0, 2 ... 12 s" in done.output
    assert "Identifiability:" in done.output
    found = open_path(target)
    assert found.states.sizes["time"] == 501
    # the file keeps what the path knows of its errors, so coefficients from the file have the
    # budget of those from the path
    straight = reconstruct(
        read(files / "run_0.nc"), read_aircraft(files / "aircraft.toml"), windows=[(2, 12)]
    )
    xr.testing.assert_allclose(found.errors, straight.errors, rtol=1e-5)
    assert (
        "error_qbar" not in coefficients(found, read_aircraft(files / "aircraft.toml"))["CL"].attrs
    )
    assert "factor.alpha_vane" in open_biases(target)["parameter"]


@pytest.mark.nightly
def test_reconstruct_several_records_into_a_folder(files, tmp_path):
    target = tmp_path / "paths"
    done = call(
        "reconstruct",
        files / "run_0.nc",
        files / "run_1.nc",
        "--aircraft",
        files / "aircraft.toml",
        "-o",
        target,
        "--json",
    )
    found = json.loads(done.stdout)
    assert [item["record"] for item in found] == ["simulated 0", "simulated 1"]
    assert sorted(file.name for file in target.iterdir()) == ["run_0.nc", "run_1.nc"]
    assert set(found[0]["constants"]["bias.p"]) == {
        "estimate",
        "stderr",
        "prior",
        "prior_stderr",
        "unit",
    }


@pytest.mark.nightly
def test_batch_of_two_records(files, tmp_path):
    target = tmp_path / "paths"
    records = files / "run_0.nc", files / "run_1.nc"
    done = call(
        "reconstruct",
        *records,
        "--aircraft",
        files / "aircraft.toml",
        "--method",
        "batch",
        "-o",
        target,
    )
    assert "Batch reconstruction: simulated 0, simulated 1" in done.output
    assert "before the fit: rank 27 of 27 constants" in done.output
    assert sorted(file.name for file in target.iterdir()) == ["run_0.nc", "run_1.nc"]


@pytest.mark.nightly
def test_batch_estimates_the_constants_that_are_free(files, tmp_path):
    target = tmp_path / "path.nc"
    free = [word for name in ("bias.alpha_vane", "wind_n", "wind_e") for word in ("--free", name)]
    call(
        "reconstruct",
        files / "run_0.nc",
        "--aircraft",
        files / "aircraft.toml",
        "--method",
        "batch",
        *free,
        "-o",
        target,
    )
    found = open_biases(target)
    assert found["parameter"].values[~found["held"].values].tolist() == [
        "bias.alpha_vane",
        "wind_n",
        "wind_e",
    ]
    with pytest.raises(SchemaError, match="--free goes with --method batch"):
        call(
            "reconstruct",
            files / "run_0.nc",
            "--aircraft",
            files / "aircraft.toml",
            *free,
            "-o",
            target,
        )


@pytest.mark.nightly
def test_figure_of_the_compatibility(files, tmp_path):
    pytest.importorskip("matplotlib", reason="figures need matplotlib")
    target, figure = tmp_path / "path.nc", tmp_path / "compatibility.png"
    done = call(
        "reconstruct",
        files / "run_0.nc",
        "--aircraft",
        files / "aircraft.toml",
        "--figure",
        figure,
        "-o",
        target,
    )
    assert "Data compatibility: simulated 0" in done.output
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_window_goes_with_one_record(files, tmp_path):
    with pytest.raises(SchemaError, match="one record"):
        call(
            "reconstruct",
            files / "run_0.nc",
            files / "run_1.nc",
            "--aircraft",
            files / "aircraft.toml",
            "--window",
            1,
            2,
            "-o",
            tmp_path,
        )


def test_a_file_is_written_atomically(tmp_path, monkeypatch):
    def fail(*_):
        raise OSError("disk full")

    monkeypatch.setattr("flighttest.records.files.write_netcdf", fail)
    with pytest.raises(OSError, match="disk full"):
        save_dataset(xr.Dataset({"q": ("time", np.zeros(3))}), tmp_path / "m.nc")
    assert list(tmp_path.iterdir()) == []

"""Motion capture against a simulated body with analytic rates: pose, rates, specific force, errors,
missing markers.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parents[3] / "examples" / "flapping_vehicle"))
import cameras

import flighttest
from flightmech.errors import IdentificationError, SchemaError, UnknownName
from flighttest.cli.group import flight
from flighttest.records.files import save_record
from flighttest.special_tests.marker_poses import poses
from flighttest.special_tests.motion_capture import read_marker_setup, read_markers, smooth_motion

LINEAR = ("h", "vn", "ve", "vd", "phi", "theta", "psi", "p", "q", "r", "ax", "ay", "az")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("cameras")
    cameras.main(path)
    return path


@pytest.fixture(scope="module")
def setup(folder):
    return read_marker_setup(folder / "markers.toml")


@pytest.fixture(scope="module")
def pose(folder, setup):
    return poses(read_markers(folder / "cameras.csv", setup), setup.body["fuselage"])


def test_the_noise_of_the_markers_is_found(pose):
    assert pose.attrs["noise"] == pytest.approx(cameras.NOISE, rel=0.05)  # 2400 coordinates: 1.5 %


def test_positions_and_turns_lie_within_their_errors(pose):
    from scipy.spatial.transform import Rotation

    true = cameras.truth(pose["time"].values)
    apart = (pose["r"].values - true["position"]) / pose["r_stderr"].values
    q = np.roll(pose["q"].values, -1, axis=1)
    turn = (true["turn"].inv() * Rotation.from_quat(q)).as_rotvec() / pose["turn_stderr"].values
    for z in (apart, turn):
        assert 0.94 < np.mean(np.abs(z) < 2.0) < 0.97  # 95.4 % of 2400
    assert (np.diff(pose["q"].values, axis=0) ** 2).sum(axis=1).max() < 0.01  # no jump of sign


def test_rates_and_specific_force_have_their_errors(pose, setup):
    found = smooth_motion(pose, setup.cutoff)
    true = cameras.truth(found["time"].values)
    for name in LINEAR:
        scatter = float(np.sqrt(np.mean((found[name].values - true[name]) ** 2)))
        assert scatter == pytest.approx(found[name].attrs["stderr"], rel=0.3), (
            name
        )  # 140 independent values of one realisation


def test_without_noise_only_the_cut_off_is_left(setup):
    time = np.arange(800) / 500.0
    true = cameras.truth(time)
    markers = setup.body["fuselage"]
    places = np.stack(
        [true["position"] + true["turn"].apply(np.array(place)) for place in markers.values()],
        axis=1,
    )
    exact = xr.DataArray(
        places,
        {"time": time, "marker": list(markers), "axis": ["n", "e", "d"]},
        ("time", "marker", "axis"),
    )
    found = smooth_motion(poses(exact, markers, noise=1e-4), setup.cutoff)
    true = cameras.truth(found["time"].values)
    for name, least in (
        ("h", 1e-4),
        ("theta", 1e-4),
        ("q", 0.02),
        ("vd", 0.02),
        ("az", 2.4),
    ):  # az: its standard error at the noise of the cameras
        assert np.abs(found[name].values - true[name]).max() < least


def test_a_hole_is_left_open_and_a_short_one_bridged(pose, setup):
    gap = pose.copy(deep=True)
    for name in ("r", "q"):
        gap[name][100:103] = np.nan
        gap[name][300:360] = np.nan
    found, whole = smooth_motion(gap, setup.cutoff), smooth_motion(pose, setup.cutoff)
    lost = np.isnan(found["q"].values)
    assert lost.sum() == 60
    near = np.abs(found["theta"].values - whole["theta"].values)[80:110]
    assert near.max() < 4.0 * whole["theta"].attrs["stderr"]


def test_frames_with_two_markers_have_no_pose_and_mirrors_are_no_rotation(setup):
    markers = setup.body["fuselage"]
    places = np.array(list(markers.values()), float)
    frames = np.stack([places, places * [1.0, 1.0, -1.0], places])
    frames[2, 2:] = np.nan
    P = xr.DataArray(
        frames,
        {"time": [0.0, 1.0, 2.0], "marker": list(markers), "axis": ["n", "e", "d"]},
        ("time", "marker", "axis"),
    )
    found = poses(P, markers, noise=1e-3)
    assert found["r"].values[0] == pytest.approx(np.zeros(3), abs=1e-12)
    assert found["q"].values[0] == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-12)
    assert (
        float(found["residual"][1]) > 0.01
    )  # a mirror image fits badly instead of as a rotation with determinant -1
    assert np.isnan(found["r"].values[2]).all()
    assert found["seen"].values.tolist() == [5, 5, 2]


def test_bad_input_is_refused(pose, setup, folder, tmp_path):
    line = {"a": (0.0, 0.0, 0.0), "b": (1.0, 0.0, 0.0), "c": (2.0, 0.0, 0.0)}
    P = xr.DataArray(
        np.zeros((4, 3, 3)),
        {"time": np.arange(4.0), "marker": list(line)},
        ("time", "marker", "axis"),
    )
    with pytest.raises(IdentificationError, match="do not lie on a line"):
        poses(P, line)
    with pytest.raises(IdentificationError, match="half the frame rate"):
        smooth_motion(pose, 300.0)
    bad = tmp_path / "bad.toml"
    bad.write_text(cameras.SETUP.replace("north west up", "north east up"), encoding="utf-8")
    with pytest.raises(SchemaError, match="right-handed"):
        read_marker_setup(bad)
    bad.write_text(cameras.SETUP.replace("belly", "tail"), encoding="utf-8")
    with pytest.raises(UnknownName, match="tail_x"):
        read_markers(folder / "cameras.csv", read_marker_setup(bad))


@pytest.mark.nightly
def test_the_verb_writes_a_flight_record(folder, tmp_path):
    target = tmp_path / "body.nc"
    words = [
        "markers",
        str(folder / "cameras.csv"),
        "--setup",
        str(folder / "markers.toml"),
        "-o",
        str(target),
    ]
    done = CliRunner().invoke(flight, words)
    assert done.exit_code == 0, done.output
    record = flighttest.read(target)
    assert {"phi", "q", "az", "vd"} <= set(record["fuselage"].to_dataset().data_vars)
    with xr.open_dataset(target, group="fuselage", engine="h5netcdf") as leaf:
        stated = {name: float(leaf[name].attrs["stderr"]) for name in ("phi", "q", "az")}
    assert stated["q"] > 0.0
    assert {name: record["fuselage"][name].attrs["stderr"] for name in stated} == pytest.approx(
        stated
    )
    save_record(record, tmp_path / "again.nc")
    assert flighttest.read(tmp_path / "again.nc")["fuselage"]["q"].attrs["stderr"] == pytest.approx(
        stated["q"]
    )
    names = tmp_path / "names.toml"
    names.write_text(
        '[fuselage]\nq = { column = "q", unit = "rad/s", scale = -2.0, offset = "3 rad/s" }\n',
        encoding="utf-8",
    )
    assert flighttest.read(target, names)["fuselage"]["q"].attrs["stderr"] == pytest.approx(
        2.0 * stated["q"]
    )
    shown = CliRunner().invoke(flight, ["show", str(target)])
    assert "fuselage/q" in shown.output

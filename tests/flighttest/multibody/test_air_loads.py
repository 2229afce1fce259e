"""Motion, loads and wing model of a simulated vehicle whose equations of motion and integration are
of another kind.
"""

import shutil
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from click.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parents[3] / "examples" / "flapping_vehicle"))
import vehicle as truth

import flighttest
from flightmech.errors import AeromatchWarning, IdentificationError, SchemaError, UnknownName
from flighttest.cli.group import flight
from flighttest.special_tests.multibody.extraction import air_loads
from flighttest.special_tests.multibody.mechanics import energy, inertial_loads, spring_loads
from flighttest.special_tests.multibody.motion_fit import fit_tree_motion
from flighttest.special_tests.multibody.vehicle import read_flight, read_vehicle

pytest.importorskip("pinocchio", reason="pinocchio is not installed (extra `multibody`)")
pytestmark = (
    pytest.mark.nightly
)  # two flights of the simulated vehicle and their fit take six seconds

flown = cache(truth.fly)
RATE, ANGLE = "joint.wing_right.angle_rate", "joint.wing_right.angle"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("flights")
    (path / "vehicle.toml").write_text(truth.tree_file(), encoding="utf-8")
    for seed in (1, 2):
        truth.markers(flown(seed, 0.9), seed).round(7).to_csv(
            path / f"flight_{seed}.csv", index=False
        )
    truth.markers(flown(None, 0.9), 3).round(7).to_csv(path / "quiet.csv", index=False)
    return path


@pytest.fixture(scope="module")
def tree(folder):
    return read_vehicle(folder / "vehicle.toml")


@pytest.fixture(scope="module")
def found(folder, tree):
    """A flight without steps of the commands, hence without motion above the cut-off: truth,
    motion, air loads.
    """
    positions, commands = read_flight(folder / "quiet.csv", tree)
    motion = fit_tree_motion(tree, positions)
    kept = np.searchsorted(positions["time"].values, motion.time)
    true = {name: values[kept] for name, values in flown(None, 0.9).items()}
    return true, motion, air_loads(motion, commands)


@pytest.mark.nightly
def test_the_joints_are_those_of_the_truth(tree):
    from flighttest.special_tests.multibody.mechanics import joint_angles

    theta = np.array([[0.3, 0.1, -0.2], [2.5, 0.0, 0.1], [5.0, -0.1, 0.0]])
    own = joint_angles(tree, theta)
    order = [tree.joints.index(name) for name in truth.NAMES[1:]]
    for row, angles in zip(theta, own.angle[:, order]):
        np.testing.assert_allclose(angles, truth.joints(row)[0], atol=1e-14)


@pytest.mark.nightly
def test_what_remains_without_air_is_zero(tree):
    """Accelerations of the truth without air, through the other equations of motion: rounding of
    loads of up to 60 N m.
    """
    rng = np.random.default_rng(0)
    for _ in range(5):
        p, v = rng.standard_normal(10), 3.0 * rng.standard_normal(9)
        p[3:7] /= np.linalg.norm(p[3:7])
        v[6] = 30.0
        v_dot, _ = truth.accelerations(p, v, np.zeros(3), air=False, drives=False)
        rest = inertial_loads(tree, p[None], v[None], v_dot[None])[0]
        rest[6:] += truth.MA * v_dot[6:] - spring_loads(tree, p[None, 7:], v[None, 6:])[0]
        np.testing.assert_allclose(rest, 0.0, atol=1e-12)


@pytest.mark.nightly
def test_energy_is_kept_without_air_and_changes_by_the_power_of_the_loads(tree):
    start = truth.start_state(*truth.START[:5], truth.START[6])
    _, X, _ = truth.integrate(start, lambda *_: np.zeros(3), 0.1, air=False, drives=False)
    rotors = 0.5 * (truth.MA * X[:, 16:] ** 2).sum(axis=1)
    total = energy(tree, X[:, :10], X[:, 10:]) + rotors
    assert (
        np.ptp(total) < 1e-6 * rotors.max()
    )  # the step of the integration leaves 2e-7 J of 8 J in a second
    _, X, _ = truth.integrate(start, lambda *_: np.zeros(3), 0.01, rate=1000.0)
    p, v = X[:, :10], X[:, 10:]
    v_dot = np.array([truth.accelerations(a, b, np.zeros(3))[0] for a, b in zip(p, v)])
    loads = inertial_loads(tree, p, v, v_dot)
    loads[:, 6:] -= spring_loads(tree, p[:, 7:], v[:, 6:])
    change = np.gradient(energy(tree, p, v), 1e-3)[1:-1]
    np.testing.assert_allclose(
        change, (loads * v).sum(axis=1)[1:-1], atol=2e-3 * np.abs(change).max()
    )  # differences over 2 ms


def test_the_motion_has_its_errors(found):
    true, motion, _ = found
    p, v, v_dot = motion.states
    stderr = motion.stderr(
        lambda *y: np.concatenate(
            flighttest.special_tests.multibody.motion_fit.tree_states(*y), axis=1
        )
    )
    q = (p[:, 3:7] * true["p"][:, 3:7]).sum(axis=1)
    np.testing.assert_allclose(np.abs(q), 1.0, atol=1e-5)
    for k, (mine, his) in enumerate(
        (
            (p[:, :3], true["p"][:, :3]),
            (p[:, 8:], true["p"][:, 8:]),
            (v, true["v"]),
            (v_dot, true["v_dot"]),
        )
    ):
        columns = (slice(0, 3), slice(8, 10), slice(10, 19), slice(19, 28))[k]
        z = (mine - his) / stderr[:, columns]
        assert 0.7 < np.sqrt((z**2).mean()) < 1.3, k  # some 70 independent values of each column
    assert motion.noise == pytest.approx(truth.NOISE, rel=0.03)  # 18 000 coordinates


@pytest.mark.nightly
def test_the_crank_is_carried_across_its_dead_centres(found):
    true, motion, _ = found
    turn = motion.states[0][:, 7] - true["p"][:, 7]
    np.testing.assert_allclose(turn, 2.0 * np.pi * np.round(turn.mean() / (2.0 * np.pi)), atol=0.05)


@pytest.mark.nightly
def test_a_crank_may_turn_the_other_way(folder, found):
    """The recording played backwards: the same places and accelerations, the crank in the negative
    sense.
    """
    text = (
        (folder / "vehicle.toml")
        .read_text(encoding="utf-8")
        .replace('rocker = "wing_right"', 'rocker = "wing_right"\nturns = -1')
    )
    (folder / "backwards.toml").write_text(text, encoding="utf-8")
    vehicle = read_vehicle(folder / "backwards.toml")
    positions, _ = read_flight(folder / "quiet.csv", vehicle)
    _, motion, _ = found
    back = fit_tree_motion(vehicle, positions.copy(data=positions.values[::-1]))
    assert back.noise == pytest.approx(motion.noise, rel=1e-3)
    assert back.y_dot[::-1, 7].max() < 0.0
    np.testing.assert_allclose(back.y_dot[::-1, 7], -motion.y_dot[:, 7], rtol=1e-4)
    np.testing.assert_allclose(
        back.y_ddot[::-1, 7:], motion.y_ddot[:, 7:], atol=1e-3 * np.abs(motion.y_ddot[:, 7]).max()
    )


@pytest.mark.nightly
def test_a_crank_that_turns_back_is_followed(tmp_path, tree):
    """The motor of this flight stops near a dead centre and is driven back; the first guess takes a
    crank to turn on.
    """
    true = truth.fly(97)
    truth.markers(true, 97).round(7).to_csv(tmp_path / "flight.csv", index=False)
    positions, _ = read_flight(tmp_path / "flight.csv", tree)
    motion = fit_tree_motion(
        tree, positions.isel(time=slice(450, None))
    )  # 3 mm where the crank is not followed
    assert motion.noise == pytest.approx(truth.NOISE, rel=0.03)
    apart = motion.y[:, 7] - true["p"][np.searchsorted(true["time"], motion.time), 7]
    assert true["v"][np.searchsorted(true["time"], motion.time), 6].min() < 0.0
    np.testing.assert_allclose(
        apart, 2.0 * np.pi * np.round(np.median(apart) / (2.0 * np.pi)), atol=0.2
    )


@pytest.mark.nightly
def test_motion_away_from_the_markers_is_warned_about(folder, tree):
    """A marker that lies elsewhere for 0.1 s, and one whose place on the body is wrong; the
    fixtures show that sound flights are quiet.
    """
    positions, _ = read_flight(folder / "quiet.csv", tree)
    moved, shifted = positions.copy(deep=True), positions.copy(deep=True)
    moved[200:250, 3] += 0.01
    with pytest.warns(
        AeromatchWarning,
        match=r"from 0\.3[89]\d? to 0\.5\d* s the motion lies \d\.?\d* mm from the markers, "
        r"0\.\d+ mm elsewhere",
    ):
        assert fit_tree_motion(tree, moved).noise > 2.0 * truth.NOISE
    shifted[:, 3, 2] += 0.004
    with pytest.warns(
        AeromatchWarning, match=r"alike from frame to frame \(correlation 0\.[5-9]\d\), not noise"
    ):
        fit_tree_motion(tree, shifted)


def test_loads_are_those_of_wings_and_tail(found):
    true, _, data = found
    for name, his in (("load", true["wings"] + true["tail"]), ("known", true["tail"])):
        apart = data[name].values - his
        if name == "load":
            size = np.sqrt(((apart / data["load_stderr"].values) ** 2).mean(axis=0))
            assert ((size > 0.6) & (size < 1.4)).all()  # some 70 independent values of each
        else:  # 0.02 m/s at the tail turn its flow by 4 mrad, a lift of 2 mN in 0.5 N for a radian
            assert np.abs(apart[:, :6]).max() < 0.01
    for name in ("CL", "CD"):
        z = (data[name].values - true[name]) / data[f"{name}_stderr"].values
        assert 0.7 < np.sqrt((z**2).mean()) < 1.3


def test_states_carry_units_and_errors(found):
    _, _, data = found
    assert data[RATE].attrs["units"] == "rad s-1"
    assert data["u"].attrs["stderr"] == pytest.approx(0.005, rel=0.3)
    assert "error" not in data.dims  # the tail of the file has no errors


@pytest.mark.nightly
def test_errors_of_the_tail_are_sources(tree, found):
    _, motion, _ = found
    tail = tree.aerodynamics["tail"]
    uncertain = tail.model_copy(
        update={
            "CL": {"1": (truth.CL_TAIL["1"], 0.01), "alpha": (1.1436, 0.06)},
            "CD": {"1": 0.0872},
        }
    )
    other = fit_motion_of(motion, tree.model_copy(update={"aerodynamics": {"tail": uncertain}}))
    commands = xr.Dataset(
        {name: ("time", np.zeros(2)) for name in ("throttle", "tail_pitch", "tail_roll")},
        {"time": [0.0, 2.0]},
    )
    changed = air_loads(other, commands)
    assert list(changed["error"].values) == ["tail CL 1", "tail CL 2"]
    moved = tail.model_copy(
        update={"CL": {"1": truth.CL_TAIL["1"] + 0.01, "alpha": 1.1436}, "CD": {"1": 0.0872}}
    )
    again = air_loads(
        fit_motion_of(motion, tree.model_copy(update={"aerodynamics": {"tail": moved}})), commands
    )
    np.testing.assert_allclose(
        again["CL"] - changed["CL"], changed["CL_error"].sel(error="tail CL 1"), atol=1e-12
    )


def fit_motion_of(motion, vehicle):
    """The same motion of a vehicle with another tail."""
    from dataclasses import replace

    return replace(motion, vehicle=vehicle)


@pytest.mark.nightly
def test_a_thousand_billionth_moves_nothing(folder, tree, found):
    positions, _ = read_flight(folder / "quiet.csv", tree)
    rng = np.random.default_rng(5)
    again = fit_tree_motion(tree, positions * (1.0 + 1e-12 * rng.standard_normal(positions.shape)))
    _, motion, _ = found
    np.testing.assert_allclose(again.y_ddot, motion.y_ddot, atol=1e-4 * np.abs(motion.y_ddot).max())
    np.testing.assert_allclose(again.y, motion.y, atol=1e-6)


@pytest.mark.nightly
def test_the_verb_fits_the_wings_and_predicts(folder):
    candidates = f"1 u w q {ANGLE} {RATE} {ANGLE}**2 {RATE}**2"
    shutil.rmtree(folder / "out", ignore_errors=True)
    args = [
        "multibody",
        str(folder / "flight_1.csv"),
        "--vehicle",
        str(folder / "vehicle.toml"),
        "--select",
        "CL",
        "--candidates",
        candidates,
    ]
    run = CliRunner().invoke(
        flight, [*args, "--model", f"CD = 1 + {RATE} + {ANGLE}**2 + {RATE}**2", "--band", "1.3",
            "25"]
        + ["--predict", str(folder / "flight_2.csv"), "-o", str(folder / "out")]
    )  # fmt: skip
    assert run.exit_code == 0, run.output
    assert "predicted flight_2: CL R2 0." in run.output
    fit = flighttest.open_fit(folder / "out" / "CD.nc")
    apart = fit.estimates["estimate"].sel(term=RATE) - truth.CD["rate"]
    assert abs(float(apart / fit.estimates["stderr"].sel(term=RATE))) < 3.0
    record = flighttest.read(folder / "out" / "flight_1.nc")
    assert RATE in record["fuselage"].to_dataset()
    assert list(pd.read_csv(folder / "out" / "flight_1_loads.csv").columns[:4]) == [
        "time",
        "X",
        "Y",
        "Z",
    ]


@pytest.mark.nightly
def test_bad_recordings_are_refused(folder, tree, tmp_path):
    table = pd.read_csv(folder / "flight_1.csv")
    table.drop(columns="throttle").to_csv(tmp_path / "a.csv", index=False)
    with pytest.raises(UnknownName, match="throttle"):
        read_flight(tmp_path / "a.csv", tree)
    table.drop(columns="wr1_x").to_csv(tmp_path / "b.csv", index=False)
    with pytest.raises(UnknownName, match="wr1_x"):
        read_flight(tmp_path / "b.csv", tree)
    hidden = table.copy()
    hidden.loc[100:200, [name for name in hidden if name[-2:] in ("_x", "_y", "_z")]] = np.nan
    hidden.to_csv(tmp_path / "c.csv", index=False)
    with pytest.raises(
        IdentificationError,
        match=r"do not determine the motion.*fewer than three markers were seen from 0\.2 to "
        r"0\.4 s",
    ):
        fit_tree_motion(tree, read_flight(tmp_path / "c.csv", tree)[0])
    positions, _ = read_flight(folder / "flight_1.csv", tree)
    with pytest.raises(IdentificationError, match="half the frame rate"):
        fit_tree_motion(tree, positions, 300.0)
    with pytest.raises(IdentificationError, match="at least"):
        fit_tree_motion(tree, positions.isel(time=slice(0, 40)))


def test_a_missing_command_is_named(found):
    _, motion, _ = found
    with pytest.raises(SchemaError, match="throttle missing"):
        air_loads(
            motion,
            xr.Dataset(
                {name: ("time", np.zeros(2)) for name in ("tail_pitch", "tail_roll")},
                {"time": [0.0, 2.0]},
            ),
        )

"""Control loading from simulated records with their truth: constants, free motion, aircraft file,
database, command.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from click.testing import CliRunner

import aerodb
import flightmech
from flightmech.aircraft.controls import Circuit
from flightmech.errors import AeromatchWarning, IdentificationError, SchemaError, UnknownName
from flighttest.cli.submodels import controls_command
from flighttest.remarks import is_forbidden
from flighttest.submodels.control_loading import cable, identification, joint_fit
from flighttest.submodels.control_loading.hinge_terms import replace_hinge_moments
from flighttest.submodels.control_loading.identification import identify_control_loading
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.motion import smooth_derivatives
from flighttest.submodels.control_loading.regression import trim_forces
from flighttest.submodels.control_loading.simulation import simulate_linkages
from flighttest.submodels.control_loading.windows import free_signals, modulate_signal

SHARED = Path(__file__).parents[2] / ".." / "shared" / "data" / "identification"
CHANNELS = {
    "F_N": "F_column",
    "s_m": "column",
    "de_rad": "delta_e",
    "qbar_Pa": "qbar",
    "alpha_rad": "alpha",
    "tab_rad": "delta_t",
    "nz": "nz",
}
FACTS = {
    "title": "t",
    "aircraft": "a",
    "S": 24.2,
    "cbar": 2.06,
    "b": 14.4,
    "x_ref": 0.0,
    "y_ref": 0.0,
    "z_ref": 0.0,
}
AIRCRAFT = """
name = "a"
S = 24.2
cbar = 2.06
b = 14.4
mass = 6000.0
Ixx = 15e3
Iyy = 22e3
Izz = 35e3
[control.delta_e]
S_hinge = 2.2
c_hinge = 0.33
gearing = -1.8
[circuit.column]
mass = 5.0
stops = [-0.17, 0.17]
"""


@pytest.fixture(scope="module")
def truth() -> dict:
    file = SHARED / "truth" / "control_loading_truth.json"
    if not file.exists():
        pytest.skip("needs ../shared/data/identification")
    return json.loads(file.read_text())["parameters"]


def record(file: Path) -> xr.Dataset:
    table = pd.read_csv(file)
    return xr.Dataset(
        {new: ("time", table[old].values) for old, new in CHANNELS.items()},
        {"time": table["t"].values},
    )


@pytest.fixture(scope="module")
def records(truth) -> tuple[list[xr.Dataset], list[xr.Dataset]]:
    folder = SHARED / "control_loading"
    kinds = {
        kind: [record(file) for file in sorted(folder.glob(f"*_{kind}.csv.gz"))]
        for kind in ("sweep", "pulse", "release")
    }
    return kinds["sweep"], [*kinds["pulse"], *kinds["release"]]


@pytest.fixture(scope="module")
def loading(truth) -> ControlLoading:
    return ControlLoading("column", -truth["G"], truth["Se"], truth["ce"])


@pytest.fixture(scope="module")
def found(loading, records):
    """The regressions alone: enough for files, priors and remarks."""
    return identify_control_loading(loading, *records, method="regression")


@pytest.fixture(scope="module")
def fitted(loading, records):
    """The output error that starts from them."""
    return identify_control_loading(loading, *records, method="output error")


@pytest.mark.nightly
def test_constants_and_hinge_moments_are_found(fitted, truth):
    found, G = fitted, truth["G"]
    hinges = {"1": "Ch0", "alpha": "Cha", "delta_e": "Chd", "delta_t": "Cht"}
    names = {
        "preload": "breakout",
        "offset": "unbalance",
        "mass": "mf",
        "inertia": "Ia",
        "cable_stiffness": "Kc",
        "hinge_friction": "Fa",
    }
    names = {**{f"Ch_e: {term}": true for term, true in hinges.items()}, **names}
    pairs = [(found.value(name), truth[true]) for name, true in names.items()]
    pairs += [(found.total("friction"), truth["Ff"] + G * truth["Fa"])]
    bounds = [
        0.05,
        0.03,
        0.03,
        0.03,
        0.1,
        0.1,
        0.15,
        0.15,
        0.15,
        0.15,
        0.04,
    ]  # of score.py next to the data
    assert all(
        abs(value - true) < bound * abs(true)
        for ((value, _), true), bound in zip(pairs, bounds, strict=True)
    )
    assert np.mean([abs(value - true) < 2.0 * stderr for (value, stderr), true in pairs]) >= 0.8


@pytest.mark.slow
def test_bob_weight_and_angle_of_attack_are_named_as_collinear(found):
    assert found.collinear == [("bob_weight", "Ch_e: alpha")]
    assert "only differences between them separate the two" in found.report()


@pytest.mark.nightly
def test_free_motion_follows_the_recorded_forces_and_needs_the_cable(found, loading, records):
    driven, free = records
    misfit = np.array([window.misfit() for window in found.fly(free[:3])])
    rigid = identify_control_loading(loading, driven, free, order=2, method="regression")
    without = np.array([window.misfit() for window in rigid.fly(free[:3])])
    assert misfit.max() < 0.02  # rms over range: 0.2 to 0.8 % as measured
    assert without[:, 0].mean() > 3.0 * misfit[:, 0].mean()
    assert rigid.order == 2
    assert rigid.total("mass")[0] == rigid.value("mass")[0]


def test_aircraft_and_database_take_the_result(found, tmp_path):
    (tmp_path / "a.toml").write_text(AIRCRAFT)
    known = flightmech.read_aircraft(tmp_path / "a.toml")
    written = flightmech.write_aircraft(found.aircraft(known), tmp_path / "b.toml")
    circuit = flightmech.read_aircraft(written).circuits["column"]
    assert circuit.order == 4
    assert circuit.cable_stiffness == pytest.approx(found.value("cable_stiffness")[0])
    assert circuit.stops == (-0.17, 0.17)
    leaf = flightmech.terms.make_term(-0.2, regressors=["alpha"], stderr=0.05, source="datcom")
    database = aerodb.make_database(
        {"Ch_e/alpha": leaf, "Ch_e/delta": leaf}, **FACTS, force_axes="stability"
    )
    new = aerodb.terms(replace_hinge_moments(database, found))
    assert set(new) == {"Ch_e/basic", "Ch_e/alpha", "Ch_e/delta_e", "Ch_e/delta_t"}
    assert float(new["Ch_e/alpha"]["value"]) == found.value("Ch_e: alpha")[0]
    assert float(new["Ch_e/alpha"]["stderr"]) == found.value("Ch_e: alpha")[1]


def changed(found, name: str, value: float, stderr: float):
    at = found.estimates["term"] == name
    estimates = found.estimates.assign(
        estimate=found.estimates["estimate"].where(~at, value),
        stderr=found.estimates["stderr"].where(~at, stderr),
    )
    return replace(found, estimates=estimates)


def test_negative_constants_become_zero_within_their_error_and_are_refused_beyond(found):
    known = Circuit(stops=(-0.1, 0.1), mass=1.0)
    assert changed(found, "hinge_damping", -0.3, 0.2).circuit(known).hinge_damping == 0.0
    with pytest.raises(SchemaError, match=r"hinge_damping is -0\.5 .* must not be negative"):
        changed(found, "hinge_damping", -0.5, 0.2).circuit(known)
    with pytest.raises(SchemaError, match=r"inertia is -0\.1 .* must not be negative"):
        changed(found, "inertia", -0.1, 0.2).circuit(known)


@pytest.mark.nightly
def test_command_writes_aircraft(records, tmp_path):
    driven, free = records
    files = []
    for k, one in enumerate([*driven, free[1], free[5]]):
        one.to_netcdf(tmp_path / f"{k}.nc", engine="h5netcdf")
        files.append(str(tmp_path / f"{k}.nc"))
    (tmp_path / "a.toml").write_text(AIRCRAFT)
    more = [
        "--free",
        files[-2],
        "--free",
        files[-1],
        "--aircraft",
        str(tmp_path / "a.toml"),
        "-o",
        str(tmp_path / "b.toml"),
        "--json",
    ]
    result = CliRunner().invoke(controls_command, [*files[:-2], *more], catch_exceptions=False)
    answer = json.loads(result.output)
    assert answer["order"] == 4
    assert answer["estimates"]["Ch_e: delta_e"][0] == pytest.approx(-0.29, rel=0.03)
    assert flightmech.read_aircraft(tmp_path / "b.toml").circuits["column"].order == 4


def one_mass(
    mass: float, friction: float, spring: float, s0: float, step: float, count: int
) -> np.ndarray:
    zero = np.zeros(1)
    names = dict(
        mass=mass, friction=friction, damping=0.0, preload=0.0, stiffness=spring, rigging=0.0
    )
    constants = {name: np.array([value]) for name, value in names.items()}
    s, _ = simulate_linkages(
        constants, -1.0, (np.array([s0]), zero), np.zeros((count, 1)), np.zeros((count, 1, 1)), step
    )
    return s[:, 0]


def test_dry_friction_takes_twice_its_travel_every_half_cycle_and_then_holds():
    mass, friction, spring = 5.0, 4.0, 2000.0
    half = np.pi * np.sqrt(mass / spring)
    s = one_mass(mass, friction, spring, 0.011, half / 100.0, 800)
    turns = 0.011 - 2.0 * friction / spring * np.arange(3)
    assert s[[0, 100, 200]] * [1, -1, 1] == pytest.approx(
        turns, abs=2e-5
    )  # sub-steps of 1 ms: (omega h)^2/24 and what a reversal leaves
    assert np.ptp(s[400:]) == 0.0
    assert abs(s[-1]) <= friction / spring


@pytest.mark.nightly
def test_command_divides_records_by_their_manoeuvres_and_joins_the_drawings(records, tmp_path):
    driven, free = records
    listed = json.dumps([{"manoeuvre": "release_column", "start": 0.0, "end": 12.0}])
    (tmp_path / "recordings").mkdir()
    files = []
    for k, one in enumerate([*driven, free[1], free[5]]):
        name = f"{k}.nc"
        one.to_netcdf(tmp_path / name, engine="h5netcdf")
        xr.DataTree(
            xr.Dataset(attrs={"manoeuvres": listed if k >= len(driven) else "[]"})
        ).to_netcdf(tmp_path / "recordings" / name, engine="h5netcdf")
        files.append(str(tmp_path / name))
    heavy = AIRCRAFT.replace("mass = 5.0", "mass = 9.0")
    (tmp_path / "a.toml").write_text(heavy)
    common = [*files, "--aircraft", str(tmp_path / "a.toml"), "--json"]
    divided = ["--records", str(tmp_path / "recordings"), "--free-manoeuvre", "release_column"]
    answers = [
        json.loads(
            CliRunner()
            .invoke(controls_command, [*common, *divided, *more], catch_exceptions=False)
            .output
        )["estimates"]
        for more in ([], ["--prior", "0.001"])
    ]
    assert answers[0]["mass"][0] == pytest.approx(5.1, rel=0.1)
    assert answers[1]["mass"][0] == pytest.approx(9.0, rel=0.02)
    with pytest.raises(SchemaError, match="--records and --free-manoeuvre go together"):
        CliRunner().invoke(controls_command, [*common, *divided[:2]], catch_exceptions=False)


@pytest.mark.slow
def test_without_a_mass_the_circuit_keeps_its_own(loading, records):
    slow = replace(loading, constants=("offset", "preload", "friction", "damping"))
    found = identify_control_loading(slow, records[0], order=2)
    known = Circuit(
        stops=(-0.1, 0.1), order=4, mass=5.0, inertia=0.5, cable_stiffness=3e4, hinge_friction=3.0
    )
    circuit = found.circuit(known)
    assert (circuit.order, circuit.mass, circuit.inertia, circuit.cable_stiffness) == (
        4,
        5.0,
        0.5,
        3e4,
    )
    assert (circuit.friction, circuit.hinge_friction) == (found.value("friction")[0], 0.0)


def heavier(found, known: Circuit, name: str) -> tuple[float, float]:
    joined = found.with_prior(replace(known, **{name: 2.0 * found.value(name)[0]}), error=0.01)
    return joined.value(name)[0] / found.value(name)[0], joined.value(name)[1] / found.value(name)[
        1
    ]


def test_mass_of_both_ends_is_not_biased(found, truth):
    value, stderr = found.total("mass")
    true = truth["mf"] + truth["G"] ** 2 * truth["Ia"]
    assert abs(value - true) < 3.0 * stderr
    assert stderr < 0.01 * true


def test_prior_moves_what_the_records_leave_open_most(found):
    known = Circuit(stops=(-0.1, 0.1), order=4, mass=0.0, inertia=0.0)
    moved, narrowed = heavier(found, known, "cable_damping")
    held, _ = heavier(found, known, "cable_stiffness")
    assert abs(moved - 2.0) < abs(held - 2.0)
    assert narrowed < 0.5
    same = found.with_prior(known)
    assert np.array_equal(same.estimates["estimate"], found.estimates["estimate"])


@pytest.mark.nightly
def test_errors_of_the_pick_ups_widen_what_they_move(loading, records):
    driven, free = records[0], records[1][:1]
    plain = identify_control_loading(loading, driven, free, order=2, method="regression")
    wide = identify_control_loading(
        loading,
        driven,
        free,
        order=2,
        method="regression",
        errors={"F_column": (2.0, 0.02), "wheel": (1.0, 1.0)},
    )
    assert wide.value("friction")[0] == plain.value("friction")[0]
    expected = np.hypot(plain.value("friction")[1], 0.02 * plain.value("friction")[0])
    assert wide.value("friction")[1] == pytest.approx(expected, rel=0.02)
    assert wide.value("offset")[1] == pytest.approx(
        np.hypot(plain.value("offset")[1], 2.0), rel=0.02
    )


@pytest.mark.nightly
def test_errors_of_the_pick_ups_are_carried_on_as_a_refit_would(found, loading, records):
    scale = 1.001
    wide = identify_control_loading(
        loading, *records, errors={"delta_e": (0.0, scale - 1.0)}, method="regression"
    )
    moved = identify_control_loading(
        loading,
        *([one.assign(delta_e=one["delta_e"] * scale) for one in group] for group in records),
        method="regression",
    )
    for name in ("friction", "Ch_e: delta_e", "cable_stiffness", "inertia"):
        carried = np.sqrt(wide.value(name)[1] ** 2 - found.value(name)[1] ** 2)
        # the noise that is taken off changes too, and to second order the stretch, a difference of
        # travels that is 40 times as small
        assert carried == pytest.approx(abs(moved.value(name)[0] - found.value(name)[0]), rel=0.15)


@pytest.mark.nightly
def test_drawings_hold_masses_that_are_lost_in_noise(loading, records):
    rng = np.random.default_rng(1)
    noisy = [
        one.assign(
            {
                name: one[name] + size * rng.normal(size=one.sizes["time"])
                for name, size in (("column", 9e-4), ("delta_e", 1.5e-3))
            }
        )
        for one in records[0]
    ]
    with pytest.raises(
        IdentificationError,
        match=r"mass: 9\d% of what distinguishes it from the other terms is noise",
    ):
        identify_control_loading(loading, noisy)
    known = Circuit(stops=(-0.1, 0.1), order=4, mass=5.0, inertia=0.5, cable_stiffness=3e4)
    held = identify_control_loading(loading, noisy, drawings=known)
    assert abs(held.value("inertia")[0] - 0.5) < 2.0 * held.value("inertia")[1] < 0.3
    assert held.value("cable_stiffness")[0] == pytest.approx(31000.0, rel=0.02)


def oscillation(time: np.ndarray) -> np.ndarray:
    return np.exp(-((time - 3.0) ** 2)) * np.sin(2.0 * np.pi * 8.0 * time) + 0.2 * time


def test_derivatives_behind_the_low_pass_are_exact_up_to_half_the_sampling_rate():
    step = 0.02
    time = np.arange(0.0, 6.0, step)
    s, rate, acceleration = smooth_derivatives(oscillation(time), step, np.inf)
    h = 1e-5
    slope = (oscillation(time + h) - oscillation(time - h)) / (2.0 * h)
    second = (oscillation(time + h) - 2.0 * oscillation(time) + oscillation(time - h)) / h**2
    assert s == pytest.approx(oscillation(time), abs=1e-12)
    assert np.abs(rate - slope).max() < 1e-3 * np.abs(slope).max()
    assert np.abs(acceleration - second)[5:-5].max() < 2e-3 * np.abs(second).max()
    gain = np.ptp(smooth_derivatives(np.sin(2.0 * np.pi * 8.0 * time), step, 8.0)[0][100:200]) / 2.0
    assert gain == pytest.approx(0.707, abs=0.01)


def test_windows_end_at_reversals_and_give_derivatives_without_differences(loading):
    time = np.arange(0.0, 2.0, 0.01)
    s = 0.05 * np.sin(2.0 * np.pi * 1.0 * time)
    channels = {"F_column": np.zeros_like(s), "column": s, "delta_e": loading.gearing * s}
    channels |= {name: np.full_like(s, 1.0) for name in ("qbar", "alpha", "delta_t", "nz")}
    moved, windows = free_signals(
        loading, xr.Dataset({name: ("time", x) for name, x in channels.items()}, {"time": time})
    )
    assert len(windows) >= 8
    rate = moved["rate"].values
    assert all((np.sign(rate[one.part]) == np.sign(rate[one.part][0])).all() for one in windows)
    for order, exact in (
        (1, 2.0 * np.pi * 0.05 * np.cos(2.0 * np.pi * time)),
        (2, -((2.0 * np.pi) ** 2) * s),
    ):
        assert modulate_signal(s, windows, order) == pytest.approx(
            modulate_signal(exact, windows), abs=2e-3 * np.abs(exact).max()
        )


def steady(count: int, rng: np.random.Generator, coupled: bool = False) -> xr.Dataset:
    """Points at several speeds and c.g. positions of a column with friction 6 N, offset 12 N, Ch =
    0.01 - 0.05 alpha - 0.3 delta_e.
    """
    qbar, alpha = rng.uniform(2000.0, 6000.0, count), rng.uniform(0.03, 0.15, count)
    delta = -0.4 * alpha + (0.0 if coupled else rng.normal(0.0, 0.02, count))
    F = (
        12.0
        + 1.8 * 2.2 * 0.33 * qbar * (0.01 - 0.05 * alpha - 0.3 * delta)
        + rng.uniform(-6.0, 6.0, count)
    )
    return xr.Dataset(
        {
            name: ("point", x)
            for name, x in {"F_column": F, "qbar": qbar, "alpha": alpha, "delta_e": delta}.items()
        }
    )


def test_steady_points_give_hinge_moments_and_bound_friction():
    loading = ControlLoading("column", -1.8, 2.2, 0.33, "Ch_e = 1 + alpha + delta_e")
    found = trim_forces(loading, steady(40, np.random.default_rng(3)))
    truth = {"offset": 12.0, "Ch_e: 1": 0.01, "Ch_e: alpha": -0.05, "Ch_e: delta_e": -0.3}
    errors = [
        (float(found.estimates["estimate"].sel(term=n)) - x)
        / float(found.estimates["stderr"].sel(term=n))
        for n, x in truth.items()
    ]
    assert np.abs(errors).max() < 2.5
    assert found.determined()["Ch_e: delta_e"]
    assert 6.0 < found.estimates.attrs["friction_limit"] < 9.0
    few = trim_forces(loading, steady(7, np.random.default_rng(3)))
    assert not few.determined()["offset"]
    assert "not determined; below" in few.report()
    with pytest.raises(IdentificationError, match="5 steady points; at least 6"):
        trim_forces(loading, steady(5, np.random.default_rng(3)))
    with pytest.raises(IdentificationError):  # one c.g.: angle of attack and elevator go together
        trim_forces(loading, steady(20, np.random.default_rng(3), coupled=True))


def test_faults_are_named():
    with pytest.raises(
        SchemaError,
        match=r"(?s)gearing is 0\.0; it must not be 0.*c_hinge is -1\.0; it must be positive",
    ):
        ControlLoading("column", 0.0, 2.2, -1.0)
    with pytest.raises(SchemaError, match="distance of the ailerons"):
        ControlLoading("wheel", -0.35, 1.0, 0.4)
    with pytest.raises(SchemaError, match="one of Ch_r; the column has Ch_e"):
        ControlLoading("column", -1.8, 2.2, 0.33, "Ch_r = 1 + beta")


def test_records_without_what_is_needed_are_refused(loading, records):
    driven, _ = records
    with pytest.raises(UnknownName, match="delta_t"):
        identify_control_loading(loading, [driven[0].drop_vars("delta_t")])
    still = driven[0].assign(column=("time", np.zeros(driven[0].sizes["time"])))
    with pytest.raises(IdentificationError, match="samples in which the control slides"):
        identify_control_loading(loading, [still])
    with pytest.raises(
        IdentificationError
    ):  # one tab setting cannot separate the tab from the constant
        identify_control_loading(
            loading, [one.assign(delta_t=("time", np.zeros(one.sizes["time"]))) for one in driven]
        )


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("module", "name"),
    [
        (joint_fit, "weights of the force"),
        (cable, "stretch of the cable"),
        (identification, "shares of the surface"),
    ],
)
def test_iterations_that_stop_at_their_limit_are_remarked(
    loading, records, found, module, name, monkeypatch, tmp_path
):
    assert found.remarks == []
    assert all(convergence.converged for convergence in found.iterations.values())
    assert "not converged" not in found.report()
    # A single pass cannot show that it converged.
    monkeypatch.setattr(module, "_PASSES", 0 if module is identification else 1)
    stopped = identify_control_loading(loading, *records, method="regression")
    assert not stopped.iterations[name].converged
    assert is_forbidden(stopped.remarks)
    assert f"!! {name}: not converged after 1 iterations" in stopped.report()
    (tmp_path / "a.toml").write_text(AIRCRAFT, encoding="utf-8")
    craft = flightmech.read_aircraft(tmp_path / "a.toml")
    with pytest.warns(AeromatchWarning, match="circuit of the column: .*not converged"):
        stopped.aircraft(craft)


def test_a_change_below_half_of_the_standard_error_is_converged():
    def convergence(change, stderr):
        return joint_fit.estimates_convergence(
            np.array([change, 0.0]), np.ones(2), np.array([stderr, 0.0]), 3
        )

    assert convergence(0.4, 1.0).converged
    (remark,) = joint_fit.convergence_remarks({"passes": convergence(0.8, 1.0)})
    assert (remark.severity, remark.value) == ("warning", pytest.approx(1.6))
    (remark,) = joint_fit.convergence_remarks({"passes": convergence(0.4, np.nan)})
    assert remark.severity == "error"
    # Without noise the standard error is that of rounding.
    assert convergence(1e-12, 1e-14).converged

"""Reconstruction of a simulated flight whose truth is known."""

import copy
import itertools

import numpy as np
import pytest
import xarray as xr
from scipy.signal import lfilter

import flighttest
from flightmech.errors import IdentificationError, OutOfRange, SchemaError
from flighttest.reconstruction import smoother
from flighttest.reconstruction.path_quantities import motion_quantities
from flighttest.reconstruction.problem.problem import PER_RUN, identifiability_remarks
from flighttest.reconstruction.problem.trajectory import estimate_trajectory, step_trajectory
from flighttest.reconstruction.smoother import solve_record
from flighttest.reconstruction.state_errors import state_errors
from flighttest.reconstruction.turbulence import has_gusts
from flighttest.records.record import find_channel_leaf
from flighttest.records.signals.delays import lag_weights

ERROR_FREE = {"V": 0.05, "alpha": 0.0012, "beta": 0.0012, "theta": 0.0008, "h": 0.6}  # m/s, rad, m


def rms(path, truth, name):
    return float(np.sqrt(np.mean((path.states[name].values - truth[name].values) ** 2)))


@pytest.fixture(scope="module")
def calm(flown, aircraft):
    record, error, truth = flown(0)
    return flighttest.reconstruct(record, aircraft), error, truth


def test_states_follow_the_truth(calm):
    path, _, truth = calm
    # standard errors of the constants times their leverage: 1e-3 rad in theta (bias against ax),
    # 0.05 m/s from wind and temperature
    assert {name: rms(path, truth, name) for name in ERROR_FREE} == {
        name: pytest.approx(0.0, abs=tol) for name, tol in ERROR_FREE.items()
    }


def test_reconstruction_beats_the_readings(calm, flown):
    path, _, truth = calm
    record = flown(0)[0]
    raw = np.sqrt(np.mean((record["vanes/alpha_vane"].values - truth["alpha"].values) ** 2))
    assert rms(path, truth, "alpha") < 0.1 * raw


def test_forces_are_at_the_cg(calm):
    path, _, truth = calm
    # the noise of one reading, 0.04 m/s2, and the error of the differentiated rates over the arm of
    # 0.9 m
    assert rms(path, truth, "az") < 0.05


def test_errors_of_the_states_are_what_the_path_does_when_a_constant_is_wrong(flown, aircraft):
    """Against paths solved again with every constant held, one standard error of one independent
    error away.
    """
    record = flown(0, duration=12.0)[0]
    setup, solution = solve_record(record, aircraft)
    errors = state_errors(record, aircraft, setup, solution)
    names = setup.problem.constants.names
    labels = [str(label) for label in errors["error"].values]
    nominal = motion_quantities(record, aircraft, setup, solution.x, solution.c)
    order = [names.index(label.split(" of ")[0]) for label in labels]
    assert [" of " in label for label in labels] == [names[i] in PER_RUN for i in order]
    L = np.linalg.cholesky(solution.covariance[np.ix_(order, order)])
    for label in ("bias.ax_imu", "factor.alpha_vane", labels[-1]):
        dc = np.zeros(len(names))
        dc[order] = L[:, labels.index(label)]
        other = estimate_trajectory(setup.problem, solution.x, solution.c + dc, held=names)
        changed = motion_quantities(record, aircraft, setup, other.x, other.c)
        for name in ("alpha", "qbar", "ax"):
            wanted = changed[name] - nominal[name]
            # to first order, and in single precision: 2 % of the largest change of the state by any
            # source
            np.testing.assert_allclose(
                errors[name].sel(error=label), wanted, atol=0.02 * float(np.abs(errors[name]).max())
            )


@pytest.mark.nightly
def test_constants_lie_within_their_standard_errors(flown, aircraft):
    z = []
    for seed in range(10):
        record, error, _ = flown(seed, duration=30.0)
        found = flighttest.reconstruct(record, aircraft).biases
        names = [n for n in found["parameter"].values if n in error]
        estimate, stderr = (found[k].sel(parameter=names).values for k in ("estimate", "stderr"))
        z.append((estimate - [error[n] for n in names]) / stderr)
    z = np.array(z)
    # 190 deviations; 95.4 % of normal ones lie within two; they are correlated within a flight, so
    # the count scatters by 3 %
    assert (np.abs(z) < 2.0).mean() > 0.89
    assert 0.8 < np.sqrt(np.mean(z**2)) < 1.2


def test_residuals_are_the_noise_of_the_sensors(calm):
    fit = calm[0].fit
    # rms of a few hundred readings or more: 200 gps readings scatter by 5 %
    assert (abs(fit["ratio"] - 1.0) < 0.15).all()
    assert (fit["verdict"] == "use").all()
    assert (abs(fit["autocorrelation"]) < 0.2).all()


def test_confused_constants_are_reported(calm):
    words = identifiability_remarks(calm[0].biases)
    assert any("bias.ax_imu and bias.theta cannot be distinguished" in text for text in words)
    assert "bias.ax_imu and bias.theta" in calm[0].report()


@pytest.mark.nightly
def test_gusts_are_found(flown, aircraft):
    record, _, truth = flown(3, gust=0.6)
    path = flighttest.reconstruct(record, aircraft)
    assert path.states.attrs["gusts"] != "none"
    late = slice(100, -100)
    for name, tol in (
        ("alpha", 0.004),
        ("V", 0.4),
    ):  # rad, m/s: vane factor and lag rest on their priors in turbulence
        e = path.states[name].values - truth[name].values
        assert np.sqrt(np.mean((e - e.mean())[late] ** 2)) < tol, name
    # an estimate in calm air would carry the whole gust: 0.6 m/s in V
    assert np.corrcoef(path.states["V"].values[late], truth["V"].values[late])[0, 1] > 0.999
    assert bool(path.biases["held"].sel(parameter="factor.alpha_vane"))


@pytest.mark.slow
def test_windows_share_their_constants(flown, aircraft):
    record, _, truth = flown(1)
    path = flighttest.reconstruct(record, aircraft, windows=[(25.0, 38.0), (2.0, 15.0)])
    assert path.states["time"].values[0] == 2.0
    assert path.states["time"].values[-1] == 38.0
    assert path.states.sizes["time"] == 2 * 651
    known = truth.sel(time=path.states["time"], method="nearest")
    assert np.sqrt(np.mean((path.states["alpha"].values - known["alpha"].values) ** 2)) < 0.002


@pytest.mark.slow
def test_without_a_heading_the_ground_velocity_turns_the_path(flown, aircraft):
    """The heading starts at 1 rad, not at zero, and follows from track and airspeed."""
    record, _, truth = flown(2)
    leaf = find_channel_leaf(record, "psi")
    blind = record.copy()
    blind[leaf] = record[leaf].to_dataset().drop_vars("psi")
    path = flighttest.reconstruct(blind, aircraft)
    error = path.states["psi"].values - truth["psi"].values
    error = (error + np.pi) % (2.0 * np.pi) - np.pi
    assert abs(error.mean()) < 0.02
    assert rms(path, truth, "beta") < 0.002
    assert "vn" in path.fit.index


@pytest.mark.slow
def test_the_second_stage_in_turbulence_starts_with_equations_of_its_own(
    flown, aircraft, monkeypatch
):
    """The intensity of the gusts changes between the stages, and with it the cost of a path."""
    stages = []
    estimate = smoother.estimate_trajectory

    def record_start(problem, x, c, *rest, known=None, **options):
        stages.append((problem, known))
        return estimate(problem, x, c, *rest, known=known, **options)

    monkeypatch.setattr(smoother, "estimate_trajectory", record_start)
    solve_record(flown(3, gust=0.6, duration=20.0)[0], aircraft)
    assert len(stages) > 2
    for (before, _), (problem, known) in itertools.pairwise(stages):
        assert known is None or problem is before


@pytest.mark.slow
def test_without_ground_velocity_the_air_path_remains(flown, aircraft):
    record, _, truth = flown(2)
    path = flighttest.reconstruct(record.drop_nodes("gps"), aircraft)
    assert "wind_n" not in path.biases["parameter"]
    # temperature and static error rest on their priors: 1 % of the speed
    assert rms(path, truth, "V") < 1.5
    assert np.std(path.states["alpha"].values - truth["alpha"].values) < 0.004


def test_without_sideslip_vane_sideslip_comes_from_the_side_force(flown, aircraft):
    record, _, truth = flown(2)
    record = record.assign(
        {"vanes": xr.DataTree(record["vanes"].to_dataset().drop_vars("beta_vane"))}
    )
    path = flighttest.reconstruct(record, aircraft)
    assert np.corrcoef(path.states["beta"].values, truth["beta"].values)[0, 1] > 0.98


@pytest.mark.slow
def test_vane_ahead_of_the_inertial_unit_has_a_negative_lag(flown, aircraft):
    record, _, truth = flown(2)
    vanes = record["vanes"].to_dataset()
    early = record.assign({"vanes": xr.DataTree(vanes.assign_coords(time=vanes["time"] - 0.065))})
    uncertain = copy.deepcopy(aircraft)
    uncertain.instruments["vanes"]["lag"] = [0.0, 0.05]
    path = flighttest.reconstruct(early, uncertain, windows=[(1.0, 39.0)])
    lag = path.biases.sel(parameter="lag.vanes")
    assert float(lag["estimate"]) < 0.0
    known = truth.interp(time=path.states["time"])
    assert np.std(path.states["alpha"].values - known["alpha"].values) < 0.002


def test_lag_weights_follow_the_lag_through_zero():
    dt = 0.02
    for tau in (-0.05, -1e-3, 0.0, dt / 20.0, 2e-3, 0.02, 0.3):
        weights, slope = lag_weights(tau, dt)
        assert weights.sum() == pytest.approx(1.0)
        near = [lag_weights(tau + step, dt)[0] for step in (-1e-7, 1e-7)]
        # E = exp(-20) is left out below dt/20: 2e-9 over the step of 2e-7
        np.testing.assert_allclose((near[1] - near[0]) / 2e-7, slope, atol=0.02, rtol=1e-5)


def test_step_turns_the_velocity_with_the_heading():
    x, dx = np.zeros((1, 7)), np.zeros((1, 7))
    x[0, 3:6], dx[0, :3] = (80.0, 30.0, 4.0), (0.1, 0.0, 0.3)
    dx[0, 3:5] = -30.0 * 0.3, 80.0 * 0.3  # what a turn of 0.3 rad is to first order
    after = step_trajectory(x, dx)
    assert np.hypot(*after[0, 3:5]) == pytest.approx(np.hypot(80.0, 30.0))
    assert np.arctan2(after[0, 4], after[0, 3]) - np.arctan2(30.0, 80.0) == pytest.approx(0.3)
    small = 1e-5 * np.arange(1.0, 8.0)[None]
    np.testing.assert_allclose(step_trajectory(x, small), x + small, atol=1e-7)
    assert (
        after[0, 5] == 4.0
    )  # roll and sideways steps leave the climb alone, as they do the height


@pytest.mark.slow
def test_lower_rate(flown, aircraft):
    record, _, truth = flown(0)
    path = flighttest.reconstruct(record, aircraft, rate=25.0)
    known = truth.interp(time=path.states["time"])
    assert np.sqrt(np.mean((path.states["alpha"].values - known["alpha"].values) ** 2)) < 0.002


def test_window_outside_the_record(flown, aircraft):
    with pytest.raises(OutOfRange, match=r"window 30 \.\.\. 60 s; the record holds 0 \.\.\. 40 s"):
        flighttest.reconstruct(flown(0)[0], aircraft, windows=[(30.0, 60.0)])


def test_overlapping_windows(flown, aircraft):
    with pytest.raises(OutOfRange, match="windows overlap at 8 s"):
        flighttest.reconstruct(flown(0)[0], aircraft, windows=[(2.0, 10.0), (8.0, 20.0)])


def test_nan_in_an_input_names_channel_and_time(flown, aircraft):
    record = flown(0)[0].copy(deep=True)
    record["imu/q"].values[500] = np.nan
    with pytest.raises(SchemaError, match=r"imu/q: 1 NaN samples, first at 10 s"):
        flighttest.reconstruct(record, aircraft)


def test_steep_attitude_is_refused(flown, aircraft):
    record = flown(0)[0].copy(deep=True)
    record["imu/theta"].values[700:710] = 1.5
    with pytest.raises(OutOfRange, match="pitch attitude reaches 86 deg"):
        flighttest.reconstruct(record, aircraft)
    assert (
        flighttest.reconstruct(record, aircraft, windows=[(20.0, 30.0)]).states.sizes["time"] == 501
    )


@pytest.mark.nightly
def test_wrong_sign_of_an_axis_names_the_record(flown, aircraft):
    record = flown(0)[0].copy(deep=True)
    record["imu/az_imu"].values[:] *= -1.0
    with pytest.raises(IdentificationError, match="simulated 0: the reconstruction"):
        flighttest.reconstruct(record, aircraft)


def test_missing_channel(flown, aircraft):
    record = flown(0)[0]
    record = record.assign({"imu": xr.DataTree(record["imu"].to_dataset().drop_vars("q"))})
    with pytest.raises(SchemaError, match="no channel q"):
        flighttest.reconstruct(record, aircraft)


def test_faults_of_the_specification_come_all_at_once(flown, aircraft):
    broken = copy.deepcopy(aircraft)
    del broken.instruments["imu"]["position"]
    del broken.instruments["imu"]["noise"]["q"]
    with pytest.raises(SchemaError) as caught:
        flighttest.reconstruct(flown(0)[0], broken)
    assert len(caught.value.problems) == 2
    assert "no instrument gives the noise of q" in str(caught.value)


def test_misspelt_key_of_an_instrument(flown, aircraft):
    broken = copy.deepcopy(aircraft)
    broken.instruments["vanes"]["lags"] = [0.05, 0.02]
    with pytest.raises(SchemaError, match="unknown key; near it: lag"):
        flighttest.reconstruct(flown(0)[0], broken)


@pytest.mark.nightly
def test_a_programme_knows_its_instruments_better(flown, aircraft):
    whole = flown(5)[0]
    parts = [slice(0.0, 13.0), slice(13.0, 26.0), slice(26.0, 40.0)]
    records = [
        whole.map_over_datasets(lambda d, part=part: d.sel(time=part) if d.data_vars else d)
        for part in parts
    ]
    alone = [flighttest.reconstruct(r, aircraft) for r in records]
    together = flighttest.reconstruct_programme(records, aircraft)
    names = [
        n for n in alone[0].biases["parameter"].values if n.startswith(("bias", "factor", "delay"))
    ]
    for a, b in zip(alone, together, strict=True):
        assert (
            b.biases["stderr"].sel(parameter=names)
            < 1.001 * a.biases["stderr"].sel(parameter=names)
        ).all()
    combined = flighttest.reconstruction.combine_biases(alone)
    assert "wind_n" not in combined["parameter"]
    assert combined.attrs["runs"] == 3
    # what proves the model takes the instruments from the others and gives them nothing, to the
    # last bit
    blind = flighttest.reconstruct_programme(records[:2], aircraft, validation=records[2:])
    pair = flighttest.reconstruct_programme(records[:2], aircraft)
    for a, b in zip(pair, blind[:2], strict=True):
        xr.testing.assert_identical(a.states, b.states)
        xr.testing.assert_identical(a.biases, b.biases)
    xr.testing.assert_identical(
        blind[2].states, together[2].states
    )  # here the others are the same two


@pytest.mark.slow
def test_combination_is_the_sum_of_information(flown, aircraft):
    found = flighttest.reconstruct(flown(0)[0], aircraft).biases
    once, twice = (
        flighttest.reconstruction.combine_biases([found]),
        flighttest.reconstruction.combine_biases([found, found]),
    )
    shared = once["parameter"].values
    np.testing.assert_allclose(
        once["estimate"], found["estimate"].sel(parameter=shared), rtol=1e-6, atol=1e-12
    )
    np.testing.assert_allclose(once["stderr"], found["stderr"].sel(parameter=shared), rtol=1e-6)
    # where the data outweigh the prior, two equal runs halve the variance; the prior of 5e-4 rad/s
    # is 1/30 of the information
    ratio = (twice["stderr"] / once["stderr"]).sel(parameter="bias.p")
    assert float(ratio) == pytest.approx(np.sqrt(0.5), rel=5e-3)


@pytest.mark.slow
def test_a_run_with_wider_errors_than_its_prior_adds_nothing(flown, aircraft):
    """Errors are widened for coloured residuals, beyond the prior if the data say little."""
    found = flighttest.reconstruct(flown(0)[0], aircraft).biases
    alone = flighttest.reconstruction.combine_biases([found])
    blurred = found.copy(deep=True)
    blurred["stderr"] = 3.0 * found["prior_stderr"]
    blurred["correlation"] = (found["correlation"].dims, np.eye(found.sizes["parameter"]))
    together = flighttest.reconstruction.combine_biases([found, blurred])
    np.testing.assert_allclose(together["estimate"], alone["estimate"], rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(together["stderr"], alone["stderr"], rtol=1e-9)


@pytest.mark.slow
def test_runs_with_different_priors_are_not_combined(flown, aircraft):
    other = copy.deepcopy(aircraft)
    other.instruments["imu"]["bias_sigma"]["p"] = 1e-3
    record = flown(0, duration=20.0)[0]
    sets = [flighttest.reconstruct(record, a) for a in (aircraft, other)]
    with pytest.raises(SchemaError, match=r"bias\.p: two runs started from different priors"):
        flighttest.reconstruction.combine_biases(sets)


@pytest.mark.nightly
def test_prior_of_other_runs_is_used(flown, aircraft):
    record, _, _ = flown(4, duration=20.0)
    alone = flighttest.reconstruct(record, aircraft)
    prior = flighttest.reconstruction.combine_biases(
        [flighttest.reconstruct(flown(4)[0], aircraft)]
    )
    after = flighttest.reconstruct(record, aircraft, prior=prior)
    k = "bias.theta"
    assert float(after.biases["stderr"].sel(parameter=k)) < float(
        alone.biases["stderr"].sel(parameter=k)
    )
    np.testing.assert_allclose(
        after.biases["prior"].sel(parameter=k), prior["estimate"].sel(parameter=k)
    )


def specified(aircraft, **factors):
    """The aircraft with another noise specification of its air data."""
    changed = copy.deepcopy(aircraft)
    for name, factor in factors.items():
        changed.instruments["air_data"]["noise"][name] *= factor
    return changed


@pytest.mark.nightly
@pytest.mark.parametrize("factor", [1.0 / 1.11, 1.0 / 1.4])
def test_a_noise_specification_too_small_is_no_turbulence(calm, flown, aircraft, factor):
    """The residual of q_c is larger than specified and white: the vane factors are estimated as
    before, and the noise is named.
    """
    path = flighttest.reconstruct(flown(0)[0], specified(aircraft, q_c=factor))
    assert path.states.attrs["gusts"] == "none"
    row, right = (found.biases.sel(parameter="factor.alpha_vane") for found in (path, calm[0]))
    assert abs(float(row["estimate"] - right["estimate"])) < 0.5 * float(right["stderr"])
    (remark,) = [one for one in path.remarks if one.term == "q_c"]
    assert remark.kind == "noise"
    assert remark.value == pytest.approx(
        1.0 / factor, rel=0.05
    )  # two thousand readings scatter by 1.6 %
    assert "noise of q_c is 1." in path.report()
    assert path.summary()["remarks"][0]["kind"] == "noise"
    assert calm[0].remarks == []


def test_gusts_are_distinguished_from_noise_by_what_lasts():
    """Two thousand readings at 50 a second: white noise of any size is none, a gust as large as
    half the noise is one.
    """
    t = 0.02 * np.arange(2000)
    for seed in range(20):
        rng = np.random.default_rng(seed)
        noise = rng.normal(size=2000)
        keep = np.exp(-0.02 / 1.5)
        gust = lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.normal(size=3000))[1000:]
        assert not any(has_gusts(size * noise, t, 0.4) for size in (1.0, 1.11, 1.5, 3.0))
        assert has_gusts(noise + 0.8 * gust / gust.std(), t, 0.4)


@pytest.mark.slow
def test_what_has_not_settled_is_named(flown, aircraft, monkeypatch):
    """A single iteration and no more: the constants that still move are reported with how far."""
    monkeypatch.setattr(smoother, "CALM_STEPS", 1)
    whole = smoother.estimate_trajectory
    monkeypatch.setattr(
        smoother,
        "estimate_trajectory",
        lambda problem, x, c, iterations=1, held=(), known=None: whole(problem, x, c, 1, held),
    )
    with pytest.raises(
        IdentificationError,
        match=r"did not settle in 2 iterations: still moving are \S+ by \S+ .*standard errors\)",
    ):
        flighttest.reconstruct(flown(0)[0], aircraft)


@pytest.mark.slow
def test_instruments_keep_their_latency_in_a_record_of_one_table(flown, aircraft):
    """A CSV has one clock for all channels: the same readings in one leaf give the same path as in
    a leaf per instrument.
    """
    record = flown(0, duration=8.0)[0]
    leaves = {name: record[name].to_dataset() for name in ("imu", "vanes", "air_data", "controls")}
    clock = leaves["imu"]["time"]
    leaves = {
        name: data.assign_coords(time=clock) for name, data in leaves.items()
    }  # equal but for rounding
    leaves["gps"] = (
        record["gps"].to_dataset().interp(time=clock, kwargs={"fill_value": "extrapolate"})
    )
    separate = xr.DataTree.from_dict({f"/{name}": data for name, data in leaves.items()})
    together = xr.DataTree.from_dict(
        {"/data": xr.merge(leaves.values(), join="exact", combine_attrs="override")}
    )
    paths = [
        flighttest.reconstruct(item, aircraft, windows=[(1.0, 7.0)])
        for item in (separate, together)
    ]
    for name in ("estimate", "stderr"):
        a, b = (path.biases[name] for path in paths)
        np.testing.assert_allclose(b.sel(parameter=a["parameter"]), a, rtol=1e-9, atol=1e-12)
    assert (
        float(paths[1].biases["stderr"].sel(parameter="delay.gps")) < 0.01
    )  # of a prior of 0.03 s

"""Batch reconstruction of simulated flights whose truth is known."""

import copy
import json

import numpy as np
import pytest

import flighttest
from flightmech.errors import AeromatchWarning, IdentificationError, SchemaError, UnknownName
from flighttest.reconstruction.batch import estimator, programme
from flighttest.remarks import is_forbidden

RIGID = 0.05  # noise of the inertial unit over that of the conftest: a navigation-grade one


@pytest.fixture(scope="module")
def precise(aircraft):
    craft = copy.deepcopy(aircraft)
    for name in ("p", "q", "r", "ax_imu", "ay_imu", "az_imu"):
        craft.instruments["imu"]["noise"][name] *= RIGID
    return craft


@pytest.fixture(scope="module")
def found(flown, precise):
    record, error, truth = flown(0, inertial_noise=RIGID)
    return flighttest.reconstruct_batch([record], precise), error, truth


def deviations(estimates, error, key="stderr"):
    names = [name for name in estimates["parameter"].values if name in error]
    chosen = estimates.sel(parameter=names)
    return (chosen["estimate"].values - [error[name] for name in names]) / chosen[key].values


def test_path_follows_the_truth(found):
    batch, _, truth = found
    states = batch.paths[0].states
    # standard errors of the constants times their leverage, as for the smoother
    for name, tol in {
        "V": 0.05,
        "alpha": 0.0006,
        "beta": 0.0006,
        "theta": 0.0004,
        "h": 0.6,
    }.items():
        assert np.sqrt(np.mean((states[name].values - truth[name].values) ** 2)) < tol, name


@pytest.mark.nightly
def test_constants_lie_within_their_standard_errors(flown, precise):
    z = []
    for seed in range(6):
        record, error, _ = flown(seed, duration=30.0, inertial_noise=RIGID)
        z.append(deviations(flighttest.reconstruct_batch([record], precise).estimates, error))
    # 114 deviations, correlated within a flight: the count scatters by 4 %
    assert (np.abs(z) < 2.0).mean() > 0.87
    assert 0.75 < np.sqrt(np.mean(np.square(z))) < 1.25


@pytest.mark.nightly
def test_noise_of_the_inertial_unit_is_in_the_standard_errors(flown, aircraft):
    z, bound = [], []
    for seed in range(5):
        record, error, _ = flown(seed, duration=30.0)
        estimates = flighttest.reconstruct_batch([record], aircraft).estimates
        z.append(deviations(estimates, error))
        bound.append(deviations(estimates, error, "stderr_white"))
    assert (np.abs(z) < 2.0).mean() > 0.87
    # the Cramer-Rao bound takes the gyros for perfect
    assert (np.abs(bound) < 2.0).mean() < 0.75


@pytest.mark.slow
def test_noise_of_the_channels_is_estimated(flown, precise):
    noisier = copy.deepcopy(precise)
    noisier.instruments["vanes"]["noise"]["alpha_vane"] *= 2.0
    record = flown(0, inertial_noise=RIGID)[0]
    noise = flighttest.reconstruct_batch([record], noisier).noise
    assert noise.loc["alpha_vane", "given"] == pytest.approx(3e-3)
    assert noise.loc["alpha_vane", "estimated"] == pytest.approx(
        1.5e-3, rel=0.05
    )  # 2001 readings scatter by 1.6 %


@pytest.mark.nightly
def test_records_share_their_constants(flown, precise):
    error = flown(0, duration=5.0)[1]
    records = [flown(seed, duration=20.0, inertial_noise=RIGID, error=error)[0] for seed in (1, 2)]
    both = flighttest.reconstruct_batch(records, precise, [[(0.0, 8.0), (9.0, 20.0)], None])
    alone = flighttest.reconstruct_batch(records[1:], precise)
    assert {"wind_n.1", "wind_n.2", "p_reference.2"} <= set(both.estimates["parameter"].values)
    assert both.starts.sizes["segment"] == 3
    assert (np.abs(deviations(both.estimates, error)) < 2.0).mean() > 0.8
    name = "bias.alpha_vane"
    assert float(both.estimates["stderr"].sel(parameter=name)) < float(
        alone.estimates["stderr"].sel(parameter=name)
    )
    biases = [path.biases["estimate"].sel(parameter=name) for path in both.paths]
    assert float(biases[0]) == float(biases[1])


def with_vanes(record, craft, **changes):
    """Return the record with its own table of the vanes, as a name map gives it."""
    vanes = {**craft.instruments["vanes"], **changes}
    made = record.copy()
    made.attrs = {**record.attrs, "instruments": json.dumps({"vanes": vanes})}
    return made


def test_two_priors_of_a_common_constant_are_an_error(flown, precise):
    records = [flown(seed, duration=10.0, inertial_noise=RIGID)[0] for seed in (1, 2)]
    records[1] = with_vanes(records[1], precise, lag=[0.2, 0.015])
    with pytest.raises(
        SchemaError,
        match=r"prior of lag.vanes: 0.05 with standard error 0.015 in record 1, 0.2 with 0.015 in "
        r"record 2; give both",
    ):
        flighttest.reconstruction.observable_constants(records, precise)


def test_instruments_of_every_record_are_its_own(flown, precise):
    """The vanes of the second record stand elsewhere; the order of the records has no effect."""
    records = [flown(seed, duration=10.0, inertial_noise=RIGID)[0] for seed in (1, 2)]
    records[1] = with_vanes(records[1], precise, position=[1.0, 0.0, 0.15])
    arms = []
    for run in (records, records[::-1]):
        equations = programme._start_equations(run, precise, None, None, None, 50.0)
        arms.append([s.problem.vane_arms[0, 0] for s in equations.layout.setups])
    assert arms[0] == arms[1][::-1]
    assert arms[0][0] - arms[0][1] == pytest.approx(3.3)


def test_steady_flight_hides_vertical_wind_behind_the_vane(flown, precise):
    record = flown(0, motion=0.0)[0]
    names = ["bias.alpha_vane", "wind_d"]
    sight = flighttest.reconstruction.observable_constants([record], precise, free=names)
    words = sight.hidden()
    assert len(words) == 1
    assert all(name in words[0] for name in names)
    row = sight.directions.isel(direction=0)
    move = dict(zip(row["parameter"].values, row["move"].values))
    # an offset of the vane makes up for air that sinks: K wind_d/V, V = 85 m/s, K = 1.08; V of the
    # first path is good to 3 %
    assert move["wind_d"] / move["bias.alpha_vane"] == pytest.approx(85.0 / 1.08, rel=0.03)
    with pytest.raises(IdentificationError, match=r"not seen apart: .*wind_d"):
        flighttest.reconstruct_batch([record], precise, free=names)


def test_a_manoeuvre_separates_them(flown, precise):
    record = flown(0, inertial_noise=RIGID)[0]
    assert (
        flighttest.reconstruction.observable_constants(
            [record], precise, free=["bias.alpha_vane", "wind_d"]
        ).hidden()
        == []
    )


@pytest.mark.slow
def test_held_constants_stay(flown, precise):
    error = {"lag.vanes": 0.05, "static_error": 0.0, "delay.air_data": 0.12, "delay.gps": 0.15}
    error |= {
        "factor.alpha_vane": 1.08,
        "factor.beta_vane": 1.05,
        "bias.alpha_vane": 0.01,
        "bias.q": 4e-4,
    }
    record, _, truth = flown(0, inertial_noise=RIGID, error=error)
    batch = flighttest.reconstruct_batch(
        [record], precise, free=["bias.alpha_vane", "bias.q", "wind_n", "wind_e"]
    )
    estimates = batch.estimates.sel(parameter=["bias.alpha_vane", "bias.q"])
    assert (np.abs(estimates["estimate"] - [0.01, 4e-4]) < 3.0 * estimates["stderr"]).all()
    assert float(batch.estimates["estimate"].sel(parameter="lag.vanes")) == 0.05
    assert ["lag.vanes", "0.05", "held", "s"] in [
        line.split() for line in batch.report().splitlines()
    ]
    assert np.std(batch.paths[0].states["alpha"].values - truth["alpha"].values) < 5e-4


def test_unknown_and_empty_names(flown, precise):
    record = flown(0, duration=10.0)[0]
    with pytest.raises(UnknownName, match=r"bias\.alfa"):
        flighttest.reconstruct_batch([record], precise, free=["bias.alfa"])
    with pytest.raises(SchemaError, match="no constant to estimate"):
        flighttest.reconstruct_batch([record], precise, free=[])
    with pytest.raises(SchemaError, match="1 sets of windows for 2 records"):
        flighttest.reconstruct_batch([record, record], precise, [None])


@pytest.mark.nightly
def test_wrong_sign_of_an_axis_is_reported(flown, precise):
    record = flown(0, duration=20.0)[0].copy(deep=True)
    record["imu/az_imu"].values[:] *= -1.0
    with pytest.raises(IdentificationError, match="batch fit"):
        flighttest.reconstruct_batch([record], precise)


@pytest.mark.slow
def test_noise_that_still_changes_in_the_last_round_is_an_error(found, flown, precise, monkeypatch):
    batch = found[0]
    assert batch.convergence.converged
    assert batch.remarks == []
    assert "iterations, converged" in batch.report()
    # With the vanes ten times as noisy as specified, one round of noise is not enough.
    noisier = copy.deepcopy(precise)
    for name in noisier.instruments["vanes"]["noise"]:
        noisier.instruments["vanes"]["noise"][name] /= 10.0
    record = flown(0, duration=10.0, inertial_noise=RIGID)[0]
    assert flighttest.reconstruct_batch([record], noisier).convergence.converged
    monkeypatch.setattr(estimator, "ROUNDS", 1)
    with pytest.warns(AeromatchWarning, match="noise of the channels: not converged after 1"):
        stopped = flighttest.reconstruct_batch([record], noisier)
    assert is_forbidden(stopped.remarks)
    assert stopped.remarks[0].value > 100.0
    assert "NOT converged" in stopped.report()
    assert "!! noise of the channels" in stopped.report()

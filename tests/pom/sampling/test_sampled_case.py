"""Draws of the aeroplane are flown in its place; the probability, its spread and its causes are
those of the errors put in.
"""

from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import aerodb
import flightmech
import pom
from flightmech.errors import SchemaError
from pom.archive.archive import Archive, read_archive, write_archive
from pom.cases.case import read_case
from pom.diagnosis.sampling.draws import DrawnModels, InstrumentErrors
from pom.diagnosis.sampling.sampled_bench import SampledBench, with_inertia
from pom.diagnosis.sampling.sampled_replay import replay_draws
from pom.diagnosis.sampling.shares import regressors_of_draws, variance_shares
from pom.judging.signals import traces_of
from pom.judging.verdict import judge_all
from pom.replaying.replay_case import plan_of
from pom.result import PomResult

NOTHING = {"mass": 0.0, "thrust": 0.0, "inertia": 0.0}
PULSE = {"delta_e": [(0.0, 0.0), (2.0, 0.0), (2.06, -0.06), (4.0, -0.06), (4.06, 0.0)]}


@pytest.fixture(scope="module")
def flight(trainer):
    return trainer.flight(trainer.database(), duration=9.5, **PULSE)


def uncertain(db, **stderr):
    """Return `db` with standard errors on some terms: ``uncertain(db, Cm_elevator=0.1)``."""
    leaves = aerodb.terms(db)
    new = {key.replace("_", "/", 1): size for key, size in stderr.items()}
    return aerodb.replace_terms(
        db,
        {
            n: leaves[n].assign(stderr=xr.full_like(leaves[n]["value"], size))
            for n, size in new.items()
        },
    )


def models(trainer, db, count, seed=0):
    model = flightmech.compile(trainer.AIRCRAFT, db)
    return DrawnModels(model, db, aerodb.update.draw(db, count, seed), seed, "test")


@pytest.fixture
def plan(write_case, flight):
    return plan_of(read_case(write_case()), flight)


@pytest.mark.nightly
def test_the_model_is_judged_against_the_flight_of_a_draw(plan, trainer, tmp_path):
    db = uncertain(trainer.database(), Cm_elevator=0.3, Cm_basic=0.01)
    drawn = models(trainer, db, 2)
    found = replay_draws(plan, drawn, errors=NOTHING)
    flown = {"final": flightmech.write_fmu(drawn.model, tmp_path / "final.fmu")}
    for k in range(2):
        one = aerodb.update.with_node_values(
            db, {name: values[k] for name, values in drawn.nodes.items()}
        )
        flown[f"{k}"] = flightmech.write_fmu(
            flightmech.compile(trainer.AIRCRAFT, one), tmp_path / f"{k}.fmu"
        )
    signals = pom.replay(plan.case, flown, plan.states).signals
    flight, model = traces_of(signals, "flight"), traces_of(signals, "final")
    for k in range(2):
        outcomes = judge_all(
            plan.case, plan.job.time, {**flight, **traces_of(signals, f"{k}")}, model
        )
        # the trainer's record has no noise but what a straight line through its third differences
        # leaves
        assert found.decides[k] == pytest.approx(
            max(one.worst_ratio for one in outcomes.values() if one.verdict in ("pass", "fail")),
            rel=1e-3,
        )


def test_errors_that_tables_and_record_share_take_each_other_back(plan, trainer):
    """All coefficients in error by what mass, inertia and thrust are: the same motion."""
    db = trainer.database()
    plan = replace(plan, job=with_inertia(plan.job, flightmech.compile(trainer.AIRCRAFT, db)))
    instruments = InstrumentErrors.of(
        plan.job, plan.states, None, {"mass": 0.02, "inertia": 0.02, "thrust": 0.02}
    )
    bench = SampledBench.of(plan, flightmech.compile(trainer.AIRCRAFT, db), instruments)
    draw = np.array(
        [float(name in ("mass", "inertia", "thrust1")) for name in bench.instruments.names]
    )
    heavier = aerodb.update.with_node_values(
        db, {name: 1.02 * leaf["value"].values for name, leaf in aerodb.terms(db).items()}
    )
    model = flightmech.compile(trainer.AIRCRAFT, heavier)
    together, apart = (
        bench.matched(model, z, np.random.default_rng(0)).decides for z in (draw, 0.0 * draw)
    )
    assert together < 0.01 * apart


@pytest.mark.nightly
def test_the_probability_is_that_of_the_error(plan, trainer):
    """A moment of the elevator in error by e gives a ratio of c |e|: within tolerance with the
    probability of |e| < 1/c.
    """
    db = uncertain(trainer.database(), Cm_elevator=1e-12)
    spoilt = {"Cm/elevator": 0.95 * aerodb.terms(db)["Cm/elevator"]["value"].values[None]}
    (one,) = replay_draws(
        plan,
        DrawnModels(flightmech.compile(trainer.AIRCRAFT, db), db, spoilt, 0, "test"),
        errors=NOTHING,
    ).decides
    c = one / (0.05 * 1.1)
    sigma = 1.0 / (1.3 * c)
    found = replay_draws(
        plan,
        models(trainer, uncertain(trainer.database(), Cm_elevator=sigma), 200, seed=4),
        errors=NOTHING,
    )
    wanted = 2.0 * NormalDist().cdf(1.3) - 1.0
    assert abs(found.probability - wanted) < 3.0 * found.stderr
    low, middle, high = found.spread()
    assert low < middle < 1.0 < high
    assert middle == pytest.approx(
        c * sigma * NormalDist().inv_cdf(0.75), rel=0.25
    )  # median of |e|


@pytest.mark.slow
def test_the_share_belongs_to_the_term_whose_error_it_is(plan, trainer):
    found = replay_draws(
        plan,
        models(
            trainer, uncertain(trainer.database(), Cm_elevator=0.05, Cm_qhat=0.3, Cl_phat=0.1), 60
        ),
    )
    for criterion in found.ratio:
        (first, share), *_ = found.dominant(criterion)
        assert first == "Cm/elevator"
        assert share > 0.9
        assert (
            0.97
            < found.shares.loc[found.shares["criterion"] == criterion, "share"].sum()
            < 1.0 + 1e-9
        )
        assert (
            not found.shares["source"].eq("Cl/phat").any()
            or abs(found.dominant(criterion, 99)[-1][1]) < 0.05
        )


@pytest.mark.slow
def test_draws_depend_on_the_seed_and_not_on_the_threads(plan, trainer):
    db = uncertain(trainer.database(), Cm_elevator=0.05)
    one, two = (replay_draws(plan, models(trainer, db, 6), jobs=jobs) for jobs in (1, 2))
    assert np.array_equal(one.decides, two.decides)
    assert one.fan.identical(two.fan)
    pd.testing.assert_frame_equal(one.shares, two.shares)
    other = replay_draws(plan, models(trainer, db, 6, seed=1))
    assert not np.array_equal(one.decides, other.decides)


@pytest.mark.slow
def test_the_fan_holds_the_model(plan, trainer):
    found = replay_draws(plan, models(trainer, uncertain(trainer.database(), Cm_elevator=0.05), 40))
    assert list(found.fan["quantile"].values) == [0.05, 0.25, 0.5, 0.75, 0.95]
    for name, quantiles in found.fan.items():
        assert (np.diff(quantiles.values, axis=0) >= 0.0).all()
        inside = (quantiles.values[0] <= plan.states[name].values + 1e-6) & (
            plan.states[name].values <= quantiles.values[-1] + 1e-6
        )
        assert inside.mean() > 0.9


def test_instruments_move_start_drive_and_flight_together(plan, trainer):
    time = plan.job.time
    shift = np.stack([np.full(time.size, 0.5), np.linspace(0.0, 1.0, time.size)])
    states = plan.states.assign({"error.V": (("error", "time"), shift)}).assign_coords(
        error=["bias.V", "wind_n of run"]
    )
    found = InstrumentErrors.of(plan.job, states, trainer.AIRCRAFT, {"mass": 0.01})
    draw = np.array(
        [
            2.0 if name in ("bias.V", "mass", "thrust1", "bias.delta_e") else 0.0
            for name in found.names
        ]
    )
    job = found.job(plan.job, draw)
    assert job.parameters["init.V"] == pytest.approx(plan.job.parameters["init.V"] + 1.0)
    assert job.parameters["mass.mass"] == pytest.approx(1.02 * plan.job.parameters["mass.mass"])
    assert np.allclose(
        job.inputs["engine1.thrust_drive"], 1.04 * plan.job.inputs["engine1.thrust_drive"]
    )
    assert np.ptp(job.inputs["delta_e"] - plan.job.inputs["delta_e"]) < 1e-12
    assert job.inputs["delta_e"][0] > plan.job.inputs["delta_e"][0]
    motion = {name: states[name].values for name in ("V", "delta_e", "engine1.thrust")}
    recorded = replace(found, noise={}).recorded(motion, draw, np.random.default_rng(0))
    assert np.allclose(recorded["V"], states["V"].values - 1.0)  # truth 1 m/s beyond the reading
    assert np.allclose(
        recorded["delta_e"],
        motion["delta_e"] - (job.inputs["delta_e"] - plan.job.inputs["delta_e"]),
    )
    assert np.allclose(recorded["engine1.thrust"], 0.96 * motion["engine1.thrust"])
    draws = found.draws(500, 3)
    assert np.array_equal(draws, found.draws(500, 3))
    assert np.abs(draws.mean(axis=0)).max() < 4.0 / np.sqrt(500)


def test_an_error_of_the_velocity_through_the_air_is_wind(plan, trainer):
    time = plan.job.time
    names = ("V", "alpha", "beta", "phi", "theta", "psi", "gamma", "p", "q", "r", "h")
    moved = {
        f"error.{name}": (("error", "time"), np.full((1, time.size), 0.3 if name == "V" else 0.0))
        for name in names
    }
    states = plan.states.assign(moved).assign_coords(error=["static_error"])
    job = replace(
        plan.job,
        inputs={
            **plan.job.inputs,
            **{name: np.zeros(time.size) for name in ("wind_n", "wind_e", "wind_d")},
        },
    )
    found = InstrumentErrors.of(job, states, None)
    draw = np.array([float(name == "static_error") for name in found.names])
    shifted = found.job(job, draw)
    wind = np.stack([shifted.inputs[name] for name in ("wind_n", "wind_e", "wind_d")])
    assert np.allclose(np.linalg.norm(wind, axis=0), 0.3, rtol=1e-3)
    theta, alpha, psi = (states[name].values for name in ("theta", "alpha", "psi"))
    assert np.allclose(
        wind[0], -0.3 * np.cos(theta - alpha) * np.cos(psi), atol=1e-3
    )  # wings level
    rolling = replace(
        job, parameters={**job.parameters, "mode.trim": 3.0}
    )  # its speed is that over the ground
    assert (
        InstrumentErrors.of(rolling, states, None).job(rolling, draw).parameters["init.V"]
        == rolling.parameters["init.V"]
    )


def test_noise_of_a_record_is_found_and_put_on_the_draws(plan, trainer):
    rng = np.random.default_rng(2)
    noisy = plan.states.assign(
        q=("time", plan.states["q"].values + 2e-3 * rng.standard_normal(plan.job.time.size))
    )
    found = InstrumentErrors.of(plan.job, noisy, None, compared={"q"})
    assert list(found.noise) == ["q"]
    assert found.noise["q"] == pytest.approx(2e-3, rel=0.15)
    still = np.zeros(plan.job.time.size)
    (values,) = found.recorded({"q": still}, np.zeros(len(found.names)), rng).values()
    assert np.std(values) == pytest.approx(found.noise["q"], rel=0.15)


def test_shares_of_errors_that_take_each_other_back_add_up():
    rng = np.random.default_rng(1)
    a = rng.standard_normal(400)
    b = -0.8 * a + 0.6 * rng.standard_normal(
        400
    )  # estimated together: their sum is known better than each
    changes = {"CL/basic": np.outer(a, [1.0, 1.0]), "CL/elevator": np.outer(b, [1.0, 1.0])}
    found = variance_shares({"row": a + b}, regressors_of_draws(changes, {}))
    assert found["share"].sum() == pytest.approx(1.0, abs=0.01)
    var = np.cov(a, b)
    wanted = (var[0, 0] + var[0, 1]) / (var.sum())
    assert found.set_index("source").loc["CL/basic", "share"] == pytest.approx(wanted, abs=0.02)


@pytest.mark.slow
def test_a_database_of_another_model_is_refused(trainer, tmp_path):
    db = uncertain(trainer.database(), Cm_elevator=0.05)
    fmu = flightmech.write_fmu(
        flightmech.compile(trainer.AIRCRAFT, trainer.scaled(db, Cm_elevator=0.9)),
        tmp_path / "final.fmu",
    )
    with pytest.raises(SchemaError, match="1 terms have other values than in"):
        DrawnModels.of(fmu, db, 3)
    with pytest.raises(SchemaError, match="no term has standard errors"):
        DrawnModels.of(fmu, trainer.database(), 3)


@pytest.mark.nightly
def test_samples_are_kept_with_the_result(plan, trainer, tmp_path):
    db = uncertain(trainer.database(), Cm_elevator=0.05, Cm_qhat=1.0)
    aerodb.save(db, tmp_path / "final.nc")
    fmu = flightmech.write_fmu(flightmech.compile(trainer.AIRCRAFT, db), tmp_path / "final.fmu")
    paths = {plan.case.record: plan.states}
    (result,) = pom.replay_sampled(
        # the command passes recordings of devices, too
        [plan.case],
        {"final": fmu},
        {"final": tmp_path / "final.nc"},
        8,
        2,
        paths,
        jobs=1,
        recorded={},
    )
    found = result.samples["final"]
    assert (found.count, found.seed) == (8, 2)
    assert found.database.startswith("final.nc, sha256 ")
    write_archive(tmp_path / "results.nc", Archive([result]), ["a"])
    for again in (
        read_archive(tmp_path / "results.nc").results[0],
        PomResult.from_json(result.to_json()),
    ):
        kept = again.samples["final"]
        assert kept.numbers() == found.numbers()
        assert np.array_equal(kept.decides, found.decides)
        for name in found.fan:
            assert np.allclose(kept.fan[name], found.fan[name], rtol=1e-8)

"""Rows of a proof of match as wanted quantities, low passes and landings, on the T-37."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import aerodb
import flightmech
from aerodb.edit.term_edits import replace_terms
from aerodb.update.expectation import Expectation
from aeromatch.project.project import read_project
from aeromatch.workflow.aerodynamics import a_priori
from flightmech.errors import IdentificationError
from flightmech.simulation.node_values import table_values, with_table_values
from flighttest.flight_programme.input_design.predicted_response import trimmed_start
from flighttest.flight_programme.planning.catalogue import PlannedManoeuvre, read_catalogue
from flighttest.flight_programme.planning.pilot import fly_manoeuvres
from flighttest.flight_programme.planning.predicted_record import predicted_record
from flighttest.flight_programme.planning.prediction import predict_manoeuvre
from pom.cli.group import pom
from pom.diagnosis.sampling.draws import InstrumentErrors
from pom.diagnosis.sampling.sampled_bench import SampledBench, with_inertia
from pom.programme.row_cases import plan_row
from pom.programme.row_gradients import differentiate_row

PROJECT = Path(__file__).parents[1] / "data" / "t37" / "aeromatch.toml"
pytestmark = pytest.mark.filterwarnings("ignore:flaps:flightmech.errors.AeromatchWarning")
CATALOGUE = """
title = "T-37, near the runway"
margin = 0.8
[limits]
alpha = ["-6 deg", "14 deg"]
nz = [0.0, 2.5]
[[condition]]
name = "approach"
setup = "60 s"
fixed = { V = "102 kt", h = "3000 ft", delta_f = "40 deg", gear = 1.0 }
[[condition]]
name = "glide path"
kind = "climb"
setup = "120 s"
fixed = { V = "97 kt", h_agl = "25 m", gamma = "-3 deg", delta_f = "40 deg", gear = 1.0 }
parameters = { "env.runway_elevation" = 0.0 }
[[manoeuvre]]
name = "3211 elevator"
kind = "multistep"
conditions = ["approach"]
[manoeuvre.axis.delta_e]
amplitude = "3 deg"
pattern = "3-2-1-1"
step = "0.6 s"
rise = "0.1 s"
free = "4 s"
[[manoeuvre]]
name = "landing"
kind = "landing"
conditions = ["glide path"]
height = 0.8
duration = "30 s"
[[fit]]
name = "pitch"
manoeuvres = ["3211 elevator"]
models = ["CL = 1 + alpha + qhat + delta_e"]
[[wanted_row]]
row = "2.c.10"
condition = "approach"
manoeuvre = "3211 elevator"
ratio = 0.5
[[wanted_row]]
row = "2.e.1"
condition = "glide path"
manoeuvre = "landing"
ratio = 0.5
"""
# Terms whose errors the tests keep; the others are taken as exact, which saves replays.
UNCERTAIN = ("Cm/basic", "Cm/qhat", "CL/basic", "CL/ground", "Cm/ground")


@pytest.fixture(scope="module")
def trainer(tmp_path_factory):
    """Aircraft, database with few uncertain terms, catalogue and model."""
    folder = tmp_path_factory.mktemp("rows")
    project = read_project(PROJECT)
    aircraft = flightmech.read_aircraft(project.aircraft)
    prior = a_priori(project, aircraft)
    changed = {}
    for name, leaf in aerodb.terms(prior).items():
        if name not in UNCERTAIN and "stderr" in leaf:
            changed[name] = leaf.drop_vars("stderr")
    prior = replace_terms(prior, changed)
    aerodb.save(prior, folder / "prior.nc")
    (folder / "catalogue.toml").write_text(CATALOGUE, encoding="utf-8")
    return aircraft, flightmech.compile(aircraft, prior), prior, folder


def start_of(sim, **more):
    kind = "climb" if "gamma" in more else "level"
    fixed = {"V": 50.0, "delta_f": np.radians(40.0), "gear": 1.0, **more}
    return trimmed_start(sim, {"env.runway_elevation": 0.0}, kind, fixed)


def low_pass(height):
    return PlannedManoeuvre(
        name="pass", kind="low_pass", amplitude=np.radians(1.0), duration=10.0, height=height
    )


@pytest.mark.nightly
def test_a_low_pass_holds_its_height(trainer):
    aircraft, sim, *_ = trainer
    flight = fly_manoeuvres(sim, start_of(sim, h_agl=20.0), [(low_pass(0.4), None)], aircraft.b)
    mark = flight.marks[0]
    inside = flight.motion.sel(time=slice(mark["start"], mark["end"]))
    heights = inside["h_agl"].values / aircraft.b
    assert abs(heights.mean() - 0.4) < 0.1
    assert np.ptp(heights) < 0.25
    record = predicted_record(flight, aircraft, "pass")
    radio = record["radio_altimeter"]["h_radio"].interp(time=flight.motion["time"])
    # the antenna is 0.55 m below the reference point and 0.6 m behind it
    assert abs(float((radio - flight.motion["h_agl"]).mean()) + 0.55) < 0.1
    assert record.attrs["runway_elevation"] == 0.0
    with pytest.raises(IdentificationError, match="a wheel touches the runway"):
        fly_manoeuvres(sim, start_of(sim, h_agl=20.0), [(low_pass(0.05), None)], aircraft.b)


@pytest.mark.nightly
def test_a_landing_flares_and_ends_at_the_contact(trainer):
    aircraft, sim, *_ = trainer
    landing = PlannedManoeuvre(name="landing", kind="landing", height=0.8, duration=30.0)
    start = start_of(sim, h_agl=30.0, gamma=np.radians(-3.0))
    flight = fly_manoeuvres(sim, start, [(landing, None)], aircraft.b)
    motion, end = flight.motion, flight.marks[0]["end"]
    assert float(motion["time"][-1]) == pytest.approx(end)
    assert float(motion["h_agl"][-1]) < 0.25 * aircraft.b
    assert -1.0 < float(motion["hdot"][-1]) < 0.1
    assert float(motion["hdot"][0]) < -2.5
    with pytest.raises(IdentificationError, match="starts near a runway"):
        fly_manoeuvres(sim, {**start, "init.h": 3000.0}, [(landing, None)], aircraft.b)


def ratios_of(wanted, trainer, tables):
    """The compared channels over their tolerance, (model, function), for models of given tables."""
    aircraft, sim, _, folder = trainer
    catalogue = read_catalogue(folder / "catalogue.toml")
    item = wanted.condition, wanted.manoeuvre
    plan, _ = plan_row(wanted, predict_manoeuvre(catalogue, sim, aircraft, item)[0])
    plan = type(plan)(plan.case, plan.states, with_inertia(plan.job, sim))
    bench = SampledBench.of(plan, sim, InstrumentErrors([], {}, {}, {}))
    rows = []
    for one in tables:
        run = bench.run(with_table_values(sim, one), np.zeros(0))
        rows.append({name: run.difference[channel] for name, channel in bench.traced.items()})
    widths = {name: bench.tolerance[channel].values for name, channel in bench.traced.items()}
    return plan.job.time, rows, widths


@pytest.mark.nightly
def test_the_spread_of_a_row_is_that_of_draws_of_the_tables(trainer):
    """With errors of a hundredth, where a replay is linear: 60 draws of two terms through the
    replay scatter as the gradients state, within the scatter of 60 draws (a tenth).
    """
    aircraft, sim, prior, folder = trainer
    catalogue = read_catalogue(folder / "catalogue.toml")
    wanted = catalogue.wanted_row[0]
    row = differentiate_row(wanted, catalogue, sim, aircraft, prior)
    small, chosen = {}, ("Cm/basic", "Cm/qhat")
    for name in chosen:
        leaf = aerodb.terms(prior)[name]
        small[name] = leaf.assign(stderr=0.01 * leaf["stderr"])
    database = replace_terms(prior, small)
    expectation, rng = Expectation(database), np.random.default_rng(1)
    values = table_values(sim, {name: small[name]["value"].shape for name in chosen})
    tables = [{name: values[name].copy() for name in chosen} for _ in range(61)]
    for name in chosen:
        nodes = np.arange(values[name].size)
        P = expectation._prior_of(name, np.zeros(len(nodes)), nodes=nodes)
        P = P / P[0, 0] * small[name]["stderr"].values.ravel()[0] ** 2
        for draw in tables[1:]:
            moved = rng.multivariate_normal(np.zeros(len(nodes)), P, method="svd")
            draw[name] += moved.reshape(values[name].shape)
    time, runs, widths = ratios_of(wanted, trainer, tables)
    gradients = {name: row.gradients[name] for name in chosen}
    expected = expectation.stderr_of([], gradients)
    compared = 0
    for k, function in row.functions.iterrows():
        if function["criterion"] not in widths or not expected[k] > 0.3 * expected.max():
            continue
        sample = int(np.argmin(np.abs(time - function["time"])))
        name = function["criterion"]
        drawn = np.array([run[name][sample] for run in runs[1:]]) / widths[name][sample]
        assert drawn.std() == pytest.approx(expected[k], rel=0.3), (name, function["time"])
        compared += 1
    assert compared > 5


@pytest.mark.nightly
def test_spread_names_the_terms_that_a_landing_rests_on(trainer):
    """The landing rests on the pitching moment of the runway; the short period does not."""
    *_, folder = trainer
    arguments = ["spread", str(folder / "catalogue.toml"), "--database", str(folder / "prior.nc")]
    arguments += ["--aircraft", str(read_project(PROJECT).aircraft)]
    arguments += ["-o", str(folder / "rows.nc"), "--json"]
    found = CliRunner().invoke(pom, arguments, catch_exceptions=False)
    assert found.exit_code == 0
    short_period, landing = json.loads(found.stdout)["rows"]
    assert next(iter(landing["rests_on"])) == "Cm/ground"
    assert not any("ground" in name for name in short_period["rests_on"])
    for row in (short_period, landing):
        assert sum(row["rests_on"].values()) == pytest.approx(1.0)
        assert row["width"] == row["widths"][row["criterion"]] > 1.0
    assert "nosewheel_touchdown" in landing["notes"][0]
    assert (folder / "rows.nc").is_file()

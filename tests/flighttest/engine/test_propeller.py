"""Propeller and engine from flight: flights with independent physics, separability, the kernel's
equations, files.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import propeller_flights as flights
import pytest
import xarray as xr
from click.testing import CliRunner

import flightmech
from aeromatch.cli.command import cli
from flightmech.aircraft import Engine, EngineDeck, PistonEngine, Propeller
from flightmech.aircraft.writing import write_aircraft
from flightmech.errors import AeromatchWarning, IdentificationError
from flightmech.simulation.kernel import Simulation
from flightmech.terms import SOURCES, make_term
from flighttest.reconstruction.dynamics.force_coefficients import coefficients
from flighttest.reconstruction.dynamics.propeller_loads import with_engine_channels
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress
from flighttest.remarks import Convergence
from flighttest.submodels.engine.propellers.engine_type import check_one_type
from flighttest.submodels.engine.propellers.equations import PropulsionEquations
from flighttest.submodels.engine.propellers.estimate import estimate_points
from flighttest.submodels.engine.propellers.identification import identify_propeller
from flighttest.submodels.engine.propellers.instruments import instrument_shares, remove_errors
from flighttest.submodels.engine.propellers.points import propeller_points
from flighttest.submodels.engine.propellers.result import PropellerFit
from flighttest.submodels.engine.propellers.shaft_dynamics import (
    ShaftDynamics,
    compile_shaft,
    identify_shaft,
)
from flighttest.submodels.engine.static_thrust import Polar

SEED = 2
LEGS = [
    flights.Leg(lever, V, 1200.0, seconds=30.0)
    for lever in (1.0, 0.6, 0.02)
    for V in (36.0, 45.0, 55.0)
]


@pytest.fixture(scope="module")
def flown():
    craft = flights.make_craft(SEED, False)
    rng = np.random.default_rng(SEED)
    records = []
    for number, leg in enumerate(LEGS):
        records.append(flights.fly(craft, leg, rng).assign_attrs(record=f"leg {number + 1}"))
    return craft, records


@pytest.fixture(scope="module")
def fit(flown):
    craft, records = flown
    prior = flights.prior_aircraft(craft, SEED)
    return identify_propeller(records, prior, Polar(*flights.prior_polar(craft, SEED)))


def test_coefficients_and_polar_come_back(flown, fit):
    craft, _ = flown
    assert fit.estimate.convergence.converged
    J = np.linspace(fit.equations.shapes["CT_prop"].low, fit.equations.shapes["CT_prop"].high, 4)
    truth = craft.blades.coefficients(J, craft.blades.design)
    for name, true in zip(("CT_prop", "CP_prop"), truth, strict=True):
        value, stderr = fit.coefficient(name, J)
        assert (np.abs(value - true) < 3.0 * stderr).all(), name
        # a priori 10 % of the level: the flight knows it better
        assert (stderr < 0.06 * np.abs(true).max()).all(), name
    assert abs(fit.polar.K - craft.K) < 3.0 * fit.polar.K_stderr < 0.25 * craft.K
    assert abs(fit.polar.CD0 - craft.CD0) < 3.0 * fit.polar.CD0_stderr


def test_report_prints_the_correlation_and_what_was_left_out(fit):
    text = fit.report()
    assert f"correlation of thrust and drag: {fit.separability.correlation:.3f}" in text
    assert fit.as_dict()["separability"]["correlation"] == fit.separability.correlation
    found = fit.separability
    # three powers: the points know more than the chart, both together more than either
    assert found.posterior_error < found.error < found.prior_error
    assert found.separable


@pytest.mark.slow
def test_one_power_is_called_not_separable_and_idle_is_requested(flown):
    craft, records = flown
    prior = flights.prior_aircraft(craft, SEED)
    fit = identify_propeller(records[:3], prior, Polar(*flights.prior_polar(craft, SEED)))
    assert fit.separability.correlation > 0.99
    assert fit.separability.error > fit.separability.prior_error
    assert not fit.separability.separable
    (text,) = [remark.text for remark in fit.remarks if remark.kind == "collinear"]
    assert "thrust and drag are not separable" in text
    assert "idle power" in text


@pytest.mark.nightly
def test_a_polar_that_is_held_is_stated(flown):
    craft, records = flown
    prior = flights.prior_aircraft(craft, SEED)
    fit = identify_propeller(records[::4], prior, Polar(craft.CD0, craft.K))
    assert fit.separability is None
    assert any("stand on the polar" in remark.text for remark in fit.remarks)


@pytest.mark.nightly
def test_command_writes_an_aircraft_with_sources(flown, tmp_path):
    craft, records = flown
    files = []
    for number in (0, 4, 8):
        files.append(str(tmp_path / f"leg{number}.nc"))
        records[number].to_netcdf(files[-1], engine="h5netcdf")
    prior, new = tmp_path / "prior.toml", tmp_path / "new.toml"
    write_aircraft(flights.prior_aircraft(craft, SEED), prior)
    command = ["flight", "engine", *files, "--aircraft", str(prior), "-o", str(new)]
    polar = ["--polar", "0.031", "0.058", "--polar-stderr", "0.003", "0.006", "--rate", "2"]
    result = CliRunner().invoke(cli, [*command, *polar], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert "correlation of thrust and drag" in result.output
    leaf = flightmech.read_aircraft(new).engines[0].propeller.tables["CT_prop"]
    inside = leaf["source"].values == SOURCES.index("flight")
    assert inside.any()
    assert not inside[0]  # J 0 was not flown
    assert (leaf["stderr"].values > 0.0).all()
    refused = CliRunner().invoke(cli, [*command, "--area", "16", "--engine", "1"])
    problems = refused.output + str(refused.exception)
    assert "--area belongs to a jet" in problems
    assert "--engine belongs to a jet" in problems
    assert "give --polar" in problems


@pytest.mark.parametrize(
    "polar", [Polar(-1.0, 0.06), Polar(0.03, -0.06), Polar(1e308, 0.06), Polar(0.03, 0.06, -0.01)]
)
def test_an_impossible_polar_is_refused(flown, polar):
    craft, records = flown
    with pytest.raises(IdentificationError, match="CD0 is between 0 and 1, K between 0 and 2"):
        identify_propeller(records, flights.prior_aircraft(craft, SEED), polar)


@pytest.mark.parametrize(
    ("factor", "text"),
    [
        (np.nan, "no window of .* has steady power .* with missing numbers"),
        (np.inf, "no window of .* has steady power .* with missing numbers"),
        (1e300, "has no number at .* check the units of the records"),
    ],
)
def test_a_propeller_speed_without_numbers_is_refused(flown, factor, text):
    """Three records of a channel that is missing, overflows or is in no unit."""
    craft, records = flown
    broken = [one.assign({"engine1.rpm": one["engine1.rpm"] * factor}) for one in records[:3]]
    broken.append(records[3].isel(time=slice(0)))
    with np.errstate(all="ignore"), pytest.raises(IdentificationError, match=text):
        identify_propeller(broken, flights.prior_aircraft(craft, SEED), Polar(0.03, 0.06, 0.01))


INHG_READ_AS_HPA = 100.0 / 3386.389


@pytest.mark.parametrize(
    ("channel", "factor", "diameter", "equation"),
    [
        ("manifold_pressure", INHG_READ_AS_HPA, 1.0, "shaft power"),
        pytest.param("rpm", 1.0 / 1.2, 1.0, "shaft power", marks=pytest.mark.nightly),
        pytest.param("rpm", 1.0, 1.0 / 0.3048, "force", marks=pytest.mark.nightly),
    ],
)
@pytest.mark.slow
def test_wrong_units_forbid_the_use(flown, channel, factor, diameter, equation):
    """The search converges with them; the noise is 100 times that of the right units."""
    craft, records = flown
    name = f"engine1.{channel}"
    wrong = [record.assign({name: factor * record[name]}) for record in records[::2]]
    prior = flights.prior_aircraft(craft, SEED)
    (engine,) = prior.engines
    blades = replace(engine.propeller, diameter=diameter * engine.propeller.diameter)
    prior = replace(prior, engines=(replace(engine, propeller=blades),))
    fit = identify_propeller(wrong, prior, Polar(*flights.prior_polar(craft, SEED)))
    assert fit.estimate.convergence.converged
    forbidden = {remark.term: remark for remark in fit.remarks if remark.severity == "error"}
    assert "check the units of rpm, manifold_pressure" in forbidden[equation].text
    np.testing.assert_array_equal(
        fit.tables()["CT_prop"]["value"], engine.propeller.tables["CT_prop"]["value"]
    )
    with pytest.warns(AeromatchWarning, match="the records do not belong to these tables"):
        fit.aircraft(prior)


def test_right_units_have_no_such_remark(fit):
    assert not [remark for remark in fit.remarks if remark.severity == "error"]
    assert not [remark for remark in fit.remarks if "a-priori standard errors" in remark.text]
    assert (fit.tables()["CT_prop"]["source"].values == SOURCES.index("flight")).any()


def test_values_far_from_the_prior_are_remarked(flown):
    craft, records = flown
    prior = flights.prior_aircraft(craft, SEED)
    polar = Polar(0.6 * craft.CD0, craft.K, 0.08 * craft.CD0, 0.1 * craft.K)
    fit = identify_propeller(records[::2], prior, polar)
    (remark,) = [remark for remark in fit.remarks if "a-priori standard errors" in remark.text]
    distance = (fit.value["CD0"] - polar.CD0) / polar.CD0_stderr
    assert remark.severity == "warning"
    assert f"CD0 {distance:+.1f}" in remark.text
    assert distance > 2.0
    assert remark.value == pytest.approx(distance)


def test_rotation_is_printed_with_the_roll_of_a_wrong_one(fit):
    craft = fit.equations.aircraft
    states = fit.equations.states(fit.value, fit.equations.measured(fit.value))
    at = states[0].at
    roll = states[0].shaft / at["rpm"] / (0.5 * at["rho"] * at["V"] ** 2 * craft.S * craft.b)
    assert f"2 Q / (qbar S b) = {2.0 * np.abs(roll).max():.2g}" in fit.report()
    assert "rotation +1 as in the aircraft file" in fit.report()


def test_lever_angles_are_used_and_engines_of_two_types_are_refused(flown):
    craft, records = flown
    prior = flights.prior_aircraft(craft, SEED)
    polar = Polar(*flights.prior_polar(craft, SEED))
    few = records[::4]
    idle, full = 0.1, 0.6
    angles = []
    for record in few:
        angle = idle + (full - idle) * record["engine1.throttle"]
        plain = record.drop_vars("engine1.throttle")
        angles.append(plain.assign({"engine1.pla": angle}))
    with pytest.raises(IdentificationError, match="angles of idle and full power as pla"):
        identify_propeller(angles, prior, polar)
    found = identify_propeller(angles, prior, polar, pla=(idle, full))
    lever = found.equations.columns["engine1.throttle"]
    np.testing.assert_allclose(np.unique(lever.round(6)), [0.02, 0.6, 1.0])
    (engine,) = prior.engines
    larger = replace(engine, propeller=replace(engine.propeller, diameter=3.0))
    other = replace(engine, propeller=replace(engine.propeller, rotation=-1))
    pair = replace(prior, engines=(engine, other))
    check_one_type(pair)
    with pytest.raises(IdentificationError, match=r"engine 2 differs .* propeller\.diameter"):
        check_one_type(replace(prior, engines=(engine, larger)))


def test_a_governed_propeller_needs_a_power():
    engine = engines()["governed piston"]
    craft = flightmech.Aircraft("one", 16.0, 1.5, 11.0, 1050.0, 1e3, 2e3, 3e3, engines=(engine,))
    time = np.arange(0.0, 6.0, 0.5)
    columns = {"V": 50.0, "h": 1000.0, "engine1.rpm": 230.0}
    record = xr.Dataset({k: ("time", x + 0.0 * time) for k, x in columns.items()}, {"time": time})
    with pytest.raises(IdentificationError, match="blade angle of a governed propeller"):
        identify_propeller([record], craft, Polar(0.03, 0.045))


def test_drag_of_a_feathered_propeller_comes_back():
    J, angles = np.array([0.0, 0.5, 1.0, 2.0, 6.0]), np.radians([12.0, 42.0, 85.0])
    grid = {"J": J, "blade_angle": angles}
    CT, CP = (
        a + b * angles[None, :] - c * J[:, None]
        for a, b, c in ((0.05, 0.18, 0.11), (0.01, 0.35, 0.08))
    )
    CT[:, 2], CP[:, 2] = -0.004 * J**2, -0.001 * J
    tables = {"CT_prop": make_term(CT, grid), "CP_prop": make_term(CP, grid)}
    tables["shaft_power"] = make_term([0.0, 300e3], {"throttle": [0.0, 1.0]})
    propeller = Propeller(
        tables, 2.4, 9.0, 190.0, low_pitch=angles[0], high_pitch=angles[1],
        feather_pitch=angles[2], feather_rate=0.3,
    )  # fmt: skip
    engine = Engine((0.0, 0.0, 0.0), propeller=propeller)
    craft = flightmech.Aircraft("one", 25.0, 2.0, 14.0, 4000.0, 1e4, 1e4, 1e4, engines=(engine,))
    V = np.tile(np.linspace(60.0, 100.0, 8), 3)
    kind = np.repeat([0, 1, 2], 8)  # full power, idle, feathered
    columns = {
        "V": V,
        "h": 0.0 * V + 1500.0,
        "mass": 0.0 * V + 4000.0,
        "lift_force": 0.0 * V + 9.8,
        "hdot": 0.0 * V,
        "run": kind.astype(float),
        "f": 0.0 * V,
        "engine1.rpm": np.where(kind == 2, 0.0, 190.0),
        "engine1.torque": np.where(kind == 0, 1500.0, 0.0),
        "engine1.feather": (kind == 2).astype(float),
    }
    points = xr.Dataset({name: ("point", x) for name, x in columns.items()})
    polar = Polar(0.03, 0.05, 0.0006, 0.001)
    truth = PropulsionEquations(points, craft, polar)
    u = truth.first()
    u[list(truth.unknowns).index("CT_prop feathered")] = 0.4
    u[list(truth.unknowns).index("CT_prop offset")] = 0.05
    noise = 0.002 * np.random.default_rng(4).standard_normal(len(V))
    flown = points.assign(f=("point", noise - truth.residuals(u)["force"]))
    equations = PropulsionEquations(flown, craft, polar)
    fit = PropellerFit(equations, estimate_points(equations), None)
    # profile drag of the blades is thrust, not drag of the aircraft
    assert abs(fit.polar.CD0 - polar.CD0) < 2.0 * fit.polar.CD0_stderr
    offset, error = fit.value["CT_prop offset"], fit._errors()["CT_prop offset"]
    assert abs(offset - 0.05) < 3.0 * error < 3.0 * 0.025
    estimate = fit.value["CT_prop feathered"]
    stderr = fit.estimate.covariance[list(fit.value).index("CT_prop feathered")].max() ** 0.5
    assert abs(estimate - 0.4) < 3.0 * stderr
    assert stderr < 0.3
    # drag area 2 D^2 0.004, times the factor
    area, error, count = fit.drag_of_propellers()["feathered"]
    assert count == 8
    assert abs(area - 1.4 * 2.0 * 2.4**2 * 0.004) < 3.0 * error
    # the made-up torque is not that of the tables, which forbids the use of the result
    ratio = fit._corrected_tables()["CT_prop"]["value"].values[1:, 2] / CT[1:, 2]
    np.testing.assert_allclose(ratio, 1.0 + estimate)


class _TwoEquations:
    """Two relative equations of one unknown whose means differ by twice 0.98 of their noise."""

    unknowns = {"scale": None}

    def first(self) -> np.ndarray:
        return np.array([0.3])

    def prior_errors(self) -> np.ndarray:
        return np.array([100.0])

    def runs(self) -> dict[str, np.ndarray]:
        return {name: np.arange(40) for name in ("shaft power", "fuel flow")}

    def residuals(self, u: np.ndarray) -> dict[str, np.ndarray]:
        noise = np.tile([-1.0, 1.0], 20)
        return {"shaft power": 0.98 + noise - u[0], "fuel flow": -0.98 + noise - u[0]}


def test_small_steps_do_not_end_the_search_before_the_solution():
    """By symmetry the solution is 0; after 40 steps 0.35 standard errors are left."""
    found = estimate_points(_TwoEquations())
    assert found.convergence.converged
    assert found.convergence.iterations > 80
    assert abs(found.value[0]) < 0.05 * found.covariance[0, 0] ** 0.5
    assert found.noise["shaft power"] == pytest.approx(found.noise["fuel flow"], rel=0.01)


def test_a_forbidden_result_changes_neither_tables_nor_constants(flown, fit):
    craft, _ = flown
    prior = flights.prior_aircraft(craft, SEED)
    values = {"inertia": (2.4, 0.1)}
    dynamics = ShaftDynamics(values, {"inertia": True}, SimpleNamespace(remarks=[]))
    good = replace(fit, dynamics=dynamics)
    assert good.aircraft(prior).engines[0].propeller.inertia == 2.4
    stopped = replace(fit.estimate, convergence=Convergence(False, 600, 3.0))
    with pytest.warns(AeromatchWarning, match="keeps all tables and constants: propulsion: not"):
        kept = replace(good, estimate=stopped).aircraft(prior)
    assert kept is prior


def test_engines_share_the_errors_of_equal_instruments():
    columns = {f"engine{k}.{name}": np.ones(2) for k in (1, 2) for name in ("engine_rpm", "torque")}
    shares = instrument_shares(columns, [1, 2], accelerometer=True)
    for name in ("rpm", "torque"):
        assert shares[name] + shares[f"engine1.{name}"] == pytest.approx(1.0)
    columns |= {"f": np.zeros(2), "lift_force": np.ones(2), "h": np.zeros(2)}
    value = {"error of torque": 0.01, "error of engine2.rpm": 0.1}
    right = remove_errors(columns, value, [1, 2], accelerometer=True)
    np.testing.assert_allclose(right["engine1.torque"], 1.01)
    np.testing.assert_allclose(right["engine2.torque"], 1.01)
    np.testing.assert_allclose(right["engine1.engine_rpm"], 1.0)
    np.testing.assert_allclose(right["engine2.engine_rpm"], 1.1)
    assert instrument_shares(columns, [1], accelerometer=True)["engine1.torque"] == 1.0


# ---- the equations of the kernel --------------------------------------------------------------


def engines() -> dict[str, Engine]:
    """One engine of each kind."""
    J, angles = np.linspace(0.0, 3.0, 13), np.radians([12.0, 22.0, 32.0, 42.0])
    grid = {"J": J, "blade_angle": angles}
    CT = 0.05 + 0.18 * angles[None, :] - 0.11 * J[:, None]
    CP = 0.01 + 0.35 * angles[None, :] - 0.08 * J[:, None]
    fixed = {"CT_prop": make_term(CT[:, 1], {"J": J}), "CP_prop": make_term(CP[:, 1], {"J": J})}
    turning = {"CT_prop": make_term(CT, grid), "CP_prop": make_term(CP, grid)}
    lever, n1 = [0.0, 1.0], [0.5, 1.0]
    power = make_term([[60e3, 70e3], [300e3, 360e3]], {"n1": n1, "engine_rpm": [120.0, 220.0]})
    turbine = turning | {"corrected_shaft_power": power, "shaft_bsfc": make_term(9e-8)}
    deck = EngineDeck(
        {
            "n1_command": make_term(n1, {"throttle": lever}),
            "n1_up_time": make_term(1.0),
            "thrust": make_term(0.0),
        }
    )
    stops = {"low_pitch": angles[0], "high_pitch": angles[-1], "rpm_low": 150.0}
    chart = make_term(
        [[9e3, 14e3], [90e3, 140e3]],
        {"manifold_pressure": [20e3, 105e3], "engine_rpm": [100.0, 300.0]},
    )
    fuel = PistonEngine(
        {
            "fuel_work": make_term([1.0e7, 1.3e7], {"fuel_air_ratio": [0.05, 0.1]}),
            "friction_pressure": make_term([5e4, 1.5e5], {"engine_rpm": [0.0, 320.0]}),
        },
        displacement=6e-3,
        intake_impedance=2e-4,
        throttle_impedance=0.02,
        pumping=0.8,
        enrichment=1.0,
    )
    charted = PistonEngine(
        {"corrected_power": chart, "bsfc": make_term(8e-8), "friction_power": make_term(1.5e3)},
        intake_impedance=2e-4,
        throttle_impedance=0.02,
    )
    origin = (0.0, 0.0, 0.0)
    light = {"diameter": 1.9, "inertia": 2.0, "rpm_high": 280.0}
    heavy = {"diameter": 2.4, "inertia": 9.0, "rpm_high": 190.0, **stops}
    return {
        "chart": Engine(origin, propeller=Propeller(fixed, **light), piston=charted),
        "fuel": Engine(origin, propeller=Propeller(fixed, **light), piston=fuel),
        "governed piston": Engine(
            origin, propeller=Propeller(turning, **{**light, **stops}), piston=charted
        ),
        "turboprop": Engine(origin, propeller=Propeller(turbine, **heavy), deck=deck),
    }


@pytest.mark.nightly
@pytest.mark.parametrize("kind", list(engines()))
def test_channels_are_those_of_the_kernel_at_rest_of_the_shaft(kind):
    engine = engines()[kind]
    sim = compile_shaft(engine)
    run = Simulation(sim.model)
    values = {
        "init.V": 55.0,
        "init.h": 1500.0,
        "mode.earth": 0.0,
        "mode.engine": 0.0,
        "env.delta_T": 8.0,
    }
    for name, value in values.items():
        run.set_parameter(sim.parameters.index(name), value)
    u = np.array([row.value for row in sim.entries(0)])
    u[sim.inputs.index("engine1.throttle")] = 0.7
    run.set_inputs(u)
    run.initialize()
    y = dict(zip(sim.outputs, run.outputs(), strict=True))
    names = ("V", "h", "alpha", "temperature", "p_static")
    wanted = [f"engine1.{name}" for name in ("rpm", "manifold_pressure", "n1")]
    columns = {name: y[name] for name in (*names, *wanted) if name in y}
    states = xr.Dataset({k: ("time", [x, x]) for k, x in columns.items()}, {"time": [0.0, 1.0]})
    craft = flightmech.Aircraft("one", 1.0, 1.0, 1.0, 1e3, 1e3, 1e3, 1e3, engines=(engine,))
    found = with_engine_channels(states, craft)
    for name in ("thrust", "torque", "J", "CT_prop", "CP_prop", "shaft_power", "blade_angle"):
        if f"engine1.{name}" in found:
            expected = y[f"engine1.{name}"]
            assert float(found[f"engine1.{name}"][0]) == pytest.approx(expected, rel=2e-6), name


# ---- regression on the effects of power -------------------------------------------------------


@pytest.mark.nightly
def test_regressors_of_power_need_no_channel_of_thrust():
    rng = np.random.default_rng(5)
    size = {"p": 0.1, "q": 0.1, "r": 0.1, "p_dot": 0.3, "q_dot": 0.3, "r_dot": 0.3, "ax": 1.0}
    size |= {"ay": 1.0, "az": 2.0, "beta": 0.03, "alpha_dot": 0.1, "beta_dot": 0.1}
    count = 80
    columns = {name: s * rng.standard_normal(count) for name, s in size.items()}
    columns["V"] = 50.0 + 4.0 * rng.standard_normal(count)
    columns["alpha"] = 0.06 + 0.03 * rng.standard_normal(count)
    columns["h"] = np.full(count, 900.0)
    columns["qbar"] = 0.5 * 1.12 * columns["V"] ** 2
    columns["engine1.rpm"] = 230.0 + 25.0 * rng.standard_normal(count)
    states = xr.Dataset(
        {name: ("time", x) for name, x in columns.items()}, {"time": np.arange(count) * 0.02}
    )
    engine = engines()["chart"]

    def craft(rotation: int) -> flightmech.Aircraft:
        blades = replace(engine.propeller, rotation=rotation, inertia=1e-9)
        turned = replace(engine, propeller=blades)
        return flightmech.Aircraft("one", 16.0, 1.5, 11.0, 1050.0, 1e3, 2e3, 3e3, engines=(turned,))

    data = coefficients(states, craft(1))
    q_S = columns["qbar"] * 16.0
    np.testing.assert_allclose(data["CT"], data["engine1.thrust"] / q_S)
    n = columns["engine1.rpm"] / (2.0 * np.pi)
    al, be = columns["alpha"], columns["beta"]
    # the hub is at the c.g.: rotation does not move it
    J = columns["V"] * np.cos(al) * np.cos(be) / (n * 1.9)
    np.testing.assert_allclose(data["engine1.J"], J)
    CT = np.interp(
        J, engine.propeller.tables["CT_prop"]["J"], engine.propeller.tables["CT_prop"]["value"]
    )
    rho = 2.0 * columns["qbar"] / columns["V"] ** 2
    np.testing.assert_allclose(data["engine1.thrust"], CT * rho * n**2 * 1.9**4)
    # a right-handed propeller rolls the airframe to the left, so the air rolls it to the right
    other = coefficients(states, craft(-1))
    Q = data["engine1.torque"].values
    np.testing.assert_allclose(data["Cl"] - other["Cl"], 2.0 * Q / (q_S * 11.0), atol=1e-9)
    for regressor in ("CT", "engine1.CT_prop", "engine1.J"):
        made = 0.02 - 0.6 * data["alpha"] + 0.15 * data[regressor]
        model = RegressionModel.parse(f"Cm = 1 + alpha + {regressor}")
        found = regress(model, data.assign(Cm=made))
        slope = found.estimates["estimate"].sel(term=regressor)
        assert float(slope) == pytest.approx(0.15, rel=1e-6)


def test_points_of_a_crankshaft_tachometer_are_those_of_the_shaft():
    """Speed and its rate, so that the power that spins up the rotor is the same."""
    engine = engines()["chart"]
    geared = replace(engine, propeller=replace(engine.propeller, gear_ratio=2.43))
    craft = flightmech.Aircraft("one", 16.0, 1.5, 11.0, 1050.0, 1e3, 2e3, 3e3, engines=(geared,))
    time = np.arange(0.0, 6.0, 0.1)
    columns = {"V": 50.0 + time, "h": 1000.0 + 0.0 * time}
    columns["engine1.manifold_pressure"] = 8e4 + 0.0 * time
    powers = []
    for name, factor in (("rpm", 1.0), ("engine_rpm", 2.43)):
        own = columns | {f"engine1.{name}": factor * (230.0 + 1.4 * time)}
        record = xr.Dataset({key: ("time", x) for key, x in own.items()}, {"time": time})
        points = propeller_points([record], craft)
        np.testing.assert_allclose(points["engine1.rpm_dot"], 1.4)
        equations = PropulsionEquations(points, craft, Polar(0.03, 0.05, 0.003, 0.005))
        (state,) = equations.uncorrected_states({}, equations.measured({}))
        powers.append(float(state.shaft[0]))
    assert powers[1] == pytest.approx(powers[0], rel=1e-12)


# ---- power changes ----------------------------------------------------------------------------


def test_shaft_and_manifold_come_back_from_a_slam_and_a_chop():
    craft = flights.make_craft(3, False)
    prior = flights.prior_aircraft(craft, 3)
    truth = {"inertia": 2.6, "map_time": 0.45, "throttle_impedance": 0.014}
    record = flights.fly_power_change(craft, truth, np.random.default_rng(3))
    engine = prior.engines[0]
    pressure, rpm = np.linspace(15e3, 105e3, 10), np.linspace(100.0, 330.0, 12)
    chart = craft.piston_power(pressure[:, None], rpm[None, :], 288.15, 101325.0)
    power = make_term(chart, {"manifold_pressure": pressure, "engine_rpm": rpm})
    engine = replace(
        engine,
        propeller=replace(engine.propeller, tables=flights.truth_tables(craft)),
        piston=replace(engine.piston, tables={"corrected_power": power}),
    )
    found = identify_shaft([record], replace(prior, engines=(engine,)))
    assert not found.remarks
    for name, true in truth.items():
        value, stderr = found.values[name]
        assert found.determined[name]
        assert abs(value - true) < max(3.0 * stderr, 0.02 * true), name


def test_a_constant_at_its_bound_is_not_called_a_priori():
    """The estimate is 0.05 of the inertia of the file; the file keeps its own."""
    search = SimpleNamespace(remarks=[])
    values = {"inertia": (0.48, 0.0), "pitch_rate": (0.3, 0.15)}
    shown = dict.fromkeys(values, False)
    dynamics = ShaftDynamics(values, shown, search, {"inertia": 9.6, "pitch_rate": 0.3})
    assert dynamics.note_of("inertia") == "   at its bound and not used: 9.6 of the file stays"
    assert dynamics.note_of("pitch_rate") == "   as a priori"
    assert not dynamics.constants()

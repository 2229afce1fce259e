"""Engine from simulated records of an integration of our own: spools, static thrust, start, deck
file, command.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner
from scipy.interpolate import PchipInterpolator

import flightmech
from flightmech.air import atmosphere
from flightmech.aircraft.propulsion.engine_deck import EngineDeck, open_tables, write_tables
from flightmech.errors import IdentificationError, UnknownName
from flightmech.terms import make_term
from flighttest.cli.submodels import engine_command
from flighttest.submodels.engine.bench import (
    as_nodes,
    compile_engine,
    record_condition,
    simulation_inputs,
)
from flighttest.submodels.engine.records import engine_channels
from flighttest.submodels.engine.result import identify_engine
from flighttest.submodels.engine.schedule import remove_lever_noise, rest_positions, schedule_nodes
from flighttest.submodels.engine.spools import identify_spools
from flighttest.submodels.engine.starting import identify_start
from flighttest.submodels.engine.static_thrust import Polar, correct_deck
from flighttest.submodels.engine.steady_points import temperature_pressure_ratios

DELAY, RATIO, LAG, NOISE = 0.2, 1.3, 0.15, 5e-4
SCHEDULE = PchipInterpolator([0.0, 0.3, 0.7, 1.0], [0.5, 0.68, 0.88, 0.98])
TIME = PchipInterpolator([0.45, 0.65, 0.85, 1.05], [2.0, 1.1, 0.5, 0.4])
FAN = PchipInterpolator([0.45, 0.65, 0.85, 1.05], [0.2, 0.42, 0.75, 1.15])
PROFILES = {
    "chop": ((0.0, 0.9), (2.0, 0.9), (2.4, 0.0)),
    "slam": ((0.0, 0.0), (2.0, 0.0), (2.4, 0.95)),
    "steps": ((0.0, 0.35), (2.0, 0.35), (2.3, 0.6), (10.0, 0.6), (10.3, 0.4)),
}
PRIOR = make_term(
    1e3 * np.outer([0.9, 4.0, 8.0, 10.0, 11.0], [1.0, 0.9, 0.8]),
    {"corrected_n1": [0.3, 0.7, 0.9, 1.0, 1.1], "mach": [0.0, 0.3, 0.6]},
)
FACTORS = np.array([1.0, 1.0, 1.02, 1.06, 1.07])
POLAR = Polar(0.024, 0.05)
S, ENGINES = 25.0, 2


def power_change(name: str, seed: int, noise: float = NOISE) -> xr.Dataset:
    """Integrate the spools with Heun's rule at 2 ms; sampled at 25 Hz."""
    rng = np.random.default_rng(seed)
    step, every = 0.002, 20
    t = np.arange(0.0, 18.0, step)
    profile = np.array(PROFILES[name])
    command = SCHEDULE(np.interp(t - DELAY, *profile.T))
    grid = np.linspace(0.4, 1.1, 1401)
    tau, fan = TIME(grid), FAN(grid)

    def rates(n2: float, n1: float, c: float) -> tuple[float, float]:
        time = np.interp(n2, grid, tau) * (1.0 if c > n2 else RATIO)
        return (c - n2) / time, (np.interp(n2, grid, fan) - n1) / LAG

    n2, n1 = float(command[0]), float(FAN(command[0]))
    rows = []
    for k in range(len(t)):
        rows.append((n1, n2))
        a = rates(n2, n1, command[k])
        b = rates(n2 + step * a[0], n1 + step * a[1], command[min(k + 1, len(t) - 1)])
        n2, n1 = n2 + 0.5 * step * (a[0] + b[0]), n1 + 0.5 * step * (a[1] + b[1])
    n1s, n2s = np.array(rows)[::every].T
    noisy = [
        x + noise * rng.normal(size=len(n1s)) for x in (np.interp(t[::every], *profile.T), n1s, n2s)
    ]
    flown = {"mach": np.full(len(n1s), 0.3), "h": np.full(len(n1s), 1500.0)}
    columns = dict(zip(("throttle", "n1", "n2"), noisy)) | flown
    return xr.Dataset(
        {key: ("time", x) for key, x in columns.items()}, {"time": t[::every]}, {"record": name}
    )


@pytest.fixture(scope="module")
def changes() -> list[xr.Dataset]:
    return [power_change(name, seed) for seed, name in enumerate(PROFILES)]


@pytest.fixture(scope="module")
def spools(changes):
    return identify_spools(changes)


def within(found: tuple[float, float], truth: float, errors: float = 4.0) -> bool:
    """Whether an estimate is within so many standard errors: four, since some thirty of them are
    looked at.
    """
    return abs(found[0] - truth) < errors * found[1]


@pytest.mark.nightly  # 3 s
def test_delay_ratio_and_lag(spools):
    for name, truth, size in (
        ("lever_delay", DELAY, 2e-3),
        ("ratio", RATIO, 0.02),
        ("n1_up_time", LAG, 2e-3),
    ):
        value, stderr = spools.constants[name]
        assert within((value, stderr), truth), name
        assert 0.0 < stderr < size
    assert abs(spools.constants["ratio_slope"][0]) < 4.0 * spools.constants["ratio_slope"][1]


@pytest.mark.slow
def test_tables_over_lever_and_speed(spools):
    for n2 in (0.55, 0.65, 0.75, 0.85):
        value, stderr = spools.tables["n2_up_time"].at(n2)
        assert value == pytest.approx(float(TIME(n2)), rel=0.05)
        assert stderr < 0.05 * value
        assert spools.tables["n1_command"].at(n2)[0] == pytest.approx(float(FAN(n2)), abs=2e-3)
    for lever in (0.0, 0.35, 0.4, 0.6, 0.9):  # where it rested
        assert within(spools.tables["n2_command"].at(lever), float(SCHEDULE(lever)), 5.0)
    with pytest.raises(IdentificationError, match="outside"):
        spools.tables["n2_command"].at(1.4)


@pytest.mark.nightly
@pytest.mark.slow
def test_same_estimates_from_perturbed_records(changes, spools):
    moved = [one.assign(n2=one["n2"] * (1.0 + 1e-12)) for one in changes]
    again = identify_spools(moved)
    for name, (value, stderr) in spools.constants.items():
        assert again.constants[name][0] == pytest.approx(
            value, abs=1e-2 * stderr
        )  # the search ends within that


def test_positions_of_rest_ignore_the_ramps(changes):
    np.testing.assert_allclose(rest_positions(changes), [0.0, 0.35, 0.4, 0.6, 0.9, 0.95], atol=2e-3)
    assert np.diff(schedule_nodes(changes)).max() < 0.21


def test_lever_without_its_noise_keeps_the_ramp(changes):
    clean = np.interp(changes[0]["time"], *np.array(PROFILES["chop"]).T)
    before, after = (
        np.sqrt(np.mean((one["throttle"].values - clean) ** 2))
        for one in (changes[0], remove_lever_noise(changes[0]))
    )
    assert after < 0.75 * before


def test_lever_that_moves_from_the_start_is_refused(changes):
    with pytest.raises(IdentificationError, match="begin at rest"):
        identify_spools([changes[0].isel(time=slice(52, None))])
    with pytest.raises(IdentificationError, match="never moves up"):
        identify_spools([changes[0]])


def points(count: int, seed: int, noise: float = 0.003) -> xr.Dataset:
    rng = np.random.default_rng(seed)
    n1, mach, h = (
        np.tile([0.72, 0.8, 0.9, 1.0], count)[:count],
        0.2 + 0.25 * rng.random(count),
        rng.choice([1500.0, 4500.0], count),
    )
    theta, delta = temperature_pressure_ratios({"mach": mach, "h": h})
    nominal = PRIOR.assign(value=PRIOR["value"] * xr.DataArray(FACTORS, dims="corrected_n1"))
    at = {"corrected_n1": xr.DataArray(n1 / np.sqrt(theta)), "mach": xr.DataArray(mach)}
    thrust = delta * nominal["value"].interp(at).values * (1.0 + noise * rng.normal(size=count))
    return xr.Dataset(
        {k: ("point", v) for k, v in {"n1": n1, "mach": mach, "h": h, "thrust": thrust}.items()}
    )


def climbs(count: int, seed: int) -> xr.Dataset:
    found = points(count, seed)
    air = atmosphere(found["h"].values)
    V = found["mach"].values * np.asarray(air.a_sound)
    q, mass = 0.5 * np.asarray(air.rho) * V**2, 4500.0
    CL = mass * 9.80665 / q / S
    excess = ENGINES * found["thrust"].values - q * S * (POLAR.CD0 + POLAR.K * CL**2)
    level = np.arange(count) % 3 == 0
    columns = {
        "V": V,
        "mass": np.full(count, mass),
        "V_dot": level * excess / mass,
        "h_dot": ~level * excess * V / mass / 9.80665,
        "CL": CL,
    }
    return found.drop_vars("thrust").assign({name: ("point", x) for name, x in columns.items()})


@pytest.mark.parametrize("what", ["recorded", "equilibrium", "both"])
def test_deck_is_corrected_by_recorded_thrust_and_by_equilibrium(what):
    given = {} if what == "equilibrium" else {"recorded": points(60, 1)}
    given |= (
        {}
        if what == "recorded"
        else {"equilibrium": climbs(60, 2), "polar": POLAR, "S": S, "engines": ENGINES}
    )
    found = correct_deck(PRIOR, **given)
    for speed, factor, stderr, known in zip(
        found.speeds, found.factor, found.stderr, found.determined
    ):
        truth = FACTORS[np.argmin(np.abs(found.speeds - speed))]
        assert (
            abs(factor - truth) < 4.0 * stderr if known else factor == pytest.approx(1.0, abs=0.1)
        )
    assert found.determined.tolist() == [False, True, True, True, True]
    # a breakpoint without points is not from flight: 2 is judgement, 1 is flight
    assert found.leaf["source"].values.tolist() == [[2] * 3, *[[1] * 3] * 4]
    assert found.leaf["value"].sel(corrected_n1=1.0, mach=0.3) == pytest.approx(
        9000.0 * found.factor[3]
    )
    assert found.ratio(1.0, 0.3) == pytest.approx((found.factor[3], found.stderr[3]))
    assert any("error of the drag" in text for text in found.remarks) == (what != "recorded")


def test_drag_and_thrust_are_not_separable_at_one_power_setting():
    """A thrust that is a part short, and a drag that is short by as much, fly the same at one speed
    and power.
    """
    one = climbs(60, 3).isel(point=slice(1, None, 4))
    one = one.isel(point=(one["h"] == 1500.0).values)
    vague = Polar(0.024, 0.05, 0.004, 0.01)
    found = correct_deck(PRIOR, equilibrium=one, polar=vague, S=S, engines=ENGINES)
    assert any("not separable" in text and "two power settings" in text for text in found.remarks)
    with_thrust = correct_deck(PRIOR, points(60, 1), climbs(60, 2), vague, S, ENGINES)
    assert not any("not separable" in text for text in with_thrust.remarks)
    assert abs(with_thrust.polar.CD0 - POLAR.CD0) < 4.0 * with_thrust.polar.CD0_stderr < 0.004


def test_points_outside_the_deck_are_left_out_and_counted():
    far = points(20, 1)
    far["n1"][0] = 2.0
    assert "1 of 20 points lie outside" in correct_deck(PRIOR, far).report()
    with pytest.raises(IdentificationError, match="no point inside"):
        correct_deck(PRIOR, far.isel(point=[0]))
    with pytest.raises(IdentificationError, match="need the polar"):
        correct_deck(PRIOR, equilibrium=climbs(10, 1))


def start_record() -> xr.Dataset:
    """A start and shut-down of the kernel's own engine, with noise."""
    t = np.arange(0.0, 45.0, 0.05)
    switches = {
        "starter": (t > 2.0) & (t < 25.0),
        "cutoff": (t < 10.0) | (t > 28.0),
        "throttle": np.zeros(len(t)),
    }
    record = xr.Dataset(
        {name: ("time", np.asarray(x, float)) for name, x in switches.items()}, {"time": t}
    )
    at = {"n2": [0.2, 0.35, 0.5]}
    tables = {
        "n2_command": make_term(0.5),
        "n2_up_time": make_term([5.0, 4.0, 3.0], at),
        "thrust": make_term(0.0),
    }
    tables |= {
        "fuel_flow": make_term([0.03, 0.04, 0.05], at),
        "itt": make_term([600.0, 1000.0, 850.0], at),
    }
    constants = {
        "starter_speed": 0.23,
        "starter_time": 3.0,
        "n2_rundown": 6.0,
        "flame_time": 0.3,
        "itt_time": 0.8,
    }
    held, wind = record_condition(record)
    outputs = [f"engine1.{name}" for name in ("n2", "fuel_flow", "itt")]
    flown = flightmech.simulate(
        compile_engine(EngineDeck(tables, **constants)),
        simulation_inputs(record, wind),
        held,
        outputs=outputs,
    )
    rng = np.random.default_rng(5)
    sizes = {"n2": 5e-4, "fuel_flow": 1e-4, "itt": 3.0}
    return record.assign(
        {
            name: ("time", flown[f"engine1.{name}"].values + s * rng.normal(size=len(t)))
            for name, s in sizes.items()
        }
    )


@pytest.fixture(scope="module")
def started():
    return identify_start([start_record()])


@pytest.mark.slow
def test_start_and_shut_down(started):
    truth = {
        "starter_speed": 0.23,
        "starter_time": 3.0,
        "n2_rundown": 6.0,
        "flame_time": 0.3,
        "itt_time": 0.8,
        "idle": 0.5,
    }
    for name, value in truth.items():
        assert within(started.constants[name], value, 5.0), name
    assert started.light_speed == pytest.approx(0.23 * (1.0 - np.exp(-8.0 / 3.0)), abs=2e-3)
    for n2, tau, flow, itt in ((0.35, 4.0, 0.04, 1000.0), (0.45, 10.0 / 3.0, 0.14 / 3.0, 900.0)):
        assert started.tables["n2_up_time"].at(n2)[0] == pytest.approx(tau, rel=0.05)
        assert started.tables["fuel_flow"].at(n2)[0] == pytest.approx(flow, rel=0.02)
        assert started.tables["itt"].at(n2)[0] == pytest.approx(itt, rel=0.05)


def test_no_light_off_is_refused():
    record = start_record()
    with pytest.raises(IdentificationError, match="no light-off"):
        identify_start([record.assign(cutoff=0.0 * record["cutoff"])])


@pytest.mark.nightly
def test_deck_file_flies(spools, started, changes, tmp_path, monkeypatch):
    """What is written is read back, starts, and follows the chop within the noise."""
    monkeypatch.setattr(
        "flighttest.submodels.engine.result.identify_spools", lambda *records, **given: spools
    )
    monkeypatch.setattr(
        "flighttest.submodels.engine.result.identify_start", lambda records: started
    )
    found = identify_engine(
        changes, [start_record()], points(60, 1), prior={"corrected_thrust": PRIOR}
    )
    entry = found.write(tmp_path / "engine.nc", (0.0, 1.0))
    (
        tmp_path / "aircraft.toml"
    ).write_text(f"""name = "t"\n[geometry]\nS = 20.0\ncbar = 1.5\nb = 10.0
[mass]\nmass = 1e9\nIxx = 1e9\nIyy = 1e9\nIzz = 1e9\n[[engine]]\nposition = [0.0, 0.0, 0.0]\n{entry}""")
    tables = open_tables(tmp_path / "engine.nc")
    assert "standard error" in entry
    assert {
        "n2_command",
        "n2_up_time",
        "n2_down_time",
        "n1_command",
        "corrected_thrust",
        "itt",
    } <= set(tables)
    assert (
        tables["n2_up_time"]["value"].sel(n2=0.22, method="nearest") > 3.0
    ).all()  # below idle: from the start
    deck = found.deck()
    chop = changes[0]
    held, wind = record_condition(chop)
    flown = flightmech.simulate(
        compile_engine(deck),
        simulation_inputs(chop, wind),
        held,
        outputs=["engine1.n2", "engine1.thrust"],
    )
    assert np.sqrt(np.mean((flown["engine1.n2"].values - chop["n2"].values) ** 2)) < 2.0 * NOISE
    assert flown["engine1.thrust"].values[0] > 4.0 * flown["engine1.thrust"].values[-1] > 0.0


def test_engine_needs_records_and_a_deck_for_points():
    with pytest.raises(IdentificationError, match="no records"):
        identify_engine()
    with pytest.raises(IdentificationError, match="a-priori deck"):
        identify_engine(recorded=points(10, 1))


def test_channels_of_an_engine():
    t = np.arange(3.0)
    columns = {
        "engine1.pla": [0.0, 0.5, 1.0],
        "engine2.pla": [0.0, 0.5, 1.0],
        "engine1.n2": [0.5, 0.6, 0.7],
        "engine2.n2": [0.7, 0.8, 0.9],
    }
    columns |= {"V": [100.0] * 3, "temperature": [288.15] * 3, "h_gps": [10.0] * 3}
    states = xr.Dataset({name: ("time", x) for name, x in columns.items()}, {"time": t})
    found = engine_channels(states, (1, 2), (0.0, 2.0))
    np.testing.assert_allclose(found["throttle"], [0.0, 0.25, 0.5])
    np.testing.assert_allclose(found["n2"], [0.6, 0.7, 0.8])
    np.testing.assert_allclose(found["mach"], 100.0 / 340.294, rtol=1e-5)
    with pytest.raises(IdentificationError, match="idle and full"):
        engine_channels(states)
    with pytest.raises(UnknownName, match=r"engine2\.n2"):
        engine_channels(states.drop_vars("engine2.n2"), (1, 2), (0.0, 1.0))


@pytest.mark.slow
def test_command(tmp_path):
    table = points(40, 1).to_dataframe()
    table.to_csv(tmp_path / "points.csv", index=False)
    write_tables(
        {"corrected_thrust": PRIOR, "n2_command": make_term(0.9), "n2_up_time": make_term(1.0)},
        tmp_path / "prior.nc",
    )
    args = [
        "--points",
        f"{tmp_path}/points.csv",
        "--prior",
        f"{tmp_path}/prior.nc",
        "-o",
        f"{tmp_path}/deck.nc",
    ]
    run = CliRunner().invoke(engine_command, args)
    assert run.exit_code == 0, run.output
    assert "recorded thrust: 40 points" in run.output
    assert "[engine.deck]" in run.output
    thrust = open_tables(tmp_path / "deck.nc")["corrected_thrust"]
    assert float(thrust["value"].sel(corrected_n1=1.0, mach=0.0)) == pytest.approx(
        10600.0, rel=0.01
    )
    shown = CliRunner().invoke(engine_command, [*args[:4], "--json"])
    assert json.loads(shown.output)["correction"]["factor"][3] == pytest.approx(1.06, rel=0.01)


def test_nodes_have_the_names_of_the_kernel():
    assert as_nodes("n2_up_time", np.array([1.0, 2.0])) == {
        "node.engine1.n2_up_time[0]": 1.0,
        "node.engine1.n2_up_time[1]": 2.0,
    }

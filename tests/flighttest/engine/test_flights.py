"""Engine from whole flights: power changes cut out, rate limits, schedule over the flight
condition, steady tables, windmilling.
"""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.air import atmosphere
from flightmech.aircraft.propulsion.engine_deck import EngineDeck, open_tables, write_tables
from flightmech.errors import IdentificationError, SchemaError, UnknownName
from flightmech.terms import evaluate_term, make_term
from flighttest.submodels.engine.bench import (
    compile_engine,
    fly_deck,
    record_condition,
    simulation_inputs,
)
from flighttest.submodels.engine.records import engine_channels, power_changes
from flighttest.submodels.engine.result import comparison_text, identify_engine
from flighttest.submodels.engine.schedule import EDGE, cover_settled_range
from flighttest.submodels.engine.spools import identify_spools
from flighttest.submodels.engine.starting import identify_start
from flighttest.submodels.engine.steady_points import temperature_pressure_ratios
from flighttest.submodels.engine.steady_tables import steady_table
from flighttest.submodels.engine.tables import EngineStructure, read_structure

NOISE = 5e-4
AT = {"n2": [0.6, 0.8, 1.0], "h": [0.0, 6000.0]}
UP = np.array([[0.04, 0.032], [0.10, 0.07], [0.12, 0.09]])
DOWN = np.array([[0.12, 0.10], [0.28, 0.21], [0.36, 0.27]])
CHOP_AND_SLAM = ((0.0, 0.8), (3.0, 0.8), (3.3, 0.0), (13.0, 0.0), (13.3, 1.0))


def limited() -> EngineDeck:
    """An engine whose spools run at limited rates that fall with height; idle rises with Mach
    number and height.
    """
    level = np.zeros((2, 2, 2))
    level[0], level[1] = 0.6, 1.0
    level[0, 1] += 0.03  # at Mach 0.5
    level[0, :, 1] += 0.02  # at 6 km
    tables = {
        "n2_command": make_term(level, {"throttle": [0.0, 1.0], "mach": [0.0, 0.5], "h": AT["h"]}),
        "n2_up_time": make_term(0.15),
        "n2_up_limit": make_term(UP, AT),
        "n2_down_limit": make_term(DOWN, AT),
        "n1_command": make_term([0.3, 1.0], {"throttle": [0.0, 1.0]}),
        "n1_up_time": make_term(0.15),
        "n1_up_limit": make_term(0.8 * UP, AT),
        "n1_down_limit": make_term(0.5 * DOWN, AT),
        "corrected_thrust": make_term(
            [[200.0, 100.0], [1300.0, 1200.0], [4600.0, 4400.0]],
            {"corrected_n2": [0.55, 0.8, 1.1], "mach": [0.0, 0.5]},
        ),
    }
    return EngineDeck(tables, lever_delay=0.1)


def flown(
    deck: EngineDeck,
    profile,
    mach: float,
    h: float,
    seed: int,
    seconds: float = 24.0,
    rate: float = 10.0,
) -> xr.Dataset:
    """A record of the kernel's own engine, with noise."""
    t = np.arange(0.0, seconds, 1.0 / rate)
    columns = {
        "throttle": np.interp(t, *np.array(profile).T),
        "mach": np.full(len(t), mach),
        "h": np.full(len(t), h),
    }
    record = xr.Dataset(
        {name: ("time", x) for name, x in columns.items()}, {"time": t}, {"record": f"r{seed}"}
    )
    held, wind = record_condition(record)
    names = ("n1", "n2", "thrust")
    found = flightmech.simulate(
        compile_engine(deck),
        simulation_inputs(record, wind),
        held,
        outputs=[f"engine1.{name}" for name in names],
        step=0.02,
    )
    rng = np.random.default_rng(seed)
    sizes = {"n1": NOISE, "n2": NOISE, "thrust": 5.0}
    return record.assign(
        {
            name: ("time", found[f"engine1.{name}"].values + sizes[name] * rng.normal(size=len(t)))
            for name in names
        }
    )


def test_outer_knots_hold_the_speeds_at_rest():
    noisy = 0.5998 + 1e-3 * np.random.default_rng(0).normal(size=400)
    settled = np.append(noisy, 0.95)  # one sample is no rest
    assert cover_settled_range(np.array([0.6, 0.8, 1.0]), settled) == pytest.approx(
        [0.5925, 0.8, 1.0], abs=5e-4
    )
    assert cover_settled_range(np.array([0.59, 0.8]), settled) == pytest.approx([0.59, 0.8])
    assert cover_settled_range(np.array([0.5, 0.59]), settled)[1] > settled[:-1].mean() + EDGE
    assert cover_settled_range(np.array([0.6, 0.8]), np.array([np.nan])) == pytest.approx(
        [0.6, 0.8]
    )


@pytest.fixture(scope="module")
def flights() -> list[xr.Dataset]:
    conditions = [(0.1, 0.0), (0.4, 200.0), (0.2, 6000.0), (0.5, 5800.0)]
    return [
        flown(limited(), CHOP_AND_SLAM, mach, h, seed) for seed, (mach, h) in enumerate(conditions)
    ]


@pytest.fixture(scope="module")
def fit(flights):
    over = {"mach": (0.0, 0.5), "h": (0.0, 6000.0)}
    tables = {"corrected_thrust": {"corrected_n2": np.linspace(0.55, 1.1, 12), "mach": (0.0, 0.5)}}
    structure = EngineStructure(
        throttle=[0.0, 0.8, 1.0],
        n2=[0.6, 0.8, 1.0],
        over=over,
        limits=True,
        fan="lever",
        tables=tables,
    )
    return identify_engine(flights=flights, structure=structure)


def test_condition_of_a_record_is_flown():
    """Mach number by the wind, height by a straight line."""
    t = np.arange(0.0, 40.0, 0.1)
    columns = {
        "throttle": 0.0 * t + 0.5,
        "mach": 0.3 + 0.1 * np.sin(t / 10.0),
        "h": 1500.0 + 20.0 * t,
    }
    record = xr.Dataset({name: ("time", x) for name, x in columns.items()}, {"time": t})
    record["temperature"] = (
        "time",
        np.asarray(atmosphere(record["h"].values, delta_T=7.0).temperature),
    )
    held, wind = record_condition(record)
    found = flightmech.simulate(
        compile_engine(limited()),
        simulation_inputs(record, wind),
        held,
        outputs=["mach", "h", "temperature"],
    )
    for name, error in (("mach", 1e-6), ("h", 1e-6), ("temperature", 1e-6)):
        np.testing.assert_allclose(found[name], record[name], atol=error)


def test_power_changes_run_from_rest_to_rest(flights):
    begin, end = ([float(one["time"][k]) for one in power_changes(flights[0])] for k in (0, -1))
    assert begin[0] == pytest.approx(2.0, abs=0.3)  # a second before the lever moves
    assert len(begin) in (
        1,
        2,
    )  # the lever rests at idle for as long as the spool runs down, or longer
    assert (
        18.0 < end[-1] < 24.0
    )  # after the spools have settled at full power, where the record ends
    late = flights[0].isel(time=slice(31, None))  # moves from its first sample
    first = power_changes(late)[0]
    assert float(first["time"][0]) == pytest.approx(float(late["time"][0]) - 1.0, abs=0.2)
    assert np.ptp(first["throttle"].values[:8]) == 0.0
    assert power_changes(flights[0], least=1.5) == []
    # a clock of seconds of the week keeps the second
    of_week = flights[0].assign_coords(time=flights[0]["time"] + 345600.0)
    assert " from 34560" in power_changes(of_week)[0].attrs["record"]
    with pytest.raises(IdentificationError, match="lacks n2"):
        power_changes(flights[0].drop_vars("n2"))


@pytest.mark.nightly
@pytest.mark.slow
def test_limits_over_speed_and_height(fit):
    spools = fit.spools
    for name, truth in (
        ("n2_up_limit", UP),
        ("n2_down_limit", DOWN),
        ("n1_up_limit", 0.8 * UP),
        ("n1_down_limit", 0.5 * DOWN),
    ):
        for (i, n2), (j, h) in ((a, b) for a in enumerate(AT["n2"]) for b in enumerate(AT["h"])):
            value, stderr = spools.tables[name].at(n2, mach=0.25, h=h)
            assert value == pytest.approx(truth[i, j], rel=0.15), (name, n2, h)
            assert stderr < 0.15 * value
        middle, error = spools.tables[name].at(0.8, mach=0.25, h=0.0)
        assert middle == pytest.approx(truth[1, 0], rel=0.03)
        assert error < 0.03 * middle


@pytest.mark.nightly
@pytest.mark.slow
def test_schedule_over_mach_number_and_height(fit):
    command = fit.spools.tables["n2_command"]
    for mach, h, change in (
        (0.1, 0.0, 0.006),
        (0.4, 200.0, 0.024667),
        (0.2, 6000.0, 0.032),
        (0.5, 5800.0, 0.049333),
    ):
        value, stderr = command.at(0.0, mach=mach, h=h)
        assert value == pytest.approx(0.6 + change, abs=1e-3)
        assert stderr < 1e-3
    with pytest.raises(IdentificationError, match="depends on mach"):
        command.at(0.0, h=0.0)
    changes = fit.spools.changes
    assert changes["n2_command from mach 0 to 0.5 at throttle 0"][0] == pytest.approx(
        0.03, abs=2e-3
    )
    assert abs(changes["n2_command from mach 0 to 0.5 at throttle 1"][0]) < 2e-3
    assert "no change beyond its error" in fit.spools.report()


@pytest.mark.nightly
def test_delay_and_time_constant_with_limits(fit):
    value, stderr = fit.spools.constants["lever_delay"]
    time, _ = fit.spools.tables["n2_up_time"].at(0.8)
    assert value + time == pytest.approx(0.25, abs=0.02)  # close to the schedule they act alike
    assert stderr < 0.02


@pytest.mark.nightly
def test_responses_are_those_of_the_model(fit):
    for one in fit.spools.responses:
        for name in ("n1", "n2"):
            assert float((one[f"{name}_model"] - one[name]).std()) < 2.0 * NOISE


@pytest.mark.nightly
def test_deck_from_flights_flies(fit, flights, tmp_path):
    against = fit.compare(flights)
    assert float(against["n2"].max()) < 2.0 * NOISE
    assert float(against["n1"].max()) < 2.0 * NOISE
    assert float(against["thrust"].max()) < 15.0  # noise 5 N
    assert "all records" in comparison_text(against)
    entry = fit.write(tmp_path / "engine.nc")
    assert "lever_delay" in entry
    assert "standard error" in entry
    with xr.open_dataset(tmp_path / "engine.nc", engine="h5netcdf") as file:
        assert file.attrs["references"] == "r0 r1 r2 r3"
    assert {"n2_up_limit", "n1_down_limit", "corrected_thrust"} <= set(fit.deck().tables)
    assert set(fit.as_dict()["steady"]) == {"corrected_thrust"}


@pytest.mark.slow
def test_residual_shows_that_limits_are_missing(flights):
    plain = identify_spools(
        [one.drop_vars("n1") for one in power_changes(flights[0])], [0.0, 0.8, 1.0], [0.6, 1.0]
    )
    assert any(
        "times the noise of the readings" in text and "limits" in text for text in plain.remarks
    )


def test_flown_deck_is_the_simulation(flights):
    """Sample by sample as the record, against one simulation in a steady condition."""
    record = flights[1]
    held, wind = record_condition(record)
    deck = limited()
    found = flightmech.simulate(
        compile_engine(deck),
        simulation_inputs(record, wind),
        held,
        outputs=["engine1.n2", "engine1.thrust"],
        step=0.01,
    )
    again = fly_deck(deck, record)
    np.testing.assert_allclose(again["n2"], found["engine1.n2"], atol=2e-6)
    np.testing.assert_allclose(again["thrust"], found["engine1.thrust"], atol=0.05)
    with pytest.raises(IdentificationError, match="lever"):
        fly_deck(deck, record.drop_vars("throttle"))


def surface(n: np.ndarray, mach: np.ndarray, h: np.ndarray) -> np.ndarray:
    return 4600.0 * n**3 - 900.0 * mach * (1.1 - n) - 0.03 * h * n


def points(seed: int, heights: tuple[float, ...], count: int = 3000) -> list[xr.Dataset]:
    """Wandering speed and Mach number at a few heights, with noise of 15 N."""
    rng = np.random.default_rng(seed)
    found = []
    for h in heights:
        t = 0.1 * np.arange(count)
        mach = 0.25 + 0.2 * np.sin(t / 40.0 + rng.uniform(0, 6))
        n2 = 0.8 + 0.2 * np.sin(t / 9.0 + rng.uniform(0, 6))
        theta, delta = temperature_pressure_ratios({"mach": mach, "h": np.full(count, h)})
        thrust = delta * surface(n2 / np.sqrt(theta), mach, h) + 15.0 * rng.normal(size=count)
        columns = {"n2": n2, "mach": mach, "h": np.full(count, h), "thrust": thrust}
        found.append(
            xr.Dataset(
                {name: ("time", x) for name, x in columns.items()},
                {"time": t},
                {"record": f"h {h:g}"},
            )
        )
    return found


GRID = {
    "corrected_n2": np.linspace(0.6, 1.1, 8),
    "mach": [0.05, 0.25, 0.45],
    "h": [0.0, 1500.0, 3800.0, 6000.0],
}
PRIOR = make_term(
    4000.0 * np.linspace(0.6, 1.1, 4) ** 3, {"corrected_n2": np.linspace(0.6, 1.1, 4)}
)


@pytest.mark.slow
def test_steady_table_continues_what_was_not_flown():
    found = steady_table(points(1, (0.0, 1500.0, 6000.0)), "corrected_thrust", GRID, PRIOR)
    at = {"corrected_n2": np.array([0.75, 0.9, 1.0]), "mach": np.full(3, 0.25)}
    for h, error in ((1500.0, 30.0), (3800.0, 40.0)):  # noise 15 N; 3800 m was not flown
        value = evaluate_term(found.leaf, at | {"h": np.full(3, h)}, outside="clamp")
        np.testing.assert_allclose(value, surface(at["corrected_n2"], at["mach"], h), atol=error)
    flown_, between = (
        float(found.leaf["stderr"].sel(h=h, mach=0.25).isel(corrected_n2=4))
        for h in (1500.0, 3800.0)
    )
    assert 0.0 < flown_ < between < 0.1 * 6000.0
    assert "smooth over" in found.report("corrected_thrust")
    wide = steady_table(points(1, (0.0, 1500.0)), "corrected_thrust", GRID, PRIOR, scale=0.02)
    np.testing.assert_array_less(
        0.0199 * np.abs(wide.leaf["value"].values), wide.leaf["stderr"].values + 1e-9
    )


@pytest.mark.slow
def test_steady_table_same_from_perturbed_records():
    records = points(2, (0.0, 1500.0))
    one = steady_table(records, "corrected_thrust", GRID, PRIOR)
    two = steady_table(
        [r.assign(thrust=r["thrust"] * (1.0 + 1e-12)) for r in records],
        "corrected_thrust",
        GRID,
        PRIOR,
    )
    np.testing.assert_allclose(two.leaf["value"], one.leaf["value"], atol=1e-5)


def test_steady_table_names_what_is_missing():
    records = points(3, (0.0,), 200)
    with pytest.raises(UnknownName, match="itt"):
        steady_table(records, "itt", {"n2": [0.6, 1.0]})
    with pytest.raises(UnknownName, match="axis"):
        steady_table(records, "corrected_thrust", {"alpha": [0.0, 1.0]})
    with pytest.raises(UnknownName, match="table of an engine deck"):
        steady_table(records, "drag", {"n2": [0.6, 1.0]})
    with pytest.raises(IdentificationError, match="no sample inside"):
        steady_table(records, "thrust", {"h": [8000.0, 9000.0]})
    with pytest.raises(IdentificationError, match="whole flights"):
        identify_engine(
            recorded=xr.Dataset(),
            prior={"corrected_thrust": PRIOR},
            structure=EngineStructure(tables={"thrust": {"n2": [0.6, 1.0]}}),
        )


def test_schedule_from_settled_flight():
    """Speeds over the lever and the condition, from the samples at rest."""
    records = [
        flown(limited(), CHOP_AND_SLAM, mach, h, 7, 40.0)
        for mach, h in ((0.1, 0.0), (0.45, 6000.0))
    ]
    found = steady_table(records, "n2_command", {"throttle": [0.0, 0.8, 1.0], "h": [0.0, 6000.0]})
    settled = found.leaf["value"].sel(throttle=1.0).values
    np.testing.assert_allclose(settled, 1.0, atol=2e-3)
    assert found.samples < sum(one.sizes["time"] for one in records) / 2


def test_height_of_the_record():
    """A pressure altitude becomes the height at which the warm air has its pressure."""
    t = np.arange(100.0)
    warm = atmosphere(6000.0, delta_T=10.0)
    columns = {
        "engine1.throttle": 0.0 * t,
        "engine1.n2": 0.0 * t + 0.6,
        "mach": 0.0 * t + 0.4,
        "h_gps": 0.0 * t + 6000.0,
    }
    columns["h_baro"] = 0.0 * t + float(flightmech.air.pressure_altitude(float(warm.p_static)))
    columns["temperature"] = 0.0 * t + float(warm.temperature)
    states = xr.Dataset({name: ("time", x) for name, x in columns.items()}, {"time": t})
    for height in (None, "h_gps"):
        found = engine_channels(states, height=height)
        np.testing.assert_allclose(found["h"], 6000.0, atol=1.0)
        np.testing.assert_allclose(
            found["pressure_ratio"], float(warm.p_static) / 101325.0, rtol=1e-6
        )
    with pytest.raises(UnknownName, match="h_radar"):
        engine_channels(states, height="h_radar")


def test_height_of_a_pressure_altitude_is_geometric():
    """11000 m of geopotential height in standard air are 11019 m of geometric height."""
    t = np.arange(5.0)
    standard = atmosphere(11019.07)
    columns = {"h_baro": 11000.0, "mach": 0.7, "temperature": float(standard.temperature)}
    states = xr.Dataset({name: ("time", x + 0.0 * t) for name, x in columns.items()}, {"time": t})
    found = engine_channels(states)
    np.testing.assert_allclose(found["h"], 11019.07, atol=0.1)
    np.testing.assert_allclose(found["pressure_ratio"], 22632.06 / 101325.0, rtol=1e-5)


def windmilling() -> xr.Dataset:
    """In flight: windmilling, start with the starter, idle, and out again."""
    t = np.arange(0.0, 60.0, 0.05)
    switches = {
        "starter": (t > 6.0) & (t < 28.0),
        "cutoff": (t < 14.0) | (t > 36.0),
        "throttle": np.zeros(len(t)),
    }
    record = xr.Dataset(
        {name: ("time", np.asarray(x, float)) for name, x in switches.items()}, {"time": t}
    )
    record = record.assign(mach=("time", np.full(len(t), 0.4)), h=("time", np.full(len(t), 3000.0)))
    tables = {
        "n2_command": make_term(0.5),
        "n2_up_time": make_term([5.0, 3.0], {"n2": [0.2, 0.5]}),
        "thrust": make_term(0.0),
    }
    tables["corrected_n2_windmill"] = make_term(0.12)
    held, wind = record_condition(record)
    deck = EngineDeck(tables, starter_speed=0.24, starter_time=2.5, n2_rundown=5.0, flame_time=0.3)
    found = flightmech.simulate(
        compile_engine(deck),
        simulation_inputs(record, wind),
        held,
        outputs=["engine1.n2"],
        step=0.02,
    )
    noise = 5e-4 * np.random.default_rng(3).normal(size=len(t))
    return record.assign(n2=("time", found["engine1.n2"].values + noise))


@pytest.mark.slow
def test_windmilling_speed_and_start_in_flight():
    found = identify_start([windmilling()])
    truth = {
        "corrected_n2_windmill": 0.12,
        "starter_speed": 0.24,
        "starter_time": 2.5,
        "n2_rundown": 5.0,
        "idle": 0.5,
    }
    for name, value in truth.items():
        estimate, stderr = found.constants[name]
        assert abs(estimate - value) < 5.0 * stderr, name  # five of them are looked at
        assert stderr < 0.02 * value
    joined = found.joined({})
    assert float(joined["corrected_n2_windmill"]["value"]) == pytest.approx(0.12, abs=1e-3)


def test_structure_file(tmp_path):
    path = tmp_path / "engine.toml"
    path.write_text(
        'limits = true\nfan = "lever"\nover = { h = ["0 ft", "10000 ft"] '
        "}\n[tables.fuel_flow]\nn2 = [0.6, 1.0]\n"
    )
    found = read_structure(path)
    assert found.limits
    assert found.fan == "lever"
    assert found.over == {"h": (0.0, pytest.approx(3048.0))}
    assert found.tables == {"fuel_flow": {"n2": (0.6, 1.0)}}
    assert found.height is None
    path.write_text('limit = true\nover = { h = [0.0] }\nfan = "n3"\n')
    with pytest.raises(SchemaError) as error:
        read_structure(path)
    assert len(error.value.problems) == 3


@pytest.mark.nightly
def test_command_with_whole_flights(tmp_path):
    """Records that were used and one that was not stand in the comparison; the entry names the
    file.
    """
    from click.testing import CliRunner

    from flighttest.cli.submodels import engine_command

    names = tmp_path / "names.toml"
    units = {
        "engine1.throttle": "1",
        "engine1.n1": "1",
        "engine1.n2": "1",
        "engine1.thrust": "N",
        "mach": "1",
        "h": "m",
    }
    rows = (
        f'{name} = {{ column = "{name.removeprefix("engine1.")}", unit = "{unit}" }}\n'
        for name, unit in units.items()
    )
    names.write_text("[engine]\n" + "".join(rows))
    for k, mach in enumerate((0.1, 0.4)):
        record = flown(limited(), ((0.0, 0.9), (3.0, 0.9), (12.0, 0.7)), mach, 0.0, k)
        record.to_dataframe().to_csv(tmp_path / f"r{k}.csv")
    (tmp_path / "engine.toml").write_text(
        "[tables.corrected_thrust]\ncorrected_n2 = [0.8, 0.9, 1.0]\nmach = [0.0, 0.5]\n"
    )
    write_tables(
        {"n2_command": make_term(0.9), "n2_up_time": make_term(1.0), "thrust": make_term(0.0)},
        tmp_path / "prior.nc",
    )
    args = [
        f"{tmp_path}/r0.csv",
        "--flights",
        "--structure",
        f"{tmp_path}/engine.toml",
        "--compare",
        f"{tmp_path}/r1.csv",
    ]
    args += [
        "--names",
        str(names),
        "--rate",
        "10",
        "--prior",
        f"{tmp_path}/prior.nc",
        "-o",
        f"{tmp_path}/deck.nc",
    ]
    run = CliRunner().invoke(engine_command, args)
    assert run.exit_code == 0, run.output
    assert "corrected_thrust (N) over corrected_n2" in run.output
    assert "deck less record, rms" in run.output
    assert all(f"\n{name} " in run.output for name in ("r0", "r1", "all records"))
    assert 'file = "deck.nc"' in run.output
    tables = open_tables(tmp_path / "deck.nc")
    assert "thrust" not in tables  # what was identified replaces its plain counterpart
    assert float(
        tables["corrected_thrust"]["value"].sel(corrected_n2=0.9, mach=0.0)
    ) == pytest.approx(2400.0, rel=0.05)

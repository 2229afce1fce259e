"""Levers that share samples, thrust of the wrong sign and unit, engines that push backwards."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import flightmech
import flighttest
from flightmech.aircraft.fuel import Fuel
from flightmech.aircraft.propulsion.tank import Tank
from flightmech.units import POUND_FORCE
from flighttest.reconstruction.quality.checks.samples import faults_of
from flighttest.reconstruction.quality.checks.signals import resample_channels
from flighttest.reconstruction.quality.engines.engine_sides import side_findings
from flighttest.reconstruction.quality.engines.engines import (
    lever_findings,
    shaft_findings,
    thrust_findings,
)
from flighttest.reconstruction.quality.engines.fuel import fuel_findings
from flighttest.reconstruction.quality.engines.tanks import tank_findings

T37 = Path(__file__).parents[4] / "data" / "t37"
THRUSTS = ("engine1.thrust", "engine2.thrust")


@pytest.fixture(scope="module")
def signals():
    record = flighttest.read(T37 / "flight" / "t37_24_val_power_slam.nc", T37 / "names.toml")
    return resample_channels(record, faults_of(record))


@pytest.fixture(scope="module")
def aircraft():
    return flightmech.read_aircraft(T37 / "aircraft.toml")


def scaled(signals, factor):
    return signals.with_values({name: factor * signals[name] for name in THRUSTS})


def test_thrust_as_it_is(signals, aircraft):
    findings, unchecked = thrust_findings(signals, aircraft)
    assert findings == []
    assert [row[0] for row in unchecked] == ["thrust_line", "engine_sides"]


@pytest.mark.parametrize(
    ("factor", "name", "words"),
    [
        (-1.0, "sign", "wrong sign"),
        (1.0 / POUND_FORCE, "unit", "in lbf and was taken as N"),
        (0.5, "scale", "one of two engines"),
    ],
)
def test_wrong_thrust(signals, aircraft, factor, name, words):
    (finding,), _ = thrust_findings(scaled(signals, factor), aircraft)
    assert finding.kind == name
    assert words in finding.text


def test_thrust_that_does_not_change_shows_nothing(signals, aircraft):
    steady = signals.with_values({name: np.full_like(signals.time, 2e3) for name in THRUSTS})
    findings, unchecked = thrust_findings(steady, aircraft)
    assert findings == []
    assert unchecked[0][0] == "thrust"


def test_engine_that_pushes_backwards(signals, aircraft):
    engine = replace(aircraft.engines[0], direction=(-1.0, 0.0, 0.0))
    turned = replace(aircraft, engines=(engine, aircraft.engines[1]))
    (finding,), _ = thrust_findings(signals, turned)
    assert (finding.severity, finding.name) == ("error", "sign:engine_direction")


@pytest.mark.parametrize(
    ("unmapped", "severity"), [("", "note"), ("controls/throttle_right, data/RPM", "warning")]
)
def test_one_lever_for_two_engines(signals, unmapped, severity):
    record = xr.DataTree(xr.Dataset(attrs={"unmapped": unmapped}))
    shared = signals.with_values({"engine2.throttle": signals["engine1.throttle"]})
    (finding,) = lever_findings(record, shared)
    assert finding.severity == severity
    assert lever_findings(record, signals) == []


@pytest.mark.parametrize(
    ("factor", "unit"), [(POUND_FORCE, "N"), (1.0 / POUND_FORCE, "lbf"), (1e-3, "kN")]
)
@pytest.mark.parametrize("name", THRUSTS)
def test_thrust_of_one_engine_in_another_unit(signals, aircraft, name, factor, unit):
    wrong = signals.with_values({name: factor * signals[name]})
    (finding,), _ = thrust_findings(wrong, aircraft)
    assert finding.name == f"unit:{name}"
    assert f"is in {unit} " in finding.text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factor", "severity"),
    [(1.0, None), (1.3, "warning"), (2.2, "error"), (60.0 / (2.0 * np.pi), "error")],
)
def test_a_propeller_that_turns_faster_than_it_can(factor, severity):
    """Crankshaft or turbine for propeller, and rpm read as rad/s, of an aeroplane with two
    turboprops.
    """
    folder = T37.parent / "commuter"
    record = flighttest.read(folder / "flight" / "check_dutch_roll.csv", folder / "names.toml")
    signals = resample_channels(record, faults_of(record))
    fast = {name: factor * signals[name] for name in ("engine1.rpm", "engine2.rpm")}
    found = shaft_findings(
        signals.with_values(fast), flightmech.read_aircraft(folder / "aircraft.toml")
    )
    expected = [(f"unit:{name}", severity) for name in fast] if severity else []
    assert [(finding.name, finding.severity) for finding in found] == expected


def stepped(signals, first, second):
    """Return the record with two levers, and speeds of the engines behind them by 1 s."""
    time = signals.time
    changed = {}
    for number, instant in ((1, first), (2, second)):
        lever = 0.8 - 0.5 * (time > instant)
        slow = np.exp(-np.maximum(time - instant, 0.0))
        changed[f"engine{number}.throttle"] = lever
        for output in ("n1", "thrust"):
            changed[f"engine{number}.{output}"] = 0.4 + 0.5 * slow
    return signals.with_values(changed)


def exchanged(signals, *quantities):
    changed = {}
    for quantity in quantities:
        changed[f"engine1.{quantity}"] = signals[f"engine2.{quantity}"]
        changed[f"engine2.{quantity}"] = signals[f"engine1.{quantity}"]
    return signals.with_values(changed)


def test_each_engine_follows_its_own_lever(signals, aircraft):
    moved = stepped(signals, 5.0, 15.0)
    findings, _ = side_findings(moved, aircraft)
    assert findings == []
    (finding,), _ = side_findings(exchanged(moved, "n1"), aircraft)
    assert finding.channels == ("engine1.n1", "engine2.n1")
    assert "engine1.n1 follows engine2.throttle" in finding.text
    findings, _ = side_findings(exchanged(moved, "throttle"), aircraft)
    assert [finding.channels[0] for finding in findings] == ["engine1.n1", "engine1.thrust"]


def test_one_lever_that_moves_alone(signals, aircraft):
    """Down only, an exchange looks like an engine that fails; down and up it does not."""
    alone = stepped(signals, 5.0, 1e3)
    assert side_findings(alone, aircraft)[0] == []
    findings, (row,) = side_findings(exchanged(alone, "thrust"), aircraft)
    assert findings == []
    assert row[2][-2:] == THRUSTS
    assert "the levers move differently" in row[3]
    back = {}
    for name in ("engine1.throttle", "engine1.thrust"):
        restored = np.where(signals.time > 16.0, alone[name][0], alone[name])
        back[name] = restored
    back = alone.with_values(back)
    assert [f.channels for f in side_findings(exchanged(back, "thrust"), aircraft)[0]] == [THRUSTS]


def lagged(signals, lever, lag=1.0):
    slow = np.empty_like(lever)
    slow[0] = lever[0]
    for k in range(1, len(lever)):
        slow[k] = slow[k - 1] + (lever[k] - slow[k - 1]) * signals.step / lag
    return slow


def two_engines(signals, levers, speeds):
    """Return the record with nothing of its engines but two levers and two speeds."""
    bare = signals.without([name for name in signals.values if name.startswith("engine")])
    changed = {}
    for number in (1, 2):
        changed[f"engine{number}.throttle"] = levers[number - 1]
        changed[f"engine{number}.n1"] = speeds[number - 1]
    return bare.with_values(changed)


@pytest.mark.parametrize("split", [0.1, 0.2, 0.3, 0.5])
@pytest.mark.parametrize("power", [1.0, 0.6])
def test_levers_that_move_together_and_split_for_a_while(signals, aircraft, split, power):
    """Both engines follow both levers; the differences show the own one."""
    part = (signals.time - signals.time[0]) / np.ptp(signals.time)
    base = np.select([part < 0.2, part < 0.8], [0.1, 0.9], 0.3)
    levers = base, base - split * ((part > 0.4) & (part < 0.6))
    noise = np.random.default_rng(1).standard_normal((2, part.size))
    speeds = [
        0.3 + 0.7 * lagged(signals, u) ** power + 0.002 * e
        for u, e in zip(levers, noise, strict=True)
    ]
    right = two_engines(signals, levers, speeds)
    assert side_findings(right, aircraft) == ([], [])
    (finding,), _ = side_findings(exchanged(right, "n1"), aircraft)
    assert finding.channels == ("engine1.n1", "engine2.n1")


def test_a_failure_next_to_an_engine_that_stays_flat_is_no_exchange(signals, aircraft):
    """Engine 1 fails, lever 2 moves at once, and the speed of engine 2 is at its limit."""
    lever = np.full(signals.time.shape, 0.9)
    instant = signals.time[0] + 10.0
    failed = 0.3 + 0.7 * lagged(signals, np.where(signals.time < instant, 0.9, 0.0))
    levers = lever, np.where(signals.time < instant, 0.9, 0.7)
    flown = two_engines(signals, levers, (failed, np.full(lever.shape, 0.97)))
    findings, ((_, _, _, reason),) = side_findings(flown, aircraft)
    assert findings == []
    assert "when an engine fails or is at its limit" in reason


def test_a_failure_that_no_lever_made_is_no_exchange(signals, aircraft):
    """Engine 1 fails by itself, and the pilot throttles engine 2 at once."""
    moved = stepped(signals, 6.0, 6.2)
    failed = moved.with_values({"engine1.throttle": np.full(signals.time.shape, 0.8)})
    assert side_findings(failed, aircraft)[0] == []


def test_an_engine_that_is_cut_off_has_the_lower_output(signals, aircraft):
    off = np.ones_like(signals.time)
    cut = signals.with_values({"engine1.cutoff": 0.0 * off, "engine2.cutoff": off})
    cut = cut.with_values({"engine1.torque": 2200.0 * off, "engine2.torque": -0.1 * off})
    findings, unchecked = side_findings(cut, aircraft)
    assert findings == []
    assert "engine1.torque" not in unchecked[0][2]
    (finding,), _ = side_findings(exchanged(cut, "torque"), aircraft)
    assert "engine 2 is cut off and engine 1 is not" in finding.text


def test_a_cutoff_of_the_other_sense_is_named(signals, aircraft):
    """A fuel lever recorded as 1 when open looks like exchanged speeds."""
    ones = np.ones_like(signals.time)
    flown = two_engines(signals, (0.8 * ones, 0.8 * ones), (0.9 * ones, 0.08 * ones))
    flown = flown.with_values({"engine1.cutoff": ones, "engine2.cutoff": 0.0 * ones})
    (finding,), _ = side_findings(flown, aircraft)
    assert "engine1.cutoff and engine2.cutoff are 1 for an engine that runs" in finding.text
    assert "sign = -1, offset = 1" in finding.remedy
    # the remedy corrects it
    corrected = {name: 1.0 - flown[name] for name in ("engine1.cutoff", "engine2.cutoff")}
    assert side_findings(flown.with_values(corrected), aircraft) == ([], [])


def test_cutoffs_that_contradict_the_levers_are_turned(signals, aircraft):
    """Engine 1 goes to a low speed by its own lever, while engine 2 is recorded as cut off."""
    lever = np.where(signals.time < signals.time[0] + 5.0, 0.9, 0.0)
    ones = np.ones_like(lever)
    flown = two_engines(signals, (lever, 0.9 * ones), (0.02 + lagged(signals, lever), 0.9 * ones))
    cut = {"engine1.cutoff": 0.0 * ones, "engine2.cutoff": np.where(lever > 0.0, 0.0, 1.0)}
    flown = flown.with_values(cut)
    (finding,), unchecked = side_findings(flown, aircraft)
    assert finding.channels == ("engine1.cutoff", "engine2.cutoff")
    assert "engine1.n1 follows engine1.throttle" in finding.text
    assert unchecked == []
    assert side_findings(exchanged(flown, "cutoff"), aircraft) == ([], [])


def test_levers_that_move_together_show_no_side(signals, aircraft):
    findings, ((name, _, channels, reason),) = side_findings(signals, aircraft)
    assert findings == []
    assert name == "engine_columns"
    assert "engine1.n1" in channels
    assert "the levers never move differently" in reason
    unknown = signals.without(["engine1.throttle", "engine2.throttle"])
    assert side_findings(unknown, aircraft)[1][0][3].startswith("the levers are not recorded")


FLOWS = ("engine1.fuel_flow", "engine2.fuel_flow")


def burning(signals, factor, fuel=None):
    """Return a record that burns 0.1 kg/s by its mass, and a recorded flow of a factor of it.

    The fuel on board falls by `fuel` times the true flow.
    """
    burned = 0.1 * (signals.time - signals.time[0])
    flow = 0.05 + 0.0 * signals.time
    channels = {**dict.fromkeys(FLOWS, factor * flow), "mass": 3000.0 - burned}
    if fuel is not None:
        channels["fuel"] = 1000.0 - fuel * burned
        signals.good.setdefault("fuel", np.ones(burned.shape, bool))
    return signals.with_values(channels)


@pytest.mark.parametrize(
    ("factor", "severity", "words"),
    [
        (1.0, "", ""),
        (1.35, "", ""),
        (2.2046, "error", "lb/h taken as kg/h"),
        (0.4536, "error", "kg/h taken as lb/h"),
        (1.5, "warning", "0.7 to 1.4 are usual"),
        (2.0, "warning", "as if each column held the flow of 2 engines"),
        (0.5, "warning", "as if the columns held 1/2 of the flow"),
        (60.0, "warning", "in kg/min and taken as kg/s"),
        (3600.0, "warning", "in kg/h and taken as kg/s"),
        (1.0 / 3600.0, "warning", "in kg/s and taken as kg/h"),
        (0.1668, "warning", "in US gal/h and taken as lb/h"),
        (6.7, "warning", "in lb/h and taken as US gal/h"),
        (2.2046 * 3600.0, "warning", "in lb/h and taken as kg/s"),
    ],
)
def test_fuel_flow_against_the_change_of_mass(signals, aircraft, factor, severity, words):
    findings, unchecked = fuel_findings(burning(signals, factor), aircraft)
    assert unchecked == []
    assert [finding.severity for finding in findings] == [severity][: bool(words)]
    for finding in findings:
        assert finding.channels == FLOWS
        assert words in finding.text
        assert "(standard error " in finding.text


@pytest.mark.parametrize(
    ("fuel", "words"),
    [
        (2.2046, "or fuel in lb and taken as kg; the flow agrees with mass"),
        (0.4536, "or fuel in kg and taken as lb; the flow agrees with mass"),
        (0.5, "or fuel were that of one tank of 2; the flow agrees with mass"),
    ],
)
def test_a_flow_that_the_mass_confirms_is_not_blamed_alone(signals, aircraft, fuel, words):
    (finding,), _ = fuel_findings(burning(signals, 1.0, fuel), aircraft)
    assert (finding.severity, finding.channels) == ("warning", ("fuel", *FLOWS))
    assert words in finding.text


def test_one_engine_alone_in_pounds_is_named(signals, aircraft):
    flown = burning(signals, 1.0)
    spoilt = flown.with_values({FLOWS[1]: 2.2046 * flown[FLOWS[1]]})
    (finding,), _ = fuel_findings(spoilt, aircraft)
    assert finding.name == f"unit:{FLOWS[1]}"
    assert "alone: lb/h taken as kg/h: it has 2.2 times the flow of engine1" in finding.text
    # two engines at two settings burn what leaves the tanks
    other = flown.with_values({name: 1.6 * flown[name] for name in FLOWS})
    (finding,), _ = fuel_findings(other, aircraft)
    assert "alone" not in finding.text


def tanked(signals, aircraft, factor):
    """Return the aircraft with two tanks, and a record of 60 kg that moves from one to the other
    while 0.1 kg/s are burned; contents times a factor.
    """
    tanks = tuple(
        Tank((0.0, y, 0.0), 500.0, name=name, content=450.0)
        for name, y in (("left", -2.0), ("right", 2.0))
    )
    engines = tuple(replace(engine, feed=("left", "right")) for engine in aircraft.engines)
    craft = replace(aircraft, engines=engines, fuel=Fuel(900.0, tanks=tanks))
    run = (signals.time - signals.time[0]) / np.ptp(signals.time)
    burned = 0.1 * (signals.time - signals.time[0])
    contents = {
        "tank.left.fuel": factor * (450.0 - 60.0 * run - 0.3 * burned),
        "tank.right.fuel": factor * (430.0 + 60.0 * run - 0.7 * burned),
    }
    for name in contents:
        signals.good.setdefault(name, np.ones(burned.shape, bool))
    return signals.with_values(contents), craft


def test_the_sum_of_the_tanks_shows_the_fuel_that_left(signals, aircraft):
    """A transfer between the tanks is not burned."""
    flown, craft = tanked(burning(signals, 1.0), aircraft, 1.0)
    assert fuel_findings(flown.without(["mass"]), craft) == ([], [])
    assert tank_findings(flown, craft) == ([], [])
    wrong, _ = tanked(burning(signals, 1.0), aircraft, 2.2046)
    (finding,), _ = fuel_findings(wrong, craft)
    assert finding.channels[:2] == ("tank.left.fuel", "tank.right.fuel")
    assert "the sum of the tanks in lb and taken as kg; the flow agrees with mass" in finding.text


def test_contents_are_compared_with_capacity_and_fuel_on_board(signals, aircraft):
    flown, craft = tanked(burning(signals, 1.0, fuel=0.0), aircraft, 2.2046)
    found, _ = tank_findings(flown.with_values({"fuel": 880.0 + 0.0 * flown.time}), craft)
    assert [finding.channels[0] for finding in found] == ["tank.left.fuel", "tank.right.fuel"] + [
        "tank.left.fuel"
    ]
    assert "reaches 992.1 kg, and the tank holds 500 kg, as if the contents were" in found[0].text
    assert "times fuel, as if the contents were in lb and taken as kg" in found[2].text
    half, _ = tanked(burning(signals, 1.0, fuel=0.0), aircraft, 1.0)
    (finding,), _ = tank_findings(half.with_values({"fuel": 500.0 + 0.0 * flown.time}), craft)
    assert "times fuel" in finding.text
    assert "as if" not in finding.text


def with_decks(aircraft, tables):
    """Return the engines of an aircraft with these tables in place of their own."""
    engines = []
    for engine in aircraft.engines:
        deck = SimpleNamespace(tables=tables)
        engines.append(SimpleNamespace(deck=deck, propeller=None, piston=None, motor=None))
        engines[-1].thrust = engine.thrust
    return SimpleNamespace(engines=engines, fuel=None)


def test_fuel_on_board_alone_leaves_both_sides_open(signals, aircraft):
    """Nothing else shows whether the flow or the fuel is in another unit."""
    alone = burning(signals, 1.0, 2.2046).without(["mass"])
    (finding,), _ = fuel_findings(alone, with_decks(aircraft, {}))
    assert (finding.severity, finding.channels) == ("warning", (*FLOWS, "fuel"))
    assert "in kg/h and taken as lb/h, or fuel in lb and taken as kg" in finding.text
    # two quantities that agree blame the flow
    (finding,), _ = fuel_findings(burning(signals, 2.2046, 1.0), aircraft)
    assert (finding.severity, finding.channels) == ("error", FLOWS)


@pytest.mark.parametrize(("factor", "count"), [(1.0, 0), (2.2046, 2)])
def test_fuel_flow_against_the_tables_of_the_engine(signals, aircraft, factor, count):
    """Without a change of mass the tables of the aircraft file decide."""
    table = xr.Dataset({"value": ("n2", [0.02, 0.2])}, {"n2": [0.5, 1.0]})
    table["value"].attrs["units"] = "kg s-1"
    table.attrs = {"regressors": "", "outside": "hold"}
    tabled = with_decks(aircraft, {"fuel_flow": table})
    channels = {"mass": np.full(signals.time.shape, 3000.0)}
    for number in (1, 2):
        flow = np.interp(signals[f"engine{number}.n2"], [0.5, 1.0], [0.02, 0.2])
        channels[f"engine{number}.fuel_flow"] = factor * flow
    flown = signals.with_values(channels)
    findings, unchecked = fuel_findings(flown, tabled)
    assert unchecked == []
    assert [finding.kind for finding in findings] == ["unit"] * count
    # neither of them shows the flow
    findings, ((name, _, names, reason),) = fuel_findings(flown, with_decks(aircraft, {}))
    assert (findings, name, names) == ([], "fuel_flow", FLOWS)
    assert "the fuel on board does not change clearly" in reason

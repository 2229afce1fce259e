"""Fuel on board in pounds that were taken as kilograms, in records without fuel flow."""

from types import SimpleNamespace

import numpy as np
import pytest

from flightmech.terms import make_term
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.engines.fuel_on_board import fuel_on_board_findings

TIME = np.arange(0.0, 300.0, 0.1)
FLOW = 0.1
NOISE = np.random.default_rng(4).normal(size=TIME.size)


def signals(**values):
    values = {name.replace("__", "."): x for name, x in values.items()}
    good = {name: np.ones(TIME.size, bool) for name in values}
    return ResampledChannels(TIME, values, good, flying=np.ones(TIME.size, bool), step=0.1)


def aircraft(capacity=0.0, tables=None):
    tanks = (SimpleNamespace(capacity=capacity),) if capacity else ()
    deck = SimpleNamespace(tables=tables or {})
    engine = SimpleNamespace(deck=deck, propeller=None, piston=None, motor=None, thrust=None)
    return SimpleNamespace(fuel=SimpleNamespace(tanks=tanks), engines=(engine,))


def burned(factor):
    return factor * (FLOW * TIME) + 0.05 * NOISE


@pytest.mark.parametrize(
    ("factor", "words"),
    [(2.2046, "lb taken as kg"), (0.4536, "kg taken as lb"), (1.0, ""), (1.2, "")],
)
@pytest.mark.parametrize("tank", ["fuel", "fuel_used"])
def test_fuel_against_the_change_of_mass(tank, factor, words):
    amount = burned(factor) if tank == "fuel_used" else 400.0 - burned(factor)
    flown = signals(**{tank: amount}, mass=3000.0 - FLOW * TIME)
    findings, unchecked = fuel_on_board_findings(flown, aircraft())
    assert unchecked == []
    assert [finding.name for finding in findings] == [f"unit:{tank}"][: bool(words)]
    assert all(words in finding.text for finding in findings)


@pytest.mark.parametrize(("factor", "count"), [(2.2046, 1), (1.0, 0)])
def test_fuel_against_the_tables_of_the_engine(factor, count):
    table = make_term([0.05, 0.15], {"n1": [0.5, 1.0]})
    table["value"].attrs["units"] = "kg s-1"
    flown = signals(fuel=400.0 - burned(factor), engine1__n1=np.full(TIME.size, 0.75))
    findings, unchecked = fuel_on_board_findings(flown, aircraft(tables={"fuel_flow": table}))
    assert unchecked == []
    assert len(findings) == count
    assert all("lb taken as kg" in finding.text for finding in findings)


def test_fuel_beyond_the_capacity():
    flown = signals(fuel=880.0 - burned(2.2))
    (finding,), _ = fuel_on_board_findings(flown, aircraft(capacity=500.0))
    assert finding.severity == "warning"
    assert "times the capacity of the tanks" in finding.text
    assert (
        fuel_on_board_findings(signals(fuel=400.0 - burned(1.0)), aircraft(capacity=500.0))[0] == []
    )


def test_what_nothing_shows_is_listed():
    findings, unchecked = fuel_on_board_findings(signals(fuel=400.0 - burned(1.0)), aircraft())
    assert findings == []
    assert [row[2] for row in unchecked] == [("fuel",)]
    # with a flow it is the task of `fuel_findings`
    flown = signals(fuel=400.0 - burned(1.0), engine1__fuel_flow=np.full(TIME.size, FLOW))
    assert fuel_on_board_findings(flown, aircraft()) == ([], [])

"""Parts lent from one aircraft to another."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

import flightmech
from flightmech.errors import SchemaError
from flightmech.terms import make_term

DATA = Path(__file__).parents[3] / "data" / "t37"


@pytest.fixture(scope="module")
def pair() -> tuple[flightmech.Aircraft, flightmech.Aircraft]:
    return flightmech.read_aircraft(DATA / "apriori.toml"), flightmech.read_aircraft(
        DATA / "aircraft.toml"
    )


def test_what_differs_before_and_after_the_flights(pair):
    parts = flightmech.aircraft.different_parts(*pair)
    engine = ["engine/static", "engine/schedule", "engine/dynamics", "engine/rest"]
    assert parts == [
        *engine,
        "gear/nose",
        "gear/left",
        "gear/right",
        "gear/steering",
        "gear/runway",
    ]
    assert flightmech.aircraft.different_parts(pair[0], pair[0]) == []


def test_all_parts_make_the_other_aircraft_and_one_part_only_itself(pair):
    before, after = pair
    parts = flightmech.aircraft.different_parts(before, after)
    assert (
        flightmech.aircraft.different_parts(
            flightmech.aircraft.swap_parts(before, after, parts), after
        )
        == []
    )
    one = flightmech.aircraft.swap_parts(before, after, ["gear/nose", "CL/basic"])
    assert flightmech.aircraft.different_parts(one, before) == ["gear/nose"]
    assert one.gear.contacts[0].position == after.gear.contacts[0].position
    skids = ["tail", "belly_front", "belly_rear", "tip_left", "tip_right"]
    assert [contact.name for contact in one.gear.contacts] == ["nose", "left", "right", *skids]


def test_parts_that_only_one_has(pair):
    after = pair[1]
    gear = after.gear
    bare = replace(after, gear=replace(gear, contacts=gear.contacts[:3]), circuits={}, fuel=None)
    assert flightmech.aircraft.different_parts(bare, after) == [
        "gear/tail",
        "gear/belly_front",
        "gear/belly_rear",
        "gear/tip_left",
        "gear/tip_right",
        "circuit/column",
        "circuit/wheel",
        "circuit/pedal",
        "fuel/load",
    ]
    assert len(flightmech.aircraft.swap_parts(after, bare, ["gear/tail"]).gear.contacts) == 7
    assert set(flightmech.aircraft.swap_parts(bare, after, ["circuit/column"]).circuits) == {
        "column"
    }
    assert flightmech.aircraft.swap_parts(after, bare, ["fuel/load"]).fuel is None


def test_aeroplanes_of_other_numbers_of_engines_lend_nothing(pair):
    both = pair[1]
    single = replace(both, engines=both.engines[:1])
    for one, other, numbers in (
        (both, single, "2 (T-37) and 1 (T-37)"),
        (single, both, "1 (T-37) and 2 (T-37)"),
    ):
        for lend in (
            partial(flightmech.aircraft.different_parts, one, other),
            partial(flightmech.aircraft.swap_parts, one, other, []),
        ):
            with pytest.raises(
                SchemaError,
                match=re.escape(f"engines: {numbers}; give two models of one aeroplane"),
            ):
                lend()


def test_simple_engines_lend_thrust_and_lag():
    fields = {
        "name": "x",
        "S": 1.0,
        "cbar": 1.0,
        "b": 1.0,
        "mass": 1.0,
        "Ixx": 1.0,
        "Iyy": 1.0,
        "Izz": 1.0,
    }
    weak, strong = (
        flightmech.Aircraft(
            **fields,
            engines=(
                flightmech.aircraft.Engine(
                    (0.0, 0.0, 0.0), thrust=make_term(thrust), time_constant=lag
                ),
            ),
        )
        for thrust, lag in ((1000.0, 1.0), (2000.0, 0.5))
    )
    assert flightmech.aircraft.different_parts(weak, strong) == ["engine/thrust"]
    lent = flightmech.aircraft.swap_parts(weak, strong, ["engine/thrust"]).engines[0]
    assert (float(lent.thrust["value"]), lent.time_constant) == (2000.0, 0.5)

"""Engine decks and fuel in the aircraft file: what is read, what is refused, what the catalogue
holds.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.aircraft.fuel import Fuel, tank_tables
from flightmech.aircraft.propulsion.engine_deck import (
    TARGETS,
    EngineDeck,
    leaf_from_toml,
    open_tables,
    write_tables,
)
from flightmech.aircraft.propulsion.tank import Tank
from flightmech.errors import SchemaError
from flightmech.simulation import catalogue
from flightmech.simulation.kernel import INPUT, PARAMETER, TARGET, computable_names
from flightmech.terms import evaluate_term, make_term

FILE = """
name = "deck"
S = 17.0
cbar = 1.67
b = 10.3
mass = 2300.0
Ixx = 10800.0
Iyy = 8100.0
Izz = 15100.0

[[engine]]
position = [-0.3, 0.0, 0.1]
angular_momentum = 3.0

[engine.deck]
lever_delay = "100 ms"
pla_full = "60 deg"
n2_rated = "20000 rpm"
inlet = [1.0, 0.0, 0.2]

[engine.deck.tables]
n2_command = { throttle = [0.0, 1.0], value = ["60 %", "100 %"] }
n2_up_time = "400 ms"
n2_up_limit = { n2 = [0.5, 1.0], h = ["0 ft", "20000 ft"], value = [[0.05, 0.04], [0.1, 0.08]] }
corrected_thrust = { corrected_n2 = [0.5, 1.0], mach = [0.0, 0.5], value = [["0.1 daN", 0.0], [900.0, 800.0]] }
windmill_thrust = { value = -0.02, regressors = ["qbar"] }

[fuel]
mass = "380 kg"
position = [0.0, 0.0, 0.2]
"""


@pytest.fixture
def file(tmp_path: Path):
    def write(old: str = "", new: str = "") -> Path:
        assert old in FILE
        path = tmp_path / "aircraft.toml"
        path.write_text(FILE.replace(old, new))
        return path

    return write


def rows(kind: int, aircraft: flightmech.Aircraft) -> dict:
    found = {INPUT: catalogue.input_rows(aircraft)}.get(kind) or catalogue.parameter_rows(
        aircraft, [], {}
    )
    return {row.name: row for row in found}


def test_reading(file):
    aircraft = flightmech.read_aircraft(file())
    deck = aircraft.engines[0].deck
    assert (deck.lever_delay, deck.pla_full, deck.inlet) == (
        0.1,
        pytest.approx(np.pi / 3),
        (1.0, 0.0, 0.2),
    )
    assert deck.n2_rated == pytest.approx(20000.0 * 2.0 * np.pi / 60.0)
    assert float(evaluate_term(deck.tables["n2_command"], {"throttle": 0.5})) == pytest.approx(0.8)
    assert float(deck.tables["n2_up_time"]["value"]) == 0.4
    assert float(
        evaluate_term(deck.tables["n2_up_limit"], {"n2": 0.75, "h": 3048.0})
    ) == pytest.approx(0.0675)
    assert (
        float(evaluate_term(deck.tables["corrected_thrust"], {"corrected_n2": 0.5, "mach": 0.0}))
        == 1.0
    )
    assert float(evaluate_term(deck.tables["windmill_thrust"], {"qbar": 1000.0})) == -20.0
    assert (aircraft.fuel.mass, aircraft.fuel.position) == (380.0, (0.0, 0.0, 0.2))


def test_catalogue(file):
    aircraft = flightmech.read_aircraft(file())
    parameters, inputs = rows(PARAMETER, aircraft), rows(INPUT, aircraft)
    assert parameters["engine1.lever_delay"].value == 0.1
    assert parameters["engine1.n2_rated"].display_units == "rpm"
    assert [parameters[f"engine1.{axis}_inlet"].value for axis in "xyz"] == [1.0, 0.0, 0.2]
    assert [parameters[f"engine1.{axis}"].value for axis in "xyz"] == [-0.3, 0.0, 0.1]
    assert parameters["engine1.angular_momentum"].value == 3.0
    assert parameters["init.fuel"].value == 380.0
    assert parameters["mode.engine"].value == 0.0  # the lever drives
    assert (
        inputs["engine1.cutoff"].low,
        inputs["engine1.cutoff"].high,
        inputs["engine1.cutoff"].value,
    ) == (0.0, 1.0, 0.0)
    assert inputs["engine1.n1_drive"].display_units == "%"


def test_ram_drag_acts_at_the_engine_without_an_inlet(file):
    parameters = rows(PARAMETER, flightmech.read_aircraft(file("inlet = [1.0, 0.0, 0.2]\n")))
    assert [parameters[f"engine1.{axis}_inlet"].value for axis in "xyz"] == [-0.3, 0.0, 0.1]


def test_targets_are_those_of_the_kernel():
    own = {
        row.pattern.removeprefix("engine*.")
        for row in computable_names(TARGET)
        if row.group in ("engine", "spool")
    }
    assert own == set(TARGETS)


def test_tables_from_a_file(file, tmp_path):
    tables = flightmech.read_aircraft(file()).engines[0].deck.tables
    write_tables(tables, tmp_path / "deck.nc", title="a deck")
    assert {
        name: leaf.identical(tables[name])
        for name, leaf in open_tables(tmp_path / "deck.nc").items()
    } == dict.fromkeys(tables, True)
    path = file(
        FILE[FILE.index("[engine.deck.tables]") : FILE.index("[fuel]")], 'file = "deck.nc"\n'
    )
    assert set(flightmech.read_aircraft(path).engines[0].deck.tables) == set(tables)


@pytest.mark.nightly
def test_written_and_read_again(file, tmp_path):
    aircraft = flightmech.read_aircraft(file())
    tanks = Fuel(
        200.0,
        tables=tank_tables([Tank((1.0, 2.0, 3.0), 150.0), Tank((-1.0, 0.0, 0.0), 100.0, order=2)]),
    )
    two = replace(aircraft, engines=aircraft.engines * 2, fuel=tanks)
    db = xr.DataTree.from_dict({"/CD/basic": make_term(0.0)})
    for craft in (aircraft, two):
        again = flightmech.read_aircraft(flightmech.write_aircraft(craft, tmp_path / "again.toml"))
        assert flightmech.compile(again, db).block == flightmech.compile(craft, db).block
    assert sorted(path.name for path in tmp_path.glob("*.nc")) == [
        "again_engine1.nc",
        "again_fuel.nc",
    ]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "n2_up_time",
            "n2_uptime",
            "engine.1.deck: unknown table of an engine deck 'n2_uptime'; near it: n2_up_time",
        ),
        (
            'n2_up_time = "400 ms"\n',
            "",
            "engine.1.deck: n2 has a command and no n2_up_time, the time constant with which "
            "it follows",
        ),
        ('"400 ms"', "0.0", "engine.1.deck: n2_up_time holds 0; it must be positive everywhere"),
        (
            "corrected_thrust",
            "itt",
            "engine.1.deck: no table of the thrust; give corrected_thrust or thrust",
        ),
        (
            "n2_command",
            "corrected_n2_windmill",
            "engine.1.deck: no table of a commanded speed; give n1_command or n2_command "
            "over the lever",
        ),
        (
            "value = [[0.05, 0.04], [0.1, 0.08]]",
            "value = [0.05, 0.1]",
            r"n2_up_limit: value has the shape \(2,\), the axes n2 h have \(2, 2\)",
        ),
        (
            ', value = ["60 %", "100 %"]',
            "",
            "n2_command: missing value, in 1 over the axes in the order they are written",
        ),
        ("n2 = [0.5, 1.0]", "n3 = [0.5, 1.0]", "n2_up_limit: unknown quantity 'n3'"),
        ('"400 ms"', '"400 m"', "n2_up_time: unit 'm' cannot be converted to 's'"),
        ('lever_delay = "100 ms"', 'file = "none.nc"', "engine.1.deck: .*none.nc"),
        (
            "angular_momentum = 3.0",
            "thrust = { throttle = [0.0, 1.0], value = [0.0, 1.0] }",
            "engine.1: thrust and deck are both given; keep one",
        ),
        ('mass = "380 kg"', 'mass = 2.0\nfile = "none.nc"', "fuel: .*none.nc"),
        ('mass = "380 kg"', "mass = -1.0", "fuel: expected zero or a positive mass"),
        (
            'mass = "380 kg"',
            "mass = 2.0\ntank = [{ position = [0, 0, 0], capacity = 1.0 }]",
            "fuel: position and tank are both given; keep one",
        ),
    ],
)
def test_faults_are_reported(file, old, new, message):
    with pytest.raises(SchemaError, match=message):
        flightmech.read_aircraft(file(old, new))


def test_fuel_beyond_the_tanks_is_refused(file):
    with pytest.raises(SchemaError, match="380 kg of fuel do not go into tanks of 100 kg"):
        flightmech.read_aircraft(
            file(
                "position = [0.0, 0.0, 0.2]", "tank = [{ position = [0, 0, 0], capacity = 100.0 }]"
            )
        )


def test_an_axis_the_stage_does_not_know_is_refused(file):
    aircraft = flightmech.read_aircraft(file('regressors = ["qbar"]', 'regressors = ["dnz"]'))
    with pytest.raises(SchemaError, match="engine1/windmill_thrust"):
        flightmech.compile(aircraft, xr.DataTree.from_dict({"/CD/basic": make_term(0.0)}))


def test_every_engine_has_a_deck_or_none(file):
    aircraft = flightmech.read_aircraft(
        file("[fuel]", "[[engine]]\nposition = [0.0, 1.0, 0.0]\n[fuel]")
    )
    with pytest.raises(
        SchemaError, match="engine 2 has no deck and others have one; give every engine one or none"
    ):
        flightmech.compile(aircraft, xr.DataTree.from_dict({"/CD/basic": make_term(0.0)}))


def test_deck_and_thrust_in_one_engine_are_refused(file):
    deck = flightmech.read_aircraft(file()).engines[0].deck
    with pytest.raises(SchemaError, match="thrust and deck are both given"):
        flightmech.aircraft.Engine((0.0, 0.0, 0.0), thrust=make_term(1.0), deck=deck)
    with pytest.raises(SchemaError, match="unknown table of an engine deck 'thrst'"):
        EngineDeck({**deck.tables, "thrst": make_term(1.0)})


def test_tables_of_tanks_are_exact_between_the_levels():
    """Two tanks one after the other: halfway through the second, moments of half its content."""
    tables = tank_tables(
        [Tank((1.0, 2.0, 3.0), 40.0, order=2), Tank((-1.0, 0.5, 0.0), 60.0, order=1)]
    )
    at = {name: float(evaluate_term(leaf, {"fuel": 70.0})) for name, leaf in tables.items()}
    assert (at["moment_x"], at["moment_y"], at["moment_z"]) == pytest.approx(
        (40.0 - 30.0, 80.0 + 15.0, 120.0)
    )
    assert (at["Ixx"], at["Iyy"], at["Izz"]) == pytest.approx(
        (40.0 * 13 + 30.0 * 0.25, 40.0 * 10 + 30.0, 40.0 * 5 + 30.0 * 1.25)
    )
    assert (at["Ixy"], at["Ixz"], at["Iyz"]) == pytest.approx((80.0 - 15.0, 120.0, 240.0))


def test_unknown_table_of_the_fuel_is_refused():
    with pytest.raises(SchemaError, match="moment is not a table of the fuel; allowed: moment_x"):
        Fuel(100.0, tables={"moment": make_term(1.0)})


def test_a_number_is_a_table_without_axes():
    assert float(leaf_from_toml("250 ms", "s")["value"]) == 0.25

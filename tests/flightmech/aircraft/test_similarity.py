"""Laws of similarity: there and back, Froude-scaled motion, what is given and what is recorded."""

from __future__ import annotations

import sys
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.controls import ControlGeometry
from flightmech.aircraft.engine import Engine
from flightmech.aircraft.separation import FlowSeparation
from flightmech.errors import SchemaError, UnknownName
from flightmech.terms import make_term

RATIO = 1.7


@pytest.fixture(scope="module")
def known() -> Aircraft:
    thrust = make_term(
        [[100.0, 80.0], [5000.0, 4000.0]],
        {"throttle": [0.0, 1.0], "mach": [0.0, 0.6]},
        stderr=50.0,
        source="flight",
    )
    return Aircraft(
        "known",
        17.0,
        1.67,
        10.3,
        2400.0,
        10800.0,
        8100.0,
        15100.0,
        Ixz=300.0,
        reference=(-3.0, 0.0, 0.1),
        cg=(0.05, 0.0, 0.2),
        engines=(
            Engine((-0.5, 0.0, -0.3), thrust=thrust, time_constant=1.2, angular_momentum=40.0),
        ),
        limits={"delta_e": (-0.35, 0.3)},
        instruments={
            "imu": {"position": [0.9, 0.2, 0.3], "noise": {"q": 1e-3}},
            "gps": {"delay": [0.1, 0.01]},
        },
        controls={
            "delta_e": ControlGeometry(1.6, 0.34, -1.1),
            "delta_a": ControlGeometry(1.2, 0.25, -0.4),
        },
    )


def assert_same(a: Aircraft, b: Aircraft) -> None:
    """Everything but the history, to rounding."""
    assert a.limits == b.limits
    assert a.controls.keys() == b.controls.keys()
    for name in a.controls:
        assert a.controls[name].__dict__ == pytest.approx(b.controls[name].__dict__, rel=1e-12)
    np.testing.assert_allclose(
        a.instruments["imu"]["position"], b.instruments["imu"]["position"], rtol=1e-12
    )
    for name in (
        "S",
        "cbar",
        "b",
        "mass",
        "Ixx",
        "Iyy",
        "Izz",
        "Ixz",
        "reference",
        "cg",
        "x_ref_mac",
    ):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-12)
    for one, other in zip(a.engines, b.engines, strict=True):
        np.testing.assert_allclose(one.position, other.position, rtol=1e-12)
        np.testing.assert_allclose(
            [one.time_constant, one.angular_momentum],
            [other.time_constant, other.angular_momentum],
            rtol=1e-12,
        )
        xr.testing.assert_allclose(
            one.thrust[["value", "stderr"]], other.thrust[["value", "stderr"]], rtol=1e-12
        )


def test_one_changes_nothing(known):
    assert_same(flightmech.aircraft.rescale(known, 1.0), known)


def test_there_and_back(known):
    assert_same(
        flightmech.aircraft.rescale(flightmech.aircraft.rescale(known, RATIO), 1.0 / RATIO), known
    )
    assert_same(
        flightmech.aircraft.rescale(
            flightmech.aircraft.rescale(known, RATIO, 3.0), 1.0 / RATIO, 1.0 / 3.0
        ),
        known,
    )


def test_powers_of_the_length(known):
    twice = flightmech.aircraft.rescale(known, 2.0, name="twice")
    assert twice.name == "twice"
    assert (twice.S, twice.cbar, twice.b) == (68.0, 3.34, 20.6)
    assert (twice.mass, twice.Ixx, twice.Ixz) == (8 * 2400.0, 32 * 10800.0, 32 * 300.0)
    engine = twice.engines[0]
    assert engine.position == (-1.0, 0.0, -0.6)
    assert engine.time_constant == pytest.approx(1.2 * np.sqrt(2.0))
    assert engine.angular_momentum == pytest.approx(40.0 * 8.0 * 2.0**1.5)
    assert float(engine.thrust["value"].max()) == 8 * 5000.0  # equal thrust over weight
    assert engine.thrust["mach"].values.tolist() == [0.0, 0.6]
    assert (engine.thrust["source"] == 2).all()  # judgement now
    assert twice.controls["delta_e"].gearing == -0.55  # the same angle per part of a longer travel
    assert twice.controls["delta_a"].gearing == -0.4  # per radian of the wheel
    assert twice.instruments["imu"] == {"position": [1.8, 0.4, 0.6], "noise": {"q": 1e-3}}


def test_given_factors_and_history(known):
    found = flightmech.aircraft.rescale(known, 2.0, 5.0, {"thrust": 3.0})
    assert found.mass == 5 * 2400.0
    assert found.Iyy == 5 * 4 * 8100.0
    assert float(found.engines[0].thrust["value"].max()) == 15000.0
    assert found.history == (
        "rescaled from known: length ratio 2; factors length 2, area 4, mass 5 (given), "
        "inertia 20, time 1.41421, thrust 3 (given), "
        "angular_momentum 14.1421, gearing 0.5"
    )
    again = flightmech.aircraft.rescale(found, 1.0)
    assert again.history.count("\n") == 1


def test_every_field_has_been_thought_of():
    """A new field of Aircraft needs a law or a reason to stay."""
    scaled = {
        "name",
        "S",
        "cbar",
        "b",
        "mass",
        "reference",
        "cg",
        "engines",
        "instruments",
        "controls",
        "circuits",
        "fuel",
        "gear",
        "history",
        "facts",
        "stall",
    }
    scaled |= {"Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"}
    kept = {"x_ref_mac", "limits", "earth_outputs", "acknowledged"}
    assert {field.name for field in fields(Aircraft)} == scaled | kept


@pytest.mark.slow
def test_separation_is_similar():
    """Steepness, angles and lags in chords stay; station and frequency follow length and time."""
    old = flightmech.read_aircraft(Path(__file__).parents[3] / "data" / "t37" / "aircraft.toml")
    tables = {"a1": 20.0, "alpha_star": 0.3, "tau1": 10.0, "tau2": 3.0}
    tables |= {"buffet_rms": 1.5, "buffet_frequency": 40.0, "buffet_damping": 0.1}
    leaves = {name: make_term(value) for name, value in tables.items()}
    old = replace(old, stall=FlowSeparation(2.5, leaves))
    new = flightmech.aircraft.rescale(old, 4.0, 32.0).stall
    assert new.station == pytest.approx(10.0)
    found = {name: float(leaf["value"]) for name, leaf in new.tables.items()}
    # Froude: accelerations stay, times grow with the root of the length
    assert found == pytest.approx(tables | {"buffet_frequency": 20.0})


@pytest.mark.slow
def test_gear_circuits_fuel_and_deck_are_similar():
    """Static deflection over stroke, damping ratio, break-out over weight, spool times over flight
    times stay the same.
    """
    old = flightmech.read_aircraft(Path(__file__).parents[3] / "data" / "t37" / "aircraft.toml")
    new = flightmech.aircraft.rescale(old, 4.0, 32.0)
    for a, b in zip(old.gear.contacts, new.gear.contacts, strict=True):
        assert old.mass / a.stiffness / abs(a.position[0]) == pytest.approx(
            new.mass / b.stiffness / abs(b.position[0])
        )
        assert a.damping / np.sqrt(a.stiffness * old.mass) == pytest.approx(
            b.damping / np.sqrt(b.stiffness * new.mass)
        )
        assert b.rolling == a.rolling
    a, b = old.circuits["column"], new.circuits["column"]
    assert b.friction / new.mass == pytest.approx(a.friction / old.mass)
    assert a.cable_stiffness / a.mass * 4.0**-1.0 == pytest.approx(
        b.cable_stiffness / b.mass
    )  # frequencies go with 1/sqrt(l)
    assert b.trim_limit == a.trim_limit == sys.float_info.max
    wheels = old.circuits["wheel"], new.circuits["wheel"]
    assert wheels[0].stops == wheels[1].stops
    assert new.fuel.mass / new.mass == pytest.approx(old.fuel.mass / old.mass)
    decks = old.engines[0].deck, new.engines[0].deck
    np.testing.assert_allclose(
        decks[1].tables["n2_up_time"]["value"], 2.0 * decks[0].tables["n2_up_time"]["value"]
    )
    np.testing.assert_allclose(
        decks[1].tables["n2_up_limit"]["value"], decks[0].tables["n2_up_limit"]["value"] / 2.0
    )
    np.testing.assert_allclose(
        decks[1].tables["corrected_thrust"]["value"],
        32.0 * decks[0].tables["corrected_thrust"]["value"],
    )


def test_impossible_ratios_are_refused(known):
    with pytest.raises(
        SchemaError, match=r"length_ratio is -1.0; give a positive number\n  - thrust is 0.0"
    ):
        flightmech.aircraft.rescale(known, -1.0, None, {"thrust": 0.0})
    with pytest.raises(UnknownName, match="unknown law 'thrsut'; near it: thrust"):
        flightmech.aircraft.rescale(known, 2.0, None, {"thrsut": 1.0})


@pytest.fixture(scope="module")
def pair(plain_aircraft, plain_tree):
    """The plain jet, which knows no Mach number, and one 1.7 times as long, over the same
    database.
    """
    small = plain_aircraft()
    return [
        (craft, flightmech.compile(craft, plain_tree()))
        for craft in (small, flightmech.aircraft.rescale(small, RATIO))
    ]


def test_linear_model_scales_by_froude(pair):
    """x' = T^-1 A T with times sqrt(l): V and rates by sqrt(l), angles by one."""
    t = np.sqrt(RATIO)
    start = [{"init.V": 90.0 * scale, "init.h": 0.0, "mode.earth": 0.0} for scale in (1.0, t)]
    small, large = (
        flightmech.linearize(sim, condition)
        for (_, sim), condition in zip(pair, start, strict=True)
    )
    scale = np.array(
        [
            {"V": t, "q": 1 / t, "p": 1 / t, "r": 1 / t}.get(str(name), 1.0)
            for name in small["state"].values
        ]
    )
    expected = small["A"].values * scale[:, None] / scale[None, :] / t
    np.testing.assert_allclose(large["A"], expected, rtol=1e-8, atol=1e-9)


def test_time_history_scales_by_froude(pair):
    """The same doublets over sqrt(l) times the time: angles equal, rates by 1/sqrt(l).  Heights
    differ by the ratio, so density does too: less than 30 m of height, 0.3 % of density.
    """
    histories = []
    for (_, sim), t in zip(pair, (1.0, np.sqrt(RATIO)), strict=True):
        time = t * np.arange(0.0, 8.0, 0.05)
        pulse = np.where(time / t < 1.0, -0.02, np.where(time / t < 2.0, 0.02, 0.0))
        inputs = xr.Dataset(
            {"delta_e": ("time", pulse), "delta_a": ("time", 0.5 * np.roll(pulse, 40))},
            {"time": time},
        )
        trimmed = flightmech.trim(sim, {"init.V": 90.0 * t, "init.h": 0.0, "mode.earth": 0.0})
        start = {
            "init.V": 90.0 * t,
            "init.h": 0.0,
            "mode.earth": 0.0,
            "mode.trim": 0.0,
            "init.alpha": float(trimmed["alpha"]),
        }
        start |= {
            "init.theta": float(trimmed["theta"]),
            "bias.thrust": float(trimmed["trim.thrust"]),
        }
        inputs["delta_e"] = inputs["delta_e"] + float(trimmed["applied.delta_e"])
        histories.append(flightmech.simulate(sim, inputs, start, step=0.005 * t))
    small, large = histories
    for name, scale in (
        ("theta", 1.0),
        ("phi", 1.0),
        ("alpha", 1.0),
        ("beta", 1.0),
        ("q", 1 / np.sqrt(RATIO)),
        ("p", 1 / np.sqrt(RATIO)),
    ):
        size = float(np.ptp(small[name].values))
        assert size > 0.002, name
        np.testing.assert_allclose(
            large[name].values, scale * small[name].values, atol=0.01 * size * scale, err_msg=name
        )

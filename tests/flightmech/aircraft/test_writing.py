"""An aircraft written and read back is the same."""

from __future__ import annotations

import dataclasses
import errno
import os
from pathlib import Path

import pytest
import xarray as xr

import flightmech
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.controls import ControlGeometry
from flightmech.aircraft.engine import Engine
from flightmech.terms import make_term


def craft() -> Aircraft:
    left = make_term(
        [[100.0, 80.0], [5000.0, 4000.0]],
        {"throttle": [0.0, 1.0], "mach": [0.0, 0.6]},
        stderr=50.0,
        source="flight",
        comment='say "x"',
    )
    right = make_term([90.0, 4900.0], {"throttle": [0.0, 1.0]})
    return Aircraft(
        'Trainer "A" \\ β',
        17.0,
        1.67,
        0.1 + 0.2,
        2400.0,
        10800.0,
        8100.0,
        15100.0,
        Ixz=-300.0,
        reference=(-3.0, 0.0, 0.1),
        x_ref_mac=0.27,
        cg=(0.05, 0.0, 0.2),
        engines=(
            Engine((-0.5, -1.0, -0.3), (0.6, 0.0, -0.8), left, 1.2, 40.0),
            Engine((-0.5, 1.0, -0.3), thrust=left),
            Engine((0.0, 0.0, 0.0), thrust=right),
            Engine((1.0, 0.0, 0.0)),
        ),
        limits={"delta_e": (-0.35, 0.3), "throttle": (0.0, 1.0)},
        instruments={
            "imu": {
                "position": [0.9, 0.2, 0.3],
                "noise": {"q": 1e-3},
                "lag": [0.05, 0.02],
                "maximum": 700,
            },
            "gps": {},
        },
        controls={
            "delta_e": ControlGeometry(1.6, 0.34, -1.1),
            "delta_r": ControlGeometry(0.9, 0.4),
        },
        earth_outputs=True,
        history="first\nsecond",
    )


@pytest.mark.slow
def test_there_and_back(tmp_path):
    known = craft()
    path = flightmech.write_aircraft(known, tmp_path / "a.toml")
    found = flightmech.read_aircraft(path)
    for name in Aircraft.__dataclass_fields__:
        if name != "engines":
            assert getattr(found, name) == getattr(known, name), name
    for one, other in zip(found.engines, known.engines, strict=True):
        assert (one.position, one.time_constant, one.angular_momentum) == (
            other.position,
            other.time_constant,
            other.angular_momentum,
        )
        assert abs(sum(a * b for a, b in zip(one.direction, other.direction)) - 1.0) < 1e-15
        if other.thrust is None:
            assert one.thrust is None
        else:
            xr.testing.assert_equal(one.thrust, other.thrust)
            assert one.thrust.attrs == other.thrust.attrs


def test_engines_with_one_table_share_a_file(tmp_path):
    flightmech.write_aircraft(craft(), tmp_path / "a.toml")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "a.toml",
        "a_engine1.nc",
        "a_engine3.nc",
    ]


@pytest.mark.nightly
def test_the_t37_with_deck_gear_fuel_and_circuits(tmp_path):
    known = flightmech.read_aircraft(Path(__file__).parents[3] / "data" / "t37" / "aircraft.toml")
    gear = known.gear
    strut = make_term([0.0, 20e3, 60e3], {"compression": [0.0, 0.1, 0.2]}, outside="linear")
    contacts = (
        dataclasses.replace(gear.contacts[0], strut=strut, orifice=900.0),
        *gear.contacts[1:],
    )
    changed = dataclasses.replace(
        known,
        gear=dataclasses.replace(
            gear, contacts=contacts, condition=2, mu_wet=(0.7, -0.01, 1e-5, 0.0)
        ),
    )
    found = flightmech.read_aircraft(flightmech.write_aircraft(changed, tmp_path / "a.toml"))
    assert flightmech.aircraft.different_parts(found, changed) == []
    assert flightmech.aircraft.different_parts(found, known) == ["gear/nose", "gear/runway"]


@pytest.mark.slow
def test_tables_and_file_of_an_aircraft_are_replaced_together(tmp_path, monkeypatch):
    """A TOML file of before with the tables of now would be another aircraft."""
    aircraft = craft()
    target = flightmech.write_aircraft(aircraft, tmp_path / "a.toml")
    before = {item.name: item.read_bytes() for item in tmp_path.iterdir()}
    assert len(before) > 1
    engines = []
    for engine in aircraft.engines:
        if engine.thrust is not None:
            thrust = engine.thrust.assign(value=1.1 * engine.thrust["value"])
            engine = dataclasses.replace(engine, thrust=thrust)
        engines.append(engine)
    changed = dataclasses.replace(aircraft, engines=tuple(engines), name="other")

    def fail(*arguments, **options):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        # the tables are written with write_bytes
        patch.setattr(Path, "write_text", fail)
        with pytest.raises(OSError, match="not written"):
            flightmech.write_aircraft(changed, target)
    assert {item.name: item.read_bytes() for item in tmp_path.iterdir()} == before
    flightmech.write_aircraft(changed, target)
    now = {item.name: item.read_bytes() for item in tmp_path.iterdir()}
    assert now["a.toml"] != before["a.toml"]
    assert now["a_engine1.nc"] != before["a_engine1.nc"]

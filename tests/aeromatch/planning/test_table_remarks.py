"""Conditions of a record beyond the tables of an engine, and sides of parts, in a plan."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import xarray as xr

import flightmech
from aeromatch.planning.record_look import table_remarks
from aeromatch.planning.remarks import aircraft_remarks

DATA = Path(__file__).parents[3] / "data"
TIME = np.arange(0.0, 10.0, 0.1)


def test_a_plan_names_a_record_beyond_the_chart_of_an_engine():
    aircraft = flightmech.read_aircraft(DATA / "c182" / "aircraft.toml")
    task = SimpleNamespace(name="cruise", aircraft=aircraft)

    def flown(pressure):
        columns = {"engine1.manifold_pressure": ("time", np.full(TIME.shape, pressure))}
        return xr.Dataset(columns, {"time": TIME})

    assert table_remarks(task, flown(70e3)) == []
    (remark,) = table_remarks(task, flown(300e3))
    assert remark.startswith("record cruise: engine 1: 100% of the flight is outside of the axis")


def test_a_plan_names_a_wheel_on_the_other_side():
    aircraft = flightmech.read_aircraft(DATA / "t37" / "aircraft.toml")
    assert aircraft_remarks(aircraft) == []
    first, left, *others = aircraft.gear.contacts
    x, y, z = left.position
    contacts = (first, replace(left, position=(x, -y, z)), *others)
    turned = replace(aircraft, gear=replace(aircraft.gear, contacts=contacts))
    (remark,) = aircraft_remarks(turned)
    assert "contact 'left' of the aircraft file" in remark

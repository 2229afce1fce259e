"""Ice that no flight shows, and flights with ice that no term knows, in a plan."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import aerodb
from aeromatch.planning.record_look import RecordLook
from aeromatch.planning.remarks import ice_remarks
from aeromatch.planning.term_remarks import flown_ranges
from flightmech.aircraft.controls import ICE
from flightmech.terms import make_term
from pom.cases.job import with_stated_inputs

BOX = {"S": 16.0, "cbar": 1.5, "b": 10.0, "x_ref": 0.0, "y_ref": 0.0, "z_ref": 0.0}


def database(regressor):
    leaves = {"CL/basic": make_term(0.3, stderr=0.1)}
    leaves["CL/change"] = make_term(-0.1, regressors=[regressor], stderr=0.1)
    about = {"title": "box", "aircraft": "box", "force_axes": "stability"}
    return aerodb.make_database(leaves, **about, **BOX)


def look(setting):
    """Return a look at a record that a fit and a case use."""
    states = xr.Dataset({ICE: ("time", np.full(5, setting))}, {"time": np.arange(5.0)})
    found = RecordLook("run", windows={"short": states})
    found.ranges["fit 'pitch'"] = flown_ranges(states, np.arange(5))
    return found


def case(**conditions):
    return SimpleNamespace(name="short", record="flight/run.csv", conditions=conditions)


CLEAN, ICED = {"run": look(0.0)}, {"run": look(1.0)}


def test_iced_flights_of_a_model_without_ice():
    (line,) = ice_remarks(database("delta_e"), [], ICED)
    assert line.startswith("record run: device.ice.setting reaches 1 in a fit")
    assert "give the key ice" in line
    assert ice_remarks(database("delta_e"), [case()], CLEAN) == []


def test_ice_that_no_flight_shows():
    iced = database(ICE)
    (line,) = ice_remarks(iced, [case()], CLEAN)
    assert line.startswith("ice: no fit and no case has device.ice.setting above 0")
    # a record that cannot be read shows nothing
    assert ice_remarks(iced, [case()], {}) == [line]
    assert ice_remarks(iced, [], ICED) == []
    assert ice_remarks(iced, [case(**{ICE: 1.0})], CLEAN) == []
    proof = RecordLook("run", windows=ICED["run"].windows)
    assert ice_remarks(iced, [case()], {"run": proof}) == []
    assert ice_remarks(iced, [case(**{ICE: 0.0})], {"run": proof}) == [line]


def test_states_of_a_case_have_what_only_its_conditions_state():
    states = xr.Dataset({"delta_f": ("time", [0.0, 0.1])}, {"time": [0.0, 1.0]})
    stated = case(**{ICE: 1.0, "delta_f": 0.5, "gear": 1.0, "mass": 900.0})
    full = with_stated_inputs(stated, states)
    assert set(full) == {"delta_f", ICE, "gear"}
    assert full["delta_f"].values == pytest.approx([0.0, 0.1])
    assert full[ICE].values.tolist() == full["gear"].values.tolist() == [1.0, 1.0]

"""A gap in the clock of a record is named before a match, with what it takes from its users."""

import json
from types import SimpleNamespace

import numpy as np
import xarray as xr

from aeromatch.planning.record_faults.gap_checks import gap_departures
from aeromatch.workflow.faulty_samples import unflown_cases
from flighttest.reconstruction.path_quantities import CHANNEL_GAPS
from pom.cases.case_inputs import CaseInputs
from pom.checking.case_check import SampleFault

CASE = SimpleNamespace(
    name="phugoid",
    record="flight/slow.csv",
    window=(3.0, 81.0),
    conditions={},
    law_moves=(),
    wind="record",
    drive=CaseInputs(),
)
CLOCK = np.arange(0.0, 90.0, 0.05)
HOLED = CLOCK[(CLOCK < 39.99) | (CLOCK > 41.99)]


def record_of(imu, air):
    leaves = {}
    for leaf, channel, time in (("imu", "p", imu), ("air", "V", air)):
        leaves[f"/{leaf}"] = xr.Dataset({channel: ("time", 0.0 * time)}, {"time": time})
    return xr.DataTree.from_dict(leaves)


def test_a_gap_names_record_time_cases_and_fits():
    spans = {"fit 'pitch'": [(30.0, 45.0)], "fit 'roll'": [(50.0, 60.0)]}
    (line,) = gap_departures("slow", record_of(HOLED, HOLED), [CASE], spans)
    assert line.startswith(
        "record slow: a gap of 2.05 s in the clock from 39.95 to 42 s (imu, air)"
    )
    assert "case phugoid is not flown across it, and its rows are invalid" in line
    assert "fit 'pitch'" in line
    assert "fit 'roll'" not in line
    assert line.endswith("choose a window before or after the gap")
    assert gap_departures("slow", record_of(CLOCK, CLOCK), [CASE], spans) == []


def test_a_gap_outside_the_inertial_unit_is_a_line_through_its_channels():
    (line,) = gap_departures("slow", record_of(CLOCK, HOLED), [CASE], {})
    assert "case phugoid reads these channels from a line across it" in line
    assert "reconstructed" not in line


def test_a_gap_of_a_driving_channel_is_not_flown():
    """A line across a gap of the elevator would lose the input of the test."""
    record = record_of(CLOCK, HOLED)
    controls = record["air"].to_dataset().rename(V="delta_e")
    record = xr.DataTree.from_dict({"/imu": record["imu"].to_dataset(), "/controls": controls})
    (line,) = gap_departures("slow", record, [CASE], {})
    assert "case phugoid is not flown across it, and its rows are invalid" in line
    held = SimpleNamespace(**{**vars(CASE), "conditions": {"delta_e": 0.0}})
    (line,) = gap_departures("slow", record, [held], {})
    assert "reads these channels from a line across it" in line


def test_blank_cells_of_one_control_are_a_gap_of_this_channel():
    lost = (CLOCK > 39.99) & (CLOCK < 41.99)
    controls = xr.Dataset(
        {
            "delta_a": ("time", np.where(lost, np.nan, 0.0)),
            "delta_e": ("time", 0.0 * CLOCK),
        },
        {"time": CLOCK},
    )
    record = xr.DataTree.from_dict({"/controls": controls})
    (line,) = gap_departures("slow", record, [CASE], {})
    assert "from 39.95 to 42 s (controls/delta_a)" in line
    assert "case phugoid is not flown across it, and its rows are invalid" in line
    # ailerons that end before the window does
    late = {**controls, "delta_a": ("time", np.where(CLOCK > 42.0, np.nan, 0.01))}
    record = xr.DataTree.from_dict({"/controls": xr.Dataset(late, {"time": CLOCK})})
    (line,) = gap_departures("slow", record, [CASE], {})
    assert f"from 42 to {CLOCK[-1]:g} s (controls/delta_a)" in line


def test_gaps_that_take_nothing_are_not_named():
    early = SimpleNamespace(**{**vars(CASE), "window": (3.0, 30.0)})
    assert gap_departures("slow", record_of(HOLED, HOLED), [early], {}) == []
    # a flap lever recorded on change: six travels of 3 s in 300 s
    travel = np.arange(0.0, 3.0, 0.1)
    clock = np.concatenate([start + travel for start in np.arange(0.0, 300.0, 50.0)])
    flaps = xr.Dataset({"delta_f": ("time", 0.0 * clock)}, {"time": clock})
    assert gap_departures("slow", xr.DataTree.from_dict({"/flaps": flaps}), [CASE], {}) == []
    # the elevator never stands still for long: the same clock lacks samples
    elevator = xr.DataTree.from_dict({"/controls": flaps.rename(delta_f="delta_e")})
    assert len(gap_departures("slow", elevator, [CASE], {})) == 2


def test_cases_that_are_not_flown_are_not_diagnosed():
    """A gap of the states, and one of a control that drives; not one of another channel."""
    gap = SampleFault(("p", "q"), "gap", 39.95, 42.0)
    later = SimpleNamespace(**{**vars(CASE), "name": "roll", "window": (42.5, 60.0)})
    holed = xr.Dataset({"q": ("time", 0.0 * HOLED)}, {"time": HOLED})
    texts = unflown_cases([CASE, later], {"slow": [gap]}, lambda record: holed)
    assert list(texts) == ["phugoid"]
    assert "in the clock from 39.95 to 42 s" in texts["phugoid"]
    whole = xr.Dataset({"q": ("time", 0.0 * CLOCK)}, {"time": CLOCK})
    for channel, names in (("delta_e", ["phugoid"]), ("V", [])):
        states = whole.assign_attrs({CHANNEL_GAPS: json.dumps({channel: [[39.95, 42.0]]})})
        assert (
            list(
                unflown_cases([CASE, later], {"slow": [gap]}, lambda record, states=states: states)
            )
            == names
        )
    # no path is read for records without a gap
    assert unflown_cases([CASE], {"slow": [gap._replace(kind="held")]}, lambda record: 1 / 0) == {}

"""Channels that hold one value for a time: anywhere in a record, and for most of it."""

import numpy as np
import pytest
import xarray as xr

from aeromatch.planning.record_faults.held_checks import held_departures
from flighttest.reconstruction.quality.checks.held_values import held_values, stuck_findings
from flighttest.reconstruction.quality.checks.samples import (
    channel_findings,
    channel_table,
    faults_of,
)

TIME = np.arange(0.0, 60.0, 0.04)
RANDOM = np.random.default_rng(5).normal(size=TIME.size)
SPEED = 50.0 + 5.0 * np.sin(0.2 * TIME) + 0.1 * RANDOM
ELEVATOR = 0.05 * np.sin(0.5 * TIME) + 0.001 * RANDOM


def record(**channels):
    variables = {name: ("time", np.asarray(x, float)) for name, x in channels.items()}
    data = xr.Dataset(variables, {"time": TIME}, {"rate": 25.0})
    return xr.DataTree.from_dict({"/all": data})


def hold(x, first, last):
    """Return a channel that holds its value between two shares of the record."""
    start, stop = (round(share * (TIME.size - 1)) for share in (first, last))
    held = x.copy()
    held[start : stop + 1] = x[start]
    return held


@pytest.mark.parametrize("name", ["V_cas", "delta_e", "psi"])
@pytest.mark.parametrize(
    ("first", "last"), [(0.0, 0.3), (0.0, 0.7), (0.3, 0.9), (0.5, 0.53), (0.4, 1.0), (0.8, 1.0)]
)
def test_a_held_channel(name, first, last):
    x = hold(ELEVATOR if name == "delta_e" else SPEED, first, last)
    if name == "psi":
        x = np.mod(x, 2.0 * np.pi)
    (flag,) = faults_of(record(**{name: x})).itertuples()
    assert (flag.channel, flag.kind) == (name, "held")
    assert flag.start == pytest.approx(60.0 * first, abs=0.2)
    assert flag.stop == pytest.approx(60.0 * last, abs=0.2)


@pytest.mark.parametrize(
    ("name", "x"),
    [
        ("V_cas", SPEED),
        # steps of 1 kt
        ("V_cas", np.round(SPEED / 0.514) * 0.514),
        # a control without noise, at rest between its inputs
        ("delta_e", np.where(TIME % 20.0 > 17.0, 0.05 * np.sin(2.1 * (TIME % 20.0 - 17.0)), 0.0)),
        # parked before it moves
        ("V_cas", np.maximum(0.0, TIME - 30.0) ** 2 / 90.0),
    ],
)
def test_channels_that_are_not_held(name, x):
    assert faults_of(record(**{name: x})).empty


def test_the_plan_of_a_match_names_them():
    flown = record(V_cas=hold(SPEED, 0.2, 0.8), h_baro=np.full(TIME.size, 1000.0))
    held, stuck = held_departures("cruise", flown, [], {"fit 'pitch'": [(20.0, 30.0)]})
    assert held.startswith("record cruise: V_cas repeats its value from 12 to 47.96 s")
    assert "(in fit 'pitch')" in held
    assert stuck.startswith("record cruise: h_baro never changes from 1000 m")
    assert held_departures("cruise", record(V_cas=SPEED), [], {}) == []


def test_the_short_search_finds_what_the_full_one_finds():
    """A plan of a match searches held and stuck channels alone, without the other checks."""
    blank = hold(SPEED, 0.2, 0.4)
    blank[100:120] = np.nan
    flown = record(
        V_cas=blank,
        psi=np.mod(hold(SPEED, 0.3, 0.6), 2.0 * np.pi),
        delta_e=hold(ELEVATOR, 0.5, 0.53),
        theta=ELEVATOR,
        h_baro=np.full(TIME.size, 900.0),
        gear=np.ones(TIME.size),
        mach=np.full(TIME.size, np.nan),
    )
    faults = faults_of(flown)
    listed = faults.loc[faults["kind"] == "held"].drop(columns="leaf")
    assert [tuple(flag) for flag in held_values(flown)] == list(map(tuple, listed.to_numpy()))
    assert {flag.channel for flag in held_values(flown)} == {"V_cas", "psi", "delta_e"}
    full = channel_findings(flown, channel_table(flown), None)
    stuck = [finding for finding in full if finding.kind == "stuck"]
    assert stuck_findings(flown) == stuck
    assert [finding.channels for finding in stuck] == [("h_baro",), ("mach",)]

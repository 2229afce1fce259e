"""Flow angles and surfaces that are recorded very late are called late, and no surface reversed."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import flightmech
import flighttest

C182 = Path(__file__).parents[4] / "data" / "c182"


@pytest.fixture(scope="module")
def aircraft():
    return flightmech.read_aircraft(C182 / "aircraft.toml")


def named(name, aircraft, **late):
    """Return errors and warnings of a record in which channels are late by so many seconds or, with
    a negative number, reversed.

    A late channel has no values of the first seconds, so the record begins when it has. To repeat
    its first value instead would be a fault of its own.
    """
    record = flighttest.read(C182 / "flight" / f"{name}.csv", C182 / "names.toml")
    for channel, delay in late.items():
        leaf = next(leaf for leaf, node in record.children.items() if channel in node.data_vars)
        t, x = record[leaf]["time"].values, record[leaf][channel].values.copy()
        record[leaf][channel].values[:] = -x if delay < 0.0 else np.interp(t - delay, t, x)
    start = max(0.0, *late.values())
    for leaf, node in record.children.items():
        record[leaf] = xr.DataTree(node.to_dataset().sel(time=slice(start, None)))
    findings = flighttest.assess(record, aircraft).findings
    return {one.name: one for one in findings if one.severity != "note"}


@pytest.mark.nightly
@pytest.mark.parametrize("delay", [0.5, 2.5])
def test_late_alpha_vane_reverses_no_elevator(delay, aircraft):
    found = named("cruise", aircraft, alpha_vane=delay)
    assert list(found) == ["lag:alpha_vane+delta_e+q"]
    assert found["lag:alpha_vane+delta_e+q"].evidence["flow_late"] == pytest.approx(delay, abs=0.35)


@pytest.mark.slow
def test_reversed_elevator_is_still_reversed(aircraft):
    assert list(named("cruise", aircraft, delta_e=-1.0)) == ["sign:delta_e+q"]


@pytest.mark.nightly
@pytest.mark.parametrize(("surface", "name"), [("delta_a", "delta_a+p"), ("delta_r", "delta_r+r")])
def test_surface_more_than_a_second_late(surface, name, aircraft):
    found = named("cruise", aircraft, **{surface: 1.3})
    assert list(found) == [f"lag:{name}"]
    assert found[f"lag:{name}"].evidence["lead"] == pytest.approx(-1.3, abs=0.1)

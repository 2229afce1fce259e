"""Records beyond the axes of the tables of an engine."""

from pathlib import Path

import numpy as np
import pytest

import flightmech
from flighttest.reconstruction.quality.engines.table_ranges import range_findings

DATA = Path(__file__).parents[4] / "data"
SPEED = np.full(100, 230.0)


@pytest.fixture(scope="module")
def aircraft():
    return flightmech.read_aircraft(DATA / "c182" / "aircraft.toml")


def test_a_record_inside_of_the_tables(aircraft):
    pressure = np.linspace(40e3, 95e3, 100)
    values = {"engine1.manifold_pressure": pressure, "engine1.rpm": SPEED, "V": 0.3 * SPEED}
    assert range_findings(values, aircraft) == []


def test_a_manifold_pressure_beyond_the_chart(aircraft):
    values = {"engine1.manifold_pressure": np.full(100, 300e3), "engine1.rpm": SPEED}
    (finding,) = range_findings(values, aircraft)
    assert finding.channels == ("engine1.manifold_pressure",)
    assert "100% of the flight is outside of the axis manifold_pressure" in finding.text
    assert "recorded 300 to 300 kPa, table 20.32 to 101.6 kPa" in finding.text
    # an axis whose unit is named already is not named again
    assert range_findings(values, aircraft, ("manifold_pressure",)) == []


def test_an_advance_ratio_beyond_the_tables(aircraft):
    values = {"engine1.rpm": SPEED, "V": np.full(100, 200.0)}
    (finding,) = range_findings(values, aircraft)
    assert "axis J of CT_prop, CP_prop: recorded 2.656 to 2.656, table 0 to 1.4" in finding.text


def test_a_propeller_that_does_not_turn_is_not_compared(aircraft):
    values = {"engine1.rpm": np.full(100, 5.0), "V": np.full(100, 60.0)}
    assert range_findings(values, aircraft) == []

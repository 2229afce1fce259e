"""Mass against lift: the tutorial's aeroplane and its mistakes, with and without a database."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import aerodb
import flightmech
import flighttest
from flightmech import terms
from flightmech.aircraft.fuel import Fuel
from flightmech.units import POUND
from flighttest.reconstruction.quality.assessment import _aircraft_findings
from flighttest.reconstruction.quality.checks.signals import ResampledChannels, resample_channels
from flighttest.reconstruction.quality.declarations.weight import weight_findings

C182 = Path(__file__).parents[4] / "data" / "c182"
INERTIAS = ("Ixx", "Iyy", "Izz")
NOTHING = pd.DataFrame(columns=["leaf", "channel", "kind", "start", "stop"])


@pytest.fixture(scope="module")
def aircraft():
    return flightmech.read_aircraft(C182 / "aircraft.toml")


@pytest.fixture(scope="module")
def record():
    return flighttest.read(C182 / "flight" / "check_short_period.csv", C182 / "names.toml")


@pytest.fixture(scope="module")
def signals(record):
    return resample_channels(record, NOTHING)


def scaled(signals, factor) -> ResampledChannels:
    return signals.with_values({"mass": factor * signals["mass"]})


def test_recorded_mass(signals, record, aircraft):
    assert weight_findings(signals, aircraft, record) == ([], "")
    (finding,), why = weight_findings(scaled(signals, 1.0 / POUND), aircraft, record)
    assert (finding.severity, finding.name, why) == ("error", "weight:mass", "")
    assert "mass is in lb and was taken as kg" in finding.text
    assert 'mass = { column = "Gross Wt"' in finding.remedy
    (finding,), _ = weight_findings(scaled(signals, POUND), aircraft, record)
    assert "mass is in kg and was taken as lb" in finding.text


@pytest.mark.parametrize("factor", [0.75, 1.35])
def test_a_legitimate_error_is_not_reached(factor, signals, record, aircraft):
    """DATCOM and upwash of a vane are wrong by a quarter."""
    both = replace(aircraft, mass=factor * aircraft.mass)
    assert weight_findings(scaled(signals, factor), both, record)[0] == []


@pytest.mark.parametrize(
    ("factor", "severity"),
    [(0.97, ""), (1.06, "note"), (0.85, "note"), (1.3, "warning"), (0.75, "warning")],
)
def test_flown_at_another_mass_than_that_of_the_aircraft_file(
    factor, severity, signals, record, aircraft
):
    findings, _ = weight_findings(scaled(signals, factor), aircraft, record)
    assert [finding.severity for finding in findings] == [severity] * bool(severity)
    for finding in findings:
        assert f"{aircraft.mass:.5g} kg of the aircraft file" in finding.text
        assert "record them" in finding.remedy


def test_burnt_fuel_and_recorded_inertias(signals, record, aircraft):
    """A third of the mass may be fuel; recorded moments of inertia belong to the recorded mass."""
    light = scaled(signals, 0.7)
    ((finding,), _) = weight_findings(light, aircraft, record)
    assert finding.severity == "warning"
    fuelled = replace(aircraft, fuel=Fuel(0.35 * aircraft.mass))
    ((finding,), _) = weight_findings(light, fuelled, record)
    assert finding.severity == "note"
    inertias = {name: np.full_like(light.time, getattr(aircraft, name)) for name in INERTIAS}
    ((finding,), _) = weight_findings(light.with_values(inertias), fuelled, record)
    assert finding.remedy == "check both against the loading sheet"
    assert "moments of inertia" not in finding.text


def test_mass_of_the_aircraft_file(signals, record, aircraft):
    wrong = replace(aircraft, mass=aircraft.mass / POUND)
    (finding,), _ = weight_findings(signals, wrong, record)  # the record's own mass is right
    assert finding.severity == "error"
    assert "the first is in lb and was taken as kg" in finding.text
    (finding,), _ = weight_findings(signals.without(("mass",)), wrong, record)
    assert (finding.severity, finding.name) == ("error", "weight:mass")
    assert "aircraft file" in finding.remedy


def test_what_the_lift_does_not_show(signals, record, aircraft):
    found, why = weight_findings(signals.without(("alpha_vane",)), aircraft, record)
    assert (found, why) == ([], "not recorded: alpha_vane")
    still = signals.with_values({"alpha_vane": np.full_like(signals.time, 0.03)})
    found, why = weight_findings(scaled(still, 1.8), replace(aircraft, mass=1900.0), record)
    assert found == []
    assert "too little" in why


def test_level_of_a_database_in_steady_flight(signals, record, aircraft):
    """Without motion of the angle of attack the lift of a prior still shows a mass of 2.2 times."""
    alpha = np.radians([-8.0, 0.0, 8.0, 16.0])
    middle = float(np.median(signals["alpha_vane"]))
    CL = terms.make_term(
        0.4 + 5.0 * (alpha - middle),
        {"alpha": alpha},
        stderr=0.05,
        source="datcom",
        comment="by hand",
    )
    attributes = {
        "title": "by hand",
        "aircraft": aircraft.name,
        "S": aircraft.S,
        "cbar": aircraft.cbar,
        "b": aircraft.b,
    }
    reference = {"x_ref": 0.0, "y_ref": 0.0, "z_ref": 0.0, "force_axes": "stability"}
    database = aerodb.make_database({"CL/basic": CL}, **attributes, **reference)
    still = signals.with_values({"alpha_vane": np.full_like(signals.time, middle)})
    assert weight_findings(still, aircraft, record, database) == ([], "")
    (finding,), _ = weight_findings(scaled(still, 1.0 / POUND), aircraft, record, database)
    assert "lift coefficient" in finding.text
    assert weight_findings(signals, aircraft, record, database) == ([], "")
    # an offset of the vane, which its own check corrects, is not an error of the mass
    offset = still.with_values({"alpha_vane": still["alpha_vane"] + np.radians(8.0)})
    assert weight_findings(offset, aircraft, record, database)[0]
    findings, _ = _aircraft_findings(still, aircraft, record, database, offset)
    assert [finding.text for finding in findings if finding.kind == "weight"] == []

"""Reference quantities and control effects of a database against aircraft file and record."""

from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

import aerodb
import flightmech
import flighttest
from flightmech import terms
from flighttest.reconstruction.quality.checks.control_response import control_responses
from flighttest.reconstruction.quality.checks.samples import faults_of
from flighttest.reconstruction.quality.checks.signals import resample_channels
from flighttest.reconstruction.quality.declarations.database_match import (
    gain_findings,
    reference_findings,
)

T37 = Path(__file__).parents[4] / "data" / "t37"


@pytest.fixture(scope="module")
def aircraft():
    return flightmech.read_aircraft(T37 / "aircraft.toml")


@pytest.fixture(scope="module")
def signals():
    name = "t37_10_multisine_clean_5kft.nc"
    record = flighttest.read(T37 / "flight" / name, T37 / "names.toml")
    return resample_channels(record, faults_of(record))


def database(aircraft, elevator=-1.1):
    known = {"stderr": 0.05, "source": "datcom", "comment": "by hand"}
    leaves = {
        "CL/basic": terms.make_term(0.3, **known),
        "Cm/elevator": terms.make_term(elevator, regressors=["delta_e"], **known),
        "Cm/altitude": terms.make_term([0.0, 0.01], {"h": [0.0, 1e4]}, **known),
    }
    reference = aircraft.reference or (0.0, 0.0, 0.0)
    return aerodb.make_database(
        leaves, title="one", aircraft="T-37", S=aircraft.S, cbar=aircraft.cbar, b=aircraft.b,
        x_ref=reference[0], y_ref=reference[1], z_ref=reference[2], force_axes="stability",
    )  # fmt: skip


def test_reference_quantities(aircraft):
    db = database(aircraft)
    assert reference_findings(aircraft, db) == []
    assert reference_findings(aircraft, None) == []
    (finding,) = reference_findings(replace(aircraft, S=1.15 * aircraft.S), db)
    assert finding.name == "geometry:S"
    assert f"{1.15 * aircraft.S:.5g} and {aircraft.S:.5g}" in finding.text
    moved = (aircraft.reference[0] + 0.1, *aircraft.reference[1:])
    (finding,) = reference_findings(replace(aircraft, reference=moved), db)
    assert finding.channels == ("reference",)


def test_gain_of_a_surface(signals, aircraft):
    answers = control_responses(signals)
    elevator = answers[answers["surface"] == "delta_e"]
    findings, (row,) = gain_findings(elevator, signals, aircraft, database(aircraft))
    assert findings == []
    assert "delta_e has" in row[3]
    (finding,), _ = gain_findings(elevator, signals, aircraft, database(aircraft, -5.0))
    assert finding.name == "scale:delta_e+q"
    unseen, (row,) = gain_findings(answers, signals, None, None)
    assert unseen == []
    assert "--database" in row[3]
    assert gain_findings(pd.DataFrame(columns=answers.columns), signals, aircraft, None) == ([], [])

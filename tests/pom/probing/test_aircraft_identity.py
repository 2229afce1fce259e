"""A model, or evidence, of another aeroplane than that of the case is named."""

from pathlib import Path
from types import SimpleNamespace

import pytest
import xarray as xr

from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import SchemaError
from pom.diagnosis.tuning.demands import demand_evidence
from pom.probing.aircraft_identity import aircraft_remarks, demand_own_evidence

FILE = Path(__file__).parents[3] / "data" / "t37" / "aircraft.toml"
OWN = {"S": 17.086, "cbar": 1.683, "b": 10.296}


@pytest.fixture
def case():
    return SimpleNamespace(aircraft=str(FILE))


def tables(masses, **quantities):
    """Return the tables of a model with the reference quantities and masses of the T-37."""
    entries = [SimpleNamespace(name=f"mass.{name}", value=value) for name, value in masses.items()]
    return SimpleNamespace(
        title="other", meta={"database": OWN | quantities}, entries=lambda kind: entries
    )


@pytest.fixture
def own(case):
    """Return mass and inertia of the aircraft file."""
    aircraft = read_aircraft(case.aircraft)
    OWN.update(S=aircraft.S, cbar=aircraft.cbar, b=aircraft.b)
    return {name: getattr(aircraft, name) for name in ("mass", "Ixx", "Iyy", "Izz")}


def test_the_model_of_the_case_has_no_remark(case, own):
    assert not list(aircraft_remarks(case, tables(own)))
    assert not list(aircraft_remarks(case, tables(own | {"Iyy": 1.15 * own["Iyy"]})))
    assert not list(aircraft_remarks(case, None))


@pytest.mark.parametrize(
    ("masses", "quantities", "text"),
    [
        ({}, {"S": 36.0}, "S is 36 m2 in the FMU and 16.91 m2 in the case"),
        ({"mass": 5600.0}, {}, "mass is 5600 kg in the FMU and"),
        ({"Iyy": 1e5}, {}, "Iyy is 1e+05 kg m2 in the FMU and"),
    ],
)
def test_a_model_of_another_aeroplane_departs(case, own, masses, quantities, text):
    (remark,) = aircraft_remarks(case, tables(own | masses, **quantities))
    assert remark.kind == "departure"
    assert text in remark.text


def test_evidence_of_another_aeroplane_is_refused(case, own):
    other = xr.DataTree(xr.Dataset(attrs=OWN | {"b": 18.6}))
    with pytest.raises(SchemaError, match=r"b is 18\.6 m in the evidence and 10\.\d+ m"):
        demand_own_evidence(other, [case])
    with pytest.raises(SchemaError, match=r"b is 18\.6 m in the evidence and .* in the model"):
        demand_evidence(xr.DataTree(xr.Dataset(attrs=OWN)), other, {})
    demand_own_evidence(xr.DataTree(xr.Dataset(attrs=OWN)), [case])

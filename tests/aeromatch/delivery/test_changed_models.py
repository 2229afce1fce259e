"""A package is made of the models that the report judged, not of files changed after the match."""

import json
import zipfile

import pytest

import aerodb
import flightmech
from aeromatch.delivery import contents
from aeromatch.delivery.contents import demand_proven_models
from flightmech.errors import SchemaError
from flightmech.simulation.compiler import compile_with_envelope
from flightmech.support.input_files import file_sha256
from flightmech.terms import make_term
from pom.judging.beyond_the_bands import BLOCK

AIRCRAFT = """
name = "box"
S = 16.0
cbar = 1.5
b = 11.0
mass = 1000.0
Ixx = 1000.0
Iyy = 1500.0
Izz = 2000.0
"""


def database(elevator):
    return aerodb.make_database(
        {"Cm/elevator": make_term(elevator, {}, ("delta_e",), stderr=0.1)},
        title="box",
        aircraft="box",
        S=16.0,
        cbar=1.5,
        b=11.0,
        x_ref=0.0,
        y_ref=0.0,
        z_ref=0.0,
        force_axes="stability",
    )


@pytest.fixture
def match(tmp_path, monkeypatch):
    """The folder of a match: the final model alone, and the hash of its FMU in the report."""
    (tmp_path / "final.toml").write_text(AIRCRAFT)
    aerodb.save(database(-1.2), tmp_path / "final.nc")
    aircraft = flightmech.read_aircraft(tmp_path / "final.toml")
    sim = compile_with_envelope(aircraft, aerodb.open(tmp_path / "final.nc"))
    with zipfile.ZipFile(tmp_path / "final.fmu", "w") as content:
        content.writestr(BLOCK, bytes(sim.block))
    judged = {"final.fmu": {"final": file_sha256(tmp_path / "final.fmu")}}
    monkeypatch.setattr(contents, "judged_files", lambda report: json.loads(json.dumps(judged)))
    return tmp_path


NAMES = ("datcom", "corrected", "final")


def test_the_models_of_the_match(match):
    demand_proven_models(NAMES, match)


def test_a_database_that_was_edited_after_the_match(match):
    aerodb.save(database(-0.84), match / "final.nc")
    with pytest.raises(SchemaError) as caught:
        demand_proven_models(NAMES, match)
    changed, remedy = caught.value.problems
    assert changed.startswith("final.fmu: its model is not that of its database and aircraft")
    assert "run `aeromatch match` again" in remedy


def test_an_aircraft_or_an_fmu_that_was_changed_after_the_match(match):
    (match / "final.toml").write_text(AIRCRAFT.replace("1500.0", "1800.0"))
    with pytest.raises(SchemaError, match="its model is not"):
        demand_proven_models(NAMES, match)
    (match / "final.toml").write_text(AIRCRAFT)
    with zipfile.ZipFile(match / "final.fmu", "a") as content:
        content.writestr("other", "x")
    with pytest.raises(SchemaError, match="is not the FMU that the report judged as final"):
        demand_proven_models(NAMES, match)

"""The command ``flight stall``, on records in place of reconstructed paths."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import stall_records as records
from click.testing import CliRunner

import aerodb
from flightmech import read_aircraft, write_aircraft
from flightmech.errors import IdentificationError
from flighttest.cli.actions.submodels import airframe as submodels
from flighttest.cli.group import flight

pytestmark = pytest.mark.slow

T37 = Path(__file__).parents[3] / "data" / "t37" / "aircraft.toml"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a folder with two stalls, an aircraft and a database without a stall."""
    rng = np.random.default_rng(11)
    kinds = {"slow.nc": "quasi-steady", "fast.nc": "accelerated"}
    stalls = {name: records.stall_record(rng, kind) for name, kind in kinds.items()}
    for name in stalls:
        (tmp_path / name).write_bytes(b"")
    aircraft = dataclasses.replace(read_aircraft(T37), cbar=records.CBAR, b=records.SPAN)
    write_aircraft(aircraft, tmp_path / "jet.toml")
    aerodb.save(records.attached_database(), tmp_path / "jet.nc")
    monkeypatch.setattr(submodels, "open_path", lambda path: stalls[str(path)])
    monkeypatch.setattr(submodels, "coefficients", lambda record, aircraft, cutoff: record)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(line: str):
    return CliRunner().invoke(flight, ["stall", *line.split()])


@pytest.mark.nightly
def test_a_stall_is_written_into_aircraft_database_and_figure(folder):
    done = run(
        "slow.nc fast.nc --aircraft jet.toml --database jet.nc --coefficient CL "
        "--into stalling.nc -o stalling.toml --figure loops.svg --json"
    )
    assert done.exit_code == 0, done.output
    parameters = json.loads(done.output)["parameters"]
    star = parameters["alpha_star"]
    assert abs(star["value"] - np.deg2rad(17.0)) < 4.0 * star["stderr"] < np.deg2rad(2.0)
    stalling = read_aircraft(folder / "stalling.toml")
    assert float(stalling.stall.tables["alpha_star"]["value"]) == pytest.approx(star["value"])
    names = set(aerodb.terms(aerodb.open(folder / "stalling.nc")))
    assert names > set(aerodb.terms(records.attached_database()))
    assert any("stall" in name for name in names)
    assert (folder / "loops.svg").read_text(encoding="utf-8").count("<svg") == 1


def test_outputs_that_need_a_database_are_refused_without_one(folder):
    done = run("slow.nc --aircraft jet.toml --into stalling.nc")
    assert "--into and --attached-to need --database" in str(done.exception)
    assert not (folder / "stalling.nc").exists()


def test_records_whose_coefficients_are_no_numbers_are_refused(folder, monkeypatch):
    """As with a dynamic pressure of 0, or accelerations that overflow."""
    rng = np.random.default_rng(11)
    record = records.stall_record(rng, "quasi-steady")
    monkeypatch.setattr(submodels, "open_path", lambda path: record.assign(CL=np.nan * record.CL))
    done = run("slow.nc fast.nc --aircraft jet.toml --database jet.nc --coefficient CL")
    assert isinstance(done.exception, IdentificationError)
    assert "no sample holds numbers of the coefficient" in str(done.exception)

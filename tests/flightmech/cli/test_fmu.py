"""The command group ``aeromatch fmu``."""

from __future__ import annotations

import json

import pytest
import xarray as xr
from click.testing import CliRunner

from flightmech.cli.group import fmu
from flightmech.errors import ParseError
from flightmech.terms import make

AIRCRAFT = """
name = "Trainer"
S = 17.0
cbar = 1.67
b = 10.3
mass = 2500.0
Ixx = 10000.0
Iyy = 8100.0
Izz = 15000.0
[[engine]]
position = [0.0, 0.0, 0.1]
thrust = { throttle = [0.0, 1.0], value = [200.0, 9000.0] }
"""


@pytest.fixture
def files(tmp_path) -> tuple[str, str]:
    aircraft, database = tmp_path / "trainer.toml", tmp_path / "trainer.nc"
    aircraft.write_text(AIRCRAFT)
    tree = xr.DataTree.from_dict({"/CL/basic": make([-0.8, 0.2, 1.4], {"alpha": [-0.2, 0.0, 0.3]}), "/CD/basic": make(0.03)})
    tree.to_netcdf(database, engine="h5netcdf")
    return str(aircraft), str(database)


@pytest.mark.parametrize("version", ["2.0", pytest.param("3.0", marks=pytest.mark.slow)])
def test_command_line_writes_and_shows(files, tmp_path, version):
    path = str(tmp_path / "trainer.fmu")
    wrote = CliRunner().invoke(fmu, ["write", *files, "-o", path, "--fmi", version, "--json"], catch_exceptions=False)
    document = json.loads(wrote.stdout)
    assert (document["file"], document["fmi"], document["terms"]) == (path, version, 3)
    shown = CliRunner().invoke(fmu, ["show", path, "--json"], catch_exceptions=False)
    found = json.loads(shown.stdout)
    assert (found["model"], found["fmi"], found["findings"]) == ("Trainer", version, [])
    assert "term.CL.basic" in {v["name"] for v in found["variables"]}
    assert "delta_e" in CliRunner().invoke(fmu, ["show", path], catch_exceptions=False).stdout


def test_command_line_refuses_a_file_that_is_no_database(files, tmp_path):
    aircraft, _ = files
    result = CliRunner().invoke(fmu, ["write", aircraft, aircraft, "-o", str(tmp_path / "x.fmu")])
    assert isinstance(result.exception, ParseError)
    assert "an aircraft file" in str(result.exception)
    assert not (tmp_path / "x.fmu").exists()

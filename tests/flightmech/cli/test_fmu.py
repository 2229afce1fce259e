"""The command group ``aeromatch fmu``."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

from flightmech.cli.group import fmu
from flightmech.errors import ParseError, SchemaError
from flightmech.simulation.compiler import compile_files
from flightmech.support.array_files.netcdf_trees import encode_tree
from flightmech.support.hdf5_seal import add_seal
from flightmech.terms import make_term

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


def tree() -> xr.DataTree:
    return xr.DataTree.from_dict(
        {
            "/CL/basic": make_term([-0.8, 0.2, 1.4], {"alpha": [-0.2, 0.0, 0.3]}),
            "/CD/basic": make_term(0.03),
        }
    )


@pytest.fixture
def files(tmp_path) -> tuple[str, str]:
    aircraft, database = tmp_path / "trainer.toml", tmp_path / "trainer.nc"
    aircraft.write_text(AIRCRAFT)
    tree().to_netcdf(database, engine="h5netcdf")
    return str(aircraft), str(database)


@pytest.mark.parametrize("version", ["2.0", pytest.param("3.0", marks=pytest.mark.slow)])
def test_command_line_writes_and_shows(files, tmp_path, version):
    path = str(tmp_path / "trainer.fmu")
    wrote = CliRunner().invoke(
        fmu, ["write", *files, "-o", path, "--fmi", version, "--json"], catch_exceptions=False
    )
    document = json.loads(wrote.stdout)
    assert (document["file"], document["fmi"], document["terms"]) == (path, version, 3)
    shown = CliRunner().invoke(fmu, ["show", path, "--json"], catch_exceptions=False)
    found = json.loads(shown.stdout)
    assert (found["model"], found["fmi"], found["findings"]) == ("Trainer", version, [])
    assert "term.CL.basic" in {v["name"] for v in found["variables"]}
    assert "delta_e" in CliRunner().invoke(fmu, ["show", path], catch_exceptions=False).stdout


@pytest.mark.parametrize("verb", ["write", "simulate", "trim"])
def test_a_sealed_database_with_a_changed_byte_is_refused(files, tmp_path, verb):
    """In a table, as half or twice a number, which nothing else shows."""
    aircraft, database = files
    content = encode_tree(tree())
    whole = bytearray(add_seal(content, "database", None))
    whole[content.index(np.float64(1.4).tobytes()) + 6] ^= 0x10
    (tmp_path / "trainer.nc").write_bytes(whole)
    (tmp_path / "inputs.csv").write_text("time,delta_e [deg]\n0,0\n1,0\n")
    given = {
        "write": ["-o", str(tmp_path / "x.fmu")],
        "simulate": ["--inputs", str(tmp_path / "inputs.csv"), "-o", str(tmp_path / "x.nc")],
        "trim": ["--fix", "V=90"],
    }
    result = CliRunner().invoke(fmu, [verb, aircraft, database, *given[verb]])
    assert isinstance(result.exception, ParseError)
    assert "its SHA-256 is not that of its seal" in str(result.exception)


@pytest.mark.nightly
def test_a_damaged_database_without_a_seal_is_an_error_of_ours_or_a_model(files):
    aircraft, database = files
    content = encode_tree(tree())
    rng, refused = np.random.default_rng(4), 0
    for place, bit in zip(rng.integers(0, len(content), 60), rng.integers(0, 8, 60), strict=True):
        damaged = bytearray(content)
        damaged[place] ^= 1 << int(bit)
        Path(database).write_bytes(damaged)
        try:
            compile_files(aircraft, database)
        except (ParseError, SchemaError):
            refused += 1
    assert 0 < refused < 60


def test_command_line_refuses_a_file_that_is_no_database(files, tmp_path):
    aircraft, _ = files
    result = CliRunner().invoke(fmu, ["write", aircraft, aircraft, "-o", str(tmp_path / "x.fmu")])
    assert isinstance(result.exception, ParseError)
    assert "an aircraft file" in str(result.exception)
    assert not (tmp_path / "x.fmu").exists()

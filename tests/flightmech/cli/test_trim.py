"""The verb ``aeromatch fmu trim``."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

import flightmech
from flightmech.cli.group import fmu
from flightmech.errors import SchemaError
from flightmech.units import KNOT

AIRCRAFT = """
name = "plain"
S = 17.0
cbar = 1.67
b = 10.3
mass = 2400.0
Ixx = 10800.0
Iyy = 8100.0
Izz = 15100.0
[[engine]]
position = [0.0, 0.0, 0.0]
thrust = { throttle = [0.0, 1.0], value = [200.0, 9000.0] }
[limits]
delta_e = ["-20 deg", "20 deg"]
"""


@pytest.fixture
def files(tmp_path, plain_tree) -> tuple[str, str]:
    aircraft, database = tmp_path / "plain.toml", tmp_path / "plain.nc"
    aircraft.write_text(AIRCRAFT)
    plain_tree().to_netcdf(database, engine="h5netcdf")
    return str(aircraft), str(database)


def run(*arguments: str):
    return CliRunner().invoke(fmu, ["trim", *arguments], catch_exceptions=False)


def test_units_in_and_numbers_out(files):
    result = run(
        *files, "--kind", "turn", "--fix", "V=175 kt", "--fix", "h=5000 ft", "--fix", "phi=30 deg", "--fix", "mode.earth=0", "--json"
    )
    assert result.exit_code == 0
    found = json.loads(result.stdout)
    assert (found["verdict"], found["kind"]) == ("trimmed", "turn")
    outputs = found["outputs"]
    assert (outputs["V"], outputs["h"], outputs["phi"]) == pytest.approx((175.0 * KNOT, 1524.0, np.radians(30.0)), rel=1e-9)
    assert found["left"]["ay"] == pytest.approx(0.0, abs=1e-9)
    from flightmech.simulation.model_files import compile_files

    y = flightmech.trim(compile_files(*files), found["start"])
    assert float(y["alpha"]) == pytest.approx(outputs["alpha"], abs=1e-12)


def test_a_table_for_people(files):
    rows = run(*files, "--fix", "V=90").stdout.splitlines()
    assert rows[0] == "plain, level: trimmed"
    assert [row.split()[0] for row in rows[2:8]] == ["alpha", "beta", "delta_e", "delta_a", "delta_r", "throttle"]
    assert rows[7].split()[2] == "%"


def test_a_flight_beyond_the_limits_ends_with_1(files):
    result = run(*files, "--kind", "climb", "--fix", "V=90", "--fix", "gamma=30 deg")
    assert result.exit_code == 1
    assert "not trimmed; throttle at its upper limit 1; left over: u_dot" in result.stdout
    assert "at its upper limit" in next(line for line in result.stdout.splitlines() if line.startswith("throttle"))


def test_unknowns_by_name(files):
    named = [word for name in ("alpha", "beta", "delta_e", "delta_a", "delta_r", "V") for word in ("--free", name)]
    found = json.loads(run(*files, "--fix", "throttle=0.3", *named, "--json").stdout)
    assert list(found["found"]) == ["alpha", "beta", "delta_e", "delta_a", "delta_r", "V"]
    assert found["converged"] == 1


def test_what_is_missing_is_stated(files):
    with pytest.raises(SchemaError, match="no value of phi, psi_dot or nz; give one in fixed"):
        run(*files, "--kind", "turn")
    assert "'phi' is not NAME=VALUE" in run(*files, "--fix", "phi").output

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
        *files,
        "--kind",
        "turn",
        "--fix",
        "V=175 kt",
        "--fix",
        "h=5000 ft",
        "--fix",
        "phi=30 deg",
        "--fix",
        "mode.earth=0",
        "--json",
    )
    assert result.exit_code == 0
    found = json.loads(result.stdout)
    assert (found["verdict"], found["kind"]) == ("trimmed", "turn")
    outputs = found["outputs"]
    assert (outputs["V"], outputs["h"], outputs["phi"]) == pytest.approx(
        (175.0 * KNOT, 1524.0, np.radians(30.0)), rel=1e-9
    )
    assert found["left"]["ay"] == pytest.approx(0.0, abs=1e-9)
    from flightmech.simulation.compiler import compile_files

    y = flightmech.trim(compile_files(*files), found["start"])
    assert float(y["alpha"]) == pytest.approx(outputs["alpha"], abs=1e-12)


def test_a_table_for_people(files):
    rows = run(*files, "--fix", "V=90").stdout.splitlines()
    assert rows[0] == "plain, level: trimmed"
    assert [row.split()[0] for row in rows[2:8]] == [
        "alpha",
        "beta",
        "delta_e",
        "delta_a",
        "delta_r",
        "throttle",
    ]
    assert rows[7].split()[2] == "%"


def test_a_flight_beyond_the_limits_ends_with_1(files):
    result = run(*files, "--kind", "climb", "--fix", "V=90", "--fix", "gamma=30 deg")
    assert result.exit_code == 1
    assert "not trimmed; throttle at its upper limit 1; left over: u_dot" in result.stdout
    assert "at its upper limit" in next(
        line for line in result.stdout.splitlines() if line.startswith("throttle")
    )


@pytest.fixture
def without_rudder(files, plain_tree) -> tuple[str, str]:
    """The same aircraft with a database that has no rudder, as one from DATCOM alone."""
    tree = plain_tree()
    for coefficient in ("CY", "Cl", "Cn"):
        node = tree[coefficient]
        for name in [
            name
            for name, leaf in node.children.items()
            if "delta_r" in str(leaf.attrs.get("regressors", "")).split()
        ]:
            del node[name]
    tree.to_netcdf(files[1], engine="h5netcdf")
    return files


@pytest.mark.slow
def test_level_flight_without_a_rudder_term_is_trimmed(without_rudder):
    """Over the rotating Earth the Coriolis acceleration is left, 1e-4 of what gravity does; a bank
    takes it.
    """
    flight = (*without_rudder, "--fix", "V=175 kt", "--fix", "h=5000 ft")
    found = json.loads(run(*flight, "--json").stdout)
    assert found["verdict"] == "trimmed; without effect: delta_r"
    assert (
        found["advice"]
        == "delta_r: nothing in database and aircraft depends on it here; the flight is steady "
        "without it"
    )
    assert 1e-6 < max(map(abs, found["left"].values())) < 3e-4
    shown = run(*flight).stdout.splitlines()
    assert found["advice"] in shown
    named = [
        word
        for name in ("alpha", "beta", "delta_e", "delta_a", "throttle", "phi")
        for word in ("--free", name)
    ]
    banked = json.loads(run(*flight, *named, "--json").stdout)
    assert (banked["verdict"], banked["advice"]) == ("trimmed", "")
    assert max(map(abs, banked["left"].values())) < 1e-9


@pytest.mark.slow
def test_what_a_missing_rudder_prevents_comes_with_the_ways_out(without_rudder):
    turn = run(*without_rudder, "--kind", "turn", "--fix", "V=175 kt", "--fix", "phi=30 deg")
    assert turn.exit_code == 1
    assert "add a term that has it, such as Cn/rudder for delta_r" in turn.stdout
    assert "--free" not in turn.stdout
    flight = (*without_rudder, "--kind", "climb", "--fix", "V=175 kt", "--fix", "gamma=5 deg")
    climb = run(*flight)
    assert climb.exit_code == 1
    advice = next(line for line in climb.stdout.splitlines() if line.startswith("delta_r: "))
    named = advice.partition("free the bank: ")[2].split()
    assert named[-2:] == ["--free", "phi"]
    assert run(*flight, *named).exit_code == 0


def test_unknowns_by_name(files):
    named = [
        word
        for name in ("alpha", "beta", "delta_e", "delta_a", "delta_r", "V")
        for word in ("--free", name)
    ]
    found = json.loads(run(*files, "--fix", "throttle=0.3", *named, "--json").stdout)
    assert list(found["found"]) == ["alpha", "beta", "delta_e", "delta_a", "delta_r", "V"]
    assert found["converged"] == 1


def test_what_is_missing_is_stated(files):
    with pytest.raises(SchemaError, match="no value of phi, psi_dot or nz; give one in fixed"):
        run(*files, "--kind", "turn")
    assert "'phi' is not NAME=VALUE" in run(*files, "--fix", "phi").output

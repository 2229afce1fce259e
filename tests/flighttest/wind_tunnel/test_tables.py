"""Balance points become a table of set points, and a database of them."""

import json

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import aerodb
from aerodb.estimators.build import from_estimate
from aerodb.estimators.column_map import read_column_map
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import AeromatchWarning, IdentificationError
from flighttest.cli.group import flight
from flighttest.special_tests.wind_tunnel.balance import read_setup
from flighttest.special_tests.wind_tunnel.reduction import balance_coefficients
from flighttest.special_tests.wind_tunnel.tables import average_at_set_points

DEG = np.pi / 180.0
S, C, RHO, V = 0.5, 0.25, 1.2, 30.0
SETUP = """rho = "1.2 kg/m3"
[reference]
S = "0.5 m2"
b = "2 m"
c = "0.25 m"
[constants]
mach = 0.09
[columns]
alpha = "alpha [deg]"
beta = "beta [deg]"
delta_e = "elevator [deg]"
"""


def lift(alpha, delta_e):
    return 0.2 + 4.5 * alpha + 0.4 * delta_e


def moment(alpha, delta_e):
    return 0.05 - 0.9 * alpha - 1.1 * delta_e


def balance_points(alphas, elevators):
    """Return loads of a balance at the reference point, about body axes with z down."""
    rows = []
    q = 0.5 * RHO * V**2
    for elevator in elevators:
        for angle in alphas:
            alpha, delta_e = angle * DEG, elevator * DEG
            CL, CD = lift(alpha, delta_e), 0.03
            sin, cos = np.sin(alpha), np.cos(alpha)
            rows.append(
                {
                    "alpha [deg]": angle,
                    "beta [deg]": 0.0,
                    "elevator [deg]": elevator,
                    "V": V,
                    "Fx": q * S * (CL * sin - CD * cos),
                    "Fz": q * S * (-CL * cos - CD * sin),
                    "My": q * S * C * moment(alpha, delta_e),
                }
            )
    return pd.DataFrame(rows)


@pytest.fixture
def files(tmp_path):
    alphas = [-4.1, -3.9, 0.0, 4.0, 8.0]
    balance_points(alphas, (-5.0, 0.0, 5.0)).to_csv(tmp_path / "run.csv", index=False)
    (tmp_path / "balance.toml").write_text(SETUP)
    return tmp_path


def test_points_near_a_set_point_are_averaged(files):
    setup = read_setup(files / "balance.toml")
    data = [balance_coefficients(files / "run.csv", setup)]
    table = average_at_set_points(data, 4.0 * DEG)
    assert set(table["alpha_deg"]) == {-4.0, 0.0, 4.0, 8.0}
    clean = average_at_set_points(data, 1.0 * DEG).query("delta_e_deg == 0")
    at = clean.set_index("alpha_deg")
    assert at.loc[-4.0, "count"] == 2
    assert at.loc[-4.0, "CL"] == pytest.approx(lift(-4.0 * DEG, 0.0), abs=1e-9)
    with pytest.raises(IdentificationError, match=r"none of 15 points lies within 0.75 deg"):
        average_at_set_points([data[0].assign(beta=data[0]["beta"] + 1.5 * DEG)], 3.0 * DEG)


@pytest.mark.slow
def test_a_database_of_a_balance(files):
    arguments = ["balance", str(files / "run.csv"), "--setup", str(files / "balance.toml")]
    arguments += ["--table", str(files / "table"), "--step", "1 deg", "--x-ref", "1.5 m"]
    result = CliRunner().invoke(flight, [*arguments, "--json"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout) == {"table": str(files / "table")}
    columns = read_column_map(files / "table" / "columns.toml")
    assert (columns.reference.x, columns.reference.cbar) == (1.5, 0.25)
    (files / "a.toml").write_text(
        'name = "model"\nS = "0.5 m2"\ncbar = "0.25 m"\nb = "2 m"\nmass = "20 kg"\n'
        'Ixx = "1 kg m2"\nIyy = "1 kg m2"\nIzz = "1 kg m2"\nIxz = "0 kg m2"\n'
        'reference = ["-1.5 m", "0 m", "0 m"]\ncg = ["-1.5 m", "0 m", "0 m"]\n'
    )
    with pytest.warns(AeromatchWarning):
        db = from_estimate(
            read_aircraft(files / "a.toml"),
            [files / "table" / "points.csv"],
            columns=columns,
            controls={"delta_e": "+delta_e"},
        )
    terms = aerodb.terms(db)
    basic = terms["CL/basic"]["value"].isel(mach=0).interp(alpha=4.0 * DEG)
    assert float(basic) == pytest.approx(lift(4.0 * DEG, 0.0), abs=1e-6)
    increment = terms["Cm/elevator"]["value"].isel(mach=0)
    increment = increment.interp(alpha=0.0, delta_e=5.0 * DEG)
    assert float(increment) == pytest.approx(-1.1 * 5.0 * DEG, abs=1e-6)
    assert db.attrs["source"] == "wind tunnel"


def test_the_reference_point_is_required(files):
    arguments = ["balance", str(files / "run.csv"), "--setup", str(files / "balance.toml")]
    result = CliRunner().invoke(flight, [*arguments, "--table", str(files / "t")])
    assert result.exit_code == 2
    assert "--table needs --step and --x-ref" in result.output

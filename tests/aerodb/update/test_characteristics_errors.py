"""Standard errors of flying qualities from those of the database."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import aerodb
import flightmech
from aerodb.cli.group import db as command
from aerodb.update.standard_errors import with_standard_errors
from flightmech import terms
from flightmech.errors import SchemaError
from tests.flightmech.conftest import linear_aircraft, linear_tree

ROOT = dict(
    title="plain",
    aircraft="plain",
    S=17.0,
    cbar=1.67,
    b=10.3,
    x_ref=0.0,
    y_ref=0.0,
    z_ref=0.0,
    force_axes="stability",
)
CONDITION = {"V": 90.0, "h": 1500.0}


@pytest.fixture(scope="module")
def aircraft():
    return linear_aircraft()


@pytest.fixture(scope="module")
def database():
    """Exact tables but for the pitch damping, known to 10 %: manoeuvre points follow it, neutral
    points do not.
    """
    leaves = aerodb.terms(linear_tree())
    leaves["Cm/qhat"] = terms.make_term(-14.0, {}, ("qhat",), stderr=1.4)
    return aerodb.make_database(leaves, **ROOT)


@pytest.mark.nightly
@pytest.mark.slow
def test_standard_errors_are_those_of_the_linear_relation(aircraft, database):
    """Manoeuvre point less neutral point is linear in Cm_q; a deviation of 40 draws has a standard
    error of 11 %, three of them allowed.
    """
    found = flightmech.characteristics(aircraft, database, CONDITION)
    errors = with_standard_errors(found, aircraft, database, CONDITION, 40, seed=3).table["stderr"]
    value = found.table["value"]
    without = aerodb.replace_terms(
        database, {"Cm/qhat": terms.make_term(-12.6, {}, ("qhat",), stderr=1.4)}
    )
    changed = flightmech.characteristics(aircraft, without, CONDITION).table["value"]
    expected = abs(float(changed["manoeuvre_point_fixed"] - value["manoeuvre_point_fixed"]))
    assert errors["manoeuvre_point_fixed"] == pytest.approx(expected, rel=0.33)
    assert errors["neutral_point_fixed"] == pytest.approx(0.0, abs=1e-9)
    again = with_standard_errors(found, aircraft, database, CONDITION, 40, seed=3)
    np.testing.assert_array_equal(again.table["stderr"], errors)
    assert "+-" in again.report()
    assert again.modes.set_index("mode").loc["short period", "damping_ratio_stderr"] > 0.0


def test_too_few_draws_are_refused(aircraft, database):
    with pytest.raises(SchemaError, match="9 draws; give 10 or more"):
        with_standard_errors(None, aircraft, database, CONDITION, 9)


@pytest.mark.slow
def test_verb(aircraft, database, tmp_path):
    aerodb.save(database, tmp_path / "db.nc")
    flightmech.write_aircraft(aircraft, tmp_path / "aircraft.toml")
    args = [
        "characteristics",
        str(tmp_path / "db.nc"),
        str(tmp_path / "aircraft.toml"),
        "--speed",
        "90",
        "--altitude",
        "1500",
    ]
    result = CliRunner().invoke(command, [*args, "--samples", "10", "--json"])
    assert result.exit_code == 0, result.output
    table = json.loads(result.output[result.output.index("{") :])["characteristics"]
    row = next(row for row in table if row["quantity"] == "manoeuvre_point_fixed")
    assert row["stderr"] > 0.0

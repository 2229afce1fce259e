"""Check cases: a table for other implementations, and the group that travels with a database."""

import numpy as np
import pytest
import xarray as xr

import aerodb
from aerodb.store.evaluation import failing_checks
from flightmech import terms
from flightmech.errors import ParseError, SchemaError


@pytest.fixture
def table(small, tmp_path):
    aerodb.exchange.export_checkcases(small, tmp_path / "cases.csv", count=300, seed=3)
    return tmp_path / "cases.csv"


def columns(table):
    lines = [line for line in table.read_text().splitlines() if not line.startswith("#")]
    return dict(
        zip(lines[0].split(","), np.array([line.split(",") for line in lines[1:]], float).T)
    )


def test_another_implementation_meets_the_table(table):
    """NumPy's interp, term by term, as a user would write it."""
    x = columns(table)
    assert list(x) == [
        "case", "alpha [rad]", "delta_f [rad]", "mach [1]", "qhat [1]", "CL/basic", "CL/qhat",
        "CL/flap", "Cm/qhat",
        "CL", "CD", "CY", "Cl", "Cm", "Cn",
    ]  # fmt: skip
    alpha = np.clip(x["alpha [rad]"], *np.radians([-8.0, 16.0]))
    slope = np.interp(x["mach [1]"], [0.2, 0.4], [5.0, 5.4])
    flap = np.interp(x["delta_f [rad]"], np.radians([0.0, 20.0, 40.0]), [0.0, 0.2, 0.36])
    qhat = np.interp(x["mach [1]"], [0.2, 0.4], [8.0, 8.4]) * x["qhat [1]"]
    expected = {
        "CL/basic": 0.2 + slope * alpha,
        "CL/qhat": qhat,
        "CL/flap": flap,
        "Cm": -17.0 * x["qhat [1]"],
        "CD": 0.0 * flap,
    }
    expected["CL"] = expected["CL/basic"] + qhat + flap
    for name, values in expected.items():
        np.testing.assert_allclose(x[name], values, rtol=0.0, atol=1e-13, err_msg=name)


def test_cases_see_every_cell_the_breakpoints_and_what_lies_beyond(table):
    x = columns(table)
    points = np.radians([-8.0, 0.0, 8.0, 16.0])
    inside, counts = np.unique(np.searchsorted(points, x["alpha [rad]"]), return_counts=True)
    assert inside.tolist() == [0, 1, 2, 3, 4]  # 0 and 4 beyond the ends
    assert counts.min() >= 10
    assert np.isin(x["alpha [rad]"], points).sum() >= 15
    assert x["mach [1]"].min() < 0.2
    assert x["delta_f [rad]"].min() == 0.0  # an axis from zero is never left downwards


def test_the_same_seed_gives_the_same_table(small, table, tmp_path):
    aerodb.exchange.export_checkcases(small, tmp_path / "again.csv", count=300, seed=3)
    assert (tmp_path / "again.csv").read_bytes() == table.read_bytes()
    aerodb.exchange.export_checkcases(small, tmp_path / "again.csv", count=300, seed=4)
    assert (tmp_path / "again.csv").read_bytes() != table.read_bytes()


def test_running_names_the_output_that_differs(small, table):
    assert aerodb.exchange.run_checkcases(small, table)["agrees"].all()
    small["CL/flap"]["value"][1] += 1e-6
    found = aerodb.exchange.run_checkcases(small, table)
    assert found.index[~found["agrees"]].tolist() == ["CL/flap", "CL"]
    row = found.loc["CL/flap"]
    assert 0.0 < row["largest_difference"] < 1.000001e-6
    assert row["tolerance"] == pytest.approx(0.36e-9, rel=1e-12)
    assert 100 < row["failed"] < 300


def test_a_term_that_is_gone_counts_as_zero(small, table):
    found = aerodb.exchange.run_checkcases(aerodb.delete_terms(small, ["Cm/qhat"]), table)
    assert found.index[~found["agrees"]].tolist() == ["Cm/qhat", "Cm"]


def test_a_column_in_degrees_is_converted(small, table):
    lines = table.read_text().splitlines()
    head = next(i for i, line in enumerate(lines) if line.startswith("case"))
    rows = [line.split(",") for line in lines[head + 1 :]]
    turned = [",".join([row[0], repr(float(np.degrees(float(row[1])))), *row[2:]]) for row in rows]
    table.write_text(
        "\n".join([*lines[:head], lines[head].replace("alpha [rad]", "alpha [deg]"), *turned, ""])
    )
    assert aerodb.exchange.run_checkcases(small, table)["agrees"].all()


def test_tables_that_cannot_be_run_are_reported(small, table):
    text = table.read_text()
    table.write_text(text.replace("mach [1]", "nach [1]").replace("qhat [1]", "qhat [deg/s]"))
    with pytest.raises(SchemaError) as caught:
        aerodb.exchange.run_checkcases(small, table)
    assert [problem[:52] for problem in caught.value.problems] == [
        "cases.csv: column nach [1]: unknown quantity 'nach';",
        "cases.csv: column qhat [deg/s]: unit 'deg/s' cannot ",
        "cases.csv: no column mach [1], which the database ne",
    ]
    table.write_text("a,b\n1,2\n")
    with pytest.raises(ParseError, match="aeromatch check cases, format 1"):
        aerodb.exchange.run_checkcases(small, table)
    with pytest.raises(SchemaError, match="count is 0; at least one case is needed"):
        aerodb.exchange.export_checkcases(small, table, count=0)


@pytest.mark.nightly
def test_checks_travel_and_are_run(small, tmp_path):
    path = tmp_path / "db.nc"
    checked = aerodb.store.with_checks(small, count=50)
    assert list(aerodb.terms(checked)) == list(aerodb.terms(small))
    aerodb.save(checked, path)
    xr.testing.assert_identical(aerodb.open(path), checked)
    xr.testing.assert_identical(aerodb.store.with_checks(checked, count=50), checked)
    checked["Cm/qhat"]["value"][...] = -17.1
    with pytest.raises(
        SchemaError,
        match=r"checks: Cm differs by .* in case \d+ \(\d+ of 50 cases fail\); the terms were "
        r"changed",
    ) as caught:
        aerodb.save(checked, path)
    assert len(caught.value.problems) == 2  # the term and its coefficient
    checked.to_netcdf(path, engine="h5netcdf")
    with pytest.raises(SchemaError, match="checks: Cm/qhat differs"):
        aerodb.open(path)


def test_cases_of_another_source_hold_by_their_own_tolerance(small):
    """As a DAVE-ML file gives them: no contributions, a tolerance each, an input missing in one
    case.
    """
    states = {
        "alpha": [0.0, 0.1, np.nan],
        "mach": [0.3] * 3,
        "delta_f": [0.0] * 3,
        "qhat": [0.0] * 3,
    }
    expected = 0.2 + 5.2 * np.array([0.0, 0.1, 0.2])
    cases = xr.Dataset({name: ("case", x) for name, x in states.items()}, {"case": [1, 2, 3]})
    cases["CL"], cases["CL_tolerance"] = (
        ("case", expected + [0.0, 0.009, 5.0]),
        ("case", [0.01] * 3),
    )
    db = xr.DataTree.from_dict({**small.to_dict(), "/checks": cases})
    assert failing_checks(db) == []
    db["checks"]["CL_tolerance"][1] = 0.008
    assert failing_checks(db)[0].startswith(
        "checks: CL differs by -0.009 in case 2 (1 of 2 cases fail)"
    )


def test_a_database_without_variables_has_cases_too(root):
    db = aerodb.store.with_checks(
        aerodb.make_database({"CD/basic": terms.make_term(0.02)}, **root), count=3
    )
    assert db["checks"]["CD"].values.tolist() == [0.02] * 3

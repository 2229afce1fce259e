"""Text tables of coefficients with a column map."""

import sys
from pathlib import Path

import numpy as np
import pytest

import aerodb
from aerodb.estimators.column_map import read_column_map
from aerodb.estimators.column_tables import read_table
from flightmech.errors import AeromatchWarning, ParseError, SchemaError

sys.path.insert(0, str(Path(__file__).parent))
from light_aircraft import aircraft

SHARED = Path(__file__).parents[4] / "shared" / "data" / "estimators" / "tables_csv"
needs_tables = pytest.mark.skipif(
    not SHARED.is_dir(), reason="the tables of other estimators are not here (shared data)"
)
DEG, FOOT = np.pi / 180.0, 0.3048
REFERENCE = '[reference]\nS = "174 ft2"\ncbar = "4.9 ft"\nb = "35.8 ft"\nx = "7.6 ft"\n'
AXES = 'force_axes = "stability"\nmoment_axes = "stability"\nmach = 0.2\n'
RUNS = (
    'layout = "runs"\n'
    + AXES
    + REFERENCE
    + """
[columns]
alpha_deg = "alpha [deg]"
beta_deg = "beta [deg]"
da_deg = "aileron [deg]"
de_deg = "elevator [deg]"
dr_deg = "rudder [deg]"
CL = "CL"
CD = "CD"
CY = "CY"
Cl = "Cl"
Cm = "Cm"
Cn = "Cn"
"""
)
LONG = (
    'layout = "long"\n'
    + AXES
    + REFERENCE
    + """
[columns]
alpha = "alpha [deg]"
beta = "beta [deg]"
da = "aileron [deg]"
de = "elevator [deg]"
dr = "rudder [deg]"
coefficient = "coefficient"
value = "value"
"""
)
MATRIX = (
    'layout = "matrix"\nrows = "alpha [deg]"\nacross = "elevator [deg]"\ncoefficient = "{}"\n'
    + AXES
    + REFERENCE
)


def column_map(folder, text):
    (folder / "map.toml").write_text(text)
    return read_column_map(folder / "map.toml")


def at(numbers, coefficient, alpha, elevator):
    rows = numbers[numbers["coefficient"] == coefficient]
    rows = rows[
        np.isclose(rows["alpha"], alpha * DEG) & np.isclose(rows["elevator"], elevator * DEG)
    ]
    if "rudder" in rows:
        rows = rows[(rows["beta"] == 0.0) & (rows["rudder"] == 0.0) & (rows["aileron"] == 0.0)]
    return rows


@needs_tables
def test_three_layouts_hold_the_same_numbers(tmp_path):
    runs = read_table(SHARED / "c182_runs_tidy.csv", column_map(tmp_path, RUNS)).numbers
    row = at(runs, "CL", 0.0, 0.0).iloc[0]
    assert (row["value"], row["line"]) == (0.127566, 12)
    long = read_table(SHARED / "c182_long.csv", column_map(tmp_path, LONG)).numbers
    assert at(long, "Cm", -4.0, -15.0).iloc[0]["value"] == 0.74254
    comma = column_map(tmp_path, MATRIX.format("Cm"))
    matrix = read_table(SHARED / "c182_wide_elevator_eu.csv", comma).numbers
    row = at(matrix, "Cm", 4.0, 5.0).iloc[0]
    assert (row["value"], row["line"]) == (-0.12945, 8)
    # An empty cell is missing, not zero.
    assert at(matrix, "Cm", 12.0, -15.0).empty
    blanks = column_map(tmp_path, MATRIX.format("CL"))
    lift = read_table(SHARED / "c182_wide_CL_tab.txt", blanks).numbers
    row = at(lift, "CL", 4.0, 0.0).iloc[0]
    assert (row["value"], row["line"]) == (0.4869, 8)
    for numbers in (long, matrix, lift):
        coefficient = numbers["coefficient"].iloc[0]
        mine = numbers[numbers["coefficient"] == coefficient].iloc[5]
        angles = (mine["alpha"] / DEG, mine["elevator"] / DEG)
        assert at(runs, coefficient, *angles).iloc[0]["value"] == pytest.approx(
            mine["value"], abs=6e-5
        )


@pytest.mark.nightly
@needs_tables
def test_a_database_of_a_table_has_increments_over_the_deflection(tmp_path):
    controls = {"elevator": "+delta_e", "aileron": "+delta_a", "rudder": "-delta_r"}
    # The drag of the table is that of a vortex lattice.
    with pytest.warns(AeromatchWarning) as caught:
        db = aerodb.from_estimate(
            aircraft(),
            [SHARED / "c182_runs_tidy.csv"],
            columns=column_map(tmp_path, RUNS),
            controls=controls,
        )
    texts = [str(warning.message) for warning in caught]
    assert any(text.startswith("CD = 0.001") for text in texts)
    # Sideslip was run from 0 to 8 deg only.
    assert any("CY over beta: not every deflection reaches alpha -4" in text for text in texts)
    table = aerodb.terms(db)["Cm/elevator"]["value"].sel(mach=0.2)
    at_4 = table.sel(alpha=4 * DEG, method="nearest")
    slope = float(at_4.sel(delta_e=5 * DEG, method="nearest")) / (5 * DEG)
    # The derivative that AVL prints for the same geometry is -1.9418 per rad.
    assert slope == pytest.approx(-1.9418, rel=0.01)
    assert float(at_4.sel(delta_e=0.0)) == 0.0
    assert aerodb.terms(db)["Cm/elevator"].attrs["regressors"] == ""
    # Sideslip: the slope of the totals is the derivative of the print, in body axes.
    beta = aerodb.terms(db)["Cn/beta"]["value"].sel(mach=0.2).sel(alpha=4 * DEG, method="nearest")
    assert float(beta) == pytest.approx(0.0878, rel=0.05)


GOOD = "Alpha,CL,CD,Cm\n0,0.1,0.02,0.01\n4,0.5,0.03,-0.02\n"
SMALL = (
    'layout = "runs"\n'
    + AXES
    + REFERENCE
    + '[columns]\nAlpha = "alpha [deg]"\nCL = "CL"\nCD = "CD"\nCm = "Cm"\n'
)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("Alpha,CL", "AOA,CL", "no heading with Alpha"),
        ("4,0.5,0.03,-0.02", "4,0.5,0.03", "3 cells"),
        ("0.5", "5 x", "'5 x'.*a number"),
        ("4,0.5", ",0.5", "an empty cell of Alpha"),
        ("Alpha,CL,CD,Cm", "Alpha,CL,CD,Cm,CL", "two columns CL"),
    ],
)
def test_a_faulty_table_names_the_line(tmp_path, old, new, message):
    text = GOOD.replace(old, new)
    assert text != GOOD
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(ParseError, match=message):
        read_table(tmp_path / "a.csv", column_map(tmp_path, SMALL))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"alpha [deg]"', '"alpha"', "alpha is an angle or the deflection"),
        ('"alpha [deg]"', '"alpha [kt]"', "alpha: "),
        ('CL = "CL"', 'CL = "CLift"', "'CLift' is not a coefficient"),
        ('CD = "CD"', 'CD = "CL"', "two columns for CL"),
        ('force_axes = "stability"\n', "", "force_axes: missing"),
        ("x = ", "xref = ", "xref: unknown key"),
        ('layout = "runs"', 'layout = "long"', "needs a column"),
    ],
)
def test_a_faulty_column_map_is_refused(tmp_path, old, new, message):
    text = SMALL.replace(old, new)
    assert text != SMALL
    with pytest.raises(SchemaError, match=message):
        column_map(tmp_path, text)


SWEEPS = (
    "alpha,stick,CL,CD,Cm\n"
    "-4,0,-0.3,0.03,0.1\n0,0,0.1,0.03,0.0\n4,0,0.5,0.03,-0.1\n8,0,0.9,0.04,-0.2\n"
    "-3.98,10,-0.198,0.03,-0.1005\n0.02,10,0.202,0.03,-0.2005\n4.02,10,0.602,0.03,-0.3005\n"
)
SWEEP_MAP = (
    'layout = "runs"\n'
    + AXES
    + REFERENCE
    + '[columns]\nalpha = "alpha [deg]"\nstick = "stick [deg]"\n'
    + 'CL = "CL"\nCD = "CD"\nCm = "Cm"\n'
)


@pytest.mark.slow
def test_runs_at_slightly_other_angles_are_interpolated(tmp_path):
    """Angles of a tunnel are never equal: the increment is taken at those of the clean runs."""
    (tmp_path / "runs.csv").write_text(SWEEPS)
    with pytest.warns(AeromatchWarning) as caught:
        db = aerodb.from_estimate(
            aircraft(),
            [tmp_path / "runs.csv"],
            columns=column_map(tmp_path, SWEEP_MAP),
            controls={"stick": "+delta_e"},
        )
    text = " ".join(str(warning.message) for warning in caught)
    # The deflected runs end at 4 deg, the clean ones at 8 deg.
    assert "CL over delta_e: not every deflection reaches alpha 8 deg" in text
    table = aerodb.terms(db)["CL/elevator"]["value"].sel(mach=0.2)
    increment = table.sel(delta_e=10 * DEG, method="nearest")
    np.testing.assert_allclose(increment, 0.1, atol=1e-9)


def test_an_unknown_coefficient_of_a_long_table_names_its_line(tmp_path):
    (tmp_path / "a.csv").write_text("alpha,coefficient,value\n0,CL,0.1\n0,CM,0.0\n")
    lines = LONG.splitlines(True)
    text = "".join(line for line in lines if not line.startswith(("beta", "da", "de", "dr")))
    with pytest.raises(ParseError, match=r"line 3.*'CM'"):
        read_table(tmp_path / "a.csv", column_map(tmp_path, text))


def test_forces_of_other_axes_than_stated_are_refused(tmp_path):
    text = SMALL.replace('force_axes = "stability"', 'force_axes = "body"')
    with pytest.raises(SchemaError, match="force_axes 'body' with CD, CL"):
        column_map(tmp_path, text)


def test_the_heading_of_a_matrix_may_have_other_words(tmp_path):
    text = "alpha\tV40 de=-10 deg\tV40 de=0 deg\tV40 de=10 deg\n0\t0.2\t0.1\t0.0\n"
    (tmp_path / "a.txt").write_text(text)
    numbers = read_table(tmp_path / "a.txt", column_map(tmp_path, MATRIX.format("Cm"))).numbers
    assert sorted(set(np.round(numbers["elevator"] / DEG, 6))) == [-10.0, 0.0, 10.0]


SIMPLE = 'layout = "runs"\n' + AXES + REFERENCE + '[columns]\na = "alpha [deg]"\nCL = "CL"\n'


def test_decimal_commas_between_tabs(tmp_path):
    (tmp_path / "a.txt").write_text("a\tCL\n-4\t-0,106\n4\t0,606\n")
    numbers = read_table(tmp_path / "a.txt", column_map(tmp_path, SIMPLE)).numbers
    assert numbers["value"].tolist() == [-0.106, 0.606]


@pytest.mark.parametrize("mark", ["-999", "9999.0", "-999.99", "99999"])
def test_a_mark_of_a_missing_number_is_refused(tmp_path, mark):
    (tmp_path / "a.csv").write_text(f"a,CL\n-4,{mark}\n4,0.6\n")
    with pytest.raises(ParseError, match=r"line 2: found '.*', a mark of a missing number"):
        read_table(tmp_path / "a.csv", column_map(tmp_path, SIMPLE))
    (tmp_path / "a.csv").write_text("a,CL\n-4,0.999\n9.99,0.6\n")
    assert len(read_table(tmp_path / "a.csv", column_map(tmp_path, SIMPLE)).numbers) == 2

"""Versions of the outputs of VSPAERO: side force, headings of polars."""

import pytest

from aerodb.estimators.reading import read_estimate
from flightmech.errors import ParseError

HEAD = [
    "Beta",
    "Mach",
    "AoA",
    "Re/1e6",
    "CL",
    "CDo",
    "CDi",
    "CDtot",
    "CS",
    "L/D",
    "E",
    "CFx",
    "CFy",
    "CFz",
    "CMx",
    "CMy",
    "CMz",
    "CMl",
    "CMm",
    "CMn",
]
# At 2 deg of sideslip: CS = CFy cos + (CFx cos + CFz sin) sin.
ROW = {
    **{"Beta": 2.0, "Mach": 0.1, "AoA": 4.0, "Re/1e6": 6.0, "CL": 0.5, "CDo": 0.02, "CDi": 0.01},
    **{"CDtot": 0.03, "CS": -0.0137, "L/D": 16.7, "E": 0.9, "CFx": -0.025, "CFy": -0.0141},
    **{"CFz": 0.4995, "CMx": 0.002, "CMy": -0.06, "CMz": -0.001, "CMl": -0.002, "CMm": -0.06},
    "CMn": 0.001,
}
SEVEN = [
    "Beta",
    "Mach",
    "AoA",
    "Re/1e6",
    "CLo",
    "CLi",
    "CLtot",
    "CDo",
    "CDi",
    "CDtot",
    "CSo",
    "CSi",
    "CStot",
    "L/D",
    "E",
    "CMxtot",
    "CMytot",
    "CMztot",
    "CFxtot",
    "CFytot",
    "CFztot",
    "StallFactor",
]


def polar(tmp_path, head, values, before=()):
    rows = [" ".join(head), " ".join(f"{value:.6e}" for value in values)]
    (tmp_path / "a.polar").write_text("\n".join([*before, *rows]) + "\n")
    return read_estimate(tmp_path / "a.polar")


def totals(one):
    return dict(zip(one.numbers["coefficient"], one.numbers["value"]))


EXPECTED = {"CL": 0.5, "CD": 0.03, "CY": -0.0141, "Cl": -0.002, "Cm": -0.06, "Cn": 0.001}


def test_the_side_force_of_a_polar_is_that_of_the_body(tmp_path):
    one = polar(tmp_path, HEAD, [ROW[name] for name in HEAD])
    assert totals(one) == pytest.approx(EXPECTED)


def test_a_heading_may_lack_the_last_column(tmp_path):
    values = [ROW[name] for name in HEAD]
    assert totals(polar(tmp_path, HEAD, [*values, 45.4])) == pytest.approx(EXPECTED)
    assert totals(polar(tmp_path, [*HEAD, "FOpt"], [*values, 45.4])) == pytest.approx(EXPECTED)
    for head, row in ((HEAD, values[:-1]), (HEAD, [*values, 1.0, 2.0])):
        with pytest.raises(ParseError, match="20, as the heading has"):
            polar(tmp_path, head, row)
    with pytest.raises(ParseError, match="21, as the heading has"):
        polar(tmp_path, [*HEAD, "FOpt"], [*values, 45.4, 1.0])


def test_a_polar_of_version_seven(tmp_path):
    row = {**ROW, "StallFactor": 1.0, "CLo": 0.0, "CLi": 0.5, "CSo": 0.0, "CSi": 0.0}
    row |= {f"{name}tot": ROW[name] for name in ("CL", "CS", "CMx", "CMy", "CMz")}
    row |= {f"CF{axis}tot": ROW[f"CF{axis}"] for axis in "xyz"}
    before = ["      Surface Integration Forces -->", "      Surf-Surf-Surf"]
    one = polar(tmp_path, SEVEN, [row[name] for name in SEVEN], before)
    assert totals(one) == pytest.approx(EXPECTED)
    assert set(one.numbers["line"]) == {4}
    with pytest.raises(ParseError, match="line 3: found no column CFytot"):
        polar(tmp_path, SEVEN[:-4], [row[name] for name in SEVEN[:-4]], before)


def test_the_side_force_of_a_stab_file_is_that_of_the_body(tmp_path):
    lines = ["*****", "Sref_ 10 Lunit^2", "Cref_ 1 Lunit", "Bref_ 10 Lunit", "Xcg_ 0.25 Lunit"]
    lines += ["Ycg_ 0 Lunit", "Zcg_ 0 Lunit", "Mach_ 0.1 no_unit", "AoA_ 2 deg", "Beta_ 0 deg"]
    lines += ["Vinf_ 50 Lunit/Tunit", "Case Delta Units CL CD CS", "Base_Aero 0 n/a 0.2 0.03 0"]
    lines += ["Coef Total Alpha Beta p q r Mach U"]
    rows = {"CFy": -0.40, "CS": -0.37, "CL": 0.0, "CD": 0.0, "CMl": -0.1, "CMm": 0.0, "CMn": 0.06}
    lines += [f"{name} 0 0 {slope} 0 0 0 0 0" for name, slope in rows.items()]
    (tmp_path / "a.stab").write_text("\n".join(lines) + "\n")
    numbers = read_estimate(tmp_path / "a.stab").numbers
    slopes = numbers[numbers["variable"] == "beta"].set_index("coefficient")["value"]
    # CS is along the wind axes: its slope is CY_beta + CD
    assert slopes["CY"] == -0.40

"""Prints of Missile DATCOM against their lines."""

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from aerodb.estimators.conventions import forces_to_stability
from aerodb.estimators.reading import read_estimate
from flightmech.errors import ParseError

SHARED = Path(__file__).parents[4] / "shared" / "data" / "estimators" / "missile_datcom"
needs_outputs = pytest.mark.skipif(
    not SHARED.is_dir(), reason="the outputs of other estimators are not here (shared data)"
)
DEG = np.pi / 180.0
NAMES = {
    "CN": ("CZ", "", -1.0),
    "CM": ("Cm", "", 1.0),
    "CNA": ("CZ", "alpha", -1.0 / DEG),
    "CMA": ("Cm", "alpha", 1.0 / DEG),
    "CYB": ("CY", "beta", 1.0 / DEG),
}
PRINT = """1         ***** THE USAF AUTOMATED MISSILE DATCOM * REV 9/02 *****
    ************************* INPUT DATA CARDS *************************
   1  $REFQ XCG=0.8522,SREF=0.0585,LREF=0.273,$
1         ***** THE USAF AUTOMATED MISSILE DATCOM * REV 9/02 *****     CASE   1
                   STATIC AERODYNAMICS FOR BODY-FIN SET 1
     MACH NO  =       0.80                REYNOLDS NO = 2.053E+07 /M
     SIDESLIP =       0.00 DEG                   ROLL =      0.00 DEG
     REF AREA =       .059 M**2         MOMENT CENTER =      .852 M
     REF LENGTH =      .27 M           LAT REF LENGTH =       .27 M

         ALPHA       CN        CM        CA        CY       CLN       CLL

          0.00      .000      .000      .307      .000      .000      .000
          5.00      .407-10000.491      .306      .000      .000    ******
1         ***** THE USAF AUTOMATED MISSILE DATCOM * REV 9/02 *****     CASE   1
                        BODY + 1 FIN SET DYNAMIC DERIVATIVES
     MACH NO  =       0.80                REYNOLDS NO = 2.053E+07 /M
     SIDESLIP =       0.00 DEG                   ROLL =      0.00 DEG
     REF AREA =       .059 M**2         MOMENT CENTER =      .852 M
     REF LENGTH =      .27 M           LAT REF LENGTH =       .27 M
                    ------------ DYNAMIC DERIVATIVES (PER RADIAN) -----------
         ALPHA       CNQ        CMQ        CAQ       CNAD       CMAD
          0.00      0.655     -2.750      0.000      0.339     -0.293
    PITCH RATE DERIVATIVES NON-DIMENSIONALIZED BY Q*LREF/2*V
"""


def find(numbers, coefficient, variable="", **conditions):
    rows = numbers[(numbers["coefficient"] == coefficient) & (numbers["variable"] == variable)]
    for name, value in conditions.items():
        rows = rows[np.isclose(rows[name], value, atol=1e-9)]
    assert len(rows) == 1
    return rows.iloc[0]


def write(tmp_path, text):
    (tmp_path / "for006.dat").write_text(text)
    return tmp_path / "for006.dat"


def test_derivatives_without_their_unit_are_refused(tmp_path):
    """A damaged heading must not make zeros of all derivatives."""
    damaged = PRINT.replace("DERIVATIVES (PER RADIAN)", "DERIVATIVES (PER RAD")
    with pytest.raises(ParseError, match="without a heading that states their unit"):
        read_estimate(write(tmp_path, damaged))


@pytest.mark.slow
@needs_outputs
def test_every_number_is_on_its_line():
    compared = 0
    for row in csv.DictReader((SHARED / "TRUTH.csv").open()):
        if not (match := re.fullmatch(r"(\w+) at (-?\d+) deg", row["quantity"])):
            continue
        coefficient, variable, factor = NAMES[match[1]]
        numbers = read_estimate(SHARED / row["file"]).numbers
        place = {"line": int(row["line"]), "alpha": float(match[2]) * DEG}
        found = find(numbers, coefficient, variable, **place)["value"]
        assert found == pytest.approx(factor * float(row["text_on_that_line"]), rel=1e-12)
        compared += 1
    assert compared == 8


@needs_outputs
def test_reference_quantities_have_the_digits_of_the_cards():
    mk82 = read_estimate(SHARED / "mk82_rev902_for006.dat").reference
    assert (mk82.S, mk82.cbar, mk82.b, mk82.x) == (0.0585, 0.273, 0.273, 0.8522)
    example = read_estimate(SHARED / "example_rev399_for006.dat").reference
    assert pytest.approx(11.045 * 0.3048**2) == example.S
    assert example.x == pytest.approx(18.75 * 0.3048)
    javelin = read_estimate(SHARED / "javelin_rev399_for006.dat").reference
    assert (javelin.S, javelin.cbar, javelin.b) == (1.266768698e-02, 0.05, 0.268)


@needs_outputs
def test_derivatives_per_degree_and_per_radian():
    mk82 = read_estimate(SHARED / "mk82_rev902_for006.dat").numbers
    # Body with fins, page 19; the page of the body alone has -0.676.
    damping = find(mk82, "Cm", "qhat", alpha=0.0)
    assert (damping["line"], damping["value"]) == (762, pytest.approx(-2.750 / DEG))
    javelin = read_estimate(SHARED / "javelin_rev399_for006.dat").numbers
    clean = javelin[(javelin["mach"] == 0.1) & (javelin["line"] < 330)]
    assert find(clean, "Cm", "qhat", alpha=0.0)["value"] == -1839.325
    assert find(clean, "Cn", "rhat", alpha=0.0)["value"] == -71.754
    assert find(clean, "Cm", "alphadothat", alpha=0.0)["value"] == -255.671
    assert sorted(set(javelin["mach"])) == [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]


@needs_outputs
def test_lift_and_drag_of_the_print_follow_from_its_body_axes():
    one = forces_to_stability(read_estimate(SHARED / "mk82_rev902_for006.dat"))
    # Line 642: CL 0.379 and CD 0.340 at 5 deg.
    assert find(one.numbers, "CL", alpha=5 * DEG)["value"] == pytest.approx(0.379, abs=6e-4)
    assert find(one.numbers, "CD", alpha=5 * DEG)["value"] == pytest.approx(0.340, abs=6e-4)


@pytest.mark.slow
@needs_outputs
def test_patterns_of_panel_deflections_are_controls():
    one = read_estimate(SHARED / "javelin_rev399_for006.dat")
    assert one.controls == ("fin2(1,-1,-1,1)", "fin2(1,1,-1,-1)", "fin2(1,1,1,1)")
    for name in one.controls:
        assert sorted(set(one.numbers[name] / DEG)) == pytest.approx([-10.0, -5.0, 0.0])


@needs_outputs
def test_a_trimmed_table_has_its_deflections_and_no_moment():
    one = read_estimate(SHARED / "example_rev399_for006.dat")
    (name,) = one.controls
    assert name == "trim of fin set 2"
    trimmed = one.numbers[one.numbers["line"] == 774]  # alpha 4, delta -3.50
    assert find(trimmed, "CZ")["value"] == -0.822
    assert find(trimmed, "Cm")["value"] == 0.0
    assert find(trimmed, "CZ")[name] == pytest.approx(-3.5 * DEG)
    assert not (one.numbers["line"] == 780).any()  # *NT*: no trim at 28 deg


def test_broken_values_are_left_out_and_stated(tmp_path):
    one = read_estimate(write(tmp_path, PRINT))
    assert one.cautions == ("for006.dat line 14: CLL is not a number and is left out",)
    # Two numbers without a blank between them.
    assert find(one.numbers, "Cm", alpha=5 * DEG)["value"] == -10000.491
    assert find(one.numbers, "CZ", alpha=5 * DEG)["value"] == -0.407
    assert one.reference.S == 0.0585
    assert find(one.numbers, "Cm", "alphadothat")["value"] == -0.293


def test_few_digits_without_a_card_need_reference_quantities(tmp_path):
    one = read_estimate(write(tmp_path, PRINT.replace("LREF=0.273,", "")))
    assert one.reference is None
    assert "REF LENGTH is printed as .27 M, and no card LREF" in one.remarks[1]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("ROLL =      0.00", "ROLL =     45.00", "roll angle of 45 deg.*other axes"),
        ("      .000      .000\n", "      .000\n", "6 numbers under ALPHA CN.*cut off"),
        ("STATIC AERODYNAMICS FOR", "SOMETHING ELSE OF", "no page of static aerodynamics"),
        ("     MACH NO  =       0.80", "", "without MACH NO"),
        (" M**2  ", " KM**2 ", r"'KM\*\*2'.*a unit of M, FT, IN, CM"),
    ],
)
def test_a_faulty_print_is_refused(tmp_path, old, new, message):
    count = -1 if "KM" in new else 1
    text = PRINT.replace(old, new, count)
    assert text != PRINT
    with pytest.raises(ParseError, match=f"(?s){message}"):
        read_estimate(write(tmp_path, text))


def test_deflections_that_are_not_printed_are_not_taken_as_zero(tmp_path):
    text = PRINT.replace(
        "                   STATIC", " $DEFLCT DELTA1=5.,5.,5.,5.$\n                   STATIC"
    )
    with pytest.raises(ParseError, match="without the table PANEL DEFLECTION ANGLES"):
        read_estimate(write(tmp_path, text))

"""Polars and stability logs of XFLR5 and flow5 against their lines."""

import csv
import re
import sys
from pathlib import Path

import numpy as np
import pytest

import aerodb
from aerodb.estimators.build import from_estimate
from aerodb.estimators.effects import EstimateTables
from aerodb.estimators.reading import read_estimate, read_estimates
from flightmech.errors import AeromatchWarning, ParseError, SchemaError

sys.path.insert(0, str(Path(__file__).parent))
from light_aircraft import aircraft

SHARED = Path(__file__).parents[4] / "shared" / "data" / "estimators" / "xflr5"
needs_outputs = pytest.mark.skipif(
    not SHARED.is_dir(), reason="the outputs of other estimators are not here (shared data)"
)
DEG = np.pi / 180.0
POLAR = """xflr5 v6.44

Plane name :        Glider
Polar name :        T5-20.0 m/s-VLM2
Freestream speed :  20.000 m/s


   alpha      Beta       CL          CDi        CDv        CD         CY         Cl         Cm
    2.000     0.000   0.400000   0.006000   0.010000   0.016000   0.000000   0.000000   0.010000
    2.000     5.000   0.399000   0.006000   0.010000   0.016000  -0.030000   0.008000   0.011000
"""
HEAD = (
    " Ctrl      , α (°)      , β (°)      , φ (°)      , CL         , CD         , CD_viscous , "
    "CD_induced , CY         , Cm         , Cm_viscous , Cm_pressure, Cl         , Cn         , "
    "Cn_viscous , Lift (N)"
)


def flow5(row):
    return f"Glider\nT1-20.0 m/s\nFreestream speed = 20.000 m/s\n\n\n{HEAD}\n{row}\n"


FLOW5_ROW = "0, 2, 0, 0, 0.4, 0.016, 0.01, 0.006, 0, 0.01, 0, 0.01, 0.002, -0.003, 0, 9.8"
LOG = """xflr5 v6.47
Type 7 - Stability polar
Density   =       1.225kg/m³
Reference Area   =     0.13953m²
Reference length =      0.8m
      Calculation for control position {position}
    CoG_x=      0.0600 m
    CoG_y=      0.0000 m
    CoG_z=      0.0000 m
{turned}
      Searching for zero-moment angle... Alpha=1.16357°
      Calculating speed to balance the weight...VInf = 8.57402 m/s

      Longitudinal derivatives
      Xw=      0.1091         Cxa=     0.14889
      Zw=     -3.1536         CLa=      4.3039
      Zq=    -0.44812         CLq=      6.9449
      Mw=   -0.081849         Cma=    -0.63425
      Mq=   -0.098813         Cmq=     -8.6951
      Neutral Point position=   0.08595 m

      Lateral derivatives
      Yv=    -0.61866         CYb=    -0.84433
      Yp=    0.011975         CYp=    0.040857
      Yr=     0.26989         CYr=     0.92085
      Lv=   -0.044646         Clb=   -0.076165
      Lp=   -0.090387         Clp=    -0.38549
      Lr=    0.019467         Clr=    0.083026
      Nv=     0.21312         Cnb=     0.36358
      Np=   -0.037193         Cnp=    -0.15862
      Nr=   -0.097294         Cnr=    -0.41495

      Control derivatives
      Xde=   -0.077213        CXde=    -0.01229
      Zde=     -5.8507        CZde=    -0.93128
      Mde=     -1.9823        CMde=     -1.7916

      _____State matrices__________
"""


def find(numbers, coefficient, variable="", line=None):
    rows = numbers[(numbers["coefficient"] == coefficient) & (numbers["variable"] == variable)]
    if line is not None:
        rows = rows[rows["line"] == line]
    assert len(rows) == 1
    return rows.iloc[0]


def write(tmp_path, text, name="a.txt"):
    (tmp_path / name).write_text(text)
    return tmp_path / name


@needs_outputs
def test_every_number_is_on_its_line():
    derivatives = {"CLa": ("CL", "alpha"), "Cma": ("Cm", "alpha"), "Cmq": ("Cm", "qhat")}
    derivatives |= {"Clb": ("Cl", "beta"), "Cnb": ("Cn", "beta")}
    compared = 0
    for row in csv.DictReader((SHARED / "TRUTH.csv").open()):
        name = row["quantity"].split()[0]
        line = int(row["line"])
        if row["file"].startswith("foil") or name not in {"CL", "CD", "Cm", "Cl", *derivatives}:
            continue
        numbers = read_estimate(SHARED / row["file"]).numbers
        value = find(numbers, *derivatives.get(name, (name, "")), line)["value"]
        # Moments of the polar about the axis aft have the opposite sign.
        expected = float(row["text_on_that_line"]) * (-1.0 if name == "Cl" else 1.0)
        assert value == expected
        compared += 1
    assert compared == 13


@needs_outputs
@pytest.mark.parametrize(
    ("file", "S", "b", "cbar", "neutral", "x"),
    [
        ("stability_DesignIteration5.rtf", 0.28093, 1.9924, 0.1410, 0.18776, 0.0599),
        ("stability_2208_originalFin.rtf", 0.406, 2.0, 0.2030, -0.33138, -0.3949),
    ],
)
def test_the_mean_chord_of_a_log_gives_its_neutral_point(file, S, b, cbar, neutral, x):
    one = read_estimate(SHARED / file)
    assert one.unit_stated
    assert (one.reference.S, one.reference.b, one.reference.x) == (S, b, x)
    assert one.reference.cbar == pytest.approx(cbar, abs=5e-5)
    lift = find(one.numbers, "CL", "alpha")["value"]
    moment = find(one.numbers, "Cm", "alpha")["value"]
    # The log prints x_cg - Cma/CLa cbar; x_cg has four decimals.
    assert x - moment / lift * one.reference.cbar == pytest.approx(neutral, abs=1e-4)


@pytest.mark.nightly
@needs_outputs
def test_a_database_of_a_polar_and_a_log():
    files = [SHARED / "DesignIteration1.txt", SHARED / "stability_DesignIteration5.rtf"]
    facts = {"S": 0.28093, "cbar": 0.141, "b": 1.9924, "reference": (-0.0599, 0.0, -0.0065)}
    with pytest.raises(SchemaError, match="state no Mach number"):
        from_estimate(aircraft(**facts), files)
    with pytest.warns(AeromatchWarning):
        db = from_estimate(aircraft(**facts), files, mach=0.06)
    terms = aerodb.terms(db)
    lift = terms["CL/basic"]["value"].isel(mach=0).interp(alpha=5.0 * DEG)
    assert float(lift) == pytest.approx(0.616268)
    assert float(terms["Cm/qhat"]["value"].max()) == pytest.approx(-124.39, rel=2e-4)
    assert float(terms["Cn/beta"]["value"].max()) > 0.0


@needs_outputs
@pytest.mark.parametrize("pattern", ["foil_*.txt", "foil_*.dat", "foil_*.csv"])
def test_a_foil_polar_is_refused_for_what_it_is(pattern):
    files = sorted(SHARED.glob(pattern))
    assert files
    for file in files:
        with pytest.raises(ParseError, match=r"foil section \(2D\).*not those of an aeroplane"):
            read_estimate(file)


def test_signs_of_a_polar_over_sideslip(tmp_path):
    one = read_estimate(write(tmp_path, POLAR))
    assert one.reference is None
    assert not one.inviscid
    assert "wind axes" in one.remarks[1]
    assert find(one.numbers, "Cl", line=10)["value"] == -0.008  # dihedral: the print rolls left up
    # Side force of the stability axes: CY cos(beta) - CD sin(beta).
    side = -0.03 * np.cos(5.0 * DEG) - 0.016 * np.sin(5.0 * DEG)
    assert find(one.numbers, "CY", line=10)["value"] == pytest.approx(side, rel=1e-12)
    csv_text = re.sub(r"(?m)(?<=\S) +(?=\S)", ",", POLAR.partition("\n\n\n")[2])
    again = read_estimate(write(tmp_path, f"xflr5 v6.44\n\n{csv_text}", "a.csv"))
    assert list(again.numbers["value"]) == list(one.numbers["value"])


@pytest.mark.parametrize("moments", ["Cm Rm Ym", "GCm GRm GYm"])
def test_a_polar_of_an_early_version(tmp_path, moments):
    head = f" alpha CL ICd PCd TCd CY {moments} IYm QInf XCP\n ______ ____ ____\n"
    row = " 2.000 0.25 0.003 0.0105 0.0135 0.0 -0.03 0.0 0.0 0.0 20.0 0.12\n"
    text = f"XFLR5_v5.00\n\nWing name : a\nWing polar name : T1-20.0 m/s\n\n{head}{row}"
    one = read_estimate(write(tmp_path, text))
    assert find(one.numbers, "CD")["value"] == 0.0135
    assert find(one.numbers, "Cm")["value"] == -0.03
    assert not one.inviscid
    with pytest.raises(ParseError, match="type 7"):
        read_estimate(write(tmp_path, text.replace("T1-20.0", "T7-20.0").replace("m/s", "")))


def test_a_polar_without_profile_drag_has_no_friction(tmp_path):
    text = POLAR.replace("0.010000   0.016000", "0.000000   0.006000")
    assert read_estimate(write(tmp_path, text)).inviscid


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("T5-20.0", "T7-20.0", "type 7.*fixed controls"),
        ("0.400000", "15.40000", "CL = 15.4.*not converged"),
        ("0.400000", "nan     ", "'nan'.*run has failed"),
        ("   0.010000\n", "\n", "8 numbers; expected 9"),
    ],
)
def test_a_faulty_polar_is_refused(tmp_path, old, new, message):
    text = POLAR.replace(old, new, 1)
    assert text != POLAR
    with pytest.raises(ParseError, match=f"(?s){message}"):
        read_estimate(write(tmp_path, text))


def test_a_polar_that_is_trimmed_throughout_is_refused(tmp_path):
    text = POLAR.replace("0.010000\n", "0.000010\n").replace("0.011000\n", "0.000000\n")
    text = text.replace("    2.000     5.000", "    3.000     0.000")
    with pytest.raises(ParseError, match=r"without a pitching moment.*does not print the deflec"):
        read_estimate(write(tmp_path, text))


def test_a_polar_of_flow5_has_axes_aft_and_up(tmp_path):
    one = read_estimate(write(tmp_path, flow5(FLOW5_ROW)))
    assert one.program == "flow5"
    assert find(one.numbers, "CL")["value"] == 0.4
    assert find(one.numbers, "Cl")["value"] == -0.002
    assert find(one.numbers, "Cn")["value"] == 0.003
    with pytest.raises(ParseError, match=r"sideslip of 3 deg.*version 7\.24"):
        read_estimate(write(tmp_path, flow5(FLOW5_ROW.replace("2, 0, 0", "2, 3, 0", 1))))
    with pytest.raises(ParseError, match="control parameter 1"):
        read_estimate(write(tmp_path, flow5(FLOW5_ROW.replace("0, 2", "1, 2", 1))))


def test_a_yawing_moment_without_sideslip_is_remarked(tmp_path):
    """A file of totals has no derivative to compare it with: 0.05 of usual ones at 5 deg."""
    rows = "\n".join(FLOW5_ROW.replace("0, 2", f"0, {angle}", 1) for angle in (2, 4))
    remarks = []
    for text in (flow5(rows), flow5(rows).replace("0.002, -0.003", "1e-4, -2e-4")):
        tables = EstimateTables(read_estimate(write(tmp_path, text)), mach=0.1)
        tables.effects()
        remarks.append([text for text in tables.remarks if "without sideslip" in text])
    assert [text[:2] for text in remarks[0]] == ["Cl", "Cn"]
    assert "a control is deflected that the file does not state" in remarks[0][0]
    assert remarks[1] == []


def test_a_first_row_at_the_end_of_the_heading_of_flow5_is_read(tmp_path):
    """As exports of 7.57 have it: without its row a polar would begin one angle later."""
    second = FLOW5_ROW.replace("0, 2", "0, 4", 1)
    glued = flow5(second).replace("Lift (N)\n", f"Lift (N)   {FLOW5_ROW}\n")
    numbers = read_estimate(write(tmp_path, glued)).numbers
    assert sorted(set(np.round(numbers["alpha"] / DEG, 6))) == [2.0, 4.0]
    broken = glued.replace(f"   {FLOW5_ROW}", "   0, 2, 0.4")
    with pytest.raises(ParseError, match="line 6: found 3 numbers; expected 14"):
        read_estimate(write(tmp_path, broken))


def test_control_derivatives_of_a_log(tmp_path):
    text = LOG.format(position=" 0.00", turned="")
    one = read_estimate(write(tmp_path, text))
    assert one.controls == ("control",)
    assert find(one.numbers, "Cm", "control")["value"] == -1.7916
    assert find(one.numbers, "CL", "control")["value"] == 0.93128
    assert find(one.numbers, "CD", "control")["value"] == 0.01229
    # Mde = CMde q S cbar with the mean chord that Mq and Zw give.
    force = 0.5 * 1.225 * 8.57402**2 * 0.13953
    assert force * one.reference.cbar * -1.7916 == pytest.approx(-1.9823, rel=1e-3)
    moved = LOG.format(
        position="-10.00", turned="   Rotating the elevator by -1.00°, total angle is -1.00°"
    )
    both = read_estimates([write(tmp_path, text), write(tmp_path, moved, "b.txt")])
    assert sorted(set(both.numbers["control"] / DEG)) == pytest.approx([-1.0, 0.0])


def test_controls_of_flow5_are_per_degree_and_have_names(tmp_path):
    text = LOG.format(position="0", turned="").replace("CLa=      ", "CZa=     -")
    text = text.replace("CLq=      ", "CZq=     -")
    text = text.replace("Control derivatives\n", "Control derivatives\n   Elevator\n")
    one = read_estimate(write(tmp_path, text))
    assert (one.program, one.reference) == ("flow5", None)
    assert find(one.numbers, "CL", "alpha")["value"] == 4.3039
    assert find(one.numbers, "Cm", "Elevator")["value"] == pytest.approx(-1.7916 / DEG)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("Mq=   -0.098813         Cmq=     -8.6951", "", "without Cmq.*cut off"),
        ("0.13953m²", "0.23953m²", "reference area of 0.23953.*two analyses"),
        ("      0.8m", "      0.9m", "reference span of 0.9"),
        ("Alpha=1.16357°", "none found", "1 blocks of derivatives with 0 angles"),
        ("CoG_x=      0.0600 m", "CoG_x= 0.06 m\n CoG_x= 0.07 m", "CoG_x that moves"),
        ("Cnb=     0.36358", "Cnb=     nan", "Cnb = nan.*failed"),
    ],
)
def test_a_faulty_log_is_refused(tmp_path, old, new, message):
    whole = LOG.format(position="0", turned="")
    text = whole.replace(old, new, 1)
    assert text != whole
    with pytest.raises(ParseError, match=f"(?s){message}"):
        read_estimate(write(tmp_path, text))

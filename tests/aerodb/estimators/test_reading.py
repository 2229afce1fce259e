"""Outputs of AVL and VSPAERO against their lines, and against each other."""

import csv
import math
import re
from pathlib import Path

import numpy as np
import pytest

from aerodb.estimators.reading import read_estimate, read_estimates
from flightmech.errors import ParseError, SchemaError

SHARED = Path(__file__).parents[4] / "shared" / "data" / "estimators"
needs_outputs = pytest.mark.skipif(
    not SHARED.is_dir(), reason="the outputs of other estimators are not here (shared data)"
)
DEG = math.pi / 180.0


def find(numbers, coefficient, variable="", **conditions):
    """Return the only number of a coefficient and variable."""
    rows = numbers[(numbers["coefficient"] == coefficient) & (numbers["variable"] == variable)]
    for name, value in conditions.items():
        rows = rows[np.isclose(rows[name], value, atol=1e-9)]
    assert len(rows) == 1
    return rows.iloc[0]


# Quantity of the table of lines: coefficient, variable; per degree for controls.
AVL_NAMES = {
    "CL": ("CL", ""),
    "Cm": ("Cm", ""),
    "Cn'": ("Cn", ""),
    "CLa": ("CL", "alpha"),
    "Cma": ("Cm", "alpha"),
    "Clb": ("Cl", "beta"),
    "Cnb": ("Cn", "beta"),
    "Cmq": ("Cm", "qhat"),
    "Cmd2": ("Cm", "elevator"),
    "Cnd3": ("Cn", "rudder"),
    "Cmd4": ("Cm", "elevator"),
    "Cnd5": ("Cn", "rudder"),
    "Cmw": ("Cm", "w"),
    "Clv": ("Cl", "v"),
    "Cnr": ("Cn", "rhat"),
}


@needs_outputs
def test_every_number_of_avl_is_on_its_line():
    compared = 0
    for row in csv.DictReader((SHARED / "avl" / "TRUTH.csv").open()):
        name = re.match(r"[A-Za-z]\w*'?", row["quantity"])[0]
        if name not in AVL_NAMES or not row["file"].endswith((".st", ".sb", ".ft")):
            continue
        coefficient, variable = AVL_NAMES[name]
        found = find(read_estimate(SHARED / "avl" / row["file"]).numbers, coefficient, variable)
        value = found["value"] * (DEG if re.fullmatch(r"C[a-z]d\d", name) else 1.0)
        assert value == pytest.approx(float(row["text_on_that_line"]), rel=1e-12)
        assert found["line"] == int(row["line"])
        compared += 1
    assert compared >= 15


@needs_outputs
def test_reference_condition_and_controls_of_avl():
    one = read_estimate(SHARED / "avl" / "c182.ctl.st")
    assert (one.reference.S, one.reference.cbar, one.reference.b, one.reference.x) == (
        174.0,
        4.9,
        35.8,
        7.6,
    )
    assert not one.unit_stated
    metric = one.with_units(0.3048).reference
    assert pytest.approx(174.0 * 0.3048**2) == metric.S
    assert metric.x == pytest.approx(7.6 * 0.3048)
    row = find(one.numbers, "CL")
    assert (row["mach"], row["alpha"], row["beta"]) == pytest.approx((0.2, 2 * DEG, 2 * DEG))
    settings = [row[name] / DEG for name in ("aileron", "elevator", "rudder")]
    assert settings == pytest.approx([5.0, -4.0, 3.0])


@needs_outputs
def test_body_and_stability_axes_of_avl_agree():
    """Forces and moments of ``.sb`` turned by alpha are those of ``.st``."""
    alpha = 4.0 * DEG
    body = read_estimate(SHARED / "avl" / "t37.a4.sb").numbers
    stability = read_estimate(SHARED / "avl" / "t37.a4.st").numbers
    sin, cos = math.sin(alpha), math.cos(alpha)

    def in_body(coefficient, variable):
        return find(body, coefficient, variable)["value"]

    lift = find(body, "CX")["value"] * sin - find(body, "CZ")["value"] * cos
    assert lift == pytest.approx(find(stability, "CL")["value"], abs=2e-5)
    roll = in_body("Cl", "v") * cos + in_body("Cn", "v") * sin
    assert roll == pytest.approx(find(stability, "Cl", "beta")["value"], abs=2e-4)
    # At constant speed the velocities of the body are V cos(alpha) and V sin(alpha).
    slope = in_body("Cm", "w") * cos - in_body("Cm", "u") * sin
    assert slope == pytest.approx(find(stability, "Cm", "alpha")["value"], abs=2e-4)
    assert in_body("Cm", "elevator") == find(stability, "Cm", "elevator")["value"]


@needs_outputs
def test_files_of_one_aeroplane_are_joined():
    files = [SHARED / "avl" / f"c182.a{angle}.st" for angle in ("-4", "0", "4", "8")]
    joined = read_estimates(files)
    lift = joined.numbers.query("coefficient == 'CL' and variable == ''")
    assert list(lift["alpha"] / DEG) == pytest.approx([-4.0, 0.0, 4.0, 8.0])
    assert list(lift["file"]) == [file.name for file in files]
    # The derivative of the print is the slope of the totals.
    slope = np.gradient(lift["value"], lift["alpha"])[2]
    assert slope == pytest.approx(
        find(joined.numbers, "CL", "alpha", alpha=4 * DEG)["value"], rel=0.01
    )
    with pytest.raises(SchemaError, match=r"t37\.a0\.st against c182\.a0\.st: EstimateReference"):
        read_estimates([SHARED / "avl" / "c182.a0.st", SHARED / "avl" / "t37.a0.st"])
    with pytest.raises(SchemaError, match="program VSPAERO and AVL"):
        read_estimates([SHARED / "avl" / "c182.a0.st", SHARED / "vspaero" / "c182.stab"])


VSPAERO_NAMES = {
    "CL total": ("CL", ""),
    "CLa": ("CL", "alpha"),
    "Cma": ("Cm", "alpha"),
    "Cmq": ("Cm", "qhat"),
    "Clp": ("Cl", "phat"),
    "Cnb": ("Cn", "beta"),
    "Clb": ("Cl", "beta"),
    "CL at": ("CL", ""),
    "CDtot at": ("CD", ""),
    "Cm per ConGrp_3": ("Cm", "Elev"),
    "Cn per ConGrp_4": ("Cn", "Rud"),
    "CL per ConGrp_1": ("CL", "AilL"),
    "CL per ConGrp_2": ("CL", "AilR"),
    "CL": ("CL", ""),
}


@pytest.mark.slow
@needs_outputs
def test_every_number_of_vspaero_is_on_its_line():
    compared = 0
    for row in csv.DictReader((SHARED / "vspaero" / "TRUTH.csv").open()):
        names = [name for name in VSPAERO_NAMES if row["quantity"].startswith(name)]
        if not names:
            continue
        coefficient, variable = VSPAERO_NAMES[max(names, key=len)]
        numbers = read_estimate(SHARED / "vspaero" / row["file"]).numbers
        at_line = numbers[numbers["line"] == int(row["line"])]
        found = find(at_line, coefficient, variable)
        assert found["value"] == float(row["text_on_that_line"])
        compared += 1
    assert compared >= 19


@needs_outputs
def test_names_of_controls_broken_over_two_lines_are_read():
    one = read_estimate(SHARED / "vspaero" / "c182.stab")
    assert one.controls == ("Aileron", "Elevator", "Rudder")
    assert sorted(set(np.round(one.numbers["alpha"] / DEG, 6))) == [-4.0, 0.0, 4.0, 8.0]
    # The derivative of the print is the step of one degree of the perturbation table.
    row = find(one.numbers, "Cm", "Elevator", alpha=-4 * DEG)
    assert row["value"] == pytest.approx((0.1978499 - 0.2284770) / DEG, rel=1e-5)


@needs_outputs
def test_both_programs_agree_on_the_same_geometry():
    """Moments of VSPAERO have the signs of flight dynamics: damping and stability as in AVL."""
    avl = read_estimate(SHARED / "avl" / "c182.a0.st").numbers
    vsp = read_estimate(SHARED / "vspaero" / "c182.stab").numbers
    for coefficient, variable in (
        ("Cl", "beta"),
        ("Cn", "beta"),
        ("Cl", "phat"),
        ("Cn", "rhat"),
        ("Cm", "qhat"),
        ("Cm", "alpha"),
        ("CY", "beta"),
    ):
        ours = find(avl, coefficient, variable)["value"]
        theirs = find(vsp, coefficient, variable, alpha=0.0)["value"]
        assert ours * theirs > 0.0
        assert abs(theirs / ours - 1.0) < 0.3


@needs_outputs
def test_controls_on_the_same_surface_are_remarked():
    remarks = " ".join(read_estimate(SHARED / "vspaero" / "StratoSurfer_DegenGeom.stab").cautions)
    assert "AilL and AilR are equal and opposite" in remarks
    assert "FlapL" not in remarks


PRINT = """
 Vortex Lattice Output -- Total Forces
  Sref =  10.000       Cref =  1.0000       Bref =  10.000
  Xref =  0.2500       Yref =  0.0000       Zref =  0.0000
 Standard axis orientation,  X fwd, Z down
  Alpha =   2.00000     pb/2V =   0.00000     p'b/2V =   0.00000
  Beta  =   0.00000     qc/2V =   0.00000
  Mach  =     0.100     rb/2V =   0.00000     r'b/2V =   0.00000
  CXtot =   0.00000     Cltot =   0.00000     Cl'tot =   0.00000
  CYtot =   0.00000     Cmtot =  -0.02000
  CZtot =  -0.20000     Cntot =   0.00000     Cn'tot =   0.00000
  CLtot =   0.20000
  CDtot =   0.00500
  CLff  =   0.20000     CDff  =   0.00500    | Trefftz
   flap            =   1.00000
 Stability-axis derivatives...
 z' force CL |    CLa =   5.000000    CLb =   0.000000
 y  mom.  Cm |    Cma =  -0.500000    Cmb =   0.000000
                  flap         d1
 y  mom.  Cm |   Cmd1 =  -0.010000
 Neutral point  Xnp =   0.350000
"""


def test_a_control_of_one_letter_and_a_print_without_other_derivatives(tmp_path):
    (tmp_path / "a.st").write_text(PRINT)
    one = read_estimate(tmp_path / "a.st")
    assert one.controls == ("flap",)
    assert find(one.numbers, "Cm", "flap")["value"] == pytest.approx(-0.01 / DEG)
    assert find(one.numbers, "CL")["flap"] == pytest.approx(DEG)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("Xnp =   0.350000", "Xnp =   0.450000", "0.2000 chords behind Xref.*0.1000 chords"),
        ("CLtot =   0.20000", "CLtot =  15.20000", "CLtot = 15.2.*not converged"),
        ("Cma =  -0.500000", "Cma = **********", r"Cma = \*+.*a number"),
        ("Cma =  -0.500000", "Cma =   Infinity", "Cma = Infinity.*a number"),
        ("X fwd, Z down", "", "axes that are not of the standard orientation|not converged"),
        ("  Cref", "  Cxxx", "no Cref"),
        ("flap         d1", "", "Cmd1 without a name"),
        ("   flap            =   1.00000\n", "", "derivatives of flap without its setting"),
        (" Stability-axis deriv", " Deriv", "moments in body axes .* commands ST, SB or FT"),
        (" Vortex Lattice", " Jet Vortex Lattice", "a print of JVL"),
        ("\n Vortex", "DERMATS\nVERSION 1.0\n Vortex", "for machines .*switch MRF off"),
        (" Standard axis", " Z Symmetry: Ground plane\n Standard axis", "a ground plane"),
        ("Mach  =     0.100", "Mach  =     0.100  Mach = 0.2", "0.1 in line"),
    ],
)
def test_a_faulty_print_of_avl_is_refused(tmp_path, old, new, message):
    text = PRINT.replace(old, new)
    if "standard" in message:
        text = PRINT.replace(" Standard axis orientation,  X fwd, Z down\n", "")
    assert text != PRINT
    (tmp_path / "a.st").write_text(text)
    with pytest.raises(ParseError, match=f"(?s){message}"):
        read_estimate(tmp_path / "a.st")


@needs_outputs
@pytest.mark.parametrize("share", [0.3, 0.55, 0.95])
def test_a_run_of_vspaero_that_was_cut_off_is_refused(tmp_path, share):
    text = (SHARED / "vspaero" / "c182.stab").read_text()
    (tmp_path / "cut.stab").write_text(text[: int(share * len(text))])
    with pytest.raises(ParseError, match=r"cut off|columns of controls|a block"):
        read_estimate(tmp_path / "cut.stab")


@needs_outputs
def test_conditions_of_vspaero_with_different_controls_are_refused(tmp_path):
    lines = (SHARED / "vspaero" / "c182.stab").read_text().splitlines(keepends=True)
    last = max(number for number, line in enumerate(lines) if line.startswith("Aileron"))
    lines[last] = lines[last].replace("Aileron", "Spoiler")
    (tmp_path / "two.stab").write_text("".join(lines))
    with pytest.raises(ParseError, match=r"controls Spoiler Elevator.*those of the block before"):
        read_estimate(tmp_path / "two.stab")


@needs_outputs
@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("aerosandbox/c182_VLM_printed.txt", "dictionary of AeroSandbox.*about the origin"),
        ("aerosandbox/c182_AeroBuildup.json", "dictionary of AeroSandbox as JSON"),
        ("aerosandbox/t37_VLM_wide.csv", "a table of AeroSandbox derivatives"),
        ("aerosandbox/t37_VLM_long.csv", "a table of AeroSandbox derivatives"),
        ("tornado/state.txt", "a state of Tornado, an input"),
        ("tornado/geometry1.txt", "a geometry of Tornado, an input"),
        ("vspaero/c182.vspaero", "a set-up file of VSPAERO"),
        ("avl/c182.avl", "'"),
    ],
)
def test_a_file_of_another_program_is_named(file, name):
    with pytest.raises(ParseError, match=name):
        read_estimate(SHARED / file)


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("****\n# Name\nSref_ 10.0\n\nSolver Case: 1\n", "a history of VSPAERO"),
        ("****\nSref_ 10.0\nCFx_(q + alpha_dot)  0.7\n", r"unsteady run of VSPAERO \(.qstab\)"),
        ("****\nSref_ 10.0\nCFx_(r - beta_dot)  0.7\n", r"unsteady run of VSPAERO \(.rstab\)"),
        (
            " Surface Forces (referred to Sref,Cref,Bref about Xref,Yref,Zref)\n",
            "surface forces of",
        ),
        (
            "AS IS\n   *    USAF STABILITY AND CONTROL  DIGITAL DATCOM    *\n",
            "a listing of Digital",
        ),
    ],
)
def test_other_prints_are_named(tmp_path, text, name):
    (tmp_path / "a.txt").write_text(text)
    with pytest.raises(ParseError, match=name):
        read_estimate(tmp_path / "a.txt")


def test_an_empty_file_is_an_aborted_run(tmp_path):
    (tmp_path / "a.stab").write_text("")
    with pytest.raises(ParseError, match="an empty file"):
        read_estimate(tmp_path / "a.stab")


def test_free_text_of_a_print_is_not_a_number_of_it(tmp_path):
    """Title and name of the run case may contain anything."""
    head = "\n Configuration: Bref = 99.9\n Run case:  Mach = 0.7\n Standard axis"
    (tmp_path / "a.st").write_text(PRINT.replace("\n Standard axis", head))
    one = read_estimate(tmp_path / "a.st")
    assert one.reference.b == 10.0
    assert set(one.numbers["mach"]) == {0.1}


def test_a_long_name_of_a_control_has_its_deflection(tmp_path):
    """The heading of the derivatives has the first twelve characters of a name."""
    text = PRINT.replace("flap            =", "elevator_right  =").replace(
        "flap         d1", "elevator_rig d1"
    )
    (tmp_path / "a.st").write_text(text)
    one = read_estimate(tmp_path / "a.st")
    assert one.controls == ("elevator_right",)
    assert find(one.numbers, "Cm", "elevator_right")["elevator_right"] == pytest.approx(DEG)


@needs_outputs
def test_rates_of_vspaero_are_reduced_by_twice_the_speed(tmp_path):
    """The step of the perturbation table, over p b/2V and q cbar/2V, is the printed derivative."""
    one = read_estimate(SHARED / "vspaero" / "c182.stab")
    speed = 220.1
    # Steps of 1 rad per unit of time in the first block, alpha -4 deg.
    roll = -0.0378673 / (35.8 / (2.0 * speed))
    pitch = (0.0429784 - 0.2284770) / (4.9 / (2.0 * speed))
    assert find(one.numbers, "Cl", "phat", alpha=-4 * DEG)["value"] == pytest.approx(roll, rel=1e-4)
    assert find(one.numbers, "Cm", "qhat", alpha=-4 * DEG)["value"] == pytest.approx(
        pitch, rel=1e-4
    )
    text = (SHARED / "vspaero" / "c182.stab").read_text()
    head, _, rest = text.partition("Pitch_Rate              0.0000000")
    (tmp_path / "turning.stab").write_text(f"{head}Pitch_Rate              2.0000000{rest}")
    turning = read_estimate(tmp_path / "turning.stab").numbers
    at_first = turning[np.isclose(turning["alpha"], -4 * DEG)]
    assert set(at_first["qhat"]) == {2.0 * 4.9 / (2.0 * speed)}


@pytest.mark.parametrize("damage", ["x" * 200_000, "\n" * 200_000], ids=["letters", "blank lines"])
def test_damaged_prints_of_avl_take_no_time_of_the_square_of_their_length(tmp_path, damage):
    """Patterns that begin at each letter, or at each blank line, searched for minutes."""
    text = (Path(__file__).parents[3] / "data" / "avl" / "c182.a4.st").read_text(encoding="utf-8")
    (tmp_path / "a.st").write_text(text.replace("CLtot =", f"CLtot = {damage}"), encoding="utf-8")
    (tmp_path / "b.st").write_text(text + damage, encoding="utf-8")
    for name in ("a.st", "b.st"):
        if "x" in damage:
            with pytest.raises(ParseError, match=r"a line of 2000\d\d letters"):
                read_estimate(tmp_path / name)
    if "x" not in damage:
        same = read_estimate(tmp_path / "b.st")
        assert len(same.numbers) > 10

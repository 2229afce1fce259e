"""Results of Tornado against their lines, and controls that a program did not estimate."""

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from aerodb.estimators.coefficient_set import CoefficientSet, EstimateReference, make_numbers
from aerodb.estimators.effects import EstimateTables
from aerodb.estimators.reading import read_estimate
from flightmech.errors import ParseError

pytestmark = pytest.mark.slow

SHARED = Path(__file__).parents[4] / "shared" / "data" / "estimators"
TORNADO = SHARED / "tornado"
needs_outputs = pytest.mark.skipif(
    not SHARED.is_dir(), reason="the outputs of other estimators are not here (shared data)"
)
# Quantity of the table of lines: coefficient, variable, sign between the axes.
NAMES = {
    "CL": ("CL", "", 1.0),
    "CL_a": ("CL", "alpha", 1.0),
    "Cm_a": ("Cm", "alpha", 1.0),
    "Cn_b": ("Cn", "beta", -1.0),
    "Cl_P": ("Cl", "phat", 1.0),
    "results.Cm_Q": ("Cm", "qhat", 1.0),
    "results.Cm_d(3)": ("Cm", "control3", 1.0),
}


def find(numbers, coefficient, variable=""):
    rows = numbers[(numbers["coefficient"] == coefficient) & (numbers["variable"] == variable)]
    assert len(rows) == 1
    return rows.iloc[0]


@needs_outputs
def test_every_number_is_on_its_line():
    compared = 0
    for row in csv.DictReader((TORNADO / "TRUTH.csv").open()):
        if row["quantity"] not in NAMES or not row["file"].startswith("q1"):
            continue
        coefficient, variable, sign = NAMES[row["quantity"]]
        found = find(read_estimate(TORNADO / row["file"]).numbers, coefficient, variable)
        assert found["value"] == pytest.approx(sign * float(row["text_on_that_line"]), rel=1e-8)
        assert row["line"] in ("-", str(found["line"]))
        compared += 1
    assert compared == 7


@needs_outputs
def test_text_and_mat_file_agree_and_only_the_mat_file_has_pitch_rate():
    text = read_estimate(TORNADO / "q1_Cx_file.txt")
    mat = read_estimate(TORNADO / "q1-Cx.mat")
    for row in text.numbers.itertuples():
        value = find(mat.numbers, row.coefficient, row.variable)["value"]
        assert value == pytest.approx(row.value, abs=6e-7)
    assert "qhat" not in set(text.numbers["variable"])
    assert "repeats the block of the roll rate" in text.remarks[1]
    assert find(mat.numbers, "CL", "qhat")["value"] == pytest.approx(9.46948886790227)
    assert text.reference is None
    assert mat.reference.x == pytest.approx(0.53715251)
    assert mat.unit_stated


@needs_outputs
def test_signs_are_those_of_avl_for_a_like_aeroplane():
    ours = read_estimate(TORNADO / "q1-Cx.mat").numbers
    avl = read_estimate(SHARED / "avl" / "c182.a4.sb").numbers
    pairs = [("CY", "beta"), ("Cl", "beta"), ("Cn", "beta"), ("Cl", "phat"), ("Cn", "phat")]
    pairs += [("CY", "rhat"), ("Cn", "rhat"), ("Cm", "qhat")]
    for coefficient, variable in pairs:
        theirs = find(avl, coefficient, "v" if variable == "beta" else variable)["value"]
        assert find(ours, coefficient, variable)["value"] * theirs > 0.0
    # The local speed of the yaw rate is missing: a twentieth of the value of AVL, 0.096.
    assert find(ours, "Cl", "rhat")["value"] == pytest.approx(0.003578788810434379)
    assert "yaw rate" in read_estimate(TORNADO / "q1-Cx.mat").cautions[0]


@needs_outputs
@pytest.mark.parametrize(("file", "lift"), [("results_2.txt", "19.36"), ("taper_1-Cx.mat", "15.1")])
def test_a_broken_lattice_is_refused(file, lift):
    with pytest.raises(ParseError, match=f"CL = {re.escape(lift)}.*condition number.*is broken"):
        read_estimate(TORNADO / file)


@needs_outputs
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: m.pop("ref"), "without the structure ref"),
        (lambda m: m["results"].pop("Cm"), "no Cm"),
        (lambda m: m["results"].update(Cm_Q=np.nan), r"Cm_Q = \[nan\].*failed"),
        (lambda m: m["results"].update(Cm_d=np.ones(3)), "3 numbers of Cm_d; expected 4"),
        (lambda m: m["state"].update(AS=0.0), "airspeed of 0"),
    ],
)
def test_a_faulty_mat_file_is_refused(tmp_path, change, message):
    content = loadmat(TORNADO / "q1-Cx.mat", simplify_cells=True)
    content = {name: content[name] for name in ("results", "state", "geo", "ref")}
    change(content)
    savemat(tmp_path / "a.mat", content)
    with pytest.raises(ParseError, match=message):
        read_estimate(tmp_path / "a.mat")


@needs_outputs
def test_a_text_export_that_was_cut_off_is_refused(tmp_path):
    text = (TORNADO / "q1_Cx_file.txt").read_text()
    (tmp_path / "a.txt").write_text(text[:900])
    with pytest.raises(ParseError, match=r"no 'Cm'.*cut off"):
        read_estimate(tmp_path / "a.txt")


def _set_with(numbers, controls):
    return CoefficientSet(
        "table",
        ("runs.csv",),
        force_axes="stability",
        moment_axes="stability",
        control_axes="stability",
        reference=EstimateReference(1.0, 1.0, 1.0, 0.0),
        controls=controls,
        numbers=make_numbers(numbers, controls),
        unit_stated=True,
    )


@pytest.mark.nightly
@pytest.mark.parametrize("as_derivative", [True, False])
def test_a_control_of_zeros_is_not_an_estimate_of_zero(as_derivative):
    """AeroSandbox's vortex lattice ignores control surfaces and prints 0 for each of them."""
    rows = []
    for alpha in (0.0, 0.1):
        for coefficient, value in (("CL", 5.0 * alpha), ("CD", 0.02), ("Cm", -alpha)):
            place = {"mach": 0.2, "alpha": alpha, "coefficient": coefficient, "file": "a"}
            place |= {"variable": ""}
            rows.append(place | {"value": value, "line": 1})
            if as_derivative:
                rows.append(place | {"variable": "delta_e", "value": 0.0, "line": 1})
            else:
                rows.append(place | {"delta_e": 0.1, "value": value, "line": 2})
    tables = EstimateTables(_set_with(rows, ("delta_e",)), None)
    assert [effect.name for effect in tables.effects()] == ["basic"]
    assert "delta_e is 0: the program did not estimate it" in tables.remarks[0]
    rows[1 if as_derivative else 5] |= {"value": 0.3}
    tables = EstimateTables(_set_with(rows, ("delta_e",)), None)
    assert [effect.name for effect in tables.effects()] == ["basic", "elevator"]

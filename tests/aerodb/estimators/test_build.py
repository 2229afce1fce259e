"""Databases of outputs of AVL and VSPAERO."""

import json
import sys
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

import aerodb
from aerodb.cli.group import db as group
from aerodb.estimators.build import _complete_drag, from_estimate
from aerodb.estimators.coefficient_set import EstimateReference
from aerodb.prior.prior_errors import PriorErrors
from flightmech.errors import AeromatchWarning, SchemaError

sys.path.insert(0, str(Path(__file__).parent))
from light_aircraft import FOOT, aircraft

SHARED = Path(__file__).parents[4] / "shared" / "data" / "estimators"
AVL, VSPAERO = SHARED / "avl", SHARED / "vspaero"
needs_outputs = pytest.mark.skipif(
    not SHARED.is_dir(), reason="the outputs of other estimators are not here (shared data)"
)
DEG = np.pi / 180.0
CONTROLS = {"elevator": "+delta_e", "aileron": "+delta_a", "rudder": "-delta_r"}
OF_VSPAERO = {"Elevator": "+delta_e", "Aileron": "+delta_a", "Rudder": "-delta_r"}
MORE = {"length_unit": FOOT, "CD0": 0.027}


def sweep(kind):
    return [AVL / f"c182.a{angle}.{kind}" for angle in ("-4", "0", "4", "8")]


def value(db, term, alpha=4.0):
    """Return a table at Mach 0.2 and an angle of attack in degrees."""
    table = aerodb.terms(db)[term]["value"]
    return float(table.sel(mach=0.2).interp(alpha=alpha * DEG))


@pytest.fixture(scope="module")
def of_avl():
    return from_estimate(aircraft(), sweep("st"), controls=CONTROLS, **MORE)


@pytest.mark.slow
@needs_outputs
def test_totals_and_derivatives_are_those_of_the_print(of_avl):
    assert value(of_avl, "CL/basic") == pytest.approx(0.48675, abs=1e-9)
    assert value(of_avl, "CD/basic") == pytest.approx(0.027 + 0.01047, abs=2e-4)
    assert value(of_avl, "Cm/qhat") == pytest.approx(-17.815828)
    assert value(of_avl, "Cm/elevator") == pytest.approx(-0.033890 / DEG)
    # Rudder of the product: trailing edge left, the opposite of the file.
    assert value(of_avl, "CY/rudder") > 0.0
    assert value(of_avl, "Cn/rudder") < 0.0
    assert value(of_avl, "Cl/aileron") < 0.0
    # Body axes: those of the other print of the run.
    assert value(of_avl, "Cl/beta") == pytest.approx(-0.076144, abs=1e-6)
    assert value(of_avl, "Cn/beta") == pytest.approx(0.087830, abs=1e-6)
    assert value(of_avl, "Cn/phat") == pytest.approx(-0.063227, abs=1e-6)
    assert value(of_avl, "Cl/rhat") == pytest.approx(0.096418, abs=1e-6)
    leaf = aerodb.terms(of_avl)["CL/basic"]
    assert leaf["source"].attrs["flag_meanings"].split()[3] == "estimate"
    assert (leaf["source"].sel(mach=0.2) == 3).all()
    assert (leaf["stderr"] > 0.0).all()
    assert aerodb.check(of_avl) == []


@pytest.mark.nightly
@needs_outputs
def test_the_print_in_body_axes_gives_the_same_database(of_avl):
    of_body = from_estimate(aircraft(), sweep("sb"), controls=CONTROLS, **MORE)
    first, second = aerodb.terms(of_avl), aerodb.terms(of_body)
    assert set(first) <= set(second)
    for name, leaf in first.items():
        # The digits of the prints are the limit.
        np.testing.assert_allclose(second[name]["value"], leaf["value"], atol=1e-4, err_msg=name)


@pytest.mark.nightly
@needs_outputs
def test_another_program_on_the_same_geometry_is_near(of_avl):
    other = from_estimate(aircraft(), [VSPAERO / "c182.stab"], controls=OF_VSPAERO, **MORE)
    for name in ("Cm/elevator", "Cl/aileron", "Cn/rudder", "CY/rudder", "Cl/phat", "Cn/rhat"):
        assert value(other, name) / value(of_avl, name) == pytest.approx(1.0, abs=0.25)


@pytest.mark.nightly
@needs_outputs
def test_moments_are_transferred_to_the_reference_of_the_aircraft(of_avl):
    forward = 0.2
    moved = aircraft(reference=(-7.6 * FOOT + forward, 0.0, 0.0))
    with pytest.raises(SchemaError, match=r"0\.13 chords from the moment centre of c182\.a-4\.st"):
        from_estimate(moved, sweep("st"), controls=CONTROLS, **MORE)
    db = from_estimate(moved, sweep("st"), controls=CONTROLS, move_reference=True, **MORE)
    # Lift acts behind the new point: the moment falls by its arm in chords.
    normal = value(of_avl, "CL/basic") * np.cos(4 * DEG) + value(of_avl, "CD/basic") * np.sin(
        4 * DEG
    )
    change = value(db, "Cm/basic") - value(of_avl, "Cm/basic")
    assert change == pytest.approx(-forward / (4.9 * FOOT) * normal, rel=1e-6)


@pytest.mark.nightly
@needs_outputs
def test_what_no_file_states_must_be_given():
    part = {"Elevator": "+delta_e", "Aileron": "+delta_a"}
    with pytest.raises(SchemaError, match=r"length_unit: c182\.stab does not state"):
        from_estimate(aircraft(), [VSPAERO / "c182.stab"], controls=OF_VSPAERO)
    with pytest.raises(SchemaError, match=r"controls\.Rudder: missing"):
        from_estimate(aircraft(), [VSPAERO / "c182.stab"], controls=part, **MORE)
    with pytest.raises(SchemaError, match="found 'delta_e'; expected a sign"):
        from_estimate(aircraft(), sweep("st"), controls=CONTROLS | {"elevator": "delta_e"}, **MORE)
    with pytest.raises(SchemaError, match=r"controls\.flap: the files have no such control"):
        from_estimate(aircraft(), sweep("st"), controls=CONTROLS | {"flap": "+delta_f"}, **MORE)
    with pytest.raises(SchemaError, match="states no reference quantities"):
        from_estimate(aircraft(), [VSPAERO / "c182.polar"], **MORE)
    for key, number in (("CD0", 1e308), ("CD0", -0.02), ("mach", -0.2), ("mach", float("nan"))):
        with pytest.raises(SchemaError, match=f"{key}: found .*; give the"):
            from_estimate(aircraft(), sweep("st"), controls=CONTROLS, **MORE | {key: number})
    # Feet for metres is 3.5 chords.
    with pytest.raises(SchemaError, match="another unit"):
        from_estimate(aircraft(), sweep("st"), controls=CONTROLS, length_unit=1.0)


@needs_outputs
def test_a_polar_needs_its_reference_and_has_friction():
    reference = EstimateReference(174.0 * FOOT**2, 4.9 * FOOT, 35.8 * FOOT, 7.6 * FOOT)
    db = from_estimate(aircraft(), [VSPAERO / "c182.polar"], reference=reference)
    assert value(db, "CD/basic") == pytest.approx(0.01413)
    assert "Cm/qhat" not in aerodb.terms(db)


@pytest.mark.nightly
@needs_outputs
def test_drag_without_friction_and_wrong_signs_are_warned_of():
    wrong = {"Elevator": "-delta_e", "Aileron": "-delta_a", "Rudder": "+delta_r"}
    with pytest.warns(AeromatchWarning) as caught:
        db = from_estimate(aircraft(), [VSPAERO / "c182.stab"], controls=wrong, length_unit=FOOT)
    text = " ".join(str(warning.message) for warning in caught)
    assert "the drag has no friction" in text
    for name in ("Cm/delta_e", "Cl/delta_a", "Cn/delta_r"):
        assert f"{name} = " in text
    assert float(aerodb.terms(db)["CD/basic"]["stderr"].min()) >= 0.03


@needs_outputs
def test_runs_that_contradict_each_other_are_refused(tmp_path):
    text = (AVL / "c182.a4.st").read_text()
    (tmp_path / "again.st").write_text(text.replace("CLtot =   0.48675", "CLtot =   0.49675"))
    with pytest.raises(SchemaError, match=r"CL at Mach 0.2 and alpha 4 deg is 0.48675 and 0.49675"):
        from_estimate(aircraft(), [*sweep("st"), tmp_path / "again.st"], controls=CONTROLS, **MORE)


@pytest.mark.nightly
@needs_outputs
def test_a_left_out_control_and_its_runs_are_not_used():
    controls = CONTROLS | {"rudder": ""}
    db = from_estimate(aircraft(), [*sweep("st"), AVL / "c182.ctl.st"], controls=controls, **MORE)
    assert "Cn/rudder" not in aerodb.terms(db)
    assert aerodb.terms(db)["CL/basic"].sizes["alpha"] == 4


@pytest.mark.nightly
@needs_outputs
def test_the_verbs(tmp_path):
    (tmp_path / "a.toml").write_text(
        'name = "C182"\nS = "174 ft2"\ncbar = "4.9 ft"\nb = "35.8 ft"\n'
        'reference = ["-7.6 ft", 0, 0]\nx_ref_mac = 0.29\nmass = "2280 lb"\nIxx = 2827\n'
        "Iyy = 1913\nIzz = 4169\nIxz = 0\ncg = [0, 0, 0]\n"
    )
    run = CliRunner()
    files = [str(file) for file in sweep("st")]
    words = ["from-estimate", str(tmp_path / "a.toml"), *files, "--length-unit", "ft"]
    words += ["--CD0", "0.027", "-o", str(tmp_path / "x.nc")]
    for name, meaning in CONTROLS.items():
        words += ["--control", f"{name}={meaning}"]
    done = run.invoke(group, words)
    assert done.exit_code == 0, done.output
    assert value(aerodb.open(tmp_path / "x.nc"), "CL/basic") == pytest.approx(0.48675)
    shown = run.invoke(
        group, ["coefficients", files[2], "--json", "-o", str(tmp_path / "numbers.csv")]
    )
    content = json.loads(shown.stdout)
    assert (content["program"], content["reference"]["S"]) == ("AVL", 174.0)
    rows = (tmp_path / "numbers.csv").read_text().splitlines()
    assert len(rows) == 1 + len(content["numbers"])
    plain = run.invoke(group, ["coefficients", files[2]])
    assert "moments and rates in stability axes" in plain.output


@pytest.mark.nightly
@needs_outputs
def test_friction_is_not_added_to_a_drag_that_has_it(tmp_path):
    reference = EstimateReference(174.0 * FOOT**2, 4.9 * FOOT, 35.8 * FOOT, 7.6 * FOOT)
    with pytest.raises(SchemaError, match="has friction; leave CD0 out"):
        from_estimate(aircraft(), [VSPAERO / "c182.polar"], reference=reference, CD0=0.02)
    text = (AVL / "c182.a4.st").read_text().replace("CDvis =   0.00000", "CDvis =   0.02000")
    (tmp_path / "viscous.st").write_text(text)
    with pytest.raises(SchemaError, match="has friction; leave CD0 out"):
        from_estimate(aircraft(), [tmp_path / "viscous.st"], controls=CONTROLS, **MORE)


@needs_outputs
def test_the_absolute_error_of_a_derivative_is_per_radian(of_avl):
    """The figure of a table is that of an increment at a usual deflection of 0.3 rad."""
    leaf = aerodb.terms(of_avl)["Cl/rudder"].sel(mach=0.2)
    absolute = np.sqrt(leaf["stderr"] ** 2 - (0.5 * leaf["value"]) ** 2)
    np.testing.assert_allclose(absolute, 0.002 / 0.3, rtol=1e-6)


@pytest.mark.nightly
@needs_outputs
def test_two_controls_may_exchange_their_names(tmp_path):
    """A control of the file with a name of the product is not taken for the renamed one."""
    names = {"aileron": "delta_e", "elevator": "aileron"}
    files = []
    for file in sweep("st"):
        text = file.read_text().replace("aileron ", "delta_e ").replace("elevator", "aileron ")
        (tmp_path / file.name).write_text(text)
        files.append(tmp_path / file.name)
    controls = {names.get(old, old): meaning for old, meaning in CONTROLS.items()}
    db = from_estimate(aircraft(), files, controls=controls, **MORE)
    assert value(db, "Cm/elevator") == pytest.approx(-0.033890 / DEG)
    assert value(db, "Cl/aileron") < 0.0


@pytest.mark.nightly
@needs_outputs
def test_a_database_of_controls_that_cancel_is_warned_of(tmp_path):
    """The derivatives of the elevator with the opposite sign, as a second group of its surface."""
    text = (VSPAERO / "c182.stab").read_text()
    lines = []
    for line in text.splitlines(keepends=True):
        words = line.split()
        if words and words[0] in ("CL", "CD", "CS", "CMl", "CMm", "CMn") and len(words) == 12:
            # The aileron becomes the counterpart of the elevator.
            words[9] = f"{-float(words[10]):.7f}"
            line = " ".join(words) + "\n"
        lines.append(line)
    (tmp_path / "c.stab").write_text("".join(lines))
    with pytest.warns(AeromatchWarning) as caught:
        from_estimate(aircraft(), [tmp_path / "c.stab"], controls=OF_VSPAERO, **MORE)
    text = " ".join(str(warning.message) for warning in caught)
    assert "Aileron and Elevator are equal and opposite" in text


def test_a_friction_drag_that_no_aeroplane_has():
    one = SimpleNamespace(inviscid=True, files=["c182.st"], program="AVL")
    with pytest.warns(AeromatchWarning, match=r"CD0 = 0.27 is unusual: .* is 0.004 to 0.1"):
        _complete_drag(one, [], PriorErrors(), 0.27)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        _complete_drag(one, [], PriorErrors(), 0.027)

"""The verbs of editing, on a file."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import aerodb
from aerodb.cli.group import db
from flightmech.errors import OutOfRange, UnitError, UnknownName
from flightmech.terms import make_term
from flightmech.units import FOOT


@pytest.fixture
def file(small, tmp_path):
    aerodb.save(small, tmp_path / "small.nc")
    return str(tmp_path / "small.nc")


@pytest.fixture
def output(tmp_path):
    return str(tmp_path / "new.nc")


def run(*arguments):
    return CliRunner().invoke(db, arguments, catch_exceptions=False)


def leaf(path, name):
    return aerodb.terms(aerodb.open(path))[name]


@pytest.mark.slow
def test_scale(file, output):
    options = {"stderr": 0.05, "source": "flight", "note": "run 21"}
    words = [word for key, item in options.items() for word in (f"--{key}", str(item))]
    result = run("edit", file, "scale", "CL/flap", "--by", "1.2", *words, "-o", output)
    assert result.stdout == f"scale: CL/flap by 1.2 +- 0.05 (run 21)\nwritten: {output}\n"
    assert aerodb.open(output).identical(
        aerodb.edit.scale(aerodb.open(file), "CL/flap", 1.2, **options)
    )
    run("edit", file, "scale", "CL/basic", "--by", "1 2", "--over", "alpha=4, 12 deg", "-o", output)
    np.testing.assert_allclose(np.degrees(leaf(output, "CL/basic")["alpha"]), [-8, 0, 4, 8, 12, 16])


def test_shift_takes_negative_numbers_and_states_warnings(file, output):
    result = run("edit", file, "shift", "CL/flap", "--by", "-0.02", "-o", output)
    assert result.exit_code == 0
    assert "warning: shift: 1 nodes of CL/flap were zero by definition" in result.stderr
    np.testing.assert_allclose(leaf(output, "CL/flap")["value"], [-0.02, 0.18, 0.34])


@pytest.mark.slow
def test_regrid_and_extend_take_units(file, output):
    result = run(
        "edit",
        file,
        "regrid",
        "CL/basic",
        "--axis",
        "alpha=-8 16 deg",
        "--axis",
        "mach=0.2 0.4",
        "-o",
        output,
    )
    assert result.stdout.startswith(
        "regrid: CL/basic on alpha 2 for 4 breakpoints, mach 2 for 2 breakpoints, differs by up to "
    )
    with pytest.raises(OutOfRange, match="outside"):
        run("edit", file, "regrid", "CL/basic", "--axis", "alpha=-8 20 deg", "-o", output)
    assert (
        run(
            "edit",
            file,
            "extend",
            "CL/basic",
            "--axis",
            "alpha=20 24 deg",
            "--how",
            "linear",
            "-o",
            output,
        ).exit_code
        == 0
    )
    np.testing.assert_allclose(
        leaf(output, "CL/basic")["value"].isel(mach=0, alpha=-1), 0.2 + 5 * np.radians(24)
    )
    run(
        "edit",
        file,
        "extend",
        "CL/flap",
        "--axis",
        "delta_f=50 deg",
        "--values",
        "0.4",
        "--stderr",
        "0.1",
        "-o",
        output,
    )
    assert float(leaf(output, "CL/flap")["value"][-1]) == 0.4


def test_move_reference_takes_units_and_keeps_the_other_coordinates(file, output):
    assert (
        run("edit", file, "move-reference", "--x", "-9.5 ft", "--z", "0.1", "-o", output).exit_code
        == 0
    )
    attributes = aerodb.open(output).attrs
    assert [float(attributes[key]) for key in ("x_ref", "y_ref", "z_ref")] == [
        -9.5 * FOOT,
        0.0,
        0.1,
    ]


def test_blend_prints_how_well_they_agree(file, output, small, tmp_path):
    other = str(tmp_path / "other.nc")
    aerodb.save(aerodb.edit.scale(small, "CL/qhat", 1.1), other)
    result = run("edit", file, "blend", other, "CL/qhat", "--rule", "correlated", "-o", output)
    assert result.stdout.splitlines()[0] == "blend: CL/qhat with 'small database', correlated"
    assert result.stdout.splitlines()[-1].split()[:2] == ["CL/qhat", "2"]


def test_delete_and_replace(file, output, tmp_path):
    run("edit", file, "delete", "CL/*", "--note", "could not be identified", "-o", output)
    assert list(aerodb.terms(aerodb.open(output))) == ["Cm/qhat"]
    again = str(tmp_path / "again.nc")
    assert (
        "replace_terms: added CL/flap"
        in run("edit", output, "replace", file, "CL/flap", "-o", again).stdout
    )
    np.testing.assert_array_equal(leaf(again, "CL/flap")["value"], leaf(file, "CL/flap")["value"])


@pytest.mark.nightly
def test_history_previous_forget(file, output, small, tmp_path):
    back = str(tmp_path / "back.nc")
    run("edit", file, "scale", "CL/flap", "--by", "2", "-o", output)
    run("edit", output, "scale", "CL/flap", "--by", "3", "--note", "again", "-o", output)
    lines = [line.strip() for line in run("history", output).stdout.splitlines()]
    assert lines == [
        "edit  what was done",
        "by hand",
        "1  scale: CL/flap by 2",
        "2  scale: CL/flap by 3 (again)",
    ]
    rows = json.loads(run("history", output, "--json").stdout)
    assert rows[2] == {
        "line": 3,
        "edit": 2,
        "verb": "scale",
        "terms": "CL/flap",
        "note": "again",
        "text": "scale: CL/flap by 3 (again)",
    }
    assert rows[0]["edit"] is None
    assert run("previous", output, "--steps", "2", "-o", back).stdout == f"written: {back}\n"
    assert aerodb.open(back).identical(small)
    run("previous", output, "--edit", "2", "-o", back)
    np.testing.assert_allclose(leaf(back, "CL/flap")["value"], [0.0, 0.4, 0.72])
    run("forget", output, "-o", back)
    assert "previous" not in aerodb.open(back).children
    with pytest.raises(OutOfRange):
        run("previous", back, "-o", output)


def test_set(file, output):
    result = run(
        "edit",
        file,
        "set",
        "CL/basic",
        "--at",
        "alpha=8 deg",
        "--at",
        "mach=0.4",
        "--value",
        "-0.5",
        "--note",
        "run 7",
        "-o",
        output,
    )
    wanted = aerodb.edit.set_nodes(
        aerodb.open(file), "CL/basic", {"alpha": np.radians(8.0), "mach": 0.4}, -0.5, note="run 7"
    )
    assert aerodb.open(output).identical(wanted)
    assert result.stdout == f"{wanted.attrs['history'].splitlines()[-1]}\nwritten: {output}\n"
    for places in (("--at", "alpha=0 8 deg"), ("--at", "alpha=0 deg", "--at", "alpha=8 deg")):
        result = run("edit", file, "set", "CL/basic", *places, "--value", "1", "-o", output)
        assert result.exit_code == 2
        assert "give one breakpoint for each axis" in result.output


def test_bad_arguments(file, output):
    assert run("edit", file, "regrid", "CL/basic", "--axis", "alpha", "-o", output).exit_code == 2
    with pytest.raises(UnknownName, match="unknown quantity 'alfa'; near it: alpha"):
        run("edit", file, "regrid", "CL/basic", "--axis", "alfa=1 deg", "-o", output)
    with pytest.raises(UnitError, match="unit 'kg' cannot be converted to 'rad'"):
        run("edit", file, "regrid", "CL/basic", "--axis", "alpha=1 2 kg", "-o", output)
    with pytest.raises(UnitError, match="expected numbers and a unit such as"):
        run("edit", file, "regrid", "CL/basic", "--axis", "alpha=low high", "-o", output)
    with pytest.raises(UnitError, match="cannot be converted to 'm'"):
        run("edit", file, "move-reference", "--x", "3 deg", "-o", output)
    assert run("edit", file, "scale", "CL/flap", "--by", "2", "-o", "/nowhere/x.nc").exit_code == 2


def test_a_reference_point_far_away_is_stated(file, output):
    """A point behind the datum is negative; its sign is often forgotten."""
    x = float(aerodb.open(file).attrs["x_ref"])
    result = run("edit", file, "move-reference", "--x", f"{-x}", "-o", output)
    assert result.exit_code == 0
    assert "the moment reference point moves by" in result.stderr
    assert "check the sign" in result.stderr
    near = run("edit", file, "move-reference", "--x", f"{x + 0.1}", "-o", output)
    assert "moves by" not in near.stderr


@pytest.fixture
def plain(root, tmp_path):
    """Return a file with the lift and the elevator of an ordinary light aeroplane."""
    alpha, delta = np.radians([-4.0, 0.0, 8.0]), np.radians([-20.0, 0.0, 15.0])
    leaves = {
        "CL/basic": make_term(0.2 + 4.9 * alpha, {"alpha": alpha}, stderr=0.01),
        "Cm/basic": make_term(0.02 - 0.7 * alpha, {"alpha": alpha}, stderr=0.01),
        "Cm/elevator": make_term(-1.2 * delta, {"delta_e": delta}, stderr=0.01),
    }
    aerodb.save(aerodb.make_database(leaves, **{**root, "absent": ""}), tmp_path / "plain.nc")
    return str(tmp_path / "plain.nc")


def test_an_edit_that_makes_a_database_implausible_states_it(plain, output):
    turned = run("edit", plain, "scale", "Cm/elevator", "--by", "-1", "-o", output)
    assert "warning: Cm/delta_e = 1.2 is implausible" in turned.stderr
    again = run("edit", output, "scale", "CL/basic", "--by", "1.01", "-o", plain)
    assert "implausible" not in again.stderr


def test_a_database_of_another_span_is_not_sound_for_an_aircraft(plain, tmp_path):
    text = 'name = "other"\nS = 16.0\ncbar = 1.5\nb = 1.1\nmass = 1000.0\n'
    (tmp_path / "a.toml").write_text(f"{text}Ixx = 1000.0\nIyy = 2000.0\nIzz = 2500.0\n")
    result = run("check", plain, "--aircraft", str(tmp_path / "a.toml"))
    assert result.exit_code == 1
    assert "not of this aircraft" in result.stdout
    assert "in the database and 1.1 in the aircraft; they must agree" in result.stdout


def test_degrees_as_breakpoints_without_a_unit_are_refused(file, output):
    words = ("CL/basic", "--axis", "alpha=20", "-o", output)
    for verb in ("extend", "regrid"):
        result = run("edit", file, verb, *words)
        assert result.exit_code == 2
        assert "is 20 deg meant? write '20 deg', or '20 rad' if it is right" in result.stderr


def test_breakpoints_with_a_unit_are_taken_as_they_are(file, output):
    """Tables of the whole envelope reach 180 deg, and hypersonic ones Mach 20."""
    words = ("extend", "CL/basic", "--how", "hold", "-o", output)
    assert run("edit", file, *words, "--axis", "alpha=100 180 deg").exit_code == 0
    assert float(leaf(output, "CL/basic")["alpha"][-1]) == pytest.approx(np.pi)
    assert run("edit", file, *words, "--axis", "alpha=1.75 rad").exit_code == 0
    assert run("edit", file, *words, "--axis", "mach=5.5 8").exit_code == 0
    assert "'1.75 rad' if it is right" in run("edit", file, *words, "--axis", "alpha=1.75").stderr

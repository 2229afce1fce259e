"""``aeromatch db export`` and ``aeromatch db import``."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

import aerodb
from aerodb.cli.group import db
from aerodb.edit.ground_effect import in_ground_effect
from aerodb.exchange.formats import recognise_format
from flightmech import terms
from flightmech.errors import ParseError
from flightmech.units import DEGREE


@pytest.fixture
def file(small, tmp_path):
    aerodb.save(small, tmp_path / "small.nc")
    return str(tmp_path / "small.nc")


def run(*arguments):
    return CliRunner().invoke(db, arguments, catch_exceptions=False)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("fmt", "name"), [("netcdf", "x.h5"), ("matlab", "x.mat"), ("csv", "x"), ("daveml", "x.dml")]
)
def test_export_and_import_recognise_the_format(small, file, tmp_path, fmt, name):
    place, back = str(tmp_path / name), str(tmp_path / "back.nc")
    assert run("export", file, "--to", fmt, "-o", place).stdout == f"written: {place}\n"
    found = run("import", place, "-o", back)
    assert found.stdout.splitlines()[0] == "small database"
    assert found.stdout.splitlines()[-1] == f"{fmt}: written {back}"
    assert list(aerodb.terms(aerodb.open(back))) == list(aerodb.terms(small))
    if fmt != "daveml":
        xr.testing.assert_identical(aerodb.open(back), small)


def test_a_formula_over_the_height_is_exported_as_a_table(small, tmp_path):
    closed = in_ground_effect(
        terms.make_term(0.8, regressors=["alpha"], stderr=0.01), 0.6, -1.45, 2.0
    )
    aerodb.save(aerodb.replace_terms(small, {"CL/ground": closed}), tmp_path / "ground.nc")
    done = run(
        "export",
        str(tmp_path / "ground.nc"),
        "--to",
        "daveml",
        "-o",
        str(tmp_path / "x.dml"),
        "--height",
        "50 m",
    )
    assert done.exit_code == 0, done.output
    assert "1 terms with a formula over the height are written as tables up to 50 m" in done.stderr
    back = aerodb.terms(aerodb.exchange.import_daveml(tmp_path / "x.dml"))["CL/ground"]
    at = {"alpha": 0.1, "h_agl": np.array([1.0, 2.0, 3.7, 11.0, 50.0])}
    np.testing.assert_allclose(
        terms.evaluate_term(back, at, outside="clamp"), terms.evaluate_term(closed, at), rtol=1e-3
    )
    done = run(
        "export",
        str(tmp_path / "ground.nc"),
        "--to",
        "csv",
        "-o",
        str(tmp_path / "x"),
        "--height",
        "50 m",
    )
    assert done.exit_code == 2
    assert "--height belongs to jsbsim and daveml; leave it out for csv" in done.stderr


@pytest.mark.slow
def test_answers_for_programs(file, tmp_path):
    place = str(tmp_path / "x.mat")
    assert json.loads(run("export", file, "--to", "matlab", "-o", place, "--json").stdout) == {
        "file": place,
        "format": "matlab",
    }
    found = json.loads(run("import", place, "-o", str(tmp_path / "back.nc"), "--json").stdout)
    assert found["format"] == "matlab"
    assert [row["term"] for row in found["terms"]] == ["CL/basic", "CL/qhat", "CL/flap", "Cm/qhat"]


def test_check_cases_take_count_and_seed(small, file, tmp_path):
    place = tmp_path / "cases.csv"
    run("export", file, "--to", "checkcases", "-o", str(place), "--count", "7", "--seed", "2")
    aerodb.exchange.export_checkcases(small, tmp_path / "same.csv", count=7, seed=2)
    assert place.read_bytes() == (tmp_path / "same.csv").read_bytes()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--to", "jsbsim"), "--to jsbsim needs --aircraft"),
        (("--to", "csv", "--count", "3"), "--count belongs to checkcases; leave it out for csv"),
        (("--to", "xlsx"), "'xlsx' is not one of"),
    ],
)
def test_options_that_do_not_fit_are_reported(file, tmp_path, arguments, message):
    found = run("export", file, *arguments, "-o", str(tmp_path / "x"))
    assert found.exit_code == 2
    assert message in found.stderr
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(
    ("content", "fmt"),
    [
        (b"\x89HDF\r\n\x1a\n...", "netcdf"),
        (b"MATLAB 5.0 MAT-file", "matlab"),
        (
            b'<?xml version="1.0"?>\n<!-- > --><?a b?>\n<!DOCTYPE DAVEfunc SYSTEM "x" [ '
            b'<!ENTITY a "b"> ]>\n<DAVEfunc>',
            "daveml",
        ),
        (b'\xef\xbb\xbf<fdm_config name="x">', "jsbsim"),
        (b'<d:DAVEfunc xmlns:d="http://daveml.org/2010/DAVEML">', "daveml"),
    ],
)
def test_the_content_decides_the_format(tmp_path, content, fmt):
    (tmp_path / "x").write_bytes(content)
    assert recognise_format(tmp_path / "x") == fmt


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"", "the bytes b''"),
        (b"a,b\n", "the bytes b'a,b"),
        (b"<html>", "the XML element 'html'"),
        (b"<!-- " + b"x" * 70_000, "the bytes b'<!-- x"),
    ],
)
def test_what_is_unknown_is_shown(tmp_path, content, found):
    (tmp_path / "x").write_bytes(content)
    with pytest.raises(ParseError, match=f"found {found}.*expected a database"):
        recognise_format(tmp_path / "x")
    with pytest.raises(ParseError, match=r"a folder without index\.csv"):
        recognise_format(tmp_path)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--without", "CL"], "--without belongs to jsbsim and daveml; leave it out for netcdf"),
        (["--travel", "delta_f=40 deg"], "--travel belongs to jsbsim; leave it out for netcdf"),
    ],
)
def test_options_of_another_format_are_refused(file, tmp_path, options, message):
    found = run("import", file, "-o", str(tmp_path / "back.nc"), *options)
    assert found.exit_code == 2
    assert message in found.output


@pytest.mark.slow
def test_the_t37_of_jsbsim_on_the_command_line(tmp_path):
    jsbsim = pytest.importorskip("jsbsim", reason="jsbsim is not installed: pip install jsbsim")
    place = Path(jsbsim.get_default_root_dir()) / "aircraft" / "T37" / "T37.xml"
    written = tmp_path / "t37.nc"
    run(
        "import",
        str(place),
        "--travel",
        "delta_f=40 deg",
        "--without",
        "aero/coefficient/DCnbDf",
        "-o",
        str(written),
    )
    whole = aerodb.exchange.import_jsbsim(place, travel={"delta_f": 40 * DEGREE})
    assert set(aerodb.terms(whole)) > set(aerodb.terms(aerodb.open(written)))

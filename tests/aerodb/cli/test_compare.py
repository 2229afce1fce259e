import json

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

import aerodb
from aerodb.cli.group import db
from aerodb.figures import figure_folder
from flightmech import terms
from flightmech.errors import SchemaError, UnknownName


@pytest.fixture
def files(small, tmp_path):
    """Return the files of the small database and of one with other flaps and pitch damping."""
    flap = aerodb.terms(small)["CL/flap"]
    other = aerodb.replace_terms(small, {"CL/flap": flap.assign(value=flap["value"] * 1.5)})
    other = aerodb.replace_terms(other, {"Cm/qhat": terms.make_term(-50.0, regressors=["qhat"])})
    aerodb.save(small, tmp_path / "prior.nc")
    aerodb.save(other, tmp_path / "final.nc")
    return str(tmp_path / "prior.nc"), str(tmp_path / "final.nc")


@pytest.fixture
def path(tmp_path):
    states = {
        name: ("time", np.full(3, value))
        for name, value in {"mach": 0.3, "alpha": 0.0, "delta_f": np.radians(40.0)}.items()
    }
    xr.Dataset({**states, "qhat": ("time", [0.0, 0.01, 0.0])}, {"time": [0.0, 1.0, 2.0]}).to_netcdf(
        tmp_path / "path.nc", group="states", engine="h5netcdf"
    )
    return str(tmp_path / "path.nc")


def run(*arguments):
    return CliRunner().invoke(db, arguments, catch_exceptions=False)


def row(text, name):
    return next(line for line in text.splitlines() if line.startswith(f"{name} ")).split()


def test_terms_and_coefficients_are_printed(files):
    text = run("compare", *files).stdout
    assert row(text, "CL/flap")[1:] == [
        "both",
        "0.18",
        "0.36",
        "0.54",
        "0.1189",
        "2.57",
        "2.57",
        "1.82",
        "delta_f",
        "40",
        "deg",
    ]
    assert row(text, "Cm/qhat")[1:6] == ["both", "-33", "-17", "-50", "33"]
    assert row(text, "CL")[1:3] == ["both", "0.18"]
    assert "no difference: CL/basic CL/qhat" in text
    assert "grid of Cm: qhat -0.005 ... 0.005 (2)" in text


def test_one_json_document(files):
    found = json.loads(run("compare", *files, "--json").stdout)
    rows = {row["term"]: row for row in found["rows"]}
    assert rows["Cm/qhat"]["max_difference"] == -33.0
    assert rows["Cm/qhat"]["max_in_stderr"] is None
    assert rows["CL/basic"]["max_difference"] == 0.0
    assert found["grid"]["Cm"] == "qhat -0.005 ... 0.005 (2)"
    assert found["figures"] == []


@pytest.mark.slow
def test_one_coefficient_only(files):
    assert "Cm" not in run("compare", *files, "--coefficient", "CL").stdout
    with pytest.raises(UnknownName, match="unknown coefficient 'CN'"):
        run("compare", *files, "--coefficient", "CN")


@pytest.mark.slow
def test_along_a_flight_the_shares_are_printed(files, path):
    text = run("compare", *files, "--along", path).stdout
    assert row(text, "Cm/qhat")[1:] == [
        *("both", "-0.33", "-0.17", "-0.5", "0.1905", "100.0", "%", "0"),
        *("time", "1", "s:", "qhat", "0.01"),
    ]
    assert "compared over 3 samples" in text
    assert json.loads(run("compare", *files, "--along", path, "--json").stdout)["along"] == path


@pytest.mark.nightly
def test_figures_of_what_differs(files, path, tmp_path):
    folder = tmp_path / "figures"
    text = run("compare", *files, "--along", path, "--figures", str(folder)).stdout
    assert sorted(file.name for file in folder.iterdir()) == [
        "lift-flap.svg",
        "lift.svg",
        "pitch.svg",
    ]
    assert "written: 3 figures in" in text
    assert not list(tmp_path.glob(".*.part"))
    with pytest.raises(SchemaError, match="is there and not empty; name a new folder"):
        run("compare", *files, "--figures", str(folder))


@pytest.mark.nightly
def test_two_axis_terms_get_a_map(small, tmp_path):
    leaf = aerodb.terms(small)["CL/basic"]
    databases = {
        "a": small,
        "b": aerodb.replace_terms(small, {"CL/basic": leaf.assign(value=leaf["value"] * 1.1)}),
    }
    made = aerodb.figures.write_comparison(
        databases, tmp_path / "figures", "png", coefficients=["CL"]
    )
    assert [file.name for file in made] == ["lift.png", "lift-basic.png", "lift-basic-map.png"]
    assert all(file.read_bytes().startswith(b"\x89PNG") for file in made)


@pytest.mark.slow
def test_a_folder_appears_atomically(files, tmp_path, monkeypatch):
    calls = []

    def failing(figure, file):
        calls.append(file)
        if len(calls) == 2:
            raise OSError("disk full")
        file.write_text("figure")

    monkeypatch.setattr(figure_folder, "save_figure", failing)
    with pytest.raises(OSError, match="disk full"):
        run("compare", *files, "--figures", str(tmp_path / "figures"))
    assert sorted(file.name for file in tmp_path.iterdir()) == ["final.nc", "prior.nc"]


def test_what_cannot_be_compared_is_stated(small, tmp_path):
    with pytest.raises(SchemaError, match="1 database came; give two or more"):
        aerodb.figures.write_comparison({"a": small}, tmp_path / "x")
    with pytest.raises(SchemaError, match="the format is 'bmp'; allowed: svg, png, pdf"):
        aerodb.figures.write_comparison({"a": small, "b": small}, tmp_path / "x", "bmp")


@pytest.mark.nightly
def test_plot_of_one_term(files, path, tmp_path):
    target = tmp_path / "lift.svg"
    arguments = (
        "plot",
        files[0],
        "--term",
        "CL",
        "--family",
        "delta_f",
        "--at",
        "mach=0.4",
        "--at",
        "qhat=0",
        "--along",
        path,
    )
    assert run(*arguments, "-o", str(target)).stdout == f"written: {target}\n"
    assert target.read_text().startswith("<?xml")
    with pytest.raises(
        SchemaError, match="found 'mach'; give NAME=VALUE, such as delta_f='40 deg'"
    ):
        run("plot", files[0], "--term", "CL", "--at", "mach", "-o", str(target))
    with pytest.raises(UnknownName, match="unknown term 'CL/flop'"):
        run("plot", files[0], "--term", "CL/flop", "-o", str(target))


def test_databases_of_one_name_are_distinguished_by_their_folders(files, small, tmp_path):
    from aerodb.cli.actions.compare import _labels

    assert list(_labels(*files)) == ["prior", "final"]
    assert list(_labels("one/db.nc", "two/db.nc")) == ["one/db", "two/db"]
    assert list(_labels("db.nc", "db.nc")) == ["a", "b"]

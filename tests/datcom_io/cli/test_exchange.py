"""The verbs for other programs' files, and show and convert on them."""

import json
import sys
from pathlib import Path

import pytest
import xarray as xr

from aeromatch.cli.command import main

DATA = Path(__file__).parents[3] / "data" / "t37" / "datcom"
CORPUS = Path(__file__).parents[3] / ".." / "shared" / "data" / "datcom"
CASCADE = CORPUS / "save_cascade" / "save_cascade"
needs_corpus = pytest.mark.skipif(
    not CORPUS.is_dir(), reason="needs the corpus ../shared/data/datcom"
)


@pytest.fixture
def run(monkeypatch, capsys):
    """Return a call of the command line in this process: exit code, stdout, stderr."""

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["aeromatch", "datcom", *map(str, words)])
        with pytest.raises(SystemExit) as caught:
            main()
        return (caught.value.code, *capsys.readouterr())

    return call


@pytest.mark.nightly
def test_export_show_convert(mat_files_in_this_process, run, tmp_path):
    code, out, _ = run("export", DATA / "t37_build.out", "-o", tmp_path / "t37.mat")
    assert code == 0
    assert "left out:\n  velocity, pressure" in out
    assert "  T-37 OWN DECK COMPONENT BUILD-UP: leaf section" in out
    code, out, _ = run("show", tmp_path / "t37.mat", "--json")
    rows = {row["leaf"]: row for row in json.loads(out)["leaves"]}
    assert rows["static"]["sizes"] == {"condition": 4, "alpha": 19, "configuration": 10}
    assert rows["static"]["case"] == "T-37 OWN DECK COMPONENT BUILD-UP"
    assert run("convert", tmp_path / "t37.mat", "-o", tmp_path / "t37.nc")[0] == 0
    with xr.open_datatree(tmp_path / "t37.nc", engine="h5netcdf") as tree:
        assert tree["T-37 OWN DECK COMPONENT BUILD-UP/static"]["CL"].size == 760


def test_export_as_json(run, tmp_path):
    code, out, _ = run("export", DATA / "t37_clean.out", "-o", tmp_path / "t37.mat", "--json")
    assert code == 0
    assert json.loads(out)["cases"] == ["T-37 OWN DECK CLEAN AIRCRAFT"]


@needs_corpus
def test_plot_shows_both_kinds(run):
    code, out, _ = run("plot", f"{CASCADE}.for013")
    assert code == 0
    assert "condition 1 alpha 4 configuration 10" in out
    assert "372  blank 21 NA 6 NDM 1" in out
    code, out, _ = run("show", f"{CASCADE}.for014")
    assert code == 0
    assert "run 10 alpha 4" in out


@pytest.mark.slow
@needs_corpus
@pytest.mark.nightly
def test_plot_gives_its_digits_to_the_listing(run, tmp_path):
    code, out, _ = run(
        "plot",
        f"{CASCADE}.for013",
        "--listing",
        f"{CASCADE}.out",
        "-o",
        tmp_path / "fine.nc",
        "--json",
    )
    assert code == 0
    refined = json.loads(out)["refined"]
    assert list(refined) == ["case 6"]
    assert refined["case 6"]["static"]["CD"] == "37 of 40 numbers"
    with xr.open_datatree(tmp_path / "fine.nc", engine="h5netcdf") as tree:
        assert float(tree["case 6/static"]["CD"][0, 0, 0]) == pytest.approx(7.136e-03, rel=1e-12)
        assert len(tree.children) == 6


@needs_corpus
def test_plot_of_another_run(run):
    code, _, err = run("plot", f"{CASCADE}.for013", "--listing", DATA / "t37_clean.out")
    assert code == 2
    assert "cases in the plot file: 1; cases with card PLOT in the listing: 0" in err
    code, _, err = run("plot", DATA / "t37_clean.out")
    assert code == 2
    assert "is not a plot file" in err


def test_csv_needs_its_unit(run, tmp_path):
    path = tmp_path / "own.csv"
    path.write_text("Alpha, Clb\n0.0, -.1000E-02\n2.0, -.2000E-02\n")
    code, _, err = run("convert", path, "-o", tmp_path / "own.nc")
    assert code == 2
    assert "give card DERIV of its deck: --deriv DEG or RAD" in err
    assert run("convert", path, "-o", tmp_path / "own.nc", "--deriv", "RAD")[0] == 0
    with xr.open_datatree(tmp_path / "own.nc", engine="h5netcdf") as tree:
        assert tree["static"]["Cl_beta"].values.tolist() == [-0.001, -0.002]
    assert run("show", path)[0] == 0

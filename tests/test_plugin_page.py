"""The package of the page on own formats works as the page states."""

import tomllib
from pathlib import Path

from click.testing import CliRunner
from test_docs import blocks

import aerodb
from aeromatch.cli.command import cli
from flightmech.terms import make_term

PAGE = Path(__file__).parents[1] / "docs" / "how-to" / "add-a-format.md"


def test_the_package_of_the_page_adds_its_formats(tmp_path, add_distribution) -> None:
    files = {block.title: block.text for block in blocks(PAGE) if block.title}
    project = tomllib.loads(files["pyproject.toml"])["project"]
    modules = {"company_formats": files["company_formats.py"]}
    add_distribution(project["name"], project["entry-points"], **modules)
    recording = tmp_path / "run_7.host"
    recording.write_text("#HOST RECORDER 2\ntime;V_cas;theta\n0.0;100.0;2.0\n0.1;101.0;2.5\n")
    shown = CliRunner().invoke(cli, ["flight", "show", str(recording)], catch_exceptions=False)
    assert "V_cas" in shown.stdout
    assert shown.exit_code == 0
    tree = aerodb.make_database(
        {"Cm/qhat": make_term(-15.0, regressors=["qhat"])},
        **{"title": "x", "aircraft": "x", "S": 16.0, "cbar": 1.6, "b": 10.0, "source": "x"},
        **{"x_ref": 0.0, "y_ref": 0.0, "z_ref": 0.0, "force_axes": "stability", "history": "x"},
    )
    aerodb.save(tree, tmp_path / "x.nc")
    arguments = ["db", "export", str(tmp_path / "x.nc"), "--to", "list", "-o"]
    written = CliRunner().invoke(cli, [*arguments, str(tmp_path / "x.txt")], catch_exceptions=False)
    assert written.exit_code == 0, written.output
    assert (tmp_path / "x.txt").read_text() == "Cm/qhat 1 nodes\n"

"""Notebooks of the documentation run from top to bottom and show tables and figures; results show
themselves in HTML.
"""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from docs_results import NOTEBOOK, NOTEBOOK_WARNINGS, UAV_NOTEBOOK

import datcom_io
import flightmech
from aeromatch.cli.actions.examples import example_folder
from flightmech.errors import IdentificationError
from flightmech.support.figures import html_table
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress

# code that runs behind the last cell
CHECKS_BEHIND = {"light-aircraft": NOTEBOOK, "uav-log": UAV_NOTEBOOK}
NOTEBOOKS = sorted((Path(__file__).parents[1] / "docs" / "tutorials").glob("*.ipynb"))


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_notebook_runs_and_every_cell_shows_its_result(file, tmp_path, monkeypatch):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1]))
    from recorders import px4_flight

    px4_flight.write(tmp_path / "log.ulg")
    notebook = nbformat.read(file, as_version=4)
    notebook.cells.append(nbformat.v4.new_code_cell(CHECKS_BEHIND[file.stem]))
    nbclient.NotebookClient(notebook, timeout=3000, kernel_name="python3").execute()
    for cell in notebook.cells[:-1]:
        if cell.cell_type == "code":
            (shown,) = [output for output in cell.outputs if output.output_type == "execute_result"]
            assert {"text/html", "image/png"} & set(shown.data), cell.source
            errors = [
                output.text
                for output in cell.outputs
                if output.output_type == "stream" and output.name == "stderr"
            ]
            assert [
                text for text in errors if not any(word in text for word in NOTEBOOK_WARNINGS)
            ] == [], cell.source


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_notebooks_are_kept_with_tables_and_figures(file):
    """`python docs/scripts/make_notebooks.py` runs them and keeps what does not change by
    itself.
    """
    text = file.read_text(encoding="utf-8")
    figures = 0
    for cell in json.loads(text)["cells"]:
        if cell["cell_type"] != "code":
            continue
        (output,) = cell["outputs"]
        assert output["output_type"] == "execute_result", cell["source"]
        assert {"text/html", "image/png"} & set(output["data"]), cell["source"]
        assert (cell["execution_count"], output["execution_count"]) == (None, None)
        figures += "image/png" in output["data"]
    assert figures >= 2
    assert len(text) < 400_000
    assert not re.search(r"/(home|root|tmp|work|Users)/", text)


def test_texts_of_a_table_are_escaped():
    shown = html_table("a < b", ("x",), [("<script>",), (np.float64(0.123456789),)], ["c > d"])
    assert "<b>a &lt; b</b>" in shown
    assert "&lt;script&gt;" in shown
    assert "0.12346" in shown
    assert "<p>c &gt; d</p>" in shown


def test_listing_and_aircraft_show_themselves():
    listing = datcom_io.read(example_folder("c182") / "datcom" / "clean.out")._repr_html_()
    assert "LIGHT HIGH-WING AIRCRAFT CLEAN AIRCRAFT" in listing
    assert "0.1 ... 0.2" in listing
    aircraft = flightmech.read_aircraft(example_folder("c182") / "aircraft.toml")._repr_html_()
    assert "16.165" in aircraft
    assert "without landing gear" in aircraft


def test_a_fit_shows_itself():
    pytest.importorskip("matplotlib")
    rng = np.random.default_rng(1)
    data = xr.Dataset(
        {"alpha": ("time", rng.normal(0.0, 0.1, 200))}, {"time": 0.02 * np.arange(200)}
    )
    data["CL"] = 0.3 + 5.0 * data["alpha"] + xr.DataArray(rng.normal(0.0, 0.01, 200), dims="time")
    fit = regress(
        RegressionModel.parse("CL = 1 + alpha"),
        [data, data.assign_coords(time=data["time"] + 50.0)],
        name="twice",
    )
    assert "<td" in fit._repr_html_()
    assert "twice: CL = 1 + alpha" in fit._repr_html_()
    upper, lower = fit.plot().axes
    measured, fitted = (line.get_ydata() for line in upper.lines[:2])
    np.testing.assert_allclose(measured - fitted, lower.lines[0].get_ydata(), atol=1e-12)
    along = upper.lines[0].get_xdata()
    np.testing.assert_allclose(np.diff(along), 0.02)  # the pause between the manoeuvres is left out
    assert upper.lines[2].get_xdata()[0] == along[200]
    with pytest.raises(IdentificationError, match="no samples"):
        type(fit)("", fit.model, fit.estimates, xr.Dataset(), fit.design, fit.regressors).plot()

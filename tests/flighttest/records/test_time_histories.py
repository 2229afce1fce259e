"""Time histories as figures: what is drawn, in which unit, with which marks; the verb ``flight
plot``.
"""

import json

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from click.testing import CliRunner

from flightmech.errors import OutOfRange, SchemaError, UnknownName
from flightmech.names import quantity_attributes
from flightmech.units import DEGREE
from flighttest.cli.group import flight
from flighttest.records.files import save_record
from flighttest.records.manoeuvre_table import with_manoeuvres
from flighttest.records.time_histories import (
    break_at_gaps,
    chosen_panels,
    record_figure,
    signals_figure,
    states_figure,
)
from flighttest.regression.equation_error.fit_file import save_fit
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress

pytest.importorskip("matplotlib")
MARKS = pd.DataFrame(
    {
        "manoeuvre": ["doublet", "trim"],
        "control": ["elevator", ""],
        "start": [2.0, 20.0],
        "end": [6.0, 28.0],
        "note": ["", ""],
    }
)


def leaf(time: np.ndarray, **columns: np.ndarray) -> xr.Dataset:
    data = {name: ("time", values, quantity_attributes(name)) for name, values in columns.items()}
    return xr.Dataset(
        data,
        {"time": ("time", time, quantity_attributes("time"))},
        {"rate": 1.0 / (time[1] - time[0]), "flags": "[]"},
    )


@pytest.fixture
def record() -> xr.DataTree:
    fast, slow = np.arange(0.0, 30.0, 0.02), np.arange(0.0, 30.0, 0.5)
    imu = leaf(fast, q=0.1 * np.sin(fast), p=np.zeros_like(fast), theta=0.05 + 0.02 * np.sin(fast))
    tree = {
        "/imu": imu,
        "/controls": leaf(slow, delta_e=-0.04 + 0.0 * slow),
        "/air_data": leaf(slow, V=80.0 + slow),
    }
    return with_manoeuvres(
        xr.DataTree.from_dict({"/": xr.Dataset(attrs={"title": "Run 1"}), **tree}), MARKS
    )


def drawn(figure) -> dict[str, np.ndarray]:
    """Return the finite ordinates of every line by its label."""
    lines = [line for ax in figure.axes for line in ax.get_lines()]
    return {str(line.get_label()): np.asarray(line.get_ydata(), float) for line in lines}


def shades(ax) -> list[tuple[float, float]]:
    return [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in ax.patches]


def test_the_page_has_motion_left_and_controls_right_in_display_units(record):
    figure = record_figure(record, marks=MARKS)
    lines = drawn(figure)
    assert list(lines) == ["V", "delta_e", "theta", "p [deg/s]", "q [deg/s]"]
    np.testing.assert_allclose(lines["delta_e"], -0.04 / DEGREE)
    np.testing.assert_allclose(lines["V"][0], 80.0 / 0.514444, rtol=1e-5)
    assert figure.get_suptitle() == "Run 1"
    on = [ax for ax in figure.axes if ax.axison]
    assert all(shades(ax) == [(2.0, 6.0), (20.0, 28.0)] for ax in on)
    assert (
        figure.get_supxlabel()
        == "1\N{NO-BREAK SPACE}doublet\N{NO-BREAK SPACE}elevator   2\N{NO-BREAK SPACE}trim"
    )


def test_chosen_channels_have_a_panel_each_and_a_window_cuts_signals_and_marks(record):
    figure = record_figure(record, ["q", "delta_e"], MARKS, window=(0.0, 10.0))
    assert list(drawn(figure)) == ["q", "delta_e"]
    assert figure.axes[0].get_xlim() == (0.0, 10.0)
    assert len(drawn(figure)["q"]) == 501
    assert shades(figure.axes[1]) == [(2.0, 6.0)]


def test_a_control_at_rest_does_not_fill_its_panel(record):
    low, high = record_figure(record, ["delta_e"]).axes[0].get_ylim()
    assert high - low == pytest.approx(0.5)
    assert (low + high) / 2.0 == pytest.approx(-0.04 / DEGREE)


def test_wrong_channels_and_windows(record):
    with pytest.raises(
        UnknownName, match=r"unknown channel 'delta_r'; .*there are q, p, theta, delta_e, V"
    ):
        record_figure(record, ["delta_r"])
    with pytest.raises(
        OutOfRange, match=r"no sample between 40 and 50 s; the signals go from 0 to 29\.98 s"
    ):
        record_figure(record, window=(40.0, 50.0))


def test_corrected_quantities_stand_for_recorded_ones():
    names = ["alpha", "alpha_vane", "h", "h_gps", "delta_e"]
    assert chosen_panels(names) == [["h"], ["delta_e"], ["alpha"], []]
    assert chosen_panels(["alpha_vane", "h_gps"]) == [["h_gps"], ["alpha_vane"]]
    assert chosen_panels(["mass", "x_cg_b"]) == [["mass"], ["x_cg_b"]]


def test_no_line_crosses_a_gap():
    time, values = break_at_gaps(
        np.array([0.0, 1.0, 2.0, 3.0, 20.0, 21.0]), np.array([1.0, np.nan, 2.0, 3.0, 4.0, 5.0])
    )
    np.testing.assert_array_equal(time, [0.0, 2.0, 3.0, np.nan, 20.0, 21.0])
    np.testing.assert_array_equal(values, [1.0, 2.0, 3.0, np.nan, 4.0, 5.0])


def test_states_have_a_band_of_two_standard_errors():
    time = np.arange(0.0, 10.0, 0.1)
    states = leaf(time, V=80.0 + 0.0 * time, alpha=0.1 + 0.0 * time)
    errors = xr.Dataset(
        {"alpha": (("error", "time"), np.outer([0.003, 0.004], np.ones_like(time)))}, {"time": time}
    )
    figure = states_figure(states, ["alpha"], errors=errors)
    band = figure.axes[0].collections[0].get_paths()[0].vertices[:, 1]
    assert [band.min(), band.max()] == pytest.approx([0.09 / DEGREE, 0.11 / DEGREE])


def call(*arguments) -> dict:
    done = CliRunner().invoke(
        flight, ["plot", *map(str, arguments), "--json"], catch_exceptions=False
    )
    assert done.exit_code == 0, done.output
    return json.loads(done.output)


@pytest.mark.nightly
def test_the_verb_draws_records_and_tables_of_manoeuvres(record, tmp_path):
    save_record(record, tmp_path / "run.nc")
    stated = call(tmp_path / "run.nc", "-o", tmp_path / "run.svg")
    assert (stated["of"], [row["manoeuvre"] for row in stated["manoeuvres"]]) == (
        "record",
        ["doublet", "trim"],
    )
    assert "doublet" in (tmp_path / "run.svg").read_text(encoding="utf-8")
    (tmp_path / "m.csv").write_text(
        "record,kind,control,start,end\nrun,3211,rudder,1,2\nother,trim,,3,4\n"
    )
    assert [
        row["manoeuvre"]
        for row in call(
            tmp_path / "run.nc",
            "--channel",
            "q",
            "--table",
            tmp_path / "m.csv",
            "-o",
            tmp_path / "a.png",
        )["manoeuvres"]
    ] == ["3211"]
    other = call(
        tmp_path / "run.nc",
        "--channel",
        "q",
        "--table",
        tmp_path / "m.csv",
        "--record",
        "other",
        "-o",
        tmp_path / "a.pdf",
    )
    assert [row["manoeuvre"] for row in other["manoeuvres"]] == ["trim"]
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "a.pdf").read_bytes().startswith(b"%PDF")
    with pytest.raises(UnknownName, match="name one with --record"):
        call(
            tmp_path / "run.nc",
            "--table",
            tmp_path / "m.csv",
            "--record",
            "third",
            "-o",
            tmp_path / "b.png",
        )
    with pytest.raises(SchemaError, match="give one of png, svg, pdf"):
        call(tmp_path / "run.nc", "-o", tmp_path / "b.gif")
    assert not (tmp_path / "b.png").exists()


@pytest.mark.slow
def test_the_verb_draws_paths_with_their_manoeuvres(record, tmp_path):
    time = np.arange(0.0, 30.0, 0.02)
    states = leaf(time, V=80.0 + 0.0 * time, q=0.1 * np.sin(time)).assign_attrs(
        record="Run 1", manoeuvres=record.attrs["manoeuvres"]
    )
    xr.DataTree.from_dict({"/states": states}).to_netcdf(tmp_path / "path.nc", engine="h5netcdf")
    stated = call(tmp_path / "path.nc", "--channel", "q", "-o", tmp_path / "path.svg")
    assert (stated["of"], len(stated["manoeuvres"])) == ("path", 2)


@pytest.mark.nightly
def test_the_verb_draws_fits(tmp_path):
    alpha = np.linspace(0.0, 0.2, 50) + 0.01 * np.sin(np.arange(50.0))
    data = xr.Dataset(
        {
            "CL": ("time", 0.2 + 5.0 * alpha + 1e-3 * np.cos(np.arange(50.0))),
            "alpha": ("time", alpha),
        },
        {"time": np.arange(50.0) / 50.0},
    )
    save_fit(regress(RegressionModel.parse("CL = 1 + alpha"), data), tmp_path / "cl.nc")
    assert call(tmp_path / "cl.nc", "-o", tmp_path / "cl.png")["of"] == "fit"
    with pytest.raises(SchemaError, match="--channel goes with a record or a path"):
        call(tmp_path / "cl.nc", "--channel", "CL", "-o", tmp_path / "cl2.png")


@pytest.mark.nightly
def test_residuals_of_several_manoeuvres_share_a_panel_for_each_output(tmp_path):
    time = np.arange(0.0, 5.0, 0.1)
    rests = [leaf(time + 10.0 * k, q=0.01 * np.sin(time), alpha=0.0 * time) for k in range(2)]
    figure = signals_figure(
        "Residuals", [[rest[name] for rest in rests] for name in ("q", "alpha")]
    )
    assert [len(ax.get_lines()) for ax in figure.axes] == [2, 2]
    assert figure.axes[0].get_xlim() == pytest.approx((0.0, 14.9))
    groups = {
        "/": xr.Dataset(attrs={"content": "output error"}),
        "/estimates": xr.Dataset(),
        "/noise": xr.Dataset(),
    }
    tree = xr.DataTree.from_dict({**groups, "/residuals/1": rests[0], "/residuals/2": rests[1]})
    tree.to_netcdf(tmp_path / "oe.nc", engine="h5netcdf")
    assert call(tmp_path / "oe.nc", "-o", tmp_path / "oe.png")["of"] == "output-error fit"

"""Models on records that they have not used: figures of simulated records, and the command."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parent))
from test_motion_fit import SHORT, V, lateral, short_period

import flighttest
from flightmech.errors import SchemaError
from flighttest.cli.group import flight
from flighttest.maximum_likelihood.linear.motion_fit import fit_motion
from flighttest.maximum_likelihood.linear.motion_prediction import predict_motion
from flighttest.maximum_likelihood.result import open_output_error, save_output_error
from flighttest.maximum_likelihood.validation import (
    ALL,
    WINDOWS,
    PredictedChannel,
    ValidationWindow,
    figures_of,
    validate_models,
)
from flighttest.regression.uncertainty.prediction_errors import r_squared, theil


@pytest.fixture(scope="module")
def motion():
    return fit_motion([short_period(1)], "short-period").fit


def regress(model, data, **more):
    return flighttest.regress(flighttest.RegressionModel.parse(model), data, **more)


def coefficients(seed, slope=-0.6, size=1.0):
    """A pitching moment with two terms, and noise of a hundredth."""
    rng = np.random.default_rng(seed)
    t = np.arange(400) * 0.02
    alpha, q = 0.05 * size * np.sin(3.0 * t), 0.02 * size * np.cos(2.0 * t + seed)
    Cm = 0.01 + slope * alpha - 8.0 * q + 3e-4 * rng.standard_normal(len(t))
    columns = {"alpha": alpha, "qhat": q, "Cm": Cm}
    return xr.Dataset({name: ("time", x) for name, x in columns.items()}, {"time": t})


def test_derivatives_predict_another_record(motion, tmp_path):
    """The residual is the noise of the instruments, from a file too; wrong derivatives are seen."""
    other = short_period(7, elevator=-0.02)
    file = tmp_path / "oe.nc"
    save_output_error(motion, file)
    found = predict_motion(open_output_error(file), other)
    for name, noise in {"alpha": 2e-3, "q": 2e-3, "az": 0.1}.items():
        error = found.measured[name].values - found.predicted[name].values
        assert 0.85 * noise < error.std() < 1.2 * noise
    assert found.remarks == ()
    values = motion.estimates["estimate"].copy()
    values.loc[{"parameter": "M_alpha"}] = 0.5 * SHORT["M_alpha"]
    wrong = replace(motion, estimates=motion.estimates.assign(estimate=values))
    bad = predict_motion(wrong, other)
    assert (bad.measured["q"] - bad.predicted["q"]).std() > 2.5 * 2e-3


def test_conditions_of_a_prediction_are_stated(motion):
    fast = short_period(3).assign(V=lambda data: data["V"] * 1.2)
    (text,) = predict_motion(motion, fast).remarks
    assert text.startswith(f"V is {1.2 * V:.1f} m/s, that of the fit {V:.1f} m/s")
    bare = replace(motion, estimates=motion.estimates.copy())
    del bare.estimates.attrs["motion"]
    with pytest.raises(SchemaError, match="flight fit-linear"):
        predict_motion(bare, fast)


def test_figures_of_windows():
    rng = np.random.default_rng(2)
    z = [rng.standard_normal(50), 3.0 + 2.0 * rng.standard_normal(80)]
    y = [one + 0.1 * rng.standard_normal(len(one)) for one in z]
    parts = [PredictedChannel("q", "1", a, b) for a, b in zip(z, y, strict=True)]
    assert figures_of(parts[:1])["R2"] == pytest.approx(r_squared(z[0], y[0]), rel=1e-12)
    both = figures_of(parts)
    # each window about its own mean: the step between them is no motion
    motion = sum(((one - one.mean()) ** 2).sum() for one in z)
    error = sum(((a - b) ** 2).sum() for a, b in zip(z, y, strict=True))
    assert both["R2"] == pytest.approx(1.0 - error / motion, rel=1e-12)
    assert both["theil"] == pytest.approx(theil(np.concatenate(z), np.concatenate(y)), rel=1e-12)
    assert both["samples"] == 130
    assert "R2" not in figures_of([PredictedChannel("q", "1", np.ones(5), np.ones(5))])


def test_a_window_of_the_fit_validates_nothing():
    """It has a remark, and is not in the figure of the model; neither is what cannot be predicted."""
    first, second = coefficients(1), coefficients(2)
    good = regress("Cm = 1 + alpha + qhat", first)
    poor = regress("Cm = 1 + alpha", second)
    lacking = second.drop_vars("qhat")
    pieces = [ValidationWindow("a", first), ValidationWindow("b", second)]
    board = validate_models({"good": good, "poor": poor}, pieces)
    rows = board.rows.set_index(["model", "window"])
    assert rows.loc[("good", "a 0-7.98 s"), "remarks"].startswith("in the fit: 400 samples")
    assert rows.loc[("good", ALL), "R2"] == rows.loc[("good", "b 0-7.98 s"), "R2"] > 0.99
    assert rows.loc[("poor", ALL), "R2"] == rows.loc[("poor", "a 0-7.98 s"), "R2"] < 0.9
    summary = board.summary.set_index("model")
    assert summary.loc["good", "R2"] > summary.loc["poor", "R2"]
    assert list(summary["parameters"]) == [3, 2]
    none = validate_models({"good": good}, [ValidationWindow("c", lacking)]).rows.iloc[0]
    assert none["remarks"].startswith("no figure: ")
    assert "qhat" in none["remarks"]
    only = validate_models({"good": good}, pieces[:1])
    assert np.isnan(only.summary.iloc[0]["R2"])


def test_extrapolation_and_separate_constants_are_stated():
    fit = regress("Cm = 1 + alpha + qhat", [coefficients(1), coefficients(2)],
                             intercepts="separate")  # fmt: skip
    row = validate_models({"m": fit}, [ValidationWindow("b", coefficients(5, size=2.0))]).rows.iloc[
        0
    ]
    assert "outside" in row["remarks"]
    assert "its constant is taken from the window" in row["remarks"]
    assert row["parameters"] == 2
    assert row["R2"] > 0.99


def test_motion_and_regression_on_one_board(motion, tmp_path):
    used = short_period(1)
    motion.estimates.attrs[WINDOWS] = json.dumps([["a", 0.0, 16.0]])
    pieces = [ValidationWindow("a", used), ValidationWindow("b", short_period(9))]
    board = validate_models({"oe": motion}, pieces)
    total = board.rows[board.rows["window"] == ALL].set_index("channel")
    assert list(total.index) == ["alpha", "q", "az"]
    assert (total["samples"] == 400).all()
    assert board.summary.iloc[0]["R2"] == total["R2"].min()
    text = board.report()
    assert "in the fit: 400 samples" in text
    assert (
        validate_models({"oe": fit_motion([lateral(1)], "lateral").fit}, pieces[:1])
        .rows.iloc[0]["remarks"]
        .startswith("no figure")
    )


@pytest.mark.slow
def test_the_command(tmp_path):
    """Paths of two names with windows of their own; the file names the windows that were used."""
    for name, seed in (("a", 1), ("b", 9)):
        short_period(seed).to_netcdf(tmp_path / f"{name}.nc", engine="h5netcdf")
    words = ["fit-linear", str(tmp_path / "a.nc"), str(tmp_path / "b.nc"), "--motion",
             "short-period", "--window-of", "a", "0", "15.96", "--window-of", "b", "0", "8",
             "-o", str(tmp_path / "oe.nc")]  # fmt: skip
    done = CliRunner().invoke(flight, words, catch_exceptions=False)
    assert done.exit_code in (0, 1), done.output
    used = json.loads(open_output_error(tmp_path / "oe.nc").estimates.attrs[WINDOWS])
    assert [(name, start) for name, start, _ in used] == [("a", 0.0), ("b", 0.0)]
    assert used[1][2] == pytest.approx(8.0, abs=0.05)
    done = CliRunner().invoke(flight, ["fit-linear", str(tmp_path / "a.nc"), "--motion",
                                       "short-period", "--window-of", "c", "0", "8"])  # fmt: skip
    assert done.exit_code != 0

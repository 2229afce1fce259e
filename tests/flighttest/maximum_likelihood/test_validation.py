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
from flighttest.maximum_likelihood.validating.used_windows import (
    WINDOWS,
    ValidationWindow,
    digest_states,
    state_windows,
)
from flighttest.maximum_likelihood.validating.validation import (
    ALL,
    PredictedChannel,
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


@pytest.mark.nightly
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


def test_a_run_that_diverges_has_no_figures(motion, monkeypatch):
    """The samples before the overflow would give the figures of a good model."""
    record = short_period(3)
    found = predict_motion(motion, record)
    predicted = found.predicted.copy(deep=True)
    predicted["q"][-5:] = np.inf
    lost = found._replace(predicted=predicted)
    monkeypatch.setattr(
        "flighttest.maximum_likelihood.validating.predicted_channels.predict_motion",
        lambda model, data: lost,
    )
    board = validate_models({"model": motion}, [ValidationWindow("other", record)])
    (row,) = board.rows.to_dict("records")
    assert "no figure: the run diverges: q has no value in 5 of" in row["remarks"]


def test_a_window_of_the_fit_validates_nothing():
    """It has a remark, and is not in the figure of the model; neither is what cannot be
    predicted.
    """
    first, second = coefficients(1), coefficients(2)
    pieces = [ValidationWindow("a", first), ValidationWindow("b", second)]
    good = state_windows(regress("Cm = 1 + alpha + qhat", first), pieces[:1])
    poor = state_windows(regress("Cm = 1 + alpha", second), pieces[1:])
    lacking = second.drop_vars("qhat")
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


def test_data_of_the_fit_in_another_form_are_not_unseen():
    """Another low-pass, aircraft file or reconstruction changes all values, not name and times."""
    data = coefficients(1)
    again = data.assign(Cm=data["Cm"] + 1e-9, alpha=data["alpha"] * 1.001)
    fit = regress("Cm = 1 + alpha + qhat", data)
    named = state_windows(fit, [ValidationWindow("a", data, "hash")])
    for record, digest in (("a", ""), ("copy", "hash"), ("a", "another")):
        board = validate_models({"m": named}, [ValidationWindow(record, again, digest)])
        assert board.rows.iloc[0]["remarks"].startswith("in the fit: 400 samples")
        assert np.isnan(board.summary.iloc[0]["R2"])
    assert validate_models({"m": named}, [ValidationWindow("b", again)]).summary.iloc[0]["R2"] > 0.9
    # without names the times decide: the window may be that of the fit
    board = validate_models({"m": fit}, [ValidationWindow("a", again)])
    text = board.rows.iloc[0]["remarks"]
    assert text.startswith("windows of the fit not known: 400 samples of the window have times")
    assert board.summary.iloc[0]["windows"] == "0 of 1"
    later = again.assign_coords(time=again["time"] + 100.0)
    board = validate_models({"m": fit}, [ValidationWindow("a", later)])
    assert "not known" in board.rows.iloc[0]["remarks"]
    assert board.summary.iloc[0]["R2"] > 0.9


@pytest.mark.nightly
def test_output_error_without_its_windows_has_no_figure(motion, tmp_path):
    save_output_error(motion, tmp_path / "oe.nc")
    fit = open_output_error(tmp_path / "oe.nc")
    board = validate_models({"oe": fit}, [ValidationWindow("a", short_period(1))])
    assert board.rows["remarks"].str.startswith("windows of the fit not known").sum() == 3
    assert np.isnan(board.summary.iloc[0]["R2"])


def test_models_are_ranked_over_the_windows_that_count_for_all():
    """The model with the easier windows has the larger R2, and the other one predicts better."""
    pieces = [ValidationWindow(name, coefficients(k)) for k, name in enumerate("abc", start=1)]
    noisy = pieces[1].data["Cm"] + 0.05 * np.sin(40.0 * pieces[1].data["time"])
    pieces[1] = pieces[1]._replace(data=pieces[1].data.assign(Cm=noisy))
    good = regress("Cm = 1 + alpha + qhat", pieces[0].data)
    wrong = good.estimates["estimate"] * xr.DataArray([1.0, 1.0, 0.95], dims="term")
    poor = replace(good, estimates=good.estimates.assign(estimate=wrong))
    models = {"poor": state_windows(poor, pieces[:2]), "good": state_windows(good, pieces[:1])}
    board = validate_models(models, pieces)
    summary = board.summary.set_index("model")
    assert summary.loc["poor", "R2"] > summary.loc["good", "R2"]
    assert summary.loc["good", "common"] > summary.loc["poor", "common"]
    assert list(summary["windows"]) == ["1 of 3", "2 of 3"]
    rows = board.rows.set_index(["model", "window"])
    assert summary.loc["good", "common"] == pytest.approx(rows.loc[("good", "c 0-7.98 s"), "R2"])
    lines = board.report_lines()
    assert lines[1].startswith("  good")
    assert any(line.startswith("! the models have different windows") for line in lines)
    alike = validate_models(dict.fromkeys("xy", models["good"]), pieces)
    assert "common" not in alike.report()
    assert list(alike.summary["common"]) == pytest.approx(list(alike.summary["R2"]))


def test_the_digest_is_that_of_the_numbers(tmp_path):
    states = short_period(1)
    states.to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    with xr.open_dataset(tmp_path / "a.nc", engine="h5netcdf") as stored:
        assert digest_states(stored.load()) == digest_states(states)
    assert digest_states(states.assign(q=states["q"] + 1e-12)) != digest_states(states)


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
    pieces = [ValidationWindow("a", used), ValidationWindow("b", short_period(9))]
    board = validate_models({"oe": state_windows(motion, pieces[:1])}, pieces)
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


@pytest.mark.nightly
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
    assert [(name, start) for name, start, *_ in used] == [("a", 0.0), ("b", 0.0)]
    assert used[1][2] == pytest.approx(8.0, abs=0.05)
    assert len(used[0][3]) == 64
    assert used[0][3] != used[1][3]
    done = CliRunner().invoke(flight, ["fit-linear", str(tmp_path / "a.nc"), "--motion",
                                       "short-period", "--window-of", "c", "0", "8"])  # fmt: skip
    assert done.exit_code != 0

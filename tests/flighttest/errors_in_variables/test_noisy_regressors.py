import numpy as np
import pytest
import xarray as xr
from flown_lift import STEP, coloured_noise
from scipy.linalg import expm

import aerodb
from flightmech.errors import IdentificationError, UnknownName
from flightmech.terms import make_term
from flighttest.parameter_constraints import parse_constraints
from flighttest.regression.equation_error.fit_file import open_fit, save_fit
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress
from flighttest.regression.errors_in_variables.instrumental_variables import (
    describe_powers,
    regress_instrumental,
)
from flighttest.regression.errors_in_variables.total_least_squares import regress_total

MOMENT = RegressionModel.parse("Cm = 1 + alpha + qhat + delta_e")
TRUTH = np.array([0.03, -0.7, -16.0, -1.2])
ANGLE, REDUCED = np.radians(0.3), 5e-5  # noise of alpha [rad] and of qhat
NOISE = {"alpha": ANGLE, "qhat": REDUCED}


def short_period(seed, duration=30.0, noise=1.0, disturbance=2e-4, gain=1.0):
    """A short period driven by the elevator, with noise on alpha and qhat, and a coloured
    moment.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, STEP)
    k = np.arange(3, 45, 2)
    phases = rng.uniform(0.0, 2.0 * np.pi, len(k))
    u = gain * 0.02 * np.cos(2 * np.pi * np.outer(t, k) / 30 + phases).sum(axis=1) / np.sqrt(len(k))
    A, B = np.array([[-1.2, 1.0], [-7.0, -2.0]]), np.array([-0.1, -12.0])
    step = expm(STEP * A)
    push = np.linalg.solve(A, (step - np.eye(2)) @ B)
    x = np.zeros((len(t), 2))
    for i in range(len(t) - 1):
        x[i + 1] = step @ x[i] + push * u[i]
    alpha, qhat = x[:, 0], x[:, 1] * 1.67 / 200.0
    moment = np.column_stack([np.ones_like(t), alpha, qhat, u]) @ TRUTH
    moment = moment + disturbance * coloured_noise(rng, len(t))
    columns = {
        "Cm": moment,
        "alpha": alpha + noise * ANGLE * rng.normal(size=len(t)),
        "qhat": qhat + noise * REDUCED * rng.normal(size=len(t)),
        "delta_e": u,
    }
    record = xr.Dataset({k: ("time", v) for k, v in columns.items()}, coords={"time": t})
    return record, xr.Dataset({"alpha": ("time", alpha), "qhat": ("time", qhat), "time": t})


@pytest.mark.nightly
def test_both_estimators_remove_the_bias_of_equation_error():
    errors = {"least squares": [], "iv": [], "tls": []}
    for seed in range(3):
        record, _ = short_period(seed)
        for method, fit in (
            ("least squares", regress(MOMENT, record)),
            ("iv", regress_instrumental(MOMENT, record)),
            ("tls", regress_total(MOMENT, record, NOISE)),
        ):
            errors[method].append(fit.estimates["estimate"].values / TRUTH - 1.0)
    mean = {method: np.mean(rows, axis=0) for method, rows in errors.items()}
    assert mean["least squares"][1] < -0.04
    assert np.abs(mean["iv"]).max() < 0.03
    assert np.abs(mean["tls"]).max() < 0.03


@pytest.mark.nightly
@pytest.mark.parametrize("method", ["iv", "tls"])
def test_two_standard_errors_cover_the_truth(method):
    """16 records, noise of the angle 0.3 deg: benchmarks/noisy_regressors.py has 200."""
    inside = []
    for seed in range(16):
        record, _ = short_period(seed)
        if method == "iv":
            e = regress_instrumental(MOMENT, record).estimates
        else:
            e = regress_total(MOMENT, record, NOISE).estimates
        inside.append(np.abs(e["estimate"].values - TRUTH) < 2 * e["stderr"].values)
    assert np.mean(inside) == pytest.approx(0.94, abs=0.08)


def test_exact_regressors_give_the_estimates_of_equation_error():
    record, _ = short_period(0, noise=0.0)
    plain = regress(MOMENT, record).estimates
    total = regress_total(MOMENT, record, {"alpha": 1e-12}).estimates
    np.testing.assert_allclose(total["estimate"], plain["estimate"], rtol=1e-9)
    np.testing.assert_allclose(total["stderr"], plain["stderr"], rtol=1e-6)
    found = regress_instrumental(MOMENT, record).estimates
    np.testing.assert_allclose(found["estimate"], plain["estimate"], rtol=0.05)


def test_total_least_squares_solves_the_corrected_normal_equations():
    record, _ = short_period(1)
    fit = regress_total(MOMENT, record, NOISE)
    X, z = fit.regressors.values, record["Cm"].values
    S = np.diag([0.0, ANGLE**2, REDUCED**2, 0.0])
    expected = np.linalg.solve(X.T @ X - len(z) * S, X.T @ z)
    np.testing.assert_allclose(fit.estimates["estimate"], expected, rtol=1e-9)


@pytest.mark.parametrize("text", ["alpha = -0.7", "qhat = 20*alpha - 2", "delta_e = alpha - 0.5"])
def test_a_constraint_with_a_constant_is_that_of_lagrange_multipliers(text):
    """The part of the model that the constraint fixes has the noise of its regressor, too."""
    record, _ = short_period(1, noise=3.0)
    noise = {name: 3.0 * size for name, size in NOISE.items()}
    fit = regress_total(MOMENT, record, noise, constraints=[text])
    X, z = fit.regressors.values, record["Cm"].values
    S = 9.0 * np.diag([0.0, ANGLE**2, REDUCED**2, 0.0])
    (constraint,) = parse_constraints([text], list(MOMENT.terms))
    G = constraint.weights[None]
    system = np.block([[X.T @ X - len(z) * S, G.T], [G, np.zeros((1, 1))]])
    expected = np.linalg.solve(system, np.append(X.T @ z, constraint.value))[:-1]
    np.testing.assert_allclose(fit.estimates["estimate"], expected, rtol=1e-7)


@pytest.mark.slow
def test_a_fixed_slope_leaves_no_bias_in_the_square():
    rng = np.random.default_rng(0)
    alpha, elevator = 0.1 * rng.normal(size=8000), 0.1 * rng.normal(size=8000)
    lift = 0.3 + 5.0 * alpha - 8.0 * alpha**2 + 0.4 * elevator + 0.01 * rng.normal(size=8000)
    columns = {"CL": lift, "alpha": alpha + 0.015 * rng.normal(size=8000), "delta_e": elevator}
    record = xr.Dataset({name: ("time", values) for name, values in columns.items()})
    record = record.assign_coords(time=STEP * np.arange(8000))
    model = RegressionModel.parse("CL = 1 + alpha + alpha**2 + delta_e")
    found = regress_total(model, record, {"alpha": 0.015}, constraints=["alpha = 5"]).estimates
    square = found.sel(term="alpha**2")
    assert abs(float(square["estimate"]) + 8.0) < 3.0 * float(square["stderr"])
    assert float(square["stderr"]) < 0.5


def test_tables_with_the_local_model_are_expected_to_give_its_parameters():
    """The design of a fit returns the parameters of a model from its values at the samples."""
    record, _ = short_period(1)
    for fit in (regress_total(MOMENT, record, NOISE), regress_instrumental(MOMENT, record)):
        values = fit.regressors.values @ TRUTH
        found = np.linalg.lstsq(fit.design.values, values, rcond=None)[0]
        np.testing.assert_allclose(found, TRUTH, rtol=1e-8)


@pytest.mark.slow
def test_fits_enter_tables_without_the_bias():
    """Tables with a wide prior take the estimates; equation error would give -0.58 for -0.7."""
    leaves = {}
    for name, value in {"basic": 0.0, "alpha": -1.0, "qhat": -10.0, "delta_e": -1.0}.items():
        term = make_term(value, regressors=[] if name == "basic" else [name])
        leaves[f"/Cm/{name}"] = term.assign(stderr=0.0 * term["value"] + 5.0 * abs(value - 1.0))
    about = {"title": "", "aircraft": "", "source": "", "force_axes": "stability"}
    about |= {"S": 17.0, "cbar": 1.67, "b": 10.3, "x_ref": 0.0, "y_ref": 0.0, "z_ref": 0.0}
    prior = xr.DataTree.from_dict({"/": xr.Dataset(attrs=about), **leaves})
    record, _ = short_period(3)
    for fit in (regress_instrumental(MOMENT, record), regress_total(MOMENT, record, NOISE)):
        found = aerodb.tabulate([fit], prior)
        for name in ("alpha", "qhat", "delta_e"):
            estimate = float(fit.estimates["estimate"].sel(term=name))
            assert float(found[f"Cm/{name}"]["value"]) == pytest.approx(estimate, rel=0.01)


def test_a_covariance_of_the_noise_may_be_given():
    record, _ = short_period(2)
    matrix = xr.DataArray(
        np.diag([ANGLE**2, REDUCED**2]),
        {"variable": ["alpha", "qhat"], "variable_": ["alpha", "qhat"]},
        ("variable", "variable_"),
    )
    a = regress_total(MOMENT, record, NOISE).estimates["estimate"]
    b = regress_total(MOMENT, record, matrix).estimates["estimate"]
    np.testing.assert_allclose(a, b, rtol=1e-12)


def test_a_covariance_is_read_by_its_names_and_must_be_symmetric():
    record, _ = short_period(2)
    both = ["alpha", "qhat"]
    share = 0.5 * ANGLE * REDUCED
    matrix = np.array([[ANGLE**2, share], [share, REDUCED**2]])
    named = xr.DataArray(matrix, {"variable": both, "variable_": both}, ("variable", "variable_"))
    expected = regress_total(MOMENT, record, named).estimates["estimate"]
    for other in (named.isel(variable_=[1, 0]), named.isel(variable=[1, 0]), named.transpose()):
        found = regress_total(MOMENT, record, other).estimates["estimate"]
        np.testing.assert_allclose(found, expected, rtol=1e-9)
    one_sided = named.copy()
    one_sided.values[1, 0] = 0.0
    with pytest.raises(IdentificationError, match="a covariance"):
        regress_total(MOMENT, record, one_sided)
    with pytest.raises(IdentificationError, match="columns alpha, delta_e"):
        regress_total(MOMENT, record, named.assign_coords(variable_=["alpha", "delta_e"]))


def test_noise_must_be_stated_and_smaller_than_the_motion():
    record, _ = short_period(3)
    with pytest.raises(IdentificationError, match="needs the noise"):
        regress_total(MOMENT, record, {})
    with pytest.raises(IdentificationError, match="positive"):
        regress_total(MOMENT, record, {"alpha": 0.0})
    with pytest.raises(UnknownName, match="beta"):
        regress_total(MOMENT, record, {"beta": 0.01})
    with pytest.raises(IdentificationError, match="of the movement of"):
        regress_total(MOMENT, record, {"alpha": np.radians(3.0)})


def test_stated_noise_that_the_samples_do_not_have_is_remarked():
    record, _ = short_period(4)
    right = regress_total(MOMENT, record, NOISE)
    assert not [remark for remark in right.remarks if remark.kind == "stated noise"]
    wrong = regress_total(MOMENT, record, {"alpha": 1.8 * ANGLE})
    assert [remark for remark in wrong.remarks if remark.kind == "stated noise"]


def test_weak_instruments_are_refused():
    record, _ = short_period(5, gain=0.02)
    with pytest.raises(IdentificationError, match="weak instruments"):
        regress_instrumental(MOMENT, record)
    still = record.assign(delta_e=0.0 * record["delta_e"])
    with pytest.raises(IdentificationError, match="no control moves"):
        regress_instrumental(RegressionModel.parse("Cm = 1 + alpha + qhat"), still)


def test_given_instruments_of_another_sensor():
    record, clean = short_period(6)
    rng = np.random.default_rng(60)
    other = clean.assign(
        alpha=clean["alpha"] + ANGLE * rng.normal(size=clean.sizes["time"]),
        qhat=clean["qhat"] + REDUCED * rng.normal(size=clean.sizes["time"]),
    )
    e = regress_instrumental(MOMENT, record, instruments=other).estimates
    np.testing.assert_allclose(e["estimate"], TRUTH, rtol=0.06)
    with pytest.raises(IdentificationError, match="equals the regressor"):
        regress_instrumental(MOMENT, record, instruments=record)
    with pytest.raises(IdentificationError, match="run from"):
        regress_instrumental(MOMENT, record, instruments=other.isel(time=slice(0, 500)))


@pytest.mark.nightly
def test_fits_are_saved_and_read_with_their_method(tmp_path):
    record, _ = short_period(7)
    for fit in (regress_instrumental(MOMENT, record), regress_total(MOMENT, record, NOISE)):
        save_fit(fit, tmp_path / "fit.nc")
        again = open_fit(tmp_path / "fit.nc")
        assert again.report() == fit.report()
        assert fit.estimates.attrs["method"] in fit.report()
        assert "least_squares" in again.estimates


def test_several_manoeuvres_with_own_constants():
    parts = [short_period(seed, 20.0)[0] for seed in (8, 9)]
    for fit in (
        regress_instrumental(MOMENT, parts, intercepts="separate"),
        regress_total(MOMENT, parts, NOISE, intercepts="separate"),
    ):
        assert list(fit.estimates["term"].values[:2]) == ["1[0]", "1[1]"]
        np.testing.assert_allclose(fit.estimates["estimate"][2:], TRUTH[1:], rtol=0.08)


@pytest.mark.slow
def test_a_change_of_rounding_size_changes_nothing():
    record, _ = short_period(10)
    rng = np.random.default_rng(1)
    moved = record.copy()
    for name in record.data_vars:
        moved[name] = record[name] * (1.0 + 1e-12 * rng.normal(size=record.sizes["time"]))
    for method in (regress_instrumental, lambda m, d: regress_total(m, d, NOISE)):
        a, b = method(MOMENT, record).estimates, method(MOMENT, moved).estimates
        assert np.abs((a["estimate"] - b["estimate"]) / a["stderr"]).max() < 1e-8
        np.testing.assert_allclose(a["stderr"], b["stderr"], rtol=1e-6)


def test_a_third_power_of_a_noisy_variable_is_remarked():
    record, _ = short_period(11)
    cubic = RegressionModel.parse("Cm = 1 + alpha + alpha**3 + qhat + delta_e")
    fit = regress_total(cubic, record, {"alpha": 0.1 * ANGLE})
    assert [remark for remark in fit.remarks if remark.kind == "nonlinear noise"]


def test_a_square_times_another_factor_is_remarked_and_a_square_alone_is_not():
    terms = ["1", "alpha", "qhat", "delta_e"]
    for term in ("alpha**2*delta_e", "alpha**2*qhat", "qhat**2*mach", "alpha*ramp(alpha,0.1)*gear"):
        assert describe_powers([*terms, term], ["alpha", "qhat"]).startswith(f"{term}: ")
    for term in ("alpha**2", "alpha*delta_e**2", "alpha*qhat", "alpha*qhat*delta_e", "delta_e**3"):
        assert not describe_powers([*terms, term], ["alpha", "qhat"])
    both = {"noisy": ["alpha", "qhat"], "has_correlated_noise": True}
    assert describe_powers([*terms, "alpha*qhat*delta_e"], **both)
    assert not describe_powers([*terms, "alpha*qhat"], **both)
    assert describe_powers([*terms, "delta_e**3"], ["delta_e"])
    # Constants of manoeuvres take up the mean of a square; without a constant nothing does.
    assert not describe_powers(["1[0]", "1[1]", "alpha", "alpha**2"], ["alpha"])
    assert describe_powers(["alpha", "alpha**2"], ["alpha"])


def test_the_remarked_bias_of_a_product_is_that_of_the_variance():
    """Of alpha**2*delta_e with slope 40 and noise of 0.03 rad the slope of delta_e takes -0.036."""
    rng = np.random.default_rng(1)
    alpha, elevator = 0.1 * rng.normal(size=8000), 0.1 * rng.normal(size=8000)
    lift = 0.3 + 5.0 * alpha + 40.0 * alpha**2 * elevator + 0.4 * elevator
    columns = {"CL": lift, "alpha": alpha + 0.03 * rng.normal(size=8000), "delta_e": elevator}
    record = xr.Dataset({name: ("time", values) for name, values in columns.items()})
    record = record.assign_coords(time=STEP * np.arange(8000))
    model = RegressionModel.parse("CL = 1 + alpha + alpha**2*delta_e + delta_e")
    fit = regress_total(model, record, {"alpha": 0.03})
    slope = fit.estimates.sel(term="delta_e")
    assert abs(float(slope["estimate"]) - 0.364) < 2.5 * float(slope["stderr"])
    assert [remark for remark in fit.remarks if remark.kind == "nonlinear noise"]

"""Constraints among terms: against least squares by hand, inequalities, contradictions, files."""

import json

import numpy as np
import pytest
import scipy
from flown_lift import LIFT, record
from flown_lift import TRUTH as _TRUTH

from aerodb.update.observations import _demand_no_constraint
from flightmech.errors import IdentificationError, SchemaError
from flighttest.parameter_constraints import choose_active, eliminate, parse_constraints
from flighttest.regression.combining.joined_fits import join_fits
from flighttest.regression.combining.mixed_estimation import mix_with_prior
from flighttest.regression.equation_error.fit_file import open_fit, save_fit
from flighttest.regression.equation_error.frequency.frequency_domain import regress_frequency
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress
from flighttest.regression.errors_in_variables.instrumental_variables import regress_instrumental
from flighttest.regression.errors_in_variables.total_least_squares import regress_total

TRUTH = np.array(list(_TRUTH.values()))
NAMES = ["a", "b", "alpha*qhat", "node.Cm.basic[3]", "init.alpha@1"]


@pytest.mark.parametrize(
    ("text", "weights", "value", "equality"),
    [
        ("a = 2", [1, 0, 0, 0, 0], 2.0, True),
        ("a=-1.5e-3", [1, 0, 0, 0, 0], -1.5e-3, True),
        ("a = b", [1, -1, 0, 0, 0], 0.0, True),
        ("a = 2*b - 0.5*alpha*qhat + 1", [1, -2, 0.5, 0, 0], 1.0, True),
        ("node.Cm.basic[3] = -init.alpha@1", [0, 0, 0, 1, 1], 0.0, True),
        ("a < 0", [-1, 0, 0, 0, 0], 0.0, False),
        ("a >= b", [1, -1, 0, 0, 0], 0.0, False),
        ("a <= 2*b + 3", [-1, 2, 0, 0, 0], -3.0, False),
    ],
)
def test_texts_become_linear_relations(text, weights, value, equality):
    (found,) = parse_constraints([text], NAMES)
    np.testing.assert_allclose(found.weights, weights)
    assert found.value == pytest.approx(value)
    assert found.is_equality == equality


@pytest.mark.parametrize(
    "text",
    ["a", "a =", "a = 2 3", "c = 1", "a = 2*c", "a = 2*", "= 2", "a = a", "a = 1e999", "2 = a"],
)
def test_what_is_not_a_constraint_is_refused_by_its_text(text):
    with pytest.raises(SchemaError, match="constraints") as caught:
        parse_constraints([text], NAMES)
    assert repr(text) in str(caught.value)


def test_contradictions_and_circles_are_refused_and_repetitions_are_not():
    with pytest.raises(SchemaError, match="contradicts"):
        eliminate(parse_constraints(["a = 1", "a = 2"], NAMES), 5)
    with pytest.raises(SchemaError, match="no parameter is left"):
        eliminate(parse_constraints(["a = 1"], ["a"]), 1)
    chained = eliminate(parse_constraints(["a = 2*b", "b = 3*alpha*qhat", "a = 2*b"], NAMES), 5)
    np.testing.assert_allclose(chained.expand(np.array([1.0, 5.0, 7.0])), [6, 3, 1, 5, 7])


def test_an_equality_is_that_of_lagrange_multipliers():
    data = record(np.random.default_rng(0))
    fit = regress(LIFT, data, constraints=["delta_e = 0.06*CL_alpha + 0.1", "qhat = 8"])
    X, z = LIFT.design(data), data["CL"].values
    A, c = np.array([[0, -0.06, 0, 1.0], [0, 0, 1.0, 0]]), np.array([0.1, 8.0])
    system = np.block([[X.T @ X, A.T], [A, np.zeros((2, 2))]])
    expected = np.linalg.solve(system, np.concatenate([X.T @ z, c]))[:4]
    np.testing.assert_allclose(fit.estimates["estimate"], expected, rtol=1e-9)
    e = fit.estimates
    assert float(e["stderr"].sel(term="qhat")) == 0.0
    ratio = float(e["stderr"].sel(term="delta_e") / e["stderr"].sel(term="alpha"))
    assert ratio == pytest.approx(0.06)
    assert not [remark for remark in fit.remarks if remark.kind == "constraint"]


def test_constrained_standard_errors_are_those_of_the_reduced_regression():
    """A fixed value is a smaller model of the remainder."""
    data = record(np.random.default_rng(1))
    fit = regress(LIFT, data, constraints=["qhat = 8"])
    rest = data.assign(CL=data["CL"] - 8.0 * data["qhat"])
    small = regress(RegressionModel.parse("CL = 1 + alpha + delta_e"), rest)
    for name in ("estimate", "stderr", "stderr_white", "dof"):
        expected = small.estimates[name].values
        found = fit.estimates[name].sel(term=["1", "alpha", "delta_e"]).values
        np.testing.assert_allclose(found, expected, rtol=1e-8, err_msg=name)


def test_inequalities_hold_and_are_inactive_where_the_data_satisfy_them():
    data = record(np.random.default_rng(2))
    free = regress(LIFT, data).estimates
    idle = regress(LIFT, data, constraints=["alpha > 0", "delta_e < 100"])
    np.testing.assert_allclose(idle.estimates["estimate"], free["estimate"], rtol=1e-12)
    np.testing.assert_allclose(idle.estimates["stderr"], free["stderr"], rtol=1e-12)
    held = regress(LIFT, data, constraints=["alpha > 5.5", "delta_e < 0.4"]).estimates
    X, z = LIFT.design(data), data["CL"].values
    low, high = [-np.inf, 5.5, -np.inf, -np.inf], [np.inf, np.inf, np.inf, 0.4]
    best = scipy.optimize.lsq_linear(X, z, (low, high), tol=1e-14).x
    np.testing.assert_allclose(held["estimate"], best, rtol=1e-6)


def test_inequalities_between_parameters_are_the_nearest_point():
    rng = np.random.default_rng(3)
    for _ in range(20):
        root = rng.normal(size=(4, 4))
        M, phi = root @ root.T + 0.1 * np.eye(4), rng.normal(size=4)
        limits = parse_constraints(["a > b", "b > 2*c", "d < 0"], list("abcd"))
        held = eliminate([], 4)
        active = choose_active(limits, held, phi, M)
        found = phi
        if active:
            G, h = np.array([c.weights for c in active]), np.array([c.value for c in active])
            inverse = np.linalg.inv(M)
            found = phi + inverse @ G.T @ np.linalg.solve(G @ inverse @ G.T, h - G @ phi)
        best = scipy.optimize.minimize(
            lambda x, M=M, phi=phi: (x - phi) @ M @ (x - phi),
            np.array([1.0, 0.0, -1.0, -1.0]),
            jac=lambda x, M=M, phi=phi: 2.0 * M @ (x - phi),
            constraints=[
                {"type": "ineq", "fun": lambda x, c=c: c.weights @ x - c.value} for c in limits
            ],
            method="SLSQP",
            options={"ftol": 1e-14},
        ).x
        np.testing.assert_allclose(found, best, atol=1e-5)


@pytest.mark.slow
def test_limits_of_parameters_of_any_size_are_satisfied():
    """Rounding of the estimate with active limits is not a contradiction of these limits."""
    names = list("abcd")
    limits = parse_constraints(["a < 0", "b < 0", "c < 0", "a < 0 - b"], names)
    held = eliminate([], 4)
    rng = np.random.default_rng(0)
    for _ in range(100):
        size = 10.0 ** rng.uniform(-4.0, 4.0, 4)
        root = rng.normal(size=(8, 4))
        unit, violated = root.T @ root, rng.uniform(0.1, 3.0, 4)
        active = choose_active(limits, held, size * violated, unit / np.outer(size, size))
        chosen = eliminate(active, 4)
        T, phi = chosen.matrix, size * violated
        M = unit / np.outer(size, size)
        found = T @ np.linalg.solve(T.T @ M @ T, T.T @ M @ phi)
        assert (found[:3] <= 1e-9 * size[:3]).all()
        assert found[0] + found[1] <= 1e-9 * (size[0] + size[1])


def test_limits_that_exclude_each_other_are_refused():
    for texts in (["a > 1", "a < 0"], ["a > b + 1", "b > c", "c > a"]):
        limits = parse_constraints(texts, list("abc"))
        with pytest.raises(SchemaError, match="they contradict each other"):
            choose_active(limits, eliminate([], 3), np.array([0.5, 0.2, 0.1]), np.eye(3))
    # the equality leaves nothing that could satisfy the limit
    held = eliminate(parse_constraints(["a = 5"], list("abc")), 3)
    limits = parse_constraints(["a > 6"], list("abc"))
    with pytest.raises(SchemaError, match="they contradict each other"):
        choose_active(limits, held, np.array([0.2, 0.1]), np.eye(2))


def test_a_contradicted_constraint_is_remarked():
    data = record(np.random.default_rng(4))
    fit = regress(LIFT, data, constraints=["alpha = 4"])
    (remark,) = [remark for remark in fit.remarks if remark.kind == "constraint"]
    assert abs(remark.value) > 3.0
    assert "alpha = 4" in remark.text
    assert regress(LIFT, data, constraints=["alpha < 0"]).remarks
    stored = json.loads(fit.estimates.attrs["constraints"])
    free = regress(LIFT, data).estimates.sel(term="alpha")
    assert stored[0]["t"] == pytest.approx(float((free["estimate"] - 4.0) / free["stderr"]))


def test_terms_that_the_data_cannot_distinguish_need_a_constraint_that_is_not_tested():
    data = record(np.random.default_rng(5))
    data["delta_t"] = 0.5 * data["delta_e"]
    model = RegressionModel.parse("CL = 1 + alpha + qhat + delta_e + delta_t")
    with pytest.raises(IdentificationError):
        regress(model, data)
    fit = regress(model, data, constraints=["delta_t = 2*delta_e"])
    assert float(fit.estimates["estimate"].sel(term="delta_e")) == pytest.approx(0.25, abs=0.1)
    assert "not tested" in fit.report()


@pytest.mark.nightly
def test_all_estimators_take_constraints_and_files_keep_them(tmp_path):
    data = record(np.random.default_rng(6))
    texts = ["qhat = 1.6*alpha", "delta_e > 0"]
    noise = {"alpha": 1e-4}
    for fit in (
        regress(LIFT, data, constraints=texts),
        regress(LIFT, data, weights="robust", constraints=texts),
        regress_total(LIFT, data, noise, constraints=texts),
    ):
        e = fit.estimates["estimate"]
        assert float(e.sel(term="qhat")) == pytest.approx(1.6 * float(e.sel(term="alpha")))
        save_fit(fit, tmp_path / "fit.nc")
        assert open_fit(tmp_path / "fit.nc").report() == fit.report()
        # The design is a linear map of the measurements to the estimates.
        assert np.isfinite(fit.design.values).all()
        assert fit.predict(data)["CL"].shape == (1500,)


def test_instrumental_variables_take_constraints():
    """Here qhat is a motion of its own that no control drives: a constraint leaves it out."""
    data = record(np.random.default_rng(7), duration=60.0)
    fit = regress_instrumental(LIFT, data, instruments=data * 1.0001, constraints=["qhat = 8"])
    np.testing.assert_allclose(fit.estimates["estimate"], TRUTH, rtol=0.1)


@pytest.mark.slow
def test_joins_priors_and_tables_refuse_an_active_constraint():
    data = record(np.random.default_rng(8))
    held = regress(LIFT, data, constraints=["qhat = 8"])
    free = regress(LIFT, data, constraints=["alpha > 0"])
    with pytest.raises(SchemaError, match="constraints"):
        join_fits([free, held])
    with pytest.raises(SchemaError, match="constraints"):
        mix_with_prior(held, {"alpha": (5.0, 0.1)})
    with pytest.raises(SchemaError, match="qhat = 8"):
        _demand_no_constraint(held)
    _demand_no_constraint(free)
    join_fits([free, free])


BAND = (0.2, 2.0)


@pytest.mark.slow
@pytest.mark.parametrize("weights", ["equal", "spectrum"])
def test_in_frequency_an_eliminated_term_is_one_with_the_term_it_follows(weights):
    """qhat = 1.6*alpha: the fit of a model with the one regressor alpha + 1.6*qhat."""
    data = record(np.random.default_rng(3), duration=30.0)
    fit = regress_frequency(
        LIFT, data, BAND, weights=weights, constraints=["CL_qhat = 1.6*alpha", "delta_e > -9"]
    )
    joined = data.assign(beta=data["alpha"] + 1.6 * data["qhat"])
    other = regress_frequency(
        RegressionModel.parse("CL = 1 + beta + delta_e"), joined, BAND, weights=weights
    )
    e, o = fit.estimates, other.estimates
    np.testing.assert_allclose(
        e["estimate"].sel(term=["1", "alpha", "delta_e"]), o["estimate"], rtol=1e-9
    )
    for name in ("stderr", "stderr_white"):
        np.testing.assert_allclose(e[name].sel(term=["1", "alpha", "delta_e"]), o[name], rtol=1e-8)
        assert float(e[name].sel(term="qhat")) == pytest.approx(1.6 * float(e[name][1]))
    rated = json.loads(e.attrs["constraints"])
    assert [row["active"] for row in rated] == [True, False]
    assert rated[1]["t"] == 0.0
    # the same residual of the data without constraint decides the contradiction
    free = regress_frequency(LIFT, data, BAND, weights=weights).estimates
    C = free["covariance"].values + free["systematic"].values @ free["systematic"].values.T
    w = np.array([0.0, -1.6, 1.0, 0.0])
    expected = float(w @ free["estimate"].values) / np.sqrt(w @ C @ w)
    assert rated[0]["t"] == pytest.approx(expected, rel=1e-6)


def test_in_frequency_a_violated_limit_becomes_an_equality():
    data = record(np.random.default_rng(4), duration=30.0)
    at_limit = regress_frequency(LIFT, data, BAND, constraints=["delta_e = 0.7"])
    limited = regress_frequency(LIFT, data, BAND, constraints=["delta_e > 0.7"])
    np.testing.assert_allclose(
        limited.estimates["estimate"], at_limit.estimates["estimate"], rtol=1e-12
    )
    e = at_limit.estimates.sel(term="delta_e")
    assert float(e["estimate"]) == 0.7
    assert float(e["stderr"]) == 0.0
    assert np.isnan(e["t"])
    assert np.isfinite(at_limit.estimates["stderr"]).all()
    with pytest.raises(SchemaError, match="no parameter '1'"):
        regress_frequency(LIFT, data, BAND, constraints=["1 = 0.2"])


@pytest.mark.nightly
@pytest.mark.parametrize("ridge", [0.05, "auto"])
def test_a_ridge_acts_on_the_free_terms(ridge):
    """Against a fit with the joined regressor; constraints are compared without the ridge."""
    data = record(np.random.default_rng(5), duration=30.0)
    texts = ["qhat = 1.6*alpha"]
    joined = data.assign(beta=data["alpha"] + 1.6 * data["qhat"])
    model = RegressionModel.parse("CL = 1 + beta + delta_e")
    for found, other in (
        (regress(LIFT, data, ridge=ridge, constraints=texts), regress(model, joined, ridge=ridge)),
        (
            regress_frequency(LIFT, data, BAND, ridge=ridge, constraints=texts),
            regress_frequency(model, joined, BAND, ridge=ridge),
        ),
    ):
        e, o = found.estimates, other.estimates
        assert e.attrs["ridge"] == pytest.approx(o.attrs["ridge"])
        for name in ("estimate", "stderr", "shrinkage"):
            np.testing.assert_allclose(
                e[name].sel(term=["1", "alpha", "delta_e"]), o[name], rtol=1e-8, atol=1e-12
            )
    without = regress(LIFT, data, constraints=texts).estimates.attrs["constraints"]
    assert (
        regress(LIFT, data, ridge=ridge, constraints=texts).estimates.attrs["constraints"]
        == without
    )


def test_a_ridge_at_a_limit_is_the_minimum_of_the_penalised_cost():
    """The cost with the ridge, minimised by another method, has the limit at the same place."""
    data = record(np.random.default_rng(6), duration=20.0)
    fit = regress(LIFT, data, ridge=0.2, constraints=["qhat > 9"])
    X, z = fit.regressors.values, data["CL"].values
    length = ((X - X.mean(axis=0)) ** 2).sum(axis=0)
    length[0] = 0.0
    low = np.array([-np.inf, -np.inf, 9.0, -np.inf])
    rows = np.vstack([X, np.diag(np.sqrt(0.2 * length))])
    by_hand = scipy.optimize.lsq_linear(
        rows, np.append(z, np.zeros(4)), (low, np.full(4, np.inf)), method="bvls"
    )
    np.testing.assert_allclose(fit.estimates["estimate"], by_hand.x, rtol=1e-6)

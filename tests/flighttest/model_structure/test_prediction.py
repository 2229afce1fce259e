"""Selection by the prediction of left-out parts: the set of models, its weights, its spread.

The records are those of benchmarks/model_structure.py, where rates over forty seeds are counted.
"""

import numpy as np
import pytest
import xarray as xr
from model_structure import CANDIDATES, LINEAR, before, record  # the benchmark

from flightmech.errors import IdentificationError
from flighttest.regression.equation_error.fit_file import open_fit, save_fit
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress
from flighttest.regression.model_structure.best_prediction import select_by_prediction
from flighttest.regression.model_structure.candidates import candidate_equations, monomials
from flighttest.regression.model_structure.hierarchy import (
    TermHierarchy,
    add_factors,
    factors_of,
    list_ancestors,
)
from flighttest.regression.model_structure.model_set import ModelComparison
from flighttest.regression.model_structure.prediction import HeldOutPrediction, WhitenedRows
from flighttest.regression.model_structure.search import select_orthogonal, select_stepwise

QUADRATIC = {**LINEAR, "alpha**2": -6.0}


@pytest.fixture(scope="module")
def quadratic():
    return record(7004, QUADRATIC, "oscillating at 0.5 Hz")


@pytest.fixture(scope="module")
def found(quadratic):
    return select_by_prediction("Cm", CANDIDATES, quadratic)


def kinds(fit):
    return [remark.kind for remark in fit.remarks]


def test_the_truth_is_the_best_of_the_set(found):
    assert set(found.model.terms) == set(QUADRATIC)
    models = found.models
    assert models["model"].iloc[0] == " + ".join(found.model.terms)
    assert models["weight"].sum() == pytest.approx(1.0)
    assert (models["weight"].diff()[1:] <= 0.0).all()
    assert (models["difference"] >= 0.0).all()
    assert 1 < len(models) < 20
    assert "models that the evidence allows" in found.report()


def test_no_model_of_the_set_lacks_a_factor_or_the_damping(found):
    for text in found.models["model"]:
        terms = text.split(" + ")
        assert {"1", "qhat"} <= set(terms)
        assert set(add_factors(terms)) == set(terms)


@pytest.mark.nightly
def test_the_spread_enters_the_standard_errors(found, quadratic, tmp_path):
    e = found.estimates
    alone = regress(found.model, quadratic).estimates
    spread = e["stderr_models"].values
    assert spread.max() > 0.0
    np.testing.assert_allclose(
        e["stderr"].values, np.hypot(alone["stderr"].values, spread), rtol=1e-9
    )
    np.testing.assert_allclose(np.diag(e["covariance"].values), e["stderr"].values ** 2)
    assert (np.abs(e["t"].values) <= np.abs(alone["t"].values)).all()
    assert (e["low"] <= alone["low"]).all()
    save_fit(found.fit, tmp_path / "fit.nc")
    again = open_fit(tmp_path / "fit.nc")
    assert again.estimates.attrs["selection"] == "prediction"
    np.testing.assert_array_equal(again.estimates["stderr_models"].values, spread)


def test_a_slope_is_compared_at_the_mean_and_not_at_zero(quadratic):
    """A model with another square has another slope at alpha = 0 and nearly the same at the
    mean.
    """
    found = select_by_prediction("Cm", CANDIDATES, quadratic)
    assert float(found.estimates["stderr_models"].sel(term="alpha")) < 0.02


def test_rounding_does_not_change_the_set(found, quadratic):
    rng = np.random.default_rng(0)
    names = ("alpha", "qhat", "delta_e", "Cm")
    shaken = {
        name: quadratic[name] * (1.0 + 1e-12 * rng.normal(size=quadratic.sizes["time"]))
        for name in names
    }
    again = select_by_prediction("Cm", CANDIDATES, quadratic.assign(shaken))
    assert list(again.models["model"]) == list(found.models["model"])
    np.testing.assert_allclose(again.models["weight"], found.models["weight"], rtol=1e-6)


@pytest.mark.nightly
def test_a_moment_without_damping_is_never_returned_in_silence():
    lost = record(7000, {"1": -0.02, "alpha": -0.8, "delta_e": -1.2}, "white")
    for choose in (select_by_prediction, select_orthogonal, select_stepwise):
        assert "qhat" in choose("Cm", CANDIDATES, lost).model.terms
        free = choose("Cm", CANDIDATES, lost, hierarchy=False)
        assert "qhat" not in free.model.terms
        assert "no damping: qhat" in "\n".join(map(str, free.fit.remarks))
        without = choose("Cm", ["1", "alpha", "delta_e"], lost)
        assert "it is not among the candidates" in "\n".join(map(str, without.fit.remarks))
    # a model that the user gives was not selected
    assert "structure" not in kinds(regress(RegressionModel("Cm", ["1", "alpha"]), lost))


@pytest.mark.nightly
def test_the_greedy_choice_lost_the_damping_and_does_not_now():
    """Found by the benchmark: 20 % of these records lost it."""
    records = [record(seed, QUADRATIC, "oscillating at 0.5 Hz") for seed in range(7000, 7008)]
    assert any("qhat" not in before(data) for data in records)
    assert all("qhat" in select_orthogonal("Cm", CANDIDATES, data).model.terms for data in records)


def test_products_need_their_factors_by_the_symmetry_of_the_coefficient():
    assert factors_of("alpha*qhat") == ["qhat", "alpha"]
    assert factors_of("alpha*beta**2", "CL") == ["beta**2", "alpha"]
    assert factors_of("alpha*beta", "CY") == ["beta"]
    assert factors_of("beta**2", "CL") == []
    assert factors_of("beta**2", "Cn") == ["beta"]  # of the wrong symmetry: all are needed
    assert factors_of("ramp(alpha,0.2)") == ["alpha"]
    assert list_ancestors(["1", "alpha", "qhat*alpha", "qhat"]) == [
        frozenset(), frozenset(), frozenset({1, 3}), frozenset()
    ]  # fmt: skip


def test_a_product_brings_the_factors_that_are_no_candidates(quadratic):
    found = select_orthogonal("Cm", ["1", "alpha**2", "qhat", "delta_e"], quadratic)
    assert {"alpha", "alpha**2"} <= set(found.model.terms)


def test_densities_of_left_out_parts_are_those_of_the_normal_distribution():
    rng = np.random.default_rng(3)
    X, part = rng.normal(size=(60, 3)), np.repeat([0, 1, 2], 20)
    X /= np.sqrt((X**2).mean(axis=0))
    z = X @ [1.0, 2.0, 0.0] + rng.normal(size=60)
    found = HeldOutPrediction(WhitenedRows(X, z, part)).densities([0, 1])
    prior = np.eye(2) / 1e-3
    for number in range(3):
        out = part == number
        A, B = X[~out, :2], X[out, :2]
        C = np.linalg.inv(A.T @ A + np.linalg.inv(prior))
        mean, S = B @ C @ A.T @ z[~out], np.eye(20) + B @ C @ B.T
        v = z[out] - mean
        density = -0.5 * (v @ np.linalg.solve(S, v) + np.linalg.slogdet(S)[1])
        # without the part of the density that no model changes
        assert found[number] == pytest.approx(density + 0.5 * z[out] @ z[out], rel=1e-9)


@pytest.mark.slow
def test_manoeuvres_are_the_parts_and_a_term_of_one_of_them_is_judged():
    """The flaps move in one of nine manoeuvres: left out, they cannot be predicted, and are
    kept.
    """
    rng = np.random.default_rng(5)
    parts = []
    for k in range(9):
        part = record(7100 + k, LINEAR, "white", duration=12.0)
        flaps = np.zeros(part.sizes["time"])
        if k == 4:
            flaps = 0.3 * (np.arange(len(flaps)) > 300) + 1e-3 * rng.normal(size=len(flaps))
        moment = part["Cm"].values - 0.2 * flaps
        parts.append(part.assign(delta_f=("time", flaps), Cm=("time", moment)))
    found = select_by_prediction("Cm", [*CANDIDATES, "delta_f"], parts)
    assert set(found.model.terms) == {*LINEAR, "delta_f"}
    problem = candidate_equations("Cm", CANDIDATES, parts, None)
    comparison = ModelComparison(problem, TermHierarchy(problem, ["1"], is_free=False))
    assert comparison.prediction.parts == 9


@pytest.mark.slow
def test_in_frequency_and_without_noise(quadratic):
    band = select_by_prediction(
        "Cm", monomials(["alpha", "qhat", "delta_e"], 1), quadratic, (0.1, 2)
    )
    assert set(band.model.terms) == set(LINEAR)
    assert (band.estimates["stderr_models"] >= 0.0).all()
    model = RegressionModel("Cm", list(LINEAR))
    exact = quadratic.assign(Cm=("time", model.design(quadratic) @ np.array(list(LINEAR.values()))))
    assert set(select_by_prediction("Cm", CANDIDATES, exact).model.terms) == set(LINEAR)


def test_refusals(quadratic):
    with pytest.raises(IdentificationError, match="gear is to be kept, but it does not move"):
        select_by_prediction(
            "Cm", [*CANDIDATES, "gear"], quadratic.assign(gear=0.0), keep=("1", "gear")
        )
    still = xr.zeros_like(quadratic["Cm"])
    with pytest.raises(IdentificationError, match="Cm is constant"):
        select_by_prediction("Cm", CANDIDATES, quadratic.assign(Cm=still))

"""Constraints among the candidates of a selection.

The truth has delta_e = 1.5 alpha: -1.2 and -0.8.
"""

import json

import numpy as np
import pytest
from model_structure import CANDIDATES, LINEAR, record  # the benchmark

from flightmech.errors import IdentificationError, SchemaError
from flighttest.regression.equation_error.frequency.frequency_domain import regress_frequency
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress
from flighttest.regression.model_structure.best_prediction import select_by_prediction
from flighttest.regression.model_structure.candidates import candidate_equations
from flighttest.regression.model_structure.search import select_orthogonal, select_stepwise

TIE = ["delta_e = 1.5*alpha"]


@pytest.fixture(scope="module")
def data():
    return record(7004, LINEAR, "oscillating at 0.5 Hz")


@pytest.fixture(scope="module")
def tied(data):
    return select_by_prediction("Cm", CANDIDATES, data, constraints=TIE)


def values(fit, name="estimate"):
    return dict(zip(map(str, fit.estimates["term"].values), fit.estimates[name].values))


@pytest.mark.parametrize("select", [select_orthogonal, select_stepwise])
def test_the_search_ends_in_the_constrained_regression_of_its_terms(data, select):
    found = select("Cm", CANDIDATES, data, constraints=TIE)
    assert set(found.model.terms) == set(LINEAR)
    expected = regress(found.model, data, constraints=TIE).estimates
    np.testing.assert_array_equal(found.estimates["estimate"], expected["estimate"])
    np.testing.assert_array_equal(found.estimates["stderr"], expected["stderr"])


def test_tied_terms_are_in_every_model_or_in_none(tied):
    assert set(tied.model.terms) == set(LINEAR)
    for text in tied.models["model"]:
        terms = set(text.split(" + "))
        assert ("alpha" in terms) == ("delta_e" in terms)


def test_the_spread_of_the_models_follows_the_constraint(data, tied):
    estimate, stderr, spread = (
        values(tied.fit, name) for name in ("estimate", "stderr", "stderr_models")
    )
    assert estimate["delta_e"] == pytest.approx(1.5 * estimate["alpha"], rel=1e-12)
    assert stderr["delta_e"] == pytest.approx(1.5 * stderr["alpha"], rel=1e-12)
    assert spread["delta_e"] == pytest.approx(1.5 * spread["alpha"], rel=1e-9)
    assert abs(estimate["alpha"] - LINEAR["alpha"]) < 2.0 * stderr["alpha"]
    alone = values(select_by_prediction("Cm", CANDIDATES, data).fit, "stderr")
    assert stderr["alpha"] < alone["alpha"]


def test_a_term_with_a_number_is_in_every_model(data):
    found = select_by_prediction("Cm", CANDIDATES, data, constraints=["qhat = -14"])
    assert values(found.fit)["qhat"] == pytest.approx(-14.0)
    assert values(found.fit, "stderr")["qhat"] == 0.0
    assert all("qhat" in text.split(" + ") for text in found.models["model"])
    assert not [one for one in found.fit.remarks if "damping" in one.text]
    zero = select_orthogonal("Cm", CANDIDATES, data, constraints=["qhat = 0"])
    assert "qhat" not in zero.model.terms
    assert [one for one in zero.fit.remarks if "a constraint makes it zero" in one.text]


def test_a_limit_acts_in_the_fit_of_the_selected_terms(data):
    found = select_stepwise("Cm", CANDIDATES, data, constraints=["alpha > -0.5", "qhat < 0"])
    assert values(found.fit)["alpha"] == -0.5
    rows = json.loads(found.estimates.attrs["constraints"])
    assert [row["active"] for row in rows] == [True, False]
    assert rows[0]["t"] < -3.0


def test_a_limit_that_zero_does_not_satisfy_brings_its_term(data):
    limits = ["alpha*delta_e < -2"]
    found = select_by_prediction("Cm", CANDIDATES, data, constraints=limits)
    assert values(found.fit)["alpha*delta_e"] == pytest.approx(-2.0, abs=1e-9)


def test_in_frequency(data):
    found = select_orthogonal("Cm", CANDIDATES, data, band=(0.1, 2.0), constraints=TIE)
    model = RegressionModel("Cm", found.model.terms)
    expected = regress_frequency(model, data, (0.1, 2.0), constraints=TIE)
    np.testing.assert_array_equal(found.estimates["estimate"], expected.estimates["estimate"])


def test_terms_that_are_not_in_the_model_are_zero_in_its_constraints(data):
    texts = ["alpha**2 = 0.5*qhat**2 + 2*delta_e**2 - 3", "alpha > 2*qhat + 0.25*delta_e"]
    ties = candidate_equations("Cm", CANDIDATES, data, None, constraints=texts).ties
    assert ties.constants == ("alpha**2",)
    assert ties.texts(["alpha**2", "delta_e**2"]) == ["alpha**2 = +2*delta_e**2 -3"]
    assert ties.texts(["qhat", "delta_e"]) == ["qhat < -0.125*delta_e"]
    assert ties.texts(["qhat", "alpha", "delta_e"]) == [texts[1]]


def test_refusals(data):
    with pytest.raises(SchemaError, match="no parameter 'beta'"):
        select_stepwise("Cm", CANDIDATES, data, constraints=["beta = 1"])
    with pytest.raises(SchemaError, match="contradicts"):
        select_stepwise("Cm", CANDIDATES, data, constraints=["qhat = 1", "qhat = 2"])
    still = data.assign(delta_f=("time", np.full(data.sizes["time"], 0.3)))
    with pytest.raises(IdentificationError, match="delta_f does not move"):
        select_stepwise("Cm", [*CANDIDATES, "delta_f"], still, constraints=["delta_f = alpha"])

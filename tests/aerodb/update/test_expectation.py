"""Standard errors expected of fits: those of `tabulate` when its weights are the a-priori ones."""

import numpy as np
import pytest
import xarray as xr

from aerodb.edit.term_edits import replace_terms
from aerodb.store.schema import make_database
from aerodb.store.schema import terms as schema_terms
from aerodb.update import draw
from aerodb.update.correlation import SHARES, prior_parts
from aerodb.update.expectation import Expectation
from aerodb.update.tabulation import tabulate
from aerodb.update.weights import weight_learning
from flightmech import terms
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress

DEG = np.pi / 180
ROOT = dict(
    title="test",
    aircraft="test",
    S=16.0,
    cbar=1.6,
    b=10.0,
    x_ref=0.0,
    y_ref=0.0,
    z_ref=0.0,
    force_axes="stability",
)


@pytest.fixture(scope="module")
def prior():
    alpha, mach = np.arange(-4, 13, 4.0) * DEG, np.array([0.2, 0.4])
    basic = np.repeat(0.2 + 5.0 * alpha[:, None], 2, axis=1)
    leaves = {
        "CL/basic": terms.make_term(
            basic,
            {"alpha": alpha, "mach": mach},
            stderr=np.full(basic.shape, 0.05),
            source="datcom",
        ),
        "CL/qhat": terms.make_term(
            np.full(2, 8.0), {"mach": mach}, ("qhat",), stderr=2.0, source="datcom"
        ),
        "CL/elevator": terms.make_term(0.5, {}, ("delta_e",), stderr=0.1, source="datcom"),
    }
    return make_database(leaves, **ROOT)


def fit(seed, alpha, mach, bias=0.0, shift=0.0, coefficient="CL"):
    """A local fit whose lift and incidence have an error of the instruments in common; `shift` is
    of the lift of this flight alone.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 8.0, 0.05)
    d = {
        "alpha": alpha + 2 * DEG * np.sin(t),
        "mach": mach + 0.0 * t,
        "qhat": 0.002 * np.sin(2.3 * t),
        "delta_e": 0.05 * np.cos(3.1 * t),
    }
    d["CL"] = (
        shift
        + 0.25
        + 5.2 * d["alpha"]
        + 7.0 * d["qhat"]
        + 0.45 * d["delta_e"]
        + 0.005 * rng.normal(size=len(t))
    )
    data = xr.Dataset({name: ("time", x) for name, x in d.items()}, {"time": t})
    if bias:
        shares = {"CL_error": 0.01 * d["CL"], "alpha_error": np.full(len(t), bias)}
        data = data.assign(
            {name: (("error", "time"), x[None]) for name, x in shares.items()}
        ).assign_coords(error=["bias.alpha"])
    data = data.rename({name: name.replace("CL", coefficient) for name in data if "CL" in name})
    model = RegressionModel.parse(f"{coefficient} = 1 + alpha + qhat + delta_e")
    return regress(model, data, f"fit {seed}")


@pytest.mark.slow
@pytest.mark.parametrize("held", [(), ("CL/elevator",)])
def test_it_is_what_tabulate_gives_with_the_weights_before_learning(prior, held, monkeypatch):
    fits = [
        fit(1, 1 * DEG, 0.22, bias=0.003),
        fit(2, 5 * DEG, 0.36, bias=0.003),
        fit(3, 3 * DEG, 0.3),
    ]
    tables = 3 - len(held)
    monkeypatch.setattr(
        weight_learning,
        "learn_weights",
        lambda y, *_: (np.append(np.tile(list(SHARES.values()), tables), 1.0), np.zeros(1)),
    )
    monkeypatch.setattr(weight_learning, "plain_probabilities", lambda *_: np.zeros(tables))
    monkeypatch.setattr(weight_learning, "_FREEDOM", 1e9)
    expected = Expectation(prior, held).stderr(fits)
    found = tabulate(fits, prior, held)
    assert set(expected) == set(found)
    for name, leaf in found.items():
        np.testing.assert_allclose(expected[name], leaf["stderr"].values, rtol=1e-9)


@pytest.mark.nightly
@pytest.mark.parametrize("held", [(), ("CL/elevator",)])
@pytest.mark.parametrize("shift", [0.0, 0.05])
@pytest.mark.filterwarnings("ignore:incompatible fits")  # with the shift they are
def test_with_what_tabulate_learnt_it_is_what_tabulate_gives(prior, held, shift):
    """Also where the fits disagree, and `tabulate` takes their errors for larger than declared."""
    fits = [
        fit(1, 1 * DEG, 0.22, bias=0.003),
        fit(2, 5 * DEG, 0.36, bias=0.003),
        *(fit(k, 1 * DEG, 0.22, shift=(2 * k - 7) * shift) for k in (3, 4)),
    ]
    found = tabulate(fits, prior, held)
    assert (found.points["weight"] == 1.0).all()  # no outlier, which an expectation does not know
    assert (found.compatibility["inflation"] > 1.5).all() == bool(shift)
    learnt = Expectation(prior, held, learnt=found).stderr(fits)
    a_priori = Expectation(prior, held).stderr(fits)
    for name, leaf in found.items():
        np.testing.assert_allclose(
            learnt[name], leaf["stderr"].values, rtol=1e-7
        )  # differences of close variances
    assert (
        max(
            np.abs(a_priori[name] / leaf["stderr"].values - 1.0).max()
            for name, leaf in found.items()
        )
        > 0.05
    )


def test_some_nodes_are_what_they_are_among_all(prior):
    fits = [fit(1, 1 * DEG, 0.22), fit(2, 5 * DEG, 0.36)]
    some = np.zeros((5, 2), bool)
    some[2, 1] = some[4, 0] = True
    every, chosen = (
        Expectation(prior).stderr(fits, wanted) for wanted in (None, {"CL/basic": some})
    )
    assert set(chosen) == {"CL/basic"}
    np.testing.assert_allclose(chosen["CL/basic"][some], every["CL/basic"][some], rtol=1e-9)
    assert np.isnan(chosen["CL/basic"][~some]).all()


def test_without_fits_nothing_changes(prior):
    wanted = {"CL/basic": np.ones((5, 2), bool)}
    np.testing.assert_array_equal(Expectation(prior).stderr([], wanted)["CL/basic"], 0.05)


def test_a_second_fit_adds_and_the_flown_region_is_that_of_tabulate(prior):
    fits = [fit(1, 1 * DEG, 0.22), fit(2, 5 * DEG, 0.36)]
    expectation = Expectation(prior)
    one, both = expectation.stderr(fits[:1])["CL/basic"], expectation.stderr(fits)["CL/basic"]
    assert both[2, 1] < 0.5 * one[2, 1]  # alpha 4 deg, Mach 0.4: flown by the second
    flown = expectation.flown(fits)["CL/basic"]
    source = tabulate(fits, prior)["CL/basic"]["source"].values == terms.SOURCES.index("flight")
    assert (source <= flown).all()
    assert source.any()


def test_parts_of_some_nodes_are_those_of_all(prior):
    leaf = prior["CL/basic"].to_dataset()
    sampled = np.array([0.0, 0.0, 0.4, 0.02, 0.9, 0.0, 0.3, 0.0, 0.0, 0.0])
    nodes = np.array([1, 3, 4, 9])
    every, some = prior_parts(leaf, sampled), prior_parts(leaf, sampled, nodes=nodes)
    np.testing.assert_allclose(some, every[:, nodes][:, :, nodes], rtol=1e-12)


def two_coefficients(prior):
    """The prior with a drag of the same shape, and fits of both with one error in common."""
    leaves = dict(schema_terms(prior))
    for name in list(leaves):
        leaves[name.replace("CL", "CD")] = leaves[name].copy()
    fits = [fit(1, 2 * DEG, 0.3, bias=0.004, coefficient=name) for name in ("CL", "CD")]
    return make_database(leaves, **ROOT), fits


def one_node(prior, name, node):
    gradient = np.zeros((1, *schema_terms(prior)[name]["value"].shape))
    gradient[(0, *node)] = 1.0
    return {name: gradient}


def test_the_gradient_of_one_node_gives_its_standard_error(prior):
    fits = [fit(1, 1 * DEG, 0.22, bias=0.003), fit(2, 5 * DEG, 0.36, bias=0.003)]
    expectation = Expectation(prior, held=["CL/elevator"])
    expected = expectation.stderr(fits)
    for name, node in (("CL/basic", (2, 1)), ("CL/qhat", (0,))):
        found = expectation.stderr_of(fits, one_node(prior, name, node))
        np.testing.assert_allclose(found, expected[name][node], rtol=1e-9)
    # without information a node keeps its declared error
    for given in ([], fits):
        np.testing.assert_allclose(
            expectation.stderr_of(given, one_node(prior, "CL/elevator", ())), 0.1
        )


def test_errors_that_coefficients_share_add_up(prior):
    """An error of alpha moves lift and drag alike; in their difference it cancels."""
    both, fits = two_coefficients(prior)
    expectation = Expectation(both)
    lift, drag = one_node(both, "CL/basic", (2, 1)), one_node(both, "CD/basic", (2, 1))
    alone = np.array([expectation.stderr_of(fits, part)[0] for part in (lift, drag)])
    total = expectation.stderr_of(fits, {**lift, **drag})[0]
    difference = expectation.stderr_of(fits, {**lift, "CD/basic": -drag["CD/basic"]})[0]
    np.testing.assert_allclose(total**2 + difference**2, 2.0 * (alone**2).sum(), rtol=1e-9)
    assert total > 1.1 * difference


@pytest.mark.slow
def test_a_sum_of_nodes_scatters_as_draws_of_the_tables(prior, monkeypatch):
    fits = [fit(1, 1 * DEG, 0.22, bias=0.003), fit(2, 5 * DEG, 0.36, bias=0.003)]
    weights = np.append(np.tile(list(SHARES.values()), 3), 1.0)
    monkeypatch.setattr(weight_learning, "learn_weights", lambda y, *_: (weights, np.zeros(1)))
    monkeypatch.setattr(weight_learning, "plain_probabilities", lambda *_: np.zeros(3))
    monkeypatch.setattr(weight_learning, "_FREEDOM", 1e9)
    nodes = draw(replace_terms(prior, dict(tabulate(fits, prior))), 4000, seed=3)
    rng = np.random.default_rng(0)
    gradients = {name: rng.normal(size=(5, *nodes[name].shape[1:])) for name in nodes}
    gradients["CL/qhat"] *= 0.01
    drawn = np.zeros((4000, 5))
    for name, gradient in gradients.items():
        flat = gradient.reshape(5, -1)
        drawn += nodes[name].reshape(4000, -1) @ flat.T
    np.testing.assert_allclose(
        Expectation(prior).stderr_of(fits, gradients), drawn.std(axis=0), rtol=0.06
    )

"""Weights of fits that join tables: wrong fits are outvoted and listed by name."""

import numpy as np
import pytest
import xarray as xr

import aerodb
from aerodb.store.schema import make_database
from aerodb.update.correlation import LENGTHS, prior_parts
from aerodb.update.observations import observe_fits, sampled_weights
from aerodb.update.posterior import covariance_between_nodes
from aerodb.update.tabulation import tabulate
from aerodb.update.weights.weight_learning import weigh_fits
from flightmech import terms
from flightmech.units import DEGREE
from flighttest.regression.combining.published import published_fit
from flighttest.regression.equation_error.model import RegressionModel

pytestmark = pytest.mark.filterwarnings("ignore::flightmech.errors.AeromatchWarning")

ALPHA, MACH = np.arange(-4.0, 15.0, 2.0), np.array([0.2, 0.35, 0.5, 0.65])
STDERR = {"1": 0.004, "alpha": 0.1}
ROOT = dict(title="test", aircraft="test", force_axes="stability", S=20.0, cbar=2.0, b=12.0)
ROOT |= dict(x_ref=0.0, y_ref=0.0, z_ref=0.0)


def prior_and_truth() -> tuple[xr.DataTree, np.ndarray]:
    """A handbook that is wrong by a wave over the table, and the true nodes."""
    a, m = np.meshgrid(ALPHA, MACH, indexing="ij")
    truth = 0.25 + 0.085 * a / np.sqrt(1 - m * m)
    error = 0.02 + 0.04 * np.sin(0.25 * a + 4 * m)
    axes = {"alpha": ALPHA * DEGREE, "mach": MACH}
    leaf = terms.make_term(truth + error, axes, stderr=np.full(a.shape, 0.05), source="datcom")
    return make_database({"CL/basic": leaf}, **ROOT), truth


def local_models(truth: np.ndarray, seed: int, wrong: dict[int, tuple[float, float]]) -> list:
    """Thirty-six models `CL = 1 + alpha`; some are wrong by numbers of standard errors."""
    random = np.random.default_rng(seed)
    axes = {"alpha": ALPHA * DEGREE, "mach": MACH}
    table = terms.make_term(truth, axes, stderr=np.ones(truth.shape), source="flight")
    fits = []
    for k in range(36):
        a, m = random.uniform(-2.5, 8.0), random.uniform(0.22, 0.6)
        along = np.linspace(a - 1.2, a + 1.2, 25)
        at = {"alpha": along * DEGREE, "mach": np.full(25, m)}
        X = np.stack([np.ones(25), (along - a) * DEGREE], axis=1)
        value = np.linalg.lstsq(X, terms.evaluate_term(table, at, "clamp"), rcond=None)[0]
        scale = np.array(list(STDERR.values()))
        value = value + scale * (random.standard_normal(2) + wrong.get(k, (0.0, 0.0)))
        model = RegressionModel("CL", ("1", "alpha"), reference={"alpha": a * DEGREE})
        conditions = {"alpha": (along[0] * DEGREE, along[-1] * DEGREE), "mach": m}
        estimates = dict(zip(STDERR, value))
        fits.append(published_fit(model, estimates, STDERR, conditions, name=f"point {k}"))
    return fits


@pytest.mark.nightly
@pytest.mark.parametrize("off", [(6.0, 0.0), (0.0, 6.0), (30.0, -30.0)], ids=str)
def test_one_wrong_fit_of_36_is_listed_by_name_and_outvoted(off: tuple[float, float]) -> None:
    prior, truth = prior_and_truth()
    fits = local_models(truth, 5, {12: off})
    new = tabulate(fits, prior)
    assert new.points.index[new.points["suspect"]].tolist() == [("CL", "point 12")]
    without = tabulate([*fits[:12], *fits[13:]], prior)["CL/basic"]
    flown = new["CL/basic"]["flown_distance"].values == 0
    moved = np.abs(new["CL/basic"]["value"] - without["value"]).values / without["stderr"].values
    assert moved[flown].max() < 1.5
    updated = aerodb.replace_terms(prior, new)
    for text in (updated.attrs["history"], updated.attrs["notices"]):
        assert "suspect fits: point 12 (CL, " in text


@pytest.mark.nightly
def test_several_wrong_fits_do_not_hide_each_other() -> None:
    prior, truth = prior_and_truth()
    wrong = {3: (12.0, 0.0), 12: (-9.0, 0.0), 20: (9.0, 9.0), 30: (0.0, -12.0)}
    new = tabulate(local_models(truth, 6, wrong), prior)
    assert set(np.flatnonzero(new.points["suspect"])) == set(wrong)


@pytest.mark.nightly
def test_ten_starts_of_the_weights_end_in_one() -> None:
    prior, truth = prior_and_truth()
    fits = local_models(truth, 7, {3: (8.0, 0.0), 12: (-6.0, 0.0)})
    ((coefficient_terms, observed),) = observe_fits(fits, prior, ())
    (leaf,) = coefficient_terms.free.values()
    H, D = (np.vstack([getattr(fit, name) for fit in observed]) for name in "HD")
    y = np.concatenate([fit.theta for fit in observed]) - H @ leaf["value"].values.ravel()
    expected = H @ prior_parts(leaf, sampled_weights(observed), LENGTHS) @ H.T
    random = np.random.default_rng(8)
    ends = [weigh_fits(y, observed, D, expected)]
    for _ in range(9):
        start = np.exp(random.uniform(-5.0, 0.0, 36))
        ends.append(weigh_fits(y, observed, D, expected, start))
    for end in ends[1:]:
        np.testing.assert_allclose(end.weight, ends[0].weight, rtol=1e-4)
        np.testing.assert_allclose(end.factors, ends[0].factors, rtol=1e-4)
    # The end is a fixed point: a further round from it changes nothing.
    again = weigh_fits(y, observed, D, expected, ends[0].weight)
    np.testing.assert_allclose(again.weight, ends[0].weight, rtol=1e-5)


@pytest.mark.slow
def test_without_a_majority_no_fit_is_chosen() -> None:
    """Two fits of one place that contradict each other keep their weights; both are inaccurate."""
    prior, truth = prior_and_truth()
    pair = [local_models(truth, 9, {0: (off, 0.0)})[0] for off in (0.0, 12.0)]
    new = tabulate(pair, prior)
    assert new.points["weight"].tolist() == [1.0, 1.0]
    assert new.compatibility.loc["CL", "inflation"] > 1.5


@pytest.mark.slow
def test_databases_without_a_stored_reach_keep_theirs() -> None:
    """The fade of the a-priori correlation has one correlation length, and earlier ones half.

    `long` of databases without `medium` fades alike.
    """
    prior, truth = prior_and_truth()
    leaf = tabulate(local_models(truth, 9, {})[:1], prior)["CL/basic"]
    for name in ("level", "long", "medium", "short"):
        leaf["prior_error"].attrs[name] = 0.0
    distance = leaf["flown_distance"].values.ravel()
    i, j = np.argmin(distance), np.argmax(distance)
    for reach in (1.0, 0.5):
        P = covariance_between_nodes(leaf, np.array([i, i]), np.array([i, j]))
        assert P[1] / P[0] == pytest.approx(np.exp(-(distance[j] - distance[i]) / reach))
        leaf["prior_error"].attrs.pop("reach_length", None)
    leaf["prior_error"].attrs |= {"reach": 0.0, "long": 1.0, "reach_length": 1.0}
    later = covariance_between_nodes(leaf, np.array([i, i]), np.array([i, j]))
    del leaf["prior_error"].attrs["medium"]
    earlier = covariance_between_nodes(leaf, np.array([i, i]), np.array([i, j]))
    assert earlier[0] == later[0]
    assert earlier[1] / later[1] == pytest.approx(np.exp(-(distance[j] - distance[i])))

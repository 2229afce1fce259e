"""Tables over the height: where they end, and one factor for all terms."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from flighttest.regression.equation_error.model import RegressionModel, term_regressors
from flighttest.regression.equation_error.samples import stack_samples
from flighttest.submodels.ground_effect.evidence import schwarz_criterion
from flighttest.submodels.ground_effect.structure import height_breakpoints
from flighttest.submodels.ground_effect.tables import ONE_FACTOR, SEPARATE, TableSearch

pytestmark = pytest.mark.slow

LIFT = RegressionModel.parse("CL = 1 + alpha")
FREE = {"1": 0.45, "alpha": 5.0}


def plateau(h):
    """Factor of all terms as the T-37 has it: constant up to 3 m, zero from 6 m on."""
    return np.interp(h, [3.0, 6.0], [0.03, 0.0])


def record(h, seed, excursion, factors=(plateau, plateau), noise=0.0) -> xr.Dataset:
    """Record with an angle of attack that oscillates, and noise of its measurement. [rad]"""
    rng = np.random.default_rng(seed)
    t = np.arange(len(h)) * 0.1
    alpha = 0.07 + excursion * np.sin(0.9 * t + seed) + 0.5 * excursion * np.sin(2.3 * t)
    of_1, of_alpha = factors
    CL = FREE["1"] * (1.0 + of_1(h)) + FREE["alpha"] * alpha * (1.0 + of_alpha(h))
    columns = {
        "alpha": alpha + noise * rng.normal(size=len(h)),
        "CL": CL + 0.003 * rng.normal(size=len(h)),
        "h_agl": h,
    }
    return xr.Dataset({name: ("time", v) for name, v in columns.items()}, {"time": t})


def programme(factors=(plateau, plateau)) -> list[xr.Dataset]:
    """Low passes and a record in free air with an oscillation; above 9 m one descent without it."""
    passes = [
        record(np.full(300, h), k, excursion=0.02, factors=factors)
        for k, h in enumerate((1.5, 2.2, 3.2, 4.2, 8.0, 500.0))
    ]
    descent = 1.5 + 60.0 * np.exp(-np.arange(300) / 60.0)
    return [*passes, record(descent, 9, excursion=0.0, factors=factors, noise=0.001)]


def search(records, held=None) -> tuple[TableSearch, float]:
    """Return the search, and the criterion without ground effect."""
    samples = stack_samples("CL", ["CL", "alpha", "h_agl"], records, LIFT)
    h, z = samples.data["h_agl"].values, samples.data["CL"].values
    X = LIFT.design(samples.data)
    if held:
        z, X = z - X @ np.array(list(held.values())), X[:, :0]
    found = TableSearch(
        X,
        LIFT.terms,
        ground=LIFT.terms,
        regressors=term_regressors(tuple(LIFT.terms), samples.data).T,
        samples=samples,
        h=h,
        z=z,
        heights=height_breakpoints(h),
        n=float(len(z)),
        held=held or {},
    )
    v = z - X @ np.linalg.lstsq(X, z, rcond=None)[0] if X.shape[1] else z
    return found, schwarz_criterion(v, X.shape[1], len(z))


@pytest.mark.nightly
def test_a_table_ends_where_one_record_with_one_angle_of_attack_remains():
    """There the slope is that of the noise of the vane: K was -1 of alpha and +0.8 of the constant,
    and both cancel at the flown angle only.
    """
    found, nothing = search(programme())
    ends = {k: found.nodes for k in (0, 1)}
    all_nodes = found._fit_separate(ends)
    of_alpha = all_nodes.value[1] / FREE["alpha"]
    assert np.abs(of_alpha).max() > 0.5
    table = found.determined((0, 1))
    assert table.form == SEPARATE
    for row, term in enumerate(table.terms):
        K = table.value[row] / FREE[term]
        assert np.abs(K).max() < 0.08
        assert table.end(term) < 12.0
    # What was set to zero is known to what it was.
    high = table.heights > 12.0
    assert (table.stderr[table.terms.index("alpha"), high][:-1] > 0.0).all()
    assert found.separate(nothing) is not None


@pytest.mark.nightly
@pytest.mark.parametrize("held", [None, FREE])
def test_one_factor_is_the_truth_where_all_terms_have_it(held):
    table = search(programme(), held)[0].one_factor()
    assert table.form == ONE_FACTOR
    assert table.terms == ("1", "alpha")
    nodes = np.flatnonzero(table.heights < 5.0)
    for row, term in enumerate(table.terms):
        K = table.value[row] / FREE[term]
        stderr = table.stderr[row] / FREE[term]
        np.testing.assert_allclose(K[nodes], plateau(table.heights[nodes]), atol=0.003)
        assert (np.abs(K - plateau(table.heights)) <= 3.0 * stderr + 0.003).all()
    assert table.end("alpha") < 12.0


def test_one_factor_has_the_error_of_that_assumption():
    """The constant has a ground effect, the slope has none: the difference is in the error."""
    table = search(programme((plateau, lambda h: 0.0 * h)))[0].one_factor()
    for row, (term, factor) in enumerate(zip(table.terms, (plateau, lambda h: 0.0 * h))):
        error = table.value[row, 0] / FREE[term] - factor(table.heights[0])
        assert abs(error) > 0.005
        assert abs(error) < 2.0 * table.stderr[row, 0] / FREE[term]


@pytest.mark.nightly
def test_without_ground_effect_there_is_no_table():
    def none(h):
        return 0.0 * h

    found, nothing = search(programme((none, none)))
    table = found.separate(nothing)
    assert table is None or np.abs(table.value).max() < 0.005
    assert found.one_factor() is None

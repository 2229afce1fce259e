"""Laws of a ground effect other than the power law, and what a form leaves."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import aerodb
from flightmech.terms import make_term
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.submodels.ground_effect.database_terms import replace_ground_effect
from flighttest.submodels.ground_effect.evidence import RichestForm, misfit_of
from flighttest.submodels.ground_effect.identification import identify_ground_effect
from flighttest.submodels.ground_effect.laws import (
    EXPONENTIAL,
    LAWS,
    POWER,
    SPAN,
    interference_factor,
)

HEIGHTS = np.array([2.0, 3.0, 8.5])
LIFT = RegressionModel.parse("CL = 1 + alpha")
# K of the constant and of alpha; one shape parameter where two are within a sixth is a form too.
TRUTHS = {
    POWER: (lambda h: 0.5 * h**-1.4, lambda h: 0.6 * h**-1.6),
    EXPONENTIAL: (lambda h: 0.62 * np.exp(-h / 2.6), lambda h: 0.3 * np.exp(-h / 2.2)),
    SPAN: (lambda h: 0.45 / (1 + (h / 3.0) ** 2), lambda h: 0.3 / (1 + (h / 2.5) ** 2)),
}


def slow_noise(rng: np.random.Generator, count: int) -> np.ndarray:
    """Noise of 0.4 s, a third of it white."""
    v = np.zeros(count)
    for k in range(1, count):
        v[k] = 0.78 * v[k - 1] + 0.63 * rng.normal()
    return 0.004 * v + 0.003 * rng.normal(size=count)


def record(h, alpha, seed, factors) -> xr.Dataset:
    rng = np.random.default_rng(seed)
    t = np.arange(len(h)) * 0.1
    a = alpha + 0.02 * np.sin(0.9 * t + seed) + 0.01 * np.sin(2.3 * t)
    of_1, of_alpha = factors
    CL = 0.7 * (1 + of_1(h)) + 5.2 * a * (1 + of_alpha(h)) + slow_noise(rng, len(h))
    columns = {"alpha": a, "CL": CL, "h_agl": h}
    return xr.Dataset({name: ("time", v) for name, v in columns.items()}, {"time": t})


def programme(factors, seed: int = 0) -> list[xr.Dataset]:
    """Four landings, three low passes and two records in free air."""
    records = []
    for k, alpha in enumerate((0.09, 0.05, 0.07, 0.06)):
        descent = 1.7 + 40.0 * np.exp(-np.arange(300) / 45.0)
        records.append(record(descent, alpha, seed + k, factors))
    for k, h in enumerate((2.4, 3.8, 7.5)):
        records.append(record(np.full(280, h), 0.06, seed + 10 + k, factors))
    for k, alpha in enumerate((0.08, 0.03)):
        records.append(record(np.full(280, 300.0), alpha, seed + 20 + k, factors))
    return records


@pytest.fixture(scope="module", params=LAWS, ids=lambda law: law.name)
def identified(request):
    factors = TRUTHS[request.param]
    return request.param, factors, identify_ground_effect([LIFT], programme(factors))["CL"]


@pytest.mark.slow
def test_the_law_of_the_truth_is_taken_and_its_factor_is_right(identified):
    """With the power law alone an exponential truth was 4 to 6 standard errors wrong."""
    law, factors, one = identified
    assert one.form in (law.name, law.common_form())
    assert one.taken_terms == ("1", "alpha")
    assert one.row("1").law == law.name
    for term, truth in zip(one.taken_terms, factors):
        found = one.taken_factor(term, HEIGHTS)
        error = found["K"].values - truth(HEIGHTS)
        assert (np.abs(error) < 3.0 * found["stderr"].values).all()
        assert (found["stderr"].values < 0.1).all()
    assert one.misfit is not None
    assert not one.misfit.is_significant
    assert not one.warnings


@pytest.mark.nightly
def test_the_database_flies_the_law(identified):
    """The kernel has the power law in closed form, the others as a table within 1e-3."""
    law, _, one = identified
    alpha = np.radians([-10.0, 0.0, 10.0, 20.0])
    leaves = {"CL/basic": make_term(0.7 + 5.2 * alpha, {"alpha": alpha}, source="datcom")}
    lengths = {"S": 27.0, "cbar": 2.2, "b": 15.1, "x_ref": 0.0, "y_ref": 0.0, "z_ref": 0.0}
    database = aerodb.make_database(
        leaves, title="t", aircraft="a", force_axes="stability", **lengths
    )
    found = identify_ground_effect([LIFT], programme(TRUTHS[law]))
    new = replace_ground_effect(database, found)
    assert aerodb.check(new) == []
    assert ("K1" in aerodb.terms(new)["CL/ground_basic"]) == (law is not POWER)
    h = np.array([2.0, 3.3, 8.5, 40.0])
    added = aerodb.evaluate(new, "CL", "clamp", alpha=0.08, h_agl=h) - (0.7 + 5.2 * 0.08)
    expected = 0.0
    for term, free in (("1", 0.7), ("alpha", 5.2 * 0.08)):
        expected = expected + free * one.factor(term, h, one.form)["K"].values
    np.testing.assert_allclose(added, expected, atol=1e-3)
    # Below the records all factors grow as Prandtl's, and the error of a term contains the growth.
    floor = one.heights[0]
    low, at_floor = aerodb.evaluate(new, "CL", "clamp", alpha=0.08, h_agl=np.array([1.0, floor]))
    growth = (low - (0.7 + 5.2 * 0.08)) / (at_floor - (0.7 + 5.2 * 0.08))
    assert growth == pytest.approx(
        interference_factor(1.0 / 15.1) / interference_factor(floor / 15.1), rel=2e-3
    )
    leaf = aerodb.terms(new)["CL/ground_basic"]
    largest = float(leaf["K1"].max()) if "K1" in leaf else 1.0
    share = float((leaf["stderr"] / (largest * np.abs(leaf["value"]))).min())
    assert share > 1.0 - 1.0 / growth
    assert "Prandtl" in leaf.attrs["comment"]
    # the slope over alpha keeps its nodes at -10, 0, 10 and 20 deg: landings had 1 to 7 deg
    assert one.flown["alpha"] == pytest.approx((0.020, 0.120), abs=0.005)
    sloped = aerodb.terms(new)["CL/ground_basic_alpha"]
    assert sloped["source"].values.tolist() == [2, 1, 1, 2]
    assert leaf["source"].values.tolist() == 1


def test_prandtls_factor_has_the_values_of_the_report():
    """NACA TM 77: sigma = (1 - 1.32 h/b) / (1.05 + 7.4 h/b) between h/b of 1/15 and 1/2."""
    assert interference_factor(0.1) == pytest.approx(0.868 / 1.79)
    assert interference_factor(0.5) == pytest.approx(0.34 / 4.75)
    assert interference_factor(0.01) == interference_factor(1.0 / 15.0)
    assert interference_factor(2.0) == interference_factor(0.5)


@pytest.mark.nightly
def test_a_refused_ground_effect_of_the_database_is_deleted():
    """The prior has 0.2 at 2 m, the flights have none: "taken: none" left the prior in place."""
    none = (lambda h: 0.0 * h, lambda h: 0.0 * h)
    alpha = np.radians([-10.0, 20.0])
    leaves = {
        "CL/basic": make_term(0.7 + 5.2 * alpha, {"alpha": alpha}, source="datcom"),
        "CL/ground": make_term([0.2, 0.0], {"h_agl": [2.0, 20.0]}, source="datcom"),
    }
    lengths = {"S": 27.0, "cbar": 2.2, "b": 15.1, "x_ref": 0.0, "y_ref": 0.0, "z_ref": 0.0}
    database = aerodb.make_database(
        leaves, title="t", aircraft="a", force_axes="stability", **lengths
    )
    found = identify_ground_effect([LIFT], programme(none), database=database)
    assert found["CL"].form == "none"
    assert found["CL"].refuses_database
    assert set(aerodb.terms(replace_ground_effect(database, found))) == {"CL/basic"}


@pytest.mark.nightly
def test_one_shape_parameter_has_the_error_of_that_assumption():
    """h0 of 2.6 and 2.2 m: one h0 was 4.7 standard errors wrong for alpha at 8.5 m."""
    one = identify_ground_effect([LIFT], programme(TRUTHS[EXPONENTIAL]))["CL"]
    common = EXPONENTIAL.common_form()
    together = one.factor("alpha", HEIGHTS, common)
    apart = one.factor("alpha", HEIGHTS, EXPONENTIAL.name)
    difference = np.abs(together["K"].values - apart["K"].values)
    assert (together["stderr"].values >= difference).all()


@pytest.mark.nightly
def test_a_form_that_leaves_more_than_the_noise_is_named():
    """A step at 5 m: no law and no table linear between breakpoints has it."""

    def step(h):
        return np.where(h < 5.0, 0.3, 0.0)

    found = identify_ground_effect([LIFT], programme((step, lambda h: 0.0 * h)))
    assert found["CL"].misfit.is_significant
    (warning,) = found.warnings
    assert "does not fit" in warning
    assert f"! {warning}" in found.report()


def test_the_misfit_of_noise_is_small_and_that_of_a_wave_is_not():
    rng = np.random.default_rng(4)
    v = rng.normal(size=2000)
    richest = RichestForm(v, 20, 2000.0)
    assert not misfit_of("table", v * np.sqrt(1.0 + 10.0 / 2000.0), 10, richest).is_significant
    wave = v + 0.5 * np.sin(np.arange(2000) / 30.0)
    assert misfit_of("table", wave, 10, richest).is_significant
    assert misfit_of("table", v, 20, richest) is None


@pytest.mark.nightly
def test_terms_that_cancel_each_other_are_deleted():
    """Without a ground effect two collinear terms are large and opposite: k of -7.6 and 31.7."""
    none = (lambda h: 0.0 * h, lambda h: 0.0 * h)
    model = RegressionModel.parse("CL = 1 + alpha + alpha^2")
    for seed in (100, 200, 300):
        one = identify_ground_effect([model], programme(none, seed))["CL"]
        assert one.form == "none"
        assert one.taken_terms == ()

"""Local models from the literature: they contribute the same to the tables as the samples that they
came from.
"""

import numpy as np
import pytest
import xarray as xr

import aerodb
import flighttest
from aerodb.update.observations import basis_at
from flightmech import terms
from flightmech.errors import AeromatchWarning, IdentificationError, SchemaError, UnknownName

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
ALPHA = np.radians(np.arange(-8.0, 21.0, 4.0))
LOCAL = "Cm = 1 + alpha + qhat + delta_e"
VALUES = {"1": 0.03, "alpha": -0.56, "qhat": -17.6, "delta_e": -1.16}
STDERR = {"1": 0.01, "alpha": 0.06, "qhat": 1.8, "delta_e": 0.12}
AT = {"mach": 0.27, "alpha": 0.1, "delta_e": 0.0, "qhat": 0.0}


def leaves(bend=1.0):
    """Pitching moment that bends with alpha, and changes with Mach number."""
    basic = 0.05 - 0.5 * ALPHA[:, None] - bend * ALPHA[:, None] ** 2 * np.array([1.0, 1.2])
    return {
        "Cm/basic": terms.make_term(
            basic, {"alpha": ALPHA, "mach": [0.2, 0.4]}, stderr=0.05, source="datcom"
        ),
        "Cm/qhat": terms.make_term(
            [-14.0, -15.0], {"mach": [0.2, 0.4]}, ["qhat"], stderr=3.0, source="datcom"
        ),
        "Cm/alphadothat": terms.make_term(-6.0, {}, ["alphadothat"], stderr=2.0, source="datcom"),
        "Cm/elevator": terms.make_term(
            np.full(len(ALPHA), -1.4), {"alpha": ALPHA}, ["delta_e"], stderr=0.3, source="datcom"
        ),
    }


def expected(fit, tables):
    """What the tables make of the local model, by the definition in `aerodb.update.tabulation`: H
    g.
    """
    g = sum(basis_at(leaf, fit.data) @ leaf["value"].values.ravel() for leaf in tables.values())
    return dict(zip(fit.model.terms, np.linalg.lstsq(fit.design.values, g, rcond=None)[0]))


def test_one_condition_is_a_tangent_of_the_tables():
    """Inside a cell the slope of the cell, on a breakpoint the mean of both sides."""
    tables = leaves()
    value = tables["Cm/basic"]["value"].interp(mach=0.27)
    for alpha, cells in ((0.1, [3]), (ALPHA[4], [3, 4])):
        found = expected(
            flighttest.combining.published_fit(LOCAL, VALUES, STDERR, AT | {"alpha": alpha}), tables
        )
        slope = np.mean([(value[k + 1] - value[k]) / (ALPHA[k + 1] - ALPHA[k]) for k in cells])
        assert found["alpha"] == pytest.approx(slope, rel=1e-9)
        # the constant is that of the tangent, extended to alpha 0; between the sides of a kink 1e-4
        # rad from it
        assert found["1"] == pytest.approx(
            float(value.interp(alpha=alpha)) - slope * alpha, abs=1e-4
        )
        assert found["qhat"] == pytest.approx(-14.35, rel=1e-9)
        assert found["delta_e"] == pytest.approx(-1.4, rel=1e-9)


def test_an_expansion_about_a_point_has_the_value_of_the_tables_there():
    model = flighttest.RegressionModel("Cm", ["1", "alpha"], {"alpha": 0.1})
    found = expected(
        flighttest.combining.published_fit(
            model, {"1": 0.0, "alpha": -0.6}, {"1": 0.01, "alpha": 0.1}, AT
        ),
        leaves(),
    )
    assert found["1"] == pytest.approx(
        float(leaves()["Cm/basic"]["value"].interp(mach=0.27, alpha=0.1)), abs=1e-12
    )


def test_a_range_is_the_least_squares_line_through_the_tables():
    """Against a regression of the tables over ten thousand conditions."""
    tables, rng = leaves(), np.random.default_rng(0)
    low, high = -0.05, 0.3
    found = expected(
        flighttest.combining.published_fit(LOCAL, VALUES, STDERR, AT | {"alpha": (low, high)}),
        tables,
    )
    alpha = np.linspace(low, high, 10001)
    line = np.polyfit(alpha, tables["Cm/basic"]["value"].interp(mach=0.27, alpha=alpha).values, 1)
    # 33 points along a range: ends weigh more than in an integral
    np.testing.assert_allclose([found["alpha"], found["1"]], line, rtol=0.02)
    curved = "Cm = 1 + alpha + alpha**2 + ramp(alpha, 8 deg) + delta_e + alpha*delta_e"
    model = flighttest.RegressionModel.parse(curved)
    ones = dict.fromkeys(model.terms, 1.0)
    found = expected(
        flighttest.combining.published_fit(
            model, ones, ones, AT | {"alpha": (low, high), "delta_e": (-0.2, 0.1)}
        ),
        tables,
    )
    data = xr.Dataset(
        {
            "alpha": ("sample", rng.uniform(low, high, 20000)),
            "delta_e": ("sample", rng.uniform(-0.2, 0.1, 20000)),
        }
    )
    data = data.assign(
        mach=("sample", np.full(20000, 0.27)),
        qhat=("sample", np.zeros(20000)),
        alphadothat=("sample", np.zeros(20000)),
    )
    z = sum(basis_at(leaf, data) @ leaf["value"].values.ravel() for leaf in tables.values())
    other = np.linalg.lstsq(model.design(data), z, rcond=None)[0]
    np.testing.assert_allclose([found[t] for t in model.terms], other, rtol=0.05, atol=0.02)


def test_a_variable_that_moves_with_another_gives_the_sum_of_both_derivatives():
    alone = expected(flighttest.combining.published_fit(LOCAL, VALUES, STDERR, AT), leaves())
    both = expected(
        flighttest.combining.published_fit(LOCAL, VALUES, STDERR, AT | {"alphadothat": "qhat"}),
        leaves(),
    )
    assert both["qhat"] - alone["qhat"] == pytest.approx(-6.0, rel=1e-9)


def flown(tables, seed):
    """A flight elsewhere: samples spread over alpha -3 to 11 deg, independent disturbances.

    Each alpha is flown at both signs of pitch rate: a chance correlation of pitch rate with the
    bend of the tables, which the published numbers cannot show, would change what the tables learn
    from the samples.
    """
    rng, n = np.random.default_rng(seed), 400
    qhat = 0.002 * rng.normal(size=n // 2)
    d = {
        "alpha": np.tile(rng.uniform(-0.05, 0.2, n // 2), 2),
        "qhat": np.concatenate([qhat, -qhat]),
    }
    d["delta_e"] = np.tile(rng.uniform(-0.1, 0.1, n // 2), 2)
    d |= {"mach": np.full(n, 0.27), "alphadothat": np.zeros(n)}
    data = xr.Dataset({name: ("time", x) for name, x in d.items()}, {"time": 0.02 * np.arange(n)})
    samples = data.rename(time="sample").drop_vars("sample")
    z = sum(basis_at(leaf, samples) @ leaf["value"].values.ravel() for leaf in tables.values())
    return data.assign(Cm=("time", z + 0.01 * rng.normal(size=n)))


@pytest.mark.slow
def test_tables_learn_the_same_from_the_published_numbers_as_from_the_samples():
    """The tables bend, the model is straight: only the range shows what its slope is a slope of."""
    prior, truth = aerodb.make_database(leaves(0.0), **ROOT), leaves(1.0)
    fit = flighttest.regress(flighttest.RegressionModel.parse(LOCAL), flown(truth, 1), "samples")
    e = fit.estimates
    values, stderr = (
        {t: float(e[key].sel(term=t)) for t in VALUES} for key in ("estimate", "stderr")
    )
    ranges = {"mach": 0.27, "alpha": (-0.05, 0.2), "delta_e": (-0.1, 0.1), "qhat": (-0.004, 0.004)}
    printed = flighttest.combining.published_fit(
        LOCAL, values, stderr, ranges, e["correlation"].values, "paper"
    )
    ours, theirs = (aerodb.tabulate([one], prior) for one in (fit, printed))
    for name in ours:
        apart = np.abs(ours[name]["value"] - theirs[name]["value"]) / ours[name]["stderr"]
        assert float(apart.max()) < 0.25, name  # 400 random samples are not an even grid
        np.testing.assert_allclose(ours[name]["stderr"], theirs[name]["stderr"], rtol=0.1)
    assert (
        theirs.points.loc[("Cm", "paper"), "rms"] < theirs.points.loc[("Cm", "paper"), "rms_prior"]
    )
    assert "paper" in theirs["Cm/basic"].attrs["comment"]


@pytest.mark.nightly
def test_two_standard_errors_cover_the_tables_after_published_models():
    """Published models of 20 tables drawn from the prior, all nodes; 96.2 % over 300."""
    from aerodb.update.correlation import prior_covariance

    prior = leaves()
    inside = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        truth = {}
        for name, leaf in prior.items():
            P = prior_covariance(leaf)
            change = np.linalg.cholesky(P + 1e-10 * np.diag(np.diag(P))) @ rng.normal(size=len(P))
            truth[name] = leaf.assign(value=leaf["value"] + change.reshape(leaf["value"].shape))
        fit = flighttest.combining.published_fit(LOCAL, VALUES, STDERR, AT | {"alpha": (0.0, 0.15)})
        seen = expected(fit, truth)
        values = {t: seen[t] + STDERR[t] * rng.normal() for t in VALUES}
        fit = flighttest.combining.published_fit(LOCAL, values, STDERR, AT | {"alpha": (0.0, 0.15)})
        new = aerodb.tabulate([fit], aerodb.make_database(prior, **ROOT))
        inside += [
            np.mean(np.abs(new[k]["value"] - truth[k]["value"]) < 2 * new[k]["stderr"]) for k in new
        ]
    assert 0.88 < np.mean(inside) < 0.99


def test_published_and_flown_fits_are_joined():
    truth = leaves(0.0)
    fit = flighttest.regress(flighttest.RegressionModel.parse(LOCAL), flown(truth, 2), "flight")
    printed = flighttest.combining.published_fit(LOCAL, VALUES, STDERR, AT, name="paper")
    joined = flighttest.combining.join_fits([fit, printed])
    for term in ("qhat", "delta_e"):
        a, b, c = (float(x.estimates["estimate"].sel(term=term)) for x in (fit, printed, joined))
        assert min(a, b) < c < max(a, b)
    alone = flighttest.combining.join_fits([printed, printed]).estimates
    np.testing.assert_allclose(alone["estimate"], list(VALUES.values()), rtol=1e-12)
    np.testing.assert_allclose(
        alone["stderr"], np.array(list(STDERR.values())) / np.sqrt(2), rtol=1e-12
    )


@pytest.mark.nightly
def test_a_published_fit_is_saved_reported_and_predicts(tmp_path):
    fit = flighttest.combining.published_fit(
        LOCAL, VALUES, STDERR, AT | {"alpha": (0.0, 0.2)}, name="paper"
    )
    text = fit.report()
    assert text.splitlines()[:2] == [
        "paper: Cm = 1 + alpha + qhat + delta_e",
        "published values, no samples",
    ]
    assert "!" not in text
    flighttest.save_fit(fit, tmp_path / "fit.nc")
    again = flighttest.open_fit(tmp_path / "fit.nc")
    xr.testing.assert_identical(again.estimates, fit.estimates)
    xr.testing.assert_identical(again.data, fit.data)
    point = xr.Dataset({"alpha": 0.15, "qhat": 0.0, "delta_e": 0.0})
    assert float(again.predict(point)["Cm"][0]) == pytest.approx(0.03 - 0.56 * 0.15)
    with pytest.warns(AeromatchWarning, match="alpha is .* fitted over 0 deg ... 11.46 deg"):
        fit.predict(point.assign(alpha=0.3))


def test_bad_publications_are_refused_with_every_problem():
    with pytest.raises(SchemaError) as caught:
        flighttest.combining.published_fit(
            LOCAL,
            {"1": 0.0, "alpha": np.nan, "qhat": -17.6, "beta": 1.0},
            {"1": 0.0, "alpha": 0.06, "qhat": 1.8, "delta_e": 0.12},
            {"alpha": (0.2, 0.1), "qhat": "q"},
            np.eye(3),
        )
    text = str(caught.value)
    for words in (
        "delta_e has no value",
        "beta has a value and is not a term of Cm",
        "the value of alpha is nan",
        "the standard error of 1 is 0.0; give a positive one",
        "the condition of alpha is (0.2, 0.1)",
        "qhat moves with 'q', which has neither a number nor a range",
        "delta_e has no condition",
        "the correlation is (3, 3); the model has 4 terms",
    ):
        assert words in text
    with pytest.raises(
        SchemaError,
        match=r"alpha has the one condition 0\.1 and a power or ramp in the model; give a range",
    ):
        flighttest.combining.published_fit(
            "Cm = 1 + alpha + alpha**2",
            dict.fromkeys(["1", "alpha", "alpha**2"], 1.0),
            dict.fromkeys(["1", "alpha", "alpha**2"], 1.0),
            AT,
        )
    with pytest.raises(UnknownName, match="alfa"):
        flighttest.combining.published_fit(LOCAL, VALUES, STDERR, AT | {"alfa": 0.1})
    with pytest.raises(
        SchemaError, match="not symmetric with a diagonal of ones and positive eigenvalues"
    ):
        flighttest.combining.published_fit(LOCAL, VALUES, STDERR, AT, np.ones((4, 4)))
    ones = dict.fromkeys(["1", "qhat", "alphadothat"], 1.0)
    with pytest.raises(
        IdentificationError, match=r"the conditions do not determine the terms: .*qhat.*alphadothat"
    ):
        flighttest.combining.published_fit(
            "Cm = 1 + qhat + alphadothat", ones, ones, {"qhat": 0.0, "alphadothat": "qhat"}
        )
    fit = flighttest.combining.published_fit(
        LOCAL, VALUES, STDERR, {key: x for key, x in AT.items() if key != "mach"}
    )
    with pytest.raises(UnknownName, match="mach"):
        aerodb.tabulate([fit], aerodb.make_database(leaves(), **ROOT))
    with pytest.raises(IdentificationError, match="published values have no residuals"):
        flighttest.equation_error.bootstrap(fit)

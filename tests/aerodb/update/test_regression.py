"""Nodes estimated directly from samples, on simulated records of known tables."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from aerodb.store.schema import make_database
from aerodb.update import regression
from aerodb.update.correlation import PARTS, prior_parts
from aerodb.update.posterior import joint_covariance
from aerodb.update.regression import regress_tables
from aerodb.update.shapes import Shape
from flightmech import terms
from flightmech.errors import IdentificationError, SchemaError, UnknownName

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
NOISE = 0.002


def leaves():
    alpha = np.arange(-4, 13, 2.0) * DEG
    sd = np.hypot(0.05, 0.4 * np.abs(alpha))
    return {
        "CL/basic": terms.make_term(
            0.2 + 5.0 * alpha, {"alpha": alpha}, stderr=sd, source="datcom"
        ),
        "CL/elevator": terms.make_term(0.5, {}, ("delta_e",), stderr=0.1, source="datcom"),
    }


def moved(prior, by=0.05, slope=-0.4):
    """A truth with another lift curve and elevator."""
    basic = prior["CL/basic"]
    return {
        "CL/basic": basic.assign(value=basic["value"] + by + slope * basic["alpha"]),
        "CL/elevator": prior["CL/elevator"].assign(value=prior["CL/elevator"]["value"] + by),
    }


def flown(truth, seed, low=0.0, high=6.0, count=800, **attrs):
    """Samples over incidence and elevator, with white noise."""
    rng = np.random.default_rng(seed)
    alpha = rng.uniform(low, high, count) * DEG
    data = {"alpha": alpha, "delta_e": rng.uniform(-0.1, 0.1, count)}
    data["CL"] = sum(
        terms.evaluate_term(leaf, data, "clamp") for leaf in truth.values()
    ) + NOISE * rng.normal(size=count)
    return xr.Dataset(
        {name: ("sample", x) for name, x in data.items()},
        attrs={"coefficient": "CL", "name": f"flight {seed}", **attrs},
    )


def white(samples, X, v):
    return NOISE**2 * np.linalg.inv(X.T @ X)


def test_the_nodes_are_those_of_the_information_form():
    """Three nodes, all of whose directions are kept: (P^-1 + B'B/sigma^2)^-1 written out, with the
    weights that were learnt.
    """
    prior = {
        "CL/basic": terms.make_term(
            [0.2, 0.3, 0.5], {"alpha": [0.0, 0.05, 0.1]}, stderr=[0.05, 0.06, 0.07], source="datcom"
        )
    }
    one = flown(prior, 1, 0.5, 5.0).drop_vars("delta_e")
    found = regress_tables([one], make_database(prior, **ROOT), white)
    assert found.compatibility.loc["CL", "count"] == 3
    P = np.einsum(
        "k,kij->ij",
        found.report.loc["CL/basic", list(PARTS)].to_numpy(float),
        prior_parts(prior["CL/basic"], np.ones(3)),
    )
    B = terms.basis(prior["CL/basic"], {"alpha": one["alpha"].values}, "clamp").toarray()
    information = B.T @ B / (NOISE * found.compatibility.loc["CL", "inflation"]) ** 2
    posterior = np.linalg.inv(np.linalg.inv(P) + information)
    g0 = prior["CL/basic"]["value"].values
    g = (
        g0
        + posterior
        @ B.T
        @ (one["CL"].values - B @ g0)
        / (NOISE * found.compatibility.loc["CL", "inflation"]) ** 2
    )
    np.testing.assert_allclose(found["CL/basic"]["value"], g, atol=1e-8)
    np.testing.assert_allclose(found["CL/basic"]["stderr"], np.sqrt(np.diag(posterior)), atol=1e-8)


def test_a_known_aeroplane_is_found_where_it_was_flown():
    prior = leaves()
    truth = moved(prior)
    found = regress_tables([flown(truth, k) for k in (2, 3)], make_database(prior, **ROOT), white)
    z = (found["CL/basic"]["value"] - truth["CL/basic"]["value"]) / found["CL/basic"]["stderr"]
    assert float(np.abs(z).max()) < 3.0
    here = dict(alpha=[0.0, 2 * DEG, 4 * DEG, 6 * DEG], method="nearest")
    assert (
        float(np.abs(found["CL/basic"]["value"] - truth["CL/basic"]["value"]).sel(**here).max())
        < 0.002
    )  # of 0.05; 0.0005 measured
    assert float(np.abs(found["CL/elevator"]["value"] - truth["CL/elevator"]["value"])) < 0.01
    assert (found["CL/basic"]["source"].sel(**here) == terms.SOURCES.index("flight")).all()
    assert int(
        found["CL/basic"]["source"].sel(alpha=12 * DEG, method="nearest")
    ) == terms.SOURCES.index("datcom")
    assert (
        found["CL/basic"]
        .attrs["history"]
        .endswith("regress_tables: from the samples of 2 groups of manoeuvres")
    )
    assert list(found.points.index) == [("CL", "flight 2"), ("CL", "flight 3")]


def test_an_error_of_a_variable_is_common_to_all_samples():
    """An incidence that may be wrong by 0.1 deg leaves lift open by 0.1 deg of slope, however many
    samples there are.
    """
    prior = leaves()
    wrong = 0.1 * DEG
    errors = {
        "CL_error": (("error", "sample"), np.zeros((1, 800))),
        "alpha_error": (("error", "sample"), np.full((1, 800), wrong)),
    }
    several = [
        flown(prior, k, name=str(k)).assign_coords(error=["bias.alpha"]).assign(errors)
        for k in (2, 3, 4)
    ]
    found = regress_tables(several, make_database(prior, **ROOT), white)["CL/basic"]
    at = dict(alpha=[2 * DEG, 4 * DEG], method="nearest")
    np.testing.assert_allclose(
        found["stderr"].sel(**at), 5.0 * wrong, rtol=0.1
    )  # less what the prior knows of it, 0.94 and 0.96


def test_a_held_term_stays_and_its_error_counts():
    prior = leaves()
    several = [flown(prior, k) for k in (2, 3)]
    held = {**prior, "CL/altitude": terms.make_term(0.0, {}, stderr=0.02, source="datcom")}
    found = regress_tables(several, make_database(held, **ROOT), white, held=["CL/altitude"])
    assert "CL/altitude" not in found
    assert float(found["CL/basic"]["stderr"].sel(alpha=2 * DEG, method="nearest")) == pytest.approx(
        0.02, rel=0.1
    )


def test_published_values_count_as_they_do_among_fits():
    """A lift of 0.30 +/- 0.001 at 1 deg, known from elsewhere, next to a flight at 6 deg and
    above.
    """
    prior = leaves()
    values = xr.Dataset(
        {
            "estimate": ("term", [0.30]),
            "covariance": (("term", "term_"), [[1e-6]]),
            "systematic": (("term", "error"), np.zeros((1, 0))),
        },
        coords={"term": ["1"], "term_": ["1"], "error": np.array([], dtype=str)},
        attrs={"coefficient": "CL", "name": "report"},
    )
    data = xr.Dataset(
        {"alpha": ("sample", [1 * DEG]), "delta_e": ("sample", [0.0]), "CL": ("sample", [0.30])}
    )
    one = SimpleNamespace(
        estimates=values, data=data, design=xr.DataArray([[1.0]], dims=("sample", "term"))
    )
    found = regress_tables(
        [flown(prior, 2, 6.0, 10.0)], make_database(prior, **ROOT), white, fits=[one]
    )
    lift = 0.5 * float(found["CL/basic"]["value"].sel(alpha=[0.0, 2 * DEG], method="nearest").sum())
    assert lift == pytest.approx(0.30, abs=0.002)  # the tables have 0.287
    assert list(found.points.index) == [("CL", "flight 2"), ("CL", "report")]


def test_portions_of_the_samples_give_the_same(monkeypatch):
    prior = leaves()
    several = [flown(moved(prior), 2)]
    db = make_database(prior, **ROOT)
    whole = regress_tables(several, db, white)
    monkeypatch.setattr(regression, "_PORTION", 1000)
    parts = regress_tables(several, db, white)
    for name in whole:
        np.testing.assert_allclose(parts[name]["value"], whole[name]["value"], atol=1e-9)
        np.testing.assert_allclose(parts[name]["stderr"], whole[name]["stderr"], rtol=1e-6)


def test_unusable_input_is_refused():
    prior = leaves()
    db = make_database(prior, **ROOT)
    with pytest.raises(IdentificationError, match="no samples"):
        regress_tables([], db, white)
    with pytest.raises(IdentificationError, match=r"flight 2: 5 samples in 5 directions"):
        regress_tables([flown(prior, 2, count=5)], db, white)
    with pytest.raises(UnknownName, match="unknown held term 'CL/tab'"):
        regress_tables([flown(prior, 2)], db, white, held=["CL/tab"])
    with pytest.raises(SchemaError, match="CL/basic has no stderr"):
        regress_tables(
            [flown(prior, 2)],
            make_database({**prior, "CL/basic": prior["CL/basic"].drop_vars("stderr")}, **ROOT),
            white,
        )
    with pytest.raises(UnknownName, match="delta_e"):
        regress_tables(
            [flown(prior, 2).drop_vars("delta_e")],
            make_database(
                {"CL/x": terms.make_term([0.0, 1.0], {"delta_e": [0.0, 0.1]}, stderr=0.1)}, **ROOT
            ),
            white,
        )


def wavy():
    """A lift curve that falls between 4 and 6 deg."""
    truth = moved(leaves())
    basic = truth["CL/basic"]
    return {
        **truth,
        "CL/basic": basic.assign(value=basic["value"] - 0.25 * (basic["alpha"] > 5 * DEG)),
    }


def found(shapes=None, truth=None):
    samples = [flown(truth or wavy(), k, 0.0, 8.0) for k in (2, 3)]
    return regress_tables(samples, make_database(leaves(), **ROOT), white, shapes=shapes)


def test_a_shape_that_the_flights_support_changes_nothing():
    true = moved(leaves())
    plain, risen = (
        found(shapes, true)
        for shapes in (None, {"CL/basic": [Shape("rising", "alpha", high=8 * DEG)]})
    )
    for name in plain:
        np.testing.assert_array_equal(risen[name]["value"], plain[name]["value"])
    assert risen.report.loc["CL/basic", "shape_bounds"] == 0
    assert risen.report.loc["CL/basic", "shape_ratio"] == pytest.approx(1.0)
    assert "shape_bounds" not in plain.report


@pytest.mark.slow
@pytest.mark.filterwarnings(
    "ignore:incompatible fits"
)  # measured tables that fall, against a prior that rises
def test_nodes_are_the_most_probable_ones_that_rise():
    """Against the quadratic programme solved by SciPy's general solver."""
    from scipy.optimize import minimize

    plain, risen = found(), found({"CL/basic": [Shape("rising", "alpha")]})
    names, V = joint_covariance(plain.terms)
    g = np.concatenate([plain[name]["value"].values.ravel() for name in names])
    scale = np.sqrt(np.diag(V))
    P = np.linalg.inv(V / np.outer(scale, scale))
    rise = [
        {"type": "ineq", "fun": lambda x, k=k: (g + scale * x)[k + 1] - (g + scale * x)[k]}
        for k in range(8)
    ]
    best = minimize(
        lambda x: 0.5 * x @ P @ x,
        np.zeros(len(g)),
        jac=lambda x: P @ x,
        constraints=rise,
        method="SLSQP",
        options={"maxiter": 500, "ftol": 1e-14},
    )
    value = np.concatenate([risen[name]["value"].values.ravel() for name in names])
    cost = 0.5 * ((value - g) / scale) @ P @ ((value - g) / scale)
    assert cost == pytest.approx(best.fun, rel=1e-3)
    assert np.diff(risen["CL/basic"]["value"]).min() > -1e-9
    assert risen.report.loc["CL/basic", "shape_bounds"] >= 1
    assert risen.report.loc["CL/basic", "shape_ratio"] < 1.0
    np.testing.assert_array_equal(risen["CL/basic"]["stderr"], plain["CL/basic"]["stderr"])
    assert "Shape rising alpha: " in risen["CL/basic"].attrs["comment"]


def test_a_sign_is_kept_where_it_is_demanded():
    shape = Shape("not_negative", "alpha", low=-5 * DEG, high=0.0)
    low = leaves()
    low["CL/basic"] = low["CL/basic"].assign(value=low["CL/basic"]["value"] - 0.3)
    plain, kept = found(truth=low), found({"CL/basic": [shape]}, low)
    assert float(plain["CL/basic"]["value"].sel(alpha=0.0)) < -0.05
    assert float(kept["CL/basic"]["value"].sel(alpha=slice(None, 0.001)).min()) > -1e-9


def test_a_demand_that_makes_no_sense_is_refused():
    with pytest.raises(UnknownName, match="unknown kind of shape 'convex'"):
        Shape("convex", "alpha")
    with pytest.raises(IdentificationError, match="rising: no axis"):
        Shape("rising")
    with pytest.raises(UnknownName, match="unknown term with a shape 'CL/basics'"):
        found({"CL/basics": [Shape("rising", "alpha")]})
    with pytest.raises(UnknownName, match="unknown axis of CL/basic 'mach'"):
        found({"CL/basic": [Shape("rising", "mach")]})
    known = leaves()
    known["CL/basic"] = terms.make_term(
        -known["CL/basic"]["value"].values,
        {"alpha": known["CL/basic"]["alpha"].values},
        stderr=0.0,
        source="datcom",
    )
    with pytest.raises(
        IdentificationError, match="CL/basic: nodes with standard error 0 contradict"
    ):
        regress_tables(
            [flown(known, 2)],
            make_database(known, **ROOT),
            white,
            shapes={"CL/basic": [Shape("rising", "alpha")]},
        )

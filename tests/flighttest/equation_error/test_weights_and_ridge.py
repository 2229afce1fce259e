import numpy as np
import pytest
import xarray as xr
from flown_lift import LIFT, TRUTH, coloured_noise, record

from flightmech import terms as terms_of
from flightmech.errors import IdentificationError, SchemaError, UnknownName
from flighttest.regression.combining.mixed_estimation import mix_with_prior, prior_of
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.frequency.frequency_domain import regress_frequency
from flighttest.regression.equation_error.time_domain import regress

TRUE = np.array(list(TRUTH.values()))


def test_a_noisy_manoeuvre_weighs_by_its_inverse_variance():
    rng = np.random.default_rng(0)
    parts = [record(rng, 20.0, 0.002), record(rng, 20.0, 0.05)]
    equal, weighted = regress(LIFT, parts), regress(LIFT, parts, weights="manoeuvre")
    assert (weighted.estimates["stderr"].values < 0.5 * equal.estimates["stderr"].values).all()
    alone = regress(LIFT, parts[0]).estimates
    np.testing.assert_allclose(
        weighted.estimates["estimate"], alone["estimate"], atol=4 * alone["stderr"].values.max()
    )
    np.testing.assert_allclose(
        least_squares.estimator_matrix(weighted.design.values) @ weighted.data["CL"].values,
        weighted.estimates["estimate"],
        rtol=1e-9,
    )


def test_weights_by_a_variable_are_weighted_least_squares():
    data = record(np.random.default_rng(1))
    sigma = 0.005 + 0.01 * np.random.default_rng(2).random(1500)
    fit = regress(LIFT, data.assign(sigma=("time", sigma)), weights="sigma")
    X, W = fit.regressors.values, np.diag(1 / sigma**2)
    np.testing.assert_allclose(
        fit.estimates["estimate"],
        np.linalg.solve(X.T @ W @ X, X.T @ W @ data["CL"].values),
        rtol=1e-10,
    )
    with pytest.raises(IdentificationError, match="sigma is not positive in 1500 samples"):
        regress(LIFT, data.assign(sigma=("time", 0.0 * sigma)), weights="sigma")
    with pytest.raises(UnknownName, match="unknown variable 'nosuch'"):
        regress(LIFT, data, weights="nosuch")


@pytest.mark.nightly
def test_two_weights_cover_too():
    """50 seeds of a quiet and a rough manoeuvre; 0.93 of 200 estimates is known to 3 %."""
    inside = []
    for seed in range(50):
        rng = np.random.default_rng(seed)
        e = regress(
            LIFT, [record(rng, 20.0, 0.002), record(rng, 20.0, 0.03)], weights="manoeuvre"
        ).estimates
        inside.append(np.abs(e["estimate"].values - TRUE) < 2 * e["stderr"].values)
    assert np.mean(inside) == pytest.approx(0.93, abs=0.07)


def test_spikes_lose_their_weight():
    rng = np.random.default_rng(3)
    data = record(rng)
    spiked = data.copy(deep=True)
    spiked["CL"][rng.choice(1500, 40, replace=False)] += 1.0
    plain, robust = (
        regress(LIFT, spiked, weights=kind).estimates["estimate"].values
        for kind in ("equal", "robust")
    )
    clean = regress(LIFT, data).estimates["estimate"].values
    assert (np.abs(robust - clean) < 0.2 * np.abs(plain - clean)).all()


def test_standard_errors_of_huber_weights_are_those_of_his_estimate():
    """Gaussian noise: 1/0.95 of the variance of equal weights [Huber1981].  With spikes in a tenth
    of the samples the clipped residuals count, not the weighted ones.
    """
    rng = np.random.default_rng(3)
    noise = rng.standard_normal(100_000)
    assert np.var(least_squares.huber_pseudo_residuals(noise)) == pytest.approx(1.0526, abs=0.02)
    spiked = np.where(rng.random(100_000) < 0.1, 20.0 * noise, noise)
    # E psi^2 / (E psi')^2 of the mixture
    limit = 1.345 * 1.4826 * np.median(np.abs(spiked))
    inside = np.mean(np.abs(spiked) <= limit)
    expected = np.mean(np.minimum(spiked**2, limit**2)) / inside**2
    assert 1.2 < expected < 1.7
    assert np.var(least_squares.huber_pseudo_residuals(spiked)) == pytest.approx(expected, rel=0.01)
    data = record(rng)
    data["CL"] = data["CL"] + 0.3 * rng.standard_normal(1500)
    plain, robust = (regress(LIFT, data, weights=kind).estimates for kind in ("equal", "robust"))
    ratio = robust["stderr_white"].values / plain["stderr_white"].values
    np.testing.assert_allclose(ratio, 1.026, atol=0.03)


def convergence_remarks(fit):
    return [remark for remark in fit.remarks if remark.kind == "convergence"]


def test_weights_that_still_change_are_remarked(monkeypatch):
    rng = np.random.default_rng(3)
    data = record(rng)
    data["CL"][rng.choice(1500, 40, replace=False)] += 1.0
    settled = regress(LIFT, data, weights="robust")
    assert "weights_change" not in settled.estimates.attrs
    assert convergence_remarks(settled) == []
    monkeypatch.setattr(least_squares, "_ROUNDS", 2)
    (remark,) = convergence_remarks(regress(LIFT, data, weights="robust"))
    assert remark.severity == "error"
    assert remark.text.startswith("weights: not converged after 2 iterations, last change ")


def collinear(rng):
    data = record(rng)
    return data.assign(delta_e=data["alpha"] + 2e-4 * coloured_noise(rng, 1500))


def test_a_ridge_trades_variance_for_a_bias_that_it_reports():
    data = collinear(np.random.default_rng(4))
    plain, ridge = regress(LIFT, data).estimates, regress(LIFT, data, ridge=0.01).estimates
    assert float(ridge["stderr"].sel(term="delta_e")) < 0.1 * float(
        plain["stderr"].sel(term="delta_e")
    )
    np.testing.assert_allclose(ridge["estimate"] - ridge["shrinkage"], plain["estimate"], rtol=1e-8)
    assert ridge.attrs["ridge"] == 0.01
    assert "shrinkage" not in plain
    auto = regress(LIFT, data, ridge="auto").estimates
    assert 0 < auto.attrs["ridge"] < 0.1
    assert "ridge" in regress(LIFT, data, ridge="auto").report()
    for wrong in (-1.0, np.inf, np.nan):
        text = f"ridge is {wrong}; expected a finite number that is not negative"
        with pytest.raises(IdentificationError, match=text):
            regress(LIFT, data, ridge=wrong)


def test_a_ridge_in_frequency_is_the_same_rule():
    data = collinear(np.random.default_rng(5))
    fit = regress_frequency(LIFT, data, (0.1, 1.0), ridge=0.01)
    plain = regress_frequency(LIFT, data, (0.1, 1.0))
    np.testing.assert_allclose(
        (fit.estimates["estimate"] - fit.estimates["shrinkage"])[1:],
        plain.estimates["estimate"][1:],
        rtol=1e-8,
    )
    np.testing.assert_allclose(
        least_squares.estimator_matrix(fit.design.values) @ fit.data["CL"].values,
        fit.estimates["estimate"],
        rtol=1e-8,
    )


def database(slope=5.0, error=0.08):
    """CL over alpha with nodes of their own, pitch rate and elevator, each with a standard
    error.
    """
    alpha = np.linspace(-0.2, 0.4, 13)

    def leaf(value, stderr, axes, regressors=()):
        return terms_of.make_term(value, axes, regressors, stderr=stderr, source="datcom")

    basic = 0.3 + slope * alpha
    return xr.DataTree.from_dict(
        {
            "/CL/basic": leaf(basic, error * np.abs(basic) + 0.02, {"alpha": alpha}),
            "/CL/qhat": leaf(np.array(6.0), np.array(2.0), {}, ["qhat"]),
            "/CL/elevator": leaf(np.array(0.45), np.array(0.1), {}, ["delta_e"]),
        }
    )


@pytest.mark.parametrize("fitted", ["time", "frequency"])
def test_the_prior_of_a_database_is_what_least_squares_makes_of_its_tables(fitted):
    data = record(np.random.default_rng(6))
    fit = regress(LIFT, data) if fitted == "time" else regress_frequency(LIFT, data, (0.1, 1.0))
    prior = prior_of(fit, database())
    np.testing.assert_allclose(prior["estimate"], [0.3, 5.0, 6.0, 0.45], rtol=1e-8)
    assert float(prior["stderr"].sel(term="qhat")) == pytest.approx(
        2.0, rel=0.03
    )  # and what a wrong lift table would put into it
    joined = mix_with_prior(fit, prior)
    assert (joined.estimates["stderr"].values <= fit.estimates["stderr"].values + 1e-12).all()
    assert joined.estimates.attrs["terms_with_prior"] == 4
    assert joined.estimates.attrs["probability"] > 0.01
    assert "flight" in joined.report()
    assert {"estimate", "stderr", "stderr_white", "correlation"} <= set(joined.estimates.data_vars)


def test_a_short_manoeuvre_without_pitch_rate_takes_it_from_the_prior():
    """Eight seconds: qhat alone is known to 40 %; joined it is no worse than the prior, and the
    report states whose it is.
    """
    data = record(np.random.default_rng(7), 8.0, 0.03)
    fit = regress(LIFT, data)
    joined = mix_with_prior(fit, prior_of(fit, database()))
    assert float(fit.estimates["stderr"].sel(term="qhat")) > 2.0
    assert float(joined.estimates["stderr"].sel(term="qhat")) <= 2.0
    assert any(
        "hardly moved by the flight" in text and "qhat" in text for text in map(str, joined.remarks)
    )


def test_a_database_that_flight_contradicts_is_named():
    fit = regress(LIFT, record(np.random.default_rng(8)))
    joined = mix_with_prior(fit, prior_of(fit, database(slope=3.5, error=0.01)))
    assert any(
        text.startswith("alpha: flight and prior differ by") for text in map(str, joined.remarks)
    )
    assert any("overconfident" in text for text in map(str, joined.remarks))


def test_terms_the_database_does_not_know_have_no_prior():
    db = database().filter(lambda node: node.name != "elevator")
    fit = regress(LIFT, record(np.random.default_rng(9)))
    assert list(prior_of(fit, db)["term"].values) == ["1", "alpha", "qhat"]
    with pytest.raises(SchemaError, match="CL/basic has no stderr"):
        prior_of(
            fit,
            xr.DataTree.from_dict({"/CL/basic": db["CL/basic"].to_dataset().drop_vars("stderr")}),
        )
    with pytest.raises(UnknownName, match="unknown coefficient 'CL'"):
        prior_of(fit, xr.DataTree.from_dict({"/Cm/basic": db["CL/basic"].to_dataset()}))


@pytest.mark.slow
def test_fits_of_every_kind_move_the_tables_to_the_truth():
    """The tables know a curve that the local models leave out; what these expect of it goes through
    their own linear map.
    """
    import aerodb

    alpha = np.linspace(-0.2, 0.4, 13)
    truth = 0.3 + 5.0 * alpha - 6.0 * alpha**2
    prior = database()
    prior.attrs.update(
        aircraft="test",
        S=16.0,
        cbar=1.6,
        b=10.0,
        x_ref=0.0,
        y_ref=0.0,
        z_ref=0.0,
        title="test",
        source="test",
        force_axes="stability",
    )
    data = []
    for seed in range(3):
        one = record(np.random.default_rng(seed), 30.0, 0.003)
        at = one["alpha"] + 0.05 * seed
        data.append(
            one.assign(
                CL=one["CL"] - 0.3 - 5.0 * one["alpha"] + np.interp(at, alpha, truth), alpha=at
            )
        )
    fits = [
        regress(LIFT, data[0], "time"),
        regress_frequency(LIFT, data[1], (0.1, 1.0), "frequency"),
        regress(LIFT, data[2], "ridge", ridge=0.02),
        regress(LIFT, data[1], "robust", weights="robust"),
    ]
    tables = aerodb.tabulate(fits, prior)
    flown = np.abs(alpha - 0.05) < 0.12
    before = np.abs(prior["CL/basic"]["value"].values - truth)[flown]
    after = np.abs(tables["CL/basic"]["value"].values - truth)[flown]
    assert after.max() < 0.35 * before.max()
    final = aerodb.replace_terms(prior, tables)
    assert "tabulate" in final["CL/basic"].attrs["history"]

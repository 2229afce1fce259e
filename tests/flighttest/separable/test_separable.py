"""Separable least squares: the grammar, exact derivatives, the estimates against a general
optimiser, what cannot be seen.
"""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy.optimize import least_squares

import flighttest
from flightmech.errors import (
    AeromatchWarning,
    IdentificationError,
    OutOfRange,
    ParseError,
    SchemaError,
    UnitError,
    UnknownName,
)
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.expression_functions import Pieces
from flighttest.regression.expressions import Scope, parse_expression, parse_terms
from flighttest.regression.separable import search
from flighttest.regression.separable.fit import regress_separable
from flighttest.regression.separable.projection import LinearBlock, project_blocks
from flighttest.regression.separable_model import SeparableModel, ShapeParameter

T = np.arange(400) * 0.05
WHOLE = Pieces([slice(0, 250), slice(250, 400)], [0.05, 0.05])
QUANTITIES = {
    "alpha": 0.1 + 0.05 * np.sin(T),
    "h": 3.0 + 2.0 * np.cos(0.3 * T),
    "q": np.sign(np.sin(0.7 * T)),
}


@pytest.mark.parametrize(
    ("text", "spelling"),
    [
        ("alpha * h ** s", "alpha*h^s"),
        ("h^-1.3*(alpha)", "h^-1.3*alpha"),
        ("2*(alpha+q)/h", "2*(alpha + q)/h"),
        ("-alpha^2", "-alpha^2"),
        ("(-alpha)^2", "(-alpha)^2"),
        ("a-(b-c)", "a - (b - c)"),
        ("ramp(alpha, 12 deg)", "ramp(alpha,0.209439510239)"),
        ("tanh(g*q)*exp(-h/k)", "tanh(g*q)*exp(-h/k)"),
        ("a^b^c", "a^b^c"),
        ("(a^b)^c", "(a^b)^c"),
    ],
)
def test_each_expression_has_one_spelling_that_reads_back(text, spelling):
    assert str(parse_expression(text)) == spelling
    assert parse_expression(spelling) == parse_expression(str(parse_expression(text)))


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("alpha*", ParseError, "the end"),
        ("(alpha", ParseError, "the end"),
        ("alpha)", ParseError, r"'\)'"),
        ("__import__('os')", ParseError, "'os'"),
        ("open(alpha)", UnknownName, "function"),
        ("lag(alpha)", ParseError, "lag of 1 arguments"),
        ("ramp(alpha, 3 furlong)", UnitError, "furlong"),
        ("alpha # h", ParseError, "#"),
        ("(" * 200 + "alpha" + ")" * 200, ParseError, "nested"),
    ],
)
def test_what_is_no_expression_is_refused(text, error, words):
    with pytest.raises(error, match=words):
        parse_expression(text)


def test_a_term_that_is_subtracted_is_refused():
    with pytest.raises(ParseError, match="takes its sign"):
        parse_terms("1 - alpha")


@pytest.mark.parametrize(
    "text",
    [
        "alpha*h^s",
        "h^(s*g)/(1 + g*alpha^2)",
        "tanh(g*q) - exp(-h/g)",
        "lag(q, g)",
        "lag(tanh(s*alpha), g)*h^s",
        "ramp(h, 2*g)",
        "max(h, 3*g)^s + min(alpha, s) + log(g*h) + sqrt(g + h) + abs(g - h) + sin(g*h) + cos(s*h)",
    ],
)
def test_derivatives_are_exact(text):
    """Against central differences, whose own error is about 1e-9 here."""
    at = {"s": -1.3, "g": 0.7}
    found = parse_expression(text).at(Scope(QUANTITIES, at, WHOLE))
    for name in found.by:
        step = 1e-5
        up, down = (
            parse_expression(text).at(Scope(QUANTITIES, {**at, name: at[name] + d}, WHOLE)).value
            for d in (step, -step)
        )
        np.testing.assert_allclose(
            np.broadcast_to(found.by[name], up.shape),
            (up - down) / (2 * step),
            rtol=1e-6,
            atol=1e-7,
        )


def test_a_lag_answers_a_ramp_exactly_and_starts_anew_after_a_gap():
    """tau y' + y = x with x = a + b t from rest: y = a + b (t - tau + tau exp(-t/tau)), exact since
    x is straight.
    """
    tau, t = 0.4, T[:150]
    x = np.concatenate([2.0 + 0.3 * T[:250], -1.0 + 0.5 * t])
    y = parse_expression("lag(x, tau)").at(Scope({"x": x}, {"tau": tau}, WHOLE)).value
    np.testing.assert_allclose(
        y[:250], 2.0 + 0.3 * (T[:250] - tau + tau * np.exp(-T[:250] / tau)), rtol=1e-12
    )
    np.testing.assert_allclose(
        y[250:], -1.0 + 0.5 * (t - tau + tau * np.exp(-t / tau)), rtol=1e-12, atol=1e-13
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("(h - 4)^s", "stay positive"),
        ("log(alpha - 1)", "log of"),
        ("lag(q, h)", "one positive number"),
        ("q/(s - s)", "zero"),
    ],
)
def test_values_without_a_result_are_reported(text, words):
    with pytest.raises(OutOfRange, match=words):
        parse_expression(text).at(Scope(QUANTITIES, {"s": -1.0}, WHOLE))


def test_the_projection_has_its_exact_derivative():
    """Golub and Pereyra's whole derivative: without the second part it is wrong by 17 % of its
    length here.
    """
    model = SeparableModel(
        "CL", ["1", "alpha", "alpha*h_agl^s", "h_agl^g"], {"s": (-4, -0.1), "g": (-4, -0.1)}
    )
    data = xr.Dataset({"alpha": ("time", QUANTITIES["alpha"]), "h_agl": ("time", QUANTITIES["h"])})
    z = np.random.default_rng(1).normal(size=len(T)) + 5.0 * QUANTITIES["alpha"]

    def at(s):
        A, slopes = model.design(data, dict(zip(("s", "g"), s)))
        return project_blocks(
            [LinearBlock(z, A, [(("s", "g").index(name), j, v) for name, j, v in slopes])], 2
        )

    s, step = np.array([-1.2, -0.6]), 1e-6
    numeric = np.array(
        [(at(s + d).residual - at(s - d).residual) / (2 * step) for d in step * np.eye(2)]
    ).T
    np.testing.assert_allclose(at(s).jacobian, numeric, atol=1e-7 * np.abs(numeric).max())


def side_force(seed: int = 3, n: int = 300) -> xr.Dataset:
    rng = np.random.default_rng(seed)
    Fz, slip = rng.uniform(5e3, 2e4, n), rng.uniform(-0.2, 0.2, n)
    Fy = -0.7 * Fz * np.tanh(8.0 * slip) + rng.normal(size=n) * 150.0
    return xr.Dataset(
        {"Fz": ("time", Fz), "slip": ("time", slip), "Fy": ("time", Fy)},
        {"time": np.arange(n) * 1.0},
    )


TYRE = SeparableModel.parse(
    "Fy = Fz*tanh(g*slip)", {"g": (0.5, 60.0)}, {"Fy": "N", "Fz": "N", "slip": "rad"}
)


def test_the_estimate_is_that_of_a_general_optimiser():
    data = side_force()
    fit = regress_separable(TYRE, data)
    z, Fz, slip = (data[name].values for name in ("Fy", "Fz", "slip"))
    peer = least_squares(
        lambda x: z - x[0] * Fz * np.tanh(x[1] * slip),
        [-1.0, 5.0],
        x_scale=[1.0, 10.0],
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
    )
    np.testing.assert_allclose(fit.estimates["estimate"], peer.x, rtol=1e-7)
    white = np.sqrt(np.diag(np.linalg.inv(peer.jac.T @ peer.jac)) * 2 * peer.cost / (len(z) - 2))
    np.testing.assert_allclose(fit.estimates["stderr_white"], white, rtol=1e-6)
    assert fit.estimates.attrs["units"] == "N"
    assert not fit.remarks


def test_functions_of_estimates_carry_their_correlation():
    """Slip stiffness Cs = g mu of Fy = -mu Fz tanh(Cs slip / mu): its error is not that of g times
    mu.
    """
    fit = regress_separable(TYRE, side_force())
    values, C = fit.derived("-[Fz*tanh(g*slip)]", "-[Fz*tanh(g*slip)]*g")
    other = SeparableModel.parse("Fy = Fz*tanh(Cs*slip/0.7)", {"Cs": (0.5, 30.0)}, dict(TYRE.units))
    direct = regress_separable(other, side_force())
    mu, g = -fit.value("Fz*tanh(g*slip)")[0], fit.value("g")[0]
    assert values == pytest.approx([mu, mu * g], rel=1e-14)
    gradient = np.array([-g, mu])
    assert C[1, 1] == pytest.approx(
        gradient @ fit.estimates["covariance"].values @ gradient, rel=1e-12
    )
    assert direct.value("Cs")[0] == pytest.approx(0.7 * g, rel=1e-9)
    with pytest.raises(UnknownName, match="quantity or parameter"):
        fit.derived("mu")


def test_a_change_in_the_last_digits_changes_nothing_else():
    data = side_force()
    moved = (
        data
        * (1.0 + 1e-12 * np.random.default_rng(9).normal(size=data.sizes["time"]))[None].T[:, 0]
    )
    a, b = (
        regress_separable(TYRE, one).estimates for one in (data, data.map(lambda v: moved[v.name]))
    )
    np.testing.assert_allclose(b["estimate"], a["estimate"], rtol=1e-11)
    np.testing.assert_allclose(b["stderr"], a["stderr"], rtol=1e-6)


def spool(tau: float, n: int = 1200) -> xr.Dataset:
    rng = np.random.default_rng(4)
    throttle = np.repeat(rng.uniform(0.3, 1.0, 12), n // 12)
    lagged = (
        parse_expression("lag(u, tau)")
        .at(Scope({"u": throttle}, {"tau": tau}, Pieces([slice(0, n)], [0.02])))
        .value
    )
    n1 = 0.4 + 0.5 * lagged + 0.004 * rng.normal(size=n)
    thrust = -500.0 + 9000.0 * lagged + 60.0 * rng.normal(size=n)
    return xr.Dataset(
        {"throttle": ("time", throttle), "n1": ("time", n1), "thrust": ("time", thrust)},
        {"time": np.arange(n) * 0.02},
    )


def test_two_measured_quantities_share_a_time_constant():
    data, tau = spool(0.8), {"tau": (0.05, 5.0)}
    models = [
        RegressionModel.parse(f"{name} = 1 + lag(throttle, tau)", tau) for name in ("n1", "thrust")
    ]
    both, one = regress_separable(models, data), regress_separable(models[0], data)
    assert abs(both.value("tau")[0] - 0.8) < 3 * both.value("tau")[1]
    assert both.value("tau")[1] < one.value("tau")[1]
    assert (
        abs(both.value("thrust: lag(throttle,tau)")[0] - 9000.0)
        < 3 * both.value("thrust: lag(throttle,tau)")[1]
    )
    assert "thrust [N]" in both.report()


def test_a_prior_counts_by_its_standard_error():
    data = spool(0.8)
    free = regress_separable(
        RegressionModel.parse("n1 = 1 + lag(throttle, tau)", {"tau": (0.05, 5.0)}), data
    ).value("tau")
    prior = ShapeParameter(0.05, 5.0, free[0] + free[1], free[1])
    joined = regress_separable(
        RegressionModel.parse("n1 = 1 + lag(throttle, tau)", {"tau": prior}), data
    ).value("tau")
    assert joined[0] == pytest.approx(free[0] + 0.5 * free[1], abs=0.05 * free[1])
    assert joined[1] == pytest.approx(free[1] / np.sqrt(2.0), rel=0.05)


def test_weights_that_still_move_an_estimate_are_remarked(monkeypatch):
    """The only round goes from the estimate without prior to that with it."""
    data = spool(0.8)
    text, bounds = "n1 = 1 + lag(throttle, tau)", {"tau": (0.05, 5.0)}
    free = regress_separable(RegressionModel.parse(text, bounds), data)
    assert (free.convergence.converged, free.convergence.iterations) == (True, 0)
    tau, stderr = free.value("tau")

    def joined(apart):
        prior = ShapeParameter(0.05, 5.0, tau + apart * stderr, stderr)
        return regress_separable(RegressionModel.parse(text, {"tau": prior}), data)

    settled = joined(1.0)
    assert settled.convergence.converged
    assert settled.convergence.iterations == 4
    assert settled.convergence_remarks == []
    monkeypatch.setattr(search, "_ROUNDS", 1)
    moved = joined(1.0)
    (remark,) = moved.convergence_remarks
    assert remark.severity == "warning"
    assert remark.text in moved.remarks
    assert "! weights: not converged after 1 iterations" in moved.report()
    with pytest.warns(AeromatchWarning, match="weights: not converged after 1 iterations"):
        (remark,) = joined(4.0).convergence_remarks
    assert remark.severity == "error"


def test_what_the_data_cannot_see_is_named():
    rng = np.random.default_rng(5)
    n = 600
    alpha, h = 0.1 * np.sin(0.4 * np.arange(n) * 0.05), np.linspace(30.0, 2.0, n)
    CL = 0.7 + 5.0 * alpha + 0.3 * h**-1.2 + 0.01 * rng.normal(size=n)
    data = xr.Dataset(
        {"alpha": ("time", alpha), "h_agl": ("time", h), "CL": ("time", CL)},
        {"time": np.arange(n) * 0.05},
    )
    bounds = {"s_0": (-4.0, -0.1), "s_alpha": (-4.0, -0.1)}
    fit = regress_separable(
        RegressionModel.parse("CL = 1 + alpha + h_agl^s_0 + alpha*h_agl^s_alpha", bounds), data
    )
    e = fit.estimates
    assert e["identified"].sel(term=["1", "alpha", "h_agl^s_0", "s_0"]).all()
    assert not e["identified"].sel(term=["alpha*h_agl^s_alpha", "s_alpha"]).any()
    assert any(text.startswith("s_alpha: not identified: its term is") for text in fit.remarks)


def test_a_parameter_at_its_bound_has_no_standard_error():
    fit = regress_separable(
        SeparableModel("Fy", TYRE.terms, {"g": (0.5, 5.0)}, dict(TYRE.units)), side_force()
    )
    assert fit.value("g")[0] == 5.0
    assert np.isnan(fit.value("g")[1])
    assert any("at its bound 5" in text for text in fit.remarks)
    assert np.isnan(fit.derived("2*g")[1]).all()


def test_a_parameter_without_effect_is_not_at_its_bound():
    """The argument of tanh is zero in all samples: no value of g changes the fit."""
    rng = np.random.default_rng(7)
    alpha = 0.1 * rng.normal(size=300)
    columns = {"alpha": alpha, "q": np.zeros(300), "CL": 0.3 + 5.0 * alpha}
    columns["CL"] = columns["CL"] + 0.01 * rng.normal(size=300)
    data = xr.Dataset(
        {name: ("time", values) for name, values in columns.items()},
        {"time": np.arange(300) * 0.05},
    )
    model = SeparableModel("CL", ("1", "alpha*exp(g*q)"), {"g": (0.5, 5.0)})
    fit = regress_separable(model, data)
    assert "g: not identified: it has no effect on the samples" in fit.remarks
    assert np.isnan(fit.value("g")[1])
    assert fit.value("alpha*exp(g*q)")[0] == pytest.approx(5.0, abs=0.05)


def test_any_quantity_of_the_vocabulary_is_a_target():
    rng = np.random.default_rng(6)
    alpha, delta_e = rng.normal(size=(2, 200)) * 0.1
    data = xr.Dataset(
        {"alpha": ("time", alpha), "delta_e": ("time", delta_e)}, {"time": np.arange(200) * 0.1}
    )
    data["Ch_e"] = -0.1 * data["alpha"] - 0.4 * data["delta_e"] + 1e-4 * rng.normal(size=200)
    fit = flighttest.regress(RegressionModel.parse("Ch_e = 1 + alpha + delta_e"), data)
    np.testing.assert_allclose(
        fit.estimates["estimate"].sel(term=["alpha", "delta_e"]), [-0.1, -0.4], atol=5e-4
    )


@pytest.mark.parametrize(
    ("given", "error", "words"),
    [
        (("CL", ["alfa*h_agl^s"], {"s": (-4, -1)}), UnknownName, "alfa"),
        (("CL", ["h_agl^s"], {}), UnknownName, "declare its unit"),
        (("CL", ["1"], {"s": (-4, -1)}), SchemaError, "no term has the parameter s"),
        (("CL", ["h_agl^s"], {"s": (-1, -4)}), SchemaError, "the lower first"),
        (("CL", ["h_agl^s"], {"s": (-4, -1, 0.0)}), SchemaError, "outside its bounds"),
        (
            ("CL", ["h_agl^s"], {"s": (-4, -1, None, 0.1)}),
            SchemaError,
            "must be positive and needs a start",
        ),
        (("CL", ["h_agl^alpha"], {"alpha": (-4, -1)}), SchemaError, "name of a quantity"),
        (("CL", ["alpha", "alpha "], {}), ParseError, "more than once"),
    ],
)
def test_faulty_models_are_refused(given, error, words):
    with pytest.raises(error, match=words):
        SeparableModel(*given)


def test_two_terms_that_are_one_are_refused():
    data = side_force().assign(twice=lambda d: 2.0 * d["Fz"])
    model = SeparableModel(
        "Fy",
        ["Fz*tanh(g*slip)", "twice*tanh(g*slip)"],
        {"g": (0.5, 60.0)},
        {**TYRE.units, "twice": "N"},
    )
    with pytest.raises(IdentificationError, match="not determined at any start"):
        regress_separable(model, data)

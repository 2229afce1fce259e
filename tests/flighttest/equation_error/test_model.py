import numpy as np
import pytest
import xarray as xr

from flightmech.errors import ParseError, UnitError, UnknownName
from flighttest.regression.equation_error.model import RegressionModel, knot_of, term_powers


def test_a_text_becomes_a_model_with_one_spelling_of_each_term():
    model = RegressionModel.parse("CL = 1 + alpha^2 + delta_f * alpha ** 2 + engine1.n1")
    assert model.terms == ("1", "alpha**2", "delta_f*alpha**2", "engine1.n1")
    assert model.variables == ("alpha", "delta_f", "engine1.n1")
    assert str(model) == "CL = 1 + alpha**2 + delta_f*alpha**2 + engine1.n1"
    assert term_powers("alpha*alpha") == {"alpha": 2}


def test_the_design_holds_the_products():
    data = xr.Dataset({"alpha": ("time", [0.1, 0.2]), "delta_f": 0.5})
    X = RegressionModel("CD", ["1", "delta_f*alpha**2"]).design(data)
    np.testing.assert_allclose(X, [[1, 0.005], [1, 0.02]], rtol=1e-15)


def test_a_reference_is_taken_off_and_multiplied_out_again():
    data = xr.Dataset(
        {
            "alpha": ("time", np.linspace(-0.1, 0.3, 7)),
            "qhat": ("time", np.linspace(0.0, 0.01, 7) ** 2),
        }
    )
    centred = RegressionModel(
        "CL", ["1", "alpha", "alpha**2", "qhat*alpha"], {"alpha": 0.1, "qhat": 0.002}
    )
    theta = np.array([0.3, 5.0, -2.0, 7.0])
    absolute, matrix = centred.absolute()
    assert set(absolute.terms) == {"1", "alpha", "alpha**2", "qhat*alpha", "qhat"}
    np.testing.assert_allclose(
        absolute.design(data) @ (matrix @ theta), centred.design(data) @ theta, rtol=1e-13
    )


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("CL = 1 + alfa", UnknownName, "near it: alpha"),
        ("Cx = 1", UnknownName, "unknown coefficient 'Cx'"),
        ("CL = 1 + alpha + alpha", ParseError, "the term alpha more than once"),
        ("CL = 1 + 2*alpha", ParseError, "2\\*alpha"),
        ("CL 1 + alpha", ParseError, "expected 'CL = 1 \\+ alpha"),
        ("CL = ", ParseError, "expected 'CL"),
        ("CL = 1 + abs(beta)", ParseError, "abs\\(beta\\)"),
    ],
)
def test_what_cannot_be_read_is_reported(text, error, words):
    with pytest.raises(error, match=words):
        RegressionModel.parse(text)


def test_missing_data_and_idle_references_are_reported():
    with pytest.raises(UnknownName, match="unknown model variable 'qhat'"):
        RegressionModel("CL", ["qhat"]).design(xr.Dataset({"alpha": ("time", [0.1])}))
    with pytest.raises(UnknownName, match="unknown reference 'beta'"):
        RegressionModel("CL", ["alpha"], {"beta": 0.1})


def test_ramps_are_truncated_powers_with_their_knot_in_si():
    model = RegressionModel.parse(
        "CL = 1 + alpha + ramp( alpha , 12 deg )**2 + delta_f*ramp(h,100 ft)"
    )
    assert model.terms == ("1", "alpha", "ramp(alpha,0.2094395102)**2", "delta_f*ramp(h,30.48)")
    assert model.variables == ("alpha", "delta_f", "h")
    data = xr.Dataset({"alpha": ("time", [0.1, 0.3]), "delta_f": 0.5, "h": ("time", [40.48, 10.0])})
    np.testing.assert_allclose(
        model.design(data), [[1, 0.1, 0, 5], [1, 0.3, (0.3 - np.radians(12)) ** 2, 0]], rtol=1e-8
    )
    assert RegressionModel.parse(str(model)) == model
    assert knot_of("ramp(alpha,-0.05)") == -0.05


def test_a_reference_leaves_the_knot_where_it_is():
    data = xr.Dataset({"alpha": ("time", np.linspace(-0.1, 0.3, 9))})
    centred = RegressionModel("CL", ["1", "alpha", "alpha*ramp(alpha,0.1)"], {"alpha": 0.05})
    theta = np.array([0.3, 5.0, -7.0])
    absolute, matrix = centred.absolute()
    assert set(absolute.terms) == {"1", "alpha", "alpha*ramp(alpha,0.1)", "ramp(alpha,0.1)"}
    np.testing.assert_allclose(
        absolute.design(data) @ (matrix @ theta),
        centred.design(data) @ theta,
        rtol=1e-13,
        atol=1e-15,
    )


@pytest.mark.parametrize(
    ("term", "error", "words"),
    [
        ("ramp(alpha)", ParseError, "a product of names, ramps and powers"),
        ("ramp(alfa,0.1)", UnknownName, "near it: alpha"),
        ("ramp(alpha,12 kg)", UnitError, "cannot be converted"),
        ("ramp(alpha,twelve)", UnitError, "expected a number and a unit"),
        ("step(alpha,0.1)", ParseError, "step"),
    ],
)
def test_ramps_that_cannot_be_read_are_reported(term, error, words):
    with pytest.raises(error, match=words):
        RegressionModel("CL", ["1", term])

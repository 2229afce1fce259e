import numpy as np
import pytest
import xarray as xr

from flightmech.errors import ParseError, UnknownName
from flighttest.model import Model, powers


def test_a_text_becomes_a_model_with_one_spelling_of_each_term():
    model = Model.parse("CL = 1 + alpha^2 + delta_f * alpha ** 2 + engine1.n1")
    assert model.terms == ("1", "alpha**2", "delta_f*alpha**2", "engine1.n1")
    assert model.variables == ("alpha", "delta_f", "engine1.n1")
    assert str(model) == "CL = 1 + alpha**2 + delta_f*alpha**2 + engine1.n1"
    assert powers("alpha*alpha") == {"alpha": 2}


def test_the_design_holds_the_products():
    data = xr.Dataset({"alpha": ("time", [0.1, 0.2]), "delta_f": 0.5})
    X = Model("CD", ["1", "delta_f*alpha**2"]).design(data)
    np.testing.assert_allclose(X, [[1, 0.005], [1, 0.02]], rtol=1e-15)


def test_a_reference_is_taken_off_and_multiplied_out_again():
    data = xr.Dataset({"alpha": ("time", np.linspace(-0.1, 0.3, 7)), "qhat": ("time", np.linspace(0.0, 0.01, 7) ** 2)})
    centred = Model("CL", ["1", "alpha", "alpha**2", "qhat*alpha"], {"alpha": 0.1, "qhat": 0.002})
    theta = np.array([0.3, 5.0, -2.0, 7.0])
    absolute, matrix = centred.absolute()
    assert set(absolute.terms) == {"1", "alpha", "alpha**2", "qhat*alpha", "qhat"}
    np.testing.assert_allclose(absolute.design(data) @ (matrix @ theta), centred.design(data) @ theta, rtol=1e-13)


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
def test_what_cannot_be_read_is_said(text, error, words):
    with pytest.raises(error, match=words):
        Model.parse(text)


def test_missing_data_and_idle_references_are_said():
    with pytest.raises(UnknownName, match="unknown model variable 'qhat'"):
        Model("CL", ["qhat"]).design(xr.Dataset({"alpha": ("time", [0.1])}))
    with pytest.raises(UnknownName, match="unknown reference 'beta'"):
        Model("CL", ["alpha"], {"beta": 0.1})

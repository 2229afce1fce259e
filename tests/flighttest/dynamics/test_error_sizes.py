"""Standard errors in per cent, in milliseconds, negative or not a number are reported where they are given."""

import warnings
from math import inf, nan

import pytest

from flightmech.errors import AeromatchWarning, SchemaError, UnknownName
from flighttest.reconstruction.dynamics.coefficient_errors import ERRORS
from flighttest.reconstruction.dynamics.error_sizes import complete_errors, error_size_remarks


def test_usual_errors_replace_the_defaults_without_a_word():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        complete = complete_errors(ERRORS, {"mass": 0.02, "timing": 0.01})
        assert complete_errors(ERRORS, None) == ERRORS
    assert complete == {**ERRORS, "mass": 0.02, "timing": 0.01}


@pytest.mark.parametrize(
    ("source", "size", "words"),
    [("mass", 5.0, "500 %"), ("timing", 20.0, "20 s; 0.002 s is usual: correct the number")],
)
def test_an_error_in_another_unit(source, size, words):
    with pytest.warns(AeromatchWarning, match=words):
        complete_errors(ERRORS, {source: size})


def test_errors_of_the_landing_gear_have_units_of_their_own():
    (line,) = error_size_remarks({"wind": 20.0, "drag": 3.0, "lift": 0.3})
    assert line.startswith("error drag = 3 is a standard error of 3 in CD; 0.03 in CD is usual")


def test_an_inertia_from_a_formula_and_a_thrust_from_a_leaflet_have_large_errors():
    assert error_size_remarks({"inertia": 0.2, "thrust": 0.25}) == []
    assert len(error_size_remarks({"inertia": 2.0, "thrust": 0.5})) == 2


def test_errors_that_are_no_size():
    with pytest.raises(SchemaError) as caught:
        complete_errors(ERRORS, {"mass": -0.1, "thrust": nan, "qbar": inf})
    assert len(caught.value.problems) == 3
    with pytest.raises(UnknownName):
        complete_errors(ERRORS, {"masses": 0.1})

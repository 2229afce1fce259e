"""Unusual numbers and models of a project file are remarks of the plan."""

from types import SimpleNamespace

import pytest

from aeromatch.planning.remarks import project_remarks
from aeromatch.project.model_sections import NewTerm
from flightmech.errors import SchemaError


def remarks(*models, **errors):
    fit = SimpleNamespace(name="pitch", models=models)
    project = SimpleNamespace(fit=(fit,), errors=errors, ground_effect=None)
    return project_remarks(project)


def test_usual_errors_and_models_have_no_remark():
    assert remarks("Cm = 1 + alpha + qhat", mass=0.005, thrust=0.1, timing=0.02) == []


def test_standard_errors_in_per_cent():
    mass, thrust = remarks(mass=0.5, thrust=3.0)
    assert "errors.mass = 0.5 is a standard error of 50 %" in mass
    assert "0.005 for half a per cent" in mass
    assert "300 %" in thrust
    assert "2 s" in remarks(timing=2.0)[0]


def test_a_model_without_its_constant():
    (line,) = remarks("Cm = alpha + qhat + delta_e")
    assert "has no constant" in line
    assert "write Cm = 1 + ..." in line


def test_a_rate_with_a_dimension():
    (line,) = remarks("Cm = 1 + alpha + q")
    assert "write qhat" in line


def test_an_angle_without_a_unit_that_is_one_in_degrees():
    with pytest.raises(SchemaError) as caught:
        NewTerm(axes={"alpha": [0, 6]}, stderr=0.1).leaf()
    assert caught.value.problems == [
        "axis alpha reaches 6 rad, 343.8 deg; a number without a unit is in rad: write '6 deg'"
    ]
    # small numbers are radians, a text has its unit, and other axes have no angle
    NewTerm(axes={"alpha": [0, 0.1]}, stderr=0.1).leaf()
    NewTerm(axes={"alpha": ["0 deg", "180 deg"], "mach": [0, 3]}, stderr=0.1).leaf()

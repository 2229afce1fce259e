"""Instruments outside of the aircraft."""

from types import SimpleNamespace

import numpy as np

from flighttest.reconstruction.quality.instruments.positions import position_findings

C182 = SimpleNamespace(b=10.9, cbar=1.49, cg=(0.0, 0.0, 0.0))


def test_places_inside_and_on_booms():
    places = {
        "ax_imu": np.array([0.4, 0.15, 0.25]),
        "alpha_vane": np.array([1.1, -5.4, -0.55]),
        "beta_vane": np.array([14.0, 0.0, 0.0]),
    }
    assert position_findings(places, C182) == []


def test_inches_as_metres_are_one_error_for_one_place():
    place = np.array([43.3, -141.7, -21.6])
    (finding,) = position_findings({"alpha_vane": place, "beta_vane": place}, C182)
    assert (finding.severity, finding.name) == ("error", "geometry:alpha_vane+beta_vane")
    assert "as if the numbers were inches: a number without a unit is in m" in finding.text
    assert '"43.3 in", "-141.7 in", "-21.6 in"' in finding.remedy


def test_a_vane_far_behind_the_cg_is_an_error_and_a_unit_there_is_none():
    place = np.array([-11.0, 0.0, 0.2])
    (finding,) = position_findings({"ax_imu": place, "alpha_vane": place}, C182)
    assert (finding.severity, finding.name) == ("error", "geometry:alpha_vane")
    assert "position = [-11, 0, 0.2] m is 11 m behind the c.g." in finding.text
    assert "if only the sign is wrong, x = 11 m" in finding.remedy
    # half a span: a boom at the tip of a swept wing
    assert position_findings({"alpha_vane": np.array([-5.4, 5.4, 0.0])}, C182) == []

"""Remarks on a run that leaves the flown region of its model."""

import numpy as np
import pytest

from pom.judging.envelope_remarks import envelope_remarks
from pom.status import DEPARTURES, NOTICES

TIME = np.linspace(0.0, 10.0, 101)


def outputs(**regions):
    """Return regions by span of time ``a2=(2.0, 4.0)``: a letter, then the code."""
    region, axis = np.zeros(TIME.size), np.zeros(TIME.size)
    for key, (start, stop, code) in regions.items():
        inside = (start <= TIME) & (stop > TIME)
        region[inside], axis[inside] = int(key[1:]), code
    return {"envelope.region": region, "envelope.axis": axis}


def test_shares_axes_and_first_time():
    found = envelope_remarks(TIME, outputs(a2=(2.0, 3.0, 3), b2=(3.0, 5.0, 1), c3=(9.0, 9.5, 2)))
    assert [remark.kind for remark in found] == ["low_confidence", "envelope_left"]
    assert found[0].text == (
        "low confidence: a-priori, supported by no flight, in 30 % of the time by alpha, mach, "
        "first at 2.0 s"
    )
    assert found[0].quantity == "alpha"
    assert found[1].values["share"] == pytest.approx(0.0495, abs=1e-4)
    assert "extrapolated beyond the tables, in 5 % of the time by beta" in found[1].text


def test_flown_and_between_have_no_remark():
    assert envelope_remarks(TIME, outputs(a0=(0.0, 5.0, 0), b1=(5.0, 9.0, 1))) == ()


def test_a_touch_has_no_remark():
    assert envelope_remarks(TIME, outputs(a2=(2.0, 2.05, 1))) == ()


def test_rest_and_models_without_an_envelope():
    ground = {**outputs(a3=(0.0, 11.0, 1)), "V": np.full(TIME.size, 3.0)}
    assert envelope_remarks(TIME, ground) == ()
    rolling = {**ground, "V": np.linspace(0.0, 30.0, TIME.size)}
    (remark,) = envelope_remarks(TIME, rolling)
    assert "in 100 % of the time by alpha, first at 5.1 s" in remark.text
    assert envelope_remarks(TIME, {"V": TIME}) == ()
    (remark,) = envelope_remarks(TIME, rolling, TIME < 7.95)
    assert "in 100 % of the time by alpha, first at 8.0 s" in remark.text
    assert envelope_remarks(TIME, rolling, np.ones(TIME.size, bool)) == ()


def test_unknown_axis_is_not_named():
    (remark,) = envelope_remarks(TIME, outputs(a2=(0.0, 5.0, 0)))
    assert "in 50 % of the time, first" in remark.text
    assert "'aeromatch db envelope' names it" in remark.text


def test_kinds_of_the_remarks():
    assert "envelope_left" in DEPARTURES
    assert "low_confidence" in NOTICES
    assert "low_confidence" not in DEPARTURES

"""The catalogue of a flight-test programme."""

import numpy as np
import pytest

from flightmech.errors import SchemaError
from flighttest.flight_programme.planning.catalogue import read_catalogue

CATALOGUE = """
title = "Light aeroplane"
margin = 0.8
rates = { gps = "5 Hz" }
[limits]
alpha = ["-3 deg", "12 deg"]
[[condition]]
name = "cruise"
setup = "60 s"
fixed = { V = "100 kt", h = "3000 ft" }
[[manoeuvre]]
name = "doublet"
kind = "multistep"
setup = "15 s"
[manoeuvre.axis.delta_e]
amplitude = "2 deg"
pattern = "doublet"
step = "0.8 s"
[[manoeuvre]]
name = "sideslips"
kind = "sideslip"
amplitude = "5 deg"
duration = "9 s"
conditions = ["cruise"]
[[fit]]
name = "pitch"
manoeuvres = ["doublet"]
models = ["Cm = 1 + alpha + qhat + delta_e"]
[[wanted]]
term = "Cm/basic"
within = { alpha = ["0 deg", "8 deg"] }
ratio = 0.5
"""


def written(tmp_path, text):
    file = tmp_path / "catalogue.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_it_is_read_in_si(tmp_path):
    found = read_catalogue(written(tmp_path, CATALOGUE))
    assert found.limits["alpha"] == pytest.approx((np.radians(-3), np.radians(12)))
    assert [(c.name, m.name) for c, m in found.flyable()] == [
        ("cruise", "doublet"),
        ("cruise", "sideslips"),
    ]
    doublet, sideslips = found.manoeuvre
    assert np.abs(doublet.design.signal()["delta_e"]).max() == pytest.approx(np.radians(2))
    assert (sideslips.amplitude, sideslips.duration) == pytest.approx((np.radians(5), 9.0))
    assert found.wanted[0].within["alpha"] == pytest.approx((0.0, np.radians(8)))


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (
            'conditions = ["cruise"]',
            'conditions = ["cruse"]',
            "manoeuvre 'sideslips': unknown condition 'cruse'",
        ),
        (
            'manoeuvres = ["doublet"]',
            'manoeuvres = ["dublet"]',
            "fit 'pitch': unknown manoeuvre 'dublet'",
        ),
        ('duration = "9 s"', "", "a sideslip needs amplitude and duration"),
        ('step = "0.8 s"', "", "give step or omega"),
        ("ratio = 0.5", "ratio = 0.5\nstderr = 0.1", "give stderr or ratio, one of them"),
        ('amplitude = "5 deg"', 'amplitude = "5 kt"', "kt"),
        ('name = "sideslips"', 'name = "doublet"', "manoeuvre 'doublet' is there twice"),
        ('"Cm = 1 + alpha', '"Cm = 1 + alfa', "alfa"),
        ("margin = 0.8", "margin = 0.8\nerrors = { weight = 0.1 }", "weight"),
    ],
)
def test_a_fault_is_stated(tmp_path, old, new, problem):
    assert old in CATALOGUE
    with pytest.raises(SchemaError) as caught:
        read_catalogue(written(tmp_path, CATALOGUE.replace(old, new)))
    assert problem in str(caught.value)

"""Inertial units that are turned against the body axes."""

from dataclasses import replace

import numpy as np
import pytest

from flightmech.units import DEGREE
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.recording.unit_mounting import (
    mounting_findings,
    unit_mounting,
)

STEP = 0.05
TIME = np.arange(0.0, 60.0, STEP)


def flown():
    """Return a motion about all axes with the rates of its attitude."""
    phi, theta = 0.3 * np.sin(0.9 * TIME), 0.1 * np.sin(1.3 * TIME)
    psi = 0.4 * np.sin(0.4 * TIME)
    phi_rate, theta_rate = 0.27 * np.cos(0.9 * TIME), 0.13 * np.cos(1.3 * TIME)
    psi_rate = 0.16 * np.cos(0.4 * TIME)
    level = psi_rate * np.cos(theta)
    values = {"phi": phi, "theta": theta, "psi": psi, "p": phi_rate - psi_rate * np.sin(theta)}
    values["q"] = theta_rate * np.cos(phi) + level * np.sin(phi)
    values["r"] = level * np.cos(phi) - theta_rate * np.sin(phi)
    # sensor noise is not known to the attitude
    for name in "pqr":
        values[name] = values[name] + 1e-3 * np.sin(7.0 * TIME + len(name))
    good = {name: np.ones(TIME.shape, bool) for name in values}
    return ResampledChannels(TIME, values, good, np.ones(TIME.shape, bool), STEP)


def turned(signals, yaw):
    c, s = np.cos(yaw), np.sin(yaw)
    p, q = signals["p"], signals["q"]
    return signals.with_values({"p": c * p + s * q, "q": c * q - s * p})


def test_a_unit_turned_by_twelve_degrees_is_named_and_turned_back():
    signals = turned(flown(), 12.0 * DEGREE)
    mounting = unit_mounting(signals)
    assert mounting.angles / DEGREE == pytest.approx([12.0, 0.0, 0.0], abs=0.2)
    (finding,), corrected = mounting_findings(mounting, signals)
    assert finding.name == "mounting:p+q+r"
    assert "yaw +12.0 deg" in finding.text
    assert corrected["q"] == pytest.approx(flown()["q"], abs=2e-3)
    # the printed matrix turns the columns of the unit back
    rows = finding.remedy.partition("[")[2].partition("]")[0].split("; ")
    matrix = np.array([row.split(", ") for row in rows], float)
    body = matrix @ np.stack([signals[name] for name in "pqr"])
    for name, rate in zip("pqr", body, strict=True):
        assert rate == pytest.approx(flown()[name], abs=2e-3)


def test_a_pitch_of_the_unit_has_its_sign():
    signals = flown()
    c, s = np.cos(5.0 * DEGREE), np.sin(5.0 * DEGREE)
    p, r = signals["p"], signals["r"]
    # nose up: the x axis of the unit has a part of -z, the z axis a part of x
    raised = signals.with_values({"p": c * p - s * r, "r": c * r + s * p})
    assert unit_mounting(raised).angles / DEGREE == pytest.approx([0.0, 5.0, 0.0], abs=0.2)


@pytest.mark.parametrize(
    "change",
    [
        lambda s: s,
        lambda s: turned(s, 2.0 * DEGREE),
        lambda s: s.with_values({"p": -s["p"]}),
        lambda s: s.with_values({"p": s["q"], "q": s["p"]}),
        lambda s: s.with_values({"q": s["q"] / DEGREE}),
        lambda s: s.with_values({"phi": np.roll(s["phi"], 6)}),
        lambda s: s.with_values({"theta": -s["theta"]}),
        # a roll with little pitching hides the wrong sign of the pitch attitude
        lambda s: s.with_values({"theta": -s["theta"], "p": 3.0 * s["p"], "phi": 3.0 * s["phi"]}),
    ],
    ids=["sound", "little", "sign", "exchanged", "unit", "late", "attitude", "roll"],
)
def test_other_mistakes_are_no_turned_unit(change):
    signals = change(flown())
    assert mounting_findings(unit_mounting(signals), signals) == ([], signals)


def test_a_record_without_heading_shows_no_mounting():
    signals = flown()
    assert unit_mounting(signals.without(("psi",))) is None
    still = replace(signals, values={name: 0.0 * x for name, x in signals.values.items()})
    assert unit_mounting(still) is None

"""A surface whose column goes on in another unit has two effects, 57.3 times apart."""

import numpy as np
import pytest

from flightmech.units import DEGREE
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.recording.changing_units import changing_unit_findings

STEP = 0.05
TIME = np.arange(0.0, 60.0, STEP)


def fly(factor):
    """Return a pitching aeroplane whose elevator is recorded times a factor (time,)."""
    noise = np.random.default_rng(2).normal(size=(2, TIME.size))
    delta_e = 0.04 * np.sign(np.sin(1.3 * TIME)) * (np.mod(TIME, 15.0) < 6.0)
    q, alpha = np.zeros(TIME.size), np.zeros(TIME.size)
    for k in range(TIME.size - 1):
        # a short period of 3 rad/s
        q_dot = -8.0 * delta_e[k] - 2.0 * q[k] - 9.0 * alpha[k]
        q[k + 1] = q[k] + STEP * q_dot
        alpha[k + 1] = alpha[k] + STEP * (q[k] - 1.2 * alpha[k])
    values = {
        "delta_e": factor * (delta_e + 0.05),
        "q": q + 3e-4 * noise[0],
        "alpha_vane": alpha + 1e-3 * noise[1],
    }
    everywhere = np.ones(TIME.size, bool)
    good = dict.fromkeys(values, everywhere)
    return ResampledChannels(TIME, values, good=good, flying=everywhere, step=STEP)


@pytest.mark.parametrize(
    ("late", "words"),
    [(DEGREE, "in deg and went on in rad"), (1.0 / DEGREE, "in rad and went on in deg")],
)
def test_a_change_of_unit_is_named_with_its_time(late, words):
    (finding,) = changing_unit_findings(fly(np.where(TIME < 27.0, 1.0, late)))
    assert (finding.severity, finding.name) == ("error", "unit:delta_e")
    assert words in finding.text
    assert finding.start == pytest.approx(27.0, abs=6.0)


@pytest.mark.parametrize("late", [1.0, 2.0, -1.0])
def test_another_gain_is_no_change_of_unit(late):
    assert changing_unit_findings(fly(np.where(TIME < 27.0, 1.0, late))) == []

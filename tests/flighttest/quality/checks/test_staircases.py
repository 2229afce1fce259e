"""Controls that are recorded slowly and held."""

import numpy as np
import pytest
import xarray as xr

from flighttest.reconstruction.quality.finding import Finding, without_consequences
from flighttest.reconstruction.quality.recording.staircases import held_samples, staircase_findings

TIME = np.arange(0.0, 100.0, 0.04)
NOISE = np.random.default_rng(1).normal(size=TIME.size)
SURFACE = 0.1 * np.sin(0.7 * TIME) + 1e-3 * NOISE


def held(x, count, start=0):
    return x[np.maximum((np.arange(x.size) - start) // count * count + start, 0)]


def record(x, name="delta_e"):
    data = xr.Dataset({name: ("time", x)}, {"time": TIME}, {"rate": 25.0})
    return xr.DataTree.from_dict({"/controls": data})


@pytest.mark.parametrize(("count", "start"), [(25, 0), (25, 7), (5, 0)])
def test_a_held_surface(count, start):
    (finding,) = staircase_findings(record(held(SURFACE, count, start)))
    assert (finding.severity, finding.name) == ("warning", "staircase:delta_e")
    assert f"every {count}th sample" in finding.text
    assert f"{25 / count:g} Hz" in finding.text


def test_coarse_steps_of_a_slow_surface_are_none():
    coarse = np.round(SURFACE / 0.01) * 0.01
    assert held_samples(coarse) == 1
    assert held_samples(np.round(0.1 * np.sin(0.7 * TIME) / 0.01)) == 1
    assert staircase_findings(record(SURFACE)) == []
    # 12.5 Hz are enough, and a satellite receiver is not a control
    assert staircase_findings(record(held(SURFACE, 2))) == []
    assert staircase_findings(record(held(SURFACE, 25), "vn")) == []


def test_a_hold_is_not_a_delay():
    lag = Finding("warning", "lag", ("delta_e", "q"), "late")
    (finding,) = without_consequences([lag, *staircase_findings(record(held(SURFACE, 25)))])
    assert finding.kind == "staircase"

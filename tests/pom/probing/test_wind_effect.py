"""A pass that rests on the variation of the recorded wind is a departure."""

import sys
from pathlib import Path

import numpy as np
import pytest

from pom.cases.job import ReplayJob
from pom.probing import weigh_wind
from pom.probing.wind_effect import LEAST_VARIATION

sys.path.insert(0, str(Path(__file__).parents[1]))
import report_fixture as fixture

RUN = "final"


def weigh(size, amplitude):
    """Return the remarks for an answer that moves by a share of itself without the gusts."""
    result = fixture.roll_result()
    time = result.signals["time"].values
    names = [str(name) for name in result.signals.data_vars]
    outputs = {name: result.signals[name].sel(run="flight").values for name in names}
    flown = []

    def fly(job, channels):
        flown.append(job)
        return {name: (1.0 + size) * outputs[name] for name in channels}, ""

    wind = 3.0 + amplitude * np.sin(2.0 * np.pi * np.linspace(0.0, 3.0, time.size))
    job = ReplayJob(time, {"wind_d": wind, "delta_a": wind}, {}, (), ())
    return weigh_wind(result, RUN, job, outputs, fly), flown


def test_rows_that_fail_in_the_mean_wind_make_a_departure():
    (remark,), (job,) = weigh(0.5, 1.0)
    assert remark.kind == "departure"
    assert "the pass rests on the wind" in remark.text
    assert max(remark.values.values()) > 1.0
    # the mean of the wind, and all other inputs as they were
    assert np.ptp(job.inputs["wind_d"]) == 0.0
    assert job.inputs["wind_d"][0] == pytest.approx(3.0, abs=1e-12)
    assert np.ptp(job.inputs["delta_a"]) > 1.0


def test_a_small_effect_is_stated_and_a_steady_wind_is_not_flown():
    (remark,), _ = weigh(1e-4, 1.0)
    assert remark.kind == "probe"
    assert weigh(0.5, 0.45 * LEAST_VARIATION) == ((), [])

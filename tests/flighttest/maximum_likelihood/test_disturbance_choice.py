"""Choice between filter error and output error by their costs, of one simulated record."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from test_motion_fit import short_period

from flighttest.maximum_likelihood.linear.disturbance_choice import prefer_calm
from flighttest.maximum_likelihood.linear.motion_fit import fit_motion
from flighttest.maximum_likelihood.result import CALM
from flighttest.maximum_likelihood.unknowns import Unknown

READINGS = 1200
WANTED = {"M_alpha": Unknown(-5.0), "process.q": Unknown(0.01)}


@pytest.fixture(scope="module")
def calm():
    return fit_motion([short_period(1)], "short-period").fit


def choose(calm, rise, converged=True):
    """Return the choice if the cost rises by some nats without the disturbance."""
    cost = calm.estimates.attrs["cost"] + 0.5 * READINGS - rise
    about = {"cost": cost, "converged": converged, "method": "filter error"}
    filtered = replace(calm, estimates=calm.estimates.assign_attrs(about))
    return prefer_calm(filtered, WANTED, (), lambda wanted: calm, READINGS)


def test_output_error_replaces_only_a_filter_at_its_maximum(calm):
    """Output error is nested in the filter: a filter that costs more has not found its maximum."""
    assert CALM in choose(calm, 0.5).estimates.attrs
    assert CALM in choose(calm, -0.05).estimates.attrs
    assert CALM not in choose(calm, 10.0).estimates.attrs
    stuck = choose(calm, -5.0)
    assert CALM not in stuck.estimates.attrs
    assert stuck.estimates.attrs["method"] == "filter error"
    assert any("5 nats above output error" in text for text in stuck.warnings)
    assert any("5 nats above output error" in remark.text for remark in stuck.remarks)
    unfinished = choose(calm, 0.5, converged=False)
    assert CALM not in unfinished.estimates.attrs
    assert any(remark.kind == "convergence" for remark in unfinished.remarks)

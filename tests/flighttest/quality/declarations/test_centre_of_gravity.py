"""Centre of gravity off the chord, and of file and record that differ."""

from types import SimpleNamespace

import numpy as np
import pytest

from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.declarations.centre_of_gravity import centre_findings


def judged(stated, recorded=None):
    aircraft = SimpleNamespace(cg=stated, cbar=1.6, b=10.0, S=16.0, mass=2000.0, x_ref_mac=0.27)
    values = {}
    if recorded is not None:
        values["x_cg_b"] = np.full(50, recorded)
    good = {name: np.ones(50, bool) for name in values}
    time = np.arange(50.0)
    signals = ResampledChannels(time, values, good=good, flying=np.ones(50, bool), step=1.0)
    return centre_findings(signals, aircraft)


@pytest.mark.parametrize("x", [-0.2, 0.0, 0.2])
def test_usual_places(x):
    findings, unchecked = judged((x, 0.0, 0.2), recorded=x)
    assert findings == []
    assert [row[0] for row in unchecked] == ["cg"]  # a tenth of the chord is not to be seen


def test_tenth_of_the_chord_between_file_and_record():
    (finding,), _ = judged((-0.16, 0.0, 0.0), recorded=0.0)
    assert finding.name == "geometry:cg+x_cg_b"


@pytest.mark.parametrize(("x", "severity"), [(-3.0, "error"), (0.8, "warning")])
def test_origin_or_unit(x, severity):
    (finding,), _ = judged((x, 0.0, 0.0))
    assert (finding.severity, finding.name) == (severity, "geometry:cg")

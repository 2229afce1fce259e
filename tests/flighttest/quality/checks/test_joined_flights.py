"""Files that hold two flights whose clock runs on."""

import numpy as np
import pytest
import xarray as xr

from flighttest.reconstruction.quality.checks.samples import faults_of
from flighttest.reconstruction.quality.recording.lost_samples import lost_samples

TIME = np.arange(0.0, 40.0, 0.04)
LATER = TIME > 20.0


def record_of(steps):
    """Return a record of slow motion whose channels step in the middle."""
    noise = np.random.default_rng(1).standard_normal((len(steps), TIME.size))
    columns = {}
    for k, (name, step) in enumerate(steps.items()):
        size = 0.02 if name in ("h_baro", "V_cas") else 1e-4
        slow = 0.1 * size * np.sin(0.5 * TIME + k)
        columns[name] = "time", 10.0 * slow + size * noise[k] + LATER * step
    leaf = xr.Dataset(columns, {"time": TIME}, {"rate": 25.0})
    return xr.DataTree.from_dict({"/imu": leaf})


STEPS = {"phi": 0.02, "theta": 0.03, "psi": 0.5, "p": 0.02, "h_baro": 60.0, "V_cas": 8.0}


def test_a_second_flight_in_a_file_is_named():
    record = record_of(STEPS)
    (finding,), _ = lost_samples(record, faults_of(record))
    assert finding.kind == "lost"
    assert "or another flight begins there: h_baro by +60" in finding.text
    assert "V_cas by +7.98 m/s" in finding.text
    assert "split a file that holds two flights there" in finding.remedy


@pytest.mark.parametrize("small", [{"psi": 0.05, "h_baro": 2.0, "V_cas": 1.0}])
def test_lost_samples_alone_are_no_second_flight(small):
    record = record_of(STEPS | small)
    (finding,), _ = lost_samples(record, faults_of(record))
    assert "another flight" not in finding.text

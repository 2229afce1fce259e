"""Calibrated airspeed that the name map calls true airspeed, and the reverse."""

import json

import numpy as np
import pytest
import xarray as xr

from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.navigation.airspeed_definition import definition_finding

TIME = np.arange(0.0, 20.0, 0.05)


def read_as(channel, heading):
    """Return signals and record of a flight at 3000 m whose airspeed is read as a channel."""
    values = {channel: np.full(TIME.shape, 60.0), "h_baro": np.full(TIME.shape, 3000.0)}
    good = {name: np.ones(TIME.shape, bool) for name in values}
    signals = ResampledChannels(TIME, values, good, np.ones(TIME.shape, bool), 0.05)
    entry = {"map_entry": json.dumps({"column": heading}), "column": heading, "file_unit": "kt"}
    leaf = xr.Dataset({channel: ("time", values[channel], entry)}, {"time": TIME})
    return signals, xr.DataTree.from_dict({"/air_data": leaf})


@pytest.mark.parametrize(
    ("channel", "other", "scale"), [("V", "V_cas", 0.865), ("V_cas", "V", 1.156)]
)
def test_the_other_airspeed_is_named(channel, other, scale):
    signals, record = read_as(channel, "AS")
    finding = definition_finding(channel, scale, 0.004, signals=signals, record=record)
    assert finding.name == f"definition:{channel}"
    assert finding.remedy.startswith(f'{other} = "AS"')
    assert not finding.evidence["heading"]


def test_another_scale_is_not_the_other_airspeed():
    signals, record = read_as("V", "AS")
    for scale in (0.95, 1.05, 1.156):
        assert definition_finding("V", scale, 0.004, signals=signals, record=record) is None


def test_a_heading_of_the_other_airspeed_settles_it():
    signals, record = read_as("V", "CAS")
    finding = definition_finding("V", 0.865, 0.004, signals=signals, record=record)
    assert finding.evidence["heading"]

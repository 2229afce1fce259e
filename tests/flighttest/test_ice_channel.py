"""The setting of the ice in a record: constant over a flight, and no fault."""

import numpy as np
import pandas as pd
import xarray as xr

from flighttest.reconstruction.quality.checks.samples import channel_findings
from flighttest.records.signals.resampling import is_control


def test_a_flight_may_be_iced_from_start_to_end():
    def findings(name):
        data = xr.Dataset({name: ("time", np.ones(20))}, {"time": np.arange(20.0)})
        record = xr.DataTree.from_dict({"/controls": data})
        row = {"leaf": "controls", "channel": name, "minimum": 1.0, "maximum": 1.0, "units": "1"}
        row |= {"noise": np.nan, "repeated": 1.0, "resolution": np.nan, "rate": 1.0, "count": 20}
        return channel_findings(record, pd.DataFrame([row]), None)

    assert findings("device.ice.setting") == []
    # fuel lever and feather of an engine that runs, or does not, all the flight
    assert findings("engine1.cutoff") == findings("engine1.feather") == []
    assert [found.kind for found in findings("temperature")] == ["stuck"]
    assert is_control("device.ice.setting")

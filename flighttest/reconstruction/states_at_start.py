"""States of a record before its reconstruction: the names, the clock and the recorded channels that
the path will have.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.names import quantity_attributes
from flighttest.reconstruction.path_quantities import path_columns
from flighttest.reconstruction.problem.assembly import assemble_problem
from flighttest.records.sensors.instruments import instruments_of
from flighttest.records.sensors.measurements import order_windows


def start_states(record: xr.DataTree, aircraft: Aircraft, rate: float = 50.0) -> xr.Dataset:
    """Return the states at the start values of the reconstruction of a record.

    They cost a hundredth of `reconstruct` and hold the same channels on the same clock. Recorded
    channels (controls, engines, devices) have their final values; the motion is that of the
    uncorrected readings. Use them to check what a later step needs.

    Parameters
    ----------
    record : DataTree
        As `reconstruct` takes it; the whole record is used.
    aircraft : Aircraft
        With its instruments.
    rate : float
        Samples per second. [Hz]

    Returns
    -------
    Dataset (time,)
        Variables as `FlightPath.states`. [SI]

    Raises
    ------
    SchemaError
        A needed channel is missing or holds NaN; the instrument specification is faulty.
    OutOfRange
        The record is shorter than ten samples, or its pitch attitude exceeds 80 deg.
    """
    setup = assemble_problem(
        record,
        aircraft,
        instruments_of(aircraft, record.attrs),
        order_windows(record, None),
        rate,
        None,
    )
    # readings that contradict each other may overflow here; the checks look at names and recorded
    # channels
    with np.errstate(all="ignore"):
        columns = path_columns(record, aircraft, setup, setup.x, setup.c)
    data = {name: ("time", values, quantity_attributes(name)) for name, values in columns.items()}
    about = {"record": str(record.attrs.get("title", "")), "rate": rate}
    return xr.Dataset(
        data, {"time": ("time", setup.problem.time, quantity_attributes("time"))}, about
    )

"""States of a record before its reconstruction, with the channels and the clock of the path."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.names import quantity_attributes
from flightmech.support.array_files.labelled_arrays import make_dataset, make_variable
from flighttest.reconstruction.path_quantities import path_columns
from flighttest.reconstruction.problem.assembly import assemble_problem
from flighttest.records.record import find_channel_leaf

# Vane of each flow angle, and channels that show both angles in uniform air.
_FLOW_ANGLES = {"alpha": "alpha_vane", "beta": "beta_vane"}
_INERTIAL = ("psi", "vn", "ve", "vd")


def start_states(record: xr.DataTree, aircraft: Aircraft, rate: float = 50.0) -> xr.Dataset:
    """Return the states at the start values of the reconstruction of a record.

    They have the channels and the clock of `reconstruct` without its iterations. Recorded channels
    (controls, engines, devices) have their final values. The motion follows from uncorrected
    readings. Use these states to check that a later step has its channels.

    Parameters
    ----------
    record : DataTree
        As in `reconstruct`; the complete record is used.
    aircraft : Aircraft
        With its instruments.
    rate : float
        Samples per second. [Hz]

    Returns
    -------
    Dataset (time,)
        Variables as `FlightPath.states`. [SI] The attribute ``unknown`` names the angles ``alpha``
        and ``beta`` that neither a vane nor velocity and heading show.

    Raises
    ------
    SchemaError
        A required channel is missing or holds NaN, or the instrument specification is faulty.
    OutOfRange
        The record is shorter than ten samples, or its pitch attitude exceeds 80 deg.
    """
    setup = assemble_problem(record, aircraft, rate=rate)
    # Readings that contradict each other may overflow here. The checks look at names and recorded
    # channels.
    with np.errstate(all="ignore"):
        columns = path_columns(record, aircraft, setup=setup, x=setup.x, c=setup.c)
    has_velocity = all(find_channel_leaf(record, name) for name in _INERTIAL)
    unknown = []
    for angle, vane in _FLOW_ANGLES.items():
        # Without inertial velocity and heading, only a vane shows an angle.
        if has_velocity:
            continue
        if vane in setup.problem.vanes:
            columns[angle] = setup.x[:, 7 + setup.problem.vanes.index(vane)]
        else:
            unknown.append(angle)
    variables = {}
    for name, values in columns.items():
        variables[name] = make_variable("time", values, quantity_attributes(name))
    clock = make_variable("time", setup.problem.time, quantity_attributes("time"))
    attributes = {"record": str(record.attrs.get("title", "")), "rate": rate}
    if unknown:
        attributes["unknown"] = " ".join(unknown)
    return make_dataset(variables, {"time": clock}, attributes)

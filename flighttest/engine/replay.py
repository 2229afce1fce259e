"""A deck flown through a record: the lever drives it along the recorded Mach number and height."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.air import atmosphere
from flightmech.aircraft.systems.engine_deck import Deck
from flightmech.errors import IdentificationError
from flightmech.simulation.kernel import STATE
from flightmech.simulation.run import constant_inputs, prepared

from . import bench

OUTPUTS = ("n1", "n2", "fuel_flow", "itt", "thrust")
_PLACED = ("vx", "vy", "vz", "q0", "q1", "q2", "q3", "p", "q", "r", "z")


def fly_deck(deck: Deck, record: xr.Dataset) -> xr.Dataset:
    """Return what a deck makes of the lever of a record.

    Unlike in the search, Mach number and height are those of every sample.

    Parameters
    ----------
    deck : Deck
    record : Dataset (time,)
        ``throttle`` [1], ``mach``, ``h`` [m], and ``temperature`` [K] if not standard, as `engine_channels` returns them; it counts
        as begun with the engine settled.

    Returns
    -------
    Dataset (time,)
        ``n1``, ``n2`` [1], ``fuel_flow`` [kg/s], ``itt`` [K], ``thrust`` [N].

    Raises
    ------
    IdentificationError
        The record lacks the lever.
    """
    if "throttle" not in record:
        raise IdentificationError(f"the record has {' '.join(map(str, record.data_vars))}; the lever, throttle, is needed")
    model = bench.compiled(deck)
    held, _ = bench.condition(record)
    time = record["time"].values.astype(float)
    mach, h = (record[name].values.astype(float) if name in record else np.zeros(len(time)) for name in ("mach", "h"))
    V = mach * np.asarray(atmosphere(h, delta_T=held["env.delta_T"]).a_sound)
    inputs = bench.simulation_inputs(record, np.zeros(len(time)))
    levers = [constant_inputs(model, {str(name): float(inputs[name].values[k]) for name in inputs.data_vars}) for k in range(len(time))]
    places = [row.name for row in model.entries(STATE)]
    fixed = [places.index(f"state.{name}") for name in _PLACED]
    columns = [model.outputs.index(f"engine1.{name}") for name in OUTPUTS]
    simulation = prepared(model, held | {"init.V": max(V[0], 1.0), "init.h": h[0], "init.alpha": 0.0}, levers[0], time[0])
    rows = []
    for k, lever in enumerate(levers):
        x = simulation.state
        x[fixed] = (V[k], 0.0, 0.0, 1.0, *[0.0] * 6, -h[k])
        simulation.state = x
        rows.append(simulation.outputs()[columns])
        if k + 1 < len(levers):
            simulation.step(time[k], time[k + 1] - time[k], lever, levers[k + 1])
    found = dict(zip(OUTPUTS, np.array(rows).T))
    return xr.Dataset({name: ("time", values) for name, values in found.items()}, {"time": time}, dict(record.attrs))

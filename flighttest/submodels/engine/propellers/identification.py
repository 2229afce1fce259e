"""Identification of propellers and their engines from records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import IdentificationError
from flightmech.quantities import time_text
from flightmech.support.arrays import true_spans
from flighttest.reconstruction.dynamics.reduced_rates import read_columns
from flighttest.reconstruction.dynamics.shaft_condition import (
    has_shaft_speed,
    propeller_of,
    shaft_speed,
)
from flighttest.submodels.engine.propellers.equations import PropulsionEquations
from flighttest.submodels.engine.propellers.estimate import (
    estimate_points,
    separate_thrust_and_drag,
)
from flighttest.submodels.engine.propellers.points import (
    DURATION,
    cut_off_samples,
    propeller_points,
)
from flighttest.submodels.engine.propellers.result import PropellerFit
from flighttest.submodels.engine.propellers.shaft_dynamics import identify_shaft, shaft_changes
from flighttest.submodels.engine.records import engine_channels
from flighttest.submodels.engine.static_thrust import Polar


def identify_propeller(
    records: Sequence[Any],
    aircraft: Aircraft,
    polar: Polar,
    *,
    power_changes: Sequence[Any] = (),
    pla: tuple[float, float] | None = None,
    errors: Mapping[str, float] | None = None,
    duration: float = DURATION,
) -> PropellerFit:
    """Identify thrust and power of propeller and engine together with the drag polar.

    Parameters
    ----------
    records : sequence of Path or Dataset (time,)
        Climbs, glides, level accelerations and decelerations, as for `propeller_points`.
    aircraft : Aircraft
        A-priori propeller and engine. All engines are of one type.
    polar : Polar
        Drag polar of the flown configuration with its standard errors; zero holds a value.
    power_changes : sequence of Path or Dataset (time,)
        Records that hold chops and slams, which are cut out of them (`shaft_changes`); without
        such, or without ``engineN.throttle``, no dynamics.
    pla : (idle, full), optional
        Lever angles at throttle 0 and 1, where records have angles. [rad]
    errors : mapping of str to float, optional
        Standard errors of the common errors of the instruments in place of the defaults: relative
        for ``V mass rpm torque manifold_pressure fuel_flow climb``, ``temperature`` [K], ``alpha``
        [rad].
    duration : float
        Time over which a point is a mean. [s]

    Returns
    -------
    PropellerFit

    Raises
    ------
    IdentificationError
        An impossible polar, no engine with a propeller, engines of several types, no points, no
        measured power of a governed propeller, or lever angles without `pla`.
    UnknownName
        A channel is missing.
    """
    polar.demand_possible()
    if not aircraft.engines:
        raise IdentificationError(
            "the aircraft file has no engine; add [[engine]] with a propeller"
        )
    for number, engine in enumerate(aircraft.engines, 1):
        propeller_of(engine, number)
    records = [_with_throttle(one, aircraft, pla) for one in records]
    power_changes = [_with_throttle(one, aircraft, pla) for one in power_changes]
    points = propeller_points(records, aircraft, duration)
    equations = PropulsionEquations(points, aircraft, polar, errors)
    estimate = estimate_points(equations)
    names = [
        getattr(one, "states", one).attrs.get("record", k + 1) for k, one in enumerate(records)
    ]
    found = PropellerFit(
        equations,
        estimate,
        separate_thrust_and_drag(equations, estimate),
        records=tuple(map(str, names)),
        cut_off=_cut_off_stretches(records, aircraft),
    )
    changes = _cut_changes(power_changes, aircraft)
    if not changes:
        return found
    return replace(found, dynamics=identify_shaft(changes, found.aircraft(aircraft)))


def _with_throttle(record: Any, aircraft: Aircraft, pla: tuple[float, float] | None) -> xr.Dataset:
    """Return the states of a record, with throttles in place of lever angles."""
    states = getattr(record, "states", record)
    added = {}
    for number in range(1, len(aircraft.engines) + 1):
        angle, lever = f"engine{number}.pla", f"engine{number}.throttle"
        if lever in states or angle not in states:
            continue
        if pla is None or pla[0] == pla[1]:
            raise IdentificationError(
                "the record has lever angles; give the angles of idle and full power as pla"
            )
        added[lever] = (states[angle] - pla[0]) / (pla[1] - pla[0])
    return states.assign(added)


def _cut_changes(records: Sequence[xr.Dataset], aircraft: Aircraft) -> list[xr.Dataset]:
    """Return the power changes of records with a lever, all engines averaged.

    The speed of a crankshaft becomes that of the propeller.
    """
    changes: list[xr.Dataset] = []
    for states in records:
        added = {}
        for number, engine in enumerate(aircraft.engines, 1):
            if has_shaft_speed(states, number) and f"engine{number}.rpm" not in states:
                columns = read_columns(states)
                added[f"engine{number}.rpm"] = "time", shaft_speed(columns, engine, number)
        numbers = range(1, len(aircraft.engines) + 1)
        channels = engine_channels(states.assign(added), numbers)
        if "throttle" not in channels:
            continue
        time = states["time"].values
        off = time[cut_off_samples(states, len(aircraft.engines))]
        for change in shaft_changes(channels):
            begin, end = (float(change["time"][k]) for k in (0, -1))
            if not ((off >= begin) & (off <= end)).any():
                changes.append(change)
    return changes


def _cut_off_stretches(records: Sequence[xr.Dataset], aircraft: Aircraft) -> tuple[str, ...]:
    """Return the stretches of records with an engine cut off, as text."""
    stretches = []
    for count, states in enumerate(records, 1):
        name = states.attrs.get("record", f"record {count}")
        off = cut_off_samples(states, len(aircraft.engines))
        for begin, end in true_spans(states["time"].values, off):
            stretches.append(f"{time_text(begin, 4)} ... {time_text(end, 4)} s of {name}")
    return tuple(stretches)

"""Mass, centre of gravity and thrust of a record, from a loading sheet and an engine deck."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import xarray as xr

from flightmech.air import P_SEA, T_SEA, atmosphere
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import IdentificationError, SchemaError, UnknownName
from flightmech.names import quantity_attributes
from flighttest.flight_programme.evaluation.plan import Loading, ThrustPoints, read_sheet
from flighttest.records.record import channel_leaves
from flighttest.remarks import Remark

# Largest residual of the points of a deck, as a share of the largest thrust. Points with a larger
# residual do not depend on corrected fuel flow and Mach number alone.
_RESIDUAL = 0.05
# Distance beyond the points of a deck, as a share of their range, that still counts as covered.
_MARGIN = 0.05
# Channels that the thrust needs besides the fuel flow.
_AIR = ("h_baro", "mach", "temperature")


def mass_after_burn(
    sheet: Loading, aircraft: Aircraft, burnt: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return mass and c.g. after fuel has been burnt.

    Parameters
    ----------
    sheet : Loading
    aircraft : Aircraft
        Position of the moment reference point on the mean chord.
    burnt : array
        Fuel burnt since the sheet was written. [kg]

    Returns
    -------
    mass, x_cg_b : array
        Mass [kg], c.g. forward of the moment reference point [m].

    Raises
    ------
    SchemaError
        The sheet has no such fuel item, or the remaining fuel is outside the fuel table.
    """
    items, table = read_sheet(sheet.file), read_sheet(sheet.fuel_table.file)
    names = [items.text(row, sheet.item) for row in range(len(items.rows))]
    if sheet.fuel not in names:
        raise SchemaError(
            f"sheet {sheet.file}", [f"no item {sheet.fuel}; there are: {', '.join(names)}"]
        )
    # dry items have a fixed moment about station 0
    dry = [row for row, name in enumerate(names) if name != sheet.fuel]
    masses = sheet.mass.of(items, "kg")
    stations = sheet.station.of(items.with_rows(dry), "m")
    moment = float((masses[dry] * stations).sum())
    # empty tanks are the first point of the fuel table
    remaining = masses[names.index(sheet.fuel)] - burnt
    fuel = np.append(0.0, sheet.fuel_table.mass.of(table, "kg"))
    fuel_moment = np.append(0.0, sheet.fuel_table.moment.of(table, "kg m"))
    if remaining.min() < 0.0 or remaining.max() > fuel[-1]:
        problem = (
            f"fuel left is {remaining.min():.4g} ... {remaining.max():.4g} kg; the fuel table "
            f"goes from 0 to {fuel[-1]:.4g} kg; check the unit of the fuel flow and the fuel taken"
        )
        raise SchemaError(f"sheet {sheet.file}", [problem])
    mass = masses[dry].sum() + remaining
    station = (moment + np.interp(remaining, fuel, fuel_moment)) / mass
    # stations count aft, the c.g. counts forward from the moment reference point
    return mass, sheet.leading_edge + aircraft.x_ref_mac * aircraft.cbar - station


def deck_thrust(
    deck: ThrustPoints,
    h: np.ndarray,
    mach: np.ndarray,
    temperature: np.ndarray,
    fuel_flow: np.ndarray,
) -> np.ndarray:
    """Return the net thrust of one engine [N] from points of its deck.

    Thrust over pressure ratio is a second-order polynomial of corrected fuel flow and Mach number,
    fitted to the points.  It is extrapolated beyond them (`thrust_remarks`).

    Raises
    ------
    IdentificationError
        The points are too few, or such a polynomial does not reproduce them.
    """
    X, delta, thrust = _deck_points(deck)
    if len(X) <= X.shape[1]:
        raise IdentificationError(
            f"{deck.file}: {len(X)} points for {X.shape[1]} coefficients of the thrust; give "
            f"more points"
        )
    theta, _, rank, _ = np.linalg.lstsq(X, thrust / delta)
    residual = float(np.abs(delta * (X @ theta) - thrust).max())
    if rank < X.shape[1] or residual > _RESIDUAL * np.abs(thrust).max():
        raise IdentificationError(
            f"{deck.file}: corrected fuel flow and Mach reproduce the points within "
            f"{residual:.3g} N only; check its units, or give thrust in the record"
        )
    X, delta = _regressors(h, mach, temperature=temperature, fuel_flow=fuel_flow)
    # the polynomial may become negative outside the points of the deck
    return np.maximum(delta * (X @ theta), 0.0)


def _deck_points(deck: ThrustPoints) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return regressors (point, 6), pressure ratio and thrust [N] of the points of a deck."""
    points = read_sheet(deck.file)
    h, mach = deck.h.of(points, "m"), deck.mach.of(points, "1")
    temperature = np.asarray(atmosphere(h).temperature) + deck.delta_T.of(points, "K")
    flow, thrust = deck.fuel_flow.of(points, "kg s-1"), deck.thrust.of(points, "N")
    X, delta = _regressors(h, mach, temperature=temperature, fuel_flow=flow)
    return X, delta, thrust


def thrust_remarks(
    record: xr.DataTree,
    aircraft: Aircraft,
    deck: ThrustPoints | None,
    windows: Iterable[tuple[float, float]],
) -> list[Remark]:
    """Return remarks on stretches whose thrust is extrapolated beyond the points of the deck.

    Parameters
    ----------
    record : DataTree
        Of `add_computed_mass`.
    aircraft : Aircraft
    deck : ThrustPoints, optional
        A record without a deck has no remark.
    windows : iterable of (start, stop)
        Stretches whose thrust is used. [s]
    """
    if deck is None:
        return []
    X, _, _ = _deck_points(deck)
    names = _flow_names(aircraft)
    time = record[channel_leaves(record)[names[0]]].to_dataset()["time"].values
    flow, air = _channels_at(record, names, time), _channels_at(record, _AIR, time)
    used = np.zeros(len(time), bool)
    for start, stop in windows:
        used |= (time >= start) & (time <= stop)
    remarks = []
    for k, row in enumerate(flow):
        at, _ = _regressors(air[0], air[1], temperature=air[2], fuel_flow=row)
        # the second and the fourth regressor are the variables themselves
        for name, column in (("corrected fuel flow [kg/s]", 1), ("Mach number", 3)):
            low, high = X[:, column].min(), X[:, column].max()
            values, margin = at[used, column], _MARGIN * (high - low)
            beyond = (values < low - margin) | (values > high + margin)
            if beyond.any():
                share = float(beyond.mean())
                text = (
                    f"engine {k + 1}: {name} is {np.nanmin(values):.4g} ... "
                    f"{np.nanmax(values):.4g}, the points of {deck.file.name} have {low:.4g} ... "
                    f"{high:.4g}: the thrust of {100.0 * share:.3g} % of the used samples is "
                    f"extrapolated; add points to the deck, or leave these stretches out"
                )
                remarks.append(Remark("extrapolated", text, f"engine{k + 1}.thrust", share, 0.0))
    return remarks


def _regressors(
    h: np.ndarray, mach: np.ndarray, *, temperature: np.ndarray, fuel_flow: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the regressors of corrected fuel flow and Mach (point, 6), and the pressure ratio."""
    delta = np.asarray(atmosphere(h).p_static) / P_SEA
    flow = fuel_flow / (delta * np.sqrt(temperature / T_SEA))
    return np.stack([np.ones_like(flow), flow, flow**2, mach, mach * flow, mach**2], axis=1), delta


def _flow_names(aircraft: Aircraft) -> list[str]:
    return [f"engine{k + 1}.fuel_flow" for k in range(len(aircraft.engines))]


def _channels_at(record: xr.DataTree, names: Iterable[str], time: np.ndarray) -> np.ndarray:
    """Return channels at times (channel, time), linear between their samples. [SI]"""
    leaves, rows = channel_leaves(record), []
    for name in names:
        leaf = record[leaves[name]].to_dataset()
        rows.append(np.interp(time, leaf["time"].values, leaf[name].values.astype(float)))
    return np.array(rows)


def add_computed_mass(
    record: xr.DataTree, aircraft: Aircraft, loading: Loading | None, deck: ThrustPoints | None
) -> xr.DataTree:
    """Return the record with mass, c.g. and thrust in a leaf ``computed``.

    The clock of the leaf is the clock of the fuel flow.

    Raises
    ------
    UnknownName
        The record does not have a required channel.
    SchemaError, IdentificationError
        As `mass_after_burn` and `deck_thrust`.
    """
    if loading is None and deck is None:
        return record
    leaves = channel_leaves(record)
    flows = _flow_names(aircraft)
    required = flows
    if deck is not None:
        required = [*flows, *_AIR]
    for name in required:
        if name not in leaves:
            raise UnknownName(
                name,
                leaves,
                "channel",
                "mass and thrust are computed from it; map it, or leave out [loading] and [thrust]",
            )
    clock = record[leaves[flows[0]]].to_dataset()
    time = clock["time"].values.astype(float)
    flow = _channels_at(record, flows, time)
    computed: dict[str, np.ndarray] = {}
    if loading is not None:
        # fuel burnt up to each sample; the flow of a sample lasts to the next
        burnt = np.concatenate([[0.0], np.cumsum(flow.sum(axis=0)[:-1] * np.diff(time))])
        computed["mass"], computed["x_cg_b"] = mass_after_burn(loading, aircraft, burnt)
    if deck is not None:
        h, mach, temperature = _channels_at(record, _AIR, time)
        for k, row in enumerate(flow):
            computed[f"engine{k + 1}.thrust"] = deck_thrust(
                deck, h, mach=mach, temperature=temperature, fuel_flow=row
            )
    variables = {name: ("time", x, quantity_attributes(name)) for name, x in computed.items()}
    data = xr.Dataset(variables, {"time": clock["time"]})
    return record.assign({"computed": xr.DataTree(data.assign_attrs(clock.attrs))})

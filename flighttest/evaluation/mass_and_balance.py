"""Mass, c.g. and thrust of a record that lacks them: from the loading sheet, the fuel burnt, and points of the engine deck."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from flightmech.air import P_SEA, T_SEA, atmosphere
from flightmech.errors import IdentificationError, SchemaError, UnknownName
from flightmech.names import attrs

from .plan import Deck, Loading
from .test_point_sheets import Sheet

if TYPE_CHECKING:
    from flightmech import Aircraft

_RESIDUAL = 0.05  # of the largest thrust: a deck that corrected fuel flow and Mach do not reproduce better is another engine
_AIR = ("h_baro", "mach", "temperature")


def weigh(sheet: Loading, aircraft: Aircraft, burnt: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return mass and c.g. after some fuel has been burnt.

    Parameters
    ----------
    sheet : Loading
    aircraft : Aircraft
        For the place of the moment reference point on the mean chord.
    burnt : array
        Fuel used since the sheet was written. [kg]

    Returns
    -------
    mass, x_cg_b : array
        Mass [kg], c.g. forward of the moment reference point [m].

    Raises
    ------
    SchemaError
        No such fuel item, more fuel burnt than taken, or less left than the fuel table reaches.
    """
    items, table = Sheet(sheet.file), Sheet(sheet.fuel_table.file)
    names = [items.text(row, sheet.item) for row in range(len(items.rows))]
    if sheet.fuel not in names:
        raise SchemaError(f"sheet {sheet.file}", [f"no item {sheet.fuel}; there are: {', '.join(names)}"])
    dry = [row for row, name in enumerate(names) if name != sheet.fuel]
    masses = sheet.mass.of(items, "kg")
    items.rows = [items.rows[row] for row in dry]
    moment = float((masses[dry] * sheet.station.of(items, "m")).sum())
    left = masses[names.index(sheet.fuel)] - burnt
    fuel, fuel_moment = (np.append(0.0, x) for x in (sheet.fuel_table.mass.of(table, "kg"), sheet.fuel_table.moment.of(table, "kg m")))
    if left.min() < 0.0 or left.max() > fuel[-1]:
        text = f"fuel left is {left.min():.4g} ... {left.max():.4g} kg; the fuel table goes from 0 to {fuel[-1]:.4g} kg"
        raise SchemaError(f"sheet {sheet.file}", [f"{text}; check the unit of the fuel flow and the fuel taken"])
    mass = masses[dry].sum() + left
    station = (moment + np.interp(left, fuel, fuel_moment)) / mass
    return mass, sheet.leading_edge + aircraft.x_ref_mac * aircraft.cbar - station


def deck_thrust(deck: Deck, h: np.ndarray, mach: np.ndarray, temperature: np.ndarray, fuel_flow: np.ndarray) -> np.ndarray:
    """Return the net thrust of one engine [N] from points of its deck.

    Thrust over pressure ratio is a second-order polynomial of corrected fuel flow and Mach number, fitted to the points.

    Raises
    ------
    IdentificationError
        The points are too few, or such a polynomial does not reproduce them.
    """
    points = Sheet(deck.file)
    units = {"h": "m", "mach": "1", "delta_T": "K", "fuel_flow": "kg s-1", "thrust": "N"}
    deck_h, deck_mach, warmer, flow, thrust = (getattr(deck, name).of(points, unit) for name, unit in units.items())
    X, delta = _corrected(deck_h, deck_mach, np.asarray(atmosphere(deck_h).temperature) + warmer, flow)
    if len(X) <= X.shape[1]:
        raise IdentificationError(f"{deck.file}: {len(X)} points for {X.shape[1]} coefficients of the thrust; give more points")
    theta, _, rank, _ = np.linalg.lstsq(X, thrust / delta)
    rest = float(np.abs(delta * (X @ theta) - thrust).max())
    if rank < X.shape[1] or rest > _RESIDUAL * np.abs(thrust).max():
        text = f"{deck.file}: corrected fuel flow and Mach reproduce the points within {rest:.3g} N only"
        raise IdentificationError(f"{text}; check its units, or give thrust in the record")
    X, delta = _corrected(h, mach, temperature, fuel_flow)
    return np.maximum(delta * (X @ theta), 0.0)


def completed(record: xr.DataTree, aircraft: Aircraft, loading: Loading | None, deck: Deck | None) -> xr.DataTree:
    """Return the record with a leaf ``computed``: mass, c.g. and thrust over the clock of the fuel flow.

    Raises
    ------
    UnknownName
        A channel that is needed is not in the record.
    SchemaError, IdentificationError
        As `weigh` and `deck_thrust`.
    """
    if loading is None and deck is None:
        return record
    home = {str(name): leaf for leaf, node in record.children.items() for name in node.data_vars}
    flows = [f"engine{k + 1}.fuel_flow" for k in range(len(aircraft.engines))]
    for name in (*flows, *(_AIR if deck else ())):
        if name not in home:
            raise UnknownName(name, home, "channel", "mass and thrust are computed from it; map it, or leave out [loading] and [thrust]")
    clock = record[home[flows[0]]].to_dataset()
    time = clock["time"].values.astype(float)

    def channel(name: str) -> np.ndarray:
        leaf = record[home[name]].to_dataset()
        return np.interp(time, leaf["time"].values, leaf[name].values.astype(float))

    flow = np.array([channel(name) for name in flows])
    found: dict[str, np.ndarray] = {}
    if loading is not None:
        burnt = np.concatenate([[0.0], np.cumsum(flow.sum(axis=0)[:-1] * np.diff(time))])
        found["mass"], found["x_cg_b"] = weigh(loading, aircraft, burnt)
    if deck is not None:
        h, mach, temperature = (channel(name) for name in _AIR)
        found |= {f"engine{k + 1}.thrust": deck_thrust(deck, h, mach, temperature, row) for k, row in enumerate(flow)}
    data = xr.Dataset({name: ("time", x, attrs(name)) for name, x in found.items()}, {"time": clock["time"]})
    return record.assign({"computed": xr.DataTree(data.assign_attrs(clock.attrs))})


def _corrected(h, mach, temperature, fuel_flow) -> tuple[np.ndarray, np.ndarray]:
    """Return the regressors of corrected fuel flow and Mach (point, 6), and the pressure ratio."""
    delta = np.asarray(atmosphere(h).p_static) / P_SEA
    flow = fuel_flow / (delta * np.sqrt(temperature / T_SEA))
    return np.stack([np.ones_like(flow), flow, flow**2, mach, mach * flow, mach**2], axis=1), delta

"""Stationary points: means over their windows, and straight lines through them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import IdentificationError, OutOfRange, UnknownName
from flightmech.support.arrays import rms
from flightmech.units import G0

from ..sensors.air_data import pressure
from .plan import Line, Points
from .test_point_sheets import Sheet

if TYPE_CHECKING:
    from flightmech import Aircraft

LEAST = 4  # points of a line: two are drawn from any error, three give no information on their scatter
_MOVES = 1e-6  # relative spread of x below which the points do not determine a slope


@dataclass(frozen=True)
class Fitted:
    """A straight line y = offset + slope x through the means of stationary points.

    Attributes
    ----------
    line : Line
    x, y : array (point,)
        [SI]
    slope, offset, root : (float, float)
        Value and standard error; root is the x at which y is zero. [SI]
    rms : float
        Of the residuals. [SI]
    """

    line: Line
    x: np.ndarray
    y: np.ndarray
    slope: tuple[float, float]
    offset: tuple[float, float]
    root: tuple[float, float]
    rms: float


def times_of(points: Points) -> pd.DataFrame:
    """Return the noted times and series of a sheet of stationary points: ``time series``, sorted; one row per time and series."""
    sheet = Sheet(points.file)
    series = [sheet.text(row, points.series) for row in range(len(sheet.rows))] if points.series else [""] * len(sheet.rows)
    found = pd.DataFrame({"time": points.time.of(sheet, "s"), "series": series})
    return found.dropna().drop_duplicates().sort_values("time", ignore_index=True)


def windows_of(points: Points, series: Sequence[str] = ()) -> list[tuple[float, float]]:
    """Return the windows of some series, each time once.

    Raises
    ------
    UnknownName
        A series that no point has.
    """
    table = times_of(points)
    for name in series:
        if name not in set(table["series"]):
            raise UnknownName(name, set(table["series"]), "series", f"sheet {points.file}")
    kept = table[table["series"].isin(series)] if series else table
    return [(float(t) + points.window[0], float(t) + points.window[1]) for t in sorted(set(kept["time"]))]


def means(record: xr.DataTree, aircraft: Aircraft, windows: Sequence[tuple[float, float]], data: xr.Dataset | None = None) -> pd.DataFrame:
    """Return the means of all channels over windows.

    Parameters
    ----------
    record : DataTree
        Channels as recorded, with ``computed`` ones.
    aircraft : Aircraft
    windows : sequence of (start, stop)
        [s]
    data : Dataset (time,), optional
        Coefficients of reconstructed windows; their means take the place of recorded ones.

    Returns
    -------
    DataFrame
        One row per window, ``start stop`` and channels. [SI]  Computed: ``CL_weight``, weight over dynamic pressure and wing area, which is
        the lift of level flight without a part of thrust; ``attitude_less_climb``, pitch attitude less the angle of climb.

    Raises
    ------
    OutOfRange
        A window is not inside the record.
    """
    return pd.DataFrame([_row(record, aircraft, window, data) for window in windows])


def _row(record: xr.DataTree, aircraft: Aircraft, window: tuple[float, float], data: xr.Dataset | None) -> dict[str, float]:
    start, stop = window
    row = {"start": start, "stop": stop}
    climb = np.nan
    for node in record.children.values():
        leaf = node.to_dataset()
        time = leaf["time"].values
        inside = (time >= start) & (time <= stop)
        if inside.sum() < 2:
            raise OutOfRange(f"stationary point {start:g} ... {stop:g} s is not inside the record, {time[0]:g} ... {time[-1]:g} s")
        row |= {str(name): float(np.nanmean(x.values[inside])) for name, x in leaf.data_vars.items()}
        if "h_baro" in leaf:
            climb = float(np.polyfit(time[inside] - start, leaf["h_baro"].values[inside], 1)[0])
    if {"h_baro", "mach", "mass"} <= set(row):
        row["CL_weight"] = row["mass"] * G0 / (0.7 * float(pressure(np.array(row["h_baro"]))) * row["mach"] ** 2 * aircraft.S)
    if {"theta", "V", "h_baro"} <= set(row):
        row["attitude_less_climb"] = row["theta"] - float(np.arcsin(climb / row["V"]))
    if data is not None:
        part = data.sel(time=slice(start, stop))
        row |= {str(name): float(x.mean()) for name, x in part.data_vars.items() if x.dims == ("time",) and x.dtype.kind == "f"}
    return row


def line_through(line: Line, points: pd.DataFrame) -> Fitted:
    """Return a straight line through points by least squares; standard errors from the scatter of the points.

    Raises
    ------
    UnknownName
        A column that the points do not have.
    IdentificationError
        Fewer than four points, or points that stand at one x.
    """
    for name in (line.x, line.y):
        if name not in points:
            raise UnknownName(name, map(str, points.columns), "mean", f"line {line.name}")
    x, y = (points[name].to_numpy(float) for name in (line.x, line.y))
    if line.kind == "polar":
        x = x**2
    if len(x) < LEAST:
        raise IdentificationError(f"line {line.name}: {len(x)} points; {LEAST} or more are needed to see their scatter")
    if np.ptp(x) <= _MOVES * np.abs(x).max():
        raise IdentificationError(f"line {line.name}: no excitation, {line.x} is {x[0]:.4g} at all points; fly points at several of it")
    X = np.stack([np.ones_like(x), x], axis=1)
    (b, m), *_ = np.linalg.lstsq(X, y)
    rest = y - b - m * x
    C = np.linalg.inv(X.T @ X) * float(rest @ rest) / (len(x) - 2)
    slope_of_root = np.array([-1.0 / m, b / m**2])
    errors = np.sqrt([C[1, 1], C[0, 0], slope_of_root @ C @ slope_of_root])
    return Fitted(line, x, y, (m, errors[0]), (b, errors[1]), (-b / m, errors[2]), rms(rest))

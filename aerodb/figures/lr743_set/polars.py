"""Trimmed drag polars and flight points for the envelope figures of LR-743."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from aerodb.figures.curve_families import thin_breakpoints
from aerodb.figures.lr743_set.chart import FlightPoints, NotDrawn
from aerodb.figures.lr743_set.combinations import (
    combine_coefficients,
    points_of,
    remove_moving_devices,
)
from aerodb.figures.lr743_set.flown import FlightData
from aerodb.figures.symbols import to_printed_unit
from flightmech.air import atmosphere
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchError
from flightmech.flying_qualities.performance import polar
from flightmech.steady_flight.trim_point import Point, trimmed_at
from flightmech.units import G0

Aircrafts = Mapping[str, Aircraft]
# Lift coefficient of the first trimmed flight.
_FIRST_LIFT = 0.5
_MOST = 4  # Mach numbers of the polars
# Share of the largest lift slope. Below it drag over lift is steep, and the band ends.
_STEEP = 0.3
# Points over which slopes of the piecewise linear tables are averaged: 2.5 deg of angle of attack.
_SMOOTH = 13
POWER_OFF = {"mode.engine": 2.0}


class TrimmedPolar(NamedTuple):
    """A trimmed polar at one Mach number; the arrays are (point,).

    `stderr` is the standard error of drag at the lift of the point.
    """

    mach: float
    CL: np.ndarray
    CD: np.ndarray
    stderr: np.ndarray
    alpha: np.ndarray


def aircraft_of(aircraft: Aircrafts, name: str) -> Aircraft:
    """Return the aircraft of a database, or raise `NotDrawn`."""
    if name not in aircraft:
        raise NotDrawn(
            f"it needs the aircraft of {name}: give --aircraft, or the folder that "
            f"`aeromatch match` wrote"
        )
    return aircraft[name]


def trim_configuration(
    aircraft: Aircraft, db: xr.DataTree, condition: Mapping[str, float]
) -> Point:
    """Return a trimmed flight of a configuration, power off, as the start of polars. [SI]"""
    # The speed has no influence on the polars, which are trimmed at each of their points.
    density = float(atmosphere(0.0).rho)
    speed = float(np.sqrt(2.0 * aircraft.mass * G0 / (density * aircraft.S * _FIRST_LIFT)))
    inputs = {"V": speed, **(POWER_OFF if aircraft.engines else {}), **condition}
    try:
        return trimmed_at(aircraft, db, inputs)
    except AeromatchError as error:
        raise NotDrawn(f"no steady flight to begin with: {error}") from error


def trimmed_polars(point: Point, db: xr.DataTree, flap: float = 0.0) -> list[TrimmedPolar]:
    """Return trimmed polars at Mach numbers of the tables."""
    machs = points_of(db, "CL", "mach")
    selected = thin_breakpoints(machs[machs > 0.0], _MOST)
    # Flaps are used at low Mach numbers only.
    if flap:
        selected = selected[: (len(selected) + 1) // 2 + 1]
    return [_trimmed_polar(point, db, mach) for mach in selected]


def _trimmed_polar(point: Point, db: xr.DataTree, mach: float) -> TrimmedPolar:
    """Return the polar at a Mach number up to the largest lift, with the standard error of drag."""
    curve = polar(point, mach)
    last = int(np.argmax(curve["CL"].values)) + 1
    CL, CD, alpha, delta_e = (
        curve[name].values[:last] for name in ("CL", "CD", "alpha", "delta_e")
    )
    variables = point.variables | {"mach": mach, "qhat": 0.0, "dnz": 0.0}
    condition: dict[str, float | np.ndarray] = {}
    for name in {*remove_moving_devices(db, "CL"), *remove_moving_devices(db, "CD")}:
        if name in variables:
            condition[name] = variables[name]
    condition |= {"alpha": alpha, "delta_e": delta_e}
    lift_stderr = combine_coefficients(db, "CL", (1.0, condition))[1]
    drag_stderr = combine_coefficients(db, "CD", (1.0, condition))[1]
    # An error of lift shifts the point along the polar. Its share in drag is the slope
    # dCD/dCL = (dCD/dalpha) / (dCL/dalpha) times the error.
    lift_slope, drag_slope = _smooth_slope(CL, alpha), _smooth_slope(CD, alpha)
    is_flat = lift_slope > _STEEP * lift_slope.max()
    polar_slope = drag_slope / np.where(is_flat, lift_slope, np.nan)
    stderr = np.hypot(drag_stderr, polar_slope * lift_stderr)
    return TrimmedPolar(mach, CL, CD, stderr=stderr, alpha=alpha)


def _smooth_slope(values: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    return scipy.ndimage.uniform_filter1d(np.gradient(values, alpha), _SMOOTH, mode="nearest")


def sample_trace(samples: pd.DataFrame, x: str, y: str) -> FlightPoints:
    """Return the samples of a manoeuvre as a thin line."""
    return FlightPoints(
        "samples of flight",
        to_printed_unit(x, samples[x]),
        samples[y].to_numpy(float),
        stderr=np.zeros(len(samples)),
        kind="trace",
    )


def steady_points(label: str, rows: pd.DataFrame, x: str, y: str, member: int) -> FlightPoints:
    """Return the steady starts of manoeuvres as test points."""
    return FlightPoints(
        f"test point, {label}",
        rows[x].to_numpy(),
        rows[y].to_numpy(),
        stderr=np.zeros(len(rows)),
        kind="test point",
        member=member,
    )


def samples_by_manoeuvre(flown: FlightData, rows: pd.DataFrame) -> list[tuple[int, pd.DataFrame]]:
    """Return number and samples of each of the manoeuvres in `rows`."""
    samples = flown.samples[flown.samples["manoeuvre"].isin(rows.index)]
    groups = samples.groupby("manoeuvre", sort=True)
    return [(int(part["manoeuvre"].iloc[0]), part) for _, part in groups]

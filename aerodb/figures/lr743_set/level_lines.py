"""The 1 g lines of the flight envelope: angle of attack of level flight over Mach number at the masses, heights and settings flown."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import SimulationError
from flightmech.performance import one_g
from flightmech.steady_flight.trim_point import trimmed_at

from ..symbols import number
from .flown import configuration, height_text, heights

if TYPE_CHECKING:
    from flightmech import Aircraft

_SETTINGS = {"delta_f": np.radians(1.0), "gear": 1.0, "speedbrake": 1.0}
"""What a line has in common, to the nearest step. [SI]"""
_POINTS = 60
_BEYOND = (0.8, 1.15)  # of the Mach numbers flown: how far a line reaches
_LEAST_MACH = 0.02


def one_g_lines(db: xr.DataTree, aircraft: Aircraft, points: pd.DataFrame) -> tuple[dict[str, xr.Dataset], list[str]]:
    """Return the 1 g lines of test points ([LR743] Fig. 9): one for each height and configuration that was flown, at the mean mass there.

    Parameters
    ----------
    db : DataTree
    aircraft : Aircraft
    points : DataFrame
        A row per test point: ``h mach mass delta_f gear speedbrake``; a mass of NaN counts as that of the aircraft, another setting of NaN
        as zero. [SI]

    Returns
    -------
    dict of str to Dataset (mach,)
        `flightmech.performance.one_g` by height, mass and configuration in words; attributes ``h`` [m], ``mass`` [kg], ``configuration``.
    list of str
        For each line that cannot be made, why.
    """
    points = points[np.isfinite(points["mach"]) & np.isfinite(points["h"])]
    points = points.fillna({name: 0.0 for name in _SETTINGS} | {"mass": aircraft.mass})
    if not len(points):
        return {}, []
    machs = np.linspace(max(_BEYOND[0] * points["mach"].min(), _LEAST_MACH), _BEYOND[1] * points["mach"].max(), _POINTS)
    found, remarks = dict[str, xr.Dataset](), []
    for _, alike in points.groupby([(points[name] / step).round() for name, step in _SETTINGS.items()]):
        at = heights(alike)
        for h in map(float, np.unique(at)):
            part = alike[at == h]
            means = part.mean(numeric_only=True)
            label = f"{height_text(h)}, {number(float(np.round(means['mass'], -1)))} kg, {configuration(means)}"
            flight = {name: float(means[name]) for name in ("mass", *_SETTINGS)} | {"h": h, "mach": float(part["mach"].max())}
            try:
                line = one_g(trimmed_at(aircraft, db, flight | ({"mode.engine": 2.0} if aircraft.engines else {})), machs)
            except SimulationError:
                remarks.append(f"{label}: no steady flight up to Mach {flight['mach']:.2g}")
                continue
            found[label] = line.assign_attrs(h=h, mass=float(means["mass"]), configuration=configuration(means))
    return found, remarks

"""Landing gear: constants by wheel, the load of every wheel over its compression, what the records do not determine."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flighttest.landing_gear import IdentifiedGear

from ..presentation.quantities import number
from .section import EQUATION_ERROR, OUTPUT_ERROR, Curve, Grid, PanelOf, Picture, Section, estimate, picture

SAMPLES = 600  # drawn of one wheel


def landing_gear(name: str, found: IdentifiedGear) -> Section:
    """Return the section of an identified landing gear."""
    techniques = [("wheel loads, tyres, brakes", EQUATION_ERROR, f"rms {_scatter(found.loads.fit.noise)} [N, N m]")]
    if found.flown is not None:
        techniques.append(("tyres and steering", OUTPUT_ERROR, f"rms {_scatter(found.flown.noise)} [SI]"))
    rows = tuple((key, *estimate(one.value, one.stderr), one.source) for key, one in found.constants.items())
    grid = Grid("Constants, SI; mirror images share theirs", ("constant", "estimate", "standard error", "source"), rows)
    remarks = tuple(f"{key} not determined: {why}" for key, why in found.undetermined.items())
    return Section(name, tuple(techniques), (grid,), _loads(name, found), remarks)


def _scatter(noise: xr.Dataset) -> str:
    """Return the rms over all records, by output."""
    rms = np.sqrt(np.mean(noise["stderr"].values ** 2, axis=0))
    return ", ".join(f"{output} {number(float(v), 3)}" for output, v in zip(noise["output"].values, rms, strict=True))


def _loads(name: str, found: IdentifiedGear) -> tuple[Picture, ...]:
    """Return the reconstructed load of every wheel over its compression."""
    panels = []
    for wheel in (wheel for group in found.groups for wheel in group.names):
        s = np.concatenate([one["compression"].sel(wheel=wheel).values for one in found.loads.loads])
        load = np.concatenate([one["force"].sel(output=f"load.{wheel}").values for one in found.loads.loads])
        good = np.flatnonzero(np.isfinite(s) & np.isfinite(load))
        some = good[:: max(1, len(good) // SAMPLES)]
        panels.append(PanelOf(f"{wheel}, load in kN", "compression, cm", (Curve(100.0 * s[some], load[some] / 1e3, "run-3", marks=True),)))
    words = f"Reconstructed load over compression of {', '.join(panel.title.partition(',')[0] for panel in panels)}"
    return (picture(name.replace(" ", "-"), panels, (), words),) if panels else ()

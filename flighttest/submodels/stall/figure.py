"""Figure of an identified stall: hysteresis loops of the lift, and the separation over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from flightmech.support.figures import demand_drawable, new_figure, write_figure
from flighttest.submodels.stall.flow import SIDES
from flighttest.submodels.stall.result import StallIdentification


def draw_stall(
    found: StallIdentification, records: Sequence[xr.Dataset], target: str | Path
) -> None:
    """Draw CL over alpha with the fit, and X of both wing halves over time, one row per record.

    Parameters
    ----------
    found : StallIdentification
    records : sequence of Dataset (time,)
        Records of the identification, with their coefficients. With a database the lift is that on
        top of the database.
    target : path
        Figure to write: png, svg or pdf.
    """
    demand_drawable(target)
    figure = new_figure(11.0, 3.2 * len(records))
    axes = figure.subplots(len(records), 2, squeeze=False, width_ratios=(2, 3))
    for number, ((loop, states), record) in enumerate(zip(axes, records, strict=True), 1):
        fitted = found.predict(record)
        loop.set_title(str(record.attrs.get("record") or f"stall {number}"), loc="left")
        alpha = np.rad2deg(record["alpha"].values)
        loop.plot(alpha, record["CL"], ".", markersize=2, label="flight")
        loop.plot(alpha, fitted["CL"], linewidth=1.2, label="model")
        loop.set_xlabel("alpha [deg]")
        loop.set_ylabel("CL on top of the database" if found.with_database else "CL")
        time = record["time"].values
        for side in SIDES:
            states.plot(time, fitted[f"X_{side}"], linewidth=1.2, label=f"{side} wing half")
        states.set_ylim(-0.05, 1.05)
        states.set_xlabel("time [s]")
        states.set_ylabel("separation point X [chord]")
        for axis in (loop, states):
            axis.legend(loc="best")
            axis.grid(alpha=0.3)
    write_figure(figure, target, dpi=120)

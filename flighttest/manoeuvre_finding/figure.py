"""A figure of the manoeuvres of a record, to be confirmed by eye."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.support.display import demand_drawable, new_figure, save_figure

from ..records.record import locate

_CONTROLS = {"elevator": ("delta_e",), "aileron": ("delta_a",), "rudder": ("delta_r",), "throttle": ("engine1.throttle", "engine1.n1")}
_MOTION = ("V", "V_cas", "phi", "beta_vane", "az_imu")
_COLOURS = ("#2a6f97", "#bc6c25")


def draw_manoeuvres(record: xr.DataTree, table: pd.DataFrame, target: str | Path) -> None:
    """Draw controls and motion over time with the manoeuvres shaded and numbered as the rows of the table.

    Parameters
    ----------
    record : DataTree
        Flight record.
    table : DataFrame
        With the columns of `flighttest.manoeuvres`.
    target : path
        File to write, atomically; its ending names the format (png, svg, pdf).

    Raises
    ------
    SchemaError
        A format that is not drawn; a record without any control or channel of motion.
    AeromatchError
        matplotlib is not installed.
    """
    demand_drawable(target)
    shown = [(label, found) for label, names in _CONTROLS.items() if (found := _first(record, names))]
    shown += [("", name) for name in _MOTION if locate(record, name) and not (name == "V_cas" and locate(record, "V"))]
    if not shown:
        raise SchemaError("figure", ["the record has no control and no channel of motion; extend the name map"])
    figure = new_figure(16.0, 1.5 * len(shown) + 1.2)
    axes = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    for ax, (label, name) in zip(axes, shown, strict=True):
        _draw(ax, record, name)
        for number, row in enumerate(table.itertuples(), start=1):
            if not label or label in str(row.control).split() or not row.control:
                ax.axvspan(row.start, row.end, color=_COLOURS[number % 2], alpha=0.3 if label else 0.1, linewidth=0)
            if label and label in str(row.control).split():
                place = (row.start, 0.98 if number % 2 else 0.5)  # in turn, since rows may share their start
                ax.annotate(f"{number} {row.manoeuvre}", place, xycoords=("data", "axes fraction"), va="top", fontsize=6)
    axes[-1].set_xlabel("time [s]")
    figure.suptitle(str(record.attrs.get("title", "")), fontsize="medium")
    save_figure(figure, target, dpi=120)


def _first(record: xr.DataTree, names: tuple[str, ...]) -> str | None:
    return next((name for name in names if locate(record, name)), None)


def _draw(ax, record: xr.DataTree, name: str) -> None:
    signal = record[str(locate(record, name))].to_dataset()[name]
    units = signal.attrs.get("units", "")
    shown, factor = ("deg", np.degrees(1.0)) if units == "rad" else (units, 1.0)
    ax.plot(signal["time"].values, factor * signal.values, color="black", linewidth=0.6)
    ax.set_ylabel(f"{name}\n[{shown}]", fontsize="small")
    ax.grid(linewidth=0.3)
    ax.margins(x=0.01)

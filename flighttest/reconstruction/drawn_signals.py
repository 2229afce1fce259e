"""Figure of the data compatibility: raw, corrected and reconstructed signal of each channel.

References
----------
.. [Gresham] Gresham, Simmons, Hopwood, Woolsey, figure 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from flightmech.errors import UnknownName
from flightmech.support.display import new_figure

from ..records.time_histories import broken

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STYLE = {"raw": ("0.6", 0.8), "corrected": ("tab:blue", 0.8), "reconstructed": ("tab:red", 1.1)}


def compatibility_figure(compatibility: xr.Dataset, title: str, channels: Sequence[str] | None = None) -> Figure:
    """Return raw, corrected and reconstructed signal of each channel over time as a figure ([Gresham] figure 5).

    Parameters
    ----------
    compatibility : Dataset (time, version)
        Of a path.
    title : str
        Name of the record.
    channels : sequence of str, optional
        All measured channels without it.

    Raises
    ------
    UnknownName
        A channel that was not measured.
    AeromatchError
        matplotlib is not installed.
    """
    known = list(map(str, compatibility.data_vars))
    chosen = list(channels) if channels is not None else known
    for name in chosen:
        if name not in known:
            raise UnknownName(name, known, "measured channel")
    rows = -(-len(chosen) // 2)
    figure = new_figure(11.0, 1.9 * rows + 0.8)
    axes = figure.subplots(rows, min(2, len(chosen)), sharex=True, squeeze=False)
    for ax, name in zip(axes.flat, chosen, strict=False):
        _draw_channel(ax, compatibility[name])
    for ax in axes.flat[len(chosen) :]:
        ax.set_visible(False)
    for ax in axes[-1]:
        ax.set_xlabel("time [s]")
    axes.flat[0].legend(loc="best", fontsize="small", frameon=False)
    figure.suptitle(f"Data compatibility: {title}", fontsize="medium")
    return figure


def _draw_channel(ax, signals: xr.DataArray) -> None:
    shown, factor = ("deg", np.degrees(1.0)) if signals.attrs.get("units") == "rad" else (signals.attrs.get("units", ""), 1.0)
    time = signals["time"].values
    for version, (colour, width) in _STYLE.items():
        values = signals.sel(version=version).values * factor
        ax.plot(*broken(time, values), color=colour, linewidth=width, label=version)
    before, after = (factor * signals.attrs[key] for key in ("rms_raw", "rms_corrected"))
    ax.set_title(f"{signals.name}: rms {before:.3g} before, {after:.3g} after", fontsize="small")
    ax.set_ylabel(f"[{shown}]")
    ax.grid(linewidth=0.3)

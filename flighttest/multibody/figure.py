"""Figure of wing models: coefficients of a record against the fitted model, in time and as spectra, as [Grauer2010] Fig. 7.

References
----------
.. [Grauer2010] Grauer, Ulrich, Hubbard, Pines, Humbert, System identification of an ornithopter aerodynamics model, AIAA 2010-7632.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from flightmech.support.display import demand_drawable, new_figure, save_figure

from ..equation_error.fit import Fit
from ..signals.fourier import detrended, finite_fourier

_DATA, _MODEL, _REST = "black", "#bc6c25", "#2a6f97"


def draw_wing_models(fits: Sequence[Fit], data: xr.Dataset, target: str | Path) -> None:
    """Draw data, model and residual of each fit over a record: over time on the left, their spectra up to the cut-off on the right.

    Parameters
    ----------
    fits : sequence of Fit
        Of CL or CD.
    data : Dataset (time,)
        As from `air_loads`; its standard error is drawn as a band about the data.
    target : path
        As for `draw_actuator`, with its errors.
    """
    demand_drawable(target)
    figure = new_figure(14.0, 3.5 * len(fits))
    axes = figure.subplots(len(fits), 2, squeeze=False, width_ratios=(2, 1))
    time = data["time"].values
    step = float(np.diff(time).mean())
    f = np.arange(1, int(data.attrs["cutoff"] * step * len(time)) + 1) / (step * len(time))
    for fit, (over_time, spectrum) in zip(fits, axes):
        name = fit.model.coefficient
        z, s = data[name].values, data[f"{name}_stderr"].values
        values = fit.estimates["estimate"].sel(term=list(fit.model.terms)).values
        y = fit.model.design(data) @ values
        over_time.fill_between(time, z - 2.0 * s, z + 2.0 * s, color="#d9d9d9", linewidth=0.0, label="2 standard errors")
        over_time.plot(time, z, color=_DATA, linewidth=0.8, label="from the motion")
        over_time.plot(time, y, color=_MODEL, linewidth=1.0, linestyle="--", label="model")
        over_time.plot(time, z - y, color=_REST, linewidth=0.6, label="residual")
        over_time.set_ylabel(name)
        over_time.set_title(f"{data.attrs.get('record', '')}: {fit.model}", fontsize="small", loc="left")
        for values, colour, style in ((z, _DATA, "-"), (y, _MODEL, "--"), (z - y, _REST, "-")):
            spectrum.plot(f, np.abs(finite_fourier(detrended(values), step, f)), color=colour, linewidth=0.8, linestyle=style)
        spectrum.set_ylabel(f"|transform of {name}| [s]")
        for axis in (over_time, spectrum):
            axis.grid(linewidth=0.3)
            axis.margins(x=0.01)
    axes[0][0].legend(fontsize="small", ncols=4)
    axes[-1][0].set_xlabel("time [s]")
    axes[-1][1].set_xlabel("frequency [Hz]")
    save_figure(figure, target, dpi=120)

"""Figure of an identified actuator: the recorded motion against the simulated response, in time and as spectra."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flightmech.support.display import demand_drawable, new_figure, save_figure

from ..signals.fourier import detrended, finite_fourier
from .frequency_domain import excited_band
from .response import simulate_actuator
from .result import IdentifiedActuator

_RECORDED, _MODEL, _REST = "black", "#bc6c25", "#2a6f97"
_BEYOND = 1.5  # times the upper edge of the excited band


def draw_actuator(found: IdentifiedActuator, target: str | Path) -> None:
    """Draw each log: motion, simulated response and residual in time on the left, their spectra on the right.

    Parameters
    ----------
    found : IdentifiedActuator
    target : path
        File to write, atomically; its ending names the format (png, svg, pdf).

    Raises
    ------
    SchemaError
        A format that is not drawn.
    AeromatchError
        matplotlib is not installed.
    """
    demand_drawable(target)
    servo = found.structure.stiffness
    name, unit, factor = ("position", "deg", np.degrees(1.0)) if servo else ("rate", "rad/s", 1.0)
    figure = new_figure(14.0, 3.5 * len(found.logs))
    axes = figure.subplots(len(found.logs), 2, squeeze=False, width_ratios=(2, 1))
    for k, (log, (over_time, spectrum)) in enumerate(zip(found.logs, axes), 1):
        time, z = log["time"].values, factor * log[name].values
        y = factor * simulate_actuator(log, found.structure, found.response.of_manoeuvre(k))[name].values
        over_time.plot(time, z, color=_RECORDED, linewidth=0.8, label="recorded")
        over_time.plot(time, y, color=_MODEL, linewidth=1.0, linestyle="--", label="simulated")
        over_time.plot(time, z - y, color=_REST, linewidth=0.6, label="residual")
        over_time.set_ylabel(f"{name} [{unit}]")
        over_time.set_title(str(log.attrs.get("record", "")), fontsize="small", loc="left")
        good = np.isfinite(z)
        filled, step = np.interp(time, time[good], z[good]), float(np.diff(time).mean())
        f = np.arange(1, len(time) // 2) / (step * (len(time) - 1))
        f = f[f <= _BEYOND * excited_band(log.assign({name: ("time", filled)}))[1]]
        for values, colour, style in ((filled, _RECORDED, "-"), (y, _MODEL, "--"), (filled - y, _REST, "-")):
            spectrum.semilogy(f, np.abs(finite_fourier(detrended(values), step, f)), color=colour, linewidth=0.8, linestyle=style)
        spectrum.set_ylabel(f"|transform| [{unit} s]")
        for axis in (over_time, spectrum):
            axis.grid(linewidth=0.3)
            axis.margins(x=0.01)
    axes[0][0].legend(fontsize="small", ncols=3)
    axes[-1][0].set_xlabel("time [s]")
    axes[-1][1].set_xlabel("frequency [Hz]")
    save_figure(figure, target, dpi=120)

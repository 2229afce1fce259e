"""Figure of an identified actuator."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flightmech.support.figures import demand_drawable, new_figure, write_figure
from flighttest.records.signals.fourier import finite_fourier, remove_straight_line
from flighttest.submodels.actuators.estimation import excited_band
from flighttest.submodels.actuators.response import simulate_actuator
from flighttest.submodels.actuators.result import IdentifiedActuator

_RECORDED, _MODEL, _RESIDUAL = "black", "#bc6c25", "#2a6f97"
# The spectra end at this multiple of the upper edge of the excited band.
_BEYOND = 1.5


def draw_actuator(actuator: IdentifiedActuator, target: str | Path) -> None:
    """Draw motion, simulated response and residual of each log, in time and as spectra.

    Parameters
    ----------
    actuator : IdentifiedActuator
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
    servo = actuator.structure.stiffness
    name, unit, factor = ("position", "deg", np.degrees(1.0)) if servo else ("rate", "rad/s", 1.0)
    figure = new_figure(14.0, 3.5 * len(actuator.logs))
    axes = figure.subplots(len(actuator.logs), 2, squeeze=False, width_ratios=(2, 1))
    for k, (log, (over_time, spectrum)) in enumerate(zip(actuator.logs, axes), 1):
        time, z = log["time"].values, factor * log[name].values
        values = actuator.response.of_manoeuvre(k)
        y = factor * simulate_actuator(log, actuator.structure, values)[name].values
        over_time.plot(time, z, color=_RECORDED, linewidth=0.8, label="recorded")
        over_time.plot(time, y, color=_MODEL, linewidth=1.0, linestyle="--", label="simulated")
        over_time.plot(time, z - y, color=_RESIDUAL, linewidth=0.6, label="residual")
        over_time.set_ylabel(f"{name} [{unit}]")
        over_time.set_title(str(log.attrs.get("record", "")), fontsize="small", loc="left")
        # Spectra need a motion without gaps.
        good = np.isfinite(z)
        filled, step = np.interp(time, time[good], z[good]), float(np.diff(time).mean())
        f = np.arange(1, len(time) // 2) / (step * (len(time) - 1))
        f = f[f <= _BEYOND * excited_band(log.assign({name: ("time", filled)}))[1]]
        curves = ((filled, _RECORDED, "-"), (y, _MODEL, "--"), (filled - y, _RESIDUAL, "-"))
        for curve, colour, style in curves:
            amplitude = np.abs(finite_fourier(remove_straight_line(curve), step, f))
            spectrum.semilogy(f, amplitude, color=colour, linewidth=0.8, linestyle=style)
        spectrum.set_ylabel(f"|transform| [{unit} s]")
        for axis in (over_time, spectrum):
            axis.grid(linewidth=0.3)
            axis.margins(x=0.01)
    axes[0][0].legend(fontsize="small", ncols=3)
    axes[-1][0].set_xlabel("time [s]")
    axes[-1][1].set_xlabel("frequency [Hz]")
    write_figure(figure, target, dpi=120)

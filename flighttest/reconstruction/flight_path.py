"""The result of a reconstruction, with its report, figure and remarks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.quantities import time_text
from flightmech.short_text import ShortText
from flightmech.support.figures import html_table
from flighttest.reconstruction.channel_signals import compatibility_figure
from flighttest.reconstruction.problem.problem import identifiability_remarks
from flighttest.reconstruction.turbulence import CALM, GUSTY
from flighttest.records.sensors.position_corrections import force_at_cg
from flighttest.remarks import Remark, remark_lines, remarks_to_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ACCEPT = 1.5  # residual rms over the noise of a sensor up to which it is used
_MOVED = 0.02  # of the c.g. along a record, from which on it is remarked [m]
_CONSTANT_KEYS = ("estimate", "stderr", "prior", "prior_stderr", "unit")


@dataclass(frozen=True)
class FlightPath(ShortText):
    """A reconstructed flight path.

    Attributes
    ----------
    states : Dataset (time,)
        Air-relative and ground velocity, attitude, rates and their derivatives, specific force,
        wind, air data and reduced rates at the c.g., without instrument errors. Controls, engine
        channels and mass are as recorded. [SI]
    biases : Dataset (parameter,)
        ``estimate stderr prior prior_stderr unit``, ``correlation prior_correlation (parameter,
        parameter_)``.
    residuals : Dataset (time,)
        Reading minus model per channel, NaN where the channel has no reading.
    fit : DataFrame
        Per channel: readings, noise, residual rms, ratio, autocorrelation at the first lag,
        verdict.
    compatibility : Dataset (time, version)
        Per channel ``raw``, ``corrected`` and ``reconstructed`` signal, see
        `flighttest.reconstruction.compatibility_table`.
    errors : Dataset (error, time)
        Change of the states for one standard error of each independent error of the constants, see
        `flighttest.reconstruction.state_errors`; None for a path without them.
    """

    states: xr.Dataset
    biases: xr.Dataset
    residuals: xr.Dataset
    fit: Any
    compatibility: xr.Dataset
    errors: xr.Dataset | None = None

    def report(self) -> str:
        """Return the data-compatibility report as text."""
        lines = [
            *_head_lines(self.states),
            "",
            *_constant_lines(self.biases),
            "",
            *_channel_lines(self.fit),
        ]
        if self.remarks:
            lines += ["", *remark_lines(self.remarks)]
        lines += ["", "Identifiability:"]
        for remark in identifiability_remarks(self.biases) or ["every constant is identifiable"]:
            lines.append(f"  - {remark}")
        return "\n".join(lines)

    def to_dataframe(self) -> pd.DataFrame:
        """Return the states as a table over time, in the units of `states`.

        The constants are a table too: ``path.biases``, or `flighttest.remarks.table_of_estimates`.
        """
        names = [name for name, item in self.states.data_vars.items() if item.dims == ("time",)]
        return self.states[names].to_dataframe()

    def plot(self, channels: Sequence[str] | None = None) -> Figure:
        """Return a figure of raw, corrected and reconstructed signals.

        See `flighttest.reconstruction.compatibility_figure`.
        """
        return compatibility_figure(self.compatibility, str(self.states.attrs["record"]), channels)

    def _repr_html_(self) -> str:
        """Return the constants as a table for a notebook."""
        names = self.biases["parameter"].values
        rows = []
        for name in names:
            values = [self.biases[key].sel(parameter=name).item() for key in _CONSTANT_KEYS]
            rows.append((str(name), *values))
        time = self.states["time"].values
        caption = (
            f"Flight path of {self.states.attrs.get('record', '')}, {time_text(time[0])} ... "
            f"{time_text(time[-1])} s, {len(time)} samples"
        )
        remarks = [remark.text for remark in self.remarks]
        return html_table(caption, ("constant", *_CONSTANT_KEYS), rows, remarks)

    @property
    def remarks(self) -> list[Remark]:
        """Remarks on turbulence, noise that is not as specified, and a moving c.g."""
        moving = moving_cg_remarks(self.states)
        return [*_turbulence_remarks(self), *_noise_remarks(self), *moving]

    def summary(self) -> dict[str, Any]:
        """Return constants, sensors and remarks as plain numbers and text."""
        constants = {}
        for name in self.biases["parameter"].values:
            estimates = self.biases.sel(parameter=name)
            constants[str(name)] = {key: estimates[key].item() for key in _CONSTANT_KEYS}
        # The list of manoeuvres belongs to the record.
        attributes = {}
        for key, item in self.states.attrs.items():
            if key != "manoeuvres":
                attributes[key] = item
        return {
            **attributes,
            "samples": self.states.sizes["time"],
            "constants": constants,
            "sensors": self.fit,
            "identifiability": identifiability_remarks(self.biases),
            "remarks": remarks_to_json(self.remarks),
        }


def fit_row(name: str, residuals: np.ndarray, sigma: float) -> dict[str, Any]:
    """Return the row of one channel in `FlightPath.fit`, sigma its specified noise."""
    rms = float(np.sqrt(np.mean(residuals**2)))
    deviations = residuals - residuals.mean()
    power = float(deviations @ deviations)
    # at the first lag; zero for residuals without any change
    autocorrelation = 0.0
    if power > 0.0:
        autocorrelation = float(deviations[1:] @ deviations[:-1] / power)
    verdict = "suspect: residual exceeds the noise"
    if rms < ACCEPT * sigma:
        verdict = "use"
    return {
        "channel": name,
        "readings": len(residuals),
        "noise": sigma,
        "rms": rms,
        "ratio": rms / sigma,
        "autocorrelation": autocorrelation,
        "verdict": verdict,
    }


def _turbulence_remarks(path: FlightPath) -> list[Remark]:
    gusts = str(path.states.attrs.get("gusts", "none"))
    if gusts == "none":
        return []
    # The constants that gusts hide stayed at their prior.
    is_held = path.biases["held"].values.astype(bool)
    names = [str(name) for name in path.biases["parameter"].values[is_held]]
    text = (
        f"turbulence (gusts {gusts} m/s, one sigma): {', '.join(names) or 'no constant'} "
        f"is indistinguishable from gusts and rests on "
        "its prior; give the vane calibration of a flight in calm air (--biases)"
    )
    return [Remark("turbulence", text, " ".join(names))]


def _noise_remarks(path: FlightPath) -> list[Remark]:
    remarks = []
    for name, row in path.fit.iterrows():
        # The excess over the specified noise is white if less than half of it is correlated.
        excess = 1.0 - 1.0 / row.ratio**2
        if row.ratio > CALM and row.autocorrelation < GUSTY * excess:
            text = (
                f"noise of {name} is {row.ratio:.2f} times that specified ({row.rms:.3g} for "
                f"{row.noise:.3g}), and white; correct it in the aircraft file"
            )
            remarks.append(Remark("noise", text, str(name), float(row.ratio), CALM))
    return remarks


def moving_cg_remarks(states: xr.Dataset) -> list[Remark]:
    """Return what a c.g. that moves along the path leaves in the specific force.

    Moments follow the c.g. The positions of the sensors are those from its mean, so that the force
    at the c.g. is wrong by the acceleration between the two.

    Parameters
    ----------
    states : Dataset (time,)
        ``x_cg_b y_cg_b z_cg_b`` [m], ``p q r`` and their rates. [SI]
    """
    needed = ("x_cg_b", "y_cg_b", "z_cg_b", "p", "q", "r", "p_dot", "q_dot", "r_dot")
    if any(name not in states for name in needed):
        return []
    columns = np.stack([states[name].values for name in needed], axis=1)
    place, omega, omega_dot = columns[:, :3], columns[:, 3:6], columns[:, 6:]
    moved = np.ptp(place, axis=0)
    axis = int(np.argmax(moved))
    # NaN of a broken channel is remarked elsewhere
    if not moved[axis] > _MOVED:
        return []
    # the specific force at a point off the c.g., with none at the c.g. itself
    off = -force_at_cg(np.zeros_like(place), omega, omega_dot, place - place.mean(axis=0))
    largest = float(np.linalg.norm(off, axis=1).max())
    name = needed[axis]
    text = (
        f"{name} moves by {moved[axis]:.3g} m along the record: the moments follow it, and the "
        f"positions of the sensors hold from its mean, which changes the specific force by at most "
        f"{largest:.2g} m/s2; reconstruct shorter windows if that counts"
    )
    return [Remark("centre of gravity", text, name, float(moved[axis]), _MOVED, severity="note")]


def _head_lines(states: xr.Dataset) -> list[str]:
    """Return the first lines of a report: record, samples, unused channels, spikes."""
    time = states["time"].values
    lines = [
        f"State reconstruction: {states.attrs['record']}, {time_text(time[0])} ... "
        f"{time_text(time[-1])} s",
        f"{len(time)} samples at {states.attrs['rate']:g} Hz, {states.attrs['iterations']} "
        f"iterations",
        f"channels not used: {states.attrs['unused'] or 'none'}; gusts [m/s]: "
        f"{states.attrs['gusts']}",
    ]
    if states.attrs.get("spikes"):
        lines.append("spikes: " + states.attrs["spikes"])
    return lines


def _constant_lines(biases: xr.Dataset) -> list[str]:
    """Return the table of the constants of a report."""
    titles = ("estimate", "std. error", "prior", "prior s.e.")
    keys = ("estimate", "stderr", "prior", "prior_stderr")
    lines = [f"{'constant':22s}" + "".join(f"{title:>13s}" for title in titles) + "  unit"]
    for i, name in enumerate(biases["parameter"].values):
        row = biases.isel(parameter=i, parameter_=i)
        numbers = "".join(f"{float(row[key]):13.5g}" for key in keys)
        lines.append(f"{name:22s}{numbers}  {row['unit'].item()}")
    return lines


def _channel_lines(fit: Any) -> list[str]:
    """Return the table of the channels of a report."""
    lines = [
        f"{'channel':14s}{'readings':>9s}{'noise':>11s}{'rms':>11s}{'ratio':>7s}{'lag-1 ac':>9s} "
        f" verdict"
    ]
    for name, row in fit.iterrows():
        lines.append(
            f"{name:14s}{row.readings:9d}{row.noise:11.4g}{row.rms:11.4g}{row.ratio:7.2f}"
            f"{row.autocorrelation:9.2f}  {row.verdict}"
        )
    return lines

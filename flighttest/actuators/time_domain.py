"""Output error in time for an actuator: the simulated response with dead time and limits against the recorded motion."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from ..maximum_likelihood.likelihood_search import Found, Likelihood, inverse, search
from ..maximum_likelihood.parameters import Unknown, lay_out
from ..maximum_likelihood.residual_covariance import coloured_covariance
from ..maximum_likelihood.result import OutputError, noise_of, tabulated
from .response import Structure, inputs, responses

ITERATIONS = 60
_LOWEST = {"Ma": 1e-12, "Ka": 0.0, "Ka/Ma": 0.0, "delay": 0.0, "rate_limit": 1e-9}


def output_error(logs: Sequence[xr.Dataset], structure: Structure, start: Mapping[str, float]) -> OutputError:
    """Return the parameters of an actuator by maximum likelihood from its whole response.

    Parameters
    ----------
    logs : sequence of Dataset (time,)
        As from `read_bench_log`; NaN in position or rate is no reading.
    structure : Structure
    start : mapping of str to float
        First values of all parameters of the structure.

    Returns
    -------
    OutputError
        Initial position and rate are unknowns of each log.
    """
    runs, likelihood = _likelihood(logs, structure, start)
    layout = likelihood.layout
    found = search(likelihood, ITERATIONS)
    covariance, colours = coloured_covariance(found, layout.columns, [run.step for run in runs])
    covariance = covariance + _by_torque(runs, logs, structure, found, layout.columns)
    estimates = tabulated(found, layout, covariance, {"method": "output error in time, actuator"})
    scatter = noise_of(found, list(runs[0].outputs), colours, [run.measured for run in runs])
    return OutputError(estimates, tuple(run.residual(v) for run, v in zip(runs, found.residuals)), scatter)


def _by_torque(
    runs: Sequence[_Run], logs: Sequence[xr.Dataset], structure: Structure, found: Found, columns: Sequence[np.ndarray]
) -> np.ndarray:
    """Return the covariance (unknown, unknown) that the noise of the torque cell adds.

    The torque is an input: its noise moves the response, and all coefficients with it by nearly the same share, of which the residuals
    show little.  One reading moves the estimates by D S' R^-1 h, with the response h to an impulse of the torque; smoothing leaves the
    noise below its cut-off, where the estimates are formed.
    """
    D = inverse(found.information, ~found.active)
    total = np.zeros_like(found.information)
    for run, log, S, noise, place in zip(runs, logs, found.slopes, found.noise, columns):
        deviation = float(log["torque"].attrs.get("noise", 0.0)) if structure.absolute else 0.0
        if not deviation:
            continue
        h = run.to_torque(structure.gear, found.theta[place])
        size = 1 << int(2 * len(h) - 1).bit_length()
        H, F = np.fft.rfft(h, size, axis=0), np.fft.rfft(S / noise[None, :, None], size, axis=0)
        moved = np.fft.irfft(np.einsum("fa,fap->fp", H.conj(), F), size, axis=0)[: len(h)]
        total[np.ix_(place, place)] += deviation**2 * moved.T @ moved
    return D @ total @ D


def _likelihood(logs: Sequence[xr.Dataset], structure: Structure, start: Mapping[str, float]) -> tuple[list[_Run], Likelihood]:
    unknowns = {name: Unknown(float(start[name]), low=_LOWEST.get(name, -math.inf)) for name in structure.parameters}
    runs = [_Run(log, structure) for log in logs]
    # wide priors: against a stop no response shows where a log begins
    if structure.stiffness:
        unknowns["init.position"] = Unknown(None, max(run.reach for run in runs), own=True)
    unknowns["init.rate"] = Unknown(None, max(run.speed for run in runs), own=True)
    layout = lay_out(unknowns, [run.first for run in runs])
    for run, names in zip(runs, layout.bases):
        run.names = names
    return runs, Likelihood(runs, layout, np.zeros(len(runs), int))


class _Run:
    """One log and its response."""

    names: tuple[str, ...]

    def __init__(self, log: xr.Dataset, structure: Structure):
        self.structure, self.time = structure, log["time"].values.astype(float)
        self.step, self.command, self.torque = inputs(log, structure)
        self.outputs = tuple(name for name in ("position", "rate") if name in log and (structure.stiffness or name == "rate"))
        self.measured = np.column_stack([log[name].values.astype(float) for name in self.outputs])
        seen = {name: column[np.isfinite(column)] for name, column in zip(self.outputs, self.measured.T)}
        self.first = {f"init.{name}": float(values[0]) for name, values in seen.items()}
        self.first.setdefault("init.rate", 0.0)
        self.reach = float(np.nanmax(self.measured[:, 0]) - np.nanmin(self.measured[:, 0]))
        self.speed = self.reach if self.outputs[0] == "rate" else self.reach / self.step

    def _flown(self, rows: np.ndarray) -> np.ndarray:
        """Outputs (run, time, output)."""
        values = dict(zip(self.names, rows.T))
        with np.errstate(over="ignore", invalid="ignore"):
            moved = dict(zip(("position", "rate"), responses(self.structure, values, self.step, self.command, self.torque)))
        return np.stack([moved[name] for name in self.outputs], axis=2)

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return the outputs (time, output)."""
        return self._flown(values[None])[0]

    def to_torque(self, gear: float, values: np.ndarray) -> np.ndarray:
        """Return the outputs (time, output) that a torque of one at the first sample makes of an actuator at rest, without limits."""
        names = dict(zip(self.names, values[:, None]))
        still = {**names, "init.position": np.zeros(1), "init.rate": np.zeros(1)}
        impulse = np.zeros(len(self.command))
        impulse[1] = gear
        free = replace(self.structure, rate_limit=False, stop_low=False, stop_high=False)
        rest = np.full(len(self.command), values[self.names.index("neutral")])
        moved = dict(zip(("position", "rate"), responses(free, still, self.step, rest, impulse)))
        return np.stack([np.append(moved[name][0, 1:], 0.0) for name in self.outputs], axis=1)

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return their slopes (time, output, unknown) by central differences."""
        moves = np.diag(steps)
        y = self._flown(np.concatenate([values + moves, values - moves]))
        return np.moveaxis((y[: len(values)] - y[len(values) :]) / (2.0 * steps[:, None, None]), 0, 2)

    def residual(self, v: np.ndarray) -> xr.Dataset:
        """Return residuals over time."""
        v = np.where(np.isfinite(self.measured), v, np.nan)
        return xr.Dataset({name: ("time", v[:, k]) for k, name in enumerate(self.outputs)}, {"time": self.time})

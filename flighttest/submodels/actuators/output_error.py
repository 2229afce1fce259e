"""Output error in the time domain for an actuator."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from flighttest.maximum_likelihood.likelihood import Likelihood, LikelihoodMaximum
from flighttest.maximum_likelihood.residual_covariance import coloured_likelihood_covariance
from flighttest.maximum_likelihood.result import OutputError, estimates_dataset, noise_dataset
from flighttest.maximum_likelihood.search import invert_information, maximise_likelihood
from flighttest.maximum_likelihood.unknowns import Unknown, lay_out
from flighttest.submodels.actuators.response import (
    Structure,
    actuator_inputs,
    actuator_responses,
)

# Largest number of iterations of the search.
ITERATIONS = 60
# Lower bounds of the parameters in the search.
_LOWEST = {"Ma": 1e-12, "Ka": 0.0, "Ka/Ma": 0.0, "delay": 0.0, "rate_limit": 1e-9}
# Outputs of a simulated actuator, in the order of `actuator_responses`.
_MOTION = ("position", "rate")


def fit_actuator_response(
    logs: Sequence[xr.Dataset], structure: Structure, start: Mapping[str, float]
) -> OutputError:
    """Return the parameters of an actuator by maximum likelihood from its whole response.

    Parameters
    ----------
    logs : sequence of Dataset (time,)
        As from `read_bench_log`; NaN in position or rate is a missing reading.
    structure : Structure
        Coefficients, dead time and limits of the model.
    start : mapping of str to float
        First values of all parameters of the structure.

    Returns
    -------
    OutputError
        Initial position and rate are unknowns of each log.
    """
    runs, likelihood = _likelihood(logs, structure, start)
    layout = likelihood.layout
    maximum = maximise_likelihood(likelihood, ITERATIONS)
    covariance, colours = coloured_likelihood_covariance(
        maximum, layout.columns, [run.step for run in runs]
    )
    covariance = covariance + _torque_noise_covariance(
        runs, logs, structure=structure, maximum=maximum, columns=layout.columns
    )
    estimates = estimates_dataset(
        maximum, layout, covariance, {"method": "output error in time, actuator"}
    )
    scatter = noise_dataset(maximum, list(runs[0].outputs), colours, [run.measured for run in runs])
    residuals = [run.residual(v) for run, v in zip(runs, maximum.residuals)]
    return OutputError(estimates, tuple(residuals), scatter)


def _torque_noise_covariance(
    runs: Sequence[_SimulatedLog],
    logs: Sequence[xr.Dataset],
    structure: Structure,
    maximum: LikelihoodMaximum,
    columns: Sequence[np.ndarray],
) -> np.ndarray:
    """Return the covariance (unknown, unknown) that the noise of the torque cell adds.

    The torque is an input.  Its noise moves the response and, by nearly the same fraction, all
    coefficients, of which the residuals show little.  One reading moves the estimates by
    D S' R^-1 h, with the response h to an impulse of the torque.  Smoothing leaves the noise below
    its cut-off frequency, where the estimates are formed.
    """
    D = invert_information(maximum.information, ~maximum.active)
    total = np.zeros_like(maximum.information)
    # Without a torque cell all coefficients are ratios, and nothing is added.
    if not structure.absolute:
        return total
    for run, log, S, noise, column in zip(runs, logs, maximum.slopes, maximum.noise, columns):
        deviation = float(log["torque"].attrs.get("noise", 0.0))
        if not deviation:
            continue
        # Correlate h with the weighted slopes by FFT; padding avoids circular overlap.
        h = run.impulse_response(structure.gear, maximum.theta[column])
        size = 1 << int(2 * len(h) - 1).bit_length()
        H, F = np.fft.rfft(h, size, axis=0), np.fft.rfft(S / noise[None, :, None], size, axis=0)
        shifts = np.fft.irfft(np.einsum("fa,fap->fp", H.conj(), F), size, axis=0)[: len(h)]
        total[np.ix_(column, column)] += deviation**2 * shifts.T @ shifts
    return D @ total @ D


def _likelihood(
    logs: Sequence[xr.Dataset], structure: Structure, start: Mapping[str, float]
) -> tuple[list[_SimulatedLog], Likelihood]:
    """Return the logs as simulated runs, and their likelihood."""
    unknowns = {
        name: Unknown(float(start[name]), low=_LOWEST.get(name, -math.inf))
        for name in structure.parameters
    }
    runs = [_SimulatedLog(log, structure) for log in logs]
    # Wide priors of the initial state: at a stop no response depends on where a log begins.
    if structure.stiffness:
        unknowns["init.position"] = Unknown(None, max(run.reach for run in runs), own=True)
    unknowns["init.rate"] = Unknown(None, max(run.speed for run in runs), own=True)
    layout = lay_out(unknowns, [run.first for run in runs])
    for run, names in zip(runs, layout.bases):
        run.names = names
    return runs, Likelihood(runs, layout, np.zeros(len(runs), int))


class _SimulatedLog:
    """One log and its simulated response.

    Attributes
    ----------
    names : tuple of str
        Parameters of the log in the order of the unknowns; `_likelihood` sets them.
    outputs : tuple of str
        ``position`` and ``rate`` that are recorded and that the structure determines.
    measured : array (time, output)
        NaN is a missing reading.
    first : dict of str to float
        First values of ``init.position`` and ``init.rate``.
    reach, speed : float
        Range of the first output, and the largest rate that it allows.
    """

    names: tuple[str, ...]

    def __init__(self, log: xr.Dataset, structure: Structure):
        self.structure, self.time = structure, log["time"].values.astype(float)
        self.step, self.command, self.torque = actuator_inputs(log, structure)
        # The position of a motor has no restoring stiffness and is not an output.
        used = _MOTION if structure.stiffness else ("rate",)
        self.outputs = tuple(name for name in used if name in log)
        self.measured = np.column_stack([log[name].values.astype(float) for name in self.outputs])
        self.first = {}
        for name, column in zip(self.outputs, self.measured.T):
            self.first[f"init.{name}"] = float(column[np.isfinite(column)][0])
        self.first.setdefault("init.rate", 0.0)
        self.reach = float(np.nanmax(self.measured[:, 0]) - np.nanmin(self.measured[:, 0]))
        self.speed = self.reach if self.outputs[0] == "rate" else self.reach / self.step

    def _simulate(self, rows: np.ndarray) -> np.ndarray:
        """Return the outputs (run, time, output) of rows of parameters."""
        values = dict(zip(self.names, rows.T))
        with np.errstate(over="ignore", invalid="ignore"):
            responses = actuator_responses(
                self.structure,
                values,
                step=self.step,
                command=self.command,
                torque=self.torque,
            )
        motion = dict(zip(_MOTION, responses))
        return np.stack([motion[name] for name in self.outputs], axis=2)

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return the outputs (time, output)."""
        return self._simulate(values[None])[0]

    def impulse_response(self, gear: float, values: np.ndarray) -> np.ndarray:
        """Return the outputs (time, output) of a unit torque at the first sample.

        The actuator is at rest before it and has no limits.
        """
        names = dict(zip(self.names, values[:, None]))
        at_rest = {**names, "init.position": np.zeros(1), "init.rate": np.zeros(1)}
        # Sample 1 carries the impulse, because torque is linear between samples.
        impulse = np.zeros(len(self.command))
        impulse[1] = gear
        free = replace(self.structure, rate_limit=False, stop_low=False, stop_high=False)
        neutral = np.full(len(self.command), values[self.names.index("neutral")])
        responses = actuator_responses(
            free, at_rest, step=self.step, command=neutral, torque=impulse
        )
        motion = dict(zip(_MOTION, responses))
        return np.stack([np.append(motion[name][0, 1:], 0.0) for name in self.outputs], axis=1)

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return the slopes of the outputs (time, output, unknown) by central differences."""
        moves = np.diag(steps)
        y = self._simulate(np.concatenate([values + moves, values - moves]))
        return np.moveaxis(
            (y[: len(values)] - y[len(values) :]) / (2.0 * steps[:, None, None]), 0, 2
        )

    def residual(self, v: np.ndarray) -> xr.Dataset:
        """Return residuals over time."""
        v = np.where(np.isfinite(self.measured), v, np.nan)
        return xr.Dataset(
            {name: ("time", v[:, k]) for k, name in enumerate(self.outputs)}, {"time": self.time}
        )

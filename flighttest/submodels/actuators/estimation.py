"""Equation error in frequency for an actuator: the spectra of the motion against those of command
and torque.

At the multiples of one over the duration T of a record, exp(-j omega T) is one, and the transforms
of the derivatives are exactly

    v~ = j omega p~ + [p(T) - p(0)],    v'~ = j omega v~ + [v(T) - v(0)]

so that what a record does not begin or end at rest with is one real constant and one real multiple
of j omega in every equation.  These two are estimated with each record: no derivative is taken in
time, no record must be periodic, and a constant drops out.

Noise of the motion is noise of regressors and would bias least squares.  The motion that the
estimates themselves simulate is free of it: it serves as instruments [Young1980], until the
estimates stay.

References
----------
.. [Grauer2010] Grauer, Ulrich, Hubbard, Pines, Humbert, System identification of an ornithopter aerodynamics model, AIAA 2010-7632.
.. [Klein2006] Klein, Morelli, Aircraft System Identification, AIAA 2006, chapter 7.
.. [Young1980] Young, Jakeman, Refined instrumental variable methods of recursive time-series analysis, Int. J. Control 31, 1980.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from scipy.optimize import minimize_scalar

from flightmech.errors import AeromatchWarning, IdentificationError
from flighttest.maximum_likelihood.residual_covariance import coloured_likelihood_covariance
from flighttest.maximum_likelihood.result import OutputError, estimates_dataset, noise_dataset
from flighttest.maximum_likelihood.search import (
    Likelihood,
    LikelihoodMaximum,
    invert_information,
    maximise_likelihood,
)
from flighttest.maximum_likelihood.unknowns import Unknown, lay_out
from flighttest.records.signals.fourier import finite_fourier, harmonics
from flighttest.regression.equation_error.spectral_weights import (
    residual_power,
    spectral_freedom,
    student_factor,
)
from flighttest.regression.equation_error.transformed_stretches import (
    TransformedStretch,
    stack_complex,
)
from flighttest.regression.uncertainty.collinearity import demand_rank
from flighttest.submodels.actuators.response import (
    Structure,
    actuator_inputs,
    actuator_responses,
    simulate_actuator,
)

_LONGEST_DELAY, _DELAYS = 0.5, 51  # [s], first look
_FLOOR = 30.0  # of the noise of the motion's spectrum, above which there is content
_SMOOTH = 5  # lines
_ROUNDS, _SETTLED = 20, 0.02  # of the instruments; change in standard errors
_WILD = (
    10.0  # times the recorded range of the rate, beyond which a simulated motion is no instrument
)


@dataclass(frozen=True)
class Estimates:
    """Estimates of one method.

    Attributes
    ----------
    values : dict of str to float
        By the names of `Structure.parameters`; ``neutral`` without an error of its own.
    stderr : dict of str to float
    R2 : float
        Of the equation, or of the response.
    """

    values: dict[str, float]
    stderr: dict[str, float]
    R2: float


def excited_band(log: xr.Dataset) -> tuple[float, float]:
    """Return the band in which the motion of a log stands above its noise. [Hz]

    Raises
    ------
    IdentificationError
        No frequency does.
    """
    x, step = _motion(log), _step(log)
    f = np.arange(1, len(x) // 2) / ((len(x) - 1) * step)
    power = np.convolve(
        np.abs(finite_fourier(x - x.mean(), step, f)) ** 2, np.ones(_SMOOTH) / _SMOOTH, "same"
    )
    above = power > _FLOOR * np.median(power[2 * len(power) // 3 :])
    if not above[0]:
        raise IdentificationError(
            f"{log.attrs.get('record', 'log')}: the motion does not stand above its noise; "
            f"excite the actuator more"
        )
    last = len(above) if above.all() else int(np.argmin(above))
    return float(f[0]), float(f[max(last, min(8, len(f))) - 1])


def equation_error(
    logs: Sequence[xr.Dataset], structure: Structure, band: tuple[float, float] | None = None
) -> Estimates:
    """Return coefficients and dead time by equation error in frequency; limits are not seen.

    Parameters
    ----------
    logs : sequence of Dataset (time,)
        As from `read_bench_log`, each without gaps in the motion.
    structure : Structure
    band : (low, high), optional
        Default: where the motion of each log stands above its noise. [Hz]

    Raises
    ------
    IdentificationError
        Fewer equations than unknowns, or coefficients that the logs cannot distinguish.
    """
    rows = _Rows(logs, structure, band)
    if not structure.delay:
        return rows.refined(rows.solved(0.0))
    grid = np.linspace(0.0, rows.longest, _DELAYS)
    cost = [rows.cost(delay) for delay in grid]
    best = int(np.argmin(cost))

    around = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, _DELAYS - 1)])
    delay = float(
        minimize_scalar(rows.cost, bounds=around, method="bounded", options={"xatol": 1e-6}).x
    )
    delay = delay if rows.cost(delay) <= cost[best] else float(grid[best])
    if best == _DELAYS - 1:
        text = (
            f"dead time of at least {rows.longest:.3g} s, the end of the search: check the "
            f"clocks of command and motion"
        )
        warnings.warn(text, AeromatchWarning, stacklevel=3)
    return rows.refined(rows.solved(delay))


class _Rows:
    """Spectral equations of all records."""

    def __init__(
        self,
        logs: Sequence[xr.Dataset],
        structure: Structure,
        band: tuple[float, float] | None,
        parts: Sequence[TransformedStretch] | None = None,
    ):
        self.structure, self.logs, self.parts = structure, logs, list(parts or ())
        self.motion: list[dict[str, np.ndarray]] = []
        if parts:
            self.motion = [
                self._spectra(log, part.step, part.frequencies, actuator_inputs(log, structure)[2])
                for log, part in zip(logs, parts)
            ]
            return
        start = 0
        for log in logs:
            step, _, torque = actuator_inputs(log, structure)
            duration = step * (log.sizes["time"] - 1)
            f = harmonics(duration, *(band or excited_band(log)))
            self.parts.append(
                TransformedStretch(
                    slice(0, log.sizes["time"]), step, f, slice(start, start + len(f))
                )
            )
            start += len(f)
            self.motion.append(self._spectra(log, step, f, torque))
        self.longest = min([_LONGEST_DELAY, *(0.2 * part.duration for part in self.parts)])
        if start < 2 * (len(structure.coefficients) + len(logs)):
            raise IdentificationError(
                f"{start} frequencies are too few for the coefficients of an actuator; widen "
                f"the band or lengthen the log"
            )

    def _spectra(
        self, log: xr.Dataset, step: float, f: np.ndarray, torque: np.ndarray
    ) -> dict[str, np.ndarray]:
        turn, found = 2j * np.pi * f, {}
        names = [name for name in ("position", "rate") if name in log]
        spectra = {name: finite_fourier(log[name].values.astype(float), step, f) for name in names}
        found["v"] = spectra["rate"] if "rate" in spectra else turn * spectra["position"]
        found["v'"] = turn * found["v"]
        if self.structure.stiffness:
            found["p"] = spectra["position"]
        if self.structure.absolute:
            found["torque"] = finite_fourier(torque, step, f)
        return found

    def _command(self, delay: float) -> list[np.ndarray]:
        """Spectra of the delayed command."""
        out = []
        for log, part in zip(self.logs, self.parts):
            time, u, f = log["time"].values, log["command"].values.astype(float), part.frequencies
            if not self.structure.held:
                out.append(finite_fourier(np.interp(time - delay, time, u), part.step, f))
                continue
            # steps of a held command: j omega u~ is the sum of its jumps, less what its ends differ
            # by
            when, jumps = time[1:] - time[0] + delay, np.diff(u)
            inside = (jumps != 0.0) & (when < part.duration - part.step)
            turned = np.exp(-2j * np.pi * np.outer(f, when[inside])) @ jumps[inside]
            out.append((turned - jumps[inside].sum()) / (2j * np.pi * f))
        return out

    def _system(self, delay: float) -> tuple[np.ndarray, np.ndarray, list[str]]:
        """Complex regressors and response; the first columns are the coefficients."""
        absolute = self.structure.absolute
        names = list(self.structure.coefficients)
        blocks, response = [], []
        for k, (motion, u, part) in enumerate(zip(self.motion, self._command(delay), self.parts)):
            own = {"Ma": -motion["v'"], "Ca": -motion["v"], "B": u}
            if self.structure.stiffness:
                own["Ka"] = -motion["p"]
            columns = [own[name.removesuffix("/Ma")] for name in names]
            ends = np.zeros((len(part.frequencies), 2 * len(self.parts)), complex)
            ends[:, 2 * k], ends[:, 2 * k + 1] = 1.0, 2j * np.pi * part.frequencies
            scale = 1.0 / np.sqrt(part.duration)
            blocks.append(scale * np.column_stack([*columns, ends]))
            response.append(scale * (motion["torque"] if absolute else motion["v'"]))
        return np.concatenate(blocks), np.concatenate(response), names

    def cost(self, delay: float) -> float:
        """Return the sum of squares of the equations for a dead time."""
        X, z, _ = self._system(delay)
        X2, z2 = stack_complex(X), stack_complex(z)
        v = z2 - X2 @ np.linalg.lstsq(X2, z2, rcond=None)[0]
        return float(v @ v)

    def refined(self, first: Estimates) -> Estimates:
        """Return the estimates with simulated motion as instruments, the first ones where that does
        not settle.
        """
        found = first
        for _ in range(_ROUNDS):
            before = found
            simulated = [self._simulated(log, found.values) for log in self.logs]
            if not all(
                np.isfinite(one["rate"].values).all()
                and np.ptp(one["rate"].values) < _WILD * np.ptp(_rate(log))
                for one, log in zip(simulated, self.logs)
            ):
                return first
            found = self.solved(
                found.values.get("delay", 0.0), _Rows(simulated, self.structure, None, self.parts)
            )
            found.values["delay"] = float(
                np.clip(found.values.get("delay", 0.0), 0.0, self.longest)
            )
            if all(
                abs(found.values[name] - before.values[name]) <= _SETTLED * s
                for name, s in found.stderr.items()
            ):
                return found
        return first

    def _simulated(self, log: xr.Dataset, values: dict[str, float]) -> xr.Dataset:
        p, v = (log["position"].values[0] if "position" in log else 0.0), _rate(log)
        moved = simulate_actuator(
            log, self.structure, {"delay": 0.0, **values, "init.position": p, "init.rate": v[0]}
        )
        return log.assign(
            {name: moved[name] for name in ("position", "rate") if name in log}
        ).assign(rate=moved["rate"])

    def solved(self, delay: float, instruments: _Rows | None = None) -> Estimates:
        """Return estimates and standard errors about a dead time: least squares, or with the motion
        of `instruments`.
        """
        X, z, names = self._system(delay)
        Z = instruments._system(delay)[0] if instruments else X
        size = np.sqrt((np.abs(X) ** 2).sum(axis=0))
        demand_rank(stack_complex(X[:, : len(names)]), names)
        if self.structure.delay:
            b = names.index(next(name for name in names if name.split("/")[0] == "B"))
            step = min(part.step for part in self.parts)
            slope = (self._system(delay + step)[0][:, b] - self._system(delay - step)[0][:, b]) / (
                2.0 * step
            )
            X, Z = np.column_stack([X, slope]), np.column_stack([Z, slope])
            size = np.append(size, np.sqrt((np.abs(slope) ** 2).sum()))
        E, F, z2 = stack_complex(X / size), stack_complex(Z / size), stack_complex(z)
        D = np.linalg.solve(F.T @ E, F.T) if instruments else np.linalg.pinv(E)
        theta = D @ z2
        v = z2 - E @ theta
        rows = len(z)
        C = (
            (D * residual_power(v[:rows] + 1j * v[rows:], F, self.parts))
            @ D.T
            * student_factor(spectral_freedom(rows, len(theta))) ** 2
        )
        values = {name: float(theta[k] / size[k]) for k, name in enumerate(names)}
        stderr = {name: float(np.sqrt(C[k, k]) / size[k]) for k, name in enumerate(names)}
        if self.structure.delay:
            values["delay"] = delay + float(theta[-1] / size[-1]) / values[names[b]]
            stderr["delay"] = float(np.sqrt(C[-1, -1]) / size[-1]) / abs(values[names[b]])
        return Estimates(
            values | self._neutral(values),
            stderr,
            1.0 - float(v @ v) / float((np.abs(z - z.mean()) ** 2).sum()),
        )

    def _neutral(self, values: dict[str, float]) -> dict[str, float]:
        """The neutral command, from the means in time."""
        found = []
        value = {name.removesuffix("/Ma"): x for name, x in values.items()}
        for log in self.logs:
            time, (_, u, torque) = log["time"].values, actuator_inputs(log, self.structure)
            p = log["position"].values if "position" in log else np.zeros(1)
            v = _rate(log)
            load = (
                value.get("Ka", 0.0) * p.mean()
                + value["Ca"] * v.mean()
                + value.get("Ma", 1.0) * (v[-1] - v[0]) / (time[-1] - time[0])
            )
            found.append(
                np.interp(time - values.get("delay", 0.0), time, u).mean()
                - (load + torque.mean()) / value["B"]
            )
        return {"neutral": float(np.mean(found))}


def _motion(log: xr.Dataset) -> np.ndarray:
    return log["position" if "position" in log else "rate"].values.astype(float)


def _rate(log: xr.Dataset) -> np.ndarray:
    return log["rate"].values if "rate" in log else np.gradient(log["position"].values, _step(log))


def _step(log: xr.Dataset) -> float:
    time = log["time"].values
    return float((time[-1] - time[0]) / (len(time) - 1))


ITERATIONS = 60
_LOWEST = {"Ma": 1e-12, "Ka": 0.0, "Ka/Ma": 0.0, "delay": 0.0, "rate_limit": 1e-9}


def fit_actuator_response(
    logs: Sequence[xr.Dataset], structure: Structure, start: Mapping[str, float]
) -> OutputError:
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
    found = maximise_likelihood(likelihood, ITERATIONS)
    covariance, colours = coloured_likelihood_covariance(
        found, layout.columns, [run.step for run in runs]
    )
    covariance = covariance + _by_torque(runs, logs, structure, found, layout.columns)
    estimates = estimates_dataset(
        found, layout, covariance, {"method": "output error in time, actuator"}
    )
    scatter = noise_dataset(found, list(runs[0].outputs), colours, [run.measured for run in runs])
    return OutputError(
        estimates, tuple(run.residual(v) for run, v in zip(runs, found.residuals)), scatter
    )


def _by_torque(
    runs: Sequence[_SimulatedLog],
    logs: Sequence[xr.Dataset],
    structure: Structure,
    found: LikelihoodMaximum,
    columns: Sequence[np.ndarray],
) -> np.ndarray:
    """Return the covariance (unknown, unknown) that the noise of the torque cell adds.

    The torque is an input: its noise moves the response, and all coefficients with it by nearly the
    same share, of which the residuals show little.  One reading moves the estimates by D S' R^-1 h,
    with the response h to an impulse of the torque; smoothing leaves the noise below its cut-off,
    where the estimates are formed.
    """
    D = invert_information(found.information, ~found.active)
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


def _likelihood(
    logs: Sequence[xr.Dataset], structure: Structure, start: Mapping[str, float]
) -> tuple[list[_SimulatedLog], Likelihood]:
    unknowns = {
        name: Unknown(float(start[name]), low=_LOWEST.get(name, -math.inf))
        for name in structure.parameters
    }
    runs = [_SimulatedLog(log, structure) for log in logs]
    # wide priors: against a stop no response shows where a log begins
    if structure.stiffness:
        unknowns["init.position"] = Unknown(None, max(run.reach for run in runs), own=True)
    unknowns["init.rate"] = Unknown(None, max(run.speed for run in runs), own=True)
    layout = lay_out(unknowns, [run.first for run in runs])
    for run, names in zip(runs, layout.bases):
        run.names = names
    return runs, Likelihood(runs, layout, np.zeros(len(runs), int))


class _SimulatedLog:
    """One log and its response."""

    names: tuple[str, ...]

    def __init__(self, log: xr.Dataset, structure: Structure):
        self.structure, self.time = structure, log["time"].values.astype(float)
        self.step, self.command, self.torque = actuator_inputs(log, structure)
        self.outputs = tuple(
            name
            for name in ("position", "rate")
            if name in log and (structure.stiffness or name == "rate")
        )
        self.measured = np.column_stack([log[name].values.astype(float) for name in self.outputs])
        seen = {
            name: column[np.isfinite(column)] for name, column in zip(self.outputs, self.measured.T)
        }
        self.first = {f"init.{name}": float(values[0]) for name, values in seen.items()}
        self.first.setdefault("init.rate", 0.0)
        self.reach = float(np.nanmax(self.measured[:, 0]) - np.nanmin(self.measured[:, 0]))
        self.speed = self.reach if self.outputs[0] == "rate" else self.reach / self.step

    def _flown(self, rows: np.ndarray) -> np.ndarray:
        """Outputs (run, time, output)."""
        values = dict(zip(self.names, rows.T))
        with np.errstate(over="ignore", invalid="ignore"):
            moved = dict(
                zip(
                    ("position", "rate"),
                    actuator_responses(
                        self.structure, values, self.step, self.command, self.torque
                    ),
                )
            )
        return np.stack([moved[name] for name in self.outputs], axis=2)

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return the outputs (time, output)."""
        return self._flown(values[None])[0]

    def to_torque(self, gear: float, values: np.ndarray) -> np.ndarray:
        """Return the outputs (time, output) that a torque of one at the first sample makes of an
        actuator at rest, without limits.
        """
        names = dict(zip(self.names, values[:, None]))
        still = {**names, "init.position": np.zeros(1), "init.rate": np.zeros(1)}
        impulse = np.zeros(len(self.command))
        impulse[1] = gear
        free = replace(self.structure, rate_limit=False, stop_low=False, stop_high=False)
        rest = np.full(len(self.command), values[self.names.index("neutral")])
        moved = dict(
            zip(("position", "rate"), actuator_responses(free, still, self.step, rest, impulse))
        )
        return np.stack([np.append(moved[name][0, 1:], 0.0) for name in self.outputs], axis=1)

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return their slopes (time, output, unknown) by central differences."""
        moves = np.diag(steps)
        y = self._flown(np.concatenate([values + moves, values - moves]))
        return np.moveaxis(
            (y[: len(values)] - y[len(values) :]) / (2.0 * steps[:, None, None]), 0, 2
        )

    def residual(self, v: np.ndarray) -> xr.Dataset:
        """Return residuals over time."""
        v = np.where(np.isfinite(self.measured), v, np.nan)
        return xr.Dataset(
            {name: ("time", v[:, k]) for k, name in enumerate(self.outputs)}, {"time": self.time}
        )

"""Equation error in the frequency domain for an actuator.

The spectra of the motion are regressed on the spectra of command and torque.  At the multiples of
one over the duration T of a record, exp(-j omega T) is one.  The transforms of the derivatives are
then exactly

    v~ = j omega p~ + [p(T) - p(0)],    v'~ = j omega v~ + [v(T) - v(0)]

The difference between the ends of a record is therefore one real constant and one real multiple of
j omega in every equation.  Both are estimated with each record.  No derivative is computed in time,
no record has to be periodic, and a constant drops out.

Noise of the motion is noise of the regressors and would bias least squares.  The motion simulated
with the estimates has no such noise.  It serves as instruments [Young1980].  The iteration ends
when the estimates no longer change.

References
----------
.. [Grauer2010] Grauer, Ulrich, Hubbard, Pines, Humbert, System identification of an ornithopter
   aerodynamics model, AIAA 2010-7632.
.. [Klein2006] Klein, Morelli, Aircraft System Identification, AIAA 2006, chapter 7.
.. [Young1980] Young, Jakeman, Refined instrumental variable methods of recursive time-series
   analysis, Int. J. Control 31, 1980.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from scipy.optimize import minimize_scalar

from flightmech.errors import AeromatchWarning, IdentificationError
from flighttest.records.signals.fourier import finite_fourier, harmonics
from flighttest.regression.equation_error.frequency.spectral_weights import (
    residual_power,
    spectral_freedom,
    student_factor,
)
from flighttest.regression.equation_error.frequency.transformed_stretches import (
    TransformedStretch,
    stack_complex,
)
from flighttest.regression.uncertainty.collinearity import demand_rank
from flighttest.remarks import Convergence, Remark
from flighttest.submodels.actuators.response import (
    Structure,
    actuator_inputs,
    simulate_actuator,
)

# Search of the dead time: longest value [s] and number of grid points.
_LONGEST_DELAY, _DELAYS = 0.5, 51
# Largest number of evaluations of the search of the dead time between two points of the grid.
_EVALUATIONS = 500
# The motion has content where its power exceeds the noise floor by this factor.
_FLOOR = 30.0
# Width of the moving average over the spectrum. [lines]
_SMOOTH = 5
# Rounds of the instruments, and largest change of an estimate in standard errors at the end.
_ROUNDS, _SETTLED = 20, 0.02
# Smallest tolerance of an estimate, over its value.
_RELATIVE = 1e-9
# A simulated rate beyond this multiple of the recorded range is not used as an instrument.
_WILD = 10.0


@dataclass(frozen=True)
class Estimates:
    """Estimates of one method.

    Attributes
    ----------
    values : dict of str to float
        By the names of `Structure.parameters`. ``neutral`` has no standard error.
    stderr : dict of str to float
        Standard errors by the same names.
    R2 : float
        Coefficient of determination of the equation or of the response. [1]
    convergence : Convergence or None
        End of the iteration over the instruments. If it did not converge, the estimates are those
        of least squares. None for estimates without instruments.
    """

    values: dict[str, float]
    stderr: dict[str, float]
    R2: float
    convergence: Convergence | None = None

    @property
    def remarks(self) -> list[Remark]:
        """A warning if the instruments did not converge."""
        if self.convergence is None:
            return []
        advice = (
            "the equation error is that of least squares, which noise of the motion biases; use "
            "the output error, or widen the band or lengthen the log"
        )
        return self.convergence.remarks(
            "instruments of the equation error", advice, severity="warning"
        )


def excited_band(log: xr.Dataset) -> tuple[float, float]:
    """Return the band in which the motion of a log exceeds its noise. [Hz]

    Raises
    ------
    IdentificationError
        The motion does not exceed its noise at the lowest frequency.
    """
    x, step = _motion(log), _step(log)
    f = np.arange(1, len(x) // 2) / ((len(x) - 1) * step)
    power = np.convolve(
        np.abs(finite_fourier(x - x.mean(), step, f)) ** 2, np.ones(_SMOOTH) / _SMOOTH, "same"
    )
    # Noise floor: the median of the upper third of the spectrum.
    above = power > _FLOOR * np.median(power[2 * len(power) // 3 :])
    if not above[0]:
        raise IdentificationError(
            f"{log.attrs.get('record', 'log')}: the motion does not stand above its noise; "
            f"excite the actuator more"
        )
    # The band ends where the power first falls below the limit, after eight lines at least.
    last = len(above) if above.all() else int(np.argmin(above))
    return float(f[0]), float(f[max(last, min(8, len(f))) - 1])


def equation_error(
    logs: Sequence[xr.Dataset], structure: Structure, band: tuple[float, float] | None = None
) -> Estimates:
    """Return coefficients and dead time by equation error in frequency, without limits.

    Parameters
    ----------
    logs : sequence of Dataset (time,)
        As from `read_bench_log`, each without gaps in the motion.
    structure : Structure
        Coefficients and dead time of the model.
    band : (low, high), optional
        Default: the band in which the motion of each log exceeds its noise. [Hz]

    Raises
    ------
    IdentificationError
        Fewer equations than unknowns, or coefficients that the logs cannot distinguish.

    Warns
    -----
    AeromatchWarning
        The search of the dead time ends at its upper bound, or does not converge.
    """
    rows = _SpectralEquations(logs, structure, band)
    if not structure.delay:
        return rows.iterate_instruments(rows.solve(0.0))
    # The cost may have several minima over the dead time. A grid selects one of them.
    grid = np.linspace(0.0, rows.longest, _DELAYS)
    cost = [rows.cost(delay) for delay in grid]
    best = int(np.argmin(cost))
    neighbours = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, _DELAYS - 1)])
    search = minimize_scalar(
        rows.cost,
        bounds=neighbours,
        method="bounded",
        options={"xatol": 1e-6, "maxiter": _EVALUATIONS},
    )
    if not search.success:
        text = (
            f"dead time of the equation error: not converged after {search.nfev} evaluations "
            f"between {neighbours[0]:.3g} and {neighbours[1]:.3g} s; the output error starts there"
        )
        warnings.warn(text, AeromatchWarning, stacklevel=3)
    delay = float(search.x)
    if not rows.cost(delay) <= cost[best]:
        delay = float(grid[best])
    if best == _DELAYS - 1:
        text = (
            f"dead time of at least {rows.longest:.3g} s, the end of the search: check the "
            f"clocks of command and motion"
        )
        warnings.warn(text, AeromatchWarning, stacklevel=3)
    return rows.iterate_instruments(rows.solve(delay))


class _SpectralEquations:
    """Spectral equations of all records; with `parts` at the frequencies of other equations."""

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
            for log, part in zip(logs, parts):
                torque = actuator_inputs(log, structure)[2]
                self.motion.append(self._spectra(log, part.step, part.frequencies, torque))
            return
        start = 0
        for log in logs:
            step, _, torque = actuator_inputs(log, structure)
            duration = step * (log.sizes["time"] - 1)
            f = harmonics(duration, *(band or excited_band(log)))
            samples, rows = slice(0, log.sizes["time"]), slice(start, start + len(f))
            self.parts.append(TransformedStretch(samples, step, f, rows))
            start += len(f)
            self.motion.append(self._spectra(log, step, f, torque))
        self.longest = min([_LONGEST_DELAY, *(0.2 * part.duration for part in self.parts)])
        # Two unknowns per record are the differences between its ends.
        if start < 2 * (len(structure.coefficients) + len(logs)):
            raise IdentificationError(
                f"{start} frequencies are too few for the coefficients of an actuator; widen "
                f"the band or lengthen the log"
            )

    def _spectra(
        self, log: xr.Dataset, step: float, f: np.ndarray, torque: np.ndarray
    ) -> dict[str, np.ndarray]:
        """Return the transforms of rate, acceleration, position and torque."""
        # A derivative is a factor j omega in frequency.
        j_omega, transforms = 2j * np.pi * f, {}
        recorded = {}
        for name in ("position", "rate"):
            if name in log:
                recorded[name] = finite_fourier(log[name].values.astype(float), step, f)
        if "rate" in recorded:
            transforms["v"] = recorded["rate"]
        else:
            transforms["v"] = j_omega * recorded["position"]
        transforms["v'"] = j_omega * transforms["v"]
        if self.structure.stiffness:
            transforms["p"] = recorded["position"]
        if self.structure.absolute:
            transforms["torque"] = finite_fourier(torque, step, f)
        return transforms

    def _command(self, delay: float) -> list[np.ndarray]:
        """Return the spectra of the delayed command, one per record."""
        spectra = []
        for log, part in zip(self.logs, self.parts):
            time, u, f = log["time"].values, log["command"].values.astype(float), part.frequencies
            if not self.structure.held:
                spectra.append(finite_fourier(np.interp(time - delay, time, u), part.step, f))
                continue
            # Held command: j omega u~ is the sum of its jumps less the difference of its ends.
            when, jumps = time[1:] - time[0] + delay, np.diff(u)
            inside = (jumps != 0.0) & (when < part.duration - part.step)
            transform = np.exp(-2j * np.pi * np.outer(f, when[inside])) @ jumps[inside]
            spectra.append((transform - jumps[inside].sum()) / (2j * np.pi * f))
        return spectra

    def _system(self, delay: float) -> tuple[np.ndarray, np.ndarray, list[str]]:
        """Return complex regressors, response and names; the first columns are the coefficients."""
        names = list(self.structure.coefficients)
        response_name = "torque" if self.structure.absolute else "v'"
        blocks, response = [], []
        for k, (motion, u, part) in enumerate(zip(self.motion, self._command(delay), self.parts)):
            # [Grauer2010], eq. (8), solved for the torque, or for v' divided by Ma.
            regressors = {"Ma": -motion["v'"], "Ca": -motion["v"], "B": u}
            if self.structure.stiffness:
                regressors["Ka"] = -motion["p"]
            columns = [regressors[name.removesuffix("/Ma")] for name in names]
            # Differences between the ends of record k: a constant and a multiple of j omega.
            ends = np.zeros((len(part.frequencies), 2 * len(self.parts)), complex)
            ends[:, 2 * k], ends[:, 2 * k + 1] = 1.0, 2j * np.pi * part.frequencies
            # Records of different durations get the same noise power.
            scale = 1.0 / np.sqrt(part.duration)
            blocks.append(scale * np.column_stack([*columns, ends]))
            response.append(scale * motion[response_name])
        return np.concatenate(blocks), np.concatenate(response), names

    def cost(self, delay: float) -> float:
        """Return the sum of squares of the equations for a dead time."""
        X, z, _ = self._system(delay)
        X2, z2 = stack_complex(X), stack_complex(z)
        v = z2 - X2 @ np.linalg.lstsq(X2, z2, rcond=None)[0]
        return float(v @ v)

    def iterate_instruments(self, first: Estimates) -> Estimates:
        """Return the estimates with simulated motion as instruments.

        Without convergence, or if a simulated motion diverges, return the first estimates. Their
        `convergence` states it.
        """
        estimates, change = first, np.inf
        for count in range(1, _ROUNDS + 1):
            before = estimates
            simulated = [self._simulate_motion(log, before.values) for log in self.logs]
            if not self._are_usable(simulated):
                return replace(first, convergence=Convergence(False, count, np.inf))
            estimates = self.solve(
                before.values.get("delay", 0.0),
                _SpectralEquations(simulated, self.structure, band=None, parts=self.parts),
            )
            estimates.values["delay"] = float(
                np.clip(estimates.values.get("delay", 0.0), 0.0, self.longest)
            )
            change = _largest_change(before, estimates)
            if change <= 1.0:
                return replace(estimates, convergence=Convergence(True, count, change))
        return replace(first, convergence=Convergence(False, _ROUNDS, change))

    def _are_usable(self, simulated: Sequence[xr.Dataset]) -> bool:
        """Return whether all simulated rates are finite and not far beyond the recorded range."""
        for motion, log in zip(simulated, self.logs):
            rate = motion["rate"].values
            if not (np.isfinite(rate).all() and np.ptp(rate) < _WILD * np.ptp(_rate(log))):
                return False
        return True

    def _simulate_motion(self, log: xr.Dataset, values: dict[str, float]) -> xr.Dataset:
        """Return the log with simulated motion that begins at the recorded state."""
        position = log["position"].values[0] if "position" in log else 0.0
        initial = {"init.position": position, "init.rate": _rate(log)[0]}
        response = simulate_actuator(log, self.structure, {"delay": 0.0, **values, **initial})
        motion = log.assign(rate=response["rate"])
        if "position" in log:
            motion = motion.assign(position=response["position"])
        return motion

    def solve(self, delay: float, instruments: _SpectralEquations | None = None) -> Estimates:
        """Return estimates and standard errors about a dead time.

        Without `instruments` the method is least squares.
        """
        X, z, names = self._system(delay)
        Z = instruments._system(delay)[0] if instruments else X
        size = np.sqrt((np.abs(X) ** 2).sum(axis=0))
        demand_rank(stack_complex(X[:, : len(names)]), names)
        if self.structure.delay:
            # The dead time is a further unknown: its column is the slope of the command term.
            b = names.index(next(name for name in names if name.split("/")[0] == "B"))
            step = min(part.step for part in self.parts)
            later, earlier = self._system(delay + step)[0], self._system(delay - step)[0]
            slope = (later[:, b] - earlier[:, b]) / (2.0 * step)
            X, Z = np.column_stack([X, slope]), np.column_stack([Z, slope])
            size = np.append(size, np.sqrt((np.abs(slope) ** 2).sum()))
        # Instrumental variables, theta = (F'E)^-1 F'z; columns are scaled to unit length.
        E, F, z2 = stack_complex(X / size), stack_complex(Z / size), stack_complex(z)
        D = np.linalg.solve(F.T @ E, F.T) if instruments else np.linalg.pinv(E)
        theta = D @ z2
        v = z2 - E @ theta
        rows = len(z)
        # Sandwich with the local power of the residuals; few lines widen it by Student's factor.
        C = (
            (D * residual_power(v[:rows] + 1j * v[rows:], F, self.parts))
            @ D.T
            * student_factor(spectral_freedom(rows, len(theta))) ** 2
        )
        values = {name: float(theta[k] / size[k]) for k, name in enumerate(names)}
        stderr = {name: float(np.sqrt(C[k, k]) / size[k]) for k, name in enumerate(names)}
        if self.structure.delay:
            # The last unknown is B times the change of the dead time.
            values["delay"] = delay + float(theta[-1] / size[-1]) / values[names[b]]
            stderr["delay"] = float(np.sqrt(C[-1, -1]) / size[-1]) / abs(values[names[b]])
        return Estimates(
            values | self._neutral(values),
            stderr,
            R2=1.0 - float(v @ v) / float((np.abs(z - z.mean()) ** 2).sum()),
        )

    def _neutral(self, values: dict[str, float]) -> dict[str, float]:
        """Return the neutral command from the means in time, averaged over the records."""
        neutral = []
        value = {name.removesuffix("/Ma"): x for name, x in values.items()}
        for log in self.logs:
            time, (_, u, torque) = log["time"].values, actuator_inputs(log, self.structure)
            p = log["position"].values if "position" in log else np.zeros(1)
            v = _rate(log)
            # Means of the terms of [Grauer2010], eq. (8); the mean of v' follows from the ends.
            load = (
                value.get("Ka", 0.0) * p.mean()
                + value["Ca"] * v.mean()
                + value.get("Ma", 1.0) * (v[-1] - v[0]) / (time[-1] - time[0])
            )
            neutral.append(
                np.interp(time - values.get("delay", 0.0), time, u).mean()
                - (load + torque.mean()) / value["B"]
            )
        return {"neutral": float(np.mean(neutral))}


def _largest_change(before: Estimates, after: Estimates) -> float:
    """Return the largest change of an estimate divided by its tolerance; NaN if one is NaN."""
    ratios = []
    for name, stderr in after.stderr.items():
        difference = abs(after.values[name] - before.values[name])
        # Without noise the standard errors are those of rounding.
        tolerance = np.maximum(_SETTLED * stderr, _RELATIVE * abs(after.values[name]))
        # An estimate that does not change has converged, also with a tolerance of zero.
        ratios.append(difference / tolerance if difference > 0.0 else difference)
    return float(np.max(ratios))


def _motion(log: xr.Dataset) -> np.ndarray:
    return log["position" if "position" in log else "rate"].values.astype(float)


def _rate(log: xr.Dataset) -> np.ndarray:
    return log["rate"].values if "rate" in log else np.gradient(log["position"].values, _step(log))


def _step(log: xr.Dataset) -> float:
    time = log["time"].values
    return float((time[-1] - time[0]) / (len(time) - 1))

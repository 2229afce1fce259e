"""Response model of an actuator.

The model is of second order in position or of first order in rate, with dead time and limits of
rate and position:

    Ma v' + Ca v + Ka p + G tau = B [u(t - delay) - neutral],    p' = v     [Grauer2010], eq. (8)

The magnitude of v is at most the rate limit, and p lies between its stops.  Without a measured
torque only the ratios to Ma determine the response.

References
----------
.. [Grauer2010] Grauer, Ulrich, Hubbard, Pines, Humbert, System identification of an ornithopter
   aerodynamics model, AIAA 2010-7632.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.linalg import expm
from scipy.signal import lfilter

COEFFICIENTS = ("Ma", "Ca", "Ka", "B")
LIMITS = ("rate_limit", "stop_low", "stop_high")
# Parts of a sampling step at a limit: the largest number, and parts per shortest time constant.
_FINEST, _PER_TIME = 8, 6.0


@dataclass(frozen=True)
class Structure:
    """Terms of the model of an actuator.

    Attributes
    ----------
    stiffness : bool
        Whether the position has a restoring stiffness (a servo). Without it, the actuator is a
        motor whose rate is recorded.
    absolute : bool
        Whether the coefficients are absolute (a torque was measured) or ratios to Ma.
    delay : bool
        Dead time of the command.
    rate_limit, stop_low, stop_high : bool
        Limits of rate and position.
    gear : float
        G, torque at the actuator per measured torque. [1]
    held : bool
        Whether a logged command holds from its time stamp to the next one. This applies if the loop
        that writes the log also commands the actuator. Otherwise a jump lies somewhere between two
        samples.
    """

    stiffness: bool = True
    absolute: bool = False
    delay: bool = True
    rate_limit: bool = False
    stop_low: bool = False
    stop_high: bool = False
    gear: float = 1.0
    held: bool = False

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Coefficients of the equation by name; ratios end in ``/Ma``."""
        names = [name for name in COEFFICIENTS if name != "Ka" or self.stiffness]
        if self.absolute:
            return tuple(names)
        return tuple(f"{name}/Ma" for name in names if name != "Ma")

    @property
    def parameters(self) -> tuple[str, ...]:
        """All parameters of the response."""
        options = [name for name in ("delay", *LIMITS) if getattr(self, name)]
        return (*self.coefficients, "neutral", *options)

    def ratios(self, values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return Ca/Ma, Ka/Ma, B/Ma and 1/Ma (0 without torque) from parameter values."""
        ratios = {}
        for name in self.coefficients:
            if not self.absolute:
                ratios[name.removesuffix("/Ma")] = values[name]
            elif name != "Ma":
                ratios[name] = values[name] / values["Ma"]
        inverse = 1.0 / values["Ma"] if self.absolute else np.zeros_like(ratios["B"])
        return {"Ka": np.zeros_like(ratios["B"]), **ratios, "1": inverse}


def simulate_actuator(
    log: xr.Dataset, structure: Structure, values: Mapping[str, float]
) -> xr.Dataset:
    """Return the response of an actuator to the command (and torque) of a log.

    Parameters
    ----------
    log : Dataset (time,)
        ``command``, and ``torque`` [N m] where the structure is absolute, on a uniform clock.
    structure : Structure
        Coefficients, dead time and limits of the model.
    values : mapping of str to float
        Parameters of the structure, ``init.position`` [rad] and ``init.rate`` [rad/s]. The default
        of the initial values is zero.

    Returns
    -------
    Dataset (time,)
        ``position`` [rad] and ``rate`` [rad/s].
    """
    rows = {name: np.array([value], float) for name, value in values.items()}
    p, v = actuator_responses(structure, rows, *actuator_inputs(log, structure))
    return xr.Dataset(
        {
            "position": ("time", p[0], {"units": "rad"}),
            "rate": ("time", v[0], {"units": "rad s-1"}),
        },
        {"time": log["time"]},
    )


def actuator_inputs(log: xr.Dataset, structure: Structure) -> tuple[float, np.ndarray, np.ndarray]:
    """Return step [s], command and torque at the actuator, G tau, of a log."""
    time = log["time"].values.astype(float)
    step = float((time[-1] - time[0]) / (len(time) - 1))
    command = log["command"].values.astype(float)
    if not structure.absolute:
        return step, command, np.zeros(len(time))
    return step, command, structure.gear * log["torque"].values.astype(float)


def actuator_responses(
    structure: Structure,
    values: Mapping[str, np.ndarray],
    step: float,
    command: np.ndarray,
    torque: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and rates (run, time) of several runs at once.

    Parameters
    ----------
    structure : Structure
        Coefficients, dead time and limits of the model.
    values : mapping of str to array (run,)
        Parameters of `structure`, ``init.position``, ``init.rate``.
    step : float
        Sampling interval. [s]
    command, torque : array (time,)
        Linear between samples.

    Notes
    -----
    Without limits the step is exact for torque and command linear between samples, and for a held
    command with any dead time.  With limits, the exact step is divided into as many parts as the
    shortest time constant requires.  Rate and position are clipped after each part.
    """
    ratio = structure.ratios(values)
    runs = len(ratio["B"])
    limited = any(getattr(structure, name) for name in LIMITS)
    parts = _parts_per_step(ratio, step) if limited else 1
    # Dead time in parts of a step.
    shift = values["delay"] * parts / step if structure.delay else np.zeros(runs)
    nil = np.zeros(runs)
    start = np.stack([values.get("init.position", nil), values.get("init.rate", nil)], axis=1)
    free, first, last = _exact_step(ratio, np.full(runs, step / parts))
    fine = np.arange((len(torque) - 1) * parts + 1) / parts
    load = -ratio["1"][:, None] * np.interp(fine, np.arange(len(torque)), torque)
    if structure.held:
        earlier, later = _switched_command(command, shift, parts)
        # The later value acts from the switch to the end of the part.
        _, *late = _exact_step(ratio, step / parts * (1.0 - shift % 1.0))
        after = late[0] + late[1]
        pull = first[:, :, None] * load[:, None, :-1] + last[:, :, None] * load[:, None, 1:]
        push = [ratio["B"][:, None] * (u - values["neutral"][:, None]) for u in (earlier, later)]
        forced = (
            pull
            + (first + last - after)[:, :, None] * push[0][:, None]
            + after[:, :, None] * push[1][:, None]
        )
    else:
        drive = load + ratio["B"][:, None] * (
            _delayed_command(command, shift / parts, fine) - values["neutral"][:, None]
        )
        forced = first[:, :, None] * drive[:, None, :-1] + last[:, :, None] * drive[:, None, 1:]
    if not limited:
        x = _linear_states(free, forced, start)
    else:
        limits = _limit_values(structure, values, runs)
        x = _limited_states(step / parts, free, forced=forced, start=start, limits=limits)
    # Only the ends of whole sampling steps are outputs.
    return x[:, 0, ::parts], x[:, 1, ::parts]


def _limit_values(
    structure: Structure, values: Mapping[str, np.ndarray], runs: int
) -> list[np.ndarray]:
    """Return rate limit, low stop and high stop (run,); infinite where the model has none."""
    infinite = np.full(runs, np.inf)
    limits = []
    for name, absent in zip(LIMITS, (infinite, -infinite, infinite)):
        limits.append(values[name] if getattr(structure, name) else absent)
    return limits


def _parts_per_step(ratio: Mapping[str, np.ndarray], step: float) -> int:
    """Return the number of parts of a sampling step that the fastest mode requires."""
    fastest = float(np.max(np.maximum(np.abs(ratio["Ca"]), np.sqrt(np.abs(ratio["Ka"])))))
    return int(np.clip(math.ceil(_PER_TIME * step * fastest / 2.0), 2, _FINEST))


def _delayed_command(command: np.ndarray, shift: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return the command (run, part) delayed by `shift` samples (run,), linear between samples.

    Before the first sample the command has the value of that sample.
    """
    samples = np.arange(len(command))
    return np.stack([np.interp(at - delay, samples, command) for delay in shift])


def _switched_command(
    command: np.ndarray, shift: np.ndarray, parts: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the held command (run, part) before and after it switches within each part.

    The switch is at the fraction `shift` mod 1 of the part.
    """
    index = np.arange((len(command) - 1) * parts) - np.floor(shift).astype(int)[:, None]
    latest = len(command) - 1
    before = command[np.clip((index - 1) // parts, 0, latest)]
    after = command[np.clip(index // parts, 0, latest)]
    return before, after


def _exact_step(
    ratio: Mapping[str, np.ndarray], step: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return free, first and last of x(h) = free x(0) + first f(0) + last f(h), per run.

    The state is x = (p, v), and the drive f is linear over the step h.
    """
    # Augmented state (p, v, f, f' h): its matrix exponential contains the integrals over the drive.
    runs = len(ratio["B"])
    A = np.zeros((runs, 4, 4))
    A[:, 0, 1] = A[:, 1, 2] = step
    A[:, 1, 0], A[:, 1, 1] = -ratio["Ka"] * step, -ratio["Ca"] * step
    A[:, 2, 3] = 1.0
    E = expm(A)
    return E[:, :2, :2], E[:, :2, 2] - E[:, :2, 3], E[:, :2, 3]


def _linear_states(free: np.ndarray, drive: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return the states (run, 2, time) of x_k+1 = free x_k + drive_k.

    Each state obeys a scalar recursion of second order, which a digital filter evaluates.
    """
    out = np.empty((len(free), 2, drive.shape[2] + 1))
    out[:, :, 0] = start
    for F, d, x, first in zip(free, drive, out, start):
        trace, determinant = np.trace(F), np.linalg.det(F)
        # Cayley-Hamilton: x_k+2 = trace x_k+1 - determinant x_k + d_k+1 + (F - trace) d_k
        inputs = d.copy()
        inputs[0, 1:] -= F[1, 1] * d[0, :-1] - F[0, 1] * d[1, :-1]
        inputs[1, 1:] -= F[0, 0] * d[1, :-1] - F[1, 0] * d[0, :-1]
        # The first two inputs of the filter reproduce the initial state.
        second = F @ first + d[:, 0]
        inputs[:, 0] = second
        if inputs.shape[1] > 1:
            inputs[:, 1] = F @ second + d[:, 1] - trace * second
        x[:, 1:] = lfilter([1.0], [1.0, -trace, determinant], inputs, axis=1)
    return out


def _limited_states(
    step: float,
    free: np.ndarray,
    forced: np.ndarray,
    start: np.ndarray,
    limits: Sequence[np.ndarray],
) -> np.ndarray:
    """Return states (run, 2, time) with limits of rate and position."""
    rate, low, high = limits
    least, most = np.minimum, np.maximum
    (fpp, fpv), (fvp, fvv) = free[:, 0].T.copy(), free[:, 1].T.copy()
    reach, slowest = rate * step, -rate
    stopped = bool(np.isfinite(low).any() or np.isfinite(high).any())
    pushes, jerks = (np.ascontiguousarray(forced[:, k].T) for k in (0, 1))
    out = np.empty((len(pushes) + 1, 2, len(free)))
    p, v = start.T.copy()
    out[0] = p, v
    for k, (push, jerk) in enumerate(zip(pushes, jerks), 1):
        # Rate limit: neither the step of the position nor the rate exceeds it.
        position = most(least(fpp * p + fpv * v + push, p + reach), p - reach)
        v = most(least(fvp * p + fvv * v + jerk, rate), slowest)
        p = position
        if stopped:
            # A stop also cancels the rate towards it.
            p = most(least(position, high), low)
            v = np.where((position - p) * v > 0.0, 0.0, v)
        out[k, 0], out[k, 1] = p, v
    return out.transpose(2, 1, 0)

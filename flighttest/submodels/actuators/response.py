"""Response of an actuator: second order in position or first order in rate, dead time, limits of
rate and position.

    Ma v' + Ca v + Ka p + G tau = B [u(t - delay) - neutral],    p' = v            [Grauer2010], eq. (8)

with |v| at most the rate limit and p between its stops.  Without a measured torque only the ratios
to Ma determine the response.

References
----------
.. [Grauer2010] Grauer, Ulrich, Hubbard, Pines, Humbert, System identification of an ornithopter aerodynamics model, AIAA 2010-7632.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.linalg import expm
from scipy.signal import lfilter

COEFFICIENTS = ("Ma", "Ca", "Ka", "B")
LIMITS = ("rate_limit", "stop_low", "stop_high")
_FINEST, _PER_TIME = 8, 6.0  # steps per sample at most, steps per shortest time constant


@dataclass(frozen=True)
class Structure:
    """What the model of an actuator has.

    Attributes
    ----------
    stiffness : bool
        Whether it has a position of rest (a servo); without, a motor whose rate is recorded.
    absolute : bool
        Whether coefficients are absolute (a torque was measured), else ratios to Ma.
    delay : bool
        Dead time of the command.
    rate_limit, stop_low, stop_high : bool
        Limits of rate and position.
    gear : float
        G, torque at the actuator per measured torque. [1]
    held : bool
        Whether a logged command holds from its stamp to the next, as where the loop that writes the
        log commands the actuator; else a jump lies somewhere between two samples.
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
        own = [name for name in COEFFICIENTS if name != "Ka" or self.stiffness]
        return tuple(own) if self.absolute else tuple(f"{name}/Ma" for name in own if name != "Ma")

    @property
    def parameters(self) -> tuple[str, ...]:
        """All parameters of the response."""
        return (
            *self.coefficients,
            "neutral",
            *(name for name in ("delay", *LIMITS) if getattr(self, name)),
        )

    def ratios(self, values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return Ca/Ma, Ka/Ma, B/Ma and 1/Ma (0 without torque) from parameter values."""
        if self.absolute:
            found = {
                name: values[name] / values["Ma"] for name in self.coefficients if name != "Ma"
            }
            inverse = 1.0 / values["Ma"]
        else:
            found = {name.removesuffix("/Ma"): values[name] for name in self.coefficients}
            inverse = np.zeros_like(found["B"])
        return {"Ka": np.zeros_like(found["B"]), **found, "1": inverse}


def simulate_actuator(
    log: xr.Dataset, structure: Structure, values: Mapping[str, float]
) -> xr.Dataset:
    """Return the response of an actuator to the command (and torque) of a log.

    Parameters
    ----------
    log : Dataset (time,)
        ``command``, ``torque`` [N m] where the structure is absolute, on a uniform clock.
    structure : Structure
    values : mapping of str to float
        Its parameters, and ``init.position`` [rad], ``init.rate`` [rad/s], zero unless given.

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
    torque = (
        structure.gear * log["torque"].values.astype(float)
        if structure.absolute
        else np.zeros(len(time))
    )
    return (
        float((time[-1] - time[0]) / (len(time) - 1)),
        log["command"].values.astype(float),
        torque,
    )


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
    values : mapping of str to array (run,)
        Parameters of `structure`, ``init.position``, ``init.rate``.
    step : float
        Sampling interval. [s]
    command, torque : array (time,)
        Linear between samples.

    Notes
    -----
    Without limits the step is exact: for torque and command linear between samples, and for a held command with whatever dead time.  At a
    limit, the exact step is divided, as finely as the shortest time constant requires, and rate and position are clipped after each part.
    """
    ratio = structure.ratios(values)
    runs = len(ratio["B"])
    limited = any(getattr(structure, name) for name in LIMITS)
    parts = _parts(ratio, step) if limited else 1
    shift = values["delay"] * parts / step if structure.delay else np.zeros(runs)
    start = np.stack(
        [values.get("init.position", np.zeros(runs)), values.get("init.rate", np.zeros(runs))],
        axis=1,
    )
    free, first, last = _exact_step(ratio, np.full(runs, step / parts))
    fine = np.arange((len(torque) - 1) * parts + 1) / parts
    load = -ratio["1"][:, None] * np.interp(fine, np.arange(len(torque)), torque)
    if structure.held:
        earlier, later = _switched(command, shift, parts)
        _, *late = _exact_step(ratio, step / parts * (1.0 - shift % 1.0))
        after = late[0] + late[1]  # of the value that is switched to
        pull = first[:, :, None] * load[:, None, :-1] + last[:, :, None] * load[:, None, 1:]
        push = [ratio["B"][:, None] * (u - values["neutral"][:, None]) for u in (earlier, later)]
        forced = (
            pull
            + (first + last - after)[:, :, None] * push[0][:, None]
            + after[:, :, None] * push[1][:, None]
        )
    else:
        drive = load + ratio["B"][:, None] * (
            _delayed(command, shift / parts, fine) - values["neutral"][:, None]
        )
        forced = first[:, :, None] * drive[:, None, :-1] + last[:, :, None] * drive[:, None, 1:]
    if not limited:
        x = _linear(free, forced, start)
    else:
        far = np.full(runs, np.inf)
        rate, low, high = (
            values[name] if getattr(structure, name) else none
            for name, none in zip(LIMITS, (far, -far, far))
        )
        x = _clipped(step / parts, free, forced, start, rate, low, high)
    return x[:, 0, ::parts], x[:, 1, ::parts]


def _parts(ratio: Mapping[str, np.ndarray], step: float) -> int:
    fastest = float(np.max(np.maximum(np.abs(ratio["Ca"]), np.sqrt(np.abs(ratio["Ka"])))))
    return int(np.clip(math.ceil(_PER_TIME * step * fastest / 2.0), 2, _FINEST))


def _delayed(command: np.ndarray, shift: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return the command later by `shift` samples (run,), linear between samples; before its first
    sample it is that sample.
    """
    return np.stack([np.interp(at - own, np.arange(len(command)), command) for own in shift])


def _switched(command: np.ndarray, shift: np.ndarray, parts: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the held command in each part of a step (run, part) before and after the fraction of
    it at which the delayed one switches.
    """
    at = np.arange((len(command) - 1) * parts) - np.floor(shift).astype(int)[:, None]
    return tuple(command[np.clip((at - late) // parts, 0, len(command) - 1)] for late in (1, 0))


def _exact_step(
    ratio: Mapping[str, np.ndarray], step: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return x(h) = free x(0) + first f(0) + last f(h) of x = (p, v) under a linear drive f, per
    run.
    """

    runs = len(ratio["B"])
    A = np.zeros((runs, 4, 4))
    A[:, 0, 1] = A[:, 1, 2] = step
    A[:, 1, 0], A[:, 1, 1] = -ratio["Ka"] * step, -ratio["Ca"] * step
    A[:, 2, 3] = 1.0
    E = expm(A)
    return E[:, :2, :2], E[:, :2, 2] - E[:, :2, 3], E[:, :2, 3]


def _linear(free: np.ndarray, drive: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return states (run, 2, time) of x_k+1 = free x_k + drive_k, by the recursion of second order
    that each state obeys.
    """

    out = np.empty((len(free), 2, drive.shape[2] + 1))
    out[:, :, 0] = start
    for F, d, x, first in zip(free, drive, out, start):
        trace, determinant = np.trace(F), np.linalg.det(F)
        # Cayley-Hamilton: x_k+2 = trace x_k+1 - determinant x_k + d_k+1 + (F - trace) d_k
        rest = d.copy()
        rest[0, 1:] -= F[1, 1] * d[0, :-1] - F[0, 1] * d[1, :-1]
        rest[1, 1:] -= F[0, 0] * d[1, :-1] - F[1, 0] * d[0, :-1]
        second = F @ first + d[:, 0]
        rest[:, 0] = second
        if rest.shape[1] > 1:
            rest[:, 1] = F @ second + d[:, 1] - trace * second
        x[:, 1:] = lfilter([1.0], [1.0, -trace, determinant], rest, axis=1)
    return out


def _clipped(
    step: float,
    free: np.ndarray,
    forced: np.ndarray,
    start: np.ndarray,
    rate: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray:
    """Return states (run, 2, time) with limits of rate and position."""
    least, most = np.minimum, np.maximum
    (fpp, fpv), (fvp, fvv) = free[:, 0].T.copy(), free[:, 1].T.copy()
    reach, slowest = rate * step, -rate
    stopped = bool(np.isfinite(low).any() or np.isfinite(high).any())
    pushes, jerks = (np.ascontiguousarray(forced[:, k].T) for k in (0, 1))
    out = np.empty((len(pushes) + 1, 2, len(free)))
    p, v = start.T.copy()
    out[0] = p, v
    for k, (push, jerk) in enumerate(zip(pushes, jerks), 1):
        moved = most(least(fpp * p + fpv * v + push, p + reach), p - reach)
        v = most(least(fvp * p + fvv * v + jerk, rate), slowest)
        p = moved
        if stopped:
            p = most(least(moved, high), low)
            v = np.where((moved - p) * v > 0.0, 0.0, v)
        out[k, 0], out[k, 1] = p, v
    return out.transpose(2, 1, 0)

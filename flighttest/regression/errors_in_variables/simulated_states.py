"""Response of noisy variables to the recorded controls, as instruments of a regression.

The auxiliary model of [Young1976]_ and [Soderstrom2002]_ is a linear one in continuous time,

    x' = F x + G u + g,

for the noisy variables x and the moving controls u. F and G follow from least squares on integrals
of the records, x = x(0) + F int x + G int u + g t. Integration attenuates noise from sample to
sample. The further of `ROUNDS` rounds take the simulated x as instruments, which removes the
remaining bias. The simulated response depends on the noise of the record only through a few
numbers, and so it is independent of the noise of each sample.

References
----------
.. [Young1976] Young, Some observations on instrumental variable methods of time-series analysis,
   Int. J. Control 23, 1976.
.. [Soderstrom2002] Soderstrom, Stoica, Instrumental variable methods for system identification,
   Circuits, Systems and Signal Processing 21, 2002.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from flightmech.errors import IdentificationError
from flighttest.regression.equation_error.samples import RegressionSamples

ROUNDS = 3
# variables that move together; one of each alternative is taken
_GROUPS = ((("alpha",), ("qhat", "q")), (("beta",), ("phat", "p"), ("rhat", "r"), ("phi",)))
CONTROLS = "delta_"  # start of the names of controls
_BEYOND = 1e6  # response over the largest sample that counts as divergent


@dataclass(frozen=True)
class _SampledStretch:
    """States (samples, states) and controls (samples, controls) of one stretch without a gap."""

    place: slice
    step: float
    x: np.ndarray
    u: np.ndarray

    def integral(self, values: np.ndarray) -> np.ndarray:
        """Return the integrals from the first sample on, by trapezia."""
        areas = 0.5 * self.step * (values[1:] + values[:-1])
        return np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(areas, axis=0)])

    def without_line(self, values: np.ndarray) -> np.ndarray:
        """Return columns without x(0) and g t, which every stretch has for itself."""
        line = np.column_stack([np.ones(len(values)), np.linspace(-1.0, 1.0, len(values))])
        Q = np.linalg.qr(line)[0]
        return values - Q @ (Q.T @ values)


def simulate_states(samples: RegressionSamples, noisy: Sequence[str]) -> dict[str, np.ndarray]:
    """Return the response of noisy variables to the controls at the samples, (samples,) each.

    Parameters
    ----------
    samples : RegressionSamples
    noisy : sequence of str
        Variables that are simulated, together with the variables that move with them.

    Raises
    ------
    IdentificationError
        No control moves, or the response diverges.
    """
    data = samples.data
    states = _list_states(data, noisy)
    controls = []
    for name in map(str, data.data_vars):
        if name.startswith(CONTROLS) and not name.endswith("_error"):
            values = data[name].values
            if np.isfinite(values).all() and np.ptp(values) > 0.0:
                controls.append(name)
    if not controls:
        raise IdentificationError(
            "no control moves, so that no response can be simulated; give instruments, such as a "
            "path from other sensors"
        )
    x = np.column_stack([data[name].values for name in states])
    u = np.column_stack([data[name].values for name in controls])
    # Columns of unit size: variables of any unit in one system.
    size_x, size_u = _sizes(x), _sizes(u)
    stretches = []
    for piece, step in zip(*samples.pieces()):
        stretches.append(_SampledStretch(piece, step, x[piece] / size_x, u[piece] / size_u))
    response = [stretch.x for stretch in stretches]
    for _ in range(ROUNDS):
        F, G = _estimate_system(stretches, response)
        response = [_simulate(stretch, F, G) for stretch in stretches]
    simulated = np.empty_like(x)
    for stretch, values in zip(stretches, response):
        simulated[stretch.place] = values * size_x
    columns = dict(zip(states, simulated.T))
    return {name: columns[name] for name in noisy}


def _sizes(columns: np.ndarray) -> np.ndarray:
    size = columns.std(axis=0)
    return np.where(size > 0.0, size, 1.0)


def _list_states(data, noisy: Sequence[str]) -> list[str]:
    """Return the noisy variables, and those that complete the motions they belong to."""
    states = list(noisy)
    for group in _GROUPS:
        if not any(name in states for name in chain.from_iterable(group)):
            continue
        for variants in group:
            held = [name for name in variants if name in data]
            if held and not any(name in states for name in variants):
                values = data[held[0]].values
                if np.isfinite(values).all() and np.ptp(values) > 0.0:
                    states.append(held[0])
    return states


def _estimate_system(
    stretches: Sequence[_SampledStretch], instruments: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return F and G from integrals, with states as their instruments."""
    rows, given, targets = [], [], []
    for stretch, values in zip(stretches, instruments):
        controls = stretch.integral(stretch.u)
        rows.append(stretch.without_line(np.column_stack([stretch.integral(stretch.x), controls])))
        given.append(stretch.without_line(np.column_stack([stretch.integral(values), controls])))
        targets.append(stretch.without_line(stretch.x))
    W, Z, y = np.concatenate(rows), np.concatenate(given), np.concatenate(targets)
    # Two stages: the integrals projected on the instruments, then least squares.
    Q = np.linalg.qr(Z)[0]
    found = np.linalg.lstsq(Q @ (Q.T @ W), y, rcond=None)[0].T
    states = y.shape[1]
    return found[:, :states], found[:, states:]


def _simulate(stretch: _SampledStretch, F: np.ndarray, G: np.ndarray) -> np.ndarray:
    """Return the response (samples, states) to the controls; x(0) and g by least squares."""
    n, h = len(F), stretch.step
    # (I - F h/2) x_(k+1) = (I + F h/2) x_k + h/2 (b_k + b_(k+1)), the rule of the integrals
    left = np.linalg.inv(np.eye(n) - 0.5 * h * F)
    transition, gain = left @ (np.eye(n) + 0.5 * h * F), left * h
    drive = stretch.u @ G.T
    drive = 0.5 * (drive[1:] + drive[:-1]) @ gain.T
    # Columns: response to the controls, to each x(0) and to each g.
    x = np.zeros((len(stretch.x), n, 1 + 2 * n))
    x[0, :, 1 : 1 + n] = np.eye(n)
    push = np.zeros((n, 1 + 2 * n))
    push[:, 1 + n :] = gain
    with np.errstate(over="ignore", invalid="ignore"):
        for k, own in enumerate(drive):
            x[k + 1] = transition @ x[k] + push
            x[k + 1, :, 0] += own
    largest = float(np.abs(stretch.x).max()) or 1.0
    if not np.isfinite(x).all() or float(np.abs(x[:, :, 0]).max()) > _BEYOND * largest:
        raise IdentificationError(
            "the simulated response to the controls diverges; choose shorter windows, or give "
            "instruments, such as a path from other sensors"
        )
    forced, own = x[:, :, 0], x[:, :, 1:].reshape(-1, 2 * n)
    start = np.linalg.lstsq(own, (stretch.x - forced).ravel(), rcond=None)[0]
    return forced + (own @ start).reshape(-1, n)

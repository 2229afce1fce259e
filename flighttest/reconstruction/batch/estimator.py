"""Maximum likelihood of a batch fit: Levenberg-Marquardt inside, noise of the channels outside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flightmech.errors import IdentificationError

from .normal_equations import Equations, Unknowns
from .parameter_layout import Layout

ITERATIONS = 30
ROUNDS = 6  # of the noise
SAME = 0.05  # change of the noise at which it has settled
GAIN = 0.01  # expected change of the cost at which the iteration has settled
STIFF = 1e9  # damping at which no step is left
FEW = 20  # readings below which a channel keeps the noise of its specification
FAR = 1000.0  # cost per reading above which factors, lags and latencies wait
_MULTIPLY = ("factor.", "lag.", "delay.", "scale.")


@dataclass(frozen=True)
class Fitted:
    """The last equations, the noise they are weighed with, and the number of iterations."""

    equations: Equations
    sigma: dict[str, float]
    iterations: int


def first_equations(layout: Layout) -> Equations:
    """Return the equations at the start: paths from the readings, constants at their first values, noise as specified."""
    c = layout.mean.copy()
    for setup, places in zip(layout.setups, layout.places, strict=True):
        c[places] = setup.c
    sigma: dict[str, float] = {}
    for setup in layout.setups:
        for sensor in setup.problem.sensors:
            sigma.update(zip(sensor.names, map(float, sensor.sigma), strict=True))
    paths = [setup.x for setup in layout.setups]
    starts = [setup.x[setup.problem.starts].copy() for setup in layout.setups]
    return Equations(layout, Unknowns(c, starts, paths), sigma)


def fit(equations: Equations) -> Fitted:
    """Return the maximum-likelihood estimate.

    Parameters
    ----------
    equations : Equations
        At the start.

    Raises
    ------
    IdentificationError
        No step lowers the cost, or the iteration does not settle.

    Notes
    -----
    J = 1/2 sum over channels [r'r/R + N ln R]: for given noise R the unknowns by Levenberg-Marquardt, then R = r'r/N,
    until R changes by less than 5 %.
    """
    count = 0
    for _ in range(ROUNDS):
        equations, used = _settle(equations)
        count += used
        sigma = {name: rms if n >= FEW else equations.sigma[name] for name, (rms, n) in equations.rms().items()}
        sigma = {name: max(value, 1e-3 * equations.sigma[name]) for name, value in sigma.items()}
        change = max(abs(sigma[name] / equations.sigma[name] - 1.0) for name in sigma)
        if change < SAME:
            break
        equations = equations.weighed(sigma)
    return Fitted(equations, equations.sigma, count)


def _settle(equations: Equations) -> tuple[Equations, int]:
    layout, damping, fresh = equations.layout, 0.0, False
    multiply = np.array([name.startswith(_MULTIPLY) for name in layout.names])
    for count in range(1, ITERATIONS + 1):
        far = equations.cost > FAR * equations.readings
        step, gain = equations.step(damping, multiply & far)
        enough = GAIN * max(1.0, equations.cost / equations.readings)  # in terms of the noise that the residuals will show
        trial = _moved(equations, step)
        if trial is not None and trial.cost <= equations.cost + enough:
            equations, fresh = trial, False
            damping = damping / 10.0 if damping > 1e-6 else 0.0
            if gain < enough and not far:
                return equations, count
        elif not fresh:  # the weak terms were those of the path before
            equations, fresh = _moved(equations, 0.0 * step) or equations, True
        else:
            damping = max(10.0 * damping, 1e-3)
            if damping > STIFF:
                raise IdentificationError(
                    "the batch fit finds no better path from its start; check signs, units and positions of the sensors"
                )
    raise IdentificationError(
        f"the batch fit did not settle in {ITERATIONS} iterations; see which constants the readings do not determine (`visible`)"
    )


def _moved(equations: Equations, step: np.ndarray) -> Equations | None:
    """Return the equations after a step; None where the path leaves what Euler angles can show."""
    after = equations.at.moved(equations.layout, step, equations.paths)
    trial = Equations(equations.layout, after, equations.sigma)
    return trial if np.isfinite(trial.cost) else None

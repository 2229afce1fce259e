"""Extended Kalman filter along a flight, for many sets of parameters at once.

The state of the filter is the motion, then two lags for each gust. The motion is predicted by the
simulation itself. The covariance follows the linear model of the simulation about the filtered
motion, which central differences give again every `REFRESH` seconds:

    e_k = z_k - y(x_k),   S_k = H P H' + R,   K = P H' S_k^-1
    x_(k+1) = f(x_k + K e_k),   P <- F (P after the readings) F' + Q

The first covariance is that of a filter which has run for long in the first condition. On a linear
system the filter is therefore the steady one from the first sample on. [Jategaonkar]_ describes the
filter, with a gain that stays; here it changes with the flight condition.

References
----------
.. [Jategaonkar] Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015, ch. 5.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from flighttest.maximum_likelihood.linear.gust_states import READ
from flighttest.maximum_likelihood.linear.riccati import (
    correct_covariance,
    noise_of_step,
    settled_covariance,
    solve_each,
)
from flighttest.maximum_likelihood.nonlinear.kernel_flights import StepSlopes

REFRESH = 0.5  # time between two linearisations [s]
_GUST_NODES = 6  # of Gauss and Legendre along a step: exact to the eleventh power of step / T


class FilteredFlights(Protocol):
    """Simulations of one record with different parameters, as `KernelFlights`."""

    failed: np.ndarray

    def look(self, sample: int, gusts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return coordinates and outputs (run, output)."""

    def correct(self, changes: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
        """Correct the coordinates of the filter, and return all coordinates."""

    def advance(
        self, sample: int, first: np.ndarray, last: np.ndarray, coordinates: np.ndarray
    ) -> None:
        """Advance to the next sample with gusts linear between two values."""

    def linearise(self, sample: int, gusts: np.ndarray, coordinates: np.ndarray) -> StepSlopes:
        """Return the linear model over the next step."""


class FilterSettings(NamedTuple):
    """What a filter needs besides the simulation, one row for each run.

    Attributes
    ----------
    intensity : array (run, state)
        Square roots of the intensities of the white noise that drives motion and lags.
    noise : array (run, output)
        Standard deviations of the readings.
    factor, offset : array (run, output)
        Of the instruments: reading = factor * output + offset.
    lags : array (run, gust, 2)
        First values of the lags. [rad]
    time : array (run, gust)
        Time constants of the gusts. [s]
    speed : array (gust,)
        From the lags to a gust. [m/s]
    """

    intensity: np.ndarray
    noise: np.ndarray
    factor: np.ndarray
    offset: np.ndarray
    lags: np.ndarray
    time: np.ndarray
    speed: np.ndarray


class _StepModel(NamedTuple):
    """Linear model of motion and lags: F, H, and the noise of a step, per run."""

    F: np.ndarray
    H: np.ndarray
    Q: np.ndarray


def filter_flights(
    flights: FilteredFlights, z: np.ndarray, settings: FilterSettings, step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return innovations (run, time, output) and their variances (run, time, output, output).

    A missing reading has the innovation zero, the variance one, and no correlation with others.
    Runs that fail are NaN.

    Parameters
    ----------
    flights : FilteredFlights
        At the first sample.
    z : array (time, output)
        Readings, NaN for a missing one.
    settings : FilterSettings
    step : float
        Sampling interval. [s]
    """
    runs, outputs = settings.noise.shape
    e, S = np.empty((runs, *z.shape)), np.empty((runs, *z.shape, outputs))
    passage = _pass_lags(settings.time, step)
    lags, R = settings.lags.copy(), settings.noise**2
    every = count_between(step)
    states = settings.intensity.shape[1]
    motion = states - 2 * settings.time.shape[1]
    with np.errstate(all="ignore"):
        for sample in range(len(z)):
            gusts = _gusts_of(lags, settings.speed)
            coordinates, y = flights.look(sample, gusts)
            y = settings.factor * y + settings.offset
            is_last = sample + 1 == len(z)
            if sample % every == 0 and not is_last:
                slopes = flights.linearise(sample, gusts, coordinates)
                model = _join_model(slopes, settings, passage, step=step)
                for part in (model.F, model.H):
                    flights.failed |= ~np.isfinite(part).all(axis=(1, 2))
                model = _StepModel(*(np.nan_to_num(part) for part in model))
                if not sample:
                    P = settled_covariance(model.F, model.H, model.Q, R)
            is_read = np.isfinite(z[sample])
            # A missing reading has no slope and the variance one.
            H = model.H * is_read[:, None]
            variance = np.where(is_read, R, 1.0)
            innovation = np.where(is_read, z[sample] - y, 0.0)
            PH = P @ H.swapaxes(1, 2)
            total = H @ PH + variance[:, :, None] * np.eye(outputs)
            e[:, sample], S[:, sample] = innovation, total
            if is_last:
                break
            K = solve_each(total, PH.swapaxes(1, 2)).swapaxes(1, 2)
            change = (K @ innovation[:, :, None])[:, :, 0]
            P = correct_covariance(P, K, H, variance)
            P = model.F @ P @ model.F.swapaxes(1, 2) + model.Q
            coordinates = flights.correct(change[:, :motion], coordinates)
            lags = lags + change[:, motion:].reshape(lags.shape)
            first = settings.speed * (lags * passage.first).sum(axis=2)
            last = settings.speed * (lags * passage.last).sum(axis=2)
            flights.advance(sample, first, last, coordinates)
            lags = (passage.transition @ lags[:, :, :, None])[:, :, :, 0]
    # A filter without a gain fails as a simulation does.
    flights.failed |= ~np.isfinite(S).all(axis=(1, 2, 3))
    e[flights.failed], S[flights.failed] = np.nan, np.nan
    return e, S


def count_between(step: float) -> int:
    """Return the number of samples between two linearisations."""
    return max(1, round(REFRESH / step))


def _gusts_of(lags: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Return the gusts (run, gust) of lags (run, gust, 2). [m/s]"""
    return speed * (lags @ READ)


class _Passage(NamedTuple):
    """Gusts over one step, from the lags at its start.

    Attributes
    ----------
    transition : array (run, gust, 2, 2)
        Of the lags over the step.
    first, last : array (run, gust, 2)
        From the lags to the ends of the straight line nearest to the gust along the step.
    """

    transition: np.ndarray
    first: np.ndarray
    last: np.ndarray


def _pass_lags(time: np.ndarray, step: float) -> _Passage:
    """Return how gusts of time constants (run, gust) pass over a step."""
    # The simulation has gusts that are linear along a step; that of the lags decays. The line of
    # least squares, w = a + b (2 s - 1) over s = 0 ... 1, has the same mean and the same first
    # moment: a = int w ds, b = 3 int w (2 s - 1) ds. What it leaves is of the third order for a
    # motion, where a line between the ends leaves (step / T)^2 / 12 of the gust.
    nodes, weights = np.polynomial.legendre.leggauss(_GUST_NODES)
    mean, slope = np.zeros((*time.shape, 2)), np.zeros((*time.shape, 2))
    for node, weight in zip(nodes, 0.5 * weights):
        seen = READ @ _lag_transitions(time, 0.5 * (node + 1.0) * step)
        mean += weight * seen
        slope += 3.0 * weight * node * seen
    return _Passage(_lag_transitions(time, step), first=mean - slope, last=mean + slope)


def _lag_transitions(time: np.ndarray, step: float) -> np.ndarray:
    """Return the transitions of two equal lags over a step, (run, gust, 2, 2)."""
    ratio = step / time
    decay = np.exp(-ratio)
    rows = [[decay, np.zeros_like(decay)], [ratio * decay, decay]]
    return np.moveaxis(np.array(rows), (0, 1), (2, 3))


def _join_model(
    slopes: StepSlopes, settings: FilterSettings, passage: _Passage, step: float
) -> _StepModel:
    """Return the linear model of motion and lags."""
    runs, n = slopes.F.shape[:2]
    total = settings.intensity.shape[1]
    F, H = np.zeros((runs, total, total)), np.zeros((runs, slopes.H.shape[1], total))
    F[:, :n, :n], H[:, :, :n] = slopes.F, slopes.H
    for gust, speed in enumerate(settings.speed):
        place = slice(n + 2 * gust, n + 2 * gust + 2)
        F[:, place, place] = passage.transition[:, gust]
        first = speed * passage.first[:, gust]
        rise = speed * passage.last[:, gust] - first
        F[:, :n, place] = (
            slopes.F_gust[:, :, gust, None] * first[:, None, :]
            + slopes.F_rise[:, :, gust, None] * rise[:, None, :]
        )
        H[:, :, place] = slopes.H_gust[:, :, gust, None] * (speed * READ)
    return _StepModel(
        F, settings.factor[:, :, None] * H, noise_of_step(F, settings.intensity, step)
    )

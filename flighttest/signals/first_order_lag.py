"""First-order lag of a channel: a vane, a filter or a line behind the truth, an actuator behind its command."""

from __future__ import annotations

import math

import numpy as np

from .conditioning import GAP
from .differentiation import WINDOW, derivative
from .sample_flags import ENDLESS

_EVEN = 1e-3  # of the step: scatter of the stamps up to which the clock is taken as uniform


def lag_weights(tau: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (E, c0, c1) of y_k+1 = E y_k + c0 x_k + c1 x_k+1, a first-order lag of an input linear between samples, and d/dtau.

    Below a twentieth of a step, E = exp(-dt/tau) is nothing and y = x - tau x', which holds for a negative lag too: a vane that is ahead
    of an inertial unit with a latency of its own.
    """
    s = tau / dt
    if s < 0.05:
        return np.array([0.0, s, 1.0 - s]), np.array([0.0, 1.0, -1.0]) / dt
    E, ds = np.exp(-1.0 / s), 1.0 / dt
    dE = E * dt / tau**2
    rise, d_rise = s * (1.0 - E), ds * (1.0 - E) - s * dE
    return np.array([E, rise - E, 1.0 - rise]), np.array([dE, d_rise - dE, -d_rise])


def remove_lag(time, x, lag: float, name: str) -> np.ndarray:
    """Return a channel with a known first-order lag removed, or applied when it is negative.

    Parameters
    ----------
    time, x : array (time,)
        Samples, at rising times; NaN stays NaN, and the lag starts anew behind it and behind a gap of the clock. [s], [any]
    lag : float
        Time constant by which the channel is behind the truth: a vane, a pressure line, a filter.  A negative one is that of what follows
        the channel: a recorded command becomes the position of an actuator that follows it with the time constant -lag. [s]
    name : str
        Name of the quantity; heading and longitude are unwrapped.

    Returns
    -------
    array (time,)

    Notes
    -----
    Removed by x + lag dx/dt with the slope of local polynomials (`derivative`, in the order of samples, so that stamps may scatter): white
    noise grows by sqrt(1 + (lag n)^2), n of `derivative_noise`, 16.9/s at 50 Hz.  Applied exactly for a channel that is linear between
    samples; the first sample of each stretch is taken as at rest.

    Examples
    --------
    >>> t = np.arange(0.0, 1.0, 0.02)
    >>> bool(np.allclose(remove_lag(t, 2.0 * (t - 0.1), 0.1, "alpha_vane"), 2.0 * t))
    True
    """
    time, x = np.asarray(time, float), np.array(x, float)
    if not lag or len(x) < 2:
        return x
    step = float(np.median(np.diff(time)))
    good = np.isfinite(x)
    parted = (np.diff(time) > GAP * step) | ~good[1:] | ~good[:-1]
    for part in np.split(np.arange(len(x)), np.flatnonzero(parted) + 1):
        if len(part) < 2:
            continue
        values = np.unwrap(x[part]) if name in ENDLESS else x[part]
        x[part] = values + lag * _slope(time[part], values) if lag > 0.0 else _behind(time[part], values, -lag, step)
    return x


def follow_command(
    time: np.ndarray,
    command: np.ndarray,
    lag: float = 0.0,
    rate_limit: float = math.inf,
    stops: tuple[float, float] = (-math.inf, math.inf),
) -> np.ndarray:
    """Return the position of an actuator that follows a command as a first-order lag, at most so fast and so far.

    Parameters
    ----------
    time, command : array (time,)
        Samples, at rising times; NaN stays NaN, and the actuator starts anew at rest behind it and behind a gap of the clock. [s], [any]
    lag : float
        Time constant. [s]
    rate_limit : float
        Highest rate of the position, in units of the command per second.
    stops : (low, high)
        Lowest and highest position.

    Returns
    -------
    array (time,)

    Notes
    -----
    Each step is that of the lag for a command linear between samples, cut at rate limit and stops: where the rate is reached inside a step,
    the position errs by a part of what the limit allows in that step.

    Examples
    --------
    >>> t = np.arange(0.0, 1.0, 0.02)
    >>> float(follow_command(t, np.where(t > 0.1, 1.0, 0.0), rate_limit=2.0)[-10].round(2))
    1.0
    """
    time, x = np.asarray(time, float), np.array(command, float)
    if len(x) < 2:
        return np.clip(x, *stops)
    (low, high), steps = stops, np.diff(time)
    usual = float(np.median(steps))
    weights = {float(step): lag_weights(lag, float(step))[0] for step in np.unique(steps)}
    y, before, found = math.nan, math.nan, np.empty(len(x))
    for k, u in enumerate(x.tolist()):
        step = float(steps[k - 1]) if k else usual
        if math.isnan(y) or math.isnan(u) or step > GAP * usual:
            y = min(max(u, low), high) if u == u else math.nan
        else:
            E, c0, c1 = weights[step]
            reach = rate_limit * step
            y = min(max(E * y + c0 * before + c1 * u, y - reach), y + reach)
            y = min(max(y, low), high)
        before, found[k] = u, y
    return found


def _slope(time: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return dx/dt from the slopes of both by the number of the sample."""
    if len(x) < WINDOW:
        return np.gradient(x, time)
    return derivative(x, 1.0) / derivative(time, 1.0)


def _behind(time: np.ndarray, x: np.ndarray, tau: float, step: float) -> np.ndarray:
    """Return the response of a first-order lag that starts at rest."""
    from scipy.signal import lfilter

    if np.ptp(np.diff(time)) > _EVEN * step:
        even = np.linspace(time[0], time[-1], max(round((time[-1] - time[0]) / step), 1) + 1)
        return np.interp(time, even, _behind(even, np.interp(even, time, x), tau, step))
    (E, c0, c1), _ = lag_weights(tau, float(time[-1] - time[0]) / (len(time) - 1))
    drive = c0 * x[:-1] + c1 * x[1:]
    return np.append(x[0], lfilter([1.0], [1.0, -E], drive, zi=[E * x[0]])[0])

"""Time delays between channels, first-order lags, and actuators that follow a command.

Cross-correlation gives a delay to one sample, the phase of the cross-spectrum to a fraction of a
sample.  A delay of 20 to 50 ms spoils damping derivatives, so that the estimate has a standard
error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flightmech.errors import IdentificationError
from flightmech.names import WRAPPED
from flightmech.short_text import ShortText
from flighttest.records.signals.differentiation import WINDOW, derivative
from flighttest.records.signals.resampling import GAP

COHERENT = 0.8
"""Squared coherence below which a frequency contains no information about the phase."""
# Neighbouring frequency lines averaged into one phase, for records of at least _LONG samples and
# for shorter ones.
_LINES, _FEW_LINES = 15, 7
_LONG = 1000
# Share of the strongest cross-spectrum below which filters and rounding dominate the motion.
_FAINT = 1e-3
# Share of the record that the taper changes, both ends together.
_TAPER = 0.2
# Factor by which the taper reduces the number of independent lines.
_TAPER_LOSS = 1.1
_SHORTEST = 256  # samples
# Largest squared coherence, so that its weight is finite.
_LARGEST_COHERENCE = 1.0 - 1e-9
# Scatter of the stamps of a uniform clock, in steps.
_EVEN = 1e-3
# Lag below which y = x - tau x' replaces the exact response, in steps.
_SHORT_LAG = 0.05


@dataclass(frozen=True)
class Delay(ShortText):
    """A delay between two channels.

    Attributes
    ----------
    estimate, stderr : float
        Positive if the second channel is later; see `bound` for an infinite standard error. [s]
    correlation : float
        Normalized cross-correlation at the delay; negative if the channels have opposite signs.
        [1]
    band : tuple of float
        Lowest and highest frequency that was coherent. [Hz]
    bound : bool
        Whether the largest correlation is at the end of the search.  The delay is then at least the
        estimate, without a standard error.
    """

    estimate: float
    stderr: float
    correlation: float
    band: tuple[float, float]
    bound: bool = False

    def report(self) -> str:
        """Return the estimate as a sentence."""
        low, high = self.band
        estimate = f"{1e3 * self.estimate:+.1f} ms"
        if self.bound:
            text = f"at least {estimate}"
        else:
            text = f"{estimate} (standard error {1e3 * self.stderr:.1f} ms)"
        return (
            f"{text}, correlation {self.correlation:+.3f}, coherent from {low:.2g} to {high:.2g} Hz"
        )


def time_delay(reference, delayed, step: float, longest: float = 1.0) -> Delay:
    """Return the delay of the channel `delayed` behind `reference`.

    Parameters
    ----------
    reference, delayed : array (time,)
        Two channels that should be proportional, on one uniform clock.  Factor, offset and sign are
        free. [any]
    step : float
        Sampling interval. [s]
    longest : float
        Largest delay of the search in both directions, at most a quarter of the record. [s]

    Returns
    -------
    Delay

    Raises
    ------
    IdentificationError
        Too few samples, a constant channel, or no coherent frequency.

    Notes
    -----
    The largest cross-correlation gives the delay to one sample, and the channel is shifted by it.
    The remainder follows from the phase phi of the cross-spectrum, averaged over 15 neighbouring
    lines (7 below 1000 samples)::

        tau = -sum(W w phi) / sum(W w^2),   W = coherence / (1 - coherence)

    The sums are over the averages with squared coherence above 0.8 and a thousandth of the
    strongest cross-spectrum; w is the angular frequency.  A phase averaged over n lines has the
    variance 1/(2 n W).  The code uses n - 2, because the estimate of W is n/(n - 2) too large in
    the mean.  The standard error is 1/sqrt(2 (n - 2) sum(W w^2)), or more if the phases scatter
    more about their line.  On simulated pairs of 12 to 180 s, 91 to 96 % of the estimates lie
    within two standard errors.
    """
    x, y = _detrend(reference), _detrend(delayed)
    _demand_motion(x, y)
    most = min(round(longest / step), len(x) // 4)
    shift, correlation = _best_shift(x, y, most)
    if shift >= 0:
        x, y = x[: len(x) - shift], y[shift:]
    else:
        x, y = x[-shift:], y[: len(y) + shift]
    remainder, stderr, band = _phase_delay(x, math.copysign(1.0, correlation) * y, step)
    # Beyond the end of the search the correlation may be larger.
    if abs(shift) == most:
        return Delay(shift * step, math.inf, correlation, band, bound=True)
    return Delay(shift * step + remainder, stderr, correlation, band)


def _demand_motion(x: np.ndarray, y: np.ndarray) -> None:
    """Raise if two channels without their lines are too short or constant."""
    if len(x) != len(y) or len(x) < _SHORTEST:
        raise IdentificationError(
            f"{len(x)} and {len(y)} samples; a delay needs two channels of the same "
            f"{_SHORTEST} samples or more"
        )
    if not (x.std() > 0.0 and y.std() > 0.0):
        raise IdentificationError(
            "a channel that does not move has no delay; choose a window with a manoeuvre"
        )


def _detrend(channel) -> np.ndarray:
    # reading a record finds no delay: SciPy's part takes half a second to import
    from scipy.signal import detrend

    return detrend(np.asarray(channel, float))


def _best_shift(x: np.ndarray, y: np.ndarray, most: int) -> tuple[int, float]:
    """Return the shift with the largest correlation [samples], and the correlation.

    The correlation is the value at the vertex of the parabola through the neighbours.
    """
    # Zero padding to twice the length makes the circular correlation a linear one.
    size = 1 << (2 * len(x)).bit_length()
    product = np.fft.irfft(np.conj(np.fft.rfft(x, size)) * np.fft.rfft(y, size), size)
    lags = np.arange(-most, most + 1)
    c = product[lags] / (len(x) * x.std() * y.std())
    i = int(np.argmax(np.abs(c)))
    peak = c[i]
    if 0 < i < len(c) - 1:
        curvature = c[i - 1] - 2.0 * c[i] + c[i + 1]
        if curvature != 0.0:
            peak = c[i] - (c[i + 1] - c[i - 1]) ** 2 / (8.0 * curvature)
    return int(lags[i]), float(np.clip(peak, -1.0, 1.0))


def _phase_delay(
    x: np.ndarray, y: np.ndarray, step: float
) -> tuple[float, float, tuple[float, float]]:
    """Return delay and standard error from the phase [s], and the coherent band [Hz].

    The formulas are in `time_delay`.
    """
    # reading a record finds no delay: SciPy's part takes half a second to import
    from scipy.signal.windows import tukey

    taper = tukey(len(x), _TAPER)
    X, Y = np.fft.rfft(taper * x)[1:], np.fft.rfft(taper * y)[1:]
    lines = _LINES if len(x) >= _LONG else _FEW_LINES
    cross = _average_lines(np.conj(X) * Y, lines)
    power_x = _average_lines(np.abs(X) ** 2, lines)
    power_y = _average_lines(np.abs(Y) ** 2, lines)
    f = _average_lines(np.fft.rfftfreq(len(x), step)[1:], lines)

    coherence = np.abs(cross) ** 2 / np.maximum(power_x * power_y, np.finfo(float).tiny)
    use = (coherence > COHERENT) & (np.abs(cross) > _FAINT * np.abs(cross).max())
    if not use.any():
        raise IdentificationError(
            f"the channels agree at no frequency (squared coherence below {COHERENT:g}): not "
            f"the same motion, or too little of it"
        )
    omega, phase = 2.0 * np.pi * f[use], np.angle(cross[use])
    coherence = np.minimum(coherence[use], _LARGEST_COHERENCE)
    weight = coherence / (1.0 - coherence)
    independent = lines / _TAPER_LOSS
    information = (weight * omega**2).sum()
    tau = float(-(weight * omega * phase).sum() / information)
    # The scatter of the phases about their line, over its expectation, may enlarge the error.
    variance = 1.0 / (2.0 * (independent - 2.0) * weight)
    scatter = ((phase + omega * tau) ** 2 / variance).sum() / max(len(phase) - 1, 1)
    stderr = math.sqrt(max(1.0, scatter) / (2.0 * (independent - 2.0) * information))
    return tau, stderr, (float(f[use][0]), float(f[use][-1]))


def _average_lines(spectrum: np.ndarray, lines: int) -> np.ndarray:
    """Return the means of neighbouring lines of a spectrum, without an incomplete last group."""
    length = len(spectrum) // lines * lines
    return spectrum[:length].reshape(-1, lines).mean(axis=1)


def lag_weights(tau: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the weights (E, c0, c1) of a first-order lag, and their derivatives by tau.

    The response is y_k+1 = E y_k + c0 x_k + c1 x_k+1 for an input that is linear between samples.

    Below a twentieth of a step, E = exp(-dt/tau) is zero and y = x - tau x'.  This also holds for a
    negative lag: a vane that is ahead of an inertial unit with a latency of its own.
    """
    s = tau / dt
    # A lag much shorter than the step only delays: the exponential is zero.
    if s < _SHORT_LAG:
        return np.array([0.0, s, 1.0 - s]), np.array([0.0, 1.0, -1.0]) / dt
    # Exact response to an input that is linear between samples: y1 = E y0 + c0 x0 + c1 x1.
    E, ds = np.exp(-1.0 / s), 1.0 / dt
    dE = E * dt / tau**2
    rise, d_rise = s * (1.0 - E), ds * (1.0 - E) - s * dE
    return np.array([E, rise - E, 1.0 - rise]), np.array([dE, d_rise - dE, -d_rise])


def remove_lag(time, x, lag: float, name: str) -> np.ndarray:
    """Return a channel without a known first-order lag, or with it if the lag is negative.

    Parameters
    ----------
    time, x : array (time,)
        Samples, at rising times.  NaN stays NaN.  The lag starts anew after a NaN and after a gap
        of the clock. [s], [any]
    lag : float
        Time constant by which the channel is behind the truth: a vane, a pressure line, a filter.
        A negative lag belongs to the system behind the channel: a recorded command becomes the
        position of an actuator that follows it with the time constant -lag. [s]
    name : str
        Name of the quantity; heading and longitude are unwrapped.

    Returns
    -------
    array (time,)

    Notes
    -----
    The lag is removed by x + lag dx/dt with the slope of local polynomials (`derivative`, in the
    order of samples, so that stamps may scatter).  White noise grows by sqrt(1 + (lag n)^2), with n
    of `derivative_noise`, 16.9/s at 50 Hz.  A negative lag is applied exactly for a channel that is
    linear between samples.  The first sample of each part is at rest.

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
    is_finite = np.isfinite(x)
    is_end = (np.diff(time) > GAP * step) | ~is_finite[1:] | ~is_finite[:-1]
    # Every stretch without a gap by itself.
    for part in np.split(np.arange(len(x)), np.flatnonzero(is_end) + 1):
        if len(part) < 2:
            continue
        values = x[part]
        if name in WRAPPED:
            values = np.unwrap(values)
        # Inverse of the lag: x = y + lag dy/dt.
        if lag > 0.0:
            x[part] = values + lag * _slope(time[part], values)
        else:
            x[part] = _lag_response(time[part], values, -lag, step)
    return x


def follow_command(
    time: np.ndarray,
    command: np.ndarray,
    lag: float = 0.0,
    rate_limit: float = math.inf,
    stops: tuple[float, float] = (-math.inf, math.inf),
) -> np.ndarray:
    """Return the position of an actuator that follows a command as a first-order lag.

    Its rate and its position are limited.

    Parameters
    ----------
    time, command : array (time,)
        Samples, at rising times.  After a NaN, which stays NaN, and after a gap of the clock the
        actuator starts anew at rest. [s], [any]
    lag : float
        Time constant. [s]
    rate_limit : float
        Highest rate of the position. [unit of the command per second]
    stops : (low, high)
        Limits of the position.

    Returns
    -------
    array (time,)

    Notes
    -----
    Each step is exact for a command that is linear between samples, and then limited.  If the rate
    limit is reached inside a step, the error is a part of the limited step.

    Examples
    --------
    >>> t = np.arange(0.0, 1.0, 0.02)
    >>> float(follow_command(t, np.where(t > 0.1, 1.0, 0.0), rate_limit=2.0)[-10].round(2))
    1.0
    """
    time, x = np.asarray(time, float), np.array(command, float)
    if len(x) < 2:
        return np.clip(x, *stops)
    steps = np.diff(time)
    usual_step = float(np.median(steps))
    weights = {float(step): lag_weights(lag, float(step))[0] for step in np.unique(steps)}
    position = np.empty(len(x))
    y, previous = math.nan, math.nan
    for k, u in enumerate(x.tolist()):
        step = float(steps[k - 1]) if k else usual_step
        if math.isnan(u):
            y = math.nan
        elif math.isnan(y) or step > GAP * usual_step:
            # The actuator starts at rest at the command.
            y = _clip(u, *stops)
        else:
            E, c0, c1 = weights[step]
            reach = rate_limit * step
            y = _clip(E * y + c0 * previous + c1 * u, y - reach, y + reach)
            y = _clip(y, *stops)
        previous, position[k] = u, y
    return position


def _clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


def _slope(time: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return dx/dt as the ratio of the slopes of x and time by the number of the sample."""
    if len(x) < WINDOW:
        return np.gradient(x, time)
    return derivative(x, 1.0) / derivative(time, 1.0)


def _lag_response(time: np.ndarray, x: np.ndarray, tau: float, step: float) -> np.ndarray:
    """Return the response of a first-order lag that starts at rest."""
    # reading a record finds no delay: SciPy's part takes half a second to import
    from scipy.signal import lfilter

    # The filter needs a uniform clock.
    if np.ptp(np.diff(time)) > _EVEN * step:
        count = max(round((time[-1] - time[0]) / step), 1) + 1
        even = np.linspace(time[0], time[-1], count)
        response = _lag_response(even, np.interp(even, time, x), tau, step)
        return np.interp(time, even, response)
    (E, c0, c1), _ = lag_weights(tau, float(time[-1] - time[0]) / (len(time) - 1))
    drive = c0 * x[:-1] + c1 * x[1:]
    return np.append(x[0], lfilter([1.0], [1.0, -E], drive, zi=[E * x[0]])[0])

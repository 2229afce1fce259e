"""Time delay between two channels: cross-correlation finds it to a sample, the phase in frequency
to a fraction of one.

A delay of 20 to 50 ms spoils damping derivatives, so the estimate comes with its standard error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flightmech.errors import IdentificationError
from flighttest.records.signals.conditioning import GAP
from flighttest.records.signals.differentiation import WINDOW, derivative
from flighttest.records.signals.sample_flags import ENDLESS

COHERENT = 0.8  # squared coherence below which a frequency contains no information about the phase
_LINES, _FEW_LINES = (
    15,
    7,
)  # neighbouring frequency lines averaged into one phase, of long and of short records
_LONG = 1000  # samples
# of the strongest cross-spectrum, below which filters and rounding speak and not the motion
_FAINT = 1e-3
_TAPER = 0.2  # part of the record that the taper touches, both ends together
_TAPER_LOSS = 1.1  # by which the taper correlates neighbouring lines
_SHORTEST = 256  # samples


@dataclass(frozen=True)
class Delay:
    """A delay between two channels.

    Attributes
    ----------
    estimate, stderr : float
        Positive when the second channel comes later; see `bound` for an infinite standard error.
        [s]
    correlation : float
        Normalized cross-correlation at the delay; negative when the channels have opposite signs.
        [1]
    band : tuple of float
        Lowest and highest frequency that was coherent. [Hz]
    bound : bool
        Whether the largest correlation lies at the end of the search: the delay is at least the
        estimate, and has no standard error.
    """

    estimate: float
    stderr: float
    correlation: float
    band: tuple[float, float]
    bound: bool = False

    def report(self) -> str:
        """Return the estimate in words."""
        low, high = self.band
        measured = f"{1e3 * self.estimate:+.1f} ms"
        return (
            f"{f'at least {measured}' if self.bound else f'{measured} (standard error {1e3 * self.stderr:.1f} ms)'}, "
            f"correlation {self.correlation:+.3f}, coherent from {low:.2g} to {high:.2g} Hz"
        )


def time_delay(reference, delayed, step: float, longest: float = 1.0) -> Delay:
    """Return how much later `delayed` shows what `reference` shows.

    Parameters
    ----------
    reference, delayed : array (time,)
        Two channels that should be proportional, on one uniform clock; factor, offset and sign are
        free. [any]
    step : float
        Sampling interval. [s]
    longest : float
        Largest delay to look for, either way; at most a quarter of the record is. [s]

    Returns
    -------
    Delay

    Raises
    ------
    IdentificationError
        Too few samples, a channel that does not move, or no frequency at which the two agree.

    Notes
    -----
    The largest cross-correlation gives the delay to a sample; the channel is moved by it.  The remainder follows from the phase of the
    cross-spectrum, averaged over 15 neighbouring lines (7 below 1000 samples): tau = -sum(W w phi)/sum(W w^2) over the averages
    with squared coherence above 0.8 and a thousandth of the strongest cross-spectrum, W = coherence/(1 - coherence).  A phase
    averaged over n lines has the variance 1/(2 n W); n - 2 is used because the estimate of W is n/(n - 2) too large in the mean.
    The standard error is 1/sqrt(2 (n - 2) sum(W w^2)), or more where the phases scatter more about their line.  On simulated
    pairs of 12 to 180 s 91 to 96 % of the estimates lie within
    two standard errors.
    """
    x, y = (_detrended(channel) for channel in (reference, delayed))
    if len(x) != len(y) or len(x) < _SHORTEST:
        raise IdentificationError(
            f"{len(x)} and {len(y)} samples; a delay needs two channels of the same "
            f"{_SHORTEST} samples or more"
        )
    if not (x.std() > 0.0 and y.std() > 0.0):
        raise IdentificationError(
            "a channel that does not move has no delay; choose a window with a manoeuvre"
        )
    most = min(round(longest / step), len(x) // 4)
    shift, correlation = _correlated(x, y, most)
    moved = x[: len(x) - shift] if shift >= 0 else x[-shift:]
    seen = y[shift:] if shift >= 0 else y[: len(y) + shift]
    fine, stderr, band = _phase(moved, math.copysign(1.0, correlation) * seen, step)
    if abs(shift) == most:  # beyond the end the correlation may be larger
        return Delay(shift * step, math.inf, correlation, band, bound=True)
    return Delay(shift * step + fine, stderr, correlation, band)


def _detrended(channel) -> np.ndarray:
    # reading a record finds no delay: SciPy's part takes half a second to import
    from scipy.signal import detrend

    return detrend(np.asarray(channel, float))


def _correlated(x: np.ndarray, y: np.ndarray, most: int) -> tuple[int, float]:
    """Return the shift in whole samples with the largest correlation, and the correlation at the
    top of the parabola.
    """
    size = 1 << (2 * len(x)).bit_length()
    product = np.fft.irfft(np.conj(np.fft.rfft(x, size)) * np.fft.rfft(y, size), size)
    lags = np.arange(-most, most + 1)
    c = product[lags] / (len(x) * x.std() * y.std())
    at = int(np.argmax(np.abs(c)))
    top = c[at]
    if 0 < at < len(c) - 1 and (bend := c[at - 1] - 2.0 * c[at] + c[at + 1]) != 0.0:
        top = c[at] - (c[at + 1] - c[at - 1]) ** 2 / (8.0 * bend)
    return int(lags[at]), float(np.clip(top, -1.0, 1.0))


def _phase(x: np.ndarray, y: np.ndarray, step: float) -> tuple[float, float, tuple[float, float]]:
    # reading a record finds no delay: SciPy's part takes half a second to import
    from scipy.signal.windows import tukey

    taper = tukey(len(x), _TAPER)
    X, Y = (np.fft.rfft(taper * channel)[1:] for channel in (x, y))
    f = np.fft.rfftfreq(len(x), step)[1:]
    lines = _LINES if len(x) >= _LONG else _FEW_LINES
    whole = len(f) // lines * lines
    cross, power_x, power_y, f = (
        block[:whole].reshape(-1, lines).mean(axis=1)
        for block in (np.conj(X) * Y, np.abs(X) ** 2, np.abs(Y) ** 2, f)
    )
    squared = np.abs(cross) ** 2 / np.maximum(power_x * power_y, np.finfo(float).tiny)
    use = (squared > COHERENT) & (np.abs(cross) > _FAINT * np.abs(cross).max())
    if not use.any():
        raise IdentificationError(
            f"the channels agree at no frequency (squared coherence below {COHERENT:g}): not "
            f"the same motion, or too little of it"
        )
    omega, phase = 2.0 * np.pi * f[use], np.angle(cross[use])
    clipped = np.minimum(squared[use], 1.0 - 1e-9)
    weight = clipped / (1.0 - clipped)
    independent = lines / _TAPER_LOSS
    information = (weight * omega**2).sum()
    tau = float(-(weight * omega * phase).sum() / information)
    variance = 1.0 / (2.0 * (independent - 2.0) * weight)
    scatter = ((phase + omega * tau) ** 2 / variance).sum() / max(len(phase) - 1, 1)
    stderr = math.sqrt(max(1.0, scatter) / (2.0 * (independent - 2.0) * information))
    return tau, stderr, (float(f[use][0]), float(f[use][-1]))


_EVEN = 1e-3  # of the step: scatter of the stamps up to which the clock is taken as uniform


def lag_weights(tau: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (E, c0, c1) of y_k+1 = E y_k + c0 x_k + c1 x_k+1, a first-order lag of an input linear
    between samples, and d/dtau.

    Below a twentieth of a step, E = exp(-dt/tau) is nothing and y = x - tau x', which holds for a
    negative lag too: a vane that is ahead of an inertial unit with a latency of its own.
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
        Samples, at rising times; NaN stays NaN, and the lag starts anew behind it and behind a gap
        of the clock. [s], [any]
    lag : float
        Time constant by which the channel is behind the truth: a vane, a pressure line, a filter.
        A negative one is that of what follows the channel: a recorded command becomes the position
        of an actuator that follows it with the time constant -lag. [s]
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
        x[part] = (
            values + lag * _slope(time[part], values)
            if lag > 0.0
            else _behind(time[part], values, -lag, step)
        )
    return x


def follow_command(
    time: np.ndarray,
    command: np.ndarray,
    lag: float = 0.0,
    rate_limit: float = math.inf,
    stops: tuple[float, float] = (-math.inf, math.inf),
) -> np.ndarray:
    """Return the position of an actuator that follows a command as a first-order lag, at most so
    fast and so far.

    Parameters
    ----------
    time, command : array (time,)
        Samples, at rising times; NaN stays NaN, and the actuator starts anew at rest behind it and
        behind a gap of the clock. [s], [any]
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
    # reading a record finds no delay: SciPy's part takes half a second to import
    from scipy.signal import lfilter

    if np.ptp(np.diff(time)) > _EVEN * step:
        even = np.linspace(time[0], time[-1], max(round((time[-1] - time[0]) / step), 1) + 1)
        return np.interp(time, even, _behind(even, np.interp(even, time, x), tau, step))
    (E, c0, c1), _ = lag_weights(tau, float(time[-1] - time[0]) / (len(time) - 1))
    drive = c0 * x[:-1] + c1 * x[1:]
    return np.append(x[0], lfilter([1.0], [1.0, -E], drive, zi=[E * x[0]])[0])

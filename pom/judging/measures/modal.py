"""Modal measures by fit: period, time to half, damping ratio, and the lag between bank and
sideslip.

The free response is fitted by y = b + c t + exp(-sigma t) (A cos wd t + B sin wd t), least squares,
with b, c, A, B eliminated at every (sigma, wd) [GolubPereyra1973].  Picking raw extremes is
fragile: it needs one noisy sample to lose a period.

References
----------
.. [GolubPereyra1973] G. H. Golub, V. Pereyra, The differentiation of pseudo-inverses and nonlinear least squares problems whose
   variables separate, SIAM J. Numer. Anal. 10(2), 1973, pp. 413-432.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import pandas as pd
import scipy

from flightmech.support.arrays import rms
from flightmech.units import DEGREE
from pom.judging.signals import Comparison, trace_of
from pom.result import PomResult
from pom.tolerances.bands import (
    Invalid,
    Judgement,
    RowRemark,
    demand_finite,
    half_width,
    inside_window,
    judge_number,
)
from pom.tolerances.channels import WRAPPED, plain_id
from pom.tolerances.criteria import Criterion

MINIMUM_CYCLES = {"2.c.9": 3.0, "2.d.7": 6.0}
"""Full cycles that the table requires; time to half or double in the record will do instead."""

LEAST_AMPLITUDE = 0.1  # of the flight's, for a mode to count as excited
PHUGOID = "2.c.9"
BANKED = 10.0 * DEGREE
"""Bank of a model off the flight's above which its phugoid is no motion of the plane of symmetry: lift 1.5 % above weight."""
_MEASURES = ("period", "t_half", "damping_ratio")
_FITTED = (*_MEASURES, "cycles", "amplitude", "residual_rms")
_MOVED, _MOST_MOVED = (
    1.0 / 3.0,
    0.25,
)  # of the period, and of the window at most: by so much its ends are moved to see whether it matters
_LEAST_SAMPLES = 7  # one more than the numbers of a mode
_COARSE = 250  # samples kept for the search of a start point
_RATIOS = (-0.1, 0.0, 0.1, 0.3, 0.7)  # sigma / wd of the search


@dataclass(frozen=True)
class DampedSine:
    """A damped sine: y = offset + slope t + amplitude exp(-sigma t) cos(wd t + phase), t from the
    first sample.
    """

    sigma: float
    wd: float
    amplitude: float
    phase: float
    offset: float
    slope: float
    residual_rms: float
    duration: float

    @property
    def period(self) -> float:
        """Time of one cycle, 2 pi / wd. [s]"""
        return 2.0 * math.pi / self.wd

    @property
    def damping_ratio(self) -> float:
        """Negative for a growing oscillation."""
        return self.sigma / math.hypot(self.sigma, self.wd)

    @property
    def t_half(self) -> float:
        """Time to half the amplitude; negative: time to double. [s]"""
        return math.log(2.0) / self.sigma if self.sigma else math.inf

    @property
    def cycles(self) -> float:
        """Full cycles in the record."""
        return self.duration / self.period


def fit_mode(time, y) -> DampedSine:
    """Fit one damped sine with a linear trend to a free response.

    Parameters
    ----------
    time : array (time,)
        Rising. [s]
    y : array (time,)
        Free response, from the end of the input on.

    Returns
    -------
    Mode

    Raises
    ------
    Invalid
        Fewer samples than a mode needs, one that is no number, or no oscillation stands out: less
        than half a cycle in the record, or an amplitude below twice the residual.
    """
    if len(time) < _LEAST_SAMPLES:
        raise Invalid(f"{len(time)} samples; a mode needs {_LEAST_SAMPLES} at least")
    t, y = np.asarray(time, float) - float(time[0]), np.asarray(y, float)
    demand_finite("the trace", t + float(time[0]), y)
    every = max(len(t) // _COARSE, 1)
    start = _search(t[::every], y[::every])
    if every > 1:
        start = _settled(t[::every], y[::every], start, 1e-4)
    sigma, wd = _settled(t, y, start, 1e-12)
    found = _project(t, y, sigma, wd)
    (b, c, A, B), rest = found.theta, found.rest
    mode = DampedSine(sigma, wd, math.hypot(A, B), math.atan2(-B, A), b, c, rms(rest), float(t[-1]))
    if mode.cycles < 0.5:
        raise Invalid(
            f"no oscillation: the fit finds {mode.cycles:.2f} of a cycle in {mode.duration:.1f} s"
        )
    if mode.amplitude < 2.0 * mode.residual_rms:
        raise Invalid(
            f"no oscillation stands out: amplitude {mode.amplitude:.3g}, residual "
            f"{mode.residual_rms:.3g}"
        )
    return mode


@dataclass(frozen=True)
class _Projection:
    """A trace projected on the regressors 1, t, exp(-sigma t) cos wd t, exp(-sigma t) sin wd t at
    given (sigma, wd).

    Attributes
    ----------
    t, X : array (time,), (time, 4)
        Time and regressors.
    Q, R : array (time, 4), (4, 4)
        Factors of X.
    theta : array (4,)
        Linear parameters b, c, A, B.
    rest : array (time,)
        Residual.
    """

    t: np.ndarray
    X: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    theta: np.ndarray
    rest: np.ndarray

    @cached_property
    def jacobian(self) -> np.ndarray:
        """Derivative of the residual by (sigma, wd) (time, 2), the linear parameters following
        [GolubPereyra1973, eq. (4.8)].
        """
        t, (cosine, sine), (A, B) = self.t, self.X.T[2:], self.theta[2:]
        moved = np.empty((2, t.size))
        np.multiply(t, -A * cosine - B * sine, out=moved[0])
        np.multiply(t, B * cosine - A * sine, out=moved[1])
        scaled = t * self.rest
        c, s = float(cosine @ scaled), float(sine @ scaled)
        turned, _ = scipy.linalg.lapack.dtrtrs(
            self.R, np.array([[0.0, 0.0], [0.0, 0.0], [-c, -s], [-s, c]]), trans=1
        )
        return self.Q @ (self.Q.T @ moved.T - turned) - moved.T


def _project(t: np.ndarray, y: np.ndarray, sigma: float, wd: float) -> _Projection:
    """Return the projection of a trace at (sigma, wd); by LAPACK itself, whose callers in numpy
    take as long as the work.
    """
    X = np.empty((4, t.size))
    X[0], X[1] = 1.0, t
    decay = np.exp(-sigma * t if abs(sigma * t[-1]) < 50.0 else -np.clip(sigma * t, -50.0, 50.0))
    angle = wd * t
    np.multiply(decay, np.cos(angle), out=X[2])
    np.multiply(decay, np.sin(angle), out=X[3])
    factors, tau, _, _ = scipy.linalg.lapack.dgeqrf(X.T)
    Q, _, _ = scipy.linalg.lapack.dorgqr(factors, tau)
    R = factors[:4]
    share = Q.T @ y
    theta, singular = scipy.linalg.lapack.dtrtrs(R, share)
    if singular:
        raise np.linalg.LinAlgError("Singular matrix")
    return _Projection(t, X.T, Q, R, theta, y - Q @ share)


def _settled(
    t: np.ndarray, y: np.ndarray, start: tuple[float, float], tolerance: float
) -> tuple[float, float]:
    """Return (sigma, wd) of least squares to a relative tolerance, from a start point."""
    scaled = y / (float(np.ptp(y)) or 1.0)
    at = lru_cache(maxsize=2)(
        lambda sigma, wd: _project(t, scaled, sigma, wd)
    )  # residual and derivative come one after the other
    # MINPACK itself: its caller `scipy.optimize.least_squares` takes a fifth of the time of a fit
    # of so few numbers
    (sigma, wd), *_ = scipy.optimize.leastsq(
        lambda x: at(*x.tolist()).rest,
        start,
        Dfun=lambda x: at(*x.tolist()).jacobian,
        diag=(1.0 / start[1], 1.0 / start[1]),
        xtol=tolerance,
        ftol=tolerance,
        gtol=tolerance,
        maxfev=200,
        full_output=True,  # how it ended is judged by what it found
    )
    return float(sigma), abs(float(wd))


def _search(t: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Return (sigma, wd) of the best point on a grid from half a cycle in the record to eight
    samples a cycle.
    """
    sigma, wd, across = _grid(t.tobytes())
    share = (across @ y).reshape(4, -1)
    best = int(np.argmax(np.einsum("ik,ik->k", share, share)))  # largest share explained
    return float(sigma[best]), float(wd[best])


@lru_cache(maxsize=8)
def _grid(times: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return sigma, wd and orthonormal regressors (4 of every point, time) on the grid of a search
    over samples `times`.
    """
    t = np.frombuffer(times)
    fastest = max(2.0 * math.pi / (8.0 * float(np.median(np.diff(t)))), 4.0 * math.pi / t[-1])
    wd, ratio = (
        x.ravel() for x in np.meshgrid(np.geomspace(math.pi / t[-1], fastest, 60), _RATIOS)
    )
    decay, angle = np.exp(-np.clip(np.outer(ratio * wd, t), -50.0, 50.0)), np.outer(wd, t)
    level = np.ones_like(angle)
    X = np.stack([level, level * t / t[-1], decay * np.cos(angle), decay * np.sin(angle)], axis=2)
    X /= np.linalg.norm(X, axis=1, keepdims=True)
    return ratio * wd, wd, np.linalg.qr(X)[0].transpose(2, 0, 1).reshape(4 * len(wd), len(t))


def judge_mode(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge period, time to half or damping ratio of the free response.

    A model that does not oscillate where the flight does, or with less than a tenth of its
    amplitude, fails: it was not excited, and the mode of its rounding errors proves nothing.  A
    time to half on one side and to double on the other is a failure whatever the width: at a
    damping ratio of 0.01 the tolerance of 0.02 would pass an unstable model.
    """
    t, flight, model = _smooth(criterion.channel, match.both(criterion))
    f = _fit("flight", t, flight)
    required = MINIMUM_CYCLES.get(plain_id(match.case.id), 0.0)
    if f.cycles < required and abs(f.t_half) > f.duration:
        raise Invalid(
            f"{f.cycles:.1f} cycles and less than the time to half ({f.t_half:.0f} s) in "
            f"{f.duration:.0f} s; "
            f"the table requires {required:g} cycles or the time to half"
        )
    value = getattr(f, criterion.measure)
    try:
        s = _excited(_fit("the model", t, model), f)
    except Invalid as error:
        return Judgement(
            "fail",
            at=float(t[0]),
            remarks=(_values(criterion.measure, f), RowRemark("no_mode", str(error))),
            flight=value,
        )
    cycles = RowRemark("cycles", f"{f.cycles:.1f} cycles", values={"flight": f.cycles}, unit="1")
    remarks = (
        _values(criterion.measure, f, s),
        cycles,
        *_window_remarks(criterion, value, t, flight),
        *_banked(criterion, match),
    )
    outcome = judge_number(criterion, value, getattr(s, criterion.measure), float(t[0]), remarks)
    if criterion.measure != "period" and f.sigma * s.sigma < 0.0:
        return replace(
            outcome, verdict="fail", remarks=(*remarks, RowRemark("stability", "stability differs"))
        )
    return outcome


def _banked(criterion: Criterion, match: Comparison) -> tuple[RowRemark, ...]:
    """Return a remark on a phugoid that a model flies in a turn; none where it does not, or its
    bank is not known.
    """
    if plain_id(match.case.id) != PHUGOID or not all(
        "phi" in side for side in (match.flight, match.model)
    ):
        return ()
    off = np.abs(np.angle(np.exp(1j * (match.model["phi"] - match.flight["phi"]))))[
        inside_window(match.time, criterion.window)
    ]
    off = float(np.fmax.reduce(off))  # gaps in a recorded bank do not matter
    if not off > BANKED:
        return ()
    text = (
        f"bank of the model up to {off / DEGREE:.0f} deg off the flight's, a turn and no "
        f"phugoid: let a math pilot hold the wings"
    )
    return (
        RowRemark("bank", text, "phi", {"largest": off / DEGREE, "limit": BANKED / DEGREE}, "deg"),
    )


def _window_remarks(
    criterion: Criterion, value: float, time: np.ndarray, flight: np.ndarray
) -> tuple[RowRemark, ...]:
    """Return a remark where the figure of the flight is one of its window: a shorter one moves it
    by more than the tolerance.

    The verdict stays: the flight is what the model is compared with, in the window of the case.
    """
    limit = float(half_width(criterion, value)[0])
    moved = [
        (getattr(mode, criterion.measure), start, stop)
        for start, stop, mode in _shortened(time.tobytes(), flight.tobytes())
    ]
    if not moved or not limit > 0.0:
        return ()
    other, start, stop = max(moved, key=lambda one: abs(one[0] - value))
    if not abs(other - value) > limit:
        return ()
    unit = "1" if criterion.measure == "damping_ratio" else "s"
    text = (
        f"the flight depends on the window: {criterion.measure.replace('_', ' ')} "
        f"{value:.4g} in the window of the case, {other:.4g} in "
        f"{start:.1f} ... {stop:.1f} s, which is more than the tolerance ({limit:.3g}); "
        f"choose a window in which the mode is alone"
    )
    return (
        RowRemark(
            "window",
            text,
            criterion.measure,
            {"flight": value, "moved": other, "limit": limit},
            unit,
        ),
    )


@lru_cache(maxsize=64)
def _shortened(times: bytes, samples: bytes) -> tuple[tuple[float, float, DampedSine], ...]:
    """Return the modes of a flight in windows whose start or end is moved inwards by a third of the
    period.
    """
    time, y = np.frombuffer(times), np.frombuffer(samples)
    whole = _remembered(times, samples)
    if isinstance(whole, str):
        return ()
    off = min(_MOVED * whole.period, _MOST_MOVED * whole.duration)
    found = []
    for start, stop in ((time[0] + off, time[-1]), (time[0], time[-1] - off)):
        inside = (time >= start) & (time <= stop)
        try:
            found.append((float(start), float(stop), fit_mode(time[inside], y[inside])))
        except Invalid:
            continue
    return tuple(found)


def _excited(model: DampedSine, flight: DampedSine) -> DampedSine:
    """Return the mode of a model that moves enough to be compared."""
    share = model.amplitude / flight.amplitude
    if share < LEAST_AMPLITUDE:
        raise Invalid(f"the model hardly oscillates: {share:.2g} of the amplitude of the flight")
    return model


def _values(measure: str, flight: DampedSine, model: DampedSine | None = None) -> RowRemark:
    """Return what a mode measures in flight and, where it has one, in the model."""
    modes = {"flight": flight} if model is None else {"flight": flight, "model": model}
    text = ", ".join(f"{who} {_text(measure, mode)}" for who, mode in modes.items())
    values = {who: float(getattr(mode, measure)) for who, mode in modes.items()}
    return RowRemark("values", text, measure, values, "1" if measure == "damping_ratio" else "s")


def _text(measure: str, mode: DampedSine) -> str:
    if measure == "damping_ratio":
        return f"zeta {mode.damping_ratio:.4f}"
    value = getattr(mode, measure)
    return f"{abs(value):.2f} s{' to double' if value < 0.0 else ''}"


@lru_cache(maxsize=256)
def _remembered(time: bytes, y: bytes) -> DampedSine | str:
    """Fit once what period, damping and time to half need, and what every model of a case is
    compared with; or why there is no mode.
    """
    try:
        return fit_mode(np.frombuffer(time), np.frombuffer(y))
    except Invalid as error:
        return str(error)


def _fit(who: str, time: np.ndarray, y: np.ndarray) -> DampedSine:
    found = _remembered(time.tobytes(), y.tobytes())
    if isinstance(found, str):
        raise Invalid(f"{who}: {found}")
    return found


def _smooth(
    channel: str, found: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time and both traces, angles without the jumps of a full turn: a model that rolls over
    is judged as it is stored.
    """
    time, flight, model = found
    return (time, np.unwrap(flight), np.unwrap(model)) if channel in WRAPPED else found


def peak_lag(criterion: Criterion, match: Comparison) -> Judgement:
    """Judge the time from a bank peak to the nearest sideslip peak, from the phases of the fitted
    mode.
    """
    t, flight_bank, model_bank = _smooth("phi", match.both(criterion, "phi"))
    _, flight_slip, model_slip = match.both(criterion, "beta")
    mode = _fit("flight", t, flight_slip)
    lag = _lag(mode, t, flight_bank)
    try:
        own = _lag(_excited(_fit("the model", t, model_slip), mode), t, model_bank)
    except Invalid as error:
        return Judgement(
            "fail",
            at=float(t[0]),
            remarks=(
                RowRemark("values", f"flight {lag:.2f} s", "lag", {"flight": lag}, "s"),
                RowRemark("no_mode", str(error)),
            ),
            flight=lag,
        )
    own -= mode.period * round(
        (own - lag) / mode.period
    )  # the same peak of the next cycle is no difference
    text = f"flight {lag:.2f} s, model {own:.2f} s"
    if half_width(criterion, lag)[0] <= 0.0:
        raise Invalid(f"the tolerance is zero wide; {text}")
    return judge_number(
        criterion,
        lag,
        own,
        float(t[0]),
        (RowRemark("values", text, "lag", {"flight": lag, "model": own}, "s"),),
    )


def _lag(sideslip: DampedSine, time: np.ndarray, bank: np.ndarray) -> float:
    """Return (phase of bank - phase of sideslip) / wd, within half a period. [s]"""
    _, _, A, B = _project(time - time[0], bank, sideslip.sigma, sideslip.wd).theta
    angle = math.remainder(math.atan2(-B, A) - sideslip.phase, 2.0 * math.pi)
    return angle / sideslip.wd


MODE_COLUMNS = ("run", "channel", "window_start", "window_stop", *_FITTED, "lag", "note")


def mode_table(result: PomResult) -> pd.DataFrame:
    """Return the modes of flight and models that the modal criteria of a case were judged by.

    Parameters
    ----------
    result : PomResult

    Returns
    -------
    DataFrame
        Columns `MODE_COLUMNS`, one row per fitted channel, window and run, flight first: ``period
        t_half`` [s], ``damping_ratio``, ``cycles`` in the window, ``amplitude residual_rms`` [SI],
        ``lag`` of bank behind sideslip [s] on the rows of ``beta`` where that is judged; NaN and a
        ``note`` where no mode could be fitted.
    """
    return result.once(_mode_table)


def keep_modes(result: PomResult, rows: Sequence[Mapping[str, Any]]) -> None:
    """Have `mode_table` of a result give these rows, made of the very same result before."""
    result.keep(_mode_table, _table(rows))


def _mode_table(result: PomResult) -> pd.DataFrame:
    fitted: dict[tuple[str, tuple[float, float]], bool] = {}
    for criterion in result.case.criteria:
        lags = criterion.measure == "peak_lag"
        channel = "beta" if lags else criterion.channel
        if (
            criterion.applies
            and (lags or criterion.measure in _MEASURES)
            and {channel, "phi" if lags else channel} <= set(result.signals)
        ):
            fitted[channel, criterion.window] = (
                fitted.get((channel, criterion.window), False) or lags
            )
    rows = [
        _mode_row(result, str(run), *key, lags)
        for key, lags in fitted.items()
        for run in result.signals["run"].values
    ]
    return _table(rows)


def _table(rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=list(MODE_COLUMNS))


def _mode_row(
    result: PomResult, run: str, channel: str, window: tuple[float, float], lags: bool
) -> dict[str, object]:
    mask = inside_window(result.signals["time"].values, window)
    time = result.signals["time"].values[mask]

    def samples(who: str, name: str) -> np.ndarray:
        return trace_of(result.signals, who, name)[mask]

    row: dict[str, object] = {
        "run": run,
        "channel": channel,
        "window_start": window[0],
        "window_stop": window[1],
        "note": "",
    }
    try:
        demand_finite(run, time, samples(run, channel))
        mode = _fit(run, time, samples(run, channel))
        if run != "flight":
            mode = _excited(mode, _fit("flight", time, samples("flight", channel)))
        lag = _lag(mode, time, samples(run, "phi")) if lags else math.nan
    except Invalid as error:
        return {**row, "note": str(error).removeprefix(f"{run}: ")}
    return {**row, **{name: getattr(mode, name) for name in _FITTED}, "lag": lag}

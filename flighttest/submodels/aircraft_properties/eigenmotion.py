"""Eigenmotions read from recorded responses: period, damping and time constants by fit, with
standard errors.

A channel of a linear system in one of its modes, lambda = -sigma + j omega, is

    y = b + c t + Re[(A + sum_i B_i int exp(-lambda s) u_i ds) exp(lambda t)]

with the inputs u_i linear between samples.  For given lambda it is linear in all the rest, which is
eliminated [Golub]; what is solved for are the one or two numbers of lambda, common to all channels.
Without inputs it is the free response; a mode that is only seen while a control moves (roll, short
period) is fitted with that control as input.

Valid where one mode carries the channel: faster and slower ones must have died out or be small, and
the model must not leave the range in which it is linear.  The standard errors are those of
residuals correlated in time and hold what else moves the channel.

References
----------
.. [Golub] Golub, Pereyra, The differentiation of pseudo-inverses and nonlinear least squares problems whose variables separate,
   SIAM J. Numer. Anal. 10, 1973.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy import stats
from scipy.optimize import least_squares
from scipy.signal import lfilter

from flightmech.errors import IdentificationError, SchemaError, UnknownName
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of
from flighttest.regression.uncertainty.significance import degrees_of_freedom
from flighttest.remarks import Convergence, Remark, is_forbidden, remark_lines
from flighttest.submodels.aircraft_properties.moved_windows import (
    SHIFT,
    MovedWindow,
    fits_in_moved_windows,
)

KINDS = ("oscillation", "aperiodic")
LEAST_CYCLES = 0.5
LEAST_SHARE = 0.5  # of the variance about a straight line that the mode must explain
PURE = 0.85  # and below which it is not alone: the rest is as large as two fifths of the motion
# probability of F above which a motion is no better than noise; the frequency was searched for, so
# one in a thousand
EXCITED = 1e-3
# damping ratio of a free oscillation below which it doubles within about a cycle: no aeroplane is
# flown so
GROWING = -0.1
KNOWN = 0.2  # relative standard error of the frequency up to which a motion is known
MOVES = 1e-4  # range below which an input or a channel does not move [SI: 0.006 deg, 0.1 mm/s]
_COARSE = 300  # samples kept for the search of a start
_RATIOS = (-0.1, 0.0, 0.1, 0.3, 0.7)  # sigma / omega of the search
_ROUNDS = 2  # of weighing the channels by their residuals
_EVALUATIONS = 100  # largest number of evaluations of a search, for each unknown of the root
# Change of the root by a further round at which the weights have converged, and above which no
# figure may be used. [standard errors]
_SAME, _WRONG = 0.5, 1.0
_RELATIVE = 1e-6  # smallest tolerance of the root, over its magnitude


@dataclass(frozen=True)
class Motion:
    """One mode as a record shows it.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    sigma, omega : float
        Decay, positive when stable [1/s]; damped frequency, 0 when aperiodic [rad/s].
    covariance : array (2, 2)
        Of sigma and omega, residuals as they are coloured.
    channels : tuple of str
    share : float
        Part of the variance of the channels about straight lines that the fit explains.
    residual_rms : dict of str to float
        Per channel. [SI]
    time, fitted, measured : array (time,), dict of array (time,)
        For a figure. [s], [SI]
    F, F_terms, F_dof, F_probability : float, int, float, float
        Wald's statistic of the amplitudes of the motion, per amplitude, with residuals as they are
        coloured; next to an oscillation a cubic drift is allowed, so that a slow curve is not taken
        for one.  Its degrees of freedom, and the probability of more by chance.
    moved : tuple of MovedWindow
        The fit of an oscillation in shorter windows; an error among the remarks where they do not
        agree with it.
    convergence : Convergence
        End of the search and of its rounds of weights. Its change is that of the root by a further
        round over half its standard error; infinite if the search itself reached its limit.
    """

    kind: str
    sigma: float
    omega: float
    covariance: np.ndarray
    channels: tuple[str, ...]
    share: float
    residual_rms: dict[str, float]
    time: np.ndarray
    measured: dict[str, np.ndarray]
    fitted: dict[str, np.ndarray]
    F: float
    F_terms: int
    F_dof: float
    F_probability: float
    moved: tuple[MovedWindow, ...] = ()
    convergence: Convergence = field(kw_only=True)

    @property
    def remarks(self) -> list[Remark]:
        """What forbids or restricts the use of the figures."""
        return _remarks(self)

    @property
    def values(self) -> dict[str, tuple[float, float, str]]:
        """Figures by name: value, standard error, SI unit.

        ``period``, ``damping_ratio``, ``omega_n`` and ``t_half`` of an oscillation,
        ``time_constant`` and ``t_half`` of an aperiodic motion; times are negative when it grows:
        ``t_half`` is then the time to double.
        """
        s, w = self.sigma, self.omega
        n = math.hypot(s, w)
        halving = ("t_half", math.log(2.0) / s, (-math.log(2.0) / s**2, 0.0), "s")
        if self.kind == "aperiodic":
            rows = [("time_constant", 1.0 / s, (-1.0 / s**2, 0.0), "s"), halving]
        else:
            rows = [
                ("period", 2.0 * math.pi / w, (0.0, -2.0 * math.pi / w**2), "s"),
                ("damping_ratio", s / n, (w**2 / n**3, -s * w / n**3), "1"),
                ("omega_n", n, (s / n, w / n), "rad s-1"),
                halving,
            ]
        return {
            name: (value, math.sqrt(max(np.asarray(slope) @ self.covariance @ slope, 0.0)), unit)
            for name, value, slope, unit in rows
        }

    def report(self) -> str:
        """Return the figures as text."""
        head = (
            f"{self.kind} in {' '.join(self.channels)}, {self.time[0]:g} ... "
            f"{self.time[-1]:g} s, {self.share:.1%} explained"
        )
        rows = [
            f"  {name:14s}{value:12.5g}{stderr:12.2g} {unit}"
            for name, (value, stderr, unit) in self.values.items()
        ]
        test = (
            f"amplitudes: F({self.F_terms}, {self.F_dof:.0f}) {self.F:.4g}, probability "
            f"{self.F_probability:.2g}"
        )
        state = "converged" if self.convergence.converged else "NOT converged"
        return "\n".join(
            [
                f"{head}, {state}",
                test,
                f"  {'':14s}{'estimate':>12s}{'std. error':>12s}",
                *rows,
                *remark_lines(self.remarks),
            ]
        )


def fit_motion(
    data: xr.Dataset,
    channels: Sequence[str],
    kind: str = "oscillation",
    inputs: Sequence[str] = (),
    trend: bool = True,
) -> Motion:
    """Fit one mode to recorded channels; an oscillation also in shorter windows, which must give
    the same.

    Parameters
    ----------
    data : Dataset (time,)
        A manoeuvre on a uniform clock, cut to where the mode is alone: after the input has ended,
        or with the input that drives it. [SI]
    channels : sequence of str
        Channels that share the mode; each is weighted by its residual.
    kind : {"oscillation", "aperiodic"}
        A complex pair or a real root.
    inputs : sequence of str
        Controls that move in the window.
    trend : bool
        Let each channel drift along a straight line; without it each has a constant only, as a slow
        aperiodic motion needs.

    Returns
    -------
    Motion

    Raises
    ------
    UnknownName
        No such channel.
    SchemaError
        The clock is not uniform, a sample is missing, or the kind is not known.
    IdentificationError
        An input does not move, or no such motion stands out of the residual: the message states
        which.

    Examples
    --------
    >>> t = np.arange(200) * 0.1
    >>> data = xr.Dataset({"r": ("time", np.exp(-0.2 * t) * np.cos(2.0 * t))}, {"time": t})
    >>> round(fit_motion(data, ["r"]).values["period"][0], 6)
    3.141593
    """
    motion = _fitted_motion(data, channels, kind, inputs, trend)
    if kind == "aperiodic" or is_forbidden(motion.remarks):
        return motion
    period = motion.values["period"][0]
    moved = fits_in_moved_windows(
        data,
        period,
        inputs,
        lambda part: _fitted_motion(part, channels, kind, inputs, trend).values,
    )
    return replace(motion, moved=moved)


def _fitted_motion(
    data: xr.Dataset, channels: Sequence[str], kind: str, inputs: Sequence[str], trend: bool
) -> Motion:
    """Fit one mode to the window as it is."""
    y, u, time = _samples(data, channels, kind, inputs)
    model = _ModeResponse(time - time[0], y, u, kind, trend)
    x, search = model.best()
    sigma, omega = float(x[0]), abs(float(x[1])) if kind == "oscillation" else 0.0
    fitted = model.fitted(x)
    line = np.polynomial.polynomial.polyfit(model.t, y, 1)
    about = y - (line[0] + model.t[:, None] * line[1])
    share = 1.0 - float(
        (((y - fitted) / model.weight) ** 2).sum() / ((about / model.weight) ** 2).sum()
    )
    if kind == "oscillation" and (cycles := omega * model.t[-1] / (2.0 * math.pi)) < LEAST_CYCLES:
        raise IdentificationError(
            f"no oscillation in {' '.join(channels)}: the fit finds {cycles:.2f} of a cycle "
            f"in {model.t[-1]:.1f} s; "
            "give the window and the inputs of the motion, or fit an aperiodic one"
        )
    if not share > LEAST_SHARE:
        raise IdentificationError(
            f"no {kind.replace('aperiodic', 'aperiodic motion')} stands out in "
            f"{' '.join(channels)}: it explains {share:.0%} of the "
            f"movement about a straight line, {LEAST_SHARE:.0%} are needed; give a window in "
            f"which the motion is excited and alone"
        )
    rms = np.sqrt(np.mean((y - fitted) ** 2, axis=0))
    measured, shown = (dict(zip(channels, part.T)) for part in (y, fitted))
    covariance, test = model.covariance(x), model.test(x)
    residual_rms = dict(zip(channels, rms.tolist()))
    return Motion(
        kind,
        sigma,
        omega,
        covariance,
        tuple(channels),
        share,
        residual_rms,
        time,
        measured,
        shown,
        *test,
        convergence=_root_convergence(search, covariance),
    )


def _root_convergence(search: _RootSearch, covariance: np.ndarray) -> Convergence:
    """Return the end of a search of the root, from its last change and the covariance."""
    stderr = np.sqrt(np.diag(covariance)[: len(search.change)])
    # Without noise the standard errors are those of rounding, below the tolerance of the search.
    tolerance = np.maximum(_SAME * stderr, _RELATIVE * search.size)
    ratio = float(np.max(search.change / tolerance))
    if not search.complete:
        ratio = math.inf
    return Convergence(ratio <= 1.0, search.evaluations, ratio)


def _remarks(motion: Motion) -> list[Remark]:
    found, channels = [], " ".join(motion.channels)
    if motion.F_probability > EXCITED or motion.share < PURE:
        kind = motion.kind.replace("aperiodic", "aperiodic motion")
        words = (
            f"no excitation: the {kind} explains {motion.share:.0%} of {channels} "
            f"({PURE:.0%} needed), probability of its amplitudes by "
            f"chance {motion.F_probability:.2g} (limit {EXCITED:g}); no figure of it may be "
            f"used: give a window in which the motion is "
            "excited and alone, and the inputs that drive it"
        )
        value, limit = (
            (motion.share, PURE) if motion.share < PURE else (motion.F_probability, EXCITED)
        )
        found.append(Remark("no excitation", words, channels, value, limit, "error"))
    ratio = motion.sigma / math.hypot(motion.sigma, motion.omega)
    if motion.kind == "oscillation" and ratio < GROWING:
        words = (
            f"grows: damping ratio {ratio:.2f}, below {GROWING:g}; something drives it "
            f"inside the window, and no figure of it may be used"
        )
        found.append(Remark("growth", words, channels, ratio, GROWING, "error"))
    found += _window_remarks(motion)
    advice = (
        "the root is not that of the least residual; give a window in which the motion is excited "
        "and alone"
    )
    is_wrong = not _SAME * motion.convergence.change <= _WRONG
    found += motion.convergence.remarks(
        f"root of {channels}", advice, channels, severity="error" if is_wrong else "warning"
    )
    errors = np.sqrt(np.maximum(np.diag(motion.covariance), 0.0))
    if motion.kind == "oscillation" and errors[1] > KNOWN * motion.omega:
        words = f"not significant: frequency {motion.omega:.3g} +- {errors[1]:.2g} rad/s"
        found.append(
            Remark("not significant", words, "omega", float(errors[1] / motion.omega), KNOWN)
        )
    if abs(motion.sigma) < 2.0 * errors[0]:
        words = (
            f"not significant: decay {motion.sigma:.3g} +- {errors[0]:.2g} 1/s; whether it "
            f"grows or decays is not known"
        )
        found.append(
            Remark("not significant", words, "sigma", float(abs(motion.sigma) / errors[0]), 2.0)
        )
    return found


def _window_remarks(motion: Motion) -> list[Remark]:
    """Return the refusal of an oscillation that another window changes."""
    changed = [(one, name) for one in motion.moved if (name := one.differs(motion.values))]
    if not changed:
        return []

    def shift(pair: tuple[MovedWindow, str]) -> float:
        one, name = pair
        (value, stderr, _), (moved, own) = motion.values[name], getattr(one, name)
        return abs(moved - value) / max(min(stderr, own), 1e-12)

    one, name = max(changed, key=shift)
    (period, _, _), (ratio, _, _) = motion.values["period"], motion.values["damping_ratio"]
    words = (
        f"depends on the window: period {period:.3g} s and damping ratio {ratio:.3f}, but "
        f"{one.period[0]:.3g} s and "
        f"{one.damping_ratio[0]:.3f} in {one.start:.1f} ... {one.stop:.1f} s (the "
        f"{name.replace('_', ' ')} moves by "
        f"{shift((one, name)):.0f} standard errors, {SHIFT:g} are allowed); something else "
        f"moves {' '.join(motion.channels)}, "
        "and no figure of it may be used: begin behind the last movement of the controls, "
        "end where the motion has died out, or give the "
        "inputs that drive it"
    )
    return [Remark("window", words, name, shift((one, name)), SHIFT, "error")]


def _samples(
    data: xr.Dataset, channels: Sequence[str], kind: str, inputs: Sequence[str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return outputs (time, channel), inputs (time, input) and time; report all that is wrong with
    them.
    """
    if kind not in KINDS:
        raise SchemaError("motion", [f"kind is {kind!r}; allowed: {', '.join(KINDS)}"])
    for name in (*channels, *inputs):
        if name not in data:
            raise UnknownName(name, map(str, data.data_vars), "channel")
    time = data["time"].values.astype(float)
    steps = np.diff(time)
    if len(time) < 12 or not np.ptp(steps) <= 1e-3 * steps.mean():
        raise SchemaError(
            "motion",
            [
                "its time is not uniform or does not rise, or it has fewer than 12 samples; "
                "cut it with flighttest.cut"
            ],
        )
    y, u = (
        np.column_stack([np.zeros((len(time), 0)), *(data[n].values.astype(float) for n in names)])
        for names in (channels, inputs)
    )
    empty = [name for name in (*channels, *inputs) if not np.isfinite(data[name].values).all()]
    if empty:
        raise SchemaError(
            "motion", [f"{', '.join(empty)}: samples are missing; choose a window without gaps"]
        )
    for name, column in zip(inputs, u.T):
        if np.ptp(column) < MOVES:
            raise IdentificationError(
                f"no excitation: {name} moves by {np.ptp(column):.2g} in the window; choose "
                f"one in which it moves"
            )
    for name, column in zip(channels, y.T):
        if np.ptp(column) < MOVES:
            raise IdentificationError(
                f"no motion: {name} moves by {np.ptp(column):.2g} in the window; it is dead "
                f"or nothing happens there"
            )
    return y, u, time


class _RootSearch(NamedTuple):
    """End of the search of a root.

    `complete` states whether all rounds ended within their tolerance, `change` is that of the root
    by a further round, and `size` the magnitude of the root.
    """

    complete: bool
    evaluations: int
    change: np.ndarray
    size: float


class _ModeResponse:
    """The response of one mode at given sigma and omega, all else eliminated."""

    def __init__(self, t: np.ndarray, y: np.ndarray, u: np.ndarray, kind: str, trend: bool):
        self.t, self.y, self.u, self.kind, self.trend = t, y, u - u[:1], kind, trend
        self.step = float(t[1] - t[0])
        self.weight = np.maximum(y.std(axis=0), 1e-300)

    def basis(self, x: np.ndarray) -> np.ndarray:
        """Return the columns (time, term): constant, trend, free motion and what the inputs drive."""
        pole = complex(-x[0], x[1] if self.kind == "oscillation" else 0.0)
        free = np.exp(np.clip(pole.real * self.t, -60.0, 60.0) + 1j * pole.imag * self.t)
        moved = [free, *(_driven(pole, column, self.step) for column in self.u.T)]
        parts = [
            part
            for column in moved
            for part in (
                [column.real, column.imag] if self.kind == "oscillation" else [column.real]
            )
        ]
        return np.column_stack([np.ones_like(self.t), *([self.t] if self.trend else []), *parts])

    def fitted(self, x: np.ndarray) -> np.ndarray:
        """Return the response (time, channel) with the best linear part."""
        X = self.basis(x)
        size = np.maximum(np.abs(X).max(axis=0), 1e-300)
        return (X / size) @ np.linalg.lstsq(X / size, self.y, rcond=1e-12)[0]

    def best(self) -> tuple[np.ndarray, _RootSearch]:
        """Return the root and the end of its search.

        The search is by grid and least squares, the channels weighed by their residuals.
        """
        x = self._search()
        scale = np.full(len(x), max(abs(x[-1]), abs(x[0])))
        evaluations, complete, change = 0, True, np.zeros(len(x))

        def minimise(start: np.ndarray):
            return least_squares(
                lambda z: ((self.y - self.fitted(z)) / self.weight).ravel(),
                start,
                x_scale=scale,
                xtol=1e-10,
                ftol=1e-12,
                max_nfev=_EVALUATIONS * len(start),
            )

        for _ in range(_ROUNDS):
            search = minimise(x)
            x, complete = search.x, complete and bool(search.success)
            evaluations += int(search.nfev)
            self.weight = np.maximum(
                np.sqrt(np.mean((self.y - self.fitted(x)) ** 2, axis=0)), 1e-9 * self.y.std(axis=0)
            )
        # A further round shows how far the root still moves. A single weight has no effect on it.
        if self.y.shape[1] > 1:
            change = np.abs(minimise(x).x - x)
        return x, _RootSearch(complete, evaluations, change, float(np.linalg.norm(x)))

    def _search(self) -> np.ndarray:
        """Return the best point of a grid, from half a cycle in the window to eight samples a
        cycle.
        """
        every = max(len(self.t) // _COARSE, 1)
        coarse = _ModeResponse(
            self.t[::every], self.y[::every], self.u[::every], self.kind, self.trend
        )
        longest = self.t[-1]
        if self.kind == "aperiodic":
            times = np.geomspace(3.0 * coarse.step, 3.0 * longest, 40)
            points = [
                np.array([sign / T])
                for T in times
                for sign in ((1.0, -1.0) if 0.2 * longest < T else (1.0,))
            ]
        else:
            fastest = max(2.0 * math.pi / (8.0 * coarse.step), 4.0 * math.pi / longest)
            points = [
                np.array([ratio * w, w])
                for w in np.geomspace(math.pi / longest, fastest, 50)
                for ratio in _RATIOS
            ]
        left = [float((((coarse.y - coarse.fitted(x)) / coarse.weight) ** 2).sum()) for x in points]
        return points[int(np.argmin(left))]

    def covariance(self, x: np.ndarray) -> np.ndarray:
        """Return the covariance (2, 2) of sigma and omega; all other parameters are estimated with
        them.
        """
        free, basis = len(x), self.basis(x)
        X = self._tangents(x, basis)
        v = ((self.y - self.fitted(x)) / self.weight).T.ravel()
        found = coloured_covariance_of(
            X, v, self._pieces(), [self.step] * self.y.shape[1]
        ).covariance
        covariance = np.zeros((2, 2))
        covariance[:free, :free] = found[:free, :free]
        return covariance

    def test(self, x: np.ndarray) -> tuple[float, int, float, float]:
        """Return F of the amplitudes, their number, degrees of freedom and probability; a drift
        next to an oscillation is a cubic.
        """

        basis, channels = self.basis(x), self.y.shape[1]
        drift = 1 + self.trend
        if self.kind == "oscillation":
            curved = (self.t[:, None] / self.t[-1]) ** np.arange(drift, 4)
            basis, drift = np.column_stack([basis[:, :drift], curved, basis[:, drift:]]), 4
        X, size = self._tangents(x, basis), np.maximum(np.abs(basis).max(axis=0), 1e-300)
        left = ((self.y - self.fitted(x)) / self.weight).T.ravel()
        v = left - X @ np.linalg.lstsq(X, left, rcond=1e-10)[0]
        pieces = self._pieces()
        try:
            C = coloured_covariance_of(X, v, pieces, [self.step] * channels).covariance
        except np.linalg.LinAlgError:  # the motion is a cubic in this window
            return 0.0, channels, 1.0, 1.0
        amplitudes = (np.linalg.lstsq(basis / size, self.y, rcond=1e-12)[0] / self.weight)[
            drift:
        ].T.ravel()
        at = len(x) + np.concatenate(
            [k * basis.shape[1] + np.arange(drift, basis.shape[1]) for k in range(channels)]
        )
        F = float(
            amplitudes @ np.linalg.lstsq(C[np.ix_(at, at)], amplitudes, rcond=1e-12)[0]
        ) / len(at)
        impulses = np.zeros((1, len(v)))
        impulses[0, [piece.start for piece in pieces]] = (
            1.0  # a flat spectrum: all frequencies of the residual count
        )
        dof = float(degrees_of_freedom(impulses, v, pieces, len(at) + len(x))[0])
        return max(F, 0.0), len(at), dof, float(stats.f.sf(max(F, 0.0), len(at), dof))

    def _pieces(self) -> list[slice]:
        """Where each channel stands among the stacked residuals."""
        n, channels = self.y.shape
        return [slice(a, b) for a, b in pairwise(range(0, n * channels + 1, n))]

    def _tangents(self, x: np.ndarray, basis: np.ndarray) -> np.ndarray:
        """Return the derivatives of the weighted response, channel after channel, by the root and
        by the linear parameters.
        """
        n, channels = self.y.shape
        basis = basis / np.maximum(np.abs(basis).max(axis=0), 1e-300)
        free = len(x)
        X = np.zeros((n * channels, free + channels * basis.shape[1]))
        for k in range(free):
            step = 1e-5 * max(abs(x[k]), abs(x[-1]), 1e-6)
            up, down = (self.fitted(x + side * step * np.eye(free)[k]) for side in (1.0, -1.0))
            X[:, k] = ((up - down) / (2.0 * step) / self.weight).T.ravel()
        for k, piece in enumerate(self._pieces()):
            X[piece, free + k * basis.shape[1] : free + (k + 1) * basis.shape[1]] = basis
        return X


def _driven(pole: complex, u: np.ndarray, step: float) -> np.ndarray:
    """Return int exp(pole (t - s)) u(s) ds from the first sample, with `u` linear between samples."""

    z = pole * step
    E = np.exp(np.clip(z.real, -60.0, 60.0) + 1j * z.imag)
    if abs(z) > 1e-4:
        late = step * (E - 1.0 - z) / z**2
        early = step * (E - 1.0) / z - late
    else:
        early = late = 0.5 * step
    driven = lfilter([late, early], [1.0, -E], u.astype(complex))
    return driven - late * u[0] * E ** np.arange(len(u))  # starts from zero

"""Eigenmotions from recorded responses: period, damping and time constants with standard errors.

A mode is fitted to the channels that share it (`mode_response`).  Without inputs the response is
free.  A mode that appears only while a control moves (roll, short period) is fitted with this
control as input.

The fit is valid where one mode carries the channel.  Faster and slower modes must have died out or
be small, and the model must not leave the range in which it is linear.  The standard errors are
those of residuals correlated in time and contain other effects that move the channel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.quantities import time_text
from flighttest.remarks import Convergence, PrintedResult, Remark, is_forbidden
from flighttest.submodels.aircraft_properties.mode_response import (
    SAME,
    WRONG,
    ModeResponse,
    take_samples,
)
from flighttest.submodels.aircraft_properties.moved_windows import (
    SHIFT,
    Figures,
    MovedWindow,
    fits_in_moved_windows,
)

# Smallest part of a cycle that a window must contain.
LEAST_CYCLES = 0.5
# Share of the variance about a straight line that a mode must explain, and share below which it is
# not alone: the remainder is then as large as two fifths of the motion.
LEAST_SHARE, PURE = 0.5, 0.85
# Probability of F above which a motion is no better than noise. The frequency was searched for, so
# the limit is one in a thousand.
EXCITED = 1e-3
# Damping ratio below which a free oscillation doubles within about a cycle. No aeroplane is flown
# so.
GROWING = -0.1
# Relative standard error of the frequency up to which a motion is determined.
KNOWN = 0.2


@dataclass(frozen=True)
class Eigenmotion(PrintedResult):
    """One mode as a record shows it.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    sigma, omega : float
        Decay, positive if stable [1/s]; damped frequency, 0 if aperiodic [rad/s].
    covariance : array (2, 2)
        Covariance of sigma and omega for coloured residuals.
    channels : tuple of str
        Channels that share the mode.
    share : float
        Part of the variance of the channels about straight lines that the fit explains.
    residual_rms : dict of str to float
        Root mean square of the residual of each channel. [SI]
    time, fitted, measured : array (time,), dict of array (time,)
        Responses for a figure. [s], [SI]
    F, F_terms, F_dof, F_probability : float, int, float, float
        Wald's statistic of the amplitudes of the motion, per amplitude, for coloured residuals;
        next to an oscillation a cubic drift is allowed, so that a slow curve is not taken for one.
        Then its degrees of freedom, and the probability of a larger value by chance.
    moved : tuple of MovedWindow
        Fits of an oscillation in shorter windows; if they contradict it, a remark is an error.
        A fit that did not converge is not among them.
    unsettled : int
        Number of shorter windows whose fit did not converge.
    compared : bool
        Whether shorter windows were looked for.
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
    unsettled: int = 0
    compared: bool = False
    convergence: Convergence = field(kw_only=True)

    @property
    def remarks(self) -> list[Remark]:
        """Remarks that forbid or restrict the use of the figures."""
        return [
            *_excitation_remarks(self),
            *_growth_remarks(self),
            *_window_remarks(self),
            *_convergence_remarks(self),
            *_unsettled_remarks(self),
            *_significance_remarks(self),
        ]

    @property
    def values(self) -> dict[str, tuple[float, float, str]]:
        """Figures by name: value, standard error, SI unit.

        ``period``, ``damping_ratio``, ``omega_n`` and ``t_half`` of an oscillation,
        ``time_constant`` and ``t_half`` of an aperiodic motion; times are negative if it grows:
        ``t_half`` is then the time to double.
        """
        s, w = self.sigma, self.omega
        n = math.hypot(s, w)
        # Each row has the slopes of the figure over sigma and omega.
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
        figures = {}
        for name, value, slope, unit in rows:
            # First-order propagation of the covariance.
            variance = np.asarray(slope) @ self.covariance @ slope
            figures[name] = value, math.sqrt(max(variance, 0.0)), unit
        return figures

    def report_lines(self) -> list[str]:
        """Return the figures as lines."""
        state = "converged" if self.convergence.converged else "NOT converged"
        lines = [
            f"{self.kind} in {' '.join(self.channels)}, {time_text(self.time[0])} ... "
            f"{time_text(self.time[-1])} s, {self.share:.1%} explained, {state}",
            f"amplitudes: F({self.F_terms}, {self.F_dof:.0f}) {self.F:.4g}, probability "
            f"{self.F_probability:.2g}",
            f"  {'':14s}{'estimate':>12s}{'std. error':>12s}",
        ]
        for name, (value, stderr, unit) in self.values.items():
            lines.append(f"  {name:14s}{value:12.5g}{stderr:12.2g} {unit}")
        return lines


def fit_motion(
    data: xr.Dataset,
    channels: Sequence[str],
    kind: str = "oscillation",
    inputs: Sequence[str] = (),
    trend: bool = True,
) -> Eigenmotion:
    """Fit one mode to recorded channels.

    An oscillation is also fitted in shorter windows, which must give the same figures.

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
        Whether each channel drifts along a straight line. Without it each channel has only a
        constant, as a slow aperiodic motion requires.

    Returns
    -------
    Eigenmotion

    Raises
    ------
    UnknownName
        No such channel.
    SchemaError
        The clock is not uniform, a sample is missing, or the kind is not allowed.
    IdentificationError
        An input does not move, or no such motion is visible above the residual: the message states
        which.

    Examples
    --------
    >>> t = np.arange(200) * 0.1
    >>> data = xr.Dataset({"r": ("time", np.exp(-0.2 * t) * np.cos(2.0 * t))}, {"time": t})
    >>> round(fit_motion(data, ["r"]).values["period"][0], 6)
    3.141593
    """

    unsettled = 0

    def fit_part(part: xr.Dataset) -> Figures | None:
        nonlocal unsettled
        shorter = _fit_window(part, channels, kind=kind, inputs=inputs, trend=trend)
        if shorter.convergence.converged:
            return shorter.values
        unsettled += 1
        return None

    motion = _fit_window(data, channels, kind=kind, inputs=inputs, trend=trend)
    if kind == "aperiodic" or is_forbidden(motion.remarks):
        return motion
    period = motion.values["period"][0]
    moved = fits_in_moved_windows(data, period, inputs=inputs, fit=fit_part)
    return replace(motion, moved=moved, unsettled=unsettled, compared=True)


def _fit_window(
    data: xr.Dataset, channels: Sequence[str], kind: str, inputs: Sequence[str], trend: bool
) -> Eigenmotion:
    """Fit one mode to the whole window."""
    y, u, time = take_samples(data, channels, kind=kind, inputs=inputs)
    model = ModeResponse(time - time[0], y, u, kind=kind, trend=trend)
    x, search = model.search_root()
    omega = abs(float(x[1])) if kind == "oscillation" else 0.0
    fitted = model.fitted(x)
    share = _explained_share(model, fitted)
    _demand_motion(
        kind, channels, cycles=omega * model.t[-1] / (2.0 * math.pi), share=share, t=model.t
    )
    rms = np.sqrt(np.mean((y - fitted) ** 2, axis=0))
    covariance, test = model.covariance(x), model.test_amplitudes(x)
    return Eigenmotion(
        kind=kind,
        sigma=float(x[0]),
        omega=omega,
        covariance=covariance,
        channels=tuple(channels),
        share=share,
        residual_rms=dict(zip(channels, rms.tolist())),
        time=time,
        measured=dict(zip(channels, y.T)),
        fitted=dict(zip(channels, fitted.T)),
        F=test.F,
        F_terms=test.terms,
        F_dof=test.dof,
        F_probability=test.probability,
        convergence=search.convergence(covariance),
    )


def _explained_share(model: ModeResponse, fitted: np.ndarray) -> float:
    """Return the part of the weighted variance about straight lines that a fit explains."""
    y = model.y
    line = np.polynomial.polynomial.polyfit(model.t, y, 1)
    movement = y - (line[0] + model.t[:, None] * line[1])
    return 1.0 - float(
        (((y - fitted) / model.weight) ** 2).sum() / ((movement / model.weight) ** 2).sum()
    )


def _demand_motion(
    kind: str, channels: Sequence[str], cycles: float, share: float, t: np.ndarray
) -> None:
    """Raise an error for a fit that is not the requested motion."""
    names = " ".join(channels)
    if kind == "oscillation" and cycles < LEAST_CYCLES:
        raise IdentificationError(
            f"no oscillation in {names}: the fit finds {cycles:.2f} of a cycle "
            f"in {t[-1]:.1f} s; "
            "give the window and the inputs of the motion, or fit an aperiodic one"
        )
    if not share > LEAST_SHARE:
        raise IdentificationError(
            f"no {_motion_name(kind)} stands out in {names}: it explains {share:.0%} of the "
            f"movement about a straight line, {LEAST_SHARE:.0%} are needed; give a window in "
            f"which the motion is excited and alone"
        )


def _motion_name(kind: str) -> str:
    """Return the noun of a kind of motion."""
    return "aperiodic motion" if kind == "aperiodic" else kind


def _excitation_remarks(motion: Eigenmotion) -> list[Remark]:
    """Return the error that the motion does not stand out, or is not alone."""
    if motion.F_probability <= EXCITED and motion.share >= PURE:
        return []
    channels = " ".join(motion.channels)
    text = (
        f"no excitation: the {_motion_name(motion.kind)} explains {motion.share:.0%} of {channels} "
        f"({PURE:.0%} needed), probability of its amplitudes by "
        f"chance {motion.F_probability:.2g} (limit {EXCITED:g}); no figure of it may be "
        f"used: give a window in which the motion is "
        "excited and alone, and the inputs that drive it"
    )
    value, limit = motion.F_probability, EXCITED
    if motion.share < PURE:
        value, limit = motion.share, PURE
    return [Remark("no excitation", text, channels, value, limit, severity="error")]


def _growth_remarks(motion: Eigenmotion) -> list[Remark]:
    """Return the error that something drives the oscillation inside the window."""
    ratio = motion.sigma / math.hypot(motion.sigma, motion.omega)
    if motion.kind != "oscillation" or ratio >= GROWING:
        return []
    text = (
        f"grows: damping ratio {ratio:.2f}, below {GROWING:g}; something drives it "
        f"inside the window, and no figure of it may be used"
    )
    return [Remark("growth", text, " ".join(motion.channels), ratio, GROWING, severity="error")]


def _convergence_remarks(motion: Eigenmotion) -> list[Remark]:
    """Return a remark on a root that is not that of the least residual."""
    channels = " ".join(motion.channels)
    advice = (
        "the root is not that of the least residual; give a window in which the motion is excited "
        "and alone"
    )
    severity = "warning" if SAME * motion.convergence.change <= WRONG else "error"
    return motion.convergence.remarks(
        f"root of {channels}", advice, term=channels, severity=severity
    )


def _unsettled_remarks(motion: Eigenmotion) -> list[Remark]:
    """Return a remark on shorter windows whose fit did not converge; a note if others remain.

    An oscillation that no shorter window confirms has a warning.
    """
    channels = " ".join(motion.channels)
    if motion.compared and not motion.moved and not motion.unsettled:
        text = (
            "not checked: no shorter window is long enough for a fit, so nothing shows whether the "
            "motion is alone: give a window of two periods and more that begins before the input"
        )
        return [Remark("window", text, channels, severity="warning")]
    if not motion.unsettled:
        return []
    count = motion.unsettled + len(motion.moved)
    text = (
        f"{motion.unsettled} of {count} shorter windows: the fit did not converge and is not "
        f"compared with that of the whole window"
    )
    severity = "note"
    if not motion.moved:
        text += "; no window shows whether the motion is alone: give a longer or a quieter one"
        severity = "warning"
    return [
        Remark("window", text, channels, value=motion.unsettled, threshold=0.0, severity=severity)
    ]


def _significance_remarks(motion: Eigenmotion) -> list[Remark]:
    """Return remarks on a frequency or a decay with a large standard error."""
    remarks = []
    errors = np.sqrt(np.maximum(np.diag(motion.covariance), 0.0))
    if motion.kind == "oscillation" and errors[1] > KNOWN * motion.omega:
        text = f"not significant: frequency {motion.omega:.3g} +- {errors[1]:.2g} rad/s"
        ratio = float(errors[1] / motion.omega)
        remarks.append(Remark("not significant", text, "omega", ratio, KNOWN))
    if abs(motion.sigma) < 2.0 * errors[0]:
        text = (
            f"not significant: decay {motion.sigma:.3g} +- {errors[0]:.2g} 1/s; whether it "
            f"grows or decays is not known"
        )
        ratio = float(abs(motion.sigma) / errors[0])
        remarks.append(Remark("not significant", text, "sigma", ratio, 2.0))
    return remarks


def _window_remarks(motion: Eigenmotion) -> list[Remark]:
    """Return the error that a shorter window changes an oscillation."""
    # Of all windows that change a figure, the remark names the largest change.
    largest, changed, figure = -math.inf, None, ""
    for window in motion.moved:
        name = window.differs(motion.values)
        if name and window.shift(name, motion.values) > largest:
            largest, changed, figure = window.shift(name, motion.values), window, name
    if changed is None:
        return []
    (period, _, _), (ratio, _, _) = motion.values["period"], motion.values["damping_ratio"]
    text = (
        f"depends on the window: period {period:.3g} s and damping ratio {ratio:.3f}, but "
        f"{changed.period[0]:.3g} s and "
        f"{changed.damping_ratio[0]:.3f} in {changed.start:.1f} ... {changed.stop:.1f} s (the "
        f"{figure.replace('_', ' ')} moves by "
        f"{largest:.0f} standard errors, {SHIFT:g} are allowed); something else "
        f"moves {' '.join(motion.channels)}, "
        "and no figure of it may be used: begin behind the last movement of the controls, "
        "end where the motion has died out, or give the "
        "inputs that drive it"
    )
    return [Remark("window", text, figure, largest, SHIFT, severity="error")]

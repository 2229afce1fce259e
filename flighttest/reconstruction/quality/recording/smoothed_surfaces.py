"""Surfaces that a recorder smooths: by a low-pass of a few tenths of a hertz, or by a mean.

A smoothed surface makes the effects of controls and rates wrong, and may look like a wrong sign. A
moment equation is linear, so that it also holds if all its terms pass through the same filter. With
a smoothed surface it holds if all terms but this surface pass through the filter of the recorder.
A surface that is only late does not show this: it fits the filtered motion after the filter and
with a delay.

A vane with a lag looks alike: the equation holds if all terms but the vane pass through the lag. Of
the two the one that leaves less unexplained is named. A vane with a late clock looks alike too. If
its delay leaves least unexplained, neither is reported, and `control_responses` has the delay.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from flighttest.reconstruction.quality.checks.control_response import (
    EQUATIONS,
    FLOW,
    FLOW_DELAYS,
    MOVED,
    Equation,
    Regression,
    prepare_regression,
)
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.finding import Finding

_AXES = ("q", "pr")  # rates of equations without and with common channels
# order and cut-off [Hz] of low-passes; order 0 is a mean over 0.443/cut-off
_FILTERS = (
    *((1, 0.2), (1, 0.3), (1, 0.5), (1, 0.8), (1, 1.2)),
    *((2, 0.2), (2, 0.3), (2, 0.5), (2, 0.8), (2, 1.2)),
    *((0, 0.35), (0, 0.5), (0, 0.7), (0, 1.0)),
)
_MEAN = 0.443  # cut-off of a mean times its length
_FASTEST = 0.4  # of the rate of the clock, above which a filter is not tried
_LONGEST = 1.0  # s, longest delay of a surface that is late only
_REST = 0.1  # s, longest delay of a surface in addition to its filter
# A smoothing is clear if the logarithm of the ratio of the unexplained variances is above `_CLEAR`
# and this logarithm times the number of independent samples, twice a log-likelihood, is above
# `_LIKELY`.
_CLEAR, _LIKELY = 0.25, 12.0
_INDEPENDENT = 0.25  # s after which samples count as independent
_UNEXPLAINED = 0.5  # share of the variance that the filter may leave
# time constants of vanes with a lag that looks like a smoothed surface; ours [s]
_VANE_LAGS = (0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0, 1.25, 1.6, 2.0, 2.5)
_TINY = 1e-300


@dataclass(frozen=True)
class VaneLag:
    """First-order lag of a vane with which the surface as recorded explains the motion.

    Attributes
    ----------
    vane : str
    lag : float
        Time constant. [s]
    unexplained : float
        Share of the variance of the acceleration behind the same lag that is unexplained. [1]
    """

    vane: str
    lag: float
    unexplained: float


@dataclass(frozen=True)
class Smoothing:
    """Filter of the recorder with which a surface explains the motion.

    Attributes
    ----------
    surface, rate : str
    order : int
        Of the low-pass; 0 for a mean over 0.443/cut-off.
    cutoff : float
        [Hz]
    late : float
        Share of the variance of the acceleration that is unexplained if the surface is late
        only. [1]
    smoothed : float
        The same if the surface is smoothed. [1]
    misfit : float
        Variance of the recorded surface that does not follow from the motion and the filter. A
        filter that is too slow makes the effect of the surface too small and this variance
        large. [rad2]
    lagged : VaneLag or None
        Lag of the vane of the equation that explains the motion better than the smoothed surface.
    """

    surface: str
    rate: str
    order: int
    cutoff: float
    late: float
    smoothed: float
    misfit: float
    lagged: VaneLag | None = None

    @property
    def channel(self) -> str:
        """The channel that the recorder changed: the surface, or the vane with a lag."""
        return self.surface if self.lagged is None else self.lagged.vane

    @property
    def gain(self) -> float:
        """Logarithm of the ratio of the shares; positive if the surface is smoothed. [1]"""
        return math.log(max(self.late, _TINY) / max(self.smoothed, _TINY))


def smoothed_surfaces(signals: ResampledChannels) -> tuple[list[Smoothing], ResampledChannels]:
    """Return the surfaces that are smoothed, and signals in which all channels are alike.

    Parameters
    ----------
    signals : ResampledChannels
        With correct signs, units and times of rates and flow angles.

    Returns
    -------
    list of Smoothing
        The clearest one first.
    ResampledChannels
        Rates, flow angles and the other surfaces have passed through the filter of the recorder.
        Effects of surfaces that follow from them have the right sign and size.
    """
    found: list[Smoothing] = []
    for axes in _AXES:
        remaining = [equation for equation in EQUATIONS if equation.rate in axes]
        while remaining:
            candidates = [_best_smoothing(equation, signals) for equation in remaining]
            smoothed = [candidate for candidate in candidates if candidate is not None]
            if not smoothed:
                break
            # A smoothed surface spoils the equation that reads it. So the clearest one is settled,
            # and the other equation is solved again.
            clearest = max(smoothed, key=lambda smoothing: smoothing.gain)
            found.append(clearest)
            signals = _filter_alike(signals, clearest, axes)
            remaining = [item for item in remaining if item.surface != clearest.surface]
    return found, signals


def smoothing_findings(found: list[Smoothing]) -> list[Finding]:
    """Return a warning for each smoothed surface or vane with a lag, of kind ``smoothed``."""
    findings = []
    for smoothing in found:
        if smoothing.lagged is not None:
            findings.append(_vane_finding(smoothing, smoothing.lagged))
            continue
        name, acceleration = smoothing.surface, f"{smoothing.rate}_dot"
        text = (
            f"{name} is smoothed in the record: about its movements {smoothing.smoothed:.1%} of "
            f"{acceleration} remains unexplained if all other channels pass through "
            f"{_describe_filter(smoothing)}, and {smoothing.late:.1%} if {name} passes through it "
            f"too, with any delay up to {_LONGEST:g} s; effects of controls and rates come out "
            f"wrong by tens of per cent"
        )
        remedy = (
            f"map a column of {name} without filter or mean (an anti-alias filter above 5 Hz is "
            f"harmless); sign and delay of the name map do not bring the quick movements back"
        )
        evidence = {
            "order": smoothing.order,
            "cutoff": smoothing.cutoff,
            "late": smoothing.late,
            "smoothed": smoothing.smoothed,
        }
        channels = (name, smoothing.rate)
        findings.append(Finding("warning", "smoothed", channels, text, remedy, evidence=evidence))
    return findings


def _vane_finding(smoothing: Smoothing, lagged: VaneLag) -> Finding:
    """Return the warning on a vane with a lag that looks like a smoothed surface."""
    name, vane, acceleration = smoothing.surface, lagged.vane, f"{smoothing.rate}_dot"
    text = (
        f"{vane} follows with a lag of the order of {lagged.lag:g} s: about the movements of "
        f"{name} {lagged.unexplained:.1%} of {acceleration} remains unexplained if all channels "
        f"but {vane} pass through this lag, and {smoothing.smoothed:.1%} if {name} were smoothed "
        f"instead; effects of controls and of the flow angle come out wrong by tens of per cent"
    )
    remedy = (
        f"measure the lag of {vane}, by its damping or filter, and give it in the name map (lag, "
        f"in s; the number here is good to a factor of two), or map a vane that follows at once"
    )
    evidence = {
        "lag": lagged.lag,
        "unexplained": lagged.unexplained,
        "smoothed": smoothing.smoothed,
    }
    channels = (vane, smoothing.rate)
    return Finding("warning", "smoothed", channels, text, remedy, evidence=evidence)


def _describe_filter(smoothing: Smoothing) -> str:
    if smoothing.order == 0:
        return f"a mean over {_MEAN / smoothing.cutoff:.2g} s"
    order = {1: "first", 2: "second"}[smoothing.order]
    return f"a low-pass of {smoothing.cutoff:g} Hz ({order} order)"


def _best_smoothing(equation: Equation, signals: ResampledChannels) -> Smoothing | None:
    """Return the clearest smoothing of the surface of an equation; None if it shows none."""
    data = prepare_regression(equation, signals)
    if data is None or not data.columns or data.movement < MOVED:
        return None
    # A surface takes up the response to a flow angle that the equation lacks.
    if set(equation.others) & FLOW - set(data.names):
        return None
    best: Smoothing | None = None
    for order, cutoff in _FILTERS:
        if cutoff * signals.step > _FASTEST:
            continue
        smoothing = _compare(equation, data, order, cutoff=cutoff, step=signals.step)
        if smoothing is not None and (best is None or smoothing.misfit < best.misfit):
            best = smoothing
    if best is None or best.smoothed > _UNEXPLAINED:
        return None
    independent = int(data.active.sum()) * signals.step / _INDEPENDENT
    clear = best.gain > _CLEAR and best.gain * independent > _LIKELY
    if not clear:
        return None
    late = _unexplained_by_late_vane(data, best, signals.step)
    lagged = _lagged_vane(data, signals.step)
    if late < min(best.smoothed, math.inf if lagged is None else lagged.unexplained):
        return None
    if lagged is not None and lagged.unexplained < best.smoothed:
        return replace(best, lagged=lagged)
    return best


def _lagged_vane(data: Regression, step: float) -> VaneLag | None:
    """Return the lag of the vane of an equation that leaves least unexplained; None without one."""
    vanes = [name for name in data.names if name in FLOW]
    best: VaneLag | None = None
    for lag in _VANE_LAGS if vanes else ():
        apply = _make_filter(1, 1.0 / (2.0 * math.pi * lag), step)
        behind = []
        for name, column in zip(data.names, data.columns, strict=True):
            # the recorder has passed the vane through the lag already
            behind.append((column if name in FLOW else apply(column))[data.active])
        Q, _ = np.linalg.qr(np.stack(behind, axis=1))
        y, surface = apply(data.y)[data.active], apply(data.surface)
        share, effect = _least_unexplained(y, Q, surface, data.active, longest=_REST / step)
        # a positive surface makes a negative moment
        if effect < 0.0 and (best is None or share < best.unexplained):
            best = VaneLag(vanes[0], lag, share)
    return best


def _unexplained_by_late_vane(data: Regression, smoothing: Smoothing, step: float) -> float:
    """Return the smallest unexplained share of any delay of the vane; infinite without a vane. [1]

    All terms pass through the filter of the smoothing, so that the share compares with its share.
    """
    if not FLOW & set(data.names):
        return math.inf
    apply = _make_filter(smoothing.order, smoothing.cutoff, step)
    y, surface = apply(data.y)[data.active], apply(data.surface)
    least = math.inf
    for delay in FLOW_DELAYS:
        on_time = []
        for name, column in zip(data.names, data.columns, strict=True):
            moved = column
            if name in FLOW:
                moved = np.interp(data.time + delay, data.time, column)
            on_time.append(apply(moved)[data.active])
        Q, _ = np.linalg.qr(np.stack(on_time, axis=1))
        share, effect = _least_unexplained(y, Q, surface, data.active, longest=_REST / step)
        # a positive surface makes a negative moment
        if effect < 0.0:
            least = min(least, share)
    return least


def _compare(
    equation: Equation, data: Regression, order: int, *, cutoff: float, step: float
) -> Smoothing | None:
    """Return the shares of a filter; None if the surface then has the wrong sign."""
    apply = _make_filter(order, cutoff, step)
    columns = np.stack([apply(column)[data.active] for column in data.columns], axis=1)
    Q, _ = np.linalg.qr(columns)
    y = apply(data.y)[data.active]
    late, _ = _least_unexplained(y, Q, apply(data.surface), data.active, longest=_LONGEST / step)
    smoothed, effect = _least_unexplained(y, Q, data.surface, data.active, longest=_REST / step)
    # a positive surface makes a negative moment
    if effect >= 0.0:
        return None
    misfit = smoothed * float(np.var(y)) / max(effect**2, _TINY)
    names = (equation.surface, equation.rate)
    return Smoothing(*names, order, cutoff, late=late, smoothed=smoothed, misfit=misfit)


def _least_unexplained(
    y: np.ndarray, Q: np.ndarray, surface: np.ndarray, mask: np.ndarray, longest: float
) -> tuple[float, float]:
    """Return the smallest unexplained share of any delay, and the effect of the surface there.

    `Q` (sample, term) is an orthonormal basis of the other terms at the samples of `mask`.
    """
    motion = y - Q @ (Q.T @ y)
    variance = max(float(np.var(y)), _TINY)
    best = (math.inf, 0.0)
    for delay in range(-round(longest), round(longest) + 1):
        # the ends that np.roll wraps around are high-passed, and not in the mask
        delayed = np.roll(surface, delay)[mask]
        delayed = delayed - Q @ (Q.T @ delayed)
        effect = float(delayed @ motion) / max(float(delayed @ delayed), _TINY)
        share = float(np.var(motion - effect * delayed)) / variance
        best = min(best, (share, effect))
    return best


def _make_filter(order: int, cutoff: float, step: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return a filter that starts at rest at the first sample."""
    # SciPy takes half a second to import; only this function needs it
    from scipy.signal import butter, lfilter, lfilter_zi

    if order == 0:
        length = max(2, round(_MEAN / (cutoff * step)))
        b, a = np.full(length, 1.0 / length), np.array([1.0])
    else:
        b, a = butter(order, cutoff, fs=1.0 / step)
    rest = lfilter_zi(b, a)

    def apply(x: np.ndarray) -> np.ndarray:
        return lfilter(b, a, x, zi=rest * x[0])[0]

    return apply


def _filter_alike(signals: ResampledChannels, smoothing: Smoothing, axes: str) -> ResampledChannels:
    """Return signals with the channels of some equations filtered, but the changed one."""
    apply = _make_filter(smoothing.order, smoothing.cutoff, signals.step)
    if smoothing.lagged is not None:
        apply = _make_filter(1, 1.0 / (2.0 * math.pi * smoothing.lagged.lag), signals.step)
    names: set[str] = set()
    for equation in EQUATIONS:
        if equation.rate in axes:
            names |= {equation.rate, equation.surface, *equation.others}
    names = (names - {smoothing.channel}) & set(signals.values)
    return signals.with_values({name: apply(signals[name]) for name in names})

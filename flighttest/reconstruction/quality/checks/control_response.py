"""Response of the aeroplane to its controls: sign, size and time of each effect.

Kinematics do not determine the sign of a surface, but the response of the aeroplane does.  Angular
accelerations are regressed on rates, flow angles and surfaces.  All of these are high-passed, so
that trim and slow drift take no part.  Positive elevator pitches down, positive aileron rolls left
and positive rudder yaws left.  The surface follows the control of the pilot.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace

import numpy as np
import pandas as pd

from flightmech.units import DEGREE
from flighttest.reconstruction.quality.checks.signals import (
    BAND,
    ResampledChannels,
    lowpass_if_possible,
)
from flighttest.reconstruction.quality.checks.surface_timing import (
    LONGEST,
    SurfaceTiming,
    regress_last_column,
    surface_timing,
)
from flighttest.records.signals.differentiation import derivative

SIGNIFICANT = 6.0  # standard errors a coefficient must have before its sign counts
FOLLOWS = 0.5  # correlation of a surface with the control that moves it
FLOW = {"alpha_vane", "beta_vane"}
MOVED = 1.0 * DEGREE  # total movement without which a delay is not informative
SHORTEST = 5.0  # [s] of usable samples
_AMBIGUOUS = 0.1  # difference of correlations by which the unexpected sign must be better
_TRIM = 0.3  # [Hz] high-pass: slower motion is trim and drift
_EARLY, _LATE = 0.05, -0.15  # [s] a lead beyond these limits: the surface has another clock
# A shift in time must gain this R2, and this share of the variance that is unexplained without it.
_GAINS, _SHARE = 0.003, 0.05
_CERTAIN = 3.0  # standard errors by which the lead must lie beyond its limit
_EXPLAINED = 0.4  # R2 that the equation must reach about the movements with the best delay
# Samples that show when a surface acts: share of the largest movement, and time around it. [s]
_ACTIVE, _AROUND = 0.25, 1.5
FLOW_DELAYS = np.arange(0.1, 3.05, 0.1)  # [s] a flow angle so late can reverse a sign
_LESS = 0.8  # largest share of the unexplained variance that may remain with such a delay
_MOVES = 0.05 * DEGREE  # rms of quick movement that makes an input
_SMALLEST_SPEED = 0.3  # of the median speed: lower bound in the dynamic pressure
_ENDS = 1.0  # [s] ends of a record, where the filters lack the samples beyond
_STILL = 1e-9  # [rad, rad/s] range of a channel that is constant
_COLUMNS = (
    "surface",
    "rate",
    "effect",
    "stderr",
    "ratio",
    "R2",
    "movement",
    "lead",
    "lead_stderr",
    "gained",
    "explained",
    "bound",
    "sign",
    "other",
    "flow_late",
)


@dataclass(frozen=True)
class Equation:
    """One moment equation: the rate it explains, its other inputs, and the surface."""

    rate: str
    others: tuple[str, ...]
    surface: str


EQUATIONS = (
    Equation("q", ("q", "alpha_vane"), "delta_e"),
    Equation("p", ("p", "r", "beta_vane", "delta_r"), "delta_a"),
    Equation("r", ("p", "r", "beta_vane", "delta_a"), "delta_r"),
)
HANDS = (  # control of the pilot, surface, sign of the vocabulary, whether it is a position
    ("column", "delta_e", -1, True),
    ("wheel", "delta_a", -1, True),
    ("pedal", "delta_r", -1, True),
    ("F_column", "delta_e", -1, False),
    ("F_wheel", "delta_a", -1, False),
    ("F_pedal", "delta_r", -1, False),
)


@dataclass(frozen=True)
class Regression:
    """Data of one moment equation.

    The acceleration y and the columns are high-passed and divided by powers of the dynamic
    pressure. `mask` has the samples that count, `active` the ones about movements of the surface.
    """

    names: list[str]
    y: np.ndarray
    columns: list[np.ndarray]
    surface: np.ndarray
    time: np.ndarray
    mask: np.ndarray
    active: np.ndarray
    movement: float


@dataclass(frozen=True)
class _Response:
    """A row of `control_responses`, its lead, and how clearly the surface is displaced in time."""

    row: tuple
    lead: float
    displacement: float


def control_responses(signals: ResampledChannels) -> pd.DataFrame:
    """Return the response of the aeroplane to each surface.

    Parameters
    ----------
    signals : ResampledChannels
        With correct signs and units of rates and flow angles.

    Returns
    -------
    DataFrame
        One row per surface that moves: ``surface rate effect stderr ratio R2 movement lead
        lead_stderr gained explained bound sign other flow_late``.

        - effect: angular acceleration per radian at the mean dynamic pressure of the flight, with
          the surface at the time at which it acts [s-2].
        - stderr: standard error of the effect, with coloured residuals [s-2].
        - movement: range between 0.5 and 99.5 % without the ends of the record [rad].
        - lead: time by which the surface is recorded before it acts [s].
        - lead_stderr: standard error of the lead, infinite at the end of the search (bound) [s].
        - gained: R2 that the lead gains; explained: R2 with that lead. Both are about the
          movements of the surface.
        - sign: sign of the effect, 0 if the opposite sign with the lead `other` [s] explains the
          motion as well, see `surface_timing`.
        - flow_late: if the surface looks reversed, the delay of the flow angle with which it does
          not; else 0 [s].

    Notes
    -----
    Only samples about the movements of a surface show when it acts.  A flight has more samples of
    the other kind.  In these, a delayed surface compensates what else the equation lacks. A vane on
    the wing in a roll is enough for a delay of 0.2 s.
    """
    final: dict[Equation, _Response] = {}
    remaining = list(EQUATIONS)
    while remaining:
        responses: dict[Equation, _Response] = {}
        for equation in remaining:
            response = _respond(equation, signals)
            if response is not None:
                responses[equation] = response
        displaced = [
            equation for equation, response in responses.items() if response.displacement > 0.0
        ]
        if not displaced:
            final.update(responses)
            break
        # A surface at another time spoils the equations that read it. So the clearest one is
        # moved to the time at which it acts, and the other equations are solved again.
        clearest = max(displaced, key=lambda equation: responses[equation].displacement)
        final[clearest] = responses[clearest]
        signals = _shift_surface(signals, clearest.surface, responses[clearest].lead)
        remaining = [equation for equation in responses if equation != clearest]
    rows = [final[equation].row for equation in EQUATIONS if equation in final]
    return pd.DataFrame(rows, columns=list(_COLUMNS))


def effect_in(
    acceleration: np.ndarray, surface: str, signals: ResampledChannels, known: np.ndarray
) -> float | None:
    """Return the effect of a surface in a given angular acceleration, as `control_responses`.

    The filters of `control_responses` attenuate quick motion: a quarter of it at 2 Hz.  They do the
    same to an acceleration that a model gives, so that both effects compare.

    Parameters
    ----------
    acceleration : array (time,)
        Rate of change of p, q or r, after the low-pass of `resample_channels`. [rad s-2]
    surface : str
    signals : ResampledChannels
    known : array of bool (time,)
        Samples at which the acceleration rests on recorded values; only these are used.

    Returns
    -------
    float or None
        Angular acceleration per radian; None if the record does not determine it. [s-2]
    """
    # deferred: the import of SciPy is slow, and only this function needs it
    from scipy.interpolate import make_interp_spline

    (equation,) = (item for item in EQUATIONS if item.surface == surface)
    data = prepare_regression(equation, signals)
    if data is None:
        return None
    used = data.mask & known
    if used.sum() * signals.step < SHORTEST:
        return None
    # The rate of the model goes through the filters of a recorded rate.  Its constant acceleration
    # would only make it large.  A trapezoidal rule would lose 3 % at 2 Hz.
    changing = acceleration - acceleration[used].mean()
    rate = make_interp_spline(signals.time, changing, k=3).antiderivative()(signals.time)
    y = _filtered_acceleration(rate, signals, data.mask)
    columns = [column[used] for column in (*data.columns, data.surface)]
    fit = regress_last_column(y[used], columns, mask=used, step=signals.step)
    return fit[0] if fit else None


def _shift_surface(signals: ResampledChannels, name: str, lead: float) -> ResampledChannels:
    shifted = np.interp(signals.time - lead, signals.time, signals[name])
    return signals.with_values({name: shifted})


def _respond(equation: Equation, signals: ResampledChannels) -> _Response | None:
    """Return the response of one equation; None if a channel or its movement is missing."""
    data = prepare_regression(equation, signals)
    if data is None:
        return None
    timing = surface_timing(
        data.y[data.active],
        [column[data.active] for column in data.columns],
        surface=data.surface,
        time=data.time,
        mask=data.active,
    )
    # Without its flow angle the equation lacks the response to it. A delay of the surface takes
    # up that response, so that the record then shows no time other than that of its clock.
    complete = not (set(equation.others) & FLOW) - set(data.names)
    displaced = complete and is_displaced(timing, data.movement)
    acting = data.surface
    if displaced:
        acting = np.interp(data.time - timing.lead, data.time, data.surface)
    columns = [column[data.mask] for column in (*data.columns, acting)]
    fit = regress_last_column(data.y[data.mask], columns, mask=data.mask, step=signals.step)
    if fit is None:
        return None
    effect, stderr, R2 = fit
    if not complete and np.sign(effect) != timing.sign:
        timing = replace(timing, sign=0)
    flow_late = 0.0
    if effect > 0.0 and complete:
        flow_late = _flow_delay(data, most=_LESS * (1.0 - timing.explained))
    displacement = 0.0
    if displaced:
        displacement = timing.gained / max(1.0 - timing.explained, 1e-12)
    ratio = effect / max(stderr, 1e-300)
    names = (equation.surface, equation.rate)
    row = (*names, effect, stderr, ratio, R2, data.movement, *astuple(timing), flow_late)
    return _Response(row, timing.lead, displacement)


def prepare_regression(equation: Equation, signals: ResampledChannels) -> Regression | None:
    """Return the data of an equation; None if a channel or its movement is missing."""
    if not {equation.rate, equation.surface} <= set(signals.values):
        return None
    # the filters leave rounding errors of a channel that is constant
    names = [name for name in equation.others if name in signals and np.ptp(signals[name]) > _STILL]
    mask = signals.mask((equation.rate, *names, equation.surface))
    if mask.sum() * signals.step < SHORTEST:
        return None
    # A movement that began before the record looks like a surface at another time: the filters
    # take the first and the last sample for all samples beyond.
    inner, ends = mask.copy(), round(_ENDS / signals.step)
    inner[:ends] = inner[-ends:] = False
    if inner.sum() * signals.step >= SHORTEST:
        mask = inner
    deflection = signals[equation.surface][mask]
    if np.ptp(deflection) == 0.0 or np.ptp(signals[equation.rate][mask]) == 0.0:
        return None

    # Moments grow with the dynamic pressure, and the effects of rates with its square root. The
    # division by it makes the coefficients constant at changing speed.
    scale = relative_pressure(signals, mask)
    y = _filtered_acceleration(signals[equation.rate], signals, mask)
    columns = []
    for name in names:
        column = lowpass_channel(signals, name)
        if name in "pqr":
            column = column / np.sqrt(scale)
        columns.append(remove_trim(column, signals))
    surface = remove_trim(lowpass_channel(signals, equation.surface), signals)
    active = mask & _about_movements(surface, mask, signals.step)
    if active.sum() <= 10 * (len(columns) + 1):
        active = mask
    return Regression(
        names,
        y,
        columns=columns,
        surface=surface,
        time=signals.time,
        mask=mask,
        active=active,
        movement=float(np.percentile(deflection, 99.5) - np.percentile(deflection, 0.5)),
    )


def _filtered_acceleration(
    rate: np.ndarray, signals: ResampledChannels, mask: np.ndarray
) -> np.ndarray:
    """Return the derivative of a rate over the relative dynamic pressure, high-passed."""
    slow = lowpass_if_possible(rate, signals.step, BAND)
    acceleration = derivative(slow, signals.step, 5, order=2)
    return remove_trim(acceleration / relative_pressure(signals, mask), signals)


def _flow_delay(data: Regression, most: float) -> float:
    """Return the delay of the flow angles with which a reversed surface acts as it should. [s]

    The delay must leave less than `most` of the variance. The result is 0 without such a delay.
    """
    y = data.y[data.active]
    best = 0.0
    for delay in FLOW_DELAYS:
        columns = []
        for name, column in zip(data.names, data.columns, strict=True):
            if name in FLOW:
                column = np.interp(data.time + delay, data.time, column)
            columns.append(column[data.active])
        X = np.stack([*columns, data.surface[data.active]], axis=1)
        theta = np.linalg.lstsq(X, y, rcond=1e-10)[0]
        unexplained = float(np.var(y - X @ theta) / max(np.var(y), 1e-300))
        # a negative effect of the surface is the convention
        if theta[-1] < 0.0 and unexplained < most:
            best, most = float(delay), unexplained
    return best


def _about_movements(surface: np.ndarray, mask: np.ndarray, step: float) -> np.ndarray:
    """Return the samples about the larger quick movements of a surface."""
    large = mask & (np.abs(surface) > _ACTIVE * np.percentile(np.abs(surface[mask]), 99.5))
    width = 2 * min(round(_AROUND / step), (len(large) - 1) // 2) + 1
    return np.convolve(large, np.ones(width), mode="same") > 0.5


def is_displaced(timing: SurfaceTiming, movement: float) -> bool:
    """Return whether a surface was certainly not recorded when it acted."""
    margin = _CERTAIN * timing.stderr
    if timing.bound:
        margin = 0.0
    outside = timing.lead - margin > _EARLY or timing.lead + margin < _LATE
    # share of what the equation leaves unexplained without the lead
    unexplained = 1.0 - timing.explained + timing.gained
    gains = timing.gained > max(_GAINS, _SHARE * unexplained)
    clear = timing.sign != 0 and timing.explained > _EXPLAINED
    return clear and outside and gains and movement > MOVED


def pilot_to_surface(signals: ResampledChannels) -> pd.DataFrame:
    """Return how each surface follows the control of the pilot.

    Returns
    -------
    DataFrame
        ``control surface expected correlation delay position``. The correlation is the largest
        within two seconds of delay. `delay` is the time by which the surface is recorded after the
        control [s]. The expected sign has priority if it correlates nearly as well, because half a
        period of delay looks like the opposite sign.
    """
    rows: list[tuple] = []
    for control, surface, sign, position in HANDS:
        if not {control, surface} <= set(signals.values):
            continue
        mask = signals.mask((control, surface))
        x = remove_trim(lowpass_channel(signals, control), signals)
        y = remove_trim(lowpass_channel(signals, surface), signals)
        if mask.sum() * signals.step > SHORTEST and np.std(y[mask]) > _MOVES:
            best = _correlate(x, y, expected=sign, mask=mask, step=signals.step)
            rows.append((control, surface, sign, *best, position))
    return pd.DataFrame(
        rows, columns=["control", "surface", "expected", "correlation", "delay", "position"]
    )


def _correlate(
    x: np.ndarray, y: np.ndarray, *, expected: int, mask: np.ndarray, step: float
) -> tuple[float, float]:
    """Return the correlation of a surface y with a control x, and the delay of the surface.
    [1, s]
    """
    longest = round(LONGEST / step)
    delays = np.arange(-longest, longest + 1)
    correlations = np.zeros(len(delays))
    for i, delay in enumerate(delays):
        # the ends that np.roll wraps around are high-passed, and small
        shifted = np.roll(x, delay)[mask]
        if np.std(shifted) > 0.0:
            correlations[i] = np.corrcoef(shifted, y[mask])[0, 1]
    right = int(np.argmax(expected * correlations))
    wrong = int(np.argmax(-expected * correlations))
    strong = abs(correlations[right]) > abs(correlations[wrong]) - _AMBIGUOUS
    best = wrong
    if strong and correlations[right] * expected > FOLLOWS:
        best = right
    # nothing follows at any delay
    if abs(correlations[best]) < FOLLOWS:
        best = right
    return float(correlations[best]), float(delays[best] * step)


def lowpass_channel(signals: ResampledChannels, name: str) -> np.ndarray:
    """Return a channel without the frequencies above the band of the checks."""
    return lowpass_if_possible(signals[name], signals.step, BAND)


def remove_trim(x: np.ndarray, signals: ResampledChannels) -> np.ndarray:
    """Return a time history without trim and slow drift."""
    return x - lowpass_if_possible(x, signals.step, _TRIM)


def relative_pressure(signals: ResampledChannels, mask: np.ndarray) -> np.ndarray:
    """Return the dynamic pressure over its mean, from the speed; one without a speed. [1]"""
    speed = next((name for name in ("V", "V_cas") if name in signals), None)
    if speed is None:
        return np.ones_like(signals.time)
    V = np.maximum(signals[speed], _SMALLEST_SPEED * np.median(signals[speed][mask]))
    return V**2 / (V**2)[mask].mean()

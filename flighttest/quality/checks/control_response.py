"""Whether the aeroplane responds to its controls with the signs of the vocabulary, and by how much.

Kinematics do not show the sign of a surface; the aeroplane does.  Angular accelerations are regressed on rates, flow angles and
surfaces, all high-passed so that trim and slow drift have no part in it.  Positive elevator pitches down, positive aileron rolls
left, positive rudder yaws left; side force opposes sideslip; the surface follows the pilot's hand.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.units import DEGREE

from ...signals.differentiation import derivative
from ...uncertainty.coloured_residuals import coloured
from ..finding import Finding, later, map_entry, rows
from .signals import BAND, Signals, smooth

SIGNIFICANT = 6.0  # standard errors a coefficient must have before its sign counts
FOLLOWS = 0.5  # correlation of a surface with the hand that moves it
_TRIM = 0.3  # Hz, below which nothing counts
_MEMORY = 2.0  # s over which residuals are taken as correlated
_LOWEST_R2 = 0.15
_SHIFTS = np.linspace(-0.2, 0.4, 25)  # s
_EARLY, _LATE, _GAINS = 0.05, -0.15, 0.03  # s, and R2, beyond which a surface was not recorded when it acted
_CERTAIN = 3.0  # standard errors by which the time must lie beyond
_ACTIVE, _AROUND = 0.25, 1.5  # of the largest movement, and s around it: samples that show when a surface acts
_MOVED = 1.0 * DEGREE  # total movement without which a delay is not informative
_FLOW = {"alpha_vane", "beta_vane"}
_EXPLAINED = 0.4  # R2 that the equation must reach about the movements with the best delay
_MOVES = 0.05 * DEGREE  # rms of quick movement that makes an input
_SMALL = 0.6 * DEGREE  # total movement below which an effect must not be large
_STRONGEST = {"delta_e": 100.0, "delta_a": 100.0, "delta_r": 20.0}  # 1/s2 per radian at the mean speed of the record
_WORDS = {
    "delta_e": "pitches the nose up (convention: trailing edge down is positive and pitches down)",
    "delta_a": "rolls to the right (convention: right aileron down is positive and rolls left)",
    "delta_r": "yaws to the right (convention: trailing edge left is positive and yaws left)",
}


@dataclass(frozen=True)
class Equation:
    """One answer of the aeroplane: what is explained, and by what."""

    rate: str
    others: tuple[str, ...]
    surface: str


EQUATIONS = (
    Equation("q", ("q", "alpha_vane"), "delta_e"),
    Equation("p", ("p", "r", "beta_vane", "delta_r"), "delta_a"),
    Equation("r", ("p", "r", "beta_vane", "delta_a"), "delta_r"),
)
HANDS = (  # pilot's control, what it moves, sign of the vocabulary, whether it is a position
    ("column", "delta_e", -1, True),
    ("wheel", "delta_a", -1, True),
    ("pedal", "delta_r", -1, True),
    ("F_column", "delta_e", -1, False),
    ("F_wheel", "delta_a", -1, False),
    ("F_pedal", "delta_r", -1, False),
)


def answers(signals: Signals) -> pd.DataFrame:
    """Return how the aeroplane answers each surface.

    Parameters
    ----------
    signals : Signals
        With right signs and units of rates and flow angles.

    Returns
    -------
    DataFrame
        One row per surface that moves: ``surface rate effect stderr ratio R2 movement lead lead_stderr gained explained``; effect is the
        angular acceleration per radian at the mean dynamic pressure of the flight [s-2], stderr that of coloured residuals, movement the
        range between 0.5 and 99.5 % [rad], lead the time by which the surface is recorded before it acts and lead_stderr its standard
        error [s], gained the R2 that delaying it gains, and explained the R2 with that delay, both about the movements of the surface.

    Notes
    -----
    Only samples about the movements of a surface show when it acts.  In all others, of which a flight has more, a delayed surface
    makes up for what else the equation lacks: a vane on the wing in a roll is enough for a delay of 0.2 s.
    """
    table: list = []
    for equation in EQUATIONS:
        if not {equation.rate, equation.surface} <= set(signals.values):
            continue
        others = [name for name in equation.others if name in signals and np.ptp(signals[name]) > 0.0]
        names = (*others, equation.surface)
        mask = signals.mask((equation.rate, *names))
        x = signals[equation.surface][mask]
        if mask.sum() * signals.step < 5.0 or np.ptp(x) == 0.0 or np.ptp(signals[equation.rate][mask]) == 0.0:
            continue
        scale = _pressure(signals, mask)
        y = _fast(derivative(_slow(signals, equation.rate), signals.step, 5, 2) / scale, signals)[mask]
        columns = [_fast(_slow(signals, n) / (np.sqrt(scale) if n in "pqr" else 1.0), signals)[mask] for n in names[:-1]]
        surface = _fast(_slow(signals, equation.surface), signals)
        fit = _regressed(y, [*columns, surface[mask]], mask, signals.step)
        if fit is not None:
            effect, stderr, R2 = fit
            movement = float(np.percentile(x, 99.5) - np.percentile(x, 0.5))
            active = mask & _about_movements(surface, mask, signals.step)
            inside = active[mask]
            timing = _lead(y[inside], [column[inside] for column in columns], surface, signals.time, active)
            table.append((equation.surface, equation.rate, effect, stderr, effect / max(stderr, 1e-300), R2, movement, *timing))
    about = ["surface", "rate", "effect", "stderr", "ratio", "R2", "movement", "lead", "lead_stderr", "gained", "explained"]
    return pd.DataFrame(table, columns=about)


def _about_movements(surface: np.ndarray, mask: np.ndarray, step: float) -> np.ndarray:
    """Return the samples about the larger quick movements of a surface."""
    large = np.abs(surface) > _ACTIVE * np.percentile(np.abs(surface[mask]), 99.5)
    width = 2 * min(round(_AROUND / step), (len(large) - 1) // 2) + 1
    return np.convolve(large, np.ones(width), mode="same") > 0.5


def _lead(
    y: np.ndarray, columns: Sequence[np.ndarray], surface: np.ndarray, time: np.ndarray, mask: np.ndarray
) -> tuple[float, float, float, float]:
    """Return by how much the surface must be delayed to explain the motion best, its standard error [s], the R2 gained and reached.

    The standard error is that of the linear model at the best delay: a delay adds the derivative of the surface times its effect.
    """
    left = []
    for shift in _SHIFTS:
        X = np.stack([*columns, np.interp(time - shift, time, surface)[mask]], axis=1)
        left.append(float(np.var(y - X @ np.linalg.lstsq(X, y, rcond=None)[0]) / np.var(y)))
    at = int(np.argmin(left))
    best = float(_SHIFTS[at])
    if 0 < at < len(left) - 1 and (bend := left[at - 1] - 2.0 * left[at] + left[at + 1]) > 0.0:
        best -= (_SHIFTS[1] - _SHIFTS[0]) * (left[at + 1] - left[at - 1]) / (2.0 * bend)
    delayed = np.interp(time - best, time, surface)
    step = float(time[1] - time[0])
    effect = _regressed(y, [*columns, delayed[mask]], mask, step)
    slope = _regressed(y, [*columns, delayed[mask], np.gradient(delayed, step)[mask]], mask, step)
    stderr = np.inf if effect is None or slope is None or effect[0] == 0.0 else slope[1] / abs(effect[0])
    return best, float(stderr), float(np.interp(0.0, _SHIFTS, left)) - left[at], 1.0 - left[at]


def hands(signals: Signals) -> pd.DataFrame:
    """Return how each surface follows the pilot's control: ``control surface expected correlation position``."""
    table: list = []
    for control, surface, sign, position in HANDS:
        if {control, surface} <= set(signals.values):
            mask = signals.mask((control, surface))
            x, y = (_fast(_slow(signals, name), signals)[mask] for name in (control, surface))
            if mask.sum() * signals.step > 5.0 and np.std(y) > _MOVES:
                correlation = float(np.corrcoef(x, y)[0, 1]) if np.std(x) > 0.0 else 0.0
                table.append((control, surface, sign, correlation, position))
    return pd.DataFrame(table, columns=["control", "surface", "expected", "correlation", "position"])


def answer_findings(
    table: pd.DataFrame, followed: pd.DataFrame, signals: Signals, record: xr.DataTree, late: Collection[str] = ()
) -> list[Finding]:
    """Return the surfaces that move the aeroplane the wrong way, far too much or at another time, and the controls that nothing follows.

    Channels that are `late` themselves show nothing about the time of a surface, nor does an equation without its flow angle.
    """
    found = []
    for row in rows(table):
        wrong = _surface(row, record) if row.R2 >= _LOWEST_R2 and abs(row.ratio) >= SIGNIFICANT else []
        others = next(equation.others for equation in EQUATIONS if equation.surface == row.surface)
        untimed = set(others) & set(late) or (set(others) & _FLOW) - set(signals.values)
        found += wrong or ([] if untimed else _timing(row, record))
    for row in rows(followed):
        found += _hand(row, record)
    return found + _side_force(signals)


def _surface(row, record: xr.DataTree) -> list[Finding]:
    name, names = row.surface, (row.surface, row.rate)
    evidence = {"effect": row.effect, "stderr": row.stderr, "R2": row.R2}
    measured = f"{row.rate}_dot = {row.effect:+.3g} 1/s2 per rad of {name}, {abs(row.ratio):.0f} standard errors"
    if row.effect > 0.0:
        text = f"{name} has the wrong sign: positive {name} {_WORDS[name]}; {measured}"
        return [Finding("error", "sign", names, text, map_entry(record, name, -1.0), evidence=evidence)]
    if row.movement < _SMALL and abs(row.effect) > _STRONGEST[name]:
        text = f"{name} is in rad and was taken as deg: it moves by {row.movement / DEGREE:.2g} deg in all, and {measured}"
        return [Finding("error", "unit", names, text, map_entry(record, name, 1.0 / DEGREE), evidence=evidence)]
    return []


def _timing(row, record: xr.DataTree) -> list[Finding]:
    """Return whether a surface was recorded when it acted."""
    name, names = row.surface, (row.surface, row.rate)
    margin = _CERTAIN * row.lead_stderr
    off = (row.lead - margin > _EARLY or row.lead + margin < _LATE) and row.gained > _GAINS
    if off and row.movement > _MOVED and row.explained > _EXPLAINED:
        when = "before" if row.lead > 0.0 else "after"
        text = (
            f"{name} is recorded {1e3 * abs(row.lead):.0f} ms (standard error {1e3 * row.lead_stderr:.0f} ms) {when} it acts on "
            f"{row.rate}_dot (that time gains {row.gained:.2f} of R2)"
        )
        line = later(record, name, lag=-row.lead) if row.lead > 0.0 else later(record, name, delay=-row.lead)
        cause = "a command, whose actuator lags" if row.lead > 0.0 else "a clock that is late"
        remedy = f"{line}, if it is {cause}" if line else f"{cause}: put the time between"
        return [
            Finding("warning", "lag", names, text, remedy, evidence={"lead": row.lead, "stderr": row.lead_stderr, "gained": row.gained})
        ]
    return []


def _hand(row, record: xr.DataTree) -> list[Finding]:
    names, evidence, detail = (row.control, row.surface), {"correlation": row.correlation}, f"(correlation {row.correlation:+.2f})"
    if row.expected * row.correlation < -FOLLOWS:
        text = f"{row.control} has the wrong sign: it moves with {row.surface} instead of against it {detail}"
        return [Finding("error", "sign", names, text, map_entry(record, row.control, -1.0), evidence=evidence)]
    if row.position and abs(row.correlation) < FOLLOWS:
        text = f"{row.surface} moves and {row.control} does not go with it {detail}"
        return [Finding("warning", "stuck", names, text, "check the pick-up; do not use the channel", evidence=evidence)]
    return []


def _side_force(signals: Signals) -> list[Finding]:
    """Side force opposes sideslip, whatever the aeroplane."""
    if not {"ay_imu", "beta_vane"} <= set(signals.values):
        return []
    mask = signals.mask(("ay_imu", "beta_vane"))
    if mask.sum() * signals.step < 5.0 or np.std(signals["beta_vane"][mask]) < 0.5 * DEGREE:
        return []
    scale = _pressure(signals, mask)
    others = [_fast(_slow(signals, name), signals)[mask] for name in ("p", "r", "delta_r") if name in signals]
    columns = [*others, _fast(signals["beta_vane"], signals)[mask]]
    fit = _regressed(_fast(signals["ay_imu"] / scale, signals)[mask], columns, mask, signals.step)
    if fit is None or fit[2] < _LOWEST_R2 or fit[0] / fit[1] < SIGNIFICANT:
        return []
    effect, stderr, R2 = fit
    detail = f"{effect:+.3g} m/s2 per rad, {effect / stderr:.0f} standard errors"
    text = f"ay_imu grows with beta_vane ({detail}): side force must oppose sideslip"
    remedy = "sign = -1 on one of the two; the check of kinematics shows which"
    return [Finding("error", "sign", ("ay_imu", "beta_vane"), text, remedy, evidence={"effect": effect, "stderr": stderr, "R2": R2})]


def _slow(signals: Signals, name: str) -> np.ndarray:
    return smooth(signals[name], signals.step, BAND)


def _fast(x: np.ndarray, signals: Signals) -> np.ndarray:
    return x - smooth(x, signals.step, _TRIM)


def _pressure(signals: Signals, mask: np.ndarray) -> np.ndarray:
    """Dynamic pressure over its mean, from the speed; one where no speed is recorded."""
    speed = next((name for name in ("V", "V_cas") if name in signals), None)
    if speed is None:
        return np.ones_like(signals.time)
    V2 = np.maximum(signals[speed], 0.3 * np.median(signals[speed][mask])) ** 2
    return V2 / V2[mask].mean()


def _regressed(y: np.ndarray, columns: Sequence[np.ndarray], mask: np.ndarray, step: float) -> tuple[float, float, float] | None:
    """Return the coefficient of the last column, its standard error with coloured residuals, and R2."""
    X = np.stack(columns, axis=1)
    size = X.std(axis=0)
    if (size < 1e-12).any() or len(y) < 10 * X.shape[1]:
        return None
    scaled = X / size
    if np.linalg.cond(scaled) > 1e6:
        return None
    theta = np.linalg.lstsq(scaled, y, rcond=None)[0]
    residual = y - scaled @ theta
    breaks = np.flatnonzero(np.diff(np.flatnonzero(mask)) > 1) + 1
    bounds = [0, *breaks.tolist(), len(y)]
    pieces = [slice(a, b) for a, b in pairwise(bounds)]
    covariance = coloured(scaled, residual, pieces, [step] * len(pieces), lag=_MEMORY).covariance
    return float(theta[-1] / size[-1]), float(np.sqrt(covariance[-1, -1]) / size[-1]), float(1.0 - residual.var() / y.var())

"""Surfaces whose column goes on in another unit: degrees up to a time, radians after it.

The motion is that of one aeroplane, so that the effect of a radian is the same before and after
any time.  A column that changes its unit shows two effects, with the ratio of the two units.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flightmech.quantities import time_text
from flightmech.units import DEGREE
from flighttest.reconstruction.quality.checks.control_response import (
    EQUATIONS,
    Equation,
    prepare_regression,
)
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.finding import Finding

# Largest quotient of the ratio of two effects and that of degree and radian, either way.
_NEAR = 2.0
# Times of a change that are tried.
_TRIES = 40
# Largest share of the unexplained variance that two effects leave of what one effect leaves.
_LEFT = 0.95
# Least effect over its standard error, of white residuals.
_CERTAIN = 10.0
# Share of the samples before and after a change.
_LEAST_SHARE = 0.1


class _Change(NamedTuple):
    """Time of a change [s], and the effects of the surface before and after it [s-2]."""

    time: float
    before: float
    after: float
    left: float


def changing_unit_findings(signals: ResampledChannels) -> list[Finding]:
    """Return the errors of surfaces that change between degrees and radians within a record.

    Parameters
    ----------
    signals : ResampledChannels
        With correct signs and units of rates and flow angles.
    """
    findings = []
    for equation in EQUATIONS:
        change = _find_change(equation, signals)
        if change is None:
            continue
        name = equation.surface
        grows = abs(change.after) > abs(change.before)
        units = ("deg", "rad") if grows else ("rad", "deg")
        text = (
            f"{name} changes its unit at about {time_text(change.time)} s: {equation.rate}_dot is "
            f"{change.before:+.3g} 1/s2 per rad of {name} before and {change.after:+.3g} after it, "
            f"as if the column were in {units[0]} and went on in {units[1]}"
        )
        remedy = (
            "convert one of the two parts before the file is read, or split the file there and "
            "give each part its name map"
        )
        evidence = {"before": change.before, "after": change.after}
        findings.append(
            Finding("error", "unit", (name,), text, remedy, start=change.time, evidence=evidence)
        )
    return findings


def _find_change(equation: Equation, signals: ResampledChannels) -> _Change | None:
    """Return the change of unit that explains the motion; None without one."""
    data = prepare_regression(equation, signals)
    if data is None:
        return None
    used = data.mask
    y, time = data.y[used], data.time[used]
    X = np.stack([*(column[used] for column in data.columns), data.surface[used]], axis=1)
    one = _unexplained(X, y)[1]
    best: _Change | None = None
    least = int(_LEAST_SHARE * len(y))
    for i in np.linspace(least, len(y) - least, _TRIES).astype(int):
        change = _split_at(X, y, int(i), float(time[i]))
        if change is None or change.left > _LEFT * one or not _is_of_units(change):
            continue
        if best is None or change.left < best.left:
            best = change
    return best


def _is_of_units(change: _Change) -> bool:
    """Return whether two effects have the ratio of degree and radian."""
    quotient = change.after / change.before
    # effects of opposite signs are negative, and no change of unit
    return 1.0 / _NEAR < max(quotient, 1.0 / quotient) * DEGREE < _NEAR


def _split_at(X: np.ndarray, y: np.ndarray, i: int, time: float) -> _Change | None:
    """Return the effects before and after a sample; None if one of them is not certain."""
    surface = X[:, -1]
    after = np.arange(len(y)) >= i
    parts = np.stack([np.where(after, 0.0, surface), np.where(after, surface, 0.0)], axis=1)
    both = np.concatenate([X[:, :-1], parts], axis=1)
    theta, left = _unexplained(both, y)
    information = both.T @ both
    if np.linalg.cond(information) > 1e14:
        return None
    variance = np.diag(np.linalg.inv(information))[-2:] * left / len(y)
    if not (np.abs(theta[-2:]) > _CERTAIN * np.sqrt(variance)).all():
        return None
    return _Change(time, float(theta[-2]), float(theta[-1]), left)


def _unexplained(X: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the coefficients of a regression, and the sum of its squared residuals."""
    theta = np.linalg.lstsq(X, y, rcond=1e-10)[0]
    return theta, float(np.sum((y - X @ theta) ** 2))

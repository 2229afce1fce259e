"""The figure of a local model on paper: measured and fitted coefficient, residual, its autocorrelation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flightmech.support.svg_chart import WIDTH, Frame, axes, clipped, curve, limits, line, spaced, text, ticks
from pom.report.presentation.quantities import number, symbol
from pom.report.submodels.section import Picture

if TYPE_CHECKING:
    import flighttest

_LEFT, _TOP, _GAP, _FOOT = 50.0, 18.0, 62.0, 30.0
_HIGH, _LOW = 84.0, 40.0  # panel of the coefficient, of its residual
_WIDE = 0.66  # part of the width that the time histories take
_SPACE = "\N{NO-BREAK SPACE}"
_MOST_SAMPLES = 1500  # drawn: a line of 430 units shows no more
_MOST_LAG = 5.0  # [s] of the autocorrelation


def fit_picture(index: int, fit: flighttest.Fit) -> Picture:
    """Return coefficient and residual over the time of the samples, and the autocorrelation of the residual."""
    name = fit.model.coefficient
    base, sub = symbol(name)
    every = max(1, -(-fit.data.sizes["sample"] // _MOST_SAMPLES))
    along, residual = fit.time_along, fit.residual
    time, rest, measured = along[::every], residual[::every], fit.data[name].values[::every]
    wide = _WIDE * WIDTH - _LEFT
    upper = Frame(_LEFT, _TOP, wide, _HIGH, (0.0, float(along[-1])), limits(np.concatenate([measured, measured - rest]), 0.06))
    lower = Frame(_LEFT, upper.bottom + 6.0, wide, _LOW, upper.x, limits(rest, 0.06))
    starts = along[1:][np.diff(fit.data["manoeuvre"].values) != 0]
    parts = [
        spaced(
            _LEFT,
            _TOP - 5.0,
            [
                (base, "symbol"),
                (sub, "sub"),
                ("\N{NO-BREAK SPACE}\N{NO-BREAK SPACE}measured, and fitted by the local model (dashed)", "caption"),
            ],
        ),
        axes(upper, x_labels=False, x_most=8),
        *(line(float(frame.px(at)), frame.top, float(frame.px(at)), frame.bottom, "window") for frame in (upper, lower) for at in starts),
        clipped(upper, f"fit-{index}", curve(upper, time, measured, "trace run-0") + curve(upper, time, measured - rest, "trace run-3")),
        axes(lower, x_labels=True, x_most=8, y_ticks=ticks(*lower.y, 3)),
        clipped(lower, f"fit-{index}-e", curve(lower, time, rest, "trace run-0")),
        text(_LEFT + wide / 2, lower.bottom + 24.0, "residual over the time of the samples, s", "caption", "middle"),
    ]
    lag, correlation, bound = _autocorrelation(fit, along, residual)
    frame = Frame(_LEFT + wide + _GAP, _TOP, WIDTH - _LEFT - wide - _GAP - 8.0, lower.bottom - _TOP, (0.0, float(lag[-1])), (-0.5, 1.05))
    parts += [text(frame.left, _TOP - 5.0, "autocorrelation of the residual", "caption"), axes(frame, x_labels=True, x_most=5)]
    parts += [line(frame.left, float(frame.py(at)), frame.right, float(frame.py(at)), "event") for at in (0.0,)]
    parts += [line(frame.left, float(frame.py(at)), frame.right, float(frame.py(at)), "window") for at in (-bound, bound)]
    parts += [clipped(frame, f"fit-{index}-r", curve(frame, lag, correlation, "trace run-0"))]
    parts += [text(frame.left + frame.width / 2, frame.bottom + 24.0, "lag, s", "caption", "middle")]
    rms = number(float(np.sqrt(np.mean(residual**2))), 3)
    words = f"{name} of {fit.name}: measured, fitted, residual with an rms of {rms}, its autocorrelation"
    return Picture("".join(parts), lower.bottom + _FOOT, words)


def _autocorrelation(fit: flighttest.Fit, along: np.ndarray, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return lags [s], biased autocorrelation of the residual over the lags of all manoeuvres, and two standard errors of white noise."""
    step = float(np.median(np.diff(along)))
    pieces = np.split(residual - residual.mean(), np.flatnonzero(np.diff(fit.data["manoeuvre"].values)) + 1)
    most = min(round(_MOST_LAG / step), max(map(len, pieces)) - 1)
    total = np.array([sum(float(v[k:] @ v[: len(v) - k]) for v in pieces if len(v) > k) for k in range(most + 1)])
    return step * np.arange(most + 1), total / total[0] if total[0] > 0.0 else total, 2.0 / np.sqrt(len(residual))

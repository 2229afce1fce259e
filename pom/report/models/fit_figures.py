"""Figures of the identification: every fit over its samples, and the map of the samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

import flighttest
from flightmech.support.figures import (
    WIDTH,
    Frame,
    choose_ticks,
    clip_to_frame,
    draw_axes,
    draw_curve,
    draw_dots,
    draw_line,
    draw_text,
    find_axis_limits,
    text_pieces,
)
from pom.report.presentation.quantities import format_number, quantity_label, symbol_parts
from pom.report.submodels.section import Picture

_LEFT, _TOP, _GAP, _FOOT = 50.0, 18.0, 62.0, 30.0
_HIGH, _LOW = 84.0, 40.0  # panel of the coefficient, of its residual
_WIDE = 0.66 * WIDTH - _LEFT  # width of the time histories
_SPACE = "\N{NO-BREAK SPACE}"
_MOST_SAMPLES = 1500  # drawn: a line of 430 units shows no more
_MOST_LAG = 5.0  # [s] of the autocorrelation
_LINES = 4  # line codes of the 1 g lines
_CELLS = 160  # of the map of test points, in each direction


def fit_picture(index: int, fit: flighttest.Fit) -> Picture:
    """Return coefficient and residual over time, and the autocorrelation of the residual.

    Parameters
    ----------
    index : int
        Number of the fit in the report.
    fit : Fit
        Local model with its samples and their time.
    """
    along, residual = fit.time_along, fit.residual
    histories, bottom = _draw_histories(index, fit, along, residual)
    correlation = _draw_autocorrelation(index, fit, along=along, residual=residual, bottom=bottom)
    name = fit.model.coefficient
    rms = format_number(float(np.sqrt(np.mean(residual**2))), 3)
    description = (
        f"{name} of {fit.name}: measured, fitted, residual with an rms of {rms}, its "
        f"autocorrelation"
    )
    return Picture("".join(histories + correlation), bottom + _FOOT, description)


def _draw_histories(
    index: int, fit: flighttest.Fit, along: np.ndarray, residual: np.ndarray
) -> tuple[list[str], float]:
    """Return the panels of coefficient and residual, and their lower edge."""
    name = fit.model.coefficient
    # Every n-th sample, n rounded up.
    step = max(1, -(-fit.data.sizes["sample"] // _MOST_SAMPLES))
    time, error, measured = along[::step], residual[::step], fit.data[name].values[::step]
    fitted = measured - error
    limits = find_axis_limits(np.concatenate([measured, fitted]), 0.06)
    upper = Frame(_LEFT, _TOP, _WIDE, height=_HIGH, x=(0.0, float(along[-1])), y=limits)
    error_limits = find_axis_limits(error, 0.06)
    lower = Frame(_LEFT, upper.bottom + 6.0, _WIDE, height=_LOW, x=upper.x, y=error_limits)

    base, subscript = symbol_parts(name)
    caption = f"{2 * _SPACE}measured, and fitted by the local model (dashed)"
    heading = [(base, "symbol"), (subscript, "sub"), (caption, "caption")]
    parts = [
        text_pieces(_LEFT, _TOP - 5.0, heading),
        draw_axes(upper, x_labels=False, x_most=8),
    ]
    # A line at the start of every manoeuvre after the first one.
    starts = along[1:][np.diff(fit.data["manoeuvre"].values) != 0]
    for frame in (upper, lower):
        for start in starts:
            x = float(frame.px(start))
            parts.append(draw_line(x, frame.top, x, frame.bottom, "window"))
    curves = draw_curve(upper, time, measured, "trace run-0")
    curves += draw_curve(upper, time, fitted, "trace run-3")
    error_curve = draw_curve(lower, time, error, "trace run-0")
    middle, label = _LEFT + _WIDE / 2, "residual over the time of the samples, s"
    parts += [
        clip_to_frame(upper, f"fit-{index}", curves),
        draw_axes(lower, x_labels=True, x_most=8, y_ticks=choose_ticks(*lower.y, 3)),
        clip_to_frame(lower, f"fit-{index}-e", error_curve),
        draw_text(middle, lower.bottom + 24.0, label, "caption", "middle"),
    ]
    return parts, lower.bottom


def _draw_autocorrelation(
    index: int,
    fit: flighttest.Fit,
    along: np.ndarray,
    residual: np.ndarray,
    bottom: float,
) -> list[str]:
    """Return the panel of the autocorrelation, to the right of the time histories."""
    lag, correlation, bound = _autocorrelation(fit, along, residual)
    left = _LEFT + _WIDE + _GAP
    width = WIDTH - _LEFT - _WIDE - _GAP - 8.0
    frame = Frame(left, _TOP, width, height=bottom - _TOP, x=(0.0, float(lag[-1])), y=(-0.5, 1.05))
    parts = [
        draw_text(left, _TOP - 5.0, "autocorrelation of the residual", "caption"),
        draw_axes(frame, x_labels=True, x_most=5),
    ]
    # Zero, and two standard errors of white noise.
    for level, css in ((0.0, "event"), (-bound, "window"), (bound, "window")):
        y = float(frame.py(level))
        parts.append(draw_line(frame.left, y, frame.right, y, css))
    curve = draw_curve(frame, lag, correlation, "trace run-0")
    middle = frame.left + frame.width / 2
    parts += [
        clip_to_frame(frame, f"fit-{index}-r", curve),
        draw_text(middle, frame.bottom + 24.0, "lag, s", "caption", "middle"),
    ]
    return parts


def _autocorrelation(
    fit: flighttest.Fit, along: np.ndarray, residual: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return lags [s], biased autocorrelation of all manoeuvres, two standard errors of noise."""
    step = float(np.median(np.diff(along)))
    starts = np.flatnonzero(np.diff(fit.data["manoeuvre"].values)) + 1
    pieces = np.split(residual - residual.mean(), starts)
    most = min(round(_MOST_LAG / step), max(map(len, pieces)) - 1)
    # Sum of products at every lag, over the manoeuvres that are longer than the lag.
    sums = []
    for k in range(most + 1):
        sums.append(sum(float(v[k:] @ v[: len(v) - k]) for v in pieces if len(v) > k))
    correlation = np.array(sums)
    if correlation[0] > 0.0:
        correlation = correlation / correlation[0]
    return step * np.arange(most + 1), correlation, 2.0 / np.sqrt(len(residual))


def sample_map(
    fits: Sequence[flighttest.Fit], level_lines: Mapping[str, xr.Dataset] | None = None
) -> Picture | None:
    """Return a figure of angle of attack and Mach number of the samples, as LR-743 Fig. 9.

    Parameters
    ----------
    fits : sequence of Fit
    level_lines : mapping of str to Dataset (mach,), optional
        1 g lines by name.

    Returns
    -------
    Picture or None
        None without samples.
    """
    data = [fit.data for fit in fits if "alpha" in fit.data and "mach" in fit.data]
    if not data:
        return None
    alpha = np.concatenate([samples["alpha"].values for samples in data])
    mach = np.concatenate([samples["mach"].values for samples in data])
    finite = np.isfinite(alpha) & np.isfinite(mach)
    x, y = mach[finite], quantity_label("alpha").shown(alpha[finite])
    if not len(x):
        return None
    # the name of the axis stands above the frame, where no number of the axis can be
    frame = Frame(54.0, 22.0, WIDTH - 66.0, height=240.0, x=_map_limits(x), y=_map_limits(y))
    centres = _cell_centres(frame, x, y)
    body = draw_axes(frame, x_labels=True)
    body += draw_dots(frame, centres[0], centres[1], "test-point")
    middle = frame.left + frame.width / 2
    body += text_pieces(middle, frame.bottom + 28, [("M", "symbol")], "middle")
    body += text_pieces(frame.left, 14, [("α", "symbol"), (", deg", "caption")])
    description = f"Angle of attack and Mach number of {len(x)} samples"
    bottom = frame.bottom + 36
    if level_lines:
        for i, (name, line) in enumerate(level_lines.items()):
            body += _draw_level_line(frame, i, name=name, line=line)
        description = f"{description}; 1 g lines: {', '.join(level_lines)}"
        # Two names side by side; rows rounded up.
        bottom = bottom + 10 + 14 * -(-len(level_lines) // 2)
    return Picture(body, bottom, description)


def _cell_centres(frame: Frame, x: np.ndarray, y: np.ndarray) -> list[np.ndarray]:
    """Return the centres of the cells of the map that hold samples, so that each is drawn once."""
    indices = []
    for values, (low, high) in ((x, frame.x), (y, frame.y)):
        indices.append(np.floor(_CELLS * (values - low) / (high - low)))
    centres = []
    cells = np.unique(np.stack(indices), axis=1)
    for cell, (low, high) in zip(cells, (frame.x, frame.y), strict=True):
        centres.append(low + (cell + 0.5) / _CELLS * (high - low))
    return centres


def _draw_level_line(frame: Frame, i: int, name: str, line: xr.Dataset) -> str:
    """Return a 1 g line with its number, and its entry in the key below the map."""
    css = f"run-{i % _LINES}"
    x, y = line["mach"].values, quantity_label("alpha").shown(line["alpha"].values)
    body = clip_to_frame(frame, f"level-{i}", draw_curve(frame, x, y, f"trace {css}"))
    left = frame.left + i % 2 * frame.width / 2
    down = frame.bottom + 36 + 4 + 14 * (i // 2)
    body += draw_line(left, down, left + 30, down, f"trace {css}")
    body += draw_text(left + 36, down + 3.5, f"{i + 1}: 1 g, {name}", "caption")
    # The number is at the point where the line leaves the frame.
    inside = np.flatnonzero(
        (x >= frame.x[0]) & (x <= frame.x[1]) & (y >= frame.y[0]) & (y <= frame.y[1])
    )
    if len(inside):
        px, py = float(frame.px(x[inside[-1]])), float(frame.py(y[inside[-1]]))
        body += draw_text(px - 3, py - 4, str(i + 1), "caption", "end")
    return body


def _map_limits(values: np.ndarray) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    margin = 0.04 * (high - low) or 0.05
    return low - margin, high + margin

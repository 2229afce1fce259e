"""Small time histories, thinned so that no peak is lost, and points with a line, as inline SVG."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from markupsafe import Markup

WIDTH, HEIGHT = 560, 170
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 8, 22, 22
_BUCKETS = 420


def chart(
    time: np.ndarray,
    lines: Sequence[np.ndarray],
    units: str,
    shaded: Sequence[tuple[float, float]] = (),
    flagged: Sequence[tuple[float, float]] = (),
    label: str = "",
) -> Markup:
    """Return a chart of one or two lines over time.

    Parameters
    ----------
    time : array (time,)
        [s]
    lines : sequence of array (time,)
        In the unit to be shown; the first is drawn on top.
    units : str
        Shown at the axis.
    shaded, flagged : sequence of (float, float)
        Spans in grey and in red. [s]
    label : str
        Text for screen readers.
    """
    finite = np.concatenate([line[np.isfinite(line)] for line in lines]) if lines else np.array([0.0])
    low, high = _range(finite if len(finite) else np.array([0.0, 1.0]))
    start, stop = float(time[0]), float(max(time[-1], time[0] + 1e-9))

    def x(t):
        return _LEFT + (np.asarray(t) - start) / (stop - start) * (WIDTH - _LEFT - _RIGHT)

    def y(v):
        return HEIGHT - _BOTTOM - (np.asarray(v) - low) / (high - low) * (HEIGHT - _TOP - _BOTTOM)

    parts = [f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{label}">']
    parts += [_span(x, a, b, "ground", 0.0) for a, b in shaded] + [_span(x, a, b, "fault", 2.0) for a, b in flagged]
    for value in ticks(low, high, 4):
        place = float(y(value))
        parts.append(f'<path class="axis" d="M{_LEFT} {place:.1f}H{WIDTH - _RIGHT}"/>')
        parts.append(f'<text x="{_LEFT - 5}" y="{place + 4:.1f}" text-anchor="end">{value + 0.0:.5g}</text>')
    for value in ticks(start, stop, 6):
        parts.append(f'<text x="{float(x(value)):.1f}" y="{HEIGHT - 6}" text-anchor="middle">{value + 0.0:g} s</text>')
    parts.append(f'<text x="4" y="11">{units}</text>')
    for line, style in reversed(list(zip(lines, ("one", "two")))):
        parts += [f'<path class="{style}" d="{path}"/>' for path in _paths(time, line, x, y)]
    return Markup("".join([*parts, "</svg>"]))  # numbers and names of the vocabulary only


def scatter(x: np.ndarray, y: np.ndarray, line: tuple[float, float], names: tuple[str, str], label: str = "") -> Markup:
    """Return points and a straight line.

    Parameters
    ----------
    x, y : array (point,)
        In the units to be shown.
    line : (float, float)
        Offset and slope.
    names : (str, str)
        Of the axes, with their units.
    label : str
        Text for screen readers.
    """
    (left, right), (low, high) = (_range(values) for values in (x, np.append(y, line[0] + line[1] * x)))

    def across(v):
        return _LEFT + (np.asarray(v) - left) / (right - left) * (WIDTH - _LEFT - _RIGHT)

    def up(v):
        return HEIGHT - _BOTTOM - (np.asarray(v) - low) / (high - low) * (HEIGHT - _TOP - _BOTTOM)

    parts = [f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{label}">']
    for value in ticks(low, high, 4):
        parts.append(f'<path class="axis" d="M{_LEFT} {float(up(value)):.1f}H{WIDTH - _RIGHT}"/>')
        parts.append(f'<text x="{_LEFT - 5}" y="{float(up(value)) + 4:.1f}" text-anchor="end">{value + 0.0:.5g}</text>')
    for value in ticks(left, right, 6):
        parts.append(f'<text x="{float(across(value)):.1f}" y="{HEIGHT - 6}" text-anchor="middle">{value + 0.0:.5g}</text>')
    parts.append(f'<text x="4" y="11">{names[1]}</text><text x="{WIDTH - _RIGHT}" y="11" text-anchor="end">over {names[0]}</text>')
    ends = np.array([x.min(), x.max()])
    (x1, x2), (y1, y2) = across(ends), up(line[0] + line[1] * ends)
    parts.append(f'<path class="two" d="M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}"/>')
    parts += [f'<circle class="dot" cx="{float(across(a)):.1f}" cy="{float(up(b)):.1f}" r="3.5"/>' for a, b in zip(x, y)]
    return Markup("".join([*parts, "</svg>"]))  # numbers and names of the vocabulary only


def _range(values: np.ndarray) -> tuple[float, float]:
    """Return the ends of an axis, a twentieth beyond the values."""
    low, high = float(values.min()), float(values.max())
    if high - low < 1e-12 * max(abs(high), 1.0):
        low, high = low - 0.5 * max(abs(low), 1e-3), high + 0.5 * max(abs(high), 1e-3)
    return low - 0.05 * (high - low), high + 0.05 * (high - low)


def ticks(low: float, high: float, count: int) -> np.ndarray:
    """Return round numbers between two values, about `count` of them.

    Examples
    --------
    >>> ticks(0.0, 10.0, 4).tolist()
    [0.0, 5.0, 10.0]
    """
    rough = (high - low) / count
    size = 10.0 ** np.floor(np.log10(rough))
    step = size * next(factor for factor in (1.0, 2.0, 5.0, 10.0) if factor * size >= rough * 0.999)
    return np.round(np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1.0) * step, 12) + 0.0  # no minus zero


def _span(x, a: float, b: float, style: str, least: float) -> str:
    left, right = (float(np.clip(x(t), _LEFT, WIDTH - _RIGHT)) for t in (a, b))
    return f'<rect class="{style}" x="{left:.1f}" y="{_TOP}" width="{max(right - left, least):.1f}" height="{HEIGHT - _TOP - _BOTTOM}"/>'


def _paths(time: np.ndarray, line: np.ndarray, x, y) -> list[str]:
    """Return the SVG paths of a line, broken where it is NaN; long ones keep smallest and largest value of each bucket."""
    if len(time) > 2 * _BUCKETS:
        edges = np.linspace(0, len(time), _BUCKETS + 1).astype(int)
        picked = []
        for a, b in pairwise(edges):
            piece = line[a:b]
            if np.isfinite(piece).any():
                picked += sorted({a + int(np.nanargmin(piece)), a + int(np.nanargmax(piece))})
            else:
                picked.append(a)
        time, line = time[picked], line[picked]
    whole = np.isfinite(line)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], whole, [False]]).astype(np.int8)))
    horizontal, vertical = x(time), y(line)
    pieces = [zip(horizontal[a:b], vertical[a:b]) for a, b in zip(edges[::2], edges[1::2])]
    return ["M" + "L".join(f"{h:.1f} {v:.1f}" for h, v in piece) for piece in pieces]

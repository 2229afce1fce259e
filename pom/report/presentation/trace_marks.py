"""Marks on the time histories of the report: when a run is outside its tolerance, and where a trace leaves the scale."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from flightmech.support.svg_chart import Frame, area, arrow, line, text

from .quantities import number

LANE = 4.0  # height of one run's bar of exits above the time axis


def exit_ticks(frame: Frame, exits: Mapping[str, Sequence[tuple[float, float]]], styles: Mapping[str, str]) -> str:
    """Return bars along the time axis where runs are out, one lane per run, with a mark at each first exit."""
    parts, lane = [], 0
    for run, found in exits.items():
        if not found:
            continue
        y = frame.bottom - 2.5 - LANE * lane
        for start, stop in found:
            a, b = (float(frame.px(t)) for t in (start, stop))
            parts.append(line(a, y, max(b, a + 1.0), y, f"lane {styles[run]}"))
        x = float(frame.px(found[0][0]))
        parts.append(line(x, frame.bottom - 9 - LANE * lane, x, frame.bottom + 4, "tickmark"))
        lane += 1
    return "".join(parts)


def fan(frame: Frame, time: np.ndarray, quantiles: np.ndarray, css: str) -> str:
    """Return nested areas between the quantiles (quantile, time) of the draws of a run: the outermost pair, the next pair inside it."""
    pairs = zip(quantiles[: len(quantiles) // 2], quantiles[::-1], strict=False)
    return "".join(area(frame, time, low, high, f"fan {css}-area") for low, high in pairs)


def beyond(frame: Frame, time: np.ndarray, values: np.ndarray, css: str, with_value: bool = True) -> str:
    """Return an arrow, and the extreme value, where a trace leaves the scale of `frame`."""
    parts: list[str] = []
    if not np.isfinite(values).any():
        return ""
    for upward in (True, False):
        k = int(np.nanargmax(values) if upward else np.nanargmin(values))
        if (values[k] > frame.y[1]) if upward else (values[k] < frame.y[0]):
            x = float(np.clip(frame.px(time[k]), frame.left + 6, frame.right - 6))
            parts.append(arrow(x, frame, upward, css))
            if not with_value:
                continue
            y = frame.top + 9 if upward else frame.bottom - 3
            side = ("end", -7) if x > frame.left + frame.width / 2 else ("start", 7)
            parts.append(text(x + side[1], y, number(values[k]), "tick halo", side[0]))
    return "".join(parts)

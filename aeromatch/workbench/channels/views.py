"""Requests of the page of the records for expressions, spectra, cursors and XY plots."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from aeromatch.workbench.channels.expressions import FUNCTIONS, stretches
from aeromatch.workbench.channels.signals import (
    ChannelSignal,
    interpolate,
    leaves_of,
    list_channels,
    signal_of,
)
from aeromatch.workbench.channels.spectra import average_densities
from aeromatch.workbench.opened import OpenProject, decimate_channels
from flightmech.errors import AeromatchError, SchemaError
from flightmech.quantities import time_text

# Greatest number of lines of a request, of points of a curve, of samples of a segment.
_MOST_LINES, _MOST_POINTS, _SEGMENT = 24, 8000, 1024
# Points of the curve of one channel over another.
_CURVE = 4000
# Fewest samples of a spectrum.
_FEWEST = 16


def number_of(query: Mapping[str, str], key: str) -> float:
    """Return a finite number of the query."""
    text = query.get(key, "")
    try:
        number = float(text)
    except ValueError:
        number = np.nan
    if not np.isfinite(number):
        raise SchemaError("channels", [f"{key} {text!r}; give a number"])
    return number


def lines_of(query: Mapping[str, str]) -> list[str]:
    """Return the expressions of the query, a JSON list of texts."""
    text = query.get("lines", "[]")
    try:
        lines = json.loads(text)
    except (ValueError, RecursionError):
        lines = None
    is_list = isinstance(lines, list) and all(isinstance(line, str) for line in lines)
    if not is_list or len(lines) > _MOST_LINES:
        raise SchemaError(
            "channels", [f"lines {text[:60]!r}; give a JSON list of at most {_MOST_LINES} texts"]
        )
    return list(dict.fromkeys(lines))


def pack_expressions(
    opened: OpenProject, query: Mapping[str, str], start: float, stop: float, points: int
) -> list[tuple[dict[str, object], np.ndarray, dict[str, np.ndarray]]]:
    """Return the expressions of a request inside a span, decimated for a screen."""
    groups = []
    for line in lines_of(query):
        signal = signal_of(opened, query.get("name", ""), line)
        times, values = decimate_channels(
            signal.time, {line: signal.levels}, start=start, stop=stop, points=points
        )
        head: dict[str, object] = {"source": "expression", "leaf": line}
        groups.append((head, times, values))
    return groups


def describe_expression(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return unit and remarks of the expression ``line`` of the record ``name``."""
    signal = signal_of(opened, query.get("name", ""), query.get("line", ""))
    return {"line": signal.text, "unit": signal.unit, "remarks": signal.remarks}


def check_expressions(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return unit and remarks of the expressions ``lines``, or why the record has not all of one.

    Another record may lack a channel: the page then waits for a record that has it.
    """
    found = []
    for line in lines_of(query):
        row: dict[str, Any] = {"line": line, "unit": "", "remarks": (), "refused": ""}
        try:
            signal = signal_of(opened, query.get("name", ""), line)
            row |= {"unit": signal.unit, "remarks": signal.remarks}
        except AeromatchError as error:
            row["refused"] = "; ".join(getattr(error, "problems", ())) or str(error)
        found.append(row)
    return {"lines": found}


def list_expression_words(
    opened: OpenProject, query: Mapping[str, str], body: Any
) -> dict[str, Any]:
    """Return the channels and functions that an expression may name."""
    leaves = leaves_of(opened, query.get("name", ""))
    return {"channels": list_channels(leaves), "functions": FUNCTIONS}


def show_curve(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the expression ``y`` over the expression ``x`` inside a span.

    The slower one is interpolated to the clock of the other.  Of many samples every k-th is
    returned, as ``every`` states: extremes of blocks would not be points of the curve.
    """
    name = query.get("name", "")
    x, y = (signal_of(opened, name, query.get(key, "")) for key in ("x", "y"))
    start, stop = number_of(query, "start"), number_of(query, "stop")
    # The signal with fewer samples is interpolated to the times of the other.
    base, other = (x, y) if len(x.time) >= len(y.time) else (y, x)
    inside = _inside(base, start, stop)
    time = base.time[inside]
    moved = other.values[_inside(other, start, stop)]
    if len(other.time) != len(base.time) or not np.array_equal(other.time, base.time):
        moved = other.interpolated(time)
    pair = {id(base): base.values[inside], id(other): moved}
    if x is y:
        pair[id(x)] = base.values[inside]
    valid = np.isfinite(pair[id(x)]) & np.isfinite(pair[id(y)])
    # Rounded up: at most _CURVE points.
    every = max(1, -(-int(valid.sum()) // _CURVE))
    columns = {
        "time": time[valid][::every],
        "x": pair[id(x)][valid][::every],
        "y": pair[id(y)][valid][::every],
    }
    return {
        **columns,
        "units": [x.unit, y.unit],
        "samples": int(valid.sum()),
        "every": every,
        "remarks": list(dict.fromkeys([*x.remarks, *y.remarks])),
    }


def show_spectrum(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the power spectral densities of the expressions ``lines`` inside a span.

    Every line has the root of the integral of its density, and the standard deviation of its
    samples, which agree for a signal without slow drift.
    """
    name = query.get("name", "")
    start, stop = number_of(query, "start"), number_of(query, "stop")
    found = []
    for line in lines_of(query):
        signal = signal_of(opened, name, line)
        found.append({"line": line, "unit": signal.unit, **_density(signal, start, stop)})
    return {"lines": found}


def _density(signal: ChannelSignal, start: float, stop: float) -> dict[str, Any]:
    inside = _inside(signal, start, stop)
    time, values = signal.time[inside], signal.continuous[inside]
    # The spectrum is averaged over stretches without a gap.
    parts = []
    for part in stretches(time, np.isfinite(values)):
        if part.stop - part.start >= _FEWEST:
            parts.append((part, float(np.median(np.diff(time[part])))))
    if not parts:
        raise SchemaError(
            signal.text,
            [
                f"no {_FEWEST} samples without a gap from {time_text(start)} to {time_text(stop)} "
                "s; "
                f"choose a longer span"
            ],
        )
    spectra = average_densities({"line": values}, parts, _SEGMENT)
    density = spectra["densities"]["line"]
    resolution = 1.0 / (spectra["samples"] * spectra["step"])
    used = np.concatenate([values[part] for part in spectra["used"]])
    return {
        "frequency": spectra["frequency"],
        "density": density,
        "segments": spectra["segments"],
        "resolution": resolution,
        "left_out": spectra["left_out"],
        # The area below the density is the variance; the deviation of the samples confirms it.
        "rms": float(np.sqrt(np.sum(density) * resolution)),
        "deviation": float(np.std(used)),
    }


def read_cursors(opened: OpenProject, query: Mapping[str, str], body: Any) -> dict[str, Any]:
    """Return the values of the expressions ``lines`` at two times, ``start`` and ``stop``. [s]

    The values are of the samples themselves, not of the points of the screen, linear between two
    samples; null in a gap.  ``slope`` is that of the least-squares line of all samples between.
    An angle that jumps is counted through its full turns, from its turn at the earlier time.
    """
    name = query.get("name", "")
    times = np.array([number_of(query, "start"), number_of(query, "stop")])
    low, high = float(times.min()), float(times.max())
    rows = []
    for line in lines_of(query):
        signal = signal_of(opened, name, line)
        values = _counted_from(signal, low) if signal.turn else signal.values
        first, last = interpolate(signal.time, values, times)
        between = (signal.time >= low) & (signal.time <= high) & np.isfinite(values)
        x, t = values[between], signal.time[between]
        row = {
            "line": line,
            "unit": signal.unit,
            "first": float(first),
            "last": float(last),
            "difference": float(last - first),
            "chord": float((last - first) / (times[1] - times[0])) if high > low else np.nan,
            "slope": _fitted_slope(t, x),
            "mean": float(x.mean()) if len(x) else np.nan,
            "deviation": float(x.std()) if len(x) else np.nan,
            "low": float(x.min()) if len(x) else np.nan,
            "high": float(x.max()) if len(x) else np.nan,
            "samples": len(x),
        }
        rows.append(row)
    return {"rows": rows}


def _counted_from(signal: ChannelSignal, start: float) -> np.ndarray:
    """Return an angle counted through its full turns, from its recorded turn at a time. [unit]"""
    values = signal.continuous
    after = np.flatnonzero((signal.time >= start) & np.isfinite(values))
    if not len(after):
        return values
    return values - (values[after[0]] - signal.values[after[0]])


def _fitted_slope(t: np.ndarray, x: np.ndarray) -> float:
    """Return the slope of the least-squares line; NaN for fewer than two samples."""
    if len(t) < 2:
        return float(np.nan)
    centred = t - t.mean()
    return float(centred @ (x - x.mean()) / (centred @ centred))


def _inside(signal: ChannelSignal, start: float, stop: float) -> slice:
    """Return the samples of a span."""
    first = int(np.searchsorted(signal.time, start))
    return slice(first, int(np.searchsorted(signal.time, stop, side="right")))


ROUTES = {
    ("GET", "/api/expression"): describe_expression,
    ("GET", "/api/expressions"): check_expressions,
    ("GET", "/api/words"): list_expression_words,
    ("GET", "/api/curve"): show_curve,
    ("GET", "/api/spectrum"): show_spectrum,
    ("GET", "/api/cursors"): read_cursors,
}
"""Requests of this module, in the form of `aeromatch.workbench.records.ROUTES`."""

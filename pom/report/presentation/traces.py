"""Traces for the page: quantised to a step, differenced, compressed.

A trace is stored as integers k with value = k * step: differences of a noisy trace, differences of
differences of a smooth one, in the fewest bytes that hold them (8, 16 or 32 bits).  With a step of
tolerance/500 the error is at most tolerance/1000, far below a pixel; the numbers a reader sees come
from the verdict table, never from here.  A parcel is what a page waits as: its text and what its
plots need as JSON, a zero, the traces, all gzipped and written in base64.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FunctionLoader

from flightmech.support.console import to_json_types
from flightmech.support.figures import (
    Frame,
    draw_area,
    draw_arrow,
    draw_line,
    draw_text,
    make_template_environment,
)
from pom.report.presentation.quantities import format_number

_FOLDER = Path(__file__).parents[1] / "templates"


@cache
def page_templates() -> Environment:
    """Return the environment of the page; ``parts`` holds the macros that its templates share."""
    found = make_template_environment(FunctionLoader(_template))
    found.globals["parts"] = found.get_template("parts.html").module
    return found


def _template(name: str) -> str:
    """Return a template without its indentation, which would be a tenth of the page."""
    lines = (_FOLDER / name).read_text(encoding="utf-8").splitlines()
    return "".join(f"{line.lstrip()}\n" for line in lines)


LANE = 4.0  # height of one run's bar of exits above the time axis


def exit_ticks(
    frame: Frame, exits: Mapping[str, Sequence[tuple[float, float]]], styles: Mapping[str, str]
) -> str:
    """Return bars along the time axis where runs are out, one lane per run, with a mark at each
    first exit.
    """
    parts, lane = [], 0
    for run, found in exits.items():
        if not found:
            continue
        y = frame.bottom - 2.5 - LANE * lane
        for start, stop in found:
            a, b = (float(frame.px(t)) for t in (start, stop))
            parts.append(draw_line(a, y, max(b, a + 1.0), y, f"lane {styles[run]}"))
        x = float(frame.px(found[0][0]))
        parts.append(draw_line(x, frame.bottom - 9 - LANE * lane, x, frame.bottom + 4, "tickmark"))
        lane += 1
    return "".join(parts)


def quantile_areas(frame: Frame, time: np.ndarray, quantiles: np.ndarray, css: str) -> str:
    """Return nested areas between the quantiles (quantile, time) of the draws of a run: the
    outermost pair, the next pair inside it.
    """
    pairs = zip(quantiles[: len(quantiles) // 2], quantiles[::-1], strict=False)
    return "".join(draw_area(frame, time, low, high, f"fan {css}-area") for low, high in pairs)


def beyond_scale_mark(
    frame: Frame, time: np.ndarray, values: np.ndarray, css: str, with_value: bool = True
) -> str:
    """Return an arrow, and the extreme value, where a trace leaves the scale of `frame`."""
    parts: list[str] = []
    if not np.isfinite(values).any():
        return ""
    for upward in (True, False):
        k = int(np.nanargmax(values) if upward else np.nanargmin(values))
        if (values[k] > frame.y[1]) if upward else (values[k] < frame.y[0]):
            x = float(np.clip(frame.px(time[k]), frame.left + 6, frame.right - 6))
            parts.append(draw_arrow(x, frame, upward, css))
            if not with_value:
                continue
            y = frame.top + 9 if upward else frame.bottom - 3
            side = ("end", -7) if x > frame.left + frame.width / 2 else ("start", 7)
            parts.append(draw_text(x + side[1], y, format_number(values[k]), "tick halo", side[0]))
    return "".join(parts)


def exceedance_area(
    frame: Frame, time: np.ndarray, values: np.ndarray, low: np.ndarray, high: np.ndarray
) -> str:
    """Return the hatched area between band and trace where the trace is outside.

    Parameters
    ----------
    frame : Frame
    time, values, low, high : array (time,)
        Clock [s], trace, and edges of the band. [display unit]
    """
    # Samples without a value compare as inside.
    with np.errstate(invalid="ignore"):
        is_above, is_below = values > high, values < low
    above, below = np.where(is_above, values, high), np.where(is_below, values, low)
    shapes = ""
    for edge, trace, outside in ((high, above, is_above), (below, low, is_below)):
        # One sample more at each side completes the area at the crossing.
        wide = outside | np.roll(outside, 1) | np.roll(outside, -1)
        lower, upper = np.where(wide, edge, np.nan), np.where(wide, trace, np.nan)
        shapes += draw_area(frame, time, lower, upper, "exit")
    return shapes


STEPS_PER_TOLERANCE = 500
STEPS_PER_HEIGHT = 500
TIME_STEP = 1e-6
_MISSING = {"int8": -(2**7), "int16": -(2**15), "int32": -(2**31)}


@dataclass
class Pack:
    """Collects arrays into one block; `add` returns what the page needs to read an array back."""

    body: bytearray

    @classmethod
    def empty(cls) -> Pack:
        """Return a pack without arrays."""
        return cls(bytearray())

    def add(self, values: np.ndarray, step: float) -> dict[str, Any]:
        """Append an array (NaN allowed) quantised to `step` and return its entry: type, order of
        difference, place, count, first, step.
        """
        first, order, differences = quantise_trace(values, step)
        kind, count = str(differences.dtype), len(differences)
        entry = {
            "type": kind,
            "order": order,
            "at": len(self.body),
            "count": count,
            "first": first,
            "step": step,
        }
        self.body += differences.astype(differences.dtype.newbyteorder("<")).tobytes()
        return entry


def pack_page(head: Mapping[str, Any], body: bytes = b"") -> str:
    """Return a page as base64 of gzip; the header holds neither time nor system, so equal input
    gives equal text.
    """
    text = json.dumps(
        to_json_types(head),
        sort_keys=True,
        ensure_ascii=False,
        separators=(",", ":"),
        allow_nan=False,
    )
    squeeze = zlib.compressobj(6, zlib.DEFLATED, 31, 9, zlib.Z_FILTERED)
    return base64.b64encode(
        squeeze.compress(text.encode() + b"\0" + body) + squeeze.flush()
    ).decode("ascii")


def unpack_page(text: str) -> tuple[dict[str, Any], bytes]:
    """Return head and body of a `pack_page`."""
    head, _, body = zlib.decompress(base64.b64decode(text), 31).partition(b"\0")
    return json.loads(head), body


def step_of(half_width: np.ndarray | None, scale: tuple[float, float]) -> float:
    """Return the step for a channel: tolerance/500 at its narrowest, or a 500th of the height of
    its panel without tolerance.
    """
    if half_width is not None:
        widths = half_width[np.isfinite(half_width) & (half_width > 0)]
        if len(widths):
            return float(widths.min()) / STEPS_PER_TOLERANCE
    return max((scale[1] - scale[0]) / STEPS_PER_HEIGHT, max(map(abs, scale)) * 1e-9) or 1.0


def quantise_trace(values: np.ndarray, step: float) -> tuple[int, int, np.ndarray]:
    """Return the first level, the order of difference (1 or 2) and the differences; NaN becomes the
    type's least number.
    """
    values = np.asarray(values, float)
    good = np.isfinite(values)
    if not good.any():
        return 0, 1, np.full(len(values), _MISSING["int8"], np.int8)
    whole = bool(good.all())
    level = np.rint((values if whole else np.where(good, values, 0.0)) / step).astype(np.int64)
    first = int(level[np.argmax(good)])
    if not whole:
        last = np.maximum.accumulate(np.where(good, np.arange(len(values)), -1))
        level = np.where(last >= 0, level[last], first)
    once = np.diff(level, prepend=first)
    twice = np.diff(once, prepend=0)
    # over a gap only the level itself is held, so its differences are of first order
    order = (
        2
        if whole
        and once.any()
        and np.log2(1 + np.abs(twice)).sum() < np.log2(1 + np.abs(once)).sum()
        else 1
    )
    differences = once if order == 1 else twice
    largest = int(np.abs(differences if whole else differences[good]).max())
    kind = next((kind for kind, least in _MISSING.items() if largest < -least), "")
    if not kind:
        raise OverflowError(f"a jump of {largest} steps of {step:g} does not fit 32 bits")
    return (
        first,
        order,
        (differences if whole else np.where(good, differences, _MISSING[kind])).astype(kind),
    )


def restore_trace(entry: Mapping[str, Any], body: bytes) -> np.ndarray:
    """Return an array of a pack, as the page's script reads it."""
    kind = np.dtype(entry["type"]).newbyteorder("<")
    differences = np.frombuffer(body, kind, entry["count"], entry["at"]).astype(np.int64)
    missing = differences == _MISSING[entry["type"]]
    level = np.where(missing, 0, differences)
    for _ in range(entry["order"]):
        level = np.cumsum(level)
    return np.where(missing, np.nan, (entry["first"] + level) * entry["step"])

"""Compact traces for the page: quantised, differenced, compressed.

A trace is stored as integers k with value = k * step.  A noisy trace has differences of k, a
smooth trace differences of differences.  They have the smallest type that holds them: 8, 16 or 32
bits.  With a step of tolerance/500 the error is at most tolerance/1000, far below a pixel.  Printed
numbers come from the verdict table, never from here.

A packed page is the text of the page and the data of its plots as JSON, a zero byte, and the
traces, compressed by gzip and written in base64.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flightmech.errors import SchemaError
from flightmech.support.console import to_json_types

STEPS_PER_TOLERANCE = 500
STEPS_PER_HEIGHT = 500
TIME_STEP = 1e-6  # s
# Least number of each type.  It marks a missing sample.
_MISSING = {"int8": -(2**7), "int16": -(2**15), "int32": -(2**31)}
# Window bits of zlib: 15 for the largest window, and 16 for the format of gzip.
_GZIP = 31
# Compression level and memory level of zlib.
_LEVEL, _MEMORY = 6, 9


@dataclass
class Pack:
    """Collection of arrays in one block of bytes."""

    body: bytearray

    @classmethod
    def empty(cls) -> Pack:
        """Return a pack without arrays."""
        return cls(bytearray())

    def add(self, values: np.ndarray, step: float) -> dict[str, Any]:
        """Append an array quantised to a step, and return the entry that reads it.

        Parameters
        ----------
        values : array (sample,)
            NaN is a missing sample.
        step : float
            Step in the unit of the values.

        Returns
        -------
        dict
            ``type``, ``order`` of the differences, byte ``at``, ``count``, ``first`` level, and
            ``step``.
        """
        first, order, differences = quantise_trace(values, step)
        entry = {
            "type": str(differences.dtype),
            "order": order,
            "at": len(self.body),
            "count": len(differences),
            "first": first,
            "step": step,
        }
        self.body += differences.astype(differences.dtype.newbyteorder("<")).tobytes()
        return entry


def pack_page(head: Mapping[str, Any], body: bytes = b"") -> str:
    """Return a page as base64 of gzip.

    The header of gzip has neither time nor system, so equal input gives equal text.
    """
    text = json.dumps(
        to_json_types(head),
        sort_keys=True,
        ensure_ascii=False,
        separators=(",", ":"),
        allow_nan=False,
    )
    compressor = zlib.compressobj(_LEVEL, zlib.DEFLATED, _GZIP, _MEMORY, zlib.Z_FILTERED)
    compressed = compressor.compress(text.encode() + b"\0" + body) + compressor.flush()
    return base64.b64encode(compressed).decode("ascii")


def unpack_page(text: str) -> tuple[dict[str, Any], bytes]:
    """Return head and body of a `pack_page`."""
    head, _, body = zlib.decompress(base64.b64decode(text), _GZIP).partition(b"\0")
    return json.loads(head), body


def step_of(half_width: np.ndarray | None, scale: tuple[float, float]) -> float:
    """Return the step of a channel.

    It is tolerance/500 where the band is narrowest.  A channel without tolerance has a 500th of
    the height of its panel.

    Parameters
    ----------
    half_width : array (time,) or None
        Half width of the band. [display unit]
    scale : (float, float)
        Edges of the panel. [display unit]
    """
    if half_width is not None:
        widths = half_width[np.isfinite(half_width) & (half_width > 0)]
        if len(widths):
            return float(widths.min()) / STEPS_PER_TOLERANCE
    height = scale[1] - scale[0]
    # A panel of almost constant values must not need more than 32 bits.
    least = max(map(abs, scale)) * 1e-9
    return max(height / STEPS_PER_HEIGHT, least) or 1.0


def least_step(traces: Iterable[np.ndarray]) -> float:
    """Return the step below which the differences of traces may not fit 32 bits."""
    largest = 0.0
    for values in traces:
        present = values[np.isfinite(values)]
        largest = max(largest, float(np.abs(present).max(initial=0.0)))
    # a difference is at most twice, a second difference at most four times a level
    return largest / 2**28


def quantise_trace(values: np.ndarray, step: float) -> tuple[int, int, np.ndarray]:
    """Return the first level, the order of the differences (1 or 2), and the differences.

    NaN becomes the least number of the type.

    Raises
    ------
    SchemaError
        A difference does not fit 32 bits.
    """
    values = np.asarray(values, float)
    present = np.isfinite(values)
    if not present.any():
        return 0, 1, np.full(len(values), _MISSING["int8"], np.int8)
    is_complete = bool(present.all())
    steps = np.rint(np.where(present, values, 0.0) / step)
    # second differences are four times as large, and must fit 64 bits
    if np.abs(steps).max() > 2.0**60:
        raise _beyond_steps(np.abs(steps).max(), step)
    levels = steps.astype(np.int64)
    first = int(levels[np.argmax(present)])
    if not is_complete:
        levels = _bridge_gaps(levels, present, first)
    differences = np.diff(levels, prepend=first)
    order = 1
    # Over a gap the level itself is constant, so that only first differences are possible.
    if is_complete and differences.any():
        second = np.diff(differences, prepend=0)
        if _bit_count(second) < _bit_count(differences):
            order, differences = 2, second
    largest = int(np.abs(differences[present]).max())
    for dtype, missing in _MISSING.items():
        if largest < -missing:
            return first, order, np.where(present, differences, missing).astype(dtype)
    raise _beyond_steps(largest, step)


def _beyond_steps(count: float, step: float) -> SchemaError:
    text = f"a trace has a jump of {count:g} steps of {step:g}, more than 32 bits: a wrong reading"
    return SchemaError("page of the report", [text])


def _bridge_gaps(levels: np.ndarray, present: np.ndarray, first: int) -> np.ndarray:
    """Return levels that stay constant over a gap, and `first` before the first sample."""
    last = np.maximum.accumulate(np.where(present, np.arange(len(levels)), -1))
    return np.where(last >= 0, levels[last], first)


def _bit_count(differences: np.ndarray) -> float:
    """Return the information of differences, about their size after compression. [bit]"""
    return float(np.log2(1 + np.abs(differences)).sum())


def restore_trace(entry: Mapping[str, Any], body: bytes) -> np.ndarray:
    """Return an array of a pack, as the page's script reads it."""
    dtype = np.dtype(entry["type"]).newbyteorder("<")
    differences = np.frombuffer(body, dtype, entry["count"], entry["at"]).astype(np.int64)
    missing = differences == _MISSING[entry["type"]]
    levels = np.where(missing, 0, differences)
    # A sum undoes each difference.
    for _ in range(entry["order"]):
        levels = np.cumsum(levels)
    return np.where(missing, np.nan, (entry["first"] + levels) * entry["step"])

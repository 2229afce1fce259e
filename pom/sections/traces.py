"""Traces for the page: quantised to a step, differenced, compressed.

A trace is stored as integers k with value = k * step, as differences of 16 bits (32 where a jump is larger), gzipped and
written in base64.  With a step of tolerance/500 the error is at most tolerance/1000, far below a pixel; the numbers a
reader sees come from ``results.json``, never from here.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

STEPS_PER_TOLERANCE = 500
STEPS_PER_RANGE = 4000
TIME_STEP = 1e-6
_MISSING = {"int16": -(2**15), "int32": -(2**31)}


@dataclass
class Pack:
    """Collects arrays into one compressed block; `add` returns what the page needs to read an array back."""

    body: bytearray

    @classmethod
    def empty(cls) -> Pack:
        """Return a pack without arrays."""
        return cls(bytearray())

    def add(self, values: np.ndarray, step: float) -> dict[str, Any]:
        """Append an array (NaN allowed) quantised to `step` and return its entry: type, place, count, first, step."""
        first, differences = quantise(values, step)
        entry = {"type": str(differences.dtype), "at": len(self.body), "count": len(differences), "first": first, "step": step}
        self.body += differences.astype(differences.dtype.newbyteorder("<")).tobytes()
        return entry

    def text(self) -> str:
        """Return the block as base64 of gzip; the header holds neither time nor system, so equal input gives equal text."""
        squeeze = zlib.compressobj(9, zlib.DEFLATED, 31)
        return base64.b64encode(squeeze.compress(bytes(self.body)) + squeeze.flush()).decode("ascii")


def step_of(half_width: np.ndarray | None, values: list[np.ndarray]) -> float:
    """Return the step for a channel: tolerance/500 at its narrowest, or a 4000th of the range without tolerance."""
    if half_width is not None:
        widths = half_width[np.isfinite(half_width) & (half_width > 0)]
        if len(widths):
            return float(widths.min()) / STEPS_PER_TOLERANCE
    finite = np.concatenate([v[np.isfinite(v)] for v in values] or [np.zeros(0)])
    span = float(np.ptp(finite)) if len(finite) else 0.0
    largest = float(np.abs(finite).max()) if len(finite) else 0.0
    return max(span / STEPS_PER_RANGE, largest * 1e-9) or 1.0


def quantise(values: np.ndarray, step: float) -> tuple[int, np.ndarray]:
    """Return the first level and the differences (int16, or int32 where needed); NaN becomes the type's least number."""
    values = np.asarray(values, float)
    good = np.isfinite(values)
    if not good.any():
        return 0, np.full(len(values), _MISSING["int16"], np.int16)
    level = np.rint(np.where(good, values, 0.0) / step).astype(np.int64)
    last = np.maximum.accumulate(np.where(good, np.arange(len(values)), -1))
    first = int(level[good][0])
    level = np.where(last >= 0, level[last], first)
    differences = np.diff(level, prepend=first)
    kind = "int16" if np.abs(differences).max() < 2**15 else "int32"
    if np.abs(differences).max() >= 2**31:
        raise OverflowError(f"a jump of {np.abs(differences).max()} steps of {step:g} does not fit 32 bits")
    return first, np.where(good, differences, _MISSING[kind]).astype(kind)


def restore(entry: Mapping[str, Any], body: bytes) -> np.ndarray:
    """Return an array of a pack, as the page's script reads it."""
    kind = np.dtype(entry["type"]).newbyteorder("<")
    differences = np.frombuffer(body, kind, entry["count"], entry["at"]).astype(np.int64)
    missing = differences == _MISSING[entry["type"]]
    level = entry["first"] + np.cumsum(np.where(missing, 0, differences))
    return np.where(missing, np.nan, level * entry["step"])


def unpack(text: str) -> bytes:
    """Return the bytes of `Pack.text`."""
    return zlib.decompress(base64.b64decode(text), 31)

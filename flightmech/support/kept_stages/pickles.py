"""Results as bytes: pickles that also hold what pickle refuses, and are no larger than need be."""

from __future__ import annotations

import io
import pickle
from types import MappingProxyType
from typing import Any

import numpy as np

LARGE = 10_000
"""Numbers of a table from which on its rows of zeros are looked for."""


class _Pickler(pickle.Pickler):
    """Pickles the read-only view of a mapping, which pickle does not, and leaves rows of zeros out
    of large tables.

    A third of the errors along a record are zero, and coefficients with their errors are 100 MB a
    record.
    """

    def reducer_override(self, item: Any) -> Any:
        if isinstance(item, MappingProxyType):
            return _view, (dict(item),)
        if (
            type(item) is np.ndarray
            and item.dtype == np.float64
            and item.ndim == 2
            and item.size >= LARGE
            and item.flags.c_contiguous
        ):
            bits = item.view(np.int64)  # a negative zero is kept
            full = bits.any(axis=1)
            if not full.all():
                return _filled, (item.shape, full, item[full])
        return NotImplemented


def _view(mapping: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(mapping)


def _filled(shape: tuple[int, int], full: np.ndarray, rows: np.ndarray) -> np.ndarray:
    found = np.zeros(shape)
    found[full] = rows
    return found


def to_pickle(value: Any) -> bytes:
    """Return a value as bytes."""
    stream = io.BytesIO()
    _Pickler(stream, protocol=5).dump(value)
    return stream.getvalue()

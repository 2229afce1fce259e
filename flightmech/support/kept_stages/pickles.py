"""Pickles of results, also of read-only mappings, without the rows of zeros of large tables."""

from __future__ import annotations

import io
import pickle
from types import MappingProxyType
from typing import Any

import numpy as np

LARGE = 10_000
"""Smallest number of elements of a table whose rows of zeros are left out."""


class _Pickler(pickle.Pickler):
    """Pickler that accepts the read-only view of a mapping, and omits rows of zeros.

    A third of the errors along a record are zero, and the coefficients of a record with their
    errors take 100 MB.
    """

    def reducer_override(self, item: Any) -> Any:
        if isinstance(item, MappingProxyType):
            return _make_view, (dict(item),)
        if type(item) is np.ndarray and _is_large_table(item):
            # as integers, because a negative zero is not a row of zero bits
            has_bits = item.view(np.int64).any(axis=1)
            if not has_bits.all():
                return _fill_table, (item.shape, has_bits, item[has_bits])
        return NotImplemented


def _is_large_table(array: np.ndarray) -> bool:
    is_table = array.dtype == np.float64 and array.ndim == 2
    return is_table and array.size >= LARGE and array.flags.c_contiguous


def _make_view(mapping: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(mapping)


def _fill_table(shape: tuple[int, int], mask: np.ndarray, rows: np.ndarray) -> np.ndarray:
    table = np.zeros(shape)
    table[mask] = rows
    return table


def to_pickle(value: Any) -> bytes:
    """Return a value as bytes."""
    stream = io.BytesIO()
    _Pickler(stream, protocol=5).dump(value)
    return stream.getvalue()

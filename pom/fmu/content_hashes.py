"""The hash of plain data, arrays, datasets and dataclasses by what they hold: the same in every process."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import xarray as xr


def content_hash(*items: Any) -> str:
    """Return the SHA-256 of what items hold.

    Parameters
    ----------
    *items : numbers, texts, None, arrays, Datasets, dataclasses, and mappings and sequences of them
        Anything else counts by its ``repr``.

    Examples
    --------
    >>> content_hash({"a": 1.0}) == content_hash({"a": 1.0})
    True
    >>> content_hash([1.0, 2.0]) == content_hash([1.0], [2.0])
    False
    """
    digest = hashlib.sha256()
    _add(digest, items)
    return digest.hexdigest()


_SINGLE = {str, float, int, bool, type(None)}


def _add(digest: Any, item: Any) -> None:
    if type(item) in _SINGLE:  # most are: before the kinds that take longer to recognise
        digest.update(repr(item).encode())
    elif isinstance(item, np.ndarray):
        digest.update(f"array {item.dtype} {item.shape}".encode())
        digest.update(repr(item.tolist()).encode() if item.dtype == object else np.ascontiguousarray(item).tobytes())
    elif isinstance(item, xr.Dataset):
        _add(digest, {"attrs": dict(item.attrs), **{name: (v.dims, v.values, dict(v.attrs)) for name, v in item.variables.items()}})
    elif is_dataclass(item) and not isinstance(item, type):
        _add(digest, {f.name: getattr(item, f.name) for f in fields(item)})
    elif isinstance(item, Mapping):
        digest.update(f"mapping {len(item)}".encode())
        for name, value in item.items():
            digest.update(f"\0{name}=".encode())
            _add(digest, value)
    elif isinstance(item, list | tuple):
        digest.update(f"sequence {len(item)}".encode())
        for value in item:
            digest.update(b"\0,")
            _add(digest, value)
    else:
        digest.update(repr(item).encode())

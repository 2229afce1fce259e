"""Stamp of a term as it was identified: a digest of its table, which every later change breaks.

The history of a term states edits by this program only.  A table that was changed in an array
library, or by a history written by hand, has another digest.  The stamp is not a signature: who
knows it can write it again.
"""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import xarray as xr

STAMP = "identified"
"""Attribute of a term with the digest of its table when flights identified it."""
_TABLES = ("value", "stderr", "source")
_TEXTS = ("regressors", "outside")


def stamp_identified(leaf: xr.Dataset) -> xr.Dataset:
    """Return a term with the digest of its present table."""
    return leaf.assign_attrs({STAMP: digest_table(leaf)})


def digest_table(leaf: xr.Dataset) -> str:
    """Return the digest of values, standard errors, sources, breakpoints and regressors."""
    digest = hashlib.sha256()
    for name in _TABLES:
        if name not in leaf:
            continue
        item = leaf[name]
        digest.update(f"{name} {item.dims} {item.shape}".encode())
        digest.update(np.ascontiguousarray(item.values, "<f8").tobytes())
    for axis in leaf["value"].dims:
        digest.update(str(axis).encode())
        digest.update(np.ascontiguousarray(leaf[axis].values, "<f8").tobytes())
    for key in _TEXTS:
        digest.update(f"{key} {leaf.attrs.get(key, '')}".encode())
    return digest.hexdigest()


def is_changed(leaf: xr.Dataset) -> bool | None:
    """Return whether a term changed after its identification; None without a stamp."""
    stamp = leaf.attrs.get(STAMP)
    if not stamp:
        return None
    return bool(stamp != digest_table(leaf))

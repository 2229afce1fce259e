"""The hash of plain data, arrays, labelled data and dataclasses by what they hold: the same in
every process.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path, PurePath
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr


def content_hash(*items: Any) -> str:
    """Return the SHA-256 of what items hold.

    Parameters
    ----------
    *items : numbers, texts, None, arrays, labelled data, dataclasses, pydantic models, and mappings, sequences and sets of them
        What carries a hash of its own as ``content_digest`` counts by it; anything else by its
        pickle, never by a text that may be shortened.

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


@dataclass(frozen=True)
class FileContent:
    """A file as an input of a stage: it counts by its name without folder, and by its bytes.

    Attributes
    ----------
    path : Path
    sha256 : str
        Of its bytes.
    """

    path: Path
    sha256: str

    @classmethod
    def of(cls, path: str | Path) -> FileContent:
        """Return a file with the hash of its bytes now."""
        with Path(path).open("rb") as content:
            return cls(Path(path), hashlib.file_digest(content, "sha256").hexdigest())

    @property
    def content_digest(self) -> str:
        """Name and hash."""
        return f"{self.path.name} {self.sha256}"


_SINGLE = {str, float, int, bool, type(None)}


def _add(digest: Any, item: Any) -> None:
    if type(item) in _SINGLE:  # most are: before the kinds that take longer to recognise
        digest.update(repr(item).encode())
    elif isinstance(own := getattr(item, "content_digest", None), str):
        digest.update(f"digest {own}".encode())
    elif isinstance(item, np.ndarray):
        digest.update(f"array {item.dtype} {item.shape}".encode())
        digest.update(
            repr(item.tolist()).encode()
            if item.dtype == object
            else np.ascontiguousarray(item).tobytes()
        )
    elif isinstance(item, xr.Dataset):
        _add(
            digest,
            {
                "attrs": dict(item.attrs),
                **{name: (v.dims, v.values, dict(v.attrs)) for name, v in item.variables.items()},
            },
        )
    elif isinstance(item, xr.DataTree):
        _add(digest, {node.path: node.to_dataset(inherit=False) for node in item.subtree})
    elif isinstance(item, pd.DataFrame):
        _add(
            digest,
            (
                "table",
                item.index.to_numpy(),
                {str(name): column.to_numpy() for name, column in item.items()},
            ),
        )
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
        digest.update(_other(item))


def _other(item: Any) -> bytes:
    """Return bytes for what is rarer."""
    if isinstance(item, np.generic | PurePath | bytes):
        return repr(item).encode()
    if isinstance(item, set | frozenset):
        return f"set {sorted(content_hash(value) for value in item)}".encode()
    kind = type(item)
    if hasattr(kind, "model_fields"):  # of pydantic, which need not be imported here
        return content_hash(
            kind.__name__, {name: getattr(item, name) for name in kind.model_fields}
        ).encode()
    return pickle.dumps(item, protocol=5)

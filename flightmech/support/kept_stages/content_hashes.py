"""Content hash of plain data, arrays, labelled data and dataclasses, equal in all processes."""

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

from flightmech.support.input_files import file_sha256


def content_hash(*items: Any) -> str:
    """Return the SHA-256 of the content of items.

    Parameters
    ----------
    *items : object
        Numbers, texts, None, arrays, labelled data, dataclasses, pydantic models, and mappings,
        sequences and sets of them. An object with a ``content_digest`` is hashed by this text.
        Other objects are hashed by their pickle, because a ``repr`` can be abbreviated.

    Examples
    --------
    >>> content_hash({"a": 1.0}) == content_hash({"a": 1.0})
    True
    >>> content_hash([1.0, 2.0]) == content_hash([1.0], [2.0])
    False
    """
    digest = hashlib.sha256()
    _update(digest, items)
    return digest.hexdigest()


@dataclass(frozen=True)
class FileContent:
    """A file as an input of a stage, hashed by its name without folder and by its bytes.

    Attributes
    ----------
    path : Path
    sha256 : str
        Hash of its bytes.
    """

    path: Path
    sha256: str

    @classmethod
    def of(cls, path: str | Path) -> FileContent:
        """Return a file with the hash of its present bytes."""
        return cls(Path(path), file_sha256(path))

    @property
    def content_digest(self) -> str:
        """Name and hash."""
        return f"{self.path.name} {self.sha256}"


# types that are hashed by their repr
_SCALARS = {str, float, int, bool, type(None)}


def _update(digest: Any, item: Any) -> None:
    """Add the content of an item to a digest.

    Lengths and types are added too, so that different structures have different hashes.
    """
    # scalars first: most items are scalars, and the other checks take longer
    if type(item) in _SCALARS:
        digest.update(repr(item).encode())
    elif isinstance(text := getattr(item, "content_digest", None), str):
        digest.update(f"digest {text}".encode())
    elif isinstance(item, np.ndarray):
        digest.update(f"array {item.dtype} {item.shape}".encode())
        digest.update(_array_bytes(item))
    elif isinstance(item, xr.Dataset):
        variables = {name: (v.dims, v.values, dict(v.attrs)) for name, v in item.variables.items()}
        _update(digest, {"attrs": dict(item.attrs), **variables})
    elif isinstance(item, xr.DataTree):
        _update(digest, {node.path: node.to_dataset(inherit=False) for node in item.subtree})
    elif isinstance(item, pd.DataFrame):
        columns = {str(name): column.to_numpy() for name, column in item.items()}
        _update(digest, ("table", item.index.to_numpy(), columns))
    elif is_dataclass(item) and not isinstance(item, type):
        _update(digest, {f.name: getattr(item, f.name) for f in fields(item)})
    elif isinstance(item, Mapping):
        digest.update(f"mapping {len(item)}".encode())
        for name, value in item.items():
            digest.update(f"\0{name}=".encode())
            _update(digest, value)
    elif isinstance(item, list | tuple):
        digest.update(f"sequence {len(item)}".encode())
        for value in item:
            digest.update(b"\0,")
            _update(digest, value)
    else:
        digest.update(_object_bytes(item))


def _array_bytes(array: np.ndarray) -> bytes:
    # the bytes of an array of objects are addresses
    if array.dtype == object:
        return repr(array.tolist()).encode()
    return np.ascontiguousarray(array).tobytes()


def _object_bytes(item: Any) -> bytes:
    """Return the bytes of an item of a rare type."""
    if isinstance(item, np.generic | PurePath | bytes):
        return repr(item).encode()
    if isinstance(item, set | frozenset):
        return f"set {sorted(content_hash(value) for value in item)}".encode()
    kind = type(item)
    # a model of pydantic, recognised without an import of pydantic
    if hasattr(kind, "model_fields"):
        values = {name: getattr(item, name) for name in kind.model_fields}
        return content_hash(kind.__name__, values).encode()
    return pickle.dumps(item, protocol=5)

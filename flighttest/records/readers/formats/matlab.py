"""MATLAB files v5 to v7: plain arrays and structures; v7.3 is HDF5 and read there.

Objects of classes (``timetable``, ``timeseries``, ``table``) are stored in a form of MATLAB's own:
save them as structures there, ``s = timetable2table(tt); s = table2struct(s, 'ToScalar', true)``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flightmech.errors import ParseError
from flightmech.support.mat_files import load_mat
from flighttest.records.readers.formats.nested import Array, Group, as_one_array, nested_tables
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.recording import Recording, decoding_errors, not_spread

_EXPECTED = "a whole MATLAB file, v5 to v7"


def read(path: Path, names: NameMap) -> Recording:
    """Return the arrays and structures of a MATLAB file as tables; texts at its top are facts of
    the record.

    Raises
    ------
    ParseError
        The file is damaged, or holds no numbers.
    """
    with decoding_errors(path, _EXPECTED):
        content = load_mat(
            path.read_bytes(),
            path,
            _EXPECTED,
            simplify_cells=True,
            verify_compressed_data_integrity=True,
        )
        content = {key: value for key, value in content.items() if not key.startswith("__")}
        root = _group(content)
        found, left_out = nested_tables(root, names)
    if not found:
        objects = [
            key
            for key, value in content.items()
            if type(value).__name__ == "MatlabOpaque" or key == "None"
        ]
        what = (
            f"objects of MATLAB classes ({', '.join(objects)})"
            if objects
            else "no array of numbers"
        )
        raise ParseError(
            str(path),
            0,
            what,
            "plain arrays or structures; convert objects in MATLAB, for instance with table2struct",
        )
    facts = {
        key: " ".join(value.split())
        for key, value in content.items()
        if isinstance(value, str) and len(value) < 2000
    }
    left_out = [one for one in left_out if one.place not in facts]
    return Recording("matlab5", found, facts, left_out=tuple(left_out))


def _group(content: Mapping[str, Any]) -> Group:
    found = Group()
    for name, item in _simulink(content).items():
        if isinstance(item, Mapping):
            inner = _group(item)
            texts = {
                key: item[key]
                for key in ("units", "unit", "description")
                if isinstance(item.get(key), str)
            }
            array = as_one_array(inner, texts)
            if array is not None:
                found.arrays[name] = array
            else:
                found.groups[name] = inner
        elif isinstance(item, list):
            found.groups.update(
                {
                    f"{name}[{i}]": _group(part)
                    for i, part in enumerate(item)
                    if isinstance(part, Mapping)
                }
            )
            if not all(isinstance(part, Mapping) for part in item):
                found.left_out[name] = "a cell array"
        else:
            values = np.asarray(item)
            if values.dtype.kind in "fiub" and values.size and values.ndim <= 2:
                found.arrays[name] = Array.of(values)
            elif (
                values.dtype == object
                and values.size
                and all(isinstance(part, Mapping) for part in values.ravel())
            ):
                found.groups.update(
                    {f"{name}[{i}]": _group(part) for i, part in enumerate(values.ravel())}
                )
            elif not (isinstance(item, str) and name in ("units", "unit", "description")):
                found.left_out[name] = _no_array(item, values)
    return found


def _no_array(item: Any, values: np.ndarray) -> str:
    """Return what an item is that gives no column."""
    if type(item).__name__ == "MatlabOpaque":
        return "an object of a MATLAB class; convert it there, for instance with table2struct"
    if values.dtype.kind in "SU":
        return "text"
    if not values.size:
        return "an empty array"
    if values.dtype.kind in "fiubc":
        sizes = " x ".join(map(str, values.shape))
        return (
            f"complex numbers ({sizes})"
            if values.dtype.kind == "c"
            else not_spread(values.shape, 0)
        )
    return "a cell array"


def _simulink(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return Simulink's structure with time as arrays by label; anything else as it is."""
    signals = content.get("signals")
    if "time" not in content or signals is None:
        return content
    parts = (
        [signals] if isinstance(signals, Mapping) else list(np.ravel(np.asarray(signals, object)))
    )
    if not all(isinstance(part, Mapping) and "values" in part for part in parts):
        return content
    arrays = {
        str(part.get("label") or f"signal[{i}]"): part["values"] for i, part in enumerate(parts)
    }
    return {"time": content["time"], **arrays}

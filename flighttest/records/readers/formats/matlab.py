"""MATLAB files v5 to v7 as tables of their plain arrays and structures.

Version 7.3 is HDF5 and is read by `hdf5`.  Objects of classes (``timetable``, ``timeseries``,
``table``) have a storage format that only MATLAB reads.  Save them as structures in MATLAB:
``s = timetable2table(tt); s = table2struct(s, 'ToScalar', true)``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flightmech.errors import ParseError
from flightmech.support.array_files.mat_files import load_mat
from flighttest.records.readers.formats.nested import Array, Group, as_one_array, nested_tables
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.recording import Recording, decoding_errors, not_spread

_EXPECTED = "a whole MATLAB file, v5 to v7"
_LONGEST_FACT = 2000  # characters
_LABELS = ("units", "unit", "description")


def read(path: Path, names: NameMap) -> Recording:
    """Return the arrays and structures of a MATLAB file as tables.

    Texts at the top level are facts of the record.

    Raises
    ------
    ParseError
        The file is damaged, or has no numbers.
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
        root = _read_group(content)
        tables, left_out = nested_tables(root, names)
    if not tables:
        raise _missing_arrays(content, path)
    facts = {}
    for key, value in content.items():
        if isinstance(value, str) and len(value) < _LONGEST_FACT:
            facts[key] = " ".join(value.split())
    omitted = [item for item in left_out if item.place not in facts]
    return Recording("matlab5", tables, facts, left_out=tuple(omitted))


def _missing_arrays(content: Mapping[str, Any], path: Path) -> ParseError:
    """Return the error for a file without arrays of numbers."""
    # SciPy stores an object of a MATLAB class as MatlabOpaque, or under the name "None".
    objects = []
    for key, value in content.items():
        if type(value).__name__ == "MatlabOpaque" or key == "None":
            objects.append(key)
    description = "no array of numbers"
    if objects:
        description = f"objects of MATLAB classes ({', '.join(objects)})"
    return ParseError(
        str(path),
        0,
        found=description,
        expected=(
            "plain arrays or structures; convert objects in MATLAB, for instance with table2struct"
        ),
    )


def _read_group(content: Mapping[str, Any]) -> Group:
    """Return the arrays and groups of a structure."""
    group = Group()
    for name, item in _simulink_arrays(content).items():
        if isinstance(item, Mapping):
            _add_structure(group, name, item)
        elif isinstance(item, list):
            _add_structures(group, name, item)
            if not _are_structures(item):
                group.left_out[name] = "a cell array"
        else:
            _add_values(group, name, item)
    return group


def _add_structure(group: Group, name: str, structure: Mapping[str, Any]) -> None:
    """Add a structure to a group, as an array if it is one channel."""
    inner = _read_group(structure)
    texts = {key: structure[key] for key in _LABELS if isinstance(structure.get(key), str)}
    array = as_one_array(inner, texts)
    if array is not None:
        group.arrays[name] = array
    else:
        group.groups[name] = inner


def _add_structures(group: Group, name: str, items: Iterable[Any]) -> None:
    """Add the structures of an array of structures, ``name[0]``, ``name[1]``, ..."""
    for i, item in enumerate(items):
        if isinstance(item, Mapping):
            group.groups[f"{name}[{i}]"] = _read_group(item)


def _are_structures(items: Iterable[Any]) -> bool:
    """Return whether all items are structures."""
    return all(isinstance(item, Mapping) for item in items)


def _add_values(group: Group, name: str, item: Any) -> None:
    """Add an array of numbers or of structures to a group, or the reason to omit it."""
    values = np.asarray(item)
    if values.dtype.kind in "fiub" and values.size and values.ndim <= 2:
        group.arrays[name] = Array.of(values)
    elif values.dtype == object and values.size and _are_structures(values.ravel()):
        _add_structures(group, name, values.ravel())
    elif not (isinstance(item, str) and name in _LABELS):
        group.left_out[name] = _describe_omitted(item, values)


def _describe_omitted(item: Any, values: np.ndarray) -> str:
    """Return a description of an item that gives no column."""
    if type(item).__name__ == "MatlabOpaque":
        return "an object of a MATLAB class; convert it there, for instance with table2struct"
    if values.dtype.kind in "SU":
        return "text"
    if not values.size:
        return "an empty array"
    if values.dtype.kind == "c":
        sizes = " x ".join(map(str, values.shape))
        return f"complex numbers ({sizes})"
    if values.dtype.kind in "fiub":
        return not_spread(values.shape, 0)
    return "a cell array"


def _simulink_arrays(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the arrays of Simulink's structure with time by label; other content is unchanged."""
    signals = content.get("signals")
    if "time" not in content or signals is None:
        return content
    # A single signal is a structure, several are an array of structures.
    if isinstance(signals, Mapping):
        structures = [signals]
    else:
        structures = list(np.ravel(np.asarray(signals, object)))
    arrays = {"time": content["time"]}
    for i, signal in enumerate(structures):
        if not isinstance(signal, Mapping) or "values" not in signal:
            return content
        arrays[str(signal.get("label") or f"signal[{i}]")] = signal["values"]
    return arrays

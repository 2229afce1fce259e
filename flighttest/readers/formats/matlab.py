"""MATLAB files v5 to v7: plain arrays and structures; v7.3 is HDF5 and read there.

Objects of classes (``timetable``, ``timeseries``, ``table``) are stored in a form of MATLAB's own: save them as structures there,
``s = timetable2table(tt); s = table2struct(s, 'ToScalar', true)``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flightmech.errors import ParseError
from flightmech.support.input_files.mat_file import load_mat

from ..name_map import NameMap
from ..recording import Recording, guarded
from .nested import Array, Group, as_one_array, tables

_EXPECTED = "a whole MATLAB file, v5 to v7"


def read(path: Path, names: NameMap) -> Recording:
    """Return the arrays and structures of a MATLAB file as tables; texts at its top are facts of the record.

    Raises
    ------
    ParseError
        The file is damaged, or holds no numbers.
    """
    with guarded(path, _EXPECTED):
        content = load_mat(path.read_bytes(), path, _EXPECTED, simplify_cells=True, verify_compressed_data_integrity=True)
        content = {key: value for key, value in content.items() if not key.startswith("__")}
        found = tables(_group(content), names)
    if not found:
        objects = [key for key, value in content.items() if type(value).__name__ == "MatlabOpaque" or key == "None"]
        what = f"objects of MATLAB classes ({', '.join(objects)})" if objects else "no array of numbers"
        raise ParseError(str(path), 0, what, "plain arrays or structures; convert objects in MATLAB, for instance with table2struct")
    facts = {key: " ".join(value.split()) for key, value in content.items() if isinstance(value, str) and len(value) < 2000}
    return Recording("matlab5", found, facts)


def _group(content: Mapping[str, Any]) -> Group:
    found = Group()
    for name, item in _simulink(content).items():
        if isinstance(item, Mapping):
            inner = _group(item)
            texts = {key: item[key] for key in ("units", "unit", "description") if isinstance(item.get(key), str)}
            array = as_one_array(inner, texts)
            if array is not None:
                found.arrays[name] = array
            else:
                found.groups[name] = inner
        elif isinstance(item, list):
            found.groups.update({f"{name}[{i}]": _group(part) for i, part in enumerate(item) if isinstance(part, Mapping)})
        else:
            values = np.asarray(item)
            if values.dtype.kind in "fiub" and values.size and values.ndim <= 2:
                found.arrays[name] = Array.of(values)
            elif values.dtype == object and values.size and all(isinstance(part, Mapping) for part in values.ravel()):
                found.groups.update({f"{name}[{i}]": _group(part) for i, part in enumerate(values.ravel())})
    return found


def _simulink(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return Simulink's structure with time as arrays by label; anything else as it is."""
    signals = content.get("signals")
    if "time" not in content or signals is None:
        return content
    parts = [signals] if isinstance(signals, Mapping) else list(np.ravel(np.asarray(signals, object)))
    if not all(isinstance(part, Mapping) and "values" in part for part in parts):
        return content
    arrays = {str(part.get("label") or f"signal[{i}]"): part["values"] for i, part in enumerate(parts)}
    return {"time": content["time"], **arrays}

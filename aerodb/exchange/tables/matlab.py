"""Terms in a MAT file of version 5, for MATLAB, Simulink n-D look-up tables and GNU Octave.

Variable ``terms`` is a structure array with one element per term.  ``database`` is a structure of
the root attributes, ``conventions`` a text.  Tables are in MATLAB's order: ``values(i,j,k)``
belongs to breakpoint i of the first axis, j of the second, k of the third, and the first index runs
fastest in memory.  Check cases and the undo history stay in the database.

This format has no checksum, so a damaged file may give other numbers.  An exported file has a
checksum in the text of its header.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy.io import savemat

from aerodb.exchange.tables.csv_text import flatten_attributes, restore_attributes
from aerodb.store.schema import check, require_valid, terms
from flightmech import terms as _terms
from flightmech.errors import ParseError, SchemaError
from flightmech.names import lookup
from flightmech.support.array_files.mat_files import load_mat
from flightmech.support.atomic_write import written_atomically
from flightmech.support.input_files import read_bytes

_TABLE = ("axes", "breakpoints", "values")
_TEXTS = ("outside", "references", "comment", "history")
_FIELDS = (
    "name",
    "coefficient",
    "contribution",
    "regressors",
    *_TABLE,
    "stderr",
    "source",
    "K1",
    "K2",
    *_TEXTS,
    "attributes",
)
_FIELD = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,62}")  # names of fields that MATLAB accepts
_NONE = np.zeros((0, 0))
# MATLAB requires the first word only. It writes another text when it saves a file.
_SEAL = b"MATLAB 5.0 aeromatch sha256 %s"
_SEAL_WORDS = (b"aeromatch", b"sha256")
_HEADER_SIZE = 116  # bytes of the text in the header
_CONVENTIONS = """\
coefficient = sum of its terms; term = K1 * K2 * table(axes) * product of regressors; \
SI units and radians.
terms(n).values(i,j,k): breakpoint i of axes(1), j of axes(2), k of axes(3); \
interpolation is linear.
Beyond the ends: outside = 'hold' keeps the end value (clip the inputs), \
'linear' goes on with the last line.
stderr is the standard error of each node; source is 0 datcom, 1 flight, 2 judgement; \
empty where the term has none.
A term with attributes power, exponent, floor is multiplied by max(v, floor)^exponent too, \
v the variable that power names.
A table without axes is a scalar; K1, K2 are factor tables over other axes, \
empty where the term has none.
interpn(t.breakpoints{:}, t.values, x1, x2, ...) gives a table of two and more axes, \
interp1 one of a single axis."""


def export_matlab(db: xr.DataTree, path: str | os.PathLike[str]) -> None:
    """Write the terms of a database to a MAT file of version 5.

    Parameters
    ----------
    db : DataTree
        The database.
    path : path
        File to write, atomically.

    Raises
    ------
    SchemaError
        The database is faulty, or an attribute of its root has a name that is not valid in a MATLAB
        structure.
    """
    require_valid(db)
    problems = []
    for key in map(str, db.attrs):
        if not _FIELD.fullmatch(key):
            problems.append(f"root attribute {key!r} is not a name of a MATLAB field; rename it")
    if problems:
        raise SchemaError("MAT file", problems)
    rows = [_term_structure(name, leaf) for name, leaf in terms(db).items()]
    content = {
        "conventions": _CONVENTIONS,
        "database": {str(key): _to_matlab_number(value) for key, value in db.attrs.items()},
        "terms": _structure_array(_FIELDS, rows),
    }
    file: Any = io.BytesIO()
    savemat(file, content, appendmat=False, format="5", long_field_names=True, oned_as="column")
    with written_atomically(path) as part:
        part.write_bytes(_with_checksum(file.getvalue()))


def _with_checksum(content: bytes) -> bytes:
    """Return a MAT file with the SHA-256 of its data in the text of its header."""
    data = content[_HEADER_SIZE:]
    header = _SEAL % hashlib.sha256(data).hexdigest().encode()
    return header.ljust(_HEADER_SIZE) + data


def _term_structure(name: str, leaf: xr.Dataset) -> dict[str, Any]:
    """Return the fields of a term."""
    coefficient, _, contribution = name.partition("/")
    facts = flatten_attributes(leaf)
    # A missing array is empty, because MATLAB structures have the same fields in all elements.
    fields: dict[str, Any] = {
        "name": name,
        "coefficient": coefficient,
        "contribution": contribution,
        "regressors": _cell_array(_terms.list_regressors(leaf)),
        **_table_fields(leaf, "value"),
    }
    for key in ("stderr", "source"):
        fields[key] = _to_matlab_order(leaf[key]) if key in leaf else _NONE
    for key in ("K1", "K2"):
        fields[key] = _NONE
        if key in leaf:
            fields[key] = _structure_array(_TABLE, [_table_fields(leaf, key)])
    # Usual texts have fields of their own. All other facts are pairs of name and value.
    for key in _TEXTS:
        text = facts.pop(key) if isinstance(facts.get(key), str) else ""
        fields[key] = text if key in leaf.attrs else _NONE
    facts.pop("regressors", None)
    # A cell array with two columns.
    pairs = np.empty((len(facts), 2), object)
    for row, (key, value) in enumerate(facts.items()):
        pairs[row, 0], pairs[row, 1] = key, _to_matlab_number(value)
    fields["attributes"] = pairs
    return fields


def _table_fields(leaf: xr.Dataset, name: str) -> dict[str, Any]:
    names = [str(axis) for axis in leaf[name].dims]
    axes = [{"name": axis, "units": lookup(axis).units} for axis in names]
    return {
        "axes": _structure_array(("name", "units"), axes),
        "breakpoints": _cell_array([leaf[axis].values.astype(float) for axis in names]),
        "values": _to_matlab_order(leaf[name]),
    }


def _to_matlab_order(table: xr.DataArray) -> np.ndarray:
    """Return a table with the first index fastest in memory; a table of one axis is a column."""
    array = np.asfortranarray(table.values)
    return array.reshape(-1, 1) if array.ndim == 1 else array


def _cell_array(items: Any) -> np.ndarray:
    cells = np.empty((1, len(items)), object)
    for i, item in enumerate(items):
        cells[0, i] = item
    return cells


def _structure_array(fields: tuple[str, ...], rows: list[dict[str, Any]]) -> np.ndarray:
    structures = np.empty((1, len(rows)), [(field, object) for field in fields])
    for i, row in enumerate(rows):
        for field in fields:
            structures[field][0, i] = row[field]
    return structures


def _to_matlab_number(value: Any) -> Any:
    """Return an integer as int64 of MATLAB, so that the import gives an integer."""
    return np.int64(value) if isinstance(value, int | np.integer) else value


def import_matlab(path: str | os.PathLike[str]) -> xr.DataTree:
    """Return the database of a MAT file.

    Parameters
    ----------
    path : path
        File of `export_matlab`; MATLAB or Octave may have changed and saved it (``save -v7``).

    Raises
    ------
    FileNotFoundError
        The file does not exist.
    ParseError
        The file is not a MAT file of version 5 to 7, it is damaged, or it lacks ``terms`` or
        ``database``.
    SchemaError
        All faults of the terms.
    """
    path = Path(path)
    root, elements = _load_structures(path)
    problems = []
    for field in _FIELDS:
        if field not in elements.dtype.names:
            problems.append(f"terms has no field {field!r}")
    leaves: dict[str, xr.Dataset] = {}
    # Without all fields the elements cannot be read.
    for number, element in enumerate(elements.ravel() if not problems else (), 1):
        try:
            name, leaf = _read_leaf(element)
        except (ValueError, TypeError, IndexError, KeyError) as error:
            problems.append(f"terms({number}): {error}")
            continue
        if name in leaves:
            problems.append(f"terms({number}): {name} stands twice")
        leaves[name] = leaf
    attributes = {key: _read_fact(root[key].item()) for key in root.dtype.names}
    for key, value in attributes.items():
        if value is None:
            problems.append(f"database.{key} is neither a text nor a number")
    if not problems:
        nodes = {f"/{name}": leaf for name, leaf in leaves.items()}
        db = xr.DataTree.from_dict({"/": xr.Dataset(attrs=attributes), **nodes})
        problems = check(db)
    if problems:
        raise SchemaError(str(path), problems)
    return db


def _load_structures(path: Path) -> tuple[Any, Any]:
    """Return the structures ``database`` and ``terms`` of a MAT file."""
    expected = "a MAT file of version 5 to 7"
    file = read_bytes(path, expected)
    # One of the two words is enough, so that a damaged header does not hide the checksum.
    has_checksum = any(word in file[:_HEADER_SIZE] for word in _SEAL_WORDS)
    if has_checksum and file != _with_checksum(file):
        raise ParseError(
            str(path),
            0,
            "a damaged file (its SHA-256 is not that in its header)",
            "a MAT file; export or copy it again",
        )
    try:
        content = load_mat(file, path, expected, variable_names=["database", "terms"])
    except NotImplementedError:
        raise ParseError(
            str(path), 0, "a MAT file of version 7.3", "version 5 to 7; save it with save -v7"
        ) from None
    root: Any = content.get("database")
    elements: Any = content.get("terms")
    if not _is_structure(root) or not _is_structure(elements) or root.size != 1:
        raise ParseError(
            str(path),
            0,
            f"the variables {sorted(content)}",
            "structures 'terms' and 'database' as aerodb.exchange.export_matlab writes them",
        )
    return root, elements


def _is_structure(variable: Any) -> bool:
    return variable is not None and variable.dtype.names is not None


def _read_leaf(element: Any) -> tuple[str, xr.Dataset]:
    """Return name and leaf of one element of ``terms``, or raise ValueError with its fault."""
    name = _read_text(element["name"], "name")
    coefficient = _read_text(element["coefficient"], "coefficient")
    contribution = _read_text(element["contribution"], "contribution")
    if name != f"{coefficient}/{contribution}":
        raise ValueError(f"name is {name!r}, coefficient and contribution are others")
    # Standard errors and sources have the axes of the values. Factor tables have their own.
    dims, coords, values = _read_table(element, f"{name} values")
    variables: dict[str, tuple[Any, ...]] = {"value": (dims, values)}
    for key, kind in (("stderr", float), ("source", np.uint8)):
        if element[key].size:
            array = _restore_shape(element[key], values.shape, f"{name} {key}")
            variables[key] = dims, array.astype(kind)
    for key in ("K1", "K2"):
        if element[key].size:
            factor_dims, points, factor = _read_table(element[key].ravel()[0], f"{name} {key}")
            coords |= points
            variables[key] = factor_dims, factor
    regressors = [_read_text(item, "regressors") for item in element["regressors"].ravel()]
    facts = {"regressors": " ".join(regressors)}
    # An empty array, which is not a text, stands for a missing attribute.
    for key in _TEXTS:
        if element[key].dtype.kind == "U":
            facts[key] = _read_fact(element[key])
    for key, value in element["attributes"].reshape(-1, 2):
        facts[_read_text(key, "attributes")] = _read_fact(value)
    return name, restore_attributes(xr.Dataset(variables, coords), facts)


def _read_table(
    element: Any, label: str
) -> tuple[tuple[str, ...], dict[str, np.ndarray], np.ndarray]:
    """Return axes, breakpoints by axis, and values of a table."""
    structures = element["axes"].ravel()
    axes = tuple(_read_text(axis["name"], "axes") for axis in structures)
    for axis, structure in zip(axes, structures, strict=True):
        units = _read_text(structure["units"], "units")
        if units != lookup(axis).units:
            raise ValueError(
                f"{label}: axis {axis} is given in {units!r}; convert its breakpoints to "
                f"{lookup(axis).units!r}"
            )
    points = [np.asarray(p, float).ravel() for p in element["breakpoints"].ravel()]
    if len(points) != len(axes):
        raise ValueError(f"{label}: {len(axes)} axes and breakpoints of {len(points)}")
    values = _restore_shape(element["values"], tuple(map(len, points)), label)
    return axes, dict(zip(axes, points, strict=True)), values.astype(float)


def _restore_shape(array: np.ndarray, shape: tuple[int, ...], label: str) -> np.ndarray:
    """Return a MATLAB array with one axis for each set of breakpoints."""
    if array.dtype.kind not in "iuf":
        raise ValueError(f"{label} holds no numbers")
    # MATLAB drops last axes of length one, and adds a second axis to a vector.
    if _trim_shape(array.shape) != _trim_shape(shape):
        raise ValueError(
            f"{label} is {' x '.join(map(str, array.shape))}, its breakpoints require "
            f"{' x '.join(map(str, shape)) or 'a scalar'}"
        )
    return np.array(array.reshape(shape), order="C")


def _trim_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return a shape without last axes of length one."""
    trimmed = list(shape)
    while trimmed and trimmed[-1] == 1:
        trimmed.pop()
    return tuple(trimmed)


def _read_text(item: Any, label: str) -> str:
    text = _read_fact(item)
    if not isinstance(text, str):
        raise ValueError(f"{label} holds {text!r}; a text is needed")
    return text


def _read_fact(item: Any) -> Any:
    """Return a MATLAB value as text or number, or None if it is neither."""
    array = np.asarray(item)
    if array.dtype.kind == "U":
        return "".join(array.ravel().tolist()) if array.size else ""
    if array.size != 1:
        return None
    if array.dtype.kind == "O":
        return _read_fact(array.ravel()[0])
    return array.ravel()[0].item() if array.dtype.kind in "iuf" else None

"""Terms in a MAT file of version 5, for MATLAB, Simulink n-D look-up tables and GNU Octave.

Variable ``terms`` is a structure array, one element per term; ``database`` a structure of the root
attributes; ``conventions`` a text.  Tables are in MATLAB's order: ``values(i,j,k)`` belongs to
breakpoint i of the first axis, j of the second, k of the third, and the first index runs fastest in
memory.  Check cases and the undo history stay in the database.

A damaged file of this format, which has no checksum, may be read with other numbers, so ours carry
one in the text of the header.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
from collections.abc import Iterator
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
from flightmech.support.atomic_write import written_atomically
from flightmech.support.input_files import read_bytes
from flightmech.support.mat_files import load_mat

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
_FIELD = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,62}")  # what MATLAB takes as the name of a field
_NONE = np.zeros((0, 0))
# MATLAB requires the first word only; it writes a text of its own when it saves
_SEAL = b"MATLAB 5.0 aeromatch sha256 %s"
_TEXT = 116  # bytes of the text in the header
_CONVENTIONS = """\
coefficient = sum of its terms; term = K1 * K2 * table(axes) * product of regressors; SI units and radians.
terms(n).values(i,j,k): breakpoint i of axes(1), j of axes(2), k of axes(3); interpolation is linear.
Beyond the ends: outside = 'hold' keeps the end value (clip the inputs), 'linear' goes on with the last line.
stderr is the standard error of each node; source is 0 datcom, 1 flight, 2 judgement; empty where the term has none.
A term with attributes power, exponent, floor is multiplied by max(v, floor)^exponent too, v the variable that power names.
A table without axes is a scalar; K1, K2 are factor tables over other axes, empty where the term has none.
interpn(t.breakpoints{:}, t.values, x1, x2, ...) gives a table of two and more axes, interp1 one of a single axis."""


def export_matlab(db: xr.DataTree, path: str | os.PathLike) -> None:
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
        The database is faulty, or an attribute of its root has a name that no MATLAB structure
        takes.
    """
    require_valid(db)
    problems = [
        f"root attribute {key!r} is no name of a MATLAB field; rename it"
        for key in map(str, db.attrs)
        if not _FIELD.fullmatch(key)
    ]
    if problems:
        raise SchemaError("MAT file", problems)
    rows = [_element(name, leaf) for name, leaf in terms(db).items()]
    content = {
        "conventions": _CONVENTIONS,
        "database": {str(key): _number(item) for key, item in db.attrs.items()},
        "terms": _structures(_FIELDS, rows),
    }
    file: Any = io.BytesIO()
    savemat(file, content, appendmat=False, format="5", long_field_names=True, oned_as="column")
    with written_atomically(path) as part:
        part.write_bytes(_sealed(file.getvalue()))


def _sealed(content: bytes) -> bytes:
    """Return a MAT file with the SHA-256 of what follows in the text of its header."""
    return (_SEAL % hashlib.sha256(content[_TEXT:]).hexdigest().encode()).ljust(_TEXT) + content[
        _TEXT:
    ]


def _element(name: str, leaf: xr.Dataset) -> dict[str, Any]:
    coefficient, _, contribution = name.partition("/")
    facts = flatten_attributes(leaf)
    named = {key: facts.pop(key) if isinstance(facts.get(key), str) else "" for key in _TEXTS}
    absent = [key for key in _TEXTS if key not in leaf.attrs]
    words = _cell(_terms.list_regressors(leaf))
    facts.pop("regressors", None)
    others = np.empty((len(facts), 2), object)
    for row, (key, item) in enumerate(facts.items()):
        others[row, 0], others[row, 1] = key, _number(item)
    return {
        "name": name,
        "coefficient": coefficient,
        "contribution": contribution,
        "regressors": words,
        **_table(leaf, "value"),
        "stderr": _matlab_order(leaf["stderr"]) if "stderr" in leaf else _NONE,
        "source": _matlab_order(leaf["source"]) if "source" in leaf else _NONE,
        **{
            key: _structures(_TABLE, [_table(leaf, key)]) if key in leaf else _NONE
            for key in ("K1", "K2")
        },
        **{key: text if key not in absent else _NONE for key, text in named.items()},
        "attributes": others,
    }


def _table(leaf: xr.Dataset, name: str) -> dict[str, Any]:
    axes = [str(axis) for axis in leaf[name].dims]
    return {
        "axes": _structures(
            ("name", "units"),
            [{"name": axis, "units": lookup(axis).units} for axis in axes],
        ),
        "breakpoints": _cell([leaf[axis].values.astype(float) for axis in axes]),
        "values": _matlab_order(leaf[name]),
    }


def _matlab_order(table: xr.DataArray) -> np.ndarray:
    """Return a table with the first index fastest in memory; a table of one axis is a column."""
    array = np.asfortranarray(table.values)
    return array.reshape(-1, 1) if array.ndim == 1 else array


def _cell(items: Any) -> np.ndarray:
    found = np.empty((1, len(items)), object)
    for place, item in enumerate(items):
        found[0, place] = item
    return found


def _structures(fields: tuple[str, ...], rows: list[dict[str, Any]]) -> np.ndarray:
    found = np.empty((1, len(rows)), [(field, object) for field in fields])
    for place, row in enumerate(rows):
        for field in fields:
            found[field][0, place] = row[field]
    return found


def _number(item: Any) -> Any:
    """Return an integer as MATLAB's int64, so that it comes back as one."""
    return np.int64(item) if isinstance(item, int | np.integer) else item


def import_matlab(path: str | os.PathLike) -> xr.DataTree:
    """Return the database of a MAT file.

    Parameters
    ----------
    path : path
        File as `export_matlab` writes it; MATLAB or Octave may have changed and saved it (``save
        -v7``).

    Raises
    ------
    FileNotFoundError
        No such file.
    ParseError
        Not a MAT file of version 5 to 7, a damaged one, or one without ``terms`` and ``database``.
    SchemaError
        Everything that is wrong with the terms.
    """
    path = Path(path)
    expected = "a MAT file of version 5 to 7"
    file = read_bytes(path, expected)
    if any(word in file[:_TEXT] for word in _SEAL.split()[2:4]) and file != _sealed(file):
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
    elements, root = content.get("terms"), content.get("database")
    if (
        elements is None
        or root is None
        or elements.dtype.names is None
        or root.dtype.names is None
        or root.size != 1
    ):
        raise ParseError(
            str(path),
            0,
            f"the variables {sorted(content)}",
            "structures 'terms' and 'database' as aerodb.exchange.export_matlab writes them",
        )
    problems = [
        f"terms has no field {field!r}" for field in _FIELDS if field not in elements.dtype.names
    ]
    leaves: dict[str, xr.Dataset] = {}
    for number, element in enumerate(elements.ravel() if not problems else (), 1):
        try:
            name, leaf = _leaf(element)
        except (ValueError, TypeError, IndexError, KeyError) as error:
            problems.append(f"terms({number}): {error}")
            continue
        problems += [f"terms({number}): {name} stands twice"] if name in leaves else []
        leaves[name] = leaf
    attributes = {key: _fact(root[key].item()) for key in root.dtype.names}
    problems += [
        f"database.{key} is neither a text nor a number"
        for key, item in attributes.items()
        if item is None
    ]
    if not problems:
        db = xr.DataTree.from_dict(
            {
                "/": xr.Dataset(attrs=attributes),
                **{f"/{name}": leaf for name, leaf in leaves.items()},
            }
        )
        problems = check(db)
    if problems:
        raise SchemaError(str(path), problems)
    return db


def _leaf(element: Any) -> tuple[str, xr.Dataset]:
    """Return name and leaf of one element of ``terms``; ValueError states what is wrong with it."""
    name = _text(element["name"], "name")
    if (
        name
        != f"{_text(element['coefficient'], 'coefficient')}/{_text(element['contribution'], 'contribution')}"
    ):
        raise ValueError(f"name is {name!r}, coefficient and contribution are others")
    dims, coords, values = _read_table(element, f"{name} values")
    variables: dict[str, tuple] = {"value": (dims, values)}
    for key, kind in (("stderr", float), ("source", np.uint8)):
        if element[key].size:
            variables[key] = dims, _shaped(element[key], values.shape, f"{name} {key}").astype(kind)
    for key in ("K1", "K2"):
        if element[key].size:
            others, points, factor = _read_table(element[key].ravel()[0], f"{name} {key}")
            coords |= points
            variables[key] = others, factor
    facts = {
        "regressors": " ".join(_text(word, "regressors") for word in element["regressors"].ravel())
    }
    facts |= {key: _fact(element[key]) for key in _TEXTS if element[key].dtype.kind == "U"}
    facts |= {
        _text(key, "attributes"): _fact(item) for key, item in element["attributes"].reshape(-1, 2)
    }
    return name, restore_attributes(xr.Dataset(variables, coords), facts)


def _read_table(
    element: Any, what: str
) -> tuple[tuple[str, ...], dict[str, np.ndarray], np.ndarray]:
    axes = [_text(axis, "axes") for axis in _names(element["axes"])]
    for axis, units in zip(axes, _units(element["axes"])):
        if units != lookup(axis).units:
            raise ValueError(
                f"{what}: axis {axis} is given in {units!r}; convert its breakpoints to "
                f"{lookup(axis).units!r}"
            )
    points = [np.asarray(p, float).ravel() for p in element["breakpoints"].ravel()]
    if len(points) != len(axes):
        raise ValueError(f"{what}: {len(axes)} axes and breakpoints of {len(points)}")
    return (
        tuple(axes),
        dict(zip(axes, points)),
        _shaped(element["values"], tuple(map(len, points)), what).astype(float),
    )


def _names(axes: np.ndarray) -> Iterator[Any]:
    return (axis["name"] for axis in axes.ravel())


def _units(axes: np.ndarray) -> Iterator[str]:
    return (_text(axis["units"], "units") for axis in axes.ravel())


def _shaped(array: np.ndarray, shape: tuple[int, ...], what: str) -> np.ndarray:
    """Return a MATLAB array with the axes of its breakpoints: MATLAB drops last axes of length one
    and adds a second one.
    """
    if array.dtype.kind not in "iuf":
        raise ValueError(f"{what} holds no numbers")
    core = tuple(array.shape)
    if _trimmed(core) != _trimmed(shape):
        raise ValueError(
            f"{what} is {' x '.join(map(str, core))}, its breakpoints require "
            f"{' x '.join(map(str, shape)) or 'a scalar'}"
        )
    return np.array(array.reshape(shape), order="C")


def _trimmed(shape: tuple[int, ...]) -> tuple[int, ...]:
    kept = list(shape)
    while kept and kept[-1] == 1:
        kept.pop()
    return tuple(kept)


def _text(item: Any, what: str) -> str:
    found = _fact(item)
    if not isinstance(found, str):
        raise ValueError(f"{what} holds {found!r}; a text is needed")
    return found


def _fact(item: Any) -> Any:
    """Return a MATLAB value as text or number, None when it is neither."""
    array = np.asarray(item)
    if array.dtype.kind == "U":
        return "".join(array.ravel().tolist()) if array.size else ""
    if array.dtype.kind == "O" and array.size == 1:
        return _fact(array.ravel()[0])
    return array.ravel()[0].item() if array.size == 1 and array.dtype.kind in "iuf" else None

"""Values in the tables of a compiled model, read and replaced without another compilation."""

from __future__ import annotations

import hashlib
import struct
import zlib
from collections.abc import Mapping, Sequence

import numpy as np

from flightmech.errors import SchemaError
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import PARAMETER

# Header of a block (`model_block`): the checksum, the first byte that it covers (the number of
# sections), then offset and count of every section.
_CHECKSUM, _CHECKED, _DIRECTORY = 24, 28, 32
_NODE_SECTION = 9  # number of the section with the nodes of all tables


def table_values(sim: SimModel, shapes: Mapping[str, Sequence[int]]) -> dict[str, np.ndarray]:
    """Return the values at the nodes of the tables of some terms.

    Parameters
    ----------
    sim : SimModel
    shapes : mapping of str to sequence of int
        Numbers of nodes along the axes, by term (``CL/basic``).

    Returns
    -------
    dict of str to array (`shapes`)
        [unit of the term]

    Raises
    ------
    SchemaError
        With all terms that the model does not have, or not with a table of that shape.
    """
    nodes = _view_nodes(sim.block)
    return {name: nodes[indices] for name, indices in _find_nodes(sim, shapes).items()}


def with_table_values(sim: SimModel, tables: Mapping[str, np.ndarray]) -> SimModel:
    """Return a compiled model with other values at the nodes of some tables.

    Axes and all other contents are those of the model.  The result is equal to a compilation of a
    database with these values, and is faster.

    Parameters
    ----------
    sim : SimModel
    tables : mapping of str to array
        Values of the nodes by term, in the shape of its ``value``. [unit of the term]

    Raises
    ------
    SchemaError
        As `table_values`, and values that are not finite.
    """
    indices = _find_nodes(sim, {name: np.shape(values) for name, values in tables.items()})
    problems = []
    for name, values in tables.items():
        if not np.isfinite(values).all():
            problems.append(f"{name} holds values that are not finite")
    if problems:
        raise SchemaError("values of tables", problems)
    block = bytearray(sim.block)
    nodes = _view_nodes(block)
    for name, positions in indices.items():
        nodes[positions] = tables[name]
    struct.pack_into("<I", block, _CHECKSUM, zlib.crc32(memoryview(block)[_CHECKED:]))
    changed = SimModel(bytes(block))
    changed.model.share_entries(sim.model)
    return changed


def nodes_digest(sim: SimModel) -> str:
    """Return the SHA-256 of the values at the nodes of all tables.

    It does not change if the model is written to a file and read again.
    """
    return hashlib.sha256(_view_nodes(sim.block).tobytes()).hexdigest()


def _view_nodes(block: bytes | bytearray) -> np.ndarray:
    """Return the nodes of all tables as a view of the block."""
    start, count = struct.unpack_from("<2Q", block, _DIRECTORY + 16 * _NODE_SECTION)
    return np.frombuffer(block, "<f8", count=count, offset=start)


def _find_nodes(sim: SimModel, shapes: Mapping[str, Sequence[int]]) -> dict[str, np.ndarray]:
    """Return the indices of the nodes of tables in their section."""
    indices, problems = {}, []
    for name, shape in shapes.items():
        first = _find_node(sim, name, [0] * len(shape))
        last = _find_node(sim, name, [count - 1 for count in shape])
        if min(first, last) < 0 or _has_more_nodes(sim, name, shape):
            size_text = " x ".join(map(str, shape)) or "one"
            problems.append(f"the model has no term {name} with a table of {size_text} nodes")
            continue
        # Tables with the same axes are adjacent at each node. The distance between nodes of one
        # table is therefore constant.
        size = int(np.prod(shape, dtype=int))
        stride = (last - first) // max(size - 1, 1)
        offsets = stride * np.arange(size)
        # nodes follow the named parameters of the model
        indices[name] = (first - len(sim.parameters) + offsets).reshape(tuple(shape))
    if problems:
        raise SchemaError("tables of the model", problems)
    return indices


def _has_more_nodes(sim: SimModel, name: str, shape: Sequence[int]) -> bool:
    """Return whether an axis of a table has more nodes than stated."""
    for axis, count in enumerate(shape):
        indices = [0] * len(shape)
        indices[axis] = count
        if _find_node(sim, name, indices) >= 0:
            return True
    return False


def _find_node(sim: SimModel, name: str, indices: Sequence[int]) -> int:
    """Return the index of a node among all parameters, or -1."""
    parameter = f"node.{name.replace('/', '.')}"
    if indices:
        parameter += f"[{','.join(map(str, indices))}]"
    return sim.model.find(PARAMETER, parameter)

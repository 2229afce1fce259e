"""Values in the tables of a compiled model, read and exchanged without compiling it again."""

from __future__ import annotations

import hashlib
import struct
import zlib
from collections.abc import Mapping, Sequence

import numpy as np

from flightmech.errors import SchemaError
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.kernel import PARAMETER

# the header of a block (`packer`): checksum of all that follows it, number of sections, then offset
# and count of every section
_CHECKSUM, _CHECKED, _DIRECTORY = 24, 28, 32
_NODES = 9  # the section with the nodes of all tables


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
        A term that the model does not have, or not with a table of that shape; all of them.
    """
    nodes = _nodes(sim.block)
    return {name: nodes[place] for name, place in _places(sim, shapes).items()}


def with_table_values(sim: SimModel, tables: Mapping[str, np.ndarray]) -> SimModel:
    """Return a compiled model with other values at the nodes of some tables; axes and all else
    stay.

    What `flightmech.compile` would make of a database with these values, in a hundredth of its
    time.

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
    places = _places(sim, {name: np.shape(values) for name, values in tables.items()})
    faulty = [
        f"{name} holds values that are not finite"
        for name, values in tables.items()
        if not np.isfinite(values).all()
    ]
    if faulty:
        raise SchemaError("values of tables", faulty)
    block = bytearray(sim.block)
    nodes = _nodes(block)
    for name, place in places.items():
        nodes[place] = tables[name]
    struct.pack_into("<I", block, _CHECKSUM, zlib.crc32(memoryview(block)[_CHECKED:]))
    found = SimModel(bytes(block))
    found.model.share_entries(sim.model)
    return found


def nodes_digest(sim: SimModel) -> str:
    """Return the SHA-256 of the values at the nodes of all tables: models whose files were written
    and read again have the same.
    """
    return hashlib.sha256(_nodes(sim.block).tobytes()).hexdigest()


def _nodes(block: bytes | bytearray) -> np.ndarray:
    start, count = struct.unpack_from("<2Q", block, _DIRECTORY + 16 * _NODES)
    return np.frombuffer(block, "<f8", count, start)


def _places(sim: SimModel, shapes: Mapping[str, Sequence[int]]) -> dict[str, np.ndarray]:
    """Return where the nodes of tables stand in the section; tables with the same axes lie side by
    side there.
    """
    found, faulty = {}, []
    for name, shape in shapes.items():
        first, last = (
            _index(sim, name, [0] * len(shape)),
            _index(sim, name, [count - 1 for count in shape]),
        )
        if min(first, last) < 0 or _longer(sim, name, shape):
            faulty.append(
                f"the model has no term {name} with a table of "
                f"{' x '.join(map(str, shape)) or 'one'} nodes"
            )
            continue
        size = int(np.prod(shape, dtype=int))
        apart = (last - first) // max(size - 1, 1)
        found[name] = first - len(sim.parameters) + apart * np.arange(size).reshape(tuple(shape))
    if faulty:
        raise SchemaError("tables of the model", faulty)
    return found


def _longer(sim: SimModel, name: str, shape: Sequence[int]) -> bool:
    """Whether an axis of a table has more nodes than stated."""
    beyond = [
        [count if axis == k else 0 for axis in range(len(shape))] for k, count in enumerate(shape)
    ]
    return any(_index(sim, name, at) >= 0 for at in beyond)


def _index(sim: SimModel, name: str, at: Sequence[int]) -> int:
    """Return the index of a node among all parameters; -1 when there is none."""
    return sim.model.find(
        PARAMETER, f"node.{name.replace('/', '.')}" + (f"[{','.join(map(str, at))}]" if at else "")
    )

"""States that identified a model, in short form: the evidence of its validity envelope.

A node of a table states that some flight gave it weight.  It does not state where between the nodes
the samples were, nor in which combination of angle of attack, sideslip, Mach number and
configuration. A database therefore keeps the cells of a fixed grid that the samples of its fits
visited, in the text of one root attribute.  Heights and thrust coefficients are kept one by one,
since no term joins them to all the others.  The sizes of the other variables are kept as well: they
show what a derivative contributes in flight.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from flightmech.names import lookup
from flightmech.short_text import ShortText
from flightmech.units import DEGREE

FLOWN_STATES = "flown_states"
"""Root attribute of a database with the states that identified it."""
PLANE = ("alpha", "beta", "mach")
CONFIGURATION = ("delta_f", "gear", "speedbrake")
JOINT = (*PLANE, *CONFIGURATION)
SINGLE = ("h_agl", "CT")
CELL = {
    "alpha": 1.0 * DEGREE,
    "beta": 1.0 * DEGREE,
    "mach": 0.02,
    "delta_f": 2.0 * DEGREE,
    "gear": 0.5,
    "speedbrake": 0.5,
    "h_agl": 1.0,
    "CT": 0.05,
}
"""Width of a cell of the grid; cells are centred at whole multiples. [SI]

Our numbers: narrower than the breakpoints of the tables, wider than the errors of the instruments.
"""
HIGHEST = 100.0  # [m] one cell for all heights above: the ground has no effect there
_LARGE = 99.0  # percentile of the absolute values that counts as the flown size of a variable


@dataclass(frozen=True)
class FlownStates(ShortText):
    """States that identified a model.

    Attributes
    ----------
    axes : tuple of str
        Those of `JOINT` that the samples have.
    cells : array of int (cell, axis)
        Visited cells; the centre of a cell is its number times `CELL`.
    single : dict of str to array of int (cell,)
        Visited cells of each variable of `SINGLE` that the samples have.
    sizes : dict of str to float
        99th percentile of the absolute values of further variables, such as ``qhat``. [SI]
    """

    axes: tuple[str, ...]
    cells: np.ndarray
    single: dict[str, np.ndarray] = field(default_factory=dict)
    sizes: dict[str, float] = field(default_factory=dict)


def gather_states(samples: Iterable[Mapping[Any, Any]]) -> FlownStates | None:
    """Return the states of samples; None without a sample that has alpha and mach.

    Parameters
    ----------
    samples : iterable of mapping of str to array (sample,)
        One mapping for each fit or record.  Samples that are not finite are left out. [SI]

    Notes
    -----
    An axis that some of the samples lack is left out of all, so that no state is invented.
    """
    kept = [item for item in samples if {"alpha", "mach"} <= set(map(str, item))]
    if not kept:
        return None
    # The joint axes are those that every sample has.
    axes = []
    for name in JOINT:
        if all(name in item for item in kept):
            axes.append(name)
    blocks: list[np.ndarray] = []
    single: dict[str, Any] = {}
    sizes: dict[str, Any] = {}
    for item in kept:
        columns = [_cell_numbers(name, item[name]) for name in axes]
        block = np.stack(np.broadcast_arrays(*columns), axis=-1).reshape(-1, len(axes))
        blocks.append(block[np.isfinite(block).all(axis=1)])
        for name in map(str, item):
            values = np.atleast_1d(np.asarray(item[name], dtype=float))
            values = values[np.isfinite(values)]
            if not values.size or name in JOINT:
                continue
            size = float(np.percentile(np.abs(values), _LARGE))
            sizes[name] = max(size, sizes.get(name, 0.0))
            if name in SINGLE:
                numbers = np.unique(_cell_numbers(name, values)).astype(int)
                single[name] = np.union1d(single.get(name, numbers), numbers)
    cells = np.unique(np.concatenate(blocks).astype(int), axis=0)
    if not len(cells):
        return None
    return FlownStates(tuple(axes), cells, single, sizes)


def _cell_numbers(name: str, values: Any) -> np.ndarray:
    """Return the numbers of the cells of values, as floats so that NaN remains."""
    x = np.asarray(values, dtype=float)
    if name == "h_agl":
        x = np.minimum(x, HIGHEST)
    return np.round(x / CELL[name])


def pack_states(states: FlownStates | None) -> str:
    """Return states as the text of an attribute; empty for None."""
    if states is None:
        return ""
    # sorted cells differ little from one to the next, so that their differences compress well
    changes = np.diff(states.cells, axis=0, prepend=0).astype("<i4")
    head = {
        "axes": states.axes,
        "widths": [CELL[name] for name in states.axes],
        "single": {name: numbers.tolist() for name, numbers in states.single.items()},
        "sizes": states.sizes,
    }
    content = json.dumps(head, separators=(",", ":")).encode() + b"\n" + changes.tobytes()
    return base64.b85encode(zlib.compress(content, 9)).decode()


@lru_cache(maxsize=8)
def unpack_states(text: str) -> FlownStates | None:
    """Return the states of `pack_states`; None for an empty text, a damaged one or other cells."""
    if not text:
        return None
    try:
        content = zlib.decompress(base64.b85decode(text))
        head, _, body = content.partition(b"\n")
        table = json.loads(head)
        axes = tuple(map(str, table["axes"]))
        if table["widths"] != [CELL[name] for name in axes]:
            return None
        changes = np.frombuffer(body, "<i4").reshape(-1, len(axes))
        single = {name: np.array(numbers, int) for name, numbers in table["single"].items()}
        sizes = {str(name): float(size) for name, size in table["sizes"].items()}
    except (ValueError, TypeError, KeyError, zlib.error):
        return None
    return FlownStates(axes, np.cumsum(changes, axis=0, dtype=int), single, sizes)


def join_states(*texts: str) -> str:
    """Return the states of several texts as one text; axes that one of them lacks are left out."""
    parts = [part for part in map(unpack_states, dict.fromkeys(filter(None, texts))) if part]
    if len(parts) < 2:
        return next(filter(None, texts), "")
    common = set.intersection(*(set(part.axes) for part in parts))
    axes = tuple(name for name in JOINT if name in common)
    blocks: list[np.ndarray] = []
    single: dict[str, np.ndarray] = {}
    sizes: dict[str, float] = {}
    for part in parts:
        blocks.append(part.cells[:, [part.axes.index(name) for name in axes]])
        for name, numbers in part.single.items():
            single[name] = np.union1d(single.get(name, numbers), numbers)
        for name, size in part.sizes.items():
            sizes[name] = max(size, sizes.get(name, 0.0))
    return pack_states(FlownStates(axes, np.unique(np.concatenate(blocks), axis=0), single, sizes))


def flown_size(states: FlownStates | None, name: str) -> float:
    """Return the size of a variable in flight, or a usual one if no sample has it. [SI]

    The usual size is 0.1 rad for an angle, 0.01 for a reduced rate and 1 for all others.
    """
    if states is not None and name in states.sizes:
        return states.sizes[name]
    if name.endswith("hat"):
        return 0.01
    return 0.1 if lookup(name).units == "rad" else 1.0

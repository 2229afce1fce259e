"""Tables of a JSBSim file as numbers: breakpoints and nodes, with the line of every fault.

A table of one axis has a breakpoint and a value in each line, one of two axes a line of column breakpoints and then rows;
more axes are blocks of such rows, ``<tableData breakPoint="...">``, nested for the fourth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from ..xml_reader import Element
from .products import MOST_NODES

_PLACES = ("axis4", "table", "row", "column")


def read_table(element: Element) -> tuple[list[str], list[np.ndarray], np.ndarray]:
    """Return the properties, breakpoints and nodes of a ``<table>``, axes from the outermost to the columns."""
    axes = element.all("independentVar")
    data = element.all("tableData")
    if not axes or not data:
        raise element.error("a table without independentVar or tableData", "a table over at least one property")
    if len(axes) == 1:
        points, values = _columns(data[0])
        return [axes[0].text], [points], values
    places = [axis.attributes.get("lookup", "") for axis in axes]
    order = list(_PLACES[-len(axes) :])
    if sorted(places) != sorted(order):
        raise axes[0].error(f"lookup {' '.join(places)!r} for {len(axes)} axes", f"lookup {' '.join(order)!r}, each once")
    names = {place: axis.text for place, axis in zip(places, axes)}
    grid, values = _block(element, len(axes))
    return [names[place] for place in order], grid, values


def _block(parent: Element, axes: int) -> tuple[list[np.ndarray], np.ndarray]:
    """Return breakpoints and nodes of the ``tableData`` in an element."""
    data = parent.all("tableData")
    if axes == 2:
        if len(data) != 1:
            raise parent.error(f"{len(data)} tableData for two axes", "one")
        return _rows(data[0])
    return _stack(data, axes, parent)


def _stack(data: list[Element], axes: int, parent: Element) -> tuple[list[np.ndarray], np.ndarray]:
    if len(data) < 2:
        raise parent.error(f"{len(data)} tableData where breakPoint counts", "at least two")
    points = [_break_point(item) for item in data]
    for item, low, high in zip(data[1:], points, points[1:]):
        if high <= low:
            raise item.error(f"breakPoint {high:g} after {low:g}", "breakpoints in rising order")
    blocks = [_rows(item) if axes == 3 else _stack(item.all("tableData"), axes - 1, item) for item in data]
    grid = [np.unique(np.concatenate(points)) for points in zip(*(own for own, _ in blocks))]
    if len(blocks) * math.prod(map(len, grid)) > MOST_NODES:
        raise parent.error("blocks with breakpoints of their own, all together too many", f"a table of up to {MOST_NODES} nodes")
    return [np.array(points), *grid], np.stack([_regridded(values, own, grid) for own, values in blocks])


def _regridded(values: np.ndarray, own: list[np.ndarray], grid: list[np.ndarray]) -> np.ndarray:
    """Return a block on the breakpoints of all blocks: the same function, for it is linear between its own and held beyond."""
    for position, (points, wanted) in enumerate(zip(own, grid)):
        if len(points) != len(wanted):
            values = np.apply_along_axis(partial(np.interp, wanted, points), position, values)
    return values


def _break_point(element: Element) -> float:
    text = element.attributes.get("breakPoint", "")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise element.error(f"breakPoint {text!r}", "a finite number")
    return value


def _columns(data: Element) -> tuple[np.ndarray, np.ndarray]:
    """Return breakpoints and nodes of a table of one axis: pairs, one to a line."""
    lines = data.numbers()
    for line, numbers in lines:
        if len(numbers) != 2:
            raise data.error(f"{len(numbers)} numbers", "a breakpoint and a value in each line of a table of one axis", line)
    if len(lines) < 2:
        raise data.error(f"a table of {len(lines)} breakpoints", "at least two")
    pairs = np.array([numbers for _, numbers in lines])
    _rising(data, pairs[:, 0], [line for line, _ in lines])
    return pairs[:, 0], pairs[:, 1]


def _rows(data: Element) -> tuple[list[np.ndarray], np.ndarray]:
    """Return breakpoints of rows and columns, and nodes, of a table of two axes."""
    lines = data.numbers()
    if len(lines) < 3 or len(lines[0][1]) < 2:
        raise data.error(f"a table of {max(len(lines) - 1, 0)} rows", "a line of column breakpoints, then at least two rows")
    head = lines[0][1]
    _rising(data, head, [lines[0][0]] * len(head))
    for line, numbers in lines[1:]:
        if len(numbers) != len(head) + 1:
            raise data.error(f"{len(numbers)} numbers", f"a row breakpoint and {len(head)} values, one to a column", line)
    rows = np.array([numbers for _, numbers in lines[1:]])
    _rising(data, rows[:, 0], [line for line, _ in lines[1:]])
    return [rows[:, 0], head], rows[:, 1:]


def _rising(data: Element, points: np.ndarray, lines: Sequence[int]) -> None:
    for at in np.flatnonzero(np.diff(points) <= 0).tolist():
        raise data.error(f"breakpoint {points[at + 1]:g} after {points[at]:g}", "breakpoints in rising order", lines[at + 1])

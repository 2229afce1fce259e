"""Numbers and tables of the engine and propeller files of JSBSim.

JSBSim takes a number without a unit in the unit of its source, which is that of `default` here.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from aerodb.exchange.jsbsim.metrics import unit_of_element
from aerodb.exchange.xml_reader import Element
from flightmech.units import FOOT, INCH, POUND_FORCE, SLUG

# Constants of JSBSim, which differ in the sixth digit from the defined ones.
INHG = 3386.38  # [Pa]
STANDARD_PRESSURE = 101320.73  # [Pa]
GAS_CONSTANT = 287.3  # [J kg-1 K-1]
POUNDS_PER_KILOGRAM = 2.2046
HORSEPOWER = 550.0 * FOOT * POUND_FORCE  # [W]

LENGTHS = {"FT": FOOT, "IN": INCH, "M": 1.0}
INERTIAS = {"SLUG*FT2": SLUG * FOOT**2, "KG*M2": 1.0}
PRESSURES = {"INHG": INHG, "PA": 1.0, "PSI": 6895.0}
VOLUMES = {"IN3": 1.638706e-5, "CC": 1e-6, "LTR": 1e-3}
POWERS = {"HP": HORSEPOWER, "WATTS": 1.0}
TORQUES = {"FT*LB": FOOT * POUND_FORCE, "N*M": 1.0}
PLAIN = {"": 1.0}


def read_value(
    parent: Element, tag: str, units: Mapping[str, float], *, default: float | None = None
) -> float:
    """Return the number of a child in SI.

    The first of `units` is that of a number without a unit. A missing child has the value `default`
    [SI], or raises `ParseError` without one.
    """
    element = parent.first(tag)
    if element is None and default is not None:
        return default
    element = parent.need(tag)
    if units is PLAIN:
        return element.number
    return element.number * unit_of_element(element, next(iter(units)), units)


def find_table(parent: Element, name: str) -> Element | None:
    """Return the table of a name. A table inside an XML comment does not exist."""
    for table in parent.all("table"):
        if table.attributes.get("name") == name:
            return table
    return None


def need_table(parent: Element, name: str) -> Element:
    """Return the table of a name; a missing one raises `ParseError`."""
    table = find_table(parent, name)
    if table is None:
        raise parent.error(f"<{parent.tag}> without the table {name}", "this table")
    return table


def read_line_table(table: Element) -> tuple[np.ndarray, np.ndarray]:
    """Return breakpoints (n,) and values (n,) of a table over one variable."""
    rows = _table_rows(table)
    if any(len(row) != 2 for row in rows):
        raise table.error("rows that do not have two numbers", "a breakpoint and a value in a row")
    array = np.array(rows)
    return _rising(table, array[:, 0]), array[:, 1]


def read_plane_table(table: Element) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return breakpoints of rows (n,) and columns (m,), and values (n, m)."""
    rows = _table_rows(table)
    columns = rows[0]
    if any(len(row) != len(columns) + 1 for row in rows[1:]):
        raise table.error(
            f"rows that do not have {len(columns) + 1} numbers",
            "a row of breakpoints, then rows of a breakpoint and a value for each of them",
        )
    array = np.array(rows[1:])
    return _rising(table, array[:, 0]), _rising(table, columns), array[:, 1:]


def is_plane(table: Element) -> bool:
    """Return whether a table has two variables: its first row is shorter than the others."""
    rows = _table_rows(table)
    return len(rows) > 1 and len(rows[0]) < len(rows[1])


def _table_rows(table: Element) -> list[np.ndarray]:
    rows = [row for _, row in table.need("tableData").numbers()]
    if len(rows) < 2:
        raise table.error(f"a table of {len(rows)} rows", "at least two")
    return rows


def _rising(table: Element, points: np.ndarray) -> np.ndarray:
    if (np.diff(points) <= 0.0).any():
        raise table.error("breakpoints that do not rise", "breakpoints in rising order")
    return points

"""Points of a balance from a file: states, loads and further columns in SI units."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np

from flightmech.errors import SchemaError
from flightmech.units import to_si
from flighttest.records.readers.columns import locate_column
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.opening import open_recording
from flighttest.records.readers.recording import CLOCK_NAMES, Recording
from flighttest.special_tests.wind_tunnel.balance import LOADS, UNITS, BalanceSetup

# Time between points of a file without time [s].
_CLOCK = 1.0


def read_points(path: str | Path, setup: BalanceSetup) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return the columns of the points in SI units, and the names of the loads.

    Points with a missing value are omitted.
    """
    recording = open_recording(path, NameMap({}))
    points: dict[str, np.ndarray] = {}
    for name, units in UNITS.items():
        # a measurand without an entry may have a column of its own name
        column = _find_column(
            recording, setup.columns.get(name, name), path, required=name in setup.columns
        )
        if column is not None:
            values, unit = column
            points[name] = np.asarray(to_si(values, unit or units, units))
    for name, label in setup.columns.items():
        if name not in UNITS:
            column = _find_column(recording, label, path, required=True)
            # a required column that is missing raises
            assert column is not None
            values, unit = column
            points[name] = np.asarray(to_si(values, unit)) if unit else values
    loads = [name for name in LOADS if name in points]
    _check_columns(points, loads, path)
    points["time"] = _find_times(recording, len(points["alpha"]))
    complete = np.logical_and.reduce([np.isfinite(values) for values in points.values()])
    points = {name: values[complete] for name, values in points.items()}
    for name, value in {"beta": 0.0, "rho": setup.rho, **setup.constants}.items():
        points.setdefault(name, np.full(int(complete.sum()), value))
    if "qbar" not in points:
        points["qbar"] = 0.5 * points["rho"] * points["V"] ** 2
    return points, loads


def _check_columns(points: Collection[str], loads: list[str], path: str | Path) -> None:
    """Raise SchemaError if the points do not give a coefficient."""
    problems = []
    if "alpha" not in points:
        problems.append("no column of alpha")
    if "V" not in points and "qbar" not in points:
        problems.append("no column of V or qbar")
    if not loads:
        problems.append(f"no load; expected some of {', '.join(LOADS)}")
    if problems:
        raise SchemaError(str(path), [f"{problem}; name it in [columns]" for problem in problems])


def _find_times(recording: Recording, count: int) -> np.ndarray:
    """Return the recorded times of the points, or uniform times."""
    for table in recording.tables.values():
        for name in CLOCK_NAMES:
            # The clock of a table of another length is not that of the points.
            if name in table.columns and len(table.columns[name]) == count:
                return np.asarray(table.columns[name], float)
    return _CLOCK * np.arange(count)


def _find_column(
    recording: Recording, label: str, path: str | Path, *, required: bool
) -> tuple[np.ndarray, str] | None:
    """Return values and unit of a column; points need no clock."""
    name, _, unit = label.partition("[")
    name, unit = name.strip(), unit.strip().rstrip("]").strip()
    table = next(iter(recording.tables.values()))
    if len(recording.tables) == 1 and name in table.columns:
        return np.asarray(table.columns[name], float), unit or table.units.get(name, "")
    column = locate_column(recording, label, path, required)
    if column is None:
        return None
    _, values, recorded_unit = column
    return values, recorded_unit

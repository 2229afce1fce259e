"""Start of a record and drift of its clock from a column of universal time."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from typing import Any, NamedTuple

import numpy as np

from flightmech.errors import SchemaError, UnknownName
from flighttest.records.readers.clocks import Clocks
from flighttest.records.readers.name_map import Utc
from flighttest.records.readers.recording import RecordedTable

_EPOCHS = {"unix": datetime(1970, 1, 1, tzinfo=UTC), "gps": datetime(1980, 1, 6, tzinfo=UTC)}
_OUTLIER = 6.0  # scaled median absolute deviations
_SIGMA_PER_MAD = 1.4826  # standard deviation of normal errors over their median absolute deviation
_LEAST_SIGMA = 1e-6  # s
_LEAST_SPAN = 10.0  # s of record that a drift needs


class _StampLine(NamedTuple):
    """Straight line through UTC over record time.

    `offset` is the UTC at zero of the record clock, `is_used` distinguishes the stamps near the
    line, and `sigma` is their scatter. [s]
    """

    slope: float
    offset: float
    sigma: float
    is_used: np.ndarray


def utc_facts(
    utc: Utc | None, tables: Mapping[str, RecordedTable], clocks: Clocks
) -> dict[str, Any]:
    """Return start and drift of the record clock from a column of universal time.

    Returns
    -------
    dict
        ``start`` (ISO 8601, UTC at zero of the record clock), ``clock_drift`` (seconds that the
        record clock gains per second of UTC) with its standard error ``clock_drift_stderr``,
        ``clock_scatter`` (median absolute deviation from the line, scaled to sigma) [s].

    Raises
    ------
    UnknownName
        The column does not exist and is not optional.
    SchemaError
        The column has fewer than two valid stamps.

    Notes
    -----
    A straight line is fitted to UTC over record time, without stamps that are further off than
    `_OUTLIER` scaled deviations.
    """
    if utc is None:
        return {}
    group, _, column = utc.column.rpartition("/")
    group = group or next(iter(tables))
    if group not in tables or column not in tables[group].columns:
        if utc.optional:
            return {}
        raise _unknown_column(utc, tables)
    clock = clocks.table_clock(group, f"{clocks.file}, table {group}")
    clocks.columns_used.add((group, column))
    scale = clocks.names.clock.changed(unit=utc.unit).seconds(None)
    stamps = np.asarray(tables[group].columns[column], float)[clock.samples] * scale
    # A receiver gives zero until it has the time.
    is_valid = np.isfinite(stamps) & (stamps > 0.0)
    if is_valid.sum() < 2:
        if utc.optional:
            return {}
        raise SchemaError(
            f"{clocks.file}, column {utc.column}",
            [f"{int(is_valid.sum())} valid stamps; two or more name the start"],
        )

    time = clock.time[is_valid]
    line = _fit_line(time, stamps[is_valid])
    leap_seconds = utc.leap_seconds if utc.epoch == "gps" else 0
    start = _EPOCHS[utc.epoch] + timedelta(seconds=float(line.offset - leap_seconds))
    facts = {
        "start": start.isoformat(timespec="microseconds").replace("+00:00", "Z"),
        "clock_scatter": line.sigma,
    }
    facts.update(_drift_facts(line, time[line.is_used]))
    outliers = int((~line.is_used).sum())
    if outliers:
        clocks.notes.append(f"{utc.column}: {outliers} stamps off the line were not used")
    return facts


def _drift_facts(line: _StampLine, time: np.ndarray) -> dict[str, float]:
    """Return drift and its standard error; `time` are the stamps near the line. [s]"""
    if np.ptp(time) <= _LEAST_SPAN:
        return {}
    # Standard error of the slope of a line: sigma over the root of the sum of squares of time.
    spread = float(np.sqrt(np.sum((time - time.mean()) ** 2)))
    return {
        "clock_drift": float(1.0 / line.slope - 1.0),
        "clock_drift_stderr": line.sigma / spread,
    }


def _unknown_column(utc: Utc, tables: Mapping[str, RecordedTable]) -> UnknownName:
    """Return the error for a column of universal time that the file does not have."""
    columns = []
    for name, table in tables.items():
        columns += [f"{name}/{column}" for column in table.columns]
    return UnknownName(utc.column, columns, what="column", hint="[utc] of the name map")


def _fit_line(time: np.ndarray, stamps: np.ndarray) -> _StampLine:
    """Return the straight line through stamps over time, without outliers."""
    # Seconds since 1970 leave few digits for the fraction, so that whole seconds are subtracted.
    whole_seconds = np.floor(stamps[0])
    slope, intercept = 1.0, float(np.median(stamps - whole_seconds - time))
    is_used = np.ones(len(time), bool)
    for _ in range(3):
        residual = stamps - whole_seconds - (intercept + slope * time)
        deviation = np.abs(residual[is_used] - np.median(residual[is_used]))
        sigma = max(_SIGMA_PER_MAD * float(np.median(deviation)), _LEAST_SIGMA)
        is_used = np.abs(residual - np.median(residual[is_used])) <= _OUTLIER * sigma
        if np.ptp(time[is_used]) > _LEAST_SPAN:
            slope, intercept = np.polyfit(time[is_used], (stamps - whole_seconds)[is_used], 1)
    return _StampLine(slope, whole_seconds + intercept, sigma, is_used)

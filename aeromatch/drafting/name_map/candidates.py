"""Columns without a quantity that move as an absent quantity would.

Each absent quantity has a reference signal from the quantities that are known: the rates are the
derivatives of the attitudes, a control surface accelerates its rate, the angle of attack follows
the normal force.  A column is a candidate if its correlation with the reference is large.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from aeromatch.drafting.name_map.name_rows import NameMapRow
from flightmech.errors import UnitError
from flightmech.names import lookup
from flightmech.units import parse_unit
from flighttest.records.readers.channel_correction import recorder_units
from flighttest.records.readers.columns import clear_unit, column_words, unit_of_column
from flighttest.records.readers.name_map import Clock, NameMap
from flighttest.records.readers.opening import open_recording
from flighttest.records.readers.recording import RecordedTable, clock_name

# Time of the moving mean that is taken off before quantities are compared: of slow ones, and of
# surfaces, whose trim follows power and speed and moves no rate. [s]
_SLOW, _TRIM = 20.0, 10.0
# Time of the moving mean that smooths a derivative. [s]
_SMOOTH = 0.3
# Largest delay between a column and its reference. [s]
_LARGEST_LAG = 0.6
# Least correlation of a candidate, and number of candidates of a quantity.
_LEAST, _MOST = 0.5, 2
# Number of recordings that are compared.
_RECORDS = 3
# Largest relative difference in size between a column and its reference, in the right unit.
_SAME_SIZE = 0.2
# A further candidate has at least this share of the largest correlation.
_NEAR = 0.9
# Fewest samples of a comparison.
_FEWEST = 100

Signals = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class ColumnCandidate:
    """A column that may be an absent quantity.

    Attributes
    ----------
    quantity, column : str
    correlation : float
        Largest correlation with the reference over the allowed delays.
    sign : int
        -1 if the column has the opposite positive sense.
    reference : str
        What the column was compared with.
    unit : str
        Unit that the heading states, else that in which the column has the size of its reference;
        empty if no unit fits.
    """

    quantity: str
    column: str
    correlation: float
    sign: int
    reference: str
    unit: str = ""

    def text(self) -> str:
        """Return a line for the author."""
        sign = "" if self.sign > 0 else ", sign = -1"
        return (
            f"column {self.column} moves with {self.reference} (correlation "
            f"{abs(self.correlation):.2f}): if it is {self.quantity}, write "
            f'{self.quantity} = {{ column = "{self.column}", '
            f'unit = "{self.unit or "..."}"{sign} }} into names.toml '
            f"and run init again"
        )


@dataclass(frozen=True)
class _Reference:
    """Signal that an absent quantity resembles, and the quantities that it needs.

    The part that the quantities `given` explain is taken off both signals: a rate is damped, and
    turned back by the angle of attack or of sideslip, which shows in the acceleration.  Before
    that, the moving mean over `mean_time` [s] is taken off all signals; 0 leaves them.
    """

    text: str
    needs: tuple[str, ...]
    make: Callable[[Signals, float], np.ndarray]
    mean_time: float = 0.0
    given: tuple[str, ...] = ()


def _rate_of(name: str, factor: float = 1.0) -> Callable[[Signals, float], np.ndarray]:
    def make(signals: Signals, step: float) -> np.ndarray:
        values = signals[name]
        if name == "psi":
            values = np.unwrap(values)
        return factor * _smooth(np.gradient(values, step), step)

    return make


def _integral_of(name: str, factor: float = 1.0) -> Callable[[Signals, float], np.ndarray]:
    return lambda signals, step: factor * np.cumsum(signals[name]) * step


def _force_over_pressure(name: str) -> Callable[[Signals, float], np.ndarray]:
    def make(signals: Signals, step: float) -> np.ndarray:
        speed = next(signals[key] for key in ("V", "V_cas", "V_ground") if key in signals)
        return -signals[name] / np.maximum(speed, 1.0) ** 2

    return make


# The first reference whose needs are recorded is used.  A positive deflection decreases its rate.
_REFERENCES: dict[str, tuple[_Reference, ...]] = {
    "delta_e": (
        _Reference(
            "the pitch acceleration",
            ("q",),
            _rate_of("q", -1.0),
            mean_time=_TRIM,
            given=("q", "az_imu", "alpha_vane"),
        ),
    ),
    "delta_a": (
        _Reference(
            "the roll acceleration",
            ("p",),
            _rate_of("p", -1.0),
            mean_time=_TRIM,
            given=("p", "r", "ay_imu", "beta_vane"),
        ),
    ),
    "delta_r": (
        _Reference(
            "the yaw acceleration",
            ("r",),
            _rate_of("r", -1.0),
            mean_time=_TRIM,
            given=("r", "p", "ay_imu", "beta_vane"),
        ),
    ),
    "p": (_Reference("the derivative of the bank angle", ("phi",), _rate_of("phi")),),
    "q": (_Reference("the derivative of the pitch attitude", ("theta",), _rate_of("theta")),),
    "r": (_Reference("the derivative of the heading", ("psi",), _rate_of("psi")),),
    "phi": (
        _Reference("the integral of the roll rate", ("p",), _integral_of("p"), mean_time=_SLOW),
    ),
    "theta": (
        _Reference("the integral of the pitch rate", ("q",), _integral_of("q"), mean_time=_SLOW),
    ),
    "alpha_vane": (
        _Reference(
            "the normal force", ("az_imu", "V"), _force_over_pressure("az_imu"), mean_time=_SLOW
        ),
        _Reference("the normal force", ("az_imu", "V_cas"), _force_over_pressure("az_imu"), _SLOW),
    ),
    "beta_vane": (
        _Reference(
            "the side force", ("ay_imu", "V"), _force_over_pressure("ay_imu"), mean_time=_SLOW
        ),
        _Reference("the side force", ("ay_imu", "V_cas"), _force_over_pressure("ay_imu"), _SLOW),
    ),
    "V_cas": (
        _Reference(
            "the ground speed",
            ("vn", "ve"),
            lambda signals, step: np.hypot(signals["vn"], signals["ve"]),
            mean_time=_SLOW,
        ),
    ),
    "h_baro": (
        _Reference("the satellite height", ("h_gps",), lambda signals, step: signals["h_gps"]),
        _Reference("the integral of the vertical speed", ("hdot",), _integral_of("hdot")),
        _Reference("the integral of the vertical speed", ("vd",), _integral_of("vd", -1.0)),
    ),
}
# Other quantities that serve in place of an absent one.
_SUBSTITUTES = {
    "delta_a": ("delta_a_left", "delta_a_right"),
    "V_cas": ("V", "mach", "q_c"),
    "h_baro": ("p_static",),
}


def candidates_of(
    rows: Sequence[NameMapRow], files: Sequence[Path], left_out: Sequence[str]
) -> list[ColumnCandidate]:
    """Return the candidates of the largest recordings, the best ones of each quantity.

    Parameters
    ----------
    rows : sequence of NameMapRow
        Known quantities.
    files : sequence of Path
        Recordings.
    left_out : sequence of str
        Columns without a quantity.
    """
    best: dict[tuple[str, str], ColumnCandidate] = {}
    # Long records show a correlation best.
    largest = sorted(files, key=lambda file: -file.stat().st_size)[:_RECORDS]
    for file in largest:
        for table in open_recording(file, NameMap({})).tables.values():
            step = _mean_step(table)
            if step is None:
                continue
            for found in find_candidates(rows, table, left_out, step):
                key = found.quantity, found.column
                if key not in best or abs(found.correlation) > abs(best[key].correlation):
                    best[key] = found
    ordered = sorted(best.values(), key=lambda item: -abs(item.correlation))
    chosen: list[ColumnCandidate] = []
    for quantity in dict.fromkeys(item.quantity for item in ordered):
        same = [item for item in ordered if item.quantity == quantity]
        # Weaker candidates of a quantity count if they are near the best one.
        least = _NEAR * abs(same[0].correlation)
        chosen += [item for item in same[:_MOST] if abs(item.correlation) >= least]
    return chosen


def _mean_step(table: RecordedTable) -> float | None:
    """Return the mean time between the samples of a table; None without a clock. [s]"""
    if table.time is not None:
        stamps, unit = np.asarray(table.time, float), 1.0
    else:
        name = clock_name(table.columns)
        if not name:
            return None
        stamps = np.asarray(table.columns[name], float)
        unit = Clock().seconds(unit_of_column(table, name, "time"))
    stamps = stamps[np.isfinite(stamps)]
    if len(stamps) < _FEWEST or stamps[-1] <= stamps[0]:
        return None
    return float((stamps[-1] - stamps[0]) * unit / (len(stamps) - 1))


def find_candidates(
    rows: Sequence[NameMapRow], table: RecordedTable, columns: Sequence[str], step: float
) -> list[ColumnCandidate]:
    """Return the columns of a table that may be absent quantities, the best one first.

    Parameters
    ----------
    rows : sequence of NameMapRow
        Known quantities; those of other tables are ignored.
    table : RecordedTable
    columns : sequence of str
        Columns without a quantity.
    step : float
        Mean time between samples. [s]
    """
    signals = _signals_of(rows, table)
    known = {row.name for row in rows}
    candidates: list[ColumnCandidate] = []
    for quantity, references in _REFERENCES.items():
        if known & {quantity, *_SUBSTITUTES.get(quantity, ())}:
            continue
        for reference in references:
            if signals.keys() >= set(reference.needs):
                candidates += _compare_columns(
                    quantity, reference, signals, table=table, columns=columns, step=step
                )
                break
    return candidates


def _signals_of(rows: Sequence[NameMapRow], table: RecordedTable) -> dict[str, np.ndarray]:
    """Return the known quantities of a table. [SI]"""
    signals: dict[str, np.ndarray] = {}
    for row in rows:
        for column in row.channel.columns:
            name = column if column in table.columns else column.rpartition("/")[2]
            if name in table.columns:
                values = np.asarray(table.columns[name], float)
                converted = row.channel.convert(values, table.units.get(name), row.name)
                # A gap would end an integral and the turns of a heading.
                filled = pd.Series(converted).interpolate(limit_direction="both")
                signals[row.name] = filled.to_numpy()
                break
    return signals


def _compare_columns(
    quantity: str,
    reference: _Reference,
    signals: Signals,
    table: RecordedTable,
    columns: Sequence[str],
    step: float,
) -> list[ColumnCandidate]:
    expected = _prepare(reference.make(signals, step), step, reference.mean_time)
    given = []
    for name in reference.given:
        if name in signals:
            given.append(_smooth(_prepare(signals[name], step, reference.mean_time), step))
    found: list[ColumnCandidate] = []
    for column in columns:
        name = column if column in table.columns else column.rpartition("/")[2]
        if name not in table.columns:
            continue
        values = np.asarray(table.columns[name], float)
        # A constant column and a text column resemble nothing.
        if np.isfinite(values).sum() < _FEWEST or np.nanstd(values) == 0.0:
            continue
        stated = table.units.get(name) or _unit_in_heading(name)
        if not _is_possible(quantity, stated):
            continue
        values = _prepare(values, step, reference.mean_time)
        if given:
            values = _smooth(values, step)
        value = _largest_correlation(values, expected, given, step)
        if abs(value) >= _LEAST:
            sign = 1 if value > 0.0 else -1
            unit = stated
            if not unit and not given:
                unit = _unit_by_size(quantity, values, expected)
            found.append(
                ColumnCandidate(
                    quantity, column, value, sign=sign, reference=reference.text, unit=unit
                )
            )
    found.sort(key=lambda candidate: -abs(candidate.correlation))
    return found[:_MOST]


def _unit_in_heading(column: str) -> str:
    """Return the unit at the end of a heading, or before its last word: AIL_DEG_X; else empty."""
    words = column_words(column)
    return clear_unit(column) or clear_unit("_".join(words[:-1]))


def _is_possible(quantity: str, stated: str) -> bool:
    """Return whether a column with the unit that its heading states may be a quantity."""
    try:
        if stated == "%" and lookup(quantity).units == "rad":
            return False
        return not stated or parse_unit(stated)[0] == parse_unit(lookup(quantity).units)[0]
    except UnitError:
        # A word in brackets that is not a unit excludes nothing.
        return True


def _unit_by_size(quantity: str, values: np.ndarray, expected: np.ndarray) -> str:
    """Return the unit of a recorder in which a column has the size of its reference."""
    ratio = float(np.std(expected) / np.std(values))
    for unit in recorder_units(quantity):
        factor = parse_unit(unit)[1]
        if abs(ratio / factor - 1.0) < _SAME_SIZE:
            return unit
    return ""


def _prepare(values: np.ndarray, step: float, mean_time: float) -> np.ndarray:
    """Return values without gaps and without their moving mean over a time; 0 takes none off."""
    series = pd.Series(values).interpolate(limit_direction="both")
    if mean_time > 0.0:
        window = max(round(mean_time / step), 3)
        series = series - series.rolling(window, center=True, min_periods=1).mean()
    return series.to_numpy()


def _smooth(values: np.ndarray, step: float) -> np.ndarray:
    window = max(round(_SMOOTH / step), 1)
    return pd.Series(values).rolling(window, center=True, min_periods=1).mean().to_numpy()


def _largest_correlation(
    values: np.ndarray, expected: np.ndarray, given: Sequence[np.ndarray], step: float
) -> float:
    """Return the partial correlation of largest size over the delays, with its sign.

    A quantity that causes the reference can only be early (`values` moved back by a positive
    delay makes it late); other quantities may be either.
    """
    best = 0.0
    most = round(_LARGEST_LAG / step)
    first_lag = 0 if given else -most
    for lag in range(first_lag, most + 1, max(most // 8, 1)):
        moved, target = _overlap(values, expected, -lag if given else lag)
        if len(moved) < _FEWEST:
            continue
        parts = [signal[lag:] for signal in given]
        value = _partial_correlation(moved, target, parts)
        if abs(value) > abs(best):
            best = value
    return best


def _partial_correlation(
    first: np.ndarray, second: np.ndarray, given: Sequence[np.ndarray]
) -> float:
    """Return the correlation of two signals without what other signals explain of both."""
    known = np.column_stack([np.ones(len(first)), *given])
    residuals = []
    for signal in (first, second):
        factors, *_ = np.linalg.lstsq(known, signal, rcond=None)
        residuals.append(signal - known @ factors)
    norm = np.linalg.norm(residuals[0]) * np.linalg.norm(residuals[1])
    # Residuals that are rounding errors of their signal correlate by chance.
    least = 1e-9 * np.linalg.norm(first) * np.linalg.norm(second)
    return float(residuals[0] @ residuals[1] / norm) if norm > least else 0.0


def _overlap(values: np.ndarray, expected: np.ndarray, lag: int) -> tuple[np.ndarray, np.ndarray]:
    """Return both signals where they overlap, with `values` moved back by `lag` samples."""
    if lag >= 0:
        return values[lag:], expected[: len(expected) - lag]
    return values[:lag], expected[-lag:]

"""Figures of an evaluation by name, and their comparison with bounds."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import (
    AeromatchError,
    IdentificationError,
    OutOfRange,
    SchemaError,
    UnknownName,
)
from flightmech.names import WRAPPED, lookup
from flightmech.quantities import parse_quantity, time_text
from flightmech.support.arrays import rms
from flightmech.units import G0, from_si
from flighttest.flight_programme.evaluation.plan import (
    Bound,
    EvaluationPlan,
    StationaryTimes,
    StraightLine,
    read_sheet,
)
from flighttest.reconstruction.quality.checks.control_response import EQUATIONS
from flighttest.reconstruction.quality.checks.relations import RELATIONS
from flighttest.reconstruction.quality.result import Quality
from flighttest.records.sensors.measurements import pressure
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.submodels.aircraft_properties.eigenmotion import Eigenmotion

# Fewest points of a line. Two points are drawn by any error; three say little about their scatter.
LEAST = 4
# Relative range of x below which the points do not determine a slope.
_LEAST_RANGE = 1e-6
# Ratio of specific heats over two: dynamic pressure is 0.7 p Ma^2.
_HALF_GAMMA = 0.7

# Units in which figures are displayed.
DISPLAY = {"rad": "deg", "rad s-1": "rad/s", "m s-1": "m/s", "s-2": "1/s2 per rad"}
INSIDE, OUTSIDE, OPEN = "inside", "outside", "not determined"
COLUMNS = ("of", "value", "stderr", "unit", "low", "high", "verdict", "source", "reason")
# Figures of an eigenmotion with their units, by kind.
_MODES = {
    "oscillation": {"period": "s", "damping_ratio": "1", "omega_n": "rad s-1", "t_half": "s"},
    "aperiodic": {"time_constant": "s", "t_half": "s"},
}
# Figures of a kinematic relation.
_KINEMATIC = ("slope", "offset", "correlation", "disagreement")


@dataclass(frozen=True)
class FittedLine:
    """A straight line y = offset + slope x through the means of stationary points.

    Attributes
    ----------
    line : StraightLine
    x, y : array (point,)
        [SI]
    slope, offset, root : (float, float)
        Value and standard error; root is the x at which y is zero. [SI]
    rms : float
        Root mean square of the residuals. [SI]
    """

    line: StraightLine
    x: np.ndarray
    y: np.ndarray
    slope: tuple[float, float]
    offset: tuple[float, float]
    root: tuple[float, float]
    rms: float


def times_of(points: StationaryTimes) -> pd.DataFrame:
    """Return the noted times and series of a sheet of stationary points.

    The table has columns ``time series`` and one row per time and series, sorted.
    """
    sheet = read_sheet(points.file)
    series = [""] * len(sheet.rows)
    if points.series:
        series = [sheet.text(row, points.series) for row in range(len(sheet.rows))]
    table = pd.DataFrame({"time": points.time.of(sheet, "s"), "series": series})
    return table.dropna().drop_duplicates().sort_values("time", ignore_index=True)


def series_windows(
    points: StationaryTimes, series: Sequence[str] = ()
) -> list[tuple[float, float]]:
    """Return the windows of several series, each time once; of all points without a series.

    Raises
    ------
    UnknownName
        No point has one of the series.
    """
    table = times_of(points)
    names = set(table["series"])
    for name in series:
        if name not in names:
            raise UnknownName(name, names, "series", f"sheet {points.file}")
    if series:
        table = table[table["series"].isin(series)]
    before, after = points.window
    return [(float(time) + before, float(time) + after) for time in sorted(set(table["time"]))]


def window_means(
    record: xr.DataTree,
    aircraft: Aircraft,
    windows: Sequence[tuple[float, float]],
    data: xr.Dataset | None = None,
) -> pd.DataFrame:
    """Return the means of all channels over windows.

    Parameters
    ----------
    record : DataTree
        Recorded channels, with the leaf ``computed``.
    aircraft : Aircraft
    windows : sequence of (start, stop)
        [s]
    data : Dataset (time,), optional
        Coefficients of reconstructed windows; their means replace the recorded ones.

    Returns
    -------
    DataFrame
        One row per window, ``start stop`` and channels, headings within their turn. [SI]
        ``CL_weight`` is weight over dynamic pressure and wing area, the lift coefficient of level
        flight without a part of the thrust.  ``attitude_less_climb`` is pitch attitude less angle
        of climb.

    Raises
    ------
    OutOfRange
        A window is not inside the record.
    """
    return pd.DataFrame([_average_window(record, aircraft, window, data) for window in windows])


def _average_window(
    record: xr.DataTree, aircraft: Aircraft, window: tuple[float, float], data: xr.Dataset | None
) -> dict[str, float]:
    """Return the means of all channels over one window."""
    start, stop = window
    row = {"start": start, "stop": stop}
    climb = np.nan
    for node in record.children.values():
        leaf = node.to_dataset()
        time = leaf["time"].values
        inside = (time >= start) & (time <= stop)
        if inside.sum() < 2:
            raise OutOfRange(
                f"stationary point {time_text(start)} ... {time_text(stop)} s is not inside the "
                "record, "
                f"{time_text(time[0])} ... {time_text(time[-1])} s"
            )
        for name, x in leaf.data_vars.items():
            row[str(name)] = _mean_of_channel(str(name), x.values[inside])
        if "h_baro" in leaf:
            # rate of climb [m s-1] by a straight line
            climb = float(np.polyfit(time[inside] - start, leaf["h_baro"].values[inside], 1)[0])
    if {"h_baro", "mach", "mass"} <= set(row):
        p_static = float(pressure(np.array(row["h_baro"])))
        force = _HALF_GAMMA * p_static * row["mach"] ** 2 * aircraft.S
        row["CL_weight"] = row["mass"] * G0 / force
    if {"theta", "V", "h_baro"} <= set(row):
        row["attitude_less_climb"] = row["theta"] - float(np.arcsin(climb / row["V"]))
    if data is not None:
        for name, x in data.sel(time=slice(start, stop)).data_vars.items():
            if x.dims == ("time",) and x.dtype.kind == "f":
                row[str(name)] = float(x.mean())
    return row


def _mean_of_channel(name: str, x: np.ndarray) -> float:
    """Return the mean of the known samples (time,), of a heading within its turn. [SI]"""
    known = x[np.isfinite(x)]
    if not known.size or name not in WRAPPED:
        return float(known.mean()) if known.size else math.nan
    mean, turn = float(np.unwrap(known).mean()), 2.0 * math.pi
    return mean % turn if known.min() >= 0.0 else math.remainder(mean, turn)


def line_through(line: StraightLine, points: pd.DataFrame) -> FittedLine:
    """Return a straight line through points by least squares; errors from their scatter.

    Raises
    ------
    UnknownName
        The points do not have a column of the line.
    IdentificationError
        There are fewer than four points, all points have the same x, or a point has no value.
    """
    for name in (line.x, line.y):
        if name not in points:
            raise UnknownName(name, map(str, points.columns), "mean", f"line {line.name}")
    x, y = points[line.x].to_numpy(float), points[line.y].to_numpy(float)
    if missing := int((~np.isfinite(x + y)).sum()):
        raise IdentificationError(
            f"line {line.name}: {missing} of {len(x)} points have no mean of {line.x} and "
            f"{line.y}; repair these channels, or leave the points out of the series"
        )
    if line.kind == "polar":
        x = x**2
    if len(x) < LEAST:
        raise IdentificationError(
            f"line {line.name}: {len(x)} points; {LEAST} or more are needed to see their scatter"
        )
    if np.ptp(x) <= _LEAST_RANGE * np.abs(x).max():
        raise IdentificationError(
            f"line {line.name}: no excitation, {line.x} is {x[0]:.4g} at all points; fly points "
            f"at several values of {line.x}"
        )
    X = np.stack([np.ones_like(x), x], axis=1)
    (b, m), *_ = np.linalg.lstsq(X, y)
    residual = y - b - m * x
    # covariance of offset and slope, with the variance of the residuals
    C = np.linalg.inv(X.T @ X) * float(residual @ residual) / (len(x) - 2)
    # gradient of the root -b/m with respect to offset and slope
    gradient = np.array([-1.0 / m, b / m**2])
    errors = np.sqrt([C[1, 1], C[0, 0], gradient @ C @ gradient])
    return FittedLine(
        line,
        x,
        y,
        slope=(m, errors[0]),
        offset=(b, errors[1]),
        root=(-b / m, errors[2]),
        rms=rms(residual),
    )


def format_si_value(value: float, unit: str, digits: int = 4) -> str:
    """Return an SI value as text, angles in degrees; a dash for a value that is not finite."""
    if not math.isfinite(value):
        return "-"
    if unit == "rad":
        value = from_si(value, "deg")
    return f"{value:.{digits}g}"


def unit_shown(unit: str) -> str:
    """Return the unit of a value of `format_si_value`."""
    if unit == "1":
        return ""
    return DISPLAY.get(unit, unit)


def limits_shown(low: float, high: float, unit: str) -> str:
    """Return the bounds as text."""
    if math.isinf(high):
        return f"at least {format_si_value(low, unit)}"
    if math.isinf(low):
        return f"at most {format_si_value(high, unit)}"
    return f"{format_si_value(low, unit)} ... {format_si_value(high, unit)}"


class FigureOfMerit(NamedTuple):
    """One number: value, standard error (NaN if there is none), SI unit."""

    value: float
    stderr: float
    unit: str


def figure_units(plan: EvaluationPlan) -> dict[str, str]:
    """Return name and SI unit of every figure that an evaluation can have.

    Names are ``kinematics.theta_rate.slope``, ``delay.theta`` and ``answer.delta_e``; of a line
    ``trim.slope trim.offset trim.root``; of a polar ``polar.CD0 polar.oswald``; of a fit
    ``pitching.alpha`` and its other terms; of a mode ``phugoid.period`` and so on.
    """
    units = {}
    for relation in RELATIONS:
        for figure in _KINEMATIC:
            units[f"kinematics.{relation.name}.{figure}"] = _kinematic_unit(figure, relation.units)
    for relation in RELATIONS:
        for channel in relation.needs:
            units[f"delay.{channel}"] = "s"
    for equation in EQUATIONS:
        units[f"answer.{equation.surface}"] = "s-2"
    for line in plan.line:
        units |= _line_units(line)
    for fit in plan.fit:
        for term in RegressionModel.parse(fit.model).terms:
            units[f"{fit.name}.{term}"] = "1"
    for mode in plan.mode:
        for figure, unit in _MODES[mode.kind].items():
            units[f"{mode.name}.{figure}"] = unit
    return units


def _kinematic_unit(figure: str, units: str) -> str:
    """Return the unit of a figure of a relation; only the offset has a unit."""
    if figure == "offset":
        return units
    return "1"


def _line_units(line: StraightLine) -> dict[str, str]:
    """Return name and unit of the figures of a line."""
    if line.kind == "polar":
        return {f"{line.name}.CD0": "1", f"{line.name}.oswald": "1"}
    return {
        f"{line.name}.slope": "1",
        f"{line.name}.offset": _mean_unit(line.y),
        f"{line.name}.root": _mean_unit(line.x),
    }


def _mean_unit(name: str) -> str:
    """Return the unit of a mean; means that are not quantities are ratios or angles."""
    if name == "attitude_less_climb":
        return "rad"
    try:
        return lookup(name).units
    except UnknownName:
        return "1"


def bounds_in_si(plan: EvaluationPlan) -> list[tuple[float, float]]:
    """Return the bounds in SI.

    Raises
    ------
    SchemaError
        Unknown figures, with near names, and wrong units, all at once.
    """
    units, problems, bounds = figure_units(plan), [], []
    for number, bound in enumerate(plan.bound, start=1):
        try:
            if bound.of not in units:
                raise UnknownName(bound.of, units, "figure")
            bounds.append(_parse_bound(bound, units[bound.of]))
        except AeromatchError as error:
            problems.append(f"bound {number}: {error}")
    if problems:
        raise SchemaError("bounds", problems)
    return bounds


def _parse_bound(bound: Bound, unit: str) -> tuple[float, float]:
    """Return lowest and highest value of a bound."""
    if bound.value is None:
        low, high = -math.inf, math.inf
        if bound.low is not None:
            low = parse_quantity(bound.low, unit)
        if bound.high is not None:
            high = parse_quantity(bound.high, unit)
        return low, high
    value, within = parse_quantity(bound.value, unit), bound.within or 0.0
    if isinstance(within, str) and within.strip().endswith("%"):
        width = abs(value) * parse_quantity(within, "1")
    else:
        width = parse_quantity(within, unit)
    return value - width, value + width


def collect_figures(
    quality: Quality,
    lines: Sequence[FittedLine],
    fits: Sequence[Fit],
    motions: Mapping[str, Eigenmotion],
    aircraft: Aircraft,
) -> dict[str, FigureOfMerit]:
    """Return the figures of an evaluation by name."""
    figures = _quality_figures(quality)
    for fitted in lines:
        figures |= _line_figures(fitted, aircraft)
    for fit in fits:
        estimates, errors = fit.estimates["estimate"].values, fit.estimates["stderr"].values
        for k, term in enumerate(fit.estimates["term"].values):
            name = f"{fit.name}.{term}"
            figures[name] = FigureOfMerit(float(estimates[k]), float(errors[k]), "1")
    for name, motion in motions.items():
        for figure, values in motion.values.items():
            figures[f"{name}.{figure}"] = FigureOfMerit(*values)
    return figures


def _quality_figures(quality: Quality) -> dict[str, FigureOfMerit]:
    """Return the figures of kinematic relations, delays and control responses."""
    figures: dict[str, FigureOfMerit] = {}
    # Kinematic relations: the slope has a standard error, the other figures have none.
    for row in quality.kinematics.to_dict("records"):
        head = f"kinematics.{row['relation']}"
        figures[f"{head}.slope"] = FigureOfMerit(row["slope"], row["slope_stderr"], "1")
        for figure in _KINEMATIC[1:]:
            unit = _kinematic_unit(figure, row["units"])
            figures[f"{head}.{figure}"] = FigureOfMerit(row[figure], math.nan, unit)
    for row in quality.delays.to_dict("records"):
        figures[f"delay.{row['channel']}"] = FigureOfMerit(row["delay"], row["stderr"], "s")
    for row in quality.answers.to_dict("records"):
        figures[f"answer.{row['surface']}"] = FigureOfMerit(row["effect"], row["stderr"], "s-2")
    return figures


def _line_figures(fitted: FittedLine, aircraft: Aircraft) -> dict[str, FigureOfMerit]:
    line = fitted.line
    units = _line_units(line)
    if line.kind == "polar":
        # CD = CD0 + CL^2 / (pi A e), with the aspect ratio A = b^2 / S
        slope, error = fitted.slope
        oswald = aircraft.S / (math.pi * aircraft.b**2 * slope)
        values = [fitted.offset, (oswald, abs(oswald * error / slope))]
    else:
        values = [fitted.slope, fitted.offset, fitted.root]
    figures = {}
    for (name, unit), value in zip(units.items(), values, strict=True):
        figures[name] = FigureOfMerit(*value, unit)
    return figures


def judge_bounds(
    plan: EvaluationPlan, figures: Mapping[str, FigureOfMerit], barred: Collection[str] = ()
) -> pd.DataFrame:
    """Return every bound with its figure and verdict; columns `COLUMNS`, SI.

    A figure without a number, or of a part in `barred`, is not determined.  Neither is one inside
    its bounds whose standard error exceeds the distance between them.
    """
    units = figure_units(plan)
    rows = []
    for bound, (low, high) in zip(plan.bound, bounds_in_si(plan), strict=True):
        figure = figures.get(bound.of)
        if figure is None:
            figure = FigureOfMerit(math.nan, math.nan, units[bound.of])
        part = bound.of.rpartition(".")[0]
        is_vague = figure.stderr > high - low and low <= figure.value <= high
        if not math.isfinite(figure.value) or part in barred or is_vague:
            verdict = OPEN
        elif low <= figure.value <= high:
            verdict = INSIDE
        else:
            verdict = OUTSIDE
        rows.append((bound.of, *figure, low, high, verdict, bound.source, bound.reason))
    return pd.DataFrame(rows, columns=list(COLUMNS))

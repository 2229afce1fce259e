"""Figures of an evaluation by name, and the bounds they are held against."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
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
from flightmech.names import lookup
from flightmech.support.arrays import rms
from flightmech.units import G0, from_si, parse_quantity
from flighttest.flight_programme.evaluation.plan import (
    Bound,
    EvaluationPlan,
    StationaryTimes,
    StraightLine,
    TestPointSheet,
)
from flighttest.reconstruction.quality.checks.control_response import EQUATIONS
from flighttest.reconstruction.quality.checks.relations import RELATIONS
from flighttest.reconstruction.quality.result import Quality
from flighttest.records.sensors.measurements import pressure
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.submodels.aircraft_properties.eigenmotion import Motion

LEAST = (
    4  # points of a line: two are drawn from any error, three give no information on their scatter
)
_MOVES = 1e-6  # relative spread of x below which the points do not determine a slope


@dataclass(frozen=True)
class FittedLine:
    """A straight line y = offset + slope x through the means of stationary points.

    Attributes
    ----------
    line : Line
    x, y : array (point,)
        [SI]
    slope, offset, root : (float, float)
        Value and standard error; root is the x at which y is zero. [SI]
    rms : float
        Of the residuals. [SI]
    """

    line: StraightLine
    x: np.ndarray
    y: np.ndarray
    slope: tuple[float, float]
    offset: tuple[float, float]
    root: tuple[float, float]
    rms: float


def times_of(points: StationaryTimes) -> pd.DataFrame:
    """Return the noted times and series of a sheet of stationary points: ``time series``, sorted;
    one row per time and series.
    """
    sheet = TestPointSheet(points.file)
    series = (
        [sheet.text(row, points.series) for row in range(len(sheet.rows))]
        if points.series
        else [""] * len(sheet.rows)
    )
    found = pd.DataFrame({"time": points.time.of(sheet, "s"), "series": series})
    return found.dropna().drop_duplicates().sort_values("time", ignore_index=True)


def series_windows(
    points: StationaryTimes, series: Sequence[str] = ()
) -> list[tuple[float, float]]:
    """Return the windows of some series, each time once.

    Raises
    ------
    UnknownName
        A series that no point has.
    """
    table = times_of(points)
    for name in series:
        if name not in set(table["series"]):
            raise UnknownName(name, set(table["series"]), "series", f"sheet {points.file}")
    kept = table[table["series"].isin(series)] if series else table
    return [
        (float(t) + points.window[0], float(t) + points.window[1])
        for t in sorted(set(kept["time"]))
    ]


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
        Channels as recorded, with ``computed`` ones.
    aircraft : Aircraft
    windows : sequence of (start, stop)
        [s]
    data : Dataset (time,), optional
        Coefficients of reconstructed windows; their means take the place of recorded ones.

    Returns
    -------
    DataFrame
        One row per window, ``start stop`` and channels. [SI]  Computed: ``CL_weight``, weight over
        dynamic pressure and wing area, which is the lift of level flight without a part of thrust;
        ``attitude_less_climb``, pitch attitude less the angle of climb.

    Raises
    ------
    OutOfRange
        A window is not inside the record.
    """
    return pd.DataFrame([_row(record, aircraft, window, data) for window in windows])


def _row(
    record: xr.DataTree, aircraft: Aircraft, window: tuple[float, float], data: xr.Dataset | None
) -> dict[str, float]:
    start, stop = window
    row = {"start": start, "stop": stop}
    climb = np.nan
    for node in record.children.values():
        leaf = node.to_dataset()
        time = leaf["time"].values
        inside = (time >= start) & (time <= stop)
        if inside.sum() < 2:
            raise OutOfRange(
                f"stationary point {start:g} ... {stop:g} s is not inside the record, "
                f"{time[0]:g} ... {time[-1]:g} s"
            )
        row |= {
            str(name): float(np.nanmean(x.values[inside])) for name, x in leaf.data_vars.items()
        }
        if "h_baro" in leaf:
            climb = float(np.polyfit(time[inside] - start, leaf["h_baro"].values[inside], 1)[0])
    if {"h_baro", "mach", "mass"} <= set(row):
        row["CL_weight"] = (
            row["mass"]
            * G0
            / (0.7 * float(pressure(np.array(row["h_baro"]))) * row["mach"] ** 2 * aircraft.S)
        )
    if {"theta", "V", "h_baro"} <= set(row):
        row["attitude_less_climb"] = row["theta"] - float(np.arcsin(climb / row["V"]))
    if data is not None:
        part = data.sel(time=slice(start, stop))
        row |= {
            str(name): float(x.mean())
            for name, x in part.data_vars.items()
            if x.dims == ("time",) and x.dtype.kind == "f"
        }
    return row


def line_through(line: StraightLine, points: pd.DataFrame) -> FittedLine:
    """Return a straight line through points by least squares; standard errors from the scatter of
    the points.

    Raises
    ------
    UnknownName
        A column that the points do not have.
    IdentificationError
        Fewer than four points, or points that stand at one x.
    """
    for name in (line.x, line.y):
        if name not in points:
            raise UnknownName(name, map(str, points.columns), "mean", f"line {line.name}")
    x, y = (points[name].to_numpy(float) for name in (line.x, line.y))
    if line.kind == "polar":
        x = x**2
    if len(x) < LEAST:
        raise IdentificationError(
            f"line {line.name}: {len(x)} points; {LEAST} or more are needed to see their scatter"
        )
    if np.ptp(x) <= _MOVES * np.abs(x).max():
        raise IdentificationError(
            f"line {line.name}: no excitation, {line.x} is {x[0]:.4g} at all points; fly "
            f"points at several of it"
        )
    X = np.stack([np.ones_like(x), x], axis=1)
    (b, m), *_ = np.linalg.lstsq(X, y)
    rest = y - b - m * x
    C = np.linalg.inv(X.T @ X) * float(rest @ rest) / (len(x) - 2)
    slope_of_root = np.array([-1.0 / m, b / m**2])
    errors = np.sqrt([C[1, 1], C[0, 0], slope_of_root @ C @ slope_of_root])
    return FittedLine(line, x, y, (m, errors[0]), (b, errors[1]), (-b / m, errors[2]), rms(rest))


DISPLAY = {"rad": "deg", "rad s-1": "rad/s", "m s-1": "m/s", "s-2": "1/s2 per rad"}


def format_si_value(value: float, unit: str, digits: int = 4) -> str:
    """Return an SI value for people, angles in degrees; a dash for what is not there."""
    if not math.isfinite(value):
        return "-"
    return f"{from_si(value, 'deg') if unit == 'rad' else value:.{digits}g}"


def unit_shown(unit: str) -> str:
    """Return the unit that `number` shows."""
    return "" if unit == "1" else DISPLAY.get(unit, unit)


def limits_shown(low: float, high: float, unit: str) -> str:
    """Return the bounds as text."""
    if math.isinf(high):
        return f"at least {format_si_value(low, unit)}"
    return (
        f"at most {format_si_value(high, unit)}"
        if math.isinf(low)
        else f"{format_si_value(low, unit)} ... {format_si_value(high, unit)}"
    )


INSIDE, OUTSIDE, OPEN = "inside", "outside", "not determined"
COLUMNS = ("of", "value", "stderr", "unit", "low", "high", "verdict", "source", "reason")
_MODES = {
    "oscillation": {"period": "s", "damping_ratio": "1", "omega_n": "rad s-1", "t_half": "s"},
    "aperiodic": {"time_constant": "s", "t_half": "s"},
}
_KINEMATIC = ("slope", "offset", "correlation", "disagreement")


class FigureOfMerit(NamedTuple):
    """One number: value, standard error (NaN where there is none), SI unit."""

    value: float
    stderr: float
    unit: str


def figure_units(plan: EvaluationPlan) -> dict[str, str]:
    """Return name and SI unit of every figure that an evaluation can give.

    ``kinematics.theta_rate.slope``, ``delay.theta``, ``answer.delta_e``; of a line ``trim.slope
    trim.offset trim.root``; of a polar ``polar.CD0 polar.oswald``; of a fit ``pitching.alpha`` and
    its other terms; of a mode ``phugoid.period`` ...
    """
    found = {
        f"kinematics.{r.name}.{what}": r.units if what == "offset" else "1"
        for r in RELATIONS
        for what in _KINEMATIC
    }
    found |= {f"delay.{channel}": "s" for r in RELATIONS for channel in r.needs}
    found |= {f"answer.{equation.surface}": "s-2" for equation in EQUATIONS}
    for line in plan.line:
        if line.kind == "polar":
            found |= {f"{line.name}.CD0": "1", f"{line.name}.oswald": "1"}
        else:
            found |= {
                f"{line.name}.slope": "1",
                f"{line.name}.offset": _unit(line.y),
                f"{line.name}.root": _unit(line.x),
            }
    for fit in plan.fit:
        found |= {f"{fit.name}.{term}": "1" for term in RegressionModel.parse(fit.model).terms}
    for mode in plan.mode:
        found |= {f"{mode.name}.{what}": unit for what, unit in _MODES[mode.kind].items()}
    return found


def _unit(name: str) -> str:
    """Return the unit of a mean; those that only an evaluation knows are ratios or angles."""
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
        Figures that do not exist, with near names, and wrong units; all at once.
    """
    units, problems, found = figure_units(plan), [], []
    for number, bound in enumerate(plan.bound, start=1):
        try:
            if bound.of not in units:
                raise UnknownName(bound.of, units, "figure")
            found.append(_limits(bound, units[bound.of]))
        except AeromatchError as error:
            problems.append(f"bound {number}: {error}")
    if problems:
        raise SchemaError("bounds", problems)
    return found


def _limits(bound: Bound, unit: str) -> tuple[float, float]:
    if bound.value is None:
        low, high = (
            None if edge is None else parse_quantity(edge, unit) for edge in (bound.low, bound.high)
        )
        return (-math.inf if low is None else low), (math.inf if high is None else high)
    value, within = parse_quantity(bound.value, unit), bound.within or 0.0
    relative = isinstance(within, str) and within.strip().endswith("%")
    width = abs(value) * parse_quantity(within, "1") if relative else parse_quantity(within, unit)
    return value - width, value + width


def collect_figures(
    quality: Quality,
    lines: Sequence[FittedLine],
    fits: Sequence[Fit],
    motions: Mapping[str, Motion],
    aircraft: Aircraft,
) -> dict[str, FigureOfMerit]:
    """Return the figures of an evaluation by name."""
    nan = math.nan
    found: dict[str, FigureOfMerit] = {}
    for row in quality.kinematics.to_dict("records"):
        head = f"kinematics.{row['relation']}"
        found[f"{head}.slope"] = FigureOfMerit(row["slope"], row["slope_stderr"], "1")
        found |= {
            f"{head}.{what}": FigureOfMerit(
                row[what], nan, row["units"] if what == "offset" else "1"
            )
            for what in _KINEMATIC[1:]
        }
    for row in quality.delays.to_dict("records"):
        found[f"delay.{row['channel']}"] = FigureOfMerit(row["delay"], row["stderr"], "s")
    for row in quality.answers.to_dict("records"):
        found[f"answer.{row['surface']}"] = FigureOfMerit(row["effect"], row["stderr"], "s-2")
    for fitted in lines:
        found |= _of_line(fitted, aircraft)
    for fit in fits:
        e = fit.estimates
        for k, term in enumerate(e["term"].values):
            found[f"{fit.name}.{term}"] = FigureOfMerit(
                float(e["estimate"].values[k]), float(e["stderr"].values[k]), "1"
            )
    for name, motion in motions.items():
        found |= {
            f"{name}.{what}": FigureOfMerit(*values) for what, values in motion.values.items()
        }
    return found


def _of_line(fitted: FittedLine, aircraft: Aircraft) -> dict[str, FigureOfMerit]:
    line = fitted.line
    if line.kind == "polar":
        slope, error = fitted.slope
        e = aircraft.S / (math.pi * aircraft.b**2 * slope)  # CD = CD0 + CL^2 / (pi A e)
        return {
            f"{line.name}.CD0": FigureOfMerit(*fitted.offset, "1"),
            f"{line.name}.oswald": FigureOfMerit(e, abs(e * error / slope), "1"),
        }
    return {
        f"{line.name}.slope": FigureOfMerit(*fitted.slope, "1"),
        f"{line.name}.offset": FigureOfMerit(*fitted.offset, _unit(line.y)),
        f"{line.name}.root": FigureOfMerit(*fitted.root, _unit(line.x)),
    }


def judge_bounds(plan: EvaluationPlan, figures: Mapping[str, FigureOfMerit]) -> pd.DataFrame:
    """Return every bound with its figure and verdict; columns `COLUMNS`, SI."""
    rows = []
    for bound, (low, high) in zip(plan.bound, bounds_in_si(plan)):
        figure = figures.get(bound.of)
        if figure is None:
            rows.append(
                (
                    bound.of,
                    math.nan,
                    math.nan,
                    figure_units(plan)[bound.of],
                    low,
                    high,
                    OPEN,
                    bound.source,
                    bound.reason,
                )
            )
            continue
        verdict = INSIDE if low <= figure.value <= high else OUTSIDE
        rows.append((bound.of, *figure, low, high, verdict, bound.source, bound.reason))
    return pd.DataFrame(rows, columns=list(COLUMNS))

"""Figures 9 to 11 of LR-743 and drag polars: the flight envelope and trimmed polars of an aircraft,
with test points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from aerodb.figures.curve_families import thin_breakpoints
from aerodb.figures.lr743_set.chart import Chart, ChartLine, ChartPanel, FlightPoints, NotDrawn
from aerodb.figures.lr743_set.combinations import (
    combine_coefficients,
    points_of,
    remove_moving_devices,
)
from aerodb.figures.lr743_set.flown import (
    FlightData,
    configuration_text,
    group_heights,
    height_text,
    is_clean,
    is_free,
)
from aerodb.figures.lr743_set.lift_curves import Databases
from aerodb.figures.symbols import (
    axis_label,
    math_symbol,
    number_text,
    to_printed_unit,
    value_with_symbol,
)
from flightmech.air import GAMMA, atmosphere
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchError, SimulationError
from flightmech.flying_qualities.performance import one_g, polar, stall
from flightmech.steady_flight.trim_point import Point, trimmed_at
from flightmech.units import FOOT, G0

_SETTINGS = {"delta_f": np.radians(1.0), "gear": 1.0, "speedbrake": 1.0}
"""What a line has in common, to the nearest step. [SI]"""
_POINTS = 60
_BEYOND = (0.8, 1.15)  # of the Mach numbers flown: how far a line reaches
_LEAST_MACH = 0.02


def one_g_lines(
    db: xr.DataTree, aircraft: Aircraft, points: pd.DataFrame
) -> tuple[dict[str, xr.Dataset], list[str]]:
    """Return the 1 g lines of test points ([LR743] Fig. 9): one for each height and configuration
    that was flown, at the mean mass there.

    Parameters
    ----------
    db : DataTree
    aircraft : Aircraft
    points : DataFrame
        A row per test point: ``h mach mass delta_f gear speedbrake``; a mass of NaN counts as that
        of the aircraft, another setting of NaN as zero. [SI]

    Returns
    -------
    dict of str to Dataset (mach,)
        `flightmech.performance.one_g` by height, mass and configuration in words; attributes ``h``
        [m], ``mass`` [kg], ``configuration``.
    list of str
        For each line that cannot be made, why.
    """
    points = points[np.isfinite(points["mach"]) & np.isfinite(points["h"])]
    points = points.fillna({name: 0.0 for name in _SETTINGS} | {"mass": aircraft.mass})
    if not len(points):
        return {}, []
    machs = np.linspace(
        max(_BEYOND[0] * points["mach"].min(), _LEAST_MACH),
        _BEYOND[1] * points["mach"].max(),
        _POINTS,
    )
    found, remarks = dict[str, xr.Dataset](), []
    for _, alike in points.groupby(
        [(points[name] / step).round() for name, step in _SETTINGS.items()]
    ):
        at = group_heights(alike)
        for h in map(float, np.unique(at)):
            part = alike[at == h]
            means = part.mean(numeric_only=True)
            label = (
                f"{height_text(h)}, {number_text(float(np.round(means['mass'], -1)))} kg, "
                f"{configuration_text(means)}"
            )
            flight = {name: float(means[name]) for name in ("mass", *_SETTINGS)} | {
                "h": h,
                "mach": float(part["mach"].max()),
            }
            try:
                line = one_g(
                    trimmed_at(
                        aircraft, db, flight | ({"mode.engine": 2.0} if aircraft.engines else {})
                    ),
                    machs,
                )
            except SimulationError:
                remarks.append(f"{label}: no steady flight up to Mach {flight['mach']:.2g}")
                continue
            found[label] = line.assign_attrs(
                h=h, mass=float(means["mass"]), configuration=configuration_text(means)
            )
    return found, remarks


Aircrafts = Mapping[str, "Aircraft"]
_HEIGHTS = (0.0, 10e3 * FOOT, 20e3 * FOOT, 30e3 * FOOT)  # of the 1 g lines without flights [m]
# lift coefficient at which a flight is trimmed to begin with, of the largest where that is less
_AT = 0.5
_MOST = 4  # Mach numbers of the polars
_STEEP = 0.3  # of the largest lift slope: below it drag over lift is steep and the band ends
_TOP = 1.15  # of the largest stall or flown lift coefficient: where Fig. 9 ends
# points over which slopes of the piecewise linear tables are averaged: 2.5 deg of angle of attack
_SMOOTH = 13
_BAND = (
    "Bands: one standard error of the drag at that lift: that of the drag and, through the "
    "slope of the polar, that of the lift."
)
_MOVED = 0.05  # lift coefficient: excursions of less are no sweeps
_STEP = 0.02  # Mach numbers of sweeps that count as one
_FORWARD = 0.02  # Mach number: a sweep that changes it by more is no sweep at one Mach number


class _Polar(NamedTuple):
    """A trimmed polar at one Mach number: (points,) each."""

    mach: float
    CL: np.ndarray
    CD: np.ndarray
    stderr: np.ndarray
    alpha: np.ndarray


def flight_envelope_chart(
    databases: Databases, aircraft: Aircrafts, flown: FlightData | None, buffet: pd.DataFrame | None
) -> Chart:
    """Fig. 9: test points of the clean aeroplane over Mach number, 1 g lines, stall, buffet,
    excursions of lift.
    """
    name, db = list(databases.items())[-1]
    craft = _aircraft_of(aircraft, name)
    point, machs = _flight(craft, db, {}), points_of(db, "CL", "mach")
    machs = np.linspace(max(machs[0], 0.05), machs[-1], 24)
    stalls = [float(polar(point, float(mach))["CL"].max()) for mach in machs]
    lines = [
        ChartLine(
            f"stall, trimmed, power off ({name})", machs, np.array(stalls), np.zeros(len(machs)), -1
        )
    ]
    points = list[FlightPoints]()
    levels = [(h, craft.mass) for h in _HEIGHTS]
    if flown is not None:
        clean = flown.manoeuvres[is_clean(flown.manoeuvres)]
        at = group_heights(clean)
        levels = [(h, float(clean["mass"][at == h].mean())) for h in np.unique(at)]
        points += [
            FlightPoints(
                f"test point, {height_text(h)}",
                clean["mach"][at == h].to_numpy(),
                clean["CL"][at == h].to_numpy(),
                *_zero(at == h),
                i,
            )
            for i, h in enumerate(np.unique(at))
        ]
        points += [
            _trace(part, "mach", "CL")
            for _, part in _by_manoeuvre(flown, clean[clean["label"].str.contains("elevator")])
        ]
    top = _TOP * max([*stalls, *(p.y.max() for p in points if len(p.y))])
    for i, (h, mass) in enumerate(levels):
        per_square = 2.0 * mass * G0 / (GAMMA * float(atmosphere(h).p_static) * craft.S)
        mach = np.linspace(min(np.sqrt(per_square / top), machs[-1]), machs[-1], 60)
        label = f"1 g, {height_text(h)}, {number_text(float(np.round(mass, -1)))} kg"
        lines.append(ChartLine(label, mach, per_square / mach**2, np.zeros(len(mach)), i))
    notes = [
        f"Stall: largest lift coefficient of the trimmed polar of {name}; in 1 g flight at "
        f"sea level {stall(point).why}.",
        "1 g: CL = 2 W/(gamma p S M^2) at the mean mass of the test points of that height.",
    ]
    if buffet is not None:
        lines.append(
            ChartLine(
                "buffet",
                buffet["mach"].to_numpy(float),
                buffet["CL"].to_numpy(float),
                np.zeros(len(buffet)),
                99,
            )
        )
    else:
        notes.append(
            "No buffet boundary: databases hold none; give one with --buffet (columns mach, CL)."
        )
    return Chart(
        "figure-09",
        "Fig. 9",
        "flight envelope and test points, clean",
        f"$C_L$ over ${math_symbol('mach')}$; grey: lift in the manoeuvres of the elevator"
        if flown is not None
        else f"$C_L$ over ${math_symbol('mach')}$",
        axis_label("mach"),
        "$C_L$ [1]",
        [ChartPanel("", lines, points=points)],
        notes,
        x_zero=True,
        y_zero=True,
    )


def elevator_sweep_chart(databases: Databases, flown: FlightData | None) -> Chart:
    """Fig. 10: lift over angle of attack in the sweeps of the elevator, by configuration and Mach
    number, and the database there.
    """
    if flown is None:
        raise NotDrawn(
            "no sweeps of flown manoeuvres; they are in flown.nc of the folder that "
            "`aeromatch match` wrote"
        )
    name, db = list(databases.items())[-1]
    rows = flown.manoeuvres[is_free(flown.manoeuvres)]
    rows = rows.assign(height=group_heights(rows))
    found: dict[str, list[tuple[float, ChartLine, FlightPoints]]] = {}
    for i, part in _by_manoeuvre(flown, rows[rows["label"].str.contains("elevator")]):
        if np.ptp(part["CL"]) >= _MOVED and np.ptp(part["mach"]) <= _FORWARD:
            row = rows.loc[[i]].iloc[0]
            found.setdefault(f"{configuration_text(row)}, {height_text(row['height'])}", []).append(
                _swept(db, row, part)
            )
    if not found:
        raise NotDrawn(
            f"no manoeuvre of the elevator in free air changed the lift coefficient by "
            f"{_MOVED} at one Mach number"
        )
    panels = [_of_sweeps(title, found[title]) for title in found]
    return Chart(
        "figure-10",
        "Fig. 10",
        "sweeps of angle of attack by configuration and Mach number",
        f"$C_L$ over ${math_symbol('alpha')}$, curves by ${math_symbol('mach')}$: {name} at the mean "
        f"condition of the sweep",
        axis_label("alpha"),
        "$C_L$ [1]",
        panels,
        (
            "Thin lines: samples of flight; loops come from pitch rate and elevator, which "
            "the curves hold.",
        ),
    )


def _of_sweeps(title: str, swept: Sequence[tuple[float, ChartLine, FlightPoints]]) -> ChartPanel:
    """Return the sweeps of one configuration and height: a curve per Mach number, over the widest
    sweep there.
    """
    members = {mach: i for i, mach in enumerate(sorted({mach for mach, _, _ in swept}))}
    lines = {}
    for mach, line, _ in sorted(swept, key=lambda one: np.ptp(one[1].x)):
        lines[mach] = replace(line, member=members[mach])
    points = []
    for mach, _, trace in swept:
        start = FlightPoints(
            "test point", trace.x[:1], trace.y[:1], np.zeros(1), "test point", members[mach]
        )
        points += [replace(trace, member=members[mach]), start]
    return ChartPanel(
        title, [lines[mach] for mach in members], points=points, by=f"${math_symbol('mach')}$"
    )


def polars_clean(databases: Databases, aircraft: Aircrafts, flown: FlightData | None) -> Chart:
    """Fig. 11: lift over drag coefficient of the clean aeroplane, by Mach number."""
    panels = []
    for name, db in databases.items():
        point = _flight(_aircraft_of(aircraft, name), db, {})
        lines = []
        for i, one in enumerate(_polars(point, db)):
            lines.append(
                ChartLine(
                    value_with_symbol("mach", one.mach),
                    one.CD,
                    one.CL,
                    one.stderr,
                    i,
                    is_across=True,
                )
            )
        panels.append(ChartPanel(name, lines, by=f"${math_symbol('mach')}$"))
    points = []
    if flown is not None:
        clean = flown.manoeuvres[is_clean(flown.manoeuvres)]
        at = group_heights(clean)
        for i, h in enumerate(np.unique(at)):
            on = at == h
            points.append(
                FlightPoints(
                    f"test point, {height_text(h)}",
                    clean["CD"][on].to_numpy(),
                    clean["CL"][on].to_numpy(),
                    *_zero(on),
                    i,
                )
            )
        panels[-1] = ChartPanel(panels[-1].title, panels[-1].lines, points=points, by=panels[-1].by)
    return Chart(
        "figure-11",
        "Fig. 11",
        "lift over drag, clean",
        f"$C_L$ over $C_D$, curves by ${math_symbol('mach')}$; trimmed, power off",
        "$C_D$ [1]",
        "$C_L$ [1]",
        panels,
        (_BAND,),
        x_zero=True,
    )


def drag_polars(databases: Databases, aircraft: Aircrafts, flown: FlightData | None) -> Chart:
    """Drag over lift coefficient by Mach number, a panel per flap setting."""
    name, db = list(databases.items())[-1]
    craft = _aircraft_of(aircraft, name)
    try:
        flaps = points_of(db, "CL", "delta_f")
    except NotDrawn:
        flaps = np.zeros(1)
    panels = []
    for flap in flaps:
        point = _flight(craft, db, {"delta_f": float(flap)} if flap else {})
        lines = [
            ChartLine(value_with_symbol("mach", p.mach), p.CL, p.CD, p.stderr, i)
            for i, p in enumerate(_polars(point, db, float(flap)))
        ]
        panels.append(
            ChartPanel(
                value_with_symbol("delta_f", float(flap)),
                lines,
                points=_test_points(flown, float(flap)),
                by=f"${math_symbol('mach')}$",
            )
        )
    return Chart(
        "drag-polars",
        "",
        "drag polars by Mach number and flap setting",
        f"$C_D$ over $C_L$, curves by ${math_symbol('mach')}$; {name}, trimmed, power off, gear up",
        "$C_L$ [1]",
        "$C_D$ [1]",
        panels,
        (_BAND,),
        y_zero=True,
    )


def _test_points(flown: FlightData | None, flap: float) -> list[FlightPoints]:
    """Return the steady starts of manoeuvres with a flap setting, gear up and gear down apart."""
    if flown is None:
        return []
    rows = flown.manoeuvres[is_free(flown.manoeuvres) & (flown.manoeuvres["speedbrake"] < 0.5)]
    rows = rows[(rows["delta_f"] - flap).abs() < np.radians(2.0)]
    found = []
    for i, (words, part) in enumerate(
        (("gear up", rows[rows["gear"] < 0.5]), ("gear down", rows[rows["gear"] >= 0.5]))
    ):
        if len(part):
            on = np.ones(len(part), bool)
            found.append(
                FlightPoints(
                    f"test point, {words}",
                    part["CL"].to_numpy(),
                    part["CD"].to_numpy(),
                    *_zero(on),
                    i,
                )
            )
    return found


def _aircraft_of(aircraft: Aircrafts, name: str) -> Aircraft:
    if name not in aircraft:
        raise NotDrawn(
            f"it needs the aircraft of {name}: give --aircraft, or the folder that "
            f"`aeromatch match` wrote"
        )
    return aircraft[name]


def _flight(aircraft: Aircraft, db: xr.DataTree, condition: Mapping[str, float]) -> Point:
    """Return a trimmed flight of a configuration, from which the polars leave. The speed matters
    not: polars are trimmed by themselves.
    """
    speed = float(
        np.sqrt(2.0 * aircraft.mass * G0 / (float(atmosphere(0.0).rho) * aircraft.S * _AT))
    )
    try:
        return trimmed_at(
            aircraft,
            db,
            {"V": speed, **({"mode.engine": 2.0} if aircraft.engines else {}), **condition},
        )
    except AeromatchError as error:
        raise NotDrawn(f"no steady flight to begin with: {error}") from error


def _polars(point: Point, db: xr.DataTree, flap: float = 0.0) -> list[_Polar]:
    """Return trimmed polars at Mach numbers of the tables, those that a flap setting is flown at."""
    machs = points_of(db, "CL", "mach")
    machs = machs[machs > 0.0]
    kept = thin_breakpoints(machs, _MOST)
    return [
        _polar(point, db, mach) for mach in (kept[: (len(kept) + 1) // 2 + 1] if flap else kept)
    ]


def _polar(point: Point, db: xr.DataTree, mach: float) -> _Polar:
    curve = polar(point, mach)
    last = int(np.argmax(curve["CL"].values)) + 1
    CL, CD, alpha, delta_e = (
        curve[name].values[:last] for name in ("CL", "CD", "alpha", "delta_e")
    )
    own = point.variables | {"mach": mach, "qhat": 0.0, "dnz": 0.0}
    place = {
        name: own[name]
        for name in {*remove_moving_devices(db, "CL"), *remove_moving_devices(db, "CD")}
        if name in own
    } | {"alpha": alpha, "delta_e": delta_e}
    lift, drag = (combine_coefficients(db, name, (1.0, place))[1] for name in ("CL", "CD"))
    slope, rise = (
        scipy.ndimage.uniform_filter1d(np.gradient(values, alpha), _SMOOTH, mode="nearest")
        for values in (CL, CD)
    )
    drag_slope = rise / np.where(slope > _STEEP * slope.max(), slope, np.nan)
    return _Polar(mach, CL, CD, np.hypot(drag, drag_slope * lift), alpha)


def _swept(
    db: xr.DataTree, row: pd.Series, part: pd.DataFrame
) -> tuple[float, ChartLine, FlightPoints]:
    """Return the Mach number of one sweep to the nearest 0.02, the database over its angles of
    attack, and its samples.
    """
    mach = float(np.round(np.round(row["mach"] / _STEP) * _STEP, 2))
    means = part.mean(numeric_only=True)
    place = {
        name: float(means[name])
        for name in remove_moving_devices(db, "CL")
        if name in means and np.isfinite(means[name])
    }
    alpha = np.linspace(part["alpha"].min(), part["alpha"].max(), 25)
    y, stderr = combine_coefficients(
        db, "CL", (1.0, {**place, "qhat": 0.0, "alphadothat": 0.0, "dnz": 0.0, "alpha": alpha})
    )
    return (
        mach,
        ChartLine(value_with_symbol("mach", mach), to_printed_unit("alpha", alpha), y, stderr),
        _trace(part, "alpha", "CL"),
    )


def _trace(part: pd.DataFrame, x: str, y: str) -> FlightPoints:
    return FlightPoints(
        "samples of flight",
        to_printed_unit(x, part[x]),
        part[y].to_numpy(float),
        np.zeros(len(part)),
        "trace",
    )


def _by_manoeuvre(flown: FlightData, rows: pd.DataFrame) -> list[tuple[int, pd.DataFrame]]:
    samples = flown.samples[flown.samples["manoeuvre"].isin(rows.index)]
    return [
        (int(part["manoeuvre"].iloc[0]), part)
        for _, part in samples.groupby("manoeuvre", sort=True)
    ]


def _zero(on: Sequence[bool] | np.ndarray) -> tuple[np.ndarray, str]:
    return np.zeros(int(np.sum(on))), "test point"

"""Figures 9 to 11 of LR-743 and drag polars: flight envelope and trimmed polars."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.figures.lr743_set.chart import (
    BOUNDARY,
    Chart,
    ChartLine,
    ChartPanel,
    FlightPoints,
    NotDrawn,
)
from aerodb.figures.lr743_set.combinations import (
    combine_coefficients,
    points_of,
    remove_moving_devices,
)
from aerodb.figures.lr743_set.flown import (
    FlightData,
    group_heights,
    height_text,
    is_clean,
    is_free,
)
from aerodb.figures.lr743_set.lift_curves import Databases
from aerodb.figures.lr743_set.polars import (
    POWER_OFF,
    Aircrafts,
    aircraft_of,
    sample_trace,
    samples_by_manoeuvre,
    steady_points,
    trim_configuration,
    trimmed_polars,
)
from aerodb.figures.symbols import (
    axis_label,
    math_symbol,
    number_text,
    to_printed_unit,
    value_with_symbol,
)
from aerodb.store.schema import terms
from flightmech.air import GAMMA, atmosphere
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.controls import ICE
from flightmech.envelope.maps import AT_REST, configuration_text
from flightmech.errors import SimulationError
from flightmech.flying_qualities.performance import one_g, polar, stall
from flightmech.steady_flight.trim_point import trimmed_at
from flightmech.terms import list_model_variables
from flightmech.units import FOOT, G0

# Steps of the settings of a 1 g line. Test points of one line agree to the nearest step. [SI]
_SETTINGS = {"delta_f": np.radians(1.0), "gear": 1.0, "speedbrake": 1.0}
_ICE_STEP = 0.1  # of the setting of ice, in addition where a term depends on it
_POINTS = 60  # of a 1 g line
_BEYOND = (0.8, 1.15)  # range of a 1 g line over the Mach numbers of the test points
_LEAST_MACH = 0.02
_HEIGHTS = (0.0, 10e3 * FOOT, 20e3 * FOOT, 30e3 * FOOT)  # of the 1 g lines without flights [m]
_TOP = 1.15  # upper end of Fig. 9 over the largest lift coefficient of stall and flight
_BAND = (
    "Bands: one standard error of the drag at that lift: that of the drag and, through the "
    "slope of the polar, that of the lift."
)
_LEAST_EXCURSION = 0.05  # lift coefficient; a smaller excursion is not a sweep
_MACH_STEP = 0.02  # Mach numbers of sweeps within this step are equal
_MOST_MACH_CHANGE = 0.02  # in a sweep at one Mach number
_NO_RATES = {"qhat": 0.0, "alphadothat": 0.0, "dnz": 0.0}  # the curve is that of steady flight


def one_g_lines(
    db: xr.DataTree, aircraft: Aircraft, points: pd.DataFrame
) -> tuple[dict[str, xr.Dataset], list[str]]:
    """Return the 1 g lines of test points ([LR743] Fig. 9), by height and configuration.

    Each line has the mean mass of its test points.

    Parameters
    ----------
    db : DataTree
        The database.
    aircraft : Aircraft
        The aircraft.
    points : DataFrame
        A row per test point: ``h mach mass delta_f gear speedbrake``, and ``device.ice.setting`` of
        records with ice.  A mass of NaN is replaced by that of the aircraft, another setting of NaN
        by zero. [SI]

    Returns
    -------
    dict of str to Dataset (mach,)
        `flightmech.performance.one_g` by height, mass and configuration in words; attributes ``h``
        [m], ``mass`` [kg], ``configuration``.
    list of str
        The reason for each line that cannot be computed.
    """
    points = points[np.isfinite(points["mach"]) & np.isfinite(points["h"])]
    steps = dict(_SETTINGS)
    if ICE in points and any(ICE in list_model_variables(leaf) for leaf in terms(db).values()):
        steps[ICE] = _ICE_STEP
    points = points.fillna({name: 0.0 for name in steps} | {"mass": aircraft.mass})
    if not len(points):
        return {}, []
    # All lines have the same Mach numbers.
    low = max(_BEYOND[0] * points["mach"].min(), _LEAST_MACH)
    machs = np.linspace(low, _BEYOND[1] * points["mach"].max(), _POINTS)
    lines: dict[str, xr.Dataset] = {}
    remarks: list[str] = []
    # Test points whose settings agree to the nearest step belong together.
    settings = [(points[name] / step).round() for name, step in steps.items()]
    for _, group in points.groupby(settings):
        heights = group_heights(group)
        for h in map(float, np.unique(heights)):
            rows = group[heights == h]
            means = rows.mean(numeric_only=True)
            configuration = configuration_text(means.to_dict())
            mass_text = number_text(float(np.round(means["mass"], -1)))
            label = f"{height_text(h)}, {mass_text} kg, {configuration}"
            # The flight is trimmed at the largest Mach number of the test points.
            flight = {name: float(means[name]) for name in ("mass", *steps)}
            flight |= {"h": h, "mach": float(rows["mach"].max())}
            if aircraft.engines:
                flight |= POWER_OFF
            try:
                line = one_g(trimmed_at(aircraft, db, flight), machs)
            except SimulationError:
                remarks.append(f"{label}: no steady flight up to Mach {flight['mach']:.2g}")
                continue
            lines[label] = line.assign_attrs(
                h=h, mass=float(means["mass"]), configuration=configuration
            )
    return lines, remarks


def flight_envelope_chart(
    databases: Databases, aircraft: Aircrafts, flown: FlightData | None, buffet: pd.DataFrame | None
) -> Chart:
    """Return Fig. 9: clean test points over Mach number, 1 g lines, stall and buffet."""
    name, db = list(databases.items())[-1]
    craft = aircraft_of(aircraft, name)
    point, machs = trim_configuration(craft, db, {}), points_of(db, "CL", "mach")
    machs = np.linspace(max(machs[0], 0.05), machs[-1], 24)
    # The stall is the largest lift of the trimmed polar.
    stall_lift = np.array([float(polar(point, float(mach))["CL"].max()) for mach in machs])
    lines = [_exact_line(f"stall, trimmed, power off ({name})", machs, stall_lift, member=-1)]
    points: list[FlightPoints] = []
    levels = [(h, craft.mass) for h in _HEIGHTS]
    description = f"$C_L$ over ${math_symbol('mach')}$"
    if flown is not None:
        clean = flown.manoeuvres[is_clean(flown.manoeuvres)]
        levels, points = _clean_test_points(clean)
        sweeps = clean[clean["label"].str.contains("elevator")]
        for _, samples in samples_by_manoeuvre(flown, sweeps):
            points.append(sample_trace(samples, "mach", "CL"))
        description += "; grey: lift in the manoeuvres of the elevator"
    # The figure ends above all test points and the stall, 1 g lines are cut there.
    largest = [float(item.y.max()) for item in points if len(item.y)]
    top = _TOP * max([*stall_lift.tolist(), *largest])
    for i, (h, mass) in enumerate(levels):
        lines.append(_one_g_line(craft, h, mass, top=top, last_mach=machs[-1], member=i))
    notes = [
        f"Stall: largest lift coefficient of the trimmed polar of {name}; in 1 g flight at "
        f"sea level {stall(point).why}.",
        "1 g: CL = 2 W/(gamma p S M^2) at the mean mass of the test points of that height.",
    ]
    if buffet is not None:
        mach, lift = buffet["mach"].to_numpy(float), buffet["CL"].to_numpy(float)
        lines.append(_exact_line("buffet", mach, lift, member=BOUNDARY))
    else:
        notes.append(
            "No buffet boundary: databases hold none; give one with --buffet (columns mach, CL)."
        )
    return Chart(
        stem="figure-09",
        number="Fig. 9",
        title="flight envelope and test points, clean",
        line=description,
        x_label=axis_label("mach"),
        y_label="$C_L$ [1]",
        panels=[ChartPanel("", lines, points=points)],
        notes=notes,
        x_zero=True,
        y_zero=True,
    )


def _clean_test_points(
    clean: pd.DataFrame,
) -> tuple[list[tuple[float, float]], list[FlightPoints]]:
    """Return height and mean mass of each group of clean test points, and the points."""
    levels, points = [], []
    heights = group_heights(clean)
    for i, h in enumerate(np.unique(heights)):
        rows = clean[heights == h]
        levels.append((h, float(rows["mass"].mean())))
        points.append(steady_points(height_text(h), rows, "mach", "CL", member=i))
    return levels, points


def _one_g_line(
    aircraft: Aircraft, h: float, mass: float, *, top: float, last_mach: float, member: int
) -> ChartLine:
    """Return the lift coefficient of level flight at a height over Mach number."""
    # CL = 2 W / (gamma p S M^2); the line begins at the upper end of the figure.
    lift_mach_squared = 2.0 * mass * G0 / (GAMMA * float(atmosphere(h).p_static) * aircraft.S)
    first_mach = min(np.sqrt(lift_mach_squared / top), last_mach)
    mach = np.linspace(first_mach, last_mach, _POINTS)
    label = f"1 g, {height_text(h)}, {number_text(float(np.round(mass, -1)))} kg"
    return _exact_line(label, mach, lift_mach_squared / mach**2, member=member)


def _exact_line(label: str, x: np.ndarray, y: np.ndarray, member: int) -> ChartLine:
    return ChartLine(label, x, y, stderr=np.zeros(len(x)), member=member)


def elevator_sweep_chart(databases: Databases, flown: FlightData | None) -> Chart:
    """Return Fig. 10: lift over angle of attack in elevator sweeps, and the database there.

    The panels are configurations, the curves Mach numbers.
    """
    if flown is None:
        raise NotDrawn(
            "no sweeps of flown manoeuvres; they are in flown.nc of the folder that "
            "`aeromatch match` wrote"
        )
    name, db = list(databases.items())[-1]
    # Heights are grouped over all manoeuvres in free air, not only over the sweeps.
    rows = flown.manoeuvres[is_free(flown.manoeuvres)]
    rows = rows.assign(height=group_heights(rows))
    sweeps: dict[str, list[tuple[float, ChartLine, FlightPoints]]] = {}
    elevator_rows = rows[rows["label"].str.contains("elevator")]
    for number, samples in samples_by_manoeuvre(flown, elevator_rows):
        if np.ptp(samples["CL"]) < _LEAST_EXCURSION or np.ptp(samples["mach"]) > _MOST_MACH_CHANGE:
            continue
        row = rows.loc[[number]].iloc[0]
        title = f"{configuration_text(row.to_dict())}, {height_text(row['height'])}"
        sweeps.setdefault(title, []).append(_sweep_curves(db, row, samples))
    if not sweeps:
        raise NotDrawn(
            f"no manoeuvre of the elevator in free air changed the lift coefficient by "
            f"{_LEAST_EXCURSION} at one Mach number"
        )
    return Chart(
        stem="figure-10",
        number="Fig. 10",
        title="sweeps of angle of attack by configuration and Mach number",
        line=f"$C_L$ over ${math_symbol('alpha')}$, curves by ${math_symbol('mach')}$: {name} at "
        f"the mean condition of the sweep",
        x_label=axis_label("alpha"),
        y_label="$C_L$ [1]",
        panels=[_sweep_panel(title, curves) for title, curves in sweeps.items()],
        notes=(
            "Thin lines: samples of flight; loops come from pitch rate and elevator, which "
            "the curves hold.",
        ),
    )


def _sweep_panel(title: str, sweeps: Sequence[tuple[float, ChartLine, FlightPoints]]) -> ChartPanel:
    """Return the sweeps of one configuration and height: a curve per Mach number."""
    machs = sorted({mach for mach, _, _ in sweeps})
    members = {mach: i for i, mach in enumerate(machs)}
    # The widest sweep of a Mach number comes last, and its curve remains.
    lines = {}
    for mach, line, _ in sorted(sweeps, key=lambda sweep: np.ptp(sweep[1].x)):
        lines[mach] = replace(line, member=members[mach])
    points = []
    for mach, _, trace in sweeps:
        start = FlightPoints(
            "test point",
            trace.x[:1],
            trace.y[:1],
            stderr=np.zeros(1),
            kind="test point",
            member=members[mach],
        )
        points += [replace(trace, member=members[mach]), start]
    curves = [lines[mach] for mach in members]
    return ChartPanel(title, curves, points=points, by=f"${math_symbol('mach')}$")


def _sweep_curves(
    db: xr.DataTree, row: pd.Series, samples: pd.DataFrame
) -> tuple[float, ChartLine, FlightPoints]:
    """Return the Mach number of a sweep to the nearest step, the database and the samples."""
    mach = float(np.round(np.round(row["mach"] / _MACH_STEP) * _MACH_STEP, 2))
    # The database at the mean condition of the sweep, over its angles of attack.
    means = samples.mean(numeric_only=True)
    condition = {}
    for name in remove_moving_devices(db, "CL"):
        if name in means and np.isfinite(means[name]):
            condition[name] = float(means[name])
    alpha = np.linspace(samples["alpha"].min(), samples["alpha"].max(), 25)
    y, stderr = combine_coefficients(db, "CL", (1.0, {**condition, **_NO_RATES, "alpha": alpha}))
    x = to_printed_unit("alpha", alpha)
    line = ChartLine(value_with_symbol("mach", mach), x, y, stderr=stderr)
    return mach, line, sample_trace(samples, "alpha", "CL")


def polars_clean(databases: Databases, aircraft: Aircrafts, flown: FlightData | None) -> Chart:
    """Return Fig. 11: lift over drag coefficient of the clean aeroplane, by Mach number."""
    panels = []
    for name, db in databases.items():
        point = trim_configuration(aircraft_of(aircraft, name), db, {})
        # Lift is the ordinate, so the band of drag is horizontal.
        lines = []
        for i, curve in enumerate(trimmed_polars(point, db)):
            lines.append(
                ChartLine(
                    value_with_symbol("mach", curve.mach),
                    curve.CD,
                    curve.CL,
                    stderr=curve.stderr,
                    member=i,
                    is_across=True,
                )
            )
        panels.append(ChartPanel(name, lines, by=f"${math_symbol('mach')}$"))
    if flown is not None:
        # The test points are compared with the final database.
        points = []
        clean = flown.manoeuvres[is_clean(flown.manoeuvres)]
        heights = group_heights(clean)
        for i, h in enumerate(np.unique(heights)):
            rows = clean[heights == h]
            points.append(steady_points(height_text(h), rows, "CD", "CL", member=i))
        panels[-1] = replace(panels[-1], points=points)
    return Chart(
        stem="figure-11",
        number="Fig. 11",
        title="lift over drag, clean",
        line=f"$C_L$ over $C_D$, curves by ${math_symbol('mach')}$; trimmed, power off",
        x_label="$C_D$ [1]",
        y_label="$C_L$ [1]",
        panels=panels,
        notes=(_BAND,),
        x_zero=True,
    )


def drag_polars(databases: Databases, aircraft: Aircrafts, flown: FlightData | None) -> Chart:
    """Return the chart of drag over lift coefficient by Mach number, a panel per flap setting."""
    name, db = list(databases.items())[-1]
    craft = aircraft_of(aircraft, name)
    # Without flaps in the tables there is one panel.
    try:
        flaps = points_of(db, "CL", "delta_f")
    except NotDrawn:
        flaps = np.zeros(1)
    panels = []
    for flap in map(float, flaps):
        point = trim_configuration(craft, db, {"delta_f": flap} if flap else {})
        lines = []
        for i, curve in enumerate(trimmed_polars(point, db, flap)):
            label = value_with_symbol("mach", curve.mach)
            lines.append(ChartLine(label, curve.CL, curve.CD, stderr=curve.stderr, member=i))
        panels.append(
            ChartPanel(
                value_with_symbol("delta_f", flap),
                lines,
                points=_flap_test_points(flown, flap),
                by=f"${math_symbol('mach')}$",
            )
        )
    return Chart(
        stem="drag-polars",
        number="",
        title="drag polars by Mach number and flap setting",
        line=f"$C_D$ over $C_L$, curves by ${math_symbol('mach')}$; {name}, trimmed, power off, "
        f"gear up",
        x_label="$C_L$ [1]",
        y_label="$C_D$ [1]",
        panels=panels,
        notes=(_BAND,),
        y_zero=True,
    )


def _flap_test_points(flown: FlightData | None, flap: float) -> list[FlightPoints]:
    """Return the test points of a flap setting, with the gear up and with the gear down."""
    if flown is None:
        return []
    rows = flown.manoeuvres[is_free(flown.manoeuvres) & (flown.manoeuvres["speedbrake"] < 0.5)]
    if ICE in rows:
        rows = rows[rows[ICE] < AT_REST]
    rows = rows[(rows["delta_f"] - flap).abs() < np.radians(2.0)]
    groups = (
        ("gear up", rows[rows["gear"] < 0.5]),
        ("gear down", rows[rows["gear"] >= 0.5]),
    )
    points = []
    for i, (label, group) in enumerate(groups):
        if len(group):
            points.append(steady_points(label, group, "CL", "CD", member=i))
    return points

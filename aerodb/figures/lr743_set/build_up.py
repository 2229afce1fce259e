"""Figures 1 to 4 and 12 to 15 of LR-743: lift from the terms of a database, with estimates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import xarray as xr

from aerodb.figures.curve_families import thin_breakpoints
from aerodb.figures.curve_sources import refine_breakpoints
from aerodb.figures.lr743_set.chart import Chart, ChartLine, ChartPanel, FlightPoints
from aerodb.figures.lr743_set.combinations import (
    combine_coefficients,
    points_of,
    remove_moving_devices,
    span_of,
)
from aerodb.figures.lr743_set.flown import (
    FlightData,
    is_clean,
    is_free,
    required_slopes,
)
from aerodb.figures.lr743_set.lift_curves import (
    MOST_CURVES,
    Databases,
    chart_over_alpha,
    covered_alphas,
    fixed_text,
    flap_settings,
    half_chord,
    line_over_alpha,
    middle_mach,
)
from aerodb.figures.symbols import axis_label, math_symbol, number_text, to_printed_unit
from flightmech.units import DEGREE

# The lift slope is the chord from zero to this angle of attack, where lift is linear. [rad]
_SLOPE = 8.0 * DEGREE
# A control derivative is the chord between this deflection and its negative. [rad]
_CONTROL = 5.0 * DEGREE
# A rate derivative is the chord between this reduced rate and its negative. [1]
_RATE = 1e-3
# Estimates within this angle belong to a flap setting. [rad]
_NEAR = 2.0 * DEGREE
_ALL_FLAPS = -1  # member of a line that is the same for all flap settings; black


def lift_intercept_chart(databases: Databases, flown: FlightData | None) -> Chart:
    """Return Fig. 1: lift coefficient at zero angle of attack over Mach number, clean."""

    def curve(db: xr.DataTree, mach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return combine_coefficients(db, "CL", (1.0, {"alpha": 0.0, "mach": mach}))

    return _chart_over_mach(
        databases,
        curve,
        stem="figure-01",
        number="Fig. 1",
        title="lift coefficient at zero angle of attack, clean",
        y_label="$C_{L_0}$ [1]",
        points=_clean_estimates(flown, "1", "mach"),
    )


def lift_slope_chart(databases: Databases, flown: FlightData | None) -> Chart:
    """Return Fig. 2: lift slope over Mach number, clean."""

    def curve(db: xr.DataTree, mach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # Slope = (CL(end) - CL(0)) / end
        end = min(_SLOPE, span_of(db, "CL", "alpha")[1])
        return combine_coefficients(
            db,
            "CL",
            (1.0 / end, {"alpha": end, "mach": mach}),
            (-1.0 / end, {"alpha": 0.0, "mach": mach}),
        )

    note = (
        f"Slope: chord from 0 to {_SLOPE / DEGREE:g} deg of angle of attack; estimates at "
        f"that of their manoeuvres."
    )
    return _chart_over_mach(
        databases,
        curve,
        stem="figure-02",
        number="Fig. 2",
        title="lift slope, clean",
        y_label=r"$C_{L_\alpha}$ [1/rad]",
        points=_clean_estimates(flown, "alpha", "mach"),
        notes=(note,),
    )


def flap_increment(databases: Databases, flown: FlightData | None, stem: str, figure: str) -> Chart:
    """Return Fig. 3 or 13: increment of the lift coefficient by the flaps over angle of attack."""

    def curves(db: xr.DataTree) -> tuple[list[ChartLine], str]:
        # Increment = CL(flap) - CL(clean) at the same condition.
        mach, alpha = middle_mach(db, "delta_f"), covered_alphas(db)
        condition = {"alpha": alpha, **mach}
        lines = []
        # The first setting is the retracted flap, whose increment is zero.
        for i, flap in enumerate(flap_settings(db)[1:]):
            values = combine_coefficients(
                db, "CL", (1.0, {**condition, "delta_f": flap}), (-1.0, condition)
            )
            lines.append(line_over_alpha("delta_f", flap, alpha, values=values, index=i))
        return lines, fixed_text(mach)

    return chart_over_alpha(
        databases,
        curves,
        stem=stem,
        number=figure,
        title="increment of the lift coefficient by the flaps",
        y_label=r"$\Delta C_L$ [1]",
        by="delta_f",
    )


def elevator_chart(databases: Databases, flown: FlightData | None, stem: str, figure: str) -> Chart:
    """Return Fig. 4 or 14: lift by the elevator over angle of attack, by flap setting."""

    def curves(db: xr.DataTree) -> tuple[list[ChartLine], str]:
        mach = middle_mach(db, "delta_e")
        span = half_chord(db, "delta_e", _CONTROL)
        return _derivative_by_flap(db, "delta_e", span, fixed=mach), fixed_text(mach)

    points = _slopes_by_flap(flown, ("delta_e",), databases)
    note = (
        f"Derivative: chord from {-_CONTROL / DEGREE:g} to {_CONTROL / DEGREE:g} deg of elevator."
    )
    return chart_over_alpha(
        databases,
        curves,
        stem=stem,
        number=figure,
        title="lift coefficient by the elevator",
        y_label=r"$C_{L_{\delta_e}}$ [1/rad]",
        by="delta_f",
        points=points,
        notes=(note, *_point_notes(points)),
    )


def pitch_rate(databases: Databases, flown: FlightData | None) -> Chart:
    """Return Fig. 15: lift coefficient by pitch rate over angle of attack, by flap setting."""

    def curves(db: xr.DataTree) -> tuple[list[ChartLine], str]:
        mach = middle_mach(db, "qhat")
        lines = _derivative_by_flap(db, "qhat", _RATE, fixed=mach, along=("alphadothat",))
        return lines, fixed_text(mach)

    points = _slopes_by_flap(flown, ("qhat", "alphadothat"), databases)
    note = (
        "Per unit of q cbar/2V (LR-743: q cbar/V, half of it). The effect of the rate of "
        "angle of attack is in it: in the manoeuvres both "
        "rates go together, and LR-743 4.5 has it in this term too."
    )
    return chart_over_alpha(
        databases,
        curves,
        stem="figure-15",
        number="Fig. 15",
        title="lift coefficient by pitch rate",
        y_label=r"$C_{L_{\hat{q}}}$ [1]",
        by="delta_f",
        points=points,
        notes=(note, *_point_notes(points)),
    )


def lift_by_mach(databases: Databases, flown: FlightData | None) -> Chart:
    """Return Fig. 12: lift coefficient of the clean aeroplane over alpha, by Mach number."""

    def curves(db: xr.DataTree) -> tuple[list[ChartLine], str]:
        alpha = covered_alphas(db)
        lines = []
        for i, mach in enumerate(thin_breakpoints(points_of(db, "CL", "mach"), MOST_CURVES)):
            values = combine_coefficients(db, "CL", (1.0, {"alpha": alpha, "mach": mach}))
            lines.append(line_over_alpha("mach", mach, alpha, values=values, index=i))
        return lines, ""

    return chart_over_alpha(
        databases,
        curves,
        stem="figure-12",
        number="Fig. 12",
        title="lift coefficient, clean",
        y_label="$C_L$ [1]",
        by="mach",
    )


def _chart_over_mach(
    databases: Databases,
    curve: Callable[[xr.DataTree, np.ndarray], tuple[np.ndarray, np.ndarray]],
    *,
    stem: str,
    number: str,
    title: str,
    y_label: str,
    points: Sequence[FlightPoints],
    notes: Sequence[str] = (),
) -> Chart:
    """Return a chart over Mach number with one line per database."""
    # One line per database, in its own range of Mach numbers.
    lines = []
    for i, (name, db) in enumerate(databases.items()):
        mach = refine_breakpoints(points_of(db, "CL", "mach"))
        y, stderr = curve(db, mach)
        lines.append(ChartLine(name, mach, y, stderr=stderr, member=i))
    # Of the variables at rest only the height is of interest.
    last_db = list(databases.values())[-1]
    at_rest = remove_moving_devices(last_db, "CL")
    fixed = fixed_text({name: value for name, value in at_rest.items() if name == "h"})
    return Chart(
        stem=stem,
        number=number,
        title=title,
        line=f"{y_label.split(' [')[0]} over ${math_symbol('mach')}${fixed}",
        x_label=axis_label("mach"),
        y_label=y_label,
        panels=[ChartPanel("", lines, points=points)],
        notes=notes,
        is_by_database=True,
    )


def _derivative_by_flap(
    db: xr.DataTree,
    name: str,
    span: float,
    *,
    fixed: Mapping[str, float],
    along: Sequence[str] = (),
) -> list[ChartLine]:
    """Return a derivative of lift over angle of attack, a line per flap setting.

    There is one line for all settings if the flaps do not change it.  The variables `along` change
    together with the variable.
    """
    # Central difference: (CL(span) - CL(-span)) / (2 span)
    alpha, weight = covered_alphas(db), 0.5 / span
    names = (name, *along)
    upper = {"alpha": alpha, **fixed, **dict.fromkeys(names, span)}
    lower = {"alpha": alpha, **fixed, **dict.fromkeys(names, -span)}
    lines = []
    for i, flap in enumerate(flap_settings(db)):
        values = combine_coefficients(
            db, "CL", (weight, {**upper, "delta_f": flap}), (-weight, {**lower, "delta_f": flap})
        )
        lines.append(line_over_alpha("delta_f", flap, alpha, values=values, index=i))
    first = lines[0]
    are_equal = all(np.allclose(line.y, first.y, rtol=1e-9, atol=1e-12) for line in lines)
    if are_equal and len(lines) > 1:
        return [ChartLine("all", first.x, first.y, stderr=first.stderr, member=_ALL_FLAPS)]
    return lines


def _clean_estimates(flown: FlightData | None, term: str, over: str) -> list[FlightPoints]:
    """Return the local estimates of a term of lift, clean."""
    if flown is None:
        return []
    estimates = flown.estimates
    is_term = (estimates["coefficient"] == "CL") & (estimates["term"] == term)
    table = estimates[is_term & is_clean(estimates)]
    if table.empty:
        return []
    x, y, stderr = (table[name].to_numpy(float) for name in (over, "estimate", "stderr"))
    label = "local estimate, standard error"
    return [FlightPoints(label, to_printed_unit(over, x), y, stderr=stderr, kind="estimate")]


def _slopes_by_flap(
    flown: FlightData | None, moved: Sequence[str], databases: Databases
) -> list[FlightPoints]:
    """Return the derivatives that manoeuvres in free air require, by the nearest flap setting."""
    if flown is None:
        return []
    db = list(databases.values())[-1]
    table = required_slopes(db, flown, "CL", moved)
    if not len(table):
        return []
    table = table[is_free(table)]
    points = []
    for i, flap in enumerate(flap_settings(db)):
        part = table[(table["delta_f"] - flap).abs() < _NEAR]
        if not len(part):
            continue
        x, y, stderr = (part[name].to_numpy(float) for name in ("alpha", "estimate", "stderr"))
        setting = number_text(float(to_printed_unit("delta_f", flap)))
        points.append(
            FlightPoints(
                f"manoeuvre, flaps {setting} deg",
                to_printed_unit("alpha", x),
                y,
                stderr=stderr,
                kind="estimate",
                member=i,
            )
        )
    return points


def _point_notes(points: Sequence[FlightPoints]) -> tuple[str, ...]:
    if not points:
        return ()
    return (
        "Points: slope of the measured lift of a manoeuvre less all other terms of the database, "
        "at its own Mach number; bars: one standard error, without errors of the other terms. "
        "Local models divide the same lift between elevator, rate and angle of attack in other "
        "ways: their single estimates do not belong in this figure.",
    )

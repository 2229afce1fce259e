"""Figures 1 to 4 and 12 to 17 of LR-743: lift and rolling moment from the terms of a database, with
local estimates.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.figures.curve_families import thin_breakpoints
from aerodb.figures.curve_sources import refine_breakpoints
from aerodb.figures.lr743_set.chart import Chart, ChartLine, ChartPanel, FlightPoints, NotDrawn
from aerodb.figures.lr743_set.combinations import (
    coefficient_leaves,
    combine_coefficients,
    points_of,
    remove_moving_devices,
    span_of,
)
from aerodb.figures.lr743_set.flown import FlightData, is_clean, is_free
from aerodb.figures.symbols import (
    axis_label,
    math_symbol,
    number_text,
    to_printed_unit,
    value_with_symbol,
)
from aerodb.store.overview import FREE_AIR
from aerodb.store.schema import terms
from flightmech import terms as _terms
from flightmech.names import lookup
from flightmech.units import DEGREE

Databases = Mapping[str, xr.DataTree]
Curves = Callable[[xr.DataTree], tuple[list[ChartLine], str]]
"""The lines of one database, and where its other variables are held, in words."""

_SLOPE = (
    8.0 * DEGREE
)  # the lift slope is the chord from zero to this angle of attack, where lift is linear
_CONTROL = (
    5.0 * DEGREE
)  # a control derivative is a chord over this much either side of zero deflection
_RATE = 1e-3  # a rate derivative is a chord over this much either side of zero [1]
_MOST = 7  # curves of a family
_SPANS = (
    0.15,
    0.25,
    0.6,
)  # heights of Figs. 16 and 17 without flights, over the span; LR-743 has 2, 3 and 8.5 m of 14.4 m
_STEADY = 0.3  # spread of the height over its mean: below it a record near the ground is a low pass
_AROUND = 4.0 * DEGREE  # beyond the angles of attack of low passes that Fig. 16 shows
_NEAR = 2.0 * DEGREE  # of a flap setting: whose estimates belong to it


def lift_intercept_chart(databases: Databases, flown: FlightData | None) -> Chart:
    """Fig. 1: lift coefficient at zero angle of attack over Mach number, clean."""

    def curve(db: xr.DataTree, mach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return combine_coefficients(db, "CL", (1.0, {"alpha": 0.0, "mach": mach}))

    title = "lift coefficient at zero angle of attack, clean"
    return _over_mach(
        "figure-01",
        "Fig. 1",
        title,
        "$C_{L_0}$ [1]",
        databases,
        curve,
        _estimates(flown, "1", "mach"),
        (),
    )


def lift_slope_chart(databases: Databases, flown: FlightData | None) -> Chart:
    """Fig. 2: lift slope over Mach number, clean."""

    def curve(db: xr.DataTree, mach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        end = min(_SLOPE, span_of(db, "CL", "alpha")[1])
        return combine_coefficients(
            db,
            "CL",
            (1.0 / end, {"alpha": end, "mach": mach}),
            (-1.0 / end, {"alpha": 0.0, "mach": mach}),
        )

    title = "lift slope, clean"
    note = (
        f"Slope: chord from 0 to {_SLOPE / DEGREE:g} deg of angle of attack; estimates at "
        f"that of their manoeuvres."
    )
    return _over_mach(
        "figure-02",
        "Fig. 2",
        title,
        r"$C_{L_\alpha}$ [1/rad]",
        databases,
        curve,
        _estimates(flown, "alpha", "mach"),
        (note,),
    )


def flap_increment(databases: Databases, flown: FlightData | None, stem: str, figure: str) -> Chart:
    """Figs. 3 and 13: increment of the lift coefficient by the flaps over angle of attack."""

    def curves(db: xr.DataTree) -> tuple[list[ChartLine], str]:
        mach = _middle_mach(db, "delta_f")
        alpha = _alpha(db)
        lines = []
        for i, flap in enumerate(_flaps(db)[1:]):
            place = {"alpha": alpha, **mach}
            lines.append(
                _line(
                    "delta_f",
                    flap,
                    alpha,
                    combine_coefficients(
                        db, "CL", (1.0, {**place, "delta_f": flap}), (-1.0, place)
                    ),
                    i,
                )
            )
        return lines, _held(mach)

    title = "increment of the lift coefficient by the flaps"
    return _over_alpha(stem, figure, title, r"$\Delta C_L$ [1]", "delta_f", databases, curves)


def elevator_chart(databases: Databases, flown: FlightData | None, stem: str, figure: str) -> Chart:
    """Figs. 4 and 14: lift coefficient by the elevator over angle of attack, by flap setting."""

    def curves(db: xr.DataTree) -> tuple[list[ChartLine], str]:
        mach = _middle_mach(db, "delta_e")
        span = _reach(db, "delta_e", _CONTROL)
        return _by_flap(db, "delta_e", span, mach), _held(mach)

    points = _by_flap_estimates(flown, "delta_e", databases)
    note = (
        f"Derivative: chord from {-_CONTROL / DEGREE:g} to {_CONTROL / DEGREE:g} deg of elevator."
    )
    title = "lift coefficient by the elevator"
    return _over_alpha(
        stem,
        figure,
        title,
        r"$C_{L_{\delta_e}}$ [1/rad]",
        "delta_f",
        databases,
        curves,
        points,
        (note, *_own(points)),
    )


def pitch_rate(databases: Databases, flown: FlightData | None) -> Chart:
    """Fig. 15: lift coefficient by pitch rate over angle of attack, by flap setting."""

    def curves(db: xr.DataTree) -> tuple[list[ChartLine], str]:
        mach = _middle_mach(db, "qhat")
        return _by_flap(db, "qhat", _RATE, mach, ("alphadothat",)), _held(mach)

    points = _by_flap_estimates(flown, "qhat", databases)
    note = (
        "Per unit of q cbar/2V (LR-743: q cbar/V, half of it). The effect of the rate of "
        "angle of attack is in it: in the manoeuvres both "
        "rates go together, and LR-743 4.5 has it in this term too."
    )
    title = "lift coefficient by pitch rate"
    return _over_alpha(
        "figure-15",
        "Fig. 15",
        title,
        r"$C_{L_{\hat{q}}}$ [1]",
        "delta_f",
        databases,
        curves,
        points,
        (note, *_own(points)),
    )


def lift_by_mach(databases: Databases, flown: FlightData | None) -> Chart:
    """Fig. 12: lift coefficient of the clean aeroplane over angle of attack, by Mach number."""

    def curves(db: xr.DataTree) -> tuple[list[ChartLine], str]:
        alpha = _alpha(db)
        members = thin_breakpoints(points_of(db, "CL", "mach"), _MOST)
        return [
            _line(
                "mach",
                mach,
                alpha,
                combine_coefficients(db, "CL", (1.0, {"alpha": alpha, "mach": mach})),
                i,
            )
            for i, mach in enumerate(members)
        ], ""

    return _over_alpha(
        "figure-12", "Fig. 12", "lift coefficient, clean", "$C_L$ [1]", "mach", databases, curves
    )


def near_the_ground(databases: Databases, flown: FlightData | None) -> Chart:
    """Fig. 16: lift coefficient over angle of attack by height, largest flap setting."""
    for db in databases.values():
        _demand_height(db, "CL")
    low = _low_passes(flown)
    flap = _largest_flap(list(databases.values())[-1], low)

    points = (
        []
        if flown is None
        else [_sampled(flown, row, i, "alpha", "CL") for i, row in enumerate(low)]
    )

    def curves(db: xr.DataTree) -> tuple[list[ChartLine], str]:
        alpha = _alpha(db)
        if points:
            ends = [np.radians(end(one.x)) for one in points for end in (np.min, np.max)]
            alpha = np.linspace(
                max(min(ends) - _AROUND, alpha[0]), min(max(ends) + _AROUND, alpha[-1]), 41
            )
        lines = []
        for i, (h, place) in enumerate(_heights(db, "CL", low, flap)):
            y, stderr = combine_coefficients(db, "CL", (1.0, {**place, "alpha": alpha, "h_agl": h}))
            lines.append(ChartLine(_height(h), to_printed_unit("alpha", alpha), y, stderr, i))
        return lines, _held({"delta_f": flap})

    notes = (
        (
            "Curves by height at the mean Mach number and elevator of the samples; free air "
            "at those of the lowest pass.",
        )
        if low
        else ()
    )
    title = "lift coefficient near the ground"
    return _over_alpha(
        "figure-16", "Fig. 16", title, "$C_L$ [1]", "h_agl", databases, curves, points, notes
    )


def bank_near_the_ground(databases: Databases, flown: FlightData | None) -> Chart:
    """Fig. 17: rolling moment of the ground over lift coefficient times bank angle, by height."""
    last = {name: db for name, db in databases.items() if _rolls(db)}
    if not last:
        raise NotDrawn(
            "no term of Cl over h_agl and phi (LR-743 eq. 14): it needs flights with bank "
            "near the ground and a model of Cl in "
            "[ground_effect], or in `aeromatch flight ground-effect`"
        )
    low = [] if flown is None else _low_passes(flown)
    x = np.linspace(-0.3, 0.3, 13)

    def curves(db: xr.DataTree) -> tuple[list[ChartLine], str]:
        lines = []
        for i, (h, place) in enumerate(_heights(db, "Cl", low, 0.0)):
            banked = {**place, "h_agl": h, "CL": 1.0, "phi": x}
            y, stderr = combine_coefficients(
                db, "Cl", (1.0, banked), (-1.0, {**banked, "phi": 0.0})
            )
            lines.append(ChartLine(_height(h), x, y, stderr, i))
        return lines, ""

    points = [] if flown is None else [_banked(flown, last, row, i) for i, row in enumerate(low)]
    return Chart(
        "figure-17",
        "Fig. 17",
        "rolling moment of the ground",
        f"$C_l$ over $C_L \\phi$, curves by ${math_symbol('h_agl')}$",
        r"$C_L\,\phi$ [rad]",
        "$C_l$ [1]",
        _panels(last, curves, points, "h_agl")[0],
        (
            "A negative slope lowers the upper wing. Points: rolling moment of the flight "
            "less all other terms of the database.",
        )
        if points
        else ("A negative slope lowers the upper wing.",),
    )


def _over_mach(
    stem: str,
    figure: str,
    title: str,
    y_label: str,
    databases: Databases,
    curve: Callable[[xr.DataTree, np.ndarray], tuple[np.ndarray, np.ndarray]],
    points: Sequence[FlightPoints],
    notes: Sequence[str],
) -> Chart:
    lines = []
    for i, (name, db) in enumerate(databases.items()):
        mach = refine_breakpoints(points_of(db, "CL", "mach"))
        lines.append(ChartLine(name, mach, *curve(db, mach), i))
    held = _held({k: v for k, v in remove_moving_devices(db, "CL").items() if k == "h"})
    line = f"{y_label.split(' [')[0]} over ${math_symbol('mach')}${held}"
    return Chart(
        stem,
        figure,
        title,
        line,
        axis_label("mach"),
        y_label,
        [ChartPanel("", lines, points=points)],
        notes,
        is_by_database=True,
    )


def _over_alpha(
    stem: str,
    figure: str,
    title: str,
    y_label: str,
    by: str,
    databases: Databases,
    curves: Curves,
    points: Sequence[FlightPoints] = (),
    notes: Sequence[str] = (),
) -> Chart:
    panels, held = _panels(databases, curves, points, by)
    unit = " [deg]" if lookup(by).units == "rad" else ""
    line = f"{y_label.split(' [')[0]} over ${math_symbol('alpha')}$, curves by ${math_symbol(by)}${unit}{held}"
    return Chart(stem, figure, title, line, axis_label("alpha"), y_label, panels, notes)


def _panels(
    databases: Databases, curves: Curves, points: Sequence[FlightPoints], by: str
) -> tuple[list[ChartPanel], str]:
    found = {name: curves(db) for name, db in databases.items()}
    last = list(found)[-1]
    panels = [
        ChartPanel(name, lines, points=points if name == last else (), by=f"${math_symbol(by)}$")
        for name, (lines, _) in found.items()
    ]
    return panels, next(iter(found.values()))[1]


def _line(
    by: str, member: float, x: np.ndarray, values: tuple[np.ndarray, np.ndarray], i: int
) -> ChartLine:
    return ChartLine(value_with_symbol(by, member), to_printed_unit("alpha", x), *values, i)


def _by_flap(
    db: xr.DataTree, name: str, span: float, place: Mapping[str, float], along: Sequence[str] = ()
) -> list[ChartLine]:
    """Return a derivative of lift over angle of attack, a line per flap setting; one line where the
    flaps change nothing.
    """
    alpha, weight = _alpha(db), 0.5 / span
    up, down = (
        {"alpha": alpha, **place, **dict.fromkeys((name, *along), sign * span)}
        for sign in (1.0, -1.0)
    )
    lines = []
    for i, flap in enumerate(_flaps(db)):
        values = combine_coefficients(
            db, "CL", (weight, {**up, "delta_f": flap}), (-weight, {**down, "delta_f": flap})
        )
        lines.append(_line("delta_f", flap, alpha, values, i))
    same = all(np.allclose(line.y, lines[0].y, rtol=1e-9, atol=1e-12) for line in lines)
    return (
        [ChartLine("all", lines[0].x, lines[0].y, lines[0].stderr, -1)]
        if same and len(lines) > 1
        else lines
    )


def _flaps(db: xr.DataTree) -> tuple[float, ...]:
    return thin_breakpoints(points_of(db, "CL", "delta_f"), _MOST)


def _alpha(db: xr.DataTree) -> np.ndarray:
    low, high = span_of(db, "CL", "alpha")
    points = points_of(db, "CL", "alpha")
    return refine_breakpoints(points[(points >= low) & (points <= high)])


def _reach(db: xr.DataTree, name: str, wanted: float) -> float:
    """Return half the chord of a derivative: `wanted`, or what the tables of the variable allow on
    both sides.
    """
    if not any(name in _terms.list_model_variables(leaf) for leaf in coefficient_leaves(db, "CL")):
        raise NotDrawn(f"no term of CL depends on {name}")
    try:
        low, high = span_of(db, "CL", name)
    except NotDrawn:  # a regressor
        return wanted
    return min(wanted, -low, high)


def _middle_mach(db: xr.DataTree, among: str) -> dict[str, float]:
    """Return the middle Mach number of the tables that depend on a variable; nothing where Mach
    number is no axis.
    """
    if not any(among in _terms.list_model_variables(leaf) for leaf in coefficient_leaves(db, "CL")):
        raise NotDrawn(f"no term of CL depends on {among}")
    try:
        points = points_of(db, "CL", "mach", among)
    except NotDrawn:
        points = points_of(db, "CL", "mach")
    return {"mach": float(points[(len(points) - 1) // 2])}


def _height(h: float) -> str:
    return "free air" if h >= FREE_AIR else f"{number_text(h)} m"


def _demand_height(db: xr.DataTree, coefficient: str) -> None:
    if not any(
        "h_agl" in _terms.list_model_variables(leaf) for leaf in coefficient_leaves(db, coefficient)
    ):
        raise NotDrawn(
            f"no term of {coefficient} depends on h_agl; it needs DATCOM cases with GRNDEF, "
            f"or flights near the ground"
        )


def _rolls(db: xr.DataTree) -> bool:
    return any(
        {"h_agl", "phi"} <= _terms.list_model_variables(leaf) for name, leaf in _cl(db).items()
    )


def _cl(db: xr.DataTree) -> dict[str, xr.Dataset]:

    return {name: leaf for name, leaf in terms(db).items() if name.startswith("Cl/")}


def _low_passes(flown: FlightData | None) -> list[pd.Series]:
    """Return the manoeuvres at a steady height in ground effect, one per record, rising; means over
    their samples. [SI]
    """
    if flown is None:
        return []
    rows = []
    low = flown.manoeuvres[~is_free(flown.manoeuvres)]
    for record, part in low.groupby("record", sort=False):
        samples = flown.samples[flown.samples["manoeuvre"].isin(part.index)]
        mean = samples.mean(numeric_only=True)
        if samples["h_agl"].std() < _STEADY * mean["h_agl"]:
            rows.append(mean.rename(str(record)))
    return sorted(rows, key=lambda row: row["h_agl"])


def _largest_flap(db: xr.DataTree, low: Sequence[pd.Series]) -> float:
    if low:
        return float(np.radians(np.round(np.degrees(low[0]["delta_f"]))))
    try:
        return float(points_of(db, "CL", "delta_f")[-1])
    except NotDrawn:
        return 0.0


def _heights(
    db: xr.DataTree, coefficient: str, low: Sequence[pd.Series], flap: float
) -> list[tuple[float, dict[str, float]]]:
    """Return the heights of the curves, the lowest first and free air last, and the condition of
    each. [SI]
    """
    own = remove_moving_devices(db, coefficient)
    if low:
        places = [
            {name: float(row[name]) for name in own if name in row and np.isfinite(row[name])}
            for row in low
        ]
        found = [(float(np.round(row["h_agl"], 1)), place) for row, place in zip(low, places)]
        return [*found, (FREE_AIR, places[0])]
    rest = {"delta_f": flap, "gear": 1.0} if coefficient == "CL" else {}
    place = {name: value for name, value in rest.items() if name in own}
    return [(float(np.round(part * db.attrs["b"], 1)), place) for part in _SPANS] + [
        (FREE_AIR, place)
    ]


def _sampled(flown: FlightData, row: pd.Series, member: int, x: str, y: str) -> FlightPoints:
    manoeuvres = flown.manoeuvres.index[flown.manoeuvres["record"] == row.name]
    part = flown.samples[flown.samples["manoeuvre"].isin(manoeuvres)]
    return FlightPoints(
        f"samples at {_height(round(row['h_agl'], 1))}",
        to_printed_unit(x, part[x]),
        part[y].to_numpy(),
        np.zeros(len(part)),
        "sample",
        member,
    )


def _banked(flown: FlightData, databases: Databases, row: pd.Series, member: int) -> FlightPoints:
    db = list(databases.values())[-1]
    part = flown.samples[
        flown.samples["manoeuvre"].isin(
            flown.manoeuvres.index[flown.manoeuvres["record"] == row.name]
        )
    ]
    own = {
        name: part[name].to_numpy(float)
        for name in {*remove_moving_devices(db, "Cl"), "CL"}
        if name in part
    }
    others, _ = combine_coefficients(db, "Cl", (1.0, {**own, "phi": 0.0}))
    y = part["Cl"].to_numpy(float) - others
    return FlightPoints(
        f"samples at {_height(round(row['h_agl'], 1))}",
        (part["CL"] * part["phi"]).to_numpy(float),
        y,
        np.zeros(len(part)),
        "sample",
        member,
    )


def _estimates(flown: FlightData | None, term: str, over: str) -> list[FlightPoints]:
    """Return the local estimates of a term of lift, clean."""
    if flown is None:
        return []
    table = flown.estimates[
        (flown.estimates["coefficient"] == "CL")
        & (flown.estimates["term"] == term)
        & is_clean(flown.estimates)
    ]
    if table.empty:
        return []
    x, y, stderr = (table[name].to_numpy(float) for name in (over, "estimate", "stderr"))
    return [
        FlightPoints(
            "local estimate, standard error", to_printed_unit(over, x), y, stderr, "estimate"
        )
    ]


def _by_flap_estimates(
    flown: FlightData | None, term: str, databases: Databases
) -> list[FlightPoints]:
    """Return the local estimates of a term of lift in free air over angle of attack, by the flap
    setting nearest to theirs.
    """
    if flown is None:
        return []
    flaps = np.array(_flaps(list(databases.values())[-1]))
    all_of_it = flown.estimates[
        (flown.estimates["coefficient"] == "CL") & (flown.estimates["term"] == term)
    ]
    table = all_of_it[is_free(all_of_it)]
    found = []
    for i, flap in enumerate(flaps):
        part = table[(table["delta_f"] - flap).abs() < _NEAR]
        if len(part):
            x, y, stderr = (part[name].to_numpy(float) for name in ("alpha", "estimate", "stderr"))
            label = (
                f"local estimate, flaps {number_text(float(to_printed_unit('delta_f', flap)))} deg"
            )
            found.append(FlightPoints(label, to_printed_unit("alpha", x), y, stderr, "estimate", i))
    return found


def _own(points: Sequence[FlightPoints]) -> tuple[str, ...]:
    return ("Estimates at their own Mach numbers; bars: one standard error.",) if points else ()


def _held(place: Mapping[str, float]) -> str:
    words = ", ".join(value_with_symbol(name, value) for name, value in place.items())
    return f"; at {words}" if words else ""

"""Figures 16 and 17 of LR-743: lift and rolling moment near the ground."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.figures.lr743_set.chart import Chart, ChartLine, FlightPoints, NotDrawn
from aerodb.figures.lr743_set.combinations import (
    coefficient_leaves,
    combine_coefficients,
    points_of,
    remove_moving_devices,
)
from aerodb.figures.lr743_set.flown import FlightData, is_free
from aerodb.figures.lr743_set.lift_curves import (
    Databases,
    chart_over_alpha,
    covered_alphas,
    fixed_text,
    panels_of_databases,
)
from aerodb.figures.symbols import math_symbol, number_text, to_printed_unit
from aerodb.store.overview import FREE_AIR
from aerodb.store.schema import terms
from flightmech import terms as _terms
from flightmech.units import DEGREE

# Heights over the span without flights. LR-743 has 2, 3 and 8.5 m for a span of 14.4 m.
_SPANS = (0.15, 0.25, 0.6)
# Spread of the height over its mean. A record near the ground with less is a low pass.
_STEADY = 0.3
# Range of Fig. 16 beyond the angles of attack of the low passes. [rad]
_AROUND = 4.0 * DEGREE


def near_the_ground(databases: Databases, flown: FlightData | None) -> Chart:
    """Return Fig. 16: lift over angle of attack by height, largest flap setting."""
    for db in databases.values():
        _demand_height(db, "CL")
    passes = _low_passes(flown)
    flap = _largest_flap(list(databases.values())[-1], passes)
    points = []
    for i, mean in enumerate(passes):
        assert flown is not None
        samples = _samples_of_pass(flown, mean)
        alpha = to_printed_unit("alpha", samples["alpha"])
        points.append(_sample_points(mean, alpha, samples["CL"].to_numpy(), member=i))

    def curves(db: xr.DataTree) -> tuple[list[ChartLine], str]:
        alpha = _alpha_around(points, covered_alphas(db))
        lines = []
        for i, (h, condition) in enumerate(_heights(db, "CL", passes, flap=flap)):
            y, stderr = combine_coefficients(
                db, "CL", (1.0, {**condition, "alpha": alpha, "h_agl": h})
            )
            x = to_printed_unit("alpha", alpha)
            lines.append(ChartLine(_height_label(h), x, y, stderr=stderr, member=i))
        return lines, fixed_text({"delta_f": flap})

    notes: tuple[str, ...] = ()
    if passes:
        notes = (
            "Curves by height at the mean Mach number and elevator of the samples; free air "
            "at those of the lowest pass.",
        )
    return chart_over_alpha(
        databases,
        curves,
        stem="figure-16",
        number="Fig. 16",
        title="lift coefficient near the ground",
        y_label="$C_L$ [1]",
        by="h_agl",
        points=points,
        notes=notes,
    )


def _alpha_around(points: Sequence[FlightPoints], alpha: np.ndarray) -> np.ndarray:
    """Return the range of angles of attack around the samples, or of the tables. [rad]"""
    if not points:
        return alpha
    # The abscissae of points are in degrees.
    ends = []
    for item in points:
        ends += [np.radians(np.min(item.x)), np.radians(np.max(item.x))]
    low = max(min(ends) - _AROUND, alpha[0])
    high = min(max(ends) + _AROUND, alpha[-1])
    return np.linspace(low, high, 41)


def bank_near_the_ground(databases: Databases, flown: FlightData | None) -> Chart:
    """Return Fig. 17: rolling moment of the ground over lift times bank angle, by height."""
    rolling = {name: db for name, db in databases.items() if _has_rolling_moment(db)}
    if not rolling:
        raise NotDrawn(
            "no term of Cl over h_agl and phi (LR-743 eq. 14): it needs flights with bank "
            "near the ground and a model of Cl in "
            "[ground_effect], or in `aeromatch flight ground-effect`"
        )
    passes = _low_passes(flown)
    # With CL = 1 the abscissa CL phi is the bank angle.
    phi = np.linspace(-0.3, 0.3, 13)

    def curves(db: xr.DataTree) -> tuple[list[ChartLine], str]:
        lines = []
        for i, (h, condition) in enumerate(_heights(db, "Cl", passes, flap=0.0)):
            banked = {**condition, "h_agl": h, "CL": 1.0, "phi": phi}
            level = {**banked, "phi": 0.0}
            y, stderr = combine_coefficients(db, "Cl", (1.0, banked), (-1.0, level))
            lines.append(ChartLine(_height_label(h), phi, y, stderr=stderr, member=i))
        return lines, ""

    points = []
    for i, mean in enumerate(passes):
        assert flown is not None
        points.append(_rolling_moment_points(flown, rolling, mean, member=i))
    note = "A negative slope lowers the upper wing."
    if points:
        note += " Points: rolling moment of the flight less all other terms of the database."
    return Chart(
        stem="figure-17",
        number="Fig. 17",
        title="rolling moment of the ground",
        line=f"$C_l$ over $C_L \\phi$, curves by ${math_symbol('h_agl')}$",
        x_label=r"$C_L\,\phi$ [rad]",
        y_label="$C_l$ [1]",
        panels=panels_of_databases(rolling, curves, points, by="h_agl")[0],
        notes=(note,),
    )


def _height_label(h: float) -> str:
    return "free air" if h >= FREE_AIR else f"{number_text(h)} m"


def _demand_height(db: xr.DataTree, coefficient: str) -> None:
    leaves = coefficient_leaves(db, coefficient)
    if not any("h_agl" in _terms.list_model_variables(leaf) for leaf in leaves):
        raise NotDrawn(
            f"no term of {coefficient} depends on h_agl; it needs DATCOM cases with GRNDEF, "
            f"or flights near the ground"
        )


def _has_rolling_moment(db: xr.DataTree) -> bool:
    """Return whether a term of the rolling moment depends on height and bank angle."""
    for name, leaf in terms(db).items():
        variables = _terms.list_model_variables(leaf)
        if name.startswith("Cl/") and {"h_agl", "phi"} <= variables:
            return True
    return False


def _low_passes(flown: FlightData | None) -> list[pd.Series]:
    """Return the mean of the samples of each low pass, named by its record, rising. [SI]"""
    if flown is None:
        return []
    passes = []
    low = flown.manoeuvres[~is_free(flown.manoeuvres)]
    for record, part in low.groupby("record", sort=False):
        samples = flown.samples[flown.samples["manoeuvre"].isin(part.index)]
        mean = samples.mean(numeric_only=True)
        # A landing or take-off crosses heights, a low pass stays at one.
        if samples["h_agl"].std() < _STEADY * mean["h_agl"]:
            passes.append(mean.rename(str(record)))
    return sorted(passes, key=lambda mean: mean["h_agl"])


def _largest_flap(db: xr.DataTree, passes: Sequence[pd.Series]) -> float:
    """Return the flap setting of the lowest pass, or else the largest of the tables. [rad]"""
    if passes:
        return float(np.radians(np.round(np.degrees(passes[0]["delta_f"]))))
    try:
        return float(points_of(db, "CL", "delta_f")[-1])
    except NotDrawn:
        return 0.0


def _heights(
    db: xr.DataTree, coefficient: str, passes: Sequence[pd.Series], flap: float
) -> list[tuple[float, dict[str, float]]]:
    """Return the height and condition of each curve, the lowest first and free air last. [SI]"""
    names = remove_moving_devices(db, coefficient)
    heights = []
    if passes:
        for mean in passes:
            condition = {}
            for name in names:
                if name in mean and np.isfinite(mean[name]):
                    condition[name] = float(mean[name])
            heights.append((float(np.round(mean["h_agl"], 1)), condition))
        # Free air has the condition of the lowest pass.
        return [*heights, (FREE_AIR, heights[0][1])]
    landing = {"delta_f": flap, "gear": 1.0} if coefficient == "CL" else {}
    condition = {name: value for name, value in landing.items() if name in names}
    for share in _SPANS:
        heights.append((float(np.round(share * db.attrs["b"], 1)), condition))
    return [*heights, (FREE_AIR, condition)]


def _samples_of_pass(flown: FlightData, mean: pd.Series) -> pd.DataFrame:
    """Return the samples of all manoeuvres of the record of a low pass."""
    is_record = flown.manoeuvres["record"] == mean.name
    manoeuvres = flown.manoeuvres.index[is_record]
    return flown.samples[flown.samples["manoeuvre"].isin(manoeuvres)]


def _sample_points(mean: pd.Series, x: np.ndarray, y: np.ndarray, member: int) -> FlightPoints:
    label = f"samples at {_height_label(round(mean['h_agl'], 1))}"
    return FlightPoints(label, x, y, stderr=np.zeros(len(y)), kind="sample", member=member)


def _rolling_moment_points(
    flown: FlightData, databases: Databases, mean: pd.Series, member: int
) -> FlightPoints:
    """Return the rolling moment of a low pass without all terms that act at zero bank."""
    db = list(databases.values())[-1]
    samples = _samples_of_pass(flown, mean)
    # All terms at zero bank are subtracted; the rest is the effect of bank near the ground.
    condition = {}
    for name in {*remove_moving_devices(db, "Cl"), "CL"}:
        if name in samples:
            condition[name] = samples[name].to_numpy(float)
    other_terms, _ = combine_coefficients(db, "Cl", (1.0, {**condition, "phi": 0.0}))
    x = (samples["CL"] * samples["phi"]).to_numpy(float)
    return _sample_points(mean, x, samples["Cl"].to_numpy(float) - other_terms, member=member)

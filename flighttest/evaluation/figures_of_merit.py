"""Figures of an evaluation by name, and the bounds they are held against."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import pandas as pd

from flightmech.errors import AeromatchError, SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.units import quantity

from ..equation_error.model import Model
from ..quality.checks.control_response import EQUATIONS
from ..quality.checks.relations import RELATIONS
from .plan import Bound, Plan

if TYPE_CHECKING:
    from flightmech import Aircraft

    from ..aircraft_properties.eigenmotion import Motion
    from ..equation_error.fit import Fit
    from ..quality.result import Quality
    from .stationary_points import Fitted

INSIDE, OUTSIDE, OPEN = "inside", "outside", "not determined"
COLUMNS = ("of", "value", "stderr", "unit", "low", "high", "verdict", "source", "reason")
_MODES = {
    "oscillation": {"period": "s", "damping_ratio": "1", "omega_n": "rad s-1", "t_half": "s"},
    "aperiodic": {"time_constant": "s", "t_half": "s"},
}
_KINEMATIC = ("slope", "offset", "correlation", "disagreement")


class Figure(NamedTuple):
    """One number: value, standard error (NaN where there is none), SI unit."""

    value: float
    stderr: float
    unit: str


def units_of(plan: Plan) -> dict[str, str]:
    """Return name and SI unit of every figure that an evaluation can give.

    ``kinematics.theta_rate.slope``, ``delay.theta``, ``answer.delta_e``; of a line ``trim.slope trim.offset trim.root``; of a polar
    ``polar.CD0 polar.oswald``; of a fit ``pitching.alpha`` and its other terms; of a mode ``phugoid.period`` ...
    """
    found = {f"kinematics.{r.name}.{what}": r.units if what == "offset" else "1" for r in RELATIONS for what in _KINEMATIC}
    found |= {f"delay.{channel}": "s" for r in RELATIONS for channel in r.needs}
    found |= {f"answer.{equation.surface}": "s-2" for equation in EQUATIONS}
    for line in plan.line:
        if line.kind == "polar":
            found |= {f"{line.name}.CD0": "1", f"{line.name}.oswald": "1"}
        else:
            found |= {f"{line.name}.slope": "1", f"{line.name}.offset": _unit(line.y), f"{line.name}.root": _unit(line.x)}
    for fit in plan.fit:
        found |= {f"{fit.name}.{term}": "1" for term in Model.parse(fit.model).terms}
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


def limits_of(plan: Plan) -> list[tuple[float, float]]:
    """Return the bounds in SI.

    Raises
    ------
    SchemaError
        Figures that do not exist, with near names, and wrong units; all at once.
    """
    units, problems, found = units_of(plan), [], []
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
        low, high = (None if edge is None else quantity(edge, unit) for edge in (bound.low, bound.high))
        return (-math.inf if low is None else low), (math.inf if high is None else high)
    value, within = quantity(bound.value, unit), bound.within or 0.0
    relative = isinstance(within, str) and within.strip().endswith("%")
    width = abs(value) * quantity(within, "1") if relative else quantity(within, unit)
    return value - width, value + width


def collect(
    quality: Quality, lines: Sequence[Fitted], fits: Sequence[Fit], motions: Mapping[str, Motion], aircraft: Aircraft
) -> dict[str, Figure]:
    """Return the figures of an evaluation by name."""
    nan = math.nan
    found: dict[str, Figure] = {}
    for row in quality.kinematics.to_dict("records"):
        head = f"kinematics.{row['relation']}"
        found[f"{head}.slope"] = Figure(row["slope"], row["slope_stderr"], "1")
        found |= {f"{head}.{what}": Figure(row[what], nan, row["units"] if what == "offset" else "1") for what in _KINEMATIC[1:]}
    for row in quality.delays.to_dict("records"):
        found[f"delay.{row['channel']}"] = Figure(row["delay"], row["stderr"], "s")
    for row in quality.answers.to_dict("records"):
        found[f"answer.{row['surface']}"] = Figure(row["effect"], row["stderr"], "s-2")
    for fitted in lines:
        found |= _of_line(fitted, aircraft)
    for fit in fits:
        e = fit.estimates
        for k, term in enumerate(e["term"].values):
            found[f"{fit.name}.{term}"] = Figure(float(e["estimate"].values[k]), float(e["stderr"].values[k]), "1")
    for name, motion in motions.items():
        found |= {f"{name}.{what}": Figure(*values) for what, values in motion.values.items()}
    return found


def _of_line(fitted: Fitted, aircraft: Aircraft) -> dict[str, Figure]:
    line = fitted.line
    if line.kind == "polar":
        slope, error = fitted.slope
        e = aircraft.S / (math.pi * aircraft.b**2 * slope)  # CD = CD0 + CL^2 / (pi A e)
        return {f"{line.name}.CD0": Figure(*fitted.offset, "1"), f"{line.name}.oswald": Figure(e, abs(e * error / slope), "1")}
    return {
        f"{line.name}.slope": Figure(*fitted.slope, "1"),
        f"{line.name}.offset": Figure(*fitted.offset, _unit(line.y)),
        f"{line.name}.root": Figure(*fitted.root, _unit(line.x)),
    }


def judge(plan: Plan, figures: Mapping[str, Figure]) -> pd.DataFrame:
    """Return every bound with its figure and verdict; columns `COLUMNS`, SI."""
    rows = []
    for bound, (low, high) in zip(plan.bound, limits_of(plan)):
        figure = figures.get(bound.of)
        if figure is None:
            rows.append((bound.of, math.nan, math.nan, units_of(plan)[bound.of], low, high, OPEN, bound.source, bound.reason))
            continue
        verdict = INSIDE if low <= figure.value <= high else OUTSIDE
        rows.append((bound.of, *figure, low, high, verdict, bound.source, bound.reason))
    return pd.DataFrame(rows, columns=list(COLUMNS))

"""All characteristics of an aircraft with a database at one condition."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.flying_qualities import (
    climb,
    lateral,
    level_flight,
    longitudinal,
    performance,
    trim_over_speed,
)
from flightmech.short_text import ShortText
from flightmech.simulation.run import Stated
from flightmech.steady_flight.eigenmodes import modes
from flightmech.steady_flight.flight_condition import Characteristic, rows_to_frame
from flightmech.steady_flight.linear_model import linearize
from flightmech.steady_flight.trim_point import Point, trimmed_at
from flightmech.units import from_si

_CURVE_POINTS = 25  # speeds of the trim curves
# Units of the report in place of SI units.
_DISPLAY = {"rad": "deg", "rad s-1": "deg/s", "rad s m-1": "deg s m-1"}


@dataclass(frozen=True)
class Characteristics(ShortText):
    """Result of `characteristics`.

    Parameters
    ----------
    table : DataFrame
        Index ``quantity``; columns ``group value units remark absent``.  ``absent`` states why a
        value is NaN.  `aerodb.update.with_standard_errors` adds a column ``stderr``. [unit of the
        value]
    modes : DataFrame
        As from `flightmech.modes`. `aerodb.update.with_standard_errors` adds ``omega_n_stderr`` and
        ``damping_ratio_stderr``.
    linear : Dataset
        As from `flightmech.linearize`, at the condition.
    derivatives : Dataset
        ``value (coefficient, variable)`` at the condition: derivatives of the coefficients about
        the moment reference point.
    trim : Dataset (V,)
        Trim curves: angle of attack, elevator, thrust, stick force over speed.
    polar : Dataset (alpha,)
        Trimmed drag polar, power off.
    performance : Dataset (V,)
        Thrust required and available, lift over drag, climb over speed; empty without engines.
    title, condition : str
        Aircraft and condition in words.
    tables_left : tuple of str
        A text for each variable of the flight that is beyond its tables.
    remarks : tuple of str
        Accelerations that the trim left, and the bank in place of a rudder.
    """

    table: pd.DataFrame
    modes: pd.DataFrame
    linear: xr.Dataset = field(repr=False)
    derivatives: xr.Dataset = field(repr=False)
    trim: xr.Dataset = field(repr=False)
    polar: xr.Dataset = field(repr=False)
    performance: xr.Dataset = field(repr=False)
    title: str
    condition: str
    tables_left: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    def report(self) -> str:
        """Return the table and the modes as text, angles in degrees."""
        lines = [f"{self.title}: {self.condition}", *self.tables_left, *self.remarks]
        for group, part in self.table.groupby("group", sort=False):
            lines += ["", str(group)]
            for name, row in part.iterrows():
                # a standard error has a column of its own, which is empty for absent values
                error = ""
                if "stderr" in part:
                    error = f"{_format_error(row['stderr'], row['units']):12}"
                lines.append(
                    f"  {name:24} {_format_value(row['value'], row['units'])}  "
                    f"{error}{row['absent'] or row['remark']}"
                )
        lines += ["", "modes"]
        for _, row in self.modes.iterrows():
            lines.append(f"  {row['mode']:24} {_format_mode(row)}")
        return "\n".join(lines)


def characteristics(
    aircraft: Aircraft, db: xr.DataTree, condition: Mapping[str, Stated]
) -> Characteristics:
    """Return the stability, control and performance quantities of an aircraft and its database.

    The quantities are those of the Smetana program [LR743].

    Neutral points stick fixed and free, manoeuvre points, elevator and stick force per g, static
    stick-force gradient, trim curves, sideslip gradients, roll rate, minimum control speed, the
    modes, stall, drag polar, glide, climb, ceilings and range figures.  If database or aircraft
    file do not give a quantity (hinge moments, gearing, thrust, fuel flow), it is absent with the
    reason in words.

    Parameters
    ----------
    aircraft : Aircraft
        Limits of the controls and ``[control]`` tables are optional.
    db : DataTree
        Terms of the six coefficients. Hinge moments ``Ch_e Ch_a Ch_r``, positive as the deflection,
        add the pilot's forces.
    condition : mapping of str to float
        ``{"V": 90.0, "h": 1500.0, "delta_f": 0.35}``: one of ``V mach V_cas V_eas``, and any of ``h
        gamma mass x_cg_b ... delta_T``, inputs and parameters of the simulation. A text has its
        unit, as ``"170 kt"``; a number is SI.

    Returns
    -------
    Characteristics

    Raises
    ------
    SchemaError, UnknownName
        Faults of the model or the condition.
    SimulationError
        No flight is steady at the condition.

    References
    ----------
    .. [LR743] Report LR-743, 1993, section 2.2.
    """
    point = trimmed_at(aircraft, db, condition)
    linear = linearize(point.sim, point.parameters)
    slowest = performance.stall(point)
    speeds = level_flight.level_speeds(point, slowest)
    polar = performance.polar(point)
    # thrust required and available need engines
    curves = xr.Dataset()
    if aircraft.engines:
        curves = level_flight.performance_curves(point, speeds)
    return Characteristics(
        table=rows_to_frame(_list_rows(point, slowest, speeds, polar=polar)),
        modes=modes(linear),
        linear=linear,
        derivatives=point.derivatives(),
        trim=trim_over_speed.trim_curves(point, np.linspace(*speeds, _CURVE_POINTS)),
        polar=polar,
        performance=curves,
        title=aircraft.name,
        condition=_describe_condition(point),
        tables_left=tuple(point.tables_left),
        remarks=tuple(point.remarks),
    )


def _list_rows(
    point: Point,
    slowest: performance.Stall,
    speeds: tuple[float, float],
    polar: xr.Dataset,
) -> list[Characteristic]:
    """Return all quantities, in the order of the report."""
    return [
        *longitudinal.longitudinal_rows(point),
        *trim_over_speed.speed_stability(point),
        *lateral.sideslip_rows(point),
        *lateral.roll_rate(point),
        *lateral.minimum_control_speed(point, slowest.V),
        *performance.stall_rows(slowest),
        *performance.polar_rows(point, polar),
        *level_flight.level_rows(point, speeds),
        *climb.climb_rows(point, speeds),
    ]


def _describe_condition(point: Point) -> str:
    parts = [
        f"V {point['V']:.4g} m/s (CAS {point['V_cas']:.4g} m/s, Mach {point['mach']:.3f})",
        f"h {point['h']:.5g} m",
        f"mass {point.mass:.5g} kg",
        f"alpha {np.degrees(point['alpha']):.3g} deg",
        f"delta_e {np.degrees(point['applied.delta_e']):.3g} deg",
    ]
    return ", ".join(parts)


def _to_display(value: float, units: str) -> tuple[float, str]:
    """Return a value and its unit for the report."""
    display = _DISPLAY.get(units, units)
    if display == units:
        return value, units
    return float(from_si(value, display)), display


def _format_value(value: float, units: str) -> str:
    if np.isnan(value):
        return f"{'-':>10} {'':10}"
    number, unit = _to_display(value, units)
    if unit == "1":
        unit = ""
    return f"{number:10.4g} {unit:10}"


def _format_error(stderr: float, units: str) -> str:
    if np.isnan(stderr):
        return ""
    return f"+- {_to_display(stderr, units)[0]:.2g}"


def _format_mode(row: pd.Series) -> str:
    """Return frequency, damping, times and remark of a mode, with standard errors if it has any."""
    errors = {}
    for name in ("omega_n", "damping_ratio"):
        errors[name] = ""
        if f"{name}_stderr" in row:
            errors[name] = f" +- {row[f'{name}_stderr']:.2g}"
    parts = [
        f"omega_n {row['omega_n']:.4g}{errors['omega_n']} rad/s",
        f"damping ratio {row['damping_ratio']:.3g}{errors['damping_ratio']}",
    ]
    for name in ("period", "t_half", "t_double"):
        if np.isfinite(row[name]):
            parts.append(f"{name} {row[name]:.4g} s")
    if row["remark"]:
        parts.append(row["remark"])
    return ", ".join(parts)

"""All characteristics of an aircraft with a database at one condition."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.flying_qualities import lateral, performance
from flightmech.flying_qualities import longitudinal as stability
from flightmech.flying_qualities import longitudinal as trim_curves
from flightmech.flying_qualities import performance as climb
from flightmech.steady_flight.eigenmodes import modes
from flightmech.steady_flight.flight_condition import rows_to_frame
from flightmech.steady_flight.linear_model import linearize
from flightmech.steady_flight.trim_point import Point, trimmed_at
from flightmech.units import from_si

_CURVE_POINTS = 25
_DISPLAY = {"rad": "deg", "rad s-1": "deg/s", "rad s m-1": "deg s m-1"}


@dataclass(frozen=True)
class Characteristics:
    """What `characteristics` found.

    Parameters
    ----------
    table : DataFrame
        Index ``quantity``; columns ``group value units remark absent``: ``absent`` states why a
        value is NaN; ``stderr`` where the standard errors of the database were carried through
        (`aerodb.update.with_standard_errors`). [unit of the value]
    modes : DataFrame
        As from `flightmech.modes`; then with ``omega_n_stderr`` and ``damping_ratio_stderr``.
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

    def report(self) -> str:
        """Return everything but the curves as text, angles in degrees."""
        lines = [f"{self.title}: {self.condition}"]
        for group, part in self.table.groupby("group", sort=False):
            lines += ["", str(group)]
            for name, row in part.iterrows():
                error = f"{_error(row['stderr'], row['units']):12}" if "stderr" in part else ""
                lines.append(
                    f"  {name:24} {_number(row['value'], row['units'])}  "
                    f"{error}{row['absent'] or row['remark']}"
                )
        lines += ["", "modes"]
        for _, row in self.modes.iterrows():
            lines.append(f"  {row['mode']:24} {_mode(row)}")
        return "\n".join(lines)


def characteristics(
    aircraft: Aircraft, db: xr.DataTree, condition: Mapping[str, float]
) -> Characteristics:
    """Return the stability, control and performance quantities of the Smetana program from any
    database.

    Neutral points stick fixed and free, manoeuvre points, elevator and stick force per g, static
    stick-force gradient, trim curves, sideslip gradients, roll rate, minimum control speed, the
    modes, stall, drag polar, glide, climb, ceilings and range figures.  What database or aircraft
    file do not give (hinge moments, gearing, thrust, fuel flow) is absent with the reason in words.

    Parameters
    ----------
    aircraft : Aircraft
        Limits of the controls and ``[control]`` tables are used where they are given.
    db : DataTree
        Terms of the six coefficients; hinge moments ``Ch_e Ch_a Ch_r``, positive as the deflection,
        add the pilot's forces.
    condition : mapping of str to float
        ``{"V": 90.0, "h": 1500.0, "delta_f": 0.35}``: one of ``V mach V_cas V_eas``, and any of ``h
        gamma mass x_cg_b ... delta_T``, inputs and parameters of the simulation. [SI]

    Returns
    -------
    Characteristics

    Raises
    ------
    SchemaError, UnknownName
        Faults of the model or the condition.
    SimulationError
        No steady flight is found at the condition.

    References
    ----------
    .. [LR743] Report LR-743, 1993, section 2.2.
    """
    point = trimmed_at(aircraft, db, condition)
    linear = linearize(point.sim, point.parameters)
    slowest = performance.stall(point)
    looked = performance.level_speeds(point, slowest)
    curve = performance.polar(point)
    rows = [
        *stability.longitudinal_rows(point),
        *trim_curves.speed_stability(point),
        *lateral.sideslip_rows(point),
        *lateral.roll_rate(point),
        *lateral.minimum_control_speed(point, slowest.V),
        *performance.stall_rows(slowest),
        *performance.polar_rows(point, curve),
        *performance.level_rows(point, looked),
        *climb.climb_rows(point, looked),
    ]
    flown = performance.performance_curves(point, looked) if aircraft.engines else xr.Dataset()
    return Characteristics(
        table=rows_to_frame(rows),
        modes=modes(linear),
        linear=linear,
        derivatives=point.derivatives(),
        trim=trim_curves.trim_curves(point, np.linspace(*looked, _CURVE_POINTS)),
        polar=curve,
        performance=flown,
        title=aircraft.name,
        condition=_condition(point),
    )


def _condition(point: Point) -> str:
    words = [
        f"V {point['V']:.4g} m/s (CAS {point['V_cas']:.4g} m/s, Mach {point['mach']:.3f})",
        f"h {point['h']:.5g} m",
        f"mass {point.mass:.5g} kg",
    ]
    words += [
        f"alpha {np.degrees(point['alpha']):.3g} deg",
        f"delta_e {np.degrees(point['applied.delta_e']):.3g} deg",
    ]
    return ", ".join(words)


def _number(value: float, units: str) -> str:
    if np.isnan(value):
        return f"{'-':>10} {'':10}"
    shown = _DISPLAY.get(units, units)
    return (
        f"{value if shown == units else from_si(value, shown):10.4g} "
        f"{'' if shown == '1' else shown:10}"
    )


def _error(stderr: float, units: str) -> str:
    shown = _DISPLAY.get(units, units)
    return (
        "" if np.isnan(stderr) else f"+- {stderr if shown == units else from_si(stderr, shown):.2g}"
    )


def _mode(row: pd.Series) -> str:
    times = [
        f"{name} {row[name]:.4g} s"
        for name in ("period", "t_half", "t_double")
        if np.isfinite(row[name])
    ]
    errors = {
        name: f" +- {row[f'{name}_stderr']:.2g}" if f"{name}_stderr" in row else ""
        for name in ("omega_n", "damping_ratio")
    }
    words = [
        f"omega_n {row['omega_n']:.4g}{errors['omega_n']} rad/s",
        f"damping ratio {row['damping_ratio']:.3g}{errors['damping_ratio']}",
        *times,
    ]
    return ", ".join([*words, *([row["remark"]] if row["remark"] else [])])

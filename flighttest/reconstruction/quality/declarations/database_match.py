"""A-priori database against aircraft file and record: reference quantities, gain of the surfaces."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.store.evaluation import evaluate
from aerodb.store.schema import terms
from flightmech.air import GAMMA, R_AIR, pressure_altitude
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchError
from flightmech.terms import list_model_variables
from flightmech.units import DEGREE
from flighttest.reconstruction.quality.checks.control_response import SIGNIFICANT
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.finding import Finding, iterate_rows

Unchecked = list[tuple[str, str, tuple[str, ...], str]]

_DIFFERENCE = 0.01  # of reference quantities, and of the moment reference point in chords
_GAIN = (0.5, 2.0)  # effect in flight over that of a database, beyond which a unit or gain is wrong
_ZERO = ("delta_", "gear", "speedbrake")  # beginnings of the names of controls
FREE_AIR = 1e3  # m over ground of a flight without radio height
_ROW = ("surface_gain", "gain of the surfaces")


def reference_findings(aircraft: Aircraft, database: xr.DataTree | None) -> list[Finding]:
    """Return the finding on reference quantities of a database that are not the aircraft's.

    Parameters
    ----------
    aircraft : Aircraft
        Its S [m2], cbar, b and moment reference point [m] are read.
    database : DataTree or None
    """
    if database is None:
        return []
    names, parts = [], []
    for name in ("S", "cbar", "b"):
        stated, of_database = getattr(aircraft, name), float(database.attrs[name])
        if abs(of_database / stated - 1.0) > _DIFFERENCE:
            names.append(name)
            parts.append(f"{name} {stated:.5g} and {of_database:.5g}")
    if aircraft.reference is not None:
        axes = zip("xyz", aircraft.reference, strict=True)
        for axis, stated in axes:
            of_database = float(database.attrs.get(f"{axis}_ref", stated))
            if abs(of_database - stated) > _DIFFERENCE * aircraft.cbar:
                names.append("reference")
                parts.append(f"{axis} of the moment reference {stated:.4g} and {of_database:.4g} m")
    if not names:
        return []
    text = f"aircraft file and database are of other reference quantities (SI): {', '.join(parts)}"
    remedy = "correct the aircraft file, or give the database that was built for it"
    unique = tuple(dict.fromkeys(names))
    return [Finding("warning", "geometry", unique, text, remedy)]


def gain_findings(
    answers: pd.DataFrame,
    signals: ResampledChannels,
    aircraft: Aircraft | None,
    database: xr.DataTree | None,
) -> tuple[list[Finding], Unchecked]:
    """Return the findings on the gain of surfaces, and what was not checked.

    Parameters
    ----------
    answers : DataFrame
        Result of `control_responses`.
    signals : ResampledChannels
    aircraft : Aircraft or None
        Mass properties and reference quantities.
    database : DataTree or None
        A-priori database of the aircraft.

    Notes
    -----
    Handbook methods give the effect of a surface to 10 to 30 %. A smaller error of the gain remains
    unknown; both effects are listed.
    """
    shown = [row for row in iterate_rows(answers) if abs(row.ratio) >= SIGNIFICANT]
    if not shown:
        return [], []
    advice = "an error of the gain looks like another effect: calibrate on the ground"
    if aircraft is None or database is None:
        return [], [(*_ROW, (), f"{advice}, or give --aircraft and --database")]
    findings, parts = [], []
    for row in shown:
        expected = _expected_effect(row.surface, signals, aircraft, database)
        if not expected:
            parts.append(
                f"{row.surface}: the record lacks a quantity of the database, or it has none"
            )
            continue
        ratio = row.effect / expected
        stderr = abs(row.stderr / expected)
        measured = (
            f"{row.surface} has {ratio:.2f} (standard error {stderr:.2f}) of the effect of the "
            f"database, {row.effect:+.3g} against {expected:+.3g} 1/s2 per rad"
        )
        if _GAIN[0] <= ratio <= _GAIN[1]:
            parts.append(measured)
            continue
        remedy = f"check unit and scale of {row.surface}, moments of inertia and the database"
        evidence = {"ratio": ratio, "stderr": stderr}
        channels = (row.surface, row.rate)
        findings.append(Finding("warning", "scale", channels, measured, remedy, evidence=evidence))
    if not parts:
        return findings, []
    reason = f"{'; '.join(parts)}: as exact as the database and the moments of inertia; {advice}"
    return findings, [(*_ROW, (), reason)]


def _expected_effect(
    surface: str, signals: ResampledChannels, aircraft: Aircraft, database: xr.DataTree
) -> float:
    """Return the angular acceleration per radian of a surface by the database, zero if unknown.

    It is taken at the medians of the flight, about the c.g. [s-2]
    """
    full = signals.completed(("V", "p_static", "temperature"))
    needs = ("V", "p_static", "temperature", "alpha_vane")
    if not set(needs) <= set(full.values):
        return 0.0
    mask = full.mask(needs)
    if not mask.any():
        return 0.0
    middle: dict[str, Any] = {name: float(np.median(x[mask])) for name, x in full.values.items()}
    middle["alpha"], middle["beta"] = middle["alpha_vane"], 0.0
    middle["mach"] = middle["V"] / np.sqrt(GAMMA * R_AIR * middle["temperature"])
    middle["h"] = float(pressure_altitude(np.clip(middle["p_static"], 1e3, 1.2e5)))
    middle["h_agl"] = middle.get("h_radio", FREE_AIR)
    # controls and rates without a record are zero
    for leaf in terms(database).values():
        for name in list_model_variables(leaf):
            if name.endswith("hat") or name.startswith(_ZERO):
                middle.setdefault(name, 0.0)
    try:
        slopes = _control_slopes(surface, middle, database)
    except AeromatchError:
        return 0.0
    density = middle["p_static"] / (R_AIR * middle["temperature"])
    force = 0.5 * density * middle["V"] ** 2 * aircraft.S
    if surface == "delta_e":
        # moment about the c.g.: lift of the surface at the reference point, ahead by -x
        moment = slopes["Cm"] - aircraft.cg[0] / aircraft.cbar * slopes["CL"]
        return force * aircraft.cbar * moment / aircraft.Iyy
    roll, yaw = slopes["Cl"], slopes["Cn"]
    Ixx, Izz, Ixz = aircraft.Ixx, aircraft.Izz, aircraft.Ixz
    determinant = Ixx * Izz - Ixz**2
    if surface == "delta_a":
        return force * aircraft.b * (Izz * roll + Ixz * yaw) / determinant
    return force * aircraft.b * (Ixz * roll + Ixx * yaw) / determinant


def _control_slopes(
    surface: str, middle: dict[str, Any], database: xr.DataTree
) -> dict[str, float]:
    """Return the derivatives of the coefficients with respect to a surface. [1/rad]"""
    slopes = {}
    held = {term.split("/")[0] for term in terms(database)}
    names = ("Cm", "CL") if surface == "delta_e" else ("Cl", "Cn")
    for name in names:
        if name not in held:
            slopes[name] = 0.0
            continue
        sides = []
        for step in (-DEGREE, DEGREE):
            state = {**middle, surface: middle.get(surface, 0.0) + step}
            sides.append(float(np.squeeze(evaluate(database, name, "clamp", **state))))
        slopes[name] = (sides[1] - sides[0]) / (2.0 * DEGREE)
    return slopes

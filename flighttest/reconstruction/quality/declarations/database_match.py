"""A-priori database against aircraft file and record: reference quantities, gain of surfaces."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchError
from flighttest.reconstruction.quality.checks.control_response import SIGNIFICANT, effect_in
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.declarations.database_acceleration import (
    database_accelerations,
    has_effect,
    recorded_air,
)
from flighttest.reconstruction.quality.finding import Finding, iterate_rows

Unchecked = list[tuple[str, str, tuple[str, ...], str]]

_DIFFERENCE = 0.01  # of reference quantities, and of the moment reference point in chords
_GAIN = (0.5, 2.0)  # effect in flight over that of a database, beyond which a unit or gain is wrong
# Error of the ratio without an error of the gain: 1.00 to 1.04, and 0.97, on four T-37 records with
# the database that was identified from them.
_METHOD = 0.03
_SIGMAS = 2.0  # standard errors beyond the limits
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
    text = f"aircraft file and database differ in reference quantities (SI): {', '.join(parts)}"
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
    The database gives an angular acceleration for the recorded motion.  It goes through the filters
    and the regression of the recorded one, so that their attenuation and the correlation with the
    rates drop out of the ratio; both effects are smaller than those of a slow input.  Handbook
    methods give the effect of a surface to 10 to 30 %, and that of an elevator or aileron of a
    light aeroplane to a factor of 2.  The standard error has the part of the motion that the
    equation does not explain.  A smaller error of the gain remains unknown; both effects are
    listed.
    """
    shown = [row for row in iterate_rows(answers) if abs(row.ratio) >= SIGNIFICANT]
    if not shown:
        return [], []
    advice = "the motion alone does not give the gain of a surface: calibrate it on the ground"
    if aircraft is None or database is None:
        return [], [(*_ROW, (), f"{advice}, or give --aircraft and --database")]
    try:
        full = recorded_air(signals)
        accelerations = database_accelerations(full, aircraft, database)
    except AeromatchError as error:
        return [], [(*_ROW, (), f"the database cannot be evaluated: {error}; {advice}")]
    findings, parts = [], []
    for row in shown:
        if not has_effect(database, row.surface):
            parts.append(f"{row.surface}: the database has no effect of it")
            continue
        expected = effect_in(accelerations[row.rate], row.surface, signals, full.flying)
        if not expected:
            parts.append(
                f"{row.surface}: the samples with airspeed, air and angle of attack do not give "
                f"its effect in the database"
            )
            continue
        ratio = row.effect / expected
        # motion that the equation does not explain, a late or disturbed flow angle, may move with
        # the surface: it changes the effect by up to its own share
        unexplained = np.sqrt(max(0.0, 1.0 - row.R2))
        spread = np.hypot(_METHOD, unexplained) * abs(ratio)
        stderr = float(np.hypot(row.stderr / expected, spread))
        measured = (
            f"{row.surface} has {ratio:.2f} (standard error {stderr:.2f}) of the effect of the "
            f"database, {row.effect:+.3g} against {expected:+.3g} 1/s2 per rad in the filters of "
            f"this check"
        )
        if _GAIN[0] - _SIGMAS * stderr <= ratio <= _GAIN[1] + _SIGMAS * stderr:
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

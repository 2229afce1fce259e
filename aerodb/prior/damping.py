"""Effects of the angular rates, without the printed derivatives that are suspect.

A suspect pitch damping is replaced by the tail's share, which the page itself contains: CMAD over
the slope of the downwash (`datcom_io.reading.damping`), and by that of the wing from its planform.
At supersonic speed strips of the planforms take its place.  A suspect subsonic roll damping is
replaced by that of lifting-line theory (`datcom_io.reading.attached_flow`), times the lift slope
over that of attached flow as in the method of the program.  The standard error is twice that of a
printed one.  Other suspect numbers count as not printed.

CMAD over CLAD is the arm of the tail in chords, and so is D(CM) over D(CL) of an elevator: 0.79 to
1.02 of it on sound listings, 0.11 to 0.27 on a public one whose run carries D(CM) on from its
flaps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

import datcom_io
from aerodb.prior.sources import Source, drop_empty_tables, warn_user
from aerodb.store.effects import Effect, join_sentences
from datcom_io.reading.attached_flow import SUBSONIC, estimate_wing_slopes
from datcom_io.reading.damping import estimate_supersonic_damping, estimate_tail_share
from datcom_io.reading.wing_damping import estimate_wing_share
from datcom_io.reading.wing_scales import scale_by_wing
from flightmech.units import DEGREE

_SUSPECT = datcom_io.FLAGS.index("suspect")
_LINEAR = 6.0 * DEGREE  # range of attached flow [rad]
_SUPERSONIC = 1.0  # from here on CLAD and CMAD contain those of the wing
# Moment of an elevator over that of its lift at the arm of the tail.
_ARM = (0.7, 1.3)


def rate_effect(clean: Source, variable: str, coefficients: Sequence[str], h_ref: float) -> Effect:
    """Return the effect of a rate from the dynamic pages.

    Parameters
    ----------
    clean : Source
        The whole aeroplane with dynamic pages.
    variable : str
        ``qhat``, ``alphadothat``, ``phat`` or ``rhat``.
    coefficients : sequence of str
    h_ref : float
        Altitude of the basic tables. [m]

    Warns
    -----
    AeromatchWarning
        Suspect numbers were replaced or left out.
    """
    grid = clean.grid("dynamic").sel(h=h_ref, drop=True)
    tables, judged, notes = {}, {}, []
    for coefficient in coefficients:
        name = f"{coefficient}_{variable}"
        table = grid[name]
        is_suspect = xr.zeros_like(table, bool)
        if f"{name}_flag" in grid:
            is_suspect = grid[f"{name}_flag"] == _SUSPECT
        if bool(is_suspect.any()):
            printed = table.where(is_suspect)
            table = table.where(~is_suspect)
            share = None
            if variable == "qhat":
                share = _estimate_pitch_rate(clean, grid, name, h_ref)
            elif name == "Cl_phat":
                share = _estimate_roll_rate(clean, grid, h_ref)
            if share is not None:
                judged[coefficient] = is_suspect & share.notnull()
                table = table.where(~is_suspect, share)
                share = share.where(is_suspect)
            notes.append(_describe(name, printed, share))
        tables[coefficient] = table
    for note in notes:
        warn_user(f"{clean.role}: {note}")
    return Effect(
        variable,
        drop_empty_tables(tables),
        variable,
        judged=judged,
        references=clean.place("dynamic"),
        comment=join_sentences(*notes),
    )


def _estimate_pitch_rate(
    clean: Source, grid: xr.Dataset, name: str, h_ref: float
) -> xr.DataArray | None:
    """Return CLQ or CMQ of tail and wing over mach, None where neither can be estimated."""
    has_tail = "HORIZONTAL" in clean.configuration
    if has_tail and not clean.has("downwash"):
        return None
    alpha = grid["alpha"].values / DEGREE
    # Slope of the downwash on the nodes of the grid, NaN where it is not printed.
    if has_tail:
        slope = clean.grid("downwash").sel(h=h_ref, method="nearest", drop=True)["epsilon_alpha"]
        slope = slope.reindex(
            mach=grid["mach"], alpha=grid["alpha"], method="nearest", tolerance=1e-6
        )
    estimates = []
    for mach in grid["mach"].values:
        wing: dict[str, float] = {}
        # The shares of tail and wing hold at subsonic speed only.
        if clean.decks and mach >= _SUPERSONIC:
            damping = np.nan
            if name == "Cm_qhat":
                damping = estimate_supersonic_damping(clean.decks[0], mach, has_tail)
            estimates.append(damping)
            continue
        if clean.decks:
            wing = estimate_wing_share(clean.decks[0], mach)
        if not has_tail:
            estimates.append(wing.get(name, np.nan))
            continue
        row = grid.sel(mach=mach)
        derivatives = {
            key: row[key].transpose("alpha").values for key in ("CL_alphadothat", "Cm_alphadothat")
        }
        scales = None
        if clean.decks:
            scales = scale_by_wing(clean.decks[0])
        tail = estimate_tail_share(
            derivatives, alpha, slope.sel(mach=mach).values, mach, scales=scales
        )
        estimates.append(tail.get(name, np.nan) + wing.get(name, 0.0))
    values = xr.DataArray(estimates, {"mach": grid["mach"].values}, "mach")
    return values.broadcast_like(grid[name])


def _estimate_roll_rate(clean: Source, grid: xr.Dataset, h_ref: float) -> xr.DataArray | None:
    """Return CLP of the wing over mach and alpha, None without its planform cards."""
    if not clean.decks or not clean.has("static"):
        return None
    static = clean.grid("static").sel(h=h_ref, method="nearest", drop=True)
    slope = static["CL_alpha"]
    if "CL_alpha_flag" in static:
        slope = slope.where(static["CL_alpha_flag"] != _SUSPECT)
    slope = slope.reindex(mach=grid["mach"], alpha=grid["alpha"], method="nearest", tolerance=1e-6)
    # The program multiplies the damping of attached flow by the lift slope over its first value.
    attached = slope.where(np.abs(slope["alpha"]) <= _LINEAR).median("alpha")
    ratio = (slope / attached.where(attached > 0.0)).fillna(1.0)
    damping = []
    for mach in grid["mach"].values:
        slopes = None
        if mach <= SUBSONIC:
            slopes = estimate_wing_slopes(clean.decks[0], mach)
        damping.append(np.nan if slopes is None else slopes.roll)
    values = xr.DataArray(damping, {"mach": grid["mach"].values}, "mach")
    return (values * ratio).broadcast_like(grid["Cl_phat"]).transpose(*grid["Cl_phat"].dims)


def _describe(name: str, printed: xr.DataArray, share: xr.DataArray | None) -> str:
    """Return a sentence on the suspect numbers of a derivative and what takes their place."""
    lowest, highest = float(printed.min()), float(printed.max())
    values = f"{lowest:.4g}"
    if highest != lowest:
        values += f" to {highest:.4g}"
    text = f"{name} of the print is suspect in sign or size ({values} per radian)"
    if share is None or not bool(share.notnull().any()):
        return f"{text} and is not used; the nearest printed number holds, or the term is absent"
    if name == "Cl_phat":
        return (
            f"{text}; lifting-line theory of the planform, {float(share.min()):.4g} to "
            f"{float(share.max()):.4g} with the printed lift slope, takes its place with twice the "
            f"standard error"
        )
    return (
        f"{text}; the shares of the tail by alpha-dot and downwash and of the wing by its planform "
        f"(at supersonic speed strips of both), "
        f"{float(share.mean()):.4g}, take its place with twice the standard error"
    )


def with_tail_arm(effect: Effect, clean: Source, h_ref: float) -> Effect:
    """Return an elevator whose moment fits its lift at the arm of the tail.

    Parameters
    ----------
    effect : Effect
        Increments CL and Cm over ``mach`` and ``delta_e``.
    clean : Source
        The whole aeroplane; without dynamic pages the arm is unknown, and nothing changes.
    h_ref : float
        Altitude of the basic tables. [m]

    Warns
    -----
    AeromatchWarning
        The moment at some Mach numbers was replaced by lift times arm.
    """
    CL, Cm = effect.tables.get("CL"), effect.tables.get("Cm")
    if CL is None or Cm is None or not clean.has("dynamic"):
        return effect
    if not {"mach", "delta_e"} <= set(Cm.dims):
        return effect
    arm = _tail_arm(clean, h_ref).reindex(mach=Cm["mach"], method="nearest")
    both = CL * Cm
    slope = both.sum("delta_e", min_count=1) / (CL**2).where(Cm.notnull()).sum("delta_e")
    ratio = slope / arm
    is_off = (ratio < _ARM[0]) | (ratio > _ARM[1])
    if not bool(is_off.any()):
        return effect
    # Where nothing is printed, the neighbour that holds there is wrong, too.
    is_off = (is_off | slope.isnull()) & arm.notnull()
    is_replaced = is_off & CL.notnull()
    printed = " ".join(f"{float(value):.2g}" for value in ratio.where(is_off).dropna("mach"))
    text = (
        f"D(CM) of the elevator is {printed} times the moment of its lift at the arm of the tail "
        f"by CMAD and CLAD: the run carries it on from deflections before; lift times arm takes "
        f"its place with twice the standard error. Run the elevator alone, one condition a run"
    )
    warn_user(f"elevator: {text}")
    tables = {**effect.tables, "Cm": Cm.where(~is_replaced, CL * arm).transpose(*Cm.dims)}
    judged = {**effect.judged, "Cm": is_replaced.transpose(*Cm.dims)}
    comment = join_sentences(effect.comment, text)
    return replace(effect, tables=tables, judged=judged, comment=comment)


def _tail_arm(clean: Source, h_ref: float) -> xr.DataArray:
    """Return CMAD over CLAD over mach, NaN where they do not state the arm of the tail. [chords]"""
    grid = clean.grid("dynamic").sel(h=h_ref, drop=True)
    lift, moment = grid["CL_alphadothat"], grid["Cm_alphadothat"]
    is_sound = (lift > 0.0) & (moment < 0.0) & (np.abs(grid["alpha"]) <= _LINEAR)
    arm = (moment / lift).where(is_sound).median("alpha")
    return arm.where(grid["mach"] < _SUPERSONIC)

"""Roll controls other than ailerons, and the all-movable stabilizer."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.units import DEGREE

from ..transform.effects import Effect, joined
from .increments import at_height, from_zero
from .sources import Source, known, warn

_LINEAR = 6.0 * DEGREE  # range of the tail's angle of attack over which its lift slope is taken


def spoilers(given: Source, h_ref: float) -> Effect:
    """Return the effect of ``delta_s`` on Cl and Cn, in stability axes.

    Notes
    -----
    The program prints a positive rolling and a positive yawing moment [DATCOM 6.2]: the wing with the spoiler goes down
    and back, which is the right wing.  A spoiler on the left, positive ``delta_s``, gives the negative moments.
    """
    grid, page = at_height(given.grid("spoiler"), h_ref), given.tree.children["spoiler"].to_dataset(inherit=False)
    if "ds_c" not in page.coords:
        raise SchemaError(given.role, ["the page names no spoiler height DS/C; give one with it"])
    height = np.asarray(page["ds_c"].values, float)
    if np.unique(height).size != height.size or (height < 0).any():
        raise SchemaError(given.role, [f"the spoiler heights {height.tolist()} are not different and positive"])
    grid = grid.drop_vars("ds_c", errors="ignore").assign_coords(deflection=height).rename(deflection="delta_s").sortby("delta_s")
    tables = known({c: grid[c] for c in ("Cl", "Cn")})
    stale = float(np.abs(tables["Cl"].sel(delta_s=0.0)).max()) if (height == 0.0).any() else 0.0
    if stale > 0.0:
        warn(
            f"{given.role}: Cl {stale:.4g} is printed for a spoiler of no height: below some height the program's chart holds its end; "
            "no height counts as no moment, and small heights are as printed"
        )
    note = f"{page.attrs.get('device', 'spoiler')}, wing-body, constant in alpha along stability axes"
    both = {c: _both_sides(table) for c, table in tables.items()}
    return Effect("spoiler", both, zeros={"delta_s": [0.0]}, references=given.place("spoiler"), comment=note)


def differential_tail(given: Source, h_ref: float) -> Effect:
    """Return the effect of ``delta_d`` = (right - left)/2 of the stabilizer halves on Cl, in stability axes; Cn has no method."""
    grid = at_height(given.grid("asyflp"), h_ref)
    if grid.attrs.get("surface") != "tail":
        raise SchemaError(given.role, ["the deflected surface is the wing, the tail is needed (STYPE 5); ailerons go to aileron="])
    delta = (
        0.5 * (grid["delta_right"] - grid["delta_left"]).values if "delta_left" in grid.coords else -0.5 * grid["delta_difference"].values
    )
    if np.unique(delta).size != delta.size:
        raise SchemaError(given.role, ["two pairs of deflections have the same (right - left); give pairs that differ in it"])
    Cl, note = grid["Cl"], ""
    if "Cl_transonic" in grid:
        flat = Cl.isnull().all([d for d in Cl.dims if d != "mach"]) & grid["Cl_transonic"].notnull()
        Cl = xr.where(flat, grid["Cl_transonic"], Cl)
        if bool(flat.any()):
            machs = " ".join(f"{mach:g}" for mach in flat["mach"].values[flat.any("delta_pair").values])
            note = f"mach {machs}: the page prints one value for all alphas"
    drop = [name for name in Cl.coords if name not in Cl.dims]
    Cl = Cl.drop_vars(drop).assign_coords(delta_pair=delta).rename(delta_pair="delta_d").sortby("delta_d")
    return Effect(
        "differential_tail", {"Cl": from_zero(Cl, "delta_d")}, zeros={"delta_d": [0.0]}, references=given.place("asyflp"), comment=note
    )


def stabilizer(given: Source, h_ref: float) -> Effect:
    """Return the effect of an all-movable stabilizer, as ``delta_e`` from its rigged incidence, on CL and Cm.

    Notes
    -----
    The page of trim with a stabilizer gives the tail alone: its lift over alpha without downwash, and lift, moment and incidence where
    the aeroplane trims.  With eta = q_H/q of the downwash table

        CL_delta_e = eta dCL_tail/dalpha,      Cm_delta_e = CL_delta_e x (Cm_tail / CL_tail at trim)

    which gives CL_tail at trim back as CL_delta_e (alpha - epsilon + i) within the rounding of the incidence.  Range: the linear one.
    """
    page, downwash = (at_height(given.grid(leaf), h_ref) for leaf in ("trim_stabilizer", "downwash"))
    near = page.sel(alpha=np.abs(page["alpha"]) <= _LINEAR)
    slope = near["CL_tail"].polyfit("alpha", 1)["polyfit_coefficients"].sel(degree=1, drop=True)
    eta = downwash["q_ratio"].sel(alpha=near["alpha"], method="nearest").mean("alpha")
    lift, moment = page["CL_tail_trim"], page["Cm_tail_trim"]
    arm = (lift * moment).sum("alpha") / (lift**2).where(moment.notnull()).sum("alpha")
    tables = known({"CL": eta * slope, "Cm": eta * slope * arm})
    if set(tables) != {"CL", "Cm"}:
        warn(f"{given.role}: the page of stabilizer trim holds no lift and moment of the tail at trim; the terms are left absent")
        return Effect("elevator", {})
    comment = joined(
        "all-movable stabilizer: delta_e is its incidence less the rigged one, trailing edge down",
        "eta times lift slope of the tail alone, arm by lift and moment at trim; linear range",
    )
    return Effect(
        "elevator",
        tables,
        "delta_e",
        judged={c: table.notnull() for c, table in tables.items()},
        references=given.place("trim_stabilizer"),
        comment=comment,
    )


def _both_sides(table: xr.DataArray) -> xr.DataArray:
    """Return a table for spoilers on the left (positive) and on the right (negative), from that of the right wing."""
    right = table.where(table["delta_s"] != 0.0, 0.0 * table) if bool((table["delta_s"] == 0.0).any()) else from_zero(table, "delta_s")
    up = right.sel(delta_s=right["delta_s"] > 0.0)
    mirrored = up.assign_coords(delta_s=-up["delta_s"]).sortby("delta_s")
    return xr.concat([mirrored, -right], "delta_s")

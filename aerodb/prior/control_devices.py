"""Hinge moments from SYMFLP pages and control-tab streams, for the loading of the controls.

A hinge-moment coefficient is referred to qbar and twice the moment of the control's area about its
hinge line [DATCOM 6.1.6], both sides together: S_hinge c_hinge of the aircraft file.  Positive
turns the trailing edge as a positive deflection does, so a control that blows back has negative
slopes.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from aerodb.prior.increments import at_height, exact_zero, from_zero
from aerodb.prior.sources import Source, drop_empty_tables, warn_user
from aerodb.store.effects import Effect, join_sentences
from flightmech.errors import SchemaError
from flightmech.units import DEGREE

_LINEAR = 6.0 * DEGREE  # range of the tail's angle of attack over which its lift slope is taken


def spoiler_effect(given: Source, h_ref: float) -> Effect:
    """Return the effect of ``delta_s`` on Cl and Cn, in stability axes.

    Notes
    -----
    The program prints a positive rolling and a positive yawing moment [DATCOM 6.2]: the wing with the spoiler goes down
    and back, which is the right wing.  A spoiler on the left, positive ``delta_s``, gives the negative moments.
    """
    grid, page = (
        at_height(given.grid("spoiler"), h_ref),
        given.tree.children["spoiler"].to_dataset(inherit=False),
    )
    if "ds_c" not in page.coords:
        raise SchemaError(given.role, ["the page names no spoiler height DS/C; give one with it"])
    height = np.asarray(page["ds_c"].values, float)
    if np.unique(height).size != height.size or (height < 0).any():
        raise SchemaError(
            given.role, [f"the spoiler heights {height.tolist()} are not different and positive"]
        )
    grid = (
        grid.drop_vars("ds_c", errors="ignore")
        .assign_coords(deflection=height)
        .rename(deflection="delta_s")
        .sortby("delta_s")
    )
    tables = drop_empty_tables({c: grid[c] for c in ("Cl", "Cn")})
    stale = float(np.abs(tables["Cl"].sel(delta_s=0.0)).max()) if (height == 0.0).any() else 0.0
    if stale > 0.0:
        warn_user(
            f"{given.role}: Cl {stale:.4g} is printed for a spoiler of no height: below some "
            f"height the program's chart holds its end; "
            "no height counts as no moment, and small heights are as printed"
        )
    note = (
        f"{page.attrs.get('device', 'spoiler')}, wing-body, constant in alpha along stability axes"
    )
    both = {c: _both_sides(table) for c, table in tables.items()}
    return Effect(
        "spoiler", both, zeros={"delta_s": [0.0]}, references=given.place("spoiler"), comment=note
    )


def differential_tail(given: Source, h_ref: float) -> Effect:
    """Return the effect of ``delta_d`` = (right - left)/2 of the stabilizer halves on Cl, in
    stability axes; Cn has no method.
    """
    grid = at_height(given.grid("asyflp"), h_ref)
    if grid.attrs.get("surface") != "tail":
        raise SchemaError(
            given.role,
            [
                "the deflected surface is the wing, the tail is needed (STYPE 5); ailerons "
                "go to aileron="
            ],
        )
    delta = (
        0.5 * (grid["delta_right"] - grid["delta_left"]).values
        if "delta_left" in grid.coords
        else -0.5 * grid["delta_difference"].values
    )
    if np.unique(delta).size != delta.size:
        raise SchemaError(
            given.role,
            ["two pairs of deflections have the same (right - left); give pairs that differ in it"],
        )
    Cl, note = grid["Cl"], ""
    if "Cl_transonic" in grid:
        flat = Cl.isnull().all([d for d in Cl.dims if d != "mach"]) & grid["Cl_transonic"].notnull()
        Cl = xr.where(flat, grid["Cl_transonic"], Cl)
        if bool(flat.any()):
            machs = " ".join(
                f"{mach:g}" for mach in flat["mach"].values[flat.any("delta_pair").values]
            )
            note = f"mach {machs}: the page prints one value for all alphas"
    drop = [name for name in Cl.coords if name not in Cl.dims]
    Cl = (
        Cl.drop_vars(drop)
        .assign_coords(delta_pair=delta)
        .rename(delta_pair="delta_d")
        .sortby("delta_d")
    )
    return Effect(
        "differential_tail",
        {"Cl": from_zero(Cl, "delta_d")},
        zeros={"delta_d": [0.0]},
        references=given.place("asyflp"),
        comment=note,
    )


def stabilizer_effect(given: Source, h_ref: float) -> Effect:
    """Return the effect of an all-movable stabilizer, as ``delta_e`` from its rigged incidence, on
    CL and Cm.

    Notes
    -----
    The page of trim with a stabilizer gives the tail alone: its lift over alpha without downwash, and lift, moment and incidence where
    the aeroplane trims.  With eta = q_H/q of the downwash table

        CL_delta_e = eta dCL_tail/dalpha,      Cm_delta_e = CL_delta_e x (Cm_tail / CL_tail at trim)

    which gives CL_tail at trim back as CL_delta_e (alpha - epsilon + i) within the rounding of the
    incidence.  Range: the linear one.
    """
    page, downwash = (
        at_height(given.grid(leaf), h_ref) for leaf in ("trim_stabilizer", "downwash")
    )
    near = page.sel(alpha=np.abs(page["alpha"]) <= _LINEAR)
    slope = near["CL_tail"].polyfit("alpha", 1)["polyfit_coefficients"].sel(degree=1, drop=True)
    eta = downwash["q_ratio"].sel(alpha=near["alpha"], method="nearest").mean("alpha")
    lift, moment = page["CL_tail_trim"], page["Cm_tail_trim"]
    arm = (lift * moment).sum("alpha") / (lift**2).where(moment.notnull()).sum("alpha")
    tables = drop_empty_tables({"CL": eta * slope, "Cm": eta * slope * arm})
    if set(tables) != {"CL", "Cm"}:
        warn_user(
            f"{given.role}: the page of stabilizer trim holds no lift and moment of the tail "
            f"at trim; the terms are left absent"
        )
        return Effect("elevator", {})
    comment = join_sentences(
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
    """Return a table for spoilers on the left (positive) and on the right (negative), from that of
    the right wing.
    """
    right = (
        table.where(table["delta_s"] != 0.0, 0.0 * table)
        if bool((table["delta_s"] == 0.0).any())
        else from_zero(table, "delta_s")
    )
    up = right.sel(delta_s=right["delta_s"] > 0.0)
    mirrored = up.assign_coords(delta_s=-up["delta_s"]).sortby("delta_s")
    return xr.concat([mirrored, -right], "delta_s")


_AGREE = 0.02  # two ratios of streams printed with three digits


def elevator_hinge(given: Source, clean: Source, h_ref: float) -> list[Effect]:
    """Return the effects ``alpha`` and ``delta`` on Ch_e from SYMFLP pages of the tail.

    Notes
    -----
    (CH)A is per angle of attack of the tail, so the table over the aeroplane's alpha is (CH)A (alpha - epsilon + i_H), with the downwash
    of the listing and the incidence of its cards.  The dynamic pressure at the tail counts as that of the flight.
    """
    grid = at_height(given.grid("symflp"), h_ref)
    lines, found = given.place("symflp"), _deflection("Ch_e", grid, "delta_e", given)
    slope = _slope("Ch_e", grid)
    if not slope:
        return found
    place = next(
        (source for source in (given, clean) if source.has("downwash") and source.decks), None
    )
    if place is None:
        warn_user(
            f"{given.role}: (CH)A is per angle of attack of the tail, and no listing with "
            f"downwash is at hand; Ch_e/alpha is left absent"
        )
        return found
    epsilon = at_height(place.grid("downwash"), h_ref)["epsilon"]
    epsilon = (
        epsilon.interp(mach=slope["Ch_e"]["mach"])
        if place is clean and epsilon.sizes["mach"] > 1
        else epsilon
    )
    i_H = place.card("SYNTHS", "ALIH", 0.0) * DEGREE
    table = slope["Ch_e"] * (epsilon["alpha"] - epsilon + i_H)
    comment = f"(CH)A times the angle of attack of the tail, alpha - epsilon + {i_H / DEGREE:g} deg"
    return [
        Effect(
            "alpha", {"Ch_e": table.transpose("mach", "alpha")}, references=lines, comment=comment
        ),
        *found,
    ]


def aileron_hinge(given: Source, h_ref: float) -> list[Effect]:
    """Return the effects ``alpha`` and ``delta`` on Ch_a of one aileron, from SYMFLP pages of the
    wing with the aileron's geometry.
    """
    grid = at_height(given.grid("symflp"), h_ref)
    if grid.attrs.get("surface") != "wing":
        raise SchemaError(
            given.role,
            [
                "the deflected surface is the tail, the wing is needed: run the aileron as a "
                "SYMFLP without tail"
            ],
        )
    slope = _slope("Ch_a", grid)
    comment = (
        "one aileron; equal on both sides, so that it cancels at the wheel unless the "
        "aeroplane rolls"
    )
    found = _deflection("Ch_a", grid, "delta_a", given)
    return (
        [Effect("alpha", slope, "alpha", references=given.place("symflp"), comment=comment), *found]
        if slope
        else found
    )


def tab_effects(given: Source, h_ref: float, with_page: bool) -> list[Effect]:
    """Return the effects ``tab`` and ``tab_gearing`` on Ch_e, and ``alpha`` and ``delta`` unless a
    SYMFLP page gives them.

    Parameters
    ----------
    with_page : bool
        The terms ``alpha`` and ``delta`` come from the SYMFLP page already.

    Notes
    -----
    The streams are planes in alpha and deflection made of the engineer's own B1 to B4, D1 to D3 [routine CTABS]:

        locked = B1 delta + B3 alpha,      gearing = (...) delta + (...) alpha,      tab for no stick force = -locked / B4 (trim tab alone)

    With a control tab too the program prints +free / B4, and the stream of the free tab holds B1 +
    D1 B2 / D2 where a tab without moment requires B1 - D1 B2 / D2: faults of sign.  So the free tab
    is not used.
    """
    grid = at_height(given.grid("tabs"), h_ref).isel(mach=0)
    planes = {
        name: _plane(grid[name], grid["one_decimal"])
        for name in grid.data_vars
        if str(name).startswith(("Ch_", "delta_"))
    }
    lines = _lines(given)
    found = []
    tab = _tab_effect(planes)
    if np.isfinite(tab):
        comment = (
            "per deflection of the trim tab; the engineer's own B4 of CONTAB, from hinge "
            "moment over tab for no stick force"
        )
        found.append(
            Effect("tab", {"Ch_e": xr.DataArray(tab)}, "delta_t", references=lines, comment=comment)
        )
    else:
        warn_user(
            f"{given.role}: hinge moment and tab for no stick force do not fit each other; "
            f"Ch_e/tab is left absent"
        )
    per_alpha, per_delta = planes.get("Ch_tab_gearing", (np.nan, np.nan))
    if np.isfinite(per_delta) and abs(per_delta) > 1e-6:
        surface = (per_alpha * grid["alpha"] + per_delta * grid["delta"]).rename(delta="delta_e")
        comment = "moment of the geared tab on the control; plane through the printed stream"
        found.append(
            Effect(
                "tab_gearing",
                {"Ch_e": surface.drop_vars(["mach"], errors="ignore")},
                references=lines,
                comment=comment,
            )
        )
    locked = planes.get("Ch_tab_locked", (np.nan, np.nan))
    if not with_page and np.isfinite(locked).all():
        comment = (
            "tab locked; the engineer's own B1 and B3 of CONTAB, angle of attack of the aeroplane"
        )
        for name, value, regressor in (
            ("alpha", locked[0], "alpha"),
            ("delta", locked[1], "delta_e"),
        ):
            found.append(
                Effect(
                    name,
                    {"Ch_e": xr.DataArray(value)},
                    regressor,
                    references=lines,
                    comment=comment,
                )
            )
    return found


def _deflection(coefficient: str, grid: xr.Dataset, axis: str, given: Source) -> list[Effect]:
    """Return the effect ``delta``: (CH)D times the deflection, whose slope the program takes from
    zero.
    """
    slope = drop_empty_tables(
        {coefficient: grid["Ch_delta"].rename(delta=axis)} if "Ch_delta" in grid else {}
    )
    if not slope:
        return []
    table = slope[coefficient] * slope[coefficient][axis]
    table = exact_zero(table, axis) if bool((table[axis] == 0.0).any()) else from_zero(table, axis)
    return [
        Effect(
            "delta",
            {coefficient: table.sortby(axis)},
            zeros={axis: [0.0]},
            references=given.place("symflp"),
            comment="(CH)D times delta",
        )
    ]


def _slope(coefficient: str, grid: xr.Dataset) -> dict[str, xr.DataArray]:
    """Return (CH)A, which is printed once for all deflections."""
    at = int(np.argmin(np.abs(grid["delta"].values)))
    return drop_empty_tables(
        {coefficient: grid["Ch_alpha"].isel(delta=at, drop=True)} if "Ch_alpha" in grid else {}
    )


def _plane(stream: xr.DataArray, one_decimal: xr.DataArray) -> tuple[float, float]:
    """Return the slopes of a stream per alpha and per deflection [1/rad], by the values printed
    with three digits.
    """
    alpha, delta, rough = xr.broadcast(stream["alpha"], stream["delta"], one_decimal)
    good = (rough == 0) & stream.transpose(*alpha.dims).notnull()
    if int(good.sum()) < 3:
        return np.nan, np.nan
    A = np.column_stack([alpha.values[good.values], delta.values[good.values]])
    slopes, *_ = np.linalg.lstsq(A, stream.transpose(*alpha.dims).values[good.values], rcond=None)
    return float(slopes[0]), float(slopes[1])


def _tab_effect(planes: dict) -> float:
    """Return B4 [1/rad] from the tab for no stick force and the hinge moment it balances, NaN where
    they do not fit.
    """
    free_of_force = np.array(planes.get("delta_tab_trim", (np.nan, np.nan)))
    for name, sign in (
        ("Ch_tab_locked", -1.0),
        ("Ch_tab_free", 1.0),
    ):  # trim tab alone; with a control tab
        ratios = sign * np.array(planes.get(name, (np.nan, np.nan))) / free_of_force
        if (
            np.isfinite(ratios).all()
            and abs(ratios[0] - ratios[1]) <= _AGREE * np.abs(ratios).max()
        ):
            return float(ratios[1])
    return float("nan")


def _lines(given: Source) -> str:
    coords = given.tree["tabs"].coords
    ends = [
        int(end)
        for name in coords
        if str(name).startswith("lines_")
        for text in coords[name].values.ravel()
        for end in str(text).split("-")
        if end.isdigit()
    ]
    return f"{given.file}, lines {min(ends)}-{max(ends)}" if ends else given.file

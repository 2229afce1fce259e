"""Effects of spoilers, differential tail and stabilizer, and hinge moments of the controls.

A hinge-moment coefficient is referred to qbar and twice the moment of the control's area about its
hinge line [DATCOM 6.1.6], both sides together: S_hinge c_hinge of the aircraft file.  A positive
hinge moment turns the trailing edge in the direction of a positive deflection.  A control that
blows back therefore has negative slopes.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from aerodb.prior.increments import at_height, exact_zero, from_zero, with_mirror_image
from aerodb.prior.sources import Source, drop_empty_tables, warn_user
from aerodb.store.effects import Effect, join_sentences
from flightmech.errors import SchemaError
from flightmech.units import DEGREE

_LINEAR = 6.0 * DEGREE  # largest angle of attack for the lift slope of the tail
_AGREE = 0.02  # relative difference of two equal ratios of streams printed with three digits
_LEAST_SLOPE = 1e-6  # slope of the geared tab, below which it is zero within rounding [1/rad]
_NO_PLANE = (np.nan, np.nan)


def spoiler_effect(given: Source, h_ref: float) -> Effect:
    """Return the effect of ``delta_s`` on Cl and Cn, in stability axes.

    Notes
    -----
    The program prints a positive rolling and a positive yawing moment [DATCOM 6.2]: the wing with
    the spoiler moves down and back, and it is the right wing.  A spoiler on the left, positive
    ``delta_s``, gives the negative moments.
    """
    grid = at_height(given.grid("spoiler"), h_ref)
    page = given.tree.children["spoiler"].to_dataset(inherit=False)
    if "ds_c" not in page.coords:
        raise SchemaError(given.role, ["the page names no spoiler height DS/C; give one with it"])
    # Heights of the spoiler over the chord are the axis delta_s.
    height = np.asarray(page["ds_c"].values, float)
    if np.unique(height).size != height.size or (height < 0).any():
        raise SchemaError(
            given.role, [f"the spoiler heights {height.tolist()} are not different and positive"]
        )
    grid = grid.drop_vars("ds_c", errors="ignore").assign_coords(deflection=height)
    grid = grid.rename(deflection="delta_s").sortby("delta_s")
    tables = drop_empty_tables({"Cl": grid["Cl"], "Cn": grid["Cn"]})
    moment_at_zero = 0.0
    if (height == 0.0).any():
        moment_at_zero = float(np.abs(tables["Cl"].sel(delta_s=0.0)).max())
    if moment_at_zero > 0.0:
        warn_user(
            f"{given.role}: Cl {moment_at_zero:.4g} is printed for a spoiler of no height: below "
            f"some height the program's chart holds its end; "
            "no height counts as no moment, and small heights are as printed"
        )
    elif held := _heights_of_one_moment(tables.get("Cl")):
        warn_user(
            f"{given.role}: the same Cl is printed for the spoiler heights DS/C {held}: the chart "
            f"of the program holds its end there; smaller heights are too effective"
        )
    device = page.attrs.get("device", "spoiler")
    note = f"{device}, wing-body, constant in alpha along stability axes"
    return Effect(
        "spoiler",
        {name: _both_sides(table) for name, table in tables.items()},
        zeros={"delta_s": [0.0]},
        references=given.place("spoiler"),
        comment=note,
    )


def _heights_of_one_moment(Cl: xr.DataArray | None) -> str:
    """Return the spoiler heights whose rolling moment is that of the next larger one, if any."""
    if Cl is None or Cl.sizes["delta_s"] < 2:
        return ""
    values = Cl.transpose("delta_s", ...).values.reshape(Cl.sizes["delta_s"], -1)
    step = np.nanmax(np.abs(np.diff(values, axis=0)), axis=1, initial=0.0)
    size = np.nanmax(np.abs(values[1:]), axis=1, initial=0.0)
    rows = np.flatnonzero((step == 0.0) & (size > 0.0))
    if not rows.size:
        return ""
    heights = Cl["delta_s"].values
    return f"{heights[rows[0]]:g} to {heights[rows[-1] + 1]:g}"


def differential_tail(given: Source, h_ref: float) -> Effect:
    """Return the effect of ``delta_d`` = (right - left)/2 of the stabilizer halves on Cl.

    It is in stability axes.  Cn has no method.
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
    if "delta_left" in grid.coords:
        delta = 0.5 * (grid["delta_right"] - grid["delta_left"]).values
    else:
        # This page prints left minus right.
        delta = -0.5 * grid["delta_difference"].values
    if np.unique(delta).size != delta.size:
        raise SchemaError(
            given.role,
            ["two pairs of deflections have the same (right - left); give pairs that differ in it"],
        )
    Cl, note = _fill_transonic(grid)
    other_coordinates = [name for name in Cl.coords if name not in Cl.dims]
    Cl = Cl.drop_vars(other_coordinates).assign_coords(delta_pair=delta)
    Cl = Cl.rename(delta_pair="delta_d").sortby("delta_d")
    tables, mirrored = with_mirror_image({"Cl": from_zero(Cl, "delta_d")}, "delta_d", given.role)
    return Effect(
        "differential_tail",
        tables,
        zeros={"delta_d": [0.0]},
        references=given.place("asyflp"),
        comment=join_sentences(note, mirrored),
    )


def _fill_transonic(grid: xr.Dataset) -> tuple[xr.DataArray, str]:
    """Return Cl with the single transonic value at all alphas, and a note on these Mach numbers."""
    Cl = grid["Cl"]
    if "Cl_transonic" not in grid:
        return Cl, ""
    other_axes = [axis for axis in Cl.dims if axis != "mach"]
    is_transonic = Cl.isnull().all(other_axes) & grid["Cl_transonic"].notnull()
    Cl = xr.where(is_transonic, grid["Cl_transonic"], Cl)
    if not bool(is_transonic.any()):
        return Cl, ""
    machs = is_transonic["mach"].values[is_transonic.any("delta_pair").values]
    text = " ".join(f"{mach:g}" for mach in machs)
    return Cl, f"mach {text}: the page prints one value for all alphas"


def stabilizer_effect(given: Source, h_ref: float) -> Effect:
    """Return the effect of an all-movable stabilizer on CL and Cm.

    ``delta_e`` is its deflection from the rigged incidence.

    Notes
    -----
    The page of trim with a stabilizer prints the lift of the tail over alpha without downwash, and
    its lift, moment and incidence at trim.  With eta = q_H/q of the downwash table

        CL_delta_e = eta dCL_tail/dalpha,      Cm_delta_e = CL_delta_e x (Cm_tail / CL_tail at trim)

    CL_delta_e (alpha - epsilon + i) reproduces CL_tail at trim within the rounding of the
    incidence. The effect holds in the linear range.
    """
    page = at_height(given.grid("trim_stabilizer"), h_ref)
    downwash = at_height(given.grid("downwash"), h_ref)
    # Slope over the linear range of incidence, with eta at the same incidences.
    near = page.sel(alpha=np.abs(page["alpha"]) <= _LINEAR)
    slope = near["CL_tail"].polyfit("alpha", 1)["polyfit_coefficients"].sel(degree=1, drop=True)
    eta = downwash["q_ratio"].sel(alpha=near["alpha"], method="nearest").mean("alpha")
    # Arm Cm_tail / CL_tail by least squares over the trimmed alphas.
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
        judged={name: table.notnull() for name, table in tables.items()},
        references=given.place("trim_stabilizer"),
        comment=comment,
    )


def _both_sides(table: xr.DataArray) -> xr.DataArray:
    """Return a table for spoilers on the left (positive) and right (negative), from the right."""
    right = from_zero(table, "delta_s")
    # A printed moment at zero height does not exist: it is replaced, not subtracted.
    if bool((table["delta_s"] == 0.0).any()):
        right = table.where(table["delta_s"] != 0.0, 0.0 * table)
    extended = right.sel(delta_s=right["delta_s"] > 0.0)
    mirrored = extended.assign_coords(delta_s=-extended["delta_s"]).sortby("delta_s")
    return xr.concat([mirrored, -right], "delta_s")


def elevator_hinge(given: Source, clean: Source, h_ref: float) -> list[Effect]:
    """Return the effects ``alpha`` and ``delta`` on Ch_e from SYMFLP pages of the tail.

    Notes
    -----
    (CH)A is per angle of attack of the tail.  The table over the aeroplane's alpha is therefore
    (CH)A (alpha - epsilon + i_H), with the downwash of the listing and the incidence of its cards.
    The dynamic pressure at the tail counts as that of the flight.
    """
    grid = at_height(given.grid("symflp"), h_ref)
    effects = _deflection_effects("Ch_e", grid, "delta_e", given)
    slope = _alpha_slope("Ch_e", grid)
    if not slope:
        return effects
    with_downwash = [source for source in (given, clean) if source.has("downwash") and source.decks]
    if not with_downwash:
        warn_user(
            f"{given.role}: (CH)A is per angle of attack of the tail, and no listing with "
            f"downwash is at hand; Ch_e/alpha is left absent"
        )
        return effects
    source = with_downwash[0]
    epsilon = at_height(source.grid("downwash"), h_ref)["epsilon"]
    # The clean listing may have other Mach numbers.
    if source is clean and epsilon.sizes["mach"] > 1:
        epsilon = epsilon.interp(mach=slope["Ch_e"]["mach"])
    i_H = source.card("SYNTHS", "ALIH", 0.0) * DEGREE
    table = slope["Ch_e"] * (epsilon["alpha"] - epsilon + i_H)
    alpha_effect = Effect(
        "alpha",
        {"Ch_e": table.transpose("mach", "alpha")},
        references=given.place("symflp"),
        comment="(CH)A times the angle of attack of the tail, alpha - epsilon + "
        f"{i_H / DEGREE:g} deg",
    )
    return [alpha_effect, *effects]


def aileron_hinge(given: Source, h_ref: float) -> list[Effect]:
    """Return the effects ``alpha`` and ``delta`` on Ch_a of one aileron.

    They come from SYMFLP pages of the wing with the geometry of the aileron.
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
    effects = _deflection_effects("Ch_a", grid, "delta_a", given)
    slope = _alpha_slope("Ch_a", grid)
    if not slope:
        return effects
    alpha_effect = Effect(
        "alpha",
        slope,
        "alpha",
        references=given.place("symflp"),
        comment="one aileron; equal on both sides, so that it cancels at the wheel unless the "
        "aeroplane rolls",
    )
    return [alpha_effect, *effects]


def tab_effects(given: Source, h_ref: float, with_page: bool) -> list[Effect]:
    """Return the effects ``tab`` and ``tab_gearing`` on Ch_e, and perhaps ``alpha``, ``delta``.

    Parameters
    ----------
    given : Source
        Streams of CONTAB.
    h_ref : float
        Altitude of the basic tables. [m]
    with_page : bool
        The terms ``alpha`` and ``delta`` come from a SYMFLP page, so that the streams are not used
        for them.

    Notes
    -----
    The streams are planes in alpha and deflection, made of the engineer's B1 to B4 and D1 to D3
    [routine CTABS]:

        locked = B1 delta + B3 alpha
        gearing = (...) delta + (...) alpha
        tab for no stick force = -locked / B4 (trim tab alone)

    With a control tab too the program prints +free / B4.  The stream of the free tab contains
    B1 + D1 B2 / D2, but a tab without moment requires B1 - D1 B2 / D2.  These are faults of sign.
    The free tab is therefore not used.
    """
    grid = at_height(given.grid("tabs"), h_ref).isel(mach=0)
    planes = {}
    for name in map(str, grid.data_vars):
        if name.startswith(("Ch_", "delta_")):
            planes[name] = _fit_plane(grid[name], grid["one_decimal"])
    references = _stream_lines(given)
    effects = _trim_tab_effects(_tab_effectiveness(planes), given.role, references)
    # A slope of zero means that the deck has no geared tab.
    per_alpha, per_delta = planes.get("Ch_tab_gearing", _NO_PLANE)
    if np.isfinite(per_delta) and abs(per_delta) > _LEAST_SLOPE:
        plane = (per_alpha * grid["alpha"] + per_delta * grid["delta"]).rename(delta="delta_e")
        gearing = Effect(
            "tab_gearing",
            {"Ch_e": plane.drop_vars(["mach"], errors="ignore")},
            references=references,
            comment="moment of the geared tab on the control; plane through the printed stream",
        )
        effects.append(gearing)
    # B1 and B3, if no SYMFLP page has the moments of the elevator.
    if not with_page:
        effects += _locked_tab_effects(planes.get("Ch_tab_locked", _NO_PLANE), references)
    return effects


def _trim_tab_effects(value: float, role: str, references: str) -> list[Effect]:
    """Return the effect ``tab`` on Ch_e of B4 of the trim tab, or warn if B4 is not known."""
    if not np.isfinite(value):
        warn_user(
            f"{role}: hinge moment and tab for no stick force do not fit each other; "
            f"Ch_e/tab is left absent"
        )
        return []
    comment = (
        "per deflection of the trim tab; the engineer's own B4 of CONTAB, from hinge "
        "moment over tab for no stick force"
    )
    table = {"Ch_e": xr.DataArray(value)}
    return [Effect("tab", table, "delta_t", references=references, comment=comment)]


def _locked_tab_effects(plane: tuple[float, float], references: str) -> list[Effect]:
    """Return the effects ``alpha`` and ``delta`` on Ch_e of a plane (B3, B1), if it is known."""
    if not np.isfinite(plane).all():
        return []
    comment = "tab locked; the engineer's own B1 and B3 of CONTAB, angle of attack of the aeroplane"
    effects = []
    for name, value, regressor in (("alpha", plane[0], "alpha"), ("delta", plane[1], "delta_e")):
        table = {"Ch_e": xr.DataArray(value)}
        effects.append(Effect(name, table, regressor, references=references, comment=comment))
    return effects


def _deflection_effects(
    coefficient: str, grid: xr.Dataset, axis: str, given: Source
) -> list[Effect]:
    """Return the effect ``delta``, none without a printed slope.

    It is (CH)D times the deflection: the program takes the slope from zero.
    """
    if "Ch_delta" not in grid or not bool(grid["Ch_delta"].notnull().any()):
        return []
    slope = grid["Ch_delta"].rename(delta=axis)
    table = slope * slope[axis]
    if bool((table[axis] == 0.0).any()):
        table = exact_zero(table, axis)
    else:
        table = from_zero(table, axis)
    effect = Effect(
        "delta",
        {coefficient: table.sortby(axis)},
        zeros={axis: [0.0]},
        references=given.place("symflp"),
        comment="(CH)D times delta",
    )
    return [effect]


def _alpha_slope(coefficient: str, grid: xr.Dataset) -> dict[str, xr.DataArray]:
    """Return (CH)A, which is printed once for all deflections; empty without it."""
    if "Ch_alpha" not in grid:
        return {}
    nearest = int(np.argmin(np.abs(grid["delta"].values)))
    return drop_empty_tables({coefficient: grid["Ch_alpha"].isel(delta=nearest, drop=True)})


def _fit_plane(stream: xr.DataArray, one_decimal: xr.DataArray) -> tuple[float, float]:
    """Return the slopes of a stream per alpha and per deflection. [1/rad]

    Only values printed with three digits are used.
    """
    alpha, delta, is_rough = xr.broadcast(stream["alpha"], stream["delta"], one_decimal)
    values = stream.transpose(*alpha.dims)
    used = ((is_rough == 0) & values.notnull()).values
    if int(used.sum()) < 3:
        return _NO_PLANE
    # Plane through the origin: no moment at zero incidence and deflection.
    A = np.column_stack([alpha.values[used], delta.values[used]])
    slopes, *_ = np.linalg.lstsq(A, values.values[used], rcond=None)
    return float(slopes[0]), float(slopes[1])


def _tab_effectiveness(planes: Mapping[str, tuple[float, float]]) -> float:
    """Return B4 from the tab for no stick force and the hinge moment that it balances. [1/rad]

    It is NaN if both slopes do not give the same ratio.
    """
    tab_slopes = np.array(planes.get("delta_tab_trim", _NO_PLANE))
    # The first stream belongs to a trim tab alone, the second to one with a control tab.
    for name, sign in (("Ch_tab_locked", -1.0), ("Ch_tab_free", 1.0)):
        ratios = sign * np.array(planes.get(name, _NO_PLANE)) / tab_slopes
        if not np.isfinite(ratios).all():
            continue
        if abs(ratios[0] - ratios[1]) <= _AGREE * np.abs(ratios).max():
            return float(ratios[1])
    return float("nan")


def _stream_lines(given: Source) -> str:
    """Return file and lines of the streams of CONTAB."""
    coordinates = given.tree["tabs"].coords
    numbers = []
    for name in coordinates:
        if not str(name).startswith("lines_"):
            continue
        for text in coordinates[name].values.ravel():
            numbers += [int(number) for number in str(text).split("-") if number.isdigit()]
    if not numbers:
        return given.file
    return f"{given.file}, lines {min(numbers)}-{max(numbers)}"

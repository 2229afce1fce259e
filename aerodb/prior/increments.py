"""From gridded DATCOM tables to effects: the basic aeroplane, rates, controls, flaps, ground.

Increments are formed against the aeroplane without the cause and are zero without it by definition.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

import datcom_io
from aerodb.prior.power import without_thrust
from aerodb.prior.sources import Source, drop_empty_tables, warn_user
from aerodb.store.effects import Effect, join_sentences
from flightmech.errors import SchemaError

COMMENT = (
    "{count} cells that the dynamic page does not give: tail's share 2 a_H eta (l_H/cbar) "
    "d(epsilon)/d(alpha) "
    "from downwash, interference and planform tables"
)
_TAIL = {"surface": "horizontal tail"}


def with_tail_share(effect: Effect, clean: Source, h_ref: float) -> Effect:
    """Return the effect of ``alphadothat`` with its missing subsonic and transonic cells taken from
    the downwash, where that is printed.

    Parameters
    ----------
    effect : Effect
        CL and Cm over mach and alpha, with NaN where nothing is printed; empty tables when there is
        no dynamic page.
    clean : Source
        The listing; without downwash and PART pages (leaves ``downwash interference planform``) the
        effect returns as it came.
    """
    if not all(clean.has(leaf) for leaf in ("downwash", "interference", "planform")):
        return effect
    CL, arm = _tail_share(clean, h_ref)
    tables, judged = {}, {}
    for coefficient, share in (("CL", CL), ("Cm", -arm * CL)):
        share = share.where(share["mach"] < clean.regimes[1])
        printed = effect.tables.get(coefficient, xr.full_like(share, float("nan")))
        judged[coefficient] = printed.isnull() & share.notnull()
        tables[coefficient] = printed.fillna(share)
    count = int(judged["CL"].sum() + judged["Cm"].sum())
    if not count:
        return effect
    lines = (
        effect.references
        or f"{clean.place('downwash')}; {clean.place('interference')}; {clean.place('planform')}"
    )
    return Effect(
        effect.name,
        tables,
        effect.regressor,
        judged=judged,
        references=lines,
        comment=COMMENT.format(count=count),
    )


def _tail_share(clean: Source, h_ref: float) -> tuple[xr.DataArray, xr.DataArray]:
    """Return CL_alphadothat of the tail over mach and alpha, and its arm in chords over mach."""
    downwash, carried, planform = (
        _at(clean, leaf, h_ref) for leaf in ("downwash", "interference", "planform")
    )
    tail = (
        carried.set_index(surface="surface").sel(_TAIL, drop=True)
        if "surface" not in carried.indexes
        else carried.sel(_TAIL, drop=True)
    )
    panel = planform.sel(_TAIL, drop=True).sel(panel="total exposed", drop=True)
    slope = tail["CL_alpha_body"] + tail["CL_alpha_surface"]
    arm = (panel["x_c4_mac"] - clean.reference["x_cg"]) / clean.reference["cbar"]
    return 2.0 * slope * arm * downwash["q_ratio"] * downwash["epsilon_alpha"], arm


def _at(clean: Source, leaf: str, h_ref: float) -> xr.Dataset:
    return clean.grid(leaf).sel(h=h_ref, method="nearest", drop=True)


_PRINTED_ZERO = 2e-4  # ground pages print 0.01 deg for no flap deflection [rad]
# second breakpoint without ground effect, so that flight at height lies inside the table [m]
FAR = 30_000.0
_LONGITUDINAL = ("CL", "CD", "Cm")
_PITCH = ("qhat", "alphadothat")
_DRIFT = (
    "{role}: D(CM) comes from a loop over several flight conditions, and the program carries "
    "something of each condition into the "
    "next (up to 40 % seen late in a list); run one condition per program run and give all runs"
)


def static_effects(clean: Source, h_ref: float) -> list[Effect]:
    """Return the effects ``basic`` and ``altitude``: CL, CD, Cm over Mach and alpha, and what
    altitude adds to them.
    """
    grid, power_in_it = clean.grid("static"), ""
    if clean.powered:
        grid, power_in_it = without_thrust(clean, grid)
        warn_user(f"{clean.role}: CL, CD and Cm are {power_in_it}")
    tables = drop_empty_tables({coefficient: grid[coefficient] for coefficient in _LONGITUDINAL})
    if "CL" not in tables:
        raise SchemaError(
            clean.role,
            [f"{clean.file} prints no lift coefficient; give a case whose static page has numbers"],
        )
    basic = {coefficient: table.sel(h=h_ref, drop=True) for coefficient, table in tables.items()}
    lines = clean.place("static")
    found = [
        Effect(
            "basic",
            basic,
            references=lines,
            comment=join_sentences(f"clean aeroplane at {h_ref:.0f} m", power_in_it),
        )
    ]
    if grid.sizes["h"] > 1:
        comment = f"Reynolds-number effect of altitude, against the basic table at {h_ref:.0f} m"
        found.append(
            Effect(
                "altitude",
                {c: tables[c] - basic[c] for c in basic},
                zeros={"h": [h_ref]},
                references=lines,
                comment=comment,
            )
        )
    return found


def pitch_rates(clean: Source, h_ref: float) -> list[Effect]:
    """Return the effects of ``qhat`` and ``alphadothat`` on CL and Cm; without dynamic page only
    the tail's share of the latter.
    """
    if not clean.has("dynamic"):
        return [with_tail_share(Effect("alphadothat", {}, "alphadothat"), clean, h_ref)]
    grid = clean.grid("dynamic").sel(h=h_ref, drop=True)
    lines = clean.place("dynamic")
    q, alphadot = (
        Effect(
            rate,
            drop_empty_tables({c: grid[f"{c}_{rate}"] for c in ("CL", "Cm")}),
            rate,
            references=lines,
        )
        for rate in _PITCH
    )
    return [q, with_tail_share(alphadot, clean, h_ref)]


def sideslip_effect(clean: Source, h_ref: float) -> Effect:
    """Return the effect of ``beta`` on CY, Cl and Cn, in stability axes."""
    grid = clean.grid("static").sel(h=h_ref, drop=True)
    return Effect(
        "beta",
        drop_empty_tables({c: grid[f"{c}_beta"] for c in ("CY", "Cl", "Cn")}),
        "beta",
        references=clean.place("static"),
    )


def lateral_rates(clean: Source, h_ref: float) -> tuple[Effect, Effect]:
    """Return the effects of ``phat`` and ``rhat``, in stability axes."""
    grid = clean.grid("dynamic").sel(h=h_ref, drop=True)
    lines, comment = clean.place("dynamic"), "CY_rhat, which has no DATCOM method, counts as zero"
    roll = drop_empty_tables({c: grid[f"{c}_phat"] for c in ("CY", "Cl", "Cn")})
    yaw = drop_empty_tables({c: grid[f"{c}_rhat"] for c in ("Cl", "Cn")})
    return Effect("phat", roll, "phat", references=lines, comment=comment), Effect(
        "rhat", yaw, "rhat", references=lines
    )


def elevator_effect(given: Source, h_ref: float) -> Effect:
    """Return the effect of ``delta_e`` on CL, CD, Cm."""
    tables, _, note = _symflp(given, "tail", "delta_e", h_ref)
    return Effect(
        "elevator", tables, zeros={"delta_e": [0.0]}, references=given.place("symflp"), comment=note
    )


def flap_effects(given: Source, h_ref: float) -> list[Effect]:
    """Return the effects ``flap`` and ``flap_slope`` of ``delta_f``."""
    tables, slope, note = _symflp(given, "wing", "delta_f", h_ref)
    lines, zeros = given.place("symflp"), {"delta_f": [0.0]}
    comment = join_sentences(note, "wing-body: a change of downwash at the tail is not in Cm")
    found = [Effect("flap", tables, zeros=zeros, references=lines, comment=comment)]
    if slope is not None:
        comment = (
            "lift slope of the flapped surface against the same without deflection; per "
            "radian of alpha"
        )
        found.append(
            Effect(
                "flap_slope", {"CL": slope}, "alpha", zeros=zeros, references=lines, comment=comment
            )
        )
    return found


def aileron_effect(given: Source, h_ref: float) -> Effect:
    """Return the effect of ``delta_a`` = (right - left)/2 on Cl and Cn, in stability axes."""
    grid = at_height(given.grid("asyflp"), h_ref)
    if grid.attrs.get("surface", "wing") != "wing":
        raise SchemaError(
            given.role,
            [
                "the deflected surface is the tail, ailerons are needed (STYPE 4); this case "
                "goes to differential_tail="
            ],
        )
    delta_a = 0.5 * (grid["delta_right"] - grid["delta_left"]).values
    if np.unique(delta_a).size != delta_a.size:
        raise SchemaError(
            given.role,
            ["two pairs of deflections have the same (right - left); give pairs that differ in it"],
        )
    grid = (
        grid.drop_vars(["delta_left", "delta_right"])
        .assign_coords(delta_pair=delta_a)
        .rename(delta_pair="delta_a")
        .sortby("delta_a")
    )
    tables = drop_empty_tables(
        {c: from_zero(grid[c], "delta_a") for c in ("Cl", "Cn") if c in grid}
    )
    return Effect("aileron", tables, zeros={"delta_a": [0.0]}, references=given.place("asyflp"))


def ground_effect_increment(given: Source, h_ref: float, b: float, z_ref: float) -> Effect:
    """Return the effect ``ground``: what the ground adds to CL, CD, Cm of the clean aeroplane.

    Parameters
    ----------
    b : float
        Span; from two spans on the effect is zero. [m]
    z_ref : float
        Moment reference point below the drawing datum, from which DATCOM counts the height. [m]
    """
    tables, note = _over_ground(given, h_ref, b, z_ref, without_deflection=True)
    return Effect(
        "ground",
        tables,
        zeros={"h_agl": [2 * b, FAR]},
        references=given.place("static"),
        comment=note,
    )


def ground_flap(given: Source, h_ref: float, b: float, z_ref: float) -> Effect:
    """Return the effect ``ground_flap``: what the flaps add to the ground effect; `b`, `z_ref` as
    for `ground`.

    Raises
    ------
    SchemaError
        Pages hold the ground effect of other deflections, or there are no several deflections with
        zero among them.

    Notes
    -----
    The pages hold the clean aeroplane and the ground increment computed with the deflection, not the free-air increment of
    the deflection; so the difference between the pages with and without deflection is the ground effect alone.
    """
    tables, note = _over_ground(given, h_ref, b, z_ref)
    if (
        "delta_f" in tables["CL"].dims
    ):  # the page in free air stands at zero, where there need be none over ground
        printed = (
            tables["CL"]
            .isel(h_agl=slice(0, -2))
            .notnull()
            .any([dim for dim in tables["CL"].dims if dim != "delta_f"])
        )
        tables = {c: t.isel(delta_f=np.flatnonzero(printed)) for c, t in tables.items()}
    points = (
        tables["CL"]["delta_f"].values if "delta_f" in tables["CL"].dims else np.array([np.inf])
    )
    if np.abs(points).min() > _PRINTED_ZERO:
        raise SchemaError(
            given.role,
            [
                "the ground pages hold no several delta_f with zero among them; give a case "
                "with GRNDEF for each deflection"
            ],
        )
    zero = {c: t.isel(delta_f=int(np.argmin(np.abs(points))), drop=True) for c, t in tables.items()}
    increments = {c: exact_zero(t - zero[c], "delta_f") for c, t in tables.items()}
    return Effect(
        "ground_flap",
        increments,
        zeros={"h_agl": [2 * b, FAR], "delta_f": [0.0]},
        references=given.place("static"),
        comment=note,
    )


def ground_elevator(given: Source) -> Effect:
    """Return the effect ``ground_elevator``, which is empty: the program has no method for it.

    With a flap on the tail the first deflection of a run prints the ground pages of the clean
    aeroplane, whatever it is, and every other one adds the ground effect of those before it.
    """
    warn_user(
        f"{given.role}: the program computes the ground effect without the elevator (the "
        f"first deflection of a run prints the pages of "
        "the clean aeroplane, the others add to them); CL/ground_elevator, "
        "CD/ground_elevator and Cm/ground_elevator are left absent"
    )
    return Effect("ground_elevator", {})


def _symflp(
    given: Source, surface: str, axis: str, h_ref: float
) -> tuple[dict[str, xr.DataArray], xr.DataArray | None, str]:
    """Return CL, CD, Cm of a symmetrical flap, zero at zero deflection, its lift-slope increment,
    and a note.
    """
    grid = at_height(given.grid("symflp"), h_ref)
    found = grid.attrs.get("surface")
    if found != surface:
        raise SchemaError(
            given.role,
            [
                f"the deflected surface is the {found}, the {surface} is needed; exchange "
                f"flaps and elevator"
            ],
        )
    if "symflp" in given.looped:
        warn_user(_DRIFT.format(role=given.role))
    grid = grid.rename(delta=axis).sortby(axis)
    printed = {"CL": grid["dCL"], "CD": grid["dCDmin"], "Cm": grid["dCm"]}
    induced = drop_empty_tables({"dCDi": grid["dCDi"]} if "dCDi" in grid else {})
    note = "" if induced else "induced-drag increment not printed"
    printed["CD"] = sum(induced.values(), printed["CD"])
    tables = {c: from_zero(table, axis) for c, table in drop_empty_tables(printed).items()}
    slope = (
        drop_empty_tables({"slope": grid["CL_alpha_delta"]})
        if np.any(grid[axis].values == 0.0)
        else {}
    )
    return tables, from_zero(slope["slope"], axis) if slope else None, note


def at_height(grid: xr.Dataset, h_ref: float) -> xr.Dataset:
    """Return the altitude nearest the reference; controls are printed at few altitudes and hardly
    depend on it.
    """
    return grid.sel(h=h_ref, method="nearest", drop=True)


def from_zero(table: xr.DataArray, axis: str) -> xr.DataArray:
    """Return increments that are zero at zero deflection: its own value taken off, or a node put
    in.
    """
    points = table[axis].values
    if np.any(points == 0.0):
        return exact_zero(table - table.sel({axis: 0.0}, drop=True), axis)
    node = xr.zeros_like(table.isel({axis: [0]})).assign_coords({axis: [0.0]})
    return xr.concat([table, node], axis).sortby(axis)


def exact_zero(table: xr.DataArray, axis: str) -> xr.DataArray:
    """Return a table whose breakpoint printed as nearly zero stands at zero exactly."""
    points = table[axis].values.copy()
    points[np.argmin(np.abs(points))] = 0.0
    return table.assign_coords({axis: points}).transpose(*table.dims)


def _over_ground(
    given: Source, h_ref: float, b: float, z_ref: float, without_deflection: bool = False
) -> tuple[dict[str, xr.DataArray], str]:
    """Return page over ground minus page in free air over h_agl, fading to zero at two spans."""
    grid = at_height(given.grid("static"), h_ref)
    if "ground_height" not in grid.dims or not np.isinf(grid["ground_height"].values).any():
        raise SchemaError(
            given.role,
            [
                "the case holds no pages over ground next to the one in free air; give a "
                "case with GRNDEF"
            ],
        )
    low = grid.sel(ground_height=np.isfinite(grid["ground_height"]))
    if without_deflection:
        low = _clean_pages(low)
    _require_first_deflections(given, low)
    tables = {}
    for coefficient in _LONGITUDINAL:
        free = grid[coefficient].sel(ground_height=np.inf, drop=True)
        for axis in set(free.dims) & {
            "delta_f",
            "delta_e",
        }:  # the free-air page is printed once, without deflection
            free = free.dropna(axis, how="all").isel({axis: 0}, drop=True)
        tables[coefficient] = low[coefficient] - free
    tables = drop_empty_tables(tables)
    last = float(low["ground_height"].max()) - z_ref
    if last >= 2 * b:
        raise SchemaError(
            given.role,
            [
                f"ground heights reach {last:.1f} m, beyond two spans ({2 * b:.1f} m) where "
                f"the effect is taken as zero; leave them out"
            ],
        )
    machs = grid["mach"].values
    comment = (
        f"zero from two spans ({2 * b:.2f} m) on, by definition; the breakpoint at "
        f"{FAR:.0f} m keeps flight at height inside the table"
    )
    if machs.size == 1:
        tables = {name: table.isel(mach=0, drop=True) for name, table in tables.items()}
        comment = join_sentences(f"computed at Mach {machs[0]:g}", comment)
    return {name: _faded(table, b, z_ref) for name, table in tables.items()}, comment


def _faded(table: xr.DataArray, b: float, z_ref: float) -> xr.DataArray:
    table = (
        table.assign_coords(ground_height=table["ground_height"] - z_ref)
        .rename(ground_height="h_agl")
        .sortby("h_agl")
    )
    far = xr.zeros_like(table.isel(h_agl=[0, 0])).assign_coords(h_agl=[2 * b, FAR])
    return xr.concat([table, far], "h_agl")


def _clean_pages(low: xr.Dataset) -> xr.Dataset:
    """Return the pages over ground without deflection; with an elevator the first deflection of the
    run prints them, whatever it is.
    """
    if "delta_e" in low.dims and "CL_flag" in low:
        low = low.isel(delta_e=int(_suspects(low).argmin("delta_e")))
    for axis in {"delta_f", "delta_e"} & set(low.dims):
        low = low.sel({axis: 0.0}, method="nearest")
    return low.drop_vars(["delta_f", "delta_e"], errors="ignore")


def _suspects(low: xr.Dataset) -> xr.DataArray:
    """Return the number of suspect cells of CL over the deflections."""
    return (low["CL_flag"] == datcom_io.FLAGS.index("suspect")).sum(
        [dim for dim in low["CL_flag"].dims if dim not in ("delta_f", "delta_e")]
    )


def _require_first_deflections(given: Source, low: xr.Dataset) -> None:
    """Refuse pages over ground that the deflections before them in the run are in."""
    if "CL_flag" not in low or not int(_suspects(low).sum()):
        return
    raise SchemaError(
        given.role,
        [
            f"{given.file} holds pages over ground of several deflections from one program "
            f"run, and the program adds the ground effect "
            "of each to those after it (flagged suspect; on the T-37 the ground effect of "
            "flaps 40 deg at 30 ft comes out 5 times too "
            "large); run one deflection at a time (datcom split makes the decks, datcom run "
            "FOLDER runs them) and give all listings"
        ],
    )

"""Effects from gridded DATCOM tables: basic aeroplane, rates, controls and flaps.

An increment is the difference to the aeroplane without the cause.  Without the cause it is zero by
definition.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from aerodb.prior.damping import rate_effect
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
_TAIL_LEAVES = ("downwash", "interference", "planform")


def with_tail_share(effect: Effect, clean: Source, h_ref: float) -> Effect:
    """Return the effect of ``alphadothat`` with missing cells computed from the downwash.

    Only subsonic and transonic cells are filled.

    Parameters
    ----------
    effect : Effect
        CL and Cm over mach and alpha, with NaN where nothing is printed; no tables without a
        dynamic page.
    clean : Source
        The listing.  Without downwash and PART pages (leaves ``downwash interference planform``)
        the effect does not change.
    h_ref : float
        Altitude of the basic tables. [m]
    """
    if not all(map(clean.has, _TAIL_LEAVES)):
        return effect
    CL, arm = _tail_share(clean, h_ref)
    # The tail is behind the reference point, so that its lift has a negative moment.
    tables, judged = {}, {}
    for coefficient, share in (("CL", CL), ("Cm", -arm * CL)):
        share = share.where(share["mach"] < clean.regimes[1])
        printed = effect.tables.get(coefficient, xr.full_like(share, float("nan")))
        judged[coefficient] = printed.isnull() & share.notnull()
        tables[coefficient] = printed.fillna(share)
    count = int(judged["CL"].sum() + judged["Cm"].sum())
    if not count:
        return effect
    references = effect.references or "; ".join(map(clean.place, _TAIL_LEAVES))
    return Effect(
        effect.name,
        tables,
        effect.regressor,
        judged=judged,
        references=references,
        comment=COMMENT.format(count=count),
    )


def _tail_share(clean: Source, h_ref: float) -> tuple[xr.DataArray, xr.DataArray]:
    """Return CL_alphadothat of the tail over mach and alpha, and its arm in chords over mach."""
    downwash, interference, planform = (_grid_at(clean, leaf, h_ref) for leaf in _TAIL_LEAVES)
    if "surface" not in interference.indexes:
        interference = interference.set_index(surface="surface")
    tail = interference.sel(_TAIL, drop=True)
    panel = planform.sel(_TAIL, drop=True).sel(panel="total exposed", drop=True)
    slope = tail["CL_alpha_body"] + tail["CL_alpha_surface"]
    arm = (panel["x_c4_mac"] - clean.reference["x_cg"]) / clean.reference["cbar"]
    # 2 a_H (l_H / cbar) eta d(epsilon)/d(alpha): the downwash reaches the tail with a delay.
    return 2.0 * slope * arm * downwash["q_ratio"] * downwash["epsilon_alpha"], arm


def _grid_at(clean: Source, leaf: str, h_ref: float) -> xr.Dataset:
    """Return a leaf over Mach number at the altitude nearest to the reference."""
    return clean.grid(leaf).sel(h=h_ref, method="nearest", drop=True)


LONGITUDINAL = ("CL", "CD", "Cm")
_LATERAL = ("CY", "Cl", "Cn")
_LIFT_WITHOUT_DEFLECTION = 0.01  # D(CL) of a flap; plain, slotted and Fowler flaps print 0.000
_DRIFT = (
    "{role}: D(CM) comes from a loop over several flight conditions, and the program carries "
    "something of each condition into the "
    "next (up to 40 % seen late in a list); run one condition per program run and give all runs"
)


def static_effects(clean: Source, h_ref: float) -> list[Effect]:
    """Return the effects ``basic`` and ``altitude`` on CL, CD, Cm.

    ``altitude`` is the increment at the other altitudes.
    """
    grid, power_note = clean.grid("static"), ""
    if clean.powered:
        grid, power_note = without_thrust(clean, grid)
        warn_user(f"{clean.role}: CL, CD and Cm are {power_note}")
    tables = drop_empty_tables({coefficient: grid[coefficient] for coefficient in LONGITUDINAL})
    if "CL" not in tables:
        raise SchemaError(
            clean.role,
            [f"{clean.file} prints no lift coefficient; give a case whose static page has numbers"],
        )
    # The basic tables are those of the reference altitude.
    basic = {coefficient: table.sel(h=h_ref, drop=True) for coefficient, table in tables.items()}
    references = clean.place("static")
    place = "at the Reynolds numbers of the deck"
    if clean.has_altitude:
        place = f"at {h_ref:.0f} m"
    comment = join_sentences(f"clean aeroplane {place}", power_note)
    effects = [Effect("basic", basic, references=references, comment=comment)]
    if grid.sizes["h"] > 1:
        altitude = Effect(
            "altitude",
            {coefficient: tables[coefficient] - table for coefficient, table in basic.items()},
            zeros={"h": [h_ref]},
            references=references,
            comment=f"Reynolds-number effect of altitude, against the basic table at {h_ref:.0f} m",
        )
        effects.append(altitude)
    return effects


def pitch_rates(clean: Source, h_ref: float) -> list[Effect]:
    """Return the effects of ``qhat`` and ``alphadothat`` on CL and Cm.

    Without a dynamic page it is only the tail's share of ``alphadothat``.
    """
    if not clean.has("dynamic"):
        return [with_tail_share(Effect("alphadothat", {}, "alphadothat"), clean, h_ref)]
    qhat = rate_effect(clean, "qhat", ("CL", "Cm"), h_ref)
    alphadot = rate_effect(clean, "alphadothat", ("CL", "Cm"), h_ref)
    return [qhat, with_tail_share(alphadot, clean, h_ref)]


def sideslip_effect(clean: Source, h_ref: float) -> Effect:
    """Return the effect of ``beta`` on CY, Cl and Cn, in stability axes."""
    return _derivatives(clean, "static", "beta", h_ref=h_ref, coefficients=_LATERAL)


def lateral_rates(clean: Source, h_ref: float) -> tuple[Effect, Effect]:
    """Return the effects of ``phat`` and ``rhat``, in stability axes."""
    roll = rate_effect(clean, "phat", _LATERAL, h_ref)
    yaw = rate_effect(clean, "rhat", ("Cl", "Cn"), h_ref)
    return replace(roll, comment="CY_rhat, which has no DATCOM method, counts as zero"), yaw


def _derivatives(
    clean: Source, leaf: str, variable: str, *, h_ref: float, coefficients: Sequence[str]
) -> Effect:
    """Return the effect of a variable from the printed derivatives with respect to it."""
    grid = clean.grid(leaf).sel(h=h_ref, drop=True)
    tables = {name: grid[f"{name}_{variable}"] for name in coefficients}
    return Effect(variable, drop_empty_tables(tables), variable, references=clean.place(leaf))


def elevator_effect(given: Source, h_ref: float) -> Effect:
    """Return the effect of ``delta_e`` on CL, CD, Cm."""
    tables, _, note = _flap_tables(given, "tail", "delta_e", h_ref)
    for table in list(tables.values())[:1]:
        points = np.degrees(table["delta_e"].values)
        if points.any() and not points.min() < 0.0 < points.max():
            warn_user(
                f"{given.role}: the deflections turn one way only ({points.min():.3g} to "
                f"{points.max():.3g} deg); the other way the tables hold zero: give deflections of "
                f"both signs"
            )
    references = given.place("symflp")
    zeros = {"delta_e": [0.0]}
    return Effect("elevator", tables, zeros=zeros, references=references, comment=note)


def flap_effects(given: Source, h_ref: float) -> list[Effect]:
    """Return the effects ``flap`` and ``flap_slope`` of ``delta_f``."""
    tables, slope, note = _flap_tables(given, "wing", "delta_f", h_ref)
    references, zeros = given.place("symflp"), {"delta_f": [0.0]}
    comment = join_sentences(note, "wing-body: a change of downwash at the tail is not in Cm")
    effects = [Effect("flap", tables, zeros=zeros, references=references, comment=comment)]
    if slope is not None:
        flap_slope = Effect(
            "flap_slope",
            {"CL": slope},
            "alpha",
            zeros=zeros,
            references=references,
            comment="lift slope of the flapped surface against the same without deflection; per "
            "radian of alpha",
        )
        effects.append(flap_slope)
    return effects


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
    # Deflections of right and left aileron: only their difference rolls.
    delta_a = 0.5 * (grid["delta_right"] - grid["delta_left"]).values
    if np.unique(delta_a).size != delta_a.size:
        raise SchemaError(
            given.role,
            ["two pairs of deflections have the same (right - left); give pairs that differ in it"],
        )
    # The pair of deflections becomes the axis delta_a.
    grid = grid.drop_vars(["delta_left", "delta_right"]).assign_coords(delta_pair=delta_a)
    grid = grid.rename(delta_pair="delta_a").sortby("delta_a")
    tables = {}
    for coefficient in ("Cl", "Cn"):
        if coefficient in grid:
            tables[coefficient] = from_zero(grid[coefficient], "delta_a")
    tables, note = with_mirror_image(drop_empty_tables(tables), "delta_a", given.role)
    return Effect(
        "aileron",
        tables,
        zeros={"delta_a": [0.0]},
        references=given.place("asyflp"),
        comment=note,
    )


def with_mirror_image(
    tables: dict[str, xr.DataArray], axis: str, role: str
) -> tuple[dict[str, xr.DataArray], str]:
    """Return antisymmetric increments for both directions, and a note if one was not printed.

    Left and right exchanged reverse rolling and yawing moment of a symmetric aeroplane. Without the
    other direction its tables would hold zero.

    Parameters
    ----------
    tables : dict of str to DataArray
        Cl and Cn over `axis`, zero at zero.
    axis : str
        ``delta_a`` or ``delta_d``. [rad]
    role : str
        Of the listing, for the message.

    Warns
    -----
    AeromatchWarning
        All deflections have one sign.
    """
    both, note = {}, ""
    for name, table in tables.items():
        points = table[axis].values
        if points.min() < 0.0 < points.max() or not points.any():
            both[name] = table
            continue
        image = (-table).assign_coords({axis: -points}).isel({axis: points != 0.0})
        both[name] = xr.concat([table, image], axis).sortby(axis).transpose(*table.dims)
        note = (
            f"the pairs of deflections turn one way only ({axis} {np.degrees(points.min()):.3g} to "
            f"{np.degrees(points.max()):.3g} deg); the other way is the mirror image"
        )
    if note:
        warn_user(f"{role}: {note}")
    return both, note


def _flap_tables(
    given: Source, surface: str, axis: str, h_ref: float
) -> tuple[dict[str, xr.DataArray], xr.DataArray | None, str]:
    """Return CL, CD, Cm of a symmetrical flap, its lift-slope increment, and a note.

    All are zero at zero deflection.
    """
    grid = at_height(given.grid("symflp"), h_ref)
    printed_surface = grid.attrs.get("surface")
    if printed_surface != surface:
        raise SchemaError(
            given.role,
            [
                f"the deflected surface is the {printed_surface}, the {surface} is needed; "
                f"exchange flaps and elevator"
            ],
        )
    if "symflp" in given.looped:
        warn_user(_DRIFT.format(role=given.role))
    grid = grid.rename(delta=axis).sortby(axis)
    # Drag: increment of the minimum drag, and induced drag if it is printed.
    CD, note = grid["dCDmin"], "induced-drag increment not printed"
    if "dCDi" in grid and bool(grid["dCDi"].notnull().any()):
        CD, note = CD + grid["dCDi"], ""
    printed = drop_empty_tables({"CL": grid["dCL"], "CD": CD, "Cm": grid["dCm"]})
    _warn_of_lift_without_deflection(given, printed, axis)
    tables = {name: from_zero(table, axis) for name, table in printed.items()}
    # The slope increment refers to the same run without deflection, which must be there.
    if not np.any(grid[axis].values == 0.0):
        return tables, None, note
    slope = grid["CL_alpha_delta"]
    if not bool(slope.notnull().any()):
        return tables, None, note
    return tables, from_zero(slope, axis), note


def _warn_of_lift_without_deflection(
    given: Source, printed: dict[str, xr.DataArray], axis: str
) -> None:
    """Warn of a jet flap, and of a flap with lift at zero deflection, which is subtracted."""
    CL, lift = printed.get("CL"), 0.0
    if CL is not None and np.any(CL[axis].values == 0.0):
        lift = float(np.abs(CL.sel({axis: 0.0})).max())
    flows = [deck.value("SYMFLP", "CMU") for deck in given.decks if deck.value("SYMFLP", "JETFLP")]
    if flows:
        warn_user(
            f"{given.role}: the jet flap (JETFLP, CMU={flows[0] or 0.0:g}) blows at every "
            f"deflection, and D(CL) at zero, {lift:.3g}, is subtracted: the increments hold at "
            f"this CMU alone, and without a zero deflection they hold the lift of the jet"
        )
    elif lift > _LIFT_WITHOUT_DEFLECTION:
        warn_user(
            f"{given.role}: D(CL) of {lift:.3g} is printed at zero deflection and subtracted from "
            f"all increments; check the cards of the device"
        )


def at_height(grid: xr.Dataset, h_ref: float) -> xr.Dataset:
    """Return a grid at the altitude nearest to the reference.

    Controls are printed at few altitudes and hardly depend on them.
    """
    return grid.sel(h=h_ref, method="nearest", drop=True)


def from_zero(table: xr.DataArray, axis: str) -> xr.DataArray:
    """Return increments that are zero at zero deflection.

    The value at zero is subtracted.  Without a breakpoint there, one is added.
    """
    points = table[axis].values
    if np.any(points == 0.0):
        return exact_zero(table - table.sel({axis: 0.0}, drop=True), axis)
    # A breakpoint at zero without increment.
    node = xr.zeros_like(table.isel({axis: [0]})).assign_coords({axis: [0.0]})
    return xr.concat([table, node], axis).sortby(axis)


def exact_zero(table: xr.DataArray, axis: str) -> xr.DataArray:
    """Return a table whose breakpoint nearest to zero is moved to zero exactly."""
    points = table[axis].values.copy()
    points[np.argmin(np.abs(points))] = 0.0
    return table.assign_coords({axis: points}).transpose(*table.dims)

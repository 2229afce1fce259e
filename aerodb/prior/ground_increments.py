"""Effects of the ground from DATCOM pages with GRNDEF.

An increment is the page over ground less the page in free air.  From two spans on it is zero by
definition.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

import datcom_io
from aerodb.prior.increments import LONGITUDINAL, at_height, exact_zero
from aerodb.prior.sources import Source, drop_empty_tables, warn_user
from aerodb.store.effects import Effect, join_sentences
from flightmech.errors import SchemaError

_PRINTED_ZERO = 2e-4  # ground pages print 0.01 deg for no flap deflection [rad]
# Second breakpoint without ground effect, so that flight at height lies inside the table. [m]
FAR = 30_000.0


def ground_effect_increment(given: Source, h_ref: float, b: float, z_ref: float) -> Effect:
    """Return the effect ``ground`` on CL, CD, Cm of the clean aeroplane.

    Parameters
    ----------
    given : Source
        Pages with GRNDEF.
    h_ref : float
        Altitude of the basic tables. [m]
    b : float
        Span; from two spans on the effect is zero. [m]
    z_ref : float
        Moment reference point below the drawing datum, from which DATCOM counts the height. [m]
    """
    tables, note = _ground_increments(given, h_ref, b, z_ref, without_deflection=True)
    return Effect(
        "ground",
        tables,
        zeros={"h_agl": [2 * b, FAR]},
        references=given.place("static"),
        comment=note,
    )


def ground_flap(given: Source, h_ref: float, b: float, z_ref: float) -> Effect:
    """Return the effect ``ground_flap``, the increment of the ground effect with flaps.

    Parameters
    ----------
    given, h_ref, b, z_ref
        As in `ground_effect_increment`.

    Raises
    ------
    SchemaError
        Pages contain the ground effect of other deflections, or the deflections are not several
        with zero among them.

    Notes
    -----
    The pages contain the clean aeroplane and the ground increment with the deflection.  They do not
    contain the increment of the deflection in free air.  The difference between the pages with and
    without deflection is therefore the ground effect alone.
    """
    tables, note = _ground_increments(given, h_ref, b, z_ref)
    points = np.array([np.inf])
    if "delta_f" in tables["CL"].dims:
        # The page in free air belongs to zero deflection, which may have no page over ground.
        over_ground = tables["CL"].isel(h_agl=slice(0, -2)).notnull()
        other_axes = [axis for axis in over_ground.dims if axis != "delta_f"]
        printed = np.flatnonzero(over_ground.any(other_axes))
        tables = {name: table.isel(delta_f=printed) for name, table in tables.items()}
        points = tables["CL"]["delta_f"].values
    if np.abs(points).min() > _PRINTED_ZERO:
        raise SchemaError(
            given.role,
            [
                "the ground pages hold no several delta_f with zero among them; give a case "
                "with GRNDEF for each deflection"
            ],
        )
    zero_index = int(np.argmin(np.abs(points)))
    increments = {}
    for name, table in tables.items():
        without_flaps = table.isel(delta_f=zero_index, drop=True)
        increments[name] = exact_zero(table - without_flaps, "delta_f")
    return Effect(
        "ground_flap",
        increments,
        zeros={"h_agl": [2 * b, FAR], "delta_f": [0.0]},
        references=given.place("static"),
        comment=note,
    )


def ground_elevator(given: Source) -> Effect:
    """Return the empty effect ``ground_elevator``: the program has no method for it.

    With a flap on the tail, the first deflection of a run prints the ground pages of the clean
    aeroplane, whatever the deflection.  Every other one adds the ground effect of those before it.
    """
    warn_user(
        f"{given.role}: the program computes the ground effect without the elevator (the "
        f"first deflection of a run prints the pages of "
        "the clean aeroplane, the others add to them); CL/ground_elevator, "
        "CD/ground_elevator and Cm/ground_elevator are left absent"
    )
    return Effect("ground_elevator", {})


def _ground_increments(
    given: Source, h_ref: float, b: float, z_ref: float, without_deflection: bool = False
) -> tuple[dict[str, xr.DataArray], str]:
    """Return page over ground minus page in free air over h_agl, zero from two spans on."""
    grid = at_height(given.grid("static"), h_ref)
    if "ground_height" not in grid.dims or not np.isinf(grid["ground_height"].values).any():
        raise SchemaError(
            given.role,
            [
                "the case holds no pages over ground next to the one in free air; give a "
                "case with GRNDEF"
            ],
        )
    over_ground = grid.sel(ground_height=np.isfinite(grid["ground_height"]))
    if without_deflection:
        over_ground = _clean_pages(over_ground)
    _require_first_deflections(given, over_ground)
    tables = {}
    for coefficient in LONGITUDINAL:
        free_air = grid[coefficient].sel(ground_height=np.inf, drop=True)
        # The free-air page is printed once, without deflection.
        for axis in set(free_air.dims) & {"delta_f", "delta_e"}:
            free_air = free_air.dropna(axis, how="all").isel({axis: 0}, drop=True)
        tables[coefficient] = over_ground[coefficient] - free_air
    tables = drop_empty_tables(tables)
    # Heights in the deck count from the drawing datum.
    highest = float(over_ground["ground_height"].max()) - z_ref
    if highest >= 2 * b:
        raise SchemaError(
            given.role,
            [
                f"ground heights reach {highest:.1f} m, beyond two spans ({2 * b:.1f} m) where "
                f"the effect is taken as zero; leave them out"
            ],
        )
    machs = grid["mach"].values
    comment = (
        f"zero from two spans ({2 * b:.2f} m) on, by definition; the breakpoint at "
        f"{FAR:.0f} m keeps flight at height inside the table"
    )
    # One Mach number holds for all.
    if machs.size == 1:
        tables = {name: table.isel(mach=0, drop=True) for name, table in tables.items()}
        comment = join_sentences(f"computed at Mach {machs[0]:g}", comment)
    return {name: _add_free_air(table, b, z_ref) for name, table in tables.items()}, comment


def _add_free_air(table: xr.DataArray, b: float, z_ref: float) -> xr.DataArray:
    """Return a table over h_agl of the reference point, with zeros at two spans and far above."""
    heights = table["ground_height"] - z_ref
    table = table.assign_coords(ground_height=heights).rename(ground_height="h_agl")
    table = table.sortby("h_agl")
    # Two breakpoints without ground effect: at two spans, and far above.
    far = xr.zeros_like(table.isel(h_agl=[0, 0])).assign_coords(h_agl=[2 * b, FAR])
    return xr.concat([table, far], "h_agl")


def _clean_pages(over_ground: xr.Dataset) -> xr.Dataset:
    """Return the pages over ground without deflection.

    With an elevator, the first deflection of the run prints them, whatever the deflection.
    """
    if "delta_e" in over_ground.dims and "CL_flag" in over_ground:
        first = int(_count_suspects(over_ground).argmin("delta_e"))
        over_ground = over_ground.isel(delta_e=first)
    for axis in {"delta_f", "delta_e"} & set(over_ground.dims):
        over_ground = over_ground.sel({axis: 0.0}, method="nearest")
    return over_ground.drop_vars(["delta_f", "delta_e"], errors="ignore")


def _count_suspects(over_ground: xr.Dataset) -> xr.DataArray:
    """Return the number of suspect cells of CL by deflection."""
    # The reader of listings marks cells that contain earlier deflections.
    is_suspect = over_ground["CL_flag"] == datcom_io.FLAGS.index("suspect")
    return is_suspect.sum([axis for axis in is_suspect.dims if axis not in ("delta_f", "delta_e")])


def _require_first_deflections(given: Source, over_ground: xr.Dataset) -> None:
    """Raise if pages over ground contain the ground effect of earlier deflections of the run."""
    if "CL_flag" not in over_ground or not int(_count_suspects(over_ground).sum()):
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

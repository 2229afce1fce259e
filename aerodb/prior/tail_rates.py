"""The tail's share of the alpha-dot derivatives from the downwash, for cells of the dynamic page that hold no number.

The horizontal tail sees the downwash of the wing late by l_H / V [DATCOM 7.4.4]:

    CL_alphadothat = 2 a_H eta (l_H / cbar) d(epsilon)/d(alpha),      Cm_alphadothat = -(l_H / cbar) CL_alphadothat

with a_H the lift slope of the tail with its carry-over to the body on the reference area, eta = q_H / q, l_H the distance from the
moment centre to the quarter chord of the exposed tail.  On the build-up listings of a jet and a trainer it gives the printed CLAD
within 0.4 % in the linear range (Mach 0.2 to 0.5) and within 8 % at zero lift at Mach 0.9 and 1.2; at supersonic speed the wing's own
part leads and the equation is not used.
"""

from __future__ import annotations

import xarray as xr

from ..transform.effects import Effect
from .sources import Source

COMMENT = (
    "{count} cells that the dynamic page does not give: tail's share 2 a_H eta (l_H/cbar) d(epsilon)/d(alpha) "
    "from downwash, interference and planform tables"
)
_TAIL = {"surface": "horizontal tail"}


def with_tail_share(effect: Effect, clean: Source, h_ref: float) -> Effect:
    """Return the effect of ``alphadothat`` with its missing subsonic and transonic cells taken from the downwash, where that is printed.

    Parameters
    ----------
    effect : Effect
        CL and Cm over mach and alpha, with NaN where nothing is printed; empty tables when there is no dynamic page.
    clean : Source
        The listing; without downwash and PART pages (leaves ``downwash interference planform``) the effect returns as it came.
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
    lines = effect.references or f"{clean.place('downwash')}; {clean.place('interference')}; {clean.place('planform')}"
    return Effect(effect.name, tables, effect.regressor, judged=judged, references=lines, comment=COMMENT.format(count=count))


def _tail_share(clean: Source, h_ref: float) -> tuple[xr.DataArray, xr.DataArray]:
    """Return CL_alphadothat of the tail over mach and alpha, and its arm in chords over mach."""
    downwash, carried, planform = (_at(clean, leaf, h_ref) for leaf in ("downwash", "interference", "planform"))
    tail = carried.set_index(surface="surface").sel(_TAIL, drop=True) if "surface" not in carried.indexes else carried.sel(_TAIL, drop=True)
    panel = planform.sel(_TAIL, drop=True).sel(panel="total exposed", drop=True)
    slope = tail["CL_alpha_body"] + tail["CL_alpha_surface"]
    arm = (panel["x_c4_mac"] - clean.reference["x_cg"]) / clean.reference["cbar"]
    return 2.0 * slope * arm * downwash["q_ratio"] * downwash["epsilon_alpha"], arm


def _at(clean: Source, leaf: str, h_ref: float) -> xr.Dataset:
    return clean.grid(leaf).sel(h=h_ref, method="nearest", drop=True)

"""What the print of the whole aeroplane lacks, for the warnings of a build."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import datcom_io
from aerodb.prior.sources import Source
from datcom_io.reading.suspects import TAIL_PRESSURE
from flightmech.units import DEGREE

_SUSPECT = datcom_io.FLAGS.index("suspect")
_FAILED = datcom_io.FLAGS.index("nan")
_NO_METHOD = datcom_io.FLAGS.index("NDM")
_MOST_PLACES = 4  # in a clause
# Quantities of a print of which a database makes terms.
_USED = {
    "static": ("CL", "CD", "Cm", "CY_beta", "Cl_beta", "Cn_beta"),
    "dynamic": (
        "CL_qhat",
        "Cm_qhat",
        "CL_alphadothat",
        "Cm_alphadothat",
        "CY_phat",
        "Cl_phat",
        "Cn_phat",
        "Cl_rhat",
        "Cn_rhat",
    ),
}


def list_missing_numbers(clean: Source, h_ref: float) -> Iterator[str]:
    """Yield clauses on quantities that are printed as NaN, as infinity, or as NDM everywhere.

    NDM stands for no method of DATCOM.
    """
    failed, without_method = [], []
    for leaf, names in _USED.items():
        if not clean.has(leaf):
            continue
        grid = clean.grid(leaf).sel(h=h_ref, drop=True)
        for name in names:
            if name not in grid or f"{name}_flag" not in grid:
                continue
            flags = grid[f"{name}_flag"].values
            numbers = np.isfinite(grid[name].values)
            count = int((flags == _FAILED).sum())
            if count:
                share = "all cells" if not numbers.any() else f"{count} of {flags.size} cells"
                failed.append(f"{name} ({share})")
            elif not numbers.any() and (flags == _NO_METHOD).any():
                without_method.append(name)
    if failed:
        yield (
            f"{clean.file} prints NaN or infinity for {', '.join(failed)}: the arithmetic of the "
            f"program failed there, and these cells are not used"
        )
    if without_method:
        yield (
            f"{clean.file} prints NDM (no method of DATCOM) for all of "
            f"{', '.join(without_method)}: these terms are absent"
        )


def describe_tail_pressure(clean: Source, h_ref: float) -> str:
    """Return a clause on Mach numbers whose tail has an impossible dynamic pressure, or nothing.

    Lift, moment and damping of the aeroplane contain no tail there, or a wrong one
    (`datcom_io.reading.suspects.flag_tail_pressure`).
    """
    if not clean.has("downwash"):
        return ""
    grid = clean.grid("downwash").sel(h=h_ref, method="nearest", drop=True)
    if "q_ratio_flag" not in grid:
        return ""
    low, high = TAIL_PRESSURE
    # Other faults of a page flag the column, too.
    is_possible = (grid["q_ratio"] >= low) & (grid["q_ratio"] <= high)
    is_wrong = (grid["q_ratio_flag"] == _SUSPECT) & ~is_possible
    machs = grid["mach"].values[is_wrong.any("alpha").values]
    if not machs.size:
        return ""
    at = " ".join(f"{mach:g}" for mach in machs)
    ratio = grid["q_ratio"].where(is_wrong)
    values = "an overflow"
    if bool(ratio.notnull().any()):
        values = f"{float(ratio.min()):.3g} to {float(ratio.max()):.3g}"
    return (
        f"{clean.file} prints Q/QINF of {values} at the tail for Mach {at}, and only {low:g} to "
        f"{high:g} are possible: CL, Cm and pitch damping hold no tail or a wrong one there; leave "
        f"out these Mach numbers, or move ZH or XH a little and compare"
    )


def describe_suspect_numbers(clean: Source, h_ref: float) -> str:
    """Return a clause on suspect static coefficients of the whole aeroplane, or nothing.

    Mach numbers whose tail has an impossible pressure are left to `describe_tail_pressure`.
    """
    if not clean.has("static"):
        return ""
    grid = clean.grid("static").sel(h=h_ref, method="nearest", drop=True)
    # Cells that power fills are removed elsewhere (`aerodb.prior.power`).
    if "power" in grid.coords and not bool((grid["power"] == "off").all()):
        return ""
    places = []
    for name in (*_USED["static"], "CL_alpha", "Cm_alpha"):
        if f"{name}_flag" not in grid or "mach" not in grid.dims:
            continue
        is_suspect = (grid[f"{name}_flag"] == _SUSPECT) & grid[name].notnull()
        for mach in grid["mach"].values[is_suspect.any("alpha").values]:
            rows = is_suspect.sel(mach=mach).values
            angles = grid["alpha"].values[rows] / DEGREE
            where = f"alpha {angles[0]:g} deg"
            if angles.size > 1:
                where = f"{angles.size} angles of attack from {angles[0]:g} deg on"
            places.append(f"{name} at Mach {mach:g}, {where}")
    if not places:
        return ""
    more = ""
    if len(places) > _MOST_PLACES:
        more = f" and {len(places) - _MOST_PLACES} more"
    return (
        f"{clean.file} contradicts itself, or a fault of the program is in "
        f"{'; '.join(places[:_MOST_PLACES])}{more}: its messages state why (datcom show); run the "
        f"deck again, or correct it"
    )

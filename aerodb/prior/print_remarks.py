"""What the print of the whole aeroplane lacks, for the warnings of a build."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import datcom_io
from aerodb.prior.sources import Source

_FAILED = datcom_io.FLAGS.index("nan")
_NO_METHOD = datcom_io.FLAGS.index("NDM")
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

"""Files that accompany the print file, recognised by their content: plot files, MAT files, CSV of
DATCOM+.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from datcom_io.cells import FILLED, FLAGS, OK, SUSPECT
from datcom_io.exchange.plot_records import is_line_of_plot
from datcom_io.listing import Case, Listing
from flightmech.errors import SchemaError, UnitError
from flightmech.support.input_files import demand_regular

if TYPE_CHECKING:
    import xarray as xr

_NUMBERS = (OK, FILLED, SUSPECT)
_HEAD = 4096
_CSV_HEADING = re.compile(r"^ *(?:Alpha|Delta\w+) *, *[A-Za-z]\w* *,? *$", re.MULTILINE)


def read_other(
    path: str | os.PathLike[str], deriv: Literal["DEG", "RAD"] | None
) -> xr.DataTree | None:
    """Return the tree of a file that is no print file: unit 13, unit 14, MAT, or CSV of DATCOM+
    with its card DERIV; else None.

    Raises
    ------
    UnitError
        A CSV of DATCOM+ without `deriv`.
    """
    demand_regular(path, "a file of Digital DATCOM")
    with Path(path).open("rb") as stream:
        head = stream.read(_HEAD).decode("latin-1")
    lines = head.splitlines()
    if head.startswith("MATLAB ") or Path(path).suffix.lower() == ".mat":
        from datcom_io.exchange.matlab_read import read_matlab

        return read_matlab(path)
    if lines and is_line_of_plot(lines[0]):
        from datcom_io.exchange.unit13 import read_plot

        return read_plot(path)
    if re.match(r"RUN +\d+ +\d+ +\w+ ", head):
        from datcom_io.exchange.unit14 import read_for014

        return read_for014(path)
    if _CSV_HEADING.search(head):
        if deriv is None:
            raise UnitError(
                f"{Path(path).name} does not state the unit of its derivatives; give card "
                f"DERIV of its deck: --deriv DEG or RAD"
            )
        from datcom_io.exchange.datcom_plus import read_datcom_plus_csv

        return read_datcom_plus_csv(path, deriv=deriv)
    return None


def content_rows(tree: xr.DataTree) -> list[dict[str, Any]]:
    """Return one row per leaf: ``case leaf sizes variables numbers missing``."""
    rows = []
    for leaf in (leaf for leaf in tree.subtree if leaf.data_vars):
        found = leaf.to_dataset(inherit=False)
        names = [str(name) for name in found.data_vars if not str(name).endswith("_flag")]
        flags: Counter[str] = Counter()
        for name in names:
            if f"{name}_flag" in found:
                codes = np.bincount(
                    found[f"{name}_flag"].values.ravel(), minlength=len(FLAGS)
                ).tolist()
                flags.update({FLAGS[code]: count for code, count in enumerate(codes) if count})
        rows.append(
            {
                "case": leaf.path.strip("/").rpartition("/")[0],
                "leaf": leaf.name,
                "sizes": {
                    str(dim): size for dim, size in found.sizes.items() if dim in found.coords
                },
                "variables": names,
                "numbers": sum(flags[FLAGS[code]] for code in _NUMBERS),
                "missing": {
                    name: count
                    for name, count in flags.items()
                    if name not in {FLAGS[code] for code in _NUMBERS}
                },
            }
        )
    return rows


def plot_case(listing: Listing, case: Case, plot: xr.DataTree) -> xr.DataTree | None:
    """Return the case in the plot file of its run, None without card PLOT: the cases that have the
    card stand there in order.

    Raises
    ------
    SchemaError
        The plot file holds another number of cases.
    """
    plotted = [other.ordinal for other in listing if other.deck.has("PLOT") and other.pages]
    if len(plotted) != len(plot.children):
        raise SchemaError(
            f"{plot.attrs.get('file')} is not the plot file of {listing.file}",
            [
                f"cases in the plot file: {len(plot.children)}; cases with card PLOT in the "
                f"listing: {len(plotted)}"
            ],
        )
    return (
        list(plot.children.values())[plotted.index(case.ordinal)]
        if case.ordinal in plotted
        else None
    )

"""Files that accompany the print file: plot files, MAT files, CSV of DATCOM+.

They are recognised by their content.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from datcom_io.cells import FILLED, FLAGS, OK, SUSPECT
from datcom_io.exchange.plot_files.plot_records import is_line_of_plot
from datcom_io.listing import Case, Listing
from flightmech.errors import SchemaError, UnitError
from flightmech.support.input_files import demand_regular

if TYPE_CHECKING:
    import xarray as xr

_NUMBERS = (FLAGS[OK], FLAGS[FILLED], FLAGS[SUSPECT])
_HEAD = 4096
_REFUSED = "THIS CASE NOT RUN"
_CSV_HEADING = re.compile(r"^ *(?:Alpha|Delta\w+) *, *[A-Za-z]\w* *,? *$", re.MULTILINE)


def read_other(
    path: str | os.PathLike[str], deriv: Literal["DEG", "RAD"] | None
) -> xr.DataTree | None:
    """Return the tree of a file that is not a print file, None for any other file.

    The kinds are unit 13, unit 14, MAT, and CSV of DATCOM+ with the card DERIV of its deck.

    Raises
    ------
    UnitError
        A CSV of DATCOM+ without `deriv`.
    """
    demand_regular(path, "a file of Digital DATCOM")
    # The head of the file is enough to recognise it.
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
    for leaf in tree.subtree:
        if not leaf.data_vars:
            continue
        dataset = leaf.to_dataset(inherit=False)
        names = [str(name) for name in dataset.data_vars if not str(name).endswith("_flag")]
        flags = _count_flags(dataset, names)
        row = {
            "case": leaf.path.strip("/").rpartition("/")[0],
            "leaf": leaf.name,
            "sizes": {
                str(dim): dataset.sizes[dim] for dim in dataset.sizes if dim in dataset.coords
            },
            "variables": names,
            "numbers": sum(flags[name] for name in _NUMBERS),
            "missing": {name: flags[name] for name in flags if name not in _NUMBERS},
        }
        rows.append(row)
    return rows


def _count_flags(dataset: xr.Dataset, names: list[str]) -> Counter[str]:
    """Return how often each flag occurs in the variables of a leaf."""
    flags: Counter[str] = Counter()
    for name in names:
        if f"{name}_flag" not in dataset:
            continue
        # Flags are small integers, so they are counted by index.
        codes = dataset[f"{name}_flag"].values.ravel()
        counts = np.bincount(codes, minlength=len(FLAGS)).tolist()
        for flag, count in zip(FLAGS, counts):
            if count:
                flags[flag] += count
    return flags


def plot_case(listing: Listing, case: Case, plot: xr.DataTree) -> xr.DataTree | None:
    """Return the case in the plot file of its run, None without card PLOT.

    The plot file has the cases with that card in their order.

    Raises
    ------
    SchemaError
        The plot file holds another number of cases.
    """
    plotted = [item.ordinal for item in listing if item.deck.has("PLOT") and not _is_refused(item)]
    if len(plotted) != len(plot.children):
        problem = (
            f"cases in the plot file: {len(plot.children)}; cases with card PLOT in the "
            f"listing: {len(plotted)}"
        )
        title = f"{plot.attrs.get('file')} is not the plot file of {listing.file}"
        raise SchemaError(title, [problem])
    if case.ordinal not in plotted:
        return None
    return list(plot.children.values())[plotted.index(case.ordinal)]


def _is_refused(case: Case) -> bool:
    """Return whether the program refused the cards of a case, so that nothing was written."""
    return any(_REFUSED in message.text for message in case.messages)

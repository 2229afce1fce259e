"""All printed cells in a file of comma-separated values."""

from __future__ import annotations

import os
from collections.abc import Iterable

from flightmech.support.atomic_write import written_atomically

from ..printout.content import PrintedCase
from .cell_frame import COLUMNS, cells


def write_cells(cases: Iterable[PrintedCase], path: str | os.PathLike[str]) -> int:
    """Write the cells of cases as they come, one line per cell; a file that stood there stays as it was when writing fails.

    Parameters
    ----------
    cases : iterable of PrintedCase
        A `Listing`, or what `datcom_io.iterate` returns: then one case at a time is held in memory.
    path : path
        CSV file in UTF-8; its folder must exist.  Columns as those of `Case.cells`, all axes included; a missing number is empty.

    Returns
    -------
    int
        Cells written.
    """
    count = 0
    with written_atomically(path) as part, open(part, "w", encoding="utf-8", newline="") as stream:
        stream.write(",".join(COLUMNS) + "\n")
        for case in cases:
            frame = cells([case]).reindex(columns=list(COLUMNS))
            frame.to_csv(stream, header=False, index=False, lineterminator="\n")
            count += len(frame)
    return count

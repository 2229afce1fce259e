"""Function that performs the command ``fmu show``."""

from __future__ import annotations

from flightmech.fmu_export.fmu_reading import read_fmu
from flightmech.support.console import print_json, print_remark, print_table


def print_fmu(path: str, as_json: bool) -> None:
    """Perform the command ``show``."""
    found = read_fmu(path)
    if as_json:
        print_json(found)
        return
    columns = ("name", "causality", "variability", "unit", "start", "description")
    rows = []
    for row in found["variables"]:
        rows.append(["" if row[column] is None else row[column] for column in columns])
    print_table(
        columns,
        rows,
        title=f"{found['model']}  FMI {found['fmi']}  {' '.join(found['platforms'])}",
        right=("start",),
    )
    if not found["runs_here"]:
        print_remark(
            f"no library for this platform, {found['platform']}; the FMU runs on "
            f"{', '.join(found['platforms']) or 'none'}"
        )
    for finding in found["findings"]:
        print_remark(f"finding: {finding}")

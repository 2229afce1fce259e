"""Thin the trajectories of tool 4 to what `test_nesc.py` compares: ``python thin.py FOLDER``, the
folder of the published files.

Writes ``case_NN.csv`` next to this file: every tenth row (1 s) of the columns below, each number as
it was published.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

COLUMNS = [
    "time",
    "altitudeMsl_ft",
    *(f"feVelocity_ft_s_{axis}" for axis in "XYZ"),
    *(f"eulerAngle_deg_{angle}" for angle in ("Roll", "Pitch", "Yaw")),
    *(f"bodyAngularRateWrtEi_deg_s_{angle}" for angle in ("Roll", "Pitch", "Yaw")),
]
AIR = ["ambientTemperature_dgR", "airDensity_slug_ft3", "mach"]  # compared in case 9


def thin(folder: Path, case: int) -> None:
    """Write the thinned trajectory of one case."""
    (file,) = folder.glob(f"Atmos_{case:02d}_*/*_sim_04.csv")
    with file.open(encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    columns = COLUMNS + AIR * (case == 9)
    with (
        Path(__file__)
        .with_name(f"case_{case:02d}.csv")
        .open("w", encoding="utf-8", newline="") as target
    ):
        writer = csv.writer(target, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows([row[name] for name in columns] for row in rows[::10])


if __name__ == "__main__":
    for number in (1, 2, 3, 6, 7, 9):
        thin(Path(sys.argv[1]), number)

"""Trim the T-37 over airspeed and print elevator, angle of attack and throttle of level flight.

    python examples/trim_over_speed.py

Speeds and heights are texts with units, as in the files.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

import aerodb
import datcom_io
import flightmech
from flightmech.units import DEGREE

DATA = Path(__file__).parents[1] / "data" / "t37"
SPEEDS = (140, 160, 180, 200, 220)  # calibrated airspeed [kt]


def main() -> pd.DataFrame:
    """Print and return one row per speed."""
    aircraft = flightmech.read_aircraft(DATA / "aircraft.toml")
    prior = aerodb.from_datcom(
        aircraft,
        clean=datcom_io.read(DATA / "datcom" / "t37_clean.out"),
        elevator=datcom_io.read(DATA / "datcom" / "t37_elevator_one_by_one.pdas.out"),
    )
    sim = flightmech.compile(aircraft, prior)
    rows = []
    for speed in SPEEDS:
        level = flightmech.trim(sim, V_cas=f"{speed} kt", h="5000 ft")
        rows.append(
            {
                "V_cas [kt]": speed,
                "alpha [deg]": float(level["alpha"]) / DEGREE,
                "delta_e [deg]": float(level["applied.delta_e"]) / DEGREE,
            }
        )
    table = pd.DataFrame(rows)
    print(table.round(2).to_string(index=False))
    return table


if __name__ == "__main__":
    main()

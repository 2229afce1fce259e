"""Check a recording before it is used, and list the manoeuvres that its controls show.

python examples/check_a_record.py
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

import flightmech
import flighttest

DATA = Path(__file__).parents[1] / "data" / "c182"


def main() -> tuple[flighttest.quality.Quality, pd.DataFrame]:
    """Print the findings and the manoeuvres."""
    record = flighttest.read(DATA / "flight" / "cruise.csv", DATA / "names.toml")
    quality = flighttest.assess(record, flightmech.read_aircraft(DATA / "aircraft.toml"))
    print(quality.verdict)
    print(quality.to_dataframe()[["severity", "name"]].to_string(index=False))
    marks = flighttest.manoeuvres(record)
    print(marks.drop(columns="note").to_string(index=False))
    return quality, marks


if __name__ == "__main__":
    main()

"""Identify the pitching moment of the C182 from its manoeuvres of the elevator:
record, states, coefficients, manoeuvres and regression.

    python examples/identify_pitch.py
"""

from __future__ import annotations

from pathlib import Path

import flightmech
import flighttest

DATA = Path(__file__).parents[1] / "data" / "c182"


def main() -> flighttest.Fit:
    """Print and return the fit."""
    aircraft = flightmech.read_aircraft(DATA / "aircraft.toml")
    record = flighttest.read(DATA / "flight" / "cruise.csv", DATA / "names.toml")
    path = flighttest.reconstruct(record, aircraft)
    data = flighttest.coefficients(path, aircraft, cutoff="4 Hz")
    marks = flighttest.manoeuvres(record)
    chosen = marks[(marks["control"] == "elevator") & marks["manoeuvre"].isin(["3211", "doublet"])]
    windows = [flighttest.select_time(data, row.start, row.end) for row in chosen.itertuples()]
    model = flighttest.RegressionModel.parse("Cm = 1 + alpha + qhat + delta_e")
    fit = flighttest.regress(model, windows, name="elevator")
    print(fit)
    return fit


if __name__ == "__main__":
    main()

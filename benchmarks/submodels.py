"""Submodels identified from simulated records whose truth is kept apart: ground effect and landing gear.

    python benchmarks/submodels.py FOLDER -o answers.json [--only ground_effect]

FOLDER holds one folder of records per submodel.  Each set is answered by public calls alone and the answers are written as
``{"ground_effect": {...}, "landing_gear": {...}}``, every estimate as [value, standard error] in SI units and radians.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import pandas as pd
import xarray as xr

import flighttest
from flightmech.support.atomic_write import written_whole

_COLUMNS = {
    "h": "h_agl",
    "alpha": "alpha",
    "de": "delta_e",
    "phi": "phi",
    "beta": "beta",
    "da": "delta_a",
    "CL": "CL",
    "CD": "CD",
    "Cm": "Cm",
    "Cl": "Cl",
}
_RATES = {"qc_V": "qhat", "pb_V": "phat", "rb_V": "rhat"}  # the records divide by V, the vocabulary by 2 V
_TOUCHED = 0.002  # m, ten times the noise of the compression: below, the wheel may be off the ground
_COEFFICIENTS = (
    "CL = 1 + alpha + qhat + delta_e",
    "CD = 1 + alpha + alpha^2",
    "Cm = 1 + alpha + qhat + delta_e",
    "Cl = 1 + beta + phat + rhat + delta_a",
)
_TERMS = {"1": "one", "alpha": "alpha", "alpha**2": "alpha2", "qhat": "q", "delta_e": "de", "CL*phi": "CLphi"}


def ground_effect(folder: Path) -> dict:
    """Return k and s of what is identified, and the names of what is not."""
    data = [_over_runway(pd.read_csv(file)) for file in sorted(folder.glob("*.csv.gz"))]
    found = flighttest.identify_ground_effect([flighttest.Model.parse(text) for text in _COEFFICIENTS], data)
    print(found.report([2.0, 3.0, 8.5]))
    answers: dict = {
        name: {_TERMS[row.term]: {"k": [row.k, row.k_stderr], "s": [row.s, row.s_stderr]} for row in one.rows()}
        for name, one in found.coefficients.items()
    }
    answers["not_identified"] = [f"{name}:{_TERMS[term]}" for name, one in found.coefficients.items() for term in one.not_identified]
    return answers


def landing_gear(folder: Path) -> dict:
    """Return spring, damping, friction and slip stiffness: F = K1 z + K2 z^2 + C w |w|, Fy = -mu Fz tanh(Cs slip / mu)."""
    drops = pd.read_csv(folder / "touchdowns.csv.gz")
    drops = drops[drops["compression_m"] > _TOUCHED]
    touched = [
        xr.Dataset(
            {new: ("time", one[old].values) for old, new in (("compression_m", "z"), ("rate_mps", "w"), ("Fz_N", "F"))},
            {"time": one["t"].values},
        )
        for _, one in drops.groupby("drop")
    ]
    strut = flighttest.SeparableModel.parse("F = z + z^2 + w*abs(w)", units={"F": "N", "z": "m", "w": "m s-1"})
    vertical = flighttest.regress_separable(strut, touched, "strut")
    points = pd.read_csv(folder / "side_force.csv")
    steady = xr.Dataset(
        {new: ("time", points[old].values) for old, new in (("Fz_N", "Fz"), ("slip_rad", "slip"), ("Fy_N", "Fy"))},
        {"time": points.index.values.astype(float)},
    )
    tyre = flighttest.SeparableModel.parse("Fy = Fz*tanh(g*slip)", {"g": (0.5, 60.0)}, {"Fy": "N", "Fz": "N", "slip": "rad"})
    side = flighttest.regress_separable(tyre, steady, "side force")
    print(f"{vertical.report()}\n\n{side.report()}")
    values, C = side.derived("-[Fz*tanh(g*slip)]", "-[Fz*tanh(g*slip)]*g")
    found = {name: list(vertical.value(term)) for name, term in (("K1", "z"), ("K2", "z^2"), ("C", "w*abs(w)"))}
    return {**found, **{name: [float(value), float(variance**0.5)] for name, value, variance in zip(("mu", "Cs"), values, C.diagonal())}}


def _over_runway(record: pd.DataFrame) -> xr.Dataset:
    columns = {new: ("time", record[old].values) for old, new in _COLUMNS.items()}
    rates = {new: ("time", 0.5 * record[old].values) for old, new in _RATES.items()}
    return xr.Dataset({**columns, **rates}, {"time": record["t"].values})


SETS = {"ground_effect": ground_effect, "landing_gear": landing_gear}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--only", choices=list(SETS), action="append")
    given = parser.parse_args()
    answered = {name: answer(given.folder / name) for name, answer in SETS.items() if name in (given.only or SETS)}
    with written_whole(given.output) as part:
        part.write_text(json.dumps(answered, indent=1))

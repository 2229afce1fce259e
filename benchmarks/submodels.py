"""Submodels identified from simulated records whose truth is kept apart: engine, ground effect,
landing gear and control loading.

    python benchmarks/submodels.py FOLDER -o answers.json [--only ground_effect]

FOLDER holds one folder of records per submodel, and truth/ with surveyed quantities: the drag polar
of the partial climbs, gearing and hinge of the elevator; no other entry of it is opened.  Each set
is answered by public calls alone and the answers are written as ``{"ground_effect": {...},
"landing_gear": {...}}``, every estimate as [value, standard error] in SI units and radians.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

import flighttest
from flightmech.support.atomic_write import written_atomically
from flightmech.terms import make_term

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
_RATES = {
    "qc_V": "qhat",
    "pb_V": "phat",
    "rb_V": "rhat",
}  # the records divide by V, the vocabulary by 2 V
_FULL = 60.0  # lever angle of full power [deg]
_SPEEDS = (50, 70, 90, 76, 62, 85)  # of n2 [%], the first three that were run are answered
_POINTS = {"N1_pct": "n1", "Mach": "mach", "h_m": "h"}
_CLIMBS = {"V_mps": "V", "mass_kg": "mass", "Vdot": "V_dot", "hdot": "h_dot", "CL": "CL"}
_COEFFICIENTS = (
    "CL = 1 + alpha + qhat + delta_e",
    "CD = 1 + alpha + alpha^2",
    "Cm = 1 + alpha + qhat + delta_e",
    "Cl = 1 + beta + phat + rhat + delta_a",
)
_TERMS = {
    "1": "one",
    "alpha": "alpha",
    "alpha**2": "alpha2",
    "qhat": "q",
    "delta_e": "de",
    "CL*phi": "CLphi",
}


def engine(folder: Path) -> dict:
    """Return delay, ratio of the time constants, tables over speed and lever, and the correction of
    the deck; the start is printed.
    """
    spools = flighttest.engine.identify_spools(
        [_power_change(file) for file in sorted(folder.glob("tr*.csv.gz"))]
    )
    a_priori = pd.read_csv(folder / "apriori_deck.csv")
    mach = [float(name.rpartition("_M")[2]) for name in a_priori.columns[1:]]
    prior = make_term(
        1e3 * a_priori.iloc[:, 1:].values,
        {"corrected_n1": a_priori.iloc[:, 0].values / 100.0, "mach": mach},
    )
    static = _columns(
        folder / "static_points.csv", {**_POINTS, "T_static_K": "temperature", "thrust_N": "thrust"}
    )
    climbs = _columns(folder / "partial_climbs.csv", _POINTS | _CLIMBS)
    known = json.loads((folder.parent / "truth" / "engine_truth.json").read_text())["climbs"]
    polar = flighttest.engine.Polar(known["CD0"], known["K"])
    deck = flighttest.engine.correct_deck(
        prior, static, climbs, polar, known["S"], known["engines"]
    )
    started = flighttest.engine.identify_start([_start(folder / "start_stop.csv")])
    print(f"{spools.report()}\n\n{deck.report()}\n\n{started.report()}")
    times, schedule = spools.tables["n2_up_time"], spools.tables["n2_command"]
    lowest, *_, highest = (100.0 * x for x in times.leaf["n2"].values)
    speeds = [n for n in _SPEEDS if lowest - 0.5 <= n <= highest][:3]
    return {
        "delay_s": list(spools.constants["lever_delay"]),
        "decel_factor": list(spools.constants["ratio"]),
        "tau_N2_accel": {str(n): list(times.at(n / 100.0)) for n in speeds},
        "N2_steady": {
            str(pla): [100.0 * x for x in schedule.at(pla / _FULL)] for pla in (10, 32, 50)
        },
        "correction_ratio": {
            str(n): list(deck.ratio(n / 100.0, float(np.mean(mach)))) for n in (92, 98)
        },
    }


def ground_effect(folder: Path) -> dict:
    """Return k and s of what is identified, and the names of what is not."""
    data = [_over_runway(pd.read_csv(file)) for file in sorted(folder.glob("*.csv.gz"))]
    found = flighttest.identify_ground_effect(
        [flighttest.RegressionModel.parse(text) for text in _COEFFICIENTS], data
    )
    print(found.report([2.0, 3.0, 8.5]))
    answers: dict = {
        name: {
            _TERMS[row.term]: {"k": [row.k, row.k_stderr], "s": [row.s, row.s_stderr]}
            for row in one.rows()
        }
        for name, one in found.coefficients.items()
    }
    answers["not_identified"] = [
        f"{name}:{_TERMS[term]}"
        for name, one in found.coefficients.items()
        for term in one.not_identified
    ]
    return answers


def landing_gear(folder: Path) -> dict:
    """Return spring, damping, friction and slip stiffness: F = K1 z + K2 z^2 + C w |w|, Fy = -mu Fz
    tanh(Cs slip / mu).
    """
    drops = pd.read_csv(folder / "touchdowns.csv.gz")
    columns = {"compression_m": "compression", "rate_mps": "rate", "Fz_N": "load"}
    strut = flighttest.landing_gear.fit_strut(
        [_series(one, columns, one["t"].values) for _, one in drops.groupby("drop")]
    )
    points = pd.read_csv(folder / "side_force.csv")
    columns = {"Fz_N": "load", "slip_rad": "slip", "Fy_N": "side_force"}
    side = flighttest.landing_gear.fit_side_force(
        _series(points, columns, points.index.values.astype(float))
    )
    names = {
        "K1": "stiffness",
        "K2": "stiffness_square",
        "C": "orifice",
        "mu": "mu",
        "Cs": "cornering",
    }
    found = {**strut, **side}
    return {answer: [found[name].value, found[name].stderr] for answer, name in names.items()}


def _series(table: pd.DataFrame, names: dict[str, str], time: np.ndarray) -> xr.Dataset:
    return xr.Dataset(
        {new: ("time", table[old].values) for old, new in names.items()}, {"time": time}
    )


def _power_change(file: Path) -> xr.Dataset:
    """Return a record, two samples averaged to one."""
    record = pd.read_csv(file)
    record = record.groupby(np.arange(len(record)) // 2).mean()[: len(record) // 2]
    columns = {
        "throttle": record["PLA_deg"] / _FULL,
        "n1": record["N1_pct"] / 100.0,
        "n2": record["N2_pct"] / 100.0,
    }
    columns |= {"mach": record["Mach"], "h": record["h_m"]}
    return xr.Dataset(
        {name: ("time", x.values) for name, x in columns.items()},
        {"time": record["t"].values},
        {"record": file.name},
    )


def _start(file: Path) -> xr.Dataset:
    record = pd.read_csv(file)
    columns = {
        "starter": record["starter"],
        "cutoff": 1.0 - record["fuel_on"],
        "n2": record["N2_pct"] / 100.0,
    }
    columns |= {"fuel_flow": record["fuel_flow_kgps"], "itt": record["ITT_degC"] + 273.15}
    return xr.Dataset(
        {name: ("time", x.values.astype(float)) for name, x in columns.items()},
        {"time": record["t"].values},
    )


def _columns(file: Path, names: dict[str, str]) -> xr.Dataset:
    table = pd.read_csv(file)
    found = xr.Dataset({new: ("point", table[old].values) for old, new in names.items()})
    return found.assign(n1=found["n1"] / 100.0)


_CHANNELS = {
    "F_N": "F_column",
    "s_m": "column",
    "de_rad": "delta_e",
    "qbar_Pa": "qbar",
    "alpha_rad": "alpha",
    "tab_rad": "delta_t",
    "nz": "nz",
}


def control_loading(folder: Path) -> dict:
    """Return hinge moments, friction, breakout force, unbalance, masses and cable of an elevator
    circuit.
    """
    surveyed = json.loads((folder.parent / "truth" / "control_loading_truth.json").read_text())[
        "parameters"
    ]
    G, S_hinge, c_hinge = (surveyed[name] for name in ("G", "Se", "ce"))
    loading = flighttest.control_loading.ControlLoading(
        "column", -G, S_hinge, c_hinge, "Ch_e = 1 + alpha + delta_e + delta_t"
    )
    sweeps = [_cockpit(file) for file in sorted(folder.glob("*_sweep.csv.gz"))]
    free = [
        _cockpit(file)
        for kind in ("pulse", "release")
        for file in sorted(folder.glob(f"*_{kind}.csv.gz"))
    ]
    found = flighttest.identify_control_loading(loading, sweeps, free)
    print(found.report())
    names = {
        "Ch0": "Ch_e: 1",
        "Cha": "Ch_e: alpha",
        "Chd": "Ch_e: delta_e",
        "Cht": "Ch_e: delta_t",
        "breakout": "preload",
    }
    names |= {"unbalance": "offset", "mf": "mass", "Ia": "inertia", "Kc": "cable_stiffness"}
    answers: dict = {answer: list(found.value(name)) for answer, name in names.items()}
    answers["friction_total"] = list(found.total("friction"))
    known_as = {"bob_weight": "bob", **{name: answer for answer, name in names.items()}}
    answers["collinear"] = sorted({known_as[name] for pair in found.collinear for name in pair})
    return answers


def _cockpit(file: Path) -> xr.Dataset:
    record = pd.read_csv(file)
    return xr.Dataset(
        {new: ("time", record[old].values) for old, new in _CHANNELS.items()},
        {"time": record["t"].values},
    )


def _over_runway(record: pd.DataFrame) -> xr.Dataset:
    columns = {new: ("time", record[old].values) for old, new in _COLUMNS.items()}
    rates = {new: ("time", 0.5 * record[old].values) for old, new in _RATES.items()}
    return xr.Dataset({**columns, **rates}, {"time": record["t"].values})


SETS = {
    "engine": engine,
    "ground_effect": ground_effect,
    "landing_gear": landing_gear,
    "control_loading": control_loading,
}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--only", choices=list(SETS), action="append")
    given = parser.parse_args()
    answered = {
        name: answer(given.folder / name)
        for name, answer in SETS.items()
        if name in (given.only or SETS)
    }
    with written_atomically(given.output) as part:
        part.write_text(json.dumps(answered, indent=1))

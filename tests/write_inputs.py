"""Small inputs of verbs, for `test_write_failures`: files of simulated records and their
aircraft.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import glider_flight
import numpy as np
import pandas as pd
import stall_records
import xarray as xr

import aerodb
from aerodb.edit.term_edits import replace_terms
from flightmech.aircraft.propulsion.engine_deck import write_tables
from flightmech.terms import make_term

ROOT = Path(__file__).parents[1]
COPIED = {"avl": ROOT / "data" / "avl", "listing": ROOT / "tests" / "datcom_io" / "listings"}
"""Folders whose files are copied, by the name of an input."""
# Terms that keep their standard errors: the plan and the rows rest on few of them.
_UNCERTAIN = ("Cm/basic", "Cm/qhat", "CL/basic")


def write_example(name: str, folder: Path) -> None:
    """Write the files of a module of the examples into a folder."""
    file = ROOT / "examples" / "flapping_vehicle" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, file)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    module.main(folder)


def write_stalls(folder: Path) -> None:
    """Write two stalls as paths: accelerations at the c.g. follow from the lift and drag."""
    rng = np.random.default_rng(11)
    S, mass = 17.0, 2000.0
    lengths = f"S = {S}\ncbar = {stall_records.CBAR}\nb = {stall_records.SPAN}\nmass = {mass}\n"
    inertia = "Ixx = 9e3\nIyy = 8e3\nIzz = 15e3\n"
    # for the export to JSBSim
    limits = '[limits]\ndelta_e = ["-25 deg", "15 deg"]\ndelta_f = ["0 deg", "40 deg"]\n'
    (folder / "jet.toml").write_text(f'name = "jet"\n{lengths}{inertia}{limits}')
    aerodb.save(stall_records.attached_database(), folder / "jet.nc")
    for name, kind in (("slow", "quasi-steady"), ("fast", "accelerated")):
        one = stall_records.stall_record(rng, kind)
        alpha, qbar = one["alpha"], 0.5 * 1.0 * one["V"] ** 2
        scale = qbar * S / mass
        rates = {f"{rate}_dot": one[rate].differentiate("time") for rate in "pqr"}
        states = one.drop_vars(["CL", "CD", "Cm", "Cl", "Cn"]).assign(
            qbar=qbar,
            ax=scale * (one["CL"] * np.sin(alpha) - one["CD"] * np.cos(alpha)),
            ay=0.0 * alpha,
            az=-scale * (one["CL"] * np.cos(alpha) + one["CD"] * np.sin(alpha)),
            **rates,
        )
        tree = xr.DataTree.from_dict({"/states": states})
        tree.to_netcdf(folder / f"{name}.nc", engine="h5netcdf")


def write_points(folder: Path) -> None:
    """Write settled points whose thrust is 3 % above that of a deck, and the deck."""
    n1, h = np.tile([0.72, 0.8, 0.9, 1.0], 10), np.full(40, 1500.0)
    mach = np.linspace(0.2, 0.45, 40)
    # 1500 m of the standard atmosphere: temperature 278.4 K, pressure 84556 Pa
    theta, delta = (
        278.4 / 288.15 * (1.0 + 0.2 * mach**2),
        84556 / 101325 * (1.0 + 0.2 * mach**2) ** 3.5,
    )
    values = 1e3 * np.outer([0.9, 4.0, 8.0, 10.0, 11.0], [1.0, 0.9, 0.8])
    axes = {"corrected_n1": [0.3, 0.7, 0.9, 1.0, 1.1], "mach": [0.0, 0.3, 0.6]}
    deck = make_term(values, axes)
    at = {
        "corrected_n1": xr.DataArray(n1 / np.sqrt(theta)),
        "mach": xr.DataArray(mach),
    }
    thrust = 1.03 * delta * deck["value"].interp(at).values
    columns = {"n1": n1, "mach": mach, "h": h, "thrust": thrust}
    pd.DataFrame(columns).to_csv(folder / "points.csv", index=False)
    times = {"n2_command": make_term(0.9), "n2_up_time": make_term(1.0)}
    write_tables({"corrected_thrust": deck, **times}, folder / "prior_deck.nc")


def write_few(folder: Path) -> None:
    """Write the a-priori database with standard errors of few terms."""
    prior = aerodb.open(folder / "prior.nc")
    changed = {}
    for name, leaf in aerodb.terms(prior).items():
        if name not in _UNCERTAIN and "stderr" in leaf:
            changed[name] = leaf.drop_vars("stderr")
    aerodb.save(replace_terms(prior, changed), folder / "few.nc")


def write_glider(folder: Path) -> None:
    """Write a simulated flight with its plan of evaluation into a folder in the folder."""
    (folder / "glider").mkdir()
    glider_flight.write_glider_flight(folder / "glider")


WRITERS: dict[str, Callable[[Path], None]] = {
    "stalls": write_stalls,
    "points": write_points,
    "few.nc": write_few,
    "glider": write_glider,
    **{
        name: partial(write_example, name)
        for name in ("tunnel", "cameras", "vehicle", "actuator_bench")
    },
}
"""Functions that write files into a folder, by the name of an input."""

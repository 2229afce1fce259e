"""Small inputs of verbs, for `test_write_failures`: files of simulated records and their
aircraft.
"""

from __future__ import annotations

import importlib.util
import re
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
# A catalogue with one manoeuvre.
CONDITION = """
title = "T-37, pitch"
margin = 0.8
held = [
  "CL/altitude", "CL/flap", "CL/flap_slope", "CL/elevator", "CL/qhat", "CL/alphadothat",
  "CL/ground", "CL/ground_flap", "Cm/altitude", "Cm/flap", "Cm/elevator", "Cm/alphadothat",
  "Cm/ground", "Cm/ground_flap",
]
[limits]
alpha = ["-6 deg", "14 deg"]
nz = [0.0, 2.5]
[[condition]]
name = "clean 5000 ft"
setup = "60 s"
fixed = { V = "175 kt", h = "5000 ft" }
[[manoeuvre]]
name = "3211 elevator"
kind = "multistep"
[manoeuvre.axis.delta_e]
amplitude = "2 deg"
pattern = "3-2-1-1"
step = "0.6 s"
rise = "0.1 s"
free = "4 s"
[[fit]]
name = "pitch"
manoeuvres = ["3211 elevator"]
models = ["CL = 1 + alpha + qhat + delta_e", "Cm = 1 + alpha + qhat + delta_e"]
"""
ONE_FIT = """
[[fit]]
name = "pitch"
records = ["slow"]
manoeuvres = ["3211 elevator"]
models = ["CL = 1 + alpha + qhat + delta_e", "Cm = 1 + alpha + qhat + delta_e"]
"""
# Small inputs by the name of their file.
TEXTS = {
    "inputs.csv": "time,delta_e\n0,0\n1,0.01\n2,0\n",
    "design.toml": """
kind = "multisine"
title = "elevator"
period = "10 s"
band = ["0.2 Hz", "1 Hz"]
[axis.delta_e]
amplitude = "2 deg"
""",
    "ice.toml": """
title = "tail ice"
reference = "NASA, 1993"
valid = "flap 0"
[terms."CL/basic"]
factor = 0.9
factor_stderr = 0.05
""",
    "fit.toml": """
title = "C182, roll"
aircraft = "aircraft.toml"
database = "db.nc"
outputs = ["p", "r"]
[[record]]
file = "p.nc"
window = [3.0, 8.0]
[parameter]
"term.Cl.phat" = { sigma = 0.2 }
"bias.Cl" = { sigma = 0.05 }
"init.p" = { own = true }
"init.r" = { own = true }
""",
    "catalogue.toml": f"""
{CONDITION}
[[wanted_row]]
row = "2.c.10"
condition = "clean 5000 ft"
manoeuvre = "3211 elevator"
ratio = 0.5
""",
    "plan.toml": f"""
{CONDITION}
[[wanted]]
term = "CL/basic"
within = {{ alpha = ["0 deg", "6 deg"], mach = [0.2, 0.3] }}
ratio = 0.5
""",
    # stands for the program: it prints what it printed of the shipped deck
    "datcom.sh": f"#!/bin/sh\ncp {ROOT / 'data' / 'c182'}/datcom/aileron.out for006.dat\n",
}
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


def keep_one_case(folder: Path) -> None:
    """Leave one case of the C182, its record, and 15 s of another record with one fit.

    A match of it writes files of all kinds in a tenth of the time.
    """
    for kind, kept in (("flight", ("slow", "check_short_period")), ("cases", ("short_period",))):
        for file in (folder / kind).iterdir():
            if file.stem not in kept:
                file.unlink()
    slow = folder / "flight" / "slow.csv"
    pd.read_csv(slow).query("`Time (s)` < 14.5").to_csv(slow, index=False)
    flown = pd.read_csv(folder / "manoeuvres.csv")
    is_kept = flown["record"].eq("check_short_period")
    is_kept |= flown["record"].eq("slow") & flown["end"].lt(14.5)
    flown[is_kept].to_csv(folder / "manoeuvres.csv", index=False)
    project = folder / "aeromatch.toml"
    project.write_text(project.read_text().partition("[[fit]]")[0] + ONE_FIT)


def write_short_deck(folder: Path) -> None:
    """Write the deck of the C182 with one Mach number and two angles of attack."""
    text = (folder / "datcom" / "c182_study.inp").read_text()
    text = re.sub(r"NMACH=3.0,MACH\(1\)=[\d.,]*,NALT", "NMACH=1.0,MACH(1)=0.1,NALT", text)
    text, count = re.subn(r"NALPHA=[^$]*", "NALPHA=2.0,ALSCHD(1)=0.0,4.0", text)
    assert count == 1
    (folder / "short.inp").write_text(text)


WRITERS: dict[str, Callable[[Path], None]] = {
    "stalls": write_stalls,
    "points": write_points,
    "few.nc": write_few,
    "glider": write_glider,
    "small": keep_one_case,
    "short.inp": write_short_deck,
    **{
        name: partial(write_example, name)
        for name in ("tunnel", "cameras", "vehicle", "actuator_bench")
    },
}
"""Functions that write files into a folder, by the name of an input."""

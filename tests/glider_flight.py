"""A simulated flight of a glider with a plan of its evaluation."""

from pathlib import Path

import numpy as np

AIRCRAFT = """
name = "glider"
S = 16.0
cbar = 1.5
b = 10.0
x_ref_mac = 0.25
mass = 900.0
Ixx = 2000.0
Iyy = 2500.0
Izz = 4000.0
"""
LOADING = """
[loading]
file = "loading.csv"
item = "item"
mass = { column = "mass", unit = "lb" }
station = { column = "arm", unit = "in" }
fuel = "fuel"
leading_edge = "100 in"
[loading.fuel_table]
file = "fuel.csv"
mass = { column = "mass", unit = "lb" }
moment = { column = "moment", unit = "in lb", scale = 100 }
"""
PLAN = """
title = "Dutch roll of a simulated flight"
record = "flight.csv"
names = "names.toml"
aircraft = "aircraft.toml"

[manoeuvres]
file = "manoeuvres.csv"
name = "motion"
time = { column = "start", unit = "s" }

[[mode]]
name = "dutch_roll"
on = "dutch_roll"
window = [0.0, 15.0]
channels = ["r"]

[[bound]]
of = "dutch_roll.period"
value = "3.1416 s"
within = "1 %"
source = "made so"
[[bound]]
of = "dutch_roll.damping_ratio"
low = 0.09
high = 0.11
source = "made so"
"""
NAMES = """
[time]
column = "t"
[ahrs]
p = "p"
q = "q"
r = "r"
phi = "phi"
theta = "theta"
"""


def write_glider_flight(folder: Path) -> None:
    """Write a flight with a Dutch roll at 20 s, kinematically exact, and its plan of evaluation."""
    t = np.arange(1000) / 20.0
    after = np.clip(t - 20.0, 0.0, None)
    oscillation = (t >= 20.0) * np.exp(-0.2 * after)
    before = (t < 20.0) * np.sin(0.2 * np.pi * t)
    phi, theta = 0.1 * before + 0.05 * oscillation * np.sin(2.0 * after), 0.05 * before * (t < 10.0)
    rate = np.gradient(phi, t)
    q, psi_dot = np.gradient(theta, t), 0.1 * oscillation * np.cos(2.0 * after)
    columns = {
        "t": t,
        "p": rate - psi_dot * np.sin(theta),
        "q": q * np.cos(phi) + psi_dot * np.cos(theta) * np.sin(phi),
    }
    columns |= {
        "r": psi_dot * np.cos(theta) * np.cos(phi) - q * np.sin(phi),
        "phi": phi,
        "theta": theta,
    }
    units = ["s", *["rad s-1"] * 3, *["rad"] * 2]
    rows = [
        ",".join(columns),
        ",".join(units),
        *(",".join(f"{x:.9g}" for x in row) for row in np.column_stack(list(columns.values()))),
    ]
    (folder / "flight.csv").write_text("\n".join(rows) + "\n")
    (folder / "names.toml").write_text(NAMES)
    (folder / "aircraft.toml").write_text(AIRCRAFT)
    (folder / "manoeuvres.csv").write_text("motion,start\ndutch_roll,20.0\n")
    (folder / "plan.toml").write_text(PLAN)
    (folder / "loading.csv").write_text("item,mass,arm\nempty,1500,110\ncrew,400,90\nfuel,300,\n")
    (folder / "fuel.csv").write_text("mass,moment\n100,120\n400,480\n")

"""Fly the T-37 of ``data/t37``: trim, elevator doublet, take-off and landing, with a plot of each.

    python examples/fly_the_t37.py [folder] [database.nc]

The database is the a-priori one of the DATCOM listings unless a file is given, such as
``out/t37/final.nc`` of ``aeromatch demo``. Needs matplotlib (``pip install 'aeromatch[figures]'``).
"""

# %% The aeroplane: an aircraft file, a database, one compiled model

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd
import xarray as xr

import aerodb
import flightmech
from aeromatch.project.project import read_project
from aeromatch.workflow.aerodynamics import a_priori
from flightmech.simulation.kernel import INPUT, OUTPUT, Simulation
from flightmech.simulation.run import index_of_parameter

matplotlib.use("Agg")
import matplotlib.pyplot as plt

DATA = Path(__file__).parents[1] / "data" / "t37"
DEG, KT = np.pi / 180.0, 1852.0 / 3600.0
RUNWAY = 120.0  # elevation [m]


def model(database: str | None = None) -> flightmech.SimModel:
    """Return the compiled aeroplane."""
    aircraft = flightmech.read_aircraft(DATA / "aircraft.toml")
    db = (
        aerodb.open(database)
        if database
        else a_priori(read_project(DATA / "aeromatch.toml"), aircraft)
    )
    return flightmech.compile(aircraft, db)


# %% Trim: what the aeroplane needs to fly level, and how it moves about that state

CRUISE = {"init.V": 180 * KT, "init.h": 1524.0, "mode.earth": 0.0}


def trimmed(sim: flightmech.SimModel) -> tuple[xr.Dataset, pd.DataFrame]:
    """Return the level flight and the table of its modes."""
    level = flightmech.trim(sim, CRUISE, kind="level")
    plant = flightmech.linearize(sim, CRUISE)
    return level, flightmech.modes(plant)


# %% Doublet: recorded inputs in, all outputs back, in one call


def doublet(sim: flightmech.SimModel) -> xr.Dataset:
    """Return the answer to two degrees of elevator, one second each way."""
    time = np.arange(0.0, 12.0, 0.01)
    elevator = 2 * DEG * (((time > 1) & (time <= 2)).astype(float) - ((time > 2) & (time <= 3)))
    record = xr.Dataset({"delta_e": ("time", elevator)}, {"time": time})
    return flightmech.simulate(sim, record, {**CRUISE, "mode.trim": 2.0}, hold="zero", terms=True)


# %% Take-off: brakes, full power, rotation; the runway carries the aeroplane until the wing does


def takeoff(sim: flightmech.SimModel) -> xr.Dataset:
    """Return a take-off with flaps half, rotated at 85 kt by a scheduled elevator."""
    time = np.arange(0.0, 40.0, 0.02)
    brake = np.interp(time, [0.0, 8.0, 8.2], [1.0, 1.0, 0.0])
    elevator = np.interp(time, [0.0, 19.5, 21.0, 25.0, 33.0], [0.0, 0.0, -7.0, -5.5, -2.0]) * DEG
    lever = np.interp(time, [1.0, 3.0], [0.0, 1.0])
    inputs = {"delta_e": elevator, "brake_left": brake, "brake_right": brake}
    inputs |= {f"engine{i}.throttle": lever for i in (1, 2)}
    record = xr.Dataset({name: ("time", values) for name, values in inputs.items()}, {"time": time})
    start = {
        "mode.trim": 3.0,
        "init.V": 0.0,
        "env.runway_elevation": RUNWAY,
        "init.h": RUNWAY + 1.0,
        "mode.earth": 0.0,
    }
    return flightmech.simulate(sim, record, {**start, "gear": 1.0, "delta_f": 20 * DEG})


# %% Landing: a pilot in the loop, step by step


def landing(sim: flightmech.SimModel) -> xr.Dataset:
    """Return a landing flown by two simple laws: glide path and speed, then a flare; brakes after
    the nose wheel is down.
    """
    run = Simulation(sim.model)
    u = dict.fromkeys(sim.inputs, 0.0) | {"gear": 1.0, "delta_f": 40 * DEG}
    approach = {
        "init.V": 95 * KT,
        "init.gamma": -3 * DEG,
        "init.h": RUNWAY + 60.0,
        "env.runway_elevation": RUNWAY,
        "mode.earth": 0.0,
    }
    for name, value in {**approach, "mode.trim": 2.0}.items():
        run.set_parameter(index_of_parameter(sim, name), value)
    inputs = np.array([u[row.name] for row in sim.entries(INPUT)])
    place = {name: i for i, name in enumerate(sim.outputs)}
    run.set_inputs(inputs)
    run.initialize()
    dt, rows, down, lever = 0.02, [], False, 0.0
    start = run.outputs()[place["theta"]]
    for k in range(round(45.0 / dt)):
        y = run.outputs()
        rows.append(y)
        height, sink, pitch, rate = (y[place[name]] for name in ("h_agl", "vd", "theta", "q"))
        down = down or y[place["wow_left"]] > 0.5
        flare = np.clip(height / 12.0, 0.0, 1.0)
        wanted = -(
            flare * 2.56 + (1.0 - flare) * 0.6
        )  # climb rate of 3 degrees at 95 kt, then of the touch-down
        aim = (
            np.clip(start + 0.035 * (wanted + sink) + 4.0 * DEG * (1.0 - flare), -4 * DEG, 9 * DEG)
            if not down
            else 0.0
        )
        elevator = np.clip(1.2 * (pitch - aim) + 0.5 * rate, -15 * DEG, 10 * DEG)
        lever += dt * (0.05 * (95 * KT - y[place["V"]])) if flare == 1.0 else -dt * 0.5
        lever = float(np.clip(lever, -0.5, 0.5)) if not down else -1.0
        u |= {"delta_e": elevator, "brake_left": 0.6 * down, "brake_right": 0.6 * down}
        u |= {f"engine{i}.throttle": lever for i in (1, 2)}  # on top of the trimmed lever
        following = np.array([u[row.name] for row in sim.entries(INPUT)])
        run.step(k * dt, dt, inputs, following)
        inputs = following
    columns = {
        row.name: ("time", np.array(rows)[:, i]) for i, row in enumerate(sim.entries(OUTPUT))
    }
    return xr.Dataset(columns, {"time": np.arange(len(rows)) * dt})


# %% Plots


def plot(found: xr.Dataset, channels: dict[str, tuple[float, str]], title: str, file: Path) -> None:
    """Draw channels over time, one panel each; `channels` gives factor and unit."""
    figure, panels = plt.subplots(
        len(channels), 1, figsize=(7.0, 1.6 * len(channels)), sharex=True, constrained_layout=True
    )
    for panel, (name, (factor, unit)) in zip(panels, channels.items(), strict=True):
        panel.plot(found["time"], found[name] / factor, color="black", linewidth=1.2)
        panel.set_ylabel(f"{name}\n[{unit}]")
        panel.grid(color="0.85", linewidth=0.5)
    panels[0].set_title(title, loc="left")
    panels[-1].set_xlabel("time [s]")
    figure.savefig(file, dpi=110)
    plt.close(figure)


def main(folder: Path, database: str | None) -> dict[str, xr.Dataset]:
    """Fly all of it, print the trim and write the plots."""
    folder.mkdir(parents=True, exist_ok=True)
    sim = model(database)
    level, modes = trimmed(sim)
    lever = float(level["found"].sel(unknown="throttle"))
    alpha, elevator = (float(level[name]) / DEG for name in ("alpha", "applied.delta_e"))
    print(f"level at 180 kt: alpha {alpha:.2f} deg, elevator {elevator:.2f} deg, lever {lever:.2f}")
    print(
        modes[["mode", "period", "t_half", "t_double", "damping_ratio"]].to_string(
            index=False, float_format="%.3g", na_rep=""
        )
    )
    flights = {"doublet": doublet(sim), "takeoff": takeoff(sim), "landing": landing(sim)}
    channels = {
        "doublet": {
            "applied.delta_e": (DEG, "deg"),
            "q": (DEG, "deg/s"),
            "alpha": (DEG, "deg"),
            "nz": (1.0, "1"),
        },
        "takeoff": {
            "V_cas": (KT, "kt"),
            "theta": (DEG, "deg"),
            "h_agl": (1.0, "m"),
            "gear.nose.Fz": (1e3, "kN"),
            "gear.left.Fz": (1e3, "kN"),
        },
        "landing": {
            "V_cas": (KT, "kt"),
            "theta": (DEG, "deg"),
            "h_agl": (1.0, "m"),
            "vd": (1.0, "m/s"),
            "gear.left.Fz": (1e3, "kN"),
        },
    }
    titles = {
        "doublet": "Elevator doublet at 180 kt",
        "takeoff": "Take-off, flaps half",
        "landing": "Landing, flaps full",
    }
    for name, found in flights.items():
        plot(found, channels[name], titles[name], folder / f"{name}.png")
    return flights


if __name__ == "__main__":
    main(
        Path(sys.argv[1] if len(sys.argv) > 1 else "out/flights"),
        sys.argv[2] if len(sys.argv) > 2 else None,
    )

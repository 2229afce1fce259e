"""Fit the engine deck ``engine.nc`` to the recordings in ``flight/``: governor, acceleration limits, thrust and fuel flow.

    python data/t37/make_engine.py

The deck is the one of LR-743 Fig. 6 and section 4.5.2: corrected thrust over corrected speed, Mach number and height; a schedule
of the commanded speeds over the lever; speeds that follow with limits of their own for up and down.  The J69 has one rotor; its
recorded n2 is what the thrust goes with, and n1 is carried along.  Runs 01 to 18 are fitted, 21 to 32 only compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.optimize import minimize_scalar, nnls

import flightmech
import flighttest
from flightmech import air
from flightmech.simulation.kernel import STATE
from flightmech.simulation.run import constant_inputs, prepared
from flightmech.aircraft.systems.engine_deck import Deck, write_tables
from flightmech.terms import basis, make

HERE = Path(__file__).parent
RATE = 10.0  # Hz, of the engine channels
FITTED = 18  # runs up to this number
MACH, H = [0.0, 0.15, 0.3, 0.5], [0.0, 1500.0, 6200.0]
SPEED = [0.58, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95, 1.0, 1.05, 1.1]  # corrected n2
GOVERNED = [0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 1.0]  # n2
FAR = 0.03  # gap between command and speed in which the limit governs
WINDOW = 4  # samples over which a rate is observed
STILL = (10.0, 0.02)  # s and throttle: settled when the lever moved by less during the time before
SMOOTH = 0.03  # weight of a second difference of a table against one sample per node
CHANNELS = ("n1", "n2", "fuel_flow", "thrust", "throttle")


@dataclass(frozen=True)
class Run:
    """A recording: mean of both engines, Mach number and height over time at `RATE`."""

    name: str
    number: int
    data: Mapping[str, np.ndarray]


def read(path: Path) -> Run:
    """Return the engine channels of a recording."""
    record = flighttest.read(path, HERE / "names.toml")
    data = flighttest.cut(record, 0.0, min(float(leaf["time"][-1]) for leaf in record.children.values()), rate=RATE)
    mean = {name: np.mean([data[f"engine{i}.{name}"].values for i in (1, 2)], axis=0) for name in CHANNELS}
    mach = (data["V"] / np.sqrt(1.4 * 287.05287 * data["temperature"])).values
    flown = {"time": data["time"].values, "mach": mach, "h": data["h_gps"].values, "temperature": data["temperature"].values}
    return Run(path.stem, int(path.stem.split("_")[1]), mean | flown)


def joined(runs: list[Run]) -> dict[str, np.ndarray]:
    """Return the channels of all runs one after the other."""
    return {name: np.concatenate([run.data[name] for run in runs]) for name in runs[0].data}


def warmer(data: Mapping[str, np.ndarray]) -> float:
    """Return the mean offset from the standard temperature, where the sensor has flow. [K]"""
    flying = data["mach"] > 0.1
    return float(np.mean((data["temperature"] - air.atmosphere(data["h"]).temperature)[flying]))


def settled(throttle: np.ndarray) -> np.ndarray:
    """Return where the lever has been still."""
    width = round(STILL[0] * RATE)
    padded = np.concatenate([np.full(width, throttle[0]), throttle])
    return np.ptp(np.lib.stride_tricks.sliding_window_view(padded, width + 1), axis=1) < STILL[1]


def fit(value: np.ndarray, axes: Mapping[str, list[float]], design: np.ndarray, **text: str) -> xr.Dataset:
    """Return the non-negative table that fits best; nodes without samples continue the others."""
    shape = [len(points) for points in axes.values()]
    weight = SMOOTH * np.sqrt(len(value) / design.shape[1])
    rows = weight * second_differences(shape)
    nodes, _ = nnls(np.vstack([design, rows]), np.append(value, np.zeros(len(rows))))
    return make(nodes.reshape(shape), axes, source="flight", references="recordings t37_01 to t37_18", **text)


def second_differences(shape: list[int]) -> np.ndarray:
    """Return the second differences of a table along each axis, per unit of index."""
    index = np.arange(np.prod(shape)).reshape(shape)
    rows = []
    for axis, count in enumerate(shape):
        lines = np.moveaxis(index, axis, 0)
        for k, place in product(range(1, count - 1), np.ndindex(lines.shape[1:])):
            row = np.zeros(index.size)
            row[[lines[(k + shift, *place)] for shift in (-1, 0, 1)]] = (1.0, -2.0, 1.0)
            rows.append(row)
    return np.array(rows)


def schedule(runs: list[Run], n: str) -> xr.Dataset:
    """Return the speed over the lever from settled flight."""
    still = np.concatenate([settled(run.data["throttle"]) for run in runs])
    data = {name: values[still] for name, values in joined(runs).items()}
    axes = {"throttle": [0.0, 0.5, 1.0]}
    return fit(data[n], axes, design_of(axes, data), comment=f"{n} of settled flight")


def design_of(axes: Mapping[str, list[float]], data: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the samples as weights of the nodes."""
    return basis(make(np.zeros([len(points) for points in axes.values()]), axes), data, outside="clamp").toarray()


def limit(runs: list[Run], command: xr.Dataset, n: str, way: float) -> xr.Dataset:
    """Return the rate limit in one direction over n2 and height.

    While the gap to the command is wide, the change of the speed over a window is the integral of the limit: linear in its nodes.
    """
    axes = {"n2": GOVERNED, "h": H}
    designs, changes = [], []
    for run in runs:
        speed = run.data[n]
        gap = way * (np.interp(run.data["throttle"], command["throttle"], command["value"]) - speed)
        design = design_of(axes, run.data)
        window = np.lib.stride_tricks.sliding_window_view
        governs = window(gap, WINDOW + 1).min(axis=1) > FAR
        integral = window(design, WINDOW + 1, axis=0) @ np.r_[0.5, np.ones(WINDOW - 1), 0.5] / RATE
        designs.append(integral[governs]), changes.append(way * (speed[WINDOW:] - speed[:-WINDOW])[governs])
    seconds = WINDOW / RATE
    way_name = "up" if way > 0 else "down"
    return fit(np.concatenate(changes) / seconds, axes, np.concatenate(designs) / seconds, comment=f"rate of {n} {way_name}, lever far off")


def static(runs: list[Run], offset: float) -> dict[str, xr.Dataset]:
    """Return the corrected thrust and the fuel flow from all samples."""
    data = joined(runs)
    atm = air.atmosphere(data["h"], delta_T=offset)
    theta = np.asarray(atm.temperature) / 288.15 * (1.0 + 0.2 * data["mach"] ** 2)
    delta = np.asarray(atm.p_static) / 101325.0
    axes = {"corrected_n2": SPEED, "mach": MACH, "h": H}
    plain = {"n2": [*GOVERNED[:-1], 0.95, 1.0], "mach": MACH, "h": H}
    design = design_of(axes, data | {"corrected_n2": data["n2"] / np.sqrt(theta)})
    return {
        "corrected_thrust": fit(data["thrust"] / delta, axes, design, comment="net thrust over the ambient pressure ratio"),
        "fuel_flow": fit(data["fuel_flow"], plain, design_of(plain, data), comment="has a floor that no correction moves"),
    }


def flown(run: Run, deck: Deck, offset: float) -> dict[str, np.ndarray]:
    """Return the engine's outputs under the recorded lever along the recorded Mach number and height."""
    craft = replace(flightmech.read_aircraft(HERE / "aircraft.toml"), engines=(flightmech.aircraft.Engine((0.0, 0.0, 0.0), deck=deck),))
    model = flightmech.compile(craft, xr.DataTree.from_dict({"/CD/basic": make(0.0)}))
    data, place = run.data, [row.name for row in model.entries(STATE)]
    fixed = [place.index(f"state.{name}") for name in ("vx", "vy", "vz", "q0", "q1", "q2", "q3", "p", "q", "r", "z")]
    speed = data["mach"] * np.asarray(air.atmosphere(data["h"], delta_T=offset).a_sound)
    levers = [constant_inputs(model, {"engine1.throttle": float(lever)}) for lever in data["throttle"]]
    values = {"mode.earth": 0.0, "mode.engine": 0.0, "env.delta_T": offset, "init.V": speed[0], "init.h": data["h"][0]}
    simulation = prepared(model, values, levers[0], float(data["time"][0]))
    rows = []
    for k, lever in enumerate(levers):
        x = simulation.state
        x[fixed] = (speed[k], *[0.0] * 2, 1.0, *[0.0] * 6, -data["h"][k])
        simulation.state = x
        rows.append(simulation.outputs())
        if k + 1 < len(levers):
            simulation.step(data["time"][k], data["time"][k + 1] - data["time"][k], lever, levers[k + 1])
    names = ("n1", "n2", "fuel_flow", "thrust")
    columns = np.array(rows)[:, [model.outputs.index(f"engine1.{name}") for name in names]]
    return dict(zip(names, columns.T, strict=True))


def residuals(runs: list[Run], deck: Deck, offset: float) -> list[dict[str, np.ndarray]]:
    """Return deck minus recording, run by run."""
    return [{name: values - run.data[name] for name, values in flown(run, deck, offset).items()} for run in runs]


def rms(found: list[dict[str, np.ndarray]], name: str) -> float:
    """Return the root mean square of a channel over runs."""
    return float(np.sqrt(np.mean(np.concatenate([run[name] for run in found]) ** 2)))


def n2_of_n1(runs: list[Run], offset: float) -> xr.Dataset:
    """Return corrected n2 over corrected n1 of settled flight, for runs that N1 drives."""
    still = np.concatenate([settled(run.data["throttle"]) for run in runs])
    data = {name: values[still] for name, values in joined(runs).items()}
    root = np.sqrt(np.asarray(air.atmosphere(data["h"], delta_T=offset).temperature) / 288.15 * (1.0 + 0.2 * data["mach"] ** 2))
    axes = {"corrected_n1": [0.3, 0.5, 0.7, 0.9, 1.1], "h": H}
    design = design_of(axes, {"corrected_n1": data["n1"] / root, "h": data["h"]})
    return fit(data["n2"] / root, axes, design, comment="settled flight; in a power change n1 lags")


def main() -> None:
    """Fit, report and write."""
    runs = [read(path) for path in sorted((HERE / "flight").glob("*.nc"))]
    own = [run for run in runs if run.number <= FITTED]
    offset = warmer(joined(own))
    tables = static(own, offset) | {"corrected_n2_driven": n2_of_n1(own, offset)}
    for n in ("n1", "n2"):
        tables[f"{n}_command"] = schedule(own, n)
        for way, sign in (("up", 1.0), ("down", -1.0)):
            tables[f"{n}_{way}_limit"] = limit(own, tables[f"{n}_command"], n, sign)
    powered = [run for run in own if np.ptp(run.data["throttle"]) > 0.5][:3]

    def deck(time: float) -> Deck:
        text = {"source": "flight", "comment": "close to the command, where no limit governs; a delay of the lever cannot be distinguished from it"}
        return Deck(tables | {f"{n}_up_time": make(time, **text) for n in ("n1", "n2")})

    best = minimize_scalar(
        lambda time: rms(residuals(powered, deck(time), offset), "n2"), bounds=(0.02, 0.3), method="bounded", options={"xatol": 5e-3}
    )
    found = deck(round(float(best.x), 2))
    left = residuals(runs, found, offset)
    for title, part in (("fitted runs", left[: len(own)]), ("compared runs", left[len(own) :]), ("all runs", left)):
        print(f"{title}: " + ", ".join(f"{name} {rms(part, name):.4g}" for name in part[0]) + " rms [SI]")
    print(f"time constant {round(float(best.x), 2)} s; air {offset:.2f} K warmer; thrust {np.ptp(joined(runs)['thrust']):.0f} N in all")
    write_tables(found.tables, HERE / "engine.nc", title="T-37 engine deck, either engine", history="make_engine.py from flight/")


if __name__ == "__main__":
    main()

"""A batch of perturbed runs: one thread against all, against a loop of single runs, and side by
side in lanes against one after the other.

    python benchmarks/batch_of_runs.py [out/t37]

The folder holds the files of the demo: final.toml and final.nc, the identified T-37 whole.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import numpy as np
import xarray as xr
from kernel_step import citation_like  # next to this file

import flightmech
from flightmech.simulation.compiler import compile_files

RUNS, SECONDS, REPEATS, LANES = 61, 60.0, 5, (1, 4, 8)
OUTPUTS = ["V", "alpha", "beta", "p", "q", "r", "phi", "theta", "ax", "ay", "az", "h"]


def least(action) -> float:
    """Return the shortest wall time of several repeats. [s]"""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return min(times)


def in_lanes(sim: flightmech.SimModel, record: xr.Dataset, varied: dict, held: dict) -> list[float]:
    """CPU time of a step of a run with 1, 4 and 8 lanes, in turn, so that what else the machine
    does meets all alike. [s]
    """
    least = [np.inf] * len(LANES)
    for _ in range(REPEATS):
        for i, lanes in enumerate(LANES):
            start = time.process_time()
            flightmech.simulate_batch(sim, record, varied, held, OUTPUTS, threads=1, lanes=lanes)
            least[i] = min(least[i], time.process_time() - start)
    return [total / RUNS / (record.sizes["time"] - 1) for total in least]


def whole_t37(folder: Path) -> None:
    """Print the steps of the whole T-37 in flight: mass, air and start differ, levers and surfaces
    move.
    """
    sim = compile_files(str(folder / "final.toml"), str(folder / "final.nc"))
    t = np.arange(0.0, SECONDS, 0.01)
    moves = {
        "delta_e": 0.01 * np.sin(2.0 * t),
        "delta_a": 0.01 * np.sin(1.3 * t),
        "delta_r": 0.01 * np.sin(1.7 * t),
    }
    levers = {f"engine{i}.throttle": 0.6 + 0.1 * np.sin(0.5 * t + i) for i in (1, 2)}
    record = xr.Dataset(
        {name: ("time", values) for name, values in (moves | levers).items()}, {"time": t}
    )
    around = np.linspace(0.95, 1.05, RUNS)
    varied = {
        "mass.mass": 2900.0 * around,
        "init.V": 100.0 * around,
        "init.h": 3000.0 * around,
        "env.delta_T": 200.0 * (around - 1.0),
    }
    alone, *together = in_lanes(sim, record, varied, {"mode.trim": 2.0})
    print(f"T-37 whole, step and {len(OUTPUTS)} outputs of a run: {1e6 * alone:.2f} us alone")
    for lanes, step in zip(LANES[1:], together, strict=True):
        print(f"up to {lanes} lanes    {1e6 * step:.2f} us, {alone / step:.2f} times less")


def main(demo: Path | None = None) -> None:
    if demo:
        whole_t37(demo)
    sim = citation_like()
    t = np.arange(0.0, SECONDS, 0.01)
    record = xr.Dataset(
        {"delta_e": ("time", 0.02 * np.sin(2.0 * t)), "delta_a": ("time", 0.02 * np.sin(1.3 * t))},
        {"time": t},
    )
    term = next(name for name in sim.parameters if name.startswith("term."))
    varied = {
        "mass.mass": np.linspace(0.95, 1.05, RUNS) * 5000.0,
        term: np.linspace(0.9, 1.1, RUNS),
    }
    held = {"init.V": 120.0, "init.h": 3000.0, "mode.trim": 1.0}

    def batch(threads: int) -> xr.Dataset:
        return flightmech.simulate_batch(sim, record, varied, held, OUTPUTS, threads=threads)

    def loop() -> None:
        for run in range(RUNS):
            flightmech.simulate(
                sim,
                record,
                held | {name: values[run] for name, values in varied.items()},
                outputs=OUTPUTS,
            )

    cores = os.cpu_count() or 1
    assert batch(1).equals(batch(cores))
    one, many, single = least(lambda: batch(1)), least(lambda: batch(cores)), least(loop)
    print(f"{RUNS} runs of {SECONDS:.0f} s at 100 Hz, 43 tables, {len(OUTPUTS)} outputs")
    print(f"one thread       {one * 1e3:6.0f} ms   {RUNS * SECONDS / one:.0f} times real time")
    print(f"{cores} threads        {many * 1e3:6.0f} ms   {one / many:.2f} times one thread")
    print(
        f"loop of simulate {single * 1e3:6.0f} ms   {single / one:.2f} times the batch on "
        f"one thread"
    )


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))

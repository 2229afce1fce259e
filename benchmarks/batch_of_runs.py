"""A batch of perturbed runs: one thread against all, and against a loop of single runs.

python benchmarks/batch_of_runs.py
"""

from __future__ import annotations

import os
import time

import numpy as np
import xarray as xr
from kernel_step import citation_like  # next to this file

import flightmech

RUNS, SECONDS, REPEATS = 61, 60.0, 5
OUTPUTS = ["V", "alpha", "beta", "p", "q", "r", "phi", "theta", "ax", "ay", "az", "h"]


def least(action) -> float:
    """Return the shortest wall time of several repeats. [s]"""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> None:
    sim = citation_like()
    t = np.arange(0.0, SECONDS, 0.01)
    record = xr.Dataset({"delta_e": ("time", 0.02 * np.sin(2.0 * t)), "delta_a": ("time", 0.02 * np.sin(1.3 * t))}, {"time": t})
    term = next(name for name in sim.parameters if name.startswith("term."))
    varied = {"mass.mass": np.linspace(0.95, 1.05, RUNS) * 5000.0, term: np.linspace(0.9, 1.1, RUNS)}
    held = {"init.V": 120.0, "init.h": 3000.0, "mode.trim": 1.0}

    def batch(threads: int) -> xr.Dataset:
        return flightmech.simulate_batch(sim, record, varied, held, OUTPUTS, threads=threads)

    def loop() -> None:
        for run in range(RUNS):
            flightmech.simulate(sim, record, held | {name: values[run] for name, values in varied.items()}, outputs=OUTPUTS)

    cores = os.cpu_count() or 1
    assert batch(1).equals(batch(cores))
    one, many, single = least(lambda: batch(1)), least(lambda: batch(cores)), least(loop)
    print(f"{RUNS} runs of {SECONDS:.0f} s at 100 Hz, 43 tables, {len(OUTPUTS)} outputs")
    print(f"one thread       {one * 1e3:6.0f} ms   {RUNS * SECONDS / one:.0f} times real time")
    print(f"{cores} threads        {many * 1e3:6.0f} ms   {one / many:.2f} times one thread")
    print(f"loop of simulate {single * 1e3:6.0f} ms   {single / one:.2f} times the batch on one thread")


if __name__ == "__main__":
    main()

"""The diagnosis of cases of the demo: swaps flown together against every swap flown alone, and
where the time goes.

    python benchmarks/diagnosis.py [out/t37] [case.toml ...]

The folder holds the files of the demo: datcom and final, databases and aircraft.  Without cases:
three that fly surfaces, one with legs on the ground and one with moving circuits.  Each record is
reconstructed by itself.
"""

from __future__ import annotations

import sys
import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np

import aerodb
import flightmech
import pom
from pom.cases.reference_states import flight_states
from pom.diagnosis import swap_runs
from pom.diagnosis.diagnosis import diagnose_bench
from pom.diagnosis.joint_correction import swap_models
from pom.replaying.kernel_replay import fly_once

CASES = (
    "21_short_period",
    "22_roll_response",
    "26_phugoid",
    "71_brake_stop",
    "53_stick_free_short_period",
)
REPEATS = 3


def timed(spent: dict[str, float], place, name: str) -> None:
    """Add the processor time of every call of a function of a module to `spent`. [s]"""
    inner = getattr(place, name)

    def outer(*arguments, **options):
        start = time.process_time()
        try:
            return inner(*arguments, **options)
        finally:
            spent[name] += time.process_time() - start

    setattr(place, name, outer)


def alone(sim, job, choices, channels):
    """Fly every choice by itself, as `pom.replaying.kernel_replay.replay_choices` does together."""
    for choice in choices:
        fly_once(sim, replace(job, parameters={**job.parameters, **choice}), channels)


def main() -> None:
    """Print processor times of each case: diagnosis, its flights, judging; flights of a stage alone
    over together.
    """
    folder, *files = sys.argv[1:] or ["out/t37"]
    files = files or [f"data/t37/cases/{name}.toml" for name in CASES]
    before, after = (aerodb.open(Path(folder) / f"{name}.nc") for name in ("datcom", "final"))
    apriori, final = (
        flightmech.read_aircraft(Path(folder) / f"{name}.toml") for name in ("datcom", "final")
    )
    cases = [pom.read_case(file) for file in files]
    models = swap_models(before, after, {case.name: final for case in cases}, apriori)
    spent: dict[str, float] = defaultdict(float)
    for name in ("replay_choices", "judge_match"):
        timed(spent, swap_runs, name)
    print(
        f"{'case':28} {'flights':>8} {'total':>8} {'flying':>8} {'judging':>8}   [s]   one "
        f"by one over together"
    )
    for case in cases:
        states = flight_states(case)
        spent.clear()
        start = time.process_time()
        bench = swap_runs.SwapBench.of(case, models[case.name], states)
        diagnose_bench(bench)
        total = time.process_time() - start
        flights, flying, judging = len(bench.known), spent["replay_choices"], spent["judge_match"]
        print(
            f"{case.name:28} {flights:8} {total:8.2f} {flying:8.2f} {judging:8.2f} "
            f"{ratio_alone(bench):20.2f}"
        )


def ratio_alone(bench: swap_runs.SwapBench) -> float:
    """Return the processor time of sixteen swaps flown one by one over that of the same flown
    together.
    """
    sim = bench.models.compiled(())
    choices = [bench.models.choice([name]) for name in bench.terms[:16]]
    channels = [name for name in bench.channels if name in sim.outputs]
    times = [np.inf, np.inf]
    for _ in range(REPEATS):
        for k, way in enumerate((alone, swap_runs.replay_choices)):
            start = time.process_time()
            way(sim, bench.flown, choices, channels)
            times[k] = min(times[k], time.process_time() - start)
    return times[0] / times[1]


if __name__ == "__main__":
    main()

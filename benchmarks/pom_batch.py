"""A batch of cases from replay to page, and what a case of a foreign FMU costs against FMPy's
`simulate_fmu`, in one run.

100 cases x 3 models of 30 s at 50 Hz: flights of an invented trainer, replayed by three of our FMUs
(whole records, FMI 3.0), judged and written as a report without its PDF.  The paths are given, so
nothing is reconstructed; the start of the FMUs' processes counts.  Run: ``python
benchmarks/pom_batch.py [CASES] [JOBS]``.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import os
import resource
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import fmpy
import numpy as np
import xarray as xr

import flightmech
import pom
from flightmech.support.console import print_table
from pom.fmu.models import Models
from pom.fmu.process import close_all
from pom.fmu.simulate import fly_job
from pom.replaying import replay_case
from pom.replaying.replay_case import OBSERVED, plan_of

DURATION = 30.0
KINDS = (
    ("2.c.10", "delta_e", 0.05),
    ("2.d.2", "delta_a", 0.03),
    ("2.d.6", "delta_r", 0.04),
    ("2.d.7", "delta_r", 0.05),
)
CHANGES: dict[str, dict[str, float]] = {
    "datcom": {"Cm_qhat": 0.5, "Cl_phat": 0.7},
    "corrected": {"Cm_qhat": 0.8},
    "final": {},
}
REPEATS = 15
CASE = """
[case]
id = "{id}"
name = "case_{number:03d}"
title = "{id}, case {number}"
record = "record_{number:03d}.nc"
window = [0.0, {duration}]
shortened = "30 s are flown"
[events]
input_end = {end}
"""


def trainer() -> Any:
    """Return the module of the invented aeroplane that the tests fly."""
    spec = importlib.util.spec_from_file_location(
        "trainer", Path(__file__).parents[1] / "tests" / "pom" / "trainer.py"
    )
    if spec is None or spec.loader is None:
        raise FileNotFoundError("tests/pom/trainer.py; run the benchmark from a checkout")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def programme(
    plane: Any, count: int, folder: Path
) -> tuple[list[pom.PomCase], dict[str, xr.Dataset]]:
    """Write case files and fly their records: a pulse of one control, each of another length."""
    cases, paths = [], {}
    for number in range(count):
        test, control, size = KINDS[number % len(KINDS)]
        end = 2.5 + 0.02 * number
        stem = f"record_{number:03d}"
        (folder / f"{stem}.nc").touch()
        file = folder / f"case_{number:03d}.toml"
        file.write_text(CASE.format(id=test, number=number, duration=DURATION, end=end))
        cases.append(pom.read_case(file))
        pulse = [(0.0, 0.0), (2.0, 0.0), (2.06, -size), (end - 0.06, -size), (end, 0.0)]
        paths[stem] = plane.flight(plane.database(), DURATION, **{control: pulse})
    return cases, paths


def timed(act: Callable[[], Any]) -> tuple[float, Any]:
    """Return wall time and result. [s]"""
    start = time.perf_counter()
    result = act()
    return time.perf_counter() - start, result


def worked(act: Callable[[], Any]) -> tuple[np.ndarray, Any]:
    """Return wall time and processor time, that of the processes of the FMUs among it, and result.
    [s]
    """
    before = processor_time()
    wall, result = timed(act)
    used = processor_time() - before
    close_all()
    return np.array([wall, used]), result


def processor_time() -> float:
    """Return the processor time of this process and of all that it started and that run. [s]

    A sandbox is killed with its process, whose time nobody waits for, so it is read before.
    """
    own = resource.getrusage(resource.RUSAGE_SELF)
    parents, seconds = {}, {}
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            # state, parent, ... utime and stime follow the name in brackets
            words = (folder / "stat").read_text().rpartition(")")[2].split()
            parents[int(folder.name)] = int(words[1])
            seconds[int(folder.name)] = (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")
    family = {os.getpid()}
    while more := {pid for pid, parent in parents.items() if parent in family} - family:
        family |= more
    children = sum(seconds[pid] for pid in family - {os.getpid()})
    return own.ru_utime + own.ru_stime + children


def end_to_end(plane: Any, count: int, jobs: int, folder: Path) -> None:
    """Time replay, verdicts and report."""
    runs = {
        name: flightmech.write_fmu(
            flightmech.compile(plane.AIRCRAFT, plane.scaled(plane.database(), **changes)),
            folder / f"{name}.fmu",
            "3.0",
        )
        for name, changes in CHANGES.items()
    }
    cases, paths = programme(plane, count, folder)
    # What a process loads once is not a part of a batch.
    pom.replay_all(cases[:1], runs, paths, jobs=1)
    close_all()
    flown, results = worked(
        lambda: pom.replay_all(cases, runs, paths, jobs=jobs, resume=folder / "kept")
    )
    with without_probes():
        plain, _ = worked(
            lambda: pom.replay_all(cases, runs, paths, jobs=jobs, resume=folder / "plain")
        )
    again, _ = worked(lambda: pom.replay_all(cases, runs, paths, jobs=jobs, resume=folder / "kept"))
    written, page = worked(
        lambda: pom.write_report(results, folder / "report", title="A hundred cases", paper=None)
    )
    steps = {
        "replay and verdicts": flown,
        "the same without probes of the models": plain,
        "the same from kept flights": again,
        f"report, HTML of {page.stat().st_size / 1e6:.1f} MB, no PDF": written,
        "replay, verdicts, report": flown + written,
    }
    rows = [
        (name, f"{wall:.2f}", f"{cpu:.2f}", f"{1e3 * cpu / count:.1f}")
        for name, (wall, cpu) in steps.items()
    ]
    columns = ("step", "s", "CPU s", "CPU ms/case")
    print_table(
        columns,
        rows,
        f"{count} cases x {len(runs)} models of {DURATION:g} s, {jobs} jobs",
        right=columns[1:],
    )


@contextlib.contextmanager
def without_probes() -> Iterator[None]:
    """Leave the probes of passing models out, in the threads of this process."""
    kept = replay_case.probe_models, replay_case.compare_model_tables
    replay_case.probe_models = lambda *given, **options: {}
    replay_case.compare_model_tables = lambda *given: ()
    try:
        yield
    finally:
        replay_case.probe_models, replay_case.compare_model_tables = kept


def foreign(plane: Any, folder: Path) -> None:
    """Time a case of one FMU that is stepped from sample to sample, here and by FMPy alone; medians
    of alternating runs.
    """
    runs = {
        "foreign": flightmech.write_fmu(
            flightmech.compile(plane.AIRCRAFT, plane.database()), folder / "foreign.fmu", "2.0"
        )
    }
    cases, paths = programme(plane, 1, folder)
    case, path = cases[0], paths["record_000"]
    model, plan = Models(runs).of(case)["foreign"], plan_of(case, path)
    wanted = [*OBSERVED, *case.show]
    ways = {
        "simulate_fmu": by_fmpy(
            runs["foreign"], plan.job, [name for name in model.links.outputs if name in wanted]
        ),
        "flight in the child process": lambda: fly_job(model, plan.job, wanted, 60.0),
        "pom.replay: checked, flown, judged": lambda: pom.replay(case, runs, path),
    }
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(REPEATS):
        for name, act in ways.items():
            seconds[name].append(timed(act)[0])
    middle = {name: statistics.median(values) for name, values in seconds.items()}
    plain = middle["simulate_fmu"]
    rows = [
        (name, f"{1e3 * value:.1f}", f"{1e3 * (value - plain):+.1f}", f"{value / plain:.2f}")
        for name, value in middle.items()
    ]
    print_table(
        ("way", "ms", "more", "ratio"),
        rows,
        f"one case of {DURATION:g} s at 50 Hz, FMI 2.0",
        right=("ms", "more", "ratio"),
    )


def by_fmpy(file: Path, job: Any, outputs: list[str]) -> Callable[[], Any]:
    """Return a run by FMPy alone: unpacked, described and simulated in this process, as one line of
    Python does it.
    """
    known = {v.name for v in fmpy.read_model_description(str(file)).modelVariables}
    names = [name for name in job.inputs if name in known]
    signals = np.zeros(len(job.time), [("time", float), *((name, float) for name in names)])
    signals["time"] = job.time - job.time[0]
    for name in names:
        signals[name] = job.inputs[name]
    start = {name: value for name, value in job.parameters.items() if name in known}
    step, duration = float(job.time[1] - job.time[0]), float(job.time[-1] - job.time[0])

    def run() -> Any:
        with contextlib.redirect_stdout(
            io.StringIO()
        ):  # a warning for every input that is not given
            return fmpy.simulate_fmu(
                str(file),
                stop_time=duration,
                output_interval=step,
                start_values=start,
                input=signals,
                output=outputs,
            )

    return run


def main() -> None:
    """Print both tables."""
    count, jobs = (int(word) for word in [*sys.argv[1:3], *("100", "-1")[len(sys.argv[1:3]) :]])
    plane = trainer()
    with TemporaryDirectory() as folder:
        end_to_end(plane, count, jobs, Path(folder))
        foreign(plane, Path(folder))


if __name__ == "__main__":
    main()

"""Time and memory against the number of cases, models and workers, the length of a record and the
number of tables.

    python benchmarks/growth.py                    all series, ten minutes on two free cores
    python benchmarks/growth.py --figure growth.png --keep growth.json
    python benchmarks/growth.py --read growth.json --figure growth.png     the figure alone
    python benchmarks/growth.py --batch 1000 5                     one batch: 1000 cases by 5 models

A batch is that of ``pom_batch.py``: cases of 30 s at 50 Hz of an invented trainer, replayed by our
FMUs, judged, replayed again from the kept flights, and written as a report without its PDF.  Every
point is a process of its own.  Time is processor time with that of all child processes, which other
work on the machine stretches much less than the clock; memory is the largest resident set of the
process, for a batch also that of all processes together, a page that several share counted once
(Linux).  The records of a batch are files of reconstructed states.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from pom_batch import DURATION, processor_time, programme, trainer

import aerodb
import flightmech
import pom
from flightmech import terms
from flightmech.support.console import print_table
from pom.fmu.process import close_all

BATCHES, FEW, MIDDLE = (75, 150, 300, 600), 40, 75
MODELS = (1, 2, 3, 4, 5)
LENGTHS = (30.0, 300.0, 1800.0, 5400.0)  # [s]
TABLES = (10, 100, 300, 1000)
FLOWN = 60  # records of a batch that differ
COEFFICIENTS = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
ROOT = ("title", "aircraft", "S", "cbar", "b", "force_axes", "x_ref", "y_ref", "z_ref")
FACTORS = (1.0, 0.9, 0.8, 0.7, 0.6)  # of the pitch damping of each model


def measured(work: Callable[[], Any]) -> tuple[dict[str, float], Any]:
    """Return processor time and wall time, with that of the child processes, and what the work
    gave. [s]
    """
    from joblib.externals.loky import get_reusable_executor

    worked, began = processor_time(), time.perf_counter()
    found = work()
    wall = time.perf_counter() - began
    close_all()
    get_reusable_executor().shutdown(wait=True)
    return {"cpu": processor_time() - worked, "wall": wall}, found


def memory() -> dict[str, float]:
    """Return the largest resident set of this process and of its largest child. [MB]"""
    mine, child = (
        resource.getrusage(who).ru_maxrss / 1024.0
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return {"memory": mine, "child": child}


@contextmanager
def watched(every: float = 0.5) -> Iterator[list[float]]:
    """Give the resident memory of this process and all below it, a shared page counted once, as
    long as the block lasts. [MB]
    """
    found: list[float] = [0.0]
    ended = threading.Event()

    def watch() -> None:
        while not ended.wait(every):
            found.append(sum(map(proportional, tree(os.getpid()))))

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield found
    finally:
        ended.set()
        watcher.join()


def tree(process: int) -> list[int]:
    """Return a process and all that descend from it."""
    below: dict[int, list[int]] = {}
    for place in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            parent = int((place / "stat").read_text().rpartition(")")[2].split()[1])
            below.setdefault(parent, []).append(int(place.name))
    found = [process]
    for one in found:
        found += below.get(one, [])
    return found


def proportional(process: int) -> float:
    """Return the resident memory of a process, each page divided by the processes that share it;
    zero for one that ended. [MB]
    """
    with suppress(OSError):
        for line in Path(f"/proc/{process}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return float(line.split()[1]) / 1024.0
    return 0.0


def prepared(folder: Path, cases: int, models: int) -> None:
    """Write records, case files and FMUs of a batch."""
    plane = trainer()
    _, paths = programme(plane, min(cases, FLOWN), folder)
    for stem, states in paths.items():
        states.to_netcdf(folder / f"{stem}.nc", engine="h5netcdf")
    # The records again, each window shorter by a sample: no flight is kept from another case.
    for number in range(FLOWN, cases):
        turn, first = divmod(number, FLOWN)
        text = (folder / f"case_{first:03d}.toml").read_text()
        text = text.replace(f"_{first:03d}", f"_{number:03d}").replace(
            f", {DURATION}]", f", {DURATION - 0.02 * turn:.2f}]"
        )
        (folder / f"case_{number:03d}.toml").write_text(text)
        shutil.copy(folder / f"record_{first:03d}.nc", folder / f"record_{number:03d}.nc")
    for number, factor in enumerate(FACTORS[:models]):
        model = flightmech.compile(plane.AIRCRAFT, plane.scaled(plane.database(), Cm_qhat=factor))
        flightmech.write_fmu(model, folder / f"model{number}.fmu", "3.0")


def batch(folder: Path, cases: int, models: int, jobs: int) -> dict[str, Any]:
    """Replay, replay again from what was kept, report."""
    read = [pom.read_case(folder / f"case_{number:03d}.toml") for number in range(cases)]
    runs = {f"model{number}": folder / f"model{number}.fmu" for number in range(models)}
    found: dict[str, Any] = {"cases": cases, "models": models, "jobs": jobs}

    def flown() -> Any:
        return pom.replay_all(read, runs, jobs=jobs, resume=folder / f"kept{models}-{jobs}-{cases}")

    with watched() as sizes:
        found["replay"], results = measured(flown)
        del results
        found["resumed"], results = measured(flown)
        found["after replay"] = memory()
        found["report"], page = measured(
            lambda: pom.write_report(
                results, folder / "report", title="Growth", paper=None, jobs=jobs
            )
        )
    found["page"] = page.stat().st_size / 1e6
    return found | memory() | {"together": max(sizes)}


def long_flight(folder: Path, seconds: float) -> dict[str, Any]:
    """Fly, write, replay and report one record of a length."""
    plane = trainer()
    pulse = [(0.0, 0.0), (2.0, 0.0), (2.06, -0.05), (2.44, -0.05), (2.5, 0.0)]
    found: dict[str, Any] = {"seconds": seconds}
    found["flight"], states = measured(
        lambda: plane.flight(plane.database(), seconds, delta_e=pulse)
    )
    case = folder / "long.toml"
    case.write_text(
        '[case]\nid = "2.c.10"\nname = "long"\ntitle = "A long record"\nrecord = "long.nc"\n'
        f"window = [0.0, {seconds}]\n[events]\ninput_end = 2.5\n"
    )
    states.to_netcdf(folder / "long.nc", engine="h5netcdf")
    runs = {
        "model": flightmech.write_fmu(
            flightmech.compile(plane.AIRCRAFT, plane.database()), folder / "long.fmu", "3.0"
        )
    }
    found["replay"], results = measured(
        lambda: pom.replay_all([pom.read_case(case)], runs, jobs=1, timeout=600.0)
    )
    assert not results[0].failure, results[0].failure
    found["report"], page = measured(
        lambda: pom.write_report(results, folder / "report", title="Growth", paper=None, jobs=1)
    )
    found["page"] = page.stat().st_size / 1e6
    return found | memory()


def many_tables(count: int) -> dict[str, Any]:
    """Compile a database of many tables and step it."""
    plane, rng = trainer(), np.random.default_rng(1)
    axes = {"mach": np.linspace(0.1, 0.6, 6), "alpha": np.radians(np.linspace(-8.0, 24.0, 20))}
    leaves = aerodb.terms(plane.database())
    names = [f"{COEFFICIENTS[number % len(COEFFICIENTS)]}/t{number:04d}" for number in range(count)]
    more = {name: terms.make_term(1e-7 * rng.normal(size=(6, 20)), axes) for name in names}
    db = plane.database()
    root: Any = {name: db.attrs[name] for name in ROOT}
    db = aerodb.make_database({**leaves, **more}, **root)
    found: dict[str, Any] = {"tables": count}
    flightmech.compile(plane.AIRCRAFT, plane.database())  # what is loaded at first use
    found["compile"], sim = measured(lambda: flightmech.compile(plane.AIRCRAFT, db))
    clock = np.arange(0.0, 20.0, 0.01)
    held = {"init.V": 85.0, "init.h": 1500.0, "mode.engine": 2, "mode.trim": 1}
    still = xr.Dataset({"delta_e": ("time", np.zeros(clock.size))}, {"time": clock})
    flightmech.simulate(sim, still, held, outputs=["V"])
    costs = [
        measured(lambda: flightmech.simulate(sim, still, held, outputs=["V"]))[0]["cpu"]
        for _ in range(3)
    ]
    found["step"] = {"cpu": min(costs) / clock.size}
    return found | memory()


def alone(kind: str, **given: Any) -> dict[str, Any]:
    """Return a point, measured in a process of its own."""
    call = [sys.executable, __file__, "--point", json.dumps({"kind": kind, **given})]
    return json.loads(
        subprocess.run(call, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines()[-1]
    )


def point(kind: str, **given: Any) -> dict[str, Any]:
    """Measure a point in this process."""
    if kind == "batch":
        return batch(Path(given.pop("folder")), **given)
    if kind == "length":
        with tempfile.TemporaryDirectory() as folder:
            return long_flight(Path(folder), given["seconds"])
    return many_tables(given["tables"])


def series() -> dict[str, list[dict[str, Any]]]:
    """Measure all points."""
    cores = os.cpu_count() or 1
    found: dict[str, Any] = {
        "tables": [alone("tables", tables=count) for count in TABLES],
        "length": [alone("length", seconds=seconds) for seconds in LENGTHS],
    }
    with tempfile.TemporaryDirectory() as place:
        prepared(Path(place), max(BATCHES), len(FACTORS))
        found["models"] = [
            alone("batch", folder=place, cases=FEW, models=count, jobs=cores) for count in MODELS
        ]
        found["workers"] = [
            alone("batch", folder=place, cases=MIDDLE, models=3, jobs=count)
            for count in sorted({1, 2, cores})
        ]
        found["cases"] = [
            alone("batch", folder=place, cases=count, models=3, jobs=cores) for count in BATCHES
        ]
    return found


def show(found: Mapping[str, list[dict[str, Any]]]) -> None:
    """Print the points."""
    for name in ("cases", "models", "workers"):
        columns = (
            "cases",
            "models",
            "workers",
            "replay",
            "resumed",
            "report",
            "ms/case",
            "s on the clock",
            "MB",
            "MB together",
            "page MB",
        )
        rows = []
        for item in found.get(name, ()):
            parts = [item[part]["cpu"] for part in ("replay", "resumed", "report")]
            wall = item["replay"]["wall"] + item["report"]["wall"]
            each = " ".join(f"{1e3 * cpu / item['cases']:.0f}" for cpu in parts)
            numbers = [f"{cpu:.1f}" for cpu in parts]
            sizes = [
                f"{item['memory']:.0f}",
                f"{item.get('together', 0.0):.0f}",
                f"{item['page']:.2f}",
            ]
            rows.append(
                [
                    str(item["cases"]),
                    str(item["models"]),
                    str(item["jobs"]),
                    *numbers,
                    each,
                    f"{wall:.1f}",
                    *sizes,
                ]
            )
        if rows:
            print_table(columns, rows, f"batch against {name}; CPU s", right=columns)
    rows = []
    for item in found.get("length", ()):
        numbers = [f"{item[part]['cpu']:.2f}" for part in ("flight", "replay", "report")]
        rows.append(
            [f"{item['seconds']:g}", *numbers, f"{item['memory']:.0f}", f"{item['page']:.2f}"]
        )
    if rows:
        columns = ("s", "flight", "replay", "report", "MB", "page MB")
        print_table(columns, rows, "one record of a length at 50 Hz; CPU s", right=columns)
    rows = []
    for item in found.get("tables", ()):
        compiled, step = 1e3 * item["compile"]["cpu"], 1e6 * item["step"]["cpu"]
        rows.append(
            [str(item["tables"]), f"{compiled:.0f}", f"{step:.2f}", f"{item['memory']:.0f}"]
        )
    if rows:
        columns = ("tables", "compile [ms]", "step [us]", "MB")
        print_table(columns, rows, "tables of 6 x 20 nodes; CPU time", right=columns)


def draw(found: Mapping[str, list[dict[str, Any]]], file: Path) -> None:
    """Draw all series: time above, memory below, a dashed line where the growth would be linear
    from the first point.
    """
    from matplotlib.figure import Figure

    parts = {
        "cases": ("replay", "resumed", "report"),
        "models": ("replay", "resumed", "report"),
        "workers": ("replay", "resumed", "report"),
    }
    parts |= {"length": ("flight", "replay", "report"), "tables": ("compile", "step")}
    axis = {
        "cases": "cases",
        "models": "models",
        "workers": "jobs",
        "length": "seconds",
        "tables": "tables",
    }
    words = {
        "cases": "cases, 3 models",
        "models": f"models, {FEW} cases",
        "workers": f"workers, {MIDDLE} cases x 3 models",
    }
    words |= {"length": "length of the record [s]", "tables": "tables"}
    figure = Figure(figsize=(15, 6), layout="constrained")
    above, below = figure.subplots(2, len(parts))
    for name, upper, lower in zip(parts, above, below, strict=True):
        x = np.array([item[axis[name]] for item in found[name]], float)
        for colour, part in enumerate(parts[name]):
            y = np.array([item[part]["cpu"] for item in found[name]]) * (
                1e3 if part == "step" else 1.0
            )
            upper.plot(x, y, f"C{colour}o-", label="1000 steps" if part == "step" else part)
            if name != "workers":
                upper.plot(x, y[0] * x / x[0], f"C{colour}--", linewidth=0.7)
        lower.plot(x, [item["memory"] for item in found[name]], "C3o-", label="process")
        if name in ("cases", "models", "workers"):
            lower.plot(
                x,
                [item.get("together", np.nan) for item in found[name]],
                "C4o-",
                label="all processes, shared pages once",
            )
        for panel in (upper, lower):
            panel.grid(alpha=0.3)
            panel.legend(fontsize=7)
        if name in ("cases", "length", "tables"):
            upper.set(xscale="log", yscale="log")
            lower.set_xscale("log")
        lower.set(xlabel=words[name], ylim=(0.0, None))
    above[0].set_ylabel("processor time [s]")
    below[0].set_ylabel("largest resident set [MB]")
    figure.savefig(file, dpi=100)


def main() -> None:
    """Read the command line, measure, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--batch", nargs=2, type=int, metavar=("CASES", "MODELS"), help="one batch only"
    )
    parser.add_argument("--figure", type=Path, help="file for the figure")
    parser.add_argument("--keep", type=Path, help="file for the points as JSON")
    parser.add_argument("--read", type=Path, help="points of an earlier run")
    parser.add_argument("--point", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.point:
        print(json.dumps(point(**json.loads(options.point))))
        return
    if options.batch:
        with tempfile.TemporaryDirectory() as place:
            prepared(Path(place), *options.batch)
            cases, models = options.batch
            found = {
                "cases": [
                    alone(
                        "batch", folder=place, cases=cases, models=models, jobs=os.cpu_count() or 1
                    )
                ]
            }
    else:
        found = json.loads(options.read.read_text()) if options.read else series()
    if options.keep:
        options.keep.write_text(json.dumps(found, indent=1))
    show(found)
    if options.figure:
        draw(found, options.figure)


if __name__ == "__main__":
    main()

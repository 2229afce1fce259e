"""What the plan of a match costs: the whole command, and its parts next to reading the records.

python benchmarks/match_plan.py [PROJECT.toml ...] [--rounds 3] [--jobs 2]

The first line of a project is `aeromatch match --plan --fresh` with an empty store, compiled and
without dask, as an installation without extras has it. Processor time is that of all its processes.
On a machine with other work the ratio to a bare start (``import numpy, scipy, xarray`` in the same
round) is the fairer number; the least of all rounds counts. The second line is processor time of
one process, in one run: reading all records of the project (the peer), the plan, and the checks of
the records.
"""

from __future__ import annotations

import argparse
import compileall
import os
import resource
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import flighttest
from aeromatch.planning.match_plan import make_plan
from aeromatch.project.project import read_project
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.support.imports import PACKAGES
from pom.checking.case_check import check_records

ROOT = Path(__file__).resolve().parents[1]
BARE = ["-c", "import numpy, scipy, xarray"]
_WITHOUT_EXTRAS = 'import sys\nsys.modules.update(dict.fromkeys(("dask", "distributed")))\n'


def processor_time(act: Callable[[], Any]) -> tuple[float, Any]:
    """Return the processor time of a call [s], and its result."""
    start = time.process_time()
    result = act()
    return time.process_time() - start, result


def run_command(words: Sequence[str], folder: Path) -> tuple[float, float]:
    """Return wall time and processor time [s] of Python with these arguments and its children."""
    own = {name: text for name, text in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    path = os.pathsep.join([str(folder), str(ROOT)])
    environment = own | {"PYTHONPATH": path, "AEROMATCH_STORE": str(folder / "store")}
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(
        [sys.executable, *words], cwd=folder, env=environment, check=True, capture_output=True
    )
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def print_whole_command(file: Path, rounds: int, jobs: int) -> None:
    """Print wall time and processor time of the plan as a command."""
    words = ["-m", "aeromatch", "match", str(file.resolve()), "-o", "out", "--plan", "--fresh"]
    words += ["--jobs", str(jobs)]
    walls, times, bare_walls, bare_times = [], [], [], []
    for _ in range(rounds):
        with TemporaryDirectory() as name:
            folder = Path(name)
            (folder / "sitecustomize.py").write_text(_WITHOUT_EXTRAS, encoding="utf-8")
            bare_wall, bare_time = run_command(BARE, folder)
            wall, processor = run_command(words, folder)
        walls.append(wall)
        times.append(processor)
        bare_walls.append(bare_wall)
        bare_times.append(bare_time)
    print(
        f"{file.parent.name}, {jobs} processes, least of {rounds}: {min(walls):.2f} s wall "
        f"({min(walls) / min(bare_walls):.1f} bare starts of {min(bare_walls):.2f} s), "
        f"{min(times):.2f} s of processor time ({min(times) / min(bare_times):.1f} bare starts of "
        f"{min(bare_times):.2f} s)",
        flush=True,
    )


def print_parts(file: Path) -> None:
    """Print the processor time of the plan next to that of reading its records."""
    project = read_project(file)
    aircraft = read_aircraft(project.aircraft)
    make_plan(project, "out/plan", 1)  # imports and caches
    planning, plan = processor_time(lambda: make_plan(project, "out/plan", 1))
    names = list(plan.looks)
    reading, records = processor_time(
        lambda: {name: flighttest.read(project.flights[name], project.names) for name in names}
    )
    checking, checks = processor_time(lambda: check_records(records, aircraft, 1))
    errors = sum(len(check.errors) for check in checks.values())
    print(
        f"{project.title}: {len(names)} records, {len(plan.problems)} problems, {errors} "
        f"errors of records; "
        f"reading {reading:.2f} s, plan {planning / reading:.1f} times that, checks of "
        f"the records {checking / reading:.1f} times",
        flush=True,
    )


def main() -> None:
    """Print two lines for every project."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("projects", nargs="*", type=Path, metavar="PROJECT.toml")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    for package in PACKAGES:
        compileall.compile_dir(ROOT / package, quiet=1)
    examples = [ROOT / "data" / name / "aeromatch.toml" for name in ("c182", "t37")]
    for file in given.projects or examples:
        print_whole_command(file, given.rounds, given.jobs)
        print_parts(file)


if __name__ == "__main__":
    main()

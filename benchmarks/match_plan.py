"""What the plan of a match and the checks of its records cost, next to reading the records once.

python benchmarks/match_plan.py [PROJECT.toml ...]

Processor time of one process, in one run: reading all records of the project (the peer), the plan,
and the checks of the records.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import flighttest
from aeromatch.planning.match_plan import make_plan
from aeromatch.project.project import read_project
from flightmech.aircraft.aircraft_file import read_aircraft
from pom.checking.case_check import check_records

DATA = Path(__file__).parents[1] / "data"


def processor_time(act: Callable[[], Any]) -> tuple[float, Any]:
    """Return the processor time of a call [s], and its result."""
    start = time.process_time()
    result = act()
    return time.process_time() - start, result


def main() -> None:
    """Print a line for every project."""
    warnings.simplefilter("ignore")
    files = [Path(name) for name in sys.argv[1:]] or [
        DATA / "c182" / "aeromatch.toml",
        DATA / "t37" / "aeromatch.toml",
    ]
    for file in files:
        project = read_project(file)
        aircraft = read_aircraft(project.aircraft)
        make_plan(project, "out/plan", 1)  # imports and caches
        planning, plan = processor_time(lambda project=project: make_plan(project, "out/plan", 1))
        names = list(plan.looks)
        reading, records = processor_time(
            lambda project=project, names=names: {
                name: flighttest.read(project.flights[name], project.names) for name in names
            }
        )
        checking, checks = processor_time(
            lambda records=records, aircraft=aircraft: check_records(records, aircraft, 1)
        )
        errors = sum(len(check.errors) for check in checks.values())
        print(
            f"{project.title}: {len(names)} records, {len(plan.problems)} problems, {errors} "
            f"errors of records; "
            f"reading {reading:.2f} s, plan {planning / reading:.1f} times that, checks of "
            f"the records {checking / reading:.1f} times"
        )


if __name__ == "__main__":
    main()

"""All NASA/NESC atmospheric check cases, 1 to 16: largest differences of ours from every published
tool, and of the tools from each other.

    python benchmarks/check_cases.py                   every recorded column
    python benchmarks/check_cases.py --groups          columns gathered
    python benchmarks/check_cases.py 11 13p1 --adams   with the integration of tool 5

The records lie in ../shared/data/flight/nesc_checkcases; a case without one is flown, and its end
is printed.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

import numpy as np
import xarray as xr

from flightmech.support.console import print_table

TESTS = Path(__file__).parents[1] / "tests" / "published"
sys.path.insert(0, str(TESTS))
SIMPLE, EARTHS = ("01", "02", "03", "06", "07", "09"), ("04", "05", "08", "10")
END = (
    "altitudeMsl_ft",
    "latitude_deg",
    "longitude_deg",
    "mach",
    "eulerAngle_deg_Roll",
    "eulerAngle_deg_Pitch",
    "eulerAngle_deg_Yaw",
)


def module(name: str) -> ModuleType:
    """Return a test module, for the bodies and starts it holds."""
    spec = importlib.util.spec_from_file_location(name, TESTS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    found = importlib.util.module_from_spec(spec)
    sys.modules[name] = found
    spec.loader.exec_module(found)
    return found


def flown(case: str, adams: bool) -> tuple[str, xr.Dataset]:
    """Return title and run of a case."""
    if case in SIMPLE:
        return f"case {int(case)}", module("test_nesc").fly(
            int(case), np.round(np.arange(0.0, 30.05, 0.1), 3)
        )
    if case in EARTHS:
        return f"case {int(case)}", module("test_nesc_earth").flown(int(case))
    from nesc.flight import fly
    from nesc.scenarios import SCENARIOS

    with_law = adams and bool(SCENARIOS[case].law)
    return f"case {case.replace('p', '.')}: {SCENARIOS[case].title}", fly(
        case, 0.01, adams=True
    ) if with_law else fly(case)


def compared(case: str, run: xr.Dataset, groups: bool) -> tuple[list[str], list[list[str]]]:
    """Return head and rows of the table of largest differences."""
    from nesc import f16, records

    ours = records.as_recorded(
        run, f16.aircraft() if case in ("11", "13p1", "13p3", "15") else None
    )
    end, tools = float(run.time[-1]), records.tools(case)
    found = {
        f"ours-{tool}": records.differences(ours, records.published(case, tool), end)
        for tool in tools
    }
    found |= {f"{a}-{b}": values for (a, b), values in records.spreads(case, end).items()}
    if groups:
        found = {pair: records.grouped(values) for pair, values in found.items()}
    names = dict.fromkeys(
        name for pair, values in found.items() if pair.startswith("ours") for name in values
    )
    return ["", *found], [
        [name, *(figure(values, name) for values in found.values())] for name in names
    ]


def figure(values: Mapping[str, float], name: str) -> str:
    """Return two digits, or a dash where one of the two has no such column."""
    return f"{values[name]:.1e}" if name in values else "-"


def main() -> None:
    """Fly and print."""
    every = [*SIMPLE, *EARTHS, "11", "12", "13p1", "13p2", "13p3", "13p4", "15", "16"]
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "case",
        nargs="*",
        default=sorted(every),
        help=f"one of {', '.join(sorted(every))}; all by default",
    )
    parser.add_argument("--groups", action="store_true", help="gather the columns")
    parser.add_argument(
        "--adams", action="store_true", help="integrate cases with a control law as tool 5 does"
    )
    options = parser.parse_args()
    if unknown := sorted(set(options.case) - set(every)):
        parser.error(f"unknown case {', '.join(unknown)}; allowed: {', '.join(sorted(every))}")
    from nesc import records

    for case in options.case:
        began = time.perf_counter()
        title, run = flown(case, options.adams)
        print(f"\n{title}, {float(run.time[-1]):g} s, flown in {time.perf_counter() - began:.1f} s")
        if records.tools(case):
            print_table(*compared(case, run, options.groups))
        else:
            last = {name: values[-1] for name, values in records.as_recorded(run).items()}
            print("no record; at the end " + ", ".join(f"{name} {last[name]:.9g}" for name in END))


if __name__ == "__main__":
    main()

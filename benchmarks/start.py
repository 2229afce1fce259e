"""Start of the verbs: CPU time of a whole process, user and system, as a ratio to ``aeromatch
--help`` in the same run.

Verbs that show, check or compare are run on the results of the demo and on the records of the
example c182; of the others, which take minutes, ``--help`` is run.  The rows above them are Python
and the packages that read HDF5 and the command line: no verb can be faster, but for the search for
circles of objects at the end of a process, which the verbs leave out.  The packages are compiled
first, as an installation does; where the variable PYTHONDONTWRITEBYTECODE is set, Python would
compile a checkout anew in every process. Every command is run once per round, ROUNDS rounds, and
the best of each counts.

python benchmarks/start.py out/t37 [ROUNDS]
"""

from __future__ import annotations

import compileall
import os
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import h5py

from aeromatch.cli.command import cli
from flightmech.support.console import print_table
from flightmech.support.imports import PACKAGES

ROOT = Path(__file__).parents[1]
PEER = "--help"
PYTHON = {
    "Python": "pass",
    "numpy": "import numpy",
    "numpy, click": "import numpy, click",
    "numpy, h5py, click": "import numpy, h5py, click",
    "pandas": "import pandas",
    "xarray": "import xarray",
}


def commands(out: Path, folder: Path) -> dict[str, list[str]]:
    """Verbs that show or check, by what the table calls them; inputs are made in `folder`."""
    flight, listing = ROOT / "data/c182/flight/cruise.csv", ROOT / "data/t37/datcom/t37_clean.out"
    names, record = ["--names", str(ROOT / "data/c182/names.toml")], folder / "record.nc"
    run(["flight", "convert", str(flight), *names, "-o", str(record)])
    changed = Path(shutil.copy(record, folder / "changed.nc"))
    # opening a file to change it removes its seal
    with h5py.File(changed, "a"):
        pass
    given = {
        "datcom show": ["datcom", "show", listing],
        "datcom check": ["datcom", "check", listing.with_suffix(".inp")],
        "datcom cells": ["datcom", "cells", listing, "-o", folder / "cells.csv"],
        "db show (a priori)": ["db", "show", out / "datcom.nc"],
        "db show (final)": ["db", "show", out / "final.nc"],
        "db show --json (final)": ["db", "show", out / "final.nc", "--json"],
        "db show --term": ["db", "show", out / "final.nc", "--term", "CL/basic"],
        "db decisions": ["db", "decisions", out / "final.nc"],
        "db history": ["db", "history", out / "final.nc"],
        "db previous": ["db", "previous", out / "final.nc"],
        "db check (a priori)": ["db", "check", out / "datcom.nc"],
        "db compare": ["db", "compare", out / "datcom.nc", out / "final.nc"],
        "db scheme": ["db", "scheme"],
        "flight show (netCDF)": ["flight", "show", record],
        "flight show (netCDF without a seal)": ["flight", "show", changed],
        "flight show (CSV)": ["flight", "show", flight, *names],
        "flight info (netCDF)": ["flight", "info", record],
        "flight info (netCDF without a seal)": ["flight", "info", changed],
        "flight info (CSV)": ["flight", "info", flight],
        "flight check (netCDF)": ["flight", "check", record],
        "flight manoeuvres (netCDF)": ["flight", "manoeuvres", record],
        "fmu show": ["fmu", "show", out / "final.fmu"],
        "pom verify": ["pom", "verify", out / "report"],
        "pom schema": ["pom", "schema", "-o", folder / "case.schema.json"],
        "schema project": ["schema", "project", "-o", folder / "project.schema.json"],
        "no such verb": ["db", "shwo"],
        "no such file": ["db", "show", "none.nc"],
        "file of another kind": ["db", "show", listing],
        "--version": ["--version"],
    }
    return {what: list(map(str, command)) for what, command in given.items()}


def verbs(group: click.Command, path: list[str], context: click.Context) -> list[list[str]]:
    """All verbs of a group and of the groups in it."""
    if not isinstance(group, click.Group):
        return [path]
    members = ((name, group.get_command(context, name)) for name in group.list_commands(context))
    return [
        verb for name, member in members if member for verb in verbs(member, [*path, name], context)
    ]


def run(command: list[str], **variables: str) -> float:
    """CPU time of ``aeromatch`` with a command. [s]"""
    return process([sys.executable, "-m", "aeromatch", *command], **variables)


def process(command: list[str], **variables: str) -> float:
    """CPU time of a process, its output thrown away. [s]"""
    child = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=os.environ | variables
    )
    _, _, usage = os.wait4(child.pid, 0)
    child.returncode = 0
    return usage.ru_utime + usage.ru_stime


def main(out: Path, rounds: int) -> None:
    """Print two tables."""
    for package in PACKAGES:
        compileall.compile_dir(ROOT / package, quiet=1)
    with TemporaryDirectory() as folder:
        shown = {PEER: [PEER], **commands(out, Path(folder))}
        work = {
            what: lambda code=code: process([sys.executable, "-c", code], OPENBLAS_NUM_THREADS="1")
            for what, code in PYTHON.items()
        }
        work |= {what: lambda command=command: run(command) for what, command in shown.items()}
        work["completion"] = lambda: run(
            [], _AEROMATCH_COMPLETE="bash_complete", COMP_WORDS="aeromatch db ", COMP_CWORD="2"
        )
        helped = verbs(cli, [], click.Context(cli))
        work |= {
            f"{' '.join(verb)} --help": lambda verb=verb: run([*verb, "--help"]) for verb in helped
        }
        best = {
            what: min(times)
            for what, times in zip(
                work, zip(*([one() for one in work.values()] for _ in range(rounds)))
            )
        }
    print_table(
        ["what", "CPU [ms]", "times --help"],
        [(what, f"{1e3 * t:.0f}", f"{t / best[PEER]:.1f}") for what, t in best.items()],
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 3)

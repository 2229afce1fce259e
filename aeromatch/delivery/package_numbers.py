"""Numbers of a data package: verdicts of the report, states in every format, flights by the kernel.

The readers of a received package can crash on its files or never end. They run in a child process.
This module is also the program of the child: ``python -m aeromatch.delivery.package_numbers
FOLDER``. It writes the checks to standard output, as JSON after a line with a mark and the length.
"""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import xarray as xr
from scipy.io import loadmat, savemat

import aerodb
import flightmech
import pom
from aerodb.edit.ground_effect import with_height_table
from aerodb.exchange.daveml.exporter import export_daveml
from aerodb.exchange.daveml.importer import import_daveml
from aerodb.exchange.jsbsim.read import import_jsbsim
from aerodb.exchange.jsbsim.write import export_jsbsim
from aerodb.exchange.tables.csv_checks import run_checkcases
from aerodb.exchange.tables.csv_terms import export_csv, import_csv
from aerodb.exchange.tables.csv_text import read_csv
from aerodb.exchange.tables.matlab import export_matlab, import_matlab
from aerodb.store.evaluation import SEED, outputs_at, random_states
from aeromatch.delivery.flown_checks import (
    compare_outputs,
    find_wide_tolerances,
    fly_by_kernel,
    read_flown_check,
)
from aeromatch.delivery.package_documents import compare_documents, compare_exports
from aeromatch.delivery.package_files import PackageCheck, read_package_manifest
from aeromatch.delivery.places import (
    FLOWN,
    FORMATS,
    README,
    RECORDINGS,
    ROADMAP,
    STATE_COUNT,
    STATES,
)
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchError
from flightmech.names import lookup
from flightmech.simulation.compiler import compile_with_envelope
from flightmech.support.foreign_code.process import (
    RunLimits,
    module_command,
    printable,
    run_foreign,
    sandbox_for,
)
from flightmech.support.foreign_code.sandbox import read_sandbox_mode, uses_sandbox
from flightmech.terms import power_factor
from pom.report.writer import JUNIT

# Kinds of checks of a report that do not concern its inputs.
_PROVED = ("program file", "output", "statement", "tolerance", "verdict")
# Tolerance of a check case of the database, as a fraction of the largest magnitude of its output.
_EXACT = 1e-9
# The same if tables replace the formulas over the height.
_TABLES = 2e-3
_READERS: dict[str, tuple[Callable[[Path], xr.DataTree], float]] = {
    "database/final.nc": (aerodb.open, _EXACT),
    "database/final.mat": (import_matlab, _EXACT),
    "database/final_csv": (import_csv, _EXACT),
    "database/final.dml": (import_daveml, _TABLES),
    "database/final_jsbsim.xml": (import_jsbsim, _TABLES),
}
_MARK = b"aeromatch checks"
# Limits of the child: wall time [s], address space and output [byte].
_TIME, _MEMORY, _OUTPUT = 900.0, 8_000_000_000, 64_000_000
# Greatest height of the tables that replace formulas of the ground effect. [m]
_HIGHEST = 1000.0
# A check of the child that is not about a file.
_CHILD = "the readers of the package"


def export_formats(folder: Path, database: xr.DataTree, aircraft: Aircraft) -> dict[str, str]:
    """Write the final database in the formats of other programs.

    Return the reason for each format that cannot represent it.
    """
    tables = _with_height_tables(database)
    writers: dict[str, Callable[[Path], None]] = {
        "final.mat": lambda path: export_matlab(database, path),
        "final_csv": lambda path: export_csv(database, path),
        "final.dml": lambda path: export_daveml(tables, path, aircraft, STATE_COUNT),
        "final_jsbsim.xml": lambda path: export_jsbsim(tables, path, aircraft),
    }
    refused = {}
    for name, write in writers.items():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            write(folder / name)
        except AeromatchError as error:
            # The README of the package states the reason.
            refused[f"database/{name}"] = "; ".join(getattr(error, "problems", ()) or [str(error)])
    return refused


def _with_height_tables(database: xr.DataTree) -> xr.DataTree:
    """Return the database with tables in place of the formulas k h^s of the ground effect."""
    tables = {}
    for name, leaf in aerodb.terms(database).items():
        factor = power_factor(leaf)
        if factor is not None and lookup(factor.variable).units == "m":
            tables[name] = with_height_table(leaf, _HIGHEST)
    return aerodb.replace_terms(database, tables, "tables for formulas over the height")


def check_numbers(folder: Path) -> list[PackageCheck]:
    """Check the numbers of a package in a child process with limits and, if possible, a sandbox."""
    folder = folder.resolve()
    done = run_foreign(
        module_command(__name__, str(folder)),
        b"",
        timeout=_TIME,
        # The reader of MATLAB files starts a process of its own.
        limits=RunLimits(memory=_MEMORY, processes=True),
        most=_OUTPUT,
        sandbox=sandbox_for(uses_sandbox(read_sandbox_mode()), [folder]),
    )
    checks: list[PackageCheck] = []
    if not done.failure:
        with suppress(ValueError, KeyError, TypeError):
            checks = _parse_checks(done.output)
    found = {(check.kind, check.name) for check in checks}
    # A reply without a check of each file is not a result.
    if not checks or not _expected_checks(folder) <= found:
        text = done.failure or "it gave no complete result"
        if done.printed:
            text += f"; it printed: {done.printed}"
        checks.append(PackageCheck("states", _CHILD, good=False, detail=text))
    return checks


def _expected_checks(folder: Path) -> set[tuple[str, str]]:
    """Return kind and name of the checks that a package with these files has."""
    expected = {("states", name) for name in _READERS if (folder / name).exists()}
    expected.add(("states", STATES))
    expected |= {("report", name) for name in (README, ROADMAP, RECORDINGS, f"report/{JUNIT}")}
    for file in (folder / "models").glob("*.fmu"):
        expected.add(("report", f"models/{file.name}"))
    for file in (folder / FLOWN).glob("*.csv"):
        expected |= {("flown", f"{file.name}{end}") for end in (" by kernel", ", its tolerances")}
    return expected


def _parse_checks(output: bytes) -> list[PackageCheck]:
    """Return the checks in the output of the child.

    Raises
    ------
    ValueError, KeyError, TypeError
        It is not the output of the child.
    """
    head, _, content = output.partition(b"\n")
    if head != b"%s %d" % (_MARK, len(content)):
        raise ValueError("no checks")
    checks = []
    for row in json.loads(content):
        if row["kind"] not in ("report", "states", "flown"):
            raise ValueError(row["kind"])
        name, detail = printable(str(row["name"])), printable(str(row["detail"]))
        checks.append(PackageCheck(row["kind"], name, good=row["good"] is True, detail=detail))
    return checks


def compute_checks(folder: Path) -> Iterator[PackageCheck]:
    """Yield the checks of the numbers of a package, computed in this process."""
    for item in pom.verify(folder / "report"):
        if item.kind in _PROVED:
            detail = item.detail or item.state
            # A file of another version of the program cannot be compared here.
            is_other = item.kind == "program file" and item.state == "unknown"
            is_same = item.state == "same" or is_other
            yield PackageCheck("report", f"{item.kind}: {item.name}", good=is_same, detail=detail)
    archive = pom.read_archive(folder / "report")
    manifest = read_package_manifest(folder)
    for name, detail, good in compare_documents(folder, manifest, archive.results):
        yield PackageCheck("report", name, good=good, detail=detail)
    for name, detail, good in compare_exports(folder / "report", archive, manifest["version"]):
        yield PackageCheck("report", name, good=good, detail=detail)
    yield from _check_states(folder)
    yield from _compare_formats(folder, manifest["version"])
    yield from _check_kernel_flights(folder)


def _check_states(folder: Path) -> Iterator[PackageCheck]:
    yield _check_coverage(folder)
    for name, (read, allowed) in _READERS.items():
        if not (folder / name).exists():
            continue
        try:
            outputs = run_checkcases(read(folder / name), folder / STATES)
        except AeromatchError as error:
            yield PackageCheck("states", name, good=False, detail=str(error))
            continue
        # Only coefficients are compared, because formulas become tables term by term.
        is_coefficient = ["/" not in str(output) for output in outputs.index]
        coefficients = outputs[is_coefficient]
        ratio = coefficients["largest_difference"].abs() / coefficients["tolerance"]
        worst = str(ratio.idxmax())
        # The ratio is in tolerances of `_EXACT`.
        limit = 1.0
        if allowed != _EXACT:
            limit = allowed / _EXACT
        yield PackageCheck(
            "states",
            name,
            good=bool((ratio <= limit).all()),
            detail=f"largest difference {ratio[worst] * _EXACT:.2g} of the largest {worst}",
        )


def _compare_formats(folder: Path, made_by: str) -> Iterator[PackageCheck]:
    """Yield whether each format is the one that this installation writes from the database.

    The states prove coefficients only, and not standard errors, comments or further variables.
    """
    installed = version("aeromatch")
    if made_by != installed:
        # Another version may write them in another way, and a manifest can state any version.
        text = f"not compared: written by version {made_by}, this is {installed}"
        yield PackageCheck("states", "the formats, written again", good=True, detail=text)
        return
    try:
        database = aerodb.open(folder / "database/final.nc")
        aircraft = flightmech.read_aircraft(folder / "aircraft/final.toml")
    except AeromatchError as error:
        yield PackageCheck("states", "the formats, written again", good=False, detail=str(error))
        return
    with TemporaryDirectory() as place:
        export_formats(Path(place) / "database", database, aircraft)
        for name in FORMATS:
            there = (folder / name).exists()
            if there and name != FLOWN:
                good = _content(folder / name) == _content(Path(place) / name)
                text = "as written from" if good else "is not what this installation writes from"
                text += " database/final.nc and aircraft/final.toml"
                yield PackageCheck("states", f"{name}, written again", good=good, detail=text)


def _content(path: Path) -> dict[str, bytes]:
    """Return the contents of the files of a format, by their path."""
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    contents = {}
    for file in files:
        if file.suffix == ".mat" and file.is_file():
            # another release of zlib may pack the same arrays in another way
            unpacked = io.BytesIO()
            arrays = loadmat(file)
            names = [name for name in arrays if not name.startswith("__")]
            savemat(unpacked, {name: arrays[name] for name in names}, long_field_names=True)
            # without the header, which has the time
            contents[file.name] = unpacked.getvalue()[128:]
        elif file.is_file():
            contents[file.relative_to(path).as_posix()] = file.read_bytes()
    return contents


def _check_coverage(folder: Path) -> PackageCheck:
    """Return the check that the table of states has all of its states, and all outputs."""
    try:
        database = aerodb.open(folder / "database/final.nc")
        table, problems = read_csv(folder / STATES)
    except AeromatchError as error:
        return PackageCheck("states", STATES, good=False, detail=str(error))
    states = random_states(database, count=1, seed=SEED)
    missing = [name for name in outputs_at(database, states, 1) if name not in table.columns]
    detail = f"{len(table.lines)} states"
    # one state many times proves one state
    different = {*zip(*[cells for name, cells in table.columns.items() if name != "case"])}
    if len(different) < len(table.lines):
        detail += f", {len(different)} of them different"
    if missing:
        detail += f", without the outputs {', '.join(missing[:10])}"
    # states of a database with few variables can be the same node twice
    good = len(table.lines) >= STATE_COUNT <= 2 * len(different) and not missing and not problems
    return PackageCheck("states", STATES, good=good, detail=detail)


def _check_kernel_flights(folder: Path) -> Iterator[PackageCheck]:
    files = sorted((folder / FLOWN).glob("*.csv"))
    if not files:
        return
    sim = compile_with_envelope(
        flightmech.read_aircraft(folder / "aircraft/final.toml"),
        aerodb.open(folder / "database/final.nc"),
    )
    for file in files:
        yield check_flight(file, "kernel", lambda case, facts: fly_by_kernel(sim, case, facts))
        yield _check_tolerances(file, sim)


def _check_tolerances(file: Path, sim: Any) -> PackageCheck:
    """Return the check that the tolerances of a check case are not wider than their rule."""
    name = f"{file.name}, its tolerances"
    try:
        wide = find_wide_tolerances(sim, *read_flown_check(file))
    except (AeromatchError, ValueError, KeyError) as error:
        return PackageCheck("flown", name, good=False, detail=printable(str(error)))
    detail = "those of the rule"
    if wide:
        detail = f"none, or wider than the rule: {', '.join(wide)}"
    return PackageCheck("flown", name, good=not wide, detail=detail)


def check_flight(
    file: Path,
    program: str,
    fly: Callable[..., Any],
    tolerance: dict[str, float] | None = None,
    unit: str = "its tolerance",
) -> PackageCheck:
    """Return the check of one flown check case by one program.

    Parameters
    ----------
    file : Path
    program : str
    fly : callable
        Returns the outputs of a case from the case and its facts.
    tolerance : dict, optional
        Default: the tolerance of the file.
    unit : str
        Name of the tolerance.
    """
    name = f"{file.name} by {program}"
    try:
        case, facts, stated_tolerance = read_flown_check(file)
        ratio, worst = compare_outputs(case, fly(case, facts), tolerance or stated_tolerance)
    except Exception as error:
        # A model may lack a library for this platform, or a simulation may fail. This is a failed
        # check, and the other checks go on.
        return PackageCheck("flown", name, good=False, detail=printable(str(error)))
    detail = f"largest difference {ratio:.2g} of {unit}, in {worst}"
    return PackageCheck("flown", name, good=ratio <= 1.0, detail=detail)


def _run_child() -> None:
    """Write the checks of a folder to standard output."""
    # What the libraries print must not come between the bytes of the reply.
    replies = os.dup(1)
    os.dup2(2, 1)
    checks = []
    try:
        for check in compute_checks(Path(sys.argv[1])):
            checks.append(check)
    except AeromatchError as error:
        checks.append(PackageCheck("states", _CHILD, good=False, detail=str(error)))
    rows = [vars(check) for check in checks]
    content = json.dumps(rows).encode()
    with os.fdopen(replies, "wb") as stream:
        stream.write(b"%s %d\n" % (_MARK, len(content)) + content)


if __name__ == "__main__":
    _run_child()

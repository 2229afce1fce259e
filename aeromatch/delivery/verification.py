"""Verification of a data package: hashes, verdicts, and check cases in every executable format."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

import aerodb
import flightmech
import pom
from aerodb.exchange.daveml.importer import import_daveml
from aerodb.exchange.jsbsim.read import import_jsbsim
from aerodb.exchange.tables.csv_checks import run_checkcases
from aerodb.exchange.tables.csv_terms import import_csv
from aerodb.exchange.tables.matlab import import_matlab
from aeromatch.delivery.contents import FLOWN, MANIFEST, STATES
from aeromatch.delivery.flown_checks import (
    compare_outputs,
    fly_by_fmu,
    fly_by_kernel,
    read_flown_check,
)
from aeromatch.delivery.jsbsim_flight import BANDS, PART, fly_by_jsbsim, jsbsim_installed
from flightmech.errors import AeromatchError, ParseError, SchemaError
from flightmech.support.input_files import file_sha256, json_content

# Largest unpacked size of a zip. [byte]
_MOST = 20_000_000_000
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


@dataclass(frozen=True)
class PackageCheck:
    """Result of one check.

    Attributes
    ----------
    kind : str
        ``hash``, ``report``, ``states`` or ``flown``.
    name : str
    good : bool
    detail : str
        Result in words, with numbers.
    """

    kind: str
    name: str
    good: bool
    detail: str = ""


@contextmanager
def unpack_package(package: str | Path) -> Iterator[Path]:
    """Yield the folder of a package; a zip is unpacked into a temporary folder.

    Raises
    ------
    SchemaError
        The path is not a data package, or the zip has members outside of its folder.
    """
    package = Path(package)
    if package.is_dir():
        yield _require_manifest(package)
        return
    if not zipfile.is_zipfile(package):
        raise SchemaError(
            str(package), ["neither a folder nor a zip; give what `aeromatch package make` wrote"]
        )
    with zipfile.ZipFile(package) as content, tempfile.TemporaryDirectory() as temporary:
        # A small zip can unpack to fill the disk.
        if sum(item.file_size for item in content.infolist()) > _MOST:
            raise SchemaError(str(package), [f"unpacks to more than {_MOST:g} bytes"])
        for name in content.namelist():
            if name.startswith(("/", "\\")) or ".." in Path(name).parts:
                raise SchemaError(str(package), [f"{name!r} leads out of the package"])
        content.extractall(temporary)
        root = Path(temporary)
        folders = [item for item in root.iterdir() if item.is_dir()]
        if len(folders) == 1:
            root = folders[0]
        yield _require_manifest(root)


def _require_manifest(folder: Path) -> Path:
    if not (folder / MANIFEST).is_file():
        raise SchemaError(str(folder), [f"no {MANIFEST}; give what `aeromatch package make` wrote"])
    return folder


def read_package_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest of a package.

    Raises
    ------
    ParseError
        The file is not a manifest.
    """
    file = folder / MANIFEST
    content = json_content(file.read_text(encoding="utf-8"), str(file), "a JSON object")
    if not isinstance(content, dict) or not isinstance(content.get("files"), dict):
        raise ParseError(str(file), 0, str(content)[:40], "a manifest of a data package")
    return content


def verify_package(folder: Path) -> Iterator[PackageCheck]:
    """Check a package, step by step.

    Yields
    ------
    PackageCheck
        Hashes of all files; statements, tolerances and verdicts of the report, judged again; the
        states of the check table in every format of the database; the flown check cases in the
        kernel, the FMU, and JSBSim if it is installed.
    """
    yield from _check_hashes(folder)
    for item in pom.verify(folder / "report"):
        if item.kind in _PROVED:
            detail = item.detail or item.state
            is_same = item.state in ("same", "unknown")
            yield PackageCheck("report", f"{item.kind}: {item.name}", good=is_same, detail=detail)
    yield from _check_states(folder)
    yield from _check_flown_cases(folder)


def _check_hashes(folder: Path) -> Iterator[PackageCheck]:
    digests = read_package_manifest(folder)["files"]
    files: dict[str, Path] = {}
    for file in sorted(folder.rglob("*")):
        if file.is_file():
            files[file.relative_to(folder).as_posix()] = file
    for name, digest in digests.items():
        if name not in files:
            yield PackageCheck("hash", name, good=False, detail="missing")
        elif file_sha256(files[name]) == digest:
            yield PackageCheck("hash", name, good=True, detail="same")
        else:
            yield PackageCheck("hash", name, good=False, detail="changed")
    for name in files:
        if name not in digests and name != MANIFEST:
            yield PackageCheck("hash", name, good=False, detail="not of the package")


def _check_states(folder: Path) -> Iterator[PackageCheck]:
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


def _check_flown_cases(folder: Path) -> Iterator[PackageCheck]:
    files = sorted((folder / FLOWN).glob("*.csv"))
    if not files:
        return
    sim = flightmech.compile(
        flightmech.read_aircraft(folder / "aircraft/final.toml"),
        aerodb.open(folder / "database/final.nc"),
    )
    programs: dict[str, Callable[..., Any]] = {
        "kernel": lambda *case: fly_by_kernel(sim, *case),
        "FMU": lambda *case: fly_by_fmu(folder / "models/final.fmu", *case),
    }
    exported = folder / "database/final_jsbsim.xml"
    if exported.is_file() and jsbsim_installed():
        programs["JSBSim"] = lambda *case: fly_by_jsbsim(exported, *case)
    # JSBSim has different equations of motion, so a part of the bands is its tolerance.
    part_of_bands = {name: PART * band for name, band in BANDS.items()}
    for file in files:
        case, facts, stated_tolerance = read_flown_check(file)
        for program, fly in programs.items():
            name = f"{file.name} by {program}"
            tolerance, unit = stated_tolerance, "its tolerance"
            if program == "JSBSim":
                tolerance, unit = part_of_bands, f"1/{1 / PART:g} of the band"
            try:
                ratio, worst = compare_outputs(case, fly(case, facts), tolerance)
            except Exception as error:
                # An FMU may lack a library for this platform, or a simulation may fail. This is a
                # failed check, and the other checks go on.
                yield PackageCheck("flown", name, good=False, detail=str(error))
                continue
            detail = f"largest difference {ratio:.2g} of {unit}, in {worst}"
            yield PackageCheck("flown", name, good=ratio <= 1.0, detail=detail)

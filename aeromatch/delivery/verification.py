"""Whether a data package is what it was and does what it states: hashes, verdicts, and check cases through every format that runs."""

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
from aerodb.exchange import import_csv, import_daveml, import_jsbsim, import_matlab, run_checkcases
from flightmech.errors import AeromatchError, ParseError, SchemaError
from flightmech.support.input_files.text import json_content

from .contents import FLOWN, MANIFEST, STATES, sha256
from .flown_checks import compared, fly_by_fmu, fly_by_kernel, read_flown_check
from .jsbsim_flight import BANDS, PART, fly_by_jsbsim, jsbsim_installed

_MOST = 20_000_000_000  # bytes that a zip may unpack to
_PROVED = ("output", "statement", "tolerance", "verdict")  # of a report apart from its inputs
_TABLES = 2e-3  # of the largest magnitude: what tables in place of a formula over the height may change
_READERS: dict[str, tuple[Callable[[Path], xr.DataTree], float]] = {
    "database/final.nc": (aerodb.open, 1.0),
    "database/final.mat": (import_matlab, 1.0),
    "database/final_csv": (import_csv, 1.0),
    "database/final.dml": (import_daveml, _TABLES),
    "database/final_jsbsim.xml": (import_jsbsim, _TABLES),
}


@dataclass(frozen=True)
class Finding:
    """One thing that was checked.

    Attributes
    ----------
    kind : str
        ``hash``, ``report``, ``states`` or ``flown``.
    name : str
    good : bool
    detail : str
        What was found, with numbers.
    """

    kind: str
    name: str
    good: bool
    detail: str = ""


@contextmanager
def unpacked(package: str | Path) -> Iterator[Path]:
    """Yield the folder of a package; a zip is unpacked into a temporary one.

    Raises
    ------
    SchemaError
        No data package, or a zip whose members lead out of it.
    """
    package = Path(package)
    if package.is_dir():
        yield _demanded(package)
        return
    if not zipfile.is_zipfile(package):
        raise SchemaError(str(package), ["neither a folder nor a zip; give what `aeromatch package make` wrote"])
    with zipfile.ZipFile(package) as content, tempfile.TemporaryDirectory() as place:
        if sum(item.file_size for item in content.infolist()) > _MOST:
            raise SchemaError(str(package), [f"unpacks to more than {_MOST:g} bytes"])
        bad = [name for name in content.namelist() if name.startswith(("/", "\\")) or ".." in Path(name).parts]
        if bad:
            raise SchemaError(str(package), [f"{bad[0]!r} leads out of the package"])
        content.extractall(place)
        folders = [item for item in Path(place).iterdir() if item.is_dir()]
        yield _demanded(folders[0] if len(folders) == 1 else Path(place))


def _demanded(folder: Path) -> Path:
    if not (folder / MANIFEST).is_file():
        raise SchemaError(str(folder), [f"no {MANIFEST}; give what `aeromatch package make` wrote"])
    return folder


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest of a package.

    Raises
    ------
    ParseError
        Not one.
    """
    file = folder / MANIFEST
    found = json_content(file.read_text(encoding="utf-8"), str(file), "a JSON object")
    if not isinstance(found, dict) or not isinstance(found.get("files"), dict):
        raise ParseError(str(file), 0, str(found)[:40], "a manifest of a data package")
    return found


def verify_package(folder: Path) -> Iterator[Finding]:
    """Check a package, step by step.

    Yields
    ------
    Finding
        Hashes of all files; statements, tolerances and verdicts of the report, judged again; the states of the check table through
        every format of the database; the flown check cases through kernel, FMU, and JSBSim where it is installed.
    """
    yield from _hashes(folder)
    for item in pom.verify(folder / "report"):
        if item.kind in _PROVED:
            yield Finding("report", f"{item.kind}: {item.name}", item.state == "same", item.detail or item.state)
    yield from _states(folder)
    yield from _flown(folder)


def _hashes(folder: Path) -> Iterator[Finding]:
    stated = read_manifest(folder)["files"]
    there = {file.relative_to(folder).as_posix(): file for file in sorted(folder.rglob("*")) if file.is_file()}
    for name, digest in stated.items():
        if name not in there:
            yield Finding("hash", name, False, "missing")
        else:
            same = sha256(there[name]) == digest
            yield Finding("hash", name, same, "same" if same else "changed")
    for name in there:
        if name not in stated and name != MANIFEST:
            yield Finding("hash", name, False, "not of the package")


def _states(folder: Path) -> Iterator[Finding]:
    for name, (read, allowed) in _READERS.items():
        if not (folder / name).exists():
            continue
        try:
            found = run_checkcases(read(folder / name), folder / STATES)
        except AeromatchError as error:
            yield Finding("states", name, False, str(error))
            continue
        own = found[[("/" not in str(output)) for output in found.index]]  # coefficients; formulas become tables term by term
        ratio = own["largest_difference"].abs() / own["tolerance"]
        worst = str(ratio.idxmax())
        limit = 1.0 if allowed == 1.0 else allowed / 1e-9  # the tolerance of a table is 1e-9 of its largest magnitude
        yield Finding("states", name, bool((ratio <= limit).all()), f"largest difference {ratio[worst] * 1e-9:.2g} of the largest {worst}")


def _flown(folder: Path) -> Iterator[Finding]:
    files = sorted((folder / FLOWN).glob("*.csv"))
    if not files:
        return
    sim = flightmech.compile(flightmech.read_aircraft(folder / "aircraft/final.toml"), aerodb.open(folder / "database/final.nc"))
    ways: dict[str, Callable[..., Any]] = {
        "kernel": lambda *case: fly_by_kernel(sim, *case),
        "FMU": lambda *case: fly_by_fmu(folder / "models/final.fmu", *case),
    }
    exported = folder / "database/final_jsbsim.xml"
    if exported.is_file() and jsbsim_installed():
        ways["JSBSim"] = lambda *case: fly_by_jsbsim(exported, *case)
    between_programs = {name: PART * band for name, band in BANDS.items()}
    for file in files:
        case, facts, stated = read_flown_check(file)
        for way, fly in ways.items():
            tolerance, of = (between_programs, f"1/{1 / PART:g} of the band") if way == "JSBSim" else (stated, "its tolerance")
            try:
                ratio, worst = compared(case, fly(case, facts), tolerance)
            except Exception as error:  # an FMU without a library for this platform, a flight that fails: a finding, not the end
                yield Finding("flown", f"{file.name} by {way}", False, str(error))
                continue
            yield Finding("flown", f"{file.name} by {way}", ratio <= 1.0, f"largest difference {ratio:.2g} of {of}, in {worst}")

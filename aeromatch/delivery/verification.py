"""Whether a data package is what it was and does what it states: hashes, verdicts, and check cases
through every format that runs.
"""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import aerodb
import flightmech
import pom
from aerodb.exchange.daveml.importer import import_daveml
from aerodb.exchange.jsbsim.read import import_jsbsim
from aerodb.exchange.tables.csv_checks import run_checkcases
from aerodb.exchange.tables.csv_terms import import_csv
from aerodb.exchange.tables.matlab import import_matlab
from aeromatch.delivery.contents import FLOWN, MANIFEST, STATES, file_sha256
from aeromatch.delivery.flown_checks import (
    compare_outputs,
    conditions_of,
    fly_by_fmu,
    fly_by_kernel,
    read_flown_check,
)
from aeromatch.delivery.jsbsim_flight import BANDS, PART, fly_by_jsbsim, jsbsim_installed
from flightmech.aircraft.parts import different_parts
from flightmech.errors import AeromatchError, ParseError, SchemaError
from flightmech.support.input_files import json_content
from flightmech.units import from_si
from pom.result import status_text

_MOST = 20_000_000_000  # bytes that a zip may unpack to
_PROVED = ("output", "statement", "tolerance", "verdict")  # of a report apart from its inputs
_TABLES = (
    2e-3  # of the largest magnitude: what tables in place of a formula over the height may change
)
_READERS: dict[str, tuple[Callable[[Path], xr.DataTree], float]] = {
    "database/final.nc": (aerodb.open, 1.0),
    "database/final.mat": (import_matlab, 1.0),
    "database/final_csv": (import_csv, 1.0),
    "database/final.dml": (import_daveml, _TABLES),
    "database/final_jsbsim.xml": (import_jsbsim, _TABLES),
}


@dataclass(frozen=True)
class PackageCheck:
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
def unpack_package(package: str | Path) -> Iterator[Path]:
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
        raise SchemaError(
            str(package), ["neither a folder nor a zip; give what `aeromatch package make` wrote"]
        )
    with zipfile.ZipFile(package) as content, tempfile.TemporaryDirectory() as place:
        if sum(item.file_size for item in content.infolist()) > _MOST:
            raise SchemaError(str(package), [f"unpacks to more than {_MOST:g} bytes"])
        bad = [
            name
            for name in content.namelist()
            if name.startswith(("/", "\\")) or ".." in Path(name).parts
        ]
        if bad:
            raise SchemaError(str(package), [f"{bad[0]!r} leads out of the package"])
        content.extractall(place)
        folders = [item for item in Path(place).iterdir() if item.is_dir()]
        yield _demanded(folders[0] if len(folders) == 1 else Path(place))


def _demanded(folder: Path) -> Path:
    if not (folder / MANIFEST).is_file():
        raise SchemaError(str(folder), [f"no {MANIFEST}; give what `aeromatch package make` wrote"])
    return folder


def read_package_manifest(folder: Path) -> dict[str, Any]:
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


def verify_package(folder: Path) -> Iterator[PackageCheck]:
    """Check a package, step by step.

    Yields
    ------
    Finding
        Hashes of all files; statements, tolerances and verdicts of the report, judged again; the
        states of the check table through every format of the database; the flown check cases
        through kernel, FMU, and JSBSim where it is installed.
    """
    yield from _hashes(folder)
    for item in pom.verify(folder / "report"):
        if item.kind in _PROVED:
            yield PackageCheck(
                "report",
                f"{item.kind}: {item.name}",
                item.state == "same",
                item.detail or item.state,
            )
    yield from _states(folder)
    yield from _flown(folder)


def _hashes(folder: Path) -> Iterator[PackageCheck]:
    stated = read_package_manifest(folder)["files"]
    there = {
        file.relative_to(folder).as_posix(): file
        for file in sorted(folder.rglob("*"))
        if file.is_file()
    }
    for name, digest in stated.items():
        if name not in there:
            yield PackageCheck("hash", name, False, "missing")
        else:
            same = file_sha256(there[name]) == digest
            yield PackageCheck("hash", name, same, "same" if same else "changed")
    for name in there:
        if name not in stated and name != MANIFEST:
            yield PackageCheck("hash", name, False, "not of the package")


def _states(folder: Path) -> Iterator[PackageCheck]:
    for name, (read, allowed) in _READERS.items():
        if not (folder / name).exists():
            continue
        try:
            found = run_checkcases(read(folder / name), folder / STATES)
        except AeromatchError as error:
            yield PackageCheck("states", name, False, str(error))
            continue
        own = found[
            [("/" not in str(output)) for output in found.index]
        ]  # coefficients; formulas become tables term by term
        ratio = own["largest_difference"].abs() / own["tolerance"]
        worst = str(ratio.idxmax())
        limit = (
            1.0 if allowed == 1.0 else allowed / 1e-9
        )  # the tolerance of a table is 1e-9 of its largest magnitude
        yield PackageCheck(
            "states",
            name,
            bool((ratio <= limit).all()),
            f"largest difference {ratio[worst] * 1e-9:.2g} of the largest {worst}",
        )


def _flown(folder: Path) -> Iterator[PackageCheck]:
    files = sorted((folder / FLOWN).glob("*.csv"))
    if not files:
        return
    sim = flightmech.compile(
        flightmech.read_aircraft(folder / "aircraft/final.toml"),
        aerodb.open(folder / "database/final.nc"),
    )
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
            tolerance, of = (
                (between_programs, f"1/{1 / PART:g} of the band")
                if way == "JSBSim"
                else (stated, "its tolerance")
            )
            try:
                ratio, worst = compare_outputs(case, fly(case, facts), tolerance)
            except Exception as error:  # an FMU without a library for this platform, a flight that fails: a finding, not the end
                yield PackageCheck("flown", f"{file.name} by {way}", False, str(error))
                continue
            yield PackageCheck(
                "flown",
                f"{file.name} by {way}",
                ratio <= 1.0,
                f"largest difference {ratio:.2g} of {of}, in {worst}",
            )


_FELT = {
    "V_stall": ("stall speed, true, power off", "kt"),
    "static_margin_fixed": ("static margin, controls held, chords", ""),
    "elevator_per_g": ("elevator per g in a pull-up", "deg"),
    "stick_force_per_g": ("stick force per g in a pull-up", "lbf"),
    "delta_r_per_beta": ("rudder over sideslip, straight flight", ""),
    "phi_per_beta": ("bank over sideslip, straight flight", ""),
    "roll_rate_peak": ("highest roll rate at full aileron", "deg/s"),
    "L_D_max": ("best lift over drag, power off", ""),
    "climb_rate_max": ("best rate of climb", "ft/min"),
}
"""What a pilot feels, of `flightmech.characteristics`: words and unit."""
_MODES = ("short period", "phugoid", "Dutch roll", "roll", "spiral")
_OF_MODES = {
    "period": ("period", "s"),
    "damping_ratio": ("damping ratio", ""),
    "t_half": ("time to half amplitude", "s"),
    "t_double": ("time to double amplitude", "s"),
}


def package_difference(
    one: Path, other: Path, model: str = "final", other_model: str | None = None
) -> dict[str, Any]:
    """Return what changed from one package to another, or from one model to another of the same.

    Parameters
    ----------
    one, other : Path
        Folders of packages.
    model, other_model : str
        ``datcom``, ``corrected`` or ``final``; the second is the first unless given.

    Returns
    -------
    dict
        ``terms`` and ``coefficients`` (name; state ``added``, ``deleted`` or ``changed``; value
        before and after where they differ most, and where that is; rms difference; largest in
        standard errors of both), ``parts``, ``cases`` (verdict and worst ratio before and after),
        ``files`` that were added, deleted or changed; ``felt``: what a pilot feels of it, trimmed
        at the ``condition`` of the cleanest validation flight (words, unit, before, after).
    """
    second = other_model or model
    before, after = (
        aerodb.open(one / f"database/{model}.nc"),
        aerodb.open(other / f"database/{second}.nc"),
    )
    aircraft = [
        flightmech.read_aircraft(folder / f"aircraft/{name}.toml")
        for folder, name in ((one, model), (other, second))
    ]
    rows, condition = _differences(before, after), _condition(other)
    return {
        "models": [model, second],
        "condition": condition,
        "felt": _felt(
            *(
                _characteristics(craft, db, condition)
                for craft, db in zip(aircraft, (before, after), strict=True)
            )
        ),
        "terms": [row for row in rows if "/" in row["name"]],
        "coefficients": [row for row in rows if "/" not in row["name"]],
        "parts": different_parts(*aircraft),
        "cases": _cases(one, model, other, second),
        "files": _files(one, other) if one != other else [],
    }


def _differences(before: Any, after: Any) -> list[dict[str, Any]]:
    """Return what differs of terms and coefficients, from `aerodb.compare`."""
    states = {"a": "deleted", "b": "added", "both": "changed"}
    rows = []
    for row in aerodb.compare(before, after).reset_index().to_dict("records"):
        if row["found_in"] == "both" and not row["max_difference"]:
            continue
        rows.append(
            {
                "name": row["term"],
                "state": states[row["found_in"]],
                "before": row["value_a"],
                "after": row["value_b"],
                "where": row["location"],
                "largest": row["max_difference"],
                "rms": row["rms_difference"],
                "in_standard_errors": row["max_in_stderr_difference"],
                "note": str(row["note"] or ""),
            }
        )
    return rows


def _condition(package: Path) -> dict[str, float]:
    """Return speed, height, mass and configuration of the validation flight with the least flaps
    and gear; empty where none is trimmed.
    """
    flights = conditions_of(pom.read_archive(package / "report").results).values()
    found = min(flights, key=lambda at: (at.get("delta_f", 0.0), at.get("gear", 0.0)), default={})
    return {name: found[name] for name in ("V", "h", "mass", "delta_f", "gear") if name in found}


def _characteristics(aircraft: Any, db: Any, condition: dict[str, float]) -> Any:
    try:
        return flightmech.characteristics(aircraft, db, condition) if condition else None
    except AeromatchError:  # no steady flight of one of the two: there is nothing to compare
        return None


def _felt(before: Any, after: Any) -> list[dict[str, Any]]:
    """Return the rows of `_FELT` and of the eigenmotions that both models have, in the units of the
    field.
    """
    if before is None or after is None:
        return []
    rows = []
    for name, (words, unit) in _FELT.items():
        values = [
            value for found in (before, after) if (value := _value(found.table, name)) is not None
        ]
        if len(values) == 2:
            shown = [float(from_si(value, unit)) if unit else value for value in values]
            rows.append({"words": words, "unit": unit, "before": shown[0], "after": shown[1]})
    for mode in _MODES:
        sides = [found.modes[found.modes["mode"] == mode] for found in (before, after)]
        for column, (words, unit) in (
            _OF_MODES.items() if all(len(side) == 1 for side in sides) else ()
        ):
            shown = [float(side[column].iloc[0]) for side in sides]
            periodic = any(np.isfinite(side["period"].iloc[0]) for side in sides)
            if np.isfinite(shown).any() and (periodic or column != "damping_ratio"):
                rows.append(
                    {
                        "words": f"{mode}: {words}",
                        "unit": unit,
                        "before": shown[0],
                        "after": shown[1],
                    }
                )
    return rows


def _value(characteristics: Any, name: str) -> float | None:
    if name not in characteristics.index or characteristics.loc[name, "absent"]:
        return None
    return float(characteristics.loc[name, "value"])


def _cases(one: Path, model: str, other: Path, second: str) -> list[dict[str, Any]]:
    old, new = (
        {r.case.name: r for r in pom.read_archive(folder / "report").results}
        for folder in (one, other)
    )
    rows = []
    for name in dict.fromkeys([*old, *new]):
        sides = [
            (found[name], run) if name in found and run in found[name].runs else None
            for found, run in ((old, model), (new, second))
        ]
        states = ["" if side is None else status_text(side[0].status(side[1])) for side in sides]
        worst = [
            None if side is None else (side[0].worst(side[1]) or {}).get("worst_ratio")
            for side in sides
        ]
        case = (new[name] if name in new else old[name]).case
        rows.append(
            {
                "row": case.id,
                "case": case.title,
                "before": states[0],
                "after": states[1],
                "worst_before": worst[0],
                "worst_after": worst[1],
            }
        )
    return rows


def _files(one: Path, other: Path) -> list[dict[str, str]]:
    old, new = (read_package_manifest(folder)["files"] for folder in (one, other))
    states = {
        name: "deleted" if name not in new else "added" if name not in old else "changed"
        for name in sorted({*old, *new})
        if old.get(name) != new.get(name)
    }
    return [{"file": name, "state": state} for name, state in states.items()]

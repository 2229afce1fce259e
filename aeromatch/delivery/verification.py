"""Verification of a data package in stages: structure, signature, hashes, numbers, flights.

A received package is not trusted. Structure and hashes read bytes only; numbers and flights run in
child processes. A stage runs only if the package is what its manifest states.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from aeromatch.delivery.flown_checks import read_flown_check
from aeromatch.delivery.fmu_flight import fly_cases_by_fmu, foreign_library, named_outputs
from aeromatch.delivery.foreign_flight import Case
from aeromatch.delivery.jsbsim_flight import (
    BANDS,
    PART,
    fly_cases_by_jsbsim,
    foreign_elements,
    jsbsim_installed,
    jsbsim_outputs,
)
from aeromatch.delivery.package_files import (
    PackageCheck,
    check_hashes,
    check_structure,
    read_package_manifest,
)
from aeromatch.delivery.package_numbers import check_flight, check_numbers
from aeromatch.delivery.places import FLOWN, SIGNATURE
from aeromatch.delivery.signing import PackageSignature
from flightmech.errors import AeromatchError, SimulationError
from flightmech.support.foreign_code.sandbox import describe_sandbox

_FMU, _JSBSIM = "models/final.fmu", "database/final_jsbsim.xml"


def verify_package(folder: Path, fly_foreign: bool = False) -> Iterator[PackageCheck]:
    """Check a package, stage by stage.

    Parameters
    ----------
    folder : Path
    fly_foreign : bool
        Whether an FMU flies whose library is not that of this installation.

    Yields
    ------
    PackageCheck
        Structure; hashes of all files, after which a changed package is not read further;
        statements, tolerances and verdicts of the report, judged again; the states of the check
        table in every format of the database; the flown check cases in the kernel, the FMU, and
        JSBSim if it is installed.
    """
    for check_stage in (check_structure, check_hashes):
        checks = check_stage(folder)
        yield from checks
        if not all(check.good for check in checks):
            return
    yield from check_numbers(folder)
    yield from _check_flights(folder, fly_foreign)


def _check_flights(folder: Path, fly_foreign: bool) -> Iterator[PackageCheck]:
    """Yield the checks of the flown check cases by the FMU and by JSBSim."""
    files = sorted((folder / FLOWN).glob("*.csv"))
    if not files:
        # The structure has checked that the manifest states the reason.
        reason = read_package_manifest(folder)["refused"].get(FLOWN, "")
        yield PackageCheck("flown", FLOWN, good=bool(reason), detail=f"no check case: {reason}")
        return
    cases: list[Case] = []
    try:
        for file in files:
            case, facts, _ = read_flown_check(file)
            cases.append((case, facts))
    except AeromatchError as error:
        yield PackageCheck("flown", FLOWN, good=False, detail=str(error))
        return
    yield from _check_fmu(folder / _FMU, files, cases, fly_foreign=fly_foreign)
    if (folder / _JSBSIM).is_file() and jsbsim_installed():
        yield from _check_jsbsim(folder / _JSBSIM, files, cases)


def _check_fmu(
    fmu: Path, files: Sequence[Path], cases: Sequence[Case], fly_foreign: bool
) -> Iterator[PackageCheck]:
    reason = foreign_library(fmu)
    if reason and not fly_foreign:
        text = (
            f"not flown: its code is not of this installation ({reason}); --fly-foreign runs it "
            f"{describe_sandbox()}"
        )
        yield PackageCheck("flown", _FMU, good=False, detail=text)
        return
    flights = fly_cases_by_fmu(fmu, cases)
    for file, flight in zip(files, flights, strict=True):
        yield check_flight(file, "FMU", lambda case, facts, got=flight: named_outputs(got))
    if reason:
        text = f"its own code was flown {describe_sandbox()}: {reason}"
        yield PackageCheck("flown", _FMU, good=True, detail=text)


def _check_jsbsim(
    model: Path, files: Sequence[Path], cases: Sequence[Case]
) -> Iterator[PackageCheck]:
    try:
        removed = foreign_elements(model)
        flights: list[Any] = fly_cases_by_jsbsim(model, cases)
    except SimulationError as error:
        yield PackageCheck("flown", _JSBSIM, good=False, detail=str(error))
        return
    if removed:
        text = f"has elements that aeromatch does not write, left out: {', '.join(removed)}"
        yield PackageCheck("flown", _JSBSIM, good=False, detail=text)
    # JSBSim has different equations of motion, so a part of the bands is its tolerance.
    part_of_bands = {name: PART * band for name, band in BANDS.items()}
    for file, flight in zip(files, flights, strict=True):
        yield check_flight(
            file,
            "JSBSim",
            lambda case, facts, got=flight: jsbsim_outputs(got, case, model.name),
            tolerance=part_of_bands,
            unit=f"1/{1 / PART:g} of the band",
        )


def check_package_signature(signature: PackageSignature, has_trusted: bool) -> list[PackageCheck]:
    """Return the check of a signature; none for a package without one if no key is demanded."""
    if signature.state == "none" and not has_trusted:
        return []
    good = signature.state == "known" or (signature.state == "unknown" and not has_trusted)
    return [PackageCheck("signature", SIGNATURE, good=good, detail=signature.text)]


def describe_verdict(checks: Sequence[PackageCheck], signature: PackageSignature) -> str:
    """Return in one line whether a package holds, and who has made it.

    A package that is consistent with itself can come from anyone: its maker is proven by a known
    key alone, and the line begins with that.
    """
    bad = [check for check in checks if not check.good and check.kind != "signature"]
    origin = signature.text
    if signature.state == "unknown":
        origin += ", which proves nothing about its maker: give --trusted-key"
    elif signature.state == "none":
        origin += ", so anyone can have made it"
    if bad:
        kinds = ", ".join(dict.fromkeys(check.kind for check in bad))
        return f"does NOT hold: {len(bad)} findings ({kinds}); {origin}"
    if signature.state == "broken":
        return f"does NOT hold: {origin}"
    if signature.state == "known":
        return f"{origin}, and consistent with itself"
    return f"MAKER NOT PROVEN, consistent with itself; {origin}"

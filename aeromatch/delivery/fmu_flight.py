"""Flight of check cases by the FMU of a package in FMPy, an independent importer.

An FMU is a program. It flies in a child process (`aeromatch.delivery.foreign_flight`), whose
program is this module: ``python -m aeromatch.delivery.fmu_flight MODEL.fmu``.
"""

from __future__ import annotations

import contextlib
import re
import sys
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import xarray as xr

from aeromatch.delivery.flown_checks import OUTPUTS, RATE, inputs_and_parameters
from aeromatch.delivery.foreign_flight import Case, Job, answer_jobs, demand_flight, fly_in_child
from flightmech.errors import AeromatchError
from flightmech.fmu_export.fmu_file import find_libraries, place_libraries

_LARGEST_DESCRIPTION = 64_000_000  # byte
_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,200}")


def foreign_library(fmu: Path) -> str:
    """Return why the library of an FMU is not that of this installation; empty if it is.

    Every file below ``binaries`` must be equal, byte by byte, to the installed library of its
    platform, or be for a platform that is not installed here and cannot run.
    """
    try:
        with zipfile.ZipFile(fmu) as content:
            return _compare_libraries(content)
    except (zipfile.BadZipFile, KeyError, ET.ParseError, OSError, RuntimeError) as error:
        return f"it cannot be read ({type(error).__name__})"
    except AeromatchError as error:
        return str(error)


def _compare_libraries(content: zipfile.ZipFile) -> str:
    if content.getinfo("modelDescription.xml").file_size > _LARGEST_DESCRIPTION:
        return "its description is too large"
    names = content.namelist()
    if len(set(names)) < len(names) or any("\\" in name for name in names):
        return "it has two files of one name, or a name with a backslash"
    root = ET.fromstring(content.read("modelDescription.xml"))
    version = root.get("fmiVersion", "")
    version = "3.0" if version.startswith("3.") else version
    if version not in ("2.0", "3.0"):
        return f"it is of FMI {version[:10]!r}"
    installed: dict[str, bytes] = {}
    libraries = find_libraries()
    for kind in root.iter():
        identifier = kind.get("modelIdentifier")
        if identifier is None:
            continue
        # The file name of the library is made of it.
        if not _IDENTIFIER.fullmatch(identifier):
            return "its model identifier is not a name"
        installed |= place_libraries(libraries, identifier, version)
    folders = {name.rpartition("/")[0] for name in installed}
    ours = 0
    for name in names:
        if name in installed:
            if content.getinfo(name).file_size != len(installed[name]):
                return f"{name} is not the installed library"
            if content.read(name) != installed[name]:
                return f"{name} is not the installed library"
            ours += 1
        elif name.rpartition("/")[0] in folders and not name.endswith("/"):
            return f"{name} is not a file of the installed library"
    return "" if ours else "it has no library of this platform"


def fly_cases_by_fmu(fmu: Path, cases: Sequence[Case]) -> list[np.ndarray | str]:
    """Return the outputs of check cases (time, output), or the text of a failure."""
    jobs, shapes = [], []
    for case, facts in cases:
        inputs, parameters = inputs_and_parameters(case, facts)
        names = [str(name) for name in inputs.data_vars]
        jobs.append(
            {
                "time": case["time"].values,
                "names": np.array(names),
                "signals": np.column_stack([inputs[name].values for name in names]),
                "parameter_names": np.array([*parameters]),
                "parameters": np.array([*parameters.values()], float),
            }
        )
        shapes.append((case.sizes["time"], len(OUTPUTS)))
    return fly_in_child(__name__, jobs, shapes, [fmu])


def fly_by_fmu(fmu: Path, case: xr.Dataset, facts: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Return the outputs of a check case, simulated by an FMU in FMPy in a child process.

    Raises
    ------
    SimulationError
        The flight failed.
    """
    (flight,) = fly_cases_by_fmu(fmu, [(case, facts)])
    return named_outputs(flight)


def named_outputs(flight: np.ndarray | str) -> dict[str, np.ndarray]:
    """Return the outputs of a flight by name; a failed flight raises SimulationError."""
    columns = demand_flight(flight, "the FMU")
    return {name: columns[:, i] for i, name in enumerate(OUTPUTS)}


def _fly_job(fmu: str, job: Job) -> np.ndarray:
    """Simulate a job in this process, and return the outputs (time, output)."""
    import fmpy

    time = job["time"]
    fields = [("time", float)] + [(str(name), float) for name in job["names"]]
    signals = np.zeros(time.size, fields)
    signals["time"] = time
    for name, column in zip(job["names"], job["signals"].T, strict=True):
        signals[str(name)] = column
    # FMPy prints a warning for every input without a signal.
    with contextlib.redirect_stdout(sys.stderr):
        response = fmpy.simulate_fmu(
            fmu,
            stop_time=float(time[-1]),
            output_interval=1.0 / RATE,
            start_values=dict(zip(job["parameter_names"].tolist(), job["parameters"].tolist())),
            input=signals,
            output=list(OUTPUTS),
        )
    return np.column_stack([np.asarray(response[name], float) for name in OUTPUTS])


if __name__ == "__main__":
    answer_jobs(lambda job: _fly_job(sys.argv[1], job))

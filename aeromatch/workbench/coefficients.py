"""Coefficients along reconstructed records, stored in the working folder.

They are formed once per record, so that any number of records can be fitted together.  Those of a
record of five minutes are 100 MB with their changes by all sources of error, so that only windows
are read from the file.

A server forms the coefficients of long or many records in a child process that can be cancelled.
The process runs this module.
"""

from __future__ import annotations

import json
import os
import sys
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import xarray as xr

import flighttest
from aeromatch.workbench.allowed_actions import ActionError
from aeromatch.workbench.fit_request import FitRequest, order_fit_windows, records_of_request
from aeromatch.workbench.opened import OpenProject
from aeromatch.workbench.processes import WorkbenchJob
from flightmech.aircraft.aircraft_file import aircraft_files, read_aircraft
from flightmech.errors import AeromatchError
from flightmech.support.array_files.netcdf_writing import write_netcdf
from flightmech.support.atomic_write import written_atomically
from flightmech.support.input_files import file_sha256
from flightmech.support.kept_stages.content_hashes import content_hash
from flightmech.support.kept_stages.program import hash_installation
from flightmech.support.temporary_names import remove_leftovers

FOLDER = "coefficients"
MOST_BYTES = 4_000_000_000
"""Greatest size of the folder; the files that were used last stay."""
MOST_HERE = 30_000
"""Greatest number of samples whose coefficients the server forms without a child process."""
# Windows in memory: one of 13 s is 4 MB.
_MOST_WINDOWS = 96
_forming = threading.Lock()


def form_missing(opened: OpenProject, records: Iterable[str], cutoff: float | None) -> None:
    """Form missing coefficients of long or many records in one child process.

    `window_of` forms the coefficients of few samples.

    Parameters
    ----------
    opened : OpenProject
        Without a server, this function does nothing.
    records : iterable of str
    cutoff : float or None
        Low-pass of the states. [Hz]

    Raises
    ------
    FileNotFoundError
        A record has not been reconstructed.
    ActionError
        The work was cancelled, or its process has failed.
    """
    run = opened.run
    if run is None:
        return
    # The page may repeat its request while the process runs.
    with _forming:
        missing = []
        for record in records:
            if not _coefficient_file(opened, record, cutoff).exists():
                missing.append(record)
        samples = sum(opened.path(record).states.sizes["time"] for record in missing)
        if samples <= MOST_HERE:
            return
        _form_in_process(opened, run, missing, cutoff)


def _form_in_process(
    opened: OpenProject,
    run: Callable[[str, str, Sequence[str]], WorkbenchJob],
    records: Sequence[str],
    cutoff: float | None,
) -> None:
    """Form the coefficients of records in a child process that ``run`` starts."""
    targets = [_coefficient_file(opened, record, cutoff) for record in records]
    errors = dict(opened.project.errors)
    calls = []
    for record, target in zip(records, targets, strict=True):
        file, aircraft = str(opened.path_file(record)), str(opened.project.aircraft)
        calls.append([file, aircraft, errors, cutoff, str(target)])
    subject = records[0] if len(records) == 1 else f"{len(records)} records"
    title = f"coefficients along {subject}"
    job = run(title, __spec__.name, [json.dumps(calls)])
    if job.state != "done":
        # A process that was ended may leave a part of a file.
        for target in targets:
            remove_leftovers(opened.work / FOLDER, f".{target.name}")
        raise ActionError(f"{title}: {job.about()['error'] or job.state}; fit again to form them")
    _remove_oldest(targets[-1])


def form_windows(opened: OpenProject, request: FitRequest) -> list[xr.Dataset]:
    """Return the coefficients in the windows of a request."""
    form_missing(opened, dict.fromkeys(records_of_request(request)), request.cutoff)
    parts = []
    for window in order_fit_windows(request):
        part = window_of(
            opened, window.record, start=window.start, end=window.end, cutoff=request.cutoff
        )
        parts.append(part)
    return parts


def window_of(
    opened: OpenProject, record: str, start: float, end: float, cutoff: float | None
) -> xr.Dataset:
    """Return the coefficients of a record between two instants.

    They are those of `flighttest.coefficients` along the whole record.

    Parameters
    ----------
    opened : OpenProject
    record : str
    start, end : float
        Instants on the clock of the record. [s]
    cutoff : float or None
        Low-pass of the states. [Hz]

    Raises
    ------
    FileNotFoundError
        The record has not been reconstructed.
    OutOfRange
        The window is not inside the record.
    """
    file = _reconstructed_file(opened, record)
    sources = [file, *opened.aircraft_files]
    key = (record, cutoff, tuple(opened.project.errors.items()))

    def read_window() -> xr.Dataset:
        stored = opened.kept(
            ("coefficients", *key), sources, lambda: _stored_coefficients(opened, record, cutoff)
        )
        # The file may have been removed while the server ran.
        if not stored.exists():
            stored = _stored_coefficients(opened, record, cutoff)
        # The time of the file is that of its last use.
        os.utime(stored)
        with xr.open_dataset(
            stored, engine="h5netcdf", phony_dims="access", decode_timedelta=False
        ) as coefficients:
            return flighttest.select_time(coefficients, start, end).load()

    return opened.kept(("window", *key, start, end), sources, read_window, _MOST_WINDOWS)


def _reconstructed_file(opened: OpenProject, record: str) -> Path:
    """Return the file of a reconstructed record, and raise if it does not exist."""
    file = opened.path_file(record)
    if not file.exists():
        raise FileNotFoundError(2, "not reconstructed yet", str(file))
    return file


def _stored_coefficients(opened: OpenProject, record: str, cutoff: float | None) -> Path:
    """Return the file with the coefficients of a record, and write it if it does not exist."""
    target = _coefficient_file(opened, record, cutoff)
    if not target.exists():
        file, project = opened.path_file(record), opened.project
        write_coefficients(
            file, project.aircraft, errors=project.errors, cutoff=cutoff, target=target
        )
        _remove_oldest(target)
    return target


def _coefficient_file(opened: OpenProject, record: str, cutoff: float | None) -> Path:
    """Return the path of the coefficients of a record; the file need not exist."""
    file = _reconstructed_file(opened, record)
    aircraft, errors = opened.project.aircraft, opened.project.errors
    digest = opened.kept(
        ("key", record, cutoff, tuple(errors.items())),
        [file, *opened.aircraft_files],
        lambda: _hash_inputs(file, aircraft, errors, cutoff),
        _MOST_WINDOWS,
    )
    return opened.work / FOLDER / f"{record}_{digest}.nc"


def write_coefficients(
    file: Path, aircraft: Path, errors: Mapping[str, float], cutoff: float | None, target: Path
) -> None:
    """Write the coefficients along a reconstructed record, completely or not at all.

    Parameters
    ----------
    file : Path
        Reconstructed record.
    aircraft : Path
        Aircraft file.
    errors : mapping of str to float
        Standard errors of the sources of error. [SI]
    cutoff : float or None
        Low-pass of the states. [Hz]
    target : Path
        File that is written.
    """
    path = flighttest.dynamics.open_path(file)
    coefficients = flighttest.coefficients(path, read_aircraft(aircraft), dict(errors), cutoff)
    target.parent.mkdir(parents=True, exist_ok=True)
    with written_atomically(target) as part:
        write_netcdf(coefficients, part)


def _hash_inputs(
    file: Path, aircraft: Path, errors: Mapping[str, float], cutoff: float | None
) -> str:
    """Return a digest of all that determines coefficients: program, files, errors, low-pass."""
    hashes = [file_sha256(source) for source in (file, *aircraft_files(aircraft))]
    return content_hash(hash_installation(), hashes, sorted(errors.items()), cutoff)[:16]


def _remove_oldest(newest: Path) -> None:
    """Remove the files that were used longest ago, until the folder has at most `MOST_BYTES`."""

    def last_use(file: Path) -> tuple[bool, int]:
        # The new file comes first, whatever the resolution of the clock.
        return file == newest, file.stat().st_mtime_ns

    total = 0
    for file in sorted(newest.parent.glob("*.nc"), key=last_use, reverse=True):
        total += file.stat().st_size
        if total > MOST_BYTES and file != newest:
            file.unlink(missing_ok=True)


def _main(calls: str) -> int:
    """Form the coefficients of the calls of `form_missing`, as a process."""
    items = json.loads(calls)
    try:
        for number, (file, aircraft, errors, cutoff, target) in enumerate(items, start=1):
            # The server shows the last line as the progress of the job.
            print(f"{Path(file).stem}, {number} of {len(items)}", file=sys.stderr, flush=True)
            write_coefficients(
                Path(file), Path(aircraft), errors=errors, cutoff=cutoff, target=Path(target)
            )
    except (AeromatchError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(_main(sys.argv[1]))

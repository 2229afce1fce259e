"""Coefficients along reconstructed records, formed once and kept in the working folder: any number
of records can be fitted together.

Those of a record of five minutes are 100 MB with the changes by all sources of error; windows of it
are read from the file. Those of long or many records a server forms in a child process, which runs
this module and can be cancelled.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import threading
from collections.abc import Iterable, Mapping
from pathlib import Path

import xarray as xr

import flighttest
from aeromatch.workbench.actions import ActionError
from aeromatch.workbench.opened import OpenProject
from flightmech.aircraft.aircraft import read_aircraft
from flightmech.errors import AeromatchError
from flightmech.support.atomic_write import remove_leftovers, written_atomically
from pom.replaying.caches import reconstruction_digest

FOLDER = "coefficients"
MOST_BYTES = 4_000_000_000
"""Of the folder: what was used last stays."""
MOST_HERE = 30_000
"""Samples whose coefficients the server itself forms, 1.7 s: to start a process for them takes as long."""
_KEPT_WINDOWS = 96  # in memory: one of 13 s is 4 MB
_forming = threading.Lock()


def form_missing(opened: OpenProject, records: Iterable[str], cutoff: float | None) -> None:
    """Form the coefficients that are not there along long or many records in one child process;
    `window_of` forms those of few samples.

    Parameters
    ----------
    opened : Opened
        Without a server nothing is done here.
    records : iterable of str
    cutoff : float or None
        Low-pass of the states. [Hz]

    Raises
    ------
    FileNotFoundError
        A record has not been reconstructed.
    ActionError
        The work was cancelled, or the process that did it has failed.
    """
    if opened.run is None:
        return
    aircraft, errors = opened.project.aircraft, opened.project.errors
    with _forming:  # the page asks again when something is changed meanwhile
        missing = [record for record in records if not _target(opened, record, cutoff).exists()]
        if sum(opened.path(record).states.sizes["time"] for record in missing) <= MOST_HERE:
            return
        about = [
            [
                str(opened.path_file(record)),
                str(aircraft),
                dict(errors),
                cutoff,
                str(_target(opened, record, cutoff)),
            ]
            for record in missing
        ]
        title = (
            f"coefficients along {missing[0] if len(missing) == 1 else f'{len(missing)} records'}"
        )
        job = opened.run(title, __spec__.name, [json.dumps(about)])
        if job.state != "done":
            for record in missing:  # what the process had begun to write
                remove_leftovers(opened.work / FOLDER, f".{_target(opened, record, cutoff).name}")
            raise ActionError(
                f"{title}: {job.about()['error'] or job.state}; fit again to form them"
            )
        _trim(_target(opened, missing[-1], cutoff))


def window_of(
    opened: OpenProject, record: str, start: float, end: float, cutoff: float | None
) -> xr.Dataset:
    """Return the coefficients of a record between two instants, as `flighttest.coefficients` forms
    them along the whole record.

    Parameters
    ----------
    opened : Opened
    record : str
    start, end : float
        On the clock of the record. [s]
    cutoff : float or None
        Low-pass of the states. [Hz]

    Raises
    ------
    FileNotFoundError
        It has not been reconstructed.
    OutOfRange
        The window is not inside the record.
    """
    file = opened.path_file(record)
    if not file.exists():
        raise FileNotFoundError(2, "not reconstructed yet", str(file))
    made_from = [file, opened.project.aircraft]
    about = (record, cutoff, tuple(opened.project.errors.items()))

    def make() -> xr.Dataset:
        kept = opened.kept(
            ("coefficients", *about), made_from, lambda: _formed(opened, record, cutoff)
        )
        if not kept.exists():  # taken away while the server ran
            kept = _formed(opened, record, cutoff)
        os.utime(kept)
        with xr.open_dataset(kept, engine="h5netcdf", decode_timedelta=False) as whole:
            return flighttest.select_time(whole, start, end).load()

    return opened.kept(("window", *about, start, end), made_from, make, _KEPT_WINDOWS)


def _formed(opened: OpenProject, record: str, cutoff: float | None) -> Path:
    """Return the file with the coefficients of a record, which is written unless it is there."""
    file, aircraft, errors, target = (
        opened.path_file(record),
        opened.project.aircraft,
        opened.project.errors,
        _target(opened, record, cutoff),
    )
    if not target.exists():
        write_coefficients(file, aircraft, errors, cutoff, target)
        _trim(target)
    return target


def _target(opened: OpenProject, record: str, cutoff: float | None) -> Path:
    file = opened.path_file(record)
    if not file.exists():
        raise FileNotFoundError(2, "not reconstructed yet", str(file))
    aircraft, errors = opened.project.aircraft, opened.project.errors
    key = opened.kept(
        ("key", record, cutoff, tuple(errors.items())),
        [file, aircraft],
        lambda: _key(file, aircraft, errors, cutoff),
        _KEPT_WINDOWS,
    )
    return opened.work / FOLDER / f"{record}_{key}.nc"


def write_coefficients(
    file: Path, aircraft: Path, errors: Mapping[str, float], cutoff: float | None, target: Path
) -> None:
    """Write the coefficients along a reconstructed record.

    Parameters
    ----------
    file : Path
        Reconstructed record.
    aircraft : Path
    errors : dict of str to float
        Standard errors of the sources of error. [SI]
    cutoff : float or None
        Low-pass of the states. [Hz]
    target : Path
        Gets the file, atomically: completely or not at all.
    """
    found = flighttest.coefficients(
        flighttest.dynamics.open_path(file), read_aircraft(aircraft), dict(errors), cutoff
    )
    target.parent.mkdir(parents=True, exist_ok=True)
    with written_atomically(target) as part:
        found.to_netcdf(part, engine="h5netcdf")


def _key(file: Path, aircraft: Path, errors: Mapping[str, float], cutoff: float | None) -> str:
    """Return a name for what the coefficients were formed from: the program, files, standard
    errors, low-pass.
    """
    hashes = [hashlib.sha256(one.read_bytes()).hexdigest() for one in (file, aircraft)]
    return hashlib.sha256(
        repr((reconstruction_digest(), hashes, sorted(errors.items()), cutoff)).encode()
    ).hexdigest()[:16]


def _trim(newest: Path) -> None:
    """Remove the files that were used longest ago until the folder is no larger than `MOST_BYTES`."""
    total = 0
    for file in sorted(
        newest.parent.glob("*.nc"),
        key=lambda one: (one == newest, one.stat().st_mtime_ns),
        reverse=True,
    ):
        total += file.stat().st_size
        if total > MOST_BYTES and file != newest:
            file.unlink(missing_ok=True)


def _main(about: str) -> int:
    """Form what `form_missing` describes, as a process."""
    items = json.loads(about)
    try:
        for number, (file, aircraft, errors, cutoff, target) in enumerate(items, start=1):
            print(f"{Path(file).stem}, {number} of {len(items)}", file=sys.stderr, flush=True)
            write_coefficients(Path(file), Path(aircraft), errors, cutoff, Path(target))
    except (AeromatchError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(_main(sys.argv[1]))

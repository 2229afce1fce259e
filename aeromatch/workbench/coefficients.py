"""Coefficients along reconstructed records, formed once and kept in the working folder: any number of records can be fitted together.

Those of a record of five minutes are 100 MB with the changes by all sources of error; windows of it are read from the file.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from pathlib import Path

import xarray as xr

import flighttest
from flightmech.support.atomic_write import written_atomically

from .opened import Opened

FOLDER = "coefficients"
MOST_BYTES = 4_000_000_000
"""Of the folder: what was used last stays."""
_KEPT_WINDOWS = 96  # in memory: one of 13 s is 4 MB


def window_of(opened: Opened, record: str, start: float, end: float, cutoff: float | None) -> xr.Dataset:
    """Return the coefficients of a record between two instants, as `flighttest.coefficients` forms them along the whole record.

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
        kept = opened.kept(("coefficients", *about), made_from, lambda: _formed(opened, record, cutoff))
        if not kept.exists():  # taken away while the server ran
            kept = _formed(opened, record, cutoff)
        os.utime(kept)
        with xr.open_dataset(kept, engine="h5netcdf", decode_timedelta=False) as whole:
            return flighttest.between(whole, start, end).load()

    return opened.kept(("window", *about, start, end), made_from, make, _KEPT_WINDOWS)


def _formed(opened: Opened, record: str, cutoff: float | None) -> Path:
    """Return the file with the coefficients of a record, which is written unless it is there."""
    file, aircraft, errors = opened.path_file(record), opened.project.aircraft, opened.project.errors
    target = opened.work / FOLDER / f"{record}_{_key(file, aircraft, errors, cutoff)}.nc"
    if not target.exists():
        found = flighttest.coefficients(flighttest.dynamics.open_path(file), opened.aircraft, dict(errors), cutoff)
        target.parent.mkdir(parents=True, exist_ok=True)
        with written_atomically(target) as part:
            found.to_netcdf(part, engine="h5netcdf")
        _trim(target)
    return target


def _key(file: Path, aircraft: Path, errors: Mapping[str, float], cutoff: float | None) -> str:
    """Return a name for what the coefficients were formed from: version, files, standard errors, low-pass."""
    from importlib.metadata import version

    hashes = [hashlib.sha256(one.read_bytes()).hexdigest() for one in (file, aircraft)]
    return hashlib.sha256(repr((version("aeromatch"), hashes, sorted(errors.items()), cutoff)).encode()).hexdigest()[:16]


def _trim(newest: Path) -> None:
    """Remove the files that were used longest ago until the folder is no larger than `MOST_BYTES`."""
    total = 0
    for file in sorted(newest.parent.glob("*.nc"), key=lambda one: (one == newest, one.stat().st_mtime_ns), reverse=True):
        total += file.stat().st_size
        if total > MOST_BYTES and file != newest:
            file.unlink(missing_ok=True)

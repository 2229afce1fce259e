"""Manoeuvres along reconstructed paths, as the verbs of `flighttest.cli.identify` read them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import xarray as xr

from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import SchemaError, UnknownName
from flightmech.support.console import count_text, show_progress
from flighttest.maximum_likelihood.validating.used_windows import ValidationWindow, digest_record
from flighttest.reconstruction.dynamics.force_coefficients import coefficients, select_time
from flighttest.reconstruction.dynamics.saved_paths import open_path
from flighttest.reconstruction.quality.manoeuvre_faults import report_faults
from flighttest.records.repeated_windows import repeated_windows

Window = tuple[float, float]


@dataclass(frozen=True)
class CutManoeuvres:
    """Coefficients along all windows of several paths.

    Attributes
    ----------
    coefficients : list of Dataset (time,)
        One for each window, path by path.
    path_numbers : list of int
        For each window, the index of its path.
    paths : tuple of str
        Files of the reconstructed paths.
    """

    coefficients: list[xr.Dataset]
    path_numbers: list[int]
    paths: tuple[str, ...]

    def as_validation_windows(self) -> list[ValidationWindow]:
        """Return the windows with the digests of their paths."""
        digests = [digest_record(path) for path in self.paths]
        windows = []
        for data, number in zip(self.coefficients, self.path_numbers, strict=True):
            windows.append(ValidationWindow(Path(self.paths[number]).stem, data, digests[number]))
        return windows


@dataclass(frozen=True)
class ManoeuvreOptions:
    """Options of the manoeuvres: reconstructed paths, and their windows.

    Attributes
    ----------
    paths : tuple of str
        Files of the reconstructed paths.
    aircraft_file : str
    windows : tuple of (float, float)
        Start and stop of the windows of every path [s]; without any window, the whole path.
    cutoff : float or None
        Cut-off frequency of the low-pass of the states [Hz].
    own_windows : tuple of (str, float, float)
        Name of one path, start and stop of a window of this path alone [s].
    errors : tuple of (str, float)
        Source and standard error, in place of the default (`coefficients`).
    """

    paths: tuple[str, ...]
    aircraft_file: str
    windows: tuple[Window, ...]
    cutoff: float | None
    own_windows: tuple[tuple[str, float, float], ...] = ()
    errors: tuple[tuple[str, float], ...] = ()

    def read(self) -> CutManoeuvres:
        """Return the coefficients along all windows, and warn of faults of the manoeuvres.

        Raises
        ------
        UnknownName, SchemaError
            As `assign_windows`, and as the readers of paths and aircraft.
        """
        windows_by_path = assign_windows(self.paths, self.windows, self.own_windows)
        aircraft = read_aircraft(self.aircraft_file)
        manoeuvres, labels, path_numbers = [], [], []
        with show_progress(f"coefficients along {count_text(len(self.paths), 'path')}"):
            for number, path in enumerate(self.paths):
                data = coefficients(open_path(path), aircraft, dict(self.errors), self.cutoff)
                # A path without windows is one manoeuvre.
                parts = [select_time(data, *window) for window in windows_by_path[number]] or [data]
                manoeuvres += parts
                labels += [Path(path).name] * len(parts)
                path_numbers += [number] * len(parts)
        # The regression itself checks the excitation of the regressors.
        report_faults(manoeuvres, labels, known=("excitation",))
        return CutManoeuvres(manoeuvres, path_numbers, self.paths)


def assign_windows(
    paths: tuple[str, ...],
    windows: tuple[Window, ...] = (),
    own_windows: tuple[tuple[str, float, float], ...] = (),
) -> list[list[Window]]:
    """Return the windows of each path: the common ones, then its own.

    The list of a path is empty if the whole path is used.

    Raises
    ------
    UnknownName
        A window belongs to a path that is not given, or that is given twice.
    SchemaError
        Some paths have a window of their own, and another path has no window; a part of a path is
        taken twice.
    """
    names = [Path(path).stem for path in paths]
    own: dict[str, list[Window]] = {}
    for name, start, stop in own_windows:
        if names.count(name) != 1:
            raise UnknownName(
                name,
                names,
                "path",
                "--window-of names one of the paths by its file without extension",
            )
        own.setdefault(name, []).append((start, stop))
    if own and not windows:
        problems = [
            f"{name}: no window; give --window-of {name}, or leave the path out"
            for name in names
            if name not in own
        ]
        if problems:
            raise SchemaError("windows", problems)
    windows_by_path = [[*windows, *own.get(name, ())] for name in names]
    problems = []
    for name, spans in zip(names, windows_by_path, strict=True):
        problems += [f"{name}: {text}" for text in repeated_windows(spans)]
    if problems:
        raise SchemaError("windows", problems)
    return windows_by_path

"""Manoeuvres, instruments and noise that the verbs of `flighttest.cli.identify` read."""

from __future__ import annotations

from pathlib import Path

from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import SchemaError, UnknownName
from flightmech.names import lookup
from flightmech.support.console import show_progress
from flightmech.units import parse_quantity
from flighttest.reconstruction.dynamics.force_coefficients import coefficients, select_time
from flighttest.reconstruction.dynamics.reduced_rates import reduced_rates
from flighttest.reconstruction.dynamics.saved_paths import open_path, open_states
from flighttest.reconstruction.quality.manoeuvre_faults import report_faults


def demand_options(
    method, band, weights, ridge, prior, noises, instrument_files, constraints
) -> None:
    """Raise for options of ``identify`` that do not go together."""
    problems = []
    if method != "least-squares" and (band is not None or weights != "equal" or ridge != "0"):
        problems.append(
            f"--method {method} works in time with equal weights; leave out --band, --weights and "
            f"--ridge"
        )
    if (noises and method != "tls") or (method == "tls" and not noises):
        problems.append(
            "--noise and --method tls go together: state the noise of each noisy variable, as "
            "--noise alpha '0.3 deg'"
        )
    if instrument_files and method != "iv":
        problems.append("--instruments goes with --method iv")
    if constraints and prior:
        problems.append("--constraint works without a prior; leave out --prior")
    if problems:
        raise SchemaError("flight identify", problems)


def read_noise(noises) -> dict[str, float]:
    """Standard deviations in SI by variable."""
    found = {}
    for name, text in noises:
        try:
            value: float | str = float(text)
        except ValueError:
            value = text
        found[name] = parse_quantity(value, lookup(name).units)
    return found


def read_instruments(files, aircraft_file, sources) -> list | None:
    """States of the instruments with reduced rates, one for each manoeuvre; None without files."""
    if not files:
        return None
    aircraft = read_aircraft(aircraft_file)
    records = [reduced_rates(open_states(file), aircraft) for file in files]
    return [records[k] for k in sources]


def read_windows_of_paths(paths, aircraft_file, windows, cutoff, own_windows=(), errors=()) -> list:
    """Coefficients along all windows of all paths."""
    return read_sourced_manoeuvres(
        paths, aircraft_file, windows, cutoff=cutoff, own_windows=own_windows, errors=errors
    )[0]


def windows_of_paths(paths, windows=(), own_windows=()) -> list[list[tuple[float, float]]]:
    """Return the windows of each path, the common ones and its own; none for all of it.

    Raises
    ------
    UnknownName, SchemaError
        A window of another path, or a path without a window where others have one.
    """
    names = [Path(path).stem for path in paths]
    own: dict[str, list[tuple[float, float]]] = {}
    for name, start, stop in own_windows:
        if names.count(name) != 1:
            raise UnknownName(
                name,
                names,
                "path",
                "--window-of names one of the paths by its file without extension",
            )
        own.setdefault(name, []).append((start, stop))
    if own and not windows and (without := [name for name in names if name not in own]):
        raise SchemaError(
            "windows",
            [
                f"{name}: no window; give --window-of {name}, or leave the path out"
                for name in without
            ],
        )
    return [[*windows, *own.get(name, ())] for name in names]


def read_sourced_manoeuvres(
    paths, aircraft_file, windows, cutoff, own_windows=(), errors=()
) -> tuple[list, list[int]]:
    """Coefficients along all windows of all paths, path by path, and the number of the path of
    each; a path takes `windows` and its own.
    """

    by_path = windows_of_paths(paths, windows, own_windows)
    aircraft = read_aircraft(aircraft_file)
    found, labels, sources = [], [], []
    with show_progress(f"coefficients along {len(paths)} path{'s' if len(paths) > 1 else ''}"):
        for number, (path, spans) in enumerate(zip(paths, by_path, strict=True)):
            data = coefficients(open_path(path), aircraft, dict(errors), cutoff)
            parts = [select_time(data, *window) for window in spans] or [data]
            found += parts
            labels += [Path(path).name] * len(parts)
            sources += [number] * len(parts)
    report_faults(found, labels, known=("excitation",))
    return found, sources

"""Test inputs as files: CSV for people and tools, and the time table that a companion computer
plays.

The time table is text that a few lines of any language read: head lines ``# key: value``, then one line per step with one whole
number per channel::

    # aeromatch playback: 1
    # title: three axes, glide
    # step_ms: 20
    # rows: 1601
    # channels: delta_a delta_e delta_r
    # units: rad rad rad
    # scale: 6.9813e-06 6.9813e-06 6.9813e-06
    # crc32: 5f0c1d2e
    0 0 0
    ...

Row n holds from n step_ms to (n + 1) step_ms after the activation switch, and commands, on channel
j,

    trim_j + gain scale_j count_j

with the trim at the moment of activation and the gain of the amplitude knob, 0 to 1.  Counts lie
within +-10000.  After the last row, and when the switch opens, the command is the trim.  The
checksum is the CRC-32 (IEEE 802.3, as in zlib) of all lines behind the head, each with its line
feed: a table that was cut short in transfer must not fly.
"""

from __future__ import annotations

import os
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import ParseError, SchemaError
from flightmech.names import lookup, quantity_attributes
from flightmech.simulation.compiler import SimModel
from flightmech.support.atomic_write import write_text
from flightmech.support.input_files import read_text
from flighttest.flight_programme.input_design.input_accuracy import (
    Expected,
    cramer_rao,
    expected_errors,
)
from flighttest.flight_programme.input_design.input_signals import axes_of, measures
from flighttest.flight_programme.input_design.predicted_response import (
    Amplitude,
    amplitude_within,
    each_within,
    scale_signal,
    trimmed_start,
)
from flighttest.flight_programme.input_design.specification import Design
from flighttest.regression.equation_error.model import RegressionModel

FORMAT = "aeromatch playback"
VERSION = "1"
FULL = 10000
_KEYS = ("title", "step_ms", "rows", "channels", "units", "scale", "crc32")


def save_csv(signal: xr.Dataset, path: str | os.PathLike) -> None:
    """Write a test input as CSV: ``time [s]``, then one column per axis with its unit; atomically.

    Parameters
    ----------
    signal : Dataset (time,)
    path : path
        An older file is replaced.
    """
    names = axes_of(signal)
    head = ",".join(["time [s]", *(f"{name} [{lookup(name).units}]" for name in names)])
    columns = np.column_stack([signal["time"].values, *(signal[name].values for name in names)])
    lines = [head, *(",".join(f"{x:.10g}" for x in row) for row in columns)]
    _write(path, "\n".join(lines) + "\n")


def save_timetable(signal: xr.Dataset, path: str | os.PathLike, title: str = "") -> None:
    """Write the time table of a test input; atomically.

    Parameters
    ----------
    signal : Dataset (time,)
    path : path
        An older file is replaced.
    title : str
        One line of text.

    Raises
    ------
    SchemaError
        A step that is not a whole number of milliseconds, an axis that does not move, a title of
        several lines.
    """
    names, step = axes_of(signal), 1000.0 / float(signal.attrs["rate"])
    peaks = [float(np.abs(signal[name].values).max()) for name in names]
    problems = [
        f"{name} does not move; leave it out" for name, peak in zip(names, peaks) if peak == 0.0
    ]
    if abs(step - round(step)) > 1e-9:
        problems.append(
            f"steps of {step:g} ms; a rate of 1000 over a whole number is needed, such as 50 Hz"
        )
    if "\n" in title or "\r" in title:
        problems.append("the title has several lines; give one")
    if problems:
        raise SchemaError("time table", problems)
    scale = [peak / FULL for peak in peaks]
    counts = np.rint(
        np.column_stack([signal[name].values / s for name, s in zip(names, scale)])
    ).astype(int)
    body = "".join(" ".join(map(str, row)) + "\n" for row in counts.tolist())
    about = {
        FORMAT: VERSION,
        "title": title,
        "step_ms": str(round(step)),
        "rows": str(len(counts)),
        "channels": " ".join(names),
        "units": " ".join(lookup(name).units for name in names),
        "scale": " ".join(repr(s) for s in scale),
        "crc32": f"{zlib.crc32(body.encode()):08x}",
    }
    _write(path, "".join(f"# {key}: {value}\n" for key, value in about.items()) + body)


def open_timetable(path: str | os.PathLike) -> xr.Dataset:
    """Read a time table: what a companion computer will command, at a gain of one and from a trim
    of zero.

    Returns
    -------
    Dataset (time,)
        One variable per channel [SI]; attributes ``title rate``.

    Raises
    ------
    ParseError
        Not such a file, a head line that is missing, a row with other than one whole number per
        channel, a wrong checksum.
    """
    text = read_text(path, f"a time table, '# {FORMAT}: {VERSION}'")
    lines = text.splitlines()
    count = next((i for i, line in enumerate(lines) if not line.startswith("#")), len(lines))
    head = dict(line.removeprefix("# ").split(": ", 1) for line in lines[:count] if ": " in line)
    if head.get(FORMAT) != VERSION:
        raise ParseError(
            str(path), 1, repr(lines[0][:60] if lines else ""), f"'# {FORMAT}: {VERSION}'"
        )
    missing = [key for key in _KEYS if key not in head and key != "title"]
    if missing:
        raise ParseError(
            str(path),
            count,
            f"a head without {', '.join(missing)}",
            f"head lines {', '.join(_KEYS)}",
        )
    names, scale = (
        head["channels"].split(),
        np.array([_number(path, head, word) for word in head["scale"].split()]),
    )
    if len(scale) != len(names):
        raise ParseError(
            str(path), 0, f"{len(scale)} scales for {len(names)} channels", "one per channel"
        )
    rows = [
        _row(path, number, line, len(names)) for number, line in enumerate(lines[count:], count + 1)
    ]
    body = "".join(line + "\n" for line in lines[count:])
    found = f"{zlib.crc32(body.encode()):08x}"
    if len(rows) != _number(path, head, head["rows"]) or found != head["crc32"]:
        expected = f"{head['rows']} rows with checksum {head['crc32']}; send the file again"
        raise ParseError(str(path), 0, f"{len(rows)} rows with checksum {found}", expected)
    step = _number(path, head, head["step_ms"]) / 1000.0
    columns = np.array(rows, float).reshape(len(rows), len(names)) * scale
    return xr.Dataset(
        {
            name: ("time", column, quantity_attributes(name))
            for name, column in zip(names, columns.T)
        },
        {"time": ("time", step * np.arange(len(rows)), quantity_attributes("time"))},
        {"title": head.get("title", ""), "rate": 1.0 / step},
    )


def _row(path: str | os.PathLike, number: int, line: str, channels: int) -> list[int]:
    words = line.split()
    try:
        counts = [int(word) for word in words]
    except ValueError:
        counts = []
    if len(counts) != channels or any(abs(n) > FULL for n in counts):
        raise ParseError(
            str(path), number, repr(line[:60]), f"{channels} whole numbers within +-{FULL}"
        )
    return counts


def _number(path: str | os.PathLike, head: dict[str, str], word: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = -1.0
    if not (value > 0.0 and np.isfinite(value)):
        raise ParseError(
            str(path), 0, f"{word!r} in the head", "positive numbers for step_ms, rows and scale"
        )
    return value


def _write(path: str | os.PathLike, text: str) -> None:
    write_text(path, text)


_KEPT = (
    "V",
    "alpha",
    "beta",
    "p",
    "q",
    "r",
    "phi",
    "theta",
    "psi",
    "nz",
    "ay",
    "h",
)  # of the response, for the CSV


@dataclass(frozen=True)
class Designed:
    """A test input that is ready to be flown.

    Attributes
    ----------
    title : str
    signal : Dataset (time,)
        Deflections from trim, scaled to the limits. [SI]
    measures : DataFrame
        Of `input_signals.measures`; with a condition also ``factor``, by which an axis is smaller
        than requested.
    amplitude : Amplitude or None
        What the limits allowed of all axes together, after each had been fitted alone; None without
        a condition.
    expected : tuple of Expected
        One per model, and one for output error.
    """

    title: str
    signal: xr.Dataset
    measures: Any
    amplitude: Amplitude | None
    expected: tuple[Expected, ...]

    def summary(self) -> dict[str, Any]:
        """Return all numbers as plain tables."""
        found: dict[str, Any] = {"title": self.title, **self.signal.attrs, "axes": self.measures}
        if self.amplitude is not None:
            found |= {
                "scale": self.amplitude.scale,
                "binding": self.amplitude.binding,
                "response": self.amplitude.extremes,
            }
        columns = ("estimate", "stderr", "stderr_white", "vif")
        found["expected"] = {
            one.name: {
                str(t): {key: float(one.estimates[key].sel(term=t)) for key in columns}
                for t in one.estimates["term"].values
            }
            for one in self.expected
        }
        return found


def design_input(
    design: Design, sim: SimModel | None = None, aircraft: Aircraft | None = None
) -> Designed:
    """Return the test input of a description, as large as its limits allow.

    Parameters
    ----------
    design : Design
        As from `read_design`.
    sim : SimModel, optional
        The a-priori model; needed when the design has a condition.
    aircraft : Aircraft, optional
        For the limits of its surfaces, which hold in addition to those of the design, and for the
        noise of its instruments.

    Raises
    ------
    SchemaError
        A condition without a model, an accuracy without a condition; every fault of the
        description.
    OutOfRange, IdentificationError
        As in `amplitude_within`, `expected_errors` and `cramer_rao`.
    """
    signal = design.signal()
    if design.condition is None:
        if design.accuracy is not None:
            raise SchemaError(
                "design",
                [
                    "accuracy: expected standard errors need a condition, in which a model "
                    "predicts the motion"
                ],
            )
        return Designed(design.title, signal, measures(signal), None, ())
    if sim is None or aircraft is None:
        raise SchemaError(
            "design",
            [
                "condition: needs the a-priori model and the aircraft; give them or leave "
                "the condition out"
            ],
        )
    start = trimmed_start(
        sim, {}, design.condition.kind, design.condition.fixed, design.condition.unknowns
    )
    limits = {**surface_limits(sim, aircraft, signal), **design.condition.limits}
    margin = design.condition.margin
    factors = each_within(sim, signal, start, limits, margin)
    signal = scale_signal(signal, factors)
    amplitude = amplitude_within(sim, signal, start, limits, margin=margin)
    factors = {name: factor * amplitude.scale for name, factor in factors.items()}
    signal = scale_signal(signal, dict.fromkeys(factors, amplitude.scale))
    expected = _expected(design, sim, aircraft, signal, start, amplitude)
    return Designed(
        design.title,
        signal,
        measures(signal).assign(factor=list(factors.values())),
        amplitude,
        expected,
    )


def surface_limits(
    sim: SimModel, aircraft: Aircraft, signal: xr.Dataset
) -> dict[str, tuple[float, float]]:
    """Return the limits of the surfaces that a test input moves, as limits on the outputs of the
    model. [SI]
    """
    moved = {
        f"applied.{name}": limit
        for name, limit in aircraft.limits.items()
        if name in axes_of(signal)
    }
    return {
        name: (float(low), float(high))
        for name, (low, high) in moved.items()
        if name in sim.outputs
    }


def save_design(made: Designed, folder: str | os.PathLike, name: str) -> list[Path]:
    """Write the input as CSV and as a time table, and the predicted response as CSV.

    Parameters
    ----------
    made : Designed
    folder : path
        Made when it is not there.
    name : str
        The files are called ``<name>.csv``, ``<name>.table`` and ``<name>_response.csv``.

    Returns
    -------
    list of Path
        What was written.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"{name}.csv", folder / f"{name}.table"]
    save_csv(made.signal, files[0])
    save_timetable(made.signal, files[1], made.title)
    if made.amplitude is not None:
        files.append(folder / f"{name}_response.csv")
        response = made.amplitude.response
        save_csv(response[[output for output in _KEPT if output in response]], files[2])
    return files


def _expected(
    design: Design, sim, aircraft, signal, start, amplitude: Amplitude
) -> tuple[Expected, ...]:
    wanted = design.accuracy
    if wanted is None:
        return ()
    noise = dict(wanted.noise) or None
    found = [
        expected_errors(
            RegressionModel.parse(text), amplitude.response, aircraft, noise, wanted.memory
        )
        for text in wanted.models
    ]
    if wanted.parameters:
        found.append(
            cramer_rao(
                sim,
                signal,
                start,
                wanted.parameters,
                wanted.outputs,
                wanted.nuisance,
                memory=wanted.memory,
            )
        )
    return tuple(found)

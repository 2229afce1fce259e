"""Test inputs as files: CSV for people and tools, time table for a companion computer.

The time table is text that a few lines of any language read. It has head lines ``# key: value``,
then one line per step with one whole number per channel::

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

Row n applies from n step_ms to (n + 1) step_ms after the activation switch.  It commands, on
channel j,

    trim_j + gain scale_j count_j

with the trim at the moment of activation and the gain of the amplitude knob, 0 to 1.  Counts lie
within +-10000.  After the last row, and when the switch opens, the command is the trim.  The
checksum is the CRC-32 (IEEE 802.3, as in zlib) of all lines after the head, each with its line
feed.  It prevents the use of a table that was truncated in transfer.
"""

from __future__ import annotations

import os
import zlib

import numpy as np
import xarray as xr

from flightmech.errors import ParseError, SchemaError
from flightmech.names import lookup, quantity_attributes
from flightmech.support.atomic_write import write_text
from flightmech.support.input_files import read_text
from flighttest.flight_programme.input_design.input_signals import axes_of

FORMAT = "aeromatch playback"
VERSION = "1"
# Largest count; the peak of each channel has this count.
FULL = 10000
_KEYS = ("title", "step_ms", "rows", "channels", "units", "scale", "crc32")


def save_csv(signal: xr.Dataset, path: str | os.PathLike) -> None:
    """Write a test input as CSV, atomically.

    The columns are ``time [s]`` and one per axis with its unit.

    Parameters
    ----------
    signal : Dataset (time,)
    path : path
        An older file is replaced.
    """
    names = axes_of(signal)
    head = ",".join(["time [s]", *(f"{name} [{lookup(name).units}]" for name in names)])
    columns = np.column_stack([signal["time"].values, *(signal[name].values for name in names)])
    lines = [head]
    for row in columns:
        lines.append(",".join(f"{x:.10g}" for x in row))
    write_text(path, "\n".join(lines) + "\n")


def save_timetable(signal: xr.Dataset, path: str | os.PathLike, title: str = "") -> None:
    """Write the time table of a test input, atomically.

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
        The step is not a whole number of milliseconds, an axis does not move, or the title has
        several lines.
    """
    names, step_ms = axes_of(signal), 1000.0 / float(signal.attrs["rate"])
    peaks = [float(np.abs(signal[name].values).max()) for name in names]
    _check_table(names, peaks, step_ms=step_ms, title=title)
    scale = [peak / FULL for peak in peaks]
    columns = [signal[name].values / unit for name, unit in zip(names, scale, strict=True)]
    counts = np.rint(np.column_stack(columns)).astype(int)
    lines = [" ".join(map(str, row)) + "\n" for row in counts.tolist()]
    body = "".join(lines)
    head = {
        FORMAT: VERSION,
        "title": title,
        "step_ms": str(round(step_ms)),
        "rows": str(len(counts)),
        "channels": " ".join(names),
        "units": " ".join(lookup(name).units for name in names),
        "scale": " ".join(repr(unit) for unit in scale),
        "crc32": f"{zlib.crc32(body.encode()):08x}",
    }
    write_text(path, "".join(f"# {key}: {value}\n" for key, value in head.items()) + body)


def _check_table(names: list[str], peaks: list[float], *, step_ms: float, title: str) -> None:
    """Raise SchemaError if a signal cannot be a time table."""
    problems = []
    for name, peak in zip(names, peaks, strict=True):
        if peak == 0.0:
            problems.append(f"{name} does not move; leave it out")
    if abs(step_ms - round(step_ms)) > 1e-9:
        problems.append(
            f"steps of {step_ms:g} ms are not whole; give a rate of 1000 over a whole number, "
            "such as 50 Hz"
        )
    if "\n" in title or "\r" in title:
        problems.append("the title has several lines; give one")
    if problems:
        raise SchemaError("time table", problems)


def open_timetable(path: str | os.PathLike) -> xr.Dataset:
    """Read a time table as the commands at a gain of one and from a trim of zero.

    Returns
    -------
    Dataset (time,)
        One variable per channel [SI]; attributes ``title rate``.

    Raises
    ------
    ParseError
        The file is not a time table, a head line is missing, a row does not have one whole number
        per channel, or the checksum is wrong.
    """
    lines = read_text(path, f"a time table, '# {FORMAT}: {VERSION}'").splitlines()
    count = 0
    while count < len(lines) and lines[count].startswith("#"):
        count += 1
    head = _read_head(path, lines, count=count)
    names = head["channels"].split()
    scale = np.array([_read_positive(path, word) for word in head["scale"].split()])
    if len(scale) != len(names):
        raise ParseError(
            str(path), 0, f"{len(scale)} scales for {len(names)} channels", "one per channel"
        )
    rows = []
    for number, line in enumerate(lines[count:], count + 1):
        rows.append(_read_row(path, line, number=number, channels=len(names)))
    # the checksum is that of the lines as they were written, with line feeds
    body = "".join(line + "\n" for line in lines[count:])
    checksum = f"{zlib.crc32(body.encode()):08x}"
    if len(rows) != _read_positive(path, head["rows"]) or checksum != head["crc32"]:
        expected = f"{head['rows']} rows with checksum {head['crc32']}; send the file again"
        raise ParseError(str(path), 0, f"{len(rows)} rows with checksum {checksum}", expected)
    step = _read_positive(path, head["step_ms"]) / 1000.0
    columns = np.array(rows, float).reshape(len(rows), len(names)) * scale
    channels = {}
    for name, column in zip(names, columns.T, strict=True):
        channels[name] = ("time", column, quantity_attributes(name))
    return xr.Dataset(
        channels,
        {"time": ("time", step * np.arange(len(rows)), quantity_attributes("time"))},
        {"title": head.get("title", ""), "rate": 1.0 / step},
    )


def _read_head(path: str | os.PathLike, lines: list[str], *, count: int) -> dict[str, str]:
    """Return the keys of the first `count` lines."""
    head = dict(line.removeprefix("# ").split(": ", 1) for line in lines[:count] if ": " in line)
    if head.get(FORMAT) != VERSION:
        first = lines[0][:60] if lines else ""
        raise ParseError(str(path), 1, repr(first), f"'# {FORMAT}: {VERSION}'")
    # an empty title is written without a value, so its line may have no separator
    missing = [key for key in _KEYS if key not in head and key != "title"]
    if missing:
        raise ParseError(
            str(path),
            count,
            f"a head without {', '.join(missing)}",
            f"head lines {', '.join(_KEYS)}",
        )
    return head


def _read_row(path: str | os.PathLike, line: str, *, number: int, channels: int) -> list[int]:
    try:
        counts = [int(word) for word in line.split()]
    except ValueError:
        counts = []
    if len(counts) != channels or any(abs(count) > FULL for count in counts):
        raise ParseError(
            str(path), number, repr(line[:60]), f"{channels} whole numbers within +-{FULL}"
        )
    return counts


def _read_positive(path: str | os.PathLike, word: str) -> float:
    """Return a positive number of the head."""
    try:
        value = float(word)
    except ValueError:
        value = -1.0
    if not (value > 0.0 and np.isfinite(value)):
        raise ParseError(
            str(path), 0, f"{word!r} in the head", "positive numbers for step_ms, rows and scale"
        )
    return value

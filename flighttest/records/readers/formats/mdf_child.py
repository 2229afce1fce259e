"""Child process that decodes MDF files.

The command is ``python -m flighttest.records.readers.formats.mdf_child FILE '["channel", ...]'``.
An empty list means all channels.

Standard output has one line of JSON with ``fault``, ``facts`` and ``groups``.  The arrays follow as
bytes, group by group: the stamps, then the channels that ``decoded`` lists with their NumPy type.
Every array of a group has `samples` numbers.
"""

from __future__ import annotations

import json
import logging
import sys
from typing import Any, BinaryIO

import numpy as np


def decode_mdf(path: str, requested: set[str]) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Return the head and the arrays that follow it."""
    from asammdf import MDF

    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    groups: list[dict[str, Any]] = []
    arrays: list[np.ndarray] = []
    left_out: list[tuple[str, str]] = []
    with MDF(path) as file:
        for index in range(len(file.groups)):
            group: Any = file.groups[index]
            master = file.masters_db.get(index)
            name = _unique_name(group, index, {group["name"] for group in groups})
            # A group needs a time master with two samples, and a channel.
            if master is None:
                left_out.append((name, f"{len(group.channels)} channels without a time master"))
                continue
            time = np.asarray(file.get_master(index), float)
            if len(time) < 2:
                plural = "" if len(time) == 1 else "s"
                reason = f"{len(time)} sample{plural}; a clock needs two samples"
                left_out.append((name, reason))
                continue
            if len(group.channels) < 2:
                left_out.append((name, "a time master without a channel"))
                continue
            description, group_arrays, omitted = _decode_group(
                file, index, master, samples=len(time), requested=requested
            )
            description["samples"] = len(time)
            description["name"] = name
            for channel, reason in omitted.items():
                left_out.append((f"{name}/{channel}", reason))
            groups.append(description)
            arrays += [time, *group_arrays]
        facts = {} if file.start_time is None else {"start": file.start_time.isoformat()}
    return {"fault": "", "facts": facts, "groups": groups, "left_out": left_out}, arrays


def _decode_group(
    file: Any, index: int, master: int, samples: int, requested: set[str]
) -> tuple[dict[str, Any], list[np.ndarray], dict[str, str]]:
    """Return the channels of a group, their arrays, and the omitted channels with the reason."""
    numbers, units, left_out = _list_channels(file.groups[index].channels, master)
    selected = [name for name in numbers if not requested or name in requested]
    signals = []
    if selected:
        signals = file.select([(None, index, numbers[name]) for name in selected])
    decoded: dict[str, str] = {}
    arrays = []
    for name, signal in zip(selected, signals, strict=True):
        values = np.asarray(signal.samples)
        if values.dtype.kind in "fiub" and values.shape == (samples,):
            # The file may flag single samples as invalid.
            is_invalid = getattr(signal, "invalidation_bits", None)
            if is_invalid is not None:
                values = np.where(np.asarray(is_invalid, bool), np.nan, values.astype(float))
            decoded[name] = values.dtype.str
            arrays.append(values)
        elif values.dtype.kind in "SUO":
            left_out[name] = "text"
        else:
            left_out[name] = f"{values.dtype} values of shape {values.shape[1:]} in each sample"
    # With a list of requested channels, the head still names all channels of the group.
    channels = list(numbers) if requested else list(decoded)
    return {"channels": channels, "decoded": decoded, "units": units}, arrays, left_out


def _list_channels(
    channels: Any, master: int
) -> tuple[dict[str, int], dict[str, str], dict[str, str]]:
    """Return number and unit of each channel by name, and channels whose name is in use."""
    numbers: dict[str, int] = {}
    units: dict[str, str] = {}
    left_out: dict[str, str] = {}
    for number, channel in enumerate(channels):
        if number == master:
            continue
        if channel.name in numbers:
            left_out[f"{channel.name}.{number}"] = "a second channel of this name in its group"
            continue
        numbers[channel.name] = number
        conversion = getattr(channel, "conversion", None)
        unit = getattr(channel, "unit", "") or getattr(conversion, "unit", "")
        if unit:
            units[channel.name] = unit
    return numbers, units, left_out


def _unique_name(group: Any, index: int, names: set[str]) -> str:
    """Return the name of a group, which differs from the `names` in use."""
    acquisition_name = getattr(group.channel_group, "acq_name", "") or ""
    name = acquisition_name.strip().replace("/", "_") or f"group{index}"
    return f"{name}.{index}" if name in names else name


def send_arrays(head: dict[str, Any], arrays: list[np.ndarray], stream: BinaryIO) -> None:
    """Write the head and the arrays."""
    stream.write(json.dumps(head).encode() + b"\n")
    for array in arrays:
        stream.write(np.ascontiguousarray(array).data)
    stream.flush()


def run_mdf_decoder() -> None:
    """Decode the file of the command line.

    An exception of asammdf becomes the fault of the head.
    """
    path, requested = sys.argv[1], set(json.loads(sys.argv[2]))
    # Standard output belongs to the arrays; what asammdf prints goes to standard error.
    stream = sys.stdout.buffer
    sys.stdout = sys.stderr
    try:
        head, arrays = decode_mdf(path, requested)
    except Exception as error:  # asammdf may raise any exception on damaged bytes
        text = " ".join(str(error).split())[:300]
        fault = f"content that cannot be decoded ({type(error).__name__}: {text})"
        head = {"fault": fault, "facts": {}, "groups": [], "left_out": []}
        arrays = []
    send_arrays(head, arrays, stream)


if __name__ == "__main__":
    run_mdf_decoder()

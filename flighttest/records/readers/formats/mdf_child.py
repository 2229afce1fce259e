"""The child process that decodes MDF files.

It is called as ``python -m flighttest.records.readers.formats.mdf_child FILE '["channel", ...]'``;
an empty list means all channels.

Standard output carries one line of JSON (``fault``, ``facts``, ``groups``) and then, group by
group, the stamps and the channels that are called ``decoded`` there with their NumPy type,
`samples` numbers each, as bare bytes.
"""

from __future__ import annotations

import json
import logging
import sys
from typing import Any, BinaryIO

import numpy as np


def decode_mdf(path: str, wanted: set[str]) -> tuple[dict[str, Any], list[np.ndarray]]:
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
            name = _name(group, index, {one["name"] for one in groups})
            if master is None:
                left_out.append((name, f"{len(group.channels)} channels without a time master"))
                continue
            time = np.asarray(file.get_master(index), float)
            if len(time) < 2 or len(group.channels) < 2:
                samples = (
                    f"{len(time)} sample{'' if len(time) == 1 else 's'}; a clock needs two samples"
                )
                left_out.append(
                    (name, samples if len(time) < 2 else "a time master without a channel")
                )
                continue
            about, found, texts = _decoded(file, index, master, len(time), wanted)
            about["samples"] = len(time)
            about["name"] = name
            left_out += [(f"{name}/{channel}", reason) for channel, reason in texts.items()]
            groups.append(about)
            arrays += [time, *found]
        facts = {} if file.start_time is None else {"start": file.start_time.isoformat()}
    return {"fault": "", "facts": facts, "groups": groups, "left_out": left_out}, arrays


def _decoded(
    file, index: int, master: int, samples: int, wanted: set[str]
) -> tuple[dict[str, Any], list[np.ndarray], dict[str, str]]:
    """Return channels and their arrays, and what is no number or has the name of another channel,
    with the reason.
    """
    left_out: dict[str, str] = {}
    numbers: dict[str, int] = {}
    units = {}
    for number, channel in enumerate(file.groups[index].channels):
        if number == master:
            continue
        if channel.name in numbers:
            left_out[f"{channel.name}.{number}"] = "a second channel of this name in its group"
            continue
        numbers[channel.name] = number
        unit = getattr(channel, "unit", "") or getattr(
            getattr(channel, "conversion", None), "unit", ""
        )
        if unit:
            units[channel.name] = unit
    asked = [name for name in numbers if not wanted or name in wanted]
    decoded: dict[str, str] = {}
    arrays = []
    for name, signal in zip(
        asked,
        file.select([(None, index, numbers[name]) for name in asked]) if asked else (),
        strict=True,
    ):
        values, bad = np.asarray(signal.samples), getattr(signal, "invalidation_bits", None)
        if values.dtype.kind in "fiub" and values.shape == (samples,):
            values = (
                values
                if bad is None
                else np.where(np.asarray(bad, bool), np.nan, values.astype(float))
            )
            decoded[name] = values.dtype.str
            arrays.append(values)
        else:
            left_out[name] = (
                "text"
                if values.dtype.kind in "SUO"
                else f"{values.dtype} values of shape {values.shape[1:]} in each sample"
            )
    known = list(numbers) if wanted else list(decoded)
    return {"channels": known, "decoded": decoded, "units": units}, arrays, left_out


def _name(group, index: int, taken: set[str]) -> str:
    name = (getattr(group.channel_group, "acq_name", "") or "").strip().replace(
        "/", "_"
    ) or f"group{index}"
    return f"{name}.{index}" if name in taken else name


def send_arrays(head: dict[str, Any], arrays: list[np.ndarray], stream: BinaryIO) -> None:
    """Write the head and the arrays."""
    stream.write(json.dumps(head).encode() + b"\n")
    for array in arrays:
        stream.write(np.ascontiguousarray(array).data)
    stream.flush()


def run_mdf_decoder() -> None:
    """Decode the file of the command line; whatever asammdf raises becomes the fault of the head."""
    path, wanted = sys.argv[1], set(json.loads(sys.argv[2]))
    stream = sys.stdout.buffer
    sys.stdout = sys.stderr
    try:
        head, arrays = decode_mdf(path, wanted)
    except Exception as error:  # a foreign decoder on damaged bytes may raise anything
        text = " ".join(str(error).split())[:300]
        head, arrays = (
            {
                "fault": f"content that cannot be decoded ({type(error).__name__}: {text})",
                "facts": {},
                "groups": [],
                "left_out": [],
            },
            [],
        )
    send_arrays(head, arrays, stream)


if __name__ == "__main__":
    run_mdf_decoder()

"""Tables of a Chapter 10 file as the ``[decode]`` tables of the name map define them.

The clock is the relative time counter from the first packet of data.  Time packets give the fact
``start``.

The file does not state which bits are which quantity.  Without ``[decode]`` the reader raises an
error that lists the channels.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from flightmech.errors import SchemaError
from flighttest.records.readers.arinc429 import label_tables
from flighttest.records.readers.bus_words import Analog, Arinc429, Mil1553, Pcm
from flighttest.records.readers.formats.chapter10.buses import arinc_words, mil1553_tables
from flighttest.records.readers.formats.chapter10.packets import (
    ARINC429_F0,
    KIND_NAMES,
    SETUP,
    TIME_F1,
    Index,
    index_packets,
)
from flighttest.records.readers.formats.chapter10.samples import analog_tables, pcm_tables
from flighttest.records.readers.formats.chapter10.time_packets import start_of_record
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.recording import RecordedTable, Recording

# Types of packets without data: setup, computer generated, recording events and index.
_NO_DATA = (SETUP, 0x00, 0x02, 0x03)


def read_chapter10_tables(path: Path, names: NameMap) -> Recording:
    """Return the parameters that the name map decodes, as tables.

    Raises
    ------
    ParseError
        The file has no packet, or a packing that the reader does not support.
    SchemaError
        The name map has no ``[decode]``.  The error lists the channels of the file.
    UnknownName
        The file has no such channel, label, message or subchannel.
    """
    file = index_packets(path)
    if not names.decode:
        raise _missing_decode_tables(file, path)
    ticks = [packet.rtc for packet in file.packets if packet.kind not in _NO_DATA]
    first_tick = min(ticks, default=0)
    notes = list(file.notes)
    tables: dict[str, RecordedTable] = {}
    for name, spec in names.decode.items():
        if isinstance(spec, Arinc429) and spec.channel is not None:
            bus_words = arinc_words(file, spec.channel, first_tick, name=name, notes=notes)
            of_labels, left_out = label_tables(bus_words, spec, name)
            tables.update(of_labels)
            notes += left_out
        elif isinstance(spec, Mil1553):
            tables.update(mil1553_tables(file, spec, first_tick, name=name, notes=notes))
        elif isinstance(spec, Pcm):
            tables.update(
                pcm_tables(file, spec, first_tick, name=name, notes=notes, path=str(path))
            )
        elif isinstance(spec, Analog):
            tables.update(
                analog_tables(file, spec, first_tick, name=name, notes=notes, path=str(path))
            )
    facts = {"title": path.name.split(".")[0], **start_of_record(file, first_tick)}
    return Recording("chapter10", tables, facts, notes=tuple(notes))


def _missing_decode_tables(file: Index, path: Path) -> SchemaError:
    """Return the error for a name map without ``[decode]``."""
    channels = []
    for row in chapter10_channels(file):
        channels.append(f"channel {row['channel']}: {row['content']}, {row['packets']} packets")
    content = "; ".join(channels) or "no data"
    return SchemaError(
        f"name map for {path.name}",
        [f"a Chapter 10 file needs [decode.NAME] tables for its words; it holds {content}"],
    )


def chapter10_channels(file: Index) -> list[dict[str, object]]:
    """Return the channels of a file: number, content and number of packets.

    A row of an ARINC 429 channel also has its labels as they are stored.
    """
    counts: Counter[tuple[int, int]] = Counter()
    for packet in file.packets:
        if packet.kind not in (SETUP, TIME_F1):
            counts[packet.channel, packet.kind] += 1

    rows: list[dict[str, object]] = []
    for (channel, kind), number in sorted(counts.items()):
        row: dict[str, object] = {
            "channel": channel,
            "content": KIND_NAMES.get(kind, f"type {kind:#04x}"),
            "packets": number,
        }
        if kind == ARINC429_F0:
            # The label is the low byte of a word and is written in octal digits.
            bus_words = arinc_words(file, channel, first_tick=0, name="", notes=[])
            labels = {int(word) & 0xFF for word in bus_words.word}
            row["labels"] = " ".join(f"{label:03o}" for label in sorted(labels))
        rows.append(row)
    return rows

"""Chapter 10 files as tables: what the ``[decode]`` tables of the name map take out of the packets.

The clock is the relative time counter from the first packet of data on; time packets give the fact
``start``.  Without ``[decode]`` there is nothing to read: which bits are which quantity is not in
the file.  The error lists the channels.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from flightmech.errors import SchemaError
from flighttest.records.readers.bus_words import Analog, Arinc429, Mil1553, Pcm, label_tables
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


def read_chapter10_tables(path: Path, names: NameMap) -> Recording:
    """Return the parameters that the name map decodes, as tables.

    Raises
    ------
    ParseError
        No packet, or a packing that is not read.
    SchemaError
        A name map without ``[decode]``; with the channels of the file.
    UnknownName
        A channel, label, message or subchannel that is not there.
    """
    file = index_packets(path)
    if not names.decode:
        listed = "; ".join(
            f"channel {c['channel']}: {c['content']}, {c['packets']} packets"
            for c in chapter10_channels(file)
        )
        raise SchemaError(
            f"name map for {path.name}",
            [
                f"a Chapter 10 file needs [decode.NAME] tables for its words; it holds "
                f"{listed or 'no data'}"
            ],
        )
    data = [packet.rtc for packet in file.packets if packet.kind not in (SETUP, 0x00, 0x02, 0x03)]
    first_tick = min(data, default=0)
    notes = list(file.notes)
    tables: dict[str, RecordedTable] = {}
    for name, spec in names.decode.items():
        if isinstance(spec, Arinc429) and spec.channel is not None:
            words = arinc_words(file, spec.channel, first_tick, name, notes)
            found, left_out = label_tables(words, spec, name)
            tables.update(found)
            notes += left_out
        elif isinstance(spec, Mil1553):
            tables.update(mil1553_tables(file, spec, first_tick, name, notes))
        elif isinstance(spec, Pcm):
            tables.update(pcm_tables(file, spec, first_tick, name, notes, str(path)))
        elif isinstance(spec, Analog):
            tables.update(analog_tables(file, spec, first_tick, name, notes, str(path)))
    facts = {"title": path.name.split(".")[0], **start_of_record(file, first_tick)}
    return Recording("chapter10", tables, facts, tuple(notes))


def chapter10_channels(file: Index) -> list[dict[str, object]]:
    """Return the channels of a file: number, content, packets; of ARINC 429 the buses with their
    labels as stored.
    """
    counts = Counter(
        (packet.channel, packet.kind)
        for packet in file.packets
        if packet.kind not in (SETUP, TIME_F1)
    )
    rows: list[dict[str, object]] = []
    for (channel, kind), number in sorted(counts.items()):
        row: dict[str, object] = {
            "channel": channel,
            "content": KIND_NAMES.get(kind, f"type {kind:#04x}"),
            "packets": number,
        }
        if kind == ARINC429_F0:
            words = arinc_words(file, channel, 0, "", [])
            row["labels"] = " ".join(
                f"{label:03o}" for label in sorted({int(word) & 0xFF for word in words.word})
            )
        rows.append(row)
    return rows

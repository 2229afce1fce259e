"""ARINC 429 and MIL-STD-1553 packets.

References
----------
.. [IRIG106-11] IRIG Standard 106-17, Chapter 11, 11.2.4.1 (MIL-STD-1553 format 1) and 11.2.8.1
   (ARINC 429 format 0).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from flightmech.errors import UnknownName
from flighttest.records.readers.arinc429 import Words
from flighttest.records.readers.bus_words import Mil1553
from flighttest.records.readers.formats.chapter10.counts import join_words, to_engineering_value
from flighttest.records.readers.formats.chapter10.packets import (
    ARINC429_F0,
    MIL1553_F1,
    TICK,
    Index,
    Packet,
)
from flighttest.records.readers.recording import RecordedTable

# Block status: message error, format error, response time-out.
_MESSAGE_ERRORS = 0x1000 | 0x0400 | 0x0200
# Block status: word count error, sync type error, invalid word.
_WORD_ERRORS = 0x0038
_TERMINAL_TO_TERMINAL = 0x0800
_MESSAGE_HEADER = 14  # bytes before the words of a MIL-STD-1553 message


class _Message(NamedTuple):
    """One MIL-STD-1553 message: relative time [ticks], block status, and its 16-bit words."""

    tick: int
    status: int
    words: np.ndarray


def arinc_words(file: Index, channel: int, first_tick: int, name: str, notes: list[str]) -> Words:
    """Return the ARINC 429 words of a channel without the words that have a format error.

    The first word of a packet has the time of the packet.  The gap time of every further word
    counts from the start of the word before it.
    """
    times, data_words, buses = [], [], []
    for packet in file.of(channel, ARINC429_F0, name):
        body = file.body(packet)
        # The channel-specific word holds the number of words in its low 16 bits.
        count = -1
        if len(body) >= 4:
            count = struct.unpack_from("<H", body)[0]
        if count < 0 or 4 + 8 * count > len(body):
            notes.append(
                f"packet at byte {packet.start}: {count} ARINC 429 words do not fit its "
                f"{len(body)} bytes; left out"
            )
            continue

        # Each word follows its intra-packet header: gap time in bits 0-19 [ticks], format error in
        # bit 23, bus in bits 24-31.
        pairs = np.frombuffer(body, "<u4", 2 * count, 4).reshape(count, 2)
        headers = pairs[:, 0]
        gaps = (headers & 0xFFFFF).astype(np.int64)
        if count:
            gaps[0] = 0
        is_valid = headers & (1 << 23) == 0
        times.append(((packet.rtc - first_tick + np.cumsum(gaps)) * TICK)[is_valid])
        data_words.append(pairs[is_valid, 1])
        buses.append((headers >> 24)[is_valid])

    if not times:
        return Words(np.zeros(0), np.zeros(0, np.uint32), np.zeros(0, np.uint32))
    return Words(np.concatenate(times), np.concatenate(data_words), np.concatenate(buses))


def mil1553_tables(
    file: Index, spec: Mil1553, first_tick: int, name: str, notes: list[str]
) -> dict[str, RecordedTable]:
    """Return the table of one message: its parameters at the times of the messages.

    Messages that the recorder flags as faulty and transfers from terminal to terminal are left
    out.

    Raises
    ------
    UnknownName
        The channel has no such message.  The error lists the messages of the channel.
    """
    transmits = spec.direction == "transmit"
    requested = (spec.rt, transmits, spec.subaddress)
    needed = max((max(word.words) for word in spec.parameters.values()), default=1)
    times, rows = [], []
    recorded: set[tuple[int, bool, int]] = set()
    short_messages = 0
    for packet in file.of(spec.channel, MIL1553_F1, name):
        for message in _read_messages(file, packet, notes):
            faulty = message.status & (_MESSAGE_ERRORS | _WORD_ERRORS)
            if faulty or message.status & _TERMINAL_TO_TERMINAL or len(message.words) < 2:
                continue
            # Command word: terminal in bits 11-15, transmit in bit 10, subaddress in bits 5-9.
            command = int(message.words[0])
            key = (command >> 11, bool(command >> 10 & 1), command >> 5 & 0x1F)
            recorded.add(key)
            if key != requested:
                continue
            data = _data_words(message.words, transmits)
            if len(data) < needed:
                short_messages += 1
                continue
            times.append((message.tick - first_tick) * TICK)
            rows.append(data[:needed])

    if not times:
        raise _unknown_message(spec, recorded, name)
    if short_messages:
        notes.append(
            f"decode.{name}: {short_messages} messages with fewer than {needed} data words left out"
        )

    data = np.array(rows)
    columns, units = {}, {}
    for parameter, word in spec.parameters.items():
        parts = [data[:, i - 1] for i in word.words]  # the name map counts data words from 1
        columns[parameter] = to_engineering_value(
            join_words(parts, 16),
            16 * len(word.words),
            code=word.code,
            lsb=word.lsb,
            offset=word.offset,
            bits=word.bits,
        )
        units[parameter] = word.unit
    return {name: RecordedTable(columns, units, np.array(times))}


def _data_words(words: np.ndarray, transmits: bool) -> np.ndarray:
    """Return the data words of a message.

    A transmitting terminal sends its status before the data, a receiving one after the data.
    """
    if transmits:
        return words[2:]
    return words[1:-1]


def _unknown_message(spec: Mil1553, recorded: set[tuple[int, bool, int]], name: str) -> UnknownName:
    """Return the error for a message that the channel does not have."""
    recorded_names = []
    for terminal, transmits, subaddress in sorted(recorded):
        direction = "transmit" if transmits else "receive"
        recorded_names.append(f"rt {terminal} {direction} subaddress {subaddress}")
    return UnknownName(
        f"rt {spec.rt} {spec.direction} subaddress {spec.subaddress}",
        recorded_names,
        what="MIL-STD-1553 message",
        hint=f"decode.{name} requires it on channel {spec.channel}",
    )


def _read_messages(file: Index, packet: Packet, notes: list[str]) -> Iterator[_Message]:
    """Yield every complete message of a packet."""
    body = file.body(packet)
    if packet.absolute_stamps:
        notes.append(
            f"packet at byte {packet.start}: stamps in the format of the secondary header "
            f"are not read; left out"
        )
        return
    count = 0
    if len(body) >= 4:
        count = struct.unpack_from("<I", body)[0] & 0xFFFFFF
    offset = 4
    for _ in range(count):
        if offset + _MESSAGE_HEADER > len(body):
            notes.append(f"packet at byte {packet.start}: cut off inside a MIL-STD-1553 message")
            return
        # Intra-packet header: 48-bit time, 2 reserved bytes, block status, gap times, length.
        tick = int.from_bytes(body[offset : offset + 6], "little")
        status, _, length = struct.unpack_from("<HHH", body, offset + 8)
        offset += _MESSAGE_HEADER
        if length % 2 or offset + length > len(body):
            notes.append(
                f"packet at byte {packet.start}: a MIL-STD-1553 message of {length} bytes "
                f"does not fit"
            )
            return
        yield _Message(tick, status, np.frombuffer(body, "<u2", length // 2, offset))
        offset += length

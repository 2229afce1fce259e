"""ARINC 429 and MIL-STD-1553 packets.

References
----------
.. [IRIG106-11] IRIG Standard 106-17, Chapter 11, 11.2.4.1 (MIL-STD-1553 format 1) and 11.2.8.1 (ARINC 429 format 0).
"""

from __future__ import annotations

import struct

import numpy as np

from flightmech.errors import UnknownName
from flighttest.records.readers.bus_words import Mil1553, Words
from flighttest.records.readers.formats.chapter10.counts import join_words, to_engineering_value
from flighttest.records.readers.formats.chapter10.packets import (
    ARINC429_F0,
    MIL1553_F1,
    TICK,
    Index,
    Packet,
)
from flighttest.records.readers.recording import RecordedTable

_ERRORS = (
    0x1000 | 0x0400 | 0x0200 | 0x0038
)  # message, format, time-out; length, sync type, invalid word


def arinc_words(file: Index, channel: int, first_tick: int, name: str, notes: list[str]) -> Words:
    """Return all ARINC 429 words of a channel; words with a format error are left out.

    The first word of a packet has the packet's time; each gap time counts from the beginning of the
    word before.
    """
    times, words, buses = [], [], []
    for packet in file.of(channel, ARINC429_F0, name):
        body = file.body(packet)
        count = struct.unpack_from("<H", body)[0] if len(body) >= 4 else -1
        if count < 0 or 4 + 8 * count > len(body):
            notes.append(
                f"packet at byte {packet.start}: {count} ARINC 429 words do not fit its "
                f"{len(body)} bytes; left out"
            )
            continue
        pairs = np.frombuffer(body, "<u4", 2 * count, 4).reshape(count, 2)
        gaps = (pairs[:, 0] & 0xFFFFF).astype(np.int64)
        if count:
            gaps[0] = 0
        good = pairs[:, 0] & (1 << 23) == 0
        times.append(((packet.rtc - first_tick + np.cumsum(gaps)) * TICK)[good])
        words.append(pairs[good, 1])
        buses.append((pairs[:, 0] >> 24)[good])
    if not times:
        return Words(np.zeros(0), np.zeros(0, np.uint32), np.zeros(0, np.uint32))
    return Words(np.concatenate(times), np.concatenate(words), np.concatenate(buses))


def mil1553_tables(
    file: Index, spec: Mil1553, first_tick: int, name: str, notes: list[str]
) -> dict[str, RecordedTable]:
    """Return the table of one message: its parameters at the times of the messages.

    Messages that the recorder flags as faulty are left out, and so are transfers from terminal to
    terminal.

    Raises
    ------
    UnknownName
        No such message, with those that are there.
    """
    transmit = spec.direction == "transmit"
    wanted = (spec.rt, transmit, spec.subaddress)
    times, rows = [], []
    seen: set[tuple[int, bool, int]] = set()
    needed = max((max(word.words) for word in spec.parameters.values()), default=1)
    short = 0
    for packet in file.of(spec.channel, MIL1553_F1, name):
        for tick, block, words in _messages(file, packet, notes):
            if block & _ERRORS or block & 0x0800 or len(words) < 2:
                continue
            command = int(words[0])
            key = (command >> 11, bool(command >> 10 & 1), command >> 5 & 0x1F)
            seen.add(key)
            if key != wanted:
                continue
            data = (
                words[2:] if transmit else words[1:-1]
            )  # a transmitting terminal sends its status before the data
            if len(data) < needed:
                short += 1
                continue
            times.append((tick - first_tick) * TICK)
            rows.append(data[:needed])
    if not times:
        there = [
            f"rt {rt} {'transmit' if sends else 'receive'} subaddress {sub}"
            for rt, sends, sub in sorted(seen)
        ]
        message = f"rt {spec.rt} {spec.direction} subaddress {spec.subaddress}"
        raise UnknownName(
            message,
            there,
            "MIL-STD-1553 message",
            f"decode.{name} requires it on channel {spec.channel}",
        )
    if short:
        notes.append(
            f"decode.{name}: {short} messages with fewer than {needed} data words left out"
        )
    data = np.array(rows)
    columns = {
        parameter: to_engineering_value(
            join_words([data[:, i - 1] for i in word.words], 16),
            16 * len(word.words),
            word.code,
            word.lsb,
            word.offset,
            word.bits,
        )
        for parameter, word in spec.parameters.items()
    }
    return {
        name: RecordedTable(
            columns,
            {parameter: word.unit for parameter, word in spec.parameters.items()},
            np.array(times),
        )
    }


def _messages(file: Index, packet: Packet, notes: list[str]):
    """Yield tick, block status and words of every message of a packet."""
    body = file.body(packet)
    if packet.absolute_stamps:
        notes.append(
            f"packet at byte {packet.start}: stamps in the format of the secondary header "
            f"are not read; left out"
        )
        return
    count = struct.unpack_from("<I", body)[0] & 0xFFFFFF if len(body) >= 4 else 0
    place = 4
    for _ in range(count):
        if place + 14 > len(body):
            notes.append(f"packet at byte {packet.start}: cut off inside a MIL-STD-1553 message")
            return
        tick = int.from_bytes(body[place : place + 6], "little")
        block, _, length = struct.unpack_from("<HHH", body, place + 8)
        place += 14
        if length % 2 or place + length > len(body):
            notes.append(
                f"packet at byte {packet.start}: a MIL-STD-1553 message of {length} bytes "
                f"does not fit"
            )
            return
        yield tick, block, np.frombuffer(body, "<u2", length // 2, place)
        place += length

"""Packets of an IRIG 106 Chapter 10 file: headers found, checked and indexed; damaged ones skipped
and reported.

References
----------
.. [IRIG106-11] IRIG Standard 106-17, Chapter 11, 11.2.1: packet header, secondary header, trailer.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flightmech.errors import ParseError, UnknownName

SYNC = b"\x25\xeb"
HEADER, SECONDARY = 24, 12  # bytes
TICK = 1e-7  # s, relative time counter
_LARGEST = 1 << 29  # bytes: 128 MB is the standard's largest packet, larger ones are damage
_TRAILER = (0, 1, 2, 4)  # bytes of the data checksum by its code
SETUP, TIME_F1, PCM_F1, MIL1553_F1, ANALOG_F1, ARINC429_F0 = 0x01, 0x11, 0x09, 0x19, 0x21, 0x38
KIND_NAMES = {
    0x00: "computer generated, user", SETUP: "setup record (TMATS)", 0x02: "recording events", 0x03: "recording index", PCM_F1: "PCM",
    TIME_F1: "time", 0x12: "network time", MIL1553_F1: "MIL-STD-1553", 0x1A: "16PP194", ANALOG_F1: "analogue", 0x29: "discrete",
    0x30: "message", ARINC429_F0: "ARINC 429", 0x40: "video", 0x41: "video", 0x42: "video", 0x43: "video", 0x44: "video", 0x48: "image",
    0x50: "UART", 0x58: "IEEE 1394", 0x59: "IEEE 1394", 0x60: "parallel", 0x68: "Ethernet", 0x69: "Ethernet", 0x70: "TSPI/CTS",
    0x78: "CAN", 0x79: "Fibre Channel",
}  # fmt: skip


@dataclass(frozen=True)
class Packet:
    """One packet: where it is, what it is, and its relative time counter [ticks of 100 ns]."""

    start: int
    channel: int
    kind: int
    flags: int
    rtc: int
    sequence: int
    body_start: int
    body_stop: int

    @property
    def absolute_stamps(self) -> bool:
        """Whether stamps inside the packet are in the format of the secondary header and not of the
        relative time counter.
        """
        return bool(self.flags & 0x40)


@dataclass(frozen=True)
class Index:
    """All packets of a file and its bytes."""

    data: np.memmap
    packets: list[Packet]
    notes: list[str]

    def body(self, packet: Packet) -> bytes:
        """Return the data of a packet, the channel-specific word first."""
        return self.data[packet.body_start : packet.body_stop].tobytes()

    def of(self, channel: int, kind: int, name: str) -> list[Packet]:
        """Return the packets of one channel and kind, for the table ``decode.name``.

        Raises
        ------
        UnknownName
            None is there; with the channels that hold this kind.
        """
        found = [
            packet for packet in self.packets if packet.channel == channel and packet.kind == kind
        ]
        if not found:
            there = {str(packet.channel) for packet in self.packets if packet.kind == kind}
            raise UnknownName(
                str(channel),
                there,
                f"channel of {KIND_NAMES[kind]} packets",
                f"decode.{name} requires it",
            )
        return found


def index_packets(path: Path) -> Index:
    """Return the index of a file.

    Raises
    ------
    ParseError
        No packet at all.
    """
    data = np.memmap(path, np.uint8, "r")
    packets: list[Packet] = []
    notes: list[str] = []
    place, lost_from = 0, -1
    while place + HEADER <= len(data):
        packet, size = _packet(data, place)
        if packet is None:
            lost_from = place if lost_from < 0 else lost_from
            place = _next_sync(data, place + 1)
            continue
        if lost_from >= 0:
            notes.append(f"bytes {lost_from} to {place} are no packets and were skipped")
            lost_from = -1
        packets.append(packet)
        place += size
    if lost_from >= 0 or place < len(data):
        notes.append(
            f"bytes {lost_from if lost_from >= 0 else place} to {len(data)} are no whole "
            f"packet: the end of the file may be cut off"
        )
    if not packets:
        raise ParseError(
            str(path), 0, "no packet with a valid header", "an IRIG 106 Chapter 10 recording"
        )
    return Index(data, packets, notes + _sequence_gaps(packets))


def _packet(data: np.ndarray, place: int) -> tuple[Packet | None, int]:
    head = data[place : place + HEADER].tobytes()
    if (
        head[:2] != SYNC
        or sum(struct.unpack("<11H", head[:22])) & 0xFFFF != struct.unpack("<H", head[22:])[0]
    ):
        return None, 0
    channel, size, length, _, sequence, flags, kind = struct.unpack("<HIIBBBB", head[2:16])
    start = place + HEADER + (SECONDARY if flags & 0x80 else 0)
    fits = size % 4 == 0 and HEADER <= size <= _LARGEST and place + size <= len(data)
    if not fits or start + length + _TRAILER[flags & 0b11] > place + size:
        return None, 0
    rtc = int.from_bytes(head[16:22], "little")
    return Packet(place, channel, kind, flags, rtc, sequence, start, start + length), size


def _next_sync(data: np.ndarray, place: int) -> int:
    while place < len(data):
        piece = data[place : place + (1 << 20)].tobytes()
        at = piece.find(SYNC)
        if at >= 0:
            return place + at
        place += max(1, len(piece) - 1)
    return len(data)


def _sequence_gaps(packets: list[Packet]) -> list[str]:
    """Return which channels lost packets, by their sequence numbers."""
    last: dict[int, int] = {}
    lost: dict[int, int] = {}
    for packet in packets:
        if packet.channel in last:
            missing = (packet.sequence - last[packet.channel] - 1) % 256
            if missing:
                lost[packet.channel] = lost.get(packet.channel, 0) + missing
        last[packet.channel] = packet.sequence
    return [
        f"channel {channel}: {count} packets missing by their sequence numbers"
        for channel, count in sorted(lost.items())
    ]

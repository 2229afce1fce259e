"""Index of the packets of an IRIG 106 Chapter 10 file.

Packet headers are checked.  Damaged packets are skipped and reported.

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
_LARGEST = 1 << 29  # bytes: the largest packet of the standard has 128 MB, a larger one is damaged
_TRAILER = (0, 1, 2, 4)  # bytes of the data checksum by its code
_PIECE = 1 << 20  # bytes that the search for a sync pattern copies at a time

# Packet types (data type in byte 15 of the header).
SETUP, TIME_F1, PCM_F1, MIL1553_F1, ANALOG_F1, ARINC429_F0 = 0x01, 0x11, 0x09, 0x19, 0x21, 0x38
KIND_NAMES = {
    0x00: "computer generated, user",
    SETUP: "setup record (TMATS)",
    0x02: "recording events",
    0x03: "recording index",
    PCM_F1: "PCM",
    TIME_F1: "time",
    0x12: "network time",
    MIL1553_F1: "MIL-STD-1553",
    0x1A: "16PP194",
    ANALOG_F1: "analogue",
    0x29: "discrete",
    0x30: "message",
    ARINC429_F0: "ARINC 429",
    0x40: "video",
    0x41: "video",
    0x42: "video",
    0x43: "video",
    0x44: "video",
    0x48: "image",
    0x50: "UART",
    0x58: "IEEE 1394",
    0x59: "IEEE 1394",
    0x60: "parallel",
    0x68: "Ethernet",
    0x69: "Ethernet",
    0x70: "TSPI/CTS",
    0x78: "CAN",
    0x79: "Fibre Channel",
}


@dataclass(frozen=True)
class Packet:
    """One packet: position [bytes], content, and relative time counter [ticks of 100 ns]."""

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
        """Whether stamps inside the packet have the format of the secondary header.

        Otherwise they are values of the relative time counter.
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
            The channel has no packet of this kind.  The error lists the channels that have.
        """
        of_kind = [packet for packet in self.packets if packet.kind == kind]
        selected = [packet for packet in of_kind if packet.channel == channel]
        if not selected:
            raise UnknownName(
                str(channel),
                {str(packet.channel) for packet in of_kind},
                what=f"channel of {KIND_NAMES[kind]} packets",
                hint=f"decode.{name} requires it",
            )
        return selected


def index_packets(path: Path) -> Index:
    """Return the index of a file.

    Raises
    ------
    ParseError
        The file has no packet with a valid header.
    """
    data = np.memmap(path, np.uint8, "r")
    packets: list[Packet] = []
    notes: list[str] = []
    offset = 0
    damaged_from = -1  # first byte of the damaged stretch before `offset`, -1 if there is none
    while offset + HEADER <= len(data):
        packet, size = _read_header(data, offset)
        if packet is None:
            if damaged_from < 0:
                damaged_from = offset
            offset = _next_sync(data, offset + 1)
            continue
        if damaged_from >= 0:
            notes.append(f"bytes {damaged_from} to {offset} are not packets and were skipped")
            damaged_from = -1
        packets.append(packet)
        offset += size

    # Bytes that are too few for a header remain behind the last packet of a truncated file.
    if damaged_from < 0 and offset < len(data):
        damaged_from = offset
    if damaged_from >= 0:
        notes.append(
            f"bytes {damaged_from} to {len(data)} are not a whole "
            f"packet: the end of the file may be cut off"
        )
    if not packets:
        raise ParseError(
            str(path),
            0,
            found="no packet with a valid header",
            expected="an IRIG 106 Chapter 10 recording",
        )
    return Index(data, packets, notes + _sequence_gaps(packets))


def _read_header(data: np.ndarray, offset: int) -> tuple[Packet | None, int]:
    """Return the packet at a byte of the file and its size, (None, 0) if it is not valid."""
    header = data[offset : offset + HEADER].tobytes()
    # The last word of the header is the 16-bit sum of its first eleven words.
    checksum = sum(struct.unpack("<11H", header[:22])) & 0xFFFF
    if header[:2] != SYNC or checksum != struct.unpack("<H", header[22:])[0]:
        return None, 0

    channel, size, length, _, sequence, flags, kind = struct.unpack("<HIIBBBB", header[2:16])
    body_start = offset + HEADER
    if flags & 0x80:  # the packet has a secondary header
        body_start += SECONDARY
    body_stop = body_start + length
    fits = size % 4 == 0 and HEADER <= size <= _LARGEST and offset + size <= len(data)
    if not fits or body_stop + _TRAILER[flags & 0b11] > offset + size:
        return None, 0
    packet = Packet(
        start=offset,
        channel=channel,
        kind=kind,
        flags=flags,
        rtc=int.from_bytes(header[16:22], "little"),
        sequence=sequence,
        body_start=body_start,
        body_stop=body_stop,
    )
    return packet, size


def _next_sync(data: np.ndarray, offset: int) -> int:
    """Return the next byte with a sync pattern, or the size of the file."""
    while offset < len(data):
        piece = data[offset : offset + _PIECE].tobytes()
        position = piece.find(SYNC)
        if position >= 0:
            return offset + position
        # The pattern has two bytes and may lie across the boundary of two pieces.
        offset += max(1, len(piece) - 1)
    return len(data)


def _sequence_gaps(packets: list[Packet]) -> list[str]:
    """Return a note for each channel that lost packets by its sequence numbers."""
    last: dict[int, int] = {}
    lost: dict[int, int] = {}
    for packet in packets:
        if packet.channel in last:
            # The sequence number of a channel counts from 0 to 255.
            missing = (packet.sequence - last[packet.channel] - 1) % 256
            if missing:
                lost[packet.channel] = lost.get(packet.channel, 0) + missing
        last[packet.channel] = packet.sequence
    notes = []
    for channel, count in sorted(lost.items()):
        notes.append(f"channel {channel}: {count} packets missing by their sequence numbers")
    return notes

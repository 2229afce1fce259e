"""PCM frames and analogue samples.

PCM packets may be packed or unpacked.  Their frames need time stamps (intra-packet headers).
Throughput mode has no recognized frames and is refused.

All analogue subchannels of a packet have one rate.  The rate follows from the number of samples and
the times of successive packets.

References
----------
.. [IRIG106-11] IRIG Standard 106-17, Chapter 11, 11.2.2.1 (PCM format 1) and 11.2.5.1 (analogue
   format 1).
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from flightmech.errors import ParseError, UnknownName
from flighttest.records.readers.bus_words import Analog, Pcm, PcmWord
from flighttest.records.readers.formats.chapter10.counts import join_words, to_engineering_value
from flighttest.records.readers.formats.chapter10.packets import (
    ANALOG_F1,
    PCM_F1,
    TICK,
    Index,
    Packet,
)
from flighttest.records.readers.recording import RecordedTable

_PADDING_BEHIND = 1  # packing mode with the sample at the high end of its word


class _AnalogSamples(NamedTuple):
    """Samples of an analogue packet.

    Attributes
    ----------
    subchannels : tuple of int
    width : int
        Bits of a sample.
    counts : array (sample, subchannel) of uint64
    """

    subchannels: tuple[int, ...]
    width: int
    counts: np.ndarray


def pcm_tables(
    file: Index, spec: Pcm, first_tick: int, name: str, notes: list[str], path: str
) -> dict[str, RecordedTable]:
    """Return the parameters in every frame as the table `name`.

    Repeated words and words of subframes have a table each, ``name.parameter``.

    Raises
    ------
    ParseError
        The frames are in throughput mode or have no stamps.
    UnknownName
        The channel has no PCM packets.
    """
    ticks, frames = [], []
    for packet in file.of(spec.channel, PCM_F1, name):
        packet_ticks, packet_words = _read_frames(file, packet, spec, notes=notes, path=path)
        ticks.append(packet_ticks)
        frames.append(packet_words)
    time = (np.concatenate(ticks) - first_tick) * TICK
    frame_words = np.concatenate(frames)

    tables: dict[str, RecordedTable] = {}
    columns, units = {}, {}
    for key, word in spec.parameters.items():
        if not word.repeated and word.frame is None:
            columns[key] = _engineering_value(frame_words, word, word.words, spec.word_bits)
            units[key] = word.unit
    if columns:
        tables[name] = RecordedTable(columns, units, time)

    for key, word in spec.parameters.items():
        if word.repeated:
            tables[f"{name}.{key}"] = _repeated_word_table(frame_words, word, spec, time)
        elif word.frame is not None and spec.counter is not None and word.frames is not None:
            # The subframe counter states which frame of the major frame a minor frame is.
            counter = frame_words[:, spec.counter.word - 1].astype(np.int64)
            has_word = (counter - spec.counter.first) % word.frames == word.frame
            values = _engineering_value(frame_words[has_word], word, word.words, spec.word_bits)
            tables[f"{name}.{key}"] = RecordedTable(
                {"value": values}, {"value": word.unit}, time[has_word]
            )
    return tables


def _repeated_word_table(
    words: np.ndarray, word: PcmWord, spec: Pcm, time: np.ndarray
) -> RecordedTable:
    """Return the samples of a word that stands several times in a frame, in order of time."""
    period = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    samples = [_engineering_value(words, word, (i,), spec.word_bits) for i in word.words]
    values = np.stack(samples, axis=1).ravel()
    # Word i of n is sent (i - 1) / n of a frame period after the first word.
    shifts = (np.array(word.words) - 1) / spec.frame_words * period
    stamps = (time[:, None] + shifts).ravel()
    return RecordedTable({"value": values}, {"value": word.unit}, stamps)


def _engineering_value(
    words: np.ndarray, word: PcmWord, numbers: tuple[int, ...], width: int
) -> np.ndarray:
    """Return a parameter from the words of these numbers, which count from 1."""
    parts = [words[:, i - 1] for i in numbers]
    return to_engineering_value(
        join_words(parts, width),
        width * len(numbers),
        code=word.code,
        lsb=word.lsb,
        offset=word.offset,
        bits=word.bits,
    )


def _read_frames(
    file: Index, packet: Packet, spec: Pcm, notes: list[str], path: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return ticks (frame,) and words (frame, word) of a packet."""
    body = file.body(packet)
    header = 0
    if len(body) >= 4:
        header = struct.unpack_from("<I", body)[0]
    # Channel-specific word: 32-bit alignment, throughput mode, unpacked mode, intra-packet headers.
    aligned_32 = header >> 18 & 1
    throughput = header >> 19 & 1
    unpacked = header >> 21 & 1
    stamped = header >> 30 & 1
    _demand_relative_stamps(packet, throughput, stamped, path)

    grain = 4 if aligned_32 else 2  # bytes of the words in which a frame is stored
    stamp_size = 12 if aligned_32 else 10  # bytes
    slot = spec.word_bits
    if unpacked:
        # Unpacked words have 16, 32 or 64 bits each.
        slot = 8 * next(size for size in (2, 4, 8) if 8 * size >= spec.word_bits)
    # A frame is padded to a whole number of storage words.
    frame_size = -(-spec.frame_words * slot // (8 * grain)) * grain
    row_size = stamp_size + frame_size
    count, excess = divmod(len(body) - 4, row_size)
    if excess or not count:
        notes.append(
            f"packet at byte {packet.start}: {len(body) - 4} bytes are not a whole number of "
            f"frames of {row_size} bytes; left out"
        )
        return np.zeros(0, np.int64), np.zeros((0, spec.frame_words), np.uint64)

    rows = np.frombuffer(body, np.uint8, count * row_size, 4).reshape(count, row_size)
    # The stamp begins with 48 bits of the relative time counter, low byte first.
    ticks = rows[:, :6].astype(np.int64) @ (1 << 8 * np.arange(6))
    return ticks, _frame_words(rows[:, stamp_size:], spec, slot, grain)


def _demand_relative_stamps(packet: Packet, throughput: int, stamped: int, path: str) -> None:
    """Raise if the frames of a PCM packet have no stamps of the relative time counter."""
    origin = f"(packet at byte {packet.start})"
    if throughput or not stamped:
        content = "PCM in throughput mode" if throughput else "PCM frames without stamps"
        raise ParseError(
            path,
            0,
            found=f"{content} {origin}",
            expected="packed or unpacked PCM with intra-packet headers",
        )
    if packet.absolute_stamps:
        raise ParseError(
            path,
            0,
            found=f"PCM stamps in the format of the secondary header {origin}",
            expected="relative stamps",
        )


def _frame_words(frames: np.ndarray, spec: Pcm, slot: int, grain: int) -> np.ndarray:
    """Return the words of frames that are stored in words of `grain` bytes.

    The low byte comes first.  The most significant bit is the first bit that was sent.
    """
    count = len(frames)
    in_order = frames.reshape(count, -1, grain)[:, :, ::-1].reshape(count, -1)
    bits = np.unpackbits(in_order, axis=1)[:, : spec.frame_words * slot]
    bits = bits.reshape(count, spec.frame_words, slot)
    # A word is at the low end of its slot.
    return _join_bits(bits[:, :, slot - spec.word_bits :])


def _join_bits(bits: np.ndarray) -> np.ndarray:
    """Return the numbers whose bits, most significant first, are on the last axis of three."""
    numbers = np.zeros(bits.shape[:2], np.uint64)
    for i in range(bits.shape[2]):
        numbers = (numbers << np.uint64(1)) | bits[:, :, i].astype(np.uint64)
    return numbers


def analog_tables(
    file: Index, spec: Analog, first_tick: int, name: str, notes: list[str], path: str
) -> dict[str, RecordedTable]:
    """Return the subchannels of the name map as the table `name`.

    Raises
    ------
    ParseError
        The subchannels have different rates.
    UnknownName
        The channel has no analogue packets, or has no such subchannel.
    """
    parts, ticks = [], []
    subchannels: tuple[int, ...] = ()
    width = 16
    for packet in file.of(spec.channel, ANALOG_F1, name):
        packet_samples = _read_analog_samples(file, packet, notes, path)
        if packet_samples is not None:
            subchannels, width, counts = packet_samples
            parts.append(counts)
            ticks.append(packet.rtc - first_tick)
    if not parts:
        raise ParseError(
            path,
            0,
            found=f"no whole analogue packet on channel {spec.channel}",
            expected="packets of samples",
        )

    samples = np.concatenate(parts)
    columns, units = {}, {}
    for key, parameter in spec.parameters.items():
        if parameter.subchannel not in subchannels:
            raise UnknownName(
                str(parameter.subchannel),
                map(str, subchannels),
                what="analogue subchannel",
                hint=f"decode.{name}.parameters.{key} requires it",
            )
        columns[key] = to_engineering_value(
            samples[:, subchannels.index(parameter.subchannel)],
            width,
            code=parameter.code,
            lsb=parameter.lsb,
            offset=parameter.offset,
        )
        units[key] = parameter.unit
    counts_of_packets = np.array([len(part) for part in parts])
    time = _sample_times(np.array(ticks) * TICK, counts_of_packets)
    return {name: RecordedTable(columns, units, time)}


def _read_analog_samples(
    file: Index, packet: Packet, notes: list[str], path: str
) -> _AnalogSamples | None:
    """Return the samples of a packet, None if it is damaged."""
    body = file.body(packet)
    if len(body) < 4:
        notes.append(f"packet at byte {packet.start}: no channel-specific word; left out")
        return None
    word = struct.unpack_from("<I", body)[0]
    # Bits 16-23 hold the number of subchannels, 0 is read as 1.  Bit 28 states that one
    # channel-specific word serves all subchannels.
    total = (word >> 16 & 0xFF) or 1
    is_shared = word >> 28 & 1
    word_count = 1 if is_shared else total
    if len(body) < 4 * word_count:
        notes.append(
            f"packet at byte {packet.start}: its {word_count} channel-specific words are cut off; "
            f"left out"
        )
        return None
    headers = struct.unpack_from(f"<{word_count}I", body)
    # Bits 24-27 hold the rate factor, bits 0-7 packing mode and length of a sample.
    if any((header >> 24 & 0xF) or (header & 0xFF) != (headers[0] & 0xFF) for header in headers):
        raise ParseError(
            path,
            0,
            found=(
                f"analogue subchannels of different rates or lengths "
                f"(packet at byte {packet.start})"
            ),
            expected="one rate and length for all subchannels of a channel",
        )
    if is_shared:
        subchannels = tuple(range(total))
    else:
        subchannels = tuple(header >> 8 & 0xFF for header in headers)

    mode = word & 0b11
    width = (word >> 2 & 0x3F) or 64  # bits; the code 0 means 64
    # Packed samples follow each other without padding, others fill words of 16 bits.
    slot = width if mode == 0 else 16 * -(-width // 16)
    first_byte = 4 * word_count
    data = np.frombuffer(body, np.uint8, (len(body) - first_byte) // 2 * 2, first_byte)
    bits = np.unpackbits(data.reshape(-1, 2)[:, ::-1].ravel())
    count = len(bits) // (slot * total)
    slots = bits[: count * slot * total].reshape(count, total, slot)
    if mode == _PADDING_BEHIND:
        sample_bits = slots[:, :, :width]
    else:
        sample_bits = slots[:, :, slot - width :]
    return _AnalogSamples(subchannels, width, _join_bits(sample_bits))


def _sample_times(starts: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Return the times of samples from the times of the packets. [s]

    The samples of a packet are evenly spaced.  The last packet has the median step.
    """
    steps = np.diff(starts) / np.maximum(counts[:-1], 1)
    step = float(np.median(steps)) if len(steps) else 0.0
    # A step far above the median means that the next packet is missing.
    steps = np.where(steps > 1.5 * step, step, steps)
    steps = np.append(steps, step)
    times = []
    for start, packet_step, count in zip(starts, steps, counts, strict=True):
        times.append(start + packet_step * np.arange(count))
    return np.concatenate(times)

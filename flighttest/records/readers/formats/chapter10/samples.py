"""PCM frames and analogue samples.

PCM: packed and unpacked frames with stamps (intra-packet headers); throughput mode, where the
recorder did not look for frames, is refused. Analogue: all subchannels of a packet at one rate; the
rate is that of the samples between the times of successive packets.

References
----------
.. [IRIG106-11] IRIG Standard 106-17, Chapter 11, 11.2.2.1 (PCM format 1) and 11.2.5.1 (analogue format 1).
"""

from __future__ import annotations

import struct

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


def pcm_tables(
    file: Index, spec: Pcm, first_tick: int, name: str, notes: list[str], path: str
) -> dict[str, RecordedTable]:
    """Return the parameters in every frame as the table `name`, repeated and subframe words as
    tables of their own.

    Raises
    ------
    ParseError
        Throughput mode, or frames without stamps.
    UnknownName
        No PCM packets on the channel.
    """
    ticks, frames = [], []
    for packet in file.of(spec.channel, PCM_F1, name):
        part = _frames(file, packet, spec, notes, path)
        ticks.append(part[0])
        frames.append(part[1])
    time = (np.concatenate(ticks) - first_tick) * TICK
    words = np.concatenate(frames)
    period = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    tables: dict[str, RecordedTable] = {}
    every = {
        key: word
        for key, word in spec.parameters.items()
        if not word.repeated and word.frame is None
    }
    if every:
        columns = {
            key: _value(words, word, word.words, spec.word_bits) for key, word in every.items()
        }
        tables[name] = RecordedTable(columns, {key: word.unit for key, word in every.items()}, time)
    for key, word in spec.parameters.items():
        if word.repeated:
            values = np.stack(
                [_value(words, word, (at,), spec.word_bits) for at in word.words], axis=1
            ).ravel()
            shifts = (np.array(word.words) - 1) / spec.frame_words * period
            tables[f"{name}.{key}"] = RecordedTable(
                {"value": values}, {"value": word.unit}, (time[:, None] + shifts).ravel()
            )
        elif word.frame is not None and spec.counter is not None and word.frames is not None:
            number = (
                words[:, spec.counter.word - 1].astype(np.int64) - spec.counter.first
            ) % word.frames
            mine = number == word.frame
            tables[f"{name}.{key}"] = RecordedTable(
                {"value": _value(words[mine], word, word.words, spec.word_bits)},
                {"value": word.unit},
                time[mine],
            )
    return tables


def _value(words: np.ndarray, word: PcmWord, at: tuple[int, ...], width: int) -> np.ndarray:
    count = join_words([words[:, i - 1] for i in at], width)
    return to_engineering_value(count, width * len(at), word.code, word.lsb, word.offset, word.bits)


def _frames(
    file: Index, packet: Packet, spec: Pcm, notes: list[str], path: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return ticks (frame,) and words (frame, word) of a packet."""
    body = file.body(packet)
    head = struct.unpack_from("<I", body)[0] if len(body) >= 4 else 0
    wide, throughput, unpacked, stamped = (
        head >> 18 & 1,
        head >> 19 & 1,
        head >> 21 & 1,
        head >> 30 & 1,
    )
    if throughput or not stamped:
        what = "PCM in throughput mode" if throughput else "PCM frames without stamps"
        raise ParseError(
            path,
            0,
            f"{what} (packet at byte {packet.start})",
            "packed or unpacked PCM with intra-packet headers",
        )
    if packet.absolute_stamps:
        raise ParseError(
            path,
            0,
            f"PCM stamps in the format of the secondary header (packet at byte {packet.start})",
            "relative stamps",
        )
    grain = 4 if wide else 2
    header = 12 if wide else 10
    slot = 8 * next(size for size in (2, 4, 8) if 8 * size >= spec.word_bits)
    bits = spec.frame_words * (slot if unpacked else spec.word_bits)
    size = -(-bits // (8 * grain)) * grain
    count, rest = divmod(len(body) - 4, header + size)
    if rest or not count:
        notes.append(
            f"packet at byte {packet.start}: {len(body) - 4} bytes are no whole number of "
            f"frames of {header + size} bytes; left out"
        )
        return np.zeros(0, np.int64), np.zeros((0, spec.frame_words), np.uint64)
    rows = np.frombuffer(body, np.uint8, count * (header + size), 4).reshape(count, header + size)
    ticks = rows[:, :6].astype(np.int64) @ (1 << 8 * np.arange(6))
    return ticks, _unpacked(rows[:, header:], spec, slot if unpacked else spec.word_bits, grain)


def _unpacked(data: np.ndarray, spec: Pcm, slot: int, grain: int) -> np.ndarray:
    """Return the words of frames kept in words of `grain` bytes, low byte first, the first bit sent
    most significant.
    """
    turned = data.reshape(len(data), -1, grain)[:, :, ::-1].reshape(len(data), -1)
    bits = np.unpackbits(turned, axis=1)[:, : spec.frame_words * slot].reshape(
        len(data), spec.frame_words, slot
    )
    bits = bits[:, :, slot - spec.word_bits :]
    words = np.zeros(bits.shape[:2], np.uint64)
    for i in range(spec.word_bits):
        words = (words << np.uint64(1)) | bits[:, :, i].astype(np.uint64)
    return words


def analog_tables(
    file: Index, spec: Analog, first_tick: int, name: str, notes: list[str], path: str
) -> dict[str, RecordedTable]:
    """Return the subchannels requested as the table `name`.

    Raises
    ------
    ParseError
        Subchannels at different rates.
    UnknownName
        No analogue packets on the channel, or no such subchannel.
    """
    parts, ticks = [], []
    numbers: tuple[int, ...] = ()
    width = 16
    for packet in file.of(spec.channel, ANALOG_F1, name):
        found = _analog_samples(file, packet, notes, path)
        if found is not None:
            numbers, width, samples = found
            parts.append(samples)
            ticks.append(packet.rtc - first_tick)
    if not parts:
        raise ParseError(
            path, 0, f"no whole analogue packet on channel {spec.channel}", "packets of samples"
        )
    for key, part in spec.parameters.items():
        if part.subchannel not in numbers:
            raise UnknownName(
                str(part.subchannel),
                map(str, numbers),
                "analogue subchannel",
                f"decode.{name}.parameters.{key} requires it",
            )
    samples = np.concatenate(parts)
    columns = {
        key: to_engineering_value(
            samples[:, numbers.index(part.subchannel)], width, part.code, part.lsb, part.offset
        )
        for key, part in spec.parameters.items()
    }
    time = _sample_times(np.array(ticks) * TICK, np.array([len(part) for part in parts]))
    return {
        name: RecordedTable(
            columns, {key: part.unit for key, part in spec.parameters.items()}, time
        )
    }


def _analog_samples(
    file: Index, packet: Packet, notes: list[str], path: str
) -> tuple[tuple[int, ...], int, np.ndarray] | None:
    """Return subchannel numbers, bits per sample and counts (sample, subchannel) of a packet."""
    body = file.body(packet)
    if len(body) < 4:
        notes.append(f"packet at byte {packet.start}: no channel-specific word; left out")
        return None
    word = struct.unpack_from("<I", body)[0]
    total, same = (word >> 16 & 0xFF) or 1, word >> 28 & 1
    heads = 1 if same else total
    if len(body) < 4 * heads:
        notes.append(
            f"packet at byte {packet.start}: its {heads} channel-specific words are cut off; "
            f"left out"
        )
        return None
    words = struct.unpack_from(f"<{heads}I", body)
    if any((one >> 24 & 0xF) or (one & 0xFF) != (words[0] & 0xFF) for one in words):
        what = f"analogue subchannels of different rates or lengths (packet at byte {packet.start})"
        raise ParseError(path, 0, what, "one rate and length for all subchannels of a channel")
    numbers = tuple(range(total)) if same else tuple(one >> 8 & 0xFF for one in words)
    mode, length = word & 0b11, (word >> 2 & 0x3F) or 64
    slot = length if mode == 0 else 16 * -(-length // 16)
    data = np.frombuffer(body, np.uint8, (len(body) - 4 * heads) // 2 * 2, 4 * heads)
    bits = np.unpackbits(data.reshape(-1, 2)[:, ::-1].ravel())
    count = len(bits) // (slot * total)
    shape = bits[: count * slot * total].reshape(count, total, slot)
    shape = shape[:, :, :length] if mode == 1 else shape[:, :, slot - length :]
    samples = np.zeros((count, total), np.uint64)
    for i in range(length):
        samples = (samples << np.uint64(1)) | shape[:, :, i].astype(np.uint64)
    return numbers, length, samples


def _sample_times(starts: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Return the times of samples from the times of the packets: even inside each packet, the last
    one as the one before.
    """
    steps = np.diff(starts) / np.maximum(counts[:-1], 1)
    step = float(np.median(steps)) if len(steps) else 0.0
    steps = np.where(steps > 1.5 * step, step, steps)  # a packet is missing after this one
    steps = np.append(steps, step)
    return np.concatenate(
        [
            start + each * np.arange(count)
            for start, each, count in zip(starts, steps, counts, strict=True)
        ]
    )

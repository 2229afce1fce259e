"""Time of the world in a Chapter 10 file: time packets (format 1) tie the relative time counter to
the calendar.

References
----------
.. [IRIG106-11] IRIG Standard 106-17, Chapter 11, 11.2.3.2.
"""

from __future__ import annotations

import struct
from datetime import UTC, datetime, timedelta

from flighttest.records.readers.formats.chapter10.packets import TICK, TIME_F1, Index

_NO_SOURCE = 0xF


def start_of_record(file: Index, first_tick: int) -> dict[str, str]:
    """Return the fact ``start`` (ISO 8601), or ``start_day_of_year`` where the time code gives no
    year; nothing without time packets.
    """
    for packet in file.packets:
        if packet.kind != TIME_F1:
            continue
        body = file.body(packet)
        if len(body) < 4 + 6:
            continue
        word = struct.unpack_from("<I", body)[0]
        if (word >> 4) & 0xF == _NO_SOURCE:
            continue
        shift = timedelta(seconds=(first_tick - packet.rtc) * TICK)
        dated = bool(word >> 9 & 1)
        if dated and len(body) < 4 + 8:
            continue
        try:
            moment = _calendar(body[4:]) if dated else _day_of_year(body[4:])
        except ValueError:
            continue
        if dated:
            return {
                "start": (moment + shift).isoformat(timespec="microseconds").replace("+00:00", "Z")
            }
        moment += shift
        return {"start_day_of_year": f"{moment.timetuple().tm_yday:03d}T{moment:%H:%M:%S.%f}"}
    return {}


def _digits(value: int, *widths: int) -> int:
    """Return binary coded decimal digits, the least first, each of its own width in bits."""
    total, scale = 0, 1
    for width in widths:
        digit = value & ((1 << width) - 1)
        if digit > 9:
            raise ValueError("no decimal digit")
        total, scale, value = total + digit * scale, scale * 10, value >> width
    return total


def _clock(words: tuple[int, ...]) -> timedelta:
    hundredths = _digits(words[0] & 0xFF, 4, 4)
    seconds = _digits(words[0] >> 8, 4, 3)
    minutes = _digits(words[1] & 0x7F, 4, 3)
    hours = _digits(words[1] >> 8, 4, 2)
    return timedelta(hours=hours, minutes=minutes, seconds=seconds, milliseconds=10 * hundredths)


def _day_of_year(body: bytes) -> datetime:
    """Return the time in a leap year, so that day 366 exists; the year itself means nothing."""
    words = struct.unpack_from("<3H", body)
    return (
        datetime(2000, 1, 1, tzinfo=UTC)
        + timedelta(days=_digits(words[2], 4, 4, 2) - 1)
        + _clock(words)
    )


def _calendar(body: bytes) -> datetime:
    words = struct.unpack_from("<4H", body)
    day, month = _digits(words[2] & 0xFF, 4, 4), _digits(words[2] >> 8, 4, 1)
    return datetime(_digits(words[3], 4, 4, 4, 2), month, day, tzinfo=UTC) + _clock(words)

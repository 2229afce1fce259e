"""Calendar time of a Chapter 10 file.

Time packets (format 1) relate the relative time counter to the calendar.

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
    """Return the fact ``start`` (ISO 8601) from the first valid time packet.

    A time code without a year gives ``start_day_of_year``.  The result is empty if the file has no
    valid time packet.
    """
    for packet in file.packets:
        if packet.kind != TIME_F1:
            continue
        body = file.body(packet)
        if len(body) < 4 + 6:
            continue
        # Channel-specific word: time source in bits 4-7, date format in bit 9.
        word = struct.unpack_from("<I", body)[0]
        if (word >> 4) & 0xF == _NO_SOURCE:
            continue
        has_date = bool(word >> 9 & 1)
        if has_date and len(body) < 4 + 8:
            continue
        try:
            moment = _read_calendar(body[4:]) if has_date else _read_day_of_year(body[4:])
        except ValueError:
            continue
        moment += timedelta(seconds=(first_tick - packet.rtc) * TICK)
        if has_date:
            text = moment.isoformat(timespec="microseconds").replace("+00:00", "Z")
            return {"start": text}
        return {"start_day_of_year": f"{moment.timetuple().tm_yday:03d}T{moment:%H:%M:%S.%f}"}
    return {}


def _decode_digits(value: int, *widths: int) -> int:
    """Return a binary coded decimal number from the widths of its digits, the least first. [bits]

    Raises ValueError for a digit above 9.
    """
    total, scale = 0, 1
    for width in widths:
        digit = value & ((1 << width) - 1)
        if digit > 9:
            raise ValueError("not a decimal digit")
        total += digit * scale
        scale *= 10
        value >>= width
    return total


def _read_time_of_day(fields: tuple[int, ...]) -> timedelta:
    """Return the time of day from the first two 16-bit fields of a time code."""
    hundredths = _decode_digits(fields[0] & 0xFF, 4, 4)
    seconds = _decode_digits(fields[0] >> 8, 4, 3)
    minutes = _decode_digits(fields[1] & 0x7F, 4, 3)
    hours = _decode_digits(fields[1] >> 8, 4, 2)
    return timedelta(hours=hours, minutes=minutes, seconds=seconds, milliseconds=10 * hundredths)


def _read_day_of_year(body: bytes) -> datetime:
    """Return a time code without a year as a time in 2000, a leap year that has a day 366."""
    fields = struct.unpack_from("<3H", body)
    day = timedelta(days=_decode_digits(fields[2], 4, 4, 2) - 1)
    return datetime(2000, 1, 1, tzinfo=UTC) + day + _read_time_of_day(fields)


def _read_calendar(body: bytes) -> datetime:
    """Return a time code with day, month and year."""
    fields = struct.unpack_from("<4H", body)
    day = _decode_digits(fields[2] & 0xFF, 4, 4)
    month = _decode_digits(fields[2] >> 8, 4, 1)
    year = _decode_digits(fields[3], 4, 4, 4, 2)
    return datetime(year, month, day, tzinfo=UTC) + _read_time_of_day(fields)

"""Cells of a CSV file that are no numbers: stamps, and columns of text or of numbers with a few
words among them.

A column of text is left out and named.  In a column of numbers, words such as ``INVALID`` or
``----`` are missing samples, which the notes count.  A cell with digits that is no number, such as
``1.2.3``, is a fault of the file where the name map needs its column.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from flightmech.errors import ParseError
from flighttest.records.readers.recording import LeftOut

_DAY_TIME = re.compile(
    r"^(?:(?:\d{4}:)?(\d{1,3})[:\s])?(\d{1,2}):(\d{1,2}):(\d{1,2})(?:[.,:](\d+))?Z?$"
)
_PARTS_OF_A_SECOND = re.compile(r"^(\d{1,2}):(\d{2}):(\d{2}):(\d+)$")
_SHORT_TIME = re.compile(r"^(\d{1,3}):(\d{2}[.,]\d+)$")  # minutes and seconds, without hours
# a date of any order before a time of day, AM or PM behind it
_DATED = re.compile(
    r"^(?:(\d{1,4}[/.-]\d{1,2}[/.-]\d{1,4}),?[ "
    r"T]+)?(\d{1,2}):(\d{1,2}):(\d{1,2}(?:[.,]\d+)?)\s*([AaPp]\.?[Mm]\.?)?$"
)
_ISO = re.compile(r"^\d{4}-\d{2}-\d{2}([T ]\d{2}:\d{2}(:\d{2}([.,:]\d*)?)?)?(Z|[+-]\d{2}:?\d{2})?$")
_LIKE_A_NUMBER = re.compile(r"^[-+]?[\d.,' ]*\d[\d.,' eE+-]*$")
_MOST_WORDS = 0.5  # share of the filled cells; a column with more words is text
_NAMED = 3  # words of a column that a text names
REMEDY = (
    "map a column of numbers, replace the words by numbers in the file (UP and DOWN by 0 "
    "and 1), or take the channel out of the map"
)


def is_missing(cell: str) -> bool:
    """Return whether a cell states that it has no value."""
    return cell.lower() in ("", "nan", "na", "n/a", "null", "none", "<na>", "-nan", "#n/a", "#na")


def is_csv_number(cell: str, decimal: str = ".") -> bool:
    """Return whether a cell is a number."""
    if (decimal == "," and "." in cell) or "_" in cell:
        return False
    try:
        float(cell.replace(decimal, "."))
    except ValueError:
        return False
    return not is_missing(cell)


def is_stamp(cell: str) -> bool:
    """Return whether a cell is a time of day or a date."""
    return any(form.match(cell) for form in (_DAY_TIME, _ISO, _SHORT_TIME, _DATED))


def numbers_of(
    cells: Sequence[str], name: str, place: str, decimal: str = "."
) -> tuple[np.ndarray | None, str, LeftOut | None]:
    """Return the numbers of a column with words in it, a note on the words, and the column if it is
    left out.

    Parameters
    ----------
    cells : sequence of str
        Cells as they stand in the file.
    name : str
        Heading.
    place : str
        Table and heading, for the list of columns that are left out.
    decimal : str
        Decimal mark.

    Returns
    -------
    numbers : array (time,) or None
        NaN for words and empty cells; None for a column of text.
    note : str
    left_out : LeftOut or None
    """
    distinct = Counter(cells)
    filled = {cell: count for cell, count in distinct.items() if not is_missing(cell)}
    words = {cell: count for cell, count in filled.items() if not is_csv_number(cell, decimal)}
    total, count = sum(filled.values()), sum(words.values())
    common = sorted(words, key=lambda word: -words[word])
    shown = ", ".join(f"{word[:40]!r} {words[word]}" for word in common[:_NAMED])
    shown += f" and {len(common) - _NAMED} other words" * (len(common) > _NAMED)
    truth = {"true": 1.0, "false": 0.0}
    if words and all(word.lower() in truth for word in filled):
        values = {cell: truth.get(cell.lower(), np.nan) for cell in distinct}
        return (
            np.array([values[cell] for cell in cells]),
            f"column {name}: TRUE and FALSE are read as 1 and 0",
            None,
        )
    faulty = next((word for word in common if _LIKE_A_NUMBER.match(word)), None)
    numeric = sum(number for word, number in words.items() if _LIKE_A_NUMBER.match(word))
    if faulty is None and count <= _MOST_WORDS * total:
        faulty = next((word for word in common if re.search(r"\d", word)), None)
    if faulty is not None and (numeric > _MOST_WORDS * count or count <= _MOST_WORDS * total):
        point = "" if decimal == "." else ", as in the first lines with a decimal comma"
        reason = (
            f"{faulty[:60]!r} in column {name[:60]!r} and {count - words[faulty]} other "
            f"cells of {total} that are no numbers"
        )
        return (
            None,
            "",
            LeftOut(place, reason, f"a number in every cell{point}, or an empty one", fault=faulty),
        )
    if count > _MOST_WORDS * total:
        return None, "", LeftOut(place, f"text in {count} of {total} cells ({shown})", REMEDY)
    values = {
        cell: float(cell.replace(decimal, ".")) if cell in filled and cell not in words else np.nan
        for cell in distinct
    }
    note = (
        f"column {name}: {count} of {total} cells are no numbers ({shown}) and are read as "
        f"missing samples"
    )
    return np.array([values[cell] for cell in cells]), note, None


def seconds_of(cells: np.ndarray, name: str, path: Path) -> tuple[np.ndarray, str]:
    """Return times of day [s] (from the start of the first day of the year), or seconds after the
    first date and that date.

    The last of four numbers is a part of a second where it has three digits or more, or exceeds 59
    somewhere; else they are day of the year, hours, minutes and seconds.
    """
    texts = [str(cell).strip() for cell in cells]
    first = next((text for text in texts if text), "")
    if _ISO.match(first):
        return _seconds_of_dates(texts, name, path)
    if not _DAY_TIME.match(first):
        return _seconds_after_dates(texts, name, path), ""
    four = [match for match in map(_PARTS_OF_A_SECOND.match, texts) if match]
    parts = any(len(match[4]) != 2 or int(match[4]) > 59 or int(match[2]) > 23 for match in four)
    seconds = np.full(len(texts), np.nan)
    for i, text in enumerate(texts):
        if not text:
            continue
        split = _PARTS_OF_A_SECOND.match(text) if parts else None
        match = _DAY_TIME.match(text)
        if split:
            day, (hours, minutes, whole, rest) = None, split.groups()
        elif match:
            day, hours, minutes, whole, rest = match.groups()
        else:
            raise ParseError(
                str(path),
                0,
                f"{text!r} in column {name!r}, row {i + 1} of the numbers",
                "hours:minutes:seconds in every line",
            )
        seconds[i] = (
            (int(day or 1) - 1) * 86400.0
            + int(hours) * 3600.0
            + int(minutes) * 60.0
            + float(f"{whole}.{rest or 0}")
        )
    return seconds, ""


def _seconds_after_dates(texts: list[str], name: str, path: Path) -> np.ndarray:
    """Return seconds of times of day behind dates whose order of day and month is not known, of 12
    hours with AM and PM, or of minutes and seconds alone. [s]

    A date is only compared with the one before it: where it changes, a day has passed.
    """
    seconds, day, before = np.full(len(texts), np.nan), 0, ""
    for i, text in enumerate(texts):
        if not text:
            continue
        short, match = _SHORT_TIME.match(text), _DATED.match(text)
        if short:
            seconds[i] = int(short[1]) * 60.0 + float(short[2].replace(",", "."))
            continue
        if match is None:
            raise ParseError(
                str(path),
                0,
                f"{text!r} in column {name!r}, row {i + 1} of the numbers",
                "a date and hours:minutes:seconds in every line",
            )
        date, hours, half = match[1] or "", int(match[2]), (match[5] or "").lower()
        if half:
            hours = hours % 12 + 12 * half.startswith("p")
        day, before = day + (bool(before) and date != before), date
        seconds[i] = (
            86400.0 * day
            + hours * 3600.0
            + int(match[3]) * 60.0
            + float(match[4].replace(",", "."))
        )
    return seconds


def _seconds_of_dates(texts: list[str], name: str, path: Path) -> tuple[np.ndarray, str]:

    # seconds end at 19 letters; a comma or a colon behind them begins their fraction
    plain: list[str] = [
        f"{text[:19]}.{text[20:]}" if text[19:20] in (",", ":") else text for text in texts
    ]
    try:
        stamps = pd.DatetimeIndex(pd.to_datetime(plain, utc=True, format="ISO8601"))
    except ValueError as error:
        raise ParseError(
            str(path),
            0,
            f"a date in column {name!r} that cannot be read ({error})",
            "ISO dates in every line",
        ) from error
    begin = stamps[stamps.notna()][0]
    return (stamps - begin).total_seconds().to_numpy(), begin.isoformat().replace("+00:00", "Z")

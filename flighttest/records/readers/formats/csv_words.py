"""Conversion of CSV cells that are not plain numbers: stamps, words, and damaged numbers.

A column of text is left out and named.  In a column of numbers, words such as ``INVALID`` or
``----`` are missing samples, which the notes count.  A cell with digits that is not a number, such
as ``1.2.3``, is a fault of the file if the name map needs its column.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from flightmech.errors import ParseError
from flighttest.records.readers.recording import LeftOut

# Hours, minutes and seconds; before them the day of the year, before it the year.
_DAY_TIME = re.compile(
    r"^(?:(?:\d{4}:)?(\d{1,3})[:\s])?(\d{1,2}):(\d{1,2}):(\d{1,2})(?:[.,:](\d+))?Z?$"
)
# Hours, minutes, seconds and a fraction; also day of the year, hours, minutes and seconds.
_FOUR_NUMBERS = re.compile(r"^(\d{1,2}):(\d{2}):(\d{2}):(\d+)$")
# Minutes and seconds, without hours.
_SHORT_TIME = re.compile(r"^(\d{1,3}):(\d{2}[.,]\d+)$")
# A date of any order before a time of day, AM or PM behind it.
_DATED = re.compile(
    r"^(?:(\d{1,4}[/.-]\d{1,2}[/.-]\d{1,4}),?[ "
    r"T]+)?(\d{1,2}):(\d{1,2}):(\d{1,2}(?:[.,]\d+)?)\s*([AaPp]\.?[Mm]\.?)?$"
)
_ISO = re.compile(r"^\d{4}-\d{2}-\d{2}([T ]\d{2}:\d{2}(:\d{2}([.,:]\d*)?)?)?(Z|[+-]\d{2}:?\d{2})?$")
_LIKE_A_NUMBER = re.compile(r"^[-+]?[\d.,' ]*\d[\d.,' eE+-]*$")
_MISSING = ("", "nan", "na", "n/a", "null", "none", "<na>", "-nan", "#n/a", "#na")
_TRUTH = {"true": 1.0, "false": 0.0}
# Share of the filled cells. A column with more words is text.
_MOST_WORDS = 0.5
# Words of a column that a message names.
_NAMED = 3
_DAY = 86400.0  # s
_HOUR = 3600.0  # s
REMEDY = (
    "map a column of numbers, replace the words by numbers in the file (UP and DOWN by 0 "
    "and 1), or take the channel out of the map"
)


def is_missing(cell: str) -> bool:
    """Return whether a cell states that it has no value."""
    return cell.lower() in _MISSING


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
    """Return the numbers of a column that also holds words.

    Parameters
    ----------
    cells : sequence of str
        Cells of the file.
    name : str
        Heading.
    place : str
        Table and heading, for the list of omitted columns.
    decimal : str
        Decimal mark.

    Returns
    -------
    numbers : array (time,) or None
        NaN for words and empty cells; None for a column of text.
    note : str
        Note on the words, empty for a column of text.
    left_out : LeftOut or None
        The column of text or the damaged column.
    """
    cell_counts = Counter(cells)
    filled = {cell: count for cell, count in cell_counts.items() if not is_missing(cell)}
    word_counts = {}
    for cell, count in filled.items():
        if not is_csv_number(cell, decimal):
            word_counts[cell] = count
    if word_counts and all(cell.lower() in _TRUTH for cell in filled):
        note = f"column {name}: TRUE and FALSE are read as 1 and 0"
        return np.array([_TRUTH.get(cell.lower(), np.nan) for cell in cells]), note, None

    total, count = sum(filled.values()), sum(word_counts.values())
    damaged = _damaged_cell(word_counts, total)
    if damaged is not None:
        mark = "" if decimal == "." else ", as in the first lines with a decimal comma"
        reason = (
            f"{damaged[:60]!r} in column {name[:60]!r} and {count - word_counts[damaged]} other "
            f"cells of {total} that are not numbers"
        )
        remedy = f"a number in every cell{mark}, or an empty one"
        return None, "", LeftOut(place, reason, remedy=remedy, fault=damaged)
    examples = _most_common_words(word_counts)
    if count > _MOST_WORDS * total:
        reason = f"text in {count} of {total} cells ({examples})"
        return None, "", LeftOut(place, reason, remedy=REMEDY)

    # Each distinct cell is converted once, because recorders repeat values.
    values = dict.fromkeys(cell_counts, np.nan)
    for cell in filled:
        if cell not in word_counts:
            values[cell] = float(cell.replace(decimal, "."))
    note = (
        f"column {name}: {count} of {total} cells are not numbers ({examples}) and are read as "
        f"missing samples"
    )
    if not count:
        # digits of another script, which float reads and pandas does not
        note = f"column {name}: numbers in digits of another script"
    return np.array([values[cell] for cell in cells]), note, None


def _by_frequency(word_counts: Mapping[str, int]) -> list[str]:
    """Return words, the most frequent first."""
    return sorted(word_counts, key=lambda word: -word_counts[word])


def _most_common_words(word_counts: Mapping[str, int]) -> str:
    """Return the most frequent words and their counts as text."""
    common = _by_frequency(word_counts)
    examples = ", ".join(f"{word[:40]!r} {word_counts[word]}" for word in common[:_NAMED])
    if len(common) > _NAMED:
        examples += f" and {len(common) - _NAMED} other words"
    return examples


def _damaged_cell(word_counts: Mapping[str, int], total: int) -> str | None:
    """Return the most frequent damaged number of a column, None if it has none."""
    common = _by_frequency(word_counts)
    # Cells such as 1.2.3 precede words with a digit.
    count = sum(word_counts.values())
    is_numeric = count <= _MOST_WORDS * total
    like_numbers = [word for word in common if _LIKE_A_NUMBER.match(word)]
    if like_numbers:
        # In a column of text, a few such cells among many words are text too.
        like_count = sum(word_counts[word] for word in like_numbers)
        if is_numeric or like_count > _MOST_WORDS * count:
            return like_numbers[0]
        return None
    if is_numeric:
        return next((word for word in common if re.search(r"\d", word)), None)
    return None


def seconds_of(cells: np.ndarray, name: str, path: Path) -> tuple[np.ndarray, str]:
    """Return the seconds of a column of stamps, and its first date or an empty text.

    Times of day count from the start of the first day of the year.  Dates count from the first
    date. [s]

    A stamp of four numbers is ambiguous.  The last number is a fraction of a second if it has three
    digits or more, or exceeds 59 in any row.  Otherwise the numbers are day of the year, hours,
    minutes and seconds.
    """
    texts = [str(cell).strip() for cell in cells]
    first = next((text for text in texts if text), "")
    if _ISO.match(first):
        return _seconds_of_iso_dates(texts, name, path)
    if not _DAY_TIME.match(first):
        return _seconds_of_dated_times(texts, name, path), ""

    has_fraction = _has_fraction_of_second(texts)
    seconds = np.full(len(texts), np.nan)
    for i, text in enumerate(texts):
        if not text:
            continue
        day: str | None
        fraction_match = _FOUR_NUMBERS.match(text) if has_fraction else None
        match = _DAY_TIME.match(text)
        if fraction_match:
            day = None
            hours, minutes, whole_seconds, fraction = fraction_match.groups()
        elif match:
            day, hours, minutes, whole_seconds, fraction = match.groups()
        else:
            raise _unreadable_stamp(
                text, name, i, path=path, expected="hours:minutes:seconds in every line"
            )
        seconds[i] = (
            (int(day or 1) - 1) * _DAY
            + int(hours) * _HOUR
            + int(minutes) * 60.0
            + float(f"{whole_seconds}.{fraction or 0}")
        )
    return seconds, ""


def _has_fraction_of_second(texts: Sequence[str]) -> bool:
    """Return whether the last of four numbers is a fraction of a second."""
    for text in texts:
        match = _FOUR_NUMBERS.match(text)
        if match and (len(match[4]) != 2 or int(match[4]) > 59 or int(match[2]) > 23):
            return True
    return False


def _unreadable_stamp(text: str, name: str, row: int, path: Path, expected: str) -> ParseError:
    """Return the error for a stamp of another form than the first stamp."""
    cell = f"{text!r} in column {name!r}, row {row + 1} of the numbers"
    return ParseError(str(path), 0, found=cell, expected=expected)


def _seconds_of_dated_times(texts: list[str], name: str, path: Path) -> np.ndarray:
    """Return the seconds of times of day behind dates, or of minutes and seconds alone. [s]

    The order of day and month in a date is not known.  A date is only compared with the date before
    it: a change means that a day has passed.
    """
    seconds = np.full(len(texts), np.nan)
    day, previous_date = 0, ""
    for i, text in enumerate(texts):
        if not text:
            continue
        short_match = _SHORT_TIME.match(text)
        if short_match:
            seconds[i] = int(short_match[1]) * 60.0 + float(short_match[2].replace(",", "."))
            continue
        match = _DATED.match(text)
        if match is None:
            expected = "a date and hours:minutes:seconds in every line"
            raise _unreadable_stamp(text, name, i, path=path, expected=expected)
        date, hours, half_of_day = match[1] or "", int(match[2]), (match[5] or "").lower()
        # 12 AM is hour 0, 12 PM is hour 12.
        if half_of_day:
            hours = hours % 12 + 12 * half_of_day.startswith("p")
        if previous_date and date != previous_date:
            day += 1
        previous_date = date
        seconds[i] = (
            _DAY * day + hours * _HOUR + int(match[3]) * 60.0 + float(match[4].replace(",", "."))
        )
    return seconds


def _seconds_of_iso_dates(texts: list[str], name: str, path: Path) -> tuple[np.ndarray, str]:
    """Return the seconds after the first date, and that date."""
    with_points = []
    for text in texts:
        # The seconds end at 19 characters.  pandas reads their fraction behind a point only.
        if text[19:20] in (",", ":"):
            text = f"{text[:19]}.{text[20:]}"
        with_points.append(text)
    stamps = pd.DatetimeIndex(
        pd.to_datetime(with_points, utc=True, format="ISO8601", errors="coerce")
    )
    for i in np.flatnonzero(stamps.isna()):
        if texts[i].lower() not in ("", "nan", "nat"):
            expected = "ISO dates in every line, of seconds from 0 to below 60"
            raise _unreadable_stamp(texts[i], name, int(i), path=path, expected=expected)
    start = stamps[stamps.notna()][0]
    start_text = start.isoformat().replace("+00:00", "Z")
    return (stamps - start).total_seconds().to_numpy(), start_text

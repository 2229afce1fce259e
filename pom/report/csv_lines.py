"""Fast writer of numeric columns as CSV lines.

Every number has the text of ``%.9g``.  Whole columns are written at once, which takes less than
half of the time of number by number.

A number is scaled to nine digits in front of the point and rounded there.  The product of two
doubles is not exact.  If it is too near to the middle of two integers, ``%.9g`` writes that number
itself, about one sample in a million.

Every number has a field of `_WIDTH` bytes in a template of the line.  The field holds all places
that a number may have.  A mask selects the places of each number.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

_DIGITS = 9
# Numbers down to 1e-4 are written without an exponent.
_ZEROS = 4
# Exponents of numbers whose power of ten is a double.
_LEAST, _LARGEST = -290, 290
# Least distance to the middle of two integers at which the rounding is certain.  It is six times
# the error of a product of nine digits.
_NEAR = 2e-6
# Lines of a block.  Its numbers stay in the cache of the processor.
_BLOCK = 512

# Places of a number in its field: sign, "0.000", digits before the point, point, digits after it,
# exponent.  The digits are in both groups; the mask selects each digit in one of them.
_SIGN, _ZERO, _BEFORE, _POINT, _AFTER, _EXPONENT, _WIDTH = 0, 1, 6, 15, 16, 25, 30
_FIELD = np.frombuffer(b"-0.000#########.#########e?000", np.uint8)

# Kinds of numbers: 0 to 12 are the exponents -4 to 8, which are not written.  Then come exponents
# of two digits, exponents of three digits, and the empty cell.
_WITH_EXPONENT = _ZEROS + _DIGITS
_EMPTY = _WITH_EXPONENT + 2


class _Tables(NamedTuple):
    """Look-up tables of the writer.

    ``powers`` has powers of ten by exponent, where a negative index counts from the end.
    ``digits`` has the four digits of 0 to 9999, and ``used`` their number without trailing zeros.
    ``masks`` has the written places by kind, number of digits and sign.
    """

    powers: np.ndarray
    digits: np.ndarray
    used: np.ndarray
    masks: np.ndarray


def csv_lines(columns: Sequence[np.ndarray]) -> Iterator[str]:
    """Yield the lines of columns in blocks of some hundred lines.

    Each line has its end.  NaN is an empty cell.

    Parameters
    ----------
    columns : sequence of array (line,)

    Examples
    --------
    >>> list(csv_lines([np.array([1.0, -0.5]), np.array([1e-9, np.nan])]))
    ['1,1e-09\\n-0.5,\\n']
    """
    varying: list[np.ndarray] = []
    # Text before the first varying column, and after each of them.  The text of a constant column
    # is formatted once.
    texts = [b""]
    for number, values in enumerate(columns, 1):
        end = b"\n" if number == len(columns) else b","
        if _is_constant(values):
            texts[-1] += _format_number(values[0]) + end
        else:
            varying.append(values)
            texts.append(end)
    if not varying:
        return iter([texts[0].decode("ascii") * len(columns[0])])
    return _format_blocks(varying, texts)


def _is_constant(values: np.ndarray) -> bool:
    """Return whether all samples are the same number to the bit."""
    bits = np.ascontiguousarray(values, float).view(np.int64)
    return bool(bits.size and (bits == bits[0]).all())


def _format_number(value: float) -> bytes:
    return b"" if np.isnan(value) else b"%.9g" % value


def _format_blocks(columns: Sequence[np.ndarray], texts: Sequence[bytes]) -> Iterator[str]:
    """Yield blocks of lines; ``texts`` has the text before the first column and after each."""
    # Place of the field of every column in a line.
    widths = [_WIDTH + len(text) for text in texts[1:-1]]
    starts = np.cumsum([len(texts[0]), *widths])
    fields = [_FIELD.tobytes() + text for text in texts[1:]]
    line = np.frombuffer(texts[0] + b"".join(fields), np.uint8)
    page = np.empty((min(_BLOCK, len(columns[0])), line.size), np.uint8)
    # The texts between the fields are always written.
    mask = np.ones(page.shape, bool)
    for start in range(0, len(columns[0]), _BLOCK):
        values = np.stack([column[start : start + _BLOCK] for column in columns])
        count = values.shape[1]
        page[:count] = line
        _fill_fields(page[:count], mask[:count], values, starts)
        written = np.compress(mask[:count].ravel(), page[:count].ravel())
        yield written.tobytes().decode("ascii")


def _fill_fields(
    page: np.ndarray, mask: np.ndarray, values: np.ndarray, starts: np.ndarray
) -> None:
    """Write numbers (column, line) into the fields of a page (line, place) and of its mask."""
    tables = _make_tables()
    digits, exponent, doubtful = _round_numbers(values, tables)
    # The nine digits are looked up in three groups: one, four and four digits.
    leading, high, low = digits // 100_000_000, digits // 10_000 % 10_000, digits % 10_000
    used = np.where(low, 5 + tables.used.take(low), 1 + tables.used.take(high))
    kind = np.where(
        (exponent >= -_ZEROS) & (exponent < _DIGITS),
        exponent + _ZEROS,
        _WITH_EXPONENT + (np.abs(exponent) > 99),
    )
    kind[np.isnan(values)] = _EMPTY
    # Flat index of the table (kind, digits, sign).
    number_masks = tables.masks.take((kind * (_DIGITS + 1) + used) * 2 + np.signbit(values))
    groups = (
        (0, (leading + ord("0")).astype(np.uint8)),
        (1, tables.digits.take(high)),
        (5, tables.digits.take(low)),
    )
    for column, start in enumerate(starts.tolist()):
        _view_places(mask, start, number_masks.dtype)[:] = number_masks[column]
        for offset, group in groups:
            _view_places(page, start + _BEFORE + offset, group.dtype)[:] = group[column]
            _view_places(page, start + _AFTER + offset, group.dtype)[:] = group[column]
    _fill_exponents(page, kind, exponent, starts)
    # These few numbers are formatted one by one, at the start of their fields.
    for column, row in zip(*np.nonzero(doubtful), strict=True):
        text, start = b"%.9g" % values[column, row], starts[column]
        page[row, start : start + len(text)] = np.frombuffer(text, np.uint8)
        mask[row, start : start + _WIDTH] = np.arange(_WIDTH) < len(text)


def _fill_exponents(
    page: np.ndarray, kind: np.ndarray, exponent: np.ndarray, starts: np.ndarray
) -> None:
    """Write sign and three digits of the exponents; the mask drops a first digit of zero."""
    columns, lines = np.nonzero((kind >= _WITH_EXPONENT) & (kind < _EMPTY))
    power, places = exponent[columns, lines], starts[columns] + _EXPONENT + 1
    page[lines, places] = np.where(power < 0, ord("-"), ord("+"))
    for offset, unit in enumerate((100, 10, 1), 1):
        page[lines, places + offset] = np.abs(power) // unit % 10 + ord("0")


def _view_places(page: np.ndarray, start: int, dtype: np.dtype) -> np.ndarray:
    """Return the places of every line from ``start`` as one item of several bytes each."""
    return np.ndarray(len(page), dtype, page, start, page.strides[:1])


def _round_numbers(
    values: np.ndarray, tables: _Tables
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return nine digits, the exponent of the first digit, and where the digits are not certain.

    The digits of zero, NaN, infinite numbers and numbers without a power of ten are zero, and so
    is their exponent.
    """
    size = np.abs(values)
    in_range = (size >= 10.0**_LEAST) & (size < 10.0**_LARGEST)
    size = np.where(in_range, size, 1.0)
    exponent = np.floor(np.log10(size)).astype(np.intp)
    scaled = size * tables.powers[_DIGITS - 1 - exponent]
    rounded = np.rint(scaled)
    near_tie = np.abs(np.abs(scaled - rounded) - 0.5) < _NEAR
    # 999999999.6 is rounded to ten digits: 1 with the next exponent.
    carries = rounded >= 10.0**_DIGITS
    exponent += carries
    digits = np.where(carries, 10 ** (_DIGITS - 1), rounded).astype(np.int32)
    digits[~in_range] = 0
    without_digits = ~in_range & (values != 0.0) & ~np.isnan(values)
    return digits, exponent, near_tie | without_digits


@cache
def _make_tables() -> _Tables:
    powers = np.ones(2 * _LARGEST + 2 * _DIGITS)
    for power in range(-_LARGEST - _DIGITS + 1, _LARGEST + _DIGITS):
        powers[power] = float(f"1e{power}")
    texts = [f"{number:04d}" for number in range(10_000)]
    digits = np.array(texts, "S4").view(np.uint32)
    used = np.array([len(text.rstrip("0")) for text in texts], np.uint8)
    # An empty cell has no places at all.
    masks = np.zeros((_EMPTY + 1, _DIGITS + 1, 2, _WIDTH), bool)
    for kind in range(_EMPTY):
        for count in range(1, _DIGITS + 1):
            masks[kind, count] = _number_mask(kind, count)
    masks[:_EMPTY, :, 1, _SIGN] = True
    return _Tables(powers, digits, used, masks.view(f"V{_WIDTH}").ravel())


def _number_mask(kind: int, count: int) -> np.ndarray:
    """Return the written places of a number of ``count`` digits, without its sign."""
    mask = np.zeros(_WIDTH, bool)
    exponent = kind - _ZEROS
    if exponent < 0:
        # 0.00ddd
        mask[_ZERO : _ZERO + 1 - exponent] = True
        mask[_BEFORE : _BEFORE + count] = True
        return mask
    # Digits before the point: d.ddde+00, or all up to the unit.
    before = 1 if kind >= _WITH_EXPONENT else exponent + 1
    mask[_BEFORE : _BEFORE + before] = True
    mask[_POINT] = count > before
    mask[_AFTER + before : _AFTER + max(count, before)] = True
    if kind >= _WITH_EXPONENT:
        # "e", sign and the last two digits; the first of three digits only if needed.
        mask[_EXPONENT : _EXPONENT + 2] = True
        mask[_EXPONENT + 2] = kind > _WITH_EXPONENT
        mask[_EXPONENT + 3 :] = True
    return mask

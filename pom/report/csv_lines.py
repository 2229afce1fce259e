"""Lines of a CSV file as ``%.9g`` writes every number, from whole columns in less than half of the time.

A number is brought to nine digits in front of the point and rounded there.  Where a product of two doubles does not show which way to
round, one sample in a million, ``%.9g`` itself writes it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

_DIGITS = 9
_ZEROS = 4  # smallest exponent below zero that is written without one
_LEAST, _LARGEST = -290, 290  # exponents of numbers whose power of ten is a double
_NEAR = 2e-6  # to the middle of two integers of nine digits: six times the error of the product that they come from
_BLOCK = 512  # lines whose numbers stay in the cache
# places of a number: sign, "0.000", digits before the point and after it, exponent
_SIGN, _ZERO, _WHOLE, _POINT, _REST, _EXPONENT, _WIDTH = 0, 1, 6, 15, 16, 25, 30
_PLACES = np.frombuffer(b"-0.000#########.#########e?000", np.uint8)
_WITH_EXPONENT, _EMPTY = _ZEROS + _DIGITS, _ZEROS + _DIGITS + 2  # kinds behind those of numbers without one; two and three digits


class _Tables(NamedTuple):
    """What is looked up: powers of ten by exponent, four digits of 0 to 9999 and how many to the last that is not zero, places written."""

    powers: np.ndarray
    digits: np.ndarray
    used: np.ndarray
    kept: np.ndarray


def csv_lines(columns: Sequence[np.ndarray]) -> Iterator[str]:
    """Give the lines of columns, some hundred at once, each with its end; a NaN is an empty cell.

    Parameters
    ----------
    columns : sequence of array (line,)

    Examples
    --------
    >>> list(csv_lines([np.array([1.0, -0.5]), np.array([1e-9, np.nan])]))
    ['1,1e-09\\n-0.5,\\n']
    """
    moving: list[np.ndarray] = []
    texts = [b""]  # before the first column that moves, and behind each; what does not move is written into the line once
    for number, values in enumerate(columns, 1):
        end = b"\n" if number == len(columns) else b","
        if _still(values):
            texts[-1] += _written(values[0]) + end
        else:
            moving.append(values)
            texts.append(end)
    return _blocks(moving, texts) if moving else iter([texts[0].decode("ascii") * len(columns[0])])


def _still(values: np.ndarray) -> bool:
    """Whether all samples are the same number to the bit."""
    bits = np.ascontiguousarray(values, float).view(np.int64)
    return bool(bits.size and (bits == bits[0]).all())


def _written(value: float) -> bytes:
    return b"" if np.isnan(value) else b"%.9g" % value


def _blocks(columns: Sequence[np.ndarray], texts: Sequence[bytes]) -> Iterator[str]:
    """Give the lines of columns, some hundred at once, with a text before the first column and one behind each."""
    first = np.cumsum([len(texts[0]), *(_WIDTH + len(text) for text in texts[1:-1])])  # place of every column in a line
    line = np.frombuffer(texts[0] + b"".join(_PLACES.tobytes() + text for text in texts[1:]), np.uint8)
    page = np.empty((min(_BLOCK, len(columns[0])), line.size), np.uint8)
    kept = np.ones(page.shape, bool)
    for start in range(0, len(columns[0]), _BLOCK):
        values = np.stack([column[start : start + _BLOCK] for column in columns])
        count = values.shape[1]
        page[:count] = line
        _fill(page[:count], kept[:count], values, first)
        yield np.compress(kept[:count].ravel(), page[:count].ravel()).tobytes().decode("ascii")


def _fill(page: np.ndarray, kept: np.ndarray, values: np.ndarray, first: np.ndarray) -> None:
    """Write numbers (column, line) into lines (line, place), and which places are kept, every column from its first place on."""
    tables = _tables()
    digits, exponent, doubtful = _rounded(values, tables)
    leading, high, low = digits // 100_000_000, digits // 10_000 % 10_000, digits % 10_000
    used = np.where(low, 5 + tables.used.take(low), 1 + tables.used.take(high))
    kind = np.where((exponent >= -_ZEROS) & (exponent < _DIGITS), exponent + _ZEROS, _WITH_EXPONENT + (np.abs(exponent) > 99))
    kind[np.isnan(values)] = _EMPTY
    written = tables.kept.take((kind * (_DIGITS + 1) + used) * 2 + np.signbit(values))
    groups = (0, (leading + ord("0")).astype(np.uint8)), (1, tables.digits.take(high)), (5, tables.digits.take(low))
    for column, at in enumerate(first.tolist()):
        _places(kept, at, written.dtype)[:] = written[column]
        for behind, group in groups:
            _places(page, at + _WHOLE + behind, group.dtype)[:] = _places(page, at + _REST + behind, group.dtype)[:] = group[column]
    found, lines = np.nonzero((kind >= _WITH_EXPONENT) & (kind < _EMPTY))
    power, places = exponent[found, lines], first[found] + _EXPONENT + 1
    page[lines, places] = np.where(power < 0, ord("-"), ord("+"))
    for place, unit in enumerate((100, 10, 1), 1):
        page[lines, places + place] = np.abs(power) // unit % 10 + ord("0")
    for column, row in zip(*np.nonzero(doubtful), strict=True):
        text, at = b"%.9g" % values[column, row], first[column]
        page[row, at : at + len(text)] = np.frombuffer(text, np.uint8)
        kept[row, at : at + _WIDTH] = np.arange(_WIDTH) < len(text)


def _places(page: np.ndarray, at: int, kind: np.dtype) -> np.ndarray:
    """Return places of every line, from one on, as one array of several bytes each."""
    return np.ndarray(len(page), kind, page, at, page.strides[:1])


def _rounded(values: np.ndarray, tables: _Tables) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return nine digits and the exponent of the first of them, and which numbers have to be written otherwise; a NaN is zero."""
    size = np.abs(values)
    known = (size >= 10.0**_LEAST) & (size < 10.0**_LARGEST)
    size = np.where(known, size, 1.0)
    exponent = np.floor(np.log10(size)).astype(np.intp)
    scaled = size * tables.powers[_DIGITS - 1 - exponent]  # a negative place counts from the end
    whole = np.rint(scaled)
    doubtful = np.abs(np.abs(scaled - whole) - 0.5) < _NEAR
    grown = whole >= 10.0**_DIGITS
    exponent += grown
    digits = np.where(grown, 10 ** (_DIGITS - 1), whole).astype(np.int32)
    digits[~known] = 0  # and the exponent is zero
    return digits, exponent, doubtful | (~known & (values != 0.0) & ~np.isnan(values))


@cache
def _tables() -> _Tables:
    powers = np.ones(2 * _LARGEST + 2 * _DIGITS)
    for power in range(-_LARGEST - _DIGITS + 1, _LARGEST + _DIGITS):
        powers[power] = float(f"1e{power}")
    texts = [f"{number:04d}" for number in range(10_000)]
    digits = np.array(texts, "S4").view(np.uint32)
    used = np.array([len(text.rstrip("0")) for text in texts], np.uint8)
    kept = np.zeros((_EMPTY + 1, _DIGITS + 1, 2, _WIDTH), bool)
    for kind in range(_EMPTY):
        for count in range(1, _DIGITS + 1):
            kept[kind, count] = _kept(kind, count)
    kept[:_EMPTY, :, 1, _SIGN] = True
    return _Tables(powers, digits, used, kept.view(f"V{_WIDTH}").ravel())


def _kept(kind: int, count: int) -> np.ndarray:
    """Return the places of a number of `count` digits that are written, without that of the sign."""
    kept = np.zeros(_WIDTH, bool)
    exponent = kind - _ZEROS
    if exponent < 0:
        kept[_ZERO : _ZERO + 1 - exponent] = kept[_WHOLE : _WHOLE + count] = True
        return kept
    whole = exponent + 1 if kind < _WITH_EXPONENT else 1
    kept[_WHOLE : _WHOLE + whole] = True
    kept[_POINT] = count > whole
    kept[_REST + whole : _REST + max(count, whole)] = True
    if kind >= _WITH_EXPONENT:
        kept[_EXPONENT : _EXPONENT + 2] = kept[_EXPONENT + 3 :] = True
        kept[_EXPONENT + 2] = kind > _WITH_EXPONENT  # a third digit of the exponent
    return kept

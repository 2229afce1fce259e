"""Decoding of ARINC 429 words to engineering values.

The bits of a word are counted from 1, the least significant: label in bits 1-8, source/destination
identifier (SDI) in 9-10, data in 11-29, sign and status matrix (SSM) in 30-31, parity in 32.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from flightmech.errors import UnknownName
from flighttest.records.readers.bus_words import Arinc429, Arinc429Label
from flighttest.records.readers.recording import RecordedTable

# Bytes with their bits in reverse order.
_REVERSED = np.array([int(f"{byte:08b}"[::-1], 2) for byte in range(256)], np.uint32)
# Sign and status matrix of valid words.  The matrix of decimal digits is their sign.
_NORMAL_BINARY, _NORMAL_DISCRETE = 0b11, 0b00
_PLUS, _MINUS = 0b00, 0b11


@dataclass(frozen=True)
class Words:
    """ARINC 429 words with their stamps [s] and, if known, their bus."""

    time: np.ndarray
    word: np.ndarray
    bus: np.ndarray | None = None


def label_values(word: np.ndarray, label: Arinc429Label) -> np.ndarray:
    """Return the engineering values of words of one label, NaN for words that are not valid.

    Parameters
    ----------
    word : array (time,) of uint32
        Words of one label, bit 1 least significant.
    label : Arinc429Label
        Coding of the parameter.

    Returns
    -------
    array (time,)
        In the unit of the label.
    """
    word = np.asarray(word, np.uint32)
    status = (word >> 29) & 0b11
    if label.code == "bnr":
        # Two's complement: sign in bit 29, most significant bit in bit 28.
        bits = int(label.bits or 0)
        count = ((word >> (28 - bits)) & ((1 << bits) - 1)).astype(float)
        count -= np.where((word >> 28) & 1, float(1 << bits), 0.0)
        values = count * (float(label.range or 0.0) / (1 << bits))
        return np.where(status == _NORMAL_BINARY, values, np.nan)
    if label.code == "bcd":
        digits, resolution = int(label.digits or 0), float(label.resolution or 0.0)
        return _decode_decimal(word, digits, resolution, status)
    discrete = ((word >> (int(label.bit or 1) - 1)) & 1).astype(float)
    return np.where(status == _NORMAL_DISCRETE, discrete, np.nan)


def _decode_decimal(
    word: np.ndarray, digits: int, resolution: float, status: np.ndarray
) -> np.ndarray:
    """Return the values of binary coded decimal words."""
    # The first digit has three bits below bit 29, further digits have four bits each.
    value = ((word >> 26) & 0b111).astype(float)
    is_valid = np.ones(len(word), bool)
    for i in range(1, digits):
        digit = (word >> (26 - 4 * i)) & 0b1111
        is_valid &= digit <= 9
        value = 10.0 * value + digit
    sign = np.select([status == _PLUS, status == _MINUS], [1.0, -1.0], np.nan)
    return np.where(is_valid, sign * value * resolution, np.nan)


def odd_parity(word: np.ndarray) -> np.ndarray:
    """Return which words have an odd number of ones."""
    word = np.asarray(word, np.uint32)
    # Fold the word to its lowest bit: each step adds the upper half to the lower one without carry.
    for shift in (16, 8, 4, 2, 1):
        word = word ^ (word >> shift)
    return (word & 1).astype(bool)


def label_tables(
    words: Words, spec: Arinc429, name: str
) -> tuple[dict[str, RecordedTable], list[str]]:
    """Return one table per parameter, ``name.parameter`` with the column ``value``, and notes.

    Raises
    ------
    UnknownName
        No word has a required label.  The error lists the labels of the words.
    """
    has_parity = odd_parity(words.word)
    is_of_bus = np.ones(len(words.word), bool)
    if spec.bus is not None and words.bus is not None:
        is_of_bus = words.bus == spec.bus
    is_used = has_parity & is_of_bus
    wrong_parity = int((~has_parity & is_of_bus).sum())

    time, word = words.time[is_used], words.word[is_used].astype(np.uint32)
    # Bits 1 to 8 are the label, bits 9 and 10 the source (SDI). A bus transmits the label with its
    # most significant bit first.
    labels = word & 0xFF
    if spec.labels == "transmitted":
        labels = _REVERSED[labels]
    sdi = (word >> 8) & 0b11
    _demand_labels(spec, labels, name)
    tables = {}
    for parameter, label in spec.parameters.items():
        has_label = labels == label.number
        if label.sdi is not None:
            has_label &= sdi == label.sdi
        values = label_values(word[has_label], label)
        tables[f"{name}.{parameter}"] = RecordedTable(
            {"value": values}, {"value": label.unit}, time[has_label]
        )
    notes = []
    if wrong_parity:
        notes.append(f"decode.{name}: {wrong_parity} words with wrong parity left out")
    return tables, notes


def _demand_labels(spec: Arinc429, labels: np.ndarray, name: str) -> None:
    """Raise if no word has the label of a parameter."""
    recorded = {int(label) for label in np.unique(labels)}
    for parameter, label in spec.parameters.items():
        if label.number in recorded:
            continue
        hint = f"decode.{name}.parameters.{parameter} requires it"
        if int(_REVERSED[label.number]) in recorded:
            opposite = "octal" if spec.labels == "transmitted" else "transmitted"
            hint = f'its byte is there turned round: try labels = "{opposite}"'
        raise UnknownName(
            f"{label.number:03o}",
            [f"{number:03o}" for number in sorted(recorded)],
            what="ARINC 429 label",
            hint=hint,
        )


def words_of_columns(
    tables: Mapping[str, RecordedTable],
    spec: Arinc429,
    time_of: Callable[[str], np.ndarray],
) -> Words:
    """Return the words of a column of a file, ``table/column``.

    `time_of` returns the stamps of a table. [s]
    """
    group, _, column = str(spec.column).rpartition("/")
    group = group or next(iter(tables))
    if group not in tables:
        raise UnknownName(
            group, tables, what="table", hint="column of [decode]: write table/column"
        )
    table = tables[group]
    if column not in table.columns:
        hint = f"[decode] requires it in table {group}"
        raise UnknownName(column, table.columns, what="column", hint=hint)
    values = np.asarray(table.columns[column], float)
    is_finite = np.isfinite(values)
    # Through int64, because a conversion of a negative float to an unsigned integer is undefined.
    word = values[is_finite].astype(np.int64).astype(np.uint32)
    return Words(np.asarray(time_of(group))[is_finite], word)

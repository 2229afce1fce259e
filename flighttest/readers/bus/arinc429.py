"""ARINC 429 words to engineering values: BNR, BCD and discretes, label by label.

A word has 32 bits: label 8-1, SDI 10-9, data 29-11 (in BNR bit 29 is the sign), SSM 31-30, odd parity 32.  Bit 1 is kept in the least
significant bit.  The label's most significant digit is sent first, so a word kept in the order of sending shows the label's byte reversed;
most interfaces turn it.  Words with wrong parity are left out; an SSM that does not state *normal operation* (BNR 11, discrete 00, BCD 00
for plus and 11 for minus) gives NaN.

References
----------
.. [ARINC429] ARINC Specification 429 Part 1-17, 2004, sections 2.1 (word formats) and attachment 6.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from flightmech.errors import UnknownName

from ..recording import Table
from .decode import Arinc429, Label

_REVERSED = np.array([int(f"{byte:08b}"[::-1], 2) for byte in range(256)], np.uint32)
_NORMAL = {"bnr": 0b11, "discrete": 0b00}


@dataclass(frozen=True)
class Words:
    """ARINC 429 words with their stamps [s] and, where known, the bus each came from."""

    time: np.ndarray
    word: np.ndarray
    bus: np.ndarray | None = None


def label_values(word: np.ndarray, label: Label) -> np.ndarray:
    """Return the engineering values of words that carry one label, NaN where the word states that it is not valid.

    Parameters
    ----------
    word : array (time,) of uint32
        Words of one label, bit 1 least significant.
    label : Label
        Coding of the parameter.

    Returns
    -------
    array (time,)
        In the unit of the label.
    """
    word = np.asarray(word, np.uint32)
    status = (word >> 29) & 0b11
    if label.code == "bnr":
        bits = int(label.bits or 0)
        count = ((word >> (28 - bits)) & ((1 << bits) - 1)).astype(float)
        count -= np.where((word >> 28) & 1, float(1 << bits), 0.0)
        return np.where(status == _NORMAL["bnr"], count * (float(label.range or 0.0) / (1 << bits)), np.nan)
    if label.code == "bcd":
        return _bcd(word, int(label.digits or 0), float(label.resolution or 0.0), status)
    return np.where(status == _NORMAL["discrete"], ((word >> (int(label.bit or 1) - 1)) & 1).astype(float), np.nan)


def _bcd(word: np.ndarray, digits: int, resolution: float, status: np.ndarray) -> np.ndarray:
    """Decimal digits from bit 29 down: the first has three bits, the others four."""
    value = ((word >> 26) & 0b111).astype(float)
    valid = np.ones(len(word), bool)
    for i in range(1, digits):
        digit = (word >> (26 - 4 * i)) & 0b1111
        valid &= digit <= 9
        value = 10.0 * value + digit
    sign = np.select([status == 0b00, status == 0b11], [1.0, -1.0], np.nan)
    return np.where(valid, sign * value * resolution, np.nan)


def odd_parity(word: np.ndarray) -> np.ndarray:
    """Return which words have an odd number of ones."""
    word = np.asarray(word, np.uint32)
    for shift in (16, 8, 4, 2, 1):
        word = word ^ (word >> shift)
    return (word & 1).astype(bool)


def label_tables(words: Words, spec: Arinc429, name: str) -> tuple[dict[str, Table], list[str]]:
    """Return one table per parameter, ``name.parameter`` with the column ``value``, and what was left out.

    Raises
    ------
    UnknownName
        Labels that no word carries, with those that are there.
    """
    keep = odd_parity(words.word)
    if spec.bus is not None and words.bus is not None:
        keep &= words.bus == spec.bus
        wrong = int((~odd_parity(words.word) & (words.bus == spec.bus)).sum())
    else:
        wrong = int((~keep).sum())
    time, word = words.time[keep], words.word[keep].astype(np.uint32)
    byte = word & 0xFF
    labels = _REVERSED[byte] if spec.labels == "transmitted" else byte
    sdi = (word >> 8) & 0b11
    _demand_labels(spec, labels, name)
    tables = {}
    for parameter, label in spec.parameters.items():
        mine = labels == label.number
        if label.sdi is not None:
            mine &= sdi == label.sdi
        tables[f"{name}.{parameter}"] = Table({"value": label_values(word[mine], label)}, {"value": label.unit}, time[mine])
    notes = [f"decode.{name}: {wrong} words with wrong parity left out"] if wrong else []
    return tables, notes


def _demand_labels(spec: Arinc429, labels: np.ndarray, name: str) -> None:
    there = {int(label) for label in np.unique(labels)}
    for parameter, label in spec.parameters.items():
        if label.number not in there:
            turned = int(_REVERSED[label.number]) in there
            other = "octal" if spec.labels == "transmitted" else "transmitted"
            hint = (
                f'its byte is there turned round: try labels = "{other}"' if turned else f"decode.{name}.parameters.{parameter} requires it"
            )
            raise UnknownName(f"{label.number:03o}", [f"{one:03o}" for one in sorted(there)], "ARINC 429 label", hint)


def words_of_columns(tables: Mapping[str, Table], spec: Arinc429, time_of) -> Words:
    """Return the words that a column of a file holds, ``table/column``; `time_of` gives the stamps of a table [s]."""
    group, _, column = str(spec.column).rpartition("/")
    group = group or next(iter(tables))
    if group not in tables:
        raise UnknownName(group, tables, "table", "column of [decode]: write table/column")
    table = tables[group]
    if column not in table.columns:
        raise UnknownName(column, table.columns, "column", f"[decode] requires it in table {group}")
    values = np.asarray(table.columns[column], float)
    good = np.isfinite(values)
    return Words(np.asarray(time_of(group))[good], values[good].astype(np.int64).astype(np.uint32))

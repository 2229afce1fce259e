"""Counts in words to engineering values."""

from __future__ import annotations

import numpy as np

from flightmech.errors import SchemaError


def join_words(words: list[np.ndarray], width: int) -> np.ndarray:
    """Return words (most significant first, `width` bits each) as one unsigned number of up to 64
    bits.
    """
    value = np.zeros(len(words[0]), np.uint64)
    for word in words:
        value = (value << np.uint64(width)) | word.astype(np.uint64)
    return value


def to_engineering_value(
    count: np.ndarray,
    width: int,
    code: str,
    lsb: float,
    offset: float,
    bits: tuple[int, int] | None = None,
) -> np.ndarray:
    """Return lsb * count + offset.

    Parameters
    ----------
    count : array (time,) of uint64
        Unsigned content of the word or words.
    width : int
        Bits in `count`.
    code : {"unsigned", "twos", "offset", "magnitude", "float"}
        Two's complement, offset binary (zero in the middle), sign and magnitude, or IEEE 754 of 32
        or 64 bits.
    lsb, offset : float
        Value of one count, and value at count zero.
    bits : (int, int), optional
        Lowest and highest bit taken, from 0.

    Raises
    ------
    SchemaError
        Floating point in another number of bits than 32 or 64.
    """
    if bits is not None:
        width = bits[1] - bits[0] + 1
        count = (count >> np.uint64(bits[0])) & np.uint64((1 << width) - 1)
    if code == "float":
        kind = {32: (np.uint32, np.float32), 64: (np.uint64, np.float64)}.get(width)
        if kind is None:
            raise SchemaError(
                "[decode] of the name map",
                [f"code 'float' on {width} bits; it has 32 or 64: name the words that hold it"],
            )
        number = count.astype(kind[0]).view(kind[1]).astype(float)
    elif code == "twos":
        negative = (count >> np.uint64(width - 1)) & np.uint64(1) > 0
        number = (
            count.astype(np.int64).astype(float)
            if width == 64
            else count.astype(float) - np.where(negative, 2.0**width, 0.0)
        )
    elif code == "offset":
        number = count.astype(float) - 2.0 ** (width - 1)
    elif code == "magnitude":
        negative = (count >> np.uint64(width - 1)) & np.uint64(1) > 0
        number = (count & np.uint64((1 << (width - 1)) - 1)).astype(float) * np.where(
            negative, -1.0, 1.0
        )
    else:
        number = count.astype(float)
    return lsb * number + offset

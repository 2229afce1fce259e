"""Conversion of counts in recorded words to engineering values."""

from __future__ import annotations

import numpy as np

from flightmech.errors import SchemaError

# Bits of a floating-point word: unsigned type of the same width, floating-point type.
_FLOAT_TYPES = {32: (np.uint32, np.float32), 64: (np.uint64, np.float64)}


def join_words(words: list[np.ndarray], width: int) -> np.ndarray:
    """Return words of `width` bits, most significant first, as one number of up to 64 bits."""
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
        Lowest and highest bit of the parameter in `count`, from 0.

    Raises
    ------
    SchemaError
        The code is floating point, and the word has another width than 32 or 64 bits.
    """
    # The parameter is a part of the word: shifted to bit 0, and the bits above it removed.
    if bits is not None:
        width = bits[1] - bits[0] + 1
        count = (count >> np.uint64(bits[0])) & np.uint64((1 << width) - 1)
    if code == "float":
        number = _float_of_bits(count, width)
    elif code == "twos":
        number = _twos_complement(count, width)
    elif code == "offset":
        number = count.astype(float) - 2.0 ** (width - 1)
    elif code == "magnitude":
        sign = np.where(_sign_bit(count, width), -1.0, 1.0)
        number = (count & np.uint64((1 << (width - 1)) - 1)).astype(float) * sign
    else:
        number = count.astype(float)
    return lsb * number + offset


def _sign_bit(count: np.ndarray, width: int) -> np.ndarray:
    """Return whether the highest of `width` bits is set."""
    return (count >> np.uint64(width - 1)) & np.uint64(1) > 0


def _float_of_bits(count: np.ndarray, width: int) -> np.ndarray:
    """Return the IEEE 754 numbers whose bits are stored in unsigned words."""
    kinds = _FLOAT_TYPES.get(width)
    if kinds is None:
        raise SchemaError(
            "[decode] of the name map",
            [f"code 'float' on {width} bits; it has 32 or 64: name the words that hold it"],
        )
    unsigned, floating = kinds
    return count.astype(unsigned).view(floating).astype(float)


def _twos_complement(count: np.ndarray, width: int) -> np.ndarray:
    """Return the signed values of two's complement numbers."""
    # In double precision, subtraction of 2^64 would lose the low bits of the count.
    # The 64 bits are reinterpreted as a signed integer instead.
    if width == 64:
        return count.astype(np.int64).astype(float)
    return count.astype(float) - np.where(_sign_bit(count, width), 2.0**width, 0.0)

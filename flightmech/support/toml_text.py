"""Parser of TOML texts with limits for damaged and malicious texts."""

from __future__ import annotations

import re
import tomllib
from typing import Any

MOST_CHARACTERS = 2**21
"""Greatest length of a TOML text. The name map of 5000 channels has a fifth of it."""

MOST_DEPTH = 100
"""Greatest depth of nested tables and arrays, and number of parts of a dotted key."""

# integers of TOML have 64 bits
_LARGEST = 2**63
# TOML allows control characters as escapes, but no name and no title has one
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]")
# one part of a dotted key
_PART = re.compile(r"\s*(?:[\w-]+|\"[^\"\n]*\"|'[^'\n]*')\s*")


def toml_content(text: str) -> dict[str, Any]:
    """Return the content of a TOML text.

    Raises
    ------
    ValueError
        A text that is not TOML (`tomllib.TOMLDecodeError`, with the line), more than
        `MOST_CHARACTERS` or `MOST_DEPTH`, an integer beyond 64 bits, or a control character, which
        could reach terminals and XML.
    """
    if len(text) > MOST_CHARACTERS:
        raise ValueError(f"{len(text)} characters, at most {MOST_CHARACTERS} are read")
    if _longest_key(text) > MOST_DEPTH:
        raise ValueError(f"a key of more than {MOST_DEPTH} parts")
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        # a ValueError with the line, so it is not handled below
        raise
    except RecursionError:
        raise ValueError(f"tables or arrays nested more than {MOST_DEPTH} deep") from None
    except ValueError:
        # int() limits the number of digits
        raise ValueError(
            "an integer of thousands of digits, beyond the 64 bits that TOML allows"
        ) from None
    _demand_ordinary(content)
    return content


def _longest_key(text: str) -> int:
    """Return the number of parts of the longest dotted key, 0 if all lines are short.

    The time of `tomllib` is proportional to the square of this number.
    """
    longest = 0
    for line in text.split("\n"):
        if line.count(".") < MOST_DEPTH:
            continue
        length = 0
        for part in line.split("."):
            length = length + 1 if _PART.fullmatch(part) else 0
            longest = max(longest, length)
    return longest


def _demand_ordinary(content: dict[str, Any]) -> None:
    """Raise for integers beyond 64 bits, control characters, and tables nested too deep."""
    # a stack of (item, its key, depth) instead of a recursion, which the depth could exceed
    stack: list[tuple[Any, str, int]] = [(content, "", 0)]
    while stack:
        item, key, depth = stack.pop()
        if isinstance(item, int) and not -_LARGEST <= item < _LARGEST:
            raise ValueError(
                f"an integer of {item.bit_length()} bits at {key}, beyond the 64 bits that "
                f"TOML allows"
            )
        if isinstance(item, str) and (match := _CONTROL.search(item)):
            raise ValueError(f"the control character {match[0]!r} at {key}")
        if depth > MOST_DEPTH:
            raise ValueError(f"tables or arrays nested more than {MOST_DEPTH} deep")
        if isinstance(item, dict):
            stack += [(name, f"the key {name!r}", depth) for name in item]
            prefix = f"{key}." if key else ""
            stack += [(value, f"{prefix}{name}", depth + 1) for name, value in item.items()]
        elif isinstance(item, list):
            stack += [(value, key, depth + 1) for value in item]

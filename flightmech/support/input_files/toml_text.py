"""TOML text of a user: its size, the depth of its tables and the size of its integers are limited, so that a hostile text costs little."""

from __future__ import annotations

import re
from itertools import groupby
from typing import Any

MOST_CHARACTERS = 2**21
"""Of a TOML text; the name map of 5000 channels has a fifth of it."""

MOST_DEPTH = 100
"""Tables and arrays inside each other, and parts of a dotted key."""

_LARGEST = 2**63
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]")  # TOML allows them as escapes; no name and no title has one
_PART = re.compile(r"\s*(?:[\w-]+|\"[^\"\n]*\"|'[^'\n]*')\s*")


def toml_content(text: str) -> dict[str, Any]:
    """Return the content of a TOML text.

    Raises
    ------
    ValueError
        `tomllib.TOMLDecodeError` with the line when the text is not TOML; else what goes beyond `MOST_CHARACTERS`, `MOST_DEPTH` or the
        64 bits that TOML gives an integer, and control characters, which reach terminals and XML.
    """
    import tomllib

    if len(text) > MOST_CHARACTERS:
        raise ValueError(f"{len(text)} characters, at most {MOST_CHARACTERS} are read")
    if _longest_key(text) > MOST_DEPTH:
        raise ValueError(f"a key of more than {MOST_DEPTH} parts")
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except RecursionError:
        raise ValueError(f"tables or arrays nested more than {MOST_DEPTH} deep") from None
    except ValueError:  # Python's limit of the digits of an integer
        raise ValueError("an integer of thousands of digits, beyond the 64 bits that TOML allows") from None
    _demand_ordinary(content)
    return content


def _longest_key(text: str) -> int:
    """Return how many parts the longest dotted key has, of long lines alone; the time of `tomllib` grows with its square."""
    lines = (line.split(".") for line in text.split("\n") if line.count(".") >= MOST_DEPTH)
    runs = (run for line in lines for run in groupby(line, lambda part: _PART.fullmatch(part) is not None))
    return max((sum(1 for _ in group) for is_part, group in runs if is_part), default=0)


def _demand_ordinary(content: dict[str, Any]) -> None:
    """Raise for integers beyond 64 bits, control characters, and tables nested too deep."""
    waiting: list[tuple[Any, str, int]] = [(content, "", 0)]
    while waiting:
        item, place, depth = waiting.pop()
        if isinstance(item, int) and not -_LARGEST <= item < _LARGEST:
            raise ValueError(f"an integer of {len(str(abs(item)))} digits at {place}, beyond the 64 bits that TOML allows")
        if isinstance(item, str) and (found := _CONTROL.search(item)):
            raise ValueError(f"the control character {found[0]!r} at {place}")
        if depth > MOST_DEPTH:
            raise ValueError(f"tables or arrays nested more than {MOST_DEPTH} deep")
        if isinstance(item, dict):
            waiting += [(key, f"the key {key!r}", depth) for key in item]
            waiting += [(part, f"{place}.{key}" if place else key, depth + 1) for key, part in item.items()]
        elif isinstance(item, list):
            waiting += [(part, place, depth + 1) for part in item]

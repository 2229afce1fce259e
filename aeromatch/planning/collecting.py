"""Problems collected from calls that raise them one by one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from flightmech.errors import AeromatchError, SchemaError

Result = TypeVar("Result")


def texts_of(error: Exception) -> list[str]:
    """Return the problems of an error, a line each."""
    if isinstance(error, SchemaError):
        return list(error.problems)
    if isinstance(error, OSError) and error.filename and error.strerror:
        return [f"{error.filename}: {error.strerror}"]
    return [str(error)]


def collect(problems: list[str], place: str, act: Callable[..., Result], *items: Any) -> Result | None:
    """Return ``act(*items)``; None if it raises an error of the package or of the disk, whose texts are added to `problems`."""
    try:
        return act(*items)
    except (AeromatchError, OSError) as error:
        problems += [f"{place}: {text}" if place else text for text in texts_of(error)]
        return None

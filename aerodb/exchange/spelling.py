"""Spelling of the options of an import in messages: keywords of Python, or options of the command.

One function serves Python and the command line, and its messages say what to do next.  A command
sets `command_spelling` around its work; without it messages have the keywords of the function.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_IS_COMMAND = ContextVar("_IS_COMMAND", default=False)


@contextmanager
def command_spelling() -> Iterator[None]:
    """Spell options as the command line does inside this context."""
    token = _IS_COMMAND.set(True)
    try:
        yield
    finally:
        _IS_COMMAND.reset(token)


def spell(keyword: str, option: str) -> str:
    """Return the keyword of a Python function, or the option of the command that is running."""
    return option if _IS_COMMAND.get() else keyword

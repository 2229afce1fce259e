"""Capture of the warnings of a call, separate for each thread."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from flightmech.errors import AeromatchWarning

_Value = TypeVar("_Value")


class _Hook:
    """An installed `showwarning`, with the state of the module `warnings` before it.

    Attributes
    ----------
    captures : int
        Captures that use the hook at this time, in all threads.
    show_others : callable
        Shows the warnings of threads without a capture.
    """

    def __init__(self, show: Callable[..., None]) -> None:
        self.captures = 0
        self.show_others = warnings.showwarning
        self._state = warnings.catch_warnings()
        self._state.__enter__()
        warnings.showwarning = show

    def remove(self) -> None:
        """Restore the state of the module `warnings`."""
        self._state.__exit__(None, None, None)


class _ThreadCaptures:
    """Captured warnings by thread.

    `warnings.catch_warnings` records for the whole process. Of two threads that use it at the same
    time, one receives the warnings of both, and the later end restores the list of a call that has
    ended. All further warnings of the process are then lost. Here one hook serves all threads, and
    it is removed after the last capture.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._of_thread = threading.local()
        # More than one hook if `catch_warnings` replaced the first one inside its block.
        self._hooks: list[_Hook] = []

    @contextmanager
    def record(self) -> Iterator[list[warnings.WarningMessage]]:
        """Yield the list that receives the warnings of this thread inside the block."""
        caught: list[warnings.WarningMessage] = []
        outer = getattr(self._of_thread, "caught", None)
        self._of_thread.caught = caught
        hook = self._use_hook()
        try:
            yield caught
        finally:
            self._release_hook(hook)
            self._of_thread.caught = outer

    def _use_hook(self) -> _Hook:
        with self._lock:
            if not self._hooks or warnings.showwarning != self._show:
                self._hooks.append(_Hook(self._show))
            hook = self._hooks[-1]
            hook.captures += 1
            # By default Python shows a repeated warning only once per process.
            warnings.simplefilter("always", AeromatchWarning)
        return hook

    def _release_hook(self, hook: _Hook) -> None:
        with self._lock:
            hook.captures -= 1
            if not hook.captures:
                self._hooks.remove(hook)
                hook.remove()

    def _show(
        self,
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: Any = None,
        line: str | None = None,
    ) -> None:
        """Store a warning for the capture of this thread, or show it as without a capture."""
        caught = getattr(self._of_thread, "caught", None)
        if caught is not None:
            caught.append(
                warnings.WarningMessage(message, category, filename, lineno, file=file, line=line)
            )
            return
        with self._lock:
            show = self._hooks[-1].show_others if self._hooks else _DEFAULT_SHOW
        show(message, category, filename, lineno, file=file, line=line)


_DEFAULT_SHOW = warnings.showwarning
_captures = _ThreadCaptures()


def capture_warnings(function: Callable[..., _Value], *arguments: Any) -> tuple[_Value, list[str]]:
    """Return the result of a call, and the texts of its `AeromatchWarning`, each once.

    Other warnings are issued again. If the call raises, all warnings are issued again. Warnings of
    other threads do not count.
    """
    caught: list[warnings.WarningMessage] = []
    texts: list[str] = []
    try:
        with _captures.record() as caught:
            value = function(*arguments)
        messages = [str(w.message) for w in caught if issubclass(w.category, AeromatchWarning)]
        texts = list(dict.fromkeys(messages))
    finally:
        for warning in caught:
            if str(warning.message) not in texts:
                warnings.warn_explicit(
                    warning.message,
                    category=warning.category,
                    filename=warning.filename,
                    lineno=warning.lineno,
                )
    return value, texts

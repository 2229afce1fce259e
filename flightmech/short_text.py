"""Text of a result for the prompt of Python: at most 25 lines, whatever the result holds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

MOST_LINES = 25
"""Lines of the text of an object."""
# Columns of one line, and names that a line lists.
_WIDTH, _MOST_NAMES = 110, 6


class ShortText:
    """Base of a class whose text at the prompt is short, and whose `print` is its report.

    A class with a method ``report()`` shows the beginning of the report.  Another dataclass shows a
    line for each field that holds something: numbers and words as they are, arrays and tables by
    their size and names.
    """

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        # dataclass writes a __repr__ of all values unless the class has one itself
        if "__repr__" not in vars(cls):
            cls.__repr__ = ShortText.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        try:
            lines = _report_lines(self)
        except Exception:
            # A debugger shows objects whose report fails: their fields are shown instead.
            lines = []
        if not lines:
            return describe_fields(self)
        return shorten_lines([f"<{type(self).__name__}>", *lines], "print it for all")

    def __str__(self) -> str:
        return "\n".join(_report_lines(self)) or describe_fields(self)


def _report_lines(item: Any) -> list[str]:
    """Return the lines of the report of an object, an empty list without one."""
    report = getattr(item, "report", None)
    if report is None:
        return []
    return str(report()).splitlines()


def without_middle(text: str, most: int) -> str:
    """Return a text; if it has more than `most` characters, its beginning and its end.

    Examples
    --------
    >>> without_middle("channel", 7)
    'channel'
    >>> without_middle("channel", 4)
    'ch ... (3 characters left out) ... el'
    """
    if len(text) <= most:
        return text
    half = most // 2
    return f"{text[:half]} ... ({len(text) - 2 * half} characters left out) ... {text[-half:]}"


def shorten_lines(lines: Iterable[str], remedy: str) -> str:
    """Return at most `MOST_LINES` lines; the last one counts those that are left out."""
    complete = list(lines)
    if len(complete) <= MOST_LINES:
        return "\n".join(complete)
    kept = complete[: MOST_LINES - 1]
    return "\n".join([*kept, f"... {len(complete) - len(kept)} more lines; {remedy}"])


def describe_fields(item: Any, units: Mapping[str, str] | None = None) -> str:
    """Return class and fields of a dataclass as text.

    Parameters
    ----------
    item : dataclass
    units : mapping of str to str, optional
        Units of fields, which stand behind their values.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass
    ... class Wing:
    ...     S: float
    ...     stations: tuple[float, ...]
    ...     twist: float | None = None
    >>> print(describe_fields(Wing(16.2, (0.0, 5.4)), {"S": "m2"}))
    <Wing>
      S         16.2 m2
      stations  (0.0, 5.4)
    """
    units = units or {}
    rows: list[tuple[str, str]] = []
    for entry in fields(item):
        # An object that is not complete yet lacks some fields.
        value = getattr(item, entry.name, None)
        if entry.name.startswith("_") or not entry.repr or _is_empty(value):
            continue
        text = describe_value(value)
        if entry.name in units:
            text = f"{text} {units[entry.name]}"
        rows.append((entry.name, text))
    width = max((len(name) for name, _ in rows), default=0)
    lines = [f"<{type(item).__name__}>"]
    for name, text in rows:
        lines.append(_cut(f"  {name:{width}}  {text}"))
    return shorten_lines(lines, "read its fields for all")


def _is_empty(value: Any) -> bool:
    if value is None:
        return True
    return isinstance(value, str | tuple | list | Mapping | set) and len(value) == 0


def describe_value(value: Any) -> str:
    """Return one line for a value: what it is where it is short, else its size and names."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if hasattr(value, "data_vars") and hasattr(value, "sizes"):
        sizes = ", ".join(f"{name}: {size}" for name, size in value.sizes.items())
        return f"Dataset ({sizes}) with {_names(value.data_vars)}"
    if hasattr(value, "children") and hasattr(value, "to_dict"):
        return f"DataTree with {_names(value.children)}"
    if hasattr(value, "columns") and hasattr(value, "iterrows"):
        return f"DataFrame of {len(value)} rows with {_names(value.columns)}"
    if hasattr(value, "dtype") and getattr(value, "ndim", 0) > 0:
        shape = ", ".join(map(str, value.shape))
        return f"array ({shape})"
    if isinstance(value, bytes):
        return f"{len(value)} bytes"
    if is_dataclass(value):
        return _describe_object(value)
    if isinstance(value, Mapping):
        return _describe_mapping(value)
    if isinstance(value, tuple | list):
        return _describe_items(value)
    return _cut(" ".join(repr(value).split()))


def _describe_object(value: Any) -> str:
    title = getattr(value, "name", "") or getattr(value, "title", "")
    return f"{type(value).__name__} {title}".strip()


def _describe_items(items: tuple[Any, ...] | list[Any]) -> str:
    if all(isinstance(item, str | int | float) for item in items):
        text = repr(items)
        if len(text) <= _WIDTH // 2:
            return text
    shown = [describe_value(item) for item in items[:_MOST_NAMES]]
    more = ", ..." if len(items) > len(shown) else ""
    return f"{len(items)}: {', '.join(shown)}{more}"


def _describe_mapping(items: Mapping[Any, Any]) -> str:
    if all(isinstance(value, str | int | float) for value in items.values()):
        text = ", ".join(f"{name} {describe_value(value)}" for name, value in items.items())
        if len(text) <= _WIDTH // 2:
            return text
    return _names(items)


def _names(names: Iterable[Any]) -> str:
    """Return the number of names and the first of them."""
    known = [str(name) for name in names]
    more = ", ..." if len(known) > _MOST_NAMES else ""
    return f"{len(known)}: {', '.join(known[:_MOST_NAMES])}{more}"


def _cut(text: str) -> str:
    return text if len(text) <= _WIDTH else f"{text[: _WIDTH - 4]} ..."

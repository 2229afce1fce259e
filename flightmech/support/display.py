"""How results show themselves in a notebook: tables in HTML, figures of matplotlib, values in the units of the field."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import AeromatchError, UnknownName
from ..names import lookup
from ..units import from_si

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def html_table(caption: str, columns: Sequence[str], rows: Iterable[Sequence[Any]], notes: Sequence[str] = ()) -> str:
    """Return a table in HTML, for ``_repr_html_``.

    Parameters
    ----------
    caption : str
        Stands above the table.
    columns : sequence of str
    rows : iterable of sequences
        Numbers are shown with five significant digits, all else as text.
    notes : sequence of str
        Paragraphs below the table.
    """
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    body = "".join("<tr>" + "".join(map(_cell, row)) + "</tr>" for row in rows)
    below = "".join(f"<p>{escape(note)}</p>" for note in notes)
    return f"<div><p><b>{escape(caption)}</b></p><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{below}</div>"


def _cell(item: Any) -> str:
    if isinstance(item, float | np.floating):
        return f'<td style="text-align: right">{item:.5g}</td>'
    return f'<td style="text-align: left">{escape(str(item))}</td>'


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of matplotlib that no window or notebook keeps. [in]

    Raises
    ------
    AeromatchError
        matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as missing:
        raise AeromatchError("figures need matplotlib, which is not installed; run: pip install 'aeromatch[figures]'") from missing
    return Figure(figsize=(width, height), layout="constrained")


def displayed(name: str, values: np.ndarray) -> tuple[np.ndarray, str]:
    """Return values of a quantity of the vocabulary in its display unit, and the unit; others as they are."""
    try:
        unit = lookup(name).display_units
    except UnknownName:
        return values, ""
    return from_si(values, unit), unit

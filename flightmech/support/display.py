"""How results show themselves in a notebook: tables in HTML, figures of matplotlib, values in the units of the field."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import AeromatchError, SchemaError, UnknownName
from ..names import lookup
from ..units import from_si
from .atomic_write import written_atomically

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES = ("png", "svg", "pdf")
"""Formats of figures."""


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


def demand_drawable(target: str | os.PathLike[str]) -> str:
    """Return the format of a figure by the ending of its file.

    Raises
    ------
    SchemaError
        A format that is not drawn.
    """
    target = Path(target)
    kind = target.suffix.lstrip(".").lower()
    if kind not in FIGURES:
        raise SchemaError("figure", [f"{target.name}: ending {kind or 'missing'!r}; give one of {', '.join(FIGURES)}"])
    return kind


def save_figure(figure: Figure, target: str | os.PathLike[str], dpi: int = 130) -> None:
    """Write a figure atomically in the format that the ending of the file names; errors as `demand_drawable`."""
    kind = demand_drawable(target)
    with written_atomically(target) as part:
        figure.savefig(part, dpi=dpi, format=kind)


def displayed(name: str, values: np.ndarray) -> tuple[np.ndarray, str]:
    """Return values of a quantity of the vocabulary in its display unit, and the unit; others as they are."""
    try:
        unit = lookup(name).display_units
    except UnknownName:
        return values, ""
    return from_si(values, unit), unit

"""Common parts of the figures of databases: line code, sheet, notes, files with repeatable bytes.

matplotlib is an extra of the installation.  Only this module imports it, and the other modules
import its names from this module.
"""

from __future__ import annotations

import os
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from aerodb.figures.symbols import number_text
from flightmech.errors import AeromatchError, SchemaError
from flightmech.support.atomic_write import written_atomically
from flightmech.terms import SOURCES

try:
    import matplotlib
except ModuleNotFoundError as missing:
    raise AeromatchError(
        "figures need matplotlib, which is not installed; run: pip install 'aeromatch[figures]'"
    ) from missing

from matplotlib import colormaps as colormaps
from matplotlib import style
from matplotlib.axes import Axes as Axes
from matplotlib.figure import Figure as Figure
from matplotlib.lines import Line2D as Line2D
from matplotlib.patches import Patch as Patch
from matplotlib.ticker import MaxNLocator as MaxNLocator

WIDTH = 7.48  # text width of A4 [in]
LEFT, RIGHT = 0.72, 0.10  # margins [in]
FORMATS = ("svg", "png", "pdf")
_STYLE: dict[str, Any] = {
    "font.size": 7.0,
    "axes.titlesize": 7.5,
    "axes.labelsize": 8.0,
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-4, 6),
    "grid.color": "#d9d9d9",
    "grid.linewidth": 0.4,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.major.width": 0.5,
    "ytick.major.width": 0.5,
    "lines.markersize": 3.2,
    "hatch.linewidth": 0.4,
    "savefig.dpi": 200,
    "svg.hashsalt": "aeromatch",
    "svg.fonttype": "path",
}
# Notes at the foot: size [pt], height of a line [in], characters in a line.
FOOT_SIZE, FOOT_LINE, FOOT_CHARACTERS = 6.2, 0.115, 165


class Pen(NamedTuple):
    """Line code of one database."""

    color: str
    dashes: Any
    width: float


# Line code of LR-743 Figs. 18 to 21, without a flight trace: the first database, a priori, is
# dotted, those between are dashed, the last one is solid.
_FIRST, _LAST = Pen("#6e6e6e", (0, (1.2, 1.2)), 1.3), Pen("#0072b2", "-", 1.0)
_BETWEEN = (
    Pen("#8a5a00", (0, (4.5, 2)), 1.0),
    Pen("#00664b", (0, (6, 1.5, 1.2, 1.5)), 1.0),
    Pen("#000000", (0, (2.5, 1)), 0.8),
)
# Marks of nodes by source: open for DATCOM, filled for flight, a cross for the judgement of an
# engineer, an open square for another estimate, a point if the source is not stated.
MARKS: dict[int, dict[str, Any]] = {
    0: {"marker": "o", "markerfacecolor": "white"},
    1: {"marker": "o"},
    2: {"marker": "x"},
    3: {"marker": "s", "markerfacecolor": "white"},
    -1: {"marker": "."},
}


def database_pens(names: Sequence[str]) -> dict[str, Pen]:
    """Return the line code of databases in order: dotted, dashed ..., solid; one alone is solid."""
    if len(names) == 1:
        return {names[0]: _LAST}
    between = [_BETWEEN[i % len(_BETWEEN)] for i in range(len(names) - 2)]
    return dict(zip(names, [_FIRST, *between, _LAST], strict=False))


@contextmanager
def drawing_style() -> Any:
    """Draw in the style of this package, independent of the settings of the user."""
    with style.context(["default", _STYLE]):
        yield


class FigureSheet:
    """A figure with positions in inches from its upper left corner."""

    def __init__(self, height: float):
        self.height = height
        self.figure = Figure(figsize=(WIDTH, height), facecolor="white")

    def panel(self, left: float, top: float, width: float, height: float) -> Axes:
        """Return new axes. [in]"""
        # matplotlib counts in shares of the figure, from its lower left corner.
        bottom = 1.0 - (top + height) / self.height
        return self.figure.add_axes((left / WIDTH, bottom, width / WIDTH, height / self.height))

    def text(self, left: float, top: float, words: str, **looks: Any) -> None:
        """Write words with their upper left corner at a position. [in]"""
        self.figure.text(left / WIDTH, 1.0 - top / self.height, words, va="top", **looks)

    def head(self, title: str, lines: Iterable[str]) -> None:
        """Write the title and lines under it."""
        self.text(0.08, 0.08, title, fontsize=9.5, fontweight="bold")
        for i, line in enumerate(lines):
            self.text(0.08, 0.29 + 0.15 * i, line, fontsize=7.5)

    def key(self, handles: Sequence[Any], top: float) -> None:
        """Draw the legend in one row below the head."""
        self.figure.legend(
            handles=list(handles),
            loc="upper left",
            bbox_to_anchor=(0.0, 1.0 - top / self.height),
            ncols=len(handles),
            frameon=False,
            fontsize=7,
            handlelength=2.1,
            handletextpad=0.5,
            columnspacing=1.1,
            borderaxespad=0.2,
        )

    def foot(self, lines: Sequence[str]) -> None:
        """Write notes at the foot of the sheet, as `foot_height` counted them."""
        top = self.height - FOOT_LINE * len(lines) - 0.05
        for i, line in enumerate(lines):
            self.text(0.08, top + FOOT_LINE * i, line, fontsize=FOOT_SIZE, color="#333333")


def foot_lines(notes: Iterable[str]) -> list[str]:
    """Return notes as lines of the width of the sheet."""
    lines: list[str] = []
    for note in notes:
        lines += textwrap.wrap(note, FOOT_CHARACTERS, break_long_words=False)
    return lines


def foot_height(lines: Sequence[str]) -> float:
    """Return the height of the lines of notes. [in]"""
    return FOOT_LINE * len(lines) + 0.1


def reference_notes(databases: Mapping[str, xr.DataTree]) -> list[str]:
    """Return reference area, lengths, moment point and axes as notes, equal ones only once."""
    texts: dict[str, list[str]] = {}
    for name, db in databases.items():
        root = db.attrs
        point = ", ".join(number_text(float(root[key])) for key in ("x_ref", "y_ref", "z_ref"))
        text = (
            f"S = {number_text(root['S'])} m², cbar = {number_text(root['cbar'])} m, b = "
            f"{number_text(root['b'])} m; moments about ({point}) m from the drawing "
            f"datum (x forward, y right, z down); forces in {root['force_axes']} axes, moments "
            f"and rates in body axes."
        )
        texts.setdefault(text, []).append(name)
    if len(texts) == 1:
        return [f"Reference: {next(iter(texts))}"]
    return [f"Reference of {', '.join(names)}: {text}" for text, names in texts.items()]


def database_handles(code: Mapping[str, Pen]) -> list[Line2D]:
    """Return the legend of the databases."""
    return [
        Line2D([], [], color=pen.color, linestyle=pen.dashes, linewidth=pen.width, label=name)
        for name, pen in code.items()
    ]


def source_handles(codes: Iterable[int]) -> list[Line2D]:
    """Return the legend of the sources of nodes."""
    words = {**dict(enumerate(SOURCES)), -1: "source not stated"}
    return [
        Line2D([], [], color="black", linestyle="none", label=f"node: {words[code]}", **MARKS[code])
        for code in sorted(codes)
    ]


def band_handle(color: str, label: str) -> Patch:
    """Return the legend of a band."""
    return Patch(facecolor=color, alpha=0.25, linewidth=0, label=label)


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a figure to a file, atomically; equal figures give equal bytes.

    Parameters
    ----------
    figure : matplotlib Figure
        From `plot_term`, `plot_comparison` or `plot_difference`.
    path : path
        The file.  Its suffix determines the format: ``.svg``, ``.png`` (200 dots per inch) or
        ``.pdf``.

    Raises
    ------
    SchemaError
        The suffix is not allowed.
    """
    kind = Path(path).suffix.lower().lstrip(".")
    if kind not in FORMATS:
        allowed = ", ".join(f".{name}" for name in FORMATS)
        raise SchemaError(str(path), [f"the suffix is {Path(path).suffix!r}; allowed: {allowed}"])
    # Without dates, and with a fixed salt of the identifiers, the bytes repeat.
    title = figure.get_label() or "figure"
    metadata: dict[str, dict[str, Any]] = {
        "svg": {"Date": None, "Creator": "aeromatch", "Title": title},
        "png": {"Software": "aeromatch", "Title": title},
        "pdf": {
            "CreationDate": None,
            "Creator": "aeromatch",
            "Producer": f"matplotlib {matplotlib.__version__}",
            "Title": title,
        },
    }
    with drawing_style(), written_atomically(path) as part:
        figure.savefig(part, format=kind, metadata=metadata[kind])


def axis_limits(values: Iterable[np.ndarray], zero: bool = False) -> tuple[float, float]:
    """Return the limits of an axis that shows all finite values, and zero if `zero`."""
    parts = [np.zeros(int(zero))]
    for item in values:
        flat = np.ravel(item)
        parts.append(flat[np.isfinite(flat)])
    finite = np.concatenate(parts)
    low, high = 0.0, 1.0
    if len(finite):
        low, high = float(finite.min()), float(finite.max())
    # A constant has no range, so its size or 1 determines the margin.
    margin = 0.06 * (high - low) or 0.1 * abs(high) or 1.0
    return low - margin, high + margin

"""Columns of numbers from the lines of a CSV file below its heading.

pandas parses the lines, of large files in several threads.
"""

from __future__ import annotations

import io
import os
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

# Bytes of a part that repays a thread.
_CHUNK = 8_000_000
_MOST_THREADS = 8
# Bytes that decide first whether a part may be blank.
_BLANK_LOOK = 4096


class Layout(NamedTuple):
    """Layout of the lines of a CSV file.

    Attributes
    ----------
    heads : list of str
        Names of the columns from left to right.
    separator : str
        Separator of the columns; a space means any number of blanks.
    decimal : str
        Decimal mark.
    """

    heads: list[str]
    separator: str
    decimal: str


def parse_columns(
    raw: bytes, begin: int, layout: Layout, as_text: set[str]
) -> dict[str, Any] | None:
    """Return the columns of all lines, None if a cell or a line does not fit.

    Parameters
    ----------
    raw : bytes
        Content of the file, with line feeds.
    begin : int
        First byte below the heading.
    layout : Layout
    as_text : set of str
        Columns of text.
    """
    size = len(raw) - begin
    parts = max(1, min(os.cpu_count() or 1, _MOST_THREADS, size // _CHUNK))
    spans = _split_at_lines(raw, begin, parts)
    heads = layout.heads
    if not spans:
        return {head: np.zeros(0) for head in heads}
    with ThreadPoolExecutor(len(spans)) as pool:
        jobs = [pool.submit(parse_frame, raw[a:b], layout, as_text) for a, b in spans]
        frames = []
        for job in jobs:
            frame = job.result()
            if frame is None:
                return None
            frames.append(frame)
    if len(frames) == 1:
        return {head: frames[0][head].to_numpy() for head in heads}
    columns = {}
    for head in heads:
        columns[head] = np.concatenate([frame[head].to_numpy() for frame in frames])
    return columns


def _split_at_lines(raw: bytes, begin: int, parts: int) -> list[tuple[int, int]]:
    """Return the byte ranges of about equal parts that end at line feeds, without blank parts."""
    cuts = [begin]
    for i in range(1, parts):
        cut = raw.find(b"\n", begin + i * (len(raw) - begin) // parts) + 1
        if cut:
            cuts.append(max(cut, cuts[-1]))
        else:
            cuts.append(len(raw))
    spans = []
    for a, b in pairwise([*cuts, len(raw)]):
        # The start of a part is tested first, because a copy of the whole part is expensive.
        is_blank = raw[a : a + _BLANK_LOOK].isspace() and raw[a:b].isspace()
        if a < b and not is_blank:
            spans.append((a, b))
    return spans


def parse_frame(
    piece: bytes, layout: Layout, as_text: set[str], guess: bool = False
) -> pd.DataFrame | None:
    """Return the lines as a frame, None if a line does not fit.

    With `guess`, pandas chooses the type of each column.
    """
    heads, separator = layout.heads, layout.separator
    types: Any = None
    if not guess:
        types = dict.fromkeys(heads, np.float64)
        types.update((head, str) for head in heads if head in as_text)
    has_blanks = separator != " " and (
        piece.startswith(b" ") or b"\n " in piece or f"{separator} ".encode() in piece
    )
    try:
        frame = pd.read_csv(
            io.BytesIO(piece),
            sep=r"\s+" if separator == " " else separator,
            comment="#" if b"#" in piece else None,
            skipinitialspace=has_blanks,
            names=heads,
            header=None,
            dtype=types,
            decimal=layout.decimal,
            encoding_errors="replace",
            low_memory=False,
        )
        for head in as_text:
            frame[head] = frame[head].fillna("")
    except (ValueError, IndexError, pd.errors.ParserError):
        return None
    # pandas makes an index of the first cells of lines that are longer than the heading.
    if not isinstance(frame.index, pd.RangeIndex):
        return None

    # pandas fills short lines with NaN without an error.  The number of separators shows them,
    # unless quotes or comments hold separators too.
    can_count = separator != " " and b'"' not in piece and b"#" not in piece
    if can_count and piece.count(separator.encode()) != len(frame) * (len(heads) - 1):
        return None
    return frame


def columns_with_words(piece: bytes, layout: Layout, as_text: set[str]) -> set[str]:
    """Return the columns that hold other cells than numbers and empty ones."""
    frame = parse_frame(piece, layout, as_text, guess=True)
    if frame is None:
        return set()
    columns = set()
    for head in layout.heads:
        if head not in as_text and frame[head].dtype.kind not in "fiu":
            columns.add(head)
    return columns

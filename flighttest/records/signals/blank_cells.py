"""Channels that are slower than the rows of their table: blanks between samples are not missing
samples.

A recorder that writes channels of several clocks into one table leaves the cells of a slower one
blank between its samples, in a regular pattern.  Blanks without a pattern are dropouts.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

_FEWEST = 3  # samples that show a pattern
_EVEN = 0.35  # of the median step: what a step of an even clock may deviate
_MANY = 10  # steps that an even clock with jitter needs; of fewer ones each must fit the rows
_SHORT = 3  # rows of a step that chance hits often
_REGULAR = 0.9  # share of the steps that are even
_BETWEEN = 0.5  # share of the blanks that lie between samples of an even clock, and not in its gaps
_BLANKS = 10  # of a channel that lacks every fifth row or fewer
_ALIKE = 0.9  # share of samples that channels of one clock have in common


def clocks_of_rows(
    time: np.ndarray, columns: Mapping[str, np.ndarray]
) -> list[tuple[np.ndarray | None, list[str]]]:
    """Return the channels of a table by the clock that their blanks show.

    Parameters
    ----------
    time : array (time,)
        Rising stamps of the rows. [s]
    columns : mapping of str to array (time,)
        Channels; NaN is blank.

    Returns
    -------
    list of (rows, names)
        Channels of one clock, in the order of their first one: the rows that have a sample of one
        of them, None for all rows.
    """
    groups: list[tuple[np.ndarray | None, list[str]]] = []
    filled = {name: ~np.isnan(values) for name, values in columns.items()}
    slower = {
        name: rows for name, rows in filled.items() if not rows.all() and is_slower(time, rows)
    }
    for name, own in filled.items():
        rows = slower.get(name)
        if (
            rows is None and own.any()
        ):  # a slower channel with dropouts has samples in rows of its clock only
            rows = next((others for others in slower.values() if not (own & ~others).any()), None)
        home = next((i for i, (others, _) in enumerate(groups) if _alike(rows, others)), None)
        if home is None:
            groups.append((rows, [name]))
            continue
        others, names = groups[home]
        joined = None if rows is None or others is None else rows | others
        groups[home] = joined, [*names, name]
    return groups


def is_slower(time: np.ndarray, filled: np.ndarray) -> bool:
    """Return whether the samples of a channel form a clock of their own: even steps, with most
    blanks between neighbouring samples.

    Parameters
    ----------
    time : array (time,)
        Rising stamps of the rows. [s]
    filled : array (time,)
        Whether a row has a sample of the channel.
    """
    at = np.flatnonzero(filled)
    blanks = int(at[-1] - at[0] + 1 - len(at)) if len(at) else 0
    if len(at) < _FEWEST or not blanks:
        return False
    step, rows = np.diff(time[at]), np.diff(at)
    usual = float(np.median(step))
    even = (
        np.abs(step - usual) <= _EVEN * usual if len(step) >= _MANY else np.zeros(len(step), bool)
    )
    # a sample stands in the nearest row, so that steps are of two neighbouring numbers of rows
    low, high = _usual_rows(rows)
    even |= (rows >= low) & (rows <= high)
    between = int((rows[even] - 1).sum())
    if float(np.mean(even)) >= _REGULAR and between >= _BETWEEN * blanks:
        return True
    return _lacks_every_nth(rows)


def _usual_rows(rows: np.ndarray) -> tuple[int, int]:
    """Return the fewest and most rows of a usual step; single rows stand for no slower clock."""
    middle = int(np.median(rows))
    if middle <= 1:
        return 1, 1
    return (middle, middle + 1) if middle <= _SHORT else (middle - 1, middle + 1)


def _lacks_every_nth(rows: np.ndarray) -> bool:
    """Return whether single blanks stand at even distances: a clock of 40 Hz in rows of 50 Hz."""
    at = np.flatnonzero(rows == 2)
    if len(at) < _BLANKS or (rows > 2).sum() > (1.0 - _REGULAR) * len(at):
        return False
    distance = np.diff(at)
    return bool(np.mean(np.abs(distance - np.median(distance)) <= 1.0) >= _REGULAR)


def _alike(rows: np.ndarray | None, others: np.ndarray | None) -> bool:
    """Return whether two channels have nearly all samples in the same rows."""
    if rows is None or others is None:
        return rows is others
    return int((rows & others).sum()) >= _ALIKE * int(np.maximum(rows.sum(), others.sum()))

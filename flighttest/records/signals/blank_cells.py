"""Channels that are slower than the rows of their table.

A recorder may write channels of several clocks into one table.  The cells of a slower channel are
blank between its samples, in a regular pattern.  These blanks are not missing samples.  Blanks
without a pattern are dropouts.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

# Samples that show a pattern.
_FEWEST = 3
# Deviation of a step of an even clock, in median steps.
_EVEN = 0.35
# Steps of an even clock with jitter. With fewer steps each must fit the rows.
_MANY = 10
# Rows of a step that is often hit by chance.
_SHORT = 3
# Share of the steps that are even.
_REGULAR = 0.9
# Share of the blanks that lie between samples of an even clock, and not in its gaps.
_BETWEEN = 0.5
# Blanks of a channel that lacks every fifth row or fewer.
_BLANKS = 10
# Share of samples that channels of one clock have in common.
_ALIKE = 0.9


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
        Channels of one clock, in the order of the first channel.  The rows (time,) have a sample of
        one of them; they are None for all rows.
    """
    filled = {name: ~np.isnan(values) for name, values in columns.items()}
    slower: dict[str, np.ndarray] = {}
    for name, is_filled in filled.items():
        if not is_filled.all() and is_slower(time, is_filled):
            slower[name] = is_filled
    groups: list[tuple[np.ndarray | None, list[str]]] = []
    for name, is_filled in filled.items():
        rows = slower.get(name)
        if rows is None and is_filled.any():
            # A slower channel with dropouts has samples only in rows of its clock.
            rows = _clock_with(is_filled, slower)
        i = _alike_group(rows, groups)
        if i is None:
            groups.append((rows, [name]))
            continue
        group_rows, names = groups[i]
        joined = None
        if rows is not None and group_rows is not None:
            joined = rows | group_rows
        groups[i] = joined, [*names, name]
    return groups


def _clock_with(is_filled: np.ndarray, slower: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Return the rows of the first slower channel that has all samples of this one."""
    for rows in slower.values():
        if not (is_filled & ~rows).any():
            return rows
    return None


def _alike_group(
    rows: np.ndarray | None, groups: list[tuple[np.ndarray | None, list[str]]]
) -> int | None:
    """Return the index of the first group with nearly the same rows."""
    for i, (group_rows, _) in enumerate(groups):
        if _are_alike(rows, group_rows):
            return i
    return None


def is_slower(time: np.ndarray, filled: np.ndarray) -> bool:
    """Return whether the samples of a channel form a clock of their own.

    Such a clock has even steps, with most blanks between neighbouring samples.

    Parameters
    ----------
    time : array (time,)
        Rising stamps of the rows. [s]
    filled : array (time,)
        Whether a row has a sample of the channel.
    """
    samples = np.flatnonzero(filled)
    if len(samples) < _FEWEST:
        return False
    blanks = int(samples[-1] - samples[0] + 1 - len(samples))
    if not blanks:
        return False
    step, rows = np.diff(time[samples]), np.diff(samples)
    usual_step = float(np.median(step))
    is_even = np.zeros(len(step), bool)
    if len(step) >= _MANY:
        is_even = np.abs(step - usual_step) <= _EVEN * usual_step
    # A sample is in the nearest row, so that steps have two neighbouring numbers of rows.
    low, high = _usual_rows(rows)
    is_even |= (rows >= low) & (rows <= high)
    between = int((rows[is_even] - 1).sum())
    if float(np.mean(is_even)) >= _REGULAR and between >= _BETWEEN * blanks:
        return True
    return _lacks_every_nth(rows)


def _usual_rows(rows: np.ndarray) -> tuple[int, int]:
    """Return the fewest and most rows of a usual step. Single rows are not a slower clock."""
    middle = int(np.median(rows))
    if middle <= 1:
        return 1, 1
    if middle <= _SHORT:
        return middle, middle + 1
    return middle - 1, middle + 1


def _lacks_every_nth(rows: np.ndarray) -> bool:
    """Return whether single blanks have even distances: a clock of 40 Hz in rows of 50 Hz."""
    blanks = np.flatnonzero(rows == 2)
    if len(blanks) < _BLANKS or (rows > 2).sum() > (1.0 - _REGULAR) * len(blanks):
        return False
    distance = np.diff(blanks)
    return bool(np.mean(np.abs(distance - np.median(distance)) <= 1.0) >= _REGULAR)


def _are_alike(rows: np.ndarray | None, others: np.ndarray | None) -> bool:
    """Return whether two channels have nearly all samples in the same rows."""
    if rows is None or others is None:
        return rows is others
    return int((rows & others).sum()) >= _ALIKE * int(np.maximum(rows.sum(), others.sum()))

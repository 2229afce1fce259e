"""Width of a tolerance compared with the printed one: a wrong unit makes it many times as wide."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

from flightmech.errors import AeromatchError
from flightmech.units import DEGREE, FOOT, KNOT, POUND_FORCE
from pom.tolerances import rows
from pom.tolerances.channels import limit_to_si_factor, plain_id, plain_words
from pom.tolerances.criteria import Band, Criterion, Limit

WIDE = 10.0
"""Ratio of widths beyond which a tolerance is more often a mistake than a decision; our number.

The rows of one parameter of one test differ by at most 2 times between the shipped standards.
"""
_UNITS = {
    "deg and rad": 1.0 / DEGREE,
    "ft and m": 1.0 / FOOT,
    "kt and m/s": 1.0 / KNOT,
    "lbf and N": POUND_FORCE,
}
_SAME_FACTOR = 0.01  # relative


def limit_ratio(criterion: Criterion, own: Limit, limit: Limit, printed: Band) -> float | None:
    """Return own over printed limit; None if they are of different kinds."""
    if own.quantity != limit.quantity or not limit.value:
        return None
    if own.quantity == "absolute":
        try:
            own_size = limit_to_si_factor(criterion.measure, criterion.channel, own.unit)
            size = limit_to_si_factor(criterion.measure, criterion.channel, limit.unit)
        except AeromatchError:
            return None
        return own.value * own_size / (limit.value * size)
    if criterion.band.base != printed.base:
        return None
    return own.value / limit.value


def width_ratio(criterion: Criterion, printed: Band) -> float | None:
    """Return the largest ratio of limits of the same kind; None without one."""
    ratios = []
    for own in criterion.band.limits:
        for limit in printed.limits:
            ratio = limit_ratio(criterion, own, limit, printed)
            if ratio is not None:
                ratios.append(ratio)
    return max(ratios, default=None)


def unit_hint(ratio: float) -> str:
    """Return the units whose factor a ratio of widths is, as words; empty for another ratio.

    Examples
    --------
    >>> unit_hint(57.29578), unit_hint(2.0)
    (', the factor between deg and rad: check the unit', '')
    """
    for units, factor in _UNITS.items():
        for size in (factor, 1.0 / factor):
            if abs(ratio / size - 1.0) < _SAME_FACTOR:
                return f", the factor between {units}: check the unit"
    return ""


def size_text(criterion: Criterion, printed: Iterable[Band]) -> str:
    """Return how a tolerance differs in size from every printed one; empty below `WIDE`.

    Parameters
    ----------
    criterion : Criterion
    printed : iterable of Band
        Bands of the same row; the nearest one counts.
    """
    nearest = None
    for band in printed:
        ratio = width_ratio(criterion, band)
        if ratio is None or not ratio > 0.0:
            continue
        distance = abs(math.log(ratio))
        if nearest is None or distance < nearest[0]:
            nearest = (distance, ratio, band)
    if nearest is None or nearest[0] < math.log(WIDE):
        return ""
    _, ratio, band = nearest
    hint = unit_hint(ratio) or "; write the width with its unit"
    return (
        f"tolerance of {plain_words(criterion.name)} {criterion.band.text}, usual is {band.text}: "
        f"{ratio:.3g} times as wide{hint}"
    )


def row_size_text(row: rows.Row, name: str) -> str:
    """Return `size_text` of a row of a table of the user against the shipped rows of its kind."""
    own = rows.make_criterion(row, name, (0.0, 1.0))
    keys = (plain_id(row["test_id"]), row["parameter"], row["measure"])
    bands = []
    for shipped in rows.tolerance_rows():
        if (plain_id(shipped["test_id"]), shipped["parameter"], shipped["measure"]) == keys:
            bands.append(rows.band_of(shipped))
    return size_text(own, bands)


def table_size_texts(table: Sequence[rows.Row]) -> Iterator[str]:
    """Yield `row_size_text` of every row of a table of the user, with the number of the test."""
    for row in table:
        text = row_size_text(row, row["parameter"])
        if text:
            yield f"{row['standard']}, {row['edition']}: {row['test_id']}: {text}"

"""Dimensions of a deck that are probably errors, as sentences below its drawing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from datcom_io.decks.deck import Deck
from datcom_io.decks.device_fit import advise_on_misfit, describe_misfit
from datcom_io.drawings.deck_shape import DeckShape
from flightmech.units import to_si

_UNITS = {"FT": "ft", "IN": "in", "M": "m", "CM": "cm"}
# Length and span of aeroplanes that fly, from a small UAV to the largest transport. [m]
_SHORTEST, _LONGEST = 0.3, 90.0
_TOLERANCE = 0.02  # of the length, by which a surface may end beyond the body
_SLENDEST, _STUBBIEST = 0.15, 8.0  # span over length


def doubts_of_deck(deck: Deck, shape: DeckShape) -> list[str]:
    """Return a sentence for each dimension that is probably an error, with the values.

    Parameters
    ----------
    deck : Deck
    shape : DeckShape
        Of this deck, as from `shape_of_deck`.
    """
    ranges: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for outline in shape.outlines:
        low, high = outline.points.min(axis=0), outline.points.max(axis=0)
        if outline.part in ranges:
            low = np.minimum(low, ranges[outline.part][0])
            high = np.maximum(high, ranges[outline.part][1])
        ranges[outline.part] = low, high
    doubts = list(_doubt_size(shape, ranges))
    doubts += _doubt_places(shape, ranges)
    # The drawing shows the device where the program puts it.
    if misfit := describe_misfit(deck):
        doubts.append(f"{misfit}; {advise_on_misfit(deck)}")
    return doubts


_Ranges = Mapping[str, tuple[np.ndarray, np.ndarray]]


def _doubt_size(shape: DeckShape, ranges: _Ranges) -> Iterator[str]:
    """Yield doubts on the unit of length and on the proportions."""
    if not ranges:
        return
    # Extent of all parts together; y counts from tip to tip.
    low = np.min([part[0] for part in ranges.values()], axis=0)
    high = np.max([part[1] for part in ranges.values()], axis=0)
    length, span = float(high[0] - low[0]), float(high[1] - low[1])
    unit = _UNITS[shape.dim]
    for name, value in (("length", length), ("span", span)):
        metres = float(to_si(value, unit, "m"))
        if not _SHORTEST <= metres <= _LONGEST:
            yield (
                f"the {name} of {value:.4g} {unit} is {metres:.3g} m; aeroplanes have "
                f"{_SHORTEST:g} to {_LONGEST:g} m: is DIM {shape.dim} the unit of the deck?"
            )
    if "wing" in ranges and "body" in ranges:
        body = float(np.ptp([ranges["body"][0][0], ranges["body"][1][0]]))
        wing = 2.0 * float(ranges["wing"][1][1])
        if body > 0.0 and not _SLENDEST <= wing / body <= _STUBBIEST:
            yield (
                f"the span of {wing:.4g} is {wing / body:.3g} times the length of the body, "
                f"{body:.4g}: are both in one unit, and is SSPN half the span?"
            )


def _doubt_places(shape: DeckShape, ranges: _Ranges) -> Iterator[str]:
    """Yield doubts on the places of surfaces and of the centre of gravity."""
    if {"wing", "horizontal tail"} <= ranges.keys():
        wing, tail = ranges["wing"][0][0], ranges["horizontal tail"][0][0]
        if tail < wing:
            yield (
                f"the horizontal tail begins at X {tail:.4g}, ahead of the wing at X {wing:.4g}: "
                f"a canard, or XH or XW is wrong"
            )
    if "body" not in ranges:
        return
    # Surfaces have to touch the body, within a share of its length.
    nose, end = float(ranges["body"][0][0]), float(ranges["body"][1][0])
    allowed = _TOLERANCE * (end - nose)
    for part in ("wing", "horizontal tail", "vertical tail", "ventral fin"):
        if part not in ranges:
            continue
        low, high = float(ranges[part][0][0]), float(ranges[part][1][0])
        if low > end + allowed or high < nose - allowed:
            yield (
                f"the {part} at X {low:.4g} to {high:.4g} does not touch the body, X {nose:.4g} to "
                f"{end:.4g}"
            )
        elif low < nose - allowed:
            yield f"the {part} begins at X {low:.4g}, ahead of the nose at X {nose:.4g}"
    for point in shape.points:
        x = point.place[0]
        if not nose <= x <= end:
            yield f"XCG {x:.4g} lies beyond the body, X {nose:.4g} to {end:.4g}"
        if "wing" in ranges:
            front, back = float(ranges["wing"][0][0]), float(ranges["wing"][1][0])
            chord = back - front
            if not front - chord <= x <= back + chord:
                yield (
                    f"XCG {x:.4g} lies more than the depth of the wing ahead of or behind it, "
                    f"X {front:.4g} to {back:.4g}"
                )
    yield from _doubt_heights(shape, ranges)


def _doubt_heights(shape: DeckShape, ranges: _Ranges) -> Iterator[str]:
    """Yield doubts on surfaces whose apex is far above or below the body."""
    low, high = float(ranges["body"][0][2]), float(ranges["body"][1][2])
    height = high - low
    for part in ("wing", "horizontal tail"):
        if part not in ranges:
            continue
        bottom, top = float(ranges[part][0][2]), float(ranges[part][1][2])
        if part == "wing" and (bottom > high + height or top < low - height):
            yield (
                f"the {part} at Z {bottom:.4g} to {top:.4g} lies more than the height of the body "
                f"above or below it, Z {low:.4g} to {high:.4g}"
            )

"""Outlines of the surfaces of a deck in space."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from datcom_io.decks.deck import Deck

ALL = ("top", "side", "front")
"""The three views."""

PlanformNodes = tuple[np.ndarray, np.ndarray, np.ndarray]


class DeckOutline(NamedTuple):
    """A closed outline, or a line of two points.

    Attributes
    ----------
    part : str
        Such as ``wing``.
    style : str
        ``body wing tail fin device engine``.
    points : array (n, 3)
        x aft, y right, z up. [of the deck]
    views : tuple of str
    """

    part: str
    style: str
    points: np.ndarray
    views: tuple[str, ...]


def mirror(points: np.ndarray) -> np.ndarray:
    """Return points (n, 3) on the other side of the plane of symmetry."""
    return points * np.array([1.0, -1.0, 1.0])


def place_on_surface(
    deck: Deck,
    name: str,
    nodes: PlanformNodes,
    apex: tuple[float, float],
    stations: np.ndarray,
    behind: np.ndarray,
) -> np.ndarray:
    """Return points (n, 3) of a wing or tail on its right half.

    Parameters
    ----------
    deck : Deck
    name : str
        ``WGPLNF`` or ``HTPLNF``.
    nodes : tuple of array
        As from `planform_nodes`.
    apex : tuple
        X and Z of the apex. [of the deck]
    stations : array (n,)
        Distances from the plane of symmetry. [of the deck]
    behind : array (n,)
        Distances behind the leading edge along the chord. [of the deck]

    Notes
    -----
    The chord is turned about the leading edge by the incidence and by the twist, which is linear
    from the root to the tip. Dihedral is DHDADI, and DHDADO over the outer length SSPNDD.
    """
    y, _, lead = nodes
    letter = "W" if name == "WGPLNF" else "H"
    incidence = deck.value("SYNTHS", f"ALI{letter}") or 0.0
    twist = deck.value(name, "TWISTA") or 0.0
    # Nose-up incidence and twist turn the chord, so that points behind the edge move down.
    angle = np.radians(incidence + twist * stations / y[-1])
    inner = np.tan(np.radians(deck.value(name, "DHDADI") or 0.0))
    outer_angle, outer = deck.value(name, "DHDADO"), deck.value(name, "SSPNDD") or 0.0
    height = inner * stations
    if outer_angle is not None and 0.0 < outer < y[-1]:
        break_at = y[-1] - outer
        slope = np.tan(np.radians(outer_angle))
        height = inner * np.minimum(stations, break_at)
        height = height + slope * np.maximum(stations - break_at, 0.0)
    x = apex[0] + np.interp(stations, y, lead) + behind * np.cos(angle)
    return np.column_stack([x, stations, apex[1] + height - behind * np.sin(angle)])


def lifting_surface(
    deck: Deck, name: str, nodes: PlanformNodes, apex: tuple[float, float]
) -> np.ndarray:
    """Return the outline (n, 3) of the right half of a wing or tail, from the root."""
    y, chord, _ = nodes
    stations = _with_dihedral_break(deck, name, y)
    chords = np.interp(stations, y, chord)
    return place_on_surface(
        deck,
        name,
        nodes,
        apex=apex,
        stations=np.r_[stations, stations[::-1]],
        behind=np.r_[np.zeros_like(chords), chords[::-1]],
    )


def _with_dihedral_break(deck: Deck, name: str, y: np.ndarray) -> np.ndarray:
    outer = deck.value(name, "SSPNDD") or 0.0
    if 0.0 < outer < y[-1]:
        return np.unique(np.r_[y, y[-1] - outer])
    return y


def upright_surface(
    nodes: PlanformNodes, apex: tuple[float, float], direction: float
) -> np.ndarray:
    """Return the outline (n, 3) of a vertical surface in the plane of symmetry."""
    y, chord, lead = nodes
    x = apex[0] + np.r_[lead, (lead + chord)[::-1]]
    z = apex[1] + direction * np.r_[y, y[::-1]]
    return np.column_stack([x, np.zeros_like(x), z])

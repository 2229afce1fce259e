"""Area, span, mean chord and sweep of a wing from its planform cards."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from datcom_io.decks.deck import Deck

# Points of the integrals over the half span.
_STATIONS = 2001
# Position of the apex in SYNTHS.
_APEX = {"WGPLNF": "XW", "HTPLNF": "XH"}


@dataclass(frozen=True)
class WingPlanform:
    """The theoretical wing of a deck, through the body to the plane of symmetry.

    Attributes
    ----------
    area, span, mean_chord, root_chord : float
        Both sides; the mean chord is that of the integral of c^2. [of the deck]
    leading_edge : float
        Leading edge of the mean chord from the drawing datum, aft. [of the deck]
    sweep : float
        Mean sweep of the quarter-chord line. [rad]
    """

    area: float
    span: float
    mean_chord: float
    root_chord: float
    leading_edge: float
    sweep: float

    @property
    def aspect_ratio(self) -> float:
        """Aspect ratio. [1]"""
        return self.span**2 / self.area


def measure_wing(deck: Deck) -> WingPlanform | None:
    """Return the wing of a deck, None without its planform cards."""
    return measure_surface(deck, "WGPLNF")


def measure_main_wing(deck: Deck) -> WingPlanform | None:
    """Return the larger of wing and horizontal tail, None without planform cards of a wing.

    Decks of a canard configuration have the surface ahead in WGPLNF and the main wing in HTPLNF.
    """
    wing, tail = measure_wing(deck), measure_surface(deck, "HTPLNF")
    if wing is not None and tail is not None and tail.area > wing.area:
        return tail
    return wing


def sample_chords(deck: Deck, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Return span stations of a surface, its chords and leading edge there, None without cards.

    Parameters
    ----------
    deck : Deck
    name : str
        Namelist of the planform, ``WGPLNF`` or ``HTPLNF``.

    Returns
    -------
    tuple of array (station,) or None
        Stations from the plane of symmetry to the tip, chord, and leading edge from the drawing
        datum, aft. [of the deck]

    Notes
    -----
    The wing is straight or cranked. Chords are linear between root, break and tip. The program
    uses a break whatever TYPE is: a deck with TYPE=1, SSPNOP and CHRDBP prints the area with it.
    """
    nodes = planform_nodes(deck, name)
    if nodes is None:
        return None
    y, chord, edge = nodes
    stations = np.linspace(0.0, y[-1], _STATIONS)
    lead = (deck.value("SYNTHS", _APEX[name]) or 0.0) + np.interp(stations, y, edge)
    return stations, np.interp(stations, y, chord), lead


def planform_nodes(deck: Deck, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Return root, break and tip of a planform, None without its cards.

    Parameters
    ----------
    deck : Deck
    name : str
        Namelist of the planform, ``WGPLNF HTPLNF VTPLNF VFPLNF``.

    Returns
    -------
    tuple of array (node,) or None
        Stations from the root of the theoretical surface, chord, and leading edge from the apex,
        aft. Chord and leading edge are linear between the nodes. [of the deck]
    """
    names = ("CHRDR", "CHRDTP", "SSPN", "SAVSI", "CHSTAT")
    root, tip, half, sweep, station = (deck.value(name, key) for key in names)
    if root is None or tip is None or not half or sweep is None or root + tip <= 0.0:
        return None
    outer = deck.value(name, "SSPNOP") or 0.0
    middle = deck.value(name, "CHRDBP")
    y, c, sweeps = [0.0, half], [root, tip], [sweep]
    if 0.0 < outer < half and middle is not None:
        y = [0.0, half - outer, half]
        c = [root, middle, tip]
        sweeps = [sweep, deck.value(name, "SAVSO") or sweep]
    edge = [0.0]
    # The sweep is that of the line at the fraction CHSTAT of the chord, so that the leading edge
    # moves forward by this fraction of the change of chord.
    for k, angle in enumerate(sweeps):
        slope = np.tan(np.radians(angle)) * (y[k + 1] - y[k])
        edge.append(edge[-1] + slope - (station or 0.0) * (c[k + 1] - c[k]))
    return np.array(y), np.array(c), np.array(edge)


def measure_surface(deck: Deck, name: str) -> WingPlanform | None:
    """Return a surface of a deck, ``WGPLNF`` or ``HTPLNF``, None without its planform cards."""
    sampled = sample_chords(deck, name)
    if sampled is None:
        return None
    stations, chord, lead = sampled
    # Integrals over one half: mean chord = Int c^2 dy / Int c dy, and its leading edge alike.
    half = float(stations[-1])
    area = float(np.trapezoid(chord, stations))
    quarter = lead + 0.25 * chord
    return WingPlanform(
        area=2.0 * area,
        span=2.0 * half,
        mean_chord=float(np.trapezoid(chord**2, stations)) / area,
        root_chord=float(chord[0]),
        leading_edge=float(np.trapezoid(chord * lead, stations)) / area,
        sweep=float(np.arctan((quarter[-1] - quarter[0]) / half)),
    )

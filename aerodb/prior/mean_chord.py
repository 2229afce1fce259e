"""Place of the moment reference point on the mean chord, from the planform cards of the wing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from aerodb.prior.sources import Source, warn_user
from datcom_io.arrays.conditions import LENGTH_UNITS
from datcom_io.decks.deck import Deck
from flightmech.aircraft.aircraft import Aircraft, DefaultNumber

# Difference of places on the mean chord from which on to warn. [chords]
_DIFFERENCE = 0.02
# Difference of the mean chord of the cards from that of the aircraft from which on the place means
# another chord, of that of the aircraft.
_OTHER_CHORD = 0.1


class MeanChord(NamedTuple):
    """Mean aerodynamic chord of a wing: length, and leading edge aft of the drawing datum [m]."""

    length: float
    leading_edge: float


def mean_chord_of(deck: Deck) -> MeanChord | None:
    """Return the mean chord of the wing of a deck, or None without all cards of its planform.

    The chords of both panels are straight lines, c(y). With the sweep at a share of the chord,

        cbar = 2/S int c^2 dy,  x_LE = 2/S int c x_LE(y) dy
    """
    unit = LENGTH_UNITS.get(deck.dim)
    root, tip = deck.value("WGPLNF", "CHRDR"), deck.value("WGPLNF", "CHRDTP")
    span, sweep = deck.value("WGPLNF", "SSPN"), deck.value("WGPLNF", "SAVSI")
    apex = deck.value("SYNTHS", "XW")
    # A scale factor multiplies some cards and not others.
    if unit is None or deck.value("SYNTHS", "SCALE") not in (None, 1.0):
        return None
    if root is None or tip is None or span is None or sweep is None or apex is None:
        return None
    share = deck.value("WGPLNF", "CHSTAT") or 0.0
    outer = deck.value("WGPLNF", "SSPNOP") or 0.0
    kink = deck.value("WGPLNF", "CHRDBP")
    if kink is None or not 0.0 < outer < span:
        kink = None
    stations, sweeps = [(0.0, root), (span, tip)], [sweep]
    if kink is not None:
        outer_sweep = deck.value("WGPLNF", "SAVSO")
        stations.insert(1, (span - outer, kink))
        sweeps.append(sweep if outer_sweep is None else outer_sweep)
    area = moment = square = 0.0
    line = apex + share * root
    for (y0, c0), (y1, c1), angle in zip(stations[:-1], stations[1:], sweeps):
        width = y1 - y0
        # Simpson's rule is exact for products of straight lines.
        y = width * np.array([0.0, 0.5, 1.0])
        c = c0 + (c1 - c0) * np.array([0.0, 0.5, 1.0])
        edge = line + np.tan(np.radians(angle)) * y - share * c
        weight = width * np.array([1.0, 4.0, 1.0]) / 6.0
        area += float(weight @ c)
        square += float(weight @ c**2)
        moment += float(weight @ (c * edge))
        line += float(np.tan(np.radians(angle))) * width
    if not area > 0.0:
        return None
    return MeanChord(unit * square / area, unit * moment / area)


def warn_of_other_place(
    aircraft: Aircraft, sources: Mapping[str, Source], reference: tuple[float, float, float]
) -> None:
    """Warn if the reference point lies elsewhere on the mean chord than the aircraft states.

    Parameters
    ----------
    aircraft : Aircraft
    sources : mapping of str to Source
        The planform is that of the cards of ``clean``.
    reference : (x, y, z)
        Moment reference point, body directions from the drawing datum. [m]
    """
    # The reference quantities alone, without a place on the chord, are enough for a database.
    stated = getattr(aircraft, "x_ref_mac", None)
    chords = {mean_chord_of(deck) for deck in sources["clean"].decks}
    if stated is None or len(chords) != 1:
        return
    (chord,) = chords
    if chord is None or abs(chord.length / aircraft.cbar - 1.0) > _OTHER_CHORD:
        return
    # Positions count aft in the drawing, and forward in body directions.
    place = (-reference[0] - chord.leading_edge) / aircraft.cbar
    if abs(place - stated) <= _DIFFERENCE:
        return
    origin = "the aircraft file gives it"
    if isinstance(stated, DefaultNumber):
        origin = "the default, the aircraft file does not give it"
    warn_user(
        f"x_ref_mac is {stated:.4g} ({origin}), and by the planform cards of "
        f"{sources['clean'].file} the reference point lies at {place:.4g} of the mean chord "
        f"(leading edge at {chord.leading_edge:.4g} m, mean chord {chord.length:.4g} m, reference "
        f"point {-reference[0]:.4g} m aft of the drawing datum): places of the c.g. and neutral "
        f"point in chords are shifted by the difference; set x_ref_mac = {place:.4g}"
    )

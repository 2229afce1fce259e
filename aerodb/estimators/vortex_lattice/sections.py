"""Mean lines of aerofoil sections, from the cards of a DATCOM deck.

A thin-surface method uses the mean line alone.

References
----------
.. [Abbott1959] I. H. Abbott, A. E. von Doenhoff, Theory of Wing Sections, 1959: mean lines of four
   and five digits, sections 6.4 and 6.5; mean line a = 1, chapter 4.
"""

from __future__ import annotations

import re

import numpy as np

from datcom_io.decks.deck import Deck

STATIONS = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, 41)))
"""Stations of a mean line, from the leading to the trailing edge. [chord]"""
# Five-digit sections by their first three digits: end of the cubic part, and its factor.
_FIVE_DIGITS = {
    "210": (0.0580, 361.40),
    "220": (0.1260, 51.640),
    "230": (0.2025, 15.957),
    "240": (0.2900, 6.643),
    "250": (0.3910, 3.230),
}
_SIX_SERIES = re.compile(r"\d{2}(?:,?\d)?[-A](\d)\d{2}")


def read_mean_line(deck: Deck, surface: str) -> tuple[np.ndarray, str]:
    """Return the mean line of a surface at `STATIONS`, and a remark, empty without one.

    Parameters
    ----------
    deck : Deck
    surface : str
        First letter of its planform namelist: ``W H V F``.

    Returns
    -------
    array (station,), str
        Height above the chord. [chord]
    """
    kind, _, digits = deck.sections.get(surface, "").partition(" ")
    if digits:
        line = _designated_line(kind, digits.strip())
        if line is not None:
            return line, ""
        return np.zeros_like(STATIONS), f"section {digits} of {surface}: its camber is not computed"
    # Without a NACA card, WGSCHR and its like have the section: ordinates or a design lift.
    characteristics = {"W": "WGSCHR", "H": "HTSCHR", "V": "VTSCHR", "F": "VFSCHR"}[surface]
    ordinates = _ordinate_line(deck, characteristics)
    if ordinates is not None:
        return ordinates, ""
    design_lift = deck.value(characteristics, "CLI")
    if design_lift is not None:
        return _uniform_load_line(design_lift), ""
    return np.zeros_like(STATIONS), f"no section of {surface} in the deck: taken without camber"


def _designated_line(kind: str, digits: str) -> np.ndarray | None:
    """Return the mean line of a NACA designation, None for one without a formula here."""
    if kind == "4" and re.match(r"\d{4}", digits):
        return _four_digit_line(int(digits[0]) / 100.0, int(digits[1]) / 10.0)
    if kind == "5" and digits[:3] in _FIVE_DIGITS:
        end, factor = _FIVE_DIGITS[digits[:3]]
        x = STATIONS
        # [Abbott1959] 6.5: a cubic up to the point `end`, a straight line behind it
        front = factor / 6.0 * (x**3 - 3.0 * end * x**2 + end**2 * (3.0 - end) * x)
        return np.where(x < end, front, factor / 6.0 * end**3 * (1.0 - x))
    series = _SIX_SERIES.match(digits)
    if kind in ("1", "6") and series:
        return _uniform_load_line(int(series[1]) / 10.0)
    return None


def _four_digit_line(height: float, place: float) -> np.ndarray:
    """Return two parabolas that meet at the largest camber."""
    x = STATIONS
    if height == 0.0 or place == 0.0:
        return np.zeros_like(x)
    # [Abbott1959] 6.4: a parabola on each side of the largest camber
    front = height / place**2 * (2.0 * place * x - x**2)
    rear = height / (1.0 - place) ** 2 * (1.0 - 2.0 * place + 2.0 * place * x - x**2)
    return np.where(x < place, front, rear)


def _uniform_load_line(design_lift: float) -> np.ndarray:
    """Return the mean line a = 1 of a design lift coefficient."""
    x = STATIONS
    # [Abbott1959] z = -cl / (4 pi) [(1 - x) ln(1 - x) + x ln x], which is zero at both ends
    inner = x[1:-1]
    line = np.zeros_like(x)
    line[1:-1] = (1.0 - inner) * np.log(1.0 - inner) + inner * np.log(inner)
    return -design_lift / (4.0 * np.pi) * line


def _ordinate_line(deck: Deck, namelist: str) -> np.ndarray | None:
    """Return the mean line of section ordinates, None without them."""
    x = np.array(deck.values(namelist, "XCORD"))
    mean = np.array(deck.values(namelist, "MEAN"))
    upper = np.array(deck.values(namelist, "YUPPER"))
    lower = np.array(deck.values(namelist, "YLOWER"))
    if x.size < 3:
        return None
    if mean.size == x.size:
        height = mean
    elif upper.size == x.size and lower.size == x.size:
        height = 0.5 * (upper + lower)
    else:
        return None
    return np.interp(STATIONS, x, height)

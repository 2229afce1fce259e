"""Factors that turn printed coefficients into those by the area, span and mean chord of the wing.

The sizes of derivatives are compared with limits. A deck may have any reference quantities, such as
BLREF = 1 for moments in feet; its derivatives are then large and right. Only by the wing's own
quantities does a limit hold for all decks.
"""

from __future__ import annotations

from datcom_io.decks.deck import Deck
from datcom_io.decks.planforms import measure_main_wing

# Reference lengths of a coefficient besides the area: c for CBARR, b for BLREF. A rate counts with
# qhat = q CBARR / 2V, phat = p BLREF / 2V, which adds one.
_LENGTHS = {
    "CL": "",
    "CY_beta": "",
    "Cl_beta": "b",
    "Cm_alpha": "c",
    "CL_qhat": "c",
    "CL_alphadothat": "c",
    "Cm_qhat": "cc",
    "Cm_alphadothat": "cc",
    "CY_phat": "b",
    "Cl_phat": "bb",
    "Cl_rhat": "bb",
    "Cn_phat": "bb",
    "Cn_rhat": "bb",
}


def scale_by_wing(deck: Deck) -> dict[str, float]:
    """Return the factors from the reference quantities of a deck to those of its main wing.

    Parameters
    ----------
    deck : Deck

    Returns
    -------
    dict of str to float
        By coefficient. All are 1 without planform cards of a wing, and where the deck leaves
        SREF, CBARR or BLREF out, which are then those of the wing. [1]
    """
    wing = measure_main_wing(deck)
    if wing is None:
        return dict.fromkeys(_LENGTHS, 1.0)
    area = (deck.value("OPTINS", "SREF") or wing.area) / wing.area
    lengths = {
        "c": (deck.value("OPTINS", "CBARR") or wing.mean_chord) / wing.mean_chord,
        "b": (deck.value("OPTINS", "BLREF") or wing.span) / wing.span,
    }
    scales = {}
    for name, letters in _LENGTHS.items():
        scales[name] = area
        for letter in letters:
            scales[name] *= lengths[letter]
    return scales

"""The aeroplane of the outputs of AVL and VSPAERO, in metres."""

from types import SimpleNamespace

FOOT = 0.3048


def aircraft(**changed):
    """Return name, reference quantities and reference point; `changed` replaces some."""
    facts = {
        "name": "C182",
        "S": 174.0 * FOOT**2,
        "cbar": 4.9 * FOOT,
        "b": 35.8 * FOOT,
        "reference": (-7.6 * FOOT, 0.0, 0.0),
    }
    return SimpleNamespace(**(facts | changed))

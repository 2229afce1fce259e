"""Digital DATCOM listings: as printed, and as xarray trees in SI and radians.

>>> import datcom_io
>>> listing = datcom_io.read("t37_clean.out")           # doctest: +SKIP
>>> listing.cases                                       # doctest: +SKIP
['T-37 OWN DECK CLEAN AIRCRAFT']
>>> listing[0].block("static")                          # the printed table, units in attrs  # doctest: +SKIP
>>> clean = listing[0].to_datatree()                    # SI, radians, house names           # doctest: +SKIP
>>> clean["static"]["CL"].sel(condition=0)              # doctest: +SKIP
"""

from __future__ import annotations

import importlib

_HOME = {
    "read": "scan",
    "Listing": "listing",
    "Case": "listing",
    "Page": "listing",
    "Table": "listing",
    "Message": "listing",
    "Deck": "deck",
    "FLAGS": "cells",
    "join": "grid",
    "to_grid": "grid",
}
__all__ = ["FLAGS", "Case", "Deck", "Listing", "Message", "Page", "Table", "join", "read", "to_grid"]


def __getattr__(name: str):
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted(__all__)

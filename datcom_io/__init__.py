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

from typing import TYPE_CHECKING

from flightmech.lazy import load

if TYPE_CHECKING:
    from .cells import FLAGS
    from .datcom_plus import read_datcom_plus_csv
    from .deck import Deck
    from .grid import join, to_grid
    from .listing import Case, DamagedListing, Listing, Message, Page, Table
    from .plot_file import read_plot
    from .plot_table import read_for014
    from .refining import refine
    from .scan import iterate, read

_HOME = {
    "read": "scan",
    "iterate": "scan",
    "Listing": "listing",
    "DamagedListing": "listing",
    "Case": "listing",
    "Page": "listing",
    "Table": "listing",
    "Message": "listing",
    "Deck": "deck",
    "FLAGS": "cells",
    "join": "grid",
    "to_grid": "grid",
    "read_plot": "plot_file",
    "read_datcom_plus_csv": "datcom_plus",
    "read_for014": "plot_table",
    "refine": "refining",
}
__all__ = [
    "FLAGS",
    "Case",
    "DamagedListing",
    "Deck",
    "Listing",
    "Message",
    "Page",
    "Table",
    "iterate",
    "join",
    "read",
    "read_datcom_plus_csv",
    "read_for014",
    "read_plot",
    "refine",
    "to_grid",
]


def __getattr__(name: str):
    return load(__name__, _HOME, name)


def __dir__() -> list[str]:
    return __all__

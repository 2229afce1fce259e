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
    from .deck_cards import Finding
    from .deck_check import check_deck
    from .deck_file import DeckFile, read_deck
    from .deck_run import Run, run_deck
    from .deck_split import split_deck
    from .deck_write import write_deck
    from .grid import join, to_grid
    from .listing import Case, DamagedListing, Listing, Message, Page, Table
    from .matlab_read import read_matlab
    from .matlab_write import write_matlab
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
    "DeckFile": "deck_file",
    "Finding": "deck_cards",
    "Run": "deck_run",
    "check_deck": "deck_check",
    "read_deck": "deck_file",
    "run_deck": "deck_run",
    "split_deck": "deck_split",
    "write_deck": "deck_write",
    "FLAGS": "cells",
    "join": "grid",
    "to_grid": "grid",
    "read_plot": "plot_file",
    "read_matlab": "matlab_read",
    "write_matlab": "matlab_write",
    "read_datcom_plus_csv": "datcom_plus",
    "read_for014": "plot_table",
    "refine": "refining",
}
__all__ = [
    "FLAGS",
    "Case",
    "DamagedListing",
    "Deck",
    "DeckFile",
    "Finding",
    "Listing",
    "Message",
    "Page",
    "Run",
    "Table",
    "check_deck",
    "iterate",
    "join",
    "read",
    "read_datcom_plus_csv",
    "read_deck",
    "read_for014",
    "read_matlab",
    "read_plot",
    "refine",
    "run_deck",
    "split_deck",
    "to_grid",
    "write_deck",
    "write_matlab",
]


def __getattr__(name: str):
    return load(__name__, _HOME, name)


def __dir__() -> list[str]:
    return __all__

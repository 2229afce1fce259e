"""Digital DATCOM listings: as printed, and as xarray trees in SI and radians.

>>> import datcom_io
>>> listing = datcom_io.read("t37_clean.out")           # doctest: +SKIP
>>> listing.case_names                                  # doctest: +SKIP
['T-37 OWN DECK CLEAN AIRCRAFT']
>>> listing[0].block("static")                          # the printed table, units in attrs  # doctest: +SKIP
>>> clean = listing[0].to_datatree()                    # SI, radians, canonical names           # doctest: +SKIP
>>> clean["static"]["CL"].sel(condition=0)              # doctest: +SKIP
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flightmech.support.lazy import load

if TYPE_CHECKING:
    from .arrays.grid import join, to_grid
    from .cells import FLAGS
    from .decks.cards import Finding
    from .decks.check import check_deck
    from .decks.deck import Deck
    from .decks.file import DeckFile, read_deck
    from .decks.writing import write_deck
    from .exchange.datcom_plus import read_datcom_plus_csv
    from .exchange.matlab.read import read_matlab
    from .exchange.matlab.write import write_matlab
    from .exchange.plot_files.refining import refine
    from .exchange.plot_files.unit13 import read_plot
    from .exchange.plot_files.unit14 import read_for014
    from .listing import Case, DamagedListing, Listing
    from .printout.content import Message, Page
    from .printout.tables import Table
    from .reading.reader import iterate, read
    from .runs.running import Run, run_deck
    from .runs.splitting import split_deck

_HOME = {
    "read": "reading.reader",
    "iterate": "reading.reader",
    "Listing": "listing",
    "DamagedListing": "listing",
    "Case": "listing",
    "Page": "printout.content",
    "Table": "printout.tables",
    "Message": "printout.content",
    "Deck": "decks.deck",
    "DeckFile": "decks.file",
    "Finding": "decks.cards",
    "Run": "runs.running",
    "check_deck": "decks.check",
    "read_deck": "decks.file",
    "run_deck": "runs.running",
    "split_deck": "runs.splitting",
    "write_deck": "decks.writing",
    "FLAGS": "cells",
    "join": "arrays.grid",
    "to_grid": "arrays.grid",
    "read_plot": "exchange.plot_files.unit13",
    "read_matlab": "exchange.matlab.read",
    "write_matlab": "exchange.matlab.write",
    "read_datcom_plus_csv": "exchange.datcom_plus",
    "read_for014": "exchange.plot_files.unit14",
    "refine": "exchange.plot_files.refining",
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

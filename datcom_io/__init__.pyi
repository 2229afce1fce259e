"""Public names of `datcom_io` and where they are defined; ``__init__.py`` loads them from this list."""

from .arrays.grid import join as join
from .arrays.grid import to_grid as to_grid
from .cells import FLAGS as FLAGS
from .decks.cards import DeckFinding as DeckFinding
from .decks.check import check_deck as check_deck
from .decks.deck import Deck as Deck
from .decks.file import DeckFile as DeckFile
from .decks.file import read_deck as read_deck
from .decks.writing import write_deck as write_deck
from .exchange.datcom_plus import read_datcom_plus_csv as read_datcom_plus_csv
from .exchange.matlab.read import read_matlab as read_matlab
from .exchange.matlab.write import write_matlab as write_matlab
from .exchange.plot_files.refining import refine as refine
from .exchange.plot_files.unit13 import read_plot as read_plot
from .exchange.plot_files.unit14 import read_for014 as read_for014
from .listing import Case as Case
from .listing import DamagedListing as DamagedListing
from .listing import Listing as Listing
from .printout.content import Message as Message
from .printout.content import Page as Page
from .printout.tables import Table as Table
from .reading.reader import iterate as iterate
from .reading.reader import read as read
from .runs.running import Run as Run
from .runs.running import run_deck as run_deck
from .runs.splitting import split_deck as split_deck

"""Namespaces of `datcom_io` by subject, and the names of the usual road; ``__init__.py`` loads them from this list."""

from . import arrays as arrays
from . import decks as decks
from . import exchange as exchange
from . import printout as printout
from . import reading as reading
from . import runs as runs
from .arrays import join as join
from .arrays import to_grid as to_grid
from .cells import FLAGS as FLAGS
from .decks import Deck as Deck
from .decks import DeckFile as DeckFile
from .decks import check_deck as check_deck
from .decks import read_deck as read_deck
from .decks import write_deck as write_deck
from .listing import Case as Case
from .listing import DamagedListing as DamagedListing
from .listing import Listing as Listing
from .reading import iterate as iterate
from .reading import read as read
from .runs import run_deck as run_deck
from .runs import run_folder as run_folder
from .runs import split_deck as split_deck

"""Public names of `datcom_io`."""

from . import arrays as arrays
from . import decks as decks
from . import drawings as drawings
from . import exchange as exchange
from . import printout as printout
from . import reading as reading
from . import runs as runs
from .arrays.grid import join as join
from .arrays.grid import to_grid as to_grid
from .cells import FLAGS as FLAGS
from .decks.check import check_deck as check_deck
from .decks.deck import Deck as Deck
from .decks.deck_file import DeckFile as DeckFile
from .decks.deck_file import read_deck as read_deck
from .decks.deck_file import write_deck as write_deck
from .listing import Case as Case
from .listing import DamagedListing as DamagedListing
from .listing import Listing as Listing
from .reading.reader import iterate as iterate
from .reading.reader import read as read
from .runs.running import run_deck as run_deck
from .runs.running import run_folder as run_folder
from .runs.splitting import split_deck as split_deck

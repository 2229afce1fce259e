"""Public names of `datcom_io.decks`."""

from .cards import DeckFinding as DeckFinding
from .check import check_deck as check_deck
from .deck import Deck as Deck
from .deck_file import DeckFile as DeckFile
from .deck_file import read_deck as read_deck
from .deck_file import write_deck as write_deck

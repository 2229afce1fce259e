"""Public names of `datcom_io.decks` and where they are defined; ``__init__.py`` loads them from this list."""

from .cards import DeckFinding as DeckFinding
from .check import check_deck as check_deck
from .deck import Deck as Deck
from .file import DeckFile as DeckFile
from .file import read_deck as read_deck
from .writing import write_deck as write_deck

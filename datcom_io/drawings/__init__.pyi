"""Public names of `datcom_io.drawings`."""

from .deck_shape import DeckShape as DeckShape
from .deck_shape import shape_of_deck as shape_of_deck
from .three_view import draw_deck as draw_deck

"""Public names of `datcom_io.reading` and where they are defined; ``__init__.py`` loads them from this list."""

from .places import Place as Place
from .places import listings_in as listings_in
from .places import place_of as place_of
from .places import read_place as read_place
from .reader import iterate as iterate
from .reader import read as read

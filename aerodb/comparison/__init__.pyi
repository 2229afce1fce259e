"""Public names of `aerodb.comparison` and where they are defined; ``__init__.py`` loads them from this list."""

from .along_record import read_conditions as read_conditions
from .comparison import compare as compare

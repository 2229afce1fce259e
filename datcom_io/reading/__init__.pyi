"""Public names of `datcom_io.reading` and where they are defined; ``__init__.py`` loads them from this list."""

from .reader import iterate as iterate
from .reader import read as read

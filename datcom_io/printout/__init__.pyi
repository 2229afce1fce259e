"""Public names of `datcom_io.printout` and where they are defined; ``__init__.py`` loads them from this list."""

from .content import Message as Message
from .content import Page as Page
from .tables import Table as Table
